"""Case of a study: a scene with its parameters, its key, and its run in this process."""

import hashlib
import json
import math
import threading
import warnings
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ..input import catalogue
from ..io.history import row_of
from ..io.run_folder import strict
from ..io.summary import summary as summary_of
from ..units import ordinary, user_path

T500_SPREAD = 0.5  # slump flow [m] that defines T500: EN 12350-8
MIN_INTERVAL, MIN_FRACTION, MAX_FRACTION = 0.02, 0.05, 0.25  # [s] and [-] of the time so far, between two measurements
SUMMARY_COLUMNS = "stopped_by", "simulated_seconds", "steps", "volume_error", "volume_error_max"  # kept in a row
SUMMARY_COLUMNS += "cpu_seconds", "compile_seconds", "version"
LOST = "lost"  # status of a case that was not finished; computed again when the study is resumed
_one_at_a_time = threading.Lock()  # Taichi runs one Simulation at a time in a process


@dataclass(frozen=True)
class Case:
    """A scene by name or file and its given parameters, JSON-ready; ``key`` identifies its result."""

    scene: str
    parameters: dict[str, object]
    key: str


def case(scene: str, **parameters) -> Case:
    """Return the case of parameters, text or numbers; SceneError for what the scene does not accept.

    The key is a digest of the scene's file and all built-in ones, which it may import, of all its parameters with their
    defaults, of the files that they name, and of the package's code: equal keys are equal results.
    """
    function = catalogue.load(scene)
    validated = function.parameters(**parameters)
    full = validated.model_dump(mode="json")
    texts = [user_path(value) for value in full.values() if isinstance(value, str) and value]
    named_files = [path for path in texts if path.is_file()]
    files = [catalogue.locate(scene), *catalogue.names().values(), *named_files]
    contents = [hashlib.sha256(ordinary(f"file {path}", path, 1e9).read_bytes()).hexdigest() for path in files]
    digest = hashlib.sha256(json.dumps([contents, full, code_digest()], sort_keys=True).encode()).hexdigest()
    return Case(catalogue.source(scene), {name: full[name] for name in parameters}, digest[:16])


@lru_cache
def code_digest() -> str:
    """Return a digest of the package's modules without those of studies: other code may give other results."""
    files = [path for path in sorted(catalogue.PACKAGE.rglob("*.py")) if path.parent.name != "study"]
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()


def row_without_result(case: Case, status: str, reason) -> dict:
    """Return the row of a case that gave no result, with the reason on one line."""
    words = " ".join(str(reason).split())
    return {"key": case.key, "status": status, "reason": words, "scene": case.scene, **case.parameters}


def run(case: Case, samples: int = 0) -> dict:
    """Run a case to its end in this process and return its row, also where it fails. Taichi is started with one thread
    where it is not, and again, which drops every earlier Simulation, where its fields are used up.

    A row holds key, status ('done', 'failed', or LOST where memory or a file was missing), reason (of a finished run
    its warnings), the parameters, the scene's measures at the end, t500_s [s] where the slump flow came to 500 mm, what
    stopped the run, steps and seconds; with ``samples`` in ``course`` that many values of each measure over time,
    {name: values}.
    """
    from .reuse import begin

    with _one_at_a_time, warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("default")
        try:
            sim = begin(catalogue.build(case.scene, **case.parameters))
            spread = Milestone(sim, "spread_m", T500_SPREAD)
            # without jolts T500 is all that a scene with a spread makes of its course
            over_time = None if spread.is_measured and not sim.scene.jolts else sim.scene.over_time
            history, frames = [], []
            if over_time:
                history.append(row_of(sim, sim.measures()))
                sim.each_step(lambda sim: sim.all_active and history.append(row_of(sim, sim.measures())))
            if samples:
                interval = sim.scene.until / samples
                sim.every(interval, lambda frame: frames.append({"time_s": frame.time} | frame.measures()))
            sim.run()
            summary, measures = summary_of(sim), sim.measures()
            if over_time:
                columns = {name: np.array([step.get(name, math.nan) for step in history]) for name in history[-1]}
                measures |= over_time(columns)
        except Exception as error:  # a study goes on, whatever a case does
            status = LOST if isinstance(error, MemoryError | OSError) else "failed"
            return row_without_result(case, status, f"{type(error).__name__}: {error}")
    row = row_without_result(case, "done", "; ".join(str(warning.message) for warning in caught))
    filling = {name: summary[name] for name in ("filled_ratio", "void_m3") if name in summary}
    row |= {name: strict(float(value)) for name, value in (measures | filling).items()}
    if spread.is_measured:
        row["t500_s"] = spread.time
    if frames:
        row["course"] = {name: [strict(frame.get(name)) for frame in frames] for name in frames[-1]}
    return row | {name: strict(summary[name]) for name in SUMMARY_COLUMNS}


class Milestone:
    """First time [s] at which a measure of a run reaches a value; None if it never does.

    The measure is interpolated in the logarithm of time. Measuring costs as much as some steps, so it is done again
    when at its present rate the measure would be half way to the value.
    """

    def __init__(self, sim, name: str, value: float):
        self.name, self.value, self.time = name, value, None
        self.last, self.due = (0.0, sim.measures().get(name)), 0.0
        self.is_measured = self.last[1] is not None
        if self.is_measured:
            sim.each_step(self.check)

    def check(self, sim):
        """Measure, if that is due, and interpolate the time at which the value was reached."""
        before, low = self.last
        if self.time is not None or sim.time < self.due:
            return
        now = sim.measures().get(self.name, math.nan)
        if now >= self.value > low:
            part = (self.value - low) / (now - low)
            self.time = before + part * (sim.time - before) if before == 0.0 else before * (sim.time / before) ** part
        half_way = 0.5 * (self.value - now) / (now - low) * (sim.time - before) if now > low else math.inf
        self.due = sim.time + max(MIN_INTERVAL, MIN_FRACTION * sim.time, min(half_way, MAX_FRACTION * sim.time))
        self.last = sim.time, max(low, now)
