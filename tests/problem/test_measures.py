"""Measures of snapshots: discs and cones of known size, within the stated bias of each measure."""

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.engine.problem import measures as measure


def disc(radius, height, spacing):
    return measure.still(mps.fill(mps.Cone(radius, radius, height), spacing), spacing)


def filled(inside, spacing, disorder, seed=0, layers=4, reach=0.3):
    """Particles of a lattice with a random origin, each up to ``disorder`` spacings aside, where ``inside(x, y)``."""
    dice, ticks = np.random.default_rng(seed), np.arange(-reach, reach, spacing)
    x = np.stack(np.meshgrid(ticks, ticks, spacing * (np.arange(layers) + 0.5), indexing="ij"), -1).reshape(-1, 3)
    x[:, :2] += dice.uniform(0.0, spacing, 2)
    x += disorder * spacing * dice.uniform(-1.0, 1.0, x.shape) * [1.0, 1.0, 0.3]
    return measure.still(x[inside(x[:, 0], x[:, 1])], spacing)


def round_disc(radius):
    return lambda x, y: np.hypot(x, y) < radius


@pytest.mark.parametrize("disorder", [0.0, 0.1, 0.3])
@pytest.mark.parametrize("spacing", [0.02, 0.01, 0.005])
def test_spread_of_a_disc_is_that_of_its_volume_in_any_order(spacing, disorder):
    """The spread of a disc of particles is that of its volume within a third of l0, a sixth at each end; that of its
    outermost particles would be up to 0.7 l0 too wide."""
    errors = []
    for seed in range(4):
        s = filled(round_disc(0.16), spacing, disorder, seed)
        volume = len(s.x) * spacing**3 / (4 * spacing)
        errors.append(measure.spread(s) - 2.0 * np.sqrt(volume / np.pi))
    assert abs(np.mean(errors)) <= spacing / 3.0


def test_spread_of_an_ellipse_is_the_mean_of_its_diameters():
    s = filled(lambda x, y: np.hypot(x / 0.24, y / 0.16) < 1.0, 0.005, 0.0)
    angle = np.linspace(0.0, 2 * np.pi, 4001)[:-1]
    mean = 2 * (1.0 / np.hypot(np.cos(angle) / 0.24, np.sin(angle) / 0.16)).mean()
    assert measure.spread(s) == pytest.approx(mean, abs=0.005)  # a spacing: its sectors are not equally wide


def test_spread_of_a_thin_rim_is_read_too_short_but_not_by_more_than_if_it_were_pushed_together():
    """The spread of a one-particle film whose outer length X thins out as the square root of the distance from its
    edge, as at rest, is read too short by at most X/3, the error of the film compressed to whole particles."""
    spacing, radius, rim = 0.005, 0.2, 0.03
    dice = np.random.default_rng(1)

    def inside(x, y):
        depth = np.sqrt(np.clip((radius - np.hypot(x, y)) / rim, 0.0, 1.0))
        return dice.uniform(size=len(x)) < depth

    found = measure.spread(filled(inside, spacing, 0.3, layers=1))
    assert 2.0 * (radius - rim / 3.0) <= found <= 2.0 * radius


def test_neither_a_void_inside_nor_one_stray_particle_but_in_its_sector_moves_the_spread():
    whole = filled(round_disc(0.2), 0.01, 0.0)
    void = filled(lambda x, y: (np.hypot(x, y) < 0.2) & (np.hypot(x - 0.1, y) > 0.03), 0.01, 0.0)
    assert measure.spread(void) == pytest.approx(measure.spread(whole), abs=1e-12)
    far = measure.spread(measure.still(np.vstack([whole.x, [0.5, 0.0, 0.005]]), 0.01)) - measure.spread(whole)
    assert 0.0 < far <= 2.0 * 0.31 / int(2 * np.pi * 0.19 / 0.01)


@pytest.mark.parametrize("spacing", [0.02, 0.01, 0.005])
def test_cone_before_the_mould_is_lifted(spacing):
    cone = mps.Cone(0.1, 0.05, 0.3)
    found = measure.slump(measure.still(mps.fill(cone, spacing), spacing), 0.3)
    assert found["slump_m"] == pytest.approx(0.0, abs=1e-12)
    assert found["slump_max_m"] == pytest.approx(0.0, abs=1e-12)
    assert found["spread_m"] == pytest.approx(0.2, abs=spacing)


def test_slump_is_the_drop_of_the_top():
    assert np.isnan(measure.top_height(filled(lambda x, y: np.hypot(x, y) > 0.25, 0.01, 0.0), 0.02))
    s = disc(0.1, 0.06, 0.01)
    raised = measure.still(np.vstack([s.x, [[0.08, 0.0, 0.075]]]), 0.01)  # a lump of one particle away from the axis
    found = measure.slump(raised, 0.3)
    assert found["slump_m"] == pytest.approx(0.24, abs=1e-12)
    assert found["slump_max_m"] == pytest.approx(0.22, abs=1e-12)


@pytest.mark.parametrize("low", [(0.0, 0.0), (0.0, 0.0, 0.0)])
def test_the_front_is_that_of_the_body_and_not_of_a_drop_or_of_one_particle(low):
    """Fronts of a body of ten layers and of a single layer are exact, in any order, and a drop ahead is ignored."""
    spacing, high = 0.01, (0.3,) + (0.1,) * (len(low) - 1)
    for top in (high, (*high[:-1], spacing)):
        x = mps.fill(mps.Box(low, top), spacing)
        found = measure.front(measure.still(x, spacing))
        assert found == pytest.approx({"front_m": 0.3, "height_m": top[-1]}, abs=1e-12)
        drop = np.vstack([x, np.append(0.4, 0.5 * np.array(top)[1:])])
        assert measure.front(measure.still(drop, spacing))["front_m"] == pytest.approx(0.3, abs=1e-12)
        shuffled = np.random.default_rng(1).permutation(x)
        assert measure.front(measure.still(shuffled, spacing))["front_m"] == pytest.approx(0.3, abs=1e-12)
    assert measure.front(measure.still(x[:1], spacing))["front_m"] == pytest.approx(x[0, 0] + 0.5 * spacing, abs=1e-12)


@pytest.mark.parametrize("spacing", [0.02, 0.01, 0.005])
def test_filled_solids_hold_their_volume(spacing):
    box, cone = mps.Box((0.0, 0.0), (0.3, 0.1)), mps.Cone(0.1, 0.05, 0.3)
    assert len(mps.fill(box, spacing)) * spacing**2 == pytest.approx(box.volume, rel=1e-12)
    x = mps.fill(cone, spacing)
    assert len(x) * spacing**3 == pytest.approx(cone.volume, rel=0.02)
    assert {tuple(p) for p in np.round(x, 9)} == {tuple(p) for p in np.round(x * [-1, 1, 1], 9)}  # mirror symmetric


@pytest.mark.parametrize("part", [1.0, 0.1])
def test_the_speed_of_what_moves(part):
    """Where a tenth of a body moves at 0.3 m/s the reported speed is 0.3 m/s, whatever the size of the part at rest."""
    x = mps.lattice((0.0, 0.0), (1.0, 0.2), 0.02)
    u = np.where(x[:, :1] < part, (0.3, 0.0), (0.0, 0.0))
    sim = mps.Simulation(mps.Scene("front", mps.Newtonian(), 0.02, x, ((-1.0, -1.0), (2.0, 2.0)), velocity=u))
    sim.neighbors.search()
    sim.scheme.fluid.gradient.build()
    report = sim.scheme.diagnostics.report(0.1, 1)
    assert (report.max_speed, report.moving_speed) == pytest.approx((0.3, 0.3), rel=1e-12)
    assert report.mean_speed == pytest.approx(0.3 * part**0.5, rel=1e-9)
    assert report.kinetic_energy == pytest.approx(0.5 * 1000.0 * 0.09 * part * 0.2, rel=1e-9)
