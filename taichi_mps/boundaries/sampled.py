"""A solid as a point sees it: a signed distance on a grid, which may travel and turn, and the faces of inner edges,
in front of which its nodes stand (concave_edges.py)."""

import numpy as np

from ..geometry.concave_edges import BEYOND, TURN, inner_edges
from ..runtime.backend import constant_fields, real, ti
from .surfaces import FAR, Surface

SAME = 1e-9  # cells: a foot is not nearer by less


@ti.data_oriented
class Sampled(Surface):
    """A solid whose signed distance is linear between the nodes of a grid; its curvature is not known."""

    def __init__(self, wall, dimension: int, spacing: float, clock, capacity: int, effective_radius: float):
        super().__init__(wall, dimension, spacing, clock, capacity, effective_radius)
        self.separates, self.steepest = True, wall.steepest
        self.dimension, self.cell, self.shape = dimension, wall.cell, wall.values.shape
        (self.values,) = constant_fields(wall.values)
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
            (self.number,) = constant_fields(number)  # row of a node among the planes, -1: the nearest face is all
            (self.planes,) = constant_fields(
                np.where(np.isinf(planes), FAR, planes), vectors=True
            )  # distance [m], normal
        self.z = ti.field(real(), (capacity, self.faces))  # [m]
        self.n = ti.Vector.field(self.dimension, real(), (capacity, self.faces))

    @ti.func
    def rotation(self):
        """Rotation of the solid from 0 s to the time at which the walls stand."""
        angle, K = self.rate * self.clock[None], self.spin / self.rate
        return ti.Matrix.identity(ti.f64, self.dimension) + ti.sin(angle) * K + (1.0 - ti.cos(angle)) * K @ K

    @ti.func
    def arm(self, x):
        """Vector from the centre to x [m]."""
        arm = x - self.point
        if ti.static(self.turns):
            arm = x - self.centre
        if ti.static(self.travels):
            arm -= self.displacement()
        return arm

    @ti.func
    def offset(self, x):
        """Vector from the first node to x [m], turned back to the solid at 0 s."""
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
        velocity = self.translation()
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
        """Signed distance [m] of x and its gradient [-]; FAR beyond the grid."""
        return linear(self.values, float, ti.Vector(self.shape), self.offset(x) / self.cell, self.cell, FAR)

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
        """Whether the solid drives what is near x, though its distance is known within ``reach`` only."""
        near = False
        for k in ti.static(range(1 + int(np.ceil(ahead / reach)))):
            way = ti.cast(self.motion(x) * (k * reach / self.speed), ti.f64)
            near = near or self.signed(x - way) < reach
        return near


@ti.func
def linear(values: ti.template(), kind: ti.template(), shape, place, cell, beyond):
    """Distance [m] at a place in nodes of a grid of this shape, linear between nodes, and its gradient [-], of the type
    ``kind``; the distance ``beyond`` outside."""
    z, slope = ti.cast(beyond, kind), ti.Vector.unit(place.n, 0, kind)
    if (place >= 0.0).all() and (place <= shape - 1).all():
        z, slope = ti.cast(0.0, kind), ti.Vector.zero(kind, place.n)
        first = ti.min(ti.cast(place, ti.i32), shape - 2)
        f = ti.cast(place - first, kind)
        for corner in ti.static(ti.ndrange(*((2,) * place.n))):
            value = values[first + ti.Vector(corner)]
            z += share(f, corner, -1) * value
            for a in ti.static(range(place.n)):
                slope[a] += (1.0 if corner[a] else -1.0) * share(f, corner, a) * value / cell
    return z, slope


@ti.func
def share(f, corner: ti.template(), but: ti.template()):
    """Product of what a corner of a cell has of a place, at the fractions f of the cell, along all axes ``but`` one."""
    part = ti.one(f[0])
    for a in ti.static(range(f.n)):
        if ti.static(a != but):
            part *= f[a] if corner[a] else 1.0 - f[a]
    return part


# ---- the faces of inner edges ---------------------------------------------------------------------------------------
def search_faces(values, cell, normal, clean, nodes, steps, reach) -> np.ndarray:
    """Table (n, d, 1 + d) as of inner_edges for nodes (n, d) of a grid with these ``values`` [m] every ``cell`` [m]:
    each face is that of a ``clean`` node one of the ``steps`` (k, d) away, which stands in front of one face, of this
    ``normal``."""
    d = values.ndim
    table = np.zeros((len(nodes), d, 1 + d))
    table[:, :, 0] = np.inf
    steps = np.vstack([np.zeros((1, d)), steps])
    whole = (np.ascontiguousarray(part, dtype=np.int32) for part in (clean, nodes, steps))
    _search(d, np.ascontiguousarray(values), normal, *whole, table, cell, reach)
    return table


@ti.kernel
def _search(
    d: ti.template(),
    values: ti.types.ndarray(ti.f64),
    normals: ti.types.ndarray(ti.f64),
    clean: ti.types.ndarray(ti.i32),
    nodes: ti.types.ndarray(ti.i32, 2),
    steps: ti.types.ndarray(ti.i32, 2),
    table: ti.types.ndarray(ti.f64, 3),
    cell: ti.f64,
    reach: ti.f64,
):
    shape = ti.Vector([values.shape[a] for a in ti.static(range(d))])
    for i in range(nodes.shape[0]):
        node = ti.Vector([nodes[i, a] for a in ti.static(range(d))])
        normal, foot = ti.Matrix.zero(ti.f64, d, d), ti.Matrix.zero(ti.f64, d, d)  # of each face, foot from here
        seeks = True
        for face in ti.static(range(d)):
            best = ti.cast(np.inf, ti.f64)  # of a face, the foot that is nearest along it
            for s in range(steps.shape[0]):
                if not seeks or best <= SAME * cell:
                    break
                step = ti.Vector([steps[s, a] for a in ti.static(range(d))])
                at = node + step
                if (at >= 0).all() and (at < shape).all() and clean[at] == 1:
                    m = ti.Vector([normals[at, a] for a in ti.static(range(d))])
                    way = step * cell
                    along = m.dot(way)
                    distance = values[at] - along  # of the node from that face
                    # of the foot of the place from that of the node, along the face
                    aside = ti.sqrt(ti.max(0.0, way.norm_sqr() - along**2))
                    p = way - values[at] * m  # foot of that place, from the node
                    sought = distance > -cell and distance < reach + d**0.5 * cell and aside < best - SAME * cell
                    for other in ti.static(range(face)):
                        n = ti.Vector([normal[other, a] for a in ti.static(range(d))])
                        apart = p - ti.Vector([foot[other, a] for a in ti.static(range(d))])
                        # of an inner edge: across an outer one they turn away from each other
                        facing = (n - m).dot(apart) > 0.4 * apart.norm()
                        sought = sought and m.dot(n) < TURN and facing
                    if sought:
                        depth, _slope = linear(values, ti.f64, shape, node - distance * m / cell, cell, np.inf)
                        if depth < 0.25 * cell and depth > -BEYOND * reach:  # it is there, or ends at the edge
                            best, table[i, face, 0] = aside, distance
                            for a in ti.static(range(d)):
                                normal[face, a], foot[face, a], table[i, face, 1 + a] = m[a], p[a], m[a]
            seeks = seeks and (face == 0 or best < np.inf)  # without a second face there is no third one
