"""Mini-cone (Kantro): the slump flow of a cement paste from a small cone.

Source: Kantro's mini-slump cone, diameters 19 and 38.1 mm, height 57.2 mm: from memory, fairly sure. The flow cone of
JIS R 5201 is --base-diameter 0.1 --top-diameter 0.07 --height 0.06. There is no surface tension.
Run time: a quarter of a minute at the default spacing, most of it to compile.
"""

import sys
from dataclasses import replace
from typing import Literal

import numpy as np
from pydantic import Field

import taichi_mps as mps
from taichi_mps.units import Duration, Length, Speed


@mps.checked
def scene(
    material: mps.Concrete = mps.Bingham(yield_value=20.0, plastic_viscosity=1.0, density=1900.0),
    spacing: Length = 0.001,
    base_diameter: Length = Field(0.0381, description="diameter of the cone at its foot"),
    top_diameter: Length = Field(0.019, description="diameter of the cone at its top"),
    height: Length = Field(0.0572, description="height of the cone"),
    lift_speed: Speed | None = None,
    until: Duration = 3.0,
    model: Literal["axisymmetric", "quarter", "full"] = "axisymmetric",
) -> mps.Scene:
    """The slump test with a small cone. A mould that is lifted needs model axisymmetric, or full, which is best taken
    with a spacing of 2 mm."""
    cone = mps.Cone(0.5 * base_diameter, 0.5 * top_diameter, height)
    widest = 4.0 * height
    if material.yields:
        widest = mps.rest_shapes.spread_at_rest(cone.volume, material.density, material.yield_value)
    body = dict(base_diameter=base_diameter, top_diameter=top_diameter, height=height, spacing=spacing)
    body |= dict(lift_speed=lift_speed, until=until, model=model)
    slump = mps.slump_cone(material, floor_radius=max(0.75 * widest, 0.75 * base_diameter), **body)

    def check(s, measures):
        """Check that the paste is on the floor, and at rest as wide as in the closed form of a thin cake within its
        error, a depth at either end: these cakes are not thin. At 20 Pa finite elements without inertia are 12 %
        narrower; inertia widens them."""
        assert s.x[:, -1].min() > 0.0 and 0.0 <= measures["slump_m"] < height, measures
        assert measures["spread_m"] > base_diameter - 2 * spacing, measures
        if material.yields and not material.ages and s.speed.max() < spacing and widest > 2.0 * base_diameter:
            deep = np.sqrt(material.yield_value * widest / (material.density * 9.81))
            assert abs(measures["spread_m"] - widest) < 2.0 * deep, (measures, widest, deep)

    return replace(slump, name="mini_cone", check=check)


if __name__ == "__main__":
    sys.exit(mps.main(["run", __file__, *sys.argv[1:]]))
