"""Matrices of known solution, their solver and their levels."""

import numpy as np

from taichi_mps.linear.cell_multigrid import CellMultigrid
from taichi_mps.linear.csr import SparseMatrix
from taichi_mps.linear.pcg import MRPCG
from taichi_mps.runtime.backend import real, ti


@ti.data_oriented
class BlockOperator:
    """Dense matrix of n x n blocks; the rows in ``masked`` are not unknowns."""

    def __init__(self, dense, components, masked=()):
        self.components, self.rows = components, len(dense) // components
        inverse = np.zeros((self.rows, components, components))
        for i in range(self.rows):
            block = slice(i * components, (i + 1) * components)
            inverse[i] = 0.0 if i in masked else np.linalg.inv(dense[block, block])
        self.dense = ti.field(real(), dense.shape)
        self.dense.from_numpy(dense)
        self.inverse_diagonal = ti.Matrix.field(components, components, real(), self.rows)
        self.inverse_diagonal.from_numpy(inverse)
        self.count = ti.field(ti.i32, ())
        self.count[None] = self.rows

    @ti.func
    def apply(self, x: ti.template(), y: ti.template(), team: ti.template(), member):
        for i in range(team.first(member, self.count[None]), team.last(member, self.count[None])):
            for a in ti.static(range(self.components)):
                s = ti.cast(0.0, ti.f64)
                for j in range(self.count[None]):
                    for b in ti.static(range(self.components)):
                        s += self.dense[i * self.components + a, j * self.components + b] * x[j][b]
                y[i][a] = s
        team.wait()


def spd(n, seed=0):
    m = np.random.default_rng(seed).standard_normal((n, n))
    return m @ m.T + 0.5 * n * np.eye(n)


def sparse_matrix(matrix, capacity=None):
    a = SparseMatrix(capacity or matrix.shape[0], max(1, matrix.nnz))
    a.load(matrix)
    return a


def solve(operator, b, components=1, tolerance=1e-10, x=0.0, levels=None, check_every=5, team=None, **options):
    """(x, report) of A x = b; an operator keeps its solver, which is compiled once."""
    capacity = operator.inverse_diagonal.shape[0]
    if not hasattr(operator, "solver"):
        operator.solver = MRPCG(capacity, components, operator)
    solver = operator.solver
    solver.levels, solver.use_levels, solver.check_every = levels, levels is not None, check_every
    solver.team = team
    for field, values in ((solver.b, b), (solver.x, np.broadcast_to(x, b.size))):
        padded = np.zeros(capacity * components)
        padded[: b.size] = values
        field.from_numpy(padded.reshape(capacity, components))
    report = solver.solve(tolerance, **options)
    return solver.x.to_numpy().ravel()[: b.size], report


def by_cell(points, per_cell):
    """Row order and sorted cells of a grid of ``points``, ``per_cell`` along each side."""
    axes = [np.arange(n) // per_cell for n in points]
    shape = tuple(int(a[-1]) + 1 for a in axes)
    cell = np.ravel_multi_index(np.meshgrid(*axes, indexing="ij"), shape).ravel()
    order = np.argsort(cell, kind="stable")
    return order, cell[order], shape


def with_levels(matrix, points, per_cell, periodic=(), kind=CellMultigrid):
    """Matrix of a grid of points, reordered by cell: (SparseMatrix, its levels, the SciPy matrix)."""
    order, cell, shape = by_cell(points, per_cell)
    matrix = matrix.tocsr()[order][:, order].tocsr()
    a = sparse_matrix(matrix)
    cell_start = ti.field(ti.i32, int(np.prod(shape)) + 1)
    cell_start.from_numpy(np.searchsorted(cell, np.arange(np.prod(shape) + 1)).astype(np.int32))
    cell_of = ti.field(ti.i32, len(cell))
    cell_of.from_numpy(cell.astype(np.int32))
    levels = kind(a, cell_start, cell_of, shape, periodic)
    levels.build()
    return a, levels, matrix


def preconditioner(levels, vectors):
    """M^-1 v for each v, in the fields of a solver, so that the cycle is compiled once."""
    if not hasattr(levels, "solver"):
        levels.solver = MRPCG(vectors.shape[1], 1, levels.matrix)
    r, z = levels.solver.r, levels.solver.z
    result = []
    for v in vectors:
        r.from_numpy(v[:, None])
        levels.cycle(r, z)
        result.append(z.to_numpy()[:, 0])
    return np.array(result)
