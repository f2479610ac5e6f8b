"""Measured curves of a user, a measure of a scene against time or end values against its keywords, and the result of
their fit: the constants of a law with intervals, its flow curve, and what is determined."""

import warnings
from dataclasses import dataclass

import numpy as np

from ..engine import Material, still
from ..input.labels import OPTIONS, RESULTS, UNITS, in_words, title
from ..spelling import in_unit, without_unit
from ..units import SceneError, require, unit_of, user_path
from .calibration import FittedConstants, rounded
from .tables import COLUMN_NAMES, ROW_ERROR, key_of, match_column, read_list

TIME_COLUMNS = "time t zeit temps 時間"  # names of the column of the times
DIAMETER = "spread_m"  # measure of a column 'diameter', which is an ignored word beside other names
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


def unit_by_name(measure: str) -> str:
    """Return the SI unit of a measure, by the end of its name."""
    end = next(end for end in UNITS if measure.endswith(end))
    return {"_m_s": "m/s", "_ratio": ""}.get(end, end[1:].replace("_per_", "/").replace("_", " "))


def column_meanings(keywords: dict, measures) -> tuple[dict[str, str], dict[str, str]]:
    """Return the names that a column may have, {key_of(name): time, keyword or measure}, and the unit of each, SI."""
    words, units = {key_of(word): "time" for word in TIME_COLUMNS.split()}, {"time": "s"}
    for name, each in keywords.items():
        words |= {key_of(word): name for word in (name, OPTIONS.get(name, name))}
        units[name] = unit_of(each).strip("-")
    for name in measures:
        stem = name.removesuffix(next(end for end in UNITS if name.endswith(end)))
        words |= {key_of(word): name for word in (name, stem, title(name), *COLUMN_NAMES.get(stem, "").split())}
        units[name] = unit_by_name(name)
    return words | ({"": DIAMETER} if DIAMETER in measures else {}), units


def read_curves(path, keywords: dict, measures) -> list[Curve]:
    """Read the curves of a CSV file, a row a point: columns are time, measures of a scene and, where a file holds
    several curves or end values, the scene's ``keywords`` {name: pydantic field}; a warning names the others.
    SceneError for any other file."""
    path = user_path(path)
    rows, where = read_list(path, "curve"), f"curve = {path}: "
    words, units = column_meanings(keywords, measures)
    contents = {column: match_column(column, words, units.get) for column in rows[0] if column}
    found = [field for field, _ in contents.values() if field]
    duplicate = next((field for field in found if found.count(field) > 1), "")
    require(not duplicate, f"{where}two columns are {duplicate}; must be one")
    allowed, others = ", ".join(measures), ", ".join(f"'{name}'" for name, (field, _) in contents.items() if not field)
    require(
        set(measures) & set(found),
        f"{where}has no column that the scene measures ({others or 'none else'}); must be one or more of {allowed}",
    )
    if others:
        warnings.warn(f"{where}not used: {others}", stacklevel=2)
    runs: dict[tuple, list] = {}
    for number, row in enumerate(rows, 1):
        require(ROW_ERROR not in row, where + row.get(ROW_ERROR, ""))
        values = {field: parse_cell(row[column], unit, units[field], f"{where}row {number}, {column}")
                for column, (field, unit) in contents.items() if field not in (None, *keywords)}  # fmt: skip
        settings = {field: f"{row[column]} {unit * without_unit(row[column])}".strip()
                    for column, (field, unit) in contents.items() if field in keywords}  # fmt: skip
        key = (*settings.items(), *([number] if "time" not in found else []))
        runs.setdefault(key, []).append((settings, values))
    curves = []
    for points in runs.values():
        settings, first = points[0]
        columns = {field: np.array([values[field] for _, values in points]) for field in first}
        times, name = columns.pop("time", np.zeros(0)), ", ".join([path.name, *map(" ".join, settings.items())])
        falls = next((f"{a} s comes {b} s" for a, b in zip(times[:-1], times[1:], strict=True) if not b >= a), "")
        require(not falls, f"curve = {name}: times fall: after {falls}")
        require(np.all(times >= 0.0), f"curve = {name}: a time is missing or before 0 s; must be 0 s or more")
        test, present = Test(name, settings, times), {measure: np.isfinite(each) for measure, each in columns.items()}
        curves += [
            Curve(test, measure, times[present[measure]] if len(times) else times, each[present[measure]])
            for measure, each in columns.items()
            if present[measure].any()
        ]
    return curves


def parse_cell(cell: str, unit: str, si_unit: str, where: str) -> float:
    """Return a cell in the unit ``si_unit``, from its own unit or that of its column; nan for an empty one."""
    try:
        return float(in_unit(si_unit, f"{cell} {unit * without_unit(cell)}".strip()) if cell else "nan")
    except ValueError:
        raise SceneError(f"{where} = {cell}: must be a number{f' [{si_unit}]' * bool(si_unit)}") from None


def measures_of(scene) -> list[str]:
    """Return the names of a scene's measures known before a run; all of RESULTS where there are none."""
    found = scene.measure(scene.unfold(still(scene.initial, scene.spacing))) if scene.measure else {}
    if not found or not scene.over_time:
        return list(found or RESULTS)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a history of two rows
        history = {"time_s": [0.0, 1.0]} | {name: [value, value] for name, value in found.items()}
        return [*found, *scene.over_time({name: np.array(values) for name, values in history.items()})]


# ---- result of a fit --------------------------------------------------------------------------------------------
@dataclass(frozen=True, kw_only=True)
class CurveFit(FittedConstants):
    """Result of a fit to measured curves, and the curves of the model beside them."""

    scene: str
    material: Material  # with the constants found
    offsets: dict[str, tuple[float, float]]  # time of the scene at the zero of a curve, half of its 95 % interval [s]
    spread: np.ndarray  # covariance of the logarithms of the constants, times the square of a 95 % quantile
    curves: list[dict]  # name, settings, measure, times [s], measured and model, SI units
    runs: int
    cpu_seconds: float

    @property
    def missed(self) -> dict[str, float]:
        """Root mean square of model - measured over the largest measured value, by measure [-]."""
        found = {}
        for name in {each["measure"]: None for each in self.curves}:
            model, measured = (
                np.concatenate([each[of] for each in self.curves if each["measure"] == name])
                for of in ("model", "measured")
            )
            found[name] = float(np.sqrt(np.nanmean((model - measured) ** 2)) / (np.nanmax(np.abs(measured)) or 1.0))
        return found

    def flow_curve(self, rates=SHEAR_RATES) -> tuple[np.ndarray, np.ndarray]:
        """Return shear stresses [Pa] at shear rates [1/s], and the factors of their 95 % intervals."""

        changes = [{name: it.value * np.exp(by)} for name, it in self.constants.items() for by in (0.01, -0.01)]
        laws = [self.material, *(self.material.model_copy(update=change) for change in changes)]
        stress, *changed = np.array([[law.shear_stress(float(rate), 0.0) for rate in rates] for law in laws])
        slopes = (np.log(changed[::2]) - np.log(changed[1::2])) / 0.02
        return stress, np.exp(np.sqrt(np.einsum("ik,ij,jk->k", slopes, self.spread, slopes)))

    def determined(self) -> str:
        """Format in sentences which constants the curves determine."""
        errors = dict(zip(self.constants, map(percent, np.sqrt(np.diag(self.spread))), strict=True))
        known = [f"{in_words(name)} to {errors[name]}" for name, it in self.constants.items() if it.determined]
        others = [in_words(name) for name, it in self.constants.items() if not it.determined]
        sentences = [f"The curves determine the {' and the '.join(known)}."] * bool(known)
        sentences += [f"They do not determine the {' and the '.join(others)}."] * bool(others)
        rate, stress, factor = min(zip(SHEAR_RATES, *self.flow_curve(), strict=True), key=lambda point: point[2])
        best = f"{rate:.2g} 1/s, {rounded(stress)} Pa, to {percent(np.log(factor))}"
        return " ".join([*sentences, f"The shear stress is known best at {best}."])

    def facts(self) -> dict:
        """Return all results, JSON-ready."""
        flow = zip(("shear_rate_1_s", "shear_stress_Pa", "factor"), (SHEAR_RATES, *self.flow_curve()), strict=True)
        facts = {"material": self.material.facts(), "missed": self.missed, "spread": self.spread.tolist()}
        return super().facts() | facts | {"flow_curve": {name: values.tolist() for name, values in flow}}

    def __str__(self):
        lines, offsets = self.constant_lines(), self.offsets.items()
        lines += [f"{'time offset':18} {1e3 * at:+.0f} +- {1e3 * by:.0f} ms: {name}" for name, (at, by) in offsets]
        lines += [f"{title(name):18} missed by {by:.2%} (root mean square)" for name, by in self.missed.items()]
        lines += [f"{name} determines {self.determines(name)}" for name in self.worth]
        return "\n".join([*lines, self.determined(), f"{self.runs} runs, {self.cpu_seconds:.0f} s of processor time"])


def percent(logarithm: float) -> str:
    """Format the uncertainty of a constant from that of its logarithm: in percent, or as a factor."""
    return f"{100.0 * np.expm1(logarithm):.2g} %" if logarithm < 0.6 else f"a factor of {np.exp(logarithm):.2g}"
