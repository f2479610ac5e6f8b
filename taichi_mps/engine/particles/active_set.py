"""The active set: particles at rest are excluded from a step, which computes moving ones and a border around them.

By cells of the binning grid: cells that hold a moving particle, and the cells around them, are active. The next layer
of cells is the boundary: its particles do not move but carry stress, which the active ones push against. The layer
after it is the halo, which only fills the neighbourhoods of boundary particles. All others are excluded, in the rows
behind those in use. So every loop over particles is one over these three, and the forces across the border balance.

Every FULL_STEP_INTERVAL steps, and in every step whose result is read, all particles take part: there loads that have
grown reach the particles at rest, and those that they move are active from then on. Before that, too, as soon as a
boundary particle yields or an active one comes near the halo.
"""

from ..runtime.backend import ti
from ..runtime.stages import flush, stage
from .particles import BOUNDARY, EXCLUDED, FLUID, HALO

FULL_STEP_INTERVAL = 20  # steps, of which one is taken by all: a particle at rest costs a twentieth
MIN_EXCLUDED_FRACTION = 0.2  # fraction of the particles that must be at rest, and be excluded
MAX_CELL_DISTANCE = 4  # cells from a moving particle: 0 and 1 active, 2 boundary, 3 halo, from here on excluded


@ti.data_oriented
class ActiveSet:
    """Set of the rows that a step computes. ``standstill`` judges particles: ``is_at_rest(i)``, ``would_move(i)``,
    ``age(i, time)``.

    ``is_full_step``: whether the present step is taken by all; ``left_out``: particles that do not move in it;
    ``mean_part_left_out``: their fraction of all particles, mean of all steps [-].
    """

    def __init__(self, neighbors, standstill):
        self.neighbors, self.bins, self.particles = neighbors, neighbors.bins, neighbors.particles
        self.standstill = standstill
        # cells from the nearest one that holds a moving particle, MAX_CELL_DISTANCE at most
        self.cell_distance = ti.field(ti.i32, self.bins.cells)
        self.near_halo = ti.field(ti.i32, self.bins.cells)  # 1 where an active particle would come near the halo
        self.counts = ti.Vector.field(3, ti.i32, ())  # particles of the boundary, of the halo, excluded
        self.must_update = ti.field(ti.i32, ())  # 1 where a boundary particle yields, or an active one is near the halo
        self.at_rest = ti.field(ti.i32, ())  # number of particles at rest
        self.kept_id = next(buffer for field, buffer in self.particles.buffers if field is self.particles.id)
        self.is_full_step, self.left_out = True, 0  # of the present step
        self.excluded_time = 0.0  # since the set was found [s]
        self.rest_fraction, self.steps = 0.0, 0  # fraction at rest at the last step of all [-], steps since
        self.all_steps, self.mean_part_left_out = 0, 0.0
        self.particles.restore_all = self.restore_all

    # ---- a step ---------------------------------------------------------------------------------------------
    def search(self, is_read: bool) -> None:
        """Exclude particles at rest, or bring them back, and list the neighbours of the rows of this step, whose result
        is ``is_read`` or not."""
        self.steps += 1
        self.is_full_step = is_read or self.rest_fraction < MIN_EXCLUDED_FRACTION or self.steps >= FULL_STEP_INTERVAL
        if self.is_full_step:
            self.restore_all()
            self.neighbors.search()
        elif self.left_out and not self.needs_update():
            self.neighbors.search()
        else:
            self.restore_all()
            self.partition()

    def end_step(self, dt: float) -> None:
        """Update the counters after a step of dt [s]; after one of all particles, count those at rest."""
        self.excluded_time += dt
        self.all_steps += 1
        self.mean_part_left_out += (self.left_out / self.particles.number - self.mean_part_left_out) / self.all_steps
        if self.is_full_step and (self.steps >= FULL_STEP_INTERVAL or self.rest_fraction >= MIN_EXCLUDED_FRACTION):
            self.steps = 0
            self.count_at_rest()
            flush()
            self.rest_fraction = self.at_rest[None] / self.particles.number

    def reactivate(self) -> None:
        """Let all particles take part in the next steps, until those at rest are counted again."""
        self.rest_fraction = 0.0

    def needs_update(self) -> bool:
        """Whether a boundary particle yields, or an active one comes near the halo."""
        self.find_reactivated()
        flush()
        return bool(self.must_update[None])

    def state(self) -> dict:
        """State that the choice of the next step's rows depends on."""
        return {"active_set": [self.steps, self.rest_fraction, self.all_steps, self.mean_part_left_out]}

    def load(self, state: dict) -> None:
        """Load the scalars of a saved state."""
        carried = state.get("active_set", (0, 0.0, 0, 0.0))
        self.steps, self.rest_fraction, self.all_steps, self.mean_part_left_out = carried

    # ---- who takes part -------------------------------------------------------------------------------------
    def partition(self) -> None:
        """Sort the particles by their distance from moving ones, exclude the distant ones, and list the neighbours of
        the others."""
        flush()
        self.bins.arrange()
        self.find_cell_distances()
        self.mark()
        flush()
        self.bins.check()
        boundary, halo, excluded = self.counts[None]
        if excluded < max(MIN_EXCLUDED_FRACTION * self.particles.count[None], halo):
            self.mark_all_active()
            self.is_full_step, self.rest_fraction = True, 0.0  # until it is counted again
        else:
            self.bins.arrange()
            self.exclude()
            self.left_out, self.excluded_time = boundary + halo + excluded, 0.0
        self.neighbors.list_pairs()

    @stage("active set")
    def count_at_rest(self):
        self.at_rest[None] = 0
        for i in range(self.particles.count[None]):
            if self.standstill.is_at_rest(i):
                self.at_rest[None] += 1

    @stage("active set")
    def find_cell_distances(self):
        """Set the distance of each cell, in cells, from the nearest one that holds a moving particle."""
        for k in range(self.bins.cells):
            self.cell_distance[k] = MAX_CELL_DISTANCE
        for i in range(self.particles.count[None]):
            if not self.standstill.is_at_rest(i):
                self.cell_distance[self.bins.cell_of[i]] = 0
        for distance in ti.static(range(1, MAX_CELL_DISTANCE)):
            for c in ti.grouped(ti.ndrange(*self.bins.shape)):
                k = self.bins.linear(c)
                if self.cell_distance[k] == MAX_CELL_DISTANCE:
                    for offset in ti.grouped(ti.ndrange(*((-1, 2),) * self.bins.dimension)):
                        other = self.bins.linear(c + offset)
                        if other >= 0 and self.cell_distance[other] == distance - 1:
                            self.cell_distance[k] = distance

    @stage("active set")
    def mark(self):
        """Mark the particles of boundary and halo and those excluded, and each cell that is near the halo."""
        for c in ti.grouped(ti.ndrange(*self.bins.shape)):
            k = self.bins.linear(c)
            self.near_halo[k] = 0
            for offset in ti.grouped(ti.ndrange(*((-1, 2),) * self.bins.dimension)):
                other = self.bins.linear(c + offset)
                if other >= 0 and self.cell_distance[other] >= MAX_CELL_DISTANCE - 1:  # noqa: SIM102  (a kernel evaluates both sides)
                    if self.bins.cell_start[other + 1] > self.bins.cell_start[other]:
                        self.near_halo[k] = 1
        self.counts[None] = ti.Vector([0, 0, 0])
        for i in range(self.particles.count[None]):
            beyond = self.cell_distance[self.bins.cell_of[i]] - 2
            for k, kind in ti.static(enumerate((BOUNDARY, HALO, EXCLUDED))):
                if beyond == k:
                    self.particles.kind[i] = kind
                    ti.atomic_add(self.counts[None][k], 1)

    @stage("active set")
    def mark_all_active(self):
        """Mark all particles as active again."""
        for i in range(self.particles.count[None]):
            if self.particles.kind[i] >= BOUNDARY:
                self.particles.kind[i] = FLUID

    @stage("active set")
    def exclude(self):
        """Leave excluded particles out of the rows in use. The fields of the halo are kept behind these, in the scratch
        rows of the reorder, for a step overwrites them without meaning."""
        for i in range(self.particles.count[None]):
            if self.particles.kind[i] >= BOUNDARY:
                self.particles.u[i] = ti.zero(self.particles.u[i])
                self.particles.a[i] = ti.zero(self.particles.a[i])
        total, rows = self.particles.count[None], self.bins.cell_start[self.bins.cells]
        self.particles.count[None], self.particles.excluded[None] = rows, total - rows
        halo_end = rows
        ti.loop_config(serialize=True)
        for i in range(rows):
            if self.particles.kind[i] == HALO:
                for field, buffer in ti.static(self.particles.buffers):
                    buffer[halo_end] = field[i]
                halo_end += 1

    @stage("active set")
    def find_reactivated(self):
        """Whether a boundary particle yields, or an active one comes near the halo."""
        self.must_update[None] = 0
        for i in range(self.particles.count[None]):
            kind = self.particles.kind[i]
            if kind == BOUNDARY:
                if self.standstill.would_move(i):
                    self.must_update[None] = 1
            elif kind == FLUID:
                k = self.bins.linear(self.bins.cell(self.particles.x[i]))
                if self.near_halo[k] == 1:
                    self.must_update[None] = 1

    # ---- all again ------------------------------------------------------------------------------------------
    def restore_all(self) -> None:
        """Bring back all excluded particles, with the fields they carried and their structure grown."""
        if self.left_out:
            flush()
            self.restore(self.excluded_time)
            self.left_out = 0
            flush()

    @stage("active set")
    def restore(self, time: float):
        active = self.particles.count[None]
        for i in range(active):
            if self.particles.kind[i] == HALO:
                self.particles.source_row[self.particles.id[i]] = i
        for k in range(active, active + self.counts[None][1]):
            for field, buffer in ti.static(self.particles.buffers):
                field[self.particles.source_row[self.kept_id[k]]] = buffer[k]
        for i in range(active + self.particles.excluded[None]):
            kind = self.particles.kind[i]
            if kind >= HALO:
                self.standstill.age(i, time)
            if kind >= BOUNDARY:
                self.particles.kind[i] = FLUID
        self.particles.count[None] += self.particles.excluded[None]
        self.particles.excluded[None] = 0
