"""Wall poured from a hose: a form with two curtains of rebar, or one from CAD, filled from one end; what stays empty.

Source: no standard; bars and cover as in a thin wall of a building, the rate of a concrete pump (43 m3/h).
Run time: about two and a quarter CPU-minutes at the default spacing, on a busy machine, and up to 20 s to compile.
"""

import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

import taichi_mps as mps
from taichi_mps.units import Duration, FlowRate, Length, Only, Position, Ratio, Source

FREE = 0.06  # height of the mouth above the form [m]
NEAR, LIFT = 0.3, 0.3  # of a hose that rises: above the mean level; of what it places in one pass along the form [m]
WALL, FORM = Only("form", False), Only("form")
LONGEST = 24.0  # of a mesh, of which the bars are one [m]
LEAST, AFTER = 10.0, 5.0  # time limit: at least, and after the last layer [s]


@mps.checked
def scene(
    material: mps.Concrete = mps.Bingham(yield_value=60.0, plastic_viscosity=20.0),
    spacing: Length = 0.02,
    length: Annotated[Length, Field(le=LONGEST), WALL] = Field(0.8, description="length of the form"),
    width: Annotated[Length, WALL] = Field(0.2, description="thickness of the wall"),
    height: Annotated[Length, Field(le=LONGEST), WALL] = Field(0.4, description="height of the form"),
    bar_diameter: Annotated[Length, WALL] = Field(0.016, description="diameter of the reinforcing bars"),
    bar_distance: Annotated[Length, WALL, Only("rebar", False)] = Field(0.2, description="distance of the bars"),
    cover: Annotated[Length, WALL, Only("rebar", False)] = Field(0.03, description="concrete cover of the bars"),
    rebar: Annotated[Source, Field(description="mesh of one curtain (STL, OBJ, PLY), bars of its own by default")] = "",
    rebar_scale: Annotated[
        Ratio, Only("rebar"), Field(description="metres a unit of that file, 0.001 where it is in mm")
    ] = 1.0,
    form: Annotated[
        Source,
        Field(description="body to be cast, open at its highest face (STEP, STL, OBJ, PLY), in place of these walls"),
    ] = "",
    form_body: Annotated[
        str, FORM, Field(description="which body of an assembly in that file is cast, all by default")
    ] = "",
    form_scale: Annotated[
        Ratio, FORM, Field(description="metres a unit of that file; a STEP file has its own unit")
    ] = 1.0,
    fill_point: Annotated[
        tuple[Position, Position] | None,
        FORM,
        Field(description="x and y of the hose above that form, by default where it is widest"),
    ] = None,
    hose_diameter: Length = Field(0.12, description="diameter of the hose"),
    rate: FlowRate = Field(0.012, description="what the hose delivers"),
    hose: Annotated[
        Literal["above", "rising", "moving"],
        WALL,
        Field(description="where the hose is: fixed above the form, or near the concrete"),
    ] = "above",
    fill_ratio: Ratio = Field(0.95, description="fraction of the form that is poured"),
    sides: Literal["smooth", "rough"] = "smooth",
    model: Annotated[Literal["half", "full"], WALL] = "half",
    measure_pressure: Annotated[bool, WALL] = Field(False, description="measure the pressure on the sides"),
    until: Annotated[
        Duration | None, Field(description=f"time limit, by default {AFTER:g} s after pouring, {LEAST:g} s at least")
    ] = None,
) -> mps.Scene:
    """Half of the form, cut along its middle plane y = 0, and the curtain in it: upright bars and, inside of them,
    level ones; or the mesh of the file ``rebar`` (STL, OBJ, PLY) in its place; or all of it, as grains need it. A hose
    that is lowered into the form must fit between the two curtains. With ``form`` the whole of a body from CAD, without
    bars but those of ``rebar``.
    """
    if spacing > hose_diameter / 3.0 * (1.0 + 1e-9):
        raise mps.SceneError(f"spacing = {spacing:g} m: must be at most a third of the hose, {hose_diameter / 3.0:g} m")
    widest = min(width, length - 2.0 * spacing)
    if hose_diameter > widest and not form:
        raise mps.SceneError(f"hose_diameter = {hose_diameter:g} m: must be at most {widest:g} m, as wide as the form")
    if bar_distance <= bar_diameter and not (form or rebar):
        raise mps.SceneError(f"bar_distance = {bar_distance:g} m: must be more than the bars' {bar_diameter:g} m")
    half, smooth = 0.5 * width, sides == "smooth"
    if form:
        cell, reach = 0.5 * spacing, 2.5 * spacing
        bars = [mps.Solid.from_mesh(rebar, cell, reach, scale=rebar_scale, name="bars")] if rebar else []
        opening = FREE + 4.0 * spacing + reach  # so high the form goes on above its highest face, around the mouth
        about = {"scale": form_scale, "body": form_body, "open_top": opening, "slip": smooth, "name": "form"}
        solid = mps.Solid.from_mesh(form, cell, reach, inside=True, **about)
        return cast(material, solid, bars, opening, reach, spacing, fill_point, hose_diameter, rate, fill_ratio, until)
    upright = half - cover - 0.5 * bar_diameter
    level = upright - 1.1 * bar_diameter
    if not rebar and level < 0.55 * bar_diameter:
        raise mps.SceneError(
            f"width = {width:g} m: must be at least {2 * (cover + 2.2 * bar_diameter):.3g} m for cover and bars"
        )
    with tempfile.TemporaryDirectory() as folder:
        one = curtain(length, height, bar_diameter, bar_distance, upright, level)
        both = np.vstack([one, one * (1.0, -1.0, 1.0)])
        ends, low, part = (both, -half, 1.0) if model == "full" else (one, 0.0, 0.5)
        path = rebar or mps.write_bars(Path(folder) / "rebar.stl", ends, 0.5 * bar_diameter)
        cell, reach = min(0.5 * spacing, 0.4 * bar_diameter), 2.5 * spacing
        bars = mps.Solid.from_mesh(path, cell, reach, scale=rebar_scale if rebar else 1.0, name="bars")
    back = mps.Plane((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), mirror=True)
    if model == "full":
        back = mps.Plane((0.0, low, 0.0), (0.0, 1.0, 0.0), slip=smooth, name="back")
    walls = (
        mps.Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), name="floor"),
        mps.Plane((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), slip=smooth, name="near"),
        mps.Plane((length, 0.0, 0.0), (-1.0, 0.0, 0.0), slip=smooth, name="far"),
        mps.Plane((0.0, half, 0.0), (0.0, -1.0, 0.0), slip=smooth, name="side"),
        back,
        bars,
    )
    cavity = mps.Cavity((0.0, low, 0.0), (length, half, height), walls, spacing)
    room = float(cavity.cells.sum() * np.prod(cavity.cell)) / part
    mouth = (0.5 * hose_diameter + spacing, 0.0, height + FREE)
    poured = fill_ratio * room
    path = None if hose == "above" else way(hose == "moving", length - 2.0 * mouth[0], height, poured / rate)
    if path is not None:
        require_room(bars, mouth, path, hose_diameter, spacing)
    inlet = mps.Inlet(mouth, (0.0, 0.0, -1.0), 0.5 * hose_diameter, rate, poured, path=path)
    lines = [] if rebar else list(both)
    lines += hose_lines(inlet) if path is None else []
    form = [(0.0, height), (0.0, 0.0), (length, 0.0), (length, height)]

    def measure(s):
        """Return the largest horizontal distance [m] of the concrete from the hose."""
        ends = [mps.measure.level(s, (x, -0.5 * half), (x + 0.1, 0.5 * half)) for x in (0.0, length - 0.1)]
        found = {"front_m": mps.measure.front(s)["front_m"], "near_m": ends[0], "far_m": ends[1]}
        found |= mps.measure.grains(s)
        known = s.loads and np.isfinite(s.loads["side"].forces).all()  # not before the first step
        return found | (pressures(s, 0.5 * sum(ends)) if known else {})

    edges = np.linspace(0.0, height, 1 + max(2, min(5, int(height / (2.5 * spacing)))))
    middle, weight = 0.5 * (edges[1:] + edges[:-1]), material.density * 9.81

    def in_layers(name, values):
        """A measure of each layer of the height."""
        return {f"{name}_at_{1e3 * z:.0f}mm_Pa": float(value) for z, value in zip(middle, values, strict=True)}

    def pressures(s, level):
        """Mean pressure [Pa] on the sides in layers of the height, and the hydrostatic one of the lowest below the
        level [m]."""
        outward = s.loads["side"].forces[:, 1] * np.sign(s.x[:, 1])
        if model == "full":
            outward = s.loads["side"].forces[:, 1] - s.loads["back"].forces[:, 1]
        mean = mps.measure.by_height(s, outward, edges) / (2.0 * length * np.diff(edges))
        hydrostatic = in_layers("hydrostatic", weight * np.maximum(0.0, level - middle))
        return in_layers("pressure", mean) | dict(list(hydrostatic.items())[:1])

    def over_time(history):
        """Hydrostatic pressure [Pa] at the end, and that pressure less what rough sides bear at most by the yield
        stress, grown with the age of each layer."""
        if not set(in_layers("pressure", middle)) <= set(history):
            return {}
        level = 0.5 * (history["near_m"] + history["far_m"])
        found = in_layers("hydrostatic", weight * np.maximum(0.0, level[-1] - middle))
        if smooth:
            return found
        age = history["time_s"][-1] - np.array([mps.measure.time_of(history["time_s"], level, z) for z in middle])
        bears = (1.0 + material.initial_structure) * material.yield_value + material.growth_at_rest * np.nan_to_num(age)
        held = 2.0 * (length + width) / (length * width) * bears  # by the four sides [N/m3]
        gain = np.clip(level[-1] - edges[:-1], 0.0, np.diff(edges)) * np.maximum(0.0, weight - held)
        return found | in_layers("less_what_sides_bear", np.cumsum(gain[::-1])[::-1] - 0.5 * gain)

    def check(s, measures):
        """Check that the poured concrete is in the form, in no bar, complete, and as high as its volume requires."""
        assert mps.measure.clearance(s, walls) > 0.0, "leak through the form or into a bar"
        layers = len(s.x) * spacing**3 / (part * inlet.layer_volume(spacing))
        assert s.grain.any() or abs(layers - round(layers)) < 1e-6, layers  # a grain comes with its first layer
        assert layers < inlet.layers(spacing) + 0.5, layers
        report = cavity.report(s)
        if round(layers) == inlet.layers(spacing) and s.speed.mean() < 0.01:
            poured = len(s.x) * spacing**3 / (part * room)
            assert abs(report["filled_ratio"] - poured) < 0.03, (report, poured)

    return mps.Scene(
        name="wall",
        material=material,
        spacing=spacing,
        fluid=None,
        inlets=(inlet,),
        cavity=cavity,
        walls=walls,
        domain=((-spacing, low - spacing, -spacing), (length + spacing, half + spacing, mouth[2] + 4 * spacing)),
        until=max(LEAST, poured / rate + AFTER) if until is None else until,
        stop_at_rest=True,
        wall_loads=measure_pressure,
        measure=measure,
        over_time=over_time,
        check=check,
        outline=tuple(lines),
        vessel=mps.vessel([form], [form], half),
    )


def cast(material, form, bars, opening, reach, spacing, fill_point, hose_diameter, rate, fill_ratio, until):
    """Scene of a form from CAD that goes on above its highest face by ``opening`` [m], filled from a hose above it."""
    clear = form.values[:, :, int((form.high[2] - reach - form.low[2] - 0.5 * opening) / form.cell)]  # beside the mouth
    widest = np.array(np.unravel_index(clear.argmax(), clear.shape)) * form.cell + form.low[:2]
    x, y = fill_point or widest.tolist()
    # the grid ends less than a cell above its reach: the lid is where the depth of a node above it says
    above = np.array([[x, y, form.high[2] - 0.5 * reach]])
    top = float(above[0, 2] + form.distance(above)[0]) - opening
    low, high = np.array(form.low) + reach, np.array(form.high) - reach
    rows = int((top + FREE + 3.0 * spacing - form.low[2]) / form.cell)  # without the lid
    walls = (replace(form, values=form.values[:, :, :rows]), *bars)
    cavity = mps.Cavity(tuple(low), (*high[:2], top), walls, spacing)
    room = float(cavity.cells.sum() * np.prod(cavity.cell))
    inlet = mps.Inlet((x, y, top + FREE), (0.0, 0.0, -1.0), 0.5 * hose_diameter, rate, fill_ratio * room)
    free = min(float(wall.distance(inlet.layer(spacing)).min()) for wall in walls)
    if free < 0.25 * spacing:
        widest = ", ".join(f"{v:.3g}" for v in widest)
        raise mps.SceneError(
            f"fill_point = ({x:.4g}, {y:.4g}) m: the hose of {hose_diameter:g} m must be over the opening at the top, "
            f"which is widest at ({widest}) m: {2.0 * clear.max():.3g} m"
        )

    def measure(s):
        """Return the largest horizontal distance [m] of the concrete from the hose."""
        distance = float(np.hypot(s.x[:, 0] - x, s.x[:, 1] - y).max() + 0.5 * s.spacing)
        return {"hose_distance_m": distance} | mps.measure.grains(s)

    def check(s, measures):
        """Check that the poured concrete is in the form, in no bar, and complete."""
        assert mps.measure.clearance(s, walls) > 0.0, "leak through the form or into a bar"
        layers = len(s.x) * spacing**3 / inlet.layer_volume(spacing)
        assert s.grain.any() or abs(layers - round(layers)) < 1e-6, layers
        assert layers < inlet.layers(spacing) + 0.5, layers

    return mps.Scene(
        name="wall",
        material=material,
        spacing=spacing,
        fluid=None,
        inlets=(inlet,),
        cavity=cavity,
        walls=walls,
        domain=(tuple((low - spacing).tolist()), (*(high[:2] + spacing).tolist(), top + FREE + 4.0 * spacing)),
        until=max(LEAST, fill_ratio * room / rate + AFTER) if until is None else until,
        stop_at_rest=True,
        measure=measure,
        check=check,
        outline=tuple(hose_lines(inlet)),
    )


def hose_lines(inlet):
    """Lines (k, 3) [m] of the end of a hose that stays above the form."""
    rims = mps.Cylinder(inlet.centre, inlet.radius, axis=(0.0, 0.0, 1.0), length=FREE).circles
    return [*rims, *np.stack(rims, axis=1)[:-1:18]]


def way(moves, along, height, time):
    """Path of the hose (k, 4) [s, m] from its place above the form: it rises with the mean level, NEAR above it, and
    may go to and fro over a length [m], once for each LIFT of the height [m]."""
    passes = max(2, int(np.ceil(height / LIFT)))
    steps = np.arange(passes + 1) / passes
    x = along * (np.arange(passes + 1) % 2) * moves
    z = np.minimum(0.0, steps * height + NEAR - height - FREE)
    return tuple(zip(steps * time, x, 0.0 * x, z, strict=True))


def require_room(bars, mouth, path, hose_diameter, spacing):
    """SceneError where a hose along this path [s, m] from the mouth [m] would meet the bars."""
    time, *along = np.transpose(path)
    ways = np.linalg.norm(np.diff(np.transpose(along), axis=0), axis=1)
    every = np.linspace(time[0], time[-1], 2 + int(len(ways) * ways.max() / (0.5 * spacing)))
    axis = np.array(mouth) + np.transpose([np.interp(every, time, values) for values in along])
    free = 2.0 * float(bars.distance(axis).min())
    if hose_diameter > free:
        raise mps.SceneError(
            f"hose_diameter = {hose_diameter:g} m: must be at most {np.floor(1e3 * free) / 1e3:g} m, the room between "
            "the bars, or hose = above; thinner bars or less cover leave more"
        )


def curtain(length, height, diameter, distance, upright, level):
    """Ends (k, 2, 3) [m] of upright bars at y = ``upright`` and of level ones at y = ``level`` [m], evenly spaced, half
    a diameter clear of the form."""
    clear = 0.5 * diameter
    bars = [((x, upright, clear), (x, upright, height + FREE / 3)) for x in middles(length, distance)]
    return np.array(bars + [((clear, level, z), (length - clear, level, z)) for z in middles(height, distance)])


def middles(length, distance):
    """Places [m] of the fewest evenly spaced bars that are no farther apart than the distance [m]."""
    count = int(np.ceil(length / distance - 1e-9))
    return length * (np.arange(count) + 0.5) / count


if __name__ == "__main__":
    sys.exit(mps.main(["run", __file__, *sys.argv[1:]]))
