"""What a run was given: a table, and the command line that repeats it."""

import shlex
from pathlib import Path

from ..problem import catalogue
from ..problem.labels import in_words
from ..problem.numerics import NUMERICS
from ..units import unit_of

LEFT_OUT = {"accuracy"}  # has chosen model and spacing, which stand there
USUAL = {"arch": "cpu", "precision": "f32"}  # of the backend


def fields_of(source: str) -> dict:
    """The declared keywords of a built-in scene; none of somebody's own file, whose code is not run for a report."""
    return catalogue.load(source).parameters.model_fields if source in catalogue.names() else {}


def rows(parameters: dict, fields: dict) -> list[tuple[str, str]]:
    """Keywords of the scene in words, with their values and units."""
    given = {key: value for key, value in parameters.items() if value not in (None, "") and key not in LEFT_OUT}
    units = {key: unit_of(field) for key, field in fields.items()}
    return [(in_words(key), shown(value, units.get(key, ""))) for key, value in given.items()]


def shown(value, unit: str) -> str:
    """A value with its unit; lengths below 1 m in mm."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if not isinstance(value, float | int):
        return str(value)
    if unit == "m" and abs(value) < 1.0:
        return f"{1e3 * value:.6g} mm"
    return f"{value:.6g} {unit.strip('-')}".rstrip()


def command(source: str, summary: dict, every: float | None) -> str:
    """The command line that computes the same again. What has its default is left out, but for the
    interval of the outputs [s], at which steps end, too; of a scene file only the name is told, not the folder."""
    fields = fields_of(source)
    given = dict(summary.get("parameters", {}))
    if summary.get("stopped_by") == "time":
        given["until"] = float(f"{summary['simulated_seconds']:.9g}")
    options = {key: value for key, value in given.items() if key not in LEFT_OUT}
    options = {key: value for key, value in options.items() if key not in fields or value != fields[key].default}
    options |= {"every": every}
    scheme = summary.get("scheme", "implicit")
    options |= {"scheme": scheme} if scheme != "implicit" else {}
    if scheme in NUMERICS:
        usual = NUMERICS[scheme]().model_dump()
        options |= {key: value for key, value in summary.get("numerics", {}).items() if value != usual.get(key)}
    backend = summary.get("backend") or {}
    options |= {key: backend[key] for key, value in USUAL.items() if backend.get(key, value) != value}
    name = source if source in catalogue.names() else Path(source).name
    words = [word for key, value in options.items() for word in option(key, value, fields)]
    return shlex.join(["taichi-mps", "run", name, *words])


def option(key: str, value, fields: dict) -> list[str]:
    """Words of an option; none for what was not given."""
    flag = f"--{key.replace('_', '-')}"
    if isinstance(value, bool):
        on = key in fields and fields[key].default is True  # by default, and then a --no- turns it off
        return [flag] if value else [f"--no-{flag[2:]}"] if on else []
    if value in (None, ""):
        return []
    if isinstance(value, list | tuple):
        return [flag, ",".join(str(item) for item in value)]
    return [flag, f"{value!r}".removesuffix(".0") if isinstance(value, float) else str(value)]
