"""Axisymmetric scenes: fits and forces of rings, pipe flow against closed forms, the slump cone, refusals."""

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.engine.terms.shifting import Shifting
from tests.support.rigs import L0, Rig

FLOOR = mps.Plane((0.0, -0.55), (0.0, 1.0))
AXIS = mps.Plane((0.0, 0.0), (1.0, 0.0), mirror=True)
FUNNEL = mps.Solid.of(lambda x: 0.8 * (0.7 - x[:, 0]) + 0.6 * x[:, 1], (-0.5, -1.0), (1.5, 1.0), 0.5 * L0)


def section(columns=9, rows=9, seed=3, inside=0.0):
    """Disordered rings (r, z) [m] from a radius on, none on the axis, and their volumes [m3]."""
    x = mps.lattice((inside, -0.5), (inside + columns * L0, -0.5 + rows * L0), L0)
    x += np.random.default_rng(seed).uniform(-0.2, 0.2, x.shape) * L0
    return x, 2.0 * np.pi * x[:, 0] * L0**2 * np.random.default_rng(seed).uniform(0.8, 1.25, len(x))


def rig(planes=(), inside=0.0):
    x, volumes = section(inside=inside)
    return Rig(x, planes=planes, rings=volumes)


@pytest.fixture(scope="module")
def rings():
    """Behind the axis and on a floor."""
    return rig((AXIS, FLOOR))


@pytest.fixture(scope="module")
def free():
    """Far from the axis, no walls."""
    return rig(inside=1.0)


@pytest.fixture(scope="module")
def lattice():
    """A lattice of rings up to the axis."""
    x = mps.lattice((0.0, -0.6), (1.2, 0.6), L0)
    return Rig(x, planes=(AXIS,), rings=2.0 * np.pi * x[:, 0] * L0**2)


def symmetric(n, seed=7):
    T = np.zeros((n, 3, 3))
    rng = np.random.default_rng(seed)
    T[:, 0, 0], T[:, 1, 1], T[:, 2, 2], T[:, 0, 1] = rng.standard_normal((4, n))
    T[:, 1, 0] = T[:, 0, 1]
    return T


# ---- fits and forces ------------------------------------------------------------------------------------------
def test_linear_fields_have_their_gradient_and_hoop_rate(free):
    """For u = A (r, z) + b the gradient in the plane is A and the hoop rate u_r/r, exactly on any rings."""
    A, b = np.array([[0.7, -0.3], [0.5, 0.2]]), np.array([0.1, -0.4])
    u = free.x @ A.T + b
    G = free.gradients(u)
    healthy = free.gradient.neighbour_count.to_numpy() > 0.5 * free.gradient.lattice_neighbours
    assert healthy.sum() > 60 and np.abs(G[:, :2, :2] - A)[healthy].max() < 1e-12
    assert np.abs(G[:, 2, 2] - u[:, 0] / free.x[:, 0]).max() < 1e-14
    assert np.all(G[:, 2, :2] == 0.0) and np.all(G[:, :2, 2] == 0.0)


def test_flow_to_a_point_has_no_divergence_beside_the_axis(rings):
    """u = (a r, -2 a (z - z_floor)) has no divergence beside the axis and the slip-free floor, which change only its
    shear."""
    G = rings.gradients(np.column_stack([0.5 * rings.x[:, 0], -1.0 * rings.x[:, 1]]))
    away = rings.healthy & (rings.x[:, 1] > -0.55 + 2.1 * L0)
    assert away.sum() > 30
    assert np.abs(G[away] - np.diag([0.5, -1.0, 0.5])).max() < 1e-12


@pytest.mark.parametrize("wall", [FLOOR, pytest.param(FUNNEL, marks=pytest.mark.slow)], ids=["floor", "funnel"])
def test_forces_are_the_negative_transpose_of_the_gradient(wall, rings):
    if wall is FUNNEL:
        x, volumes = section(inside=0.02)
        inside = FUNNEL.distance(x) > 0.1 * L0
        rings = Rig(x[inside], planes=(AXIS, FUNNEL), rings=volumes[inside])
    rng = np.random.default_rng(6)
    assert rings.imbalance(rng.standard_normal(rings.x.shape), symmetric(len(rings.x))) < 1e-12


def test_the_shift_counts_a_ring_by_its_cross_section(free):
    """The shift (I12) is that of brute force where rings are all around, and zero without deformation."""
    shifting = Shifting(free, shifts_in_tension=False)
    section, x = free.volumes / (2.0 * np.pi * free.x[:, 0] * L0**2), free.x
    e = x[None] - x[:, None]
    r = np.linalg.norm(e, axis=-1) + 9.0 * np.eye(len(x))
    e /= r[..., None]
    l0 = L0 * np.sqrt(section)[:, None]
    near = (section / section[:, None] * np.maximum(0.0, 1.0 - r / (1.5 * l0)))[..., None] * e
    apart = -(0.05 * np.maximum(0.0, 0.85 * l0 - r)[..., None] * e).sum(1)
    digits = np.sin(0.5 + x @ [12.9898, 78.233] / L0 + 4.934 * np.arange(2)[:, None]).T * 43758.5453
    move = l0 * (-0.1 * near.sum(1) + 0.005 * (2.0 * (digits - np.floor(digits)) - 1.0))
    size = np.linalg.norm(move, axis=1, keepdims=True)
    full = free.gradient.neighbour_count.to_numpy() >= 0.97 * free.gradient.lattice_neighbours
    assert full.sum() > 15 and section.std() > 0.1
    for rate, expected in ((5.0, move * np.minimum(1.0, 0.05 * l0 / size) + apart), (0.0, 0.0 * apart)):
        free.particles.shear_rate.fill(rate)
        shifting.compute(0.01, 0.02, 0.0)
        assert np.abs(shifting.shift.to_numpy() - expected)[full].max() < 1e-9 * L0


@pytest.mark.parametrize("name", ["uniform pressure", "uniform extension", "shear along the axis"])
def test_stress_on_a_lattice_of_rings_gives_its_divergence_up_to_the_axis(lattice, name):
    """The divergence is 0 of a uniform pressure, including the hoop force on the first ring, and of diag(1, -2, 1), and
    2 of T_rz = r, within 3 % of T/l0, the part of rings beyond the axis that the second ring sees. Away from the axis a
    pressure gives exactly none: larger rings outside push in what the hoop pushes out."""
    n = len(lattice.x)
    T, exact = np.zeros((n, 3, 3)), np.zeros((n, 2))
    if name == "shear along the axis":
        T[:, 0, 1] = T[:, 1, 0] = lattice.x[:, 0] / L0
        exact[:, 1] = 2.0
    else:
        T[:] = -np.eye(3) if name == "uniform pressure" else np.diag([1.0, -2.0, 1.0])
    found = lattice.forces(T) * L0 / lattice.volumes[:, None]
    inner = (np.abs(lattice.x[:, 1]) < 0.6 - 4.2 * L0) & (lattice.x[:, 0] < 1.2 - 4.2 * L0)
    assert inner.sum() >= 21 and lattice.x[inner, 0].min() < 0.51 * L0
    assert np.abs(found - exact)[inner].max() < 0.03
    if name == "uniform pressure":
        away = inner & (lattice.x[:, 0] > 4.2 * L0)
        assert away.sum() >= 6 and np.abs(found[away]).max() < 2e-12


def test_a_lattice_of_thin_rings_has_the_density_of_a_lattice():
    """Rings that have moved outward are closer than l0 to each other without an increase of their density."""
    side = 0.5 * L0
    x = mps.lattice((1.0, -0.35), (1.7, 0.35), side)
    rig = Rig(x, rings=2.0 * np.pi * x[:, 0] * side**2)
    inner = np.all(np.abs(rig.x - (1.35, 0.0)) < 0.35 - 2.1 * L0, axis=1)
    assert inner.sum() >= 9
    assert rig.gradient.density_ratio()[inner] == pytest.approx(1.0, abs=2e-3)


# ---- the whole body -------------------------------------------------------------------------------------------
def test_a_section_is_revolved_to_the_whole_body():
    """The revolved volume is exact within the rounding of the particles in a ring; radii, heights and velocities are
    exact, and rings of two particles or more have no net momentum across the axis."""
    scene = mps.slump_cone(model="axisymmetric")
    u = np.random.default_rng(1).standard_normal(scene.fluid.shape)
    zero = np.zeros(len(u))
    part = mps.measure.Snapshot(0.2, 0.01, scene.fluid, u, zero, zero, zero > 0, zero + 1, np.zeros((0, 2)))
    whole = scene.unfold(part)
    assert whole.x.shape[1] == 3 and len(whole.x) * 1e-6 == pytest.approx(scene.volumes.sum(), rel=0.01)
    radius = np.hypot(whole.x[:, 0], whole.x[:, 1])
    key = np.round(np.column_stack([radius, whole.x[:, 2]]), 9)
    assert {tuple(k) for k in key.tolist()} == {tuple(k) for k in np.round(scene.fluid, 9).tolist()}
    assert np.allclose(np.sort(np.unique(np.round(whole.speed, 9))), np.sort(np.round(part.speed, 9)))
    assert np.abs(whole.u[:, :2].sum(0)).max() < 1e-9 * len(whole.x)


@pytest.mark.parametrize("first", [0.5, 0.74, 0.76, 0.99])
def test_rings_that_have_left_the_axis_revolve_to_a_whole_cylinder(first):
    """Three rings a spacing apart in four layers, the innermost ``first`` spacings from the axis, revolve to a cylinder
    with a flat top, also on the axis, whose volume is exact but for half a particle a ring and the one on the axis."""
    columns = first + np.arange(3)
    x = L0 * np.array([(r, z) for r in columns for z in 0.5 + np.arange(4)])
    whole = mps.measure.revolved(mps.measure.still(x, L0))
    reach = L0 * columns[-1]
    ticks = np.linspace(-reach, reach, 41)
    places = np.stack(np.meshgrid(ticks, ticks), -1).reshape(-1, 2)
    places = places[np.hypot(*places.T) <= reach]
    assert np.abs(mps.measure.surface(whole, places) - 4.0 * L0).max() < 1e-12
    layer = (whole.size**3).sum() / (4.0 * L0**3)
    assert abs(layer - np.pi * (columns[-1] + 0.5) ** 2) < 3 * 0.5 + (first > 0.75)


def test_a_hole_around_the_axis_that_a_ring_would_fit_into_stays():
    whole = mps.measure.revolved(mps.measure.still([[1.3 * L0, 0.5 * L0], [2.3 * L0, 0.5 * L0]], L0))
    assert np.isnan(mps.measure.surface(whole, [[0.0, 0.0]])[0])
    assert np.hypot(*whole.x[:, :2].T).min() == pytest.approx(1.3 * L0)


def test_the_cone_of_rings_has_the_volume_of_the_cone():
    for spacing, error in ((0.01, 0.012), (0.005, 0.005)):
        scene = mps.slump_cone(model="axisymmetric", spacing=spacing)
        assert scene.volumes.sum() == pytest.approx(mps.Cone(0.1, 0.05, 0.3).volume, rel=error)


# ---- runs -----------------------------------------------------------------------------------------------------
@pytest.mark.long
@pytest.mark.parametrize("yield_value", [0.0, 150.0], ids=["Newtonian", "plug over 0.3 R"])
def test_pipe_flow(yield_value):
    """Axial velocity, from rest to four times the decay time of the slowest mode, 20 across, weighted by volume, is
    that of the closed form within 3 %."""
    radius, push, eta, density = 0.1, 5.0, 50.0, 2000.0
    l0 = radius / 10
    length = 7 * l0
    scene = mps.Scene(
        name="pipe",
        material=mps.Bingham(density=density, plastic_viscosity=eta, yield_value=yield_value),
        spacing=l0,
        fluid=mps.lattice((0.0, 0.0), (radius, length - 0.5 * l0), l0),
        walls=(mps.Plane((radius, 0.0), (-1.0, 0.0)),),
        domain=((0.0, 0.0), (radius + l0, length)),
        periodic=(False, True),
        gravity=(0.0, push),
        axisymmetric=True,
    )
    sim = mps.Simulation(scene, mps.Implicit(max_time_step=0.02))
    sim.run(until=4.0 * density * radius**2 / (eta * 5.783))
    s, slope = sim.snapshot(), 0.5 * density * push
    plug = yield_value / slope
    r = np.maximum(s.x[:, 0], plug)
    exact = (slope * (radius**2 - r**2) / 2 - yield_value * (radius - r)) / eta
    volume = scene.volumes
    assert (volume * (s.u[:, 1] - exact) ** 2).sum() < 0.03**2 * (volume * exact**2).sum()
    assert np.abs(s.u[:, 0]).max() < 0.03 * s.u[:, 1].max()


def test_the_cone_slumps_as_the_finite_elements():
    """A cone of 500 Pa and 50 Pa s, true Bingham with inertia, slumps to 179.9 mm and spreads to 319.3 mm, +-0.4 mm
    (reference/A_fe_inertial_slump), within 5 mm and 3 %, and within 1 % in volume, root mean square in time."""
    sim = mps.Simulation(mps.slump_cone(model="axisymmetric", yield_value=500.0))
    volume = []
    sim.each_step(lambda sim: volume.append(sim.report.volume_error))
    assert sim.run() == "rest"
    found = sim.measures()
    assert abs(found["slump_m"] - 0.1799) < 0.005 and abs(found["spread_m"] / 0.3193 - 1.0) < 0.03
    assert np.sqrt(np.mean(np.square(volume))) < 0.01
    sim.scene.check(sim.scene.unfold(sim.snapshot()), found)
