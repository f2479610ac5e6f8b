"""Where nothing but gravity acts on the whole fluid, and that nothing else moves it there."""

from types import SimpleNamespace

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.terms.motion import free_directions

SPACING = 0.01
FLOOR = mps.Plane((0.0, 0.0), (0.0, 1.0), slip=True)
PLAIN = {"dimension": 2, "axisymmetric": False, "inlets": (), "wall_particles": None}


def test_a_block_that_collapses_on_a_frictionless_floor_stays_where_it_is():
    """One that is not symmetric, with a push: it keeps the momentum of the push. Blocks slid away at 20 to 60 mm/s, for
    what the solver's tolerance left in a step was where the next one began."""
    x = mps.fill(mps.Box((-0.1, 0.0), (0.1, 0.1)), SPACING)
    x = x[x[:, 1] < 0.1 + 0.5 * x[:, 0]]
    scene = mps.Scene(
        name="wedge",
        material=mps.Bingham(density=2300.0, plastic_viscosity=1500.0, yield_value=200.0),
        spacing=SPACING,
        fluid=x,
        velocity=np.tile((0.01, 0.0), (len(x), 1)),
        walls=(FLOOR,),
        domain=((-0.5, -0.05), (0.5, 0.2)),
        until=2.0,
    )
    sim = mps.Simulation(scene)
    sim.run()
    s = sim.snapshot()
    assert np.ptp(s.x[:, 0]) > 1.2 * np.ptp(x[:, 0])
    assert s.u[:, 0].mean() == pytest.approx(0.01, abs=1e-12)
    assert s.x[:, 0].mean() == pytest.approx(x[:, 0].mean() + 0.01 * s.time, abs=0.02 * SPACING)


@pytest.mark.parametrize(
    "walls, free",
    [
        ((), [[1, 0], [0, 1]]),
        ((FLOOR,), [[1, 0], [0, 0]]),
        ((mps.Plane((0.0, 0.0), (-0.6, 0.8), slip=True),), [[0.64, 0.48], [0.48, 0.36]]),
        ((FLOOR, mps.Plane((-0.2, 0.0), (1.0, 0.0), mirror=True)), [[0, 0], [0, 0]]),
        ((mps.Plane((0.0, 0.0), (0.0, 1.0)),), [[0, 0], [0, 0]]),
        ((mps.Plane((0.0, 0.0), (0.0, 1.0), friction=mps.Friction(yield_value=10.0)),), [[0, 0], [0, 0]]),
        ((FLOOR, mps.Cylinder((0.0, 0.05), radius=1.0, slip=True)), [[0, 0], [0, 0]]),
    ],
)
def test_directions_along_all_walls_with_slip_are_free(walls, free):
    assert free_directions(SimpleNamespace(walls=walls, **PLAIN), "surfaces") == pytest.approx(
        np.array(free, float), abs=1e-12
    )


@pytest.mark.parametrize("what", [{"axisymmetric": True}, {"inlets": (None,)}, {"wall_particles": np.zeros((1, 2))}])
def test_what_an_inlet_pushes_and_what_stands_on_wall_particles_is_not_free(what):
    assert not free_directions(SimpleNamespace(walls=(), **(PLAIN | what)), "particles").any()


def test_wall_particles_that_are_not_used_hold_nothing():
    scene = SimpleNamespace(walls=(FLOOR,), **(PLAIN | {"wall_particles": np.zeros((1, 2))}))
    assert free_directions(scene, "surfaces") == pytest.approx(np.diag([1.0, 0.0]))
