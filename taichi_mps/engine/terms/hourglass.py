"""Resistance to zero-energy (hourglass) modes: motion of particles past each other that the gradient does not see (I8).

    h = c eta_a + rho l0^2/(2 T) + ...,    c = 0.6,    at least 2 p dt,

eta_a the apparent viscosity at the rate of the bonds, T the natural step of the scene (time_step.py).

A part of it is taken back: what the change of the gradient explains. Where the velocity is curved, the linear fits at
both ends of a bond leave the same, c = (delta_ij + delta_ji)/2, with delta_ij = u_j - u_i - G_i r_ij; where particles
move past each other they leave opposite motions. Only what the mean of both gradients leaves,
e = (delta_ij - delta_ji)/2, is to be resisted: instead of the energy

    (1/2) (w/r^2) (h_i |delta_ij|^2 + h_j |delta_ji|^2)  of a bond  its least for this e,  (w/r^2) h |e|^2,

with h = 2 h_i h_j/(h_i + h_j). The matrix keeps the first, which needs the neighbours only. The force of the difference
goes to the right-hand side, at the velocity before the step: a deferred correction. It is never more than what the
matrix resists, so it is stable with any step; in one much longer than the scene's own it would hold up what should be
gone at once, and fades.

In a full vessel the ghosts behind no-slip walls go on with the curvature of the velocity, so what is left of the bonds
to them is taken back whole. And what is left at the edge of a plug, where the law has a kink, is resisted by the
plastic viscosity alone, for the yield stress does not grow with the rate.
"""

from ..runtime.backend import real, ti
from ..runtime.stages import stage
from .constants import Term

BOND_DISSIPATION = 0.6  # c: bond-associated dissipation gives 1/2 (shear) to 2/3 (along the bond), docs/equations.md
SETTLING = 2.0  # h >= 2 p dt: what the pressure pushes apart goes no further than to its place in a step
# Resistance of a low-viscosity fluid at rest over that in motion: with less its particles do not settle; and the strain
# or rotation in a step from which on the fluid is in motion
REST_FACTOR, MOVING_STRAIN = 64.0, 0.002
HUGE = 1e30  # N s m: no bound
# at the edge of a plug a quarter of the bonds carry all of this motion: their rate is twice the mean
PLUG_EDGE_FACTOR = 4.0


@ti.data_oriented
class HourglassResistance(Term):
    """Resistance of every particle to motion that its velocity gradient does not see."""

    def __init__(self, fluid, constants, strain_rate, pressure, stress):
        super().__init__(fluid, constants=constants, strain_rate=strain_rate, pressure=pressure, stress=stress)
        self.law, self.in_space = stress.law, self.dimension == 3
        # resistance of a low-viscosity fluid and in all [Pa s], and 2 V/n0 times the latter [N s m]
        self.inertial_viscosity, self.viscosity, self.h = (ti.field(real(), self.capacity) for _ in range(3))

    @stage("prepare")
    def set(self, dt: float, first: ti.i32):
        """Set the resistance by the strain rate at the start of a step of dt [s], which the ``first`` step does not
        know (I8)."""
        for i in range(self.particles.count[None]):
            m = self.constants.mix(i)
            # Without a yield stress a low-viscosity fluid at rest has 64 times as much, less where the velocity
            # gradient strains or turns it in a step, and no more than elsewhere from 0.002 on and in a full closed box,
            # where nothing settles
            inertial_viscosity = self.constants.inertial_viscosity[m]
            if ti.static(self.law == "newtonian"):
                strain = 2.0**0.5 * self.strain_rate.velocity_gradient(i).norm() * dt
                rigid_fraction = 1.0 - ti.min(1.0, strain / MOVING_STRAIN)
                inertial_viscosity *= 1.0 + (REST_FACTOR - 1.0) * rigid_fraction**2 * (1 - self.pressure.full[None])
            h = BOND_DISSIPATION * self.constants.eta[m] + inertial_viscosity
            if ti.static(self.law != "newtonian"):  # noqa: SIM102  (a compiled choice stays apart)
                if first == 0:
                    rate, residual = self.strain_rate.rate[i], self.strain_rate.residual[i]
                    step_ratio = ti.min(1.0, self.constants.natural_step[None] / dt)
                    fall = ti.sqrt(step_ratio) if ti.static(self.in_space) else step_ratio
                    min_rate = self.constants.min_bond_rate[None] * fall
                    bond_rate = ti.max(
                        ti.sqrt(rate * rate + 2.0 * BOND_DISSIPATION * PLUG_EDGE_FACTOR * residual), min_rate
                    )
                    if ti.static(self.stress.has_curve):
                        h = BOND_DISSIPATION * self.stress.shear_stress(i, bond_rate) / bond_rate + inertial_viscosity
                    else:
                        h += BOND_DISSIPATION * self.stress.yield_stress(i) / bond_rate
            if ti.static(self.stress.mixes > 1):
                mu = (h - inertial_viscosity) / BOND_DISSIPATION
                h = BOND_DISSIPATION * self.stress.interface.viscosity(i, mu) + inertial_viscosity
            if ti.static(self.particles.has_grains):  # noqa: SIM102
                if not self.particles.in_grain(i):  # only mortar is strained
                    h = inertial_viscosity + (
                        (h - inertial_viscosity) * self.stress.stress_ratio(i) / self.stress.mortar_fraction(i)
                    )
            viscosity = ti.max(h, SETTLING * self.pressure.p[i] * dt)
            self.inertial_viscosity[i], self.viscosity[i] = inertial_viscosity, viscosity
            self.h[i] = 2.0 * self.particles.volume(i) * viscosity / self.gradient.full_weight(i)
            if ti.static(self.particles.has_grains):
                self.h[i] *= 1 - self.stress.rigid.masked[i]

    @ti.func
    def flowing(self):
        """Resistance of the first mix where it flows, with the plastic viscosity alone [N s m]."""
        viscosity = BOND_DISSIPATION * self.constants.eta[0] + self.constants.inertial_viscosity[0]
        return 2.0 * self.particles.volume(0) * viscosity / self.gradient.full_weight(0)


@ti.data_oriented
class DeferredCorrection(Term):
    """The correction for the velocity at the start of a step; its loop over pairs is written for LLVM
    as those of particles/pair_sums.py.
    ``averages``: in a full vessel the law is averaged (I31), so only what flows resists what is left."""

    def __init__(self, fluid, sums, strain_rate, resistance, averages: bool = False):
        super().__init__(fluid, pair_sums=sums, strain_rate=strain_rate, resistance=resistance)
        self.averages, self.lanes = averages, sums.lanes
        self.fraction = ti.field(real(), ())  # of the correction that is applied [-]
        self.max_resistance = ti.field(real(), ())  # upper bound of h_i h_j/(h_i + h_j) [N s m]
        # transpose of the flux before it meets B [N], and last the force of the bonds [N]
        self.sums = ti.Matrix.field(self.dimension + 1, self.lanes, real(), self.capacity)

    @stage("correction")
    def gather(self, fraction: float):
        """Sum the correction over the pairs of all particles at their present velocity; ``fraction`` of it counts."""
        for i in range(self.particles.count[None]):
            self.pair_sums.set_velocity(i, self.particles.u[i])
        for _ in range(1):
            self.fraction[None], self.max_resistance[None] = fraction, HUGE
            if ti.static(self.averages):  # noqa: SIM102  (a compiled choice stays apart)
                if self.walls.curvature_known[None] == 1:
                    self.max_resistance[None] = 0.5 * self.resistance.flowing()
        for i in range(self.particles.count[None]):
            self.gather_bonds(i, fraction, self.max_resistance[None])
        if ti.static(self.walls.carry_curvature):
            for i in range(self.particles.count[None]):
                if self.walls.curvature_known[None] == 1:
                    self.add_walls(i)

    @ti.func
    def gather_bonds(self, i, fraction, max_resistance):
        sums = ti.Matrix.zero(float, self.dimension + 1, self.lanes)
        ui, Gi, hi = self.pair_sums.velocity[i], self.strain_rate.G[i], self.resistance.h[i]
        for k in range(self.neighbors.row_start[i], self.neighbors.row_start[i + 1]):
            j = self.neighbors.column[k]
            if j < 0:  # never: the way out of the loop
                break
            Gj, hj, b, w = self.strain_rate.G[j], self.resistance.h[j], self.gradient.b[k], self.gradient.weight_r2[k]
            difference, r = self.pair_sums.velocity[j] - ui, b / ti.max(w, 1e-12)
            h = ti.min(hi * hj / ti.max(hi + hj, 1e-30), max_resistance)
            for a in ti.static(range(self.lanes)):
                ours, theirs = difference[a], -difference[a]
                for c in ti.static(range(self.dimension)):
                    ours -= Gi[c, a] * r[c]
                    theirs += Gj[c, a] * r[c]
                resisted = h * (ours - theirs)
                for c in ti.static(range(self.dimension)):
                    sums[c, a] += (hi * ours - resisted) * b[c]
                sums[self.dimension, a] -= w * (hi * ours - hj * theirs - 2.0 * resisted)
        self.sums[i] = fraction * sums

    @ti.func
    def add_walls(self, i):
        """Add the part that mirrored ghosts of a full vessel leave where the velocity is curved along the walls: none
        of it is resisted."""
        slopes, _drag = self.walls.curvature_term(i, self.particles.x[i])
        force = self.force_of_walls(i)
        for a in ti.static(range(self.dimension)):
            self.sums[i][self.dimension, a] += force[a]
            for c in ti.static(range(self.dimension)):
                self.sums[i][c, a] += 2.0 * self.fraction[None] * self.resistance.h[i] * slopes[a, c]

    @ti.func
    def force_of_walls(self, i, face: ti.template() = None):
        """Force [N] on particle i of what is taken back at the walls."""
        _slopes, drag = self.walls.curvature_term(i, self.particles.x[i], face)
        return -self.fraction[None] * self.resistance.h[i] * drag

    @ti.func
    def force(self, i):
        """Flux matrix [N m] of particle i, to be added to that of its stress, and the force of its bonds [N]."""
        force = ti.Vector.zero(float, self.dimension)
        for a in ti.static(range(self.dimension)):
            force[a] = self.sums[i][self.dimension, a]
        return self.gradient.in_plane(self.sums[i].transpose()) @ self.gradient.B[i], force
