"""The active set: particles at rest are left out of a step, which computes moving ones and a border around them.

By cells of the binning grid: those that hold something that moves, and the ones around them, are active. Around these
stand, in the next ring, particles that do not move but carry stress, which the active ones push against; then one ring
of buried ones, which only fill the neighbourhoods of the standing ones. All others are set aside, in the rows behind
those in use. So every loop over particles is one over these three, and the forces across the border balance.

Every EVERY steps, and in each step whose result is read, all particles take part: there loads that have grown reach
what stands, and what they move is active from then on. Before that, too, as soon as a standing particle yields or an
active one comes near a buried one.
"""

from ..runtime.backend import ti
from ..runtime.stages import flush, stage
from .particles import ASIDE, BURIED, FLUID, STANDING

EVERY = 20  # steps, of which one is taken by all: what stands costs a twentieth
PAYS = 0.2  # part of the particles that must stand still, and be set aside
RINGS = 4  # cells from what moves: 0, 1 active, 2 standing, 3 buried, from here on aside


@ti.data_oriented
class ActiveSet:
    """Set of the rows that a step computes. ``standstill`` judges particles: ``holds(i)``, ``yields(i)``, ``age(i,
    time)``.

    ``whole``: whether the present step is taken by all; ``left_out``: particles that do not move in it;
    ``mean_part_left_out``: their part of the particles, mean of all steps [-].
    """

    def __init__(self, neighbors, standstill):
        self.neighbors, self.bins, self.particles = neighbors, neighbors.bins, neighbors.particles
        self.standstill = standstill
        self.ring = ti.field(ti.i32, self.bins.cells)  # cells from the next one that moves, RINGS at most
        self.near_buried = ti.field(ti.i32, self.bins.cells)  # 1 where an active particle would come near buried ones
        self.numbers = ti.Vector.field(3, ti.i32, ())  # particles that stand, buried, aside
        self.left = ti.field(ti.i32, ())  # 1 where a standing particle yields, or an active one left its cells
        self.holding = ti.field(ti.i32, ())  # particles that stand still
        self.kept_id = next(twin for field, twin in self.particles.twins if field is self.particles.id)
        self.whole, self.left_out, self.time_aside = True, 0, 0.0  # of the present step; since the set was found [s]
        self.standing, self.steps = 0.0, 0  # part that stood still at the last step of all [-], steps since
        self.all_steps, self.mean_part_left_out = 0, 0.0
        self.particles.recall = self.recall

    # ---- a step ---------------------------------------------------------------------------------------------
    def search(self, is_read: bool) -> None:
        """Set aside what stands, or bring it back, and list the neighbours of the rows of this step, whose result is
        ``is_read`` or not."""
        self.steps += 1
        self.whole = is_read or self.standing < PAYS or self.steps >= EVERY
        if self.whole:
            self.recall()
            self.neighbors.search()
        elif self.left_out and not self.someone_leaves():
            self.neighbors.search()
        else:
            self.recall()
            self.divide()

    def end_step(self, dt: float) -> None:
        """Update the counters after a step of dt [s]; after one of all particles, count those that stand still."""
        self.time_aside += dt
        part = self.left_out / self.particles.number
        self.all_steps += 1
        self.mean_part_left_out += (part - self.mean_part_left_out) / self.all_steps
        if self.whole and (self.steps >= EVERY or self.standing >= PAYS):
            self.steps = 0
            self.count_holding()
            flush()
            self.standing = self.holding[None] / self.particles.number

    def wake(self) -> None:
        """Let all particles take part in the next steps, until those that stand still are counted again."""
        self.standing = 0.0

    def someone_leaves(self) -> bool:
        """Whether a standing particle yields, or an active one comes near a buried one."""
        self.find_reactivated()
        flush()
        return bool(self.left[None])

    def state(self) -> dict:
        """State that the choice of the next step's rows depends on."""
        return {"active_set": [self.steps, self.standing, self.all_steps, self.mean_part_left_out]}

    def load(self, state: dict) -> None:
        """Go on from a state."""
        carried = state.get("active_set", (0, 0.0, 0, 0.0))
        self.steps, self.standing, self.all_steps, self.mean_part_left_out = carried

    # ---- who takes part -------------------------------------------------------------------------------------
    def divide(self) -> None:
        """Sort the particles by how far they are from what moves, set those far from it aside, and list the neighbours
        of the others."""
        flush()
        self.bins.arrange()
        self.find_rings()
        self.mark()
        flush()
        self.bins.check()
        standing, buried, aside = self.numbers[None]
        if aside < max(PAYS * self.particles.count[None], buried):
            self.unmark()
            self.whole, self.standing = True, 0.0  # until it is counted again
        else:
            self.bins.arrange()
            self.set_aside()
            self.left_out, self.time_aside = standing + buried + aside, 0.0
        self.neighbors.list_pairs()

    @stage("active set")
    def count_holding(self):
        self.holding[None] = 0
        for i in range(self.particles.count[None]):
            if self.standstill.holds(i):
                self.holding[None] += 1

    @stage("active set")
    def find_rings(self):
        """Set the ring of each cell: its distance in cells from the nearest that holds a moving particle."""
        for k in range(self.bins.cells):
            self.ring[k] = RINGS
        for i in range(self.particles.count[None]):
            if not self.standstill.holds(i):
                self.ring[self.bins.cell_of[i]] = 0
        for ring in ti.static(range(1, RINGS)):
            for c in ti.grouped(ti.ndrange(*self.bins.shape)):
                k = self.bins.linear(c)
                if self.ring[k] == RINGS:
                    for offset in ti.grouped(ti.ndrange(*((-1, 2),) * self.bins.dimension)):
                        other = self.bins.linear(c + offset)
                        if other >= 0 and self.ring[other] == ring - 1:
                            self.ring[k] = ring

    @stage("active set")
    def mark(self):
        """Mark each particle as active or asleep in the coming steps, and each cell that active particles may enter."""
        for c in ti.grouped(ti.ndrange(*self.bins.shape)):
            k = self.bins.linear(c)
            self.near_buried[k] = 0
            for offset in ti.grouped(ti.ndrange(*((-1, 2),) * self.bins.dimension)):
                other = self.bins.linear(c + offset)
                if other >= 0 and self.ring[other] >= RINGS - 1:  # noqa: SIM102  (a kernel evaluates both sides)
                    if self.bins.cell_start[other + 1] > self.bins.cell_start[other]:
                        self.near_buried[k] = 1
        self.numbers[None] = ti.Vector([0, 0, 0])
        for i in range(self.particles.count[None]):
            beyond = self.ring[self.bins.cell_of[i]] - 2
            for k, kind in ti.static(enumerate((STANDING, BURIED, ASIDE))):
                if beyond == k:
                    self.particles.kind[i] = kind
                    ti.atomic_add(self.numbers[None][k], 1)

    @stage("active set")
    def unmark(self):
        """Mark all particles as active again."""
        for i in range(self.particles.count[None]):
            if self.particles.kind[i] >= STANDING:
                self.particles.kind[i] = FLUID

    @stage("active set")
    def set_aside(self):
        """The rows in use are those in front of what is aside. What buried particles carry is kept behind them, in the
        scratch rows of the reorder, for a step means nothing there."""
        for i in range(self.particles.count[None]):
            if self.particles.kind[i] >= STANDING:
                self.particles.u[i] = ti.zero(self.particles.u[i])
                self.particles.a[i] = ti.zero(self.particles.a[i])
        total, rows = self.particles.count[None], self.bins.cell_start[self.bins.cells]
        self.particles.count[None], self.particles.aside[None] = rows, total - rows
        kept = rows
        ti.loop_config(serialize=True)
        for i in range(rows):
            if self.particles.kind[i] == BURIED:
                for field, twin in ti.static(self.particles.twins):
                    twin[kept] = field[i]
                kept += 1

    @stage("active set")
    def find_reactivated(self):
        """Whether a standing particle yields, or an active one comes near a buried one."""
        self.left[None] = 0
        for i in range(self.particles.count[None]):
            kind = self.particles.kind[i]
            if kind == STANDING:
                if self.standstill.yields(i):
                    self.left[None] = 1
            elif kind == FLUID:
                k = self.bins.linear(self.bins.cell(self.particles.x[i]))
                if self.near_buried[k] == 1:
                    self.left[None] = 1

    # ---- all again ------------------------------------------------------------------------------------------
    def recall(self) -> None:
        """Bring back all particles that were set aside, with the fields they carried and their structure grown."""
        if self.left_out:
            flush()
            self.bring_back(self.time_aside)
            self.left_out = 0
            flush()

    @stage("active set")
    def bring_back(self, time: float):
        kept = self.particles.count[None]
        for i in range(kept):
            if self.particles.kind[i] == BURIED:
                self.particles.source_row[self.particles.id[i]] = i
        for k in range(kept, kept + self.numbers[None][1]):
            for field, twin in ti.static(self.particles.twins):
                field[self.particles.source_row[self.kept_id[k]]] = twin[k]
        for i in range(kept + self.particles.aside[None]):
            kind = self.particles.kind[i]
            if kind >= BURIED:
                self.standstill.age(i, time)
            if kind >= STANDING:
                self.particles.kind[i] = FLUID
        self.particles.count[None] += self.particles.aside[None]
        self.particles.aside[None] = 0
