"""Grid levels: a symmetric positive definite preconditioner, the same answer, iterations that hardly grow."""

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.backend import real, ti
from taichi_mps.grid_levels import GridLevels
from taichi_mps.mrpcg import MRPCG
from taichi_mps.neighbors import Bins, NeighborList
from taichi_mps.particles import Particles

SPACING, REACH = 1.0, 2.1


@ti.data_oriented
class Membrane:
    """sum over neighbours of (x_i - x_j) + mass x_i: vectors of two components on particles that are not on a lattice.

    A field with the slope g adds 1/2 sum_j (g.r)^2 of every pair twice: on a lattice |g|^2/2 times sum_j r^2/2.
    """

    def __init__(self, across, periodic, seed=0):
        x = mps.lattice((0.0, 0.0), (across, across), SPACING)
        x = x + np.random.default_rng(seed).uniform(-0.2, 0.2, x.shape)
        self.mass = 4.0 / across**2  # as weak for any size, on the scale of the whole
        self.particles = Particles(x, np.zeros(len(x), int), 0.0 * x, np.ones(len(x)), carries_stress=False)
        room = 0.0 if periodic else REACH
        self.bins = Bins(self.particles, ((-room, -room), (across + room, across + room)), (periodic, False), REACH)
        self.neighbors = NeighborList(self.bins, 20 * len(x))
        self.count = self.particles.count
        self.inverse_diagonal = ti.Matrix.field(2, 2, real(), len(x))
        self.energy = 0.25 * sum(i * i + j * j for i in range(-2, 3) for j in range(-2, 3) if i * i + j * j < REACH**2)
        self.bins.sort()
        self.neighbors.build()
        self._diagonal()

    @ti.kernel
    def _diagonal(self):
        for i in range(self.count[None]):
            inverse = 1.0 / (self.neighbors.row_start[i + 1] - self.neighbors.row_start[i] + self.mass)
            self.inverse_diagonal[i] = inverse * ti.Matrix.identity(float, 2)
            if self.particles.id[i] == 0:  # not an unknown
                self.inverse_diagonal[i] *= 0.0

    @ti.func
    def apply(self, u: ti.template(), y: ti.template()):
        for i in range(self.count[None]):
            s = self.mass * u[i]
            for k in range(self.neighbors.row_start[i], self.neighbors.row_start[i + 1]):
                s += u[i] - u[self.neighbors.column[k]]
            y[i] = s

    @ti.func
    def stiffness(self, i):
        return ti.cast(self.energy, float), ti.cast(0.0, float), self.mass * ti.Matrix.identity(float, 2)


@pytest.fixture(scope="module", autouse=True)
def double():
    mps.init(arch="cpu", precision="f64")


def solved(across, levels, periodic=False):
    """(solution, iterations, levels) for a smooth and a rough load."""
    membrane = Membrane(across, periodic)
    grids = GridLevels(membrane, membrane.bins) if levels else None
    solver = MRPCG(across**2, 2, membrane, grids)
    x = membrane.particles.x.to_numpy()
    b = np.sin(3.0 * x / across) + np.random.default_rng(1).standard_normal(x.shape)
    solver.b.from_numpy(b)
    if levels:
        grids.build()
    report = solver.solve(1e-8)
    assert report.converged
    return solver.x.to_numpy(), report.iterations, grids


@pytest.mark.parametrize("periodic", [pytest.param(False, marks=pytest.mark.long), True])
def test_the_preconditioner_is_symmetric_and_positive(periodic):
    _, _, levels = solved(24, True, periodic)
    rng = np.random.default_rng(2)
    fields = [ti.Vector.field(2, ti.f64, 24 * 24) for _ in range(4)]
    a, c = rng.standard_normal((2, 24 * 24, 2))
    mask = np.abs(levels.operator.inverse_diagonal.to_numpy()).sum((1, 2)) > 0  # rows that are unknowns
    a, c = a * mask[:, None], c * mask[:, None]
    for field, values in zip(fields, (a, c), strict=False):
        field.from_numpy(values)
    levels.cycle(fields[0], fields[2])
    levels.cycle(fields[1], fields[3])
    Ma, Mc = fields[2].to_numpy(), fields[3].to_numpy()
    assert (a * Mc).sum() == pytest.approx((c * Ma).sum(), rel=1e-12)
    assert (a * Ma).sum() > 0.0 and (c * Mc).sum() > 0.0
    assert np.all(Ma[~mask] == 0.0)


def test_levels_change_the_iterations_and_not_the_answer():
    plain, many, _ = solved(48, False)
    coarse, few, _ = solved(48, True)
    np.testing.assert_allclose(coarse, plain, atol=1e-6 * np.abs(plain).max())
    assert few < 0.5 * many


def test_iterations_hardly_grow_with_the_number_of_particles():
    _, small, _ = solved(24, True)
    _, large, _ = solved(192, True)  # 64 times as many
    assert large <= 1.3 * small


def test_what_is_lumped_is_all_there_is():
    """The shares of a particle in the nodes of a grid add up to one: a, and S, are conserved from grid to grid."""
    _, _, levels = solved(24, True, periodic=True)
    first, a, S = (field.to_numpy() for field in (levels.first, levels.a, levels.S))
    active = levels.active.to_numpy() > 0
    for grid in range(levels.grids):
        nodes = np.arange(first[grid], first[grid + 1])[active[first[grid] : first[grid + 1]]]
        assert a[nodes].sum() == pytest.approx(24 * 24 * levels.operator.energy, rel=1e-9)
        assert S[nodes].sum(0) == pytest.approx(24 * 24 * levels.operator.mass * np.eye(2), rel=1e-9, abs=1e-12)
