"""Access to the inner objects of a simulation, for tests of one term with given particles."""

import numpy as np

import taichi_mps as mps
from taichi_mps.engine.particles.particles import FLUID


def find(sim) -> None:
    """Neighbours and fits of the particles where they are now."""
    sim.neighbors.search()
    sim.scheme.fluid.gradient.build()


def loaded(sim, x, u=0.0):
    """A compiled simulation at 0 s with another body of fluid at x (n, d) [m], of no more particles than its own."""
    rows = {"x": x, "u": np.broadcast_to(u, x.shape), "kind": np.full(len(x), FLUID), "id": np.arange(len(x))}
    nothing = {name: np.zeros((len(x), *item.shape[1:])) for name, item in sim.particles.read().items()}
    scalars = dict(time=0.0, steps=0, last_dt=None, report=None, rest={})
    sim.load({**nothing, **rows, **scalars, "first": True, "largest_viscosity": 0.0})
    return sim


def at_start(scene, numerics=None):
    """A simulation whose neighbours and fits are those of the first positions."""
    sim = mps.Simulation(scene, numerics)
    find(sim)
    return sim


def in_order(sim, rows) -> np.ndarray:
    """Values of the rows (capacity, ...) in the order in which the particles were given (n, ...)."""
    number = sim.particles.read()["id"]
    return rows[: len(number)][np.argsort(number)]
