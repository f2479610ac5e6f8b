"""Inputs of a run: a table, and the command line that repeats it."""

import shlex
from pathlib import Path

from ..engine import NUMERICS
from ..input import catalogue
from ..input.labels import in_words, option_name
from ..spelling import in_unit
from ..units import unit_of

OMITTED = {"accuracy"}  # keyword that chose model and spacing, which are shown instead
MAX_DIGITS = 12  # characters of a number as it stands
DEFAULT_BACKEND = {"arch": "cpu", "precision": "f32", "scheme": "implicit"}


def fields_of(source: str, scene_file=None) -> dict:
    """Declared keywords of a built-in scene; of a user's own file empty unless the user names it again as
    ``scene_file``: its code is not run for a report."""
    return (
        catalogue.load(scene_file or source).parameters.model_fields
        if scene_file or source in catalogue.names()
        else {}
    )


def rows(parameters: dict, fields: dict) -> list[tuple[str, str]]:
    """Rows of a table of the scene's keywords in words, with their values and units."""
    return [
        (in_words(key), shown(value, unit_of(fields[key]) if key in fields else ""))
        for key, value in parameters.items()
        if value not in (None, "") and key not in OMITTED
    ]


def shown(value, unit: str) -> str:
    """Format a value with its unit; lengths below 10 cm in mm, below 1 m in cm, flow rates in l/min, times from
    2 min on in min."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if not isinstance(value, float | int):
        return str(value)
    if unit == "m" and abs(value) < 1.0:
        return f"{1e3 * value:.6g} mm" if abs(value) < 0.1 else f"{1e2 * value:.6g} cm"
    times = (1.0 / 60.0, "min") if unit == "s" and value >= 120.0 else (1.0, unit.strip("-"))
    factor, unit = (6e4, "l/min") if unit == "m3/s" else times
    return f"{factor * value:.6g} {unit}".rstrip()


def command(source: str, summary: dict, every: float | None = None, until: float | None = None, fields=None) -> str:
    """Command line, after ``taichi-mps``, that repeats a run, without options at their defaults. ``every``: interval of
    the outputs [s], if it is not the usual one; ``until``: time limit [s], if it is not that of the scene with these
    keywords; ``fields``: those of the scene, by default of a built-in one. A scene file is named without its folder."""
    fields = fields or fields_of(source)
    numerics = NUMERICS[summary["scheme"]]().model_dump()
    defaults = {
        **{key: field.default for key, field in fields.items()},
        **numerics,
        **DEFAULT_BACKEND,
    }
    options = {
        **summary["parameters"],
        "every": every,
        "scheme": summary["scheme"],
        **{key: value for key, value in summary["numerics"].items() if key in numerics},
        **{key: summary["backend"][key] for key in ("arch", "precision")},
        **({} if until is None else {"until": float(f"{until:.9g}")}),
    }
    words = [option(key, shorter(value, fields.get(key)), options) for key, value in options.items()
            if value not in (None, "") and key not in OMITTED
            and (value != defaults[key] if key in defaults else value is not False)]  # fmt: skip
    return shlex.join(["run", source if source in catalogue.names() else Path(source).name, *words])


def shorter(value, field):
    """The text that ``shown`` gives of a number with many digits, where it reads as that number, else the value."""
    unit = unit_of(field) if field and isinstance(value, float) and len(repr(value)) > MAX_DIGITS else ""
    return shown(value, unit) if unit and in_unit(unit, shown(value, unit)) == value else value


def option(key: str, value, others=()) -> str:
    """Format an option of the command line; ``others``: the other keywords of the scene."""
    flag = option_name(key, others)
    if isinstance(value, bool):
        return flag if value else f"--no-{flag[2:]}"
    if isinstance(value, list | tuple):
        value = ",".join(map(str, value))
    return f"{flag}={f'{value!r}'.removesuffix('.0') if isinstance(value, float) else value}"
