"""Coarse levels for an operator on particles that has no matrix: grids of nodes made from the binning grid.

Source: Bramble, Pasciak and Xu, Parallel multilevel preconditioners, Mathematics of Computation 55 (1990), 1-22.
"""

from itertools import pairwise

import numpy as np

from .backend import real, ti


@ti.data_oriented
class GridLevels:
    """M^-1 = D^-1 + w sum_l P_l D_l^-1 P_l^T, the sum over grids l of nodes.

    Grid 0 has a node at each corner of the binning cells, each next one every second node of the last, along the axes
    where that is possible. P_l is linear interpolation from the nodes of grid l to the particles. D_l are the diagonal
    blocks of the operator on the shape functions phi of the nodes,

        D_l,n = sum_i a_i |grad phi_n|^2 I + c_i grad phi_n (x) grad phi_n + phi_n^2 S_i,

    summed over the particles on grid 0, on the next ones over the nodes of the finer grid, onto which the particles'
    a, c and S are lumped.

    operator: ``inverse_diagonal`` as for MRPCG (a zero block: no unknown), and the ti.func ``stiffness(i)``, which
    gives a_i, c_i and the d x d matrix S_i of particle i.
    """

    PAY_FROM = 8000
    """Rows from which the levels pay. Measured on the slump cone of 300 Pa, CPU milliseconds a step (iterations),
    Jacobi against levels: 5,504 rows 126 (77), 124 (42); 43,992 rows 1826 (180), 968 (65)."""

    WEIGHT = 0.5

    def __init__(self, operator, bins):
        self.operator, self.bins = operator, bins
        d = self.dimension = bins.dimension
        stride = np.ones(d, int)  # cells between nodes
        shape = np.array(bins.shape) + np.where(bins.periodic, 0, 1)
        self.corners = tuple(int(s) for s in shape)  # nodes of grid 0 along each axis
        strides, shapes = [], []
        while True:
            strides.append(stride)
            shapes.append(shape)
            merge = np.where(bins.periodic, (shape % 2 == 0) & (shape >= 6), shape > 3)
            if not merge.any():
                break
            stride = np.where(merge, 2 * stride, stride)
            shape = np.where(merge, np.where(bins.periodic, shape // 2, shape // 2 + 1), shape)
        self.grids = len(shapes)
        first = np.cumsum([0] + [int(np.prod(s)) for s in shapes])
        nodes = int(first[-1])
        self.nodes = nodes
        self.first = ti.field(ti.i32, self.grids + 1)  # first node of each grid
        self.shape = ti.Vector.field(d, ti.i32, self.grids)  # nodes along each axis
        self.stride = ti.Vector.field(d, ti.i32, self.grids)  # cells from node to node
        self.first.from_numpy(first.astype(np.int32))
        self.shape.from_numpy(np.array(shapes, np.int32))
        self.stride.from_numpy(np.array(strides, np.int32))
        self.ratio = ti.Vector.field(d, ti.i32, self.grids)  # nodes of the finer grid from node to node, 1 or 2
        ratios = [stride // finer for finer, stride in pairwise([strides[0], *strides])]
        self.ratio.from_numpy(np.array(ratios, np.int32))
        self.unit = ti.field(real(), self.grids)  # 1 over the product of these
        self.unit.from_numpy(1.0 / self.ratio.to_numpy().prod(1))
        self.active = ti.field(ti.i32, nodes)  # 1 where a particle may be within reach of the node
        self.used = ti.field(ti.i32, nodes)  # the active nodes of a grid, from its first on
        self.uses = ti.field(ti.i32, self.grids)  # how many they are
        self.a, self.c = (ti.field(real(), nodes) for _ in range(2))  # lumped [of the operator times m2]
        self.S = ti.Matrix.field(d, d, real(), nodes)  # lumped [of the operator]
        self.inverse = ti.Matrix.field(d, d, real(), nodes)  # D_l^-1
        self.b = ti.Vector.field(d, real(), nodes)  # P_l^T r
        self.z = ti.Vector.field(d, real(), nodes)  # sum of P D^-1 b over this grid and the coarser ones
        self.fraction = ti.Vector.field(d, real(), bins.particles.capacity)  # place of each particle in its cell [-]

    # ---- places ---------------------------------------------------------------------------------------------
    @ti.func
    def place(self, k, shape):
        """Coordinates of the k-th node or cell of a grid of this shape."""
        place, rest = ti.Vector.zero(ti.i32, self.dimension), k
        for a in ti.static(range(self.dimension - 1, -1, -1)):
            place[a] = rest % shape[a]
            rest //= shape[a]
        return place

    @ti.func
    def linear(self, place, shape):
        """Number of the node or cell at a place of a grid of this shape, wrapped along periodic axes; -1 outside."""
        number, inside = 0, 1
        for a in ti.static(range(self.dimension)):
            k = place[a]
            if ti.static(self.bins.periodic[a]):
                k = (k + shape[a]) % shape[a]
            if k < 0 or k >= shape[a]:
                inside = 0
            number = number * shape[a] + k
        return ti.select(inside == 1, number, -1)

    @ti.func
    def corner(self, place, corner: ti.template()):
        """Number of the node at a corner (0 or 1 along each axis) of the cell at a place."""
        number = 0
        for a in ti.static(range(self.dimension)):
            k = place[a] + corner[a]
            if ti.static(self.bins.periodic[a] and corner[a] == 1):
                k = ti.select(k == self.corners[a], 0, k)
            number = number * self.corners[a] + k
        return number

    @ti.func
    def share(self, i, corner):
        """Value at particle i of the shape function of the node at a corner (0 or 1 along each axis) of its cell."""
        share = ti.cast(1.0, float)
        for a in ti.static(range(self.dimension)):
            share *= ti.abs(1.0 - corner[a] - self.fraction[i][a])
        return share

    @ti.func
    def parents(self, place, grid):
        """Of the node at a place: the place of its first parent on the next grid, and its distance from it, in nodes of
        this grid: 0, or 1 along an axis where it stands between two parents."""
        halved = self.ratio[grid + 1] - 1
        return place >> halved, place & halved

    @ti.func
    def parent(self, first, rest, corner, grid):
        """Number of the parent at a corner (0 or 1 along each axis) and its share in the node."""
        share = ti.cast(self.unit[grid + 1], float)
        for a in ti.static(range(self.dimension)):
            share *= ti.select(corner[a] == 1, rest[a], self.ratio[grid + 1][a] - rest[a])
        number = self.linear(first + corner, self.shape[grid + 1]) if share > 0.0 else -1
        return self.first[grid + 1] + number, ti.select(number < 0, 0.0, share)

    @ti.func
    def child(self, place, offset, grid):
        """Number of the node of the finer grid, ``offset`` of its nodes (-2 to 2 along each axis) from a node of this
        one, and by axis the means around it of phi^2, of (h dphi/dx)^2 and of phi h dphi/dx, h from node to node."""
        at, square = place, ti.Vector.one(float, self.dimension)
        rise, product = ti.Vector.zero(float, self.dimension), ti.Vector.zero(float, self.dimension)
        for a in ti.static(range(self.dimension)):
            far = ti.abs(offset[a])
            if self.stride[grid][a] > self.stride[grid - 1][a]:
                at[a] = 2 * place[a] + offset[a]
                square[a] = ti.select(far == 0, 1.0, ti.select(far == 1, 0.25, 0.0))
                rise[a] = ti.select(far < 2, 1.0, 0.5)
                product[a] = ti.select(far == 1, -0.5 * offset[a], 0.0)
            else:
                at[a] = place[a] + offset[a]
                square[a] = ti.select(far == 0, 1.0, 0.0)
                rise[a] = ti.select(far == 0, 1.0, ti.select(far == 1, 0.5, 0.0))
        number = self.linear(at, self.shape[grid - 1])
        return ti.select(number < 0, -1, self.first[grid - 1] + number), square, rise, product

    # ---- blocks ---------------------------------------------------------------------------------------------
    def build(self) -> None:
        """Blocks of all grids for the operator as it is now."""
        self._locate()
        for grid in range(1, self.grids):
            self._mark(grid)
        self._assemble_finest()
        for grid in range(1, self.grids):
            self._assemble(grid)

    @ti.func
    def collect(self, grid):
        """List the active nodes of a grid, in order."""
        ti.loop_config(serialize=True)
        for _ in range(1):
            found = self.first[grid]
            for node in range(self.first[grid], self.first[grid + 1]):
                if self.active[node] > 0:
                    self.used[found] = node
                    found += 1
            self.uses[grid] = found - self.first[grid]

    @ti.kernel
    def _locate(self):
        """Place of the particles in their cells; nodes at the corners of cells that hold some are active."""
        for i in range(self.operator.count[None]):
            s = (self.bins.particles.x[i] - self.bins.low) / self.bins.cell_size
            self.fraction[i] = ti.cast(s - self.place(self.bins.cell_of[i], ti.Vector(self.bins.shape)), float)
        for node in range(self.nodes):
            self.active[node] = 0
        for cell in range(self.bins.cells):
            if self.bins.cell_start[cell + 1] > self.bins.cell_start[cell]:
                place = self.place(cell, ti.Vector(self.bins.shape))
                for corner in ti.grouped(ti.ndrange(*((0, 2),) * self.dimension)):
                    self.active[self.linear(place + corner, self.shape[0])] = 1
        self.collect(0)

    @ti.kernel
    def _mark(self, grid: ti.i32):
        """Nodes that an active one of the finer grid adds to are active."""
        for m in range(self.uses[grid - 1]):
            node = self.used[self.first[grid - 1] + m]
            place, rest = self.parents(self.place(node - self.first[grid - 1], self.shape[grid - 1]), grid - 1)
            for corner in ti.grouped(ti.ndrange(*((0, 2),) * self.dimension)):
                number, share = self.parent(place, rest, corner, grid - 1)
                if share > 0.0:
                    self.active[number] = 1
        self.collect(grid)

    @ti.func
    def invert(self, node, D):
        self.inverse[node] = ti.Matrix.zero(float, self.dimension, self.dimension)
        if D.trace() > 0.0:  # a node that the particles only just touch must not blow up
            tiny = 1e-4 * D.trace() * ti.Matrix.identity(float, self.dimension)
            self.inverse[node] = (D + tiny).inverse()

    @ti.kernel
    def _assemble_finest(self):
        for m in range(self.uses[0]):
            node = self.used[m]
            place = self.place(node, self.shape[0])
            I = ti.Matrix.identity(float, self.dimension)  # noqa: E741
            D, total = 0.0 * I, 0.0 * I
            shear, bulk = ti.cast(0.0, float), ti.cast(0.0, float)
            for corner in ti.grouped(ti.ndrange(*((0, 2),) * self.dimension)):
                cell = self.linear(place - corner, ti.Vector(self.bins.shape))
                if cell >= 0:
                    for i in range(self.bins.cell_start[cell], self.bins.cell_start[cell + 1]):
                        value = self.share(i, corner)
                        slope = ti.Vector.zero(float, self.dimension)
                        for a in ti.static(range(self.dimension)):
                            side = ti.select(corner[a] == 1, self.fraction[i][a], 1.0 - self.fraction[i][a])
                            sign = ti.select(corner[a] == 1, 1.0, -1.0) / ti.cast(self.bins.cell_size[a], float)
                            slope[a] = value / ti.max(side, 1e-6) * sign
                        a_i, c_i, S_i = self.operator.stiffness(i)
                        D += a_i * slope.dot(slope) * I + c_i * slope.outer_product(slope) + value * value * S_i
                        shear += value * a_i
                        bulk += value * c_i
                        total += value * S_i
            self.a[node], self.c[node], self.S[node] = shear, bulk, total
            self.invert(node, D)

    @ti.kernel
    def _assemble(self, grid: ti.i32):
        for m in range(self.uses[grid]):
            node = self.used[self.first[grid] + m]
            place = self.place(node - self.first[grid], self.shape[grid])
            size = ti.cast(self.bins.cell_size * ti.cast(self.stride[grid], ti.f64), float)
            I = ti.Matrix.identity(float, self.dimension)  # noqa: E741
            D, total = 0.0 * I, 0.0 * I
            shear, bulk = ti.cast(0.0, float), ti.cast(0.0, float)
            for offset in ti.grouped(ti.ndrange(*((-2, 3),) * self.dimension)):
                number, square, rise, product = self.child(place, offset, grid)
                if number >= 0 and self.active[number] > 0:
                    outer, value = 0.0 * I, ti.cast(1.0, float)
                    for a in ti.static(range(self.dimension)):
                        value *= square[a]
                        for c in ti.static(range(self.dimension)):
                            term = ti.cast(1.0, float) / (size[a] * size[c])
                            for e in ti.static(range(self.dimension)):
                                if ti.static(a == c and e == a):
                                    term *= rise[e]
                                elif ti.static(e in (a, c) and a != c):
                                    term *= product[e]
                                else:
                                    term *= square[e]
                            outer[a, c] = term
                    D += self.a[number] * outer.trace() * I + self.c[number] * outer + value * self.S[number]
                    share = ti.sqrt(value)
                    shear += share * self.a[number]
                    bulk += share * self.c[number]
                    total += share * self.S[number]
            self.a[node], self.c[node], self.S[node] = shear, bulk, total
            self.invert(node, D)

    # ---- the cycle ------------------------------------------------------------------------------------------
    @ti.kernel
    def cycle(self, r: ti.template(), z: ti.template()):
        """z = M^-1 r."""
        self.correct(r, z)

    @ti.func
    def correct(self, r: ti.template(), z: ti.template()):
        """z = M^-1 r; its loops are top-level loops."""
        for m in range(self.uses[0]):
            node = self.used[m]
            place = self.place(node, ti.Vector(self.corners))
            b = ti.Vector.zero(float, self.dimension)
            for corner in ti.static(ti.ndrange(*((0, 2),) * self.dimension)):
                cell = self.linear(place - ti.Vector(corner), ti.Vector(self.bins.shape))
                if cell >= 0:
                    for i in range(self.bins.cell_start[cell], self.bins.cell_start[cell + 1]):
                        b += self.share(i, corner) * r[i]
            self.b[node] = b
        if ti.static(self.grids > 1):
            for m in range(self.uses[1]):
                self.restrict(1, m)
        ti.loop_config(serialize=True)
        for _ in range(1):  # the coarser grids have few nodes: one thread, no launches
            for grid in range(2, self.grids):
                for m in range(self.uses[grid]):
                    self.restrict(grid, m)
            for k in range(2, self.grids):
                for m in range(self.uses[self.grids + 1 - k]):
                    self.prolong(self.grids + 1 - k, m)
        if ti.static(self.grids > 1):
            for m in range(self.uses[1]):
                self.prolong(1, m)
        for m in range(self.uses[0]):
            self.prolong(0, m)
        for i in range(self.operator.count[None]):
            correction = ti.Vector.zero(float, self.dimension)
            if ti.abs(self.operator.inverse_diagonal[i]).sum() > 0:
                place = self.place(self.bins.cell_of[i], ti.Vector(self.bins.shape))
                for corner in ti.static(ti.ndrange(*((0, 2),) * self.dimension)):
                    correction += self.share(i, corner) * self.z[self.corner(place, corner)]
            z[i] = self.operator.inverse_diagonal[i] @ r[i] + self.WEIGHT * correction

    @ti.func
    def restrict(self, grid, m):
        """b of the m-th node of a grid from those of the finer one."""
        node = self.used[self.first[grid] + m]
        place = self.place(node - self.first[grid], self.shape[grid])
        b = ti.Vector.zero(float, self.dimension)
        for offset in ti.grouped(ti.ndrange(*((-1, 2),) * self.dimension)):
            share = ti.cast(self.unit[grid], float)
            for a in ti.static(range(self.dimension)):
                share *= self.ratio[grid][a] - ti.abs(offset[a])
            number = self.linear(self.ratio[grid] * place + offset, self.shape[grid - 1]) if share > 0.0 else -1
            if number >= 0 and self.active[self.first[grid - 1] + number] > 0:
                b += share * self.b[self.first[grid - 1] + number]
        self.b[node] = b

    @ti.func
    def prolong(self, grid, m):
        """z of the m-th node of a grid: D^-1 b, and what the next grid adds."""
        node = self.used[self.first[grid] + m]
        z = self.inverse[node] @ self.b[node]
        if grid + 1 < self.grids:
            place, rest = self.parents(self.place(node - self.first[grid], self.shape[grid]), grid)
            for corner in ti.grouped(ti.ndrange(*((0, 2),) * self.dimension)):
                number, share = self.parent(place, rest, corner, grid)
                if share > 0.0:
                    z += share * self.z[number]
        self.z[node] = z
