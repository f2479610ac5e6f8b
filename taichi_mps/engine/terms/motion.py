"""Time integration of the particle positions (I13)."""

from ..particles.particles import FLUID
from ..runtime.backend import ti
from ..runtime.stages import stage
from .constants import Term


@ti.data_oriented
class Motion(Term):
    """Drift of the fluid particles, kept in front of the walls."""

    def __init__(self, fluid, constants, shifting):
        super().__init__(fluid, constants=constants, shifting=shifting)

    @stage("drift")
    def drift(self, dt: float):
        """x <- x + dt u/2, before the neighbours are found: forces act at the middle of the step, so a body in rotation
        keeps its angular momentum and a wave its energy."""
        for i in range(self.particles.count[None]):
            if self.particles.kind[i] == FLUID:
                move = ti.cast(0.5 * dt * self.particles.u[i], ti.f64)
                self.particles.x[i] = self.walls.keep_in_fluid(self.particles.x[i], move)

    @stage("guess")
    def guess(self, dt: float, u: ti.template()):
        """Initial guess of the first solve: u^n + dt a, a the acceleration of the last step; zero of walls."""
        for i in range(self.particles.count[None]):
            u[i] = ti.Vector.zero(float, self.dimension)
            if self.particles.kind[i] == FLUID:
                u[i] = self.particles.u[i] + dt * self.particles.a[i]

    @stage("advance")
    def advance(self, dt: float, u: ti.template(), first: ti.i32):
        """x <- x + dt u/2 + shift. In the first step a particle that falls and that viscosity holds (it gains less than
        half of free fall) had its speed at once: x <- x + dt u."""
        for i in range(self.particles.count[None]):
            if self.particles.kind[i] == FLUID:
                half = 0.5 * u[i]
                if (
                    first != 0
                    and self.constants.density_held(i) == 0.0
                    and (u[i] - self.particles.u[i]).norm()
                    < 0.5 * ti.cast(self.constants.gravity_at(i), float).norm() * dt
                ):
                    half = u[i] - 0.5 * self.particles.u[i]
                move = ti.cast(dt * half + self.shifting.shift[i], ti.f64)
                self.particles.a[i] = (u[i] - self.particles.u[i]) / dt
                self.particles.u[i] = u[i]
                self.particles.x[i] = self.walls.keep_in_fluid(self.particles.x[i], move)
