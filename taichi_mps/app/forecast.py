"""Worker process of forecasts: checks a run before it starts, and predicts its measures by the tables of calibrate.

It is a process of its own, since it builds the scene, which may be large, and imports Taichi. Run by resident.py.
"""

import io
import re
import warnings
from contextlib import redirect_stderr, suppress
from importlib.util import find_spec

import numpy as np

from ..cli.main import planned
from ..cli.run import clock_of, describe_run
from ..problem.materials import Bingham, Concrete
from ..study.calibration import BINGHAM
from ..study.emulator import MEASURED, emulator_of
from ..units import SceneError, plain
from .form import options
from .resident import answer_all
from .results import numbers

OTHER_KEYWORDS = "spacing", "model", "until", "accuracy", "floor_radius"  # keywords that make no other test
OVERRIDDEN = "accuracy: has no effect, since particle size and model are given"


def forecast(words: list[str]) -> dict:
    """Forecast of a run from its command line: whether it is in ``space``, its ``seconds``, ``lines`` of text,
    ``remarks`` on how it was read, and the measures by the ``table``; or, if it cannot be computed, its errors by key
    in ``wrong``."""
    messages = io.StringIO()
    try:
        with warnings.catch_warnings(record=True) as warned, redirect_stderr(messages):
            warnings.simplefilter("always")
            _, run, problem = planned("run", words)
            clock = clock_of(problem, run)
            from ..simulation.forecast import pairs_of, require_memory

            require_memory(problem, pairs_of(problem.scene), run.precision)
    except (SceneError, ImportError) as error:  # ImportError: pint, which numbers with a unit need
        return {"wrong": errors_by_key(plain(" ".join(str(error).split())))}
    remarks = [line.removeprefix("taichi-mps: ") for line in messages.getvalue().splitlines()]
    given = {word.split("=")[0] for word in words}
    remarks += [OVERRIDDEN] * ({"--accuracy", "--spacing", "--model"} <= given)
    remarks += dict.fromkeys(str(item.message) for item in warned if item.category is UserWarning)
    known = {"space": problem.scene.dimension == 3, "seconds": clock.whole}
    return known | {
        "lines": describe_run(problem, clock),
        "remarks": remarks,
        "table": measures_by_table(problem.scene),
    }


def errors_by_key(line: str) -> dict[str, str]:
    """Split errors, 'key = value: ...; key = value: ...', by their keys; '' for one without a key."""
    found = {}
    for part in line.split("; "):
        key = re.match(r"([A-Za-z]\w*)( = .*?: | is missing)", part)
        name = key[1] if key else next(reversed(found), "")
        found[name] = f"{found[name]}; {part}" if name in found else part
    return found


def measures_by_table(scene) -> dict | None:
    """Measures of the test by the table of calibrate; None if it has none for this vessel and mix."""
    mix, known = scene.material, scene.parameters
    if scene.name not in MEASURED or not find_spec("scipy") or type(mix) is not Bingham or not mix.yields:
        return None
    table = emulator_of(test=scene.name)
    vessel = {key: known[key] for key in table.usual if key not in (*Concrete.model_fields, *OTHER_KEYWORDS)}
    if any(value != table.settings.get(key, table.usual[key]) for key, value in vessel.items()):
        return None
    with suppress(SceneError):  # a mix beyond the table
        found = table.at(*np.log([getattr(mix, name) / mix.density for name in BINGHAM]))
        return numbers({column: float(found[name]) for name, column in MEASURED[scene.name].items()})
    return None


def answer(request: dict, tell, cancelled) -> None:
    """Answer a request with the forecast of a run."""
    tell(**forecast([request["test"], *options(request["values"])]))


if __name__ == "__main__":
    answer_all(answer)
