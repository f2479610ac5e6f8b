"""Momentum along directions in which only gravity acts on the fluid as a whole: the solver's tolerance causes no
drift."""

from types import SimpleNamespace

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.engine.terms.momentum_drift import free_directions
from tests.support.scenes import ran

SPACING = 0.01
FLOOR = mps.Plane((0.0, 0.0), (0.0, 1.0), slip=True)
NONE = [[0, 0], [0, 0]]


def test_a_block_that_collapses_on_a_frictionless_floor_stays_where_it_is():
    """An asymmetric block that gets a push keeps its momentum; blocks drifted at 20 to 60 mm/s when each step started
    from what the solver's tolerance had left."""
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
    s = ran(scene).snapshot()
    assert np.ptp(s.x[:, 0]) > 1.2 * np.ptp(x[:, 0])
    assert s.u[:, 0].mean() == pytest.approx(0.01, abs=1e-12)
    assert s.x[:, 0].mean() == pytest.approx(x[:, 0].mean() + 0.01 * s.time, abs=0.02 * SPACING)


PARTICLES = {"wall_particles": np.zeros((1, 2))}


@pytest.mark.parametrize(
    ("walls", "free", "what"),
    [
        ((), [[1, 0], [0, 1]], {}),
        ((FLOOR,), [[1, 0], [0, 0]], {}),
        ((mps.Plane((0.0, 0.0), (-0.6, 0.8), slip=True),), [[0.64, 0.48], [0.48, 0.36]], {}),
        ((FLOOR, mps.Plane((-0.2, 0.0), (1.0, 0.0), mirror=True)), NONE, {}),
        ((mps.Plane((0.0, 0.0), (0.0, 1.0)),), NONE, {}),
        ((mps.Plane((0.0, 0.0), (0.0, 1.0), friction=mps.Friction(yield_value=10.0)),), NONE, {}),
        ((FLOOR, mps.Cylinder((0.0, 0.05), radius=1.0, slip=True)), NONE, {}),
        ((), NONE, {"axisymmetric": True}),
        ((), NONE, {"inlets": (None,)}),  # an inlet pushes
        ((), NONE, PARTICLES | {"represented": "particles"}),
        ((FLOOR,), [[1, 0], [0, 0]], PARTICLES),  # which are not used
    ],
)
def test_directions_along_all_walls_with_slip_are_free(walls, free, what):
    scene = {
        "dimension": 2,
        "axisymmetric": False,
        "inlets": (),
        "wall_particles": None,
        "represented": "surfaces",
    } | what
    found = free_directions(SimpleNamespace(walls=walls, **scene), scene["represented"])
    assert found == pytest.approx(np.array(free, float), abs=1e-12)
