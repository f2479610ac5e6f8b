"""Stress that the ghosts behind a no-slip wall carry besides that of the particle in front of it (I9).

Their stress differs along the wall as that of the fluid does. They contribute t(z) to the moment matrix M; without
the corresponding force the first row feels only 77 % of a pressure gradient along the wall in two dimensions.

In a full vessel their shear stress, too, exceeds the first row's. A drive f = rho g - grad p along a wall makes it
grow towards the wall, so a ghost at the normal distance h carries f h more than the particle. Its velocity goes on
with the curvature -f/eta of the fluid's (walls.py), and the law of each particle is averaged over what its gradient
sees (I31). Other flow curves are not: there the first row, with the stress of its own place, f l0/2 less than the wall,
would yield late. So their law is averaged over the layer between row and wall: while the yield surface lies in it,
where the wall carries s = tau_w - tau_y < f l0, the weight of the excess is 2 s/(f l0) - (s/(f l0))^2, and 1 beyond.
Where there is a free surface none of this is added: its own error, a last row that is held back, balances this one in
thin layers.
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
    """Stress along the walls; in a full vessel also the drive along them, the weight of the excess of shear stress, and
    the curvature of the velocity, for every particle in reach of a no-slip wall, and the variation of the stress for
    all particles."""

    def __init__(self, fluid, constants, strain_rate, pressure, stress):
        super().__init__(fluid, constants=constants, strain_rate=strain_rate, pressure=pressure, stress=stress)
        d, self.in_full_vessels = self.dimension, fluid.walls.carry_curvature
        self.drive = ti.Vector.field(d, real(), self.capacity)  # rho g - grad p [N/m3]
        self.weight = ti.field(real(), self.capacity)  # of the excess [-]
        self.inverse_moment = ti.Matrix.field(d, d, real(), self.capacity)  # inverse of the moment without walls [-]

    @ti.func
    def force(self, i, face: ti.template() = None):
        """Force density [N/m3] of the ghosts' stress on particle i, besides that of its own stress."""
        force = ti.Vector.zero(float, self.dimension)
        if ti.static(self.in_full_vessels):  # noqa: SIM102  (a compiled choice stays apart)
            if self.pressure.full[None] == 1:
                force = self.excess(i, face)
        if self.pressure.full[None] == 0:
            force = self.along_the_walls(i, face)
        return force

    @stage("wall stress")
    def set_drive_and_weight(self):
        """Set the moment of the fit without walls and, in a full vessel, drive and weight at the start of a step: the
        weight with which the present stress is in equilibrium."""
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
            for i in range(self.rows()):
                self.set_drive(i)

    @stage("wall stress")
    def update_weight(self):
        """Update the weight, in a full vessel, for the present stress of the wall."""
        if ti.static(self.in_full_vessels):
            for i in range(self.rows()):
                if self.touches_wall(i):
                    half = self.half_layer_stress(i)
                    size = self.stress.shear_stress_magnitude(i, self.stress.mu[i])
                    s = size + self.weight[i] * half - self.stress.yield_stress(i)
                    self.weight[i] = self.excess_weight(i, ti.max(0.0, s) / ti.max(2.0 * half, 1e-12), size)

    @ti.func
    def rows(self):
        """Number of rows of a full vessel, else 0."""
        return self.particles.count[None] * self.pressure.full[None]

    @ti.func
    def pressure_gradient(self, i):
        """grad p [Pa/m] at particle i, from a linear fit to the particles around it."""
        N = ti.Vector.zero(float, self.dimension)
        for k in range(self.neighbors.row_start[i], self.neighbors.row_start[i + 1]):
            N += (self.pressure.p[self.neighbors.column[k]] - self.pressure.p[i]) * self.gradient.b[k]
        return self.inverse_moment[i] @ N

    @ti.func
    def set_drive(self, i):
        """Set the drive along the walls, the weight of the excess and the curvature of the velocity of particle i."""
        self.walls.velocity_curvature[i] = ti.Vector.zero(float, self.dimension)
        self.drive[i] = ti.Vector.zero(float, self.dimension)
        if self.gradient.B[i][0, 0] > 0.0 and self.touches_wall(i):
            self.drive[i] = self.constants.weight_of(i) - self.pressure_gradient(i)
            size = self.stress.shear_stress_magnitude(i, self.stress.viscosity(i, self.particles.shear_rate[i]))
            over = ti.max(0.0, size - self.stress.yield_stress(i))
            self.weight[i] = self.excess_weight(i, ti.sqrt(over / ti.max(self.half_layer_stress(i), 1e-12)), size)
            # the fraction of the layer up to the next row that flows
            flowing_fraction = ti.min(self.weight[i], over / ti.max(2.0 * self.half_layer_stress(i), 1e-12))
            # part of the drive that the stress along a concave wall bears, half of it in a pipe [-]; left out at a
            # convex wall, along which a drive hardly ever acts
            bent = ti.cast(0.0, float)
            for f, wall in ti.static(self.walls.select_faces(None, "no_slip")):
                if ti.static(wall.curved):  # noqa: SIM102  (a compiled choice stays apart)
                    if self.walls.c[i, f] > 0.0:
                        _z, _n, _v, k = wall.face(i, self.particles.x[i], self.walls.slots[f])
                        borne = k * size * self.gradient.spacing / ti.max(2.0 * self.half_layer_stress(i), 1e-12)
                        bent = ti.max(0.0, ti.min(1.0, borne))
            curvature = -flowing_fraction * (1.0 - bent) * self.drive[i] / ti.max(self.stress.slope(i), 1e-12)
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
            reach, fit = self.gradient.spacing, self.gradient.B[i]
            if self.touches_wall(i):
                fit = self.inverse_moment[i]
            slope = fit @ N
            for f, wall in ti.static(self.walls.select_faces(None, "no_slip")):
                if self.walls.c[i, f] > 0.0:
                    z, n, _velocity, _curvature = wall.face(i, self.particles.x[i], self.walls.slots[f])
                    slope -= n * n.dot(slope) * (1.0 - ti.min(1.0, z / reach))
            variation = reach * slope.norm()
        return variation

    @ti.func
    def excess_weight(self, i, s, size):
        """Weight of the excess, s over f l0: never more than doubles the stress of the first row, its ``size`` [Pa]."""
        weight = ti.cast(1.0, float)
        if ti.static(not self.stress.averages):  # noqa: SIM102  (a compiled choice stays apart)
            if s < 1.0:
                weight = 2.0 * s - s * s
        return ti.min(weight, size / ti.max(self.half_layer_stress(i), 1e-12))

    @ti.func
    def touches_wall(self, i):
        """Whether particle i is in reach of a wall that holds it."""
        in_reach = False
        for f, _wall in ti.static(self.walls.select_faces(None, "resists_slip")):
            in_reach = in_reach or self.walls.c[i, f] > 0.0
        return in_reach

    @ti.func
    def half_layer_stress(self, i):
        """f l0/2 [Pa], f the largest part [N/m3] of the drive of particle i along a no-slip wall in reach."""
        most = ti.cast(0.0, float)
        for f, wall in ti.static(self.walls.select_faces(None, "no_slip")):
            if self.walls.c[i, f] > 0.0:
                _z, n, _velocity, _curvature = wall.face(i, self.particles.x[i], self.walls.slots[f])
                most = ti.max(most, (self.drive[i] - n * n.dot(self.drive[i])).norm())
        return 0.5 * self.gradient.spacing * most

    @ti.func
    def excess(self, i, face: ti.template() = None):
        """Force density [N/m3] by which the shear stress of the ghosts exceeds that of particle i."""
        total = ti.Vector.zero(float, self.dimension)
        x, size = self.particles.x[i], self.gradient.cross_section_ratio(i)
        for f, wall in ti.static(self.walls.select_faces(face, "no_slip")):
            if self.walls.c[i, f] > 0.0:
                z, n, _velocity, curvature = wall.face(i, x, self.walls.slots[f])
                along = self.drive[i] - n * n.dot(self.drive[i])
                depth = self.walls.ghosts.lookup("normal", i, wall, f, x, z, curvature, size)
                total -= along * (n.dot(self.gradient.B[i] @ n) * depth)
        return self.weight[i] * total

    @ti.func
    def along_the_walls(self, i, face: ti.template() = None):
        """Force density [N/m3] by which the stress of the ghosts differs along the walls: the divergence of the stress
        T in the directions along each wall, times t(z) and B."""
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
