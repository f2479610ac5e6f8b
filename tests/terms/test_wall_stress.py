"""What ghosts carry besides the stress of the first row: stress along a wall; in a full vessel the shear stress, of a
channel on its lattice, and the law averaged over a layer."""

import numpy as np
import pytest

import taichi_mps as mps
from tests.support.inside import at_start, in_order

ACROSS, GAP, ETA, DENSITY, PUSH = 20, 0.1, 50.0, 2300.0, 8000.0  # -, m, Pa s, kg/m3, N/m3
L0 = GAP / ACROSS


def channel(yield_value=0.0, lid=True, eta=ETA, material=None, start=None):
    """Fluid between two no-slip planes, periodic along x, pushed; without ``lid`` its surface is free. ``start``: its
    velocity [m/s] at a height [m]."""
    high = (10 * L0, GAP)
    x = mps.lattice((0.0, 0.0), np.array(high) - 0.5 * L0, L0)
    scene = mps.Scene(
        name="channel",
        material=material or mps.Bingham(density=DENSITY, plastic_viscosity=eta, yield_value=yield_value),
        spacing=L0,
        fluid=x,
        velocity=None if start is None else np.column_stack([start(x[:, 1]), np.zeros(len(x))]),
        walls=(mps.Plane((0.0, 0.0), (0.0, 1.0)), *[mps.Plane(high, (0.0, -1.0))] * lid),
        domain=((0.0, -L0), (high[0], GAP + 5 * L0)),
        periodic=(True, False),
        gravity=(PUSH / DENSITY, 0.0),
    )
    return mps.Simulation(scene, mps.Implicit(max_time_step=1e-5) if start else None)


def test_the_exact_parabola_is_steady_on_its_lattice():
    """No row of it gains more in a step than 0.4 % of what the push alone would give, the tolerance of the solve, once
    it is known that the vessel is full; without the curvature behind the walls the first row loses 12 % of that and
    the second gains 10."""
    sim = channel(
        material=mps.Newtonian(density=DENSITY, viscosity=ETA), start=lambda y: 0.5 * PUSH / ETA * y * (GAP - y)
    )
    sim.step()
    before = in_order(sim, sim.particles.u.to_numpy())
    sim.step()
    gain = (in_order(sim, sim.particles.u.to_numpy()) - before)[:, 0] * DENSITY / (PUSH * sim.report.dt)
    assert sim.scheme.pressure.full[None] == 1
    assert np.abs(gain.reshape(10, ACROSS).mean(0)).max() < 4e-3


def test_the_stress_differs_by_a_spacing_to_both_sides_and_to_the_wall():
    sim = channel(yield_value=300.0)
    sim.step()
    y = sim.particles.x.to_numpy()[:, 1]
    tensors = np.zeros(sim.particles.stress.to_numpy().shape)
    tensors[:, 0, 1] = tensors[:, 1, 0] = PUSH * (0.5 * GAP - y)
    sim.particles.stress.from_numpy(tensors)
    sim.scheme.wall_stress.start()
    spread, depth = sim.scheme.stress.spread.to_numpy(), np.minimum(y, GAP - y)
    away = np.abs(0.5 * GAP - y) > 3 * L0  # from the middle, where the stress changes its sign
    assert spread[away] == pytest.approx(PUSH * np.minimum(L0, depth)[away], rel=0.02)


def test_a_channel_on_its_lattice_hardly_slides_past_its_walls():
    """So viscous that no row leaves its place beside the next, and put back after each step: what is left is less than
    f l0^2/(6 eta), the error of central differences on rows; without the excess behind the walls, 0.4 f l0^2/eta."""
    eta = 100.0 * ETA
    sim = channel(eta=eta)
    places = sim.particles.x.to_numpy()[np.argsort(sim.particles.id.to_numpy())]
    while sim.time < 8.0 * DENSITY * (0.5 * GAP) ** 2 / eta:
        sim.step()
        sim.particles.x.from_numpy(places[sim.particles.id.to_numpy()])
    y, u = sim.particles.x.to_numpy()[:, 1], sim.particles.u.to_numpy()[:, 0]
    exact = 0.5 * PUSH / eta * y * (GAP - y)
    assert np.sqrt(np.mean((u - exact) ** 2)) < PUSH * L0**2 / (6.0 * eta)


@pytest.fixture(scope="module")
def yielding():
    material = mps.HerschelBulkley(density=DENSITY, yield_value=300.0, consistency=ETA, flow_index=1.0)
    sim = channel(material=material)
    sim.step()
    return sim


def weight_at(sim, stress):
    """Weight of the excess of the first row [-], at the start of a step and then updated, where each of its particles
    carries a shear stress [Pa] of its own."""
    particles, term = sim.particles, sim.scheme.wall_stress
    first = particles.x.to_numpy()[:, 1] < L0
    tensors = np.zeros(particles.stress.to_numpy().shape)
    tensors[first, 0, 1] = tensors[first, 1, 0] = stress
    particles.stress.from_numpy(tensors)
    sim.scheme.pressure.p.fill(0.0)
    term.start()
    at_start = term.weight.to_numpy()[first]
    term.update()
    return at_start, term.weight.to_numpy()[first]


def test_the_weight_makes_the_first_row_slide_as_the_exact_film(yielding):
    """Where the wall carries tau_y + s, s < f l0, a plug slides over the film by s^2/(2 f eta): the rate of the first
    row, this speed over l0, needs tau_y + s^2/(2 f l0) there, and the wall must carry tau_y + s all the same."""
    most = PUSH * L0
    s = most * np.linspace(0.05, 0.95, 10)
    stress = 300.0 + s**2 / (2.0 * most)
    at_start, updated = weight_at(yielding, stress)
    assert stress + 0.5 * most * at_start == pytest.approx(300.0 + s, rel=1e-9)
    assert updated == pytest.approx(at_start, rel=1e-9)


def test_what_has_not_yielded_keeps_its_stress_and_what_flows_well_has_all_of_the_excess(yielding):
    most = PUSH * L0
    stress = np.repeat([0.0, 299.0, 300.0, 300.0 + 0.5 * most, 300.0 + 3.0 * most], 2)
    at_start, updated = weight_at(yielding, stress)
    assert at_start == pytest.approx(np.repeat([0.0, 0.0, 0.0, 1.0, 1.0], 2), abs=1e-9)
    assert updated == pytest.approx(at_start, abs=1e-9)


@pytest.mark.long
def test_below_a_free_surface_there_is_none():
    sim = channel(lid=False)
    for _ in range(3):
        sim.step()
    assert sim.scheme.pressure.full[None] == 0
    assert np.abs(sim.scheme.wall_stress.drive.to_numpy()).max() == 0.0


def pushed(dimension, wall, borne=0.0):
    """Force along x over -V dp/dx [-] of the first four rows of a lattice on a floor, where p grows along x, (4,); the
    part ``borne`` of p along x is borne by a deviatoric stress."""
    floor = mps.Plane((0.0,) * dimension, (0.0,) * (dimension - 1) + (1.0,), **wall)
    size = (11 * L0,) * (dimension - 1) + (6 * L0,)
    scene = mps.Scene(
        name="pressure along a wall",
        material=mps.Bingham(density=DENSITY, plastic_viscosity=ETA, yield_value=1e4),
        spacing=L0,
        fluid=mps.lattice((0.0,) * dimension, np.array(size) - 0.5 * L0, L0),
        walls=(floor,),
        domain=((-L0,) * dimension, tuple(np.array(size) + L0)),
    )
    sim = at_start(scene)
    x = sim.particles.x.to_numpy()
    p = 1000.0 + PUSH * x[:, 0]
    sim.scheme.pressure.p.from_numpy(p)
    stress = np.diag([1.0] + [-1.0 / (dimension - 1)] * (dimension - 1))
    sim.particles.stress.from_numpy(borne * p[:, None, None] * stress)
    b = sim.scheme.velocity.solver.b
    sim.scheme.wall_stress.start()
    sim.scheme.source.set(b)
    middle = (np.abs(x[:, : dimension - 1] - 5.5 * L0) < 0.6 * L0).all(1)
    row = np.rint(x[:, -1] / L0 - 0.5).astype(int)
    each = b.to_numpy()[:, 0] / (-PUSH * L0**dimension)
    return np.array([each[middle & (row == k)].mean() for k in range(4)])


@pytest.mark.parametrize("dimension", (2, 3))
@pytest.mark.parametrize("wall", ({}, {"slip": True}), ids=("no slip", "slip"))
def test_a_pressure_that_grows_along_a_wall_pushes_every_row(dimension, wall):
    """The force is -V grad p in the fluid, and in the rows at the wall within 3 %: without the ghosts' part the first
    row at a no-slip wall has 77 % of it in two dimensions, 79 % in three."""
    rows = pushed(dimension, wall)
    assert rows[3] == pytest.approx(1.0, abs=1e-9)
    assert rows == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize("dimension", (2, 3))
def test_a_pressure_that_stress_bears_along_a_wall_pushes_no_row(dimension):
    """As in a column that stands: its pressure is that of its weight, and nothing holds it at its sides."""
    assert pushed(dimension, {}, borne=1.0) == pytest.approx(0.0, abs=1e-9)
    assert pushed(dimension, {}, borne=0.5) == pytest.approx(0.5, abs=0.015)
