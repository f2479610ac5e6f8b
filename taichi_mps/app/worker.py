"""Worker processes of the page: one previews tests by cheap models that it keeps compiled, one forecasts runs.

Another mix changes numbers of the same kernels, so only the first preview of a test waits for them. A forecast builds
the scene, which may be large, and imports Taichi, which the server does not. Run by resident.py.
"""

import base64
import io
import math
import sys
import warnings
from contextlib import redirect_stderr, suppress
from dataclasses import replace
from importlib.util import find_spec

import numpy as np

from ..cli.main import planned
from ..cli.run import describe_run, make_clock
from ..engine import Bingham, Concrete, Frame, Problem, Scene, Simulation, pairs_of, require_memory
from ..forecast import accuracy
from ..input import catalogue
from ..input.labels import in_words
from ..report.drawings import beginning
from ..study.calibration import BINGHAM
from ..study.emulator import RESULT_COLUMNS, emulator_of
from ..study.reuse import begin
from ..units import SceneError, leading_key, plain
from ..viz.body import fit_to_mould
from .form import PREVIEW_MODELS, options, wrong
from .resident import answer_all
from .results import numbers

FINE, COARSE = 1.0 / 30.0, 1.0 / 15.0  # particle size of a cone over its height
SOFT = 100.0 / (2300.0 * 9.81 * 0.3)  # yield stress over rho g H below which a coarse cone is shown first
MIN_DOMAIN = 3.0  # least radius of the domain of a cone over its height
# flow time of the first picture and least time between pictures [s], and least ratio of their times
FIRST_PICTURE, PICTURE_INTERVAL, TIME_RATIO = 0.02, 1.0 / 30.0, 1.04
MAX_KEPT = 12  # Simulations that are kept: two of each cone, and some domains
OTHER_KEYWORDS = "spacing", "model", "until", "accuracy", "floor_radius"  # keywords that make no other test


# ---- previews ------------------------------------------------------------------------------------------------
def preview_models(test: str, values: dict) -> list[Scene]:
    """Cheap models of a test, the coarsest first, from texts of its keywords. The radius of the domain of a cone grows
    by factors of two, since each domain needs kernels of its own."""
    parameters = catalogue.load(test).parameters
    given = {
        key: text for key, text in values.items() if key in parameters.model_fields and key not in PREVIEW_MODELS[test]
    }
    given |= {key: text for key, text in PREVIEW_MODELS[test].items() if text is not None}
    if PREVIEW_MODELS[test].get("model") != "axisymmetric":
        return [catalogue.build(test, **given)]
    valid, scenes = parameters(**given), []
    soft = (valid.yield_value or 0.0) < SOFT * valid.density * accuracy.GRAVITY * valid.height
    for part in (COARSE, FINE) if soft else (FINE,):
        scene = catalogue.build(test, **given, spacing=part * valid.height)
        low, (radius, top) = scene.domain
        radius = MIN_DOMAIN * valid.height * 2.0 ** max(0, math.ceil(math.log2(radius / (MIN_DOMAIN * valid.height))))
        scenes.append(replace(scene, domain=(low, (radius, top))))
    return scenes


class Film:
    """Sender of the moving section of a Simulation, at times that lie further apart as it slows down."""

    def __init__(self, sim: Simulation, tell, cancelled):
        self.sim, self.tell, self.cancelled, self.course = sim, tell, cancelled, []
        # length of a unit of the 16-bit integer positions [m]
        self.unit = float(np.abs(sim.scene.domain).max()) / 32000.0

    def run(self) -> str:
        """Run to the end; return the reason of the end as in a summary."""
        self.tell(stage=self.fixed_parts())
        self.send_state()
        self.next_picture = FIRST_PICTURE
        self.sim.each_step(self.send_if_due)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                ended = self.sim.run()
            except (SceneError, ArithmeticError, RuntimeError) as error:  # a mix that the cheap model cannot compute
                return getattr(error, "stopped_by", "diverged")
        if not self.cancelled():
            self.send_state()
        return ended

    def send_if_due(self, sim: Simulation) -> None:
        """Stop after a step if the preview is cancelled, else send the state if a picture is due."""
        if self.cancelled():
            sim.interrupt()
        elif sim.time >= self.next_picture and sim.all_active:
            self.send_state()

    def send_state(self) -> None:
        """Send the time, the measures, and the positions and sizes of the particles."""
        body, time = self.sim.snapshot(), self.sim.time
        measures = Frame(self.sim.scene, body, self.sim.report).measures()
        self.course.append({"time_s": time, **measures})
        places = fit_to_mould(self.sim.scene, body).x if self.sim.scene.axisymmetric else body.x
        rows = np.round(np.column_stack([places, body.size]) / self.unit).astype("<i2")
        self.tell(t=time, m=numbers(measures), x=base64.b64encode(rows.tobytes()).decode())
        self.next_picture = max(time + PICTURE_INTERVAL, TIME_RATIO * time)

    def fixed_parts(self) -> dict:
        """Fixed lines of the picture [m], and the names of the measures."""
        scene = self.sim.scene
        return {
            "rings": scene.axisymmetric,
            "unit": self.unit,
            "spacing": scene.spacing,
            "low": scene.domain[0],
            "high": scene.domain[1],
            "height": scene.parameters.get("height"),
            "periodic": any(scene.periodic),
            "tilt": scene.parameters.get("angle", 0.0),
            "mould": [line[:, [0, -1]].tolist() for line in scene.outline[:2]] if scene.axisymmetric else [],
            "walls": [face[:2, ::2].tolist() for face in scene.vessel if len(np.unique(face, axis=0)) == 2],
        }

    def result(self) -> dict:
        """Result of a preview, with its expected error from the measured errors of such models."""
        scene, measures = self.sim.scene, {k: v for k, v in self.course[-1].items() if k != "time_s"}
        if scene.over_time:
            measures |= scene.over_time(
                {key: np.array([row.get(key, math.nan) for row in self.course]) for key in self.course[0]}
            )
        _, height, error = accuracy.errors_of_run(self.sim.problem.facts()) or (None, None, None)
        errors = {"slump_m": height * error.slump, "spread_m": 2.0 * height * error.reach} if error else {}
        return {"m": numbers(measures), "errors": errors, "time": self.sim.time, "spacing": scene.spacing}


def preview(request: dict, tell, cancelled) -> None:
    """Answer a request with the moving section of a test, then with its measures."""
    try:
        scenes = preview_models(request["test"], request["values"])
        for scene in scenes:
            Problem(scene)
    except (SceneError, ImportError) as error:
        tell(wrong=plain(error))
        return
    for scene in scenes:
        film = Film(begin(scene, lambda: tell(preparing=True), MAX_KEPT), tell, cancelled)
        ended = film.run()
        if not cancelled():
            tell(result=film.result() | {"ended": ended, "last": scene is scenes[-1]})


# ---- forecasts -----------------------------------------------------------------------------------------------
def forecast(words: list[str]) -> dict:
    """Forecast of a run from its command line: whether it is in ``space``, its ``seconds``, ``lines`` of text,
    ``remarks`` on how it was read, the measures by the ``table``, and the body at the ``beginning``; or, if it cannot
    be computed, its errors by key in ``wrong``."""
    messages = io.StringIO()
    try:
        with warnings.catch_warnings(record=True) as warned, redirect_stderr(messages):
            warnings.simplefilter("always")
            _, run, problem = planned("run", words)
            clock = make_clock(problem, run)
            require_memory(problem, pairs_of(problem.scene), run.precision)
    except (SceneError, ImportError) as error:  # ImportError: pint, which numbers with a unit need
        return {"wrong": wrong(error)}
    remarks = [
        *(line.removeprefix("taichi-mps: ") for line in messages.getvalue().splitlines()),
        *dict.fromkeys(str(item.message) for item in warned if item.category is UserWarning),
    ]
    return {
        "space": problem.scene.dimension == 3,
        "seconds": clock.whole,
        "lines": describe_run(problem, clock),
        "remarks": [in_words(key := leading_key(line)) + line[len(key) :] for line in remarks],
        "table": measures_by_table(problem.scene),
        "beginning": beginning(problem.scene),
    }


def measures_by_table(scene) -> dict | None:
    """Measures of the test by the table of calibrate; None if it has none for this vessel and mix."""
    mix, known = scene.material, scene.parameters
    if scene.name not in RESULT_COLUMNS or not find_spec("scipy") or type(mix) is not Bingham or not mix.yields:
        return None
    table = emulator_of(test=scene.name)
    if any(
        known[key] != table.settings.get(key, default)
        for key, default in table.defaults.items()
        if key not in (*Concrete.model_fields, *OTHER_KEYWORDS)
    ):
        return None
    with suppress(SceneError):  # a mix beyond the table
        estimates = table.at(*np.log([getattr(mix, name) / mix.density for name in BINGHAM]))
        return numbers({column: float(estimates[name]) for name, column in RESULT_COLUMNS[scene.name].items()})
    return None


ANSWERS = {
    "preview": preview,
    "forecast": lambda request, tell, _: tell(**forecast([request["test"], *options(request["values"])])),
}

if __name__ == "__main__":
    answer_all(ANSWERS[sys.argv[1]])
