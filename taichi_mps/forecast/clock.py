"""Clock of a run: durations of its parts, given before it starts and ever closer while it runs.

Before: what the parts take on one core of an AMD EPYC, the flow by ``forecast.cost_of``, all times the slowness of this
machine, known from what the import of the program took. While it goes on: what is left of the flow by what its steps
took so far, the more the more of it is done. How much of a flow is done is known from its steps, or of a pour, whose
steps become dearer, from the cost up to this time. Steps that are left are those of the forecast, less those taken,
until the flow decays; then the geometric mean of these and of the steps of that decay, as with the steps to a time
limit before rest.
"""

import math
import os
import time

import numpy as np

from ..engine import ONE_THREAD_BELOW_ROWS, compiled_before, particles_of
from .cost import cost_of

PARTS = "start", "ready", "flow", "report"  # of a run, one after the other
START, REPORT = 1.0, 0.8  # [s]: Python, Taichi and the scene; last pictures, animation and page, of a small body
IMPORT = 0.32  # [s] of the processor, of START, for the import of the command line: inferred from runs on an Intel Xeon
MAX_SLOWNESS = 4.0  # of a machine; beyond it the process has done more than import the command line
READY = {False: 2.0, True: 2.3}  # [s] of the first step, in space or not, with kernels compiled before
COMPILING = {False: (2.8, 0.2), True: (2.8, 0.9)}  # [s] with kernels compiled anew, and more for each wall
ROW = 4e-3  # [s] of the measures and the row of a step
TEAM_EXPONENT = 0.6  # exponent of the number of threads by which a flow is faster with them
TRUSTED = 0.05  # fraction of a flow that tells as much about it as the forecast
REMAINING_FRACTION = 0.1  # fraction of the time or the steps taken that is still expected beyond the forecast
MIN_INTERVAL = 0.1  # [s] between two answers


class Clock:
    """Wall time of a run by its PARTS.

    Parameters
    ----------
    problem : Problem
        What is computed.
    settings : dict
        ``precision`` and ``threads``.
    every : float
        Time between pictures [s].
    begun : float, optional
        Monotonic time at which the program began [s], now by default.
    imported : float, optional
        Processor time that the import of the command line took [s], as in the table by default.
    """

    def __init__(self, problem, settings: dict, every: float, begun: float | None = None, imported: float = IMPORT):
        scene, rows = problem.scene, particles_of(problem)
        self.cost, self.every = cost_of(problem), every
        in_space = scene.dimension == 3
        team = rows >= ONE_THREAD_BELOW_ROWS and in_space
        self.threads, self.precision = settings["threads"] if team else 1, settings["precision"]
        self.cold = not compiled_before()  # nothing was compiled on this machine
        first, each = COMPILING[in_space]
        ready = first + each * len(() if problem.wall_particles else scene.walls)
        # which of these kernels is among those compiled is not known
        ready = ready if self.cold else math.sqrt(ready * READY[in_space])
        flow = self.cost.cpu_seconds / self.threads**TEAM_EXPONENT + ROW * self.cost.steps
        slowness = imported / IMPORT if imported / IMPORT < MAX_SLOWNESS else 1.0
        self.expected = dict(zip(PARTS, (slowness * usual for usual in (START, ready, flow, REPORT)), strict=True))
        self.measured = dict.fromkeys(PARTS, 0.0)
        self.part, self.first, self.last_answer = PARTS[0], (0, 0.0), 0.0
        self.begun = self.since = time.monotonic() if begun is None else begun
        self.expected["start"] = max(self.expected["start"], time.monotonic() - self.begun)  # a solid takes longer
        # processes that ended before are not of the run: a shell that becomes the program leaves it its own
        self.cpu_begun = sum(os.times()[:4] if begun is None else os.times()[2:4])

    @property
    def whole(self) -> float:
        """Wall time in all that is expected before the run [s]."""
        return sum(self.expected.values())

    @property
    def cpu_seconds(self) -> float:
        """Processor time in all that is expected before the run [s]."""
        # threads wait for each other
        return self.whole + self.expected["flow"] * (self.threads ** (1.0 - TEAM_EXPONENT) - 1.0)

    def begin(self, part: str, sim=None) -> None:
        """Note that a part begins, the flow of ``sim`` from its present step on, and so that the one before is over."""
        if sim:
            self.first = sim.steps, sim.time
        now = time.monotonic()
        self.measured[self.part] += now - self.since
        self.part, self.since = part, now

    def now(self, sim) -> dict[str, float] | None:
        """Seconds passed and left of a run, the fraction that is done and the expected end of the flow [s]; None within
        MIN_INTERVAL of the last answer."""
        now = time.monotonic()
        if now - self.last_answer < MIN_INTERVAL:
            return None
        self.last_answer = now
        passed, here, expected = now - self.begun, now - self.since, self.expected[self.part]
        left = sum(self.expected[part] for part in PARTS[PARTS.index(self.part) + 1 :])
        if self.part == "flow" and sim.steps > self.first[0]:
            done = fraction_done(sim, self.cost, *self.first)
            left += (1.0 - done) * expected * (here / done / expected) ** (done / (done + TRUSTED))
        else:
            left += max(expected - here, REMAINING_FRACTION * here)
        rest = sim.rest.expected(sim) if sim.problem.rests and sim.scene.stop_at_rest else sim.scene.until
        return {
            "passed_s": passed,
            "left_s": left,
            "fraction": passed / (passed + left),
            "time_s": sim.time,
            "end_s": max(sim.time, min(sim.scene.until, rest or self.cost.end)),
        }

    def finish(self) -> dict:
        """Entries of summary.json about the time of a run, with that of its other processes."""
        self.begin(PARTS[-1])
        return {
            "seconds_by_part": self.measured,
            "all_wall_seconds": sum(self.measured.values()),
            "all_cpu_seconds": sum(os.times()[:4]) - self.cpu_begun,
        }


def fraction_done(sim, cost, steps: int, time: float) -> float:
    """Fraction of the cost of a flow that is done, of what was to come after so many steps, at a time [s]."""
    if cost.course is None:
        taken = sim.steps - steps
        return taken / (taken + steps_left(sim, cost))
    before, now = np.interp((time, sim.time), np.linspace(0.0, sim.scene.until, len(cost.course)), cost.course)
    return (now - before) / (1.0 - before)


def steps_left(sim, cost) -> float:
    """Number of steps that a run still takes, by its forecast ``cost`` and by its decay, if it has one."""
    now, dt, fold, until = sim.time, sim.report.dt, sim.rest.fold, sim.scene.until
    forecast = max(cost.steps - sim.steps, REMAINING_FRACTION * sim.steps)
    end = min(until, sim.rest.expected(sim) or until) if sim.problem.rests and sim.scene.stop_at_rest else until
    if fold <= 0.0:
        return math.sqrt(forecast * max(1.0, (until - now) / dt)) if cost.end >= until else forecast
    longest = max(dt, sim.problem.time_step.longest_in(fold))
    growing = min(max(end - now, 0.0), fold * math.log(longest / dt))
    decay = fold / dt * -math.expm1(-growing / fold) + (max(end - now, 0.0) - growing) / longest
    return math.sqrt(forecast * decay)
