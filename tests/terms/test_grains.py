"""Grains as rigid bodies (G1-G5): projection, rotation, collisions, contacts with walls and bars, and in mortar."""

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.engine.geometry.packing import template
from tests.support.grains import L0, THIN, G, advance, momenta, two_bars
from validation.grains import HELD, sphere

STONE = 2650.0
WIDE = (-0.3, -0.2), (0.6, 0.4)
NEWTONIAN = mps.Newtonian(viscosity=10.0, density=2000.0)


def dry(places, across=4, gravity=(0.0, 0.0), walls=(), velocity=None, friction=0.4, domain=WIDE, **numerics):
    """Discs without mortar near the places (g, 2) [m], with velocities (g, 2) [m/s]."""
    offset, cells = template(float(across), 2)
    corners = [np.round(np.array(place) / L0 - offset) for place in places]
    x = np.vstack([(corner + cells) * L0 for corner in corners])
    u = None if velocity is None else np.repeat(np.array(velocity, float), len(cells), axis=0)
    centres = np.array([(corner + offset) * L0 for corner in corners])
    grains = mps.Grains(diameter=across * L0, centres=centres, density=STONE, friction=friction)
    return mps.Simulation(
        mps.Scene("dry", THIN, L0, x, domain, walls, velocity=u, gravity=gravity, grains=grains, until=10.0),
        mps.Implicit(tolerance=1e-10, **numerics),
    )


@pytest.fixture(scope="module")
def compiled_pair():
    sim = dry([(0.0, 0.0), (0.06, 0.02)], velocity=[(1.0, 0.0), (-0.5, 0.0)])
    return sim, sim.state()


@pytest.fixture
def pair(compiled_pair):
    """Two discs at 0 s that meet off their centres after 23 ms."""
    sim, start = compiled_pair
    sim.load(start)
    return sim


def matrix(sim, apply):
    """Matrix (nd, nd) of P followed by ``apply``, from the vector p of the solver to its q."""
    solver, columns = sim.scheme.velocity.solver, []
    for vector in np.eye(2 * solver.p.shape[0]):
        solver.p.from_numpy(vector.reshape(-1, 2))
        sim.scheme.rigid.project(solver.p)
        apply(solver.p, solver.q)
        columns.append(solver.q.to_numpy().ravel())
    return np.transpose(columns)


def motions(sim, g):
    """Components (2N,) of the particles of grain g among those of all, and the displacements (3, 2N) of its translation
    along each axis and of its rotation."""
    own = slice(*sim.scheme.rigid.begin.to_numpy()[g : g + 2])
    rows, arms = sim.scheme.rigid.row.to_numpy()[own], sim.scheme.rigid.arm.to_numpy()[own, :2]
    moves = np.array([0.0 * arms + (1, 0), 0.0 * arms + (0, 1), arms[:, ::-1] * (-1, 1)])
    return (2 * rows[:, None] + (0, 1)).ravel(), moves.reshape(3, -1)


def test_the_projector_is_symmetric_idempotent_and_keeps_momentum_and_angular_momentum(pair):
    pair.step()
    P = matrix(pair, lambda p, q: q.copy_from(p))
    assert max(np.abs(P - P.T).max(), np.abs(P - P @ P).max()) < 1e-12
    for own, moves in (motions(pair, g) for g in range(2)):
        assert moves @ P[np.ix_(own, own)] == pytest.approx(moves, abs=1e-12)


def test_a_solve_goes_on_with_the_residual_of_contacts_that_have_changed(pair):
    """r = b - A u stays that where an update opens a contact, by the product with the matrix before and after."""
    while pair.scheme.contacts.force.to_numpy().max() == 0.0:
        pair.step()
    contacts, solver, products = pair.scheme.contacts, pair.scheme.velocity.solver, []
    solver.x.from_numpy(np.where(pair.particles.read()["slot"][:, None] > 13, 1.0, -1.0) * (1.0, 0.0))  # apart
    pair.scheme.rigid.project(solver.x)
    solver.r.fill(0.0)
    for change in (contacts.update, lambda u: contacts.change_residual(u, solver.r)):
        solver.A.multiply(solver.x, solver.q)
        products.append(solver.q.to_numpy())
        change(solver.x)
    assert np.abs(products[0] - products[1]).max() > 1.0, "no contact has changed"
    assert solver.r.to_numpy() == pytest.approx(products[0] - products[1], abs=1e-9)


def test_a_dry_collision_keeps_momentum_and_angular_momentum_and_no_overlap_stays(pair):
    momentum, angular, _ = momenta(pair)
    least = np.inf
    while pair.time < 0.1:
        pair.step()
        g = pair.grains
        least = min(least, np.linalg.norm(g.centres[0] - g.centres[1]) - g.radii.sum())
    assert abs(pair.grains.spins[:, 0]).min() > 1.0 and pair.grains.velocities[0, 0] < 0.6, "they have not met"
    after, turned, _ = momenta(pair)
    assert after == pytest.approx(momentum, abs=1e-9 * abs(momentum[0]))
    assert turned == pytest.approx(angular, rel=1e-9)
    assert least > -0.05 * L0


def test_grains_keep_their_shape_and_a_state_in_a_contact_goes_on_bit_for_bit(pair):

    def distances():
        rows = pair.particles.read()
        x = rows["x"][np.argsort(rows["slot"])][:12]
        return np.linalg.norm(x[:, None] - x[None], axis=-1)

    pair.step()  # from here on particles stand at the places of their grains
    before = distances()
    while pair.scheme.contacts.force.to_numpy().max() == 0.0:
        pair.step()
    met, ends = pair.state(), []
    for _ in range(2):
        for _ in range(10):
            pair.step()
        ends.append(pair.state())
        pair.load(met)
    for name, values in ends[0].items():
        assert (
            np.array_equal(values, ends[1][name]) if isinstance(values, np.ndarray) else name != "time" or values > 0.0
        )
    assert ends[0]["time"] == ends[1]["time"]
    assert distances() == pytest.approx(before, abs=1e-13)


def slope(tangent, friction, velocity=None):
    """A disc on a plane whose slope has this tangent, with a velocity [(x, y)] at first [m/s], after 0.2 s."""
    angle = np.arctan(tangent)
    gravity = (G * np.sin(angle), -G * np.cos(angle))
    floor = mps.Plane((0.0, 0.0), (0.0, 1.0), name="floor")
    sim = dry([(0.0, 0.02)], gravity=gravity, walls=(floor,), velocity=velocity, friction=friction, wall_loads=True)
    advance(sim, 0.2)
    return sim, np.sin(angle), np.cos(angle)


@pytest.mark.long
def test_a_disc_rolls_down_a_slope_with_two_thirds_of_its_weight_along_it_and_presses_with_its_weight_across():
    """Its inertia is that of a disc, m a^2/2, not that of its particles as points, which would give 0.69."""
    sim, along, across = slope(0.3, 0.4)
    grains, weight = sim.grains, sim.scheme.rigid.mass[0] * G
    assert grains.velocities[0, 0] == pytest.approx(2.0 / 3.0 * G * along * sim.time, rel=1e-3)
    assert -grains.spins[0, 0] * grains.radii[0] == pytest.approx(grains.velocities[0, 0], rel=1e-5)
    loads = sim.measures()
    assert loads["force_floor_z_N_per_m"] == pytest.approx(-weight * across, rel=1e-5)
    assert loads["force_floor_x_N_per_m"] == pytest.approx(weight * along / 3.0, rel=1e-3)
    assert abs(grains.centres[0, 1] - grains.radii[0]) < 1e-3 * L0


@pytest.mark.long
def test_a_disc_thrown_along_a_floor_slips_until_it_rolls_with_two_thirds_of_its_speed():
    """After v/(3 mu g), 42 ms. Told then that it slips with all its friction, which nothing asks for, it sticks within
    the step: turned round with the slip, that force would leave it a speed of mu g dt."""
    sim, *_ = slope(0.0, 0.4, [(0.5, 0.0)])
    assert sim.grains.velocities[0, 0] == pytest.approx(0.5 * 2.0 / 3.0, rel=1e-3)
    state = sim.state()
    state["contact_sticks"][0], state["contact_force"][0, 0] = 0, 0.4 * sim.scheme.rigid.mass[0] * G
    sim.load(state)
    sim.step()
    assert sim.grains.velocities[0, 0] == pytest.approx(0.5 * 2.0 / 3.0, rel=1e-3)


@pytest.mark.long
def test_a_disc_slips_on_a_slope_steeper_than_three_times_its_friction():
    sim, along, across = slope(1.5, 0.4)
    assert sim.grains.velocities[0, 0] == pytest.approx(G * (along - 0.4 * across) * sim.time, rel=1e-3)
    assert -sim.grains.spins[0, 0] * sim.grains.radii[0] == pytest.approx(2.0 * 0.4 * G * across * sim.time, rel=1e-2)


@pytest.mark.slow
@pytest.mark.parametrize("slip", [True, False])
def test_a_disc_slides_down_an_oblique_plane_without_friction_as_if_alone(slip):
    """With g sin a and no spin, whether plane or disc is smooth: a contact that sticks for one solve would brake it."""
    plane = mps.Plane((0.0, 0.0), (-0.6, 0.8), slip=slip)
    sim = dry([(-0.012, 0.016)], gravity=(0.0, -G), walls=(plane,), friction=0.4 * slip)
    advance(sim, 0.1)
    assert sim.grains.velocities[0] @ (-0.8, -0.6) == pytest.approx(0.6 * G * sim.time, rel=1e-3)
    assert abs(sim.grains.spins[0, 0]) < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("friction", [0.4, *(pytest.param(mu, marks=pytest.mark.long) for mu in (0.0, 0.2))])
def test_a_grain_of_one_and_a_tenth_gaps_rests_on_two_bars_of_one_solid_that_bear_its_weight(friction):
    """The distance of the solid is that of its nearest point: each bar must be a contact. At rest the centre lies where
    both touch, within the samples of the bars, an eighth of a spacing apart. Normal forces N at a slope a and friction
    T <= mu N bear the weight, 2 (N sin a + T cos a) = W: without friction N = W/(2 sin a); with friction not more, and
    at least W/(2 (sin a + mu cos a)). Friction of 0.4, more than tan a, would lock any force of the fall in."""
    bar, reach = 2.0 * L0, 5.0 * L0
    half = 3.0 * L0 / 1.1 + bar
    sine = (1.0 - (half / reach) ** 2) ** 0.5
    sim, rise = dry([(0.0, 0.07)], 6, gravity=(0.0, -G), walls=(two_bars(half, bar),), friction=friction), -1.0
    while sim.time < 0.3:
        sim.step()
        rise = max(rise, sim.grains.velocities[0, 1])
    contacts, least = sim.scheme.contacts, 0.5 * sim.scheme.rigid.mass[0] * G / (sine + friction * half / reach)
    pressed = (contacts.force.to_numpy() * contacts.normal.to_numpy())[:2].sum(1)
    assert contacts.number[0] == 2
    assert sim.grains.centres[0] == pytest.approx([0.0, sine * reach], abs=0.03 * L0)
    assert np.abs(sim.grains.velocities).max() < 1e-4 and rise < 0.01, "it comes down with 1 m/s"
    assert 0.97 * least < pressed.min() <= pressed.max() < 1.03 * least * (1.0 + friction * half / reach / sine)


@pytest.mark.slow
def test_a_contact_that_finds_no_room_in_the_list_of_its_grain_ends_the_run(monkeypatch):
    monkeypatch.setattr("taichi_mps.engine.terms.contact.most_contacts", lambda _radii, _surfaces: 1)
    sim = dry([(0.0, 0.0), (0.03, 0.03), (0.06, 0.06)])
    with pytest.raises(mps.DivergedError, match="a grain has more contacts than its list of 1 holds"):
        sim.step()


def pool(material, extra, centres=((0.1, 0.08), (0.05, 0.1)), across=4, depth=0.16, **more):
    """Discs at the centres [m] in a pool 0.2 m wide, heavier than it by ``extra`` [kg/m3]."""
    x = mps.lattice((0.0, 0.0), (0.2, depth), L0)
    walls = tuple(
        mps.Plane(*p) for p in (((0.0, 0.0), (0.0, 1.0)), ((0.0, 0.0), (1.0, 0.0)), ((0.2, 0.0), (-1.0, 0.0)))
    )
    grains = mps.Grains(diameter=across * L0, centres=centres, density=material.density + extra)
    domain = (-0.05, -0.05), (0.25, depth + 0.14)
    return mps.Simulation(mps.Scene("pool", material, L0, x, domain, walls, grains=grains, until=10.0, **more))


@pytest.mark.long
def test_what_preconditions_grains_in_mortar_is_the_mobility_of_each_and_positive_definite():
    """Two discs on the floor that stick to each other. Of a grain it is the inverse of the block of P^T D P of its
    translation and of that of its rotation, D that of its particles and contacts, by what A has more with contacts."""
    sim = pool(NEWTONIAN, 300.0, [(0.125, 0.025), (0.075, 0.025)], 5)
    sim.step()
    rigid, contacts, solver = sim.scheme.rigid, sim.scheme.contacts, sim.scheme.velocity.solver
    contacts.resistance.fill(0.0)
    free = matrix(sim, solver.A.multiply)
    n, sticks = contacts.normal.to_numpy(), contacts.partner.to_numpy()[:, None, None] >= 0
    parts = np.where(sticks, np.eye(3), n[:, :, None] * n[:, None])
    contacts.resistance.from_numpy(contacts.stiffness.to_numpy()[:, None, None] * parts)
    solver.M.build()
    M, n = matrix(sim, solver.M.apply), rigid.particles.capacity
    blocks = np.linalg.inv(solver.A.inverse_diagonal.to_numpy())
    D = matrix(sim, solver.A.multiply) - free + np.einsum("ij,iab->iajb", np.eye(n), blocks).reshape(2 * n, 2 * n)
    for g in range(2):
        own, moves = motions(sim, g)
        resists, moved = moves @ D[np.ix_(own, own)] @ moves.T, moves @ M[np.ix_(own, own)] @ moves.T
        resists[2, 2] += rigid.extra[g][2, 2] / contacts.step[None]
        for part in (slice(0, 2), slice(2, 3)):
            mobility = np.linalg.inv(resists[part, part])
            size = np.diag(moves[part] @ moves[part].T)
            assert moved[part, part] == pytest.approx(size * mobility * size, rel=1e-8)
    values, rigid_away = np.linalg.eigvalsh(M), 2 * rigid.members - 6
    assert np.abs(M - M.T).max() < 1e-10 * values[-1]
    assert values[rigid_away] > 1e6 * np.abs(values[:rigid_away]).max()


@pytest.mark.long
def test_floor_and_sides_bear_the_weight_of_a_pool_with_a_disc_on_its_floor():
    """Pressure of the mortar and contact together, within 0.5 %."""
    sim = pool(NEWTONIAN, 300.0, [(0.105, 0.025)], 5, wall_loads=True)
    advance(sim, 0.5)
    more = 300.0 * G * len(template(5.0, 2)[1]) * L0**2
    borne = sum(load for name, load in sim.measures().items() if name.startswith("force") and "_z_" in name)
    assert -borne == pytest.approx(2000.0 * G * 0.2 * 0.16 + more, rel=5e-3)
    assert sim.scheme.contacts.force[0][1] > 0.0


@pytest.mark.slow
def test_a_particle_below_a_falling_block_with_a_disc_falls_as_freely():
    """It carries no stress: what is held below a surface is not its weight."""
    x = np.vstack([mps.lattice((0.0, 0.0), (0.2, 0.1), L0), [(0.035, -0.065)]])
    grains = mps.Grains(diameter=4 * L0, centres=[(0.1, 0.05)], density=2300.0)
    sim = mps.Simulation(mps.Scene("block", NEWTONIAN, L0, x, WIDE, grains=grains, until=10.0))
    advance(sim, 0.05)
    assert sim.snapshot().u[:, 1] == pytest.approx(-G * 0.05, rel=1e-3)


@pytest.mark.slow
def test_a_disc_sinks_in_a_deep_pool_as_fast_as_in_a_shallow_one_and_goes_on():
    """Under 8 and 52 cm: a pressure that grows with the depth would lock it in the lattice of the mortar."""
    pools = [pool(NEWTONIAN, 300.0, [(0.1, 0.12)], depth=depth) for depth in (0.2, 0.64)]
    for sim in pools:
        advance(sim, 1.0)
    shallow, deep = (0.115 - sim.grains.centres[0, 1] for sim in pools)
    assert deep == pytest.approx(shallow, rel=0.03) and deep > 1.5 * L0
    assert pools[1].grains.velocities[0, 1] == pytest.approx(-deep, rel=0.25), "of 1 s"


@pytest.mark.slow
def test_a_disc_that_sinks_steadily_sinks_as_far_in_a_fifth_of_the_steps():
    """Up to eight natural steps at once, against one."""
    mortar = mps.Bingham(yield_value=2.0, plastic_viscosity=10.0, density=2000.0)
    few = pool(mortar, 300.0, [(0.1, 0.12)], depth=0.2)
    many = mps.Simulation(few.scene, mps.Implicit(max_time_step=few.problem.time_step.longest))
    for sim in (few, many):
        advance(sim, 1.0)
    assert 0.115 - few.grains.centres[0, 1] == pytest.approx(0.115 - many.grains.centres[0, 1], rel=0.03)
    assert few.report.step < 0.2 * many.report.step


@pytest.mark.long
def test_grains_in_a_yield_stress_that_holds_them_stand_without_creep():
    """In 60 Pa, heavier by 300 kg/m3: their weight over tau_y D is 1.5, the limit for a disc about 12. What is left is
    the settling of the pool, which dies away."""
    sim = pool(mps.Bingham(yield_value=60.0, plastic_viscosity=10.0, density=2000.0), 300.0)
    start, speeds = sim.grains.centres, []
    for time in (0.2, 0.4, 0.8):
        advance(sim, time)
        speeds.append(np.abs(sim.grains.velocities).max())
    assert np.abs(sim.grains.centres - start).max() < 1e-3 * L0
    assert speeds[2] < 2e-6 and speeds[0] > speeds[1] > speeds[2], speeds
    state = sim.snapshot()
    assert sorted(np.unique(state.grain)) == [0, 1, 2] and (state.grain == 1).sum() == len(template(4.0, 2)[1])


@pytest.mark.long
def test_a_sphere_in_a_tenth_more_yield_stress_than_holds_it_by_beris_and_others_stands():
    """8 across, diameter of equal volume. Held by the mortar's yield stress where its own particles are, it falls with
    a few thousandths of Stokes' speed."""
    equal = 0.986
    _, speeds, found = sphere(8, 1.1 * HELD * equal, 0.25)
    assert found == pytest.approx(equal, abs=1e-3) and abs(speeds[-1]) < 1e-4


@pytest.mark.long
def test_grains_as_dense_as_newtonian_fluid_float():
    """They move by less than a thousandth of what their weight would make without buoyancy, rho g D^2/eta."""
    sim = pool(NEWTONIAN, 0.0)
    advance(sim, 0.3)
    assert np.abs(sim.grains.velocities).max() < 1e-3 * 2000.0 * G * 0.04**2 / 10.0


def sheared(side, **keywords):
    """A grain in the middle of a square of this side [m], 5 mm a spacing, periodic, sheared by 1/s between walls."""
    x = mps.lattice((0.0, 0.0), (side, side), 0.005)
    walls = tuple(mps.Plane((0.0, z), (0.0, n), velocity=(-0.5 * n * side, 0.0)) for z, n in ((0.0, 1.0), (side, -1.0)))
    grains = mps.Grains(centres=[(0.5 * side, 0.5 * side)], density=1000.0, **keywords)
    numbers = {"velocity": (x - 0.5 * side)[:, ::-1] * (1.0, 0.0), "gravity": (0.0, 0.0), "grains": grains}
    mortar, domain = mps.Newtonian(viscosity=10.0, density=1000.0), ((0.0, -0.02), (side, side + 0.02))
    return mps.Simulation(
        mps.Scene("shear", mortar, 0.005, x, domain, walls, periodic=(True, False), until=20.0, **numbers)
    )


@pytest.mark.long
def test_a_disc_in_shear_turns_with_half_of_the_shear_rate():
    """Jeffery 1922, unbounded: gamma/2; four spacings across in a gap of four diameters, from strain 0.4 to 3."""
    sim, spins = sheared(0.08, diameter=0.02), []
    start = sim.grains.centres[0, 1]
    while sim.time < 3.0:
        sim.step()
        spins += [sim.grains.spins[0, 0]] * (sim.time > 0.4)
    assert np.mean(spins) == pytest.approx(-0.5, rel=0.03)
    assert abs(sim.grains.centres[0, 1] - start) < 0.02 * 0.005


@pytest.mark.long
def test_an_ellipse_in_shear_turns_over_in_the_time_of_jeffery():
    """Jeffery 1922, unbounded: half a turn in pi (r + 1/r)/gamma, r the ratio of the axes by the second moments of its
    particles, each a square; 12 across in a gap of six diameters."""
    sim = sheared(0.36, diameter=0.06, shape="ellipse 2:1")
    s = sim.snapshot()
    moments = np.linalg.eigvalsh(np.cov(s.x[s.grain > 0].T, bias=True) + 0.005**2 / 12.0 * np.eye(2))
    ratio = (moments[1] / moments[0]) ** 0.5
    while sim.time < 1.0 or sim.grains.rotations[0, 1, 0] < 0.0:
        sim.step()
    assert sim.time == pytest.approx(np.pi * (ratio + 1.0 / ratio), rel=0.03)


@pytest.mark.long
@pytest.mark.parametrize("across, bound", [(4, 0.1), (8, 0.05)])
def test_spheres_in_a_cubic_array_settle_as_fast_as_by_sangani_and_acrivos(across, bound):
    """Periodic box two diameters wide, Newtonian, radius of equal volume; series of Sangani and Acrivos 1982, which
    gives the drag of Zick and Homsy 1982 within 0.1 % here. The speed is that against no mean flux of volume."""
    size, n = 0.016, 2 * across
    spacing, side = size / across, 2.0 * size
    x = mps.lattice((0.0,) * 3, (side,) * 3, spacing)
    grains = mps.Grains(diameter=size, centres=[(0.5 * side,) * 3], density=2700.0)
    fluid = mps.Newtonian(viscosity=20.0, density=2200.0)
    keywords = {"periodic": (True,) * 3, "until": 10.0, "grains": grains}
    sim = mps.Simulation(mps.Scene("array", fluid, spacing, x, ((0.0,) * 3, (side,) * 3), **keywords))
    inside = sim.snapshot().grain > 0
    share = inside.mean()
    assert len(x) == n**3
    equal = spacing * (6.0 * inside.sum() / np.pi) ** (1.0 / 3.0)
    drag = 1.0 - 1.7601 * share ** (1 / 3) + share - 1.5593 * share**2 + 3.9799 * share ** (8 / 3)
    speed = 500.0 * G * equal**2 / (18.0 * 20.0) * (drag - 3.0734 * share ** (10 / 3))
    for _ in range(20):
        sim.step()
    u = sim.snapshot().u[:, 2]
    assert (1.0 - share) * (u[~inside].mean() - u[inside].mean()) / speed == pytest.approx(1.0, abs=bound)
