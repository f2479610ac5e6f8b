"""Plane walls without wall particles: what they add to a neighbourhood, their balance, and what they keep out."""

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.backend import ti
from taichi_mps.gradient import Gradient
from taichi_mps.neighbors import Bins, NeighborList
from taichi_mps.particles import Particles
from taichi_mps.walls import Walls
from taichi_mps.weights import lattice_constants

L0, RE = 0.1, 0.21
HEIGHT = 10 * L0


@ti.data_oriented
class Rig:
    """A lattice between two walls, periodic elsewhere: every particle should feel an unbounded lattice."""

    def __init__(self, dimension, slip):
        d = dimension
        width = 7 * L0  # at least three effective radii
        low, high = (0.0,) * d, (width,) * (d - 1) + (HEIGHT,)
        up = (0.0,) * (d - 1)
        planes = (mps.Plane(low, (*up, 1.0), slip=slip), mps.Plane(high, (*up, -1.0), slip=slip))
        x = mps.lattice(low, np.array(high) - 0.5 * L0, L0)
        self.dimension, self.constants = d, lattice_constants(d, L0, RE)
        self.particles = Particles(x, np.zeros(len(x), int), 0.0 * x, False)
        domain = (np.array(low) - np.eye(d)[-1], np.array(high) + np.eye(d)[-1])
        bins = Bins(self.particles, domain, (True,) * (d - 1) + (False,), RE)
        neighbors = NeighborList(bins, 40 * len(x))
        self.walls = Walls(planes, d, L0, RE)
        self.gradient = Gradient(neighbors, self.walls, self.constants)
        self.F, self.W, self.near, self.inward = (ti.Vector.field(d, ti.f64, len(x)) for _ in range(4))
        self.P = ti.Matrix.field(d, d, ti.f64, len(x))
        self.moved = ti.Vector.field(d, ti.f64, 16)
        bins.sort()
        neighbors.build()
        self.gradient.build()
        self.x = self.particles.read()["x"]
        self.interior = (self.x[:, -1] > RE) & (self.x[:, -1] < HEIGHT - RE)

    @ti.kernel
    def press(self, p0: ti.f64, weight: ti.f64):
        """F: force on a unit volume from the pressure p0 + weight depth; W: what the walls add for the weight."""
        down = -weight * ti.Vector.unit(self.dimension, self.dimension - 1, ti.f64)
        for i in range(self.particles.count[None]):
            self.P[i] = -(p0 + weight * (HEIGHT - self.particles.x[i][self.dimension - 1])) * self.gradient.B[i]
        for i in range(self.particles.count[None]):
            self.F[i] = self.gradient.force(i, self.P)
            self.W[i] = self.walls.hydrostatic(self.particles.x[i], down, self.gradient.B[i])
            inward, near = self.walls.crowding(self.particles.x[i])
            self.inward[i], self.near[i] = inward, near

    @ti.kernel
    def push_out(self, x: ti.types.ndarray(dtype=ti.f64, ndim=2)):
        for i in range(x.shape[0]):
            y = ti.Vector.zero(ti.f64, self.dimension)
            for a in ti.static(range(self.dimension)):
                y[a] = x[i, a]
            self.moved[i] = self.walls.outside(y)


@pytest.fixture(scope="module", params=[(2, False), (2, True), (3, False)], ids=["2-D", "2-D slip", "3-D"])
def rig(request):
    return Rig(*request.param)


def test_number_density_and_neighbours_are_those_of_the_full_lattice(rig):
    """To the linear interpolation of the table; the count is a step function of the distance."""
    n = rig.gradient.n.to_numpy()
    assert np.abs(n / rig.constants.n0 - 1.0).max() < 1e-3
    assert np.abs(n[rig.interior] / rig.constants.n0 - 1.0).max() < 1e-12
    around = rig.gradient.around.to_numpy()
    assert np.all(around[rig.interior] == rig.constants.neighbours)
    assert np.abs(around - rig.constants.neighbours).max() < 0.01


def test_uniform_pressure_hardly_pushes_a_lattice(rig):
    """Nothing in the bulk; at the wall under 1 % of p/l0 (0.75 % in 2-D, 0.51 % in 3-D), because the moment of the
    second ghost layer is that of a velocity mirrored at the wall, not of the lattice."""
    rig.press(1000.0, 0.0)
    F = rig.F.to_numpy()
    far = (rig.x[:, -1] > 2 * RE) & (rig.x[:, -1] < HEIGHT - 2 * RE)
    assert far.sum() > 0
    assert np.abs(F[far]).max() < 1e-9
    assert np.abs(F[:, :-1]).max() < 1e-9
    assert np.abs(F).max() < 0.01 * 1000.0 / L0


def test_hydrostatic_pressure_carries_the_weight(rig):
    weight = 9810.0
    rig.press(0.0, weight)
    F = rig.F.to_numpy() + rig.W.to_numpy()
    depth = HEIGHT - rig.x[:, -1]
    assert np.abs(F[:, :-1]).max() < 1e-9 * weight
    assert np.all(np.abs(F[:, -1] / weight - 1.0) < 0.01 * (depth + RE) / L0)  # as for a uniform pressure
    far = (rig.x[:, -1] > 2 * RE) & (rig.x[:, -1] < HEIGHT - 2 * RE)
    assert np.abs(F[far, -1] / weight - 1.0).max() < 1e-9


def test_crowding_balances_the_lattice(rig):
    """The ghosts pull as much to the wall as the particles on the other side pull away from it."""
    rig.press(0.0, 0.0)
    first = np.abs(rig.x[:, -1] - 0.5 * L0) < 0.1 * L0
    assert first.sum() > 0
    inward, near = rig.inward.to_numpy()[first], rig.near.to_numpy()[first]
    r = rig.x[None] - rig.x[first][:, None]
    r[..., :-1] -= 7 * L0 * np.round(r[..., :-1] / (7 * L0))
    size = np.linalg.norm(r, axis=-1)
    size[size < 1e-9] = np.inf
    e = r / size[..., None]
    ours = (np.maximum(RE / size - 1.0, 0.0)[..., None] * e).sum(1)
    close = (np.maximum(1.0 - size / (1.5 * L0), 0.0)[..., None] * e).sum(1)
    assert np.abs(ours + inward).max() < 1e-3 * np.abs(ours).max()
    assert np.abs(close + near).max() < 1e-3 * np.abs(close).max()


def test_positions_are_kept_in_front_of_the_walls(rig):
    d, closest = rig.dimension, 0.1 * L0
    heights = np.array([-0.5, -1e-9, 0.0, 0.5 * closest, closest, 0.3, HEIGHT - closest, HEIGHT, HEIGHT + 2.0])
    x = np.full((len(heights), d), 0.25)
    x[:, -1] = heights
    rig.push_out(x)
    moved = rig.moved.to_numpy()[: len(x)]
    assert np.allclose(moved[:, -1], np.clip(heights, closest, HEIGHT - closest), atol=1e-12)
    assert np.array_equal(moved[:, :-1], x[:, :-1])


def test_box_planes_face_the_fluid():
    planes = mps.box_planes((0.0, 0.0, 0.0), (1.0, 2.0, 3.0))
    assert len(planes) == 5  # open at the top
    assert all(plane.distance(np.array([[0.5, 1.0, 1.5]]))[0] > 0 for plane in planes)
    assert all(plane.distance(np.array([[-0.1, 2.1, -0.1]]))[0] != 0 for plane in planes)
    assert {tuple(plane.normal) for plane in planes} == {(0, 0, 1), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0)}


def test_a_moving_wall_is_refused_as_particles():
    """Wall particles stand still: a wall that moves must not come to rest silently."""
    lid = mps.Plane((0.0, 1.0), (0.0, -1.0), velocity=(1.0, 0.0))
    fluid = mps.fill(mps.Box((0.0, 0.0), (1.0, 1.0)), 0.1)
    domain = ((-0.5, -0.5), (1.5, 1.5))
    scene = mps.Scene("lid", mps.Newtonian(), 0.1, fluid, domain, walls=(lid,), wall_particles=fluid + (0.0, 1.0))
    for numerics in (mps.Implicit(walls="particles"), mps.SemiImplicit()):
        with pytest.raises(mps.SceneError, match="moves"):
            mps.Simulation(scene, numerics)
