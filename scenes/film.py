"""Film on an incline: a layer of concrete flows down a rough slope, or stands on it.

Source: exact solution. The layer moves where rho g h sin(angle) > yield stress, as a plug above a sheared zone.
Run time: a few CPU-seconds at the default spacing.
"""

import sys
from typing import Literal

import numpy as np
from pydantic import Field

import taichi_mps as mps
from taichi_mps.units import Angle, Duration, Length


def film_velocity(y, depth, slope_weight, eta, tau_y):
    """Exact steady velocity [m/s] at height y [m] of a Bingham film; slope_weight = rho g sin(angle) [N/m3]."""
    sheared = max(0.0, depth - tau_y / slope_weight)  # the yielded layer's thickness
    y = np.minimum(y, sheared)
    return slope_weight * (sheared * y - 0.5 * y**2) / eta


@mps.checked
def scene(
    material: mps.Bingham = mps.Bingham(yield_value=100.0, plastic_viscosity=50.0),
    angle: Angle = Field(10.0, description="slope of the plane"),
    depth: Length = Field(0.1, description="depth of the film"),
    spacing: Length = 0.005,
    until: Duration = 2.0,
    model: Literal["plane"] = "plane",
) -> mps.Scene:
    """Two-dimensional film, periodic along the slope; axes along and normal to it. Its depth is that of whole rows of
    particles, the nearest to the one given."""
    if spacing > depth:
        raise mps.SceneError(f"spacing = {spacing:g} m: larger than the film, {depth:g} m deep")
    rows, columns = round(depth / spacing), max(10, round(0.5 * depth / spacing))
    depth, length = rows * spacing, columns * spacing
    theta = np.radians(angle)
    slope_weight = material.density * 9.81 * np.sin(theta)
    thick = 3 * spacing

    def measure(snapshot):
        exact = film_velocity(snapshot.x[:, 1], depth, slope_weight, material.plastic_viscosity, material.yield_value)
        scale = max(exact.max(), 1e-30)
        return {
            "surface_speed_m_s": float(snapshot.u[snapshot.x[:, 1] > depth - 1.5 * spacing, 0].mean()),
            "exact_surface_speed_m_s": float(exact.max()),
            "velocity_error": float(np.sqrt(np.mean((snapshot.u[:, 0] - exact) ** 2)) / scale)
            if scale > 1e-12
            else 0.0,
        }

    def check(snapshot, measures):
        if measures["exact_surface_speed_m_s"] > 0:
            assert measures["velocity_error"] < 0.1, measures
        else:
            assert measures["surface_speed_m_s"] < 1e-4, measures

    return mps.Scene(
        name="film",
        material=material,
        spacing=spacing,
        fluid=mps.lattice((0.0, 0.0), (length - 0.1 * spacing, depth - 0.1 * spacing), spacing),
        walls=(mps.Plane((0.0, 0.0), (0.0, 1.0)),),
        wall_particles=mps.lattice((0.0, -thick), (length - 0.1 * spacing, 0.0 - 0.1 * spacing), spacing),
        domain=((0.0, -thick), (length, depth + 5 * spacing)),
        gravity=(9.81 * float(np.sin(theta)), -9.81 * float(np.cos(theta))),
        periodic=(True, False),
        until=until,
        measure=measure,
        check=check,
    )


if __name__ == "__main__":
    sys.exit(mps.main(["run", __file__, *sys.argv[1:]]))
