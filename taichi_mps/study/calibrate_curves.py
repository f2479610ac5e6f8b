"""Constants of a law from measured curves: least squares on the logarithms of the constants, by a regression over runs
of the scene near the best point; the regression averages their scatter."""

import os
import warnings
from itertools import combinations_with_replacement
from pathlib import Path
from time import monotonic

import numpy as np

from ..problem import catalogue
from ..problem.labels import in_words, is_measure, title, written
from ..problem.materials import LAWS, numbers_of
from ..report.sentences import in_time
from ..units import notes, require, suggestion
from .calibration import rounded
from .case import case
from .case import run as run_case
from .curves import Curve, CurveFit, Test, measures_of, read_curves, unit_by_name
from .fit import DIFFERENCE_STEP, constants_of, worth_of
from .sweep import carry_out, executor_of, wall_time

OFFSET = "time_offset"  # in ``free``: the unknown time [s] of the scene at the zero of a curve
MAX_OFFSET = 0.5  # largest offset over the duration of the curve
SAMPLES = 100  # of a curve of a run
COARSENING = 2.0  # spacing of the runs of the fit over the scene's
SEARCH_FACTOR = 100.0  # largest factor between a constant and its initial value
START_FACTORS = 1.0, 0.1, 0.3, 3.0, 10.0  # tried first, of all constants at once
RUN_STEP = 0.4  # of the logarithm of a constant, between runs; particles scatter more than smaller steps
RADIUS = 1.5 * RUN_STEP  # in the logarithms, within which runs enter the regression
MAX_ITERATIONS, TOLERANCE = 10, 0.05  # of the search, and the change of the logarithms that ends it
RELATIVE_ERROR = 0.01  # of a point over the largest value of its measure: weighs measures of different units
MAX_DISTANCE = 0.1  # of points beyond all runs, over the largest value of their measure


def run_with_history(case):
    """Run a case to its end and return its row, with its measures over time in ``course``, {name: values}."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "volume_error_max")  # coarse runs are corrected by finer ones
        return run_case(case, SAMPLES)


class Runs:
    """Runs of a scene beside measured curves, kept in the folder of a study.

    A point ``at`` holds the logarithms of the constants over their ``initial`` values, then the time of the scene at
    the zero of each ``shifted`` test over a tenth of the test's duration. ``done`` holds points and rows of the runs of
    the fit, whose residuals are those of the points on the curves: (computed - measured)/error.
    """

    def __init__(self, scene: str, curves: list[Curve], settings: dict, initial: dict, is_shifted: bool, folder):
        self.scene, self.curves, self.settings, self.initial = scene, curves, settings, initial
        self.tests = list(dict.fromkeys(curve.test for curve in curves))
        self.shifted = [test for test in self.tests if is_shifted and len(test.times)]
        self.curve_ends = np.cumsum([len(curve.values) for curve in curves])  # in the residuals
        alike = [np.concatenate([each.values for each in curves if each.measure == one.measure]) for one in curves]
        self.errors = [RELATIVE_ERROR * (float(np.abs(values).max()) or 1.0) for values in alike]
        self.folder, self.pool, self.seconds = folder, None, 0.0  # of the study, its executor, wall time of a run
        self.planned, self.rows, self.done = {}, {}, {}

    def mix(self, at) -> dict[str, float]:
        """Return the constants of a point, SI units, rounded to five figures, which identify a run."""
        values = zip(self.initial.items(), at, strict=False)
        return {name: float(f"{value * np.exp(logarithm):.5g}") for (name, value), logarithm in values}

    def offsets(self, at) -> dict[Test, float]:
        """Return the time [s] of the scene at the zero of each test."""
        found = zip(self.shifted, at[len(self.initial) :], strict=True)
        return dict.fromkeys(self.tests, 0.0) | {test: 0.1 * np.ptp(test.times) * float(each) for test, each in found}

    def case(self, test: Test, at, spacing):
        """Return the case of a test at a point and a spacing [m]."""
        margin = MAX_OFFSET * np.ptp(test.times) if test in self.shifted else 0.0
        until = {"until": float(test.times[-1] + margin)} if len(test.times) else {}
        return case(self.scene, **self.settings | test.settings | self.mix(at) | until | {"spacing": spacing})

    def compute(self, points, spacing) -> list[list[dict]]:
        """Return the rows of the tests at each point, (points, tests); those that are new are run in parallel."""
        cases = [[self.case(test, at, spacing) for test in self.tests] for at in points]
        start, before = monotonic(), len(self.planned)
        self.planned |= {each.key: each for some in cases for each in some}
        if new := len(self.planned) - before:
            rows = carry_out(list(self.planned.values()), self.folder, run_with_history, self.pool)
            self.rows, self.seconds = {row["key"]: row for row in rows}, (monotonic() - start) / new
        return [[self.rows[each.key] for each in some] for some in cases]

    def add(self, points, spacing) -> None:
        """Add runs of the fit, those that come to their end."""
        for at, rows in zip(points, self.compute(points, spacing), strict=True):
            if all(row["status"] == "done" for row in rows):
                self.done[tuple(self.mix(at).values())] = at, rows

    def model(self, rows, at) -> list[np.ndarray]:
        """Return the values of each curve by rows of the tests, at its times, with the offsets of a point, or at the
        end; SceneError where a run failed."""
        found, offsets, by_test = [], self.offsets(at), dict(zip(self.tests, rows, strict=True))
        for curve in self.curves:
            test, name, row = curve.test, curve.measure, by_test[curve.test]
            require(row["status"] == "done", f"curve = {test.name}: a run {row['status']}: {row['reason']}")
            values = row["course"] if len(test.times) else row
            measures = ", ".join(filter(is_measure, values))
            require(name in values, f"curve = {test.name}: the scene does not measure {name}; must be of {measures}")
            value = np.atleast_1d(np.array(values[name], float))
            found.append(np.interp(curve.times + offsets[test], values["time_s"], value) if len(test.times) else value)
        return found

    def residuals(self, rows, at) -> np.ndarray:
        """Return (computed - measured)/error of all measured points, by rows of the tests and offsets of a point."""
        triples = zip(self.model(rows, at), self.curves, self.errors, strict=True)
        return np.concatenate([(model - curve.values) / error for model, curve, error in triples])

    def split_by_curve(self, values) -> list[np.ndarray]:
        """Split values of all measured points, such as residuals, by curve."""
        return np.split(values, self.curve_ends[:-1])

    def require_reached(self, rows, at) -> None:
        """Raise SceneError, with the rows at a point, where over a quarter of a curve's points lie beyond all runs."""
        values, found = self.model(rows, at), np.array([self.residuals(each, at) for _, each in self.done.values()])
        beyond = self.split_by_curve(np.maximum(found.min(0), -found.max(0)) > MAX_DISTANCE / RELATIVE_ERROR)
        for curve, model, outside in zip(self.curves, values, beyond, strict=True):
            measured, nearest = (written(curve.measure, float(values[-1])) for values in (curve.values, model))
            require(
                np.mean(outside) <= 0.25,
                f"curve = {curve.test.name}: no run comes to it, its {title(curve.measure)} ends at {measured}, that "
                f"of the nearest run at {nearest}, {self.describe(at)}",
            )

    def describe(self, at) -> str:
        """Format the constants of a point."""
        return ", ".join(f"{in_words(name)} {rounded(value)}" for name, value in self.mix(at).items())


class Surface:
    """Residuals near a point as a smooth function of it: a quadratic regression on the logarithms of the constants over
    the runs within RADIUS. ``correction`` is added to them. Offsets of time need no runs."""

    def __init__(self, runs: Runs, centre):
        self.runs, self.count, self.centre, self.correction = runs, len(runs.initial), centre, 0.0
        near = [(at, rows) for at, rows in runs.done.values() if self.distance(at).max() <= RADIUS]
        self.rows, self.terms = [rows for _, rows in near], np.array([self.terms_at(at) for at, _ in near])
        self.inverse = np.linalg.pinv(self.terms, rcond=1e-3)

    def distance(self, at) -> np.ndarray:
        """Return the distance of the constants of a point from the centre."""
        return np.abs(at - self.centre)[: self.count]

    def terms_at(self, at) -> np.ndarray:
        """Return the terms of the quadratic at a point."""
        distances = (at - self.centre)[: self.count]
        return np.array([1.0, *distances, *(a * b for a, b in combinations_with_replacement(distances, 2))])

    def run_residuals(self, at) -> np.ndarray:
        """Return the residuals of the runs with the offsets of a point, (runs, points)."""
        return np.array([self.runs.residuals(rows, at) for rows in self.rows])

    def residuals(self, at) -> np.ndarray:
        """Return the residuals at a point."""
        return self.terms_at(at) @ self.inverse @ self.run_residuals(at) + self.correction

    def slopes(self, at) -> np.ndarray:
        """Return one-sided derivatives of the residuals at a point, (2, points, unknowns)."""
        steps = np.diag(np.where(np.arange(len(at)) < self.count, RUN_STEP, DIFFERENCE_STEP))
        both = np.array([-steps, steps])
        found = np.array([[self.residuals(at + step) for step in side] for side in both]) - self.residuals(at)
        return np.swapaxes(found / both.sum(2)[..., None], 1, 2)

    def scatter(self, at) -> np.ndarray:
        """Return errors of the residuals at a point by the scatter of runs, (runs, points), whose squares add up. A
        finer run that corrects the residuals scatters as much as one of the runs."""
        found, weights = self.run_residuals(at), self.terms_at(at) @ self.inverse
        freedom = max(len(self.terms) - np.linalg.matrix_rank(self.terms), 1)  # degrees of it
        factor = (weights @ weights + bool(np.ndim(self.correction))) / freedom
        return (found - self.terms @ self.inverse @ found) * np.sqrt(factor)


def initial_values(scene: str, free: list[str], settings: dict) -> dict[str, float]:
    """Return initial values of the free constants, as given or the law's; SceneError for what is no constant of it."""
    defaults = {name: number.default for law in reversed(LAWS) for name, number in numbers_of(law).items()}
    for name in free:
        known = f"{suggestion(name, defaults)}; must be of {', '.join(defaults)}"
        require(name in defaults, f"free = {name}: is no constant of a law{known}")
    own = catalogue.build(scene, **settings).material
    initial = {name: settings.get(name, getattr(own, name, defaults[name])) for name in free}
    law = catalogue.build(scene, **settings | initial).material
    for name in free:
        known = numbers_of(type(law))
        require(name in known, f"free = {name}: the law {type(law).__name__} has only {', '.join(known)}")
        initial[name] = value = getattr(law, name)
        require(
            isinstance(value, float) and value > 0.0, f"{name} = {value}: is where the search begins; must be above 0"
        )
    return initial


def log_bounds(initial: dict, fields) -> np.ndarray:
    """Return the bounds of the constants, logarithms over their initial values, (2, constants)."""
    ends = []
    for name, value in initial.items():
        low, high = (
            [bound for note in notes(fields[name]) for mark in marks if (bound := getattr(note, mark, None))]
            for marks in (("ge", "gt"), ("le", "lt"))
        )
        ends.append(np.log([max([*low, value / SEARCH_FACTOR]) / value, min([*high, value * SEARCH_FACTOR]) / value]))
    return np.array(ends).T


def calibrate_curves(
    scene: str, curve: str, free: str, out=None, executor="local", workers=None, finer=True, watch=None, **settings
) -> CurveFit:
    """Fit the constants of a law to measured curves.

    curve: CSV files, separated by commas; free: names of constants of the law, and OFFSET for an unknown time offset of
    each curve; out: folder of the study, which is resumed; finer: whether runs at the scene's spacing correct those of
    the fit, at twice that; watch: is called with lines of progress; settings: keywords of the scene. SceneError for
    invalid input.
    """
    names = [name.strip().replace("-", "_").replace("yield_stress", "yield_value") for name in free.split(",")]
    initial = initial_values(scene, [name for name in names if name != OFFSET], settings)
    require(initial, f"free = {free}: must be a constant of the law or more, such as yield_value,plastic_viscosity")
    function, built = catalogue.load(scene), catalogue.build(scene, **settings | initial)
    keywords, measures = function.parameters.model_fields, measures_of(built)
    curves = [found for path in curve.split(",") for found in read_curves(Path(path.strip()), keywords, measures)]
    points = sum(len(found.values) for found in curves)
    require(points >= 5, f"curve = {curve}: holds {points} points; must be at least 5")
    for test in dict.fromkeys(curve.test for curve in curves):
        both = sorted(test.settings.keys() & {*settings, *initial, "until"})
        require(not both, f"curve = {test.name}: {''.join(both[:1])} is a column of it; must not be given, too")
        domain = catalogue.build(scene, **settings | initial | test.settings).domain
        room = 4.0 * np.ptp(domain, axis=0).max()  # beyond it a unit is missing
        for each in (each for each in curves if each.test is test and unit_by_name(each.measure) == "m"):
            largest, where = np.abs(each.values).max(), f"curve = {test.name}: {each.measure}"
            require(
                largest <= room, f"{where} = {largest:g} m: must be at most {room:.2g} m, or have a unit, as in [cm]"
            )
    folder, report, spacing = out or Path("studies") / f"calibrate-{built.name}", watch or str, built.spacing
    runs = Runs(scene, curves, settings, initial, OFFSET in names, folder)
    offsets = np.full((2, len(runs.shifted)), [[-10.0 * MAX_OFFSET], [10.0 * MAX_OFFSET]])
    bounds, coarse = np.hstack([log_bounds(initial, type(built.material).model_fields), offsets]), spacing
    unknowns, coarse = bounds.shape[1], COARSENING * spacing if finer else spacing
    require(points > unknowns, f"free = {free}: {unknowns} numbers; must be fewer than the measured points, {points}")
    start, _ = executor_of(executor, workers, folder)
    with start() as runs.pool:
        if watch:
            likely = len(runs.tests) * (len(START_FACTORS) + 6 * (1 + 2 * len(initial)))
            cases = [runs.case(test, np.zeros(unknowns), coarse) for test in runs.tests]
            duration = in_time(wall_time(cases, workers or os.cpu_count() or 1, likely))
            finely = f", besides {3 * len(runs.tests)} at {spacing:g} m" * finer
            report(f"some {likely} runs at a spacing of {coarse:g} m, about {duration}{finely}")
        at, surface = search(runs, bounds, coarse, spacing, report)
        return fit_result(runs, at, surface, bounds, built.material, spacing)


def search(runs: Runs, bounds, coarse, spacing, report) -> tuple[np.ndarray, Surface]:
    """Return the best point and the regression there, by runs of a ``coarse`` spacing [m] and, where that is not the
    scene's ``spacing``, a finer one at the point that corrects them; ``report`` is called with lines of progress."""
    from scipy.optimize import least_squares

    count, steps = len(runs.initial), RUN_STEP * np.eye(len(bounds[0]))[: len(runs.initial)]
    scaled = np.array([name != "flow_index" for name in runs.initial] + [False] * len(runs.shifted), float)
    starts = np.clip(np.outer(np.log(START_FACTORS), scaled), *bounds)
    runs.add(starts, coarse)
    squares = [(np.sum(runs.residuals(rows, at) ** 2), k) for k, (at, rows) in enumerate(runs.done.values())]
    at = list(runs.done.values())[min(squares)[1]][0] if squares else starts[0]
    for corrected, most in ((False, MAX_ITERATIONS), (coarse > spacing, 2)):
        for _ in range(most):
            centre = at
            runs.add(np.clip([at, *(at + steps), *(at - steps)], *bounds), coarse)
            runs.require_reached(runs.compute([at], coarse)[0], at)
            surface = Surface(runs, at)
            if corrected:
                surface.correction = runs.residuals(runs.compute([at], spacing)[0], at) - surface.residuals(at)
            reach = np.where(np.arange(len(at)) < count, RUN_STEP * (1.0 if corrected else 2.0), np.inf)
            before = np.sum(surface.residuals(at) ** 2)
            found = least_squares(surface.residuals, at, bounds=np.clip([at - reach, at + reach], *bounds))
            at, error = found.x, RELATIVE_ERROR * np.sqrt(np.mean(found.fun**2))
            told = f"{len(runs.planned)} runs, {runs.seconds:.1f} s each"
            report(f"{told}: {runs.describe(at)}: misses by {error:.2%}")
            if np.abs(at - centre)[:count].max() < TOLERANCE or 2.0 * found.cost > 0.99 * before:
                break
    return at, surface


def fit_result(runs: Runs, at, surface: Surface, bounds, material, spacing) -> CurveFit:
    """Return the result at a point, with intervals by the slopes, the residuals there and the scatter of the runs.

    The residuals of a curve are correlated: their variance is scaled by (1 + r)/(1 - r), r the correlation of
    neighbouring points. Each end of an interval uses the slope to its side where that is less than the central one;
    the prior, which stands for the bounds, narrows no interval.
    """
    from scipy.stats import t

    rows = runs.compute([at], spacing)[0]
    residuals, parts_of, count = runs.residuals(rows, at), runs.split_by_curve, len(runs.initial)
    runs.require_reached(rows, at)
    sum_of_squares, degrees_of_freedom = max(float(residuals @ residuals), 1e-12), len(residuals) - len(at)
    correlation = sum(float(part[1:] @ part[:-1]) for part in parts_of(residuals)) / sum_of_squares
    correlation = min(max(correlation, 0.0), 0.9)
    error = np.sqrt(sum_of_squares / degrees_of_freedom * (1.0 + correlation) / (1.0 - correlation))
    prior, quantile = np.diag(12.0 / np.ptp(bounds, axis=0) ** 2), t.ppf(0.975, degrees_of_freedom)
    sides, noise = surface.slopes(at) / error, surface.scatter(at) / error
    slopes = sides.mean(0)

    def covariance(slopes):
        spread = np.linalg.inv(prior + slopes.T @ slopes)
        shifts = spread @ slopes.T @ noise.T  # of the best point, by the scatter of runs
        return spread + shifts @ shifts.T

    ends = []
    for sign, side in zip((-1.0, 1.0), sides, strict=True):
        flattest = np.where(np.linalg.norm(side, axis=0) < np.linalg.norm(slopes, axis=0), side, slopes)
        precision = 1.0 / np.diag(covariance(flattest)) - np.diag(prior)
        ends.append(at + sign * quantile / np.sqrt(np.maximum(precision, 0.01 * np.diag(prior))))
    first, spread = slice(count), covariance(slopes) * quantile**2
    constants = constants_of(runs.initial, at[first], np.array(ends)[:, first], bounds[:, first])
    half_widths, parts = runs.offsets(np.sqrt(np.diag(spread))), parts_of(slopes)
    names = [f"{title(curve.measure)} of {curve.test.name}" for curve in runs.curves]
    worth = worth_of(runs.initial, bounds, parts) if len(parts) > 1 else []
    return CurveFit(
        scene=runs.scene,
        material=material.model_copy(update={name: it.value for name, it in constants.items()}),
        constants=constants,
        offsets={test.name: (runs.offsets(at)[test], half_widths[test]) for test in runs.shifted},
        spread=spread[first, first],
        curves=[curve.facts(values) for curve, values in zip(runs.curves, runs.model(rows, at), strict=True)],
        worth=dict(zip(names, worth, strict=False)),
        runs=len(runs.planned),
        cpu_seconds=sum(
            row.get(name) or 0.0 for row in runs.rows.values() for name in ("cpu_seconds", "compile_seconds")
        ),
    )
