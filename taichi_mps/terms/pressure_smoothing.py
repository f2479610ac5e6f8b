"""The pressure that acts and the one that is read: mean over neighbours, and the constant of a full closed box."""

from ..runtime.backend import real, ti
from ..runtime.stages import stage

SMOOTHING = 0.6  # weight of the neighbours' mean in the pressure
READING = 0.75  # the same in a snapshot, twice
SMOOTHING_SCALE = 1e-3  # strain per step above which the pressure is smoothed fully
COMPRESSION = 3.0  # mean pressure of a full closed box over the largest viscous stress in it


@ti.data_oriented
class PressureSmoothing:
    """Smoothed pressure ``p`` [Pa] of every particle; zero where it carries no stress."""

    def __init__(self, particles, gradient, constants, gravity):
        self.particles, self.gradient, self.constants = particles, gradient, constants
        self.neighbors, self.dimension = gradient.neighbors, particles.dimension
        self.g = ti.types.vector(particles.dimension, real())(gravity)
        self.p = ti.field(real(), particles.capacity)  # [Pa]
        self.once = ti.field(real(), particles.capacity)  # half-way to the pressure that is read [Pa]
        self.full = ti.field(ti.i32, ())  # 1 in a closed box without a free surface

    @ti.func
    def mean(self, i, fraction, pressure: ti.template()):
        """(1-a) p_i + a sum w (p_j - f rho g.r_ij)/sum w of a ``pressure``, over particles that carry stress, a the
        ``fraction``; f fades to zero where p_i is below that of half a layer: a body in free fall has no hydrostatic
        part."""
        x = self.particles.x[i]
        total, weight = ti.cast(0.0, float), ti.cast(0.0, float)
        own = self.constants.density[self.constants.mix(i)]
        g = self.g * self.constants.pressed(pressure[i])
        for k in range(self.neighbors.row_start[i], self.neighbors.row_start[i + 1]):
            j = self.neighbors.column[k]
            if self.gradient.B[j][0, 0] > 0.0:
                r = ti.cast(self.neighbors.bins.displacement(x, self.particles.x[j]), float)
                w = self.gradient.weight_r2[k] * r.dot(r)
                density = own
                if ti.static(self.constants.mixes > 1):
                    density = 0.5 * (own + self.constants.density[self.constants.mix(j)])
                total += w * (pressure[j] - density * g.dot(r))
                weight += w
        p = pressure[i]
        if weight > 0.0:
            p = (1.0 - fraction) * p + fraction * total / weight
        return p

    @stage("smooth pressure")
    def smooth(self, dt: float):
        """p~: the mean pressure with the weight 0.6 where the material deforms and 0 at rest."""
        for i in range(self.particles.count[None]):
            self.p[i] = 0.0
            if self.gradient.B[i][0, 0] > 0.0:
                deforming = ti.min(1.0, self.particles.shear_rate[i] * dt / SMOOTHING_SCALE)
                self.p[i] = self.mean(i, SMOOTHING * deforming, self.particles.p)

    @ti.kernel
    def read(self):
        """The pressure to read, the mean of the mean, into ``p``, which the next step fills anew: the force does not
        see what alternates from particle to particle, so nothing holds it down at rest, and it means nothing."""
        for i in range(self.particles.count[None]):
            self.once[i] = self.particles.p[i]
            if self.gradient.B[i][0, 0] > 0.0:
                self.once[i] = self.mean(i, READING, self.particles.p)
        for i in range(self.particles.count[None]):
            self.p[i] = self.once[i]
            if self.gradient.B[i][0, 0] > 0.0:
                self.p[i] = self.mean(i, READING, self.once)

    @stage("smooth pressure")
    def find_closed_box(self, whole: ti.i32):
        """Whether this is a full closed box; in a step that is not of the ``whole`` fluid it stays what it was."""
        ti.loop_config(serialize=True)
        for _ in range(whole):
            surface, rows = 0, 0
            for i in range(self.particles.count[None]):
                if self.gradient.B[i][0, 0] > 0.0:
                    rows += 1
                    if self.gradient.neighbour_count[i] < 0.75 * self.gradient.full:
                        surface += 1
            self.full[None] = ti.cast(surface == 0 and rows > 0, ti.i32)

    @stage("prepare")
    def compress(self):
        """In a full closed box the pressure, which is free up to a constant, is kept high enough that nothing is in
        tension: tension tears voids open."""
        ti.loop_config(serialize=True)
        for _ in range(1):
            if self.full[None] == 1:
                volumes, pressure = ti.cast(0.0, ti.f64), ti.cast(0.0, ti.f64)
                momentum = ti.Vector.zero(ti.f64, self.dimension)
                fastest, speed2 = ti.cast(0.0, float), ti.cast(0.0, float)
                for i in range(self.particles.count[None]):
                    if self.gradient.B[i][0, 0] > 0.0:
                        volume = ti.cast(self.particles.volume(i), ti.f64)
                        volumes += volume
                        pressure += volume * self.p[i]
                        fastest = ti.max(fastest, self.particles.shear_rate[i])
                        momentum += volume * ti.cast(self.particles.u[i], ti.f64)
                mean_u = ti.cast(momentum / volumes, float)
                for i in range(self.particles.count[None]):
                    if self.gradient.B[i][0, 0] > 0.0:
                        speed2 = ti.max(speed2, (self.particles.u[i] - mean_u).norm_sqr())
                wanted = ti.cast(0.0, float)
                for m in range(self.constants.mixes):
                    stress = self.constants.eta[m] * fastest + self.constants.tau_y[m]
                    wanted = ti.max(wanted, COMPRESSION * stress + self.constants.density[m] * speed2)
                missing = wanted - ti.cast(pressure / volumes, float)
                for i in range(self.particles.count[None]):
                    self.p[i] += missing

    @stage("stress")
    def update(self, rate: ti.template(), constraint: ti.template()):
        """p <- p - K (div u - s) for the velocity gradient ``rate`` and the divergence s that the ``constraint`` wants:
        the multiplier of the augmented Lagrangian (I7)."""
        for i in range(self.particles.count[None]):
            carries = ti.cast(self.gradient.B[i][0, 0] > 0.0, float)
            excess = rate.velocity_gradient(i).trace() - constraint.divergence[i]
            self.p[i] -= self.constants.bulk[None] * excess * carries

    @stage("advance")
    def keep(self):
        """At the end of a step: the particles carry p."""
        for i in range(self.particles.count[None]):
            self.particles.p[i] = self.p[i]
