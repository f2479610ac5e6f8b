"""The default scheme against exact solutions: free fall, films on an incline.

Errors are relative L2 norms of what started from rest; their bounds are the targets of the validation table: 2 % at 20
across, plug speeds within 5 % just above the yield value, 1e-6 m/s where a film must stand.
"""

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.problem import catalogue
from taichi_mps.study.reuse import begin
from taichi_mps.validation import flows

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
