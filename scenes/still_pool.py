"""Still pool: a fluid at rest in a tank must stay at rest with the hydrostatic pressure.

Source: the hydrostatic case of every particle method's validation; exact p = rho g (h - y), u = 0.
Run time: a few CPU-seconds for 1 s at the default spacing.
"""

import sys
from typing import Literal

import numpy as np
from pydantic import Field

import taichi_mps as mps
from taichi_mps.units import Duration, Length


def pool_error(snapshot, density, depth):
    """Relative L2 error of the pressure [-] against rho g (depth - y), the highest particle over the level [m], and the
    drift of the level that lies twice as high as the centre of mass [m]."""
    exact = density * 9.81 * (depth - snapshot.x[:, -1])
    return {
        "pressure_error": float(np.sqrt(np.mean((snapshot.p - exact) ** 2)) / (density * 9.81 * depth)),
        "level_drift_m": float(snapshot.x[:, -1].max() + 0.5 * snapshot.spacing - depth),
        "mean_drift_m": float(2.0 * snapshot.x[:, -1].mean() - depth),
        "max_speed_m_s": float(snapshot.speed.max()),
    }


@mps.checked
def scene(
    material: mps.Concrete = mps.Newtonian(),
    spacing: Length = 0.01,
    width: Length = Field(0.2, description="width of the tank"),
    depth: Length = Field(0.2, description="depth of the fluid"),
    until: Duration = 1.0,
    model: Literal["plane", "half"] = "plane",
) -> mps.Scene:
    """Two-dimensional tank with a free surface; half of it up to a mirror plane in the middle."""
    low, high = (0.0, 0.0), (width, depth)
    floor, west, east = mps.box_planes(low, high, slip=True)
    mirrors = (mps.Plane((0.5 * width, 0.0), (-1.0, 0.0), mirror=True),) if model == "half" else ()
    margin = 0.25 * depth + 5 * spacing

    def measure(snapshot):
        return pool_error(snapshot, material.density, depth)

    def check(snapshot, measures):
        assert measures["pressure_error"] < 0.1, measures
        assert abs(measures["level_drift_m"]) < 0.25 * spacing, measures
        assert measures["max_speed_m_s"] < 0.05 * (9.81 * depth) ** 0.5, measures

    return mps.Scene(
        name="still_pool",
        material=material,
        spacing=spacing,
        fluid=mps.fill(mps.Box(low, high), spacing, mirrors),
        walls=(floor, west, *(mirrors or (east,))),
        wall_particles=mps.shell(low, (width, 1.25 * depth), spacing),
        domain=((-margin, -margin), (width + margin, depth + margin)),
        until=until,
        measure=measure,
        check=check,
    )


if __name__ == "__main__":
    sys.exit(mps.main(["run", __file__, *sys.argv[1:]]))
