"""Least-squares gradient of the velocity and its exact adjoint, the force of a stress field (eqs 11, 22-29).

With b_ij = (w/r^2) r_ij, M_i = sum_j b_ij (x) r_ij and B_i = M_i^-1 the gradient is
G_i(u) = [sum_j (u_j - u_i) (x) b_ij] B_i, and the force of stresses T is F_i = V sum_j (T_i B_i + T_j B_j) b_ij: the
negative adjoint of G, hence exact momentum, a symmetric operator and a traction-free surface without any marker.
"""

from .backend import real, ti
from .particles import DUMMY, FLUID, WALL


@ti.data_oriented
class Gradient:
    """Pair vectors, inverse moments and particle number density at the present positions."""

    def __init__(self, neighbors, walls, constants):
        particles = neighbors.particles
        d = particles.dimension
        self.neighbors, self.particles, self.walls = neighbors, particles, walls
        self.dimension = d
        self.n0 = constants.n0
        self.full = constants.neighbours
        self.full_packing = constants.packing
        self.effective_radius = neighbors.bins.effective_radius
        self.b = ti.Vector.field(d, real(), neighbors.pair_capacity)  # (w/r^2) r_ij [1/m] of each pair
        self.weight_r2 = ti.field(real(), neighbors.pair_capacity)  # w/r^2 [1/m2] of each pair
        self.B = ti.Matrix.field(d, d, real(), particles.capacity)  # inverse moment [-]; zero: carries no stress
        self.n = ti.field(real(), particles.capacity)  # particle number density [-], eq 13, walls included
        self.packing = ti.field(real(), particles.capacity)  # 1 + sum (1 - r/re)^3 (1 + 3 r/re) [-], walls included
        self.around = ti.field(real(), particles.capacity)  # neighbours, those behind walls included [-]

    @ti.func
    def inverse(self, M):
        """M^-1; a nearly flat neighbourhood (collinear, coplanar) is stiffened by 0.3 (n0/d) I first."""
        m0 = self.n0 / self.dimension
        deficient = ti.cast(M.determinant() < 0.05 * m0**self.dimension, float)
        return (M + deficient * 0.3 * m0 * ti.Matrix.identity(float, self.dimension)).inverse()

    @ti.kernel
    def build(self):
        """Fill b, w/r^2, B, n, packing at the present positions."""
        re = self.effective_radius
        for i in range(self.particles.count[None]):
            x = self.particles.x[i]
            M = ti.Matrix.zero(float, self.dimension, self.dimension)
            n, packing = ti.cast(0.0, float), ti.cast(1.0, float)
            wet, hidden = 0, 0
            first, last = self.neighbors.row_start[i], self.neighbors.row_start[i + 1]
            for k in range(first, last):
                j = self.neighbors.column[k]
                to_j = self.neighbors.bins.displacement(x, self.particles.x[j])
                r = ti.cast(to_j, float)
                r2 = ti.max(r.dot(r), 1e-4 * re * re)
                w = ti.max(re / ti.sqrt(r2) - 1.0, 0.0)
                q = ti.min(1.0, ti.sqrt(r2) / re)
                if ti.static(self.walls.part):  # noqa: SIM102  (a compiled choice stays apart)
                    if self.walls.between(x, x + to_j):
                        w, q = 0.0, 1.0
                        hidden += 1
                b = r * (w / r2)
                self.b[k] = b
                self.weight_r2[k] = w / r2
                M += b.outer_product(r)
                n += w
                packing += (1.0 - q) ** 3 * (1.0 + 3.0 * q)
                if self.particles.kind[j] == FLUID:
                    wet += 1
            around = ti.cast(last - first - hidden, float)
            if ti.static(len(self.walls.surfaces) > 0):
                counts, moment = self.walls.moments(x)
                around += counts[0]
                n += counts[1]
                packing += counts[2]
                M += moment
            self.n[i] = n
            self.packing[i] = packing
            self.around[i] = around
            kind = self.particles.kind[i]
            stressed = around >= self.dimension and (kind == FLUID or (kind == WALL and wet > 0)) and kind != DUMMY
            self.B[i] = self.inverse(M) if stressed else ti.Matrix.zero(float, self.dimension, self.dimension)

    @ti.func
    def velocity_gradient(self, i, u: ti.template(), motion):
        """G_i = du_a/dx_b [1/s] of the vector field u; ``motion`` 1 counts the walls' own velocity, 0 does not."""
        H = ti.Matrix.zero(float, self.dimension, self.dimension)
        ui = u[i]
        for k in range(self.neighbors.row_start[i], self.neighbors.row_start[i + 1]):
            H += (u[self.neighbors.column[k]] - ui).outer_product(self.b[k])
        if ti.static(len(self.walls.surfaces) > 0):
            H += self.walls.gradient_term(self.particles.x[i], ui, motion)
        return H @ self.B[i]

    @ti.func
    def fit(self, i, u: ti.template(), motion):
        """G_i and what the linear fit leaves, (1/n0) sum (w/r^2) |u_j - u_i - G_i r_ij|^2 [1/s2]."""
        H = ti.Matrix.zero(float, self.dimension, self.dimension)
        square = ti.cast(0.0, float)
        ui = u[i]
        for k in range(self.neighbors.row_start[i], self.neighbors.row_start[i + 1]):
            jump = u[self.neighbors.column[k]] - ui
            H += jump.outer_product(self.b[k])
            square += self.weight_r2[k] * jump.norm_sqr()
        if ti.static(len(self.walls.surfaces) > 0):
            H += self.walls.gradient_term(self.particles.x[i], ui, motion)
            square += self.walls.drag_power(self.particles.x[i], ui, motion)
        G = H @ self.B[i]
        return G, ti.max(0.0, square - (G * H).sum()) / self.n0

    @ti.func
    def force(self, i, flux: ti.template()):
        """Force [N] on particle i of the flux matrices P_j = V T_j B_j [N m] of all particles."""
        total = ti.Vector.zero(float, self.dimension)
        Pi = flux[i]
        for k in range(self.neighbors.row_start[i], self.neighbors.row_start[i + 1]):
            total += (Pi + flux[self.neighbors.column[k]]) @ self.b[k]
        if ti.static(len(self.walls.surfaces) > 0):
            total += self.walls.force_term(self.particles.x[i], Pi)
        return total
