"""A box that is periodic along every axis: no walls, no free surface, no gravity."""

import numpy as np
import pytest

import taichi_mps as mps


@pytest.mark.parametrize("dimension", [2, pytest.param(3, marks=pytest.mark.long)])
def test_a_body_that_fills_space_goes_on_uniformly(dimension):
    """Once around the unit box along the diagonal: every particle is back, at its speed, without pressure."""
    x = mps.lattice((0.0,) * dimension, (0.9375,) * dimension, 0.125)
    scene = mps.Scene(
        name="periodic box",
        material=mps.Newtonian(density=1000.0, viscosity=50.0),
        spacing=0.125,
        fluid=x,
        velocity=np.ones_like(x),
        gravity=(0.0,) * dimension,
        domain=((0.0,) * dimension, (1.0,) * dimension),
        periodic=(True,) * dimension,
    )
    sim = mps.Simulation(scene, mps.Implicit(max_time_step=0.01, tolerance=1e-6))
    sim.run(until=1.0)
    s = sim.snapshot()
    away = s.x - x
    assert np.abs(away - np.round(away)).max() < 1e-5
    assert np.abs(s.u - 1.0).max() < 1e-5
    assert np.abs(s.p).max() < 1e-3 * 1000.0  # rho U^2
