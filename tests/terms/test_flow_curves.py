"""Flow curves other than Bingham's: Herschel-Bulkley against its closed form, an own law that is thixotropic."""

from dataclasses import replace

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.problem import catalogue
from taichi_mps.runtime.backend import ti
from taichi_mps.terms.rheology import curve_mapping, flow_curve, return_mapping

DEPTH, DENSITY = 0.1, 2300.0


@pytest.fixture(scope="module", autouse=True)
def taichi():
    mps.init(arch="cpu")


def film(material, across):
    """The scene film with another material, and the weight along the slope [N/m3]."""
    scene = catalogue.build("film", spacing=DEPTH / across)
    return replace(scene, material=material, check=None, measure=None), DENSITY * scene.gravity_vector[0]


def stress_of(rate, structure):
    return (200.0 + 30.0 * rate) * (1.0 + structure)


def growth_of(rate, structure):
    return 2.0  # 1/s


@ti.data_oriented
class Mapping:
    """Both mappings on a list of trial stresses."""

    def __init__(self, material, mu_r):
        self.curve, self.material, self.mu_r = flow_curve(material), material, mu_r
        self.out = ti.Vector.field(4, ti.f64, 64)

    @ti.func
    def shear_stress(self, i, rate):
        return ti.cast(self.curve(rate, 0.0), float)

    @ti.kernel
    def run(self):
        for k in range(64):
            size = 20.0 * k
            trial = ti.Matrix([[0.6 * size, 0.8 * size], [0.8 * size, -0.6 * size]])
            a, _, rate_a = curve_mapping(self, k, trial, self.mu_r)
            b, _, rate_b = return_mapping(trial, 50.0, 300.0, self.mu_r)
            self.out[k] = ti.Vector([a[0, 1], rate_a, b[0, 1], rate_b])


def test_the_mapping_of_a_straight_curve_is_that_of_bingham():
    mapping = Mapping(mps.HerschelBulkley(yield_value=300.0, consistency=50.0, flow_index=1.0), 400.0)
    mapping.run()
    out = mapping.out.to_numpy()
    np.testing.assert_allclose(out[:, :2], out[:, 2:], rtol=2e-5, atol=1e-3)
    assert (out[:, 1] == 0.0).sum() == 16  # up to 300 Pa, where the trial is 0, 20, ... Pa


@pytest.mark.long
@pytest.mark.parametrize("index", [0.5, 1.6])
def test_film_of_herschel_and_bulkley(index):
    """u(y) = n/(n+1) (W/k)^(1/n) (d^(1+1/n) - (d - y)^(1+1/n)), d the depth of the sheared layer."""
    material = mps.HerschelBulkley(density=DENSITY, yield_value=100.0, consistency=60.0, flow_index=index)
    scene, weight = film(material, 20)
    sim = mps.Simulation(scene)
    sim.run(until=8.0)  # four times rho H^2 over the apparent viscosity on the floor, at n = 0.5
    s = sim.snapshot()
    sheared = DEPTH - 100.0 / weight
    power = 1.0 + 1.0 / index
    below = np.maximum(0.0, sheared - s.x[:, 1])
    exact = (weight / 60.0) ** (1.0 / index) / power * (sheared**power - below**power)
    error = np.sqrt(np.mean((s.u[:, 0] - exact) ** 2)) / exact.max()
    bingham = weight / 120.0 * (sheared**2 - below**2)
    assert error < 0.03, error
    assert np.sqrt(np.mean((bingham - exact) ** 2)) / exact.max() > 3.0 * error  # tells the laws apart


def test_a_thixotropic_law_of_ones_own_comes_to_rest():
    """The stress on the floor carries (1 + 2 t) 200 Pa from some time on: then the film stands."""
    law = mps.FlowCurve(
        density=DENSITY, yield_value=200.0, plastic_viscosity=30.0, shear_stress=stress_of, growth=growth_of
    )
    scene, weight = film(law, 10)
    stands = 0.5 * (weight * DEPTH / 200.0 - 1.0)  # [s]
    assert 0.3 < stands < 1.5
    sim = mps.Simulation(scene)
    sim.run(until=0.5 * stands)
    assert sim.snapshot().u[:, 0].max() > 0.01
    sim.run(until=stands + 0.5)
    assert np.abs(sim.snapshot().u).max() < 1e-4
    structure = sim.particles.read()["structure"]
    np.testing.assert_allclose(structure, 2.0 * sim.time, rtol=1e-4)


@pytest.mark.long
def test_a_thixotropic_film_follows_its_closed_form():
    """Within 1 % at 20 across. Each height has its stress W (H - y), inertia dying out within a tenth of a second, and
    u' = (tau - (1 + lambda) tau_y)/k, d lambda/dt = A/tau_y - alpha u' lambda of its own."""
    tau_y, k, growing, undone, until = 100.0, 100.0, 10.0, 0.5, 4.0
    mix = {"density": DENSITY, "yield_value": tau_y, "plastic_viscosity": k}
    scene = catalogue.build(
        "film", **mix, structuration=growing, destructuration=undone, spacing=DEPTH / 20, until=until
    )
    sim = mps.Simulation(scene)
    sim.run()
    s = sim.snapshot()
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
