"""Sleep: what rests is left out of the solve, the front goes as far, and what is disturbed wakes."""

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.terms.sleeping import AWAKE


@pytest.fixture(scope="module", autouse=True)
def taichi():
    mps.init(arch="cpu")


def layer(length=0.6, height=0.1, l0=0.01):
    """A layer of stiff concrete that slumps at its right end only."""
    return mps.Scene(
        name="layer",
        material=mps.Bingham(yield_value=400.0, plastic_viscosity=20.0),
        spacing=l0,
        fluid=mps.fill(mps.Box((-length, 0.0), (0.0, height)), l0),
        walls=(mps.Plane((0.0, 0.0), (0.0, 1.0)), mps.Plane((-length, 0.0), (1.0, 0.0))),
        domain=((-length - 0.05, -0.03), (0.5, 0.2)),
        measure=mps.measure.front,
    )


def asleep(sim):
    """Share of the particles that were no unknowns in the last step."""
    return float(np.mean(sim.scheme.sleeping.state.to_numpy()[: sim.particles.count[None]] != AWAKE))


def carried(sleep, until=0.6):
    """A simulation of the layer at the first step from ``until`` [s] on, not a tenth one: in these all are awake."""
    sim = mps.Simulation(layer(), mps.Implicit(sleep=sleep))
    while sim.time < until or sim.steps % 10 == 0:
        sim.step()
    return sim


@pytest.mark.long
def test_the_front_of_a_layer_that_sleeps_goes_as_far():
    awake, sleeping = (carried(sleep).measures()["front_m"] for sleep in (False, True))
    assert awake > 0.01
    assert sleeping == pytest.approx(awake, abs=1e-3)


def test_most_of_a_layer_sleeps_and_what_is_pushed_wakes_and_comes_to_rest_again():
    sim = carried(True)
    assert asleep(sim) > 0.6
    state = sim.state()
    pushed = (state["x"][:, 0] > -0.4) & (state["x"][:, 0] < -0.2) & (state["x"][:, 1] > 0.05)
    state["u"][pushed, 0] = 0.05
    state["still"][pushed] = 0.0
    state["report"] = None  # the step is found from the velocities
    before = asleep(sim)
    sim.load(state)
    sim.step()
    assert asleep(sim) < before - pushed.mean()
    numbers = state["id"][pushed]
    assert np.abs(sim.snapshot().u[numbers]).mean() > 1e-3
    while sim.time < 1.5 or sim.steps % 10 == 0:
        sim.step()
    assert np.abs(sim.snapshot().u[numbers]).max() < 1e-4
    assert asleep(sim) > 0.6
