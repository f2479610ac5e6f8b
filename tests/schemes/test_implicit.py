"""Free fall in both schemes, and the implicit scheme against films on an incline.

Errors are relative L2 norms of flows from rest; their bounds are the targets of the validation table: 2 % at 20 across,
1e-6 m/s where a film must stand.
"""

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.study.reuse import begin
from validation import columns, flows

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


@pytest.mark.parametrize(
    ("d", "material", "numerics", "part"),
    [
        (2, mps.Bingham(), mps.Implicit(tolerance=1e-12), 0.5),
        pytest.param(3, mps.Newtonian(viscosity=50.0), mps.Implicit(tolerance=1e-12), 0.5, marks=pytest.mark.long),
        (2, mps.Bingham(), mps.SemiImplicit(), 1.0),
    ],
    ids=["2-D Bingham", "3-D Newtonian", "semi-implicit"],
)
def test_free_fall_is_exact(d, material, numerics, part):
    """Free fall is exact to rounding for any steps, with or without stress carried by the active set (only with a yield
    stress); half of the velocity gained in a step counts in its displacement, in the paper's scheme (eqs 18, 21) all of
    it."""
    x, g = groups(d), np.array([0.0] * (d - 1) + [-9.81])
    velocity, domain = np.tile(START[:d], (len(x), 1)), ((-1.0,) * d, (3.0,) * d)
    sim = mps.Simulation(mps.Scene("fall", material, L0, x, domain, velocity=velocity), numerics)
    x = sim.snapshot().x
    u, away = START[:d], np.zeros(d)
    while sim.time < 0.2:
        dt = sim.step().dt
        u, away = u + g * dt, away + (u + part * g * dt) * dt
    s = sim.snapshot()
    assert sim.steps > 10 and np.abs(s.u - u).max() < 1e-9 and np.abs(s.x - x - away).max() < 1e-9
    if numerics.scheme == "implicit":
        assert sim.report.acceleration == pytest.approx(9.81, rel=1e-9)
        carried = [name in sim.particles.carried for name in ("stress", "plastic_rate")]
        assert carried == 2 * [material.yields]


# ---- films ----------------------------------------------------------------------------------------------------
def film(across, until=1.0, **keywords):
    """On 10 degrees after ``until``, with the kernels of the film before where they fit: use it before the next."""
    sim = begin(mps.catalogue.build("film", spacing=DEPTH / across, **keywords))
    sim.run(until=until)
    return sim


def test_film_stands_below_its_yield_value_and_flows_above():
    """A film of 20 particles across stands below its yield stress and flows above: after 2 s within 2 % where half of
    it is plug. Just above the yield stress one or two rows are sheared and the discretisation sets the speed: row
    film_at_yield of the validation table."""
    stands = film(20, 2.0, yield_value=WEIGHT * DEPTH / 0.95, plastic_viscosity=100.0)
    assert stands.snapshot().speed.max() <= 1e-6
    s = film(20, 2.0, yield_value=0.5 * WEIGHT * DEPTH, plastic_viscosity=100.0).snapshot()
    assert flows.l2(s.u[:, 0], flows.profile(s.x[:, 1], WEIGHT, 100.0, 0.5 * WEIGHT * DEPTH)) <= 0.02


@pytest.mark.slow
@pytest.mark.parametrize(("bn", "pressure"), [(0.0, 3.0), (1.0, 4.0), (1.0, 2.0)])
@pytest.mark.parametrize("viscosity", [50.0, 400.0])
def test_film_starts_as_fast_as_it_should(bn, pressure, viscosity):
    """Mean speed within 3 % of the reference from a tenth of T = rho H^2/eta on; the usual step is 0.02 to 1.5 T."""
    time, found = DENSITY * DEPTH**2 / viscosity, []
    law = {"yield_value": bn / pressure * WEIGHT * DEPTH, "plastic_viscosity": viscosity}
    sim = begin(mps.catalogue.build("film", spacing=DEPTH / 20, **law))
    sim.each_step(lambda sim: found.append((sim.time / time, sim.snapshot().u[:, 0].mean())))
    sim.run(until=1.5 * time)
    known = columns("B_startup_poiseuille.csv", Bn=bn, G=pressure)
    times, speeds = np.transpose([row for row in found if row[0] > 0.099])
    exact = WEIGHT * DEPTH**2 / (pressure * viscosity) * np.interp(times, known["t"], known["Q_half"])
    assert times[0] < 0.11 and np.abs(speeds / exact - 1.0).max() <= 0.03
