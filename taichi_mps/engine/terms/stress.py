"""Strain rate and stress of the implicit scheme: the velocity gradient, what the yield law makes of it, and the
viscosities of the matrix (I5, I6)."""

from ..particles.particles import FLUID
from ..runtime.backend import real, ti
from ..runtime.stages import stage
from .constants import Term
from .rheology import (
    bi_viscosity,
    compiled,
    curve_mapping,
    deviator,
    magnitude,
    return_mapping,
    series_mapping,
    shear_rate,
)


@ti.data_oriented
class StrainRate(Term):
    """Velocity gradient, shear rate and residual of the fit (gradient.py) of the velocity that particles carry."""

    def __init__(self, fluid, sums):
        super().__init__(fluid)
        # transpose of the velocity gradient in the plane [1/s]; lanes as in pair_sums.py
        self.G = ti.Matrix.field(self.dimension, sums.lanes, real(), self.capacity)
        self.rate = ti.field(real(), self.capacity)  # shear rate sqrt(2 D:D) [1/s]
        self.residual = ti.field(real(), self.capacity)  # (1/n0) sum (w/r^2) |u_j - u_i - G_i r_ij|^2 [1/s2]
        self.half_step = ti.field(real(), ())  # [s]

    @stage("prepare")
    def evaluate(self, dt: float):
        """Fit the velocity around each particle, at the middle of a step of dt [s]."""
        for _ in range(1):
            self.half_step[None] = 0.5 * dt
        for i in range(self.particles.count[None]):
            G, residual = self.gradient.fit(i, self.particles.u, 1.0)
            G += self.gradient.curvature_correction(i)
            for a, c in ti.static(ti.ndrange(self.dimension, self.dimension)):
                self.G[i][c, a] = G[a, c]
            self.rate[i], self.residual[i] = shear_rate(G), residual

    @ti.func
    def velocity_gradient(self, i):
        """The gradient (t, t) at particle i of the velocity at the start of the step [1/s]."""
        return self.gradient.tensor(i, self.gradient.in_plane(self.G[i].transpose()), self.particles.u)

    @ti.func
    def half_step_change(self, i):
        """Decrease [1/s] of the gradient (t, t) of a velocity when the particles move with it from the middle of the
        step to its end (I32)."""
        G = self.velocity_gradient(i)
        return self.half_step[None] * G @ G


@ti.data_oriented
class SolvedRate(Term):
    """Velocity gradient of the velocity that the system was solved for."""

    def __init__(self, fluid, sums, strain_rate):
        super().__init__(fluid, sums=sums, strain_rate=strain_rate)
        t = self.particles.tensor_dimension
        self.G = ti.Matrix.field(t, t, real(), self.capacity)  # velocity gradient [1/s]

    @stage("stress")
    def evaluate(self, u: ti.template()):
        """Gradient of the velocity u [m/s], walls with their own; its shear rate is the particles' from now on."""
        for i in range(self.particles.count[None]):
            if self.particles.kind[i] != FLUID:
                u[i] = self.particles.u[i]
        self.sums.gather_differences(u)
        for i in range(self.particles.count[None]):
            G = self.sums.velocity_gradient(i, u, 1.0) + self.gradient.curvature_correction(i)
            self.G[i] = G
            self.particles.shear_rate[i] = shear_rate(G - self.strain_rate.half_step_change(i))

    @ti.func
    def velocity_gradient(self, i):
        """The gradient (t, t) at particle i of the solved velocity [1/s]."""
        return self.G[i]


@ti.data_oriented
class Stress(Term):
    """Stress of every particle from the velocity, and its viscosities; its law is that of the problem."""

    def __init__(self, fluid, constants, interface, strain_rate, solved_rate, pressure, problem, rigid):
        # strain_rate: at the start of the step; solved_rate: of the new velocity
        super().__init__(
            fluid,
            constants=constants,
            interface=interface,
            pressure=pressure,
            strain_rate=strain_rate,
            solved_rate=solved_rate,
            rigid=rigid,
        )
        self.law, self.mixes, self.tensors = problem.law, len(problem.materials), self.particles.tensor_dimension
        materials = list(enumerate(problem.materials))
        self.has_friction = any(material.friction_coefficient > 0.0 for _, material in materials)
        # (number of the mix, function) of what has a compiled flow curve, and of what is thixotropic
        numbers = constants.laws
        self.curves = [(k, compiled(law.shear_stress, numbers.get(k))) for k, law in materials if law.curved]
        self.growths = [(k, compiled(law.growth, numbers.get(k))) for k, law in materials if law.ages]
        self.has_curve, self.has_growth = bool(self.curves), bool(self.growths)
        self.mu = ti.field(real(), self.capacity)  # viscosity of the implicit part of the stress [Pa s]
        self.yielded = ti.field(ti.i32, self.capacity)  # 1 where the material flows
        self.averages = (  # whether the law is averaged in a full vessel (I31)
            fluid.walls.carry_curvature and self.law == "yield-stress" and self.mixes == 1 and not self.has_curve
        ) and not self.particles.has_grains
        # variation of the shear stress over the neighbourhood that the gradient of a particle sees [Pa]
        self.variation = ti.field(real(), self.capacity) if self.averages else None
        self.fluidity = None  # shear rate over stress by the mix of each particle [1/(Pa s)], where there are several
        if self.mixes > 1:
            carried = self.law == "yield-stress"
            self.fluidity = self.particles.fluidity if carried else ti.field(real(), self.capacity)

    @stage("prepare")
    def set_viscosity(self):
        """Set the viscosities of the matrix for the shear rate at the start of the step."""
        for i in range(self.particles.count[None]):
            self.mu[i] = self.viscosity(i, self.strain_rate.rate[i])
            if ti.static(self.mixes > 1 and self.law != "yield-stress"):
                self.fluidity[i] = 1.0 / self.mu[i]

    @ti.func
    def viscosity(self, i, rate):
        """Viscosity [Pa s] of the implicit part of the stress: apparent, or the penalty of a true yield stress."""
        m = self.constants.mix(i)
        mu = self.constants.eta[m]
        if ti.static(self.law == "yield-stress"):
            mu = self.constants.mu_r[m]
        elif ti.static(self.law == "bi-viscosity"):
            mu = bi_viscosity(
                rate / self.mortar_share(i), self.constants.eta[m], self.constants.tau_y[m], self.constants.pi_c[m]
            )
        if ti.static(self.law != "yield-stress"):
            mu /= self.mortar_share(i)
        return mu

    @ti.func
    def mortar_share(self, i):
        """Share of what the gradient of particle i sees that strains: beside a grain that of the mortar [-] (G4)."""
        share = ti.cast(1.0, float)
        if ti.static(self.particles.has_grains):
            share = self.rigid.share[i]
        return share

    @ti.func
    def viscous(self, i, G):
        """Implicit part of the stress [Pa] (t, t) of particle i for a velocity gradient [1/s]: 2 mu D, of a viscous
        fluid next to another mix with the shear across the interface in series (I27)."""
        T = 2.0 * self.mu[i] * deviator(G)
        if ti.static(self.mixes > 1 and self.law != "yield-stress"):  # noqa: SIM102  (a compiled choice stays apart)
            if self.interface.other_fraction[i] > 0.0:
                less = 1.0 - self.interface.viscosity(i, self.mu[i]) / self.mu[i]
                T -= less * self.interface.across_interface(i, T)
        return T

    @ti.func
    def shear_stress_magnitude(self, i, mu):
        """Shear stress [Pa] of particle i: of a true yield stress by the stress it carries, else by a viscosity ``mu``
        [Pa s] and its shear rate."""
        size = mu * self.particles.shear_rate[i]
        if ti.static(self.law == "yield-stress"):
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
        m = self.constants.mix(i)
        if ti.static(self.particles.has_grains):  # 2 D = f rate T/|T|: the law of the mortar, with f mu_r
            part, stress, rate = self.rigid.share[i] * self.mu[i], trial, ti.cast(0.0, float)
            if ti.static(self.has_curve):
                stress, _q, rate = curve_mapping(self, i, trial, part)
            else:
                stress, _q, rate = return_mapping(trial, self.constants.eta[m], self.yield_stress(i), part)
            return stress, (trial - stress) / (2.0 * self.mu[i]), rate
        elif ti.static(self.mixes > 1):
            across = self.interface.across_interface(i, trial)
            other_fraction, other_fluidity = self.interface.other_fraction[i], self.interface.other_fluidity[i]
            return series_mapping(self, i, trial, across, self.mu[i], other_fraction, other_fluidity)
        elif ti.static(self.has_curve):
            return curve_mapping(self, i, trial, self.mu[i])
        else:
            variation = ti.cast(0.0, float)
            if ti.static(self.averages):
                variation = self.variation[i]
            return return_mapping(trial, self.constants.eta[m], self.yield_stress(i), self.mu[i], variation)

    @ti.func
    def yield_stress(self, i):
        """Yield stress [Pa] of particle i: that of its mix and, by internal friction, tan(phi) p (I28)."""
        m = self.constants.mix(i)
        stress = self.constants.tau_y[m]
        if ti.static(self.has_friction):
            stress += self.constants.friction[m] * ti.max(
                0.0, self.pressure.p[i] + self.pressure.full[None] * self.pressure.hydrostatic(i)
            )
        return stress

    @ti.func
    def shear_stress(self, i, rate):
        """Shear stress [Pa] of the mix of particle i at a shear rate [1/s], by its flow curve."""
        m = self.constants.mix(i)
        stress = self.yield_stress(i) + self.constants.eta[m] * rate  # Bingham's, whose numbers are fields
        for k, curve in ti.static(self.curves):
            if m == k:
                stress = ti.cast(curve(rate, self.structure(i)), float)
        return stress

    @ti.func
    def over_yield(self, i):
        """Excess (tau - tau_y)/tau_y of the shear stress of particle i by its flow curve [-]."""
        least = self.shear_stress(i, 0.0)
        return (self.shear_stress(i, self.own_rate(i)) - least) / ti.max(least, 1e-9)

    @ti.func
    def slope(self, i):
        """Slope of the flow curve of particle i at its shear rate, where it flows [Pa s]."""
        slope = self.constants.eta[self.constants.mix(i)]
        if ti.static(self.has_curve):
            rate = ti.max(self.particles.shear_rate[i], self.constants.min_bond_rate[None])
            slope = (self.shear_stress(i, 1.1 * rate) - self.shear_stress(i, rate)) / (0.1 * rate)
        return slope

    @ti.func
    def own_rate(self, i):
        """Shear rate [1/s] of the mix of particle i: next to another mix that of the gradient is of both."""
        rate = self.particles.shear_rate[i] / self.mortar_share(i)
        if ti.static(self.mixes > 1 and self.law == "yield-stress"):
            rate = self.fluidity[i] * magnitude(self.particles.stress[i])
        return rate

    @ti.func
    def known_part(self, i):
        """The part of the stress [Pa] (t, t) that the matrix has not: that of the change of the gradient to the end of
        the step, and of a true yield stress, stress - 2 mu_r q."""
        T = -self.viscous(i, self.strain_rate.half_step_change(i))
        if ti.static(self.law == "yield-stress"):
            T += self.particles.stress[i] - 2.0 * self.mu[i] * self.particles.plastic_rate[i]
        return T

    @stage("stress")
    def map_to_yield_surface(self, k: ti.i32, viscous: ti.i32):
        """The trial stress of the solved velocity mapped back onto the yield surface (I6); in the first ``viscous`` of
        the iterations k of a step the body is still taken for a viscous one."""
        for i in range(self.particles.count[None]):
            rate = self.particles.shear_rate[i]
            if ti.static(self.law == "yield-stress"):
                carries = ti.cast(self.gradient.B[i][0, 0] > 0.0, float)
                D = deviator(self.solved_rate.velocity_gradient(i) - self.strain_rate.half_step_change(i))
                trial = self.particles.stress[i] + 2.0 * self.mu[i] * D
                stress, q, flow = self.yield_law(i, trial)
                if k >= viscous:
                    self.particles.stress[i] = stress * carries
                    self.particles.plastic_rate[i] = q * carries
                    if ti.static(self.mixes > 1):
                        self.fluidity[i] = carries * flow / ti.max(magnitude(stress), 1e-12)
                self.yielded[i] = flow > 0.0
            elif ti.static(self.law == "bi-viscosity"):
                self.yielded[i] = rate / self.mortar_share(i) >= 2.0 * self.constants.pi_c[self.constants.mix(i)]
                self.mu[i] = self.viscosity(i, rate)
                if ti.static(self.mixes > 1):
                    self.fluidity[i] = 1.0 / self.mu[i]
            else:
                self.yielded[i] = 1

    @ti.func
    def total(self, i, rate: ti.template()):
        """Stress [Pa] (t, t) of particle i, pressure included: the one it carries, else that of a StrainRate or
        SolvedRate."""
        T = ti.Matrix.zero(float, self.tensors, self.tensors)
        if ti.static(self.law == "yield-stress"):  # noqa: SIM108  (a compiled choice stays apart)
            T = self.particles.stress[i]
        else:
            T = self.viscous(i, rate.velocity_gradient(i) - self.strain_rate.half_step_change(i))
        return T - self.pressure.p[i] * ti.Matrix.identity(float, self.tensors)

    @ti.kernel
    def find_yielded(self):
        """Mark the particles that flow, by the plastic rate that they carry; for a true yield stress."""
        for i in range(self.particles.count[None]):
            self.yielded[i] = ti.cast(self.particles.plastic_rate[i].norm_sqr() > 0.0, ti.i32)

    @stage("advance")
    def advance(self, dt: float, u: ti.template()):
        """Advance the structure, and rotate the stress with the material, over a step of dt [s] with the velocity u
        (Jaumann's rate, by a rotation: Hughes and Winget 1980)."""
        for i in range(self.particles.count[None]):
            for k, growth_of in ti.static(self.growths):
                if self.constants.mix(i) == k:
                    self.particles.structure[i] += dt * growth_of(self.own_rate(i), self.structure(i))
            if ti.static(self.law == "yield-stress"):
                G = self.gradient.velocity_gradient(i, u, 1.0) + self.gradient.curvature_correction(i)
                W = 0.25 * dt * (G - G.transpose())
                I = ti.Matrix.identity(float, self.tensors)  # noqa: E741
                rotation = (I - W).inverse() @ (I + W)
                self.particles.stress[i] = rotation @ self.particles.stress[i] @ rotation.transpose()
