"""Clock of a run: durations of its parts, forecast before it starts and updated, ever closer, while it runs.

Before: steps and processor time of the flow by ``forecast.cost_of``, the other parts as measured on one core of an AMD
EPYC; both times the ratios that earlier runs on this machine had to that. These lie beside the compiled kernels, so
that where the kernels are gone the forecast is again that of a first run. While it goes on: more and more by the steps
that are left and what they have taken so far, less and less by the forecast: the weight of the former is the share of
the steps that are done times that of the expected time that has passed. The steps that are left are those told, less
those taken, until the flow decays; then the geometric mean of these and of the steps of that decay.
"""

import json
import math
import os
import time
from contextlib import suppress

from .. import __version__
from ..runtime.caches import kernels
from ..runtime.stages import ONE_THREAD_BELOW_ROWS, OPTIMISED_FROM_ROWS
from ..runtime.workarounds import LANGUAGE
from ..terms.constants import CREEP
from .forecast import cost_of, own_step, particles_of

PARTS = "start", "ready", "flow", "pictures", "report"  # of a run, one after the other
START, REPORT = 1.0, 0.5  # [s]: Python, Taichi and the scene; the page, of a small body
READY = {False: 2.0, True: 2.3}  # [s] of the first step, in space or not, with kernels compiled before
# [s] of the first step with kernels compiled anew, and more for each wall; in space or not, optimised or not
COMPILING = {
    (False, False): (2.8, 0.2),
    (False, True): (3.2, 1.2),
    (True, False): (2.8, 0.9),
    (True, True): (4.0, 2.2),
}
ROW = 4e-3  # [s] of the measures and the row of a step
PICTURE, FILM = 0.17, 0.3  # [s] of a picture, of animation and curves
TEAM_EXPONENT = 0.6  # exponent of the number of threads by which a flow is faster with them
# steps of any run, the fewest that are learnt from; share of those taken still expected where too few were told
MIN_STEPS, REMAINING_SHARE = 20.0, 0.1
RATIO_LIMITS = 0.125, 8.0  # of a ratio that is believed
MIN_INTERVAL = 0.1  # [s] between two answers
RATIOS = "taichi_mps.json"  # file of the ratios


class Clock:
    """Wall time of a run by its PARTS.

    Parameters
    ----------
    problem : Problem
        What is computed.
    settings : dict
        ``arch``, ``precision`` and ``threads``.
    every : float
        Time between pictures [s].
    begun : float, optional
        Monotonic time at which the program began [s], now by default.
    """

    def __init__(self, problem, settings: dict, every: float, begun: float | None = None):
        scene, rows = problem.scene, particles_of(problem)
        self.problem, self.cost = problem, cost_of(problem)
        in_space = scene.dimension == 3
        team = rows >= ONE_THREAD_BELOW_ROWS and in_space
        self.threads, self.precision = settings["threads"] if team else 1, settings["precision"]
        self.every = every
        names = __version__, scene.name, scene.parameters.get("model"), problem.scheme, problem.law, self.threads > 1
        self.key = " ".join(map(str, (*names, rows >= OPTIMISED_FROM_ROWS, settings["arch"], settings["precision"])))
        self.known, self.path = {}, kernels(LANGUAGE) / RATIOS
        with suppress(OSError, ValueError, TypeError):
            self.known = dict(json.loads(self.path.read_text(encoding="utf-8")))
        self.cold = self.key not in self.known
        ready = READY[in_space]
        if self.cold:
            first, each = COMPILING[in_space, rows >= OPTIMISED_FROM_ROWS]
            ready = first + each * len(() if problem.wall_particles else scene.walls)
        flow = self.cost.cpu_seconds / self.threads**TEAM_EXPONENT + ROW * self.cost.steps
        pictures = PICTURE * (min(self.cost.steps, self.cost.end / every) + 1.0)
        self.usual = dict(zip(PARTS, (START, ready, flow + pictures, FILM, REPORT), strict=True))
        self.expected = {part: seconds * self._ratio(part) for part, seconds in self.usual.items()}
        self.measured = dict.fromkeys(PARTS, 0.0)
        self.part, self.first, self.last_answer = PARTS[0], 0, 0.0
        self.begun = self.since = time.monotonic() if begun is None else begun
        self.cpu_begun = time.process_time() if begun is None else 0.0

    def _ratio(self, part: str) -> float:
        """Time that a part took on this machine over the usual one, last time or of any run; 1 where that is not
        known."""
        with suppress(TypeError, ValueError, KeyError, AttributeError):
            found = float(self.known.get(self.key, self.known.get("all"))[part])
            return min(max(found, RATIO_LIMITS[0]), RATIO_LIMITS[1]) if math.isfinite(found) else 1.0
        return 1.0

    @property
    def whole(self) -> float:
        """Wall time in all that is expected before the run [s]."""
        return sum(self.expected.values())

    @property
    def cpu_seconds(self) -> float:
        """Processor time in all that is expected before the run [s]."""
        more = self.threads ** (1.0 - TEAM_EXPONENT) - 1.0  # threads wait for each other
        return self.whole + self.expected["flow"] * more

    def begin(self, part: str, steps: int = 0) -> None:
        """Note that a part begins, after so many steps, and so that the one before is over."""
        self.first = steps
        now = time.monotonic()
        self.measured[self.part] += now - self.since
        self.part, self.since = part, now

    def now(self, sim) -> dict[str, float] | None:
        """Seconds passed and left of a run, the share that is done and the expected end of the flow [s]; None within
        MIN_INTERVAL of the last answer."""
        now = time.monotonic()
        if now - self.last_answer < MIN_INTERVAL:
            return None
        self.last_answer = now
        passed, here = now - self.begun, now - self.since
        expected, taken = self.expected[self.part], sim.steps - self.first
        left = sum(self.expected[part] for part in PARTS[PARTS.index(self.part) + 1 :])
        left_here = max(expected - here, REMAINING_SHARE * here)
        if self.part == "flow" and taken:
            to_come = steps_left(sim, self.cost)
            weight = taken / (taken + to_come) * min(here / expected, 1.0)
            left_here += weight * (here * to_come / taken - left_here)
        left += left_here
        rest = sim.rest.expected(sim) if sim.problem.rests and sim.scene.stop_at_rest else sim.scene.until
        end = max(sim.time, min(sim.scene.until, rest or self.cost.end))
        return {"passed_s": passed, "left_s": left, "share": passed / (passed + left), "time_s": sim.time, "end_s": end}

    def finish(self, steps: int) -> dict:
        """Entries of summary.json about the time of a run. What the parts took over what is usual is kept for the next
        forecasts where the run is whole: ``steps`` of it, 0 of another. Too few steps tell nothing."""
        self.begin(PARTS[-1])
        ratios = {part: max(seconds, 1e-3) / self.usual[part] for part, seconds in self.measured.items()}
        if not self.cold:  # a machine that was busy now and then
            ratios = {part: math.sqrt(ratio * self._ratio(part)) for part, ratio in ratios.items()}
        partial = self.path.with_suffix(f".{os.getpid()}")
        if steps >= MIN_STEPS:
            with suppress(OSError):
                partial.write_text(json.dumps(self.known | {self.key: ratios, "all": ratios}), encoding="utf-8")
                os.replace(partial, self.path)
        whole = sum(self.measured.values()), time.process_time() - self.cpu_begun
        return {"seconds_by_part": self.measured, "all_wall_seconds": whole[0], "all_cpu_seconds": whole[1]}


def steps_left(sim, cost) -> float:
    """Number of steps that a run still takes, by its forecast ``cost`` and by its decay, if it has one."""
    now, dt, fold, until = sim.time, sim.report.dt, sim.rest.fold, sim.scene.until
    forecast = max(cost.steps - sim.steps, REMAINING_SHARE * sim.steps)
    if sim.pouring and not all(pouring.done for pouring in sim.pouring):
        share = min(now / max(pouring.end for pouring in sim.pouring), 1.0)
        return (1.0 - share) * math.sqrt(cost.steps * sim.steps / max(share, 1e-3)) + MIN_STEPS
    end = min(until, sim.rest.expected(sim) or until) if sim.problem.rests and sim.scene.stop_at_rest else until
    if fold <= 0.0:
        return min(forecast, max(1.0, (until - now) / dt)) if end < until else forecast
    longest = max(dt, own_step(sim.problem, quiet=True), CREEP * fold)
    growing = min(max(end - now, 0.0), fold * math.log(longest / dt))
    decay = fold / dt * -math.expm1(-growing / fold) + (max(end - now, 0.0) - growing) / longest
    return math.sqrt(forecast * decay)
