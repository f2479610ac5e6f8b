"""How particles move: half a step before the forces are found, half a step and the shift after (I13)."""

from ..particles.particles import FLUID, Carried
from ..runtime.backend import real, ti
from ..runtime.stages import stage


@ti.data_oriented
class Motion:
    """Drift of the fluid particles, kept in front of the walls."""

    def __init__(self, particles, walls, shifting, gravity):
        self.particles, self.walls, self.shifting = particles, walls, shifting
        self.dimension = particles.dimension
        self.g = ti.types.vector(self.dimension, real())(gravity)

    @staticmethod
    def carried(_problem) -> dict[str, Carried]:
        """What the particles carry for this term."""
        return {"a": Carried("acceleration of the last step", "m/s2", "vector")}

    @stage("drift")
    def drift(self, dt: float):
        """x <- x + dt u/2, before the neighbours are found: forces act at the middle of the step, so a body in rotation
        keeps its angular momentum and a wave its energy."""
        for i in range(self.particles.count[None]):
            if self.particles.kind[i] == FLUID:
                move = ti.cast(0.5 * dt * self.particles.u[i], ti.f64)
                self.particles.x[i] = self.walls.outside(self.particles.x[i], move)

    @stage("guess")
    def guess(self, dt: float, u: ti.template()):
        """Where the first solve starts: u^n + dt a, a the acceleration of the last step; zero of walls."""
        for i in range(self.particles.count[None]):
            u[i] = ti.Vector.zero(float, self.dimension)
            if self.particles.kind[i] == FLUID:
                u[i] = self.particles.u[i] + dt * self.particles.a[i]

    @stage("advance")
    def advance(self, dt: float, u: ti.template(), first: ti.i32):
        """x <- x + dt u/2 + shift. In the first step a particle that viscosity holds (it gains less than half of free
        fall) had its speed at once: x <- x + dt u."""
        for i in range(self.particles.count[None]):
            if self.particles.kind[i] == FLUID:
                half = 0.5 * u[i]
                if first != 0 and (u[i] - self.particles.u[i]).norm() < 0.5 * self.g.norm() * dt:
                    half = u[i] - 0.5 * self.particles.u[i]
                move = ti.cast(dt * half + self.shifting.shift[i], ti.f64)
                self.particles.a[i] = (u[i] - self.particles.u[i]) / dt
                self.particles.u[i] = u[i]
                self.particles.x[i] = self.walls.outside(self.particles.x[i], move)
