"""Case of a study: a scene with its parameters, its key, and its run in this process."""

import hashlib
import json
import math
import threading
import warnings
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ..io.history import row_of
from ..io.run_folder import strict
from ..problem import catalogue
from ..units import ordinary, user_path

REACHED = 0.5  # spread [m] whose time is read, T500: EN 12350-8
LOOK = 0.02, 0.05, 0.25  # between two looks at the spread: 0.02 s or 5 % of the time so far at least, 25 % at most
KEPT = ("stopped_by", "simulated_seconds", "steps", "volume_error", "volume_error_max")  # of the summary, in a row
KEPT += ("cpu_seconds", "compile_seconds", "version")
_one_at_a_time = threading.Lock()  # Taichi runs one Simulation at a time in a process


@dataclass(frozen=True)
class Case:
    """A scene by name or file and the parameters given, JSON-ready. ``key`` is that of its result."""

    scene: str
    parameters: dict[str, object]
    key: str


def case(scene: str, **parameters) -> Case:
    """The case of these parameters, as text or numbers; SceneError for what the scene does not accept.

    The key is a digest of the scene's file and of all built-in ones, from which it may be made, of all its parameters
    with their defaults, of the files that they name, and of the package's code: equal keys are equal results.
    """
    function = catalogue.load(scene)
    valid = function.parameters(**parameters)
    full = valid.model_dump(mode="json")
    texts = [user_path(value) for value in full.values() if isinstance(value, str) and value]
    named = [path for path in texts if path.is_file()]
    files = [catalogue.locate(scene), *catalogue.names().values(), *named]
    contents = [hashlib.sha256(ordinary(f"file {path}", path, 1e9).read_bytes()).hexdigest() for path in files]
    digest = hashlib.sha256(json.dumps([contents, full, code()], sort_keys=True).encode()).hexdigest()
    return Case(catalogue.source(scene), {name: full[name] for name in parameters}, digest[:16])


@lru_cache
def code() -> str:
    """A digest of the package's modules, but for those of studies: with another code the numerics may change, too."""
    files = [path for path in sorted(catalogue.PACKAGE.rglob("*.py")) if path.parent.name != "study"]
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()


def row_without_result(case: Case, status: str, reason) -> dict:
    """The row of a case that gave no result; the reason on one line."""
    words = " ".join(str(reason).split())
    return {"key": case.key, "status": status, "reason": words, "scene": case.scene, **case.parameters}


def run(case: Case, samples: int = 0) -> dict:
    """Compute a case to its end in this process: its row. What fails is a row with its reason. Taichi is started with
    one thread where it is not, and again, which drops every earlier Simulation, where its fields are used up.

    A row holds key, status ('done' or 'failed'), reason (of a run that is done its warnings), the parameters, the
    scene's measures at the end, t500_s [s] where the spread came to 500 mm, what stopped the run, steps and seconds;
    with ``samples`` in ``course`` so many values of each measure over the time, {name: values}.
    """
    from ..simulation.reuse import begin

    with _one_at_a_time, warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("default")
        try:
            sim = begin(catalogue.build(case.scene, **case.parameters))
            spread = Milestone(sim, "spread_m", REACHED)
            # without jolts T500 is all that a scene with a spread makes of its course
            over_time = None if spread.watched and not sim.scene.jolts else sim.scene.over_time
            course, frames = [], []
            if over_time:
                course.append(row_of(sim, sim.measures()))
                sim.each_step(lambda sim: sim.all_active and course.append(row_of(sim, sim.measures())))
            if samples:
                each = sim.scene.until / samples
                sim.every(each, lambda frame: frames.append({"time_s": frame.time} | frame.measures()))
            sim.run()
            summary, measures = sim.summary(), sim.measures()
            if over_time:
                columns = {name: np.array([step.get(name, math.nan) for step in course]) for name in course[-1]}
                measures |= over_time(columns)
        except Exception as error:  # a study goes on, whatever a case does
            return row_without_result(case, "failed", f"{type(error).__name__}: {error}")
    row = row_without_result(case, "done", "; ".join(str(warning.message) for warning in warned))
    filling = {name: summary[name] for name in ("filled_ratio", "void_m3") if name in summary}
    row |= {name: strict(float(value)) for name, value in (measures | filling).items()}
    if spread.watched:
        row["t500_s"] = spread.time
    if frames:
        row["course"] = {name: [strict(frame.get(name)) for frame in frames] for name in frames[-1]}
    return row | {name: strict(summary[name]) for name in KEPT}


class Milestone:
    """The first time [s] at which a measure of a run comes to a value; None if it never does.

    Between two looks the measure is taken to go with the logarithm of time. A look costs as much as some steps, so
    the next one is due when at its present pace the measure would be half way to the value.
    """

    def __init__(self, sim, name: str, value: float):
        self.name, self.value, self.time = name, value, None
        self.last, self.due = (0.0, sim.measures().get(name)), 0.0
        self.watched = self.last[1] is not None
        if self.watched:
            sim.each_step(self.look)

    def look(self, sim):
        """Measure, if a look is due, and find the time at which the value was reached."""
        before, low = self.last
        if self.time is not None or sim.time < self.due:
            return
        now = sim.measures().get(self.name, math.nan)
        if now >= self.value > low:
            part = (self.value - low) / (now - low)
            self.time = before + part * (sim.time - before) if before == 0.0 else before * (sim.time / before) ** part
        half = 0.5 * (self.value - now) / (now - low) * (sim.time - before) if now > low else math.inf
        self.due = sim.time + max(LOOK[0], LOOK[1] * sim.time, min(half, LOOK[2] * sim.time))
        self.last = sim.time, max(low, now)
