"""U-box test (JSCE-F 511): concrete rises in the second leg of a U through a gate with bars; the two levels.

Source: height 680 mm, width 200 mm, legs 140 mm deep, gate 190 mm high, 3 bars of 13 mm 50 mm apart, about 20 l: bars
and volume as quoted, the rest from memory, fairly sure. The bottom is flat here; the wall between is 3 l0 thick.
Run time: about two CPU-minutes at the default spacing, on a busy machine, and up to 20 s to compile.
"""

import sys
from typing import Literal

import numpy as np
from pydantic import Field

import taichi_mps as mps
from taichi_mps.units import Duration, Length

BAR_DIAMETER, BAR_DISTANCE, BAR_COUNT = 0.013, 0.05, 3  # diameter and distance of axes [m], number of the bars


@mps.checked
def scene(
    material: mps.Concrete = mps.Bingham(yield_value=40.0, plastic_viscosity=20.0),
    spacing: Length = 0.0125,
    leg: Length = Field(0.14, description="length of each leg"),
    width: Length = Field(0.2, description="width of the vessel"),
    height: Length = Field(0.68, description="height of the vessel"),
    opening: Length = Field(0.19, description="height of the opening between the legs"),
    bars: Literal["yes", "no"] = Field("yes", description="reinforcing bars in the opening"),
    sides: Literal["smooth", "rough"] = "smooth",
    until: Duration = 3.0,
    model: Literal["half", "full"] = "half",
) -> mps.Scene:
    """Two legs on a rough floor; upright walls have no friction, or are rough and then hold back a layer a spacing
    thick. The first is filled to the brim; the gate between them is gone at t = 0. One side of the middle plane is
    computed, or all. The bars stand in the middle of the opening."""
    if not opening < height:
        raise mps.SceneError(f"opening = {opening:g} m: must be less than height = {height:g} m; a wall is above it")
    half, reach, thick, cell = 0.5 * width, 2.5 * spacing, 3 * spacing, 0.5 * spacing
    far, slip, full = 2 * leg + thick, sides == "smooth", model == "full"
    first = -half if full else 0.0  # where the computed part begins [m]
    corners = [(leg, opening), (leg + thick, opening), (leg + thick, height + reach), (leg, height + reach)]
    mirror = mps.Plane((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), mirror=True)
    near = mps.Plane((0.0, -half, 0.0), (0.0, 1.0, 0.0), slip=slip) if full else mirror
    walls = (
        mps.Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
        mps.Plane((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), slip=slip),
        mps.Plane((far, 0.0, 0.0), (-1.0, 0.0, 0.0), slip=slip),
        mps.Plane((0.0, half, 0.0), (0.0, -1.0, 0.0), slip=slip),
        near,
        mps.Solid.prism(corners, cell, reach, (first - 2 * spacing, half + 2 * spacing), slip=slip),
    )
    fluid = mps.fill(mps.Box((0.0, -half, 0.0), (leg, half, height)), spacing, () if full else (mirror,))
    across = BAR_DISTANCE * (np.arange(BAR_COUNT) - 0.5 * (BAR_COUNT - 1))
    middle, outline = leg + 0.5 * thick, ()
    if bars == "yes":
        places = [(middle, y) for y in across if y > first - 1e-9]
        walls += (
            mps.Solid.bars(places, 0.5 * BAR_DIAMETER, (-reach, opening), 0.4 * BAR_DIAMETER, reach, name="bars"),
        )
        outline = tuple(
            np.array([[middle + dx, y, 0.0], [middle + dx, y, opening]])
            for y in across
            for dx in (-0.5 * BAR_DIAMETER, 0.5 * BAR_DIAMETER)
        )
    legs, gate = (
        [(0.0, height), (0.0, 0.0), (far, 0.0), (far, height)],
        [((x, opening), (x, height)) for x in (leg, leg + thick)],
    )
    parts = (0.0, leg, height), (leg, leg + thick, opening), (leg + thick, far, height)
    sides = [[(a, 0.0), (b, 0.0), (b, top), (a, top)] for a, b, top in parts]
    filled = len(fluid) * spacing**3 / ((half - first) * leg)  # mean height of what fills the first leg [m]

    def measure(s):
        middle, y = 0.25 * leg, 0.25 * width
        h1, h2 = (mps.measure.level(s, (x + middle, -y), (x + leg - middle, y)) for x in (0.0, far - leg))
        passing = mps.measure.grains(s, lambda at: at[:, 0] > leg + 0.5 * (thick + BAR_DIAMETER))
        return {"h1_m": h1, "h2_m": h2, "step_m": h1 - h2, **passing}

    def over_time(history):
        """Time in which the second leg is filled to 300 mm."""
        return {"t300_s": mps.measure.time_of(history["time_s"], history["h2_m"], 0.3)}

    def check(s, measures):
        """Check that the concrete is in the vessel, and at rest that the volume fills both legs and the opening, and
        that the levels differ by no more than the walls and the bars, if any, can hold."""
        assert mps.measure.clearance(s, walls) > 0.0, "leak through a wall or a bar"
        assert max(measures["h1_m"], measures["h2_m"]) < height + spacing, measures
        if s.speed.max() < 0.01 and not material.ages:
            drag = far / opening + (0.0 if slip else 2.0 * (1.0 / leg + 1.0 / width) * filled)
            held = material.yield_value / (9.81 * material.density) * drag + 2.0 * spacing
            assert -held < measures["step_m"] < held or bars == "yes", (measures, held)
            both = measures["h1_m"] + measures["h2_m"] + thick * opening / leg
            assert not slip or abs(both - filled) < 3.0 * spacing, (measures, filled)

    return mps.Scene(
        name="u_box",
        material=material,
        spacing=spacing,
        fluid=fluid,
        walls=walls,
        # the far wall throws drops up
        domain=((-reach, first - reach, -reach), (far + reach, half + reach, 2.2 * height)),
        until=until,
        stop_at_rest=True,
        measure=measure,
        over_time=over_time,
        check=check,
        outline=outline,
        vessel=mps.vessel([legs, *gate], sides, half),
    )


if __name__ == "__main__":
    sys.exit(mps.main(["run", __file__, *sys.argv[1:]]))
