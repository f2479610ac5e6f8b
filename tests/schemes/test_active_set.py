"""Active set: particles at rest are left out of the steps, and the rest flows as with all particles."""

from dataclasses import replace

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.engine.particles.active_set import FULL_STEP_INTERVAL
from taichi_mps.engine.particles.particles import BOUNDARY, FLUID

L0 = 0.02
MIX = mps.Bingham(yield_value=200.0, plastic_viscosity=20.0)
BOX = mps.Implicit(sleep="on"), mps.Implicit(sleep="off")


def layer(length=2.4, height=0.1, inlets=(), until=2.0, sides=True, material=MIX):
    """A plane layer between smooth walls, at first at rest."""
    x, z = (np.arange(0.5 * L0, size, L0) for size in (length, height))
    walls = [mps.Plane((0.0, 0.0), (0.0, 1.0), name="floor")]
    if sides:
        walls += [mps.Plane((0.0, 0.0), (1.0, 0.0), slip=True), mps.Plane((length, 0.0), (-1.0, 0.0), slip=True)]
    return mps.Scene(
        "layer",
        material,
        L0,
        np.stack(np.meshgrid(x, z, indexing="ij"), -1).reshape(-1, 2),
        ((-L0, -L0), (length + L0, 1.0)),
        walls=tuple(walls),
        inlets=tuple(inlets),
        until=until,
    )


def weight(at, start, until=2.0):
    """The layer, onto which concrete falls at a place from 0.25 m, from a time on."""
    return layer(inlets=[mps.Inlet((at, 0.35), (0.0, -1.0), 0.06, 0.06, 0.012, start=start)], until=until)


def in_use(sim):
    """Places and kinds of what the last step went through."""
    count = sim.particles.count[None]
    return sim.particles.x.to_numpy()[:count], sim.particles.kind.to_numpy()[:count]


@pytest.fixture(scope="module")
def both():
    """The scene of a weight that lands, with an active set and without, and its first state."""
    sims = [mps.Simulation(weight(0.4, start=1.0), numerics) for numerics in BOX]
    return *sims, sims[0].state()


@pytest.mark.long
def test_with_nothing_asleep_it_is_the_same_run_bit_for_bit(both):
    on, off, start = both
    start = start | {"u": 0.3 * np.sin(3.0 * np.pi * start["x"] / [2.4, 0.3])}
    for sim in (on, off):
        sim.load(start)
        for _ in range(FULL_STEP_INTERVAL + 5):
            sim.step()
    assert on.scheme.left_out == 0.0
    np.testing.assert_equal(on.particles.read(), off.particles.read())


@pytest.fixture(scope="module")
def landed(both):
    """A layer that stands, on which a weight lands."""
    sim, _off, start = both
    seen, places = [], []
    sim.load(start)
    while sim.time < 1.4:
        sim.step()
        x, kind = in_use(sim)
        if not sim.all_active:
            seen.append((sim.time, np.sum(kind == FLUID) / sim.particles.number))
            places.append(x[kind == FLUID, 0])
    return sim, np.array(seen), places


def test_a_layer_at_rest_wakes_where_a_weight_lands_and_nowhere_else(landed):
    """To either side the impulse of what lands from 0.25 m, half of 0.012 rho v, slides the layer against the yield
    stress of its floor, over a length that grows from 0 in the 0.22 s since."""
    slides = MIX.density * 0.012 * (2.0 * 9.81 * 0.25) ** 0.5 / (MIX.yield_value * 0.22)  # 1.4 m
    sim, seen, places = landed
    before, after = seen[:, 0] < 1.0, seen[:, 0] > 1.1
    assert before.any() and after.any()
    assert seen[before, 1].min() < 0.2, "the layer stands"
    moving = [x for x, late in zip(places, after, strict=True) if late]
    assert all(((x > 0.3) & (x < 0.5)).any() for x in moving), "awake under the weight"
    assert max(x.max() for x in moving) < 0.43 + slides, "asleep far from it"
    snapshot = sim.snapshot()
    foot = snapshot.p[(snapshot.x[:, 1] < L0) & (snapshot.x[:, 0] > 1.6)]
    assert foot.mean() == pytest.approx(MIX.density * 9.81 * (0.1 - 0.5 * L0), rel=0.03), "and carries its own weight"


def test_all_particles_are_read_each_once_whatever_is_left_out(landed):
    sim, *_ = landed
    while sim.all_active:
        sim.step()
    assert sim.particles.excluded[None] > 0
    number = sim.fluid_particles
    snapshot = sim.snapshot()
    assert len(snapshot.x) == number == len(np.unique(sim.particles.read()["id"]))
    assert np.isfinite(snapshot.density_ratio).all() and snapshot.density_ratio.max() < 2.0


def test_a_step_with_an_active_set_is_that_of_all(both):
    """From one state, just after the weight has landed, the velocities of the active particles agree with those of a
    step of all within the tolerance of the solver, and the others hardly move in it."""
    sim, whole, start = both
    sim.load(start)
    while sim.time < 1.25 or sim.scheme.active_set.steps != 3:
        sim.step()
    state = sim.state()
    sim.step(), whole.load(state), whole.step()
    assert not sim.all_active, "the step went through a part"
    _x, kind = in_use(sim)
    active = sim.particles.read()["id"][: len(kind)][kind == FLUID]
    assert 10 < len(active) < 0.7 * sim.particles.number and (kind == BOUNDARY).any()
    ours, all_of_them = (
        dict(zip(r["id"], r["u"], strict=True)) for r in (sim.particles.read(), whole.particles.read())
    )
    fast = np.array([all_of_them[i] for i in active])
    error = np.array([ours[i] for i in active]) - fast
    others = np.array([u for i, u in all_of_them.items() if i not in set(active)])
    assert np.abs(fast).max() > 0.05
    assert max(np.abs(error).max(), np.abs(others).max()) < 0.01 * np.abs(fast).max()


@pytest.mark.long
@pytest.mark.parametrize("wall", ["plate", "side"])
def test_what_a_wall_that_moves_comes_near_takes_part_and_the_far_end_does_not(wall, monkeypatch):
    """A plate comes down at 0.3 m/s from 0.25 m onto a layer at rest, while the left wall slides up at 50 mm/s in its
    plane: no particle within an effective radius of either is left out, and the far end is. The solver's tolerance
    leaves less of 50 mm/s than the speed below which particles are left out."""
    # which would read all particles
    monkeypatch.setattr("taichi_mps.engine.simulation.rest.touches_moving_wall", lambda sim: True)
    still, reach, speed, below = layer(height=0.06), 2.1 * L0, 0.3, 0.25
    floor, left, right = still.walls
    section = [(0.4, below), (0.6, below), (0.6, below + 0.06), (0.4, below + 0.06)]
    plate = mps.Solid.prism(section, cell=0.5 * L0, reach=reach, velocity=(0.0, -speed), slip=True)
    side = mps.Plane((0.0, 0.0), (1.0, 0.0), velocity=(0.0, 0.05))
    walls = (floor, left, right, plate) if wall == "plate" else (floor, side, right)
    sim, met = mps.Simulation(replace(still, walls=walls), mps.Implicit(sleep="on", tolerance=3e-4)), 0
    while speed * sim.time < below - 0.04:
        sim.step()
        count = sim.particles.number
        x, kind = sim.particles.x.to_numpy()[:count], sim.particles.kind.to_numpy()[:count]
        under = (np.abs(x[:, 0] - 0.5) < 0.1) & (below - speed * sim.time - x[:, 1] < reach)
        near = under if wall == "plate" else x[:, 0] < reach
        if near.any() and not sim.all_active:
            met += 1
            assert (kind[near] == FLUID).all() and x[kind == FLUID, 0].max() < 1.8
    assert met > 10


@pytest.mark.long
def test_the_floor_carries_the_weight_of_what_is_left_out():
    """The floor carries the whole weight at each output, although most of the layer is left out between outputs."""
    sim, found = mps.Simulation(layer(length=1.0), mps.Implicit(sleep="on", wall_loads=True)), []
    sim.every(0.25, lambda sim: found.append(sim.measures()["force_floor_z_N_per_m"]))
    sim.run()
    assert sim.scheme.left_out > 0.2
    np.testing.assert_allclose(found[4:], -MIX.density * 9.81 * 1.0 * 0.1, rtol=0.01)


@pytest.mark.long
def test_structure_grows_while_it_sleeps():
    """The structure of particles that are left out grows as that of active ones: by A_thix t from the start at rest."""
    mix = mps.HerschelBulkley(yield_value=200.0, consistency=20.0, structuration=100.0)
    sim = mps.Simulation(layer(length=1.0, material=mix), BOX[0])
    while sim.time < 2.0:
        sim.step()
    assert sim.scheme.left_out > 0.2
    grown = sim.particles.read()["structure"]
    assert np.abs(grown / grown.mean() - 1.0).max() < 0.02


def test_a_run_goes_on_from_its_state_bit_for_bit(landed):
    sim, *_ = landed
    while sim.all_active:
        sim.step()
    state, steps = sim.state(), 2 * FULL_STEP_INTERVAL
    ends = []
    for _ in range(2):
        sim.load(state)
        for _ in range(steps):
            sim.step()
        ends.append(sim.particles.read())
    assert sim.scheme.left_out > 0.0
    np.testing.assert_equal(*ends)
