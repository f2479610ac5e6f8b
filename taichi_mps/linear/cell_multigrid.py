"""Multigrid preconditioner for a sparse matrix, with coarse levels made from the binning grid.

Sources: Braess, Towards algebraic multigrid for elliptic problems of second order, Computing 55 (1995), 379-393
(over-correction of piecewise constants); Notay, An aggregation-based algebraic multigrid method, ETNA 37 (2010),
123-146 (why such aggregates need more than a V-cycle).
"""

from itertools import product

import numpy as np

from ..runtime.backend import constant_fields, double_field, ti
from .vectors import Multigrid, SparseMatrix


def cell_number(place, shape) -> np.ndarray:
    """Linear index (n,) of the cells at places (n, d) of a grid of this shape, wrapped."""
    return np.ravel_multi_index(tuple(place.T), tuple(shape), mode="wrap").astype(np.int32)


@ti.data_oriented
class CellMultigrid(Multigrid):
    """Preconditioner of a SparseMatrix: one symmetric W-cycle over piecewise constants on the binning cells.

    Level 0 are the cells (rows sorted by cell: those of cell c are cell_start[c] .. cell_start[c+1], and
    cell_of[i] = c; matrix neighbours at most one cell apart, across a periodic side too, of three cells or more). Each
    next level merges 2^d cells; the last one, of at most MAX_LAST_CELLS cells, is inverted. All have the Galerkin
    operators
    A' = P^T A P, P piecewise constant, as stencils of 3^d numbers. A cycle for A z = r, with C = the cycle
    applied twice on the next level (its inverse on the last):

        z = w D^-1 r;    z += s P C P^T (r - A z);    z += w D^-1 (r - A z)

    s > 1 is Braess's over-correction: constants overestimate the energy of smooth functions. If w < 2 / rho(D^-1 A)
    (any w < 1 for a diagonally dominant A) and s < 2, the eigenvalues of M^-1 A lie in (0, 2): one cycle
    has them in (0, s] if those of C A' are in (0, 1], and two cycles turn l into 1 - (1 - l)^2 <= 1. So M stays
    symmetric positive definite.
    """

    MIN_ROWS = 20_000
    """Number of rows from which on the levels cost less than Jacobi, set-up included. Measured on a lattice with 60
    neighbours, f32, one core, zero start, tolerance 1e-6, CPU seconds (iterations), Jacobi against levels: 4.9k rows
    .011 (54), .013 (9); 12k .032 (72), about the same; 39k .16 (105), .11 (9); 118k .60 (140), .22 (9). A warm start
    helps Jacobi more."""

    fits_in_a_kernel = False  # its W-cycle is a recursion in Python
    MAX_LAST_CELLS = 64
    OVER_CORRECTION = 1.6
    DAMPING = 0.9

    def __init__(self, matrix: SparseMatrix, cell_start, cell_of, shape):
        super().__init__(matrix)
        self.matrix, self.cell_start, self.cell_of, self.shape = matrix, cell_start, cell_of, tuple(shape)
        self.dimension, self.stencil_points = len(shape), 3 ** len(shape)
        self.real = matrix.real
        self.y = ti.Vector.field(1, self.real, matrix.capacity)  # A z
        self._make_tables()
        self.cells = self.first_cell[1]  # of level 0
        cells, last = self.first_cell[-1], self.first_cell[-1] - self.first_cell[-2]
        self.value = double_field((cells, self.stencil_points))  # stencils of all levels
        self.b, self.x, self.r = (double_field(cells) for _ in range(3))  # A' x = b, r = b - A' x
        self.inverse = double_field((last, last))  # of the last level

    def _make_tables(self) -> None:
        """Make the tables of the cells' neighbours, children and parents; level l has the cells first_cell[l] to before
        first_cell[l+1]."""
        offsets = np.array(list(product((-1, 0, 1), repeat=self.dimension)))
        shape, self.first_cell = np.array(self.shape), [0]
        column, coarse_point, parent = [], [], []
        while True:  # a stencil point at a time: places of all of them would need 27 times as much
            place, merge = np.indices(shape).reshape(self.dimension, -1).T, np.where(shape > 3, 2, 1)
            coarse, own = -(-shape // merge), place // merge
            column.append(self.first_cell[-1] + np.stack([cell_number(place + offset, shape) for offset in offsets], 1))
            first_parent = (np.where(place + k == shape, coarse, (place + k) // merge) for k in offsets)
            coarse_point.append(
                np.stack([cell_number(other - own + 1, (3,) * self.dimension) for other in first_parent], 1)
            )
            self.first_cell.append(self.first_cell[-1] + len(place))
            parent.append(self.first_cell[-1] + cell_number(own, coarse))  # the last level has none: beyond the end
            if len(place) <= self.MAX_LAST_CELLS or np.all(merge == 1):
                break
            shape = coarse
        parent = np.concatenate(parent)
        child = np.argsort(parent, kind="stable")
        child_start = np.searchsorted(parent[child], np.arange(self.first_cell[-1] + 1))
        # column: cell at each stencil point; beyond a side, where the stencil stays zero, any. coarse_point: stencil
        # point of the parent that it adds to. Children of cell c: child[child_start[c] .. child_start[c+1]]
        self.column, self.coarse_point, self.parent, self.child, self.child_start = constant_fields(
            np.concatenate(column), np.concatenate(coarse_point).astype(np.int8), parent, child, child_start
        )
        (self.place,) = constant_fields(np.indices(self.shape).reshape(self.dimension, -1).T, vectors=True)

    def build_levels(self) -> None:
        """Build the Galerkin operators of all levels for the present matrix."""
        self._sum_rows()
        for first, end in zip(self.first_cell[1:], self.first_cell[2:], strict=False):
            self._sum_children(first, end)
        dense = np.zeros(self.inverse.shape)
        self._assemble_dense(self.first_cell[-2], dense)
        # Scaled to a unit diagonal (1 for empty cells) and kept away from singular, as for pure Neumann conditions.
        scale = np.diag(dense).copy()
        scale = 1.0 / np.sqrt(np.where(scale > 0.0, scale, 1.0))
        dense *= np.outer(scale, scale)
        np.fill_diagonal(dense, 1.0 + np.sqrt(np.finfo(np.float64 if self.real == ti.f64 else np.float32).eps))
        inverse = np.linalg.inv(dense) * np.outer(scale, scale)
        self.inverse.from_numpy(0.5 * (inverse + inverse.T))

    def cycle(self, r, z) -> None:
        """z = M^-1 r by one cycle."""
        self._restrict_rows(r, z)
        self._solve_level(0)
        self._correct_rows(r, z)

    def _solve_level(self, level: int) -> None:
        """x = C b on a level whose x is zero."""
        if level == len(self.first_cell) - 2:
            self._solve_last(self.first_cell[level])
            return
        first, end, coarse_end = self.first_cell[level : level + 3]
        for _ in range(2):
            self._restrict_cells(first, end, coarse_end)
            self._solve_level(level + 1)
            self._correct_cells(first, end)

    @ti.kernel
    def _sum_rows(self):
        for c in range(self.cells):
            for k in range(self.stencil_points):
                self.value[c, k] = 0.0
            for i in range(self.cell_start[c], self.cell_start[c + 1]):
                if self.matrix.diagonal[i] > 0:
                    self.value[c, self.stencil_points // 2] += self.matrix.diagonal[i]
                    for k in range(self.matrix.row_start[i], self.matrix.row_start[i + 1]):
                        j = self.matrix.column[k]
                        if self.matrix.diagonal[j] > 0:
                            self.value[c, self._stencil_point(c, self.cell_of[j])] += self.matrix.value[k]

    @ti.func
    def _stencil_point(self, c, other):
        step = self.place[other] - self.place[c]
        point = 0
        for a in ti.static(range(self.dimension)):  # two cells or more apart: across a periodic side
            point = 3 * point + 1 + (step[a] if ti.abs(step[a]) < 2 else ti.select(step[a] > 0, -1, 1))
        return point

    @ti.kernel
    def _sum_children(self, first: ti.i32, end: ti.i32):
        for c in range(first, end):
            for k in range(self.stencil_points):
                self.value[c, k] = 0.0
            for m in range(self.child_start[c], self.child_start[c + 1]):
                for k in range(self.stencil_points):
                    self.value[c, ti.cast(self.coarse_point[self.child[m], k], ti.i32)] += self.value[self.child[m], k]

    @ti.kernel
    def _assemble_dense(self, first: ti.i32, dense: ti.types.ndarray(dtype=ti.f64, ndim=2)):
        for c in range(dense.shape[0]):
            for k in range(self.stencil_points):
                dense[c, self.column[first + c, k] - first] += self.value[first + c, k]

    @ti.kernel
    def _solve_last(self, first: ti.i32):
        for c in range(self.inverse.shape[0]):
            s = ti.cast(0.0, ti.f64)
            for m in range(self.inverse.shape[1]):
                s += self.inverse[c, m] * self.b[first + m]
            self.x[first + c] = s

    @ti.func
    def _relax_cells(self, first, end):
        """r = b - A' x;  x += w D^-1 r."""
        self._residual_of_cells(first, end)
        for c in range(first, end):
            d = self.value[c, self.stencil_points // 2]
            self.x[c] += ti.select(d > 0, self.DAMPING * self.r[c] / d, 0.0)

    @ti.func
    def _residual_of_cells(self, first, end):
        for c in range(first, end):
            s = self.b[c]
            for k in range(self.stencil_points):
                s -= self.value[c, k] * self.x[self.column[c, k]]
            self.r[c] = s

    @ti.kernel
    def _restrict_cells(self, first: ti.i32, end: ti.i32, coarse_end: ti.i32):
        self._relax_cells(first, end)
        self._residual_of_cells(first, end)
        for c in range(end, coarse_end):
            s = ti.cast(0.0, ti.f64)
            for m in range(self.child_start[c], self.child_start[c + 1]):
                s += self.r[self.child[m]]
            self.b[c] = s
            self.x[c] = 0.0

    @ti.kernel
    def _correct_cells(self, first: ti.i32, end: ti.i32):
        for c in range(first, end):
            self.x[c] += self.OVER_CORRECTION * self.x[self.parent[c]]
        self._relax_cells(first, end)

    @ti.kernel
    def _restrict_rows(self, r: ti.template(), z: ti.template()):
        for i in range(self.matrix.count[None]):
            z[i] = self.DAMPING * self.matrix.inverse_diagonal[i] @ r[i]
        self.matrix.multiply(z, self.y)
        for c in range(self.cells):
            s = ti.cast(0.0, ti.f64)
            for i in range(self.cell_start[c], self.cell_start[c + 1]):
                if self.matrix.diagonal[i] > 0:
                    s += r[i][0] - self.y[i][0]
            self.b[c] = s
            self.x[c] = 0.0

    @ti.kernel
    def _correct_rows(self, r: ti.template(), z: ti.template()):
        for i in range(self.matrix.count[None]):
            if self.matrix.diagonal[i] > 0:
                z[i][0] += ti.cast(self.OVER_CORRECTION * self.x[self.cell_of[i]], self.real)
        self.matrix.multiply(z, self.y)
        for i in range(self.matrix.count[None]):
            z[i] += self.DAMPING * self.matrix.inverse_diagonal[i] @ (r[i] - self.y[i])
