"""Plane walls that act on the fluid without wall particles.

Behind a wall the lattice of particles goes on as ghosts; a particle at distance z sees tabulated sums over them
(weights.half_space_table). Ghost velocities mirror the fluid's, for no-slip u_g = -u(mirror point) with the latter
from the particle's own velocity and gradient; the wall then adds to the least-squares fit of particle i

    N_i += (u_i - u_wall) (x) n c(z),   M_i += c(z) z n (x) n + t(z) (I - n (x) n),   c = 2 sum (w/r^2)(z + d)

which is exact for a velocity that grows linearly from the wall and keeps a lattice at the wall in equilibrium. All
wall terms are local to one particle and exactly adjoint to its gradient.
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
        table = half_space_table(dimension, spacing, effective_radius, entries)
        self.table = ti.Vector.field(table.shape[1], real(), entries)  # GHOST_SUMS at z = re k/(entries - 1)
        self.table.from_numpy(table.astype(np.float64))
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
        """Ghost sums at distance z [m], by linear interpolation; zero beyond the effective radius."""
        s = ti.max(z, self.closest) / self.effective_radius * (self.entries - 1)
        k = ti.min(ti.cast(s, ti.i32), self.entries - 2)
        f = s - k
        return self.table[k] * (1.0 - f) + self.table[k + 1] * f

    @ti.func
    def moments(self, x):
        """Neighbours and n [-], and the moment matrix [-] that the walls add at x."""
        count_n = ti.Vector.zero(float, 2)
        moment = ti.Matrix.zero(float, self.dimension, self.dimension)
        for point, n, _velocity, slip in ti.static(self.planes):
            z = self.distance(point, n, x)
            if z < self.effective_radius:
                sums = self.lookup(z)
                count_n += ti.Vector([sums[0], sums[1]])
                normal = n.outer_product(n)
                moment += sums[2] * ti.max(z, self.closest) * normal
                if ti.static(not slip):
                    moment += sums[3] * (ti.Matrix.identity(float, self.dimension) - normal)
        return count_n, moment

    @ti.func
    def gradient_term(self, x, u, motion):
        """sum of (u - u_wall) (x) n c [1/s 1/m]; ``motion`` 1 with the walls' velocity, 0 without."""
        total = ti.Matrix.zero(float, self.dimension, self.dimension)
        for point, n, velocity, slip in ti.static(self.planes):
            z = self.distance(point, n, x)
            if z < self.effective_radius:
                jump = u - motion * velocity
                if ti.static(slip):
                    jump = n * n.dot(u)
                total += jump.outer_product(n) * self.lookup(z)[2]
        return total

    @ti.func
    def force_term(self, x, flux):
        """Force of the walls on a particle with flux matrix P = V T B: the exact adjoint of gradient_term."""
        total = ti.Vector.zero(float, self.dimension)
        for point, n, _velocity, slip in ti.static(self.planes):
            z = self.distance(point, n, x)
            if z < self.effective_radius:
                pull = flux @ n
                if ti.static(slip):
                    pull = n * n.dot(pull)
                total -= pull * self.lookup(z)[2]
        return total

    @ti.func
    def drag_term(self, x, u, motion):
        """sum of (u - u_wall) c/z: the walls' part of the resistance to non-affine motion (momentum.py)."""
        total = ti.Vector.zero(float, self.dimension)
        for point, n, velocity, slip in ti.static(self.planes):
            z = self.distance(point, n, x)
            if z < self.effective_radius:
                jump = u - motion * velocity
                if ti.static(slip):
                    jump = n * n.dot(u)
                total += jump * (self.lookup(z)[2] / ti.max(z, self.closest))
        return total

    @ti.func
    def pull(self, x):
        """sum of n c [1/m] over the walls, and of c/z [1/m2] (for the diagonal)."""
        total = ti.Vector.zero(float, self.dimension)
        drag = ti.cast(0.0, float)
        for point, n, _velocity, _slip in ti.static(self.planes):
            z = self.distance(point, n, x)
            if z < self.effective_radius:
                c = self.lookup(z)[2]
                total += n * c
                drag += c / ti.max(z, self.closest)
        return total, drag

    @ti.func
    def hydrostatic(self, x, weight, B):
        """Force density [N/m3] by which the ghosts' pressure exceeds the particle's own under rho g = ``weight``."""
        total = ti.Vector.zero(float, self.dimension)
        for point, n, _velocity, _slip in ti.static(self.planes):
            z = self.distance(point, n, x)
            if z < self.effective_radius:
                total -= B @ n * (n.dot(weight) * self.lookup(z)[4])
        return total

    @ti.func
    def crowding(self, x):
        """sum w e and sum max(0, 1 - r/(1.5 l0)) e over the ghosts, e the direction from x to each [-]."""
        inward = ti.Vector.zero(float, self.dimension)
        near = ti.Vector.zero(float, self.dimension)
        for point, n, _velocity, _slip in ti.static(self.planes):
            z = self.distance(point, n, x)
            if z < self.effective_radius:
                sums = self.lookup(z)
                inward -= n * sums[5]
                near -= n * sums[6]
        return inward, near

    @ti.func
    def outside(self, x):
        """x moved out of the solids [m]: at least ``closest`` in front of every wall."""
        y = x
        for point, n, _velocity, _slip in ti.static(self.planes):
            z = self.distance(point, n, y)
            if z < self.closest:
                y = y + ti.cast(n * (self.closest - z), ti.f64)
        return y
