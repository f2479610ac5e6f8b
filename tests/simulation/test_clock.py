"""Clock of a run: the remaining time is never negative, accurate from a tenth of the run on, and more so on a known
machine."""

from types import SimpleNamespace

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.problem import catalogue
from taichi_mps.problem.problem import Problem
from taichi_mps.simulation import clock
from taichi_mps.simulation.clock import MIN_STEPS, PARTS, READY, Clock, steps_left
from taichi_mps.simulation.forecast import cost_of
from taichi_mps.simulation.rest import Rest
from taichi_mps.simulation.reuse import begin

SETTINGS = {"arch": "cpu", "precision": "f32", "threads": 1}
MIXES = (
    (50, 20),
    (100, 10),
    (100, 50),
    (100, 300),
    (300, 20),
    (300, 50),
    (500, 50),
    (500, 300),
    (1000, 50),
    (1500, 50),
)
SETTING_UP, STEP = 3.5, 0.006  # [s] of a warm run of rings without its flow, of a step with its row of history.csv


@pytest.fixture
def known(monkeypatch, tmp_path):
    monkeypatch.setattr(clock, "kernels", lambda language: tmp_path)
    return tmp_path / clock.RATIOS


@pytest.mark.slow
def test_nine_runs_in_ten_are_told_within_thirty_percent_from_a_tenth_on():
    """From a tenth of a run on nine forecasts in ten are within 30 %, where each step, and the rest of the run, is
    taken to last equally long, so that only the number of steps is forecast."""
    mps.init(threads=1)
    worst = []
    for yield_value, viscosity in MIXES:
        scene = catalogue.build(
            "slump", model="axisymmetric", spacing=0.01, yield_value=yield_value, plastic_viscosity=viscosity
        )
        sim, cost, told = begin(scene), cost_of(Problem(scene)), []
        sim.each_step(lambda sim, cost=cost, told=told: told.append(sim.steps + steps_left(sim, cost)))
        sim.run()
        first, whole = SETTING_UP + cost.steps * STEP, SETTING_UP + sim.steps * STEP
        assert 0.5 < first / whole < 2.0, "before the run"
        told = SETTING_UP + STEP * np.array(told[sim.steps // 10 :])
        assert np.all(told >= SETTING_UP + STEP * np.arange(sim.steps // 10 + 1, sim.steps + 1)), "never negative"
        worst.append(np.abs(told / whole - 1.0).max())
    assert np.sum(np.array(worst) < 0.3) >= 0.9 * len(MIXES), worst


def test_a_machine_that_is_known_is_told_exactly(known, monkeypatch):
    """For a run twice as slow as usual the first forecast is off by two, and the next one exact and warm."""
    problem, now = Problem(catalogue.build("slump", model="axisymmetric", spacing=0.05)), [100.0]
    monkeypatch.setattr(clock.time, "monotonic", lambda: now[0])
    sim = SimpleNamespace(steps=0, time=0.0, rest=Rest(), scene=problem.scene, problem=problem, pouring=())
    sim.report = SimpleNamespace(dt=0.01)
    first = Clock(problem, SETTINGS, 0.05, begun=100.0)
    assert first.cold and first.whole == sum(first.usual.values())
    steps, shown = round(first.cost.steps), []
    for part in PARTS:
        first.begin(part, sim.steps)
        for _ in range(steps):
            now[0] += 2.0 * first.usual[part] / steps
            sim.steps += part == "flow"
            shown.append(first.now(sim))
    assert len(shown) == 5 * steps and all(line is None or line["left_s"] >= 0.0 for line in shown)
    shares = [line["share"] for line in shown if line]
    assert 0.0 < shares[0] < 0.1 and shares[-1] > 0.9 and max(shares) <= 1.0
    first.finish(MIN_STEPS - 1)
    assert not known.exists(), "a run of a few steps tells nothing about the next"
    told = first.finish(sim.steps)
    assert told["all_wall_seconds"] == pytest.approx(2.0 * first.whole) == sum(told["seconds_by_part"].values())
    again = Clock(problem, SETTINGS, 0.05)
    ready = 2.0 * READY[False]  # compiled by now
    assert not again.cold and again.whole == pytest.approx(2.0 * first.whole - 2.0 * first.usual["ready"] + ready)
    known.write_text("[1, 2")
    assert Clock(problem, SETTINGS, 0.05).whole == first.whole, "a damaged file is as none"
