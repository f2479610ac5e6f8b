"""Interface of two mixes: fractions on a lattice, stress across and along; return mappings of a law, alone and in
series."""

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.engine.runtime.backend import ti
from taichi_mps.engine.terms.rheology import compiled, curve_mapping, series_mapping
from taichi_mps.engine.terms.stress import return_mapping
from tests.support.scenes import two_mixes

LOWER, UPPER, SPACING = mps.Newtonian(2300.0, 200.0), mps.Newtonian(2300.0, 20.0), 0.01


ROWS = pytest.mark.lattice("the particles of a row have the same value to rounding")


@pytest.fixture(scope="module")
def scheme():
    """The scheme of a film of ten rows, the five upper ones of UPPER, whose terms look at a lattice."""
    mps.init(arch="cpu", precision="f64")
    sim = mps.Simulation(two_mixes(LOWER, UPPER))
    state, scheme = sim.state(), sim.scheme
    sim.load(state | {"mix": (state["x"][:, 1] > 0.05).astype(np.int32)})
    with sim.execution.active():
        scheme.fluid.neighbors.search()
        scheme.fluid.gradient.build()
        scheme.strain_rate.evaluate(0.0)
        scheme.stress.set_viscosity()
        scheme.interface.find_normals()
        scheme.interface.gather(scheme.stress.fluidity)
    return scheme


def rows_of(scheme, field):
    """Mean of a field over each of the ten rows, and its scatter in them."""
    count = scheme.fluid.particles.count[None]
    row = np.floor(scheme.fluid.particles.x.to_numpy()[:count, 1] / SPACING).astype(int)
    values = field.to_numpy()[:count]
    assert max(np.ptp(values[row == k], axis=0).max() for k in range(10)) < 1e-9
    return np.array([values[row == k].mean(axis=0) for k in range(10)])


@ROWS
def test_a_quarter_of_the_gradient_of_a_row_at_the_interface_is_of_the_other_mix(scheme):
    """In the first row half of the fit uses bonds across the interface, and half of each bond lies there; in the second
    row only bonds of two spacings do."""
    share = rows_of(scheme, scheme.interface.other_fraction)
    np.testing.assert_allclose(share[[4, 5]], 0.25, rtol=1e-3)
    assert np.all(share[[3, 6]] < 1e-3) and np.all(share[[0, 1, 2, 7, 8, 9]] == 0.0)
    normal = rows_of(scheme, scheme.interface.normal)
    np.testing.assert_allclose(normal[[4, 5]], [[0.0, 1.0], [0.0, -1.0]], atol=1e-9)
    fluidity = rows_of(scheme, scheme.interface.other_fluidity)
    np.testing.assert_allclose(fluidity[[4, 5]], share[[4, 5]] / (20.0, 200.0), rtol=1e-9)


@ti.data_oriented
class Viscous:
    """Stress of every particle for one velocity gradient."""

    def __init__(self, scheme):
        self.stress, self.count = scheme.stress, scheme.fluid.particles.count
        self.T = ti.Matrix.field(2, 2, ti.f64, scheme.fluid.particles.capacity)

    @ti.kernel
    def run(self, xx: ti.f64, xy: ti.f64, yx: ti.f64):
        for i in range(self.count[None]):
            self.T[i] = self.stress.viscous(i, ti.Matrix([[xx, xy], [yx, -xx]]))


@ROWS
def test_shear_across_goes_through_both_and_stretching_along_through_each(scheme):
    """At u' = 1 1/s the stress is 1/(0.75/200 + 0.25/20) Pa below the interface and 1/(0.25/200 + 0.75/20) Pa above;
    stretched along the layers each mix has 2 eta, and a rotation gives none."""
    viscous = Viscous(scheme)
    viscous.run(0.0, 1.0, 0.0)
    stress = rows_of(scheme, viscous.T)[:, 0, 1]
    share = rows_of(scheme, scheme.interface.other_fraction)
    own, other = np.repeat([200.0, 20.0], 5), np.repeat([20.0, 200.0], 5)
    np.testing.assert_allclose(stress, 1.0 / ((1.0 - share) / own + share / other), rtol=1e-9)
    assert stress[4] == pytest.approx(1.0 / (0.75 / 200.0 + 0.25 / 20.0), rel=2e-3)
    viscous.run(1.0, 0.0, 0.0)
    T = rows_of(scheme, viscous.T)
    np.testing.assert_allclose(T[:, 0, 0], 2.0 * own, rtol=1e-9)
    np.testing.assert_allclose(T[:, 0, 1], 0.0, atol=1e-9)
    viscous.run(0.0, 1.0, -1.0)
    np.testing.assert_allclose(rows_of(scheme, viscous.T), 0.0, atol=1e-9)


@ti.data_oriented
class Mappings:
    """On a list of trial stresses the mappings of Bingham's law, 300 Pa and 50 Pa s: as a flow curve in series with
    another fluid, as one alone, and by the closed form."""

    def __init__(self, share, others):
        self.share, self.others = share, others
        self.curve = compiled(mps.HerschelBulkley(yield_value=300.0, consistency=50.0).shear_stress)
        self.series, self.alone, self.closed = (ti.Vector.field(5, ti.f64, 64) for _ in range(3))
        self.run()

    @ti.func
    def shear_stress(self, i, rate):
        return ti.cast(self.curve(rate, 0.0), float)

    @ti.kernel
    def run(self):
        for k in range(64):
            size = 20.0 * k
            trial = ti.Matrix([[0.6 * size, 0.8 * size], [0.8 * size, -0.6 * size]])
            across = ti.Matrix([[0.0, 0.8 * size], [0.8 * size, 0.0]])
            T, q, rate = series_mapping(self, k, trial, across, 400.0, self.share, self.others)
            self.series[k] = ti.Vector([T[0, 0], T[0, 1], q[0, 0], q[0, 1], rate])
            T, q, rate = curve_mapping(self, k, trial, 400.0)
            self.alone[k] = ti.Vector([T[0, 0], T[0, 1], q[0, 0], q[0, 1], rate])
            T, q, rate = return_mapping(trial, 50.0, 300.0, 400.0)
            self.closed[k] = ti.Vector([T[0, 0], T[0, 1], q[0, 0], q[0, 1], rate])


def test_the_mapping_of_a_straight_curve_is_that_of_bingham():
    found = Mappings(0.0, 0.0)
    closed = found.closed.to_numpy()
    for curve in (found.alone, found.series):
        np.testing.assert_allclose(curve.to_numpy(), closed, rtol=2e-5, atol=1e-5)
    assert (closed[:, 4] == 0.0).sum() == 16  # up to 300 Pa, where the trial is 0, 20, ... Pa


def test_two_laws_in_series_share_the_shear_across():
    """Across q = [(1 - c) phi + psi] T/2 and along q = phi T/2 with phi = rate/|T| and |T| = 300 + 50 rate, and T + 2
    mu_r q is the trial stress."""
    share, others = 0.25, 0.004
    along, across, q_along, q_across, rate = Mappings(share, others).series.to_numpy().T
    size = np.hypot(along, across)
    phi = np.where(rate > 0.0, rate / np.maximum(size, 1e-9), 0.0)
    np.testing.assert_allclose(size[rate > 0.0], 300.0 + 50.0 * rate[rate > 0.0], rtol=1e-4)
    assert np.all(size[rate == 0.0] <= 300.0 * (1.0 + 1e-6)) and 0 < (rate == 0.0).sum() < 64
    np.testing.assert_allclose(q_along, 0.5 * phi * along, rtol=2e-4, atol=1e-4)
    np.testing.assert_allclose(q_across, 0.5 * ((1.0 - share) * phi + others) * across, rtol=2e-4, atol=1e-4)
    np.testing.assert_allclose(along + 800.0 * q_along, 0.6 * 20.0 * np.arange(64), rtol=1e-4, atol=1e-3)
