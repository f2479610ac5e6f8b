"""Coarse levels for an operator on particles that has no matrix: a multigrid cycle on grids of nodes.

Sources: Bramble, Pasciak and Xu, Parallel multilevel preconditioners, Mathematics of Computation 55 (1990), 1-22 (what
is added); Adams, Brezina, Hu and Tuminaro, Parallel multigrid smoothing: polynomial versus Gauss-Seidel, Journal of
Computational Physics 188 (2003), 593-610 (Chebyshev smoothing).
"""

from ..runtime.backend import real, ti
from ..runtime.stages import sequence, stage
from ..runtime.thread_team import first, last, wait
from .node_operators import NodeOperators

SWEEPS = 3  # degree of the Chebyshev polynomial; odd
LOWEST = 1.0 / 16.0  # share of the spectrum of D^-1 A below which the next grid corrects
LAST = 3  # times that the last grid, which has no next one, is smoothed after; odd


@ti.data_oriented
class NodeMultigrid(NodeOperators):
    """M^-1 = D^-1 + P_0 (w D_0^-1 + I C_1 I^T) P_0^T.

    P_0 is linear interpolation from the nodes of grid 0 to the particles, I from grid 1 to grid 0, and D_0 are the
    diagonal blocks of the operator on the nodes of grid 0. C_l is one V-cycle on grid l,

        x = s b;    x += I C_{l+1} I^T (b - A_l x);    x += s (b - A_l x)

    with a Chebyshev polynomial s in D_l^-1 A_l. The eigenvalues of D_l^-1 A_l are at most 2^d (node_operators.py), and
    the polynomial contracts up to there, so M is symmetric positive definite whatever the particles.

    operator: ``inverse_diagonal`` as for PCG (a zero block: no unknown), and the ti.func ``stiffness(i)``, which
    gives a_i = V mu, c_i = V (mu + lambda) of Lame's lambda, and the d x d matrix S_i of particle i.
    """

    PAY_FROM = 6000
    """Rows from which the levels pay. Measured on the slump cone, one thread, CPU milliseconds a step (iterations),
    Jacobi against levels: 500 Pa, 3,192 rows 30 (58), 32 (35); 100 Pa, 5,504 rows 59 (66), 59 (43). They also
    take seconds to compile."""

    fits_in_a_kernel = True

    def __init__(self, operator, bins):
        super().__init__(operator, bins)
        d = self.dimension
        self.weight = 2.0 / 2**d  # of grid 0
        most = min(bins.cells, bins.particles.capacity)  # cells that hold particles
        self.sums = ti.Matrix.field(2**d, self.lanes, real(), most)  # what the corners of each of them get
        self.b = ti.Vector.field(d, real(), self.nodes)  # right-hand side
        self.rest = ti.Vector.field(d, real(), self.nodes)  # what the next grid corrects: b - A x
        self.z = ti.Vector.field(d, real(), (2, self.nodes))  # x and the one before, in turn; at last in z[1]
        self.step, self.carry = (ti.field(real(), SWEEPS) for _ in range(2))
        highest = 2.0**d
        middle, half = 0.5 * highest * (1.0 + LOWEST), 0.5 * highest * (1.0 - LOWEST)
        rho = half / middle
        for k in range(SWEEPS):
            last, rho = rho, rho if k == 0 else 1.0 / (2.0 * middle / half - rho)
            self.step[k] = 1.0 / middle if k == 0 else 2.0 * rho / half
            self.carry[k] = 0.0 if k == 0 else rho * last

    @sequence("cycle")
    def cycle(self, r, z):
        """z = M^-1 r by one cycle."""
        self.collect(r)
        self.gather()
        for grid in range(1, self.grids):  # down: what the finer grid leaves, smoothed from zero
            self.restrict(grid)
            for k in range(1, SWEEPS):
                self.sweep(grid, k, (k + 1) % 2)
            self.leave(grid)
        for up in range(1, self.grids):
            grid = self.grids - up
            self.prolong(grid)
            for k in range(LAST * SWEEPS if grid == self.grids - 1 else SWEEPS):
                self.sweep(grid, k % SWEEPS, k % 2)
        self.correct_finest()
        self.correct(r, z)

    @stage("collect")
    def collect(self, r: ti.template()):
        """Restrict r of the particles to the corners of the cells that hold them."""
        for c in range(first(self.filled[None]), last(self.filled[None])):
            sums = ti.Matrix.zero(float, 2**self.dimension, self.lanes)
            for i in range(self.bins.cell_start[self.cells[c]], self.bins.cell_start[self.cells[c] + 1]):
                weights, own = self.corner_weights[i], r[i]
                for k, a in ti.static(ti.ndrange(2**self.dimension, self.dimension)):
                    sums[k, a] += weights[k] * own[a]
            self.sums[c] = sums
        wait()

    @stage("gather")
    def gather(self):
        """Sum the corner values of the cells around each node of grid 0."""
        for m in range(first(self.uses[0]), last(self.uses[0])):
            node, place = self.used[m], self.where[m]
            b = ti.Vector.zero(float, self.dimension)
            for k, corner in ti.static(enumerate(self.corners_of_a_cell)):
                cell = self.linear(place - ti.Vector(corner), ti.Vector(self.bins.shape))
                number = self.number[cell] if cell >= 0 else -1
                if number >= 0:
                    for a in ti.static(range(self.dimension)):
                        b[a] += self.sums[number][k, a]
            self.rest[node] = b
        wait()

    @stage("correct finest")
    def correct_finest(self):
        """Interpolate the correction from the nodes of grid 0 to the particles."""
        for m in range(first(self.uses[0]), last(self.uses[0])):
            node = self.used[m]
            self.z[1, node] = self.weight * self.inverse[node] @ self.rest[node] + self.coarser(m, 0)
        wait()

    @stage("correct")
    def correct(self, r: ti.template(), z: ti.template()):
        """Compute z of the particles in each cell: Jacobi, and the interpolated correction of grid 0."""
        for c in range(first(self.filled[None]), last(self.filled[None])):
            place = self.place(self.cells[c], ti.Vector(self.bins.shape))
            of_corners = ti.Matrix.zero(float, 2**self.dimension, self.lanes)
            for k, corner in ti.static(enumerate(self.corners_of_a_cell)):
                node = self.linear(place + ti.Vector(corner), self.corners)
                for a in ti.static(range(self.dimension)):
                    of_corners[k, a] = self.z[1, node][a]
            for i in range(self.bins.cell_start[self.cells[c]], self.bins.cell_start[self.cells[c] + 1]):
                D, weights = self.operator.inverse_diagonal[i], self.corner_weights[i]
                correction = ti.Vector.zero(float, self.dimension)
                for k, a in ti.static(ti.ndrange(2**self.dimension, self.dimension)):
                    correction[a] += weights[k] * of_corners[k, a]
                z[i] = D @ r[i] + (correction if ti.abs(D).sum() > 0 else 0.0 * correction)
        wait()

    @stage("restrict")
    def restrict(self, grid: ti.i32):
        """Restrict the residual of the finer grid to b of a grid, and set x after the first sweep from zero."""
        for m in range(first(self.uses[grid]), last(self.uses[grid])):
            node = self.used[self.first[grid] + m]
            row = self.start[grid] + m
            b = ti.Vector.zero(float, self.dimension)
            for k in range(self.points):
                fine = self.finer[row, k]
                if fine >= 0:
                    b += self.weights[grid, k] * self.rest[fine]
            self.b[node] = b
            self.z[0, node] = self.step[0] * self.inverse[node] @ b
            self.z[1, node] = ti.Vector.zero(float, self.dimension)
        wait()

    @ti.func
    def residual(self, grid, m, at):
        """b - A z[at] of the m-th node of a grid."""
        row = self.start[grid] + m
        total = ti.Vector.zero(float, self.lanes)
        for k in range(self.points):
            other = self.column[row, k]
            if other < 0:  # never: the way out (momentum.py says why)
                break
            z = self.z[at, other]
            for e, a in ti.static(ti.ndrange(self.dimension, self.lanes)):
                total[a] += self.stencil[row, k][e, a] * z[e]
        rest = self.b[self.used[self.first[grid] + m]]
        for a in ti.static(range(self.dimension)):
            rest[a] -= total[a]
        return rest

    @stage("sweep")
    def sweep(self, grid: ti.i32, k: ti.i32, at: ti.i32):
        """Step k of the Chebyshev polynomial, from z[at] and the one before, which the result replaces."""
        for m in range(first(self.uses[grid]), last(self.uses[grid])):
            node = self.used[self.first[grid] + m]
            x, before = self.z[at, node], self.z[1 - at, node]
            change = self.carry[k] * (x - before) + self.step[k] * self.inverse[node] @ self.residual(grid, m, at)
            self.z[1 - at, node] = x + change
        wait()

    @stage("leave")
    def leave(self, grid: ti.i32):
        """Restrict the residual of a grid to the next coarser one."""
        for m in range(first(self.uses[grid]), last(self.uses[grid])):
            self.rest[self.used[self.first[grid] + m]] = self.residual(grid, m, 0)
        wait()

    @stage("prolong")
    def prolong(self, grid: ti.i32):
        """Add the correction of the next coarser grid."""
        for m in range(first(self.uses[grid]), last(self.uses[grid])):
            node = self.used[self.first[grid] + m]
            self.z[0, node] += self.coarser(m, grid)
        wait()

    @ti.func
    def coarser(self, m, grid):
        """Correction of the next coarser grid, interpolated to the m-th node of a grid."""
        z = ti.Vector.zero(float, self.dimension)
        if grid + 1 < self.grids:
            place, rest = self.parents(self.where[self.first[grid] + m], grid)
            for corner in ti.static(self.corners_of_a_cell):
                number, weight = self.parent(place, rest, ti.Vector(corner), grid)
                if weight > 0.0 and self.active[number] > 0:
                    z += weight * self.z[1, number]
        return z
