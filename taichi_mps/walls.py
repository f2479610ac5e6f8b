"""Plane walls that act on the fluid without wall particles.

Behind a wall the lattice goes on: a particle at distance z sees tabulated sums over that half-space. The velocity
of these ghosts is the linear extrapolation through the particle's own and the wall's, so every wall term is local
to one particle and exactly adjoint to its gradient.
"""

import numpy as np

from .backend import real, ti
from .weights import half_space_table


@ti.data_oriented
class Walls:
    """Static tuple of planes; every function sums over those within the effective radius of x [m]."""

    def __init__(self, planes, dimension: int, spacing: float, effective_radius: float, entries: int = 256):
        self.dimension = dimension
        self.effective_radius = effective_radius
        self.closest = 0.1 * spacing
        self.entries = entries
        self.table = ti.Vector.field(6, real(), entries)  # half_space_table: sums at z = re k/(entries - 1)
        self.table.from_numpy(half_space_table(dimension, spacing, effective_radius, entries).astype(np.float64))
        vector = ti.types.vector(dimension, real())
        position = ti.types.vector(dimension, ti.f64)
        self.planes = tuple(
            (position(w.point), vector(w.normal), vector(w.velocity or (0.0,) * dimension), w.slip) for w in planes
        )
        self.move = any(w.velocity is not None for w in planes)

    @ti.func
    def distance(self, point, normal, x):
        """Signed distance [m] of x from the wall, positive in the fluid."""
        return ti.cast((x - point).dot(ti.cast(normal, ti.f64)), float)

    @ti.func
    def lookup(self, z):
        """Table row at distance z [m], by linear interpolation; zero beyond the effective radius."""
        s = ti.max(z, self.closest) / self.effective_radius * (self.entries - 1)
        k = ti.min(ti.cast(s, ti.i32), self.entries - 2)
        f = s - k
        return self.table[k] * (1.0 - f) + self.table[k + 1] * f

    @ti.func
    def moments(self, x):
        """Neighbours and n [-], and the moment matrix [-] that the walls add at x."""
        count_n = ti.Vector.zero(float, 2)
        moment = ti.Matrix.zero(float, self.dimension, self.dimension)
        for point, n, velocity, slip in ti.static(self.planes):
            z = self.distance(point, n, x)
            if z < self.effective_radius:
                row = self.lookup(z)
                count_n += ti.Vector([row[0], row[1]])
                moment += row[2] * ti.Matrix.identity(float, self.dimension) + (row[3] - row[2]) * n.outer_product(n)
        return count_n, moment

    @ti.func
    def gradient_term(self, x, u, motion):
        """sum over ghosts of (u_ghost - u) (x) b [m/s x 1/m]; ``motion`` 1 with the walls' velocity, 0 without."""
        total = ti.Matrix.zero(float, self.dimension, self.dimension)
        for point, n, velocity, slip in ti.static(self.planes):
            z = self.distance(point, n, x)
            if z < self.effective_radius:
                jump = u - motion * velocity
                if ti.static(slip):
                    jump = n * n.dot(u)
                total += jump.outer_product(n) * (self.lookup(z)[3] / ti.max(z, self.closest))
        return total

    @ti.func
    def force_term(self, x, flux):
        """Force of the walls on a particle with flux matrix P = V T B: the exact adjoint of gradient_term."""
        total = ti.Vector.zero(float, self.dimension)
        for point, n, velocity, slip in ti.static(self.planes):
            z = self.distance(point, n, x)
            if z < self.effective_radius:
                pull = flux @ n
                if ti.static(slip):
                    pull = n * n.dot(pull)
                total -= pull * (self.lookup(z)[3] / ti.max(z, self.closest))
        return total

    @ti.func
    def drag_term(self, x, u, motion):
        """sum over ghosts of (w/r^2)(u_ghost - u) . d(u_ghost - u)/du: the walls' part of the non-affine resistance."""
        total = ti.Vector.zero(float, self.dimension)
        for point, n, velocity, slip in ti.static(self.planes):
            z = self.distance(point, n, x)
            if z < self.effective_radius:
                jump = u - motion * velocity
                if ti.static(slip):
                    jump = n * n.dot(u)
                zc = ti.max(z, self.closest)
                total += jump * (self.lookup(z)[3] / (zc * zc))
        return total

    @ti.func
    def pull(self, x):
        """sum of n m_n/z over the walls [1/m], and of m_n/z^2 [1/m2] (for the diagonal)."""
        total = ti.Vector.zero(float, self.dimension)
        drag = ti.cast(0.0, float)
        for point, n, velocity, slip in ti.static(self.planes):
            z = self.distance(point, n, x)
            if z < self.effective_radius:
                zc = ti.max(z, self.closest)
                m = self.lookup(z)[3] / zc
                total += n * m
                drag += m / zc
        return total, drag

    @ti.func
    def crowding(self, x):
        """sum w e and sum max(0, 1 - r/(1.5 l0)) e over the ghosts, e the direction from x to each [-]."""
        surface = ti.Vector.zero(float, self.dimension)
        near = ti.Vector.zero(float, self.dimension)
        for point, n, velocity, slip in ti.static(self.planes):
            z = self.distance(point, n, x)
            if z < self.effective_radius:
                row = self.lookup(z)
                surface -= n * row[4]
                near -= n * row[5]
        return surface, near

    @ti.func
    def outside(self, x):
        """x moved out of the solids [m]: at least ``closest`` in front of every wall."""
        y = x
        for point, n, velocity, slip in ti.static(self.planes):
            z = self.distance(point, n, y)
            if z < self.closest:
                y = y + ti.cast(n * (self.closest - z), ti.f64)
        return y
