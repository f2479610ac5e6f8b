"""The stress of the implicit scheme: what the yield law makes of a velocity, and the viscosities of the matrix."""

from ..particles.particles import FLUID
from ..runtime.backend import real, ti
from ..runtime.stages import stage
from .constants import NON_AFFINE
from .rheology import bi_viscosity, compiled, curve_mapping, deviator, flow_curve, magnitude, return_mapping

SETTLING = 2.0  # h >= 2 p dt: what the pressure pushes apart goes no further than to its place in a step
# What a thin fluid has against non-affine motion at rest, over that in motion, or its particles find no places to stay
# in; and the strain or rotation in a step from which on it moves
AT_REST, MOVING = 64.0, 0.002
EDGE = 4.0  # at the edge of a plug a quarter of the bonds carry all non-affine motion: their rate is twice the mean


@ti.data_oriented
class Stress:
    """Stress, pressure and shear rate of every particle from the velocity, and its viscosities.

    law: newtonian, bingham (a true yield value) or bi-viscosity."""

    def __init__(self, particles, gradient, walls, system, constants, smoothing, material, law, gravity):
        self.particles, self.gradient, self.walls, self.system = particles, gradient, walls, system
        self.constants, self.smoothing, self.law = constants, smoothing, law
        self.curve, self.growth = flow_curve(material), compiled(getattr(material, "growth", None))
        self.has_curve, self.has_growth = self.curve is not None, self.growth is not None
        self.g = ti.types.vector(particles.dimension, real())(gravity)
        self.yielded = ti.field(ti.i32, particles.capacity)  # 1 where the material flows

    @ti.func
    def viscosity(self, i, rate):
        """Viscosity [Pa s] of the implicit part of the stress: apparent, or the penalty of a true yield value."""
        m = self.constants.mix(i)
        mu = self.constants.eta[m]
        if ti.static(self.law == "bingham"):
            mu = self.constants.mu_r[m]
        elif ti.static(self.law == "bi-viscosity"):
            mu = bi_viscosity(rate, self.constants.eta[m], self.constants.tau_y[m], self.constants.pi_c[m])
        return mu

    @ti.func
    def inertial(self, i, G, dt):
        """What a thin fluid has against the motion that the gradient does not see [Pa s]. Without a yield value it is
        64 times as much at rest, less where the velocity gradient G [1/s] strains or turns it in a step dt [s], and no
        more than elsewhere from 0.002 on and in a full closed box, where nothing settles (I8)."""
        resistance = self.constants.inertial[self.constants.mix(i)]
        if ti.static(self.law == "newtonian"):
            rest = 1.0 - ti.min(1.0, 2.0**0.5 * G.norm() * dt / MOVING)
            resistance *= 1.0 + (AT_REST - 1.0) * rest**2 * (1 - self.smoothing.full[None])
        return resistance

    @ti.func
    def non_affine(self, i, rate, left, first, dt, inertial):
        """h [Pa s], what resists the motion that the gradient does not see, for a shear rate [1/s], what the linear
        fit ``left`` of the last velocity [1/s2] (in the first step these are not known), a step of dt [s], and
        ``inertial`` what a thin fluid has [Pa s]."""
        m = self.constants.mix(i)
        h = NON_AFFINE * self.constants.eta[m] + inertial
        if ti.static(self.law != "newtonian"):  # noqa: SIM102  (a compiled choice stays apart)
            if first == 0:
                bond_rate = ti.max(ti.sqrt(rate * rate + 2.0 * NON_AFFINE * EDGE * left), self.constants.slowest[None])
                if ti.static(self.has_curve):
                    h = NON_AFFINE * self.curve(bond_rate, self.structure(i)) / bond_rate + inertial
                else:
                    h += NON_AFFINE * self.constants.tau_y[m] / bond_rate
        return ti.max(h, SETTLING * self.smoothing.p[i] * dt)

    @ti.func
    def size(self, i):
        """Shear stress [Pa] of particle i."""
        size = self.system.mu[i] * self.particles.shear_rate[i]
        if ti.static(self.law == "bingham"):
            size = magnitude(self.particles.stress[i])
        return size

    @ti.func
    def structure(self, i):
        """Structure of a thixotropic particle, 0 of any other [-]."""
        structure = ti.cast(0.0, float)
        if ti.static(self.has_growth):
            structure = self.particles.structure[i]
        return structure

    @ti.func
    def yield_law(self, i, trial):
        """Stress [Pa], plastic rate and its size [1/s] of particle i for a trial stress [Pa]."""
        if ti.static(self.has_curve):
            return curve_mapping(self.curve, trial, self.structure(i), self.system.mu[i])
        else:
            m = self.constants.mix(i)
            return return_mapping(trial, self.constants.eta[m], self.constants.tau_y[m], self.system.mu[i])

    @stage
    def update(self, u: ti.template(), source: ti.template(), viscous: ti.i32):
        """Shear rate; p <- p - K (div u - s), s the ``source`` [1/s]; the stress mapped back onto the yield surface,
        unless the body is still taken for a ``viscous`` one."""
        for i in range(self.particles.count[None]):
            if self.particles.kind[i] != FLUID:
                u[i] = self.particles.u[i]
        self.system.gather_jumps(u)
        for i in range(self.particles.count[None]):
            if self.system.acts(i):
                G = self.system.velocity_gradient(i, u, 1.0)
                D = deviator(G)
                rate = 2.0 * magnitude(D)
                carries = ti.cast(self.gradient.B[i][0, 0] > 0.0, float)
                self.particles.shear_rate[i] = rate
                self.smoothing.p[i] -= self.constants.bulk[None] * (G.trace() - source[i]) * carries
                if ti.static(self.law == "bingham"):
                    trial = self.particles.stress[i] + 2.0 * self.system.mu[i] * D
                    stress, q, flow = self.yield_law(i, trial)
                    if viscous == 0:
                        self.particles.stress[i] = stress * carries
                        self.particles.plastic_rate[i] = q * carries
                    self.yielded[i] = flow > 0.0
                elif ti.static(self.law == "bi-viscosity"):
                    self.yielded[i] = rate >= 2.0 * self.constants.pi_c[self.constants.mix(i)]
                    self.system.mu[i] = self.viscosity(i, rate)
                else:
                    self.yielded[i] = 1
                if ti.static(self.walls.rub):
                    self.rub(i, G, D, u)

    @ti.func
    def rub(self, i, G, D, u: ti.template()):
        """Friction of the walls for all that particle i gives to them: stress, pressure, non-affine resistance."""
        T = 2.0 * self.system.mu[i] * D
        if ti.static(self.law == "bingham"):
            T = self.particles.stress[i]
        T -= self.smoothing.p[i] * ti.Matrix.identity(float, T.n)
        B, x, h = self.gradient.B[i], self.particles.x[i], self.system.h[i]
        flux = self.gradient.spread_stress(i, T) - h * self.gradient.in_plane(G)
        weight = self.particles.volume(i) * self.constants.density[self.constants.mix(i)] * self.g
        weight *= self.constants.pressed(self.smoothing.p[i])
        share, mu = self.gradient.counts_as(i), self.system.mu[i]
        self.walls.adjust_friction(i, x, u[i], flux, weight, B, mu, h, share)

    @ti.func
    def carry(self, i, dt, u: ti.template()):
        """At the end of a step: keep p; the structure grows; the stress turns with the material."""
        self.particles.p[i] = self.smoothing.p[i]
        if ti.static(self.system.sleeps):  # noqa: SIM102  (a compiled choice stays apart)
            if not self.system.acts(i):  # what sleeps does not deform
                self.particles.shear_rate[i], self.yielded[i] = 0.0, 0
        if ti.static(self.has_growth):
            self.particles.structure[i] += dt * self.growth(self.particles.shear_rate[i], self.structure(i))
        if ti.static(self.law == "bingham"):
            G = self.gradient.velocity_gradient(i, u, 1.0)
            W = 0.5 * (G - G.transpose())
            stress = self.particles.stress[i]
            self.particles.stress[i] = stress + dt * (W @ stress - stress @ W)
