"""The mean of the pressure over the neighbours (I10), and the longest step (I14)."""

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.engine.particles.kernels import smooth_weight
from taichi_mps.engine.problem.problem import Problem
from taichi_mps.engine.problem.time_step import longest_step
from taichi_mps.engine.terms.pressure import SMOOTHING
from tests.support.inside import find, in_order
from tests.support.rigs import L0, cloud

DENSITY, G, RE = 1000.0, np.array([0.0, -9.81]), 2.1


@pytest.fixture(scope="module")
def smoothed():
    """What the smoothing makes of a pressure on 121 particles that deform, or do not: function of x, p and the rate."""
    domain = ((-2.0,) * 2, (2.0,) * 2)
    with pytest.MonkeyPatch.context() as patch:  # compiled with what a full closed box takes
        patch.setattr(Problem, "may_be_full", lambda *_: True)
        sim = mps.Simulation(mps.Scene("pressure", mps.Newtonian(density=DENSITY), L0, cloud((11, 11)), domain))

    def smooth(x, p, shear_rate):
        sim.particles.load({"x": x, "p": p, "shear_rate": np.full(len(x), shear_rate), "id": np.arange(len(x))})
        find(sim)
        sim.scheme.pressure.smooth(1.0)
        return in_order(sim, sim.scheme.pressure.p.to_numpy())

    smooth.sim = sim
    return smooth


def test_a_hydrostatic_pressure_is_its_own_mean_on_any_particles(smoothed):
    x = cloud((11, 11))
    p = 2e4 + DENSITY * x @ G  # at least twice that of half a layer
    assert np.abs(smoothed(x, p, 1.0) - p).max() < 1e-9 * p.max()


def test_in_a_full_closed_box_a_uniform_pressure_is_its_own_mean(smoothed):
    """There p is the pressure in excess of the hydrostatic one, and no weight counts; elsewhere it would grow where
    more neighbours are below than above, at the rim of the cloud by the weight of half a spacing or more."""
    x = cloud((11, 11))
    p = np.full(len(x), 2e4)
    assert np.abs(smoothed(x, p, 1.0) - p).max() > 0.3 * DENSITY * 9.81 * L0
    full = smoothed.sim.scheme.pressure.full
    full[None] = 1
    try:
        assert np.abs(smoothed(x, p, 1.0) - p).max() < 1e-9 * p.max()
    finally:
        full[None] = 0


def test_a_disturbance_is_smoothed_by_what_its_neighbours_weigh_and_left_at_rest(smoothed):
    """An alternating pressure added to a hydrostatic one on a square lattice is multiplied inside by 1 - a + a sum w
    (-1)^(k + l)/sum w over the neighbours (k, l), and unchanged at rest."""
    k = np.argwhere(np.ones((11, 11))) - 5
    x = L0 * k
    even, odd = 1e4 + DENSITY * x @ G, 100.0 * (-1.0) ** k.sum(1)
    near = np.argwhere(np.ones((5, 5))) - 2
    r = np.linalg.norm(near, axis=1)
    w = np.where((r > 0) & (r < RE), smooth_weight(np.minimum(r / RE, 1.0)), 0.0)
    left = 1.0 - SMOOTHING + SMOOTHING * (w * (-1.0) ** near.sum(1)).sum() / w.sum()
    assert -0.5 < left < 0.5
    inside = np.abs(k).max(1) <= 3
    assert smoothed(x, even + odd, 1.0)[inside] == pytest.approx((even + left * odd)[inside], rel=1e-9)
    assert smoothed(x, even + odd, 0.0) == pytest.approx(even + odd, rel=1e-12)


def test_similar_flows_have_similar_steps():
    """With lengths times 4, times times 2 (Froude's similarity) and so viscosities times 8 the step is twice as long,
    for a thin fluid, concrete and a creeping body; each of the three bounds of the docs limits one of them."""
    height, spacing = 0.3, 0.01
    bounds = []
    for viscosity in (1e-6, 50.0 / 2300.0, 1500.0 / 2300.0):
        step = longest_step(viscosity, 9.81, height, spacing)
        assert longest_step(8.0 * viscosity, 9.81, 4.0 * height, 4.0 * spacing) == pytest.approx(2.0 * step)
        bounds.append(step)
    assert bounds[0] == pytest.approx(0.06 * (spacing / 9.81) ** 0.5, rel=1e-3)
    assert bounds[1] == pytest.approx(0.057 * (height / 9.81) ** 0.5)
    assert bounds[2] == pytest.approx(0.5 * 1500.0 / 2300.0 / (9.81 * height))
