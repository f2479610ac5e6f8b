"""Rows on flows between curved walls: the circular pipe and circular Couette flow, scheme `implicit` at its defaults.

Each flow starts from two fillings: particles on circles, and a square lattice cut by the walls, whose first particles
lie at any distance from them. Errors are |u - u_exact|/|u_exact|, of the component along the flow, and the rest of the
velocity over |u_exact|, in the L2 norm over all particles at the end of the run.
"""

import numpy as np

import taichi_mps as mps

from . import Measured, read_reference, row
from .flows import l2
from .scheme import simulate

DENSITY, ETA = 2300.0, 50.0  # kg/m3, Pa s
RADIUS, OUTER, ACROSS = 0.05, 0.1, 20  # of the pipe and the inner cylinder, of the outer one [m]; particles
FILLINGS = ("rings", "a cut lattice")


# ---- helpers --------------------------------------------------------------------------------------------------
def material(tau_y):
    if tau_y == 0.0:
        return mps.Newtonian(density=DENSITY, viscosity=ETA)
    return mps.Bingham(density=DENSITY, plastic_viscosity=ETA, yield_value=tau_y)


def section(filling, inner, outer, spacing):
    """Points (n, 2) [m] between two circles."""
    if filling == "rings":
        return mps.rings(inner, outer, spacing)
    x = mps.lattice((-outer,) * 2, (outer,) * 2, spacing)
    r = np.linalg.norm(x, axis=1)
    return x[(r > inner) & (r < outer)]


def profile_numbers(filling, along, across, exact):
    """Errors of the velocity along the flow, (n,), and of that across it, (n,) or (n, k)."""
    yield Measured(f"L2 error, from {filling}", l2(along, exact), 0.03)
    rest = float(np.linalg.norm(across) / np.linalg.norm(exact))
    yield Measured(f"L2 norm of the velocity across the flow, from {filling}", rest, 0.03)


# ---- pipe -----------------------------------------------------------------------------------------------------
def pipe_profile(r, push, tau_y):
    """Velocity [m/s] at the radius r [m] under the pressure gradient ``push`` [Pa/m]; a plug within 2 tau_y/push."""
    r = np.maximum(r, min(2.0 * tau_y / push, RADIUS))
    return push / (4.0 * ETA) * (RADIUS**2 - r**2) - tau_y / ETA * (RADIUS - r)


def pipe_numbers(push, tau_y, until):
    """A pipe along x, periodic, seven spacings long, from rest; ``push`` is a body force."""
    for line in read_reference("B_pipe_buckingham_reiner.csv"):  # the closed form is the table's
        if [float(line[key]) for key in ("mu_Pas", "ty_Pa", "G_Pa/m")] == [ETA, tau_y, push]:
            assert abs(pipe_profile(float(line["r_m"]), push, tau_y) - float(line["u_m/s"])) < 1e-6, line
    p = 2.0 * tau_y / (push * RADIUS)
    flow = np.pi * RADIUS**4 * push / (8.0 * ETA) * (1.0 - 4.0 * p / 3.0 + p**4 / 3.0)
    spacing, layers = 2.0 * RADIUS / ACROSS, 7
    side = RADIUS + spacing
    for filling in FILLINGS:
        disc = section(filling, 0.0, RADIUS, spacing)
        scene = mps.Scene(
            name="pipe",
            material=material(tau_y),
            spacing=spacing,
            fluid=np.vstack([np.insert(disc, 0, (k + 0.5) * spacing, axis=1) for k in range(layers)]),
            walls=(mps.Cylinder((0.0, 0.0, 0.0), RADIUS, axis=(1.0, 0.0, 0.0)),),
            domain=((0.0, -side, -side), (layers * spacing, side, side)),
            periodic=(True, False, False),
            gravity=(push / DENSITY, 0.0, 0.0),
        )
        sim = simulate(scene)
        sim.run(until=until)
        s = sim.snapshot()
        exact = pipe_profile(np.hypot(s.x[:, 1], s.x[:, 2]), push, tau_y)
        yield from profile_numbers(filling, s.u[:, 0], s.u[:, 1:], exact)
        found = float(s.u[:, 0].mean()) * np.pi * RADIUS**2
        yield Measured(f"flow rate, from {filling}, relative error", found / flow - 1.0, 0.03)


PIPE = "circular pipe, R = 0.05 m, 20 across, 50 Pa s"
REINER = "B_pipe_buckingham_reiner.csv and closed form"


@row(f"{PIPE}, Newtonian, 8000 Pa/m, after 1 s", "closed form")
def pipe_newtonian():
    yield from pipe_numbers(8000.0, 0.0, 1.0)


@row(f"{PIPE}, 100 Pa, 8000 Pa/m (plug of R/2), after 1 s", REINER)
def pipe_bingham_05():
    yield from pipe_numbers(8000.0, 100.0, 1.0)


@row(f"{PIPE}, 100 Pa, 20000 Pa/m (plug of R/5), after 0.5 s", REINER)
def pipe_bingham_02():
    yield from pipe_numbers(20000.0, 100.0, 0.5)


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


def couette_numbers(turn, tau_y, until):
    for line in read_reference("B_taylor_couette.csv"):  # the closed form is the table's
        if [float(line[key]) for key in ("mu_Pas", "ty_Pa", "Omega")] == [ETA, tau_y, turn]:
            ours = couette_profile(float(line["r_m"]), turn, tau_y)
            assert abs(ours - float(line["utheta_m/s"])) < 1e-4 * RADIUS * turn, line
    spacing = (OUTER - RADIUS) / ACROSS
    side = OUTER + spacing
    for filling in FILLINGS:
        scene = mps.Scene(
            name="circular Couette",
            material=material(tau_y),
            spacing=spacing,
            fluid=section(filling, RADIUS, OUTER, spacing),
            walls=(
                mps.Cylinder((0.0, 0.0), RADIUS, inside=False, angular_velocity=turn),
                mps.Cylinder((0.0, 0.0), OUTER),
            ),
            domain=((-side, -side), (side, side)),
            gravity=(0.0, 0.0),
        )
        sim = simulate(scene)
        sim.run(until=until)
        s = sim.snapshot()
        r = np.linalg.norm(s.x, axis=1)
        along = (s.x[:, 0] * s.u[:, 1] - s.x[:, 1] * s.u[:, 0]) / r
        yield from profile_numbers(filling, along, (s.x * s.u).sum(1) / r, couette_profile(r, turn, tau_y))


COUETTE = "circular Couette flow, inner cylinder of 0.05 m turning in one of 0.1 m, 20 across, 50 Pa s"
RIWLIN = "B_taylor_couette.csv and closed form"


@row(f"{COUETTE}, Newtonian, 1 rad/s, after 1 s", "closed form")
def circular_couette_newtonian():
    yield from couette_numbers(1.0, 0.0, 1.0)


@row(f"{COUETTE}, 100 Pa, 1 rad/s (rigid beyond 0.0887 m), after 1 s", RIWLIN)
def circular_couette_bingham_1():
    yield from couette_numbers(1.0, 100.0, 1.0)


@row(f"{COUETTE}, 100 Pa, 5 rad/s (all yielded), after 0.3 s", RIWLIN)
def circular_couette_bingham_5():
    yield from couette_numbers(5.0, 100.0, 0.3)
