"""Checks that a run makes of itself: error of the volume, results that are no number, the edge of the domain."""

import math
import warnings
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import taichi_mps as mps
from tests.support.scenes import hose, parts, ran


@pytest.fixture(scope="module", autouse=True)
def taichi():
    mps.init(arch="cpu")


@pytest.fixture(scope="module")
def block():
    """A simulation of 25 particles on a floor, and its state at the start."""
    sim = mps.Simulation(mps.Scene(**parts(until=0.05, measure=mps.measure.front)))
    return sim, sim.state()


def begun(block, **changes):
    """The block at its start, in a scene that is changed by this."""
    sim, start = block
    changes = {"measure": mps.measure.front} | changes
    sim.restart(replace(sim.problem, scene=replace(sim.scene, **changes)), start)
    return sim


# ---- volume ----------------------------------------------------------------------------------------------------
@pytest.mark.slow
def test_the_largest_volume_error_is_reported_and_goes_on_where_a_run_is_resumed(block):
    sim, errors = begun(block), []
    sim.each_step(lambda sim: errors.append(abs(sim.report.volume_error)))
    sim.run(until=0.03)
    assert sim.report.volume_error_max == sim.summary()["volume_error_max"] == max(errors) > 0.0
    kept = sim.state()
    begun(block).load(kept)
    sim.run(until=0.05)
    assert sim.report.volume_error_max >= kept["report"]["volume_error_max"] == max(errors[:-1])


@pytest.mark.filterwarnings("error::UserWarning")
def test_a_volume_that_was_not_kept_on_the_way_is_a_warning_with_a_remedy(block):
    sim = begun(block)
    sim.run(until=0.01)
    sim.step()
    sim.report = replace(sim.report, volume_error_max=0.36)
    with pytest.warns(UserWarning, match="volume_error_max = 36.0%: .* not kept within 2% .* a smaller spacing"):
        sim.run(until=0.02)


# ---- rest ------------------------------------------------------------------------------------------------------
def test_every_step_counts_for_the_rule_of_rest_also_one_that_ends_a_run(block, monkeypatch):
    """The rest rule sees every step, also the last of a run, since otherwise a resumed run would come to rest at
    another step."""
    sim, counted = begun(block, stop_at_rest=True), []
    monkeypatch.setattr(sim.rest, "reached", lambda s: counted.append(s.steps))
    sim.run(until=0.02)
    assert sim.stopped_by == "time" and sorted(set(counted)) == list(range(1, sim.steps + 1))
    sim.each_step(lambda sim: sim.interrupt())
    sim.run(until=1.0)
    assert sim.stopped_by == "interrupted" and counted[-1] == sim.steps


# ---- measures --------------------------------------------------------------------------------------------------
def broken_at_times(snapshot):
    if 0.0 < snapshot.time < 0.02:
        raise ZeroDivisionError(f"at {snapshot.time}")
    return {"good_m": 1.0, "later_m": "far" if snapshot.time < 0.02 else 2.0}


def test_a_measure_that_raises_or_gives_no_number_names_itself_once_and_costs_nothing(block):
    sim = begun(block, measure=broken_at_times)
    found = []
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        sim.each_step(lambda sim: found.append(sim.measures()))
        first = sim.measures()
        assert sim.run(until=0.05) == "time"
    assert first == {"good_m": 1.0} and found[0] == {} and found[-1] == {"good_m": 1.0, "later_m": 2.0}
    assert {key: sim.summary()[key] for key in found[-1]} == found[-1]
    lines = [str(warning.message) for warning in told if warning.category is UserWarning]
    assert len(lines) == 2 and lines[0].startswith("measure = broken_at_times: later_m = far is no number; left out")
    assert lines[1].startswith("measure = broken_at_times: ZeroDivisionError: at ")


@pytest.mark.parametrize("given", [None, 3.0, {"a_m": None}, {"a_m": [1.0]}, {"a_m": 1j}, {"a_m": "1.0"}])
def test_what_is_no_number_is_left_out(given):
    scene = mps.Scene(**parts(measure=lambda s: given, over_time=lambda h: {"t_s": h["time_s"]}))
    with pytest.warns(UserWarning, match="measure = <lambda>: .*; left out, the run goes on"):
        assert scene.measure(None) == {}
    with pytest.warns(UserWarning, match="over_time = <lambda>: KeyError: 'time_s'; left out"):
        assert scene.over_time({}) == {}


def test_a_slump_that_is_no_number_is_an_error_and_no_field_of_the_summary(block):
    sim = begun(block, measure=lambda s: {"slump_m": math.nan, "spread_m": 0.7})
    sim.each_step(lambda sim: None)  # whom nobody watches nothing is measured of
    with pytest.raises(mps.UnmeasuredError, match="^slump_m at t = 0.05 s, step [0-9]+, is no number: ") as error:
        sim.run()
    assert isinstance(error.value, mps.DivergedError) and error.value.stopped_by == sim.stopped_by == "time"
    assert "slump_m" not in sim.summary() and sim.summary()["spread_m"] == 0.7


# ---- the edge --------------------------------------------------------------------------------------------------
@pytest.mark.slow
def test_who_reaches_the_edge_of_the_domain_is_told_which_and_what_enlarges_it():
    given = parts(walls=(), gravity=(0.0, -1.0), enlarged_by="room", parameters={"room": 2.0})
    sim = mps.Simulation(mps.Scene(**given, velocity=np.tile((0.0, 9.0), (25, 1))))
    start = sim.state()
    for velocity, crossed in (
        ((3.0, 0.0), "x = 2 m, its upper end"),
        ((-3.0, 0.0), "x = -1 m, its lower end"),
        ((0.0, 9.0), "z = 2 m, its upper end"),
    ):
        sim.restart(sim.problem, start | {"u": np.tile(velocity, (25, 1))})
        with pytest.raises(mps.DomainError, match=f"beyond {crossed}, at up to .* m/s; enlarge room$") as error:
            sim.run(until=5.0)
        assert str(error.value).startswith(f"edge of the domain at t = {sim.time:.6g} s, step {sim.steps}: ")
        assert sim.stopped_by == sim.summary()["stopped_by"] == "edge of the domain"
        speed, way = max(map(abs, velocity)), 1.0 if velocity[0] < 0.0 else 1.5
        assert sim.time * speed == pytest.approx(way, abs=0.1 * speed)


@pytest.mark.long
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(("viscosity", "reaches"), [(1.0, 0.5), (0.1, 0.6)])
def test_a_thin_mix_stays_on_the_floor_of_the_slump_test(viscosity, reaches):
    """A mix of 1 Pa and 0.1 Pa s spreads to 1 m without leaving the domain, whose default ends at 0.555 m."""
    given = dict(yield_value=1.0, plastic_viscosity=viscosity, spacing=0.02, model="axisymmetric")
    # nothing is left at the axis
    sim = ran(replace(mps.catalogue.build("slump", **given), measure=None), until=1.0)
    assert reaches < sim.snapshot().x[:, 0].max() < sim.scene.domain[1][0]


def test_of_what_falls_moves_and_is_poured_the_speeds_together_bound_a_run():
    """Beyond ten times the sum of the speeds of falling, moving and pouring a run has diverged, and particles that
    leave the domain faster are an instability."""
    floor = replace(parts()["walls"][0], velocity=(2.0, 0.0))
    scene = mps.Scene(**parts(walls=(floor,), velocity=np.tile((0.0, -3.0), (25, 1)), inlets=(hose(),)))
    fall = math.sqrt(2.0 * 9.81 * 3.0 * math.sqrt(2.0))  # through the diagonal of the domain
    assert mps.Simulation(scene).problem.expected_speed == pytest.approx(
        fall + 2.0 + 3.0 + hose().speed(0.1), rel=1e-12
    )


@pytest.mark.long
def test_plates_that_close_push_the_fluid_out_as_fast_as_continuity_asks():
    """Plates 22 times as long as wide that close at 0.01 m/s push the fluid out at 0.11 m/s in the mean, within a
    tenth, which does not count as a divergence."""
    speed, spacing, half, gap = 0.01, 0.0025, 0.22, 0.02
    plates = [mps.Plane((0.0, y), (0.0, n), velocity=(0.0, n * 0.5 * speed)) for y, n in ((0.0, 1.0), (gap, -1.0))]
    fluid = mps.lattice((-half, 0.0), (half, gap), spacing)
    material = mps.Newtonian(density=1000.0, viscosity=10.0)
    domain = (-2.0 * half, -gap), (2.0 * half, 2.0 * gap)
    sim = mps.Simulation(mps.Scene("squeeze", material, spacing, fluid, domain, plates, gravity=(0.0, 0.0)))
    while sim.time < 0.02:
        sim.step()
    s, place = sim.snapshot(), 0.75 * half
    out = s.u[np.abs(s.x[:, 0] - place) < 5 * spacing, 0].mean()
    assert out == pytest.approx(speed * place / gap, rel=0.1)
    assert sim.report.max_speed > 10.0 * speed


# ---- time ------------------------------------------------------------------------------------------------------
LATER = "must be later than the present time, 0 s, by 1e-09 s"


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda sim: sim.step(until=0.0), f"until = 0.0 s: {LATER}"),
        (lambda sim: sim.step(until=1e-300), f"until = 1e-300 s: {LATER}"),
        (lambda sim: sim.step(until=1e-12), f"until = 1e-12 s: {LATER}"),
        (lambda sim: sim.step(until=math.nan), "until = nan s: must be a finite number"),
        (lambda sim: sim.run(until=math.nan), "until = nan s: must be a finite number"),
        (lambda sim: sim.every(1e-300, print), "interval = 1e-300 s: must be at least 1e-09 s"),
        (lambda sim: sim.every(None, print), "interval = None s: must be a"),
    ],
)
def test_a_time_that_is_none_or_not_to_come_is_refused(block, call, message):
    with pytest.raises(mps.SceneError, match=message):
        call(begun(block))


def test_a_step_of_an_instant_is_taken_and_a_run_of_less_is_over(block):
    sim = begun(block)
    assert sim.step(until=1e-9).dt == 1e-9 and 0.0 < sim.report.max_speed < 1e-7
    assert sim.run(until=1e-12) == "time" and sim.steps == 1


def test_a_step_ends_where_a_hose_opens(block, monkeypatch):
    """A step ends when a hose opens, since a long step of a stiff mix would carry the first layer far in front of the
    mouth."""
    sim, ends = begun(block), []
    hoses = [SimpleNamespace(entered=0, delay=0.0, next=opens, pour=lambda *_: 0.0) for opens in (0.0123, 0.0345)]
    monkeypatch.setattr(sim, "pouring", hoses)
    sim.each_step(lambda sim: ends.append(sim.time))
    sim.run(until=0.05)
    assert {0.0123, 0.0345} <= {round(end, 12) for end in ends}
