"""Printing: a wall or a column grows layer on layer from a nozzle, until it fails under its own weight.

Source: limit analysis. A wall fails between rho g H = 2 tau_y, which is exact where it is slender, and a quarter of its
width more; a column between rho g H = sqrt(3) tau_y and about a third of its diameter more. Width and layers as of
Wolfs, Bos and Salet (2018), as quoted.
Run time: some CPU-seconds for a section at the default spacing, minutes for a column and a path.
"""

import sys
from dataclasses import replace
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

import taichi_mps as mps
from taichi_mps.units import Count, Duration, Length

FAILED = 0.01  # by how much wider a foot has failed; it bears as much more, twice as much in a column
THRESHOLD = {"section": 2.0, "path": 2.0, "column": 3.0**0.5}  # rho g H/tau_y at which what is slender fails


@mps.checked
def scene(
    material: mps.Concrete = mps.Bingham(yield_value=2000.0, plastic_viscosity=50.0),
    spacing: Length = 0.005,
    width: Length = Field(0.04, description="width of the wall, diameter of the column"),
    layer_height: Length = Field(0.01, description="height of a layer"),
    layers: Annotated[Count, Field(description="layers that are printed")] = 25,
    layer_time: Duration = Field(2.0, description="time of a layer"),
    length: Length = Field(0.2, description="length of the wall that the nozzle goes along, of model path"),
    floor: Annotated[
        Literal["smooth", "rough"], Field(description="whether the concrete slips on the floor")
    ] = "rough",
    until: Duration | None = None,
    model: Literal["section", "column", "path"] = "section",
) -> mps.Scene:
    """``section``: half of that through a long wall, printed over its whole width by a nozzle that rises with it.
    ``column``: a quarter of a round one, likewise. ``path``: half of a wall along which a nozzle as wide and high as a
    layer goes to and fro and lays it down behind itself."""
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
    limit = THRESHOLD[model] * material.yield_value / spare if spare > 0.0 else np.inf
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
        """It is as wide and as high as it was printed, well below the height at which it fails."""
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


if __name__ == "__main__":
    sys.exit(mps.main(["run", __file__, *sys.argv[1:]]))
