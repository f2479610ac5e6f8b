"""Gravity and walls that change in time, with exactly known effects on a body."""

from dataclasses import replace

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.engine.geometry.time_dependent import TimeDependent

L0 = 0.1
JUMPS = ((0.0, 3.0, 0.0), (0.2, 3.0, 0.0), (0.2, -1.0, 2.0), (0.4, -1.0, 2.0), (0.5, 0.0, 0.0))


def block(**changed):
    given = {
        "name": "block",
        "material": mps.Bingham(yield_value=2000.0),
        "spacing": L0,
        "fluid": mps.fill(mps.Box((0.0, 0.0), (1.0, 0.5)), L0),
        "domain": ((-3.0, -3.0), (4.0, 3.0)),
        "until": 0.6,
    }
    return mps.Scene(**given | changed)


@pytest.fixture(scope="module")
def free():
    """A function that gives a block without walls at its start, compiled once, in a gravity."""
    sim = mps.Simulation(block(gravity=JUMPS), mps.Implicit(max_time_step=0.01))
    start = sim.state()

    def within(gravity):
        sim.restart(replace(sim.problem, scene=block(gravity=gravity)), start)
        return sim

    return within


def test_a_free_block_follows_gravity(free):
    """Velocity is the integral of gravity, and position that of velocity to the order of the step; steps end at the
    rows of a table, and a resumed run has the same bits, also one of several limits."""
    sim = free(JUMPS)
    changing, ends, found = sim.scene.gravity_in_time, [], []
    sim.each_step(lambda sim: ends.append(sim.time))
    sim.run(until=0.25)
    state = sim.state()
    for limits in ((), (0.26, 0.3999, 0.4, 0.41)):  # which do not change the run
        sim.load(state)
        for limit in limits:
            sim.run(until=limit)
        sim.run()
        found.append(sim.snapshot())
    s, again = found
    assert np.allclose(s.u, changing.integral(0.0, 0.6), atol=2e-5)
    way = sum(changing.integral(0.0, t) for t in (np.arange(600) + 0.5) * 1e-3) * 1e-3
    assert np.abs(s.x - sim.scene.fluid - way).max() < 2e-4
    assert set(changing.times) - {0.0} <= {round(t, 9) for t in ends}
    np.testing.assert_equal(vars(again), vars(s))


VELOCITY = ((0.1, 0.0, 0.0), (0.2, 0.0, 0.4), (0.3, 0.0, 0.4), (0.3, 0.0, 0.0))  # [m/s], from 0.1 s on


@pytest.mark.slow
@pytest.mark.parametrize("until", [pytest.param(3.0, marks=pytest.mark.long), 0.5])
def test_a_floor_lifts_a_block_as_it_says(until):
    """A rising floor carries a block that stands on it; the block comes to rest when the floor has stopped, and not
    before."""
    floor = mps.Plane((0.0, 0.0), (0.0, 1.0), velocity=VELOCITY, slip=True)
    scene = block(walls=(floor,), stop_at_rest=True, until=until, material=mps.Bingham(yield_value=20000.0))
    sim = mps.Simulation(scene)
    stopped = sim.run()
    assert floor.displacement(1.0) == pytest.approx((0.0, 0.06), rel=1e-3)
    assert (stopped, sim.time > 0.3) == ("rest" if until > 0.5 else "time", True)
    assert np.abs(sim.snapshot().x - scene.fluid - (0.0, 0.06)).max() < 0.05 * L0


@pytest.mark.long
def test_what_stands_wakes_when_gravity_turns(monkeypatch):
    """A cone at rest that is left out of the steps flows again as without an active set: after a jump of gravity all
    particles are active."""
    monkeypatch.setattr("taichi_mps.engine.particles.active_set.MIN_EXCLUDED_FRACTION", 0.01)
    gravity = ((0.0, 0.0, -1.0), (0.5, 0.0, -1.0), (0.5, 0.0, -9.81))
    walls = (mps.Plane((0.0, 0.0), (0.0, 1.0)),)
    scene = block(walls=walls, gravity=gravity, spacing=0.05, fluid=mps.fill(mps.Box((0.0, 0.0), (1.0, 0.5)), 0.05))
    reach = []
    for sleep in ("on", "off"):
        sim = mps.Simulation(scene, mps.Implicit(sleep=sleep))
        sim.run(until=0.5)
        before = np.ptp(sim.snapshot().x[:, 0])
        sim.run(until=0.8)
        reach.append(np.ptp(sim.snapshot().x[:, 0]) - before)
    assert reach[0] == pytest.approx(reach[1], rel=0.05) and reach[1] > L0


@pytest.mark.parametrize("d", [2, pytest.param(3, marks=pytest.mark.long)])
def test_a_jolt_gives_a_free_block_the_velocity_of_its_distance_from_the_hinge(d):
    """A hinged table that stops gives a body on it omega times the distance from the hinge, in one step and to the
    solver's tolerance, since a rigid turn strains nothing."""
    low, high = ((0.2, 0.0), (0.8, 0.3)) if d == 2 else ((0.2, -0.2, 0.0), (0.6, 0.2, 0.3))
    jolt = mps.Jolt(0.1, (0.0,) * (d - 1) + (-0.1,), 2.0, pivot=low, axis=None if d == 2 else (0.0, 1.0, 0.0))
    fluid = mps.fill(mps.Box(low, high), L0)
    domain = (-2.0,) * d, (2.0,) * d
    sim = mps.Simulation(block(fluid=fluid, domain=domain, gravity=(0.0,) * d, jolts=(jolt,)))
    x = sim.snapshot().x
    sim.run(until=0.1)
    assert np.array_equal(sim.snapshot().x, x)
    sim.step()
    s = sim.snapshot()
    expected = jolt.jump(x)
    arm = x - low
    up = {2: 2.0 * arm[:, 0], 3: -2.0 * arm[:, 0]}[d] - 0.1
    assert np.allclose(expected[:, -1], up, atol=1e-12) and np.allclose(s.u, expected, atol=1e-6)


@pytest.mark.parametrize(
    ("frame", "spacing", "numerics"),
    [
        pytest.param("gravity", L0, {"passes": 6}, marks=pytest.mark.long),
        pytest.param("floor", L0 / 2, {"passes": 24, "max_time_step": 1.0 / 384.0}, marks=pytest.mark.long),
    ],
)
def test_a_layer_on_a_shaken_floor_slides_where_its_inertia_exceeds_the_yield_stress(frame, spacing, numerics):
    """The lowest row of a layer of the height h yields where rho h a > tau_y, and no row does below that, within a
    twentieth; a is the peak acceleration of the floor, in whose frame it is a gravity.

    More would slide at 0.95. With few outer iterations a layer at rest oscillates as an elastic one of the modulus
    (iterations mu_r/step), whose period ten rows in short steps damp less than five. A sudden start leaves what the
    first step's iterations do not carry as a velocity, which the next steps must stop. And a floor has its mean
    velocity over each step, which changes by more than its acceleration from a long step to a short one: here steps are
    equal, and the last one, cut short by the end of the run, is left out.
    """
    turn, height, peak = 8.0 * np.pi, 0.5, 4.0  # [1/s], [m], [m/s2]
    rows = np.array(mps.vibration(turn / (2.0 * np.pi), peak / turn**2, (1.0, 0.0), end=0.5))
    given = {"gravity": tuple(map(tuple, rows))}
    assert np.abs(rows[:, 1]).max() == pytest.approx(peak)
    assert np.trapezoid(rows[:, 1], rows[:, 0]) == pytest.approx(0.0, abs=1e-12)
    if frame == "floor":
        shaken = [(time, peak / turn * (1.0 - np.cos(turn * time)), 0.0) for time in rows[1:-1, 0]]
        given = {"velocity": tuple(shaken)}
    floor = mps.Plane((0.0, 0.0), (0.0, 1.0), velocity=given.pop("velocity", None))
    given |= {"walls": (floor,), "periodic": (True, False), "domain": ((0.0, -1.0), (1.0, 1.0))}
    given |= {"spacing": spacing, "fluid": mps.fill(mps.Box((0.0, 0.0), (1.0, height)), spacing)}
    least = {}
    for ratio in (0.95, 1.05):
        material = mps.Bingham(yield_value=2300.0 * height * peak / ratio, plastic_viscosity=10.0)
        sim = mps.Simulation(block(material=material, **given), mps.Implicit(**numerics))
        unyielded = []
        sim.each_step(lambda sim, unyielded=unyielded: unyielded.append(sim.report.unyielded_fraction))
        sim.run(until=0.45)
        least[ratio] = min(unyielded[:-1])
    assert least[0.95] == 1.0 and least[1.05] < 1.0, least


def test_what_changes_between_rows_and_beyond_them():
    part = TimeDependent(JUMPS, "gravity", "m/s2", 2)
    assert part.integral(-1.0, 1.0) == pytest.approx((3.6 - 0.25, 0.4 + 0.1)) and part.last == 0.5
    assert [part.changes(t) for t in (0.0, 0.1, 0.2, 0.3, 0.4, 0.45, 0.5, 0.6)] == [0, 0, 1, 0, 1, 1, 1, 0]


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"gravity": ((0.0, 1.0), (1.0, 2.0))}, "gravity: rows of 2 numbers: must have a time"),
        ({"gravity": ((1.0, 0.0, 1.0), (0.0, 0.0, 2.0))}, "gravity = .* must have times .* that grow"),
        ({"gravity": JUMPS, "axisymmetric": True}, "must be along z, axisymmetric"),
        ({"gravity": JUMPS, "walls": (mps.Plane((-1.0, 0.0), (1.0, 0.0), mirror=True),)}, "must lie in the plane"),
    ],
)
def test_what_breaks_a_symmetry_or_is_no_table_is_refused(changed, told):
    with pytest.raises(mps.SceneError, match=told):
        block(**changed)


def test_a_checkpoint_knows_the_gravity_that_it_was_written_with(tmp_path, free):
    sim = free(JUMPS)
    sim.run(until=0.25)
    file = mps.checkpoint.Checkpoint.of(sim).write(tmp_path / "checkpoint.h5")
    other = replace(sim.scene, gravity=(*JUMPS[:-1], (0.5, 1.0, 0.0)))
    assert mps.checkpoint.digest(other, mps.checkpoint.laws(other)) != mps.checkpoint.read(file).header["problem"]
