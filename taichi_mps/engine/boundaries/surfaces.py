"""Wall surfaces as Taichi functions: distance of a point, and normal, velocity and curvature of the wall at its foot.

``nearest(x)`` gives the distance z [m] of x, positive in the fluid; the unit normal n into the fluid; the velocity
[m/s] of the wall at the foot x - z n, which no slip imposes on the fluid; and its curvature k [1/m], positive where the
fluid is inside.

A wall that moves has its position at the time ``clock`` [s]. A thin one has fluid on both sides: z is positive and n
points to the side of x; ``signed_distance(x)`` tells the side, ``distance_beyond_edge(x)`` how far outside the edge the
foot is [m].
"""

from copy import copy

import numpy as np

from ..geometry.walls import spin
from ..runtime.backend import double_field, real, ti

FAR = 1e9  # distance [m] given for a wall that ends before the foot
MIN_DISTANCE = 0.1  # least distance of a particle from a wall, over the spacing [-]
# distances over the spacing up to which a unilateral wall acts fully, and from which on not at all [-]
FULL_CONTACT, NO_CONTACT = 0.5, 0.55


@ti.data_oriented
class Surface:
    """Base class of wall surfaces: distance, normal and velocity at the foot of a point, and the fraction of the wall
    that acts on a particle."""

    curved = rotates = separates = False
    faces = 1  # largest number of faces in front of a particle
    cut_by = ()  # walls at right angles where its ghosts end

    def __init__(self, wall, dimension: int, spacing: float, clock, capacity: int, effective_radius: float):
        """``capacity``: rows of the fields per particle; ``effective_radius``: distance up to which the wall acts
        [m]."""
        self.slip, self.thin, self.unilateral, self.spacing = wall.slip, wall.thin, wall.loose, spacing
        self.has_friction, self.friction = wall.friction is not None, None  # friction: set by Walls
        self.resists_slip, self.no_slip = not wall.slip, not wall.slip and not self.has_friction
        self.releases, self.particles, self.released = False, None, None  # of a unilateral wall; set by Walls
        self.clock, self.travels = clock, bool(np.any(wall.travel))  # whether it is translated
        self.changes_position = self.travels  # whether its position changes
        self.moving, self.speed = wall.speed > 0.0, wall.speed  # whether it moves, also within its surface; [m/s]
        self.separates = wall.thin  # whether fluid on its two sides does not interact
        self.travel = ti.types.vector(dimension, ti.f64)(wall.travel)
        self.point = ti.types.vector(dimension, ti.f64)(wall.point)
        self.wall, self.velocity_varies = wall, wall.in_time is not None  # whether its velocity changes
        if self.velocity_varies:  # way since 0 s [m], and mean velocity of the step [m/s]
            self.moved, self.mean_velocity = (double_field(components=dimension) for _ in range(2))

    @ti.func
    def arm(self, x):
        """Vector to x [m] from the point about which torques are taken."""
        return self.offset(x)

    @ti.func
    def offset(self, x):
        """Vector from the point of the wall to x [m]."""
        if ti.static(self.travels):
            return x - self.point - self.displacement()
        else:
            return x - self.point

    @ti.func
    def displacement(self):
        """Displacement of the wall since 0 s [m]."""
        if ti.static(self.velocity_varies):
            return self.moved[None]
        else:
            return self.clock[None] * self.travel

    @ti.func
    def translation_velocity(self):
        """Velocity of the wall without rotation [m/s]."""
        if ti.static(self.velocity_varies):
            return ti.cast(self.mean_velocity[None], float)
        else:
            return self.velocity

    def frictionless(self):
        """Return a copy of this wall with slip instead of friction."""
        other = copy(self)
        other.slip, other.resists_slip, other.has_friction, other.friction = True, False, False, None
        return other

    @ti.func
    def find_faces(self, i, x):
        """Find the faces before particle i at x [m], once a step; no-op for a wall of one face."""

    @ti.func
    def face(self, i, x, slot: ti.template()):
        """Distance, normal, velocity and curvature, as from ``nearest``, of one of the faces in front of particle i at
        x [m]."""
        return self.nearest(x)

    @ti.func
    def update_release(self, i, x):
        """Update, once a step, whether particle i is released from a unilateral wall: it is where it moves away from
        the wall and does not press on it, until it approaches again."""
        _z, n, velocity, _curvature = self.nearest(x)
        leaves = n.dot(self.particles.u[i] - velocity) > 0.0
        pressure = self.particles.p[i]
        if ti.static(self.particles.carries_stress):
            for a, b in ti.static(ti.ndrange(self.particles.dimension, self.particles.dimension)):
                pressure -= n[a] * self.particles.stress[i][a, b] * n[b]
        self.released[i] = ti.cast(leaves and (self.released[i] == 1.0 or pressure <= 0.0), float)

    @ti.func
    def moves_near(self, x, max_distance: ti.template(), ahead: ti.template()):
        """Whether the moving wall is within ``max_distance`` [m] of x, or will be after ``ahead`` [m] of motion."""
        z, _n, velocity, _curvature = self.nearest(x)
        return z < max_distance + ahead and velocity.norm_sqr() > 0.0

    @ti.func
    def weight(self, i, x, z):
        """Fraction of the wall that acts on particle i at x, at the distance z, 0 to 1. A thin wall fades out over a
        spacing beyond its edge, where the other side comes in view; a unilateral one as a gap opens, and where the
        particle is released, so that it can only push."""
        weight = ti.cast(1.0, float)
        if ti.static(self.thin):
            weight *= ti.cast(ti.max(0.0, ti.min(1.0, 1.0 - self.distance_beyond_edge(x) / self.spacing)), float)
        if ti.static(self.unilateral):
            weight *= ti.max(0.0, ti.min(1.0, (NO_CONTACT - z / self.spacing) / (NO_CONTACT - FULL_CONTACT)))
            if ti.static(self.releases):
                weight *= 1.0 - self.released[i]
        return weight

    @ti.func
    def stands_between(self, x, y, a, b):
        """Whether the wall separates two points at the signed distances a and b [m] from it: the same for (y, x), or
        forces were not opposite. A segment through a plate meets it at the ratio of the distances of its ends; of one
        that meets a solid, their sum is at most its length times the slope of the distance.
        """
        hidden = a * b < 0.0
        if ti.static(not self.thin):
            hidden = a + b < self.steepest * (y - x).norm()
        if hidden:
            middle = (ti.abs(b) * x + ti.abs(a) * y) / ti.max(ti.abs(a) + ti.abs(b), 1e-12)
            if ti.static(self.thin):  # noqa: SIM108  (a compiled choice stays apart)
                hidden = self.distance_beyond_edge(middle) <= 0.0
            else:
                hidden = self.signed_distance(middle) < 0.0
        return hidden

    @ti.func
    def keep_in_front(self, x, y, closest):
        """Point y [m], or the point at the distance ``closest`` in front of the wall, on the side of x, if y is nearer
        or behind."""
        z, n, _velocity, _curvature = self.nearest(y)
        target = ti.cast(closest, float)
        if ti.static(self.thin):
            if self.distance_beyond_edge(x) <= 0.0 and self.signed_distance(x) * self.signed_distance(y) < 0.0:
                n, z = -n, -z
            if self.distance_beyond_edge(y) > 0.0:
                z = target
        moved = y
        if z < target:
            moved = y + ti.cast(n * (target - z), ti.f64)
        return moved


@ti.data_oriented
class PlaneSurface(Surface):
    """Surface of a plane for kernels."""

    def __init__(self, wall, dimension: int, *others):
        super().__init__(wall, dimension, *others)
        vector = ti.types.vector(dimension, real())
        self.normal = vector(wall.normal)
        self.velocity = vector(wall.fastest)

    @ti.func
    def nearest(self, x):
        z = ti.cast(self.offset(x).dot(ti.cast(self.normal, ti.f64)), float)
        return z, self.normal, self.translation_velocity(), ti.cast(0.0, float)


@ti.data_oriented
class CylinderSurface(Surface):
    """Surface of a circle (2-D), a cylinder or the mantle of a truncated cone for kernels; a point at the height s has
    its foot at the radius |x - point - s axis| + z n_r."""

    curved = True

    def __init__(self, wall, dimension: int, *others):
        super().__init__(wall, dimension, *others)
        self.rotates, self.radius = wall.angular_velocity != 0.0, wall.radius
        self.axis = ti.types.vector(dimension, ti.f64)(wall.unit_axis)  # zero in 2-D
        self.side = 1.0 if wall.inside else -1.0
        self.slope, self.ends, self.length = wall.slope, wall.length is not None, wall.length
        self.cosine = 1.0 / (1.0 + wall.slope**2) ** 0.5
        self.velocity = 0.0 if wall.in_time else wall.velocity  # along the axis [m/s]
        # gradient of the wall's velocity [1/s]
        self.spin = ti.types.matrix(dimension, dimension, ti.f64)(
            spin(wall.angular_velocity, wall.unit_axis, dimension)
        )

    @ti.func
    def polar(self, x):
        """Height s [m] above the point, unit radial vector, radius r [m], and z [m], positive on the fluid's side."""
        offset = self.offset(x)
        s = offset.dot(self.axis)
        radial = offset - s * self.axis
        r = radial.norm()
        return s, radial / ti.max(r, 1e-12), r, self.side * self.cosine * (self.radius + self.slope * s - r)

    @ti.func
    def signed_distance(self, x):
        _s, _e, _r, z = self.polar(x)
        return z

    @ti.func
    def distance_beyond_edge(self, x):
        s, _e, _r, z = self.polar(x)
        foot = s - z * self.side * self.cosine * self.slope
        return ti.max(-foot, foot - self.length)

    @ti.func
    def nearest(self, x):
        s, e, r, z = self.polar(x)
        n = self.side * self.cosine * (self.slope * self.axis - e)
        foot = r + self.side * self.cosine * z
        velocity = self.velocity * self.axis + foot * (self.spin @ e)
        if ti.static(self.velocity_varies):
            velocity += self.mean_velocity[None]
        curvature = ti.cast(self.side * self.cosine / foot, float)
        if ti.static(self.ends):
            foot_s = s - z * n.dot(self.axis)
            beyond = ti.max(-foot_s, foot_s - self.length)
            if ti.static(self.thin):
                if z < 0.0:
                    z, n, curvature = -z, -n, -curvature
                if beyond >= self.spacing:
                    z = FAR
            elif beyond > 0.0:
                z = FAR
        return ti.cast(z, float), ti.cast(n, float), ti.cast(velocity, float), curvature
