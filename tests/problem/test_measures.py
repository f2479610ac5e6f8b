"""What is measured on a snapshot: discs and cones of known size, within the bias that the measure states."""

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.problem import measures as measure
from taichi_mps.problem.measures import Snapshot


def snapshot(x, spacing):
    x = np.asarray(x, float)
    zeros = np.zeros(len(x))
    return Snapshot(0.0, spacing, x, 0.0 * x, zeros, zeros, zeros > 0, zeros + 1.0, np.zeros((0, x.shape[1])))


def disc(radius, height, spacing):
    return snapshot(mps.fill(mps.Cone(radius, radius, height), spacing), spacing)


def ring(radius, spacing, turn=0.0, count=400):
    angle = 2 * np.pi * np.arange(count) / count + turn
    r = radius - 0.5 * spacing
    return np.stack([r * np.cos(angle), r * np.sin(angle), 0.0 * angle + 0.5 * spacing], 1)


@pytest.mark.parametrize("spacing", [0.01, 0.02])
def test_top_of_a_flat_disc_is_exact(spacing):
    assert measure.top_height(disc(0.1, 0.06, spacing), 0.02) == pytest.approx(0.06, abs=1e-12)


@pytest.mark.parametrize("spacing", [0.02, 0.01, 0.005])
def test_spread_of_a_disc(spacing):
    """Each sector is read at its outermost particle + l0/2: within one spacing of the lattice disc's diameter."""
    assert measure.spread(disc(0.1, 0.06, spacing)) == pytest.approx(0.2, abs=spacing)


def test_spread_of_a_ring_is_exact_and_does_not_depend_on_direction():
    for turn in (0.0, 0.1, 1.0):
        assert measure.spread(snapshot(ring(0.25, 0.01, turn), 0.01)) == pytest.approx(0.5, abs=1e-12)


def test_spread_of_an_ellipse_is_the_mean_of_its_diameters():
    x = ring(0.25, 1e-6, count=4000) * [1.2, 0.8, 1.0]
    s = snapshot(x, 0.01)
    angle = np.linspace(0.0, 2 * np.pi, 4001)[:-1]
    mean = 2 * (0.25 / np.sqrt((np.cos(angle) / 1.2) ** 2 + (np.sin(angle) / 0.8) ** 2)).mean() + 0.01
    assert measure.spread(s) == pytest.approx(mean, abs=0.005)


def test_one_stray_particle_moves_the_spread_by_its_own_sector_only():
    x = ring(0.25, 0.01)
    far = measure.spread(snapshot(np.vstack([x, [0.5, 0.0, 0.005]]), 0.01)) - 0.5
    sectors = 4 * int(2 * np.pi * 0.5 / 0.06)
    assert 0.0 < far <= 2 * 0.26 / sectors + 1e-12


@pytest.mark.parametrize("spacing", [0.02, 0.01, 0.005])
def test_cone_before_the_mould_is_lifted(spacing):
    cone = mps.Cone(0.1, 0.05, 0.3)
    found = measure.slump(snapshot(mps.fill(cone, spacing), spacing), 0.3)
    assert found["slump_m"] == pytest.approx(0.0, abs=1e-12)
    assert found["slump_max_m"] == pytest.approx(0.0, abs=1e-12)
    assert found["spread_m"] == pytest.approx(0.2, abs=spacing)


def test_slump_is_the_drop_of_the_top():
    s = disc(0.1, 0.06, 0.01)
    raised = snapshot(np.vstack([s.x, [[0.08, 0.0, 0.075]]]), 0.01)  # a lump of one particle away from the axis
    found = measure.slump(raised, 0.3)
    assert found["slump_m"] == pytest.approx(0.24, abs=1e-12)
    assert found["slump_max_m"] == pytest.approx(0.22, abs=1e-12)


def test_nothing_at_the_axis_is_not_a_number():
    assert np.isnan(measure.top_height(snapshot(ring(0.25, 0.01), 0.01), 0.02))


def test_front():
    x = mps.fill(mps.Box((0.0, 0.0), (0.3, 0.1)), 0.01)
    assert measure.front(snapshot(x, 0.01)) == pytest.approx({"front_m": 0.3, "height_m": 0.1}, abs=1e-12)


@pytest.mark.parametrize("spacing", [0.02, 0.01, 0.005])
def test_filled_solids_hold_their_volume(spacing):
    box, cone = mps.Box((0.0, 0.0), (0.3, 0.1)), mps.Cone(0.1, 0.05, 0.3)
    assert len(mps.fill(box, spacing)) * spacing**2 == pytest.approx(box.volume, rel=1e-12)
    x = mps.fill(cone, spacing)
    assert len(x) * spacing**3 == pytest.approx(cone.volume, rel=0.02)
    assert {tuple(p) for p in np.round(x, 9)} == {tuple(p) for p in np.round(x * [-1, 1, 1], 9)}  # mirror symmetric


@pytest.mark.parametrize("part", [1.0, 0.1])
def test_the_speed_of_what_moves(part):
    """A tenth of the body at 0.3 m/s: the report has 0.3 m/s, however large the rest that stands."""
    x = mps.lattice((0.0, 0.0), (1.0, 0.2), 0.02)
    u = np.where(x[:, :1] < part, (0.3, 0.0), (0.0, 0.0))
    scene = mps.Scene("front", mps.Newtonian(), 0.02, x, ((-1.0, -1.0), (2.0, 2.0)), velocity=u)
    sim = mps.Simulation(scene)
    sim.neighbors.search()
    sim.scheme.gradient.build()
    report = sim.scheme.diagnostics.report(0.1, 1)
    assert (report.max_speed, report.moving_speed) == pytest.approx((0.3, 0.3), rel=1e-12)
    assert report.mean_speed == pytest.approx(0.3 * part**0.5, rel=1e-9)
    assert report.kinetic_energy == pytest.approx(0.5 * 1000.0 * 0.09 * part * 0.2, rel=1e-9)
