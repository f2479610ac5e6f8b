"""From concrete to the mortar between its coarse aggregate, and back: yield stress and plastic viscosity.

Source: Chateau, Ovarlez and Trung (2008), Journal of Rheology 52, 489-506, arXiv 1006.2293; phi_m and its range by
Mahaut, Chateau, Coussot and Ovarlez (2008), Journal of Rheology 52, 287-313. The abstracts were read; phi_m, the
exponent and the range are from memory.
"""

import math

from pydantic import Field

from ..units import Checked, Viscosity, YieldValue, real

PACKING = 0.57  # phi_m of spheres of one size [-]
MOST = 0.5  # volume fraction [-] up to which spheres of one size were measured


def growth(volume: float) -> dict[str, float]:
    """Constants of a suspension of spheres in a Bingham fluid over those of the fluid [-], at this volume fraction.

    With g = (1 - phi/phi_m)^(-2.5 phi_m), Krieger and Dougherty: sqrt((1 - phi) g) of the yield stress, g of the
    plastic viscosity.
    """
    viscosity = (1.0 - volume / PACKING) ** (-2.5 * PACKING)
    return {"yield_value": math.sqrt((1.0 - volume) * viscosity), "plastic_viscosity": viscosity}


class Suspension(Checked):
    """Constants of a concrete or of a mortar, and the volume fraction of the coarse aggregate."""

    yield_value: YieldValue = Field(300.0, description="yield stress, measured of the concrete or the mortar")
    plastic_viscosity: Viscosity = Field(50.0, description="plastic viscosity of the same")
    grains_volume: real("-", gt=0.0, le=MOST) = Field(0.3, description="volume of the grains over that of the concrete")

    def facts(self) -> dict[str, dict[str, float]]:
        """Constants of the ``mortar`` in such a concrete, and of the ``concrete`` of such a mortar, SI units."""
        by = growth(self.grains_volume)
        return {
            "mortar": {name: getattr(self, name) / factor for name, factor in by.items()},
            "concrete": {name: getattr(self, name) * factor for name, factor in by.items()},
        }

    def __str__(self):
        within, made = ([f"{value:.3g}" for value in constants.values()] for constants in self.facts().values())
        given, part = f"{self.yield_value:g} Pa and {self.plastic_viscosity:g} Pa s", f"{100 * self.grains_volume:g} %"
        return (
            f"A concrete of {given} with {part} of grains has a mortar of {within[0]} Pa and {within[1]} Pa s.\n"
            f"A mortar of {given} makes with {part} of grains a concrete of {made[0]} Pa and {made[1]} Pa s.\n"
            f"For spheres of one size, up to {100 * MOST:g} % (Chateau, Ovarlez and Trung 2008): a grading thickens "
            "less, crushed stone more.\n"
            f"To run it: taichi-mps run slump --yield-stress {within[0]} --plastic-viscosity {within[1]} --grains 16mm "
            f"--grains-volume {self.grains_volume:g}"
        )
