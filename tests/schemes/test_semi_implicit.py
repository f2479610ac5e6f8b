"""The paper's scheme against exact solutions, stability limits and dense algebra, with bounds where it is inexact."""

from pathlib import Path

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.engine.linear.pcg import CONVERGED
from taichi_mps.engine.problem.time_step import Speeds
from tests.support import inside
from validation.flows import l2, profile

REFERENCE = Path(__file__).parents[1] / "reference"
L0 = 0.01


def open_scene(fluid, material=None, margin=10 * L0, periodic=None, domain=None, **more):
    """Fluid without walls in a domain of its own size plus a margin."""
    low, high = fluid.min(0) - margin, fluid.max(0) + margin
    return mps.Scene(
        name="test", material=material or mps.Bingham(), spacing=L0, fluid=fluid, periodic=periodic,
        domain=domain or (tuple(low), tuple(high)), **more,
    )  # fmt: skip


def at_start(scene, **numerics):
    """A simulation with lists and gradients made at the initial positions."""
    return inside.at_start(scene, mps.SemiImplicit(**numerics))


@pytest.fixture(scope="module")
def free():
    """A function that gives a simulation, compiled once for a dimension and a form of the scheme, of fluid at x
    (n, d) [m] without walls, with lists and gradients made there."""
    made = {}

    def of(x, u=0.0, literal=False):
        key = x.shape[1], literal
        if key not in made:
            made[key] = at_start(open_scene(block(x.shape[1], 10)), literal=literal)
        inside.find(inside.loaded(made[key], x, u))
        return made[key]

    return of


def block(dimension, cells):
    return mps.lattice((0.0,) * dimension, (cells * L0,) * dimension, L0)


def interior(x, cells, depth=2.4):
    return np.all((x > depth * L0) & (x < (cells - depth) * L0), axis=1)


# ---- operators on the full lattice --------------------------------------------------------------------------
@pytest.mark.parametrize("dimension", [2, 3])
def test_laplacian_is_exact_on_the_lattice(dimension, free):
    rng = np.random.default_rng(1)
    cells = 8
    x = block(dimension, cells)
    hessians = rng.normal(size=(dimension, dimension, dimension))
    velocity = np.einsum("aij,ni,nj->na", hessians, x, x) + x @ rng.normal(size=(dimension, dimension)) + 0.3
    simulation = free(x, velocity, literal=True)
    viscosity = simulation.scheme.viscosity
    viscosity.set_laplacian_and_guess()
    inside = interior(simulation.particles.read()["x"], cells)
    assert inside.sum() >= 4**dimension
    exact, found = 2.0 * np.einsum("aii->a", hessians), viscosity.lap_u.to_numpy()[: len(x)]
    np.testing.assert_allclose(found[inside], np.tile(exact, (inside.sum(), 1)), rtol=1e-9)


@pytest.mark.parametrize("dimension", [2, 3])
def test_pressure_gradient_is_exact_on_the_lattice(dimension, free):
    slope = np.array([3.0, -2.0, 0.7])[:dimension]
    simulation = free(block(dimension, 10), literal=True)
    particles, pressure = simulation.particles, simulation.scheme.pressure
    x = particles.x.to_numpy()
    particles.p.from_numpy(x @ slope + 7.0)
    pressure.correct(-pressure.density)  # u' = -(dt/rho) grad P = grad P
    inside = interior(x, 10)
    assert inside.sum() >= 2**dimension
    np.testing.assert_allclose(particles.u.to_numpy()[inside], np.tile(slope, (inside.sum(), 1)), rtol=1e-9)


# ---- explicit stability -------------------------------------------------------------------------------------
@pytest.mark.parametrize("dimension, cells", [(2, 24), (3, 12)])
def test_stability_bound_of_the_explicit_viscosity(dimension, cells):
    """The largest stable nu dt/l0^2 of a Fourier mode is that of the infinite lattice (von Neumann), from both
    sides."""
    table = (REFERENCE / "C_mps_lattice_constants_viscous_limit.csv").read_text(encoding="utf-8").splitlines()
    limit = next(float(line.split(",")[6]) for line in table if line.startswith(f"{dimension},2.1,"))
    x = block(dimension, cells)
    high = (cells * L0,) * (dimension - 1) + ((cells + 4) * L0,)
    rng = np.random.default_rng(3)
    scene = open_scene(
        x, mps.Newtonian(1000.0, 10.0), periodic=(True,) * (dimension - 1) + (False,),
        domain=((0.0,) * dimension, high), gravity=(0.0,) * dimension, velocity=rng.normal(size=x.shape),
    )  # fmt: skip
    simulation = at_start(scene)
    viscosity, u, growth = simulation.scheme.viscosity, simulation.particles.u, {}
    start = u.to_numpy()
    for factor in (0.98, 1.05):
        u.from_numpy(start)
        for _ in range(150):
            viscosity.predict(factor * limit * L0**2 * 1000.0 / 10.0, 0.05, 1)
            u.copy_from(viscosity.u_star)
        growth[factor] = np.linalg.norm(u.to_numpy()) / np.linalg.norm(start)
    assert growth[0.98] < 1.0 < 1e3 < growth[1.05]
    rule = viscosity.stable_step(0.2, L0, viscosity.eta)
    assert rule * 10.0 / 1000.0 / L0**2 == pytest.approx(0.2)


# ---- pressure -----------------------------------------------------------------------------------------------
def test_poisson_matrix_is_symmetric_positive_definite_and_equals_a_dense_one():
    """The Poisson matrix is the dense one, symmetric and positive definite, and its solution keeps negative pressures,
    which only the default form cuts off."""
    rng = np.random.default_rng(7)
    scene = mps.catalogue.build(
        "still_pool", plastic_viscosity=50.0, density=2300.0, width=0.08, depth=0.08, spacing=L0
    )
    object.__setattr__(scene, "fluid", scene.fluid + rng.uniform(-0.15, 0.15, scene.fluid.shape) * L0)
    simulation = at_start(scene, literal=True, tolerance=1e-10)
    dt, rho, scheme = 1e-3, 2300.0, simulation.scheme
    scheme.pressure.solve(dt, 1e-10)
    assert scheme.pressure.solver.status[None] == CONVERGED
    rows = simulation.particles.read()
    n = len(rows["id"])
    r = np.linalg.norm(rows["x"][:, None] - rows["x"][None], axis=2)
    np.fill_diagonal(r, np.inf)
    w = np.maximum(2.1 * L0 / r - 1.0, 0.0)
    lattice, density = scheme.fluid.lattice, w.sum(1)
    carries = (rows["kind"] != 2) & (density >= 0.97 * lattice.n0)
    unknown = np.flatnonzero(carries)
    assert 20 < len(unknown) < n
    inner = np.ix_(unknown, unknown)
    dense = (np.diag((w * (rows["kind"] != 2)).sum(1)) - w)[inner]

    matrix = scheme.pressure.matrix
    start, column, value, diagonal = (
        field.to_numpy() for field in (matrix.row_start, matrix.column, matrix.value, matrix.diagonal)
    )
    built = np.diag(diagonal[:n])
    for i in range(n):
        built[i, column[start[i] : start[i + 1]]] = value[start[i] : start[i + 1]]
    assert np.all(diagonal[:n][~carries] == 0.0)
    np.testing.assert_allclose(built[inner], dense, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(built[inner], built[inner].T, rtol=1e-12, atol=1e-14)
    assert np.linalg.eigvalsh(dense).min() > 0.0

    b = lattice.lam * lattice.n0 / 4.0 * rho / dt**2 * (density[unknown] - lattice.n0) / lattice.n0
    exact = np.linalg.solve(dense, b)
    p = simulation.particles.p.to_numpy()[:n]
    np.testing.assert_allclose(p[unknown], exact, rtol=0, atol=1e-6 * np.abs(exact).max())
    assert np.all(p[~carries] == 0.0) and p.min() < 0.0 < p.max()


@pytest.mark.slow
@pytest.mark.parametrize(
    "numerics, pressure, speed, drift",
    [
        ({"literal": True}, np.inf, 1.0, 1.0),  # the density source shakes the pool, but for 0.3 s it stays there
        ({}, 0.1, 0.05 * (9.81 * 0.2) ** 0.5, 0.25),  # the check of the scene
    ],
    ids=["literal", "default"],
)
def test_a_still_pool_stays_bounded(numerics, pressure, speed, drift):
    """The pool stays within bounds of pressure, the error over rho g h, of speed [m/s], and of the drift of its level
    over l0."""
    simulation = mps.Simulation(
        mps.catalogue.build("still_pool", plastic_viscosity=50.0, density=2300.0), mps.SemiImplicit(**numerics)
    )
    errors, pressures = [], []
    simulation.every(0.01, lambda s: errors.append(s.measures()["pressure_error"]))
    simulation.every(0.01, lambda s: pressures.append(s.snapshot().p))
    assert simulation.run(until=0.3) == "time"
    measures = simulation.measures()
    if numerics:  # it fails: the noise becomes a multiple of the pressure
        assert np.max(errors) > 5.0, errors
    p = np.concatenate(pressures)
    assert p.max() > 0.0 and (numerics or p.min() == 0.0)  # the default cuts negative ones off
    assert np.median(errors[10:]) < pressure
    assert measures["max_speed_m_s"] < speed
    assert abs(measures["level_drift_m"]) < drift * L0


def test_a_closed_box_without_surface_can_be_solved():
    """In a closed box the pressure is known up to a constant, and the mean of the source is removed."""
    low, high = np.zeros(2), np.full(2, 8 * L0)
    walls = mps.lattice(low - 3 * L0, high + 3 * L0, L0)
    walls = walls[~np.all((walls > low) & (walls < high), axis=1)]
    lid = mps.Plane(tuple(high), (0.0, -1.0))
    rng = np.random.default_rng(5)
    fluid = mps.fill(mps.Box(tuple(low), tuple(high)), L0)
    scene = open_scene(
        fluid + rng.uniform(-0.004, 0.004, fluid.shape) * L0, walls=(*mps.box_planes(low, high), lid),
        wall_particles=walls,
    )  # fmt: skip
    simulation = at_start(scene, literal=True)
    scheme = simulation.scheme
    scheme.pressure.solve(1e-3, 1e-6)
    rows = simulation.particles.read()
    assert np.all(scheme.pressure.matrix.diagonal.to_numpy()[: len(rows["id"])][rows["kind"] != 2] > 0.0)
    assert scheme.pressure.solver.status[None] == CONVERGED
    assert np.isfinite(rows["p"]).all() and np.ptp(rows["p"]) > 0.0


# ---- viscosity ----------------------------------------------------------------------------------------------
def film(cells, depth, material, force, seconds):
    """Velocity profile of a film on a fixed lattice, from rest, by terms/explicit_viscosity.py alone: (y, u). Zero
    velocity lies half a spacing behind the wall."""
    spacing = depth / cells
    length = 8 * spacing
    scene = mps.Scene(
        name="film", material=material, spacing=spacing, fluid=mps.lattice((0.0, 0.0), (length, depth), spacing),
        walls=(mps.Plane((0.0, 0.0), (0.0, 1.0)),),
        wall_particles=mps.lattice((0.0, -3 * spacing), (length, 0.0), spacing),
        domain=((0.0, -3 * spacing), (length, depth + 5 * spacing)), periodic=(True, False),
        gravity=(force / material.density, 0.0),
    )  # fmt: skip
    simulation = at_start(scene)
    viscosity, particles = simulation.scheme.viscosity, simulation.particles
    dt = viscosity.stable_step(0.2, spacing, viscosity.largest_possible)
    for _ in range(int(seconds / dt)):
        viscosity.predict(dt, 0.05, 20)
        particles.u.copy_from(viscosity.u_star)
    rows = particles.read()
    fluid = rows["kind"] == 0
    return rows["x"][fluid, 1], rows["u"][fluid, 0], simulation


@pytest.mark.slow
def test_newtonian_film_converges_with_first_order():
    """The walls' zero velocity lies half a spacing behind the wall, so the film is exact for a depth larger by l0/2, to
    (l0/H)^2 and the rest of the start-up after 0.25 s: 14 % off at 10 across, and twice that at 5."""
    depth, force, eta, time = 0.05, 8000.0, 50.0, 0.25
    errors = []
    for cells in (5, 10):
        y, u, simulation = film(cells, depth, mps.Newtonian(2300.0, eta), force, time)
        behind = 0.5 * depth / cells
        shifted = profile(y + behind, force, eta, 0.0, depth + behind)
        left = np.exp(-eta / 2300.0 * (0.5 * np.pi / (depth + behind)) ** 2 * time)
        assert l2(u, shifted) < left + cells**-2.0
        errors.append(l2(u, profile(y, force, eta, 0.0, depth)))
        assert simulation.scheme.viscosity.Lambda.to_numpy().max() == 0.0  # no yield code ran
    assert errors[1] == pytest.approx(0.1404, abs=0.015) and errors[1] < 0.6 * errors[0]


def test_bi_viscosity_film():
    """At 4 kPa/m the error is of first order: at most l0/H, less than the zero velocity half a spacing behind the wall
    gives by itself. Where the shear rate jumps by more than about 4 pi_c between particles the gradient of Lambda (eq
    4) would drive the flow: no such case here."""
    depth, force, eta, tau_y, knee_rate = 0.05, 4000.0, 50.0, 100.0, 0.2
    material = mps.Bingham(
        density=2300.0, plastic_viscosity=eta, yield_value=tau_y, critical_strain_rate=0.5 * knee_rate
    )
    cells = 10
    y, u, simulation = film(cells, depth, material, force, 0.25)
    assert l2(u, profile(y, force, eta, tau_y, depth, knee_rate)) < 1.0 / cells
    rows, knee = simulation.particles.read(), depth - (tau_y + eta * knee_rate) / force  # its height
    flowing, spacing = rows["shear_rate"][rows["kind"] == 0] >= knee_rate, depth / cells
    assert np.all(flowing[y < knee - spacing]) and not np.any(flowing[y > knee + spacing])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("gradient", "part"),
    [([[0.0, 2.0], [0.0, 0.0]], 1.0), ([[1.0, 0.0], [0.0, -1.0]], 0.5), ([[0.0, -1.0], [1.0, 0.0]], 0.5)],
    ids=["shear", "stretch", "spin"],
)
def test_a_free_body_is_sheared_against_the_whole_law_and_stretched_against_half_of_it(gradient, part):
    """The power of viscosity is that of the law in shear, and half of it, 4 eta rate^2 of the area, in stretching; it
    brakes a rotation as much: lap u ends at the surface, where P = 0, and dissipates eta grad u:grad u instead of
    2 eta e:e. The surface rows, 2 of 40, lack a part."""
    cells, eta, dt = 40, 50.0, 1e-6
    x = block(2, cells) - 0.5 * cells * L0
    simulation = at_start(
        open_scene(x, mps.Newtonian(2300.0, eta), velocity=x @ np.transpose(gradient), gravity=(0.0, 0.0))
    )
    simulation.scheme.viscosity.predict(dt, 0.05, 1)
    before = simulation.particles.read()["u"]
    change = (simulation.scheme.viscosity.u_star.to_numpy() - before) / dt
    power = -2300.0 * L0**2 * (change * before).sum()
    assert power / (4.0 * eta * len(x) * L0**2) == pytest.approx(part, rel=2.0 / cells)


# ---- the whole scheme ---------------------------------------------------------------------------------------
def test_direct_iteration_and_unyielded_decision_of_a_slump():
    scene = mps.catalogue.build("slump", yield_value=100.0, spacing=0.025)
    simulation = mps.Simulation(scene, mps.SemiImplicit(literal=True))
    first = simulation.step()
    assert first.dt == 1e-3 and first.dt_limit == "first"
    for _ in range(10):
        report = simulation.step()
        assert 1 <= report.outer_iterations <= 20
        assert simulation.scheme.viscosity.error[None] <= 0.05
        snapshot = simulation.snapshot()
        assert np.array_equal(snapshot.yielded, snapshot.shear_rate >= 2 * 0.1)
        assert report.unyielded_fraction == np.mean(~snapshot.yielded)
    limits = simulation.scheme.time_step_limits(Speeds(report.max_speed, report.acceleration))
    largest = 50.0 + (100.0 / np.maximum(snapshot.shear_rate, 0.2)).max()
    assert limits["diffusion"] == pytest.approx(0.2 * 0.025**2 * 2300.0 / largest)
    assert limits["Courant"] == pytest.approx(0.2 * 0.025 / report.max_speed)


def test_the_run_ends_when_nine_tenths_are_unyielded():
    """The run starts with a step at the diffusion number of unyielded material and ends when nine tenths are unyielded;
    resumed it has the same bits."""
    scene = mps.catalogue.build("slump", yield_value=1000.0, critical_strain_rate=1.0, spacing=0.025)
    simulation, reports = mps.Simulation(scene, mps.SemiImplicit()), []
    first = simulation.step()
    assert first.dt == pytest.approx(0.2 * 0.025**2 * 2300.0 / 550.0) and first.dt_limit == "diffusion"
    state = simulation.state()
    simulation.each_step(lambda s: reports.append(s.report))
    assert simulation.run(until=1.0) == "unyielded"
    fractions = [report.unyielded_fraction for report in reports if report.time > 0.05]
    assert fractions[-1] >= 0.9 > max(fractions[:-1])  # rule: the end of the run
    assert simulation.measures()["slump_m"] > 0.1
    simulation.load(state)
    assert [simulation.step() for _ in range(9)] == reports[:9]


# ---- what practice adds -------------------------------------------------------------------------------------
def test_the_gradient_of_the_smallest_pressure_only_pushes_apart(free):
    """The gradient equals brute force, u' = -(dt/rho)(d/n0) sum_j (P_j - min P) r_ij/r^2 w, by which every neighbour
    repels; it does not conserve momentum, since the two of a pair take different minima."""
    dt, reach, rng = 1e-4, 2.1 * L0, np.random.default_rng(6)
    x = block(2, 10)
    simulation = free(x + rng.uniform(-0.3, 0.3, x.shape) * L0)
    simulation.particles.p.from_numpy(rng.uniform(0.0, 100.0, len(x)))
    simulation.scheme.fluid.gradient.weigh()
    simulation.scheme.pressure.correct(dt)
    rows = simulation.particles.read()
    x, u, p = rows["x"] - dt * rows["u"], rows["u"], rows["p"]  # where it was before it was corrected
    r = x[None] - x[:, None]
    distance = np.linalg.norm(r, axis=2) + 1e9 * np.eye(len(x))
    near = distance < reach
    least = np.minimum(p, np.where(near, p[None], np.inf).min(1))
    weight = np.where(near, (reach / distance - 1.0) / distance**2, 0.0)
    pushes = (p[None] - least[:, None]) * weight
    assert np.all(pushes >= 0.0)
    n0 = simulation.scheme.pressure.n0
    exact = -dt / 2300.0 * (2 / n0) * np.einsum("ij,ija->ia", pushes, r)
    np.testing.assert_allclose(u, exact, rtol=1e-6, atol=1e-6 * np.abs(exact).max())
    assert np.linalg.norm(u.sum(0)) > 1e-3 * np.abs(u).sum()


@pytest.mark.lattice("velocities across the line of a pair are kept to rounding where it is along x")
def test_two_particles_that_meet_exchange_momentum_with_the_restitution():
    """Particles at 0.45 l0 that approach with 1 m/s part with 0.2 m/s along their line and keep their velocity across
    it; those at 0.55 l0, or that part, are unchanged, and a wall particle takes half of the impulse."""
    pairs = [(0.45, 1.0), (0.55, 1.0), (0.45, -1.0), (0.45, 1.0)]
    x = L0 * np.array([[[9.0 * k, 0.0], [9.0 * k + distance, 0.0]] for k, (distance, _) in enumerate(pairs)])
    u = np.array([[[speed, 0.3], [0.0, 0.0]] for _, speed in pairs])
    wall = mps.Plane((float(x[-1, 1, 0]) + 0.2 * L0, 0.0), (-1.0, 0.0))
    scene = open_scene(
        x.reshape(-1, 2)[:-1], velocity=u.reshape(-1, 2)[:-1], gravity=(0.0, 0.0), walls=(wall,),
        wall_particles=x[-1, 1:], domain=((-10 * L0,) * 2, (40 * L0,) * 2),
    )  # fmt: skip
    simulation = at_start(scene)
    simulation.scheme.collisions.collide(simulation.particles.u)
    rows = simulation.particles.read()
    first, far, parting, (last, _) = rows["u"][np.argsort(rows["id"])].reshape(-1, 2, 2)
    np.testing.assert_allclose(first, [[0.4, 0.3], [0.6, 0.0]], atol=1e-12)
    np.testing.assert_array_equal(far, u[1])
    np.testing.assert_array_equal(parting, u[2])
    assert last == pytest.approx([1.0 - 0.6, 0.3])


def test_a_neighbour_list_is_kept_while_nobody_went_far(free):
    """Sums over the kept list are those of brute force after moves of less and of more than half of the skin."""
    rng = np.random.default_rng(9)
    x = block(2, 8)
    simulation = free(x)
    neighbors, gradient, particles = simulation.neighbors, simulation.scheme.fluid.gradient, simulation.particles
    for size, kept in ((0.04, True), (0.3, False)):
        x = x + size * L0 * (rng.uniform(-0.7, 0.7, x.shape))
        rows = particles.read()
        listed = neighbors.pairs[None]
        particles.load(rows | {"x": x[rows["id"]]})
        neighbors.search()
        assert (neighbors.pairs[None] == listed) == kept
        gradient.weigh()
        rows = particles.read()
        distance = np.linalg.norm(rows["x"][None] - rows["x"][:, None], axis=2) + 1e9 * np.eye(len(x))
        n = np.maximum(0.0, 2.1 * L0 / distance - 1.0).sum(1)
        np.testing.assert_allclose(gradient.n.to_numpy()[: len(x)], n, rtol=1e-6)


@pytest.mark.parametrize(
    ("yield_value", "until", "stopped_by"),
    [
        pytest.param(100.0, 0.5, "time", marks=pytest.mark.long),
        pytest.param(500.0, 2.0, "unyielded", marks=pytest.mark.long),
    ],
)
def test_the_cases_of_the_paper_arrive(yield_value, until, stopped_by):
    """Cases #1 and #3 at 20 mm run to the end with the volume within 1 %, and within 3 % throughout (the target of 10
    mm is 2 %; the first fall, in which the lattice gives way, is twice as many steps of a spacing here). Slumps are 10
    to 60 mm above the finite elements' (docs/equations.md says why), more than in the paper's text."""
    scene = mps.catalogue.build("slump", yield_value=yield_value, spacing=0.02, critical_strain_rate=0.1)
    simulation, errors = mps.Simulation(scene, mps.SemiImplicit()), []
    simulation.each_step(lambda s: errors.append(s.report.volume_error))
    assert simulation.run(until=until) == stopped_by
    assert abs(errors[-1]) < 0.01 and np.abs(errors).max() < 0.03
    assert 0.2 < simulation.measures()["slump_m"] < 0.28
