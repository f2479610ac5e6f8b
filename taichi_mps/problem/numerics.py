"""Numerics: how a scene is to be computed, by which scheme. Each number is declared here and nowhere else."""

from typing import ClassVar, Literal

from pydantic import Field, model_validator

from ..units import Checked, Count, Duration, RadiusRatio, Ratio

COURANT = "largest way of a particle in a step over the spacing"
RADIUS = "effective radius r_e over the spacing: farther particles are no neighbours"


class Implicit(Checked):
    """Numerics of the default scheme: implicit viscosity, pressure and yield stress together.

    ``passes`` is the number of augmented-Lagrangian (Uzawa) iterations of a step: each solves for the velocity and then
    corrects stress and pressure. The last solve stops at ``tolerance``, those before at ten times that.
    ``sleep``: whether what stands still is left out of the steps (the active set, particles/active_set.py).
    """

    scheme: ClassVar[str] = "implicit"
    unyielded_stop: ClassVar[None] = None  # of the paper's scheme only

    walls: Literal["surfaces", "particles"] = Field("surfaces", description="how walls are represented")
    courant_number: Ratio = Field(0.2, description=COURANT)
    max_time_step: Duration | None = Field(None, description="longest step, by default what resolves the flow")
    tolerance: Ratio = Field(3e-3, description="relative residual at which a velocity solve stops")
    passes: Count = Field(6, description="augmented-Lagrangian (Uzawa) iterations a step")
    effective_radius_ratio: RadiusRatio = Field(2.1, description=RADIUS)
    wall_loads: bool = Field(False, description="measure force and torque of the fluid on each wall")
    sleep: Literal["auto", "on", "off"] = Field(
        "auto", description="leave what stands still out of the steps; auto: where there are particles enough"
    )


class SemiImplicit(Checked):
    """Numerics of Tomiyama et al. (2009): explicit viscosity, semi-implicit pressure; the numbers are the paper's.

    By default with what the practice of MPS adds (S1-S5); ``literal``: its equations alone, with neither collisions nor
    shift, and with negative pressures. Each form has its ``source``, the right-hand side of the pressure equation (the
    deviation of the particle number density, alone or mixed with the divergence), and its ``gradient`` of the pressure
    (less the smallest around a particle, the paper's, or one that conserves momentum); either can be given.
    ``picard_tolerance`` and ``picard_limit`` stop the direct (Picard) iterations of the apparent viscosity.
    """

    scheme: ClassVar[str] = "semi-implicit"
    walls: ClassVar[str] = "particles"

    literal: bool = Field(False, description="the paper's equations alone, without what practice adds")
    source: Literal["density", "mixed"] | None = Field(
        None, description="right-hand side of the pressure equation, by default mixed, if literal density"
    )
    gradient: Literal["smallest", "literal", "conservative"] | None = Field(
        None, description="discrete gradient of the pressure, by default smallest, if literal that of the paper"
    )
    courant_number: Ratio = Field(0.2, description=COURANT)
    diffusion_number: Ratio = Field(0.2, description="largest viscosity times step over density and spacing squared")
    first_time_step: Duration = Field(1e-3, description="first step")
    max_time_step: Duration = Field(1e-3, description="longest step")
    picard_tolerance: Ratio = Field(0.05, description="relative change of the viscosity that ends the iteration")
    picard_limit: Count = Field(20, description="direct (Picard) iterations of the viscosity a step, at most")
    tolerance: Ratio = Field(1e-5, description="relative residual at which the pressure solve stops")
    unyielded_stop: Ratio = Field(0.9, description="unyielded fraction of the particles at which the run ends")
    effective_radius_ratio: RadiusRatio = Field(2.1, description=RADIUS)

    @model_validator(mode="before")
    @classmethod
    def _complete(cls, values):
        """A form is a named set of source and gradient, of which each can be given by itself."""
        form = FORMS[bool(values.get("literal"))]
        return values | {key: form[key] for key in form if values.get(key) is None}


FORMS = {  # source and gradient, of the literal form and of the default
    True: {"source": "density", "gradient": "literal"},
    False: {"source": "mixed", "gradient": "smallest"},
}

NUMERICS = {kind.scheme: kind for kind in (Implicit, SemiImplicit)}
