"""Coarse levels of an operator on particles: grids of nodes made from the binning grid, linear interpolation between
them and the particles, and the operator on each grid, a stencil summed from the particles without a matrix."""

from itertools import pairwise, product

import numpy as np

from ..particles.neighbors import wrapped_number
from ..runtime.backend import constant_fields, real, ti
from ..runtime.sums import sum_threads


@ti.data_oriented
class NodeOperators:
    """Grids of nodes with an operator A_l on each.

    Grid 0 has a node at each corner of the binning cells, each next one every second node of the last, along the
    axes where that is possible. ``corner_weights`` interpolate from grid 0 to particles, ``parent_and_weight`` from
    grid to grid. Nodes near particles are active. From grid 1 on each active node has a row, from
    first_row[grid] on. There are rows for one in four particles on grid 1, half as many on each next one, 1000 at
    least; concrete takes a tenth of that. Nodes without a row, as of a spray, stay out of these grids, which then
    correct less.

    A_l is the operator on the shape functions f of the nodes of grid l, a stencil of 3^d blocks; the block of nodes n
    and m is

        sum_i a_i (grad f_n . grad f_m I + grad f_m (x) grad f_n) + (c_i - a_i) grad f_n (x) grad f_m + f_n f_m S_i

    summed over the cells of grid l - 1, each of which stands for its particles with the sums of their a, c and S at
    the centre of a: the operator of an elastic body. On grid 0 only the diagonal blocks D_0 are made, by particle.
    Each cell gives 2^d nodes a part of A_l that is positive, so the eigenvalues of D_l^-1 A_l are at most 2^d.

    Of particle i ``stiffness(i)`` of the operator gives a_i, c_i and S_i (node_multigrid.py).
    """

    MIN_GRID_ROWS = 1000  # least number of rows of a grid
    SMALL_ROWS = 8192  # rows of a grid, a tenth of which concrete takes, up to which one block of threads is enough

    def __init__(self, operator, bins):
        self.operator, self.bins = operator, bins
        d = self.dimension = bins.dimension
        stride = np.ones(d, int)  # cells between nodes
        shape = np.array(bins.shape) + np.where(bins.periodic, 0, 1)
        self.corners = tuple(int(s) for s in shape)  # nodes of grid 0 along each axis
        self.corners_of_a_cell = tuple(product((0, 1), repeat=d))
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
        self.serial = sum_threads() == 1  # whether nodes and cells are listed in order
        first = np.cumsum([0] + [int(np.prod(s)) for s in shapes])
        self.nodes = int(first[-1])
        ratios = np.array([stride // finer for finer, stride in pairwise([strides[0], *strides])])
        row_capacity = [
            min(n, max(self.MIN_GRID_ROWS, bins.particles.capacity >> (k + 2)))
            for k, n in enumerate(np.diff(first)[1:])
        ]
        start = np.cumsum([0, 0, *row_capacity])
        # the first grid that a block of threads of a GPU computes alone, with all that are coarser
        self.first_small = 1 + sum(bool(rows > self.SMALL_ROWS) for rows in row_capacity if not self.serial)
        self.rows = max(1, int(start[-1]))
        # for each grid its first node, its first row, and 1 over the product of its ratio
        self.first_node, self.first_row, self.inverse_ratio = constant_fields(first, start, 1.0 / ratios.prod(1))
        # for each grid, along each axis: nodes, cells per node, and nodes of the finer grid per node, 1 or 2
        self.shape, self.stride, self.ratio = constant_fields(np.array(shapes), np.array(strides), ratios, vectors=True)
        self.active = ti.field(ti.i32, self.nodes)  # 1 where a particle may be near the node
        self.active_nodes = ti.field(ti.i32, self.nodes)  # active nodes of a grid, from first_node on
        self.node_index = ti.Vector.field(d, ti.i32, self.nodes)  # coordinates of these on their grid
        self.active_count = ti.field(ti.i32, self.grids)  # number of active nodes
        self.filled_cells = ti.field(ti.i32, bins.cells)  # binning cells that hold particles
        self.filled_count = ti.field(ti.i32, ())  # number of these cells
        self.filled_number = ti.field(ti.i32, bins.cells)  # index of a cell in filled_cells, -1: empty
        self.fraction = ti.Vector.field(d, real(), bins.particles.capacity)  # position of each particle in its cell [-]
        # interpolation weights of the corners of each particle's cell [-]
        self.corner_weights = ti.Vector.field(2**d, real(), bins.particles.capacity)
        self.stencil_points = 3**d
        self.a, self.c = (ti.field(real(), self.nodes) for _ in range(2))  # sums over the cell above each node
        self.S = ti.Matrix.field(d, d, real(), self.nodes)
        self.centre = ti.Vector.field(d, real(), self.nodes)  # centre of a in the cell, 0 to 1 [-]
        self.lanes = 4 if d == 3 else d  # LLVM makes vector instructions of four numbers
        # transposed blocks of A_l
        self.stencil = ti.Matrix.field(d, self.lanes, real(), (self.rows, self.stencil_points))
        self.column = ti.field(ti.i32, (self.rows, self.stencil_points))  # node at each stencil point
        self.inverse = ti.Matrix.field(d, d, real(), self.nodes)  # D_l^-1
        # node of the finer grid at each offset, -1: none
        self.finer = ti.field(ti.i32, (self.rows, self.stencil_points))
        ratio = self.ratio.to_numpy()[:, None]
        apart = np.abs(np.array(list(product((-1, 0, 1), repeat=d))))
        (self.weights,) = constant_fields(np.maximum(0, ratio - apart).prod(2) * (1.0 / ratio.prod(2)))  # its weight

    def build_levels(self) -> None:
        """Build the operators of all grids for the present operator on particles."""
        self._locate_particles()
        self._assemble_finest()
        for grid in range(1, self.grids):
            self._mark_active(grid)
            self._sum_over_cells(grid - 1)
            self._assemble(grid)

    # ---- indices and coordinates ------------------------------------------------------------------------------
    @ti.func
    def coordinates(self, k, shape):
        """Coordinates of the k-th node or cell of a grid of this shape."""
        coordinates, remainder = ti.Vector.zero(ti.i32, self.dimension), k
        for a in ti.static(range(self.dimension - 1, -1, -1)):
            coordinates[a] = remainder % shape[a]
            remainder //= shape[a]
        return coordinates

    @ti.func
    def linear_index(self, index, shape: ti.template()):
        """Linear index of the node or cell at an index of a grid of this shape, wrapped along periodic axes; -1
        outside."""
        return wrapped_number(index, shape, self.bins.periodic)

    @ti.func
    def first_parent(self, index, grid):
        """Coordinates of the first parent, on the next grid, of the node at an index, and the distance between the two
        in nodes of this grid: 0, or 1 along an axis where the node lies between two parents."""
        halved = self.ratio[grid + 1] - 1
        return index >> halved, index & halved

    @ti.func
    def parent_and_weight(self, first, remainder, corner, grid):
        """Number of the parent at a corner (0 or 1 along each axis) and its interpolation weight."""
        weight = ti.cast(self.inverse_ratio[grid + 1], float)
        for a in ti.static(range(self.dimension)):
            weight *= ti.select(corner[a] == 1, remainder[a], self.ratio[grid + 1][a] - remainder[a])
        number = self.linear_index(first + corner, self.shape[grid + 1]) if weight > 0.0 else -1
        return self.first_node[grid + 1] + number, ti.select(number < 0, 0.0, weight)

    @ti.func
    def neighbour(self, index, grid):
        """Number of the active node at an index of a grid; -1 if there is none."""
        number = self.linear_index(index, self.shape[grid])
        number = self.first_node[grid] + number if number >= 0 else -1
        if number >= 0 and self.active[number] == 0:
            number = -1
        return number

    # ---- active nodes ---------------------------------------------------------------------------------------
    @ti.func
    def list_active_nodes(self, grid):
        """List the active nodes of a grid, in order."""
        first, capacity = self.first_node[grid], self.nodes
        if grid > 0:
            capacity = self.first_row[grid + 1] - self.first_row[grid]
        self.active_count[grid] = 0
        ti.loop_config(serialize=self.serial)
        for node in range(self.first_node[grid], self.first_node[grid + 1]):
            if self.active[node] > 0:
                m = ti.atomic_add(self.active_count[grid], 1)
                if m < capacity:
                    self.active_nodes[first + m] = node
                    self.node_index[first + m] = self.coordinates(node - first, self.shape[grid])
                else:
                    self.active[node] = 0
        self.active_count[grid] = ti.min(self.active_count[grid], capacity)

    @ti.kernel
    def _locate_particles(self):
        """Locate the particles in their cells, and mark the nodes at the corners of cells that hold some as active."""
        for i in range(self.operator.count[None]):
            s = (self.bins.particles.x[i] - self.bins.low) / self.bins.cell_size
            fraction = ti.cast(s - self.coordinates(self.bins.cell_of[i], ti.Vector(self.bins.shape)), float)
            self.fraction[i] = fraction
            for k, corner in ti.static(enumerate(self.corners_of_a_cell)):
                weight = ti.cast(1.0, float)
                for a in ti.static(range(self.dimension)):
                    weight *= ti.abs(1.0 - corner[a] - fraction[a])
                self.corner_weights[i][k] = weight
        for node in range(self.nodes):
            self.active[node] = 0
        self.filled_count[None] = 0
        ti.loop_config(serialize=self.serial)
        for cell in range(self.bins.cells):
            self.filled_number[cell] = -1
            if self.bins.cell_start[cell + 1] > self.bins.cell_start[cell]:
                self.filled_number[cell] = ti.atomic_add(self.filled_count[None], 1)
                self.filled_cells[self.filled_number[cell]] = cell
        for c in range(self.filled_count[None]):
            cell_index = self.coordinates(self.filled_cells[c], ti.Vector(self.bins.shape))
            for corner in ti.static(self.corners_of_a_cell):
                self.active[self.linear_index(cell_index + ti.Vector(corner), self.corners)] = 1
        self.list_active_nodes(0)

    @ti.kernel
    def _mark_active(self, grid: ti.i32):
        """Mark as active the nodes of a grid to which an active node of the finer grid contributes."""
        for m in range(self.active_count[grid - 1]):
            parent, remainder = self.first_parent(self.node_index[self.first_node[grid - 1] + m], grid - 1)
            for corner in ti.grouped(ti.ndrange(*((0, 2),) * self.dimension)):
                number, weight = self.parent_and_weight(parent, remainder, corner, grid - 1)
                if weight > 0.0:
                    self.active[number] = 1
        self.list_active_nodes(grid)

    # ---- operators ------------------------------------------------------------------------------------------
    @ti.func
    def set_inverse_diagonal(self, node, D):
        """Store the inverse of the diagonal block D of a node, slightly regularized; zero for a zero block."""
        self.inverse[node] = ti.Matrix.zero(float, self.dimension, self.dimension)
        size = D.trace()
        if size > 1e-30:  # particles at the rim of a node give a tiny block, whose determinant would underflow
            self.inverse[node] = (D / size + 1e-4 * ti.Matrix.identity(float, self.dimension)).inverse() / size

    @ti.kernel
    def _assemble_finest(self):
        """Assemble the diagonal blocks of grid 0."""
        for m in range(self.active_count[0]):
            node, index = self.active_nodes[m], self.node_index[m]
            I = ti.Matrix.identity(float, self.dimension)  # noqa: E741
            D = 0.0 * I
            for corner in ti.grouped(ti.ndrange(*((0, 2),) * self.dimension)):
                cell = self.linear_index(index - corner, ti.Vector(self.bins.shape))
                if cell >= 0:
                    for i in range(self.bins.cell_start[cell], self.bins.cell_start[cell + 1]):
                        value, slope = self.shape_function(corner, self.fraction[i], 0)
                        a_i, c_i, S_i = self.operator.stiffness(i)
                        D += a_i * slope.dot(slope) * I + c_i * slope.outer_product(slope) + value * value * S_i
            self.set_inverse_diagonal(node, D)

    @ti.func
    def shape_function(self, corner, fraction, grid):
        """Value and gradient [1/m], at a fraction of a cell of the grid, of the shape function of the node at one of
        its corners."""
        value, slope = ti.cast(1.0, float), ti.Vector.one(float, self.dimension)
        for a in ti.static(range(self.dimension)):
            width = ti.cast(self.bins.cell_size[a] * self.stride[grid][a], float)
            weight = ti.abs(1.0 - corner[a] - fraction[a])
            value *= weight
            for e in ti.static(range(self.dimension)):
                slope[e] *= ti.select(corner[a] == 1, 1.0, -1.0) / width if e == a else weight
        return value, slope

    @ti.func
    def set_neighbours(self, row, index, grid):
        """Set the neighbours of the node of a row on the finer grid, -1 where there is none, and on its own grid, where
        a zero block of any node stands for a missing one, so that sums over the stencil need no test."""
        for k in range(self.stencil_points):
            fine = self.neighbour(self.ratio[grid] * index + self.stencil_offset(k), grid - 1)
            self.finer[row, k] = fine if self.weights[grid, k] > 0.0 else -1
            self.column[row, k] = self.neighbour(index + self.stencil_offset(k), grid)
            if self.column[row, k] < 0:
                self.stencil[row, k] = ti.Matrix.zero(float, self.dimension, self.lanes)
                self.column[row, k] = self.first_node[grid]

    @ti.func
    def stencil_offset(self, k):
        """Offset of stencil point k, -1 to 1 along each axis."""
        return self.coordinates(k, 3 * ti.Vector.one(ti.i32, self.dimension)) - 1

    @ti.func
    def stencil_point(self, offset):
        """Number of the stencil point at an offset."""
        k = 0
        for a in ti.static(range(self.dimension)):
            k = 3 * k + offset[a] + 1
        return k

    @ti.kernel
    def _sum_over_cells(self, grid: ti.i32):
        """Sum a, c and S over the cells above the nodes of a grid, and compute the centre of a."""
        for m in range(self.active_count[grid]):
            node, index = self.active_nodes[self.first_node[grid] + m], self.node_index[self.first_node[grid] + m]
            S = ti.Matrix.zero(float, self.dimension, self.dimension)
            shear, bulk, moment = ti.cast(0.0, float), ti.cast(0.0, float), ti.Vector.zero(float, self.dimension)
            if grid == 0:
                cell = self.linear_index(index, ti.Vector(self.bins.shape))
                if cell >= 0:
                    for i in range(self.bins.cell_start[cell], self.bins.cell_start[cell + 1]):
                        a_i, c_i, S_i = self.operator.stiffness(i)
                        shear, bulk, S, moment = shear + a_i, bulk + c_i, S + S_i, moment + a_i * self.fraction[i]
            else:
                for corner in ti.grouped(ti.ndrange(*((0, 2),) * self.dimension)):
                    inner = self.neighbour(self.ratio[grid] * index + corner, grid - 1)
                    if (corner < self.ratio[grid]).all() and inner >= 0:
                        shear, bulk, S = shear + self.a[inner], bulk + self.c[inner], S + self.S[inner]
                        moment += self.a[inner] * (self.centre[inner] + corner) / self.ratio[grid]
            self.a[node], self.c[node], self.S[node] = shear, bulk, S
            self.centre[node] = moment / shear if shear > 0.0 else 0.5 + 0.0 * moment

    @ti.kernel
    def _assemble(self, grid: ti.i32):
        """Assemble the stencils of a grid from the sums over the cells of the finer grid."""
        for m in range(self.active_count[grid]):
            node, row = self.active_nodes[self.first_node[grid] + m], self.first_row[grid] + m
            index = self.node_index[self.first_node[grid] + m]
            for k in range(self.stencil_points):
                self.stencil[row, k] = ti.Matrix.zero(float, self.dimension, self.lanes)
            D = ti.Matrix.zero(float, self.dimension, self.dimension)
            ratio = self.ratio[grid]
            for offset in ti.grouped(ti.ndrange(*((-2, 2),) * self.dimension)):
                at, cell = ratio * index + offset, -1
                if (offset >= -ratio).all() and (offset < ratio).all():
                    cell = self.neighbour(at, grid - 1)
                if cell >= 0 and self.c[cell] > 0.0:
                    corner = index - (at >> (ratio - 1))  # of the node in its cell
                    fraction = (self.centre[cell] + (at & (ratio - 1))) / ratio
                    value, slope = self.shape_function(corner, fraction, grid)
                    shear, bulk_rest, S = self.a[cell], self.c[cell] - self.a[cell], value * self.S[cell]
                    for other in ti.grouped(ti.ndrange(*((0, 2),) * self.dimension)):
                        v, s = self.shape_function(other, fraction, grid)
                        k, level = self.stencil_point(other - corner), shear * slope.dot(s)
                        for e, a in ti.static(ti.ndrange(self.dimension, self.dimension)):
                            block = shear * s[a] * slope[e] + bulk_rest * slope[a] * s[e] + v * S[a, e]
                            self.stencil[row, k][e, a] += block + level if ti.static(a == e) else block
            for e, a in ti.static(ti.ndrange(self.dimension, self.dimension)):
                D[a, e] = self.stencil[row, self.stencil_points // 2][e, a]
            self.set_neighbours(row, index, grid)
            self.set_inverse_diagonal(node, D)
