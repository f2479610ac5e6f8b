"""L-flow test (JSCE-F 514): concrete runs from an upright column into a level channel; its distance over time.

Source: column about 400 x 200 x 100 mm, channel 200 mm wide, from memory: the standard's table could not be confirmed.
Assumed besides: an opening 150 mm high, as of the L-box, and a channel of 900 mm in front of it. All are keywords.
Run time: about half a CPU-minute at the default spacing, on a busy machine, and up to 20 s to compile.
"""

import sys
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

import taichi_mps as mps
from taichi_mps.units import Duration, Length, Only, Speed

IN_SPACE = Only("model", ("half", "full"))


@mps.checked
def scene(
    material: mps.Concrete = mps.Bingham(yield_value=100.0, plastic_viscosity=50.0),
    spacing: Length = 0.0125,
    column_depth: Length = Field(0.1, description="length of the column of concrete"),
    column_height: Length = Field(0.4, description="height of the column of concrete"),
    width: Annotated[Length, IN_SPACE] = Field(0.2, description="width of the vessel"),
    opening: Length = Field(0.15, description="height of the gate"),
    channel_length: Length = Field(0.9, description="length of the channel in front of the gate"),
    sides: Annotated[Literal["smooth", "rough"], IN_SPACE] = "smooth",
    lift_speed: Speed | None = None,
    until: Duration = 5.0,
    model: Literal["half", "plane", "full"] = "half",
) -> mps.Scene:
    """L-shaped vessel with a rough floor; upright walls have no friction, or are rough, too, and then hold back a layer
    a spacing thick. The gate is gone at t = 0, or a smooth plate on the outer face of the column, a spacing in front of
    the opening, is lifted from then on with ``lift_speed`` [m/s]; what fills that spacing is missing at the top, so
    that the vessel holds its volume. Model half computes one side of the middle plane, plane leaves out the side walls,
    full has the whole width, for walls of particles, which are rough."""
    if not opening < column_height:
        raise mps.SceneError(
            f"opening = {opening:g} m: must be less than column_height = {column_height:g} m; a wall is above it"
        )
    plane, full, half, slip = model == "plane", model == "full", 0.5 * width, sides == "smooth"
    length, reach = column_depth + channel_length, 2.5 * spacing
    cell, along = 0.5 * spacing, None if plane else (-(half if full else 0.0) - 2 * spacing, half + 2 * spacing)

    def at(x, z, y=0.0):
        return (float(x), float(z)) if plane else (float(x), float(y), float(z))

    trough = [(0.0, column_height), (0.0, 0.0), (length, 0.0), (length, opening)]
    gate = [(column_depth, opening), (column_depth, column_height)]
    column, channel = (
        [(0.0, 0.0), (column_depth, 0.0), *gate[1:], trough[0]],
        [gate[0], (column_depth, 0.0), *trough[2:]],
    )
    mirrors = () if plane or full else (mps.Plane((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), mirror=True),)
    floor, back, end = ((at(0, 0), at(0, 1)), (at(0, 0), at(1, 0)), (at(length, 0), at(-1, 0)))
    side = () if plane else (((0.0, half, 0.0), (0.0, -1.0, 0.0)),)
    side += (((0.0, -half, 0.0), (0.0, 1.0, 0.0)),) if full else ()
    left, right, top = column_depth, column_depth + 3 * spacing, column_height + 2 * spacing
    front = mps.Solid.prism(
        [(left, opening), (right, opening), (right, top), (left, top)], cell, reach, along, slip=slip
    )
    margin = reach if mirrors else 3.5 * spacing
    upright = (mps.Plane(*wall, slip=slip) for wall in (back, end, *side))
    walls = (mps.Plane(*floor), *upright, *mirrors, front)
    fluid = mps.fill(mps.Box(at(0, 0, -half), at(column_depth, column_height, half)), spacing, mirrors)
    if lift_speed:
        left, right, top = column_depth + spacing, column_depth + 2 * spacing, opening + spacing
        corners = [(left, -reach), (right, -reach), (right, top), (left, top)]
        walls += (mps.Solid.prism(corners, cell, reach, along, velocity=at(0, lift_speed), slip=True, loose=True),)
        under = fluid[(fluid[:, 0] > column_depth - spacing) & (fluid[:, -1] < opening - 0.4 * spacing)]
        from_the_top = np.lexsort((fluid[:, 0], -fluid[:, -1]))  # at the same height what is farthest from the gate
        fluid = np.vstack([fluid[np.sort(from_the_top[len(under) :])], under + at(spacing, 0)])
    area = len(fluid) * spacing**2 / (1.0 if plane else (2 if full else 1) * half / spacing)  # of the section [m2]
    thick = 3 * spacing
    low, high = at(-thick, -thick, -half - thick), at(length + thick, top, half + thick)
    wall_particles = (
        mps.behind(walls, mps.lattice(low, high, spacing), thick) if full or plane and not lift_speed else None
    )

    def measure(s):
        low, high = (0.25 * column_depth, -0.25 * width), (0.75 * column_depth, 0.25 * width)
        return {
            "flow_m": mps.measure.front(s)["front_m"] - column_depth,
            "drop_m": column_height - mps.measure.level(s, low[: s.x.shape[1] - 1], high[: s.x.shape[1] - 1]),
            **mps.measure.grains(s, lambda x: x[:, 0] > column_depth),
        }

    def over_time(history):
        """Time to 100 mm in front of the gate, and the mean speed between 50 and 100 mm."""
        t50, t100 = (mps.measure.time_of(history["time_s"], history["flow_m"], d) for d in (0.05, 0.1))
        return {"t100_s": t100, "early_speed_m_s": 0.05 / max(t100 - t50, 1e-9)}

    def check(s, measures):
        """Check that the fluid is in the vessel, and at rest as far as in the closed form of a channel without a
        column, within 5 % and a spacing."""
        assert mps.measure.clearance(s, walls) > 0.0, "leak through a wall"
        assert 0.0 <= measures["drop_m"] < column_height and measures["flow_m"] > -spacing, measures
        if (
            material.yields
            and not material.ages
            and measures["flow_m"] < channel_length - spacing
            and s.speed.max() < 0.002
        ):
            between = None if plane or slip else width
            mix = material.density, material.yield_value
            x, _ = mps.rest_shapes.channel_at_rest(area, *mix, between, normal_stress=True)
            assert abs(measures["flow_m"] + column_depth - x[-1]) < 0.05 * x[-1] + spacing, (measures, x[-1])

    return mps.Scene(
        name="l_flow",
        material=material,
        spacing=spacing,
        fluid=fluid,
        walls=walls,
        wall_particles=wall_particles,
        domain=(at(-margin, -margin, -margin - half * full), at(length + margin, 1.2 * column_height, half + margin)),
        until=until,
        stop_at_rest=True,
        vessel=mps.vessel([trough, gate], [column, channel], 0.0 if plane else half),
        measure=measure,
        over_time=over_time,
        check=check,
    )


if __name__ == "__main__":
    sys.exit(mps.main(["run", __file__, *sys.argv[1:]]))
