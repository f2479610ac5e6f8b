"""What tests of grains have in common."""

import numpy as np

import taichi_mps as mps

L0, G = 0.01, 9.81  # spacing [m], weight [m/s2]
THIN = mps.Newtonian(viscosity=1e-3, density=1000.0)  # the law where there is no mortar


def two_bars(half, bar):
    """A solid of two round bars of the radius ``bar``, each ``half`` from the middle [m]."""

    def distance(x):
        return np.minimum(*(np.hypot(x[:, 0] - side * half, x[:, 1]) for side in (-1.0, 1.0))) - bar

    return mps.Solid.of(distance, (-half - 0.04, -0.03), (half + 0.04, 0.03), 0.125 * L0)


def advance(sim, time):
    while sim.time < time - 1e-9:
        sim.step(time)


def momenta(sim):
    """Momentum (3,) [kg m/s], angular momentum (3,) [kg m2/s] and kinetic energy [J] of all grains."""
    names = "mass", "centre", "velocity", "spin", "rotation", "solid"
    m, x, u, w, turn, solid = (getattr(sim.scheme.rigid, name).to_numpy() for name in names)
    own, p = (turn @ solid @ turn.transpose(0, 2, 1) @ w[..., None])[..., 0], m[:, None] * u
    return p.sum(0), (np.cross(x, p) + own).sum(0), 0.5 * (p * u).sum() + 0.5 * (w * own).sum()
