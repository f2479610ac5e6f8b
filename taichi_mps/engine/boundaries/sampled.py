"""Surface of a solid for kernels: a signed distance on a grid, which may move and rotate, and the faces that meet at
its concave edges (geometry/concave_edges.py)."""

import numpy as np

from ..geometry.concave_edges import EDGE_MARGIN, MAX_COSINE, find_concave_edges
from ..runtime.backend import constant_fields, real, ti
from .surfaces import FAR, Surface

SAME_DISTANCE = 1e-9  # difference in cells up to which two feet are equally near


@ti.data_oriented
class SampledSurface(Surface):
    """Surface of a solid whose signed distance is linear between the nodes of a grid; its curvature counts as zero."""

    def __init__(self, wall, dimension: int, spacing: float, clock, capacity: int, effective_radius: float):
        super().__init__(wall, dimension, spacing, clock, capacity, effective_radius)
        self.separates, self.steepest = True, wall.steepest
        self.dimension, self.cell, self.shape = dimension, wall.cell, wall.values.shape
        (self.values,) = constant_fields(wall.values)
        self.velocity = ti.types.vector(dimension, real())(wall.travel)
        self.rotates, self.rate = wall.angular_velocity != 0.0, wall.angular_velocity
        self.changes_position = self.travels or self.rotates
        if self.rotates:
            self.centre = ti.types.vector(dimension, ti.f64)(wall.centre)
            self.spin = ti.types.matrix(dimension, dimension, ti.f64)(wall.spin)
        # distance and normal of the faces before each particle: the nearest one, and near a concave edge the others
        self.depth = effective_radius - 0.5 * spacing  # of the ghosts: the first is half a spacing behind a face
        face_row, planes = find_concave_edges(wall.values, self.cell, self.depth, search_faces)
        self.faces = planes.shape[1]
        if self.faces > 1:
            (self.face_row,) = constant_fields(face_row)  # row of a node in ``planes``, -1: only the nearest face
            # distance [m] and normal of the faces
            (self.planes,) = constant_fields(np.where(np.isinf(planes), FAR, planes), vectors=True)
        self.z = ti.field(real(), (capacity, self.faces))  # [m]
        self.n = ti.Vector.field(self.dimension, real(), (capacity, self.faces))

    @ti.func
    def rotation(self):
        """Rotation matrix of the solid from 0 s to the time of ``clock``."""
        angle, K = self.rate * self.clock[None], self.spin / self.rate
        return ti.Matrix.identity(ti.f64, self.dimension) + ti.sin(angle) * K + (1.0 - ti.cos(angle)) * K @ K

    @ti.func
    def arm(self, x):
        """Vector from the centre to x [m]."""
        arm = x - self.point
        if ti.static(self.rotates):
            arm = x - self.centre
        if ti.static(self.travels):
            arm -= self.displacement()
        return arm

    @ti.func
    def offset(self, x):
        """Vector from the first node to x [m], rotated back to the solid at 0 s."""
        if ti.static(self.rotates):
            return self.rotation().transpose() @ self.arm(x) + self.centre - self.point
        else:
            return self.arm(x)

    @ti.func
    def rotated(self, n):
        """Rotate a direction of the solid from 0 s to the time of ``clock``."""
        if ti.static(self.rotates):
            return ti.cast(self.rotation() @ ti.cast(n, ti.f64), float)
        else:
            return n

    @ti.func
    def velocity_at(self, foot):
        """Velocity [m/s] of the solid at a place [m]."""
        velocity = self.translation_velocity()
        if ti.static(self.rotates):
            velocity += ti.cast(self.spin @ self.arm(foot), float)
        return velocity

    @ti.func
    def find_faces(self, i, x):
        z, n, _velocity, _curvature = self.nearest(x)
        self.z[i, 0], self.n[i, 0] = z, n
        if ti.static(self.faces > 1):
            for slot in range(1, self.faces):
                self.z[i, slot] = FAR
            if z < self.depth:
                node_coordinates = self.offset(x) / self.cell
                first = ti.min(ti.cast(node_coordinates, ti.i32), ti.Vector(self.shape) - 2)
                node = first  # the node around x that is farthest from the solid, where the faces are clear
                for corner in ti.static(ti.ndrange(*((2,) * self.dimension))):
                    if self.values[first + ti.Vector(corner)] > self.values[node]:
                        node = first + ti.Vector(corner)
                if self.face_row[node] >= 0:
                    self.place_faces(i, self.face_row[node], ti.cast((node_coordinates - node) * self.cell, float))

    @ti.func
    def place_faces(self, i, row, offset):
        """Set distance and normal of the faces of a row of ``planes`` before particle i, ``offset`` [m] from its node;
        with friction, which acts on the first face, the nearest one comes first."""
        for slot in range(self.faces):
            plane = self.planes[row, slot]
            for a in ti.static(range(self.dimension)):
                self.n[i, slot][a] = plane[1 + a]
            self.z[i, slot] = plane[0] + self.n[i, slot].dot(offset)
            self.n[i, slot] = self.rotated(self.n[i, slot])
            if ti.static(self.has_friction) and self.z[i, slot] < self.z[i, 0]:
                z, n = self.z[i, 0], self.n[i, 0]
                self.z[i, 0], self.n[i, 0] = self.z[i, slot], self.n[i, slot]
                self.z[i, slot], self.n[i, slot] = z, n

    @ti.func
    def face(self, i, x, slot: ti.template()):
        z, n = self.z[i, slot], self.n[i, slot]
        return z, n, self.velocity_at(x - ti.cast(z * n, ti.f64)), ti.cast(0.0, float)

    @ti.func
    def sample(self, x):
        """Signed distance [m] of x and its gradient [-]; FAR beyond the grid."""
        return interpolate(self.values, float, ti.Vector(self.shape), self.offset(x) / self.cell, self.cell, FAR)

    @ti.func
    def signed_distance(self, x):
        z, _slope = self.sample(x)
        return z

    @ti.func
    def nearest(self, x):
        z, slope = self.sample(x)
        n = self.rotated(slope / ti.max(slope.norm(), 1e-6))
        return z, n, self.velocity_at(x - ti.cast(z * n, ti.f64)), ti.cast(0.0, float)

    @ti.func
    def moves_near(self, x, max_distance: ti.template(), ahead: ti.template()):
        """Whether the solid moves within ``max_distance`` + ``ahead`` [m] of x; farther than ``max_distance``
        its distance is not known."""
        near = False
        for k in ti.static(range(1 + int(np.ceil(ahead / max_distance)))):
            path = ti.cast(self.velocity_at(x) * (k * max_distance / self.speed), ti.f64)
            near = near or self.signed_distance(x - path) < max_distance
        return near


@ti.func
def interpolate(values: ti.template(), kind: ti.template(), shape, x, cell, beyond):
    """Interpolate the distance [m] linearly at x, in nodes of a grid of this shape, and its gradient [-], both of
    the type ``kind``; outside of the grid the distance is ``beyond``."""
    z, slope = ti.cast(beyond, kind), ti.Vector.unit(x.n, 0, kind)
    if (x >= 0.0).all() and (x <= shape - 1).all():
        z, slope = ti.cast(0.0, kind), ti.Vector.zero(kind, x.n)
        first = ti.min(ti.cast(x, ti.i32), shape - 2)
        f = ti.cast(x - first, kind)
        for corner in ti.static(ti.ndrange(*((2,) * x.n))):
            value = values[first + ti.Vector(corner)]
            z += corner_weight(f, corner, -1) * value
            for a in ti.static(range(x.n)):
                slope[a] += (1.0 if corner[a] else -1.0) * corner_weight(f, corner, a) * value / cell
    return z, slope


@ti.func
def corner_weight(f, corner: ti.template(), but: ti.template()):
    """Weight of a corner of a cell in multilinear interpolation at the fractions f of the cell, without the factor of
    axis ``but``."""
    weight = ti.one(f[0])
    for a in ti.static(range(f.n)):
        if ti.static(a != but):
            weight *= f[a] if corner[a] else 1.0 - f[a]
    return weight


# ---- faces of concave edges -----------------------------------------------------------------------------------------
def search_faces(values, cell, normal, single_face, nodes, steps, max_distance) -> np.ndarray:
    """Table (n, d, 1 + d) of faces, as in ``find_concave_edges``, for nodes (n, d) of a grid of distances ``values``
    every ``cell`` [m]. Each face is the one in front of which a ``single_face`` node stands, one of the ``steps`` (k,
    d) away and with this ``normal``."""
    d = values.ndim
    table = np.zeros((len(nodes), d, 1 + d))
    table[:, :, 0] = np.inf
    steps = np.vstack([np.zeros((1, d)), steps])
    integers = (np.ascontiguousarray(part, dtype=np.int32) for part in (single_face, nodes, steps))
    _search(d, np.ascontiguousarray(values), normal, *integers, table, cell, max_distance)
    return table


@ti.func
def meet_in_concave_edge(m, n, apart):
    """Whether faces of the normals m and n, feet ``apart``, face each other; those of a convex edge do not."""
    return m.dot(n) < MAX_COSINE and (n - m).dot(apart) > 0.4 * apart.norm()


@ti.kernel
def _search(
    d: ti.template(),
    values: ti.types.ndarray(ti.f64),
    normals: ti.types.ndarray(ti.f64),
    single_face: ti.types.ndarray(ti.i32),
    nodes: ti.types.ndarray(ti.i32, 2),
    steps: ti.types.ndarray(ti.i32, 2),
    table: ti.types.ndarray(ti.f64, 3),
    cell: ti.f64,
    max_distance: ti.f64,
):
    shape = ti.Vector([values.shape[a] for a in ti.static(range(d))])
    for i in range(nodes.shape[0]):
        node = ti.Vector([nodes[i, a] for a in ti.static(range(d))])
        normal, foot = ti.Matrix.zero(ti.f64, d, d), ti.Matrix.zero(ti.f64, d, d)  # of each face; foot from the node
        searching = True
        for face in ti.static(range(d)):
            best = ti.cast(np.inf, ti.f64)  # smallest distance of the two feet along the face
            for s in range(steps.shape[0]):
                if not searching or best <= SAME_DISTANCE * cell:
                    break
                step = ti.Vector([steps[s, a] for a in ti.static(range(d))])
                at = node + step
                if (at >= 0).all() and (at < shape).all() and single_face[at] == 1:
                    m = ti.Vector([normals[at, a] for a in ti.static(range(d))])
                    offset = step * cell
                    along = m.dot(offset)
                    distance = values[at] - along  # of the node from that face
                    # distance along the face between the feet of ``at`` and of the node
                    aside = ti.sqrt(ti.max(0.0, offset.norm_sqr() - along**2))
                    p = offset - values[at] * m  # foot of ``at``, from the node
                    accepted = (
                        distance > -cell
                        and distance < max_distance + d**0.5 * cell
                        and aside < best - SAME_DISTANCE * cell
                    )
                    for other in ti.static(range(face)):
                        n = ti.Vector([normal[other, a] for a in ti.static(range(d))])
                        apart = p - ti.Vector([foot[other, a] for a in ti.static(range(d))])
                        accepted = accepted and meet_in_concave_edge(m, n, apart)
                    if accepted:
                        depth, _slope = interpolate(values, ti.f64, shape, node - distance * m / cell, cell, np.inf)
                        # on the face or at the edge
                        accepted = depth < 0.25 * cell and depth > -EDGE_MARGIN * max_distance
                    if accepted:
                        best, table[i, face, 0] = aside, distance
                        for a in ti.static(range(d)):
                            normal[face, a], foot[face, a], table[i, face, 1 + a] = m[a], p[a], m[a]
            searching = searching and (face == 0 or best < np.inf)  # without a second face there is no third one
