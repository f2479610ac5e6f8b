"""L-box test (EN 12350-10): concrete runs from a column between bars into a channel; the levels at its ends, H2/H1.

Source: 2 or 3 bars, gaps of 59 or 41 mm, H2/H1: the standard as quoted, sure; bars of 12 mm fit these gaps. Column
600 x 200 x 100 mm, channel 700 mm from the back wall, opening 150 mm: from memory (EFNARC 2002), fairly sure. H1 and
H2, mean depths at three places across the width, H1 immediately behind the gate, H2 at the end of the channel: from
memory (European Guidelines for SCC, 2005, annex B.4). Place of the bars and breadth of a reading: assumed.
Run time: about one and a half CPU-minutes at the default spacing, on a busy machine, and up to 20 s to compile.
"""

import math
import sys
from dataclasses import replace
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

import taichi_mps as mps
from taichi_mps.input import catalogue
from taichi_mps.units import Duration, Length, Only, Speed

# depth, height, diameter, centre in front of the column [m]
COLUMN, OPENING, BAR_DIAMETER, BAR_POSITION = 0.1, 0.15, 0.012, 0.05
RULE = 0.025  # side of the square on which the foot of a rule stands [m]


@mps.checked
def scene(
    material: mps.Concrete = mps.Bingham(yield_value=40.0, plastic_viscosity=20.0),
    spacing: Length = 0.0125,
    bars: Literal["none", "2", "3"] = Field("3", description="reinforcing bars behind the gate"),
    length: Length = Field(0.7, description="length of the vessel"),
    width: Length = Field(0.2, description="width of the vessel"),
    height: Length = Field(0.6, description="height of the column of concrete"),
    sides: Annotated[Literal["smooth", "rough"], Only("model", ("half", "full"))] = "smooth",
    lift_speed: Speed | None = None,
    until: Duration = 4.0,
    model: Literal["half", "full", "slice"] = "half",
) -> mps.Scene:
    """The vessel of l_flow with a far wall at ``length`` [m] and upright bars, evenly spaced, behind the gate. Model
    slice is one bar and its gap, without side walls, periodic across: as wide as the next whole number of particles, by
    which the bar is thinner or thicker than 12 mm; the gap is that of the box."""
    if not length > COLUMN + 2 * BAR_POSITION:
        raise mps.SceneError(
            f"length = {length:g} m: must be greater than {COLUMN + 2 * BAR_POSITION:g} m, column and bars"
        )
    count, diameter, is_slice = 0 if bars == "none" else int(bars), BAR_DIAMETER, model == "slice"
    clear = (width - count * BAR_DIAMETER) / (count + 1)
    if is_slice:
        if not count:
            raise mps.SceneError("bars = none: must be 2 or 3 of model = slice, which is one bar and its gap")
        width, count = round((clear + BAR_DIAMETER) / spacing) * spacing, 1
        diameter, clear = width - clear, 0.5 * clear  # on either side
        if not 0.5 * BAR_DIAMETER < diameter < 1.5 * BAR_DIAMETER:
            raise mps.SceneError(f"spacing = {spacing:g} m: leaves a bar of {diameter:g} m; must be smaller")
    whole = "full" if is_slice else model
    keywords = dict(spacing=spacing, width=width, sides=sides, lift_speed=lift_speed, until=until, model=whole)
    keywords |= dict(column_height=height, opening=OPENING, channel_length=length - COLUMN)
    vessel = catalogue.build("l_flow", **keywords, **material.model_dump())
    half, outline, x, reach = 0.5 * width, (), COLUMN + BAR_POSITION, 2.5 * spacing
    if is_slice:
        low, high = vessel.domain
        vessel = replace(
            vessel,
            walls=tuple(wall for wall in vessel.walls if not (isinstance(wall, mps.Plane) and wall.normal[1])),
            domain=((low[0], -half, low[2]), (high[0], half, high[2])),
            periodic=(False, True, False),
            wall_particles=None,
        )
    walls = vessel.walls
    if count:
        across = -half + clear + 0.5 * diameter + (clear + diameter) * np.arange(count)
        places = [(x, y) for y in across if y > -1e-9 or model != "half"]
        places += [(x, -width), (x, width)] if is_slice else []  # images: a grain in the gap is between two
        walls += (mps.Solid.bars(places, 0.5 * diameter, (-reach, OPENING), 0.4 * diameter, reach, name="bars"),)
        outline = tuple(
            np.array([[x + dx, y, 0.0], [x + dx, y, OPENING]])
            for y in across
            for dx in (-0.5 * diameter, 0.5 * diameter)
        )

    def depth(s, end):
        """Mean [m] of three depths at places evenly spaced across the width, each of a square that ends at x [m]."""
        places = (
            np.array([(end - RULE, y - 0.5 * RULE), (end, y + 0.5 * RULE)]) for y in (-0.25 * width, 0.0, 0.25 * width)
        )
        return float(np.mean([mps.measure.standing_level(s, *place) for place in places]))

    def measure(s):
        h1, h2 = depth(s, COLUMN), depth(s, length)
        front, ratio = mps.measure.front(s)["front_m"], h2 / h1 if h1 > 0.0 else np.nan
        passing = mps.measure.grains(s, lambda at: at[:, 0] > x + 0.5 * diameter)
        return {"front_m": front, "h1_m": h1, "h2_m": h2, "passing_ratio": ratio, **passing}

    def over_time(history):
        """Times at which the front is 200 and 400 mm from the column."""
        return {
            f"t{mm}_s": mps.measure.time_of(history["time_s"], history["front_m"], COLUMN + 1e-3 * mm)
            for mm in (200, 400)
        }

    def check(s, measures):
        """Check that the concrete is in the vessel, and at rest that the levels differ by no more than in the closed
        form and half a spacing, in either direction, for a wave may come back late; bars may hold more on their side.
        The closed form is that of a thin layer. Concrete stretched as it leaves the column and compressed as the far
        wall stops it has a normal stress of +-pi/2 tau_y besides, which balances a step of pi tau_y/(rho g)."""
        assert mps.measure.clearance(s, walls) > 0.0, "leak through a wall or a bar"
        assert 0.0 <= measures["h2_m"] < height and measures["h1_m"] < height + spacing, measures
        if material.yields and not material.ages and s.speed.max() < 0.01:
            area = len(vessel.fluid) * spacing**3 / (half if model == "half" else width)
            between = width if sides == "rough" else None
            at, h = mps.rest_shapes.channel_at_rest(area, material.density, material.yield_value, between, length)
            h1, h2 = np.interp([COLUMN - 0.5 * RULE, length - 0.5 * RULE], at, h, right=0.0)
            step = h1 - h2 + math.pi * material.yield_value / (material.density * 9.81) + 0.5 * spacing
            assert measures["h2_m"] - measures["h1_m"] < step, (measures, h1, h2)
            assert measures["h1_m"] - measures["h2_m"] < step or count, (measures, h1, h2)

    return replace(
        vessel, name="l_box", walls=walls, measure=measure, over_time=over_time, check=check, outline=outline
    )


if __name__ == "__main__":
    sys.exit(mps.main(["run", __file__, *sys.argv[1:]]))
