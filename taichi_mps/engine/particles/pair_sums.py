"""Sums over pairs, written for vector instructions: differences of the velocity, and fluxes.

The two loops over pairs are written for LLVM, which turns them into vector instructions of four numbers if vectors of
three components are kept as four, if a sum is stored whole and used in another loop only, and if the loop has a way
out. Without, LLVM takes many pairs at a time, whose numbers it must pick one by one: twice as slow.
"""

from ..runtime.backend import real, ti


@ti.data_oriented
class PairSums:
    """Sums over the neighbours of each particle for the least-squares gradient and its adjoint (gradient.py)."""

    def __init__(self, particles, gradient, walls):
        d = particles.dimension
        self.particles, self.gradient, self.walls = particles, gradient, walls
        self.neighbors, self.dimension = gradient.neighbors, d
        lanes = self.lanes = 4 if d == 3 else d
        self.velocity = ti.Vector.field(lanes, real(), particles.capacity)  # whose differences are summed [m/s]
        self.pair_drag = ti.field(real(), self.neighbors.pair_capacity)  # (h_i + h_j) w/r^2 of each pair [kg/s]
        # sums over pairs of u_j - u_i: d rows of its slopes [1/s], one of the drag [N]
        self.difference_sums = ti.Matrix.field(d + 1, lanes, real(), particles.capacity)
        self.flux = ti.Matrix.field(d, lanes, real(), particles.capacity)  # transpose of P = V T B - h G [N m]
        self.flux_sums = ti.Matrix.field(d, lanes, real(), particles.capacity)  # sums of fluxes, by axis [N]

    @ti.func
    def set_velocity(self, i, u):
        """Put the velocity u [m/s] of particle i where its neighbours see it."""
        for a in ti.static(range(self.dimension)):
            self.velocity[i][a] = u[a]

    @ti.func
    def gather_differences(self, u: ti.template()):
        """``difference_sums`` of the velocity u: walls not included."""
        for i in range(self.particles.count[None]):
            self.set_velocity(i, u[i])
        for i in range(self.particles.count[None]):
            self.gather_difference(i)

    @ti.func
    def gather_difference(self, i):
        """``difference_sums`` of particle i and its ``velocity``: the transpose of sum_j (u_j - u_i) (x) b_ij; drag."""
        sums = ti.Matrix.zero(float, self.dimension + 1, self.lanes)
        ui = self.velocity[i]
        for k in range(self.neighbors.row_start[i], self.neighbors.row_start[i + 1]):
            j = self.neighbors.column[k]
            if j < 0:  # never: the way out of the loop
                break
            difference, b, drag = self.velocity[j] - ui, self.gradient.b[k], self.pair_drag[k]
            for c, a in ti.static(ti.ndrange(self.dimension, self.lanes)):
                sums[c, a] += difference[a] * b[c]
            for a in ti.static(range(self.lanes)):
                sums[self.dimension, a] += difference[a] * drag
        self.difference_sums[i] = sums

    @ti.func
    def gather_fluxes(self, i):
        """``flux_sums`` of particle i; walls not included."""
        sums = ti.Matrix.zero(float, self.dimension, self.lanes)
        Pi = self.flux[i]
        for k in range(self.neighbors.row_start[i], self.neighbors.row_start[i + 1]):
            j = self.neighbors.column[k]
            if j < 0:  # never: the way out of the loop
                break
            Pj, b = self.flux[j], self.gradient.b[k]
            for c, a in ti.static(ti.ndrange(self.dimension, self.lanes)):
                sums[c, a] += (Pi[c, a] + Pj[c, a]) * b[c]
        self.flux_sums[i] = sums

    @ti.func
    def velocity_gradient(self, i, u: ti.template(), wall_motion):
        """du_a/dx_b [1/s] of the velocity u at i, as Gradient.velocity_gradient, from gathered differences."""
        H = ti.Matrix.zero(float, self.dimension, self.dimension)
        for a, c in ti.static(ti.ndrange(self.dimension, self.dimension)):
            H[a, c] = self.difference_sums[i][c, a]
        H += self.walls.gradient_term(i, self.particles.x[i], u[i], wall_motion, self.gradient.cross_section_ratio(i))
        return self.gradient.tensor(i, H @ self.gradient.B[i], u)

    @ti.func
    def set_flux(self, i, P):
        """Put the matrix P of particle i into ``flux``."""
        for a, c in ti.static(ti.ndrange(self.dimension, self.dimension)):
            self.flux[i][c, a] = P[a, c]

    @ti.func
    def force(self, i):
        """Force [N] on particle i of all flux matrices, once gathered; walls included."""
        P = ti.Matrix.zero(float, self.dimension, self.dimension)
        for a, c in ti.static(ti.ndrange(self.dimension, self.dimension)):
            P[a, c] = self.flux[i][c, a]
        force = ti.Vector.zero(float, self.dimension)
        if ti.static(len(self.walls.surfaces) > 0):
            force += self.walls.force_term(i, self.particles.x[i], P)
        if ti.static(self.particles.axisymmetric):
            force[0] -= self.gradient.hoop[i]
        for c, a in ti.static(ti.ndrange(self.dimension, self.dimension)):
            force[a] += self.flux_sums[i][c, a]
        return force
