"""When a body is at rest (I15)."""

import math
from dataclasses import dataclass

import numpy as np

OF_WHAT_MOVES = 0.1  # way [l0] that what moves may still have before it in the material's own time
QUIET = 0.2  # [s] for which hardly a way must have been left
OF_THE_BODY = 0.5  # way [l0] that the body may still have before it if it slows down as it has done


@dataclass
class Rest:
    """Since when a simulation rests, and its largest mean speed, with its time."""

    since: float | None = None  # [s]
    fastest: float = 0.0  # [m/s]
    fastest_at: float = 0.0  # [s]
    way: float = 0.0  # that may be left now, over the spacing
    way_then: float = 0.0  # the same when it was fastest

    def __post_init__(self):
        """TypeError for what a checkpoint should not hold."""
        for key, value in vars(self).items():
            if not isinstance(value, int | float) and (key, value) != ("since", None):
                raise TypeError(f"rest: {key} = {value!r} is not a number")

    def reached(self, sim) -> bool:
        """Is there hardly a way left? eta/tau_y is the time in which a Bingham flow decays where it ceases as a whole:
        a slow flow of a viscous mix is not taken for rest, nor a front before a large body that stands. A thin layer
        goes on as 1/t^2; what is left there is speed times age."""
        window = sim.problem.resting_time
        if not math.isfinite(window):
            return False
        report = sim.report
        if report.mean_speed >= self.fastest:
            self.fastest, self.fastest_at = report.mean_speed, sim.time
        ways = (
            report.moving_speed * window / OF_WHAT_MOVES,
            report.mean_speed * (sim.time - self.fastest_at) / OF_THE_BODY,
        )
        self.way = max(ways) / sim.scene.spacing
        if self.fastest_at == sim.time:
            self.way_then = self.way
        if self.way > 1.0 or pushed(sim):
            self.since = None
            return False
        if self.since is None:
            self.since = sim.time
        return sim.time - self.since >= QUIET

    def expected(self, time: float) -> float | None:
        """When [s] the body will be at rest if the way that is left goes on to decay as it has since it was fastest; a
        guess, for who waits. None where nothing decays yet."""
        if not 0.0 < self.way < 0.9 * self.way_then:
            return None
        decay = math.log(self.way_then / self.way) / (time - self.fastest_at)
        return (time + math.log(self.way) / decay if self.way > 1.0 else self.since or time) + QUIET


def pushed(sim) -> bool:
    """Does a wall that travels touch the fluid? What stands in a mould is at rest only once the mould is gone."""
    walls = [wall for wall in sim.scene.walls if np.any(wall.travel)]
    x = sim.particles.read()["x"] if walls else None
    return any(np.abs(wall.distance(x, sim.time)).min() < sim.walls.effective_radius for wall in walls)
