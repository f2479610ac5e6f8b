"""Multigrid preconditioner for an operator on particles that has no matrix: a cycle on grids of nodes.

Sources: Bramble, Pasciak and Xu, Parallel multilevel preconditioners, Mathematics of Computation 55 (1990), 1-22 (what
is added); Adams, Brezina, Hu and Tuminaro, Parallel multigrid smoothing: polynomial versus Gauss-Seidel, Journal of
Computational Physics 188 (2003), 593-610 (Chebyshev smoothing).
"""

from ..runtime.backend import compiled_now, for_kernels, real, ti
from ..runtime.stages import block_stage, flush, loop_stage, sequence
from ..runtime.thread_team import first, last, wait
from .node_operators import NodeOperators
from .vectors import Jacobi

CHEBYSHEV_DEGREE = 3  # degree of the polynomial of the smoother; odd
LOWEST_SMOOTHED = 1.0 / 16.0  # fraction of the largest eigenvalue of D^-1 A down to which the smoother acts
LAST_GRID_CYCLES = 3  # repetitions of the smoother on the coarsest grid; odd


@ti.data_oriented
class NodeMultigrid(NodeOperators):
    """Preconditioner M^-1 = D^-1 + P_0 (w D_0^-1 + I C_1 I^T) P_0^T.

    P_0 is linear interpolation from the nodes of grid 0 to the particles, I from grid 1 to grid 0, and D_0 are the
    diagonal blocks of the operator on the nodes of grid 0. C_l is one V-cycle on grid l,

        x = s b;    x += I C_{l+1} I^T (b - A_l x);    x += s (b - A_l x)

    with a Chebyshev polynomial s in D_l^-1 A_l. The eigenvalues of D_l^-1 A_l are at most 2^d (node_operators.py), and
    the polynomial contracts up to there, so M is symmetric positive definite whatever the particles.

    The operator has ``inverse_diagonal`` as for PCG (a zero block: no unknown), and the ti.func ``stiffness(i)``, which
    gives a_i = V mu, c_i = V (mu + lambda) with Lame's lambda, and the d x d matrix S_i of particle i.
    """

    MIN_ROWS = 6000
    """Number of rows from which on the levels cost less than Jacobi. Measured on the slump cone, one thread, CPU
    milliseconds a step (iterations), Jacobi against levels: 500 Pa, 3,192 rows 30 (58), 32 (35); 100 Pa, 5,504 rows 59
    (66), 59 (43). They also take seconds to compile."""

    def __init__(self, operator, bins):
        super().__init__(operator, bins)
        self.jacobi = Jacobi(operator)  # for fewer than MIN_ROWS rows
        self.uses_levels = ti.field(ti.i32, ())  # 1 if there are MIN_ROWS rows or more
        self.built = False  # the same, for Python
        d = self.dimension
        self.weight = 2.0 / 2**d  # w, of grid 0
        most = min(bins.cells, bins.particles.capacity)  # largest number of cells that hold particles
        self.corner_sums = ti.Matrix.field(2**d, self.lanes, real(), most)  # sums at the corners of these cells
        self.b = ti.Vector.field(d, real(), self.nodes)  # right-hand side
        self.defect = ti.Vector.field(d, real(), self.nodes)  # b - A x, restricted to the next grid
        self.z = ti.Vector.field(d, real(), (2, self.nodes))  # x and its last value, alternating; the result in z[1]
        self.chebyshev_step, self.chebyshev_carry = (ti.field(real(), CHEBYSHEV_DEGREE) for _ in range(2))
        highest = 2.0**d
        middle, half = 0.5 * highest * (1.0 + LOWEST_SMOOTHED), 0.5 * highest * (1.0 - LOWEST_SMOOTHED)
        rho = half / middle
        for k in range(CHEBYSHEV_DEGREE):
            last, rho = rho, rho if k == 0 else 1.0 / (2.0 * middle / half - rho)
            self.chebyshev_step[k] = 1.0 / middle if k == 0 else 2.0 * rho / half
            self.chebyshev_carry[k] = 0.0 if k == 0 else rho * last

    def build(self) -> None:
        """Build the levels for the present operator if it has MIN_ROWS rows or more."""
        flush()
        self.built = bool(self.operator.count[None] >= self.MIN_ROWS)
        self.uses_levels[None] = int(self.built)
        if self.built:
            self.build_levels()

    @for_kernels
    def has_levels(self):
        """Whether the levels are used: for kernels the field, which Python need not read."""
        return self._has_levels() if compiled_now() else self.built

    @ti.func
    def _has_levels(self):
        return self.uses_levels[None] == 1

    @sequence("cycle")
    def apply(self, r, z):
        """z = M^-1 r."""
        if self.has_levels():
            self.cycle(r, z)
        else:
            self.jacobi.apply(r, z)

    @sequence("cycle")
    def cycle(self, r, z):
        """z = M^-1 r by one cycle."""
        self.restrict_to_corners(r)
        self.sum_corners()
        if ti.static(self.first_small > 1):
            self.descend(1, self.first_small)
        self.cycle_small()
        if ti.static(self.first_small > 1):
            self.ascend(1, self.first_small)
        self.correct_nodes()
        self.correct_particles(r, z)

    @block_stage("cycle")
    def cycle_small(self):
        """Go down and up through the small grids."""
        self.descend(self.first_small, self.grids)
        self.ascend(self.first_small, self.grids)

    @sequence("down")
    def descend(self, begin: ti.template(), end: ti.template()):
        """Go down from grid to grid, each with the defect of the finer one, smoothed from zero."""
        for grid in range(begin, end):
            self.restrict(grid)
            for k in range(1, CHEBYSHEV_DEGREE):
                self.sweep(grid, k, (k + 1) % 2)
            self.store_defect(grid)

    @sequence("up")
    def ascend(self, begin: ti.template(), end: ti.template()):
        """Go up from grid to grid, each with the correction of the coarser one."""
        for up in range(begin, end):
            grid = begin + end - 1 - up
            self.prolong(grid)
            for k in range(LAST_GRID_CYCLES * CHEBYSHEV_DEGREE if grid == self.grids - 1 else CHEBYSHEV_DEGREE):
                self.sweep(grid, k % CHEBYSHEV_DEGREE, k % 2)

    @loop_stage("collect")
    def restrict_to_corners(self, r: ti.template()):
        """Restrict the residual r of the particles to the corners of the cells that hold them."""
        for c in range(first(self.filled_count[None]), last(self.filled_count[None])):
            sums = ti.Matrix.zero(float, 2**self.dimension, self.lanes)
            for i in range(self.bins.cell_start[self.filled_cells[c]], self.bins.cell_start[self.filled_cells[c] + 1]):
                weights, residual = self.corner_weights[i], r[i]
                for k, a in ti.static(ti.ndrange(2**self.dimension, self.dimension)):
                    sums[k, a] += weights[k] * residual[a]
            self.corner_sums[c] = sums
        wait()

    @loop_stage("gather")
    def sum_corners(self):
        """Sum the corner values of the cells around each node of grid 0."""
        for m in range(first(self.active_count[0]), last(self.active_count[0])):
            node, index = self.active_nodes[m], self.node_index[m]
            b = ti.Vector.zero(float, self.dimension)
            for k, corner in ti.static(enumerate(self.corners_of_a_cell)):
                cell = self.linear_index(index - ti.Vector(corner), ti.Vector(self.bins.shape))
                number = self.filled_number[cell] if cell >= 0 else -1
                if number >= 0:
                    for a in ti.static(range(self.dimension)):
                        b[a] += self.corner_sums[number][k, a]
            self.defect[node] = b
        wait()

    @loop_stage("correct finest")
    def correct_nodes(self):
        """Compute the correction at the nodes of grid 0: w D_0^-1, and the interpolated correction of grid 1."""
        for m in range(first(self.active_count[0]), last(self.active_count[0])):
            node = self.active_nodes[m]
            self.z[1, node] = self.weight * self.inverse[node] @ self.defect[node] + self.coarse_correction(m, 0)
        wait()

    @loop_stage("correct")
    def correct_particles(self, r: ti.template(), z: ti.template()):
        """Compute z of the particles: Jacobi, and the interpolated correction of grid 0."""
        for c in range(first(self.filled_count[None]), last(self.filled_count[None])):
            cell_index = self.coordinates(self.filled_cells[c], ti.Vector(self.bins.shape))
            corner_values = ti.Matrix.zero(float, 2**self.dimension, self.lanes)
            for k, corner in ti.static(enumerate(self.corners_of_a_cell)):
                node = self.linear_index(cell_index + ti.Vector(corner), self.corners)
                for a in ti.static(range(self.dimension)):
                    corner_values[k, a] = self.z[1, node][a]
            for i in range(self.bins.cell_start[self.filled_cells[c]], self.bins.cell_start[self.filled_cells[c] + 1]):
                D, weights = self.operator.inverse_diagonal[i], self.corner_weights[i]
                correction = ti.Vector.zero(float, self.dimension)
                for k, a in ti.static(ti.ndrange(2**self.dimension, self.dimension)):
                    correction[a] += weights[k] * corner_values[k, a]
                z[i] = D @ r[i] + (correction if ti.abs(D).sum() > 0 else 0.0 * correction)
        wait()

    @loop_stage("restrict")
    def restrict(self, grid: ti.i32):
        """Restrict the defect of the finer grid to b of a grid, and set x after the first sweep from zero."""
        for m in range(first(self.active_count[grid]), last(self.active_count[grid])):
            node = self.active_nodes[self.first_node[grid] + m]
            row = self.first_row[grid] + m
            b = ti.Vector.zero(float, self.dimension)
            for k in range(self.stencil_points):
                fine = self.finer[row, k]
                if fine >= 0:
                    b += self.weights[grid, k] * self.defect[fine]
            self.b[node] = b
            self.z[0, node] = self.chebyshev_step[0] * self.inverse[node] @ b
            self.z[1, node] = ti.Vector.zero(float, self.dimension)
        wait()

    @ti.func
    def residual(self, grid, m, at):
        """b - A z[at] of the m-th node of a grid."""
        row = self.first_row[grid] + m
        total = ti.Vector.zero(float, self.lanes)
        for k in range(self.stencil_points):
            other = self.column[row, k]
            if other < 0:  # never: a way out lets LLVM use vector instructions (particles/pair_sums.py)
                break
            z = self.z[at, other]
            for e, a in ti.static(ti.ndrange(self.dimension, self.lanes)):
                total[a] += self.stencil[row, k][e, a] * z[e]
        residual = self.b[self.active_nodes[self.first_node[grid] + m]]
        for a in ti.static(range(self.dimension)):
            residual[a] -= total[a]
        return residual

    @loop_stage("sweep")
    def sweep(self, grid: ti.i32, k: ti.i32, at: ti.i32):
        """Do step k of the Chebyshev iteration, from z[at] and the value before, which the result replaces."""
        for m in range(first(self.active_count[grid]), last(self.active_count[grid])):
            node = self.active_nodes[self.first_node[grid] + m]
            x, previous = self.z[at, node], self.z[1 - at, node]
            change = self.chebyshev_carry[k] * (x - previous) + self.chebyshev_step[k] * self.inverse[
                node
            ] @ self.residual(grid, m, at)
            self.z[1 - at, node] = x + change
        wait()

    @loop_stage("leave")
    def store_defect(self, grid: ti.i32):
        """Store the defect b - A x of a grid, for the next coarser one."""
        for m in range(first(self.active_count[grid]), last(self.active_count[grid])):
            self.defect[self.active_nodes[self.first_node[grid] + m]] = self.residual(grid, m, 0)
        wait()

    @loop_stage("prolong")
    def prolong(self, grid: ti.i32):
        """Add the correction of the next coarser grid."""
        for m in range(first(self.active_count[grid]), last(self.active_count[grid])):
            self.z[0, self.active_nodes[self.first_node[grid] + m]] += self.coarse_correction(m, grid)
        wait()

    @ti.func
    def coarse_correction(self, m, grid):
        """Correction of the next coarser grid, interpolated to the m-th node of a grid."""
        z = ti.Vector.zero(float, self.dimension)
        if grid + 1 < self.grids:
            parent, remainder = self.first_parent(self.node_index[self.first_node[grid] + m], grid)
            for corner in ti.static(self.corners_of_a_cell):
                number, weight = self.parent_and_weight(parent, remainder, ti.Vector(corner), grid)
                if weight > 0.0 and self.active[number] > 0:
                    z += weight * self.z[1, number]
        return z
