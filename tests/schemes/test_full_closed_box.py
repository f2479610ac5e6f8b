"""A full closed box under gravity: its walls hold the weight, and what flows in it does not know of it (I34)."""

import numpy as np
import pytest

import taichi_mps as mps

ACROSS, DENSITY, ETA, G = 12, 1000.0, 10.0, np.array([0.0, -9.81])  # -, kg/m3, Pa s, m/s2: Reynolds number 100


@pytest.fixture(scope="module")
def cavity():
    """A unit cavity under a lid of 1 m/s and its state at the start; the scene's gravity sets the scales of the step
    and the penalties of all runs."""
    sim = mps.Simulation(
        mps.Scene(
            name="cavity",
            material=mps.Newtonian(density=DENSITY, viscosity=ETA),
            spacing=1.0 / ACROSS,
            fluid=mps.fill(mps.Box((0.0, 0.0), (1.0, 1.0)), 1.0 / ACROSS),
            walls=(*mps.box_planes((0.0, 0.0), (1.0, 1.0)), mps.Plane((0.0, 1.0), (0.0, -1.0), velocity=(1.0, 0.0))),
            gravity=G,
            domain=((-0.1, -0.1), (1.1, 1.1)),
            wall_loads=True,
        )
    )
    return sim, sim.state()


def after(sim, state, gravity, steps=1):
    """Snapshot some steps after a state under a gravity [m/s2]."""
    sim.scheme.fluid.gravity[None] = gravity
    sim.load(state)
    for _ in range(steps):
        sim.step()
    return sim.snapshot()


@pytest.mark.slow
def test_the_vortex_is_the_same_with_and_without_gravity(cavity):
    """Bit for bit, for the weight less that of the first mix is nothing. The pressure that is read has the hydrostatic
    one, and all walls together carry the weight but for what their corners miss, less than half a layer."""
    without, found = (after(*cavity, gravity, 10) for gravity in (0.0 * G, G))
    np.testing.assert_array_equal([found.u, found.x], [without.u, without.x])
    assert found.p == pytest.approx(without.p + DENSITY * (found.x - 0.5) @ G, abs=1e-5 * DENSITY * 9.81)
    assert sum(load.force - without.loads[name].force for name, load in found.loads.items()) == pytest.approx(
        DENSITY * G, abs=0.5 / ACROSS * DENSITY * 9.81
    )


@pytest.mark.slow
def test_a_full_closed_box_goes_on_from_the_whole_pressure(cavity):
    """The particles of a full box carry the pressure in excess of the hydrostatic one, and its state says so. A state
    of an earlier version, whose particles carry the whole pressure, goes on the same up to the tolerance of the solve:
    taken for the excess, it would shake the box."""
    sim, start = cavity
    after(sim, start, G, 3)
    state = sim.state()
    whole = state["p"] + DENSITY * (state["x"] - 0.5) @ G
    own, same, shaken = (after(sim, state | of, G).u for of in ({}, {"p": whole, "full": 0}, {"p": whole}))
    assert np.abs(same - own).max() < 1e-3 < np.abs(shaken - own).max()
