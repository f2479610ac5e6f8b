"""Film on an incline: a layer of concrete flows down a rough slope, or stands on it.

Source: exact solution, of a mix that is not thixotropic. The layer moves where rho g h sin(angle) > yield stress, as a
plug above a sheared zone.
Run time: a few CPU-seconds at the default spacing.
"""

import sys
from typing import Literal

import numpy as np
from pydantic import Field

import taichi_mps as mps
from taichi_mps.units import Angle, Duration, Length

ROOTS, WEIGHTS = (
    0.5 * (half + part) for half, part in zip((1.0, 0.0), np.polynomial.legendre.leggauss(32), strict=True)
)


def film_velocity(y, depth, slope_weight, material):
    """Exact steady velocity [m/s] at height y [m] of a film; slope_weight = rho g sin(angle) [N/m3]. It is the integral
    of the shear rate from the floor, here over the square root of the stress above the yield stress, or above the knee
    stress of a bi-viscosity law, whose shear rate below it is proportional to the stress."""
    knee = getattr(material, "knee_stress", material.yield_value)

    def up_to(stress):
        below, above = np.minimum(stress, knee), np.maximum(0.0, stress - knee)[..., None]
        flowing = above[..., 0] * (material.shear_rate(knee + above * ROOTS**2) @ (2.0 * ROOTS * WEIGHTS))
        return 0.5 * below * material.shear_rate(below) + flowing

    return (up_to(np.array(slope_weight * depth)) - up_to(slope_weight * (depth - np.asarray(y)))) / slope_weight


@mps.checked
def scene(
    material: mps.Concrete = mps.Bingham(yield_value=100.0, plastic_viscosity=50.0),
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
    # the weight along the slope, less what friction holds of it; both grow with the depth
    held = np.cos(theta) * material.friction_coefficient
    slope_weight = material.density * 9.81 * max(1e-9, np.sin(theta) - held)
    thick = 3 * spacing

    def measure(snapshot):
        exact = film_velocity(snapshot.x[:, 1], depth, slope_weight, material)
        scale = max(exact.max(), 1e-30)
        surface = {"surface_speed_m_s": float(snapshot.u[snapshot.x[:, 1] > depth - 1.5 * spacing, 0].mean())}
        if material.ages:  # the exact speed is that of a history
            return surface
        return surface | {
            "exact_surface_speed_m_s": float(exact.max()),
            "velocity_error": float(np.sqrt(np.mean((snapshot.u[:, 0] - exact) ** 2)) / scale)
            if scale > 1e-12
            else 0.0,
        }

    def check(snapshot, measures):
        if material.ages:
            assert measures["surface_speed_m_s"] > -1e-4, measures
        elif measures["exact_surface_speed_m_s"] > 0:
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
