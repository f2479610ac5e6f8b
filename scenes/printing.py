"""Printing: a wall, a column or what a G-code file says grows layer on layer, until it fails under its own weight.

Source: limit analysis. A wall fails between rho g H = 2 tau_y, which is exact where it is slender, and a quarter of its
width more; a column between rho g H = sqrt(3) tau_y and about a third of its diameter more. Width and layers as of
Wolfs, Bos and Salet (2018), as quoted.
Run time: some CPU-seconds for a section at the default spacing, minutes for a column and a path.
"""

import sys
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import AfterValidator, Field, ValidationInfo

import taichi_mps as mps
from taichi_mps.input import tool_path
from taichi_mps.input.tool_path import read_gcode, straight_runs
from taichi_mps.units import Count, Duration, FlowRate, Length, Only, Source

FAILED = 0.01  # by how much wider a foot has failed; it bears as much more, twice as much in a column
COLLAPSED = 0.1  # by how much wider than it was laid a layer of a tool path has collapsed
TURN = np.radians(10.0)  # by which a bead may bend that a mouth lays without turning
# Measured printable mortars: yield stress at rest [Pa], plastic viscosity [Pa s]; rows of uf-3dcp-mix (Open3DCP) that
# have both, of Gao, Wang and Wang (2022), 3D Printing Concrete Mix Design Open Dataset, Zenodo 6828947, CC BY 4.0.
MORTARS = {"uf-1": (2411.0, 19.0), "uf-2": (3350.0, 16.65), "uf-9": (786.0, 36.9), "uf-10": (398.0, 34.0)}
USUAL = mps.Bingham(yield_value=2000.0, plastic_viscosity=50.0)
WITH, WITHOUT = Only("gcode"), Only("gcode", False)
THRESHOLD = {"section": 2.0, "path": 2.0, "column": 3.0**0.5}  # rho g H/tau_y at which what is slender fails


def model_of(model: str, given: ValidationInfo) -> str:
    """Model of a wall: that of a tool path where there is one."""
    return "gcode" if given.data.get("gcode") else model


def dialect_of(dialect: str, given: ValidationInfo) -> str:
    """Dialect of a tool path: the one that it names where none is given."""
    path = given.data.get("gcode")
    return tool_path.dialect_of(path) if dialect == "auto" and path and Path(path).is_file() else dialect


@mps.checked
def scene(
    material: mps.Concrete = USUAL,
    spacing: Length = 0.005,
    width: Annotated[Length, WITHOUT] = Field(0.04, description="width of the wall, diameter of the column"),
    layer_height: Annotated[Length, WITHOUT] = Field(0.01, description="height of a layer"),
    layers: Annotated[Count, WITHOUT, Field(description="layers that are printed")] = 25,
    layer_time: Annotated[Duration, WITHOUT] = Field(2.0, description="time of a layer"),
    length: Annotated[Length, Only("model", ("path",))] = Field(
        0.2, description="length of the wall that the nozzle goes along, of model path"
    ),
    floor: Annotated[
        Literal["smooth", "rough"], Field(description="whether the concrete slips on the floor")
    ] = "rough",
    mortar: Annotated[
        Literal["uf-1", "uf-2", "uf-9", "uf-10"] | None,
        Field(description="a measured mix, in place of the numbers of the mix but its density"),
    ] = None,
    gcode: Annotated[
        Source,
        Field(description="tool path (G-code) in place of width, height, layers and length; the model is then gcode"),
    ] = "",
    print_rate: Annotated[FlowRate | None, WITH, Field(description="what the nozzle delivers, in place of E")] = None,
    filament_diameter: Annotated[Length | None, WITH, Field(description="of the filament whose length E is")] = None,
    gcode_dialect: Annotated[
        tool_path.Dialect,
        WITH,
        AfterValidator(dialect_of),
        Field(description="firmware; marlin: G90 and G91 hold for E, too; auto: what the file names, else klipper"),
    ] = Field("auto", validate_default=True),
    until: Duration | None = None,
    model: Annotated[Literal["section", "column", "path", "gcode"], AfterValidator(model_of)] = Field(
        "section", validate_default=True
    ),
) -> mps.Scene:
    """``section``: half of that through a long wall, printed over its whole width by a nozzle that rises with it.
    ``column``: a quarter of a round one, likewise. ``path``: half of a wall along which a nozzle as wide and high as a
    layer goes to and fro and lays it down behind itself. ``gcode``: the whole of what a tool path lays, likewise."""
    if mortar:
        if material != USUAL.model_copy(update={"density": material.density}):
            raise mps.SceneError(f"mortar = {mortar}: must be given without other numbers of the mix than density")
        at_rest, viscosity = MORTARS[mortar]
        material = mps.Bingham(yield_value=at_rest, plastic_viscosity=viscosity, density=material.density)
    if gcode:
        return along(read_gcode(gcode, print_rate, filament_diameter, gcode_dialect), material, spacing, floor, until)
    if model == "gcode":
        raise mps.SceneError("model = gcode: must have a tool path, gcode")
    rise, high, half = layer_height / layer_time, layers * layer_height, 0.5 * width
    total, d = layers * layer_time, 2 if model == "section" else 3
    up = np.eye(d)[-1]
    if model == "path":
        if abs(layer_height / spacing - max(1, round(layer_height / spacing))) > 1e-6:
            allowed = f"must be a whole number of spacings, {spacing:g} m, in model path"
            raise mps.SceneError(f"layer_height = {layer_height:g} m: {allowed}")
        laid = mps.Inlet((0.0, 0.0, 0.0), (-1.0, 0.0, 0.0), half, 1.0, 1.0, height=layer_height)
        section = laid.layer_volume(spacing) / spacing  # area across the nozzle [m2]
        laid = replace(laid, rate=section * length / layer_time, volume=section * length)
        inlets, printed_area = [], section / layer_height * length
        for k in range(layers):
            begin, end, way = k * layer_time, (k + 1) * layer_time, 1 - 2 * (k % 2)  # to, and fro
            path = ((begin, 0.0, 0.0, 0.0), (end, way * length, 0.0, 0.0))
            centre = (k % 2 * length, 0.0, (k + 0.5) * layer_height)
            inlets += [replace(laid, centre=centre, direction=(-way, 0.0, 0.0), start=begin, path=path)]
    else:
        rising = mps.Inlet((0.0,) * d, tuple(-up), half, 1.0, 1.0, path=((0.0, *(0.0,) * d), (total, *(high * up))))
        printed_area = rising.layer_volume(spacing) / spacing  # of the lattice, so that its layers touch
        inlets = [replace(rising, rate=printed_area * rise, volume=printed_area * high)]
    halves = {"section": [0], "column": [0, 1], "path": [1]}[model]  # axes across mirror planes
    mirrors = [mps.Plane((0.0,) * d, tuple(np.eye(d)[axis]), mirror=True) for axis in halves]
    walls = (mps.Plane((0.0,) * d, tuple(up), slip=floor == "smooth", name="floor"), *mirrors)
    # rho g H = threshold (tau_y + structuration t), with H = rise t
    grown = THRESHOLD[model] * material.growth_at_rest / rise
    spare = material.density * 9.81 - grown
    limit = (
        THRESHOLD[model] * (1.0 + material.initial_structure) * material.yield_value / spare if spare > 0.0 else np.inf
    )
    room = 5.0 * high + width

    def measure(s):
        """Height [m] of what stands, and what has been printed, over its area; width [m] at the foot."""
        top = float(s.x[:, -1].max() + 0.5 * s.spacing)
        across = np.abs(s.x[:, 1] if model == "path" else s.x[:, 0])
        foot = across[s.x[:, -1] < s.x[:, -1].min() + 0.25 * top].max() + 0.5 * s.spacing
        return {
            "height_m": top,
            "printed_m": len(s.x) * s.spacing**d / printed_area,
            "foot_m": 2.0 * float(foot),
        }

    def over_time(history):
        """The height [m] that was printed when the foot had become wider by 1 %; nan if it stands."""
        wider = history["foot_m"] / width - 1.0
        fallen = mps.measure.time_of(history["time_s"], wider, FAILED)
        exact = {"limit_height_m": limit} if np.isfinite(limit) else {}
        return exact | {"failure_height_m": float(np.interp(fallen, history["time_s"], history["printed_m"]))}

    def check(s, measures):
        """Check that the wall is as wide and as high as it was printed, well below the height at which it fails."""
        assert s.x[:, -1].min() > 0.0
        if measures["printed_m"] < 0.9 * limit:
            assert abs(measures["foot_m"] - width) < spacing and measures["height_m"] > measures["printed_m"] - spacing

    return mps.Scene(
        name="printing",
        material=material,
        spacing=spacing,
        fluid=None,
        inlets=tuple(inlets),
        walls=walls,
        domain=((*(-room,) * (d - 1), -spacing), (*(room + length,) * (d - 1), high + 4.0 * layer_height)),
        until=until or total,
        measure=measure,
        over_time=over_time,
        check=check,
    )


def along(beads, material, spacing, floor, until):
    """Scene of beads that a nozzle lays; each straight run of them through a mouth with the section of the bead."""
    inlets, runs, owed, width = [], [], 0.0, 0.0
    for run in mitred(straight_runs(beads, TURN, spacing)):
        first, last = run[0], run[-1]
        if abs(first.height / spacing - max(1, round(first.height / spacing))) > 1e-4:
            allowed = f"must be a whole number of spacings, {spacing:g} m"
            raise mps.SceneError(f"gcode: a layer of {first.height:g} m at z = {first.end[2]:g} m: {allowed}")
        volume = sum(bead.volume for bead in run)
        length = sum(np.linalg.norm(bead.end - bead.start) for bead in run)
        width = volume / (length * first.height)
        if width < 3.0 * spacing:
            raise mps.SceneError(f"spacing = {spacing:g} m: must be at most a third of a bead of {width:.4g} m")
        duration = last.begin + last.duration - first.begin
        times = first.begin + duration * np.cumsum([bead.volume for bead in run]) / volume  # so each has its own volume
        places = [(time, *(bead.end - first.start)) for time, bead in zip(times, run, strict=True)]
        centre = tuple(first.start - (0.0, 0.0, 0.5 * first.height))
        mouth = {"height": first.height, "start": first.begin, "path": ((first.begin, 0.0, 0.0, 0.0), *places)}
        inlet = mps.Inlet(centre, (*(first.start - last.end)[:2], 0.0), 0.5 * width, 1.0, volume, **mouth)
        of_layer = inlet.layer_volume(spacing)
        count = round((volume + owed) / of_layer)  # a rounding of one run is made good by the next
        owed += volume - count * of_layer
        if count:
            inlets.append(replace(inlet, rate=count * of_layer / duration, volume=count * of_layer))
            runs.append(run)
    per_inlet = [inlet.layers(spacing) * len(inlet.layer(spacing)) for inlet in inlets]
    ends, layer = np.cumsum(per_inlet), np.array([run[0].layer for run in runs])
    back = np.array([inlet.unit_direction for inlet in inlets])
    across = np.cross((0.0, 0.0, 1.0), back)
    starts = np.array([run[0].start for run in runs])
    tops = {run[0].layer: run[0].end[2] for run in runs}
    heights = {run[0].layer: run[0].height for run in runs}
    widths = {k: np.average([w for w, j in each], weights=[j for w, j in each]) for k, each in by_layer(runs).items()}

    def shape(s):
        """Number, width [m], mean offset (2,) [m] to the side and mean height [m] of each layer that has begun.

        The width is that about the straight line through a bead, for one that turns on a smooth floor is no wider.
        """
        run = np.searchsorted(ends, np.arange(len(s.x)), side="right")
        count = np.maximum(np.bincount(run, minlength=len(runs)), 1)
        along, aside = (np.einsum("ij,ij->i", s.x - starts[run], axis[run]) for axis in (back, across))
        far, off = (x - (np.bincount(run, x, len(runs)) / count)[run] for x in (along, aside))
        turn = np.bincount(run, far * off, len(runs)) / (
            np.bincount(run, far**2, len(runs)) + count * s.spacing**2 / 12.0
        )
        for k in np.unique(layer[run]):
            own = layer[run] == k
            spread = (
                12.0 * np.mean(((off - turn[run] * far) ** 2 / (1.0 + turn[run] ** 2))[own]) + s.spacing**2
            )  # of a lattice w wide: w^2
            offset = np.mean(aside[own, None] * across[run[own], :2], axis=0)
            yield k, float(np.sqrt(spread)), offset, float(s.x[own, 2].mean())

    def measure(s):
        """Shape of what is printed: height of the last layer, width, lean, and the layer that is widest."""
        found = list(shape(s))
        wider = [wide / widths[k] - 1.0 for k, wide, _, _ in found]
        worst = int(np.argmax(wider))
        return {
            "height_m": found[-1][3] + 0.5 * heights[found[-1][0]],
            "width_m": float(np.mean([wide for _, wide, _, _ in found])),
            "lean_m": max(float(np.hypot(*offset)) for _, _, offset, _ in found),
            "collapsed_number": float(found[worst][0] + 1) if wider[worst] > COLLAPSED else 0.0,
        }

    def over_time(history):
        """The shape that was commanded; the first layer to collapse, and the height [m] that was printed by then."""
        commanded = {"commanded_height_m": max(tops.values()), "commanded_width_m": float(np.mean([*widths.values()]))}
        fallen = np.flatnonzero(history["collapsed_number"] > 0.0)
        if not len(fallen):
            return commanded | {"first_collapse_number": 0.0}
        begun = [run[0].end[2] for run in runs if run[0].begin <= history["time_s"][fallen[0]]]
        number = float(history["collapsed_number"][fallen[0]])
        return commanded | {"first_collapse_number": number, "failure_height_m": float(max(begun))}

    def check(s, measures):
        """Check that no concrete is below the floor, and that the commanded volume is there."""
        assert s.x[:, 2].min() > 0.0
        commanded = sum(bead.volume for bead in beads if bead.begin + bead.duration <= s.time)
        assert len(s.x) * spacing**3 > 0.98 * commanded - 2.0 * max(i.layer_volume(spacing) for i in inlets)

    places = np.array([place for bead in beads for place in (bead.start, bead.end)])
    room = max(tops.values()) + 2.0 * max(widths.values())
    low, high = places.min(0) - room, places.max(0) + room
    return mps.Scene(
        name="printing",
        material=material,
        spacing=spacing,
        fluid=None,
        inlets=tuple(inlets),
        walls=(mps.Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), slip=floor == "smooth", name="floor"),),
        domain=((*low[:2].tolist(), -spacing), (*high[:2].tolist(), max(tops.values()) + 4.0 * max(heights.values()))),
        until=until or beads[-1].begin + beads[-1].duration,
        measure=measure,
        over_time=over_time,
        check=check,
    )


def mitred(runs):
    """Runs of beads that meet at corners without overlap: there the first goes on and the second begins where it ends,
    or, where a line is closed, the last ends where the first begins, farther back by what that leaves out."""
    for k, run in enumerate(runs):
        begun = [other for other in runs[:k] if other[0].layer == run[0].layer]
        closed = [other for other in begun if np.allclose(other[0].start, run[-1].end, atol=0.25 * run[-1].width)]
        follows = k + 1 < len(runs) and runs[k + 1][0].layer == run[0].layer
        after = runs[k + 1][0] if follows and np.allclose(run[-1].end, runs[k + 1][0].start, atol=1e-7) else None
        for first in closed[:1]:
            share = corner(run[-1], first[0], run[-1])
            lent, along = part(run[-1], 1.0 - share, 1.0), first[0].end - first[0].start
            run[-1] = part(run[-1], 0.0, 1.0 - share)
            back = along * np.linalg.norm(lent.end - lent.start) / np.linalg.norm(along)
            first[0] = replace(first[0], start=first[0].start - back, volume=first[0].volume + lent.volume)
        if after and not closed:
            share = corner(run[-1], after, after)
            step = (run[-1].end - run[-1].start) / np.linalg.norm(run[-1].end - run[-1].start)
            end = run[-1].end + share * np.linalg.norm(after.end - after.start) * step
            lent = replace(part(after, 0.0, share), start=run[-1].end, end=end)
            run += [lent] if share > 1e-6 else []
            runs[k + 1][0] = part(after, share, 1.0)
    return runs


def corner(bead, after, of):
    """Share of the length of a bead that is half of its width by the tangent of half of the angle between two beads."""
    along, then = bead.end - bead.start, after.end - after.start
    cosine = np.clip(along @ then / (np.linalg.norm(along) * np.linalg.norm(then)), -1.0, 1.0)
    tangent = np.sqrt((1.0 - cosine) / max(1.0 + cosine, 1e-9))
    return 0.5 * min(1.0, of.width * min(1.0, tangent) / np.linalg.norm(of.end - of.start))


def part(bead, begin, end):
    """A bead between two shares of its length."""
    along, share = bead.end - bead.start, end - begin
    ends = {"start": bead.start + begin * along, "end": bead.start + end * along}
    times = {"begin": bead.begin + begin * bead.duration, "duration": share * bead.duration}
    return replace(bead, **ends, **times, volume=share * bead.volume)


def by_layer(runs):
    """Widths [m] of the beads of each layer, with their lengths [m]."""
    found = {}
    for bead in (bead for run in runs for bead in run):
        found.setdefault(bead.layer, []).append((bead.width, np.linalg.norm(bead.end - bead.start)))
    return found


if __name__ == "__main__":
    sys.exit(mps.main(["run", __file__, *sys.argv[1:]]))
