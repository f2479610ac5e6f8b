"""Rest criterion (I15): a body is at rest when its remaining displacement, by the observed decay, is negligible."""

import math
from dataclasses import dataclass

import numpy as np

from ...units import INSTANT, array, validated

NEGLIGIBLE_PATH = 1.0 / 600.0  # remaining path of a body at rest over its height: 0.5 mm of a slump cone
FOLD = math.e  # by this factor the speed must fall for a decay to be known, or rise for another motion
PAUSE = 1.15  # times sqrt(H/g), 0.2 s of a slump cone: for so long hardly a way must have been left


@validated
@dataclass
class Rest:
    """Decay of a motion in folds, reductions of the speed by a factor: speed and time of the last fold, and duration of
    the fold before."""

    since: float | None = None  # time since which the remaining displacement is negligible [s]
    speed: float = 0.0  # of the moving particles, at the last fold [m/s]
    at: float = 0.0  # time of that fold [s]
    fold: float = 0.0  # time that the fold took [s]; 0 as long as nothing has fallen
    before: array(
        "", (0,), (4,), kind=tuple
    ) = ()  # speed, at and fold of the motion that a faster one interrupts, and since when [s]

    def observe(self, speed: float, now: float) -> None:
        """Record the speed of the moving particles [m/s] after a step, at a time [s].

        A faster motion that has ended sooner than the one before it falls by e, such as of a drop, has interrupted it:
        the former decay holds again.
        """
        if self.before:
            before, at, fold, interrupted = self.before
            over, short = speed <= FOLD * before, now - interrupted <= max(fold, interrupted - at)
            if over and short:
                self.speed, self.at, self.fold = before, at, fold
            if over or not short:
                self.before = ()
        if speed > FOLD * self.speed:
            if self.fold > 0.0 and not self.before:
                self.before = (self.speed, self.at, self.fold, now)
            self.speed, self.at, self.fold, self.since = speed, now, 0.0, None
        elif speed * FOLD <= self.speed:
            folds = math.log(self.speed / speed) if speed > 0.0 else math.inf
            self.fold, self.speed, self.at = (now - self.at) / folds, speed, now

    def reached(self, sim) -> bool:
        """Whether the remaining displacement is negligible. For an exponential decay it is the speed times the time in
        which it falls by e; if the decay slows down, the time since the last fold counts, and before the first fold
        sqrt(H/g). Always False for a mix without true yield stress, and before the last change of gravity and walls."""
        if not sim.problem.rests:
            return False
        if self.remaining_path(sim) > NEGLIGIBLE_PATH * sim.problem.height or touches_moving_wall(sim):
            self.since = None
        elif self.since is None:
            self.since = sim.time
        return self.lasting(sim, sim.scene.last_change) >= 0.0

    def lasting(self, sim, start: float = 0.0) -> float:
        """Time [s], from a ``start`` on [s], for which the body has been at rest: the remaining displacement negligible
        for longer than a pause. Negative before it is."""
        since = math.inf if self.since is None else max(self.since, start)
        return sim.time - since - PAUSE * sim.problem.fall_time

    def remaining_path(self, sim) -> float:
        """Remaining displacement [m]."""
        return sim.report.moving_speed * max(self.fold or sim.problem.fall_time, sim.time - self.at)

    def expected(self, sim) -> float | None:
        """Expected time of rest [s] if the speed continues to fall as before, an estimate for progress; None before the
        first fold."""
        if self.fold <= 0.0:
            return None
        pause = PAUSE * sim.problem.fall_time
        if self.since is not None:
            return self.since + pause
        left = self.remaining_path(sim) / (NEGLIGIBLE_PATH * sim.problem.height)
        return sim.time + max(self.fold, sim.time - self.at) * max(0.0, math.log(left)) + pause


def touches_moving_wall(sim) -> bool:
    """Whether a moving wall touches the fluid: a body in a mould is at rest only after the mould is gone."""
    walls = [
        wall
        for wall in sim.scene.walls
        if np.any(wall.travel) and np.any(wall.mean_velocity(sim.time, sim.time + INSTANT))
    ]
    x = sim.particles.read()["x"] if walls else None
    return any(np.abs(wall.distance(x, sim.time)).min() < sim.walls.effective_radius for wall in walls)
