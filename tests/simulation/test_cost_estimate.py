"""What a pour will cost: steps and particles beside integrals in closed form, and forecasts beside measured pours."""

import json
from pathlib import Path

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.problem import catalogue
from taichi_mps.problem.problem import Problem
from taichi_mps.simulation import cost_estimate
from taichi_mps.simulation.cost_estimate import LANDS, estimate_cost

MEASURED = json.loads((Path(__file__).resolve().parents[2] / "benchmarks/results/cubic_metre.json").read_text())
L0, SIDE, MOUTH, RATE, VOLUME, G = 0.02, 0.4, 2.0, 0.012, 0.192, 9.81
FULL = VOLUME / RATE  # [s]


def poured(**changes):
    """A hose over a box of 0.4 x 0.4 m that it fills to 1.2 m."""
    box = mps.box_planes((0.0, 0.0, 0.0), (SIDE, SIDE, MOUTH))
    return mps.Scene(
        name="box",
        material=mps.Bingham(yield_value=50.0, plastic_viscosity=1e5),  # so viscous that only the jet bounds a step
        spacing=L0,
        fluid=None,
        domain=((-L0, -L0, -L0), (SIDE + L0, SIDE + L0, MOUTH + 4 * L0)),
        walls=box,
        cavity=mps.Cavity((0.0, 0.0, 0.0), (SIDE, SIDE, MOUTH), box, L0),
        inlets=(mps.Inlet((0.2, 0.2, MOUTH), (0.0, 0.0, -1.0), 0.06, RATE, VOLUME),),
        **{"until": FULL} | changes,
    )


def test_steps_are_those_of_a_jet_that_falls_to_a_rising_level():
    """Integral of U/(C l0) dt with U^2 = LANDS^2 (a - b t); it falls to a heap as high as it is wide."""
    scene = poured()
    a = scene.inlets[0].speed(L0) ** 2 + 2.0 * G * (MOUTH - 2.0 * scene.inlets[0].radius)
    b = 2.0 * G * RATE / SIDE**2
    way = LANDS * 2.0 / (3.0 * b) * (a**1.5 - (a - b * FULL) ** 1.5)
    found = estimate_cost(Problem(scene, mps.Implicit(courant_number=0.1)))
    assert found.steps == pytest.approx(way / (0.1 * L0), rel=0.01)
    assert found.ends == FULL


def test_particles_grow_at_the_rate_and_cost_what_was_measured(monkeypatch):
    dt, after = 1e-5, 4.0
    monkeypatch.setattr(cost_estimate, "measured", lambda: (np.array([1.0, 1e6]), np.array([3e-6, 3.0])))  # 3 us each
    found = estimate_cost(Problem(poured(until=FULL + after), mps.Implicit(max_time_step=dt)))
    particles = VOLUME / L0**3
    assert found.steps == pytest.approx((FULL + after) / dt)
    assert found.particle_steps == pytest.approx((0.5 * particles * FULL + particles * after) / dt, rel=0.01)
    assert found.cpu_seconds == pytest.approx(3e-6 * found.particle_steps)


def test_between_measured_sizes_it_is_a_power_and_beyond_them_in_proportion():
    known = np.array([100.0, 10_000.0]), np.array([1e-3, 4e-2])
    told = cost_estimate.seconds_of_a_step(np.array([1.0, 100.0, 1000.0, 10_000.0, 50_000.0]), *known)
    assert told == pytest.approx([1e-3, 1e-3, (1e-3 * 4e-2) ** 0.5, 4e-2, 2e-1])


def test_of_what_is_not_poured_in_space_nothing_is_known():
    assert estimate_cost(Problem(catalogue.build("slump"))) is None


@pytest.mark.parametrize("name", MEASURED)
def test_forecasts_are_within_thirty_percent_of_measured_pours(name):
    """Those that stand beside the measurements; the next test makes one of them again."""
    row = MEASURED[name]
    told = row["forecast"]
    assert row["simulated_s"] == pytest.approx(told["ends_s"])
    assert told["steps"] == pytest.approx(row["steps"], rel=0.3)
    assert told["cpu_s"] == pytest.approx(row["cpu_s"], rel=0.3)
    assert told["bytes"] == pytest.approx(row["peak_bytes"], rel=0.3)


def test_the_forecast_beside_a_measurement_is_that_of_today():
    row = MEASURED["small_32"]
    found = estimate_cost(Problem(catalogue.build("wall", **row["case"])))
    assert found.steps == pytest.approx(row["forecast"]["steps"], rel=1e-6)
    assert found.cpu_seconds == pytest.approx(row["forecast"]["cpu_s"], rel=1e-6)
