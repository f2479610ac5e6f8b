"""Measured curves as a user hands them over: a measure of a scene against time, or end values against its keywords."""

import warnings
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..problem.labels import OPTIONS, RESULTS, UNITS, title
from ..problem.measures import still
from ..spelling import in_unit, without_unit
from ..units import SceneError, require, unit_of, user_path
from . import lists
from .columns import NAMES, key_of, quantity

TIME = "time t zeit temps 時間"  # names of the column of the times
DIAMETER = "spread_m"  # what a column 'diameter' holds, which is a word beside other names


@dataclass(frozen=True)
class Curve:
    """What was measured of one run: at its times [s], or at its end where it has none; nan where a cell is empty."""

    name: str
    settings: dict[str, str]  # keywords of the scene, of columns of the file
    times: np.ndarray  # [s], (n,)
    values: dict[str, np.ndarray] = field(default_factory=dict)  # by measure, SI units, (n,); (1,) without times

    @property
    def points(self) -> int:
        """Number of measured values."""
        return sum(int(np.isfinite(values).sum()) for values in self.values.values())


def unit_by_name(measure: str) -> str:
    """SI unit of a measure, by the end of its name."""
    end = next(end for end in UNITS if measure.endswith(end))
    return {"_m_s": "m/s", "_ratio": ""}.get(end, end[1:].replace("_per_", "/").replace("_", " "))


def vocabulary(keywords: dict, measures) -> tuple[dict[str, str], dict[str, str]]:
    """What a column may be called, {key_of(name): time, keyword or measure}, and the SI unit of each of these."""
    words, units = {key_of(word): "time" for word in TIME.split()}, {"time": "s"}
    for name, each in keywords.items():
        words |= {key_of(word): name for word in (name, OPTIONS.get(name, name))}
        units[name] = unit_of(each).strip("-")
    for name in measures:
        stem = name.removesuffix(next(end for end in UNITS if name.endswith(end)))
        words |= {key_of(word): name for word in (name, stem, title(name), *NAMES.get(stem, "").split())}
        units[name] = unit_by_name(name)
    return words | ({"": DIAMETER} if DIAMETER in measures else {}), units


def read_curves(path, keywords: dict, measures) -> list[Curve]:
    """The curves of a CSV file, a row a point: columns are time, measures of a scene and, where a file holds several
    curves or end values, the scene's ``keywords`` {name: pydantic field}. SceneError for what is no such file."""
    path = user_path(path)
    (rows, comma), where = lists.read(path), f"curve = {path}: "
    words, units = vocabulary(keywords, measures)
    held = {column: quantity(column, words, units.get) for column in rows[0] if column}
    found = [what for what, _ in held.values() if what]
    twice = next((what for what in found if found.count(what) > 1), "")
    require(not twice, f"{where}two columns are {twice}; must be one")
    known, others = ", ".join(measures), ", ".join(f"'{name}'" for name, (what, _) in held.items() if not what)
    missing = f"{where}has no column that the scene measures ({others or 'none else'}); must be one or more of {known}"
    require(set(measures) & set(found), missing)
    runs: dict[tuple, list] = {}
    for number, row in enumerate(rows, 1):
        require(lists.WRONG not in row, where + row.get(lists.WRONG, ""))
        told = {what: value_of(row[column], unit, units[what], comma, f"{where}row {number}, {column}")
                for column, (what, unit) in held.items() if what not in (None, *keywords)}  # fmt: skip
        settings = {what: f"{row[column]} {unit * without_unit(row[column])}".strip()
                    for column, (what, unit) in held.items() if what in keywords}  # fmt: skip
        key = (*settings.items(), *([number] if "time" not in found else []))
        runs.setdefault(key, []).append((settings, told))
    curves = []
    for points in runs.values():
        settings, columns = points[0][0], {what: np.array([told[what] for _, told in points]) for what in points[0][1]}
        times, name = columns.pop("time", np.zeros(0)), ", ".join([path.name, *map(" ".join, settings.items())])
        falls = next(((a, b) for a, b in zip(times[:-1], times[1:], strict=True) if not b >= a), None)
        require(falls is None, f"curve = {name}: times fall: after {falls and falls[0]} s comes {falls and falls[1]} s")
        require(np.all(times >= 0.0), f"curve = {name}: a time is missing or before 0 s; must be 0 s or more")
        curves.append(Curve(name, settings, times, columns))
    return curves


def value_of(cell: str, unit: str, ours: str, comma: bool, where: str) -> float:
    """A cell in the SI unit ``ours``, of the unit of its column or its own; nan of an empty one."""
    try:
        text = cell.replace(",", ".") if comma else cell
        return float(in_unit(ours, f"{text} {unit * without_unit(text)}".strip()) if text else "nan")
    except ValueError:
        raise SceneError(f"{where} = {cell}: must be a number{f' [{ours}]' * bool(ours)}") from None


def of_files(paths: str, keywords: dict, measures) -> list[Curve]:
    """The curves of files with commas between them; SceneError for fewer than five points in all."""
    curves = [curve for path in paths.split(",") for curve in read_curves(Path(path.strip()), keywords, measures)]
    points = sum(curve.points for curve in curves)
    require(points >= 5, f"curve = {paths}: holds {points} points; must be at least 5")
    return curves


def measures_of(scene) -> list[str]:
    """Names of what a scene measures, as far as they are known before a run; all of results where it reads loads."""
    found = scene.measure(scene.unfold(still(scene.initial, scene.spacing))) if scene.measure else {}
    if not found or not scene.over_time:
        return list(found or RESULTS)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a history of two rows
        history = {"time_s": [0.0, 1.0]} | {name: [value, value] for name, value in found.items()}
        return [*found, *scene.over_time({name: np.array(values) for name, values in history.items()})]
