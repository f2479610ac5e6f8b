"""Moving walls, and thin ones with fluid on both sides: what they carry along, and that they separate the fluid."""

from dataclasses import replace

import numpy as np
import pytest

import taichi_mps as mps
from tests.support.rigs import L0, Probe, Rig, cloud
from tests.support.scenes import ran

UP = (0.0, 0.0, 1.0)
SHEET = mps.Cylinder((0.0, 0.0, -0.2), 0.32, axis=UP, slope=-0.2, length=0.4, thin=True)  # both rims in the cloud
FITTED = ("n", "packing", "neighbour_count")


def test_where_a_travelling_wall_is():
    lid = mps.Plane((0.0, 1.0), (0.0, -1.0), velocity=(1.0, -0.5))
    sliding = mps.Plane((0.0, 1.0), (0.0, -1.0), velocity=(1.0, 0.0))
    x = np.array([[3.0, 0.0]])
    assert lid.distance(x, 0.4) == pytest.approx(0.8) and sliding.distance(x, 0.4) == pytest.approx(1.0)
    mould = replace(SHEET, velocity=0.5)
    x = np.random.default_rng(2).uniform(-0.4, 0.4, (50, 3))
    assert np.allclose(mould.distance(x + (0.0, 0.0, 0.1), 0.2), SHEET.distance(x), atol=1e-15)
    x = np.array([[0.3, 0.0, 0.0], [0.26, 0.0, 0.0]])  # 20 mm from it on either side
    assert SHEET.distance(x) == pytest.approx(0.02 / np.hypot(1.0, 0.2))
    assert not np.any(mps.Cylinder((0.0, 0.0, 0.0), 1.0, axis=UP, velocity=1.0).travel)  # endless: it only slides


def test_fluid_behind_a_thin_wall_is_not_felt():
    """Fit, density and packing of the particles inside do not depend on the particles outside of a thin wall."""
    x = cloud((7, 7, 7))
    axial = np.abs(x[:, 2]) < 0.15
    x = x[(SHEET.distance(x) > 0.01) & axial]
    inside = np.hypot(x[:, 0], x[:, 1]) < SHEET.radius + SHEET.slope * (x[:, 2] + 0.2)
    assert 20 < inside.sum() < len(x) - 20
    u = np.random.default_rng(4).standard_normal(x.shape)
    seen = []
    for given, velocity in ((x, u), (x[inside], u[inside])):
        rig = Rig(given, planes=(SHEET,))
        number = rig.particles.read()["id"]  # of each row
        fields = (rig.gradients(velocity[number]), *(getattr(rig.gradient, f).to_numpy() for f in FITTED))
        seen.append([field[np.argsort(number)] for field in fields])
    for all_around, alone in zip(*seen, strict=True):
        assert np.allclose(all_around[inside], alone, rtol=1e-12, atol=1e-12)


def test_nothing_passes_through_a_thin_wall_and_all_may_pass_its_rim():
    """Random moves of up to half a spacing pass no lifted mould from either side, except below its rim."""
    rng = np.random.default_rng(5)
    mould = replace(SHEET, velocity=0.25)
    x = rng.uniform(-0.45, 0.45, (4000, 3))
    x = x[mould.distance(x) > 0.1 * L0]
    time = 0.4
    place, move = x + (0.0, 0.0, 0.25 * time), rng.uniform(-0.5, 0.5, x.shape) * L0
    there = Probe((mould,), place, move, time).end.to_numpy()
    past = ~np.isfinite(mould.distance(there, time))
    assert np.array_equal(there[past], (place + move)[past])

    def side(p):
        s = p[:, 2] - 0.25 * time + 0.2
        return np.sign(mould.radius + mould.slope * s - np.hypot(p[:, 0], p[:, 1]))

    def beside(p):
        return np.isfinite(mould.distance(p, time))

    both = beside(place) & beside(there)
    crossing = both & (side(place) != side(place + move))
    assert crossing.sum() > 50
    assert np.array_equal(side(place)[both], side(there)[both])
    assert mould.distance(there, time)[both].min() >= 0.1 * L0 * (1.0 - 1e-6)


def test_a_rim_fades_over_one_spacing():
    z = np.array([0.0, 0.19, 0.2, 0.225, 0.25, 0.299, 0.31, -0.25, -0.35])
    x = np.column_stack([np.full_like(z, 0.25), 0.0 * z, z])
    assert Probe((replace(SHEET, slope=0.0),), x).weight.to_numpy() == pytest.approx(
        [1.0, 1.0, 1.0, 0.75, 0.5, 0.01, 0.0, 0.5, 0.0], abs=1e-12
    )


@pytest.mark.parametrize(
    "slip", [pytest.param(False, id="rough"), pytest.param(True, id="smooth", marks=pytest.mark.long)]
)
def test_force_at_a_thin_wall_is_the_negative_transpose_of_the_gradient(slip):
    x = cloud((6, 6, 6))
    x = x[SHEET.distance(x) > 0.1 * L0]
    rig = Rig(x, planes=(replace(SHEET, slip=slip),))
    rng = np.random.default_rng(6)
    assert rig.imbalance(rng.standard_normal(x.shape), rng.standard_normal((len(x), 3, 3))) < 1e-12


def moved(walls, until):
    """Displacements (n, 2) [m] of a block that would stand, between walls, until a time [s]."""
    x = mps.fill(mps.Box((0.0, 0.0), (1.0, 0.5)), L0)
    scene = mps.Scene("block", mps.Bingham(yield_value=20000.0), L0, x, ((-1.0,) * 2, (2.0,) * 2), walls)
    return ran(scene, until=until).snapshot().x - x


@pytest.mark.slow
@pytest.mark.parametrize(
    ("sign", "unilateral"),
    [
        (-1.0, True),
        pytest.param(1.0, True, marks=pytest.mark.long),
        pytest.param(-1.0, False, marks=pytest.mark.long),
        pytest.param(1.0, False, marks=pytest.mark.long),
    ],
)
def test_a_unilateral_wall_pushes_a_block_and_does_not_pull_it(sign, unilateral):
    """A board pushes a block on a smooth floor at its speed; drawn away it leaves the block if it is unilateral, and
    takes it along if not."""
    floor = mps.Plane((0.0, 0.0), (0.0, 1.0), slip=True)
    board = mps.Plane((0.0, 0.0), (1.0, 0.0), velocity=(sign * 0.2, 0.0), slip=True, loose=unilateral)
    taken = sign > 0.0 or not unilateral
    along = moved((floor, board), 0.5)[:, 0]
    assert np.abs(along - sign * 0.1 * taken).max() < (0.05 if taken else 1e-3) * L0


# ---- the slump cone lifted --------------------------------------------------------------------------------------
def lifted(**keywords):
    return mps.catalogue.build("slump", **({"spacing": 0.02, "lift_speed": 0.15, "yield_value": 500.0} | keywords))


def through(scene, s):
    """Particles that are beside the mould, outside it."""
    mould = scene.walls[-1]
    height = s.x[:, 2] - mould.displacement(s.time)[2]
    radius = mould.radius + mould.slope * height
    return int(np.sum((height > 0.0) & (height < mould.length) & (np.hypot(s.x[:, 0], s.x[:, 1]) > radius)))


@pytest.mark.long
def test_the_mould_holds_the_concrete_and_is_lifted_off_it():
    """Nothing leaks through a lifted mould or sticks to it, and the final shape is that of instant removal within
    l0."""
    scene = lifted(until=3.0)
    sim, again = mps.Simulation(scene), mps.Simulation(scene)
    for _ in range(6):
        sim.step()
    again.load(sim.state())  # a resumed lift is the uninterrupted one, bit for bit
    for run in (sim, again):
        run.step()
        run.step()
    np.testing.assert_equal(vars(again.snapshot()), vars(sim.snapshot()))
    leaks = []
    sim.every(0.1, lambda sim: leaks.append(through(scene, sim.snapshot())))
    assert sim.run() == "rest"
    assert sim.time > 1.0 and max(leaks) == 0
    instant = ran(lifted(lift_speed=None)).measures()
    assert abs(sim.measures()["slump_m"] - instant["slump_m"]) < scene.spacing
    scene.check(sim.snapshot(), sim.measures())


@pytest.mark.long
def test_the_mould_of_rings_holds_them_and_gone_fast_is_gone_at_once():
    sims, inside = {}, []
    for speed in (0.15, 5.0, None):
        sims[speed] = sim = mps.Simulation(lifted(lift_speed=speed, model="axisymmetric", spacing=0.005))
        if speed == 0.15:
            mould = sim.scene.walls[-1]
            sim.every(0.1, lambda sim, mould=mould: inside.append(mould.distance(sim.snapshot().x, sim.time).min()))
        assert sim.run() == "rest"
    assert sims[0.15].time > 2.0 and min(inside) > 0.0
    fast, gone = ([sims[speed].measures()[key] for key in ("slump_m", "spread_m")] for speed in (5.0, None))
    assert fast == pytest.approx(gone, abs=0.001)  # at 5 mm both scatter by 0.1 mm, at 10 mm by 0.3 (docs/models.md)
