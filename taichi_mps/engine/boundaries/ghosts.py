"""Tabulated sums over the ghosts behind a wall, and the fraction that remains where another wall ends them."""

import numpy as np

from ..geometry.concave_edges import EDGE_MARGIN
from ..geometry.solid import Solid
from ..geometry.walls import Cylinder, Plane
from ..particles.kernels import GHOST_SUMS, corner_table, ghost_table, lattice_sums
from ..runtime.backend import constant_fields, real, ti
from .surfaces import MIN_DISTANCE

SMALLEST_RING, LARGEST_RING, RING_SIZES = 0.2, 1.5, 27  # sizes of rings in the tables over the spacing, their number
COUNT_SUMS = "neighbours", "n", "packing"  # sums in which each ghost must count once
PAIR_SUMS = "gradient", "tangential", "normal"  # sums of w/r^2, for rings times their radius over l0 (gradient.py)
# cosines of the angle between two faces of a solid, and entries of their tables along each distance
COSINES, WEDGE_ENTRIES = 9, 24


def perpendicular_walls(walls) -> list[list[int]]:
    """Numbers of the walls at right angles to each wall, where its ghosts end: planes, and cylinders standing on a
    plane."""

    def across(one, other):
        if isinstance(one, Plane) and isinstance(other, Plane):
            return abs(np.dot(one.normal, other.normal)) < 1e-6
        if isinstance(one, Plane) and isinstance(other, Cylinder):
            return other.axis is not None and other.slope == 0.0 and abs(other.unit_axis @ one.normal) > 1.0 - 1e-6
        return isinstance(other, Plane) and isinstance(one, Cylinder) and across(other, one)

    return [[m for m, other in enumerate(walls) if across(wall, other)] for wall in walls]


def face_pairs(walls, faces, mirrors) -> np.ndarray:
    """Matrix (faces, faces) of the pairs of faces that may meet at any angle: 0 no, 1 yes, 2 where one of the two is a
    mirror plane. Faces of a solid may meet each other and the faces of all other walls. ``faces``: wall of each face;
    ``mirrors``: whether each wall is a mirror plane."""
    solid = np.array([isinstance(walls[k], Solid) for k in faces], bool)
    mirror = np.array([mirrors[k] for k in faces], bool)
    return ((solid[:, None] | solid) & ~np.eye(len(faces), dtype=bool)) * (1 + (mirror[:, None] | mirror))


@ti.func
def bilinear(table: ti.template(), name: ti.template(), row, column):
    """Interpolate one of GHOST_SUMS linearly between rows and columns of a table, or between columns if it has one
    row."""
    c = ti.static(GHOST_SUMS.index(name))
    k = ti.min(ti.cast(column, ti.i32), table.shape[1] - 2)
    f = column - k
    if ti.static(table.shape[0] == 1):
        return table[0, k][c] * (1.0 - f) + table[0, k + 1][c] * f
    a = ti.max(0, ti.min(ti.cast(row, ti.i32), table.shape[0] - 2))
    g = ti.max(0.0, ti.min(1.0, row - a))
    value = (table[a, k][c] * (1.0 - f) + table[a, k + 1][c] * f) * (1.0 - g)
    return value + (table[a + 1, k][c] * (1.0 - f) + table[a + 1, k + 1][c] * f) * g


@ti.data_oriented
class GhostSums:
    """Sums GHOST_SUMS over the ghosts of a particle at the distance z [m] from a wall. ``rings``: tables for rings,
    too, whose ghosts stand at another spacing; ``corners``: tables for walls at right angles; ``meet``: the pairs of
    faces that meet at any angle (``face_pairs``)."""

    def __init__(self, dimension, spacing, effective_radius, kernels, rings, corners, meet, capacity):
        self.dimension, self.spacing, self.rings = dimension, spacing, rings
        self.depth, self.effective_radius = effective_radius - 0.5 * spacing, effective_radius
        self.closest, self.entries = MIN_DISTANCE * spacing, 256
        self.sizes = (
            SMALLEST_RING + (LARGEST_RING - SMALLEST_RING) * np.arange(RING_SIZES) / (RING_SIZES - 1)
            if rings
            else np.ones(1)
        )
        bent = 0.1 / spacing  # curvature [1/m] of the arcs that give the slope of the sums
        tables = np.array(
            [
                [
                    ghost_table(dimension, spacing, effective_radius, self.entries, k, size, **kernels)
                    for size in self.sizes
                ]
                for k in (0.0, bent, -bent)
            ]
        )
        n0 = lattice_sums(dimension, spacing, effective_radius, **kernels).n0
        row = round(1.5 * spacing / effective_radius * (self.entries - 1))
        coefficient = tables[0, np.argmin(np.abs(self.sizes - 1.0)), row, GHOST_SUMS.index("gradient")]
        # fraction of a wall's area that belongs to the second row
        self.second_row_fraction = float(coefficient) * spacing * dimension / n0
        # GHOST_SUMS at a size and z = re k/(entries - 1), and their derivative by the curvature [m]
        self.flat, self.bend = constant_fields(tables[0], (tables[1] - tables[2]) / (2.0 * bent), vectors=True)
        if corners:
            # fraction that remains, by the distances across and from it
            (self.corner,) = constant_fields(
                corner_table(dimension, spacing, effective_radius, **kernels).swapaxes(0, 1), vectors=True
            )
        self.has_wedges = bool(meet.any())
        if self.has_wedges:
            fractions = [
                corner_table(dimension, spacing, effective_radius, WEDGE_ENTRIES, cosine, **kernels)
                for cosine in np.linspace(-1.0, 1.0, COSINES)
            ]
            (self.wedge,) = constant_fields(np.array(fractions), vectors=True)
            (self.meet,) = constant_fields(meet)
            each = (capacity, len(meet))
            # of each face: distance [m], weight, normal; and the fraction of each sum behind it that remains
            self.face_geometry = ti.Vector.field(2 + dimension, real(), each)
            self.remaining = ti.Vector.field(len(GHOST_SUMS), real(), each)

    @ti.func
    def table_value(self, table: ti.template(), name: ti.template(), z, ratio):
        """One of GHOST_SUMS, interpolated in a table at distance z [m], for a particle of this cross-section ratio."""
        row = ti.cast(0.0, float)
        if ti.static(self.rings):
            row = (ti.sqrt(ratio) - SMALLEST_RING) / (LARGEST_RING - SMALLEST_RING) * (RING_SIZES - 1)
        return bilinear(table, name, row, ti.max(z, self.closest) / self.effective_radius * (self.entries - 1))

    @ti.func
    def remaining_fraction(self, name: ti.template(), z, across):
        """Fraction of a ghost sum at distance z [m] from a wall whose ghosts end at another ``across`` [m] away."""
        scale = (self.corner.shape[0] - 1) / self.effective_radius
        return bilinear(self.corner, name, ti.max(across, self.closest) * scale, ti.max(z, self.closest) * scale)

    @ti.func
    def remaining_fractions_at_angle(self, z, across, cosine):
        """Fractions of all GHOST_SUMS at the distance z [m] from a face whose ghosts end at another, ``across`` [m]
        away, the two normals at an angle of this cosine."""
        scale = (WEDGE_ENTRIES - 1) / self.effective_radius
        s, t = ti.max(z, self.closest) * scale, ti.max(across, self.closest) * scale
        c = ti.max(0.0, 0.5 * (cosine + 1.0) * (COSINES - 1))
        k = ti.min(ti.cast(s, ti.i32), WEDGE_ENTRIES - 2)
        m = ti.min(ti.cast(t, ti.i32), WEDGE_ENTRIES - 2)
        a = ti.min(ti.cast(c, ti.i32), COSINES - 2)
        f, g, h = s - k, t - m, c - a
        fractions = ti.Vector.zero(float, ti.static(len(GHOST_SUMS)))
        for da, dk, dm in ti.static(ti.ndrange(2, 2, 2)):
            weight = (h if da else 1.0 - h) * (f if dk else 1.0 - f) * (g if dm else 1.0 - g)
            fractions += weight * self.wedge[a + da, k + dk, m + dm]
        return fractions

    @ti.func
    def lookup(self, name: ti.template(), i, wall: ti.template(), f: ti.template(), x, z, curvature, ratio):
        """Value of one of GHOST_SUMS for particle i at x, a distance z [m] from face f of this wall, whose curvature is
        given [1/m]. In a corner, ghosts behind both walls count once. Their sum w e along either normal belongs to
        neither wall: it cancels with the other wall's ghosts in front of the first; so does their gradient where one of
        the two walls is a mirror plane."""
        value = self.table_value(self.flat, name, z, ratio)
        if ti.static(wall.curved):
            value += curvature * self.table_value(self.bend, name, z, ratio)
        for other, before, mirror in ti.static(wall.cut_by):
            if ti.static(name == "inward" or (before if name in COUNT_SUMS else mirror)):
                across, _n, _velocity, _curvature = other.nearest(x)
                if across < self.effective_radius:
                    cut = 1.0 - self.remaining_fraction(name, z, across)
                    if ti.static(other.thin or other.unilateral):
                        cut *= other.weight(i, x, across)
                    value *= 1.0 - cut
        if ti.static(self.has_wedges):
            value *= self.remaining[i, f][ti.static(GHOST_SUMS.index(name))]
        if ti.static(wall.thin or wall.unilateral):
            value *= wall.weight(i, x, z)
        if ti.static(self.rings and name in PAIR_SUMS):  # the circle where the wall is, of no length on the axis
            depth, n, _velocity, _curvature = wall.nearest(x)
            value *= ti.max(0.0, ti.cast(x[0], float) - n[0] * depth) / self.spacing
        return value

    @ti.func
    def store_face(self, i, f, z, n, weight):
        """Store the distance z [m], normal and weight of face f before particle i."""
        self.face_geometry[i, f][0], self.face_geometry[i, f][1] = z, weight
        for a in ti.static(range(self.dimension)):
            self.face_geometry[i, f][2 + a] = n[a]

    @ti.func
    def divide_corners(self, i):
        """Set the fraction of each face's sums that remains for particle i near corners. Ghosts behind two faces are
        counted once: counts go to the first face. Each face keeps a fraction of the pair sums reduced by n.m/(1 + n.m),
        and of ``inward`` a half for coincident faces and nothing at a right angle; at a mirror plane the shared pair
        sums are dropped. A face fades out where its foot lies behind the other, beyond the edge."""
        for f in range(self.meet.shape[0]):
            remaining = ti.Vector.one(float, ti.static(len(GHOST_SUMS)))
            if self.face_geometry[i, f][0] < self.effective_radius:
                for g in range(self.meet.shape[0]):
                    if self.meet[f, g] > 0 and self.face_geometry[i, g][0] < self.effective_radius:
                        remaining = self.after_other_face(i, f, g, remaining)
            self.remaining[i, f] = remaining

    @ti.func
    def after_other_face(self, i, f, g, before):
        """Fractions of the sums of face f that remain for particle i beside another face g, of those ``before`` it."""
        remaining, cosine = before, ti.cast(0.0, float)
        z, across = self.face_geometry[i, f][0], self.face_geometry[i, g][0]
        for a in ti.static(range(self.dimension)):
            cosine += self.face_geometry[i, f][2 + a] * self.face_geometry[i, g][2 + a]
        acts = self.face_geometry[i, g][1]  # weight of the other face
        cut = 1.0 - self.remaining_fractions_at_angle(z, across, cosine)
        cut *= acts * self.visible_fraction(across, z, cosine)
        counted_once = ti.max(0.0, cosine) / (1.0 + ti.max(0.0, cosine))
        fraction = 1.0 if self.meet[f, g] == 2 else counted_once
        for k, name in ti.static(enumerate(GHOST_SUMS)):
            if ti.static(name in COUNT_SUMS):
                remaining[k] *= 1.0 - cut[k] if g < f else 1.0
            elif ti.static(name == "inward"):
                remaining[k] *= 1.0 - (1.0 - counted_once) * cut[k]
            else:
                remaining[k] *= 1.0 - fraction * cut[k]
        return remaining * (1.0 - acts * (1.0 - self.visible_fraction(z, across, cosine)))

    @ti.func
    def visible_fraction(self, z, across, cosine):
        """Visible fraction of a face z [m] away: 0 where its foot is well behind another face, ``across`` [m] away."""
        return ti.max(0.0, ti.min(1.0, 1.0 + (across - cosine * z) / (EDGE_MARGIN * self.depth)))
