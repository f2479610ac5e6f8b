"""Linear systems of known solution, the solver on them, and the ways to launch its stages."""

from types import SimpleNamespace

import numpy as np
import scipy.sparse as sp

import taichi_mps as mps
from taichi_mps.engine.linear.node_multigrid import NodeMultigrid
from taichi_mps.engine.linear.pcg import HUGE, PCG, STATUS
from taichi_mps.engine.linear.vectors import SparseMatrix
from taichi_mps.engine.particles.neighbors import Bins, NeighborList
from taichi_mps.engine.particles.particles import Particles
from taichi_mps.engine.runtime.backend import constant_fields, real, ti
from taichi_mps.engine.runtime.stages import Execution, stage
from taichi_mps.engine.runtime.thread_team import first, last, wait

FUSED = {"rows": 1}  # all stages of a solve are one kernel of one thread
LAUNCHED = {"rows": 1 << 30}  # a kernel for each part of it, in which a team of threads works, or one alone


@ti.data_oriented
class BlockOperator:
    """Dense matrix of n x n blocks; the rows in ``masked`` are not unknowns."""

    def __init__(self, dense, components, masked=()):
        self.components, self.rows = components, len(dense) // components
        all_rows = range(self.rows)
        inverse = np.linalg.inv(dense.reshape(2 * (self.rows, components))[all_rows, :, all_rows])
        inverse[list(masked)] = 0.0
        (self.dense,) = constant_fields(dense)
        self.inverse_diagonal = ti.Matrix.field(components, components, real(), self.rows)
        self.inverse_diagonal.from_numpy(inverse)
        self.count = ti.field(ti.i32, ())
        self.count[None] = self.rows

    @stage("apply")
    def multiply(self, x: ti.template(), y: ti.template()):
        for i in range(first(self.count[None]), last(self.count[None])):
            for a in ti.static(range(self.components)):
                s = ti.cast(0.0, ti.f64)
                for j in range(self.count[None]):
                    for b in ti.static(range(self.components)):
                        s += self.dense[i * self.components + a, j * self.components + b] * x[j][b]
                y[i][a] = s if ti.abs(self.inverse_diagonal[i]).sum() > 0 else 0.0
        wait()


def spd(n, seed=0):
    """A dense symmetric positive definite matrix."""
    m = np.random.default_rng(seed).standard_normal((n, n))
    return m @ m.T + 0.5 * n * np.eye(n)


def sparse_matrix(matrix, capacity=None):
    """A SparseMatrix with the entries of a SciPy matrix."""
    rows, diagonal = matrix.shape[0], matrix.diagonal()
    capacity, pairs = capacity or rows, (matrix - sp.diags(diagonal)).tocsr()
    lists = constant_fields(np.pad(pairs.indptr, (0, capacity - rows), mode="edge"), pairs.indices)
    a = SparseMatrix(capacity, *lists, ti.field(ti.i32, ()))
    a.count[None] = rows
    a.value.from_numpy(pairs.data)
    set_diagonal(a, np.ascontiguousarray(diagonal, float))
    return a


@ti.kernel
def set_diagonal(a: ti.template(), diagonal: ti.types.ndarray(ti.f64, 1)):
    for i in range(diagonal.shape[0]):
        a.set_diagonal(i, ti.cast(diagonal[i], float))


def solve(operator, b, components=1, tolerance=1e-10, x=0.0, preconditioner=None, launch=None, **options):
    """(x, report) of A x = b; an operator keeps one solver for each preconditioner, which is compiled once. The report:
    ``status``, whether ``converged``, ``iterations`` and ``residual``, sqrt((r, z)/reference) at the end. Options:
    limit, most, again, reduction, enough of PCG.solve."""
    capacity = operator.inverse_diagonal.shape[0]
    launch = launch or FUSED
    solvers = operator.__dict__.setdefault("solvers", {})
    key = preconditioner, *launch.values()
    if key not in solvers:
        solvers[key] = PCG(capacity, components, operator, preconditioner), Execution(**launch)
    solver, execution = solvers[key]
    for field, values in ((solver.b, b), (solver.x, np.broadcast_to(x, b.size))):
        padded = np.pad(values, (0, capacity * components - b.size))
        field.from_numpy(padded.reshape(capacity, components))
    given = {"limit": 1000, "most": HUGE, "again": 0, "reduction": 1.0, "enough": 0.0} | options
    solver.max_reference[None] = given.pop("most")
    with execution.active():
        solver.solve(tolerance, *given.values())
    status, iterations = STATUS[solver.status[None]], solver.iterations[None]
    residual = np.sqrt(abs(solver.rz[None]) / (abs(solver.reference[None]) or 1.0))
    report = SimpleNamespace(status=status, converged=status == "converged", iterations=iterations, residual=residual)
    return solver.x.to_numpy().ravel()[: b.size], report


def applied(product, vectors, components=1):
    """Product A v of an operator, or M^-1 v of a preconditioner, for each row of ``vectors``."""
    r, z = (ti.Vector.field(components, real(), vectors.shape[1] // components) for _ in range(2))
    result = []
    for v in vectors:
        r.from_numpy(v.reshape(-1, components))
        product(r, z)
        result.append(z.to_numpy().ravel())
    return np.array(result)


# ---- an operator on particles -----------------------------------------------------------------------------------
SPACING, REACH = 1.0, 2.1


@ti.data_oriented
class Springs:
    """sum over neighbours of n n.(u_i - u_j), n the direction of r_ij, + mass u_i; the particles are on no lattice.

    With the gradient G of u, 1/2 sum_j (r G r)^2/r^2; over all directions that is an elastic body with mu = lambda:
    mu V = 1/16 sum_j r^2.
    """

    def __init__(self, across, periodic=False, x=None):
        """``across`` particles along each side, or those at ``x`` (n, 2), in a box of that size."""
        if x is None:
            x = mps.lattice((0.0, 0.0), (across, across), SPACING)
            x = x + np.random.default_rng(0).uniform(-0.2, 0.2, x.shape)
        self.particles = Particles({"x": x}, np.ones(len(x)), {})
        room = 0.0 if periodic else REACH
        self.bins = Bins(self.particles, ((-room, -room), (across + room, across + room)), (periodic, False), REACH)
        self.neighbors = NeighborList(self.bins, 20 * len(x))
        self.count = self.particles.count
        self.mass = ti.field(real(), ())
        self.mass[None] = 4.0 / across**2  # as weak for any size, on the scale of the whole
        self.inverse_diagonal = ti.Matrix.field(2, 2, real(), len(x))
        self.shear = sum(i * i + j * j for i in range(-2, 3) for j in range(-2, 3) if i * i + j * j < REACH**2) / 16.0
        self.neighbors.search()
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

    @stage("apply")
    def multiply(self, u: ti.template(), y: ti.template()):
        for i in range(first(self.count[None]), last(self.count[None])):
            s = self.mass[None] * u[i]
            for k in range(self.neighbors.row_start[i], self.neighbors.row_start[i + 1]):
                j = self.neighbors.column[k]
                s += self.spring(i, j) @ (u[i] - u[j])
            y[i] = s * ti.cast(ti.abs(self.inverse_diagonal[i]).sum() > 0, float)
        wait()

    @ti.func
    def stiffness(self, i):
        shear = ti.cast(self.shear, float)
        return shear, 2.0 * shear, self.mass[None] * ti.Matrix.identity(float, 2)


class Nodes(NodeMultigrid):
    """Grids of nodes for however few rows."""

    MIN_ROWS = 0
