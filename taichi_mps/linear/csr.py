"""A sparse matrix in compressed rows (CSR)."""

from ..runtime.backend import real, ti
from ..runtime.stages import stage
from ..runtime.thread_team import first, last, wait


@ti.data_oriented
class SparseMatrix:
    """Scalar matrix in compressed rows: A_ii = diagonal[i] and A_ij = value[k], j = column[k], k in the row of i.

    row_start, column and count may belong to someone else (a neighbour list). Rows whose diagonal is not
    positive are no unknowns. Fill value and call set_diagonal for every row.
    """

    def __init__(self, capacity: int, pair_capacity: int, row_start=None, column=None, count=None):
        self.capacity, self.pair_capacity = capacity, pair_capacity
        self.count = ti.field(ti.i32, ()) if count is None else count
        self.row_start = ti.field(ti.i32, capacity + 1) if row_start is None else row_start
        self.column = ti.field(ti.i32, pair_capacity) if column is None else column
        self.real = real()
        self.value = ti.field(self.real, pair_capacity)
        self.diagonal = ti.field(self.real, capacity)
        self.inverse_diagonal = ti.Matrix.field(1, 1, self.real, capacity)

    @ti.func
    def set_diagonal(self, i, d):
        self.diagonal[i] = d
        self.inverse_diagonal[i][0, 0] = ti.select(d > 0, 1 / d, 0)

    @stage("apply")
    def apply(self, x: ti.template(), y: ti.template()):
        """y_i = sum_j A_ij x_j."""
        for i in range(first(self.count[None]), last(self.count[None])):
            s = self.diagonal[i] * x[i][0]
            for k in range(self.row_start[i], self.row_start[i + 1]):
                s += self.value[k] * x[self.column[k]][0]
            y[i][0] = s
        wait()
