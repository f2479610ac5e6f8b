"""What is known of a run before it starts: size, memory, time, accuracy. Found in a process of its own, since it builds
the scene, which may be large, and imports Taichi."""

import io
import signal
import warnings
from contextlib import redirect_stderr
from dataclasses import dataclass
from multiprocessing import TimeoutError, get_context

from ..memory import admit, size
from ..problem import catalogue
from ..problem.accuracy import expected_of
from ..problem.numerics import NUMERICS
from ..problem.problem import Problem
from ..report.sentences import certainty
from ..units import SceneError

PATIENCE = 60.0  # [s] for one forecast; it never comes where the process was killed for want of memory


@dataclass(frozen=True)
class Forecast:
    """What a run will be, for a reader: ``until`` is its end at the latest [s], ``lines`` tell of size, time and
    accuracy, ``warnings`` of what the package warns of."""

    until: float
    lines: tuple[str, ...]
    warnings: tuple[str, ...]


class Forecaster:
    """Makes forecasts in one process beside the server, which is started by the first and ends with ``close``."""

    def __init__(self):
        self._pool = None

    def ask(self, *question) -> Forecast:
        """``forecast(*question)``, waited for; SceneError for what cannot be computed, or not be tried in PATIENCE."""
        if self._pool is None:
            self._pool = get_context("spawn").Pool(1, signal.signal, (signal.SIGINT, signal.SIG_IGN))
        try:
            return self._pool.apply_async(forecast, question).get(PATIENCE)
        except TimeoutError:
            self.close()
            raise SceneError(f"spacing: this scene could not be tried within {PATIENCE:g} s; make it coarser") from None

    def close(self) -> None:
        """End the process, whatever it does."""
        pool, self._pool = self._pool, None
        if pool:
            pool.terminate()
            pool.join()


def forecast(name: str, scheme: str, keywords: dict, numerics: dict, options: dict) -> Forecast:
    """That of a built-in scene and a scheme, with keywords, numerics and options of ``run`` as text; SceneError for
    what cannot be computed."""
    from ..simulation.memory_estimate import estimate, particles_of
    from ..simulation.pouring import Pouring
    from ..simulation.simulation import pairs_of

    with warnings.catch_warnings(record=True) as warned, redirect_stderr(io.StringIO()):
        warnings.simplefilter("always")
        scene = catalogue.build(name, **keywords)
        problem = Problem(scene, NUMERICS[scheme](**numerics))
        to_come = sum(Pouring(scene, inlet).to_come for inlet in scene.inlets)
        needed = estimate(problem, to_come, pairs_of(scene), precision=options.get("precision", "f32"))
        count = particles_of(problem, to_come)
        admit(needed, f"spacing = {scene.spacing:g} m: its {count:.6g} particles take")
    like_a_summary = {"scene": name, "parameters": dict(scene.parameters), "scheme": scheme}
    like_a_summary["materials"] = [material.facts() for material in problem.materials]
    measured = expected_of(like_a_summary)
    if measured:
        time = f"{measured.cpu_seconds:.2g} s of processor time for the flow, and some to make the program ready."
    else:
        told = catalogue.run_time(name).replace("spacing", "particle size").replace("`", "")
        time = f"Of this test is known: {told}" if told else "How long it takes is not known."
    model = f", model {scene.parameters['model']}" if "model" in scene.parameters else ""
    lines = (
        f"{count:,} particles of {1e3 * scene.spacing:.3g} mm{model}; about {size(needed)} of memory.",
        time,
        certainty(like_a_summary),
    )
    return Forecast(scene.until, lines, tuple(dict.fromkeys(str(item.message) for item in warned)))
