"""The forecast of a run, found in a process of its own, since it builds the scene, which may be large, and imports
Taichi."""

import io
import signal
import warnings
from contextlib import redirect_stderr
from dataclasses import dataclass
from multiprocessing import TimeoutError, get_context

from ..memory import admit
from ..problem import catalogue
from ..problem.numerics import NUMERICS
from ..problem.problem import Problem
from ..units import SceneError

PATIENCE = 60.0  # [s] for one forecast; it never comes where the process was killed for want of memory


@dataclass(frozen=True)
class Forecast:
    """What a run will be, for a reader: ``until`` is its end at the latest [s], ``lines`` those of ``report.forecast``,
    ``warnings`` what the package warns of."""

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
    from ..report.forecast import forecast as lines_of
    from ..simulation.memory_estimate import estimate, particles_of
    from ..simulation.pouring import Pouring
    from ..simulation.simulation import pairs_of

    precision = options.get("precision", "f32")
    with warnings.catch_warnings(record=True) as warned, redirect_stderr(io.StringIO()):
        warnings.simplefilter("always")
        scene = catalogue.build(name, **keywords)
        problem = Problem(scene, NUMERICS[scheme](**numerics))
        to_come = sum(Pouring(scene, inlet).to_come for inlet in scene.inlets)
        needed = estimate(problem, to_come, pairs_of(scene), precision=precision)
        admit(needed, f"spacing = {scene.spacing:g} m: its {particles_of(problem, to_come):.6g} particles take")
        lines = tuple(lines_of(problem, precision))
    return Forecast(scene.until, lines, tuple(dict.fromkeys(str(item.message) for item in warned)))
