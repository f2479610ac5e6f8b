"""Walls without wall particles: their part of number density and forces, their balance, and that nothing passes
them."""

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.engine.particles.kernels import mps_weight, smooth_weight
from taichi_mps.engine.runtime.backend import ti
from tests.support.rigs import L0, MASS_RATE, RE, Probe, Rig, System, cloud

HEIGHT = 10 * L0


@ti.data_oriented
class Box(Rig):
    """A lattice between two walls, periodic elsewhere: every particle should feel an unbounded lattice."""

    def __init__(self, d, slip, weight=mps_weight):
        width = 7 * L0  # at least three effective radii
        low, high, up = (0.0,) * d, (width,) * (d - 1) + (HEIGHT,), np.eye(d)[-1]
        planes = (mps.Plane(low, tuple(up), slip=slip), mps.Plane(high, tuple(-up), slip=slip))
        x = mps.lattice(low, np.array(high) - 0.5 * L0, L0)
        super().__init__(x, None, planes, None, weight, (low - up, high + up), (True,) * (d - 1) + (False,))
        self.W, self.near = (ti.Vector.field(d, ti.f64, len(x)) for _ in range(2))
        self.depth = HEIGHT - self.x[:, -1]
        self.far = (self.depth > 2 * RE) & (self.depth < HEIGHT - 2 * RE)

    @ti.kernel
    def add(self, weight: ti.f64):
        """W: what the walls add for the weight of a unit volume; near: how they crowd."""
        down = -weight * ti.Vector.unit(self.dimension, self.dimension - 1, ti.f64)
        for i in range(self.particles.count[None]):
            self.W[i] = self.walls.hydrostatic(i, self.particles.x[i], down, self.gradient.B[i], 1.0)
            self.near[i] = self.walls.repulsion(i, self.particles.x[i], 1.0)

    def press(self, p0, weight):
        """Force (n, d) on a unit volume from the pressure p0 + weight depth, with what the walls add."""
        self.add(weight)
        p = p0 + weight * self.depth
        return self.forces(-p[:, None, None] * np.eye(self.dimension)) / self.volume + self.W.to_numpy()


WALLS = {
    "2-D": (2, False), "2-D slip": (2, True), "3-D": (3, False),
    "2-D smooth": (2, False, smooth_weight), "3-D smooth": (3, False, smooth_weight),
}  # fmt: skip


@pytest.fixture(
    scope="module",
    params=[pytest.param(name, marks=[pytest.mark.slow] * (name in ("2-D", "3-D"))) for name in WALLS],
)
def rig(request):
    return Box(*WALLS[request.param])


def test_number_density_and_neighbours_are_those_of_the_full_lattice(rig):
    """Number density and neighbour count beside walls are those of the full lattice within the linear interpolation of
    the table; the count is a step function of the distance."""
    interior = (rig.depth > RE) & (rig.depth < HEIGHT - RE)
    n, around = rig.gradient.n.to_numpy(), rig.gradient.neighbour_count.to_numpy()
    assert np.abs(n / rig.lattice.n0 - 1.0).max() < 1e-3
    assert np.abs(n[interior] / rig.lattice.n0 - 1.0).max() < 1e-12
    assert np.all(around[interior] == rig.lattice.neighbours)
    assert np.abs(around - rig.lattice.neighbours).max() < 0.01


def test_uniform_pressure_hardly_pushes_a_lattice(rig):
    """A uniform pressure exerts no force in the bulk, and at the wall less than 1 % of p/l0 (0.75 % in 2-D, 0.51 % in
    3-D), because the moment of the second ghost layer is that of a mirrored velocity, not of the lattice."""
    F = rig.press(1000.0, 0.0)
    assert np.abs(F[rig.far]).max() < 1e-9
    assert np.abs(F[:, :-1]).max() < 1e-9
    assert np.abs(F).max() < 0.01 * 1000.0 / L0


def test_hydrostatic_pressure_carries_the_weight(rig):
    weight = 9810.0
    F = rig.press(0.0, weight)
    assert np.abs(F[:, :-1]).max() < 1e-9 * weight
    assert np.all(np.abs(F[:, -1] / weight - 1.0) < 0.01 * (rig.depth + RE) / L0)  # as for a uniform pressure
    assert np.abs(F[rig.far, -1] / weight - 1.0).max() < 1e-9


def test_the_repulsion_balances_the_lattice(rig):
    """The repulsion of the ghosts cancels that of the particles on the other side."""
    rig.add(0.0)
    first = np.abs(rig.x[:, -1] - 0.5 * L0) < 0.1 * L0
    r = rig.x[None] - rig.x[first][:, None]
    r[..., :-1] -= 7 * L0 * np.round(r[..., :-1] / (7 * L0))
    size = np.linalg.norm(r, axis=-1)
    size[size < 1e-9] = np.inf
    close = (np.maximum(1.0 - size / (1.5 * L0), 0.0)[..., None] * r / size[..., None]).sum(1)
    assert np.abs(close + rig.near.to_numpy()[first]).max() < 1e-3 * np.abs(close).max()
    assert np.abs(rig.gradient.surface_normal.to_numpy()).max() < 1e-3


@pytest.mark.parametrize("d", [2, 3])
def test_positions_are_kept_in_front_of_the_walls(d):
    up, closest = np.eye(d)[-1], 0.1 * L0
    planes = mps.Plane((0.0,) * d, tuple(up)), mps.Plane((0.0,) * (d - 1) + (HEIGHT,), tuple(-up))
    heights = np.array([-0.5, -1e-9, 0.0, 0.5 * closest, closest, 0.3, HEIGHT - closest, HEIGHT, HEIGHT + 2.0])
    x = np.full((len(heights), d), 0.25)
    x[:, -1] = heights
    moved = Probe(planes, x).end.to_numpy()
    assert np.allclose(moved[:, -1], np.clip(heights, closest, HEIGHT - closest), atol=1e-12)
    assert np.array_equal(moved[:, :-1], x[:, :-1])


# ---- curved walls ---------------------------------------------------------------------------------------------
TILTED = (1.0, 2.0, -2.0)  # of length 3
AROUND = mps.Cylinder((0.1, -0.2), 0.6, angular_velocity=0.7)
WITHIN = mps.Cylinder((0.1, -0.2), 0.25, inside=False, angular_velocity=0.7)
PIPE = mps.Cylinder((0.05, 0.0, 0.02), 0.33, axis=TILTED, angular_velocity=-0.4, velocity=0.3)
FUNNEL = mps.Cylinder((0.0, 0.0, -0.5), 0.25, axis=(0.0, 0.0, 1.0), slope=0.2, length=1.0)
CURVED = {
    "between circles": (2, (AROUND, WITHIN)),
    "slip circle": (2, (mps.Cylinder((0.0, 0.0), 0.4, slip=True),)),
    "pipe": (3, (PIPE,)),
    "funnel": (3, (FUNNEL,)),
}


def inside(walls, d):
    """A jittered lattice in front of all walls."""
    x = cloud((14,) * d if d == 2 else (7,) * d)
    return x[np.min([wall.distance(x) for wall in walls], axis=0) > 0.1 * L0]


def motion_at(wall, x):
    """Velocities (n, d) [m/s] at x of what turns and slides with a wall."""
    arm = x - np.array(wall.point)
    spin = np.cross(wall.unit_axis, arm) if x.shape[1] == 3 else np.stack([-arm[:, 1], arm[:, 0]], 1)
    return wall.angular_velocity * spin + wall.velocity * wall.unit_axis


def test_distances_from_curved_walls():
    x = np.array([[0.1, -0.2], [0.6, -0.2], [0.1, 0.5]])
    assert AROUND.distance(x) == pytest.approx([0.6, 0.1, -0.1])
    assert WITHIN.distance(x) == pytest.approx([-0.25, 0.25, 0.45])
    axis = np.array(TILTED) / 3.0
    across = np.array([2.0, 1.0, 2.0]) / 3.0
    x = np.array(PIPE.point) + np.array([[5.0, 0.0], [-2.0, 0.3], [0.0, 0.4]]) @ np.stack([axis, across])
    assert PIPE.distance(x) == pytest.approx([0.33, 0.03, -0.07])
    cosine = 1.0 / np.sqrt(1.04)
    x = np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [0.0, 0.0, -0.6], [0.3, 0.0, 0.6]])
    assert FUNNEL.distance(x) == pytest.approx([0.35 * cosine, 0.05 * cosine, np.inf, np.inf])
    assert AROUND.speed == pytest.approx(0.42) and PIPE.speed == pytest.approx(np.hypot(0.132, 0.3))


@pytest.mark.parametrize("wall", [AROUND, WITHIN, PIPE, FUNNEL], ids=["around", "within", "pipe", "funnel"])
def test_kernels_see_the_distance_its_gradient_and_the_motion_at_the_foot(wall):
    d = len(wall.point)
    x = np.random.default_rng(3).uniform(-0.3, 0.3, (40, d))
    x = x[np.abs(wall.distance(x)) < 0.2]
    h, unit = 1e-6, np.eye(d)
    probe = Probe((wall,), np.concatenate([x, *(x + h * e for e in unit), *(x - h * e for e in unit)]))
    fields = (probe.z, probe.normal, probe.curvature, probe.velocity)
    z, normal, curvature, velocity = (field.to_numpy().reshape(2 * d + 1, len(x), -1) for field in fields)
    n, z = normal[0], z[0]
    assert np.allclose(z[:, 0], wall.distance(x), atol=1e-14)
    gradient = [(wall.distance(x + h * e) - wall.distance(x - h * e)) / (2 * h) for e in unit]
    assert np.allclose(n.T, gradient, atol=1e-8)
    foot = x - z * n
    assert np.abs(wall.distance(foot)).max() < 1e-12
    assert np.allclose(velocity[0], motion_at(wall, foot), atol=1e-12)
    bend = sum((normal[1 + a, :, a] - normal[1 + d + a, :, a]) / (2 * h) for a in range(d))  # div n
    k = curvature[0, :, 0]  # of the wall's parallel through x it is minus div n
    assert np.allclose(bend, -k / (1.0 - k * z[:, 0]), rtol=1e-6)


@pytest.fixture(scope="module", params=CURVED)
def curved(request):
    d, walls = CURVED[request.param]
    return Rig(inside(walls, d), planes=walls)


def test_force_at_curved_walls_is_the_negative_transpose_of_the_gradient(curved):
    """At curved walls the power of a random stress in a random velocity is the negative of the work of its forces."""
    rng, (n, d) = np.random.default_rng(6), curved.x.shape
    near = np.min([wall.distance(curved.x) for wall in curved.planes], axis=0) < L0
    u, T = rng.standard_normal((n, d)) * near[:, None], rng.standard_normal((n, d, d)) * near[:, None, None]
    assert near.sum() > 10
    assert curved.imbalance(u, T) < 1e-12


@pytest.mark.parametrize("case", ["between circles", pytest.param("pipe", marks=pytest.mark.long)])
def test_turning_with_the_walls_is_exact_and_meets_no_resistance(case):
    """Gradient, stress and hourglass resistance of a rigid rotation between co-rotating walls are exact to rounding."""
    d, walls = CURVED[case]
    system = System(inside(walls, d), planes=walls)
    near = np.min([wall.distance(system.x) for wall in walls], axis=0) < L0
    assert near.sum() > 10
    u = motion_at(walls[0], system.x)
    G = system.gradients(u, wall_motion=1.0)
    assert np.abs(G[system.healthy] + G[system.healthy].transpose(0, 2, 1)).max() < 1e-11
    stiffened = system.x[~system.healthy]  # those at the ends of the pipe with too few neighbours, and who feels them
    free = np.array([np.all(np.linalg.norm(stiffened - x, axis=1) > RE) for x in system.x])
    assert (free & near).sum() > 10
    push = system.push_of_moving_walls()
    assert np.abs(push).max() > 0.0
    assert np.abs(system.multiply(u) - MASS_RATE * u - push)[free].max() < 1e-9 * np.abs(push).max()


@pytest.mark.parametrize("wall", [mps.Cylinder((0.0, 0.0), 1.0), mps.Cylinder((0.0, 0.0), 1.0, inside=False)])
def test_curved_ghosts_complete_rings(wall):
    """At R = 10 l0 rings in front of a curved wall have n = n0 to 0.6 %; with a flat wall 1.1 to 1.5 % would be
    missing."""
    x = mps.rings(0.6, 1.0, L0) if wall.inside else mps.rings(1.0, 1.4, L0)
    rig = Rig(x, planes=(wall,))
    n = rig.gradient.n.to_numpy()[wall.distance(rig.x) < L0] / rig.gradient.n0
    assert abs(n.mean() - 1.0) < 0.006


def plane(**keywords):
    return mps.Plane((0.0, 0.0), **{"normal": (1.0, 0.0)} | keywords)


def cylinder(**keywords):
    return mps.Cylinder(**{"point": (0.0, 0.0, 0.0), "radius": 1.0, "axis": (0.0, 0.0, 1.0)} | keywords)


RUBS = mps.Friction(yield_value=1.0)


@pytest.mark.parametrize(
    ("make", "given", "message"),
    [
        (mps.Friction, {"yield_value": -1.0}, "yield_value = -1.0 Pa: must be greater than or equal to 0 Pa"),
        (mps.Friction, {"viscous_constant": np.nan}, "viscous_constant = nan Pa s/m"),
        (mps.Friction, {}, "no friction at all; must be slip = True"),
        (plane, {"slip": True, "friction": RUBS}, "slip = True with"),
        (plane, {"mirror": True, "friction": RUBS}, "of a mirror plane"),
        (plane, {"mirror": True, "velocity": (0.0, 1.0)}, r"velocity = \(0.0, 1.0\) m/s: a mirror plane cannot move"),
        (
            plane,
            {"mirror": True, "normal": (2.0, 0.0)},
            r"normal = \(2.0, 0.0\) of a mirror plane: must have the length",
        ),
        (cylinder, {"slip": True, "friction": RUBS}, "slip = True with"),
        (cylinder, {"radius": 0.0}, "radius = 0.0 m: must be greater than 0 m"),
        (cylinder, {"radius": float("nan")}, "radius = nan m: must be a finite number"),
        (cylinder, {"axis": None}, "axis = None"),
        (cylinder, {"axis": (0.0, 0.0, 0.0)}, "axis = "),
        (cylinder, {"point": (0.0, 0.0)}, "axis = "),
        (cylinder, {"point": (0.0, 0.0), "axis": None, "length": 1.0}, "length = 1.0 m: a circle has no axis"),
        (cylinder, {"slope": 0.1}, "slope = 0.1: needs a length"),
        (cylinder, {"slope": -2.0, "length": 1.0}, "radius = -1 m"),
        (cylinder, {"length": -1.0}, "length = -1.0 m: must be greater than 0 m"),
        (cylinder, {"thin": True}, "thin = True: needs a length"),
    ],
)
def test_an_impossible_wall_is_refused(make, given, message):
    with pytest.raises(mps.SceneError, match=message):
        make(**given)
