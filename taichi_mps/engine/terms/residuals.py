"""Residuals of the constraints of the augmented Lagrangian, |D - q| and |div u - s|, at the velocity of a step."""

from ..particles.particles import FLUID
from ..runtime.backend import double_field, ti
from ..runtime.stages import flush, stage
from ..runtime.sums import sum_threads
from .constants import Term
from .rheology import deviator, magnitude


@ti.data_oriented
class Residuals(Term):
    """Root mean squares over the volume of 2|D - q| (as shear rates) and |div u - s|, over the rate sqrt(g/H + U^2/H^2)
    in which the scene falls or moves by its height: the strain by which the fluid departs from its law in that time.
    The first is 0 of a law without q."""

    def __init__(self, fluid, constants, stress, constraint):
        super().__init__(fluid, constants=constants, stress=stress, constraint=constraint)
        self.threads, self.sums = sum_threads(), double_field(components=3)  # V, V (2|D - q|)^2, V (div u - s)^2

    def read(self) -> list[float]:
        """Read both residuals [-] of the last measurement."""
        flush()
        return self.of(self.sums[None].to_list())

    def of(self, sums) -> list[float]:
        """Compute both residuals [-] from the sums."""
        volume, *squares = sums
        return [(square / max(volume, 1e-30)) ** 0.5 / self.constants.rate for square in squares]

    @stage("stress")
    def measure(self):
        """Sum the squares of both residuals over the volume after the last iteration."""
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.sums[None] = ti.Vector.zero(ti.f64, 3)
        ti.loop_config(serialize=self.threads == 1)
        for thread in range(self.threads):
            lane_sums = ti.Vector.zero(ti.f64, 3)
            for k in range((self.particles.count[None] - thread + self.threads - 1) // self.threads):
                i = thread + k * self.threads
                if self.particles.kind[i] == FLUID and self.gradient.B[i][0, 0] > 0.0:
                    volume, departure = ti.cast(self.particles.volume(i), ti.f64), ti.cast(0.0, float)
                    G = self.stress.solved_rate.velocity_gradient(i)
                    if ti.static(self.stress.law == "yield-stress"):
                        D = deviator(G - self.stress.strain_rate.half_step_change[i])
                        departure = 2.0 * magnitude(D - self.particles.plastic_rate[i])
                    excess = G.trace() - self.constraint.divergence[i]
                    lane_sums += volume * ti.Vector([1.0, departure**2, excess**2], dt=ti.f64)
            self.sums[None] += lane_sums
