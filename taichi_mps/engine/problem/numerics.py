"""Numerics: the scheme by which a scene is computed, and its parameters, each declared here and nowhere else."""

from typing import ClassVar, Literal

from pydantic import Field

from ...units import Checked, Count, Duration, Flag, RadiusRatio, Ratio, real

COURANT = "largest way of a particle in a step over the spacing"
RADIUS = "effective radius r_e over the spacing: farther particles are no neighbours"


class Implicit(Checked):
    """Numerics of the default scheme: viscosity, pressure and yield stress implicit, in one system.

    The parameters are the fields below.

    Raises
    ------
    SceneError
        If a number is out of range.

    Notes
    -----
    A step has ``passes`` augmented-Lagrangian (Uzawa) iterations, the outer iterations; each solves for the velocity
    and then corrects stress and pressure (eqs I5-I7). The last solve stops at ``tolerance``, those before at ten times
    that. With ``outer_tolerance`` the last iteration comes as soon as both residuals of the one before are below it.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> mps.Implicit(passes=3).tolerance
    0.003
    """

    scheme: ClassVar[str] = "implicit"
    unyielded_stop: ClassVar[None] = None  # of the paper's scheme only

    walls: Literal["surfaces", "particles"] = Field(default="surfaces", description="how walls are represented")
    courant_number: Ratio = Field(default=0.2, description=COURANT)
    max_time_step: Duration | None = Field(
        default=None, description="no step is longer; those that resolve the flow may be shorter"
    )
    tolerance: Ratio = Field(default=3e-3, description="relative residual at which a velocity solve stops")
    passes: Count = Field(default=6, description="augmented-Lagrangian (Uzawa) iterations a step")
    outer_tolerance: real("-", ge=0.0, le=1.0) = Field(
        default=0.0, description="residual below which a step ends its iterations; 0: never"
    )
    effective_radius_ratio: RadiusRatio = Field(default=2.1, description=RADIUS)
    wall_loads: Flag = Field(default=False, description="measure force and torque of the fluid on each wall")
    sleep: Literal["auto", "on", "off"] = Field(
        default="auto", description="leave what stands still out of the steps; auto: where there are particles enough"
    )


class SemiImplicit(Checked):
    """Numerics of Tomiyama et al. (2009): explicit viscosity, semi-implicit pressure.

    The parameters are the fields below; their defaults are the paper's numbers.

    Raises
    ------
    SceneError
        If a number is out of range.

    Notes
    -----
    By default the scheme has what the practice of MPS adds (S1-S5). With ``literal`` it is the paper's equations
    (1)-(29) alone, with neither collisions nor shift and with negative pressures.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> mps.SemiImplicit(literal=True).unyielded_stop
    0.9
    """

    scheme: ClassVar[str] = "semi-implicit"
    walls: ClassVar[str] = "particles"

    literal: Flag = Field(default=False, description="the paper's equations alone, without what practice adds")
    courant_number: Ratio = Field(default=0.2, description=COURANT)
    diffusion_number: Ratio = Field(
        default=0.2, description="largest viscosity times step over density and spacing squared"
    )
    first_time_step: Duration = Field(default=1e-3, description="first step")
    max_time_step: Duration = Field(default=1e-3, description="longest step")
    picard_tolerance: Ratio = Field(
        default=0.05, description="relative change of the velocity that ends the Picard iteration"
    )
    picard_limit: Count = Field(default=20, description="direct (Picard) iterations of the viscosity a step, at most")
    tolerance: Ratio = Field(default=1e-5, description="relative residual at which the pressure solve stops")
    unyielded_stop: Ratio = Field(default=0.9, description="unyielded fraction of the particles at which the run ends")
    effective_radius_ratio: RadiusRatio = Field(default=2.1, description=RADIUS)


NUMERICS = {kind.scheme: kind for kind in (Implicit, SemiImplicit)}
