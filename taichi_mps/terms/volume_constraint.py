"""The divergence that the flow is to have: it takes back a part of what the packing is too dense or too loose (I11)."""

from ..runtime.backend import real, ti
from ..runtime.stages import stage

REFILL, RING_REFILL = 0.05, 0.2  # part of the packing error removed per step; thin rings lose more of it per step
VISCOUS_REFILL, DAMPED = 0.25, 0.25  # the same where viscosity damps what it moves: above this diffusion number
# at most constants.fastest; of rings and in a full closed box also this part of the shear rate, or the shift wins
RATE_FASTEST = 0.25
# packing error of an enclosed particle that is taken back; more is a void, which stays, but a full closed box has none
LOOSEST, EMPTY = -0.03, -1.0
STRAIN = 0.02  # in a step, from which on packing error and shift act fully


@ti.data_oriented
class VolumeConstraint:
    """Wanted divergence of every particle."""

    def __init__(self, particles, gradient, constants, strain_rate, pressure, shifting):
        self.particles, self.gradient, self.constants = particles, gradient, constants
        self.strain_rate, self.pressure, self.shifting = strain_rate, pressure, shifting
        self.refill = RING_REFILL if particles.axisymmetric else REFILL
        self.spacing = gradient.spacing
        self.divergence = ti.field(real(), particles.capacity)  # s [1/s]

    @stage("prepare")
    def set(self, dt: float):
        """s = r (packing - 1)/dt within +-fastest, r the part that a step of dt [s] removes; only where the material
        deforms or is torn. A full closed box has no voids: there any lack is taken back."""
        for i in range(self.particles.count[None]):
            follows = self.pressure.full[None]  # 1 where it is as fast as the shear
            loosest = LOOSEST if self.gradient.enclosed(i) else 0.0
            error = ti.max(self.gradient.packing[i] - 1.0, loosest if follows == 0 else EMPTY)
            if ti.static(self.gradient.axisymmetric):
                follows = 1
            fastest = ti.max(self.constants.fastest[None], follows * RATE_FASTEST * self.strain_rate.rate[i])
            divergence = ti.max(-fastest, ti.min(fastest, self.part_removed(i, dt) * error / dt))
            self.divergence[i] = divergence * self.shifting.acts(i, dt, STRAIN)

    @ti.func
    def part_removed(self, i, dt):
        """Part of the packing error that a step removes, by its diffusion number eta dt/(rho l0^2) [-]; in a full
        closed box, which cannot change its volume, that would only stir: there shear makes the errors, and a step
        removes as much as it strains, 0.05 at least and 0.25 at most."""
        m = self.constants.mix(i)
        diffusion = self.constants.eta[m] * dt / (self.constants.density[m] * self.spacing**2)
        more = (VISCOUS_REFILL - self.refill) * diffusion / (DAMPED + diffusion)
        if self.pressure.full[None] == 1:
            more = ti.max(0.0, ti.min(VISCOUS_REFILL, self.strain_rate.rate[i] * dt) - self.refill)
        return self.refill + more

    @stage("prepare")
    def balance(self):
        """A box full of fluid has no surface to give way: there no mean divergence can be wanted."""
        ti.loop_config(serialize=True)
        for _ in range(1):
            if self.pressure.full[None] == 1:
                volumes, total = ti.cast(0.0, ti.f64), ti.cast(0.0, ti.f64)
                for i in range(self.particles.count[None]):
                    if self.gradient.B[i][0, 0] > 0.0:
                        volume = ti.cast(self.particles.volume(i), ti.f64)
                        volumes += volume
                        total += volume * self.divergence[i]
                mean = ti.cast(total / volumes, float)
                for i in range(self.particles.count[None]):
                    self.divergence[i] -= mean
