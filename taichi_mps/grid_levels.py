"""Coarse levels for an operator on particles that has no matrix: a multigrid cycle on grids of nodes.

Sources: Bramble, Pasciak and Xu, Parallel multilevel preconditioners, Mathematics of Computation 55 (1990), 1-22 (what
is added); Adams, Brezina, Hu and Tuminaro, Parallel multigrid smoothing: polynomial versus Gauss-Seidel, Journal of
Computational Physics 188 (2003), 593-610 (Chebyshev smoothing).
"""

from itertools import product

import numpy as np

from .backend import real, ti
from .node_grids import NodeGrids
from .team import WHOLE

SWEEPS = 3  # degree of the Chebyshev polynomial; odd
LOWEST = 1.0 / 16.0  # share of the spectrum of D^-1 A below which the next grid corrects
LAST = 3  # times that the last grid, which has no next one, is smoothed after; odd


@ti.data_oriented
class GridLevels(NodeGrids):
    """M^-1 = D^-1 + P_0 (w D_0^-1 + I C_1 I^T) P_0^T.

    P_0 is linear interpolation from the nodes of grid 0 to the particles, I from grid 1 to grid 0, and D_0 are the
    diagonal blocks of the operator on the nodes of grid 0. C_l is one V-cycle on grid l,

        x = s b;    x += I C_{l+1} I^T (b - A_l x);    x += s (b - A_l x)

    with a Chebyshev polynomial s in D_l^-1 A_l. A_l is the operator on the shape functions f of the nodes of grid l, a
    stencil of 3^d blocks; that of nodes n and m is

        sum_i a_i (grad f_n . grad f_m I + grad f_m (x) grad f_n) + (c_i - a_i) grad f_n (x) grad f_m + f_n f_m S_i

    summed over the cells of grid l - 1, each of which stands for its particles with the sums of their a, c and S at
    the centre of a: the operator of an elastic body. Each cell gives 2^d nodes a part of A_l that is positive, so the
    eigenvalues of D_l^-1 A_l are at most 2^d. The polynomial contracts up to there, so M is symmetric positive definite
    whatever the particles.

    operator: ``inverse_diagonal`` as for MRPCG (a zero block: no unknown), and the ti.func ``stiffness(i)``, which
    gives a_i = V mu, c_i = V (mu + lambda) of Lame's lambda, and the d x d matrix S_i of particle i.
    """

    PAY_FROM = 6000
    """Rows from which the levels pay. Measured on the slump cone, one thread, CPU milliseconds a step (iterations),
    Jacobi against levels: 500 Pa, 3,192 rows 30 (58), 32 (35); 100 Pa, 5,504 rows 59 (66), 59 (43). They also
    take seconds to compile."""

    SPREAD_FROM = 50_000
    """Rows from which grid 1 is work for several threads."""

    def __init__(self, operator, bins):
        super().__init__(operator, bins)
        d = self.dimension
        self.points = 3**d
        self.weight = 2.0 / 2**d  # of grid 0
        # first grid that one thread works on: grid 1 has about a row for 30 particles
        self.serial = 2 if self.grids > 1 and bins.particles.capacity >= self.SPREAD_FROM else 1
        self.a, self.c = (ti.field(real(), self.nodes) for _ in range(2))  # of the cell above each node [times m2]
        self.S = ti.Matrix.field(d, d, real(), self.nodes)
        self.centre = ti.Vector.field(d, real(), self.nodes)  # of a in the cell, 0 to 1 [-]
        self.lanes = 4 if d == 3 else d  # LLVM makes vector instructions of four numbers
        self.stencil = ti.Matrix.field(d, self.lanes, real(), (self.rows, self.points))  # transposed blocks of A_l
        self.column = ti.field(ti.i32, (self.rows, self.points))  # node at each stencil point, -1: none
        self.inverse = ti.Matrix.field(d, d, real(), self.nodes)  # D_l^-1
        self.finer = ti.field(ti.i32, (self.rows, self.points))  # node of the finer grid at each offset, -1: none
        self.weights = ti.field(real(), (self.grids, self.points))  # its share there
        most = min(bins.cells, bins.particles.capacity)  # cells that hold particles
        self.sums = ti.Matrix.field(2**d, self.lanes, real(), most)  # what the corners of each of them get
        self.b = ti.Vector.field(d, real(), self.nodes)  # right-hand side
        self.rest = ti.Vector.field(d, real(), self.nodes)  # what the next grid corrects: b - A x
        self.z = ti.Vector.field(d, real(), (2, self.nodes))  # x and the one before, in turn; at last in z[1]
        ratio = self.ratio.to_numpy()[:, None]
        apart = np.abs(np.array(list(product((-1, 0, 1), repeat=d))))
        self.weights.from_numpy(np.maximum(0, ratio - apart).prod(2) * (1.0 / ratio.prod(2)))
        self.step, self.carry = (ti.field(real(), SWEEPS) for _ in range(2))
        highest = 2.0**d
        middle, half = 0.5 * highest * (1.0 + LOWEST), 0.5 * highest * (1.0 - LOWEST)
        rho = half / middle
        for k in range(SWEEPS):
            last, rho = rho, rho if k == 0 else 1.0 / (2.0 * middle / half - rho)
            self.step[k] = 1.0 / middle if k == 0 else 2.0 * rho / half
            self.carry[k] = 0.0 if k == 0 else rho * last

    # ---- operators ------------------------------------------------------------------------------------------
    def build(self) -> None:
        """Operators of all grids for the particles' operator as it is now."""
        self.locate()
        self._assemble_finest()
        for grid in range(1, self.grids):
            self._lump(grid - 1)
            self._assemble(grid)

    @ti.func
    def invert(self, node, D):
        self.inverse[node] = ti.Matrix.zero(float, self.dimension, self.dimension)
        size = D.trace()
        if size > 1e-30:  # a node that the particles only just touch must not blow up, nor its determinant underflow
            scaled = D / size + 1e-4 * ti.Matrix.identity(float, self.dimension)
            self.inverse[node] = scaled.inverse() / size

    @ti.kernel
    def _assemble_finest(self):
        """Diagonal blocks of grid 0."""
        for m in range(self.uses[0]):
            node, place = self.used[m], self.where[m]
            I = ti.Matrix.identity(float, self.dimension)  # noqa: E741
            D = 0.0 * I
            for corner in ti.grouped(ti.ndrange(*((0, 2),) * self.dimension)):
                cell = self.linear(place - corner, ti.Vector(self.bins.shape))
                if cell >= 0:
                    for i in range(self.bins.cell_start[cell], self.bins.cell_start[cell + 1]):
                        value, slope = self.shape_function(corner, self.fraction[i], 0)
                        a_i, c_i, S_i = self.operator.stiffness(i)
                        D += a_i * slope.dot(slope) * I + c_i * slope.outer_product(slope) + value * value * S_i
            self.invert(node, D)

    @ti.func
    def shape_function(self, corner, fraction, grid):
        """Value, and gradient [1/m], of the shape function of the node at a corner of a cell between the nodes."""
        value, slope = ti.cast(1.0, float), ti.Vector.one(float, self.dimension)
        for a in ti.static(range(self.dimension)):
            width = ti.cast(self.bins.cell_size[a] * self.stride[grid][a], float)
            share = ti.abs(1.0 - corner[a] - fraction[a])
            value *= share
            for e in ti.static(range(self.dimension)):
                slope[e] *= ti.select(corner[a] == 1, 1.0, -1.0) / width if e == a else share
        return value, slope

    @ti.func
    def clear(self, row, place, grid):
        """Neighbours of the node of a row on its grid and on the finer one, -1 where there is none, and zero blocks."""
        for k in range(self.points):
            self.stencil[row, k] = ti.Matrix.zero(float, self.dimension, self.lanes)
            self.column[row, k] = self.neighbour(place + self.offset(k), grid)
            fine = self.neighbour(self.ratio[grid] * place + self.offset(k), grid - 1)
            self.finer[row, k] = fine if self.weights[grid, k] > 0.0 else -1

    @ti.func
    def close(self, row, grid):
        """Where there is no neighbour a zero block of any node: sums over the stencil need not ask."""
        for k in range(self.points):
            if self.column[row, k] < 0:
                self.stencil[row, k] = ti.Matrix.zero(float, self.dimension, self.lanes)
                self.column[row, k] = self.first[grid]

    @ti.func
    def offset(self, k):
        """Stencil point k, -1 to 1 along each axis."""
        return self.place(k, 3 * ti.Vector.one(ti.i32, self.dimension)) - 1

    @ti.func
    def point(self, offset):
        """Number of the stencil point at an offset."""
        k = 0
        for a in ti.static(range(self.dimension)):
            k = 3 * k + offset[a] + 1
        return k

    @ti.kernel
    def _lump(self, grid: ti.i32):
        """Sums of a, c and S over the cells above the nodes of a grid, and where their a is."""
        for m in range(self.uses[grid]):
            node, place = self.used[self.first[grid] + m], self.where[self.first[grid] + m]
            S = ti.Matrix.zero(float, self.dimension, self.dimension)
            shear, bulk, moment = ti.cast(0.0, float), ti.cast(0.0, float), ti.Vector.zero(float, self.dimension)
            if grid == 0:
                cell = self.linear(place, ti.Vector(self.bins.shape))
                if cell >= 0:
                    for i in range(self.bins.cell_start[cell], self.bins.cell_start[cell + 1]):
                        a_i, c_i, S_i = self.operator.stiffness(i)
                        shear, bulk, S, moment = shear + a_i, bulk + c_i, S + S_i, moment + a_i * self.fraction[i]
            else:
                for corner in ti.grouped(ti.ndrange(*((0, 2),) * self.dimension)):
                    inner = self.neighbour(self.ratio[grid] * place + corner, grid - 1)
                    if (corner < self.ratio[grid]).all() and inner >= 0:
                        shear, bulk, S = shear + self.a[inner], bulk + self.c[inner], S + self.S[inner]
                        moment += self.a[inner] * (self.centre[inner] + corner) / self.ratio[grid]
            self.a[node], self.c[node], self.S[node] = shear, bulk, S
            self.centre[node] = moment / shear if shear > 0.0 else 0.5 + 0.0 * moment

    @ti.kernel
    def _assemble(self, grid: ti.i32):
        """Stencils of a grid, from the sums over the cells of the finer one."""
        for m in range(self.uses[grid]):
            node, row = self.used[self.first[grid] + m], self.start[grid] + m
            place = self.where[self.first[grid] + m]
            self.clear(row, place, grid)
            D = ti.Matrix.zero(float, self.dimension, self.dimension)
            ratio = self.ratio[grid]
            for offset in ti.grouped(ti.ndrange(*((-2, 2),) * self.dimension)):
                at, cell = ratio * place + offset, -1
                if (offset >= -ratio).all() and (offset < ratio).all():
                    cell = self.neighbour(at, grid - 1)
                if cell >= 0 and self.c[cell] > 0.0:
                    corner = place - (at >> (ratio - 1))  # of the node in its cell
                    fraction = (self.centre[cell] + (at & (ratio - 1))) / ratio
                    value, slope = self.shape_function(corner, fraction, grid)
                    shear, rest, S = self.a[cell], self.c[cell] - self.a[cell], value * self.S[cell]
                    for other in ti.grouped(ti.ndrange(*((0, 2),) * self.dimension)):
                        v, s = self.shape_function(other, fraction, grid)
                        k, level = self.point(other - corner), shear * slope.dot(s)
                        for e, a in ti.static(ti.ndrange(self.dimension, self.dimension)):
                            block = shear * s[a] * slope[e] + rest * slope[a] * s[e] + v * S[a, e]
                            self.stencil[row, k][e, a] += block + level if ti.static(a == e) else block
            for e, a in ti.static(ti.ndrange(self.dimension, self.dimension)):
                D[a, e] = self.stencil[row, self.points // 2][e, a]
            self.close(row, grid)
            self.invert(node, D)

    # ---- the cycle ------------------------------------------------------------------------------------------
    @ti.kernel
    def cycle(self, r: ti.template(), z: ti.template()):
        """z = M^-1 r."""
        self.part_of_cycle(r, z, WHOLE, 0)

    @ti.func
    def part_of_cycle(self, r: ti.template(), z: ti.template(), team: ti.template(), member):
        """What a member of a team does of it."""
        for c in range(team.first(member, self.filled[None]), team.last(member, self.filled[None])):
            self.collect_residual(c, r)
        team.wait()
        for m in range(team.first(member, self.uses[0]), team.last(member, self.uses[0])):
            self.gather(m)
        team.wait()
        if ti.static(team.together):
            self.correct_by(1, team, member)
        else:
            if ti.static(self.serial > 1):
                for m in range(self.uses[1]):
                    self.restrict(1, m)
                for k in ti.static(range(1, SWEEPS)):
                    for m in range(self.uses[1]):
                        self.sweep(1, m, k, (k + 1) % 2)
                for m in range(self.uses[1]):
                    self.leave(1, m)
            ti.loop_config(serialize=True)
            for _ in range(1):  # few nodes: to wake the other threads for each loop would take longer
                self.correct_by(self.serial, team, member)
            if ti.static(self.serial > 1):
                for m in range(self.uses[1]):
                    self.prolong(1, m)
                for k in ti.static(range(SWEEPS)):
                    for m in range(self.uses[1]):
                        self.sweep(1, m, k, k % 2)
        for m in range(team.first(member, self.uses[0]), team.last(member, self.uses[0])):
            node = self.used[m]
            self.z[1, node] = self.weight * self.inverse[node] @ self.rest[node] + self.coarser(m, 0)
        team.wait()
        for c in range(team.first(member, self.filled[None]), team.last(member, self.filled[None])):
            self.correct(c, r, z)
        team.wait()

    @ti.func
    def correct_by(self, highest, team: ti.template(), member):
        """The V-cycle on the grids from this one on."""
        for grid in range(highest, self.grids):
            first, last = team.first(member, self.uses[grid]), team.last(member, self.uses[grid])
            for m in range(first, last):
                self.restrict(grid, m)
            team.wait()
            for k in range(1, SWEEPS):
                for m in range(first, last):
                    self.sweep(grid, m, k, (k + 1) % 2)
                team.wait()
            for m in range(first, last):
                self.leave(grid, m)
            team.wait()
        for up in range(highest, self.grids):
            grid = self.grids - 1 + highest - up
            first, last = team.first(member, self.uses[grid]), team.last(member, self.uses[grid])
            for m in range(first, last):
                self.prolong(grid, m)
            team.wait()
            for k in range(LAST * SWEEPS if grid == self.grids - 1 else SWEEPS):
                for m in range(first, last):
                    self.sweep(grid, m, k % SWEEPS, k % 2)
                team.wait()

    @ti.func
    def gather(self, m):
        """What the m-th node of grid 0 gets of its cells."""
        node, place = self.used[m], self.where[m]
        b = ti.Vector.zero(float, self.dimension)
        for k, corner in ti.static(enumerate(self.corners_of_a_cell)):
            cell = self.linear(place - ti.Vector(corner), ti.Vector(self.bins.shape))
            number = self.number[cell] if cell >= 0 else -1
            if number >= 0:
                for a in ti.static(range(self.dimension)):
                    b[a] += self.sums[number][k, a]
        self.rest[node] = b

    @ti.func
    def collect_residual(self, c, r: ti.template()):
        """What the corners of the c-th cell that holds particles get of the r of these."""
        sums = ti.Matrix.zero(float, 2**self.dimension, self.lanes)
        for i in range(self.bins.cell_start[self.cells[c]], self.bins.cell_start[self.cells[c] + 1]):
            shares, own = self.shares[i], r[i]
            for k, a in ti.static(ti.ndrange(2**self.dimension, self.dimension)):
                sums[k, a] += shares[k] * own[a]
        self.sums[c] = sums

    @ti.func
    def correct(self, c, r: ti.template(), z: ti.template()):
        """z of the particles in that cell."""
        place = self.place(self.cells[c], ti.Vector(self.bins.shape))
        of_corners = ti.Matrix.zero(float, 2**self.dimension, self.lanes)
        for k, corner in ti.static(enumerate(self.corners_of_a_cell)):
            node = self.corner(place, corner)
            for a in ti.static(range(self.dimension)):
                of_corners[k, a] = self.z[1, node][a]
        for i in range(self.bins.cell_start[self.cells[c]], self.bins.cell_start[self.cells[c] + 1]):
            D, shares = self.operator.inverse_diagonal[i], self.shares[i]
            correction = ti.Vector.zero(float, self.dimension)
            for k, a in ti.static(ti.ndrange(2**self.dimension, self.dimension)):
                correction[a] += shares[k] * of_corners[k, a]
            z[i] = D @ r[i] + (correction if ti.abs(D).sum() > 0 else 0.0 * correction)

    @ti.func
    def restrict(self, grid, m):
        """b of the m-th node of a grid from what the finer one leaves; x after the first sweep from zero."""
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

    @ti.func
    def sweep(self, grid, m, k, at):
        """Step k of the Chebyshev polynomial, from z[at] and the one before, which the result replaces."""
        node = self.used[self.first[grid] + m]
        x, before = self.z[at, node], self.z[1 - at, node]
        change = self.carry[k] * (x - before) + self.step[k] * self.inverse[node] @ self.residual(grid, m, at)
        self.z[1 - at, node] = x + change

    @ti.func
    def leave(self, grid, m):
        self.rest[self.used[self.first[grid] + m]] = self.residual(grid, m, 0)

    @ti.func
    def prolong(self, grid, m):
        """Add what the next grid adds."""
        node = self.used[self.first[grid] + m]
        self.z[0, node] += self.coarser(m, grid)

    @ti.func
    def coarser(self, m, grid):
        """What the next grid adds at the m-th node of a grid."""
        z = ti.Vector.zero(float, self.dimension)
        if grid + 1 < self.grids:
            place, rest = self.parents(self.where[self.first[grid] + m], grid)
            for corner in ti.static(self.corners_of_a_cell):
                number, share = self.parent(place, rest, ti.Vector(corner), grid)
                if share > 0.0 and self.active[number] > 0:
                    z += share * self.z[1, number]
        return z
