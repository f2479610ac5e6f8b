"""The classic failures of particle methods: the paper's literal scheme fails where theory says, the default survives.

Three simulations carry them, loaded with one body after the other: ``free``, a thin fluid without walls and gravity, in
both schemes, and ``box``, soft concrete (50 Pa, 5 Pa s) on a no-slip floor between walls. What stands elsewhere:

- explicit viscosity below and above its exact limit:
  schemes/test_semi_implicit.py::test_stability_bound_of_the_explicit_viscosity
- 1, 2, 3, collinear and coplanar particles, fragments in free flight: schemes/test_implicit.py::test_free_fall_is_exact
- a closed box without surface: test_semi_implicit.py::test_a_closed_box_without_surface_can_be_solved (literal), rows
  cavity_100 and cavity_400 (default), which a void below the lid would miss by far
- the noise of the literal scheme in a still pool: test_semi_implicit.py::test_a_still_pool_stays_bounded
- a free disc that keeps its rotation by default: simulation/test_frame.py; a square patch in rotation, to 2 rad, and
  the disc by the paper's scheme: rows square_patch, square_patch_fine, rotating_disc (validation/test_validation.py)
- at full size, with either scheme: rows still_pool_* (100 s of rest), column_* (about the critical height), slump_100
  (a moving front; literal: ends at 0.07 s) of ``python -m validation``
"""

import numpy as np
import pytest
from scipy.spatial.distance import pdist

import taichi_mps as mps
from tests.support.inside import loaded

LITERAL, DEFAULT = mps.SemiImplicit(literal=True), mps.Implicit()
WIDE = 0.05  # spacing of the free bodies [m]
FINE, DENSITY, YIELD_VALUE, ETA = 0.00125, 2300.0, 50.0, 5.0  # of the box: m, kg/m3, Pa, Pa s
WIDTH, HEIGHT = 72 * FINE, 18 * FINE  # of the box, and of the block that collapses in it [m]


def box(low, high, spacing):
    return mps.fill(mps.Box(low, high), spacing)


def free(numerics):
    """A square of water-like fluid (1 Pa s, 1 m) in rotation at 1 rad/s."""
    x = box((-0.5, -0.5), (0.5, 0.5), WIDE)
    scene = mps.Scene(
        name="free",
        material=mps.Newtonian(density=1000.0, viscosity=1.0),
        spacing=WIDE,
        fluid=x,
        velocity=spin(x),
        gravity=(0.0, 0.0),
        domain=((-2.0, -2.0), (2.0, 2.0)),
    )
    return mps.Simulation(scene, numerics)


@pytest.fixture(scope="module")
def free_default():
    return free(DEFAULT)


@pytest.fixture(scope="module")
def free_literal():
    return free(LITERAL)


@pytest.fixture(scope="module")
def box_default():
    """A block of soft concrete, twice as wide as high, tau_y = 0.0985 rho g H; all in the box is at Courant 0.5."""
    low, high = (0.0, 0.0), (WIDTH, 2 * HEIGHT)
    scene = mps.Scene(
        name="box",
        material=mps.Bingham(density=DENSITY, plastic_viscosity=ETA, yield_value=YIELD_VALUE),
        spacing=FINE,
        fluid=box((0.25 * WIDTH, 0.0), (0.75 * WIDTH, HEIGHT), FINE),
        walls=mps.box_planes(low, high),
        domain=((-5 * FINE, -5 * FINE), (WIDTH + 5 * FINE, 6 * HEIGHT)),
    )
    return mps.Simulation(scene, mps.Implicit(courant_number=0.5))


def run(sim, until):
    sim.run(until=until)
    return sim.snapshot()


def spin(x, omega=1.0):
    """Rigid rotation, counter-clockwise [m/s]."""
    return omega * np.column_stack([-x[:, 1], x[:, 0]])


# ---- viscosity ------------------------------------------------------------------------------------------------
def test_any_diffusion_number_is_stable_by_default(free_default):
    """Of noise at nu dt/l0^2 = 1000, two thousand times the explicit limit, only the rigid motion is left after two
    steps, the first of which leaves what the solver's tolerance allows."""
    x = free_default.scene.fluid
    u = 1e-9 * np.random.default_rng(0).normal(size=x.shape)
    rigid = u.mean(0) + spin(x, (x[:, 0] * u[:, 1] - x[:, 1] * u[:, 0]).sum() / (x**2).sum())
    rule = free_default.scheme.constants.time_step
    usual = rule.longest, rule.viscous_time
    rule.longest, rule.viscous_time = 1000.0 * WIDE**2 * 1000.0 / 1.0, 0.0
    loaded(free_default, x, u).step()
    report = free_default.step()
    rule.longest, rule.viscous_time = usual
    assert report.dt * 1.0 / 1000.0 / WIDE**2 == pytest.approx(1000.0)
    assert np.abs(free_default.snapshot().u - rigid).max() < 2e-3 * np.abs(u).max()


# ---- tension and impact ---------------------------------------------------------------------------------------
def square_patch():
    x = box((-0.5, -0.5), (0.5, 0.5), WIDE)
    return x, spin(x)


def two_blocks():
    """Two blocks of 10 x 10 that touch, each at 0.5 m/s towards the other."""
    block = box((0.0, -0.25), (0.5, 0.25), WIDE)
    x = np.vstack([block, block * (-1.0, 1.0)])
    return x, -0.5 * np.sign(x) * (1.0, 0.0)


@pytest.mark.parametrize("body", [square_patch, two_blocks])
def test_the_literal_scheme_clumps_and_explodes(free_literal, body):
    """Eq (11) attracts in tension and eq (19) repels the clump: before a quarter of a turn, or of the squeeze, there is
    more kinetic energy than at the start, and a named limit ends the run."""
    x, u = body()
    with pytest.raises(mps.DivergedError, match="runaway|left the domain|volume is lost") as error:
        run(loaded(free_literal, x, u), 0.5)
    assert error.value.report.kinetic_energy > 2.0 * 0.5 * 1000.0 * WIDE**2 * (u**2).sum()
    assert pdist(free_literal.snapshot().x).min() < 0.5 * WIDE


def test_the_shift_grows_with_tension(free_default):
    """Inside the shift is min(1, 60 (-p) dt/h) (h_0/h)^2, h the hourglass resistance and h_0 that of a thin fluid; none
    in the first step, which knows no pressure."""
    loaded(free_default, *square_patch()).step()
    assert (free_default.scheme.shifting.tension.to_numpy() == 0.0).all()
    run(free_default, 0.5)
    scheme, before = free_default.scheme, free_default.particles.read()
    dt = free_default.step().dt
    after = free_default.particles.read()["id"]
    count, p = len(after), before["p"][np.argsort(before["id"])][after]
    h = scheme.resistance.viscosity.to_numpy()[:count]
    part = scheme.shifting.tension.to_numpy()[:count]
    inside = scheme.fluid.gradient.neighbour_count.to_numpy()[:count] >= 0.97 * scheme.fluid.gradient.lattice_neighbours
    thin = (scheme.constants.inertial_viscosity[0] / h) ** 2
    wanted = np.where(inside, np.clip(-60.0 * p * dt / h, 0.0, 1.0) * thin, 0.0)
    np.testing.assert_allclose(part, wanted, atol=1e-5)
    assert 0.5 < part.max() < 1.0 and (part[~inside] == 0.0).all()


def test_the_shift_carries_nothing_where_little_deforms(free_default):
    """A uniform shift is removed where nothing deforms, by half at half the strain scale, and kept where a step strains
    by all of it; one that alternates between columns loses its mean by Wendland's kernel."""
    loaded(free_default, *square_patch())
    free_default.step()
    scheme, particles = free_default.scheme, free_default.particles
    s = particles.read()
    x = s["x"]
    column = np.rint(x[:, 0] / WIDE - 0.5)
    inside = np.abs(x - x.mean(0)).max(1) < 0.2
    kernel = {(i, j): np.hypot(i, j) / 2.1 for i in range(-2, 3) for j in range(-2, 3)}
    kernel = {k: (1.0 - q) ** 4 * (1.0 + 4.0 * q) for k, q in kernel.items() if q < 1.0}
    alternating = sum((-1) ** i * w for (i, _), w in kernel.items()) / sum(kernel.values())
    for rate, deforming in ((0.0, 0.0), (1.0, 0.5), (9.0, 1.0)):
        particles.shear_rate.fill(rate)
        for shift, mean in ((1.0 + 0.0 * column, 1.0), ((-1.0) ** column, alternating)):
            moves = np.zeros((scheme.shifting.shift.shape[0], 2))
            moves[: len(x), 1] = 1e-3 * shift
            scheme.shifting.shift.from_numpy(moves.astype(scheme.shifting.shift.to_numpy().dtype))
            scheme.shifting.remove_mean_shift(0.01, 0.02)
            left = scheme.shifting.shift.to_numpy()[: len(x), 1]
            wanted = 1e-3 * shift * (1.0 - (1.0 - deforming) * mean)
            np.testing.assert_allclose(left[inside], wanted[inside], atol=2e-5)


def test_two_blocks_meet_without_a_clump(free_default):
    """Two blocks merge to one sheet: momentum stays zero to the tolerance of the solver, although the halves need not
    stay mirror images, energy falls, and volume is kept."""
    x, u = two_blocks()
    s = run(loaded(free_default, x, u), 0.5)
    assert np.abs(s.u.sum(0)).max() < 1e-4 * np.abs(u).sum()
    assert (s.u**2).sum() < (u**2).sum()
    assert s.x[:, 1].max() > 0.4 and np.abs(s.x[:, 0]).max() < 0.4  # from 0.225 and 0.475
    assert abs(free_default.report.volume_error) < 0.03 and pdist(s.x).min() > 0.5 * WIDE


@pytest.mark.long
def test_stirred_water_comes_to_rest():
    """10 x 10 particles of water that turn at 0.1 m/s at first fall below 1e-6 of the energy M g H, at rest; with the
    hourglass resistance of moving particles throughout they kept some cm/s, 3e-5."""
    depth, l0 = 0.2, 0.02
    x = box((0.0, 0.0), (depth, depth), l0)
    sin, cos = np.sin(np.pi * x / depth), np.cos(np.pi * x / depth)
    u = 0.1 * np.column_stack([sin[:, 0] * cos[:, 1], -cos[:, 0] * sin[:, 1]])
    walls = mps.box_planes((0.0, 0.0), (depth, depth), slip=True)
    domain = ((-0.1, -0.1), (depth + 0.1, depth + 0.1))
    water = mps.Newtonian(density=1000.0, viscosity=1e-3)
    sim, energy = mps.Simulation(mps.Scene("water", water, l0, x, domain, velocity=u, walls=walls)), []
    sim.each_step(lambda s: energy.append(s.report.kinetic_energy))
    sim.run(until=0.5)
    assert energy[-1] > 0.3 * energy[0]  # what moves is not held
    sim.run(until=7.0)
    energy.clear()
    s = run(sim, 8.0)
    assert np.mean(energy) < 1e-6 * 1000.0 * 9.81 * depth**3
    assert 2.0 * s.x[:, 1].mean() == pytest.approx(depth, abs=0.1 * l0)
    assert np.sqrt(np.mean((s.p - 1000.0 * 9.81 * (depth - s.x[:, 1])) ** 2)) < 0.02 * 1000.0 * 9.81 * depth


# ---- soft concrete in a box -----------------------------------------------------------------------------------
BODIES = {  # in spacings: low and high corner; velocity [m/s]
    "column": ((30, 0), (35, 5), (0.0, 0.0)),  # tau_y = 0.355 rho g H, above finite elements' critical 0.30 to 0.35
    "front": ((18, 0), (54, 18), (0.0, 0.0)),
    "thrown": ((2, 2), (14, 14), (-1.0, -1.0)),  # into the corner
    "film of one": ((10, 0), (30, 1), (0.1, 0.0)),  # slides
    "film of two": ((10, 0), (30, 2), (0.1, 0.0)),
}


def body_of(name):
    """Positions and velocities of one of BODIES."""
    low, high, u = BODIES[name]
    x = box(FINE * np.array(low), FINE * np.array(high), FINE)
    return x, np.tile(u, (len(x), 1))


@pytest.mark.slow
def test_what_must_stand_stands(box_default):
    """A column of few particles below its critical height stands for two seconds and slows down, by a factor of e in
    0.3 s, so that ten seconds more would move it a hundredth of a spacing. Pools: rows still_pool_* of the validation
    table."""
    x, _ = body_of("column")
    s = run(loaded(box_default, x), 2.0)
    assert np.abs(s.x - x).max() < 0.01 * FINE
    assert s.speed.max() * 10.0 < 0.01 * FINE


@pytest.mark.slow
def test_a_deep_pool_of_a_viscous_fluid_stands():
    """30 layers of 50 Pa s without a yield stress, pushed by twice the pressure that viscosity alone stops in a step,
    stand; with less hourglass resistance the lattice collapsed by a tenth in 0.4 s."""
    depth, spacing = 0.3, 0.01
    size = (8 * spacing, depth)
    material = mps.Newtonian(density=DENSITY, viscosity=50.0)
    walls = mps.box_planes((0.0, 0.0), size, slip=True)
    domain = ((-0.1, -0.1), (size[0] + 0.1, depth + 0.1))
    sim = mps.Simulation(mps.Scene("pool", material, spacing, box((0.0, 0.0), size, spacing), domain, walls=walls))
    s = run(sim, 0.6)
    assert s.x[:, 1].mean() == pytest.approx(0.5 * depth, rel=1e-3)
    assert s.speed.max() < 0.002
    assert np.sqrt(np.mean((s.p - DENSITY * 9.81 * (depth - s.x[:, 1])) ** 2)) < 0.005 * DENSITY * 9.81 * depth


def test_a_moving_contact_front_of_soft_concrete(box_default):
    """A block of 50 Pa spreads in one piece, without a gap of a particle's size, with a front one or two particles
    high, as far as finite elements without inertia (B = 0.1: 1.75 H), within 10 %."""
    s = run(loaded(box_default, *body_of("front")), 1.0)
    apart = np.sort(np.linalg.norm(s.x[:, None] - s.x[None], axis=2), axis=1)[:, 1]
    reach = 0.5 * (np.ptp(s.x[:, 0]) + FINE) / HEIGHT
    assert reach == pytest.approx(1.75164, rel=0.1)
    assert apart.max() - FINE < FINE
    assert s.x[:, 1].min() > 0.3 * FINE and abs(box_default.report.volume_error) < 0.02


def test_an_impact_in_a_corner_at_courant_one_half(box_default):
    """At a Courant number of one half no particle passes the walls, no energy is gained, and the concrete stops where
    it hit."""
    x, u = body_of("thrown")
    loaded(box_default, x, u)
    energy = []
    while box_default.time < 0.05:
        energy.append(box_default.step(until=0.05).kinetic_energy)
    s = box_default.snapshot()
    assert max(energy) < 1.05 * 0.5 * DENSITY * FINE**2 * (u**2).sum()
    assert s.x.min() > 0.3 * FINE and s.speed.max() < 0.05
    assert abs(box_default.report.volume_error) < 0.02  # rule: with more a run warns


@pytest.mark.parametrize("body", ["film of one", "film of two"])
def test_a_film_of_few_particles_stops(box_default, body):
    """The floor's stress, tau_y + eta u/h, stops the film in rho h^2/eta < 3 ms, the remaining slip of its particles
    decays by a factor of ten in 30 ms, and it keeps its layers."""
    x, u = body_of(body)
    s = run(loaded(box_default, x, u), 0.5)
    assert s.speed.max() < 1e-9
    moved = s.x - x
    assert 0.0 < moved[:, 0].mean() < 0.5 * FINE
    assert np.abs(moved[:, 1]).max() < 0.05 * FINE


# ---- divergence is an error -----------------------------------------------------------------------------------
def harm(state, name):
    """A state that one limit refuses."""
    if name == "too fast":
        state["report"] = None  # the step is found from the velocities
    array, rows, factor, summand = {
        "not a number": ("u", 7, 1.0, np.nan),
        "broken": ("p", 7, 1.0, np.nan),
        "too fast": ("u", slice(None), 1e3, 0.0),
        "crowded": ("x", slice(None), 0.8, 0.0),  # four fifths of the size: 36 % of the volume of the 80 % inside
        "gone": ("x", 7, 0.0, 2.5),
    }[name]
    state[array][rows] = factor * state[array][rows] + summand
    return state


REMEDY = "lower max_time_step or courant_number"
LIMITS = {
    "not a number": f"1 particles left the domain or are not finite numbers; {REMEDY}",
    "broken": f"the matrix of the linear solve is broken; {REMEDY}",
    "too fast": rf"a speed of \S+ m/s, over \S+ m/s, is a runaway; {REMEDY}",
    "crowded": rf"\d\d% of the volume is lost, over 20%: particles overlap; {REMEDY}",
    "gone": r"edge of the domain .*: 1 particles left the domain beyond x = \S+ m, its upper end, .*; enlarge the",
}


@pytest.mark.parametrize("name", LIMITS)
def test_each_limit_ends_the_run_in_the_step_that_crosses_it(free_default, name):
    x = free_default.scene.fluid
    loaded(free_default, x, spin(x)).step()
    free_default.load(harm(free_default.state(), name))
    with pytest.raises(mps.DivergedError, match=LIMITS[name]):
        free_default.step()


def test_a_little_less_crowded_is_let_pass(free_default):
    x = free_default.scene.fluid
    assert loaded(free_default, 0.95 * x, spin(x)).step().volume_error < -0.05
