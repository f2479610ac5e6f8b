"""Printing: a wall or a column grows layer on layer from a nozzle, until it fails under its own weight.

Source: limit analysis. A wall fails between rho g H = 2 tau_y, which is exact where it is slender, and a quarter of its
width more; a column from rho g H = sqrt(3) tau_y on. Width and layers as of Wolfs, Bos and Salet (2018), as quoted.
Run time: some CPU-seconds for a section at the default spacing, minutes for a column and a path.
"""

import sys
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

import taichi_mps as mps
from taichi_mps.units import Count, Duration, Length

FAILED = 0.02  # by how much wider a foot has failed
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
    ``column``: a quarter of a round one, likewise. ``path``: the nozzle goes to and fro along a wall and rises after
    each layer."""
    rise, high, half = layer_height / layer_time, layers * layer_height, 0.5 * width
    total, d = layers * layer_time, 2 if model == "section" else 3
    up = np.eye(d)[-1]
    if model == "path":
        travel = length - width
        if travel <= 0.0:
            raise mps.SceneError(f"length = {length:g} m: must be greater than the width, {width:g} m")
        corners = [(0.0, 0.0, 0.0, 0.0)]
        for k in range(layers):  # along for nine tenths of the time of a layer, up in the last tenth
            to = travel * ((k + 1) % 2)
            corners += [((k + 0.9) * layer_time, to, 0.0, k * layer_height)]
            corners += [((k + 1.0) * layer_time, to, 0.0, (k + 1) * layer_height)]
        path, start, rate = tuple(corners), (half, 0.0), width * length * layer_height / layer_time
    else:
        path, start = ((0.0, *(0.0,) * d), (total, *(high * up))), (0.0,) * (d - 1)
        rate = (width if d == 2 else np.pi * half**2) * rise
    mouth = (*start, 2.0 * layer_height if model == "path" else 0.0)
    area = width if d == 2 else np.pi * half**2
    volume = rate * total if model == "path" else area * high
    inlet = mps.Inlet(mouth, tuple(-up), half, rate, volume, path=path)
    halves = {"section": [0], "column": [0, 1], "path": [1]}[model]  # axes across mirror planes
    mirrors = [mps.Plane((0.0,) * d, tuple(np.eye(d)[axis]), mirror=True) for axis in halves]
    walls = (mps.Plane((0.0,) * d, tuple(up), slip=floor == "smooth", name="floor"), *mirrors)
    # rho g H = threshold (tau_y + structuration t), with H = rise t
    grown = THRESHOLD[model] * getattr(material, "structuration", 0.0) / rise
    spare = material.density * 9.81 - grown
    limit = THRESHOLD[model] * material.yield_value / spare if spare > 0.0 else np.inf
    room = 5.0 * high + width
    printed = inlet.layers(spacing) * inlet.layer_volume(spacing) / (area if model != "path" else width * length)

    def measure(s):
        """Height [m] of what stands, and how much has been printed; width [m] at the foot."""
        top = float(s.x[:, -1].max() + 0.5 * s.spacing)
        across = np.abs(s.x[:, 1] if model == "path" else s.x[:, 0])
        foot = across[s.x[:, -1] < s.x[:, -1].min() + 0.25 * top].max() + 0.5 * s.spacing
        return {
            "height_m": top,
            "printed_m": float(np.clip(rise * s.time, spacing, printed)),
            "foot_m": 2.0 * float(foot),
        }

    def over_time(history):
        """The height [m] that was printed when the foot had become wider by 2 %; nan if it stands."""
        wider = history["foot_m"] / width - 1.0
        fallen = mps.measure.time_of(history["time_s"], wider, FAILED)
        exact = {"limit_height_m": limit} if np.isfinite(limit) else {}
        return exact | {"failure_height_m": float(np.interp(fallen, history["time_s"], history["printed_m"]))}

    def check(s, measures):
        """It is as wide as it was printed, well below the height at which it fails."""
        assert s.x[:, -1].min() > 0.0
        if model != "path" and measures["printed_m"] < 0.9 * limit:
            assert abs(measures["foot_m"] - width) < spacing and measures["height_m"] > measures["printed_m"] - spacing

    return mps.Scene(
        name="printing",
        material=material,
        spacing=spacing,
        fluid=None,
        inlets=(inlet,),
        walls=walls,
        domain=((*(-room,) * (d - 1), -spacing), (*(room + length,) * (d - 1), high + 4.0 * layer_height)),
        until=until or total,
        measure=measure,
        over_time=over_time if model != "path" else None,
        check=check,
    )


if __name__ == "__main__":
    sys.exit(mps.main(["run", __file__, *sys.argv[1:]]))
