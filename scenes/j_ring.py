"""J-ring test (EN 12350-12): slump flow through a ring of bars; the step between inside and outside.

Source: ring 300 mm, bars of 18 mm, 16 (gap 41 mm) or 12 (gap 59 mm): pages named in docs/scenes/index.md; 125 mm high:
not confirmed. The cone is that of the slump test, gone at once. Blocking step: mean depth within 50 mm of the axis,
less that just outside.
Run time: about 20 CPU-seconds at the default spacing, on a busy machine, and up to 20 s to compile.
"""

import sys
from dataclasses import replace
from typing import Literal

import numpy as np
from pydantic import Field

import taichi_mps as mps
from taichi_mps.units import Count, Duration, Length

BASE = 0.2  # diameter of the base of the cone [m]
INNER, OUTER = 0.05, 0.025  # radius of the middle, and width of the ring outside the bars, where depths are read [m]


@mps.checked
def scene(
    material: mps.Concrete = mps.Bingham(yield_value=40.0, plastic_viscosity=20.0),
    spacing: Length = 0.01,
    bars: Count = Field(16, description="bars of the ring"),
    bar_diameter: Length = Field(0.018, description="diameter of the bars"),
    ring_diameter: Length = Field(0.3, description="diameter of the ring"),
    ring_height: Length = Field(0.125, description="height of the ring"),
    until: Duration = 5.0,
    model: Literal["quarter", "full"] = "quarter",
) -> mps.Scene:
    """A quarter of the slump cone and of the ring, none of whose bars stands on a mirror plane; or all of it."""
    quarter = model == "quarter"
    if quarter and bars % 4:
        raise mps.SceneError(f"bars = {bars}: must be a multiple of 4, or model = full")
    gap = np.pi * ring_diameter / bars - bar_diameter
    if gap <= 0.0:
        raise mps.SceneError(f"bars = {bars}: leave no gap; must be fewer, or thinner than {1e3 * bar_diameter:g} mm")
    if ring_diameter < BASE + bar_diameter:
        raise mps.SceneError(
            f"ring_diameter = {ring_diameter:g} m: must be at least {BASE + bar_diameter:g} m, around the cone's base"
        )
    if gap < 2.0 * spacing:
        raise mps.SceneError(
            f"spacing = {spacing:g} m: must be at most half of the gap between bars, {0.5 * gap:.3g} m"
        )
    cone = mps.slump_cone(material, spacing=spacing, until=until, model=model, floor_radius=0.4)
    ring, thick = 0.5 * ring_diameter, 0.5 * bar_diameter
    angles = (np.arange(bars) + 0.5) * 2.0 * np.pi / bars
    places = ring * np.stack([np.cos(angles), np.sin(angles)], -1)
    reach = 2.5 * spacing
    solid = mps.Solid.bars(
        places[: bars // 4 if quarter else bars],
        thick,
        (-reach, ring_height),
        min(0.5 * spacing, 0.4 * thick),
        reach,
        name="bars",
    )
    walls = (*cone.walls, solid)
    circle = np.linspace(0.0, 2.0 * np.pi, 73)
    rim = np.column_stack([ring * np.cos(circle), ring * np.sin(circle), np.full(73, ring_height)])
    upright = [np.array([[*place, 0.0], [*place, ring_height]]) for place in places]

    def measure(s):
        r = np.hypot(s.x[:, 0], s.x[:, 1])
        first, last = ring + thick, ring + thick + OUTER
        inside = mps.measure.depth(s, r < INNER, np.pi * INNER**2)
        outside = mps.measure.depth(s, (r > first) & (r < last), np.pi * (last**2 - first**2))
        passing = mps.measure.grains(s, lambda x: np.hypot(x[:, 0], x[:, 1]) > first)
        return {**cone.measure(s), "blocking_step_m": inside - outside, **passing}

    def over_time(history):
        """Time to a slump flow of 500 mm."""
        return {"t500_s": mps.measure.time_of(history["time_s"], history["spread_m"], 0.5)}

    def check(s, measures):
        """Check that the concrete is on the floor and in no bar, falls outwards, and is no wider than without ring."""
        assert mps.measure.clearance(s, walls) > 0.0, "leak through a wall or a bar"
        assert 0.2 - 2 * spacing < measures["spread_m"] and 0.0 <= measures["slump_m"] < 0.3, measures
        if material.yields and s.speed.max() < 0.01:
            volume = (4 if quarter else 1) * len(cone.fluid) * spacing**3
            widest = mps.rest_shapes.spread_at_rest(volume, material.density, material.yield_value)
            assert measures["spread_m"] < 1.05 * widest and measures["blocking_step_m"] > -0.5 * spacing, measures

    return replace(
        cone, name="j_ring", walls=walls, measure=measure, over_time=over_time, check=check, wall_particles=None,
        outline=(rim, *upright),
    )  # fmt: skip


if __name__ == "__main__":
    sys.exit(mps.main(["run", __file__, *sys.argv[1:]]))
