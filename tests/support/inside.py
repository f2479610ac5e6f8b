"""What stands inside of a simulation, for tests of one term at given particles."""

import numpy as np

import taichi_mps as mps


def find(sim) -> None:
    """Neighbours and fits of the particles where they are now."""
    sim.neighbors.search()
    sim.scheme.gradient.build()


def at_start(scene, numerics=None):
    """A simulation whose neighbours and fits are those of the first positions."""
    sim = mps.Simulation(scene, numerics)
    find(sim)
    return sim


def in_order(sim, rows) -> np.ndarray:
    """Values of the rows (capacity, ...) in the order in which the particles were given (n, ...)."""
    number = sim.particles.read()["id"]
    return rows[: len(number)][np.argsort(number)]
