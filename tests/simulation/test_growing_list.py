"""A neighbour list that is too short: the step is repeated with a longer one, without a trace in the result."""

import numpy as np
import pytest

import taichi_mps as mps

SPACING, STEPS = 0.02, 16


def scene(wall, height):
    """A block falls towards wall particles ``wall`` spacings apart: the nearer to each other, the more neighbours."""
    width, depth = 10 * SPACING, 4 * SPACING
    low = np.array([0.0, height * SPACING])
    return mps.Scene(
        name="crowded wall",
        material=mps.Newtonian(viscosity=50.0),
        spacing=SPACING,
        fluid=mps.fill(mps.Box(low, low + (width, 5 * SPACING)), SPACING),
        velocity=np.tile((0.0, -0.5), (50, 1)),
        walls=(mps.Plane((0.0, 0.0), (0.0, 1.0)),),
        wall_particles=mps.lattice((-width, -depth), (2 * width, 0.0), wall * SPACING),
        domain=((-1.0, -1.0), (1.0, 1.0)),
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("wall", "height", "steps"),
    [(0.65, 20.0, [0]), pytest.param(0.6875, 2.2, range(1, STEPS), marks=pytest.mark.long)],
    ids=["at once", "when the block comes near"],
)
def test_a_list_that_is_too_short_is_made_longer_and_the_step_is_taken_again(wall, height, steps):
    """Sixteen steps, in one of which the list was enlarged, have the bits of a run with a list that is long enough."""
    sim = mps.Simulation(scene(wall, height), mps.Implicit(walls="particles", max_time_step=0.01))
    start, room = sim.state(), [sim.neighbors.pair_capacity]
    for _ in range(STEPS):
        sim.step()
        room.append(sim.neighbors.pair_capacity)
    (longer,) = np.flatnonzero(np.diff(room))
    end = sim.state()
    sim.load(start)
    for _ in range(STEPS):
        sim.step()
    assert longer in steps and sim.neighbors.pair_capacity == room[-1]
    np.testing.assert_equal(sim.state(), end)
