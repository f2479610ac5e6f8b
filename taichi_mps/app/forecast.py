"""The program that checks a run before it starts, and knows what its test measures from the tables of calibrate.

A process of its own, since it builds the scene, which may be large, and imports Taichi. Run by resident.py.
"""

import io
import re
import warnings
from contextlib import redirect_stderr, suppress
from importlib.util import find_spec

import numpy as np

from ..cli.main import planned
from ..cli.run import clock_of
from ..cli.run import lines as lines_of
from ..problem.materials import Bingham, Concrete
from ..study.calibration import BINGHAM
from ..study.emulator import MEASURED, emulator_of
from ..units import SceneError, plain
from .form import options
from .resident import answer_all
from .results import numbers

OF_A_RUN = "spacing", "model", "until", "accuracy", "floor_radius"  # keywords that make no other test
OVERRIDDEN = "accuracy: has no effect, since particle size and model are given"


def forecast(words: list[str]) -> dict:
    """Forecast of a run from the values that were typed: whether it is in ``space``, its ``seconds``, ``lines``,
    ``remarks`` of how it was read, and what its ``table`` says; of what cannot be computed ``wrong``, by key."""
    told = io.StringIO()
    try:
        with warnings.catch_warnings(record=True) as warned, redirect_stderr(told):
            warnings.simplefilter("always")
            _, run, problem = planned("run", words)
            clock = clock_of(problem, run)
            from ..simulation.forecast import pairs_of, require_memory

            require_memory(problem, pairs_of(problem.scene), run.precision)
    except (SceneError, ImportError) as error:  # ImportError: pint, which numbers with a unit need
        return {"wrong": by_key(plain(" ".join(str(error).split())))}
    remarks = [line.removeprefix("taichi-mps: ") for line in told.getvalue().splitlines()]
    given = {word.split("=")[0] for word in words}
    remarks += [OVERRIDDEN] * ({"--accuracy", "--spacing", "--model"} <= given)
    remarks += dict.fromkeys(str(item.message) for item in warned if item.category is UserWarning)
    known = {"space": problem.scene.dimension == 3, "seconds": clock.whole}
    return known | {"lines": lines_of(problem, clock), "remarks": remarks, "table": by_table(problem.scene)}


def by_key(line: str) -> dict[str, str]:
    """Errors of a form, 'key = value: ...; key = value: ...', by its keys; what names none by ''."""
    found = {}
    for part in line.split("; "):
        key = re.match(r"([A-Za-z]\w*)( = .*?: | is missing)", part)
        name = key[1] if key else next(reversed(found), "")
        found[name] = f"{found[name]}; {part}" if name in found else part
    return found


def by_table(scene) -> dict | None:
    """The measures of the test from the table of calibrate; None where there is none for this vessel and mix."""
    mix, known = scene.material, scene.parameters
    if scene.name not in MEASURED or not find_spec("scipy") or type(mix) is not Bingham or not mix.yields:
        return None
    table = emulator_of(test=scene.name)
    vessel = {key: known[key] for key in table.usual if key not in (*Concrete.model_fields, *OF_A_RUN)}
    if any(value != table.settings.get(key, table.usual[key]) for key, value in vessel.items()):
        return None
    with suppress(SceneError):  # a mix beyond the table
        found = table.at(*np.log([getattr(mix, name) / mix.density for name in BINGHAM]))
        return numbers({column: float(found[name]) for name, column in MEASURED[scene.name].items()})
    return None


def answer(request: dict, tell, cancelled) -> None:
    """Tell what is known of a run of a test with texts of its fields."""
    tell(**forecast([request["test"], *options(request["values"])]))


if __name__ == "__main__":
    answer_all(answer)
