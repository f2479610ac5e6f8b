"""Pressure of the momentum equation and pressure for output, both smoothed over neighbours; its level in a full closed
box; and the prescribed divergence that corrects packing errors (I11)."""

from ..runtime.backend import real, ti
from ..runtime.stages import stage
from .constants import HUGE, Term

SMOOTHING = 0.6  # weight of the neighbours' mean in the pressure
OUTPUT_SMOOTHING = 0.75  # weight of the neighbours' mean in the pressure for output, applied twice
SMOOTHING_SCALE = 1e-3  # strain per step above which the pressure is smoothed fully
COMPRESSION = 3.0  # mean pressure of a full closed box over the largest viscous stress in it
# fraction of the packing error removed per step; thin rings lose more of their packing in a step
CORRECTION_RATE, RING_CORRECTION_RATE = 0.05, 0.2
# fraction approached where the diffusion number exceeds DIFFUSION_SCALE: there viscosity damps the correction
VISCOUS_CORRECTION_RATE, DIFFUSION_SCALE = 0.25, 0.25
# upper bound of the divergence over the shear rate, for rings and in a full closed box, or max_divergence if larger
MAX_SHEAR_FRACTION = 0.25
# packing error of an enclosed particle, of which no more counts in a step, but in a full closed box
MIN_PACKING_ERROR, MIN_PACKING_ERROR_CLOSED_BOX = -0.03, -1.0
# packing that poured material lacks, from which on it is loose; not counted is what a surface misses, over its normal
LOOSE, MISSING_AT_SURFACE = 0.1, 0.2
FULL_STRAIN = 0.02  # in a step, from which on packing error and shift act fully


@ti.data_oriented
class Pressure(Term):
    """Smoothed pressure ``p`` [Pa] of every particle; zero where it carries no stress.

    The walls of a full closed box hold the weight of a fluid of one density, however it flows, and where there are
    grains those below the lowest place of its surface, the ``level``. There p is the pressure in excess of the
    ``hydrostatic`` one, and that weight acts on no particle (I34). From step to step the particles carry the whole
    pressure, but those of a full closed box the excess.
    """

    def __init__(self, fluid, constants):
        super().__init__(fluid, constants=constants)
        self.p = ti.field(real(), self.capacity)  # [Pa]
        self.smoothed_once = ti.field(real(), self.capacity)  # pressure for output after the first smoothing [Pa]
        self.full = constants.full  # 1 in a closed box without a free surface
        # number of particles that carry stress, that have a gap, that lie at a surface
        self.rows, self.gaps, self.surface = (ti.field(ti.i32, ()) for _ in range(3))

    @ti.func
    def hydrostatic_fraction(self, p):
        """f: fraction of its weight that a particle of pressure p [Pa] hands on hydrostatically [-]: it fades to zero
        where p is below that of half a layer, for a body in free fall has no hydrostatic part. A full closed box cannot
        fall, and its pressure is free up to a constant: there it is 1 everywhere."""
        return ti.max(self.constants.pressure_ramp(p), ti.cast(self.full[None], float))

    @ti.func
    def hydrostatic(self, i):
        """Pressure [Pa] of the first mix at rest that stands beside p at particle i: in a full closed box, zero in its
        middle, or below the ``level``; 0 elsewhere, and of a particle that carries no stress."""
        pressure = ti.cast(0.0, float)
        if ti.static(self.constants.holds):  # noqa: SIM102  (a compiled choice stays apart)
            if self.gradient.B[i][0, 0] > 0.0:
                s = self.constants.depth(i)
                if self.full[None] == 0:
                    s = 0.5 * ti.max(0.0, ti.min(1.0, s)) ** 2 + ti.max(0.0, s - 1.0)
                pressure = self.constants.density[0] * ti.cast(
                    self.constants.gravity[None].norm() * self.constants.spacing * s, float
                )
        return pressure

    @ti.func
    def whole(self, i):
        """Pressure [Pa] of particle i with the hydrostatic one beside p."""
        return self.p[i] + self.hydrostatic(i)

    @ti.func
    def carried(self, i):
        """Part of the hydrostatic pressure [Pa] that particles carry from step to step."""
        return (1 - self.full[None]) * self.hydrostatic(i)

    @ti.func
    def head_density(self, i):
        """Density whose weight the pressure that particles carry balances around particle i [kg/m3]."""
        return self.constants.head_density(i) + (1 - self.full[None]) * self.constants.density_held(i)

    @ti.func
    def mean(self, i, fraction, pressure: ti.template()):
        """(1-a) p_i + a sum w (p_j - f rho g.r_ij)/sum w of a ``pressure`` that particles carry, over those that carry
        stress, a the ``fraction``, f the ``hydrostatic_fraction`` of p_i. Where i carries none it stays p_i."""
        x = self.particles.x[i]
        total, weight = ti.cast(0.0, float), ti.cast(0.0, float)
        density_i = self.head_density(i)
        g = ti.cast(self.constants.gravity_at(i), float) * self.hydrostatic_fraction(pressure[i])
        for k in range(self.neighbors.row_start[i], self.neighbors.row_start[i + 1]):
            j = self.neighbors.column[k]
            if self.gradient.B[j][0, 0] > 0.0:
                r = ti.cast(self.neighbors.bins.displacement(x, self.particles.x[j]), float)
                w = self.gradient.weight_r2[k] * r.dot(r)
                density = density_i
                if ti.static(self.constants.mixes > 1):
                    density = 0.5 * (density_i + self.head_density(j))
                total += w * (pressure[j] - density * g.dot(r))
                weight += w
        p = pressure[i]
        if weight > 0.0 and self.gradient.B[i][0, 0] > 0.0:
            p = (1.0 - fraction) * p + fraction * total / weight
        return p

    @stage("smooth pressure")
    def smooth(self, dt: float):
        """p~: the mean pressure with the weight 0.6 where the material deforms and 0 at rest."""
        for i in range(self.particles.count[None]):
            self.p[i] = 0.0
            if self.gradient.B[i][0, 0] > 0.0:
                deforming = ti.min(1.0, self.particles.shear_rate[i] * dt / SMOOTHING_SCALE)
                self.p[i] = self.mean(i, SMOOTHING * deforming, self.particles.p) - self.carried(i)

    @ti.kernel
    def smooth_for_output(self):
        """Smooth the pressure twice for output, into ``p``, which the next step overwrites: it may hold checkerboard
        modes, to which the discrete gradient is blind and which are undamped at rest."""
        for i in range(self.particles.count[None]):
            self.smoothed_once[i] = self.mean(i, OUTPUT_SMOOTHING, self.particles.p)
        for i in range(self.particles.count[None]):
            self.p[i] = self.mean(i, OUTPUT_SMOOTHING, self.smoothed_once) + self.full[None] * self.hydrostatic(i)

    @ti.func
    def has_gap(self, i):
        """1 where particle i has less than three quarters of its neighbours."""
        return ti.cast(self.gradient.neighbour_count[i] < 0.75 * self.gradient.lattice_neighbours, ti.i32)

    @ti.func
    def at_surface(self, i):
        """1 where particle i has a gap, and ``dimension`` of those around it."""
        around = 0
        if self.has_gap(i):
            for k in range(self.neighbors.row_start[i], self.neighbors.row_start[i + 1]):
                around += self.has_gap(self.neighbors.column[k])
        return ti.cast(around >= self.dimension, ti.i32)

    @stage("smooth pressure")
    def find_surface(self, may_change: ti.i32, first: ti.i32):
        """Whether this is a full closed box, without a surface: particles with a gap that have ``dimension`` of them
        around. It stays what it was unless it ``may_change``: in a step of all particles, where the vessel may fill.
        As it changes, the pressure that particles carry from before this step loses or gains the hydrostatic one, and
        in the ``first`` step it is that. With grains, also the ``level``: how deep the surface reaches."""
        if ti.static(self.constants.may_be_full or self.constants.has_level):
            was_full = ti.max(self.full[None], first)
            for i in range(self.particles.count[None]):
                self.p[i] = self.full[None] * self.hydrostatic(i)
            for _ in range(1):
                self.rows[None], self.gaps[None], self.surface[None], self.constants.level[None] = 0, 0, 0, -HUGE
            for i in range(self.particles.count[None]):
                if self.gradient.B[i][0, 0] > 0.0:
                    self.rows[None] += 1
                    self.gaps[None] += self.has_gap(i)
                    if self.at_surface(i):
                        self.surface[None] += 1
                        ti.atomic_max(self.constants.level[None], self.constants.along_gravity(self.particles.x[i]))
            for _ in range(1):
                if may_change == 1:
                    self.full[None] = ti.cast(
                        self.surface[None] == 0 and self.rows[None] > 10 * self.gaps[None], ti.i32
                    )
                if self.constants.level[None] == -HUGE:
                    self.constants.level[None] = HUGE
            for i in range(self.particles.count[None]):
                if was_full != self.full[None]:
                    before = self.p[i] if first == 0 else self.hydrostatic(i)
                    self.particles.p[i] += before - self.full[None] * self.hydrostatic(i)

    @ti.func
    def volume_mean(self, values: ti.template()):
        """Mean of a field over the particles that carry stress, by their volumes."""
        volumes, total = ti.cast(0.0, ti.f64), ti.cast(ti.zero(values[0]), ti.f64)
        for i in range(self.particles.count[None]):
            if self.gradient.B[i][0, 0] > 0.0:
                volume = ti.cast(self.particles.volume(i), ti.f64)
                volumes += volume
                total += volume * ti.cast(values[i], ti.f64)
        return ti.cast(total / volumes, float)

    @stage("prepare")
    def compress(self):
        """Raise the pressure in a full closed box, where it is free up to a constant, so that no particle is in
        tension, which would open voids."""
        ti.loop_config(serialize=True)
        for _ in range(1):
            if self.full[None] == 1:
                mean_p, mean_u = self.volume_mean(self.p), self.volume_mean(self.particles.u)
                max_rate, speed2 = ti.cast(0.0, float), ti.cast(0.0, float)
                for i in range(self.particles.count[None]):
                    if self.gradient.B[i][0, 0] > 0.0:
                        max_rate = ti.max(max_rate, self.particles.shear_rate[i])
                        speed2 = ti.max(speed2, (self.particles.u[i] - mean_u).norm_sqr())
                target = ti.cast(0.0, float)
                for m in range(self.constants.mixes):
                    stress = self.constants.eta[m] * max_rate + self.constants.tau_y[m]
                    target = ti.max(target, COMPRESSION * stress + self.constants.density[m] * speed2)
                for i in range(self.particles.count[None]):
                    if self.gradient.B[i][0, 0] > 0.0:
                        self.p[i] += target - mean_p

    @stage("stress")
    def update_multiplier(self, rate: ti.template(), constraint: ti.template()):
        """p <- p - K (div u - s) for the velocity gradient ``rate`` and the divergence s that the ``constraint`` wants:
        the multiplier of the augmented Lagrangian (I7)."""
        for i in range(self.particles.count[None]):
            carries = ti.cast(self.gradient.B[i][0, 0] > 0.0, float)
            excess = rate.velocity_gradient(i).trace() - constraint.divergence[i]
            self.p[i] -= self.constants.bulk[None] * excess * carries

    @stage("advance")
    def keep(self):
        """Store p in the particles at the end of a step."""
        for i in range(self.particles.count[None]):
            self.particles.p[i] = self.p[i] + self.carried(i)


@ti.data_oriented
class VolumeConstraint(Term):
    """Wanted divergence of every particle; ``pours``: whether inlets bring material, which may land loose."""

    def __init__(self, fluid, constants, strain_rate, pressure, shifting, stress, pours):
        super().__init__(
            fluid,
            constants=constants,
            strain_rate=strain_rate,
            pressure=pressure,
            shifting=shifting,
            stress=stress,
            pours=pours,
        )
        self.spacing = fluid.gradient.spacing
        self.correction_rate = RING_CORRECTION_RATE if self.particles.axisymmetric else CORRECTION_RATE
        self.divergence = ti.field(real(), self.capacity)  # s [1/s]

    @stage("prepare")
    def set(self, dt: float):
        """s = r (packing - 1)/dt within +-``max_divergence``, r the fraction that a step of dt [s] removes; only where
        the material deforms or is torn. A full closed box has no voids: there any lack is taken back.

        Packing corrections dissipate the power tau_y |s|. For a true yield stress with a free surface this is limited
        to the viscous dissipation of the flow: else the correction in a body at rest makes the strain that enables it.
        """
        for i in range(self.particles.count[None]):
            follows_shear = self.pressure.full[None]  # 1 where it is as fast as the shear
            least = MIN_PACKING_ERROR if self.gradient.enclosed(i) else 0.0
            error = ti.max(
                self.gradient.packing[i] - 1.0, least if follows_shear == 0 else MIN_PACKING_ERROR_CLOSED_BOX
            )
            if ti.static(self.gradient.axisymmetric):
                follows_shear = 1
            most = ti.max(
                self.constants.max_divergence[None], follows_shear * MAX_SHEAR_FRACTION * self.strain_rate.rate[i]
            )
            divergence = ti.max(-most, ti.min(most, self.removed_fraction(i, dt) * error / dt))
            divergence *= self.shifting.correction_fraction(i, dt, FULL_STRAIN)
            if ti.static(self.stress.law == "yield-stress"):  # noqa: SIM102  (a compiled choice stays apart)
                if self.pressure.full[None] == 0:
                    most = self.stress.own_rate(i) * self.stress.over_yield(i)
                    divergence = ti.max(-most, ti.min(most, divergence))
            if ti.static(self.pours):
                divergence = self.let_settle(i, dt, divergence)
            # at the end of the step (I32)
            self.divergence[i] = divergence + self.strain_rate.half_step_change[i].trace()

    @ti.func
    def let_settle(self, i, dt, divergence):
        """The divergence [1/s], or that by which what landed loose closes under its weight until it is packed (I33): no
        faster than its apparent weight, none in free fall, makes it in a step. A jet is left as it falls."""
        lack = 1.0 - self.gradient.packing[i]
        loose = lack - MISSING_AT_SURFACE * self.gradient.surface_normal[i].norm() > LOOSE
        if loose and self.gradient.B[i][0, 0] > 0.0 and self.pressure.full[None] == 0:
            g = ti.cast(self.constants.gravity_at(i), float)
            apparent = ti.max(0.0, (g - self.particles.a[i]).dot(g) / ti.max(g.norm(), 1e-30))  # [m/s2]
            closing = ti.max(0.0, -self.strain_rate.velocity_gradient(i).trace())
            borne = self.constants.pressure_ramp(self.particles.p[i] - self.constants.layer_pressure[None])
            wanted = borne * self.removed_fraction(i, dt) * lack / dt
            divergence = ti.min(divergence, -ti.min(wanted, closing + apparent * dt / self.spacing))
        return divergence

    @ti.func
    def removed_fraction(self, i, dt):
        """Part of the packing error that a step removes, by its diffusion number eta dt/(rho l0^2) [-]; in a full
        closed box, which cannot change its volume, that would only stir: there shear makes the errors, and a step
        removes as much as it strains, 0.05 at least and 0.25 at most."""
        m = self.constants.mix(i)
        diffusion = self.constants.eta[m] * dt / (self.constants.density[m] * self.spacing**2)
        more = (VISCOUS_CORRECTION_RATE - self.correction_rate) * diffusion / (DIFFUSION_SCALE + diffusion)
        if self.pressure.full[None] == 1:
            more = ti.max(0.0, ti.min(VISCOUS_CORRECTION_RATE, self.strain_rate.rate[i] * dt) - self.correction_rate)
        return self.correction_rate + more

    @stage("prepare")
    def balance(self):
        """A box full of fluid has no surface to give way: there no mean divergence can be wanted."""
        ti.loop_config(serialize=True)
        for _ in range(1):
            if self.pressure.full[None] == 1:
                mean = self.pressure.volume_mean(self.divergence)
                for i in range(self.particles.count[None]):
                    self.divergence[i] -= mean
