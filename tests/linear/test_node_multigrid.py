"""Grid levels: a symmetric positive definite preconditioner, the same answer, iterations that hardly grow."""

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.linear.node_multigrid import NodeMultigrid
from taichi_mps.linear.pcg import MRPCG
from taichi_mps.particles.neighbors import Bins, NeighborList
from taichi_mps.particles.particles import Particles
from taichi_mps.runtime.backend import real, ti

SPACING, REACH = 1.0, 2.1


@ti.data_oriented
class Springs:
    """sum over neighbours of n n.(u_i - u_j), n the direction of r_ij, + mass u_i; the particles are on no lattice.

    With the gradient G of u, 1/2 sum_j (r G r)^2/r^2; over all directions that is an elastic body with mu = lambda:
    mu V = 1/16 sum_j r^2.
    """

    def __init__(self, across, periodic, seed=0):
        x = mps.lattice((0.0, 0.0), (across, across), SPACING)
        x = x + np.random.default_rng(seed).uniform(-0.2, 0.2, x.shape)
        self.particles = Particles(x, np.zeros(len(x), int), 0.0 * x, np.ones(len(x)), carries_stress=False)
        room = 0.0 if periodic else REACH
        self.bins = Bins(self.particles, ((-room, -room), (across + room, across + room)), (periodic, False), REACH)
        self.neighbors = NeighborList(self.bins, 20 * len(x))
        self.count = self.particles.count
        self.mass = ti.field(real(), ())
        self.mass[None] = 4.0 / across**2  # as weak for any size, on the scale of the whole
        self.inverse_diagonal = ti.Matrix.field(2, 2, real(), len(x))
        self.shear = sum(i * i + j * j for i in range(-2, 3) for j in range(-2, 3) if i * i + j * j < REACH**2) / 16.0
        self.bins.sort()
        self.neighbors.build()
        self._diagonal()

    @ti.func
    def spring(self, i, j):
        r = self.bins.displacement(self.particles.x[i], self.particles.x[j])
        return ti.cast(r.outer_product(r) / r.dot(r), float)

    @ti.kernel
    def _diagonal(self):
        for i in range(self.count[None]):
            D = self.mass[None] * ti.Matrix.identity(float, 2)
            for k in range(self.neighbors.row_start[i], self.neighbors.row_start[i + 1]):
                D += self.spring(i, self.neighbors.column[k])
            self.inverse_diagonal[i] = D.inverse()
            if self.particles.id[i] == 0:  # not an unknown
                self.inverse_diagonal[i] *= 0.0

    @ti.func
    def apply(self, u: ti.template(), y: ti.template(), team: ti.template(), member):
        for i in range(team.first(member, self.count[None]), team.last(member, self.count[None])):
            s = self.mass[None] * u[i]
            for k in range(self.neighbors.row_start[i], self.neighbors.row_start[i + 1]):
                j = self.neighbors.column[k]
                s += self.spring(i, j) @ (u[i] - u[j])
            y[i] = s
        team.wait()

    @ti.func
    def stiffness(self, i):
        shear = ti.cast(self.shear, float)
        return shear, 2.0 * shear, self.mass[None] * ti.Matrix.identity(float, 2)


@pytest.fixture(scope="module", autouse=True)
def double():
    mps.init(arch="cpu", precision="f64")


def solved(across, levels, periodic=False):
    """(solution, iterations, levels) for a smooth and a rough load."""
    springs = Springs(across, periodic)
    grids = NodeMultigrid(springs, springs.bins) if levels else None
    solver = MRPCG(across**2, 2, springs, grids)
    x = springs.particles.x.to_numpy()
    b = np.sin(3.0 * x / across) + np.random.default_rng(1).standard_normal(x.shape)
    solver.b.from_numpy(b)
    if levels:
        grids.build()
    report = solver.solve(1e-8, 5000)
    assert report.converged
    return solver.x.to_numpy(), report.iterations, grids


def assert_symmetric_and_positive(levels):
    rng = np.random.default_rng(2)
    fields = [ti.Vector.field(2, ti.f64, 24 * 24) for _ in range(2)]
    a, c = rng.standard_normal((2, 24 * 24, 2))
    mask = np.abs(levels.operator.inverse_diagonal.to_numpy()).sum((1, 2)) > 0  # rows that are unknowns
    a, c = a * mask[:, None], c * mask[:, None]
    found = []
    for values in (a, c):
        fields[0].from_numpy(values)
        levels.cycle(*fields)
        found.append(fields[1].to_numpy())
    Ma, Mc = found
    assert (a * Mc).sum() == pytest.approx((c * Ma).sum(), rel=1e-12)
    assert (a * Ma).sum() > 0.0 and (c * Mc).sum() > 0.0
    assert np.all(Ma[~mask] == 0.0)


@pytest.fixture(scope="module")
def grids():
    """Levels of a body that is periodic along one axis."""
    return solved(24, True, True)[2]


def test_the_preconditioner_is_symmetric_and_positive(grids):
    assert_symmetric_and_positive(grids)


def test_nodes_without_room_are_left_out(grids):
    full, nodes = grids.start.to_numpy(), grids.uses.to_numpy()
    grids.start.from_numpy(np.maximum(0, 9 * (np.arange(len(full)) - 1)).astype(np.int32))
    grids.build()
    assert_symmetric_and_positive(grids)
    assert nodes[1] > 9 and grids.uses[1] == 9
    grids.start.from_numpy(full)
    grids.build()
    assert np.all(grids.uses.to_numpy() == nodes)


@pytest.fixture(scope="module")
def large():
    return solved(192, True)


def test_levels_change_the_iterations_and_not_the_answer(large):
    plain, many, _ = solved(192, False)
    coarse, few, _ = large
    np.testing.assert_allclose(coarse, plain, atol=1e-6 * np.abs(plain).max())
    assert few < 0.1 * many


def test_iterations_hardly_grow_with_the_number_of_particles(large):
    _, small, _ = solved(24, True)
    assert large[1] <= 1.3 * small  # 64 times as many particles


def operators(levels):
    """Of each grid from grid 1 on: (node numbers on their grid's axes, dense matrix)."""
    first, start, uses, used, shape = (
        f.to_numpy() for f in (levels.first, levels.start, levels.uses, levels.used, levels.shape)
    )
    column, stencil = levels.column.to_numpy(), levels.stencil.to_numpy()
    for grid in range(1, levels.grids):
        nodes = used[first[grid] : first[grid] + uses[grid]]
        number = {node: m for m, node in enumerate(nodes)}
        dense = np.zeros((len(nodes), len(nodes), 2, 2))
        for m in range(len(nodes)):
            for k in range(levels.points):
                if np.any(stencil[start[grid] + m, k]):
                    dense[m, number[column[start[grid] + m, k]]] += stencil[start[grid] + m, k].T
        yield np.array(np.unravel_index(nodes - first[grid], shape[grid])).T, dense


def test_the_operators_of_all_grids_have_the_energy_of_linear_fields():
    """Shape functions reproduce them: a constant has the energy of the masses, G x that of the elastic body."""
    springs = Springs(24, False)
    levels = NodeMultigrid(springs, springs.bins)
    G = np.array([[0.3, -1.1], [0.4, 0.8]])
    shear, bulk = springs.shear, springs.shear  # mu and lambda
    strain = shear * (np.sum(G * G) + np.sum(G * G.T)) + bulk * np.trace(G) ** 2
    for mass in (0.7, 0.0):
        springs.mass[None] = mass
        levels.build()
        found = list(operators(levels))
        assert len(found) >= 3
        for grid, (place, A) in enumerate(found, start=1):
            np.testing.assert_allclose(A, A.transpose(1, 0, 3, 2), atol=1e-12)
            np.testing.assert_allclose(A.sum((0, 1)), 24 * 24 * mass * np.eye(2), atol=1e-9)
            if mass == 0.0:
                u = place * np.array(levels.bins.cell_size) * levels.stride.to_numpy()[grid] @ G.T
                assert np.einsum("na,nmab,mb", u, A, u) == pytest.approx(24 * 24 * strain, rel=1e-9)


@ti.kernel
def inverse_of(levels: ti.template(), size: float) -> ti.types.matrix(2, 2, ti.f32):
    levels.invert(0, size * ti.Matrix([[0.6, 0.2], [0.2, 0.4]]))
    return levels.inverse[0]


def test_a_node_that_particles_hardly_touch_has_an_inverse_in_single_precision():
    """Its block may be so small that the determinant is not a number of f32; last, as it starts Taichi anew."""
    mps.init(arch="cpu", precision="f32")
    springs = Springs(24, False)
    levels = NodeMultigrid(springs, springs.bins)
    for size in (1e-25, 1.0, 1e6):
        found = np.array(inverse_of(levels, size).to_numpy()) * size
        np.testing.assert_allclose(found, np.linalg.inv([[0.6001, 0.2], [0.2, 0.4001]]), rtol=1e-5)
    assert np.all(inverse_of(levels, 1e-38).to_numpy() == 0.0)  # as good as no particle there
