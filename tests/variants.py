"""The suite in a variant that differs from it only in rounding.
    python -m pytest -q -p tests.variants --variant moved:1

``moved:SEED`` moves fluid by up to 1e-6 l0 at the start of each simulation, ``numbered:SEED`` numbers it at random,
in which order cells sum it up, and ``no_fast_math`` compiles without fast_math. Tests of an exact lattice, marked
``lattice``, are left out where particles are moved, those of the numbers themselves, ``numbering``, where these change.
"""

import numpy as np
import pytest

NOT_FOR = {"moved": "lattice", "numbered": "numbering"}  # variant -> mark of the tests that are left out


def pytest_addoption(parser):
    parser.addoption("--variant", default="", help="moved:SEED, numbered:SEED or no_fast_math")


def pytest_configure(config):
    variant, _, seed = config.getoption("variant").partition(":")
    if variant == "no_fast_math":
        from taichi_mps.engine.runtime.backend import ti

        start = ti.init
        ti.init = lambda **settings: start(**(settings | {"fast_math": False}))
    elif variant == "moved":
        from taichi_mps.engine.schemes import scheme

        initial_state = scheme.initial_state
        scheme.initial_state = lambda problem: moved(initial_state(problem), problem.scene.spacing, int(seed))
    elif variant == "numbered":
        from taichi_mps.engine.particles.particles import Particles

        load, read = Particles.load, Particles.read
        Particles.load = lambda self, state: load(self, renumbered(self, state, int(seed)))
        Particles.read = lambda self: renumbered(self, read(self), int(seed), back=True)
    elif variant:
        raise pytest.UsageError(f"--variant {variant}: must be moved:SEED, numbered:SEED or no_fast_math")


def moved(state: dict, spacing: float, seed: int) -> dict:
    """The fluid of a first state moved aside at random."""
    aside = np.random.default_rng(seed).uniform(-1e-6, 1e-6, state["x"].shape) * spacing
    return state | {"x": state["x"] + aside * (state["kind"] == 0)[:, None]}


def renumbered(particles, state: dict, seed: int, back=False) -> dict:
    """A state whose particles of the start have other numbers, or again those that they were given."""
    if not hasattr(particles, "order"):
        particles.order = np.random.default_rng(seed).permutation(len(state["id"]))
    order, number = np.argsort(particles.order) if back else particles.order, state["id"]
    last = len(order) - 1
    return state | {"id": np.where(number <= last, order[np.minimum(number, last)], number)}


def pytest_collection_modifyitems(config, items):
    mark = NOT_FOR.get(config.getoption("variant").partition(":")[0])
    left_out = [item for item in items if mark and item.get_closest_marker(mark)]
    config.hook.pytest_deselected(items=left_out)
    items[:] = [item for item in items if item not in left_out]
