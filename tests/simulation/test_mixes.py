"""Several mixes in one scene: a film of two layers against its closed form, and refused scenes."""

from dataclasses import replace

import numpy as np
import pytest

import taichi_mps as mps
from tests.support.scenes import two_mixes

DEPTH, ACROSS = 0.1, 10
LOWER = mps.Bingham(density=2400.0, plastic_viscosity=50.0, yield_value=100.0)
UPPER = mps.Bingham(density=2000.0, plastic_viscosity=100.0, yield_value=50.0)


def exact(y, force, lower, upper):
    """Velocity [m/s] at y (n,) [m] of a steady film, ``upper`` above half its depth, driven by ``force`` [m/s2]: the
    shear stress is the weight of what lies above, and u' = ((tau - tau_y)/k)^(1/n) wherever that is positive."""
    edges = np.linspace(0.0, DEPTH, 10001)
    middle = 0.5 * (edges[1:] + edges[:-1])
    above, thick = middle > 0.5 * DEPTH, edges[1]
    density = np.where(above, upper.density, lower.density)
    tau = force * thick * (np.cumsum(density[::-1])[::-1] - 0.5 * density)
    rate = np.where(above, rate_of(upper, tau), rate_of(lower, tau))
    return np.interp(y, edges, np.concatenate([[0.0], np.cumsum(rate * thick)]))


def rate_of(mix, tau):
    """Shear rate [1/s] of a mix at a shear stress [Pa]."""
    index = getattr(mix, "flow_index", 1.0)
    return (np.maximum(0.0, tau - mix.yield_value) / getattr(mix, mix.viscous[0])) ** (1.0 / index)


STIFF, THIN = mps.Newtonian(2300.0, 200.0), mps.Newtonian(2300.0, 20.0)
BENDS = mps.HerschelBulkley(yield_value=60.0, consistency=80.0, flow_index=0.6)
SOFT, RIGID = (mps.Bingham(yield_value=s, plastic_viscosity=v) for s, v in ((20.0, 20.0), (1000.0, 50.0)))


def own_law(rate, structure):
    return 20.0 + 20.0 * rate


OWN = mps.FlowCurve(yield_value=20.0, typical_slope=20.0, shear_stress=own_law)


@pytest.mark.long
@pytest.mark.parametrize(
    ("lower", "upper", "error"),
    [
        (STIFF, THIN, 0.03),
        (THIN, STIFF, 0.03),
        (BENDS, SOFT, 0.03),
        (mps.Newtonian(2300.0, 100.0), BENDS, 0.03),
        (BENDS, OWN, 0.03),
        (RIGID, SOFT, 0.05),
        (LOWER, UPPER, 0.03),
    ],
    ids=["stiff below", "stiff above", "laws", "thinning above", "own law above", "rigid below", "densities"],
)
def test_two_layers_of_any_law(lower, upper, error):
    """A film of two layers with 5 rows each keeps its steady velocity within 3 %; 200 under 20 Pa s was 11 % off when
    each particle took the strain rate of its fit for its own. Over a rigid layer it is a film of five rows: 0.5 % at 20
    across and the order 1.5 of films make 4 %."""
    mps.init(arch="cpu")
    sim = mps.Simulation(two_mixes(lower, upper))
    state = sim.state()
    state["mix"] = (state["x"][:, 1] > 0.5 * DEPTH).astype(np.int32)
    state["u"][:, 0] = exact(state["x"][:, 1], sim.scene.gravity_vector[0], lower, upper)
    sim.load(state)
    sim.run(until=1.5)
    s = sim.snapshot()
    u = exact(s.x[:, 1], sim.scene.gravity_vector[0], lower, upper)
    assert np.linalg.norm(s.u[:, 0] - u) < error * np.linalg.norm(u)
    assert lower is not RIGID or np.abs(s.u[s.mix == 0]).max() < 0.01 * u.max()
    middle, lowest = 0.5 * DEPTH, s.x[:, 1] < DEPTH / ACROSS
    above = upper.density * middle + lower.density * (middle - s.x[lowest, 1].mean())  # the lowest row [kg/m2]
    weight = -sim.scene.gravity_vector[1] * above  # which is pressure where the layer flows
    assert lower is RIGID or s.p[lowest].mean() == pytest.approx(weight, rel=0.03)
    assert s.x[s.mix == 0, 1].max() < middle < s.x[s.mix == 1, 1].min()  # the layers do not mix


@pytest.mark.long
def test_a_newtonian_mix_at_rest_beside_one_with_a_critical_strain_rate():
    """A mix with neither yield stress nor critical strain rate keeps the viscosity eta."""
    water = mps.Newtonian(density=2000.0, viscosity=10.0)
    stiff = mps.Bingham(yield_value=100.0, plastic_viscosity=50.0, critical_strain_rate=0.1)
    sim = mps.Simulation(two_mixes(water, stiff))
    sim.step()
    s = sim.snapshot()
    assert np.all(s.yielded) and np.all(np.isfinite(s.u)) and np.all(s.mix == 0)


def test_the_mixes_of_a_scene_are_counted_once():
    (hose,) = two_mixes(LOWER, UPPER).inlets
    same = replace(hose, material=LOWER), replace(hose, material=None), hose, replace(hose, start=200.0)
    scene = two_mixes(LOWER, UPPER, inlets=same)
    assert scene.materials == (LOWER, UPPER) and [scene.mix_of(inlet) for inlet in same] == [0, 0, 1, 1]
