"""Grids of nodes made from the binning grid, and linear interpolation between them and the particles."""

from itertools import pairwise, product

import numpy as np

from ..particles.neighbors import wrapped_number
from ..runtime.backend import constant_fields, real, ti


@ti.data_oriented
class NodeGrids:
    """Grid 0 has a node at each corner of the binning cells, each next one every second node of the last, along the
    axes where that is possible. ``corner_weights`` interpolate from grid 0 to particles, ``parent`` from grid to grid.

    Active are the nodes within reach of particles. From grid 1 on each of them has a row, start[grid] and on. There
    are rows for one in four particles on grid 1, half as many on each next one, 1000 at least; concrete takes a tenth
    of that. What has no row, of a spray, stays out of these grids, which then correct less.
    """

    ROWS = 1000

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
        first = np.cumsum([0] + [int(np.prod(s)) for s in shapes])
        self.nodes = int(first[-1])
        ratios = np.array([stride // finer for finer, stride in pairwise([strides[0], *strides])])
        room = [min(n, max(self.ROWS, bins.particles.capacity >> (k + 2))) for k, n in enumerate(np.diff(first)[1:])]
        start = np.cumsum([0, 0, *room])
        self.rows = max(1, int(start[-1]))
        # of each grid its first node, its first row, and 1 over the product of its ratio
        self.first, self.start, self.unit = constant_fields(first, start, 1.0 / ratios.prod(1))
        # of each grid nodes along each axis, cells from node to node, nodes of the finer grid from node to node: 1 or 2
        self.shape, self.stride, self.ratio = constant_fields(np.array(shapes), np.array(strides), ratios, vectors=True)
        self.active = ti.field(ti.i32, self.nodes)  # 1 where a particle may be within reach of the node
        self.used = ti.field(ti.i32, self.nodes)  # the active nodes of a grid, from its first on
        self.where = ti.Vector.field(d, ti.i32, self.nodes)  # the places of these
        self.uses = ti.field(ti.i32, self.grids)  # how many they are
        self.cells = ti.field(ti.i32, bins.cells)  # those that hold particles
        self.filled = ti.field(ti.i32, ())  # how many they are
        self.number = ti.field(ti.i32, bins.cells)  # which of them each cell is, -1: empty
        self.fraction = ti.Vector.field(d, real(), bins.particles.capacity)  # place of each particle in its cell [-]
        self.corner_weights = ti.Vector.field(2**d, real(), bins.particles.capacity)  # of corners of its cell [-]

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
    def linear(self, place, shape: ti.template()):
        """Number of the node or cell at a place of a grid of this shape, wrapped along periodic axes; -1 outside."""
        return wrapped_number(place, shape, self.bins.periodic)

    @ti.func
    def parents(self, place, grid):
        """Of the node at a place: the place of its first parent on the next grid, and its distance from it, in nodes of
        this grid: 0, or 1 along an axis where it stands between two parents."""
        halved = self.ratio[grid + 1] - 1
        return place >> halved, place & halved

    @ti.func
    def parent(self, first, rest, corner, grid):
        """Number of the parent at a corner (0 or 1 along each axis) and its weight in the node."""
        weight = ti.cast(self.unit[grid + 1], float)
        for a in ti.static(range(self.dimension)):
            weight *= ti.select(corner[a] == 1, rest[a], self.ratio[grid + 1][a] - rest[a])
        number = self.linear(first + corner, self.shape[grid + 1]) if weight > 0.0 else -1
        return self.first[grid + 1] + number, ti.select(number < 0, 0.0, weight)

    @ti.func
    def neighbour(self, place, grid):
        """Number of the active node at a place of a grid; -1 if there is none."""
        number = self.linear(place, self.shape[grid])
        number = self.first[grid] + number if number >= 0 else -1
        if number >= 0 and self.active[number] == 0:
            number = -1
        return number

    # ---- active nodes ---------------------------------------------------------------------------------------
    def locate(self) -> None:
        """Find the active nodes for the particles as they are now."""
        self._locate()
        for grid in range(1, self.grids):
            self._mark(grid)

    @ti.func
    def list_active(self, grid):
        """List the active nodes of a grid, in order."""
        ti.loop_config(serialize=True)
        for _ in range(1):
            found = self.first[grid]
            for node in range(self.first[grid], self.first[grid + 1]):
                if self.active[node] > 0:
                    row = self.start[grid] + found - self.first[grid]
                    if grid == 0 or row < self.start[grid + 1]:
                        self.used[found] = node
                        self.where[found] = self.place(node - self.first[grid], self.shape[grid])
                        found += 1
                    else:
                        self.active[node] = 0
            self.uses[grid] = found - self.first[grid]

    @ti.kernel
    def _locate(self):
        """Place of the particles in their cells; nodes at the corners of cells that hold some are active."""
        for i in range(self.operator.count[None]):
            s = (self.bins.particles.x[i] - self.bins.low) / self.bins.cell_size
            fraction = ti.cast(s - self.place(self.bins.cell_of[i], ti.Vector(self.bins.shape)), float)
            self.fraction[i] = fraction
            for k, corner in ti.static(enumerate(self.corners_of_a_cell)):
                weight = ti.cast(1.0, float)
                for a in ti.static(range(self.dimension)):
                    weight *= ti.abs(1.0 - corner[a] - fraction[a])
                self.corner_weights[i][k] = weight
        for node in range(self.nodes):
            self.active[node] = 0
        ti.loop_config(serialize=True)
        for _ in range(1):
            found = 0
            for cell in range(self.bins.cells):
                self.number[cell] = -1
                if self.bins.cell_start[cell + 1] > self.bins.cell_start[cell]:
                    self.number[cell], self.cells[found] = found, cell
                    found += 1
            self.filled[None] = found
        for c in range(self.filled[None]):
            place = self.place(self.cells[c], ti.Vector(self.bins.shape))
            for corner in ti.static(self.corners_of_a_cell):
                self.active[self.linear(place + ti.Vector(corner), self.corners)] = 1
        self.list_active(0)

    @ti.kernel
    def _mark(self, grid: ti.i32):
        """Nodes that an active one of the finer grid adds to are active."""
        for m in range(self.uses[grid - 1]):
            place, rest = self.parents(self.where[self.first[grid - 1] + m], grid - 1)
            for corner in ti.grouped(ti.ndrange(*((0, 2),) * self.dimension)):
                number, weight = self.parent(place, rest, corner, grid - 1)
                if weight > 0.0:
                    self.active[number] = 1
        self.list_active(grid)
