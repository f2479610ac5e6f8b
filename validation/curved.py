"""Flows between curved walls: the circular pipe and circular Couette flow, scheme `implicit` at its defaults.

Each flow starts from two fillings: particles on circles, and a square lattice cut by the walls, whose first particles
lie at any distance from them. Errors are |u - u_exact|/|u_exact|, of the component along the flow, and the rest of the
velocity over |u_exact|, in the L2 norm over all particles at the end of the run.
"""

import numpy as np

import taichi_mps as mps

from . import Measured, run
from .flows import l2

DENSITY, ETA = 2300.0, 50.0  # kg/m3, Pa s
RADIUS, OUTER, ACROSS = 0.05, 0.1, 20  # of the pipe and the inner cylinder, of the outer one [m]; particles


def from_fillings(flow, **settings):
    """A flow from particles on circles and from a lattice: errors of the velocity along it, and of the rest of it."""
    for filling in ("rings", "a cut lattice"):
        along, across, exact, others = flow(filling, **settings)
        yield Measured(f"L2 error, from {filling}", l2(along, exact), 0.03)
        rest = float(np.linalg.norm(across) / np.linalg.norm(exact))
        yield Measured(f"L2 norm of the velocity across the flow, from {filling}", rest, 0.03)
        yield from others


def section(filling, inner, outer, spacing):
    """Points (n, 2) [m] between two circles."""
    if filling == "rings":
        return mps.rings(inner, outer, spacing)
    x = mps.lattice((-outer,) * 2, (outer,) * 2, spacing)
    r = np.linalg.norm(x, axis=1)
    return x[(r > inner) & (r < outer)]


# ---- pipe -----------------------------------------------------------------------------------------------------
def pipe_profile(r, push, tau_y):
    """Velocity [m/s] at the radius r [m] under the pressure gradient ``push`` [Pa/m]; a plug within 2 tau_y/push."""
    r = np.maximum(r, min(2.0 * tau_y / push, RADIUS))
    return push / (4.0 * ETA) * (RADIUS**2 - r**2) - tau_y / ETA * (RADIUS - r)


def pipe(filling, push, tau_y, until):
    """A pipe along x, periodic, seven spacings long, from rest; ``push`` is a body force. Velocities along and across,
    (n,) and (n, 2), the exact one, and the error of the flow rate."""
    spacing, layers = 2.0 * RADIUS / ACROSS, 7
    side, disc = RADIUS + spacing, section(filling, 0.0, RADIUS, spacing)
    scene = mps.Scene(
        name="pipe",
        material=mps.Bingham(density=DENSITY, plastic_viscosity=ETA, yield_value=tau_y),
        spacing=spacing,
        fluid=np.vstack([np.insert(disc, 0, (k + 0.5) * spacing, axis=1) for k in range(layers)]),
        walls=(mps.Cylinder((0.0, 0.0, 0.0), RADIUS, axis=(1.0, 0.0, 0.0)),),
        domain=((0.0, -side, -side), (layers * spacing, side, side)),
        periodic=(True, False, False),
        gravity=(push / DENSITY, 0.0, 0.0),
    )
    s = run(scene, until).snapshot()
    p = 2.0 * tau_y / (push * RADIUS)
    flow = np.pi * RADIUS**4 * push / (8.0 * ETA) * (1.0 - 4.0 * p / 3.0 + p**4 / 3.0)
    error = float(s.u[:, 0].mean()) * np.pi * RADIUS**2 / flow - 1.0
    exact = pipe_profile(np.hypot(s.x[:, 1], s.x[:, 2]), push, tau_y)
    return s.u[:, 0], s.u[:, 1:], exact, [Measured(f"flow rate, from {filling}, relative error", error, 0.03)]


# ---- circular Couette flow ------------------------------------------------------------------------------------
def couette_profile(r, turn, tau_y):
    """Circumferential velocity [m/s] at the radius r [m]: the inner cylinder turns at ``turn`` [rad/s], the outer one
    stands. The stress C/r^2 drives r d(u/r)/dr, and beyond sqrt(C/tau_y) the material is rigid (Reiner-Riwlin)."""

    def angular_velocity(C, r):
        high = min(OUTER, (C / tau_y) ** 0.5) if tau_y else OUTER
        low = np.minimum(r, high)
        return C / (2.0 * ETA) * (low**-2.0 - high**-2.0) - tau_y / ETA * np.log(high / low)

    low, high = tau_y * RADIUS**2, 1e3  # C [N]
    for _ in range(100):
        C = 0.5 * (low + high)
        low, high = (low, C) if angular_velocity(C, RADIUS) > turn else (C, high)
    return r * angular_velocity(C, r)


def couette(filling, turn, tau_y, until):
    """Velocities along and across, (n,), and the exact one."""
    spacing = (OUTER - RADIUS) / ACROSS
    side, turning = OUTER + spacing, mps.Cylinder((0.0, 0.0), RADIUS, inside=False, angular_velocity=turn)
    scene = mps.Scene(
        name="circular Couette",
        material=mps.Bingham(density=DENSITY, plastic_viscosity=ETA, yield_value=tau_y),
        spacing=spacing,
        fluid=section(filling, RADIUS, OUTER, spacing),
        walls=(turning, mps.Cylinder((0.0, 0.0), OUTER)),
        domain=((-side, -side), (side, side)),
        gravity=(0.0, 0.0),
    )
    s = run(scene, until).snapshot()
    r = np.linalg.norm(s.x, axis=1)
    along = (s.x[:, 0] * s.u[:, 1] - s.x[:, 1] * s.u[:, 0]) / r
    return along, (s.x * s.u).sum(1) / r, couette_profile(r, turn, tau_y), []
