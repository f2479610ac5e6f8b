"""Several mixes in one scene: a film of two layers against its closed form, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.problem import catalogue

DEPTH, ACROSS = 0.1, 10
LOWER = mps.Bingham(density=2400.0, plastic_viscosity=50.0, yield_value=100.0)
UPPER = mps.Bingham(density=2000.0, plastic_viscosity=100.0, yield_value=50.0)


def film(**change):
    """The scene film of the mix LOWER, with a hose of the mix UPPER that opens long after the end."""
    spacing = DEPTH / ACROSS
    scene = catalogue.build("film", spacing=spacing)
    (left, bottom), (right, top) = scene.domain
    hose = mps.Inlet((0.5 * (left + right), top), (0.0, -1.0), 2 * spacing, 1e-3, 4 * spacing**2, 100.0, UPPER)
    domain = ((left, bottom), (right, top + 2 * spacing))
    given = {"material": LOWER, "inlets": (hose,), "domain": domain, "check": None, "measure": None}
    return replace(scene, **(given | change))


def exact(y, force):
    """Velocity [m/s] at y (n,) [m] of a steady film, UPPER above half its depth, driven by ``force`` [m/s2]: the shear
    stress is the weight of what lies above, and u' = (tau - tau_y)/eta wherever that is positive."""
    at = np.linspace(0.0, DEPTH, 10001)
    above = at > 0.5 * DEPTH
    density, tau_y, eta = (
        np.where(above, getattr(UPPER, name), getattr(LOWER, name))
        for name in ("density", "yield_value", "plastic_viscosity")
    )
    tau = force * np.cumsum(density[::-1])[::-1] * at[1]
    rate = np.maximum(0.0, tau - tau_y) / eta
    return np.interp(y, at, np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1])) * at[1]]))


@pytest.mark.long
def test_film_of_two_layers():
    mps.init(arch="cpu")
    sim = mps.Simulation(film())
    state = sim.state()
    state["mix"] = (state["x"][:, 1] > 0.5 * DEPTH).astype(np.int32)
    sim.load(state)
    sim.run(until=2.0)
    s = sim.snapshot()
    u = exact(s.x[:, 1], sim.scene.gravity_vector[0])
    assert np.linalg.norm(s.u[:, 0] - u) < 0.03 * np.linalg.norm(u)
    middle, lowest = 0.5 * DEPTH, s.x[:, 1] < DEPTH / ACROSS
    above = UPPER.density * middle + LOWER.density * (middle - s.x[lowest, 1].mean())  # the lowest row [kg/m2]
    assert s.p[lowest].mean() == pytest.approx(-sim.scene.gravity_vector[1] * above, rel=0.03)
    assert s.x[s.mix == 0, 1].max() < middle < s.x[s.mix == 1, 1].min()  # the layers do not mix


def test_a_newtonian_mix_at_rest_beside_one_with_a_critical_strain_rate():
    """Neither a yield value nor a rate: its viscosity is eta."""
    water = mps.Newtonian(density=2000.0, viscosity=10.0)
    stiff = mps.Bingham(yield_value=100.0, plastic_viscosity=50.0, critical_strain_rate=0.1)
    sim = mps.Simulation(film(material=water, inlets=(replace(film().inlets[0], material=stiff),)))
    sim.step()
    s = sim.snapshot()
    assert np.all(s.yielded) and np.all(np.isfinite(s.u)) and np.all(s.mix == 0)


@pytest.mark.parametrize(
    "change, message",
    [
        ({"material": mps.HerschelBulkley()}, "material = HerschelBulkley: must be Bingham or Newtonian"),
        ({"material": mps.Bingham(critical_strain_rate=0.01)}, "critical_strain_rate: must be given for all mixes"),
        ({"walls": (mps.Plane((0, 0), (0, 1), friction=mps.Friction(viscous_constant=9.0)),)}, "friction"),
    ],
)
def test_mixes_that_do_not_go_together_are_refused(change, message):
    with pytest.raises(mps.SceneError, match=message):
        film(**change)
    hose = replace(film().inlets[0], material=mps.HerschelBulkley())
    with pytest.raises(mps.SceneError, match="inlet: material = HerschelBulkley.*must be Bingham or Newtonian"):
        film(inlets=(hose,))


def test_the_mixes_of_a_scene_are_counted_once():
    scene = film()
    hose = scene.inlets[0]
    same = replace(hose, material=LOWER), replace(hose, material=None), hose, replace(hose, start=200.0)
    assert film(inlets=same).materials == (LOWER, UPPER)
    assert [film(inlets=same).mix_of(inlet) for inlet in same] == [0, 0, 1, 1]
