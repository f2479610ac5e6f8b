"""Outputs and time limits do not change a run: it has the same bits whatever is read and when, and wherever it was
stopped; frames between two steps are interpolated; a resumed run has the same steps and frames."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.engine import Frame, Problem, frame_between
from taichi_mps.io.history import read_history
from taichi_mps.io.recorder import Recorder
from taichi_mps.io.run_folder import RunFolder
from taichi_mps.io.vtkhdf import Trajectory

RINGS = {"model": "axisymmetric", "spacing": 0.02, "yield_value": 500.0}


def bits(sim) -> bytes:
    """All that particles carry."""
    return b"".join(np.ascontiguousarray(rows).tobytes() for _, rows in sorted(sim.particles.read().items()))


def with_outputs(sim, start, every) -> tuple:
    """From a state to the end, with outputs every so many seconds: time, steps, reason of the end, bits, frames."""
    frames = []
    if sim.problem.scheme == "implicit":
        sim.restart(sim.problem, start)
    else:  # has no restart
        sim = mps.Simulation(sim.problem)
    if every:
        sim.every(every, frames.append)
    return whole(sim), frames


def whole(sim) -> tuple:
    """Run to the end: time, steps, reason of the end, bits."""
    stopped_by = sim.run()
    return sim.time, sim.steps, stopped_by, bits(sim)


# ---- the same bits ---------------------------------------------------------------------------------------------
RUNS = pytest.mark.parametrize(
    ("scene", "keywords", "numerics", "until"),
    [
        pytest.param("film", {"spacing": 0.01}, None, 0.3, marks=pytest.mark.long),
        ("slump", RINGS, None, 5.0),
        pytest.param(
            "slump", {"model": "quarter", "spacing": 0.025, "yield_value": 500.0}, None, 5.0, marks=pytest.mark.long
        ),
        pytest.param(
            "slump", {"model": "quarter", "spacing": 0.025}, mps.Implicit(sleep="on"), 5.0, marks=pytest.mark.long
        ),
        pytest.param("slump", {"spacing": 0.03}, mps.SemiImplicit(), 0.2, marks=pytest.mark.long),
    ],
    ids=["film", "rings", "quarter", "sleeping", "semi-implicit"],
)


@RUNS
def test_a_run_does_not_know_its_outputs(scene, keywords, numerics, until):
    """End time, steps and every bit are equal without outputs and with outputs of any interval."""
    sim = mps.Simulation(mps.catalogue.build(scene, until=until, **keywords), numerics)
    start = sim.state()
    alone, _ = with_outputs(sim, start, None)
    assert alone[2] == ("rest" if until == 5.0 else "time")
    for every in (0.0073, 0.05, 1.0):
        found, frames = with_outputs(sim, start, every)
        assert found == alone, every
        times = np.array([frame.time for frame in frames])
        assert times[0] == 0.0 and times[-1] == alone[0] and np.all(np.diff(times) > 0.0)
        np.testing.assert_allclose(times[:-1] / every, np.round(times[:-1] / every), atol=1e-9)
    if sim.problem.scheme == "implicit":  # a limit that no step reaches switches nothing
        sim.restart(Problem(sim.scene, sim.numerics.model_copy(update={"max_time_step": 10.0})), start)
        assert with_outputs(sim, start, None)[0] == alone


@pytest.mark.slow
@RUNS
def test_a_run_does_not_know_its_limits(scene, keywords, numerics, until):
    """A limit that lies between two steps tells what lies on the line between them, and the run goes on as if there had
    been none: to limits in the same step, at the end of a step, and before the first."""
    sim = mps.Simulation(mps.catalogue.build(scene, until=until, **keywords), numerics)
    start, steps = sim.state(), [(0.0, sim.snapshot().x)]
    sim.each_step(lambda sim: steps.append((sim.time, sim.snapshot().x)) if sim.all_active else None)
    alone, ends = whole(sim), steps[:-1]
    sim.load(start)
    times = [time for time, _ in ends]
    for limit in np.interp([0.3, 3.5, 3.9, 9.0, len(times) - 1.3], range(len(times)), times).tolist():
        assert sim.run(limit) == "time" and sim.time == limit
        k = int(np.searchsorted(times, limit))
        (earlier, first), (later, x) = ends[k - 1 : k + 1]
        np.testing.assert_allclose(
            sim.snapshot().x, first + (limit - earlier) / (later - earlier) * (x - first), rtol=0.0, atol=1e-12
        )
    assert whole(sim) == alone


# ---- frames ----------------------------------------------------------------------------------------------------
def frame(time, x, u, **of_scene):
    """A frame of points in a domain from 0 to 1 m."""
    scene = SimpleNamespace(domain=((0.0, 0.0), (1.0, 1.0)), periodic=(False, False), **of_scene)
    state = replace(mps.measure.still(x, 0.01), time=time, u=np.asarray(u, float))
    return Frame(scene, state)


def test_a_frame_between_two_steps_lies_on_the_line_between_them():
    first = frame(1.0, [[0.2, 0.5], [0.4, 0.1]], [[1.0, 0.0], [0.0, 0.0]])
    last = frame(3.0, [[0.6, 0.5], [0.4, 0.3]], [[3.0, 0.0], [0.0, 1.0]])
    found = frame_between(first, last, 1.5)
    assert found.time == 1.5
    np.testing.assert_allclose(found.snapshot().x, [[0.3, 0.5], [0.4, 0.15]])
    np.testing.assert_allclose(found.snapshot().u, [[1.5, 0.0], [0.0, 0.25]])


def test_what_came_in_since_moves_at_its_own_velocity():
    first, last = (
        frame(0.0, [[0.2, 0.5]], [[0.0, 0.0]]),
        frame(0.1, [[0.2, 0.5], [0.3, 0.9]], [[0.0, 0.0], [0.0, -1.0]]),
    )
    np.testing.assert_allclose(frame_between(first, last, 0.04).snapshot().x, [[0.2, 0.5], [0.3, 0.96]])


def test_who_leaves_a_periodic_domain_at_one_end_does_not_cross_it_in_a_frame():
    first, last = frame(0.0, [[0.98, 0.5]], [[1.0, 0.0]]), frame(0.1, [[0.08, 0.5]], [[1.0, 0.0]])
    last.scene.periodic = (True, False)
    assert frame_between(first, last, 0.05).snapshot().x[0, 0] % 1.0 == pytest.approx(0.03)


# ---- resume ----------------------------------------------------------------------------------------------------
def recorded(folder, sim):
    """Run to the end, with a folder of outputs every 15 ms."""
    recorder = Recorder(folder, sim, 0.015, "slump", {"every": 0.015})
    recorder.next_checkpoint = float("inf")
    stopped_by = sim.run()
    recorder.finish(stopped_by)
    return stopped_by


@pytest.mark.slow
def test_a_run_that_several_limits_stopped_has_the_files_of_one_without(tmp_path):
    """Limits before the first step, between outputs, and in the same step."""
    sim = mps.Simulation(mps.catalogue.build("slump", until=0.12, **RINGS))
    problem, state, (one, parts) = sim.problem, sim.state(), folders(tmp_path)
    assert recorded(one, sim) == "time"
    for limit in (1e-6, 0.052, 0.0521, 0.12):
        sim.restart(replace(problem, scene=replace(problem.scene, until=limit)), state)
        assert recorded(parts, sim) == "time"
        found = mps.checkpoint.read(parts.checkpoint)
        assert found.header["time"] == parts.read_summary()["simulated_seconds"] == limit > found.state["time"]
        assert read_history(parts.history)["time_s"][-1] == Trajectory(parts.trajectory).times()[-1] == limit
        state = found.state
    for strange in (7, 1):  # unknown; walls alone
        with pytest.raises(mps.SceneError, match="checkpoint: kind: must be 0 of fluid, 1 or 2 of walls"):
            replace(found, state=state | {"kind": np.full_like(state["kind"], strange)}).resume(problem)
    require_equal(one, parts, problem.scene)


def folders(path) -> tuple:
    """Two folders for runs."""
    found = RunFolder(path / "one"), RunFolder(path / "parts")
    for folder in found:
        folder.create(False)
    return found


def require_equal(one, parts, scene):
    """Require the same history and the same outputs of two runs from the first step on: before it the particles of a
    Simulation that is used again are still marked as they last flowed."""
    outputs = [list(Trajectory(folder.trajectory).replay(scene=scene)) for folder in (one, parts)]
    assert [frame.time for frame in outputs[0]] == [frame.time for frame in outputs[1]]
    for frame, other in zip(*(frames[1:] for frames in outputs), strict=True):
        for name in ("x", "u", "p", "shear_rate", "yielded", "density_ratio"):
            np.testing.assert_array_equal(getattr(frame.state, name), getattr(other.state, name), err_msg=name)
    histories = [read_history(folder.history) for folder in (one, parts)]
    np.testing.assert_equal(*({key: values[1:] for key, values in history.items()} for history in histories))
