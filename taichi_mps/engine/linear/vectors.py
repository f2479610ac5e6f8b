"""Vector operations of an iterative solver, which define how rows are summed and masked; a sparse matrix in compressed
rows (CSR); the Jacobi preconditioner."""

from ..runtime.backend import double_field, real, ti
from ..runtime.stages import loop_stage, stage
from ..runtime.sums import GPU_THREADS, sum_threads
from ..runtime.thread_team import first, last, leads, wait

ROWS_PER_BLOCK = 1024  # rows per partial sum: a dot product has the same bits with any number of threads


@ti.data_oriented
class Vectors:
    """Operations on vector fields of the first ``count`` of ``capacity`` rows, ``components`` numbers each.

    operator: ``inverse_diagonal``, a matrix field whose zero blocks mark the rows that are no unknowns.
    """

    def __init__(self, capacity: int, components: int, operator):
        self.capacity, self.components, self.operator = capacity, components, operator
        self.count, self.real = operator.count, real()
        self.partial, self.serial = double_field((capacity + ROWS_PER_BLOCK - 1) // ROWS_PER_BLOCK), sum_threads() == 1

    def field(self):
        """Make a vector field of this capacity."""
        return ti.Vector.field(self.components, self.real, self.capacity)

    @stage("dot")
    def dot(self, a: ti.template(), b: ti.template(), out: ti.template()):
        """out = (a, b): partial sums of ROWS_PER_BLOCK rows in f64, then their sum in order; on a GPU in any order."""
        if ti.static(self.serial):
            blocks = (self.count[None] + ROWS_PER_BLOCK - 1) // ROWS_PER_BLOCK
            for k in range(first(blocks), last(blocks)):
                s = ti.cast(0.0, ti.f64)
                for i in range(k * ROWS_PER_BLOCK, ti.min((k + 1) * ROWS_PER_BLOCK, self.count[None])):
                    s += ti.cast(a[i].dot(b[i]), ti.f64)
                self.partial[k] = s
            wait()
            if leads():
                s = ti.cast(0.0, ti.f64)
                for k in range(blocks):
                    s += self.partial[k]
                out[None] = s
            wait()
        else:
            out[None] = 0.0
            for thread in range(GPU_THREADS):
                s = ti.cast(0.0, ti.f64)
                for k in range((self.count[None] - thread + GPU_THREADS - 1) // GPU_THREADS):
                    s += ti.cast(a[thread + k * GPU_THREADS].dot(b[thread + k * GPU_THREADS]), ti.f64)
                out[None] += s

    @loop_stage("axpy")
    def axpy(self, alpha: ti.template(), p: ti.template(), x: ti.template(), q: ti.template(), r: ti.template()):
        """x <- x + alpha p and r <- r - alpha q; no change if alpha is 0, even where p or q are not finite."""
        n = self.count[None] if alpha[None] != 0.0 else 0
        for i in range(first(n), last(n)):
            step = ti.cast(alpha[None], self.real)
            x[i] += step * p[i]
            r[i] -= step * q[i]
        wait()

    @loop_stage("xpby")
    def xpby(self, z: ti.template(), beta: ti.template(), p: ti.template()):
        """p <- z + beta p."""
        for i in range(first(self.count[None]), last(self.count[None])):
            p[i] = z[i] + ti.cast(beta[None], self.real) * p[i]
        wait()

    @loop_stage("copy")
    def copy(self, a: ti.template(), b: ti.template()):
        """b <- a."""
        for i in range(first(self.count[None]), last(self.count[None])):
            b[i] = a[i]
        wait()

    @ti.func
    def masked(self, i, v):
        """Value v, or zero where row i is not an unknown."""
        return ti.select(ti.abs(self.operator.inverse_diagonal[i]).sum() > 0, v, ti.zero(v))


@ti.data_oriented
class SparseMatrix:
    """Scalar matrix in compressed rows: A_ii = diagonal[i] and A_ij = value[k], j = column[k], k in the row of i.

    ``row_start``, ``column`` and ``count`` are those of a neighbour list. Rows whose diagonal is not positive are no
    unknowns. To assemble it, fill ``value`` and call ``set_diagonal`` for every row.
    """

    def __init__(self, capacity: int, row_start, column, count):
        self.row_start, self.column, self.count = row_start, column, count
        self.value = ti.field(real(), column.shape[0])
        self.diagonal = ti.field(real(), capacity)
        self.inverse_diagonal = ti.Matrix.field(1, 1, real(), capacity)

    @ti.func
    def set_diagonal(self, i, d):
        """Set the diagonal element of row i to d, and its inverse."""
        self.diagonal[i] = d
        self.inverse_diagonal[i][0, 0] = ti.select(d > 0, 1 / d, 0)

    @loop_stage("apply")
    def multiply(self, x: ti.template(), y: ti.template()):
        """y_i = sum_j A_ij x_j."""
        for i in range(first(self.count[None]), last(self.count[None])):
            s = self.diagonal[i] * x[i][0]
            for k in range(self.row_start[i], self.row_start[i + 1]):
                s += self.value[k] * x[self.column[k]][0]
            y[i][0] = s
        wait()


@ti.data_oriented
class Jacobi:
    """Preconditioner M^-1 = D^-1, the inverse of the (block) diagonal: the cheapest for few rows."""

    def __init__(self, operator):
        self.operator = operator

    def build(self) -> None:
        """No-op: the operator keeps its diagonal."""

    @loop_stage("precondition")
    def apply(self, r: ti.template(), z: ti.template()):
        """z = D^-1 r."""
        for i in range(first(self.operator.count[None]), last(self.operator.count[None])):
            z[i] = self.operator.inverse_diagonal[i] @ r[i]
        wait()
