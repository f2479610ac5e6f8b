"""Which particles stand still: they move so slowly that it would not show in the whole run (I30).

Their stress does not tell: what has flowed and stopped stays on its yield surface, where it stopped.
"""

from ..particles.particles import FLUID
from ..runtime.backend import ti
from .rheology import magnitude

SHOWS = 1e-3  # way over the height of the body that shows, in the time of the run


@ti.data_oriented
class Standstill:
    """Whether a particle may be left out of the steps to come; ``ahead`` [m]: how far a wall moves meanwhile."""

    def __init__(self, particles, walls, constants, stress, pressure, problem, ahead: float):
        self.particles, self.walls, self.constants, self.stress = particles, walls, constants, stress
        self.pressure = pressure
        self.slowest = SHOWS * problem.height / max(problem.scene.until, problem.fall_time)  # [m/s]
        self.slowest_rate = self.slowest / problem.scene.spacing  # [1/s]
        self.ahead = ahead

    @ti.func
    def holds(self, i):
        """Is particle i slow, no wall that moves near it, and the fluid no full closed box?"""
        slow = self.particles.u[i].norm_sqr() < self.slowest**2 and self.pressure.full[None] == 0
        still = slow and self.particles.kind[i] == FLUID
        for wall in ti.static(self.walls.surfaces):
            if ti.static(wall.drives):
                still = still and not wall.drives_near(self.particles.x[i], self.walls.effective_radius, self.ahead)
        return still

    @ti.func
    def yields(self, i):
        """Do its neighbours move particle i, which is held, so that it would be slow no longer?"""
        return 2.0 * magnitude(self.particles.plastic_rate[i]) > self.slowest_rate

    @ti.func
    def age(self, i, time):
        """The structure of a particle that was left out for a time [s] grows as at rest."""
        for k, growth in ti.static(self.stress.growths):
            if self.constants.mix(i) == k:
                self.particles.structure[i] += time * growth(0.0, self.particles.structure[i])
