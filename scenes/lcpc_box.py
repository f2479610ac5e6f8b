"""LCPC box: six litres spread in a long level box; the length they reach gives the yield stress.

Source: Roussel (2007), Mater. Struct., doi:10.1617/s11527-007-9230-4: box 1200 x 200 x 150 mm, 6 l; not confirmed.
There the concrete is poured slowly at one end; here a block of 200 x 200 x 150 mm stands there and is let go at t = 0.
Run time: three CPU-seconds to rest at the default spacing, six of a soft mix, and up to 20 s to compile.
"""

import sys
from typing import Annotated, Literal

from pydantic import Field

import taichi_mps as mps
from taichi_mps.units import Duration, Length, Only

IN_SPACE = Only("model", ("half",))
TO_REST, WITHOUT = 3600.0, 10.0  # time limits [s] of what comes to rest by itself, and of what does not


@mps.checked
def scene(
    material: mps.Concrete = mps.Bingham(yield_value=100.0, plastic_viscosity=20.0),
    spacing: Length = 0.0125,
    length: Length = Field(1.2, description="length of the box"),
    width: Annotated[Length, IN_SPACE] = Field(0.2, description="width of the box"),
    height: Length = Field(0.15, description="height of the box"),
    block: Length = Field(0.2, description="length of the concrete before it flows"),
    sides: Annotated[Literal["rough", "smooth"], IN_SPACE] = "rough",
    until: Duration | None = Field(
        None, description="time limit, by default an hour, or 10 s of what does not come to rest"
    ),
    model: Literal["half", "plane"] = "half",
) -> mps.Scene:
    """Box with a rough floor; upright walls are rough, too, or have no friction. A ``block`` of concrete this long
    fills one end of it up to the height. Model half computes one side of the middle plane, plane leaves out the side
    walls."""
    if not block < length:
        raise mps.SceneError(f"block = {block:g} m: must be less than length = {length:g} m, that of the box")
    plane, half, reach = model == "plane", 0.5 * width, 2.5 * spacing
    slip = sides == "smooth"

    def at(x, z, y=0.0):
        return (float(x), float(z)) if plane else (float(x), float(y), float(z))

    mirrors = () if plane else (mps.Plane((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), mirror=True),)
    side = () if plane else (((0.0, half, 0.0), (0.0, -1.0, 0.0)),)
    floor, back, end = ((at(0, 0), at(0, 1)), (at(0, 0), at(1, 0)), (at(length, 0), at(-1, 0)))
    walls = (mps.Plane(*floor), *(mps.Plane(*wall, slip=slip) for wall in (back, end, *side)), *mirrors)
    fluid = mps.fill(mps.Box(at(0, 0, -half), at(block, height, half)), spacing, mirrors)
    box = [(0.0, height), (0.0, 0.0), (length, 0.0), (length, height)]
    area = len(fluid) * spacing**2 / (1.0 if plane else half / spacing)  # of the section [m2]

    def measure(s):
        low, high = (0.02, -0.25 * width), (0.08, 0.25 * width)
        return {
            "front_m": mps.measure.front(s)["front_m"],
            "h1_m": mps.measure.level(s, low[: s.x.shape[1] - 1], high[: s.x.shape[1] - 1]),
        }

    def check(s, measures):
        """Check that the concrete is in the box, and at rest as long as in the closed form, within 5 % and a
        spacing."""
        assert mps.measure.clearance(s, walls) > 0.0, "leak through a wall"
        assert block < measures["front_m"] < length + spacing, measures
        if material.yields and not material.ages and s.speed.max() < 0.002:
            between = None if plane or slip else width
            mix = material.density, material.yield_value
            x, _ = mps.rest_shapes.channel_at_rest(area, *mix, between, length, normal_stress=True)
            assert abs(measures["front_m"] - x[-1]) < 0.05 * x[-1] + spacing, (measures, x[-1])

    return mps.Scene(
        name="lcpc_box",
        material=material,
        spacing=spacing,
        fluid=fluid,
        walls=walls,
        domain=(at(-reach, -reach, -reach), at(length + reach, 2.0 * height, half + reach)),
        until=until or (TO_REST if material.rests else WITHOUT),
        stop_at_rest=True,
        measure=measure,
        check=check,
        vessel=mps.vessel([box], [box], 0.0 if plane else half),
    )


if __name__ == "__main__":
    sys.exit(mps.main(["run", __file__, *sys.argv[1:]]))
