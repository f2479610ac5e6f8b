"""Constants of a law from measured curves: runs of their scene, by least squares on the logarithms, coarse first."""

import os
import warnings
from pathlib import Path
from time import monotonic

import numpy as np

from ..problem import catalogue
from ..problem.labels import in_words, is_measure, title, written
from ..problem.materials import LAWS, numbers_of
from ..report.sentences import in_time
from ..units import SceneError, notes, require, suggestion
from .calibration import rounded
from .case import case
from .case import run as run_case
from .curves import Curve, CurveFit, Test, measures_of, read_curve_files, unit_by_name
from .fit import DIFFERENCE_STEP, FAILED_RESIDUAL, LeastSquares
from .surface import RUN_STEP, Surface
from .sweep import carry_out, executor_of, wall_time

OFFSET = "time_offset"  # in ``free``: the unknown time [s] of the scene at the zero of a curve
MAX_OFFSET = 0.5  # largest offset over the duration of the curve
SAMPLES = 100  # of a curve of a run
COARSENING = 2.0  # spacing of the runs of the fit over the scene's
SEARCH_FACTOR = 100.0  # largest factor between a constant and its initial value
START_ITERATIONS = 4  # runs of the first search, which scales all constants by one factor
MAX_ITERATIONS, TOLERANCE = 10, 0.05  # of the search, and the change of the logarithms that ends it
RELATIVE_ERROR = 0.01  # of a point over the largest value of its measure: weighs measures of different units
MAX_DISTANCE = 0.1  # of points beyond all runs, over the largest value of their measure


def run_with_history(case):
    """Run a case to its end and return its row, with its measures over time in ``course``, {name: values}."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "volume_error_max")  # coarse runs are corrected by finer ones
        return run_case(case, SAMPLES)


class RunLeastSquares(LeastSquares):
    """Least squares of runs of a scene to measured curves; the runs are kept in the folder of a study.

    A point ``at`` holds the logarithms of the constants over their ``initial`` values, then, with ``offsets``, the time
    of the scene at the zero of each test over a tenth of the test's duration. Runs of the fit have a ``spacing`` [m];
    ``correction`` is added to their residuals, and ``computed`` holds their points.
    """

    def __init__(
        self, scene: str, curves: list[Curve], settings: dict, initial: dict, ends, offsets: bool, spacing: float
    ):
        self.scene, self.curves, self.settings, self.initial = scene, curves, settings, initial
        self.folder, self.pool, self.seconds = None, None, 0.0  # of the study, its executor, wall time of a run
        self.spacing, self.correction = spacing, 0.0
        self.cases, self.planned, self.rows, self.computed = {}, {}, {}, {}
        self.tests = list(dict.fromkeys(curve.test for curve in curves))
        shifted = [test for test in self.tests if offsets and len(test.times)]
        self.offset_columns = {test: number for number, test in enumerate(shifted, len(initial))}  # in a point
        self.offset_units = np.array([0.1 * np.ptp(test.times) for test in shifted])  # of the offsets [s]
        alike = [np.concatenate([each.values for each in curves if each.measure == one.measure]) for one in curves]
        self.errors = [RELATIVE_ERROR * (float(np.abs(values).max()) or 1.0) for values in alike]
        self.curve_ends = np.cumsum([len(curve.values) for curve in curves])  # in the residuals
        self.residual_range = np.inf, -np.inf  # smallest and largest residual of each point so far
        super().__init__(initial, np.hstack([ends, np.outer([-10.0, 10.0], np.full(len(shifted), MAX_OFFSET))]))

    def mix(self, at) -> dict[str, float]:
        """Return the constants of a point, SI units, rounded to five figures, which identify a run."""
        values = zip(self.initial.items(), at[: len(self.initial)], strict=True)
        return {name: float(f"{value * np.exp(logarithm):.5g}") for (name, value), logarithm in values}

    def offset(self, at, test: Test) -> float:
        """Return the time [s] of the scene at the zero of a test."""
        column = self.offset_columns.get(test)
        return 0.0 if column is None else at[column] * self.offset_units[column - len(self.initial)]

    def case(self, test: Test, at, spacing):
        """Return the case of a test at a point and a spacing [m]."""
        mix = self.mix(at)
        name = test, spacing, *mix.values()
        if name not in self.cases:
            margin = MAX_OFFSET * np.ptp(test.times) if test in self.offset_columns else 0.0
            until = {"until": float(test.times[-1] + margin)} if len(test.times) else {}
            keywords = self.settings | test.settings | mix | until | {"spacing": spacing}
            self.cases[name] = case(self.scene, **keywords)
        return self.cases[name]

    def compute(self, points, spacing) -> None:
        """Run the cases of these points that were not run yet, in parallel."""
        wanted = [self.case(test, at, spacing) for at in points for test in self.tests]
        start, new = monotonic(), [run for run in wanted if run.key not in self.planned]
        self.planned |= {run.key: run for run in wanted}
        if new:
            rows = carry_out(list(self.planned.values()), self.folder, run_with_history, self.pool)
            self.rows = {row["key"]: row for row in rows}
            self.seconds = (monotonic() - start) / len(new)
        for at in points:
            keys = [self.case(test, at, spacing).key for test in self.tests]
            if spacing == self.spacing and all(self.rows[key]["status"] == "done" for key in keys):
                self.computed[tuple(self.mix(at).values())] = at[: len(self.initial)]

    def model(self, at, spacing) -> list[np.ndarray]:
        """Return the values of each curve by runs, at its times or at the end; SceneError where a run failed."""
        self.compute([at], spacing)
        found = []
        for curve in self.curves:
            test, name, row = curve.test, curve.measure, self.rows[self.case(curve.test, at, spacing).key]
            require(row["status"] == "done", f"curve = {test.name}: a run {row['status']}: {row['reason']}")
            values = row["course"] if len(test.times) else row
            measures = ", ".join(filter(is_measure, values))
            require(name in values, f"curve = {test.name}: the scene does not measure {name}; must be of {measures}")
            value = np.atleast_1d(np.array(values[name], float))
            found.append(
                np.interp(curve.times + self.offset(at, test), values["time_s"], value) if len(test.times) else value
            )
        return found

    def residuals_at(self, at, spacing) -> np.ndarray:
        """Return (model - measured)/error of all measured points, by runs of a spacing [m]."""
        triples = zip(self.model(at, spacing), self.curves, self.errors, strict=True)
        found = np.concatenate([(model - curve.values) / error for model, curve, error in triples])
        self.residual_range = np.fmin(self.residual_range[0], found), np.fmax(self.residual_range[1], found)
        return found

    def residuals(self, at) -> np.ndarray:
        """Return (model - measured)/error of all measured points, corrected."""
        return self.residuals_at(at, self.spacing) + self.correction

    def split_by_curve(self, values) -> list[np.ndarray]:
        """Split values of all measured points, such as residuals, by curve."""
        return np.split(values, self.curve_ends[:-1])

    def require_reached(self, at) -> None:
        """Raise SceneError, with the run at a point, where over a quarter of a curve's points lie beyond all runs."""
        lowest, highest = self.residual_range
        beyond = self.split_by_curve(np.maximum(lowest, -highest) > MAX_DISTANCE / RELATIVE_ERROR)
        for curve, model, outside in zip(self.curves, self.model(at, self.spacing), beyond, strict=True):
            measured, nearest = (written(curve.measure, float(values[-1])) for values in (curve.values, model))
            require(
                np.mean(outside) <= 0.25,
                f"curve = {curve.test.name}: no run comes to it, its {title(curve.measure)} ends at {measured}, that "
                f"of the nearest run at {nearest}, {self.describe(at)}",
            )

    def one_sided_slopes(self, at) -> np.ndarray:
        """Return one-sided derivatives of the residuals at a point, (2, points, unknowns): by steps of RUN_STEP in the
        logarithm of a constant, of DIFFERENCE_STEP in an offset. Runs are computed in parallel."""
        count, others = len(self.initial), len(self.offset_units)
        steps = np.diag([RUN_STEP] * count + [DIFFERENCE_STEP] * others)
        around = np.clip([at - steps, at + steps], *self.bounds)
        self.compute([at, *around[0, :count], *around[1, :count]], self.spacing)
        found = np.array([[self.residuals(point) for point in side] for side in around]) - self.residuals(at)
        return np.swapaxes(found / (around - at).sum(2)[..., None], 1, 2)

    def slopes(self, at) -> np.ndarray:
        """Return central derivatives of the residuals at a point, (points, unknowns)."""
        return self.one_sided_slopes(at).mean(0)

    def fit_offsets(self, at) -> tuple[np.ndarray, float]:
        """Return the point with the best offset of each test, and the sum of squares there."""
        tried = np.linspace(-10.0 * MAX_OFFSET, 10.0 * MAX_OFFSET, 201) if self.offset_columns else np.zeros(1)
        squares = []
        for offset in tried:
            at = np.concatenate([at[: len(self.initial)], np.full(len(self.offset_units), offset)])
            squares.append([part @ part for part in self.split_by_curve(self.residuals(at))])
        for test, column in self.offset_columns.items():
            selected = [curve.test is test for curve in self.curves]
            at[column] = tried[np.argmin(np.array(squares)[:, selected].sum(1))]
        return at, float(np.sum(self.residuals(at) ** 2))

    def initial_guess(self) -> np.ndarray:
        """Return the start of the fit, all constants scaled by the best common factor; SceneError beyond all runs."""
        from scipy.optimize import minimize_scalar

        direction = np.array([name != "flow_index" for name in self.initial], float)
        search = {"bounds": np.log([1.0 / SEARCH_FACTOR, SEARCH_FACTOR]), "options": {"maxiter": START_ITERATIONS}}
        best = minimize_scalar(lambda factor: self.fit_offsets(factor * direction)[1], method="bounded", **search).x
        at, _ = self.fit_offsets(best * direction)
        self.require_reached(at)
        return at

    def describe(self, at) -> str:
        """Format the constants of a point."""
        return ", ".join(f"{in_words(name)} {rounded(value)}" for name, value in self.mix(at).items())


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
    curves = read_curve_files(curve, function.parameters.model_fields, measures_of(built))
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
    ends = log_bounds(initial, type(built.material).model_fields)
    coarser = COARSENING if finer else 1.0
    runs = RunLeastSquares(scene, curves, settings, initial, ends, OFFSET in names, coarser * spacing)
    points, unknowns = runs.curve_ends[-1], runs.bounds.shape[1]
    require(points > unknowns, f"free = {free}: {unknowns} numbers; must be fewer than the measured points, {points}")
    start, _ = executor_of(executor, workers)
    with start() as runs.pool:
        runs.folder = folder
        if watch:
            likely = len(runs.tests) * (START_ITERATIONS + 7 * (1 + 2 * len(initial)))
            cases = [runs.case(test, np.zeros(len(initial)), runs.spacing) for test in runs.tests]
            duration = in_time(wall_time(cases, workers or os.cpu_count() or 1, likely))
            finely = f", besides {3 * len(runs.tests)} at {spacing:g} m" * finer
            report(f"some {likely} runs at a spacing of {runs.spacing:g} m, about {duration}{finely}")

        def logged_residuals(at):
            try:
                found = runs.residuals(at)
            except SceneError as failure:
                report(str(failure))
                return np.full(points, FAILED_RESIDUAL)
            error = RELATIVE_ERROR * np.sqrt(np.mean(found**2))
            report(f"{len(runs.planned)} runs, {runs.seconds:.1f} s each: {runs.describe(at)}: misses by {error:.2%}")
            return found

        at = np.clip(runs.initial_guess(), *(0.999 * runs.bounds))
        at = runs.solve(at, logged_residuals, jac=runs.slopes, xtol=TOLERANCE, ftol=0.01, max_nfev=MAX_ITERATIONS).x
        for corrected in (finer, finer, False):
            centre, side_slopes = at, runs.one_sided_slopes(at)
            if corrected:
                runs.correction = 0.0
                runs.correction = runs.residuals_at(at, spacing) - Surface(runs, at).residuals(at)
            at, slopes = Surface(runs, at).best()
            logged_residuals(at)
            if np.abs(at - centre)[: len(initial)].max() < 0.4 * TOLERANCE:
                break
        runs.require_reached(at)
        return fit_result(runs, at, slopes, side_slopes, built.material, spacing)


def fit_result(runs: RunLeastSquares, at, slopes, side_slopes, material, spacing) -> CurveFit:
    """Return the result at a point, with intervals by the slopes, the residuals there and the scatter of the runs.

    The residuals of a curve are correlated: their variance is scaled by (1 + r)/(1 - r), r the correlation of
    neighbouring points. Each end of an interval uses the slope to its side where that is less than the central one;
    the prior, which stands for the bounds, narrows no interval.
    """
    from scipy.stats import t

    residuals, model, count = runs.residuals_at(at, spacing), runs.model(at, spacing), len(runs.initial)
    sum_of_squares = max(float(residuals @ residuals), 1e-12)
    correlation = sum(float(part[1:] @ part[:-1]) for part in runs.split_by_curve(residuals)) / sum_of_squares
    degrees_of_freedom, correlation = len(residuals) - len(at), min(max(correlation, 0.0), 0.9)
    error = np.sqrt(sum_of_squares / degrees_of_freedom * (1.0 + correlation) / (1.0 - correlation))
    quantile, noise, ends = t.ppf(0.975, degrees_of_freedom), Surface(runs, at).scatter(at) / error, []

    def covariance(slopes):
        spread = runs.covariance(slopes / error)
        shifts = spread @ slopes.T @ noise.T / error  # of the best point, by the scatter of runs
        return spread + shifts @ shifts.T

    for sign, side in zip((-1.0, 1.0), side_slopes, strict=True):
        flattest = np.where(np.linalg.norm(side, axis=0) < np.linalg.norm(slopes, axis=0), side, slopes)
        precision = 1.0 / np.diag(covariance(flattest)) - np.diag(runs.prior)
        ends.append(at + sign * quantile / np.sqrt(np.maximum(precision, 0.01 * np.diag(runs.prior))))
    constants, spread = runs.constants(at, np.transpose(ends)), covariance(slopes) * quantile**2
    half_widths, parts = np.sqrt(np.diag(spread)), runs.split_by_curve(slopes / error)
    curves, names = [], [f"{title(curve.measure)} of {curve.test.name}" for curve in runs.curves]
    for curve, values in zip(runs.curves, model, strict=True):
        facts = {"name": curve.test.name, "settings": curve.test.settings, "measure": curve.measure}
        arrays = {"times": curve.times, "measured": curve.values, "model": values}
        curves.append(facts | {name: array.tolist() for name, array in arrays.items()})
    spent = [row.get(name) or 0.0 for row in runs.rows.values() for name in ("cpu_seconds", "compile_seconds")]
    return CurveFit(
        scene=runs.scene,
        material=material.model_copy(update={name: it.value for name, it in constants.items()}),
        constants=constants,
        offsets={test.name: (runs.offset(at, test), runs.offset(half_widths, test)) for test in runs.offset_columns},
        spread=spread[:count, :count],
        curves=curves,
        worth=dict(zip(names, runs.worth(parts), strict=True)) if len(parts) > 1 else {},
        runs=len(runs.planned),
        cpu_seconds=sum(spent),
    )
