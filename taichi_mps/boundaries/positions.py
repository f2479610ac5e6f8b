"""Positions of the walls, which may move, in time, and the tests that keep particles in front of them and apart."""

from ..geometry.solid import Solid
from ..geometry.walls import Cylinder, Plane
from ..runtime.backend import double_field, real, ti
from ..runtime.stages import flush, stage
from .sampled import Sampled
from .surfaces import CLOSEST, Flat, Round

SURFACES = {Plane: Flat, Cylinder: Round, Solid: Sampled}


@ti.data_oriented
class WallPositions:
    """Static tuple of the surfaces of walls, at a time."""

    def __init__(self, walls, dimension: int, spacing: float, effective_radius: float, capacity: int):
        self.dimension, self.effective_radius, self.closest = dimension, effective_radius, CLOSEST * spacing
        self.clock = double_field()  # time [s] at which the walls stand
        self.time = 0.0  # at which the present step begins [s]
        seen = dimension, spacing, self.clock, capacity, effective_radius
        self.surfaces = tuple(SURFACES[type(wall)](wall, *seen) for wall in walls)
        self.moving = any(wall.speed > 0.0 for wall in walls)
        self.travelling = any(surface.moves for surface in self.surfaces)
        self.in_time = [surface for surface in self.surfaces if surface.in_time]
        self.separating = tuple(surface for surface in self.surfaces if surface.separates)
        if self.separating:
            self.sides = ti.field(real(), (capacity, len(self.separating)))  # signed distance from each of them [m]

    def place(self, time: float) -> None:
        """Put the walls that travel where they are at this time [s]."""
        self.time = time
        self.follow(time)
        if self.travelling:
            self.clock[None] = time

    def follow(self, time: float) -> None:
        """Put the walls whose velocity changes where they are at this time [s]."""
        if self.in_time:
            flush()
        for surface in self.in_time:
            surface.moved[None] = surface.wall.displacement(time)

    def set_velocities(self, dt: float) -> None:
        """Give the walls whose velocity changes its mean over a step of dt [s]."""
        if self.in_time:
            flush()
        for surface in self.in_time:
            surface.mean[None] = surface.wall.mean_velocity(self.time, self.time + dt)

    def move_to_middle(self, dt: float) -> None:
        """Put the walls where they are in the middle of a step of dt [s]."""
        self.follow(self.time + 0.5 * dt)
        if self.travelling:
            self.set_clock(self.time + 0.5 * dt)

    def move_to_end(self, dt: float) -> None:
        """Put the walls where they are at the end of a step of dt [s], from its middle."""
        self.follow(self.time + dt)
        if self.travelling:
            self.set_clock(self.time + 0.5 * dt + 0.5 * dt)
        self.time += dt

    @stage("walls")
    def set_clock(self, time: ti.f64):
        """Put the walls that travel where they are at this time [s]."""
        self.clock[None] = time

    @ti.func
    def set_sides(self, i, x):
        """Keep the signed distances of particle i, at x [m], from the walls that separate."""
        for s, wall in ti.static(enumerate(self.separating)):
            self.sides[i, s] = wall.signed(x)

    @ti.func
    def between(self, i, j, x, y):
        """Whether a thin wall or a solid stands between particles i and j, at x and y [m], whose sides are kept."""
        hidden = False
        for s, wall in ti.static(enumerate(self.separating)):
            hidden = hidden or wall.between(x, y, self.sides[i, s], self.sides[j, s])
        return hidden

    @ti.func
    def outside(self, x, move):
        """x + move, kept out of the solids [m]: at least ``closest`` in front of every wall."""
        y = x + move
        for wall in ti.static(self.surfaces):
            y = wall.keep_in_front(x, y, self.closest)
        return y
