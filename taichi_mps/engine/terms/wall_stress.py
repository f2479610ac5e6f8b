"""Stress of the ghosts behind a no-slip wall in excess of that of the particle in front of them (I9).

With a free surface the stress of the ghosts varies along the wall as that of the fluid does. The ghosts contribute
t(z) to the moment matrix M; without the corresponding force the first row of particles feels only 77 % of a pressure
gradient along the wall in two dimensions.

In a full vessel the shear stress of the ghosts exceeds that of the first row instead. A driving force f = rho g - grad
p along a wall makes the shear stress grow towards the wall, so a ghost at the normal distance h carries f h more than
the particle, and the velocity of the ghosts continues with the curvature -f/eta (walls.py).

The first row, with the stress of its own place, f l0/2 less than that of the wall, would yield late. The law of a
single Bingham mix is therefore averaged over the neighbourhood that a particle's gradient sees (I31). Any other law is
averaged over the layer between row and wall: while the yield surface lies in that layer, where the wall carries
s = tau_w - tau_y < f l0, the weight of the excess is 2 s/(f l0) - (s/(f l0))^2, and 1 beyond.

With a free surface neither excess nor curvature is added: in thin layers the error of leaving them out is balanced by
the error of the free surface, which holds back the last row.
"""

from ..runtime.backend import real, ti
from ..runtime.stages import stage
from .constants import Term


@ti.func
def no_force(i, face: ti.template() = None):
    """No-op: the force of ghosts where the fluid slips on all walls."""
    return 0.0


@ti.data_oriented
class WallStress(Term):
    """Stress of the ghosts of no-slip walls, besides that of the particle in front of them.

    In a full vessel each particle near such a wall has a driving force along it, a weight of the excess of shear
    stress and a curvature of the velocity, and every particle has a variation of the stress."""

    def __init__(self, fluid, constants, strain_rate, pressure, stress):
        super().__init__(fluid, constants=constants, strain_rate=strain_rate, pressure=pressure, stress=stress)
        d, self.in_full_vessels = self.dimension, fluid.walls.carry_curvature
        self.driving_force = ti.Vector.field(d, real(), self.capacity)  # rho g - grad p [N/m3]
        self.weight = ti.field(real(), self.capacity)  # weight of the excess of shear stress [-]
        self.inverse_moment = ti.Matrix.field(d, d, real(), self.capacity)  # inverse of the moment without walls [-]

    @ti.func
    def force(self, i, face: ti.template() = None):
        """Force density [N/m3] on particle i of the ghosts' stress in excess of its own: of its variation along the
        walls with a free surface, of the excess of shear stress in a full vessel."""
        force = ti.Vector.zero(float, self.dimension)
        if ti.static(self.in_full_vessels):  # noqa: SIM102  (a compiled choice stays apart)
            if self.pressure.full[None] == 1:
                force = self.excess(i, face)
        if self.pressure.full[None] == 0:
            force = self.along_the_walls(i, face)
        return force

    @stage("wall stress")
    def set_driving_force(self):
        """Set the inverse moment without walls and, in a full vessel, driving force, weight, curvature and variation of
        the stress at the start of a step. The weight is that with which the present stress is in equilibrium."""
        for i in range(self.particles.count[None]):
            if self.touches_wall(i):
                M = ti.Matrix.zero(float, self.dimension, self.dimension)
                for k in range(self.neighbors.row_start[i], self.neighbors.row_start[i + 1]):
                    b = self.gradient.b[k]
                    if self.gradient.weight_r2[k] > 0.0:
                        M += b.outer_product(b) / self.gradient.weight_r2[k]
                self.inverse_moment[i] = self.gradient.inverse(M, self.gradient.full_weight(i))
        if ti.static(self.in_full_vessels):
            for _ in range(1):
                self.walls.curvature_known[None] = self.pressure.full[None]
            if ti.static(self.stress.averages):
                for i in range(self.particles.count[None]):
                    self.stress.variation[i] = self.stress_variation(i) if self.pressure.full[None] == 1 else 0.0
            for i in range(self.count_in_full_vessel()):
                self.set_driving_force_of(i)

    @stage("wall stress")
    def update_weight(self):
        """Update the weight, in a full vessel, for the present stress of the wall."""
        if ti.static(self.in_full_vessels):
            for i in range(self.count_in_full_vessel()):
                if self.touches_wall(i):
                    half = self.half_layer_stress(i)
                    size = self.stress.shear_stress_magnitude(i, self.stress.mu[i])
                    s = size + self.weight[i] * half - self.stress.yield_stress(i)
                    self.weight[i] = self.excess_weight(i, ti.max(0.0, s) / ti.max(2.0 * half, 1e-12), size)

    @ti.func
    def count_in_full_vessel(self):
        """Number of particles in a full vessel, else 0."""
        return self.particles.count[None] * self.pressure.full[None]

    @ti.func
    def pressure_gradient(self, i):
        """grad p [Pa/m] at particle i, from a linear fit to the particles around it."""
        N = ti.Vector.zero(float, self.dimension)
        for k in range(self.neighbors.row_start[i], self.neighbors.row_start[i + 1]):
            N += (self.pressure.p[self.neighbors.column[k]] - self.pressure.p[i]) * self.gradient.b[k]
        return self.inverse_moment[i] @ N

    @ti.func
    def set_driving_force_of(self, i):
        """Set the driving force along the walls, the weight of the excess and the curvature of the velocity of particle
        i."""
        self.walls.velocity_curvature[i] = ti.Vector.zero(float, self.dimension)
        self.driving_force[i] = ti.Vector.zero(float, self.dimension)
        if self.gradient.B[i][0, 0] > 0.0 and self.touches_wall(i):
            self.driving_force[i] = self.constants.weight_of(i) - self.pressure_gradient(i)
            size = self.stress.shear_stress_magnitude(i, self.stress.viscosity(i, self.particles.shear_rate[i]))
            over = ti.max(0.0, size - self.stress.yield_stress(i))
            self.weight[i] = self.excess_weight(i, ti.sqrt(over / ti.max(self.half_layer_stress(i), 1e-12)), size)
            # the fraction of the layer up to the next row that flows
            flowing_fraction = ti.min(self.weight[i], over / ti.max(2.0 * self.half_layer_stress(i), 1e-12))
            # fraction of the driving force that the stress along a concave wall bears, half in a pipe [-]; 0 at a
            # convex wall, along which one hardly ever acts
            bent = ti.cast(0.0, float)
            for f, wall in ti.static(self.walls.select_faces(None, "no_slip")):
                if ti.static(wall.curved):  # noqa: SIM102  (a compiled choice stays apart)
                    if self.walls.c[i, f] > 0.0:
                        _z, _n, _v, k = wall.face(i, self.particles.x[i], self.walls.slots[f])
                        borne = k * size * self.gradient.spacing / ti.max(2.0 * self.half_layer_stress(i), 1e-12)
                        bent = ti.max(0.0, ti.min(1.0, borne))
            curvature = -flowing_fraction * (1.0 - bent) * self.driving_force[i] / ti.max(self.stress.slope(i), 1e-12)
            self.walls.velocity_curvature[i] = 0.25 * self.gradient.spacing * curvature

    @ti.func
    def stress_variation(self, i):
        """Variation [Pa] of the shear stress within one spacing on either side of particle i, cut off at walls."""
        variation = ti.cast(0.0, float)
        if self.gradient.B[i][0, 0] > 0.0:
            N, size = ti.Vector.zero(float, self.dimension), self.stress.shear_stress_magnitude(i, self.stress.mu[i])
            for k in range(self.neighbors.row_start[i], self.neighbors.row_start[i + 1]):
                j = self.neighbors.column[k]
                N += (self.stress.shear_stress_magnitude(j, self.stress.mu[j]) - size) * self.gradient.b[k]
            spacing, fit = self.gradient.spacing, self.gradient.B[i]
            if self.touches_wall(i):
                fit = self.inverse_moment[i]
            slope = fit @ N
            for f, wall in ti.static(self.walls.select_faces(None, "no_slip")):
                if self.walls.c[i, f] > 0.0:
                    z, n, _velocity, _curvature = wall.face(i, self.particles.x[i], self.walls.slots[f])
                    slope -= n * n.dot(slope) * (1.0 - ti.min(1.0, z / spacing))
            variation = spacing * slope.norm()
        return variation

    @ti.func
    def excess_weight(self, i, s, size):
        """Weight of the excess of shear stress [-] for s over f l0. The excess is at most ``size``, the shear stress
        [Pa] of particle i: it never more than doubles that of the first row."""
        weight = ti.cast(1.0, float)
        if ti.static(not self.stress.averages):  # noqa: SIM102  (a compiled choice stays apart)
            if s < 1.0:
                weight = 2.0 * s - s * s
        return ti.min(weight, size / ti.max(self.half_layer_stress(i), 1e-12))

    @ti.func
    def touches_wall(self, i):
        """Whether particle i is near a wall that resists slip."""
        touches = False
        for f, _wall in ti.static(self.walls.select_faces(None, "resists_slip")):
            touches = touches or self.walls.c[i, f] > 0.0
        return touches

    @ti.func
    def half_layer_stress(self, i):
        """Growth f l0/2 [Pa] of the shear stress over half a layer, f [N/m3] the largest part of the driving force of
        particle i along a no-slip wall near it."""
        most = ti.cast(0.0, float)
        for f, wall in ti.static(self.walls.select_faces(None, "no_slip")):
            if self.walls.c[i, f] > 0.0:
                _z, n, _velocity, _curvature = wall.face(i, self.particles.x[i], self.walls.slots[f])
                most = ti.max(most, (self.driving_force[i] - n * n.dot(self.driving_force[i])).norm())
        return 0.5 * self.gradient.spacing * most

    @ti.func
    def excess(self, i, face: ti.template() = None):
        """Force density [N/m3] by which the shear stress of the ghosts exceeds that of particle i."""
        total = ti.Vector.zero(float, self.dimension)
        x, size = self.particles.x[i], self.gradient.cross_section_ratio(i)
        for f, wall in ti.static(self.walls.select_faces(face, "no_slip")):
            if self.walls.c[i, f] > 0.0:
                z, n, _velocity, curvature = wall.face(i, x, self.walls.slots[f])
                along = self.driving_force[i] - n * n.dot(self.driving_force[i])
                depth = self.walls.ghosts.lookup("normal", i, wall, f, x, z, curvature, size)
                total -= along * (n.dot(self.gradient.B[i] @ n) * depth)
        return self.weight[i] * total

    @ti.func
    def along_the_walls(self, i, face: ti.template() = None):
        """Force density [N/m3] on particle i of the variation of the ghosts' stress along the walls: the divergence of
        the stress T in the directions along each wall, times t(z) and B."""
        force = ti.Vector.zero(float, self.dimension)
        moment = ti.Matrix.zero(float, self.dimension, self.dimension)
        x, size = self.particles.x[i], self.gradient.cross_section_ratio(i)
        for f, wall in ti.static(self.walls.select_faces(face, "resists_slip")):
            if self.walls.c[i, f] > 0.0:
                z, n, _velocity, curvature = wall.face(i, x, self.walls.slots[f])
                t = self.walls.tangential(i, wall, f, x, z, curvature, size)
                moment += t * (ti.Matrix.identity(float, self.dimension) - n.outer_product(n))
        if moment.trace() > 0.0:
            fit = moment @ self.inverse_moment[i]
            T = self.gradient.in_plane(self.stress.total(i, self.strain_rate))
            for k in range(self.neighbors.row_start[i], self.neighbors.row_start[i + 1]):
                T_j = self.gradient.in_plane(self.stress.total(self.neighbors.column[k], self.strain_rate))
                force += (T_j - T) @ (fit @ self.gradient.b[k])
            force = self.gradient.B[i] @ force
        return force
