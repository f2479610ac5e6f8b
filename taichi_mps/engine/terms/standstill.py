"""Criterion for particles at rest, which a step may leave out (I30)."""

from ..particles.particles import FLUID
from ..runtime.backend import ti
from .constants import Term
from .rheology import magnitude

NEGLIGIBLE_DISPLACEMENT = 1e-3  # displacement during the run, over the height of the body, of a particle at rest
STRUCTURE_STEPS = 32  # of the time for which a particle was left out, in each of which its structure grows at one rate


@ti.data_oriented
class Standstill(Term):
    """Whether a particle may be excluded from the next steps: it moves so slowly that its displacement in the whole run
    is negligible. Its stress does not tell: what has flowed and stopped stays on its yield surface, where it stopped.

    ``ahead`` [m]: how far a wall moves meanwhile.
    """

    def __init__(self, fluid, constants, stress, pressure, problem, ahead: float):
        super().__init__(fluid, constants=constants, stress=stress, pressure=pressure, ahead=ahead)
        self.max_speed = NEGLIGIBLE_DISPLACEMENT * problem.height / max(problem.scene.until, problem.fall_time)  # [m/s]
        self.max_rate = self.max_speed / problem.scene.spacing  # [1/s]

    @ti.func
    def is_at_rest(self, i):
        """Whether particle i is slow, no wall that moves is near it, and the fluid is no full closed box."""
        slow = self.particles.u[i].norm_sqr() < self.max_speed**2 and self.pressure.full[None] == 0
        at_rest = slow and self.particles.kind[i] == FLUID
        for wall in ti.static(self.walls.surfaces):
            if ti.static(wall.moving):
                at_rest = at_rest and not wall.moves_near(self.particles.x[i], self.walls.effective_radius, self.ahead)
        return at_rest

    @ti.func
    def would_move(self, i):
        """Whether the plastic rate that neighbours impose on particle i, which is at rest, exceeds the threshold."""
        return 2.0 * magnitude(self.particles.plastic_rate[i]) > self.max_rate

    @ti.func
    def age(self, i, time):
        """The structure of a particle that was left out for a time [s] grows as at rest."""
        for k, growth in ti.static(self.stress.growths):
            if self.constants.mix(i) == k:
                for _ in range(STRUCTURE_STEPS):
                    self.particles.structure[i] += time / STRUCTURE_STEPS * growth(0.0, self.particles.structure[i])
