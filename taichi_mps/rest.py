"""When a body is at rest."""

import math

import numpy as np

from .scales import resting_time


class Rest:
    """Since when a simulation rests."""

    def __init__(self):
        self.since: float | None = None  # [s]

    def reached(self, sim) -> bool:
        """Would what moves still go less than a tenth of a spacing in the material's own time? eta/tau_y is the time in
        which a Bingham flow decays, so a slow flow of a viscous mix is not taken for rest, nor a front before a large
        body that stands."""
        window = resting_time(sim.scene.materials)
        if not math.isfinite(window):
            return False
        if sim.report.moving_speed * window > 0.1 * sim.scene.spacing or pushed(sim):
            self.since = None
            return False
        if self.since is None:
            self.since = sim.time
        return sim.time - self.since >= 0.2


def pushed(sim) -> bool:
    """Does a wall that travels touch the fluid? What stands in a mould is at rest only once the mould is gone."""
    walls = [wall for wall in sim.scene.walls if np.any(wall.travel)]
    x = sim.particles.read()["x"] if walls else None
    return any(np.abs(wall.distance(x, sim.time)).min() < sim.walls.effective_radius for wall in walls)
