"""A box that is periodic along every axis: no walls, no free surface, no gravity."""

import numpy as np
import pytest

import taichi_mps as mps

NU = 0.05  # kinematic viscosity [m2/s]


def box(dimension, across, velocity):
    """Unit cube of that many particles across, with velocity(x) [m/s]."""
    x = mps.lattice((0.0,) * dimension, (1.0 - 0.5 / across,) * dimension, 1.0 / across)
    scene = mps.Scene(
        name="periodic box",
        material=mps.Newtonian(density=1000.0, viscosity=1000.0 * NU),
        spacing=1.0 / across,
        fluid=x,
        velocity=velocity(x),
        gravity=(0.0,) * dimension,
        domain=((0.0,) * dimension, (1.0,) * dimension),
        periodic=(True,) * dimension,
    )
    return mps.Simulation(scene, mps.Implicit(max_time_step=0.01, tolerance=1e-6))


@pytest.mark.parametrize("dimension", [2, pytest.param(3, marks=pytest.mark.long)])
def test_a_body_that_fills_space_goes_on_uniformly(dimension):
    """Once around the box along the diagonal: every particle is back, at its speed, without pressure."""
    sim = box(dimension, 8, lambda x: np.ones_like(x))
    sim.run(until=1.0)
    s = sim.snapshot()
    away = s.x - sim.scene.fluid
    assert np.abs(away - np.round(away)).max() < 1e-5
    assert np.abs(s.u - 1.0).max() < 1e-5
    assert np.abs(s.p).max() < 1e-3 * 1000.0  # rho U^2


@pytest.mark.slow
def test_a_shear_wave_decays_across_the_last_axis():
    """u_x = sin(2 pi y) decays as exp(-4 pi^2 nu t); momentum stays zero."""
    sim = box(2, 24, lambda x: 0.1 * np.sin(2 * np.pi * x[:, 1:]) * (1.0, 0.0))
    sim.run(until=0.2)
    s = sim.snapshot()
    amplitude = 2.0 * np.mean(s.u[:, 0] * np.sin(2 * np.pi * s.x[:, 1]))
    assert amplitude == pytest.approx(0.1 * np.exp(-4 * np.pi**2 * NU * 0.2), rel=0.05)
    assert np.abs(s.u.mean(0)).max() < 1e-6
