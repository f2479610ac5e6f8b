"""Measured curves of a user, a measure of a scene against time or end values against its keywords, and the result of
their fit: the constants of a law with intervals, its flow curve, and what is determined."""

import re
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ..engine import Material, still
from ..input.labels import OPTIONS, RESULTS, UNITS, in_words, title
from ..spelling import in_unit, without_unit
from ..units import require, unit_of, user_path
from .calibration import FittedConstants, rounded
from .tables import COLUMN_NAMES, ROW_ERROR, key_of, match_column, read_list, words_of

TIME_COLUMNS = (  # names of the column of the times
    "time times t elapsed elapsedtime seconds second sec secs s timestamp timeafterlifting timesincelifting "
    "zeit laufzeit zeitstempel sekunden temps tempsécoulé 時間 経過時間 時刻 秒"
)
# the number of a picture, and the rate, which is not 0
FRAMES = re.compile(r"(?i)\W*(?:frames?|bilde?r?|フレーム)\W+(?=[\d.]*[1-9])(\d+(?:\.\d+)?)\s*(?:fps|hz|1/s|/s)\W*")
# words of the name of a column that names runs
NAME_WORDS = "test concrete mix batch sample specimen name id no nr number probe versuch mischung 試験 配合 供試体 番号"
MAX_GIVEN = 0.1  # part of the shear stress by constants that were given, up to which it counts as found
MAX_MISSED = 0.1  # misfit over the largest value of a measure, above which the result says so
SHEAR_RATES = np.geomspace(0.1, 1000.0, 81)  # of a flow curve [1/s]


@dataclass(frozen=True, eq=False)
class Test:
    """Measurements of one run."""

    name: str
    settings: dict[str, str]  # keywords of the scene, of columns of the file
    times: np.ndarray  # [s], (n,); none where only its end was measured


@dataclass(frozen=True, eq=False)
class Curve:
    """Measured values of one measure of a test: at times [s], or at the end where there are none."""

    test: Test
    measure: str
    times: np.ndarray  # [s], (n,)
    values: np.ndarray  # SI units, (n,); (1,) without times


def column_meanings(keywords: dict, measures) -> tuple[dict[str, str], dict[str, str]]:
    """Return the names that a column may have, {key_of(name): time, keyword or measure}, and the unit of each, SI."""
    spellings = {"time": TIME_COLUMNS.split()} | {name: [name, OPTIONS.get(name, name)] for name in keywords}
    units = {"time": "s"} | {name: unit_of(field).strip("-") for name, field in keywords.items()}
    for name in measures:
        end = next(end for end in UNITS if name.endswith(end))
        stem, unit = name.removesuffix(end), end[1:].replace("_per_", "/").replace("_", " ")
        units[name] = {"_m_s": "m/s", "_ratio": ""}.get(end, unit)
        others = COLUMN_NAMES.get(stem, "") + (" diameter" if name == "spread_m" else "")
        spellings[name] = [name, stem, title(name), *others.split()]
    return {key_of(word): name for name, words in spellings.items() for word in words}, units


def read_curves(path, keywords: dict, measures, given=()) -> Iterator[Curve]:
    """Yield the curves of a CSV file, a row a point: columns are time, measures of a scene and, where a file holds
    several curves or end values, the scene's ``keywords`` {name: pydantic field} that are not ``given``, or names, of
    NAME_WORDS; a warning names the others. SceneError for any other file."""
    path = user_path(path)
    rows, where = read_list(path, "curve"), f"curve = {path}: "
    words, units = column_meanings(keywords, measures)
    rates = {column: float(at[1]) for column in rows[0] if (at := FRAMES.fullmatch(column or ""))}  # of frames [1/s]
    contents = {  # {column: (field, unit)}
        column: ("time", "s") if column in rates else match_column(column, words, units.get, where)
        for column in rows[0]
        if column
    }
    names = [
        column
        for column in contents
        if set(words_of(column) or [""]) <= set(NAME_WORDS.split()) and len({row.get(column) for row in rows}) > 1
    ]
    found = [field for field, _ in contents.values() if field]
    twice = next((field for field in found if [*found, *given].count(field) > 1), "")
    require(not twice, f"{where}{twice} is a column of it; must be there once, and not be given as an option, too")
    others = ", ".join(f"'{name}'" for name, (field, _) in contents.items() if not field and name not in names)
    require(
        set(measures) & set(found),
        f"{where}has no column that the scene measures ({others or 'none else'}); must be one or more of "
        f"{', '.join(measures)}",
    )
    tests: dict[tuple, list[int]] = {}  # rows by the names and keywords of their run
    for k, row in enumerate(rows, 1):
        require(ROW_ERROR not in row, where + row.get(ROW_ERROR, ""))
        of_run = (
            *((column, row[column]) for column in names),
            *((field, f"{row[column]} {unit if without_unit(row[column]) else ''}".strip())
              for column, (field, unit) in contents.items() if field in keywords),
        )  # fmt: skip
        require(
            "time" in found or of_run not in tests,
            f"{where}row {k}: nothing tells it from a row before; must have a column of times, such as time [s], "
            f"of a keyword of the scene or of names, such as test{'; not used: ' if others else ''}{others}",
        )
        tests.setdefault(of_run, []).append(k - 1)
    table = {
        field: np.array([number(row[column], unit, units[field], f"{where}row {k}, {column}")
                         for k, row in enumerate(rows, 1)]) / rates.get(column, 1.0)
        for column, (field, unit) in contents.items() if field not in (None, *keywords)
    }  # fmt: skip
    if others:
        warnings.warn(f"{where}not used: {others}", stacklevel=2)
    for key, at in tests.items():
        name, times = ", ".join([path.name, *map(" ".join, key)]), table["time"][at] if "time" in found else np.zeros(0)
        for a, b in pairwise([0.0, *times]):
            require(
                b >= a, f"curve = {name}: times fall: after {a} s comes {b} s; must be 0 s or more, and none missing"
            )
        test = Test(name, {field: text for field, text in key if field in keywords}, times)
        for measure, values in ((measure, table[measure][at]) for measure in table if measure != "time"):
            if (known := np.isfinite(values)).any():
                yield Curve(test, measure, times[known[: len(times)]], values[known])


def number(cell: str, unit: str, si_unit: str, where: str) -> float:
    """Return a cell in the unit ``si_unit``, from its own unit or that of its column; nan for an empty one."""
    try:
        found = float(in_unit(si_unit, f"{cell} {unit * without_unit(cell)}".strip()) if cell else "nan")
    except ValueError:
        found = np.inf
    require(abs(found) != np.inf, f"{where} = {cell}: must be a number{f' [{si_unit}]' if si_unit else ''}")
    return found


def measures_of(scene) -> list[str]:
    """Return the names of a scene's measures known before a run; all of RESULTS where there are none."""
    found = scene.measure(scene.unfold(still(scene.initial, scene.spacing))) if scene.measure else {}
    history = {"time_s": np.arange(100.0)} | {name: np.full(100, value) for name, value in found.items()}
    return [*found, *(scene.over_time(history) if found and scene.over_time else {})] or list(RESULTS)


# ---- result of a fit --------------------------------------------------------------------------------------------
@dataclass(frozen=True, kw_only=True)
class CurveFit(FittedConstants):
    """Result of a fit to measured curves, and the curves of the model beside them."""

    scene: str
    material: Material  # with the constants found
    offsets: dict[str, tuple[float, float]]  # time of the scene at the zero of a curve, half of its 95 % interval [s]
    spread: np.ndarray  # covariance of the logarithms of the constants, times the square of a 95 % quantile
    missed: dict[str, float]  # root mean square of model - measured over the largest measured value, by measure [-]
    curves: list[dict]  # name, settings, measure, times [s], measured and model, SI units
    runs: int
    cpu_seconds: float

    def flow_curve(self, rates=SHEAR_RATES) -> tuple[np.ndarray, np.ndarray]:
        """Return shear stresses [Pa] at shear rates [1/s], and the factors of their 95 % intervals."""
        stress, slopes = self.logarithmic_slopes(self.constants, rates)
        return stress, np.exp(np.sqrt(np.einsum("ik,ij,jk->k", slopes, self.spread, slopes)))

    def logarithmic_slopes(self, names, rates) -> tuple[np.ndarray, np.ndarray]:
        """Return shear stresses [Pa] at shear rates [1/s], and the derivatives of their logarithms by those of numbers
        of the law, (numbers, rates)."""
        changes = [{name: getattr(self.material, name) * np.exp(by)} for name in names for by in (0.01, -0.01)]
        laws = [self.material, *(self.material.model_copy(update=change) for change in changes)]
        stress, *changed = np.array([[law.shear_stress(float(rate), 0.0) for rate in rates] for law in laws])
        return stress, np.reshape(np.log(changed[::2]) - np.log(changed[1::2]), (-1, len(rates))) / 0.02

    def determined(self) -> str:
        """Format in sentences which constants the curves determine."""
        known = [
            f"{in_words(name)} to {percent(by)}"
            for (name, it), by in zip(self.constants.items(), np.sqrt(np.diag(self.spread)), strict=True)
            if it.determined
        ]
        others = [in_words(name) for name, it in self.constants.items() if not it.determined]
        given = [name for name, it in self.material if isinstance(it, float) and name not in self.constants]
        own = np.abs(self.logarithmic_slopes(given, SHEAR_RATES)[1]).sum(0) < MAX_GIVEN
        stress, factor = self.flow_curve()
        best = np.where(own, factor, np.inf).argmin()
        sentences = {
            f"The curves determine the {' and the '.join(known)}.": known,
            f"They do not determine the {' and the '.join(others)}.": others,
            f"The shear stress is known best at {SHEAR_RATES[best]:.2g} 1/s, {rounded(stress[best])} Pa, to "
            f"{percent(np.log(factor[best]))}.": own.any(),
        }
        return " ".join(text for text, holds in sentences.items() if holds)

    def facts(self) -> dict:
        """Return all results, JSON-ready."""
        stress, factor = self.flow_curve()
        return super().facts() | {
            "material": self.material.facts(),
            "spread": self.spread.tolist(),
            "flow_curve": {
                "shear_rate_1_s": SHEAR_RATES.tolist(),
                "shear_stress_Pa": stress.tolist(),
                "factor": factor.tolist(),
            },
        }

    def __str__(self):
        lines = [
            *self.constant_lines(),
            *(
                f"{'time offset':18} {1e3 * at:+.0f} +- {1e3 * by:.0f} ms: {name}"
                for name, (at, by) in self.offsets.items()
            ),
            *(
                f"{title(name):18} missed by {by:.2%} (root mean square)"
                + ("; no run comes near what was measured" if by > MAX_MISSED else "")
                for name, by in self.missed.items()
            ),
            *(f"{name} determines {self.determines(name)}" for name in self.worth),
            self.determined(),
            f"{self.runs} runs, {self.cpu_seconds:.0f} s of processor time",
        ]
        return "\n".join(lines)


def percent(logarithm: float) -> str:
    """Format the uncertainty of a constant from that of its logarithm: in percent, or as a factor."""
    return f"{100.0 * np.expm1(logarithm):.2g} %" if logarithm < 0.6 else f"a factor of {np.exp(logarithm):.2g}"
