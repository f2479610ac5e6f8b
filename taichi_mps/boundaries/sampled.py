"""A solid as a point sees it: a signed distance on a grid, which may travel and turn, and the faces of inner edges."""

import numpy as np

from ..geometry.concave_edges import inner_edges
from ..runtime.backend import real, ti
from .face_search import search_faces
from .ghosts import vectors
from .surfaces import FAR, Surface


@ti.data_oriented
class Sampled(Surface):
    """A solid whose signed distance is linear between the nodes of a grid; its curvature is not known."""

    def __init__(self, wall, dimension: int, spacing: float, clock, capacity: int, effective_radius: float):
        super().__init__(wall, dimension, spacing, clock, capacity, effective_radius)
        self.separates, self.steepest = True, wall.steepest
        self.dimension, self.cell, self.shape = dimension, wall.cell, wall.values.shape
        self.values = ti.field(real(), self.shape)
        self.values.from_numpy(wall.values)
        self.velocity = ti.types.vector(dimension, real())(wall.travel)
        self.turns, self.rate = wall.angular_velocity != 0.0, wall.angular_velocity
        self.moves = self.travels or self.turns
        if self.turns:
            self.centre = ti.types.vector(dimension, ti.f64)(wall.centre)
            self.spin = ti.types.matrix(dimension, dimension, ti.f64)(wall.spin)
        # what each particle sees of the solid, and beside inner edges the faces that meet there
        self.reach = effective_radius - 0.5 * spacing  # of the ghosts: the first is half a spacing behind a face
        number, planes = inner_edges(wall.values, self.cell, self.reach, search_faces)
        self.faces = planes.shape[1]
        if self.faces > 1:
            self.number = ti.field(ti.i32, self.shape)  # row of a node among the planes, -1: the nearest face is all
            self.number.from_numpy(number)
            self.planes = vectors(np.where(np.isinf(planes), FAR, planes))  # distance [m], normal
        self.z = ti.field(real(), (capacity, self.faces))  # [m]
        self.n = ti.Vector.field(self.dimension, real(), (capacity, self.faces))

    @ti.func
    def rotation(self):
        """From 0 s to the time at which the walls stand."""
        angle, K = self.rate * self.clock[None], self.spin / self.rate
        return ti.Matrix.identity(ti.f64, self.dimension) + ti.sin(angle) * K + (1.0 - ti.cos(angle)) * K @ K

    @ti.func
    def arm(self, x):
        """From the centre to x [m]."""
        arm = x - self.point
        if ti.static(self.turns):
            arm = x - self.centre
        if ti.static(self.travels):
            arm -= self.clock[None] * self.travel
        return arm

    @ti.func
    def offset(self, x):
        """From the first node to x [m], as the solid stood at 0 s."""
        offset = self.arm(x)
        if ti.static(self.turns):
            offset = self.rotation().transpose() @ offset + self.centre - self.point
        return offset

    @ti.func
    def as_it_stands(self, n):
        """A direction of the solid at 0 s, turned with it."""
        turned = n
        if ti.static(self.turns):
            turned = ti.cast(self.rotation() @ ti.cast(n, ti.f64), float)
        return turned

    @ti.func
    def motion(self, foot):
        """Velocity [m/s] of the solid at a place [m]."""
        velocity = self.velocity
        if ti.static(self.turns):
            velocity += ti.cast(self.spin @ self.arm(foot), float)
        return velocity

    @ti.func
    def find_faces(self, i, x):
        z, n, _velocity, _curvature = self.nearest(x)
        self.z[i, 0], self.n[i, 0] = z, n
        if ti.static(self.faces > 1):
            for slot in range(1, self.faces):
                self.z[i, slot] = FAR
            if z < self.reach:
                place = self.offset(x) / self.cell
                first = ti.min(ti.cast(place, ti.i32), ti.Vector(self.shape) - 2)
                node = first  # of those around the one farthest from the solid: the faces are clear there
                for corner in ti.static(ti.ndrange(*((2,) * self.dimension))):
                    if self.values[first + ti.Vector(corner)] > self.values[node]:
                        node = first + ti.Vector(corner)
                row = self.number[node]
                if row >= 0:
                    offset = ti.cast((place - node) * self.cell, float)
                    for slot in range(self.faces):
                        plane = self.planes[row, slot]
                        for a in ti.static(range(self.dimension)):
                            self.n[i, slot][a] = plane[1 + a]
                        self.z[i, slot] = plane[0] + self.n[i, slot].dot(offset)
                        self.n[i, slot] = self.as_it_stands(self.n[i, slot])
                        if ti.static(self.has_friction):  # noqa: SIM102  (friction acts on the first face: the nearest one)
                            if self.z[i, slot] < self.z[i, 0]:
                                z, n = self.z[i, 0], self.n[i, 0]
                                self.z[i, 0], self.n[i, 0] = self.z[i, slot], self.n[i, slot]
                                self.z[i, slot], self.n[i, slot] = z, n

    @ti.func
    def face(self, i, x, slot: ti.template()):
        z, n = self.z[i, slot], self.n[i, slot]
        return z, n, self.motion(x - ti.cast(z * n, ti.f64)), ti.cast(0.0, float)

    @ti.func
    def sample(self, x):
        """Distance [m] and its gradient [-]; FAR beyond the grid."""
        place = self.offset(x) / self.cell
        z, slope = ti.cast(FAR, float), ti.Vector.unit(self.dimension, 0, float)
        if (place >= 0.0).all() and (place <= ti.Vector(self.shape) - 1).all():
            z, slope = ti.cast(0.0, float), ti.Vector.zero(float, self.dimension)
            k = ti.min(ti.cast(place, ti.i32), ti.Vector(self.shape) - 2)
            f = ti.cast(place - k, float)
            for corner in ti.static(ti.ndrange(*((2,) * self.dimension))):
                value = self.values[k + ti.Vector(corner)]
                weight = ti.cast(1.0, float)
                for a in ti.static(range(self.dimension)):
                    weight *= f[a] if corner[a] else 1.0 - f[a]
                z += weight * value
                for a in ti.static(range(self.dimension)):
                    rise = ti.cast(1.0 if corner[a] else -1.0, float)
                    for b in ti.static(range(self.dimension)):
                        if ti.static(a != b):
                            rise *= f[b] if corner[b] else 1.0 - f[b]
                    slope[a] += rise * value / self.cell
        return z, slope

    @ti.func
    def signed(self, x):
        z, _slope = self.sample(x)
        return z

    @ti.func
    def nearest(self, x):
        z, slope = self.sample(x)
        n = self.as_it_stands(slope / ti.max(slope.norm(), 1e-6))
        return z, n, self.motion(x - ti.cast(z * n, ti.f64)), ti.cast(0.0, float)

    @ti.func
    def drives_near(self, x, reach: ti.template(), ahead: ti.template()):
        """As of any surface; its distance is known within ``reach`` only, so x is seen from where it comes to."""
        near = False
        for k in ti.static(range(1 + int(np.ceil(ahead / reach)))):
            way = ti.cast(self.motion(x) * (k * reach / self.speed), ti.f64)
            near = near or self.signed(x - way) < reach
        return near
