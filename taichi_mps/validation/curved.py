"""Rows on flows between curved walls: the circular pipe and circular Couette flow, scheme `implicit` at its defaults.

The cross-section is filled from a square lattice cut by the circles, so the first particles lie at any distance from
the wall. Errors of profiles are |u - u_exact|/|u_exact| in the L2 norm over all particles at the end of the run.
"""

import numpy as np

import taichi_mps as mps

from . import Measured, read_reference, row
from .flows import l2

DENSITY, ETA, RADIUS, GAP = 2300.0, 50.0, 0.05, 0.05  # kg/m3, Pa s, m (pipe, inner cylinder), m


def material(tau_y):
    return mps.Bingham(density=DENSITY, plastic_viscosity=ETA, yield_value=tau_y) if tau_y else mps.Newtonian(
        density=DENSITY, viscosity=ETA
    )


# ---- pipe -----------------------------------------------------------------------------------------------------
def pipe_profile(r, push, tau_y):
    """Velocity [m/s] at the radius r [m] under the pressure gradient ``push`` [Pa/m]; a plug within 2 tau_y/push."""
    r = np.maximum(r, min(2.0 * tau_y / push, RADIUS))
    return push / (4.0 * ETA) * (RADIUS**2 - r**2) - tau_y / ETA * (RADIUS - r)


def pipe(across, push, tau_y, until):
    """Snapshot of a pipe along x, periodic, seven spacings long, from rest; ``push`` [Pa/m] is a body force."""
    spacing = 2.0 * RADIUS / across
    section = mps.fill(mps.Ring(RADIUS), spacing)
    x = np.vstack([np.insert(section, 0, (k + 0.5) * spacing, axis=1) for k in range(7)])
    side = RADIUS + spacing
    scene = mps.Scene(
        name="pipe",
        material=material(tau_y),
        spacing=spacing,
        fluid=x,
        walls=(mps.Cylinder((0.0, 0.0, 0.0), RADIUS, axis=(1.0, 0.0, 0.0)),),
        domain=((0.0, -side, -side), (7 * spacing, side, side)),
        periodic=(True, False, False),
        gravity=(push / DENSITY, 0.0, 0.0),
    )
    sim = mps.Simulation(scene)
    sim.run(until=until)
    return sim.snapshot()


def pipe_numbers(push, tau_y, until):
    for line in read_reference("B_pipe_buckingham_reiner.csv"):  # the closed form is the table's
        if [float(line[key]) for key in ("mu_Pas", "ty_Pa", "G_Pa/m")] == [ETA, tau_y, push]:
            assert abs(pipe_profile(float(line["r_m"]), push, tau_y) - float(line["u_m/s"])) < 1e-6, line
    s = pipe(20, push, tau_y, until)
    exact = pipe_profile(np.hypot(s.x[:, 1], s.x[:, 2]), push, tau_y)
    yield Measured("L2 error at 20 across", l2(s.u[:, 0], exact), 0.03)
    p = 2.0 * tau_y / (push * RADIUS)
    flow = np.pi * RADIUS**4 * push / (8.0 * ETA) * (1.0 - 4.0 * p / 3.0 + p**4 / 3.0)
    yield Measured("flow rate (Buckingham-Reiner), relative error",
                   float(s.u[:, 0].sum()) * s.spacing**2 / 7 / flow - 1.0, 0.03)  # fmt: skip
    yield Measured("largest speed across the axis", float(np.abs(s.u[:, 1:]).max() / exact.max()), 0.01, "u_max")


PIPE = "circular pipe, R = 0.05 m, 50 Pa s"
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
def couette_profile(r, turn, tau_y, outer=RADIUS + GAP):
    """Circumferential velocity [m/s] at the radius r [m]: the inner cylinder turns at ``turn`` [rad/s], the outer one
    stands. tau = C/r^2 gives the rate of r d(u/r)/dr, and the material is rigid beyond r_s = sqrt(C/tau_y)."""

    def fall(C, low):
        """u(low)/low - u(outer)/outer [rad/s]."""
        high = min(outer, (C / tau_y) ** 0.5) if tau_y else outer
        low = np.minimum(low, high)
        return C / (2.0 * ETA) * (low**-2.0 - high**-2.0) - tau_y / ETA * np.log(high / low)

    C = [tau_y * RADIUS**2, 1e6]
    for _ in range(200):
        middle = 0.5 * (C[0] + C[1])
        C[int(fall(middle, RADIUS) > turn)] = middle
    return r * fall(C[0], r)


def couette_numbers(turn, tau_y, until):
    for line in read_reference("B_taylor_couette.csv"):  # the closed form is the table's
        if [float(line[key]) for key in ("mu_Pas", "ty_Pa", "Omega")] == [ETA, tau_y, turn]:
            ours = couette_profile(float(line["r_m"]), turn, tau_y)
            assert abs(ours - float(line["utheta_m/s"])) < 1e-4 * RADIUS * turn, line
    spacing, outer = GAP / 20, RADIUS + GAP
    scene = mps.Scene(
        name="circular Couette",
        material=material(tau_y),
        spacing=spacing,
        fluid=mps.fill(mps.Ring(outer, RADIUS), spacing),
        walls=(
            mps.Cylinder((0.0, 0.0), RADIUS, inside=False, angular_velocity=turn),
            mps.Cylinder((0.0, 0.0), outer),
        ),
        domain=((-outer - spacing,) * 2, (outer + spacing,) * 2),
        gravity=(0.0, 0.0),
    )
    sim = mps.Simulation(scene)
    sim.run(until=until)
    s = sim.snapshot()
    r = np.linalg.norm(s.x, axis=1)
    around = (s.x[:, 0] * s.u[:, 1] - s.x[:, 1] * s.u[:, 0]) / r
    outward = (s.x * s.u).sum(1) / r
    exact = couette_profile(r, turn, tau_y)
    yield Measured("L2 error at 20 across", l2(around, exact), 0.03)
    yield Measured("L2 norm of the radial velocity", l2(exact + outward, exact), 0.03)


COUETTE = "circular Couette flow, inner cylinder of 0.05 m turning in one of 0.1 m, 50 Pa s"


@row(f"{COUETTE}, Newtonian, 1 rad/s, after 1 s", "closed form")
def circular_couette_newtonian():
    yield from couette_numbers(1.0, 0.0, 1.0)


@row(f"{COUETTE}, 100 Pa, 1 rad/s (rigid beyond 0.0887 m), after 1 s", "B_taylor_couette.csv and closed form")
def circular_couette_bingham_1():
    yield from couette_numbers(1.0, 100.0, 1.0)


@row(f"{COUETTE}, 100 Pa, 5 rad/s, after 0.5 s", "B_taylor_couette.csv and closed form")
def circular_couette_bingham_5():
    yield from couette_numbers(5.0, 100.0, 0.5)
