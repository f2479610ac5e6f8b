"""The default scheme against exact solutions: free fall, films on an incline, flow between walls.

Errors are relative L2 norms of what started from rest; their bounds are the targets of the validation table: 2 % at 20
across, plug speeds within 5 % just above the yield value, 1e-6 m/s where a film must stand.
"""

import csv
import runpy
from pathlib import Path

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.problem import catalogue
from taichi_mps.study.reuse import begin
from taichi_mps.validation import flows
from taichi_mps.validation.scheme import simulate

REFERENCE = Path(__file__).parents[1] / "reference" / "B_poiseuille_bingham_biviscosity.csv"
DENSITY, DEPTH = 2300.0, 0.1
WEIGHT = DENSITY * 9.81 * np.sin(np.radians(10.0))  # of the film along its slope [N/m3]
L0, START = 0.02, np.array([0.3, -0.2, 1.0])


# ---- free fall ------------------------------------------------------------------------------------------------
def groups(d):
    """Sets of 1, 2, 3 particles, a line, and in 3-D a plane, far from each other."""
    line = L0 * np.arange(5.0)[:, None] * np.eye(d)[0]
    sets = [line[:1], line[:2], np.vstack([line[:2], L0 * np.eye(d)[1]]), line]
    if d == 3:
        a, b = np.meshgrid(np.arange(4.0), np.arange(4.0))
        sets.append(L0 * (a.ravel()[:, None] * np.eye(3)[0] + b.ravel()[:, None] * np.eye(3)[2]))
    return np.vstack([x + 0.4 * k * np.eye(d)[0] for k, x in enumerate(sets)])


@pytest.mark.parametrize("d", [2, 3], ids=["2-D Bingham", "3-D Newtonian"])
def test_free_fall_is_exact(d):
    """x = u0 t + g t^2/2 and u = u0 + g t to rounding, whatever the steps and whether or not the set carries stress,
    which a fluid with a yield stress alone does; the acceleration is g."""
    x, g, t = groups(d), np.array([0.0] * (d - 1) + [-9.81]), 0.2
    scene = mps.Scene(
        name="fall",
        material=mps.Newtonian(viscosity=50.0) if d == 3 else mps.Bingham(),
        spacing=L0,
        fluid=x,
        velocity=np.tile(START[:d], (len(x), 1)),
        domain=((-1.0,) * d, (3.0,) * d),
    )
    sim = mps.Simulation(scene, mps.Implicit(tolerance=1e-12))
    sim.run(until=t)
    s = sim.snapshot()
    assert s.time == pytest.approx(t, rel=1e-12) and sim.steps > 10
    assert np.abs(s.u - START[:d] - g * t).max() < 1e-9
    assert np.abs(s.x - x - START[:d] * t - 0.5 * g * t**2).max() < 1e-9
    assert sim.report.acceleration == pytest.approx(9.81, rel=1e-9)
    yields = scene.material.yield_value > 0.0
    assert [name in sim.particles.carried for name in ("stress", "plastic_rate")] == [yields, yields]


# ---- films ----------------------------------------------------------------------------------------------------
def test_closed_forms_agree_with_the_reference_table():
    lines = [line for line in REFERENCE.read_text(encoding="utf-8").splitlines() if line[0] != "#"]
    film_velocity = runpy.run_path(str(catalogue.names()["film"]))["film_velocity"]
    for row in csv.DictReader(lines):
        eta, tau_y, knee_rate, weight, y, bingham, bi_viscosity = (float(v) for v in list(row.values())[:7])
        height = np.array(0.05 - abs(y))  # the table measures from the surface of a film 0.05 m deep
        assert film_velocity(height, 0.05, weight, eta, tau_y) == pytest.approx(bingham, rel=1e-4, abs=1e-9)
        ours = flows.profile(height, weight, eta, tau_y, 0.05, knee_rate)
        assert ours == pytest.approx(bi_viscosity, rel=1e-4, abs=1e-9)


def film(across, until=1.0, **keywords):
    """On 10 degrees after ``until``, with the kernels of the film before where they fit: use it before the next."""
    sim = begin(catalogue.build("film", spacing=DEPTH / across, **keywords))
    sim.run(until=until)
    return sim


def test_bi_viscosity_film():
    """2 % at 20 across, which tells it from the law without a critical strain rate; yielded to the knee."""
    sim = film(20, yield_value=100.0, plastic_viscosity=100.0, critical_strain_rate=1.0)
    s = sim.snapshot()
    error, other = (
        flows.l2(s.u[:, 0], flows.profile(s.x[:, 1], WEIGHT, 100.0, 100.0, knee_rate=rate)) for rate in (2.0, 1e-6)
    )
    assert error <= 0.02 < 0.06 < other
    assert not sim.particles.carries_stress
    knee = DEPTH - (100.0 + 100.0 * 2.0) / WEIGHT
    sure = np.abs(s.x[:, 1] - knee) > 2 * s.spacing
    assert np.array_equal(s.yielded[sure], s.x[sure, 1] < knee)


def test_film_stands_below_its_yield_value_and_flows_above():
    """20 across, after 2 s. At 1.05 of the yield value one row of particles is sheared: there the plug is too slow by
    f l0^2/(6 eta) at most, what central differences on rows leave where only one of two rows flows."""
    eta, speed = 50.0, {}
    for load in (0.95, 1.05, 1.2):
        sim = film(20, 2.0, yield_value=WEIGHT * DEPTH / load, plastic_viscosity=eta)
        speed[load] = sim.measures()["surface_speed_m_s"]
        if load < 1.0:
            assert sim.snapshot().speed.max() <= 1e-6
    exact = {load: float(flows.profile(DEPTH, WEIGHT, eta, WEIGHT * DEPTH / load)) for load in (1.05, 1.2)}
    assert exact[1.05] - WEIGHT * (DEPTH / 20) ** 2 / (6.0 * eta) <= speed[1.05] <= 1.05 * exact[1.05], (speed, exact)
    assert speed[1.2] == pytest.approx(exact[1.2], rel=0.05)


# ---- between walls --------------------------------------------------------------------------------------------
@pytest.mark.slow
def test_a_channel_that_stops_hardly_goes_back():
    """The developed flow at Bn = 5, 10 particles across, left alone in steps far shorter than the natural one: at rest
    in time (B_cessation_summary.csv), within 5 %, and the stress its plug carried, which lags by one step, does not
    throw it back by more than one of the last steps took off. With a penalty that does not know of the step it does."""
    half, speed, bingham_number, pressure, stop = 0.05, 0.1, 5.0, 9.85669, 0.143653
    tau_y, unit = bingham_number * flows.ETA * speed / half, DENSITY * half**2 / flows.ETA
    weight = pressure * flows.ETA * speed / half**2

    def developed(y):
        return flows.profile(half - np.abs(y - half), weight, flows.ETA, tau_y, half)

    material = mps.Bingham(density=DENSITY, plastic_viscosity=flows.ETA, yield_value=tau_y)
    step = 0.01 * stop * unit
    sim = simulate(flows.between_walls(half / 5, 2 * half, material, start=developed), step)
    assert step < 0.05 * sim.scheme.constants.natural_step
    mean = []
    sim.each_step(lambda s: mean.append(s.snapshot().u[:, 0].mean() / speed))
    sim.run(until=1.3 * stop * unit)
    turned = np.flatnonzero(np.array(mean) < 0)[0]
    assert abs(0.01 * turned - 1.0) < 0.05
    assert -min(mean) < mean[turned - 2] - mean[turned - 1]
    assert abs(mean[-1]) < 1e-3  # what the table calls stopped
