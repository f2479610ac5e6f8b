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
