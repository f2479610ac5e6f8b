"""Stress of the implicit scheme: what the yield law makes of the strain rate (strain_rate.py), and the viscosities of
the matrix (I5, I6)."""

from ..runtime.backend import real, ti
from ..runtime.stages import stage
from .constants import Term
from .rheology import bi_viscosity, compiled, curve_mapping, deviator, magnitude, series_mapping

MIN_PENALTY_FRACTION = 0.5  # fraction of mortar beside a grain, from which on down its penalty grows no more [-]


@ti.func
def return_mapping(trial, plastic_viscosity, yield_stress, mu_r, variation=0.0):
    """Stress [Pa] and plastic strain rate q [1/s] of a true Bingham material from the trial stress lambda + 2 mu_r D.

    Minimises the dissipation of q penalised by mu_r: |q| = max(0, (|trial| - tau_y)/(eta + mu_r)) (augmented
    Lagrangian of Fortin and Glowinski). Rigid where |trial| <= tau_y: then q = 0 and the stress is the trial.

    Where the stress differs by +-``variation`` [Pa] over what the gradient sees, the rate is the mean of the law (I31).
    """
    trial_magnitude = magnitude(trial)
    rate = ti.max(0.0, (trial_magnitude - yield_stress) / (plastic_viscosity + mu_r))
    factor = (yield_stress + plastic_viscosity * rate) / ti.max(trial_magnitude, 1e-12) if rate > 0.0 else 1.0
    over = trial_magnitude - yield_stress + variation
    if variation > 1e-6 * yield_stress and over > 0.0:
        # rate = x^2/scale and x + mu_r rate = over, of x = tau - tau_y + variation
        scale = 4.0 * variation * plastic_viscosity
        x = 2.0 * over / (1.0 + ti.sqrt(1.0 + 4.0 * mu_r * over / scale))
        if x < 2.0 * variation:
            rate = x * x / scale
            factor = (trial_magnitude - mu_r * rate) / ti.max(trial_magnitude, 1e-12)
    stress = trial * factor
    return stress, (trial - stress) / (2.0 * mu_r), rate


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
        self.law, self.mixes, self.tensors = problem.law, len(problem.scene.materials), self.particles.tensor_dimension
        materials = list(enumerate(problem.scene.materials))
        self.has_friction = any(material.friction_coefficient > 0.0 for _, material in materials)
        # (number of the mix, function) of what has a compiled flow curve, and of what is thixotropic
        self.curves = [(k, compiled(law.shear_stress, constants.laws.get(k))) for k, law in materials if law.curved]
        self.growths = [(k, compiled(law.growth, constants.laws.get(k))) for k, law in materials if law.ages]
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
            self.fluidity = self.particles.fluidity if self.law == "yield-stress" else ti.field(real(), self.capacity)

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
                rate / self.mortar_fraction(i), self.constants.eta[m], self.constants.tau_y[m], self.constants.pi_c[m]
            )
        lowest = ti.static(MIN_PENALTY_FRACTION if self.law == "yield-stress" else 0.0)
        # of what a gradient sees only mortar strains, so it is stiffer
        return mu * self.stress_ratio(i) / ti.max(lowest, self.mortar_fraction(i))

    @ti.func
    def mortar_fraction(self, i):
        """Fraction of what the gradient of particle i sees that strains: beside a grain that of the mortar [-] (G4)."""
        if ti.static(self.particles.has_grains):
            return self.rigid.mortar_fraction[i]
        else:
            return ti.cast(1.0, float)

    @ti.func
    def stress_ratio(self, i):
        """Stress of particle i over that of the mortar that its gradient sees, beside a grain [-] (G4)."""
        if ti.static(self.particles.has_grains):
            return self.rigid.stress_ratio[i]
        else:
            return ti.cast(1.0, float)

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
        if ti.static(self.law == "yield-stress"):
            return magnitude(self.particles.stress[i])
        else:
            return mu * self.particles.shear_rate[i]

    @ti.func
    def structure(self, i):
        """Structure of a thixotropic particle, 0 of any other [-]."""
        if ti.static(self.has_growth):
            return self.particles.structure[i]
        else:
            return ti.cast(0.0, float)

    @ti.func
    def yield_law(self, i, trial):
        """Stress [Pa], plastic rate and its size [1/s] of particle i for a trial stress [Pa]."""
        # beside a grain the law is that of the mortar for the trial over the ratio, with c_m mu_r/s (G4)
        ratio = self.stress_ratio(i)
        mu = self.mortar_fraction(i) * self.mu[i] / ratio
        given = trial / ratio
        stress, rate, variation = given, ti.cast(0.0, float), ti.cast(0.0, float)
        if ti.static(self.mixes > 1):
            across = self.interface.across_interface(i, given)
            other_fraction, other_fluidity = self.interface.other_fraction[i], self.interface.other_fluidity[i]
            stress, _q, rate = series_mapping(self, i, given, across, mu, other_fraction, other_fluidity)
        elif ti.static(self.has_curve):
            stress, _q, rate = curve_mapping(self, i, given, mu)
        else:
            if ti.static(self.averages):
                variation = self.variation[i]
            eta = self.constants.eta[self.constants.mix(i)]
            stress, _q, rate = return_mapping(given, eta, self.yield_stress(i), mu, variation)
        stress *= ratio
        return stress, (trial - stress) / (2.0 * self.mu[i]), rate

    @ti.func
    def yield_stress(self, i):
        """Yield stress [Pa] of particle i: that of its mix and, by internal friction, tan(phi) p (I28)."""
        m = self.constants.mix(i)
        stress = self.constants.tau_y[m]
        if ti.static(self.has_friction):
            stress += self.constants.friction[m] * ti.max(0.0, self.pressure.whole(i))
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
        if ti.static(self.mixes > 1 and self.law == "yield-stress"):
            return self.fluidity[i] * magnitude(self.particles.stress[i])
        else:
            return self.particles.shear_rate[i] / self.mortar_fraction(i)

    @ti.func
    def known_part(self, i):
        """The part of the stress [Pa] (t, t) that the matrix has not: that of the change of the gradient to the end of
        the step, and of a true yield stress, stress - 2 mu_r q."""
        T = -self.viscous(i, self.strain_rate.half_step_change[i])
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
                D = deviator(self.solved_rate.velocity_gradient(i) - self.strain_rate.half_step_change[i])
                stress, q, flow = self.yield_law(i, self.particles.stress[i] + 2.0 * self.mu[i] * D)
                if k >= viscous:
                    self.particles.stress[i] = stress * carries
                    self.particles.plastic_rate[i] = q * carries
                    if ti.static(self.mixes > 1):
                        self.fluidity[i] = carries * flow / ti.max(magnitude(stress), 1e-12)
                self.yielded[i] = flow > 0.0
            elif ti.static(self.law == "bi-viscosity"):
                self.yielded[i] = rate / self.mortar_fraction(i) >= 2.0 * self.constants.pi_c[self.constants.mix(i)]
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
            T = self.viscous(i, rate.velocity_gradient(i) - self.strain_rate.half_step_change[i])
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
