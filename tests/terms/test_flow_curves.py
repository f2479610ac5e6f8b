"""Flow curves other than Bingham's: Herschel-Bulkley against its closed form, and a user's thixotropic law."""

import runpy
from dataclasses import replace

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.engine.problem.problem import Problem
from tests.support.scenes import ran

DEPTH, DENSITY = 0.1, 2300.0


@pytest.fixture(scope="module", autouse=True)
def taichi():
    mps.init(arch="cpu")


def stress_of(rate, structure):
    return (200.0 + 30.0 * rate) * (1.0 + structure)


def growth_of(rate, structure):
    return 2.0  # 1/s


@pytest.mark.slow
@pytest.mark.parametrize(
    ("numbers", "within"),
    [
        pytest.param({"consistency": 60.0, "flow_index": 0.5}, 0.03, marks=pytest.mark.long),
        pytest.param({"consistency": 60.0, "flow_index": 1.6}, 0.03, marks=pytest.mark.long),
        ({"casson_viscosity": 20.0}, 0.01),
    ],
)
def test_film_of_a_law(numbers, within):
    """The film of a law has the exact profile of the scene within its bound, and clearly not that of Bingham's law."""
    mix = {"density": DENSITY, "yield_value": 100.0, "spacing": DEPTH / 20}
    # four times rho H^2 over the apparent viscosity on the floor, at n = 0.5
    sim = ran(mps.catalogue.build("film", **mix, **numbers), until=8.0)
    error = sim.measures()["velocity_error"]
    bingham = mps.catalogue.build("film", **mix, plastic_viscosity=60.0).measure(sim.snapshot())["velocity_error"]
    assert error < within and bingham > 3.0 * error, (error, bingham)


@pytest.mark.parametrize(
    ("law", "integral"),
    [
        (mps.Bingham(yield_value=100.0, plastic_viscosity=50.0), 400.0**2 / (2.0 * 50.0)),
        (mps.HerschelBulkley(yield_value=100.0, consistency=50.0, flow_index=0.5), 400.0**3 / (3.0 * 50.0**2)),
        (
            mps.HerschelBulkley(yield_value=100.0, consistency=50.0, flow_index=1.6),
            400.0**1.625 / (1.625 * 50.0**0.625),
        ),
        (
            mps.Casson(yield_value=100.0, casson_viscosity=50.0),
            ((500.0**2 - 100.0**2) / 2.0 - 40.0 / 3.0 * (500.0**1.5 - 100.0**1.5) + 100.0 * 400.0) / 50.0,
        ),
    ],
    ids=str,
)
def test_the_exact_film_of_the_scene_is_the_integral_of_the_shear_rate(law, integral):
    """The exact velocity at the surface is the integral of the shear rate under the weight of 5 kPa/m, and 0 at the
    floor."""
    film_velocity = runpy.run_path(str(mps.catalogue.names()["film"]))["film_velocity"]
    u = film_velocity(np.array([0.0, DEPTH]), DEPTH, 5000.0, law)
    np.testing.assert_allclose(u, [0.0, integral / 5000.0], rtol=1e-6, atol=1e-12)


def test_a_thixotropic_law_of_ones_own_comes_to_rest():
    """The film stops when its yield stress, (1 + 2 t) 200 Pa, exceeds the stress on the floor."""
    law = mps.FlowCurve(
        density=DENSITY, yield_value=200.0, typical_slope=30.0, shear_stress=stress_of, growth=growth_of
    )
    scene = replace(mps.catalogue.build("film", spacing=DEPTH / 10), material=law, check=None, measure=None)
    weight = DENSITY * scene.gravity_vector[0]  # along the slope [N/m3]
    stands = 0.5 * (weight * DEPTH / 200.0 - 1.0)  # [s]
    assert 0.3 < stands < 1.5
    sim = ran(scene, until=0.5 * stands)
    assert sim.snapshot().u[:, 0].max() > 0.01
    sim.run(until=stands + 0.5)
    assert np.abs(sim.snapshot().u).max() < 1e-4
    structure = sim.particles.read()["structure"]
    np.testing.assert_allclose(structure, 2.0 * sim.report.time, rtol=1e-4)


@pytest.mark.slow
def test_ten_minutes_at_rest_are_few_steps_and_an_age():
    """300 Pa that grow by 0.5 Pa/s are 600 Pa after 600 s without weight, in the mould; what then falls is the mix of
    an age of 600 s."""
    wait, thixotropic = 600.0, {"yield_value": 300.0, "structuration": 0.5, "destructuration": 0.0}
    cone = mps.catalogue.build("slump", model="axisymmetric", spacing=0.02, until=wait + 1.0, age=wait, **thixotropic)
    sim = mps.Simulation(cone)
    aged = sim.state()
    np.testing.assert_allclose(aged["structure"], 1.0)
    sim.run()
    slump = sim.measures()["slump_m"]
    gravity = ((0.0, 0.0, 0.0), (wait, 0.0, 0.0), (wait, 0.0, -9.81))
    rested = replace(cone, material=mps.HerschelBulkley(**thixotropic), gravity=gravity)
    sim.restart(Problem(rested), aged | {"structure": 0.0 * aged["structure"]})
    sim.run(until=wait)
    assert sim.time == wait and sim.steps < 300
    np.testing.assert_allclose(sim.particles.read()["structure"], 1.0, rtol=1e-5)
    sim.run()
    assert sim.measures()["slump_m"] == pytest.approx(slump, abs=5e-4) and 0.16 < slump < 0.18


@pytest.mark.long
def test_a_thixotropic_film_follows_its_closed_form():
    """Each height has its stress W (H - y) once inertia has died out within a tenth of a second, and u' = (tau - (1 +
    lambda) tau_y)/k, d lambda/dt = A/tau_y - alpha u' lambda of its own: within 1 % at 20 across."""
    tau_y, k, growing, undone, until = 100.0, 100.0, 10.0, 0.5, 4.0
    mix = {"density": DENSITY, "yield_value": tau_y, "plastic_viscosity": k}
    scene = mps.catalogue.build(
        "film", **mix, structuration=growing, destructuration=undone, spacing=DEPTH / 20, until=until
    )
    s = ran(scene).snapshot()
    edges = np.linspace(0.0, DEPTH, 2001)
    tau = DENSITY * scene.gravity_vector[0] * (DEPTH - 0.5 * (edges[1:] + edges[:-1]))
    structure, steps = np.zeros(2000), 4000
    for _ in range(steps):
        rate = np.maximum(0.0, tau - (1.0 + structure) * tau_y) / k
        structure += until / steps * (growing / tau_y - undone * rate * structure)
    u = np.interp(s.x[:, 1], edges, np.concatenate([[0.0], np.cumsum(rate * edges[1])]))
    error = np.linalg.norm(s.u[:, 0] - u) / np.linalg.norm(u)
    assert error < 0.01, error
    assert structure.max() > 0.3 > 0.1 > structure.min()  # both parts of the law count
