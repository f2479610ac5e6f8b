"""Dense grid binning, deterministic reorder by (cell, id), and neighbour lists in compressed rows (CSR)."""

import numpy as np

from ..runtime.backend import double_field, ti
from ..runtime.stages import flush, one_thread, stage
from ..runtime.sums import running_sums
from .particles import DUMMY, EXCLUDED, FLUID, WALL

NEARLY_FULL = 0.8  # of the room for pairs: in one step their number does not grow by a quarter


class CapacityError(RuntimeError):
    """Error of a list that is full, of neighbours or of the contacts of a grain; the message says what did not fit.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> issubclass(mps.CapacityError, RuntimeError)
    True
    """


class EscapedError(RuntimeError):
    """Particles left the domain or lost their numbers; the message says how many."""


@ti.func
def wrapped_number(place, shape: ti.template(), periodic: ti.template()):
    """Return the number of the cell or node at a place of a grid, wrapped where it is periodic; -1 outside."""
    number, inside = 0, True
    for a in ti.static(range(len(periodic))):
        k = place[a]
        if ti.static(periodic[a]):
            k = (k + shape[a]) % shape[a]
        inside = inside and 0 <= k < shape[a]
        number = number * shape[a] + k
    return number if inside else -1


@ti.data_oriented
class Bins:
    """Dense grid of cells over the scene's domain, not smaller than a neighbour list reaches; last axis fastest."""

    def __init__(self, particles, domain, periodic, radius: float):
        low, high = (np.array(corner, float) for corner in domain)
        size = high - low
        self.particles = particles
        self.dimension = len(low)
        self.periodic = tuple(periodic)
        self.radius = radius
        shape = np.maximum(1, np.floor(size / radius).astype(int))
        self.shape = tuple(int(s) for s in shape)
        self.cells = int(np.prod(shape))
        vector = ti.types.vector(self.dimension, ti.f64)
        self.low, self.cell_size, self.size = vector(low), vector(size / shape), vector(size)
        self.cell_start = ti.field(ti.i32, self.cells + 2)  # first row of each cell; one more of what is excluded
        self.cell_of = ti.field(ti.i32, particles.capacity)  # linear cell of each row
        self._fill = ti.field(ti.i32, self.cells + 2)  # rows already put into each cell
        self.lost = ti.field(ti.i32, ())  # particles outside the domain or not finite

    @ti.func
    def cell(self, x):
        """Cell coordinates of a position, clamped to the grid."""
        return ti.max(0, ti.min(ti.cast(ti.floor((x - self.low) / self.cell_size), ti.i32), ti.Vector(self.shape) - 1))

    @ti.func
    def linear(self, c):
        """Return the number of the cell at a place, wrapped along periodic axes; -1 outside."""
        return wrapped_number(c, self.shape, self.periodic)

    @ti.func
    def displacement(self, xi, xj):
        """x_j - x_i [m], the nearest image along periodic axes."""
        r = xj - xi
        for a in ti.static(range(self.dimension)):
            if ti.static(self.periodic[a]):
                r[a] -= self.size[a] * ti.round(r[a] / self.size[a])
        return r

    @stage("reorder")
    def arrange(self):
        """Put the rows into the order (cell, id), what is excluded behind them, and count lost particles."""
        self.lost[None] = 0
        for k in range(self.cells + 2):
            self.cell_start[k], self._fill[k] = 0, 0
        for i in range(self.particles.count[None]):
            x = self.particles.x[i]
            outside = 0
            for a in ti.static(range(self.dimension)):
                if ti.static(self.periodic[a]):
                    x[a] -= self.size[a] * ti.floor((x[a] - self.low[a]) / self.size[a])
                half_width = ti.static(1.0 if self.periodic[a] else 0.5)  # brought back, only what is no number is out
                if not (ti.abs(x[a] - self.low[a] - 0.5 * self.size[a]) <= half_width * self.size[a]):
                    outside = 1
            ti.atomic_add(self.lost[None], outside)
            self.particles.x[i] = x
            k = self.linear(self.cell(x))
            if self.particles.kind[i] == EXCLUDED:
                k = self.cells
            self.cell_of[i] = k
            ti.atomic_add(self.cell_start[k + 1], 1)
        running_sums(self.cell_start, self.cells + 1)
        for i in range(self.particles.count[None]):
            k = self.cell_of[i]
            self.particles.source_row[self.cell_start[k] + ti.atomic_add(self._fill[k], 1)] = i
        for k in range(self.cells):  # insertion sort by id: the order is then independent of the threads
            for a in range(self.cell_start[k] + 1, self.cell_start[k + 1]):
                row = self.particles.source_row[a]
                b = a
                while (
                    b > self.cell_start[k]
                    and self.particles.id[self.particles.source_row[b - 1]] > self.particles.id[row]
                ):
                    self.particles.source_row[b] = self.particles.source_row[b - 1]
                    b -= 1
                self.particles.source_row[b] = row
        self.particles.reorder()
        for k in range(self.cells):
            for i in range(self.cell_start[k], self.cell_start[k + 1]):
                self.cell_of[i] = k

    def check(self) -> None:
        """EscapedError if any particle left the domain."""
        lost = self.lost[None]
        if lost > 0:
            raise EscapedError(f"{lost} particles left the domain or are not finite numbers")


@ti.data_oriented
class NeighborList:
    """Rows j = column[row_start[i] .. row_start[i+1]] with |x_j - x_i| < radius, j != i.

    ``skin`` [m], where steps are short: the radius is longer by it than the effective radius, and a list is kept until
    a particle has gone half as far (Verlet, Physical Review 159 (1967), 98-103). Dummies, and wall particles without
    fluid near, then have no neighbours: nothing is read there.
    """

    def __init__(self, bins: Bins, pair_capacity: int, skin: float = 0.0):
        self.bins = bins
        self.particles = bins.particles
        self.pair_capacity, self.skin = int(pair_capacity), skin
        self.leaves_out_walls = skin > 0.0 and self.particles.has_walls
        self.one_thread = one_thread(self.particles.capacity)
        self.row_start = ti.field(ti.i32, bins.particles.capacity + 1)  # first pair of each particle
        self.column = ti.field(ti.i32, self.pair_capacity)  # neighbour's row of each pair
        self.pairs = ti.field(ti.i32, ())  # number of pairs, also of those that do not fit
        if skin > 0.0:
            self.listed_at = double_field(bins.particles.capacity, bins.dimension)  # positions of the present list [m]
            self.outdated = ti.field(ti.i32, ())  # whether a particle has gone more than half of the skin since
        self.forget()

    @ti.func
    def _scan(self, i, fill: ti.template()):
        """Count the neighbours of i, and store them if ``fill``; sums run in row order, so bits are reproducible."""
        x = self.particles.x[i]
        c = self.bins.cell(x)
        d = ti.static(self.bins.dimension)
        shape = ti.static(self.bins.shape)
        radius2 = self.bins.radius**2
        listed, fluid_neighbours = 0, 0
        first = self.row_start[i]
        for offset in ti.grouped(ti.ndrange(*((-1, 2),) * (d - 1))):
            neighbour_cell = c
            for a in ti.static(range(d - 1)):
                neighbour_cell[a] += offset[a]
            row = wrapped_number(neighbour_cell, shape, ti.static(self.bins.periodic[: d - 1]))
            if row >= 0:
                end = ti.static(shape[d - 1] - 1)
                for wrapped in ti.static(range(2 if self.bins.periodic[d - 1] else 1)):
                    low = ti.max(c[d - 1] - 1, 0)
                    high = ti.min(c[d - 1] + 1, end)
                    if ti.static(wrapped == 1):  # the one cell across a periodic end of the last axis, or none
                        low = end if c[d - 1] == 0 else 0
                        high = low if c[d - 1] == 0 or c[d - 1] == end else low - 1
                    for j in range(
                        self.bins.cell_start[row * shape[d - 1] + low],
                        self.bins.cell_start[row * shape[d - 1] + high + 1],
                    ):
                        r = self.bins.displacement(x, self.particles.x[j])
                        if j != i and r.dot(r) < radius2:
                            if ti.static(fill):
                                self.column[ti.min(first + listed, self.pair_capacity - 1)] = j
                            listed += 1
                            if ti.static(self.leaves_out_walls):
                                fluid_neighbours += self.particles.kind[j] == FLUID
        if ti.static(self.leaves_out_walls):  # noqa: SIM102  (a compiled choice stays apart)
            if self.particles.kind[i] == WALL and fluid_neighbours == 0:
                listed = 0
        return listed

    @ti.func
    def _pairs_of(self, i, fill: ti.template()):
        """Return the number of neighbours that are listed for i."""
        listed = 0
        if ti.static(not self.leaves_out_walls) or self.particles.kind[i] != DUMMY:
            listed = self._scan(i, fill)
        return listed

    @stage("neighbours")
    def list(self):
        """Count the pairs of each particle and store them as far as they fit; threads must add up the counts first."""
        self.row_start[0] = 0
        if ti.static(self.one_thread):
            ti.loop_config(serialize=True)
            for i in range(self.particles.count[None]):
                self.row_start[i + 1] = self.row_start[i] + self._pairs_of(i, True)
        else:
            for i in range(self.particles.count[None]):
                self.row_start[i + 1] = self._pairs_of(i, False)
            running_sums(self.row_start, self.particles.count[None])
            for i in range(self.particles.count[None]):
                if self.row_start[i + 1] > self.row_start[i]:
                    self._scan(i, True)
        self.pairs[None] = self.row_start[self.particles.count[None]]
        if ti.static(self.skin > 0.0):
            for i in range(self.particles.count[None]):
                self.listed_at[i] = self.particles.x[i]

    def search(self) -> None:
        """Bring the particles into the order of the cells and list their neighbours at the present positions.

        Nothing is done where the list still holds them. EscapedError if any left the domain, CapacityError when the
        pairs do not fit.
        """
        if self._known and self.skin > 0.0:
            self.find_moved()
            flush()
            if not self.outdated[None]:
                return
        flush()
        self.bins.arrange()
        self.list_pairs()

    def list_pairs(self) -> None:
        """List the neighbours of rows that are in the order of the cells."""
        self.list()
        flush()
        self.bins.check()
        pairs = self.pairs[None]
        if pairs > self.pair_capacity:
            raise CapacityError(f"{pairs} neighbour pairs do not fit into pair_capacity = {self.pair_capacity}")
        self._known = True

    @stage("neighbours")
    def find_moved(self):
        """Whether a particle has gone more than half of the skin since the list was made."""
        self.outdated[None] = 0
        for i in range(self.particles.count[None]):
            displacement = self.bins.displacement(self.listed_at[i], self.particles.x[i])
            if not (displacement.dot(displacement) <= (0.5 * self.skin) ** 2):  # a position that is no number, too
                self.outdated[None] = 1

    def state(self) -> dict:
        """Positions [m] (n, d) at which the list was made, on which a list with a skin depends."""
        listed = self.skin > 0.0 and self._known
        return {"listed_at": self.listed_at.to_numpy()[: self.particles.count[None]]} if listed else {}

    def forget(self) -> None:
        """Forget the list: the particles are elsewhere, and there may be as many pairs as fit."""
        self.pairs[None] = self.pair_capacity
        self._known = False

    @property
    def nearly_full(self) -> bool:
        """Whether the next search may find more pairs than fit."""
        return self.pairs[None] > NEARLY_FULL * self.pair_capacity
