"""Least-squares gradient of the velocity and its exact adjoint, the force of a stress field (eqs 11, 22-29).

With b_ij = (w/r^2) r_ij, w a weight of kernels.py, M_i = sum_j b_ij (x) r_ij and B_i = M_i^-1 the gradient is
G_i(u) = [sum_j (u_j - u_i) (x) b_ij] B_i, and the force of stresses T is F_i = sum_j (V_i T_i B_i + V_j T_j B_j) b_ij:
the negative adjoint of G, hence exact momentum, a symmetric operator and a traction-free surface without any marker.

In an axisymmetric scene a particle is a ring at (r, z) of fixed volume V_i and tensors are 3 x 3: the hoop part of the
gradient is G_33 = u_r/r, the adjoint adds -V_i T_33/r_i to the radial force. What two rings share is as long as the
circle half-way between them, so w of a pair is multiplied by (r_i + r_j)/(2 l0); the axis, a circle of no length, has
no share. A ring that moves outward gets thinner: ``ratio`` is its cross-section over l0^2, with which it counts among
neighbours and in the packing.
"""

import numpy as np

from ..runtime.backend import constant_fields, real, ti
from ..runtime.field_io import FieldIO
from ..runtime.stages import stage
from .kernels import ring_table
from .particles import BOUNDARY, FLUID, WALL

# largest surface normal of a full neighbourhood: 1.15 l0 below a flat surface, where 3 % of the packing is missing
ENCLOSED = 0.3
MAX_RING_RATIO, ENTRIES = 2.0, 256  # largest ratio in the table of lattice sums, and its length


@ti.data_oriented
class Gradient:
    """Pair vectors, inverse moments and particle number density at the present positions."""

    def __init__(self, neighbors, walls, lattice, spacing: float):
        particles = neighbors.particles
        d = particles.dimension
        self.neighbors, self.particles, self.walls = neighbors, particles, walls
        self.dimension, self.tensors = d, particles.tensor_dimension
        self.axisymmetric, self.spacing = particles.axisymmetric, spacing
        self.n0, self.weight, self.packing_kernel = lattice.n0, lattice.weight, lattice.packing_kernel
        self.lattice_neighbours, self.at_surface = lattice.neighbours, lattice.surface_normal
        self.full_packing = lattice.packing
        self.effective_radius = neighbors.bins.radius - neighbors.skin
        # (w/r^2) r_ij [1/m] and w/r^2 [1/m2] of each pair; of rings times the circle half-way between them over l0
        self.b = ti.Vector.field(d, real(), neighbors.pair_capacity)
        self.weight_r2 = ti.field(real(), neighbors.pair_capacity)
        self.B = ti.Matrix.field(d, d, real(), particles.capacity)  # inverse moment [-]; zero: carries no stress
        self.n = ti.field(real(), particles.capacity)  # particle number density [-], eq 13, walls included
        self.packing = ti.field(real(), particles.capacity)  # sum of the packing kernel over that of a lattice
        # sum w e over that of a particle at a flat surface [-]: 0 inside, points away from where neighbours are missing
        self.surface_normal = ti.Vector.field(d, real(), particles.capacity)
        self.neighbour_count = ti.field(real(), particles.capacity)  # neighbours, those behind walls included [-]
        if self.axisymmetric:
            self.ratio = ti.field(real(), particles.capacity)  # cross-section of the ring over l0^2 [-]
            self.hoop = ti.field(real(), particles.capacity)  # V T_33/r of the stress of the last flux [N]
            ratios = MAX_RING_RATIO / ENTRIES * np.arange(1, ENTRIES + 1)
            self.ring_sums = ring_table(spacing, self.effective_radius, ratios, self.weight)
            # n0 and packing [-] of a lattice with these ratios
            (self.lattices,) = constant_fields(self.ring_sums, vectors=True)
        self.field_io = FieldIO(
            {"n": self.n} | ({"ratio": self.ratio} if self.axisymmetric else {}), particles.capacity
        )

    @ti.func
    def cross_section_ratio(self, i):
        """Cross-section of particle i over that of the lattice [-]: 1 but for rings."""
        if ti.static(self.axisymmetric):
            return self.ratio[i]
        else:
            return ti.cast(1.0, float)

    @ti.func
    def lattice(self, i):
        """n0 and packing [-] of a full lattice of particles like i."""
        sums = ti.Vector([ti.cast(self.n0, float), ti.cast(self.full_packing, float)])
        if ti.static(self.axisymmetric):
            s = self.ratio[i] * (ENTRIES / MAX_RING_RATIO) - 1.0
            k = ti.max(0, ti.min(ti.cast(s, ti.i32), ENTRIES - 2))
            f = ti.max(0.0, ti.min(1.0, s - k))
            sums = self.lattices[k] * (1.0 - f) + self.lattices[k + 1] * f
        return sums

    @ti.func
    def ring_radius_ratio(self, i):
        """Radius of ring i over l0 [-]; 1 where particles are no rings."""
        if ti.static(self.axisymmetric):
            return ti.cast(self.particles.x[i][0], float) / self.spacing
        else:
            return ti.cast(1.0, float)

    @ti.func
    def full_weight(self, i):
        """Sum of the weights w of a full neighbourhood of particle i [-]."""
        return self.lattice(i)[0] * self.ring_radius_ratio(i)

    @ti.func
    def enclosed(self, i):
        """Whether particle i has a full neighbourhood. In three dimensions the number of neighbours does not tell: a
        lattice has 32, disordered particles as dense have 37. The surface normal of rings, which points to thinner
        ones, is not used."""
        enclosed = self.neighbour_count[i] >= 0.9 * self.lattice_neighbours
        if ti.static(not self.axisymmetric):
            enclosed = enclosed and self.surface_normal[i].norm() < ENCLOSED
        return enclosed

    def density_ratio(self) -> np.ndarray:
        """Particle number density over that of a lattice [-], (n,); of rings over a lattice as thin as they."""
        rows = self.field_io.read(self.particles.count[None])
        if not self.axisymmetric:
            return rows["n"] / self.n0
        ratio, ratios = rows["ratio"], MAX_RING_RATIO / ENTRIES * np.arange(1, ENTRIES + 1)
        return rows["n"] / np.maximum(1e-12, ratio * np.interp(ratio, ratios, self.ring_sums[:, 0]))

    @ti.func
    def inverse(self, M, n0):
        """M^-1; a nearly flat neighbourhood (collinear, coplanar) is stiffened by 0.3 (n0/d) I first."""
        m0 = n0 / self.dimension
        deficient = ti.cast(M.determinant() < 0.05 * m0**self.dimension, float)
        return (M + deficient * 0.3 * m0 * ti.Matrix.identity(float, self.dimension)).inverse()

    @stage("gradient")
    def build(self):
        """Fill b, w/r^2, B, n, packing at the present positions."""
        re = self.effective_radius
        if ti.static(self.axisymmetric):
            for i in range(self.particles.count[None]):  # a ring thicker than the axis is far has no cross-section
                r = ti.max(ti.cast(self.particles.x[i][0], float), 0.5 * self.spacing)
                self.ratio[i] = self.particles.ring[i] / (2.0 * np.pi * r * self.spacing**2)
        if ti.static(len(self.walls.separating) > 0):
            for i in range(self.particles.count[None]):
                self.walls.set_signed_distances(i, self.particles.x[i])
        for i in range(self.particles.count[None]):
            x = self.particles.x[i]
            M = ti.Matrix.zero(float, self.dimension, self.dimension)
            n, packing, neighbour_count = ti.cast(0.0, float), self.cross_section_ratio(i), ti.cast(0.0, float)
            surface_normal = ti.Vector.zero(float, self.dimension)
            fluid_neighbours = 0
            first, last = self.neighbors.row_start[i], self.neighbors.row_start[i + 1]
            for k in range(first, last):
                j = self.neighbors.column[k]
                to_j = self.neighbors.bins.displacement(x, self.particles.x[j])
                r = ti.cast(to_j, float)
                r2 = ti.max(r.dot(r), 1e-4 * re * re)
                distance = ti.sqrt(r2)
                q = ti.min(1.0, distance / re)
                w = self.weight(q)
                ratio = self.cross_section_ratio(j)
                if ti.static(len(self.walls.separating) > 0):  # noqa: SIM102  (a compiled choice stays apart)
                    if self.walls.stands_between(i, j, x, x + to_j):
                        w, ratio = 0.0, 0.0
                if ti.static(self.neighbors.skin > 0.0):  # noqa: SIM102
                    if distance >= re:
                        ratio = 0.0
                n += ratio * w
                b = r * (w / r2)
                surface_normal += distance * b
                if ti.static(self.axisymmetric):
                    half_way = 0.5 * (self.ring_radius_ratio(i) + self.ring_radius_ratio(j))
                    b, w = b * half_way, w * half_way
                self.b[k] = b
                self.weight_r2[k] = w / r2
                M += b.outer_product(r)
                packing += ratio * self.packing_kernel(q)
                neighbour_count += ratio
                if self.particles.kind[j] == FLUID:
                    fluid_neighbours += 1
            counts, moment, behind = self.walls.moments(i, x, self.cross_section_ratio(i))
            surface_normal += behind
            neighbour_count += counts[0]
            n += counts[1]
            packing += counts[2]
            M += moment
            lattice = self.lattice(i)
            self.n[i] = n
            self.packing[i] = packing / lattice[1]
            self.neighbour_count[i] = neighbour_count
            self.surface_normal[i] = surface_normal / self.at_surface
            kind = self.particles.kind[i]
            some = neighbour_count >= self.dimension * ti.min(1.0, self.cross_section_ratio(i))
            stressed = some and (kind == FLUID or kind == BOUNDARY or (kind == WALL and fluid_neighbours > 0))  # noqa: SIM109
            self.B[i] = (
                self.inverse(M, self.full_weight(i))
                if stressed
                else ti.Matrix.zero(float, self.dimension, self.dimension)
            )

    @stage("gradient")
    def weigh(self):
        """Fill b, w/r^2 and n alone at the present positions, in a scene whose walls are particles."""
        re = self.effective_radius
        for i in range(self.particles.count[None]):
            x, n = self.particles.x[i], ti.cast(0.0, float)
            for k in range(self.neighbors.row_start[i], self.neighbors.row_start[i + 1]):
                r = ti.cast(self.neighbors.bins.displacement(x, self.particles.x[self.neighbors.column[k]]), float)
                r2 = ti.max(r.dot(r), 1e-4 * re * re)
                w = self.weight(ti.min(1.0, ti.sqrt(r2) / re))
                self.b[k] = r * (w / r2)
                self.weight_r2[k] = w / r2
                n += w
            self.n[i] = n

    @ti.func
    def pair_weight(self, k):
        """w of pair k (eq 10) from b = (w/r^2) r_ij and w/r^2."""
        b = self.b[k]
        return b.dot(b) / ti.max(self.weight_r2[k], 1e-30)

    @ti.func
    def slope(self, i, u: ti.template(), wall_motion):
        """sum_j (u_j - u_i) (x) b_ij [1/s], walls included."""
        H = ti.Matrix.zero(float, self.dimension, self.dimension)
        ui = u[i]
        for k in range(self.neighbors.row_start[i], self.neighbors.row_start[i + 1]):
            H += (u[self.neighbors.column[k]] - ui).outer_product(self.b[k])
        H += self.walls.gradient_term(i, self.particles.x[i], ui, wall_motion, self.cross_section_ratio(i))
        return H

    @ti.func
    def tensor(self, i, G, u: ti.template()):
        """Velocity gradient G of the plane as a full tensor, with u_r/r as G_33 in an axisymmetric scene [1/s]."""
        full = ti.Matrix.zero(float, self.tensors, self.tensors)
        for a, c in ti.static(ti.ndrange(self.dimension, self.dimension)):
            full[a, c] = G[a, c]
        if ti.static(self.axisymmetric):
            full[2, 2] = u[i][0] / ti.cast(self.particles.x[i][0], float)
        return full

    @ti.func
    def in_plane(self, T):
        """Part of a tensor in the plane (r, z); the whole tensor in a scene that is not axisymmetric."""
        block = ti.Matrix.zero(float, self.dimension, self.dimension)
        for a, c in ti.static(ti.ndrange(self.dimension, self.dimension)):
            block[a, c] = T[a, c]
        return block

    @ti.func
    def velocity_gradient(self, i, u: ti.template(), wall_motion):
        """G_i = du_a/dx_b [1/s] of the vector field u; ``wall_motion`` 1 counts the walls' own velocity, 0 does not."""
        return self.tensor(i, self.slope(i, u, wall_motion) @ self.B[i], u)

    @ti.func
    def curvature_correction(self, i):
        """Correction of the velocity gradient [1/s] where the velocity is curved along the walls of a full vessel."""
        G = ti.Matrix.zero(float, self.tensors, self.tensors)
        if ti.static(self.walls.carry_curvature):
            term, _drag = self.walls.curvature_term(i, self.particles.x[i])
            G += term @ self.B[i]
        return G

    @ti.func
    def fit(self, i, u: ti.template(), wall_motion):
        """Velocity gradient G_i and residual of the linear fit, (1/n0) sum (w/r^2) |u_j - u_i - G_i r_ij|^2 [1/s2]."""
        H = self.slope(i, u, wall_motion)
        square = ti.cast(0.0, float)
        for k in range(self.neighbors.row_start[i], self.neighbors.row_start[i + 1]):
            square += self.weight_r2[k] * (u[self.neighbors.column[k]] - u[i]).norm_sqr()
        square += self.walls.drag_term(i, self.particles.x[i], u[i], wall_motion)[1]
        G = H @ self.B[i]
        return self.tensor(i, G, u), ti.max(0.0, square - (G * H).sum()) / self.full_weight(i)

    @ti.func
    def stress_flux(self, i, T):
        """Flux matrix P_i = V_i T_i B_i [N m] of the stress T [Pa] of i; keeps its hoop force for PairSums.force."""
        if ti.static(self.axisymmetric):
            carries = ti.cast(self.B[i][0, 0] > 0.0, float)
            self.hoop[i] = carries * self.particles.volume(i) * T[2, 2] / ti.cast(self.particles.x[i][0], float)
        return self.particles.volume(i) * (self.in_plane(T) @ self.B[i])
