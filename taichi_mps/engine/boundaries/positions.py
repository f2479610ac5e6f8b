"""Positions of moving walls in time, and the tests that keep particles in front of walls and hide pairs behind them."""

from ..geometry.solid import Solid
from ..geometry.walls import Cylinder, Plane
from ..runtime.backend import double_field, real, ti
from ..runtime.stages import flush, stage
from .sampled import SampledSurface
from .surfaces import MIN_DISTANCE, CylinderSurface, PlaneSurface

SURFACES = {Plane: PlaneSurface, Cylinder: CylinderSurface, Solid: SampledSurface}


@ti.data_oriented
class WallPositions:
    """Surfaces of all walls, at their positions at a time."""

    def __init__(self, walls, dimension: int, spacing: float, effective_radius: float, capacity: int):
        self.dimension, self.effective_radius, self.closest = dimension, effective_radius, MIN_DISTANCE * spacing
        self.clock = double_field()  # time of the walls' positions [s]
        self.time = 0.0  # start of the present step [s]
        self.surfaces = tuple(
            SURFACES[type(wall)](wall, dimension, spacing, self.clock, capacity, effective_radius) for wall in walls
        )
        self.moving = any(wall.speed > 0.0 for wall in walls)
        self.positions_change = any(surface.changes_position for surface in self.surfaces)
        self.varying = [surface for surface in self.surfaces if surface.velocity_varies]
        self.separating = tuple(surface for surface in self.surfaces if surface.separates)
        if self.separating:
            # signed distance from each of them [m]
            self.signed_distances = ti.field(real(), (capacity, len(self.separating)))

    def place(self, time: float) -> None:
        """Set the walls to their positions at a time [s]."""
        self.time = time
        self.set_displacements(time)
        if self.positions_change:
            self.clock[None] = time

    def set_displacements(self, time: float) -> None:
        """Set the displacements, at a time [s], of the walls whose velocity changes."""
        if self.varying:
            flush()
        for surface in self.varying:
            surface.moved[None] = surface.wall.displacement(time)

    def set_velocities(self, dt: float) -> None:
        """Set the mean velocity, over a step of dt [s], of the walls whose velocity changes."""
        if self.varying:
            flush()
        for surface in self.varying:
            surface.mean_velocity[None] = surface.wall.mean_velocity(self.time, self.time + dt)

    def move_to_middle(self, dt: float) -> None:
        """Set the walls to their positions in the middle of a step of dt [s]."""
        self.set_displacements(self.time + 0.5 * dt)
        if self.positions_change:
            self.set_clock(self.time + 0.5 * dt)

    def move_to_end(self, dt: float) -> None:
        """Set the walls to their positions at the end of a step of dt [s], from its middle."""
        self.set_displacements(self.time + dt)
        if self.positions_change:
            self.set_clock(self.time + 0.5 * dt + 0.5 * dt)
        self.time += dt

    @stage("walls")
    def set_clock(self, time: ti.f64):
        """Set the time [s] of the walls' positions."""
        self.clock[None] = time

    @ti.func
    def set_signed_distances(self, i, x):
        """Store the signed distances of particle i, at x [m], from thin walls and solids."""
        for s, wall in ti.static(enumerate(self.separating)):
            self.signed_distances[i, s] = wall.signed_distance(x)

    @ti.func
    def stands_between(self, i, j, x, y):
        """Whether a thin wall or a solid stands between particles i and j, at x and y [m], from their stored signed
        distances."""
        hidden = False
        for s, wall in ti.static(enumerate(self.separating)):
            hidden = hidden or wall.stands_between(x, y, self.signed_distances[i, s], self.signed_distances[j, s])
        return hidden

    @ti.func
    def keep_in_fluid(self, x, move):
        """Point x + move [m], moved to at least ``closest`` in front of every wall."""
        y = x + move
        for wall in ti.static(self.surfaces):
            y = wall.keep_in_front(x, y, self.closest)
        return y
