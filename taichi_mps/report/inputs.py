"""What a run was given: a table, and the command line that repeats it."""

import shlex
from pathlib import Path

from ..problem import catalogue
from ..problem.labels import in_words, option_name
from ..problem.numerics import NUMERICS
from ..units import unit_of

LEFT_OUT = {"accuracy"}  # has chosen model and spacing, which stand there
USUAL = {"arch": "cpu", "precision": "f32", "scheme": "implicit"}


def fields_of(source: str) -> dict:
    """The declared keywords of a built-in scene; none of somebody's own file, whose code is not run for a report."""
    return catalogue.load(source).parameters.model_fields if source in catalogue.names() else {}


def rows(parameters: dict, fields: dict) -> list[tuple[str, str]]:
    """Keywords of the scene in words, with their values and units."""
    given = {key: value for key, value in parameters.items() if value not in (None, "") and key not in LEFT_OUT}
    return [
        (in_words(key), shown(value, unit_of(fields[key]) if key in fields else "")) for key, value in given.items()
    ]


def shown(value, unit: str) -> str:
    """A value with its unit; lengths below 10 cm in mm, below 1 m in cm."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if not isinstance(value, float | int):
        return str(value)
    if unit == "m" and abs(value) < 1.0:
        return f"{1e3 * value:.6g} mm" if abs(value) < 0.1 else f"{1e2 * value:.6g} cm"
    return f"{value:.6g} {unit.strip('-')}".rstrip()


def command(source: str, summary: dict, every: float | None = None) -> str:
    """The words after taichi-mps that compute the same again. What has its default is left out; ``every``: the interval
    of the outputs [s], at which steps end, too, where it is not the usual one. Of a scene file only the name is told,
    not the folder."""
    usual = {
        **{key: field.default for key, field in fields_of(source).items()},
        **NUMERICS[summary["scheme"]]().model_dump(),
        **USUAL,
    }
    options = {
        **summary["parameters"],
        "every": every,
        "scheme": summary["scheme"],
        **summary["numerics"],
        **{key: summary["backend"][key] for key in ("arch", "precision")},
    }
    if summary["stopped_by"] == "time":
        options["until"] = float(f"{summary['simulated_seconds']:.9g}")
    given = {key: value for key, value in options.items() if value not in (None, "") and key not in LEFT_OUT}
    told = [option(key, value, options) for key, value in given.items()
            if (value != usual[key] if key in usual else value is not False)]  # fmt: skip
    return shlex.join(["run", source if source in catalogue.names() else Path(source).name, *told])


def option(key: str, value, others=()) -> str:
    """An option of the command line, beside other keywords."""
    flag = option_name(key, others)
    if isinstance(value, bool):
        return flag if value else f"--no-{flag[2:]}"
    if isinstance(value, list | tuple):
        value = ",".join(map(str, value))
    return f"{flag}={f'{value!r}'.removesuffix('.0') if isinstance(value, float) else value}"
