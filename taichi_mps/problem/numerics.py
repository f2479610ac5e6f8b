"""Numerics: how a scene is to be computed, by which scheme."""

from typing import ClassVar, Literal

from pydantic import Field

from ..units import Checked, Count, Duration, RadiusRatio, Ratio


class Implicit(Checked):
    """Numerics of the default scheme: implicit viscosity, pressure and yield stress together."""

    scheme: ClassVar[str] = "implicit"
    unyielded_stop: ClassVar[None] = None  # of the paper's scheme only

    walls: Literal["surfaces", "particles"] = "surfaces"
    courant_number: Ratio = 0.2
    max_time_step: Duration | None = None
    tolerance: Ratio = 3e-3
    passes: Count = 6
    effective_radius_ratio: RadiusRatio = 2.1
    sleep: bool = Field(False, description="leave out of the solve what has come to rest")


class SemiImplicit(Checked):
    """Numerics of Tomiyama et al. (2009): explicit viscosity, semi-implicit pressure. Defaults are the paper's."""

    scheme: ClassVar[str] = "semi-implicit"
    walls: ClassVar[str] = "particles"

    source: Literal["density", "mixed"] = "density"
    gradient: Literal["literal", "conservative"] = "literal"
    courant_number: Ratio = 0.2
    diffusion_number: Ratio = 0.2
    first_time_step: Duration = 1e-3
    max_time_step: Duration = 1e-3
    picard_tolerance: Ratio = 0.05
    picard_limit: Count = 20
    tolerance: Ratio = 1e-5
    unyielded_stop: Ratio = 0.9
    effective_radius_ratio: RadiusRatio = 2.1


NUMERICS = {kind.scheme: kind for kind in (Implicit, SemiImplicit)}
