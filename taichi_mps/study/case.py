"""Case of a study: a scene with its parameters, its key, and its run in this process."""

import hashlib
import json
import threading
import warnings
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ..input import catalogue
from ..io.history import history_row
from ..io.run_folder import strict
from ..io.summary import summary as summary_of
from ..units import regular_file, user_path

T500_SLUMP_FLOW = 0.5  # slump flow [m] that defines T500: EN 12350-8
MIN_INTERVAL, MIN_FRACTION = 0.02, 0.05  # [s] and [-] of the time so far, between two measurements of a slump flow
SUMMARY_COLUMNS = (  # kept in a row
    "stopped_by",
    "simulated_seconds",
    "steps",
    "volume_error",
    "volume_error_max",
    "cpu_seconds",
    "compile_seconds",
    "version",
)
LOST = "lost"  # status of a case that was not finished; computed again when the study is resumed
_one_at_a_time = threading.Lock()  # Taichi runs one Simulation at a time in a process


@dataclass(frozen=True)
class Case:
    """A scene by name or file and its given parameters, JSON-ready; ``key`` identifies its result."""

    scene: str
    parameters: dict[str, object]
    key: str


def case_of(scene: str, **parameters) -> Case:
    """Return the case of parameters, text or numbers; SceneError for what the scene does not accept.

    The key is a digest of the scene's file and all built-in ones, which it may import, of all its parameters with their
    defaults, of the files that they name, and of the package's code: equal keys are equal results.
    """
    full = catalogue.load(scene).parameters(**parameters).model_dump(mode="json")
    texts = [user_path(value) for value in full.values() if isinstance(value, str) and value]
    files = [catalogue.locate(scene), *catalogue.names().values(), *(path for path in texts if path.is_file())]
    contents = [hashlib.sha256(regular_file(f"file {path}", path, 1e9).read_bytes()).hexdigest() for path in files]
    digest = hashlib.sha256(json.dumps([contents, full, code_digest()], sort_keys=True).encode()).hexdigest()
    return Case(catalogue.source(scene), {name: full[name] for name in parameters}, digest[:16])


@lru_cache
def code_digest() -> str:
    """Return a digest of the package's modules without those of studies: other code may give other results."""
    files = [path for path in sorted(catalogue.PACKAGE.rglob("*.py")) if path.parent.name != "study"]
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()


def row_without_result(case: Case, status: str, reason) -> dict:
    """Return the row of a case that gave no result, with the reason on one line."""
    return {
        "key": case.key,
        "status": status,
        "reason": " ".join(str(reason).split()),
        "scene": case.scene,
        **case.parameters,
    }


def run_case(case: Case, samples: int = 0) -> dict:
    """Run a case to its end in this process and return its row, also where it fails. Taichi is started with one thread
    where it is not, and again, which drops every earlier Simulation, where its fields are used up.

    A row holds key, status ('done', 'failed', or LOST where memory or a file was missing), reason (of a finished run
    its warnings), the parameters, the scene's measures at the end and over time, what stopped the run, steps and
    seconds; with ``samples`` in ``course`` that many values of each measure over time,
    {name: values}.
    """
    from .reuse import begin

    with _one_at_a_time, warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("default")
        try:
            sim = begin(catalogue.build(case.scene, **case.parameters))
            history, frames = [history_row(sim, sim.measures())], []
            # measuring costs as much as some steps, and without jolts T500 is all that is made of a slump flow
            sparse = "spread_m" in history[0] and not sim.scene.jolts

            def note(sim):
                last = history[-1]["time_s"]
                due = last + max(MIN_INTERVAL, MIN_FRACTION * last) if sparse else last
                if sim.all_active and sim.time > due:
                    history.append(history_row(sim, sim.measures()))

            if sim.scene.over_time:
                sim.each_step(note)
            if samples:
                sim.every(
                    sim.scene.until / samples, lambda frame: frames.append({"time_s": frame.time} | frame.measures())
                )
            sim.run()
            summary, measures = summary_of(sim), sim.measures()
            if sim.scene.over_time:
                history += [history_row(sim, measures)] if history[-1]["time_s"] < sim.time else []
                columns = {name: np.array([step.get(name, np.nan) for step in history]) for name in history[-1]}
                measures |= sim.scene.over_time(columns)
        except Exception as error:  # a study goes on, whatever a case does
            return row_without_result(
                case, LOST if isinstance(error, MemoryError | OSError) else "failed", f"{type(error).__name__}: {error}"
            )
    row = row_without_result(case, "done", "; ".join(str(warning.message) for warning in caught))
    filling = {name: summary[name] for name in ("filled_ratio", "void_m3") if name in summary}
    row |= {name: strict(float(value)) for name, value in (measures | filling).items()}
    if frames:
        row["course"] = {name: [strict(frame.get(name)) for frame in frames] for name in frames[-1]}
    return row | {name: strict(summary[name]) for name in SUMMARY_COLUMNS}
