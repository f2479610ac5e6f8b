"""The rest rule (I15) on motions whose remaining displacement is known."""

from dataclasses import asdict
from types import SimpleNamespace

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.engine.problem.problem import Problem
from taichi_mps.engine.problem.time_step import Speeds
from taichi_mps.engine.simulation.rest import NEGLIGIBLE_PATH, PAUSE, Rest
from tests.support.scenes import parts, ran

SPACING = 0.01


def stop(speed, material, fraction=1.0, again=None, until=1000.0):
    """Time [s] at which the rule calls a body at rest of which a ``fraction`` moves with speed(t) [m/s], and the way
    [m] that it then takes to be left, at most; again: a time [s] at which the rule is written down and read again."""
    rest, dt = Rest(), 0.01
    problem = Problem(mps.Scene(**parts(material=material, spacing=SPACING, walls=())))
    for time in np.arange(dt, until, dt):
        report = SimpleNamespace(mean_speed=np.sqrt(fraction) * speed(time), moving_speed=speed(time))
        rest.observe(report.moving_speed, time)
        if rest.reached(SimpleNamespace(report=report, problem=problem, scene=problem.scene, time=time)):
            return time, NEGLIGIBLE_PATH * problem.height
        if again is not None and time > again:
            rest, again = Rest(**asdict(rest)), None
    return None


@pytest.mark.parametrize("natural", [0.2, 3.0, 40.0])
def test_of_a_flow_that_ceases_exponentially_no_more_is_left_than_the_bound(natural):
    """Of exp(-t/T) the displacement left, speed times T, is at most the bound, also in sqrt(H/g); the rule looks once
    in an e-fold, so at least a third of the bound is left in slow flows."""
    ends, bound = stop(lambda t: 0.2 * np.exp(-t / natural), mps.Bingham())
    left = 0.2 * np.exp(-ends / natural) * natural
    assert left < bound and (left > bound / 3.0 or natural < 1.0)


def test_of_a_layer_that_slows_down_as_one_over_the_square_of_time_at_most_thrice_the_bound_is_left():
    """After a fast start a layer with the speed c/t^2, of which c/t is left, stops between one and three times the
    bound; an e-fold takes 0.39 t."""
    c, material = 0.01, mps.Bingham()
    ends, bound = stop(lambda t: c / (0.1 + t) ** 2, material)
    assert bound < c / (0.1 + ends) < 3.0 * bound
    assert stop(lambda t: c / (0.1 + t) ** 2, material, again=2.0)[0] == ends


def test_drops_that_fall_meanwhile_do_not_end_a_slow_flow():
    """Drops of 0.5 m/s, for a fortieth of a second at 4, 5 and 10 s, leave the time of rest of a decay of 5 s as it is;
    a checkpoint of the drop's flight, too."""

    def decay(t):
        return 0.02 * np.exp(-t / 5.0)

    def drops(t):
        return 0.5 if any(fall <= t < fall + 0.025 for fall in (4.0, 5.0, 10.0)) else decay(t)

    alone, _ = stop(decay, mps.Bingham())
    assert alone > 10.0
    assert stop(drops, mps.Bingham())[0] == alone == stop(drops, mps.Bingham(), again=10.0)[0]


@pytest.mark.parametrize(
    ("speed", "material"),
    [
        (lambda t: 0.01, mps.Bingham()),
        (lambda t: 0.01 * min(1.0, t), mps.Bingham()),  # begins slowly
        (lambda t: 0.01 if t < 1.0 or t > 1.05 else 0.0, mps.Bingham()),  # starts again
        (lambda t: 0.0, mps.Newtonian()),  # without a true yield stress
        (lambda t: 0.0, mps.Bingham(critical_strain_rate=0.1)),
    ],
)
def test_what_goes_on_or_has_no_true_yield_stress_is_never_at_rest(speed, material):
    assert stop(speed, material, until=20.0) is None


def test_a_front_before_a_large_body_that_stands_is_not_at_rest():
    """A thousandth of the body at 10 mm/s, 0.3 mm/s in the mean, is not at rest."""
    material = mps.Bingham()
    assert stop(lambda t: 0.01, material, fraction=0.001, until=20.0) is None
    ends, _ = stop(lambda t: 0.01 if t < 2.0 else 0.0, material, fraction=0.001)
    assert 2.0 < ends < 2.4


@pytest.mark.parametrize(
    "written", [{"since": "now"}, {"speed": None}, {"at": [0.0]}, {"before": ["0"]}, {"rest": 0.0}]
)
def test_what_a_checkpoint_should_not_hold_is_refused(written):
    with pytest.raises((mps.SceneError, TypeError)):
        Rest(**written)


def test_what_a_travelling_wall_touches_is_not_at_rest():
    """Particles 5 mm above a floor that sinks by 0.1 m/s are at rest only 0.16 s later, when they are 21 mm away from
    it."""
    rest, floor = Rest(), mps.Plane((0.0, 0.0), (0.0, 1.0), velocity=(0.0, -0.1))
    problem = Problem(mps.Scene(**parts(spacing=SPACING, walls=(floor,))))
    particles = SimpleNamespace(read=lambda: {"x": np.array([[0.0, 0.005], [0.0, 0.015]])})
    still, walls = SimpleNamespace(mean_speed=0.0, moving_speed=0.0), SimpleNamespace(effective_radius=0.021)

    def reached(time):
        what = {"problem": problem, "scene": problem.scene, "particles": particles, "walls": walls}
        return rest.reached(SimpleNamespace(report=still, time=time, **what))

    pause = PAUSE * problem.fall_time
    assert next(time for time in np.arange(0.0, 1.0, 0.01) if reached(time)) == pytest.approx(0.16 + pause, abs=0.02)


@pytest.mark.parametrize("limit", [3.0, 30.0, 300.0, np.inf])
def test_at_rest_a_structure_grows_within_a_hundredth_in_few_steps(limit):
    """d lambda/dt = 1 - lambda/T at one rate a step, by the steps that a body at rest takes, beside T (1 - exp(-t/T)),
    or t."""
    rule = Problem(mps.Scene(**parts(spacing=SPACING))).time_step
    time = structure = steps = 0
    while time < 900.0:
        dt = rule.longest_at(Speeds(0.0, 0.0, at_rest=time))
        time, structure, steps = time + dt, structure + dt * (1.0 - structure / limit), steps + 1
        exact = time if limit == np.inf else -limit * np.expm1(-time / limit)
        assert structure == pytest.approx(exact, rel=0.01)
    assert steps < 300
    assert rule.longest_at(Speeds(1e-4, 0.0, at_rest=time)) * 1e-4 <= 0.005 * SPACING, "what still moves is not far"


@pytest.mark.parametrize(
    ("spacing", "passes"),
    [(0.02, 6), *(pytest.param(*given, marks=pytest.mark.long) for given in ((0.02, 24), (0.01, 6)))],
    ids=str,
)
def test_a_cone_that_stands_is_quiet(spacing, passes):
    """From 3 to 4 s 99.9 % of the rings move slower than 1e-3 sqrt(g l0), and all slower than three times that."""
    sim = mps.Simulation(mps.slump_cone(model="axisymmetric", spacing=spacing), mps.Implicit(passes=passes))
    start, slow = sim.state(), 1e-3 * (9.81 * spacing) ** 0.5
    for tau_y in (500.0, 1000.0):
        scene = mps.slump_cone(model="axisymmetric", spacing=spacing, yield_value=tau_y)
        sim.restart(Problem(scene, sim.numerics), start)
        speeds = []
        while sim.time < 4.0:
            sim.step()
            if sim.time > 3.0:
                speeds.append(sim.snapshot().speed)
        assert np.quantile(speeds, 0.999, axis=1).max() < slow and np.max(speeds) < 3.0 * slow


@pytest.mark.slow
def test_a_body_that_is_set_aside_as_a_whole_comes_to_rest():
    """A body that is left out as a whole comes to rest: its zero speed between steps of all particles does not count as
    the start of another motion."""
    scene = mps.slump_cone(model="quarter", spacing=0.0125, yield_value=1500.0, until=1.0)
    sim, left_out = mps.Simulation(scene, mps.Implicit(sleep="on")), []
    sim.each_step(lambda s: left_out.append(s.scheme.active_set.left_out))
    assert sim.run() == "rest" and max(left_out) == sim.fluid_particles


@pytest.mark.parametrize(
    "exponent",
    [pytest.param(1.0, id="Bingham"), pytest.param(0.5, id="Herschel-Bulkley", marks=pytest.mark.long)],
)
def test_repacking_takes_no_more_power_than_viscosity_dissipates(exponent):
    """After 0.4 s at 300 Pa and 50 Pa s^n the wanted divergence s meets its bound, tau_y |s| = (tau - tau_y) rate,
    where the packing asks for more."""
    law = {"yield_value": 300.0} | ({} if exponent == 1.0 else {"consistency": 50.0, "flow_index": exponent})
    sim = ran(mps.slump_cone(model="axisymmetric", spacing=0.02, **law), until=0.4)
    sim.scheme.strain_rate.half_step_change.fill(0.0)  # without what a step turns (I32)
    sim.scheme.constraint.set(sim.report.dt)
    count = len(sim.snapshot().x)
    s, rate = (f.to_numpy()[:count] for f in (sim.scheme.constraint.divergence, sim.particles.shear_rate))
    most, rounding = rate * 50.0 * rate**exponent / 300.0, 3e-7 * rate  # of tau in single precision
    assert np.all(np.abs(s) <= most + rounding) and (np.abs(np.abs(s) - most) <= rounding).sum() > 5
