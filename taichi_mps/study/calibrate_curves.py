"""Constants of a law from measured curves: least squares on the logarithms of the constants, by a regression over runs
of the scene near the best point; the regression averages their scatter."""

import os
from itertools import combinations_with_replacement
from pathlib import Path
from time import monotonic

import numpy as np

from ..engine import LAWS, numbers_of
from ..input import catalogue
from ..input.labels import in_words, is_measure, title, written
from ..report.sentences import in_time
from ..units import notes, require, suggestion
from .calibration import rounded
from .case import Case, case, run
from .curves import Curve, CurveFit, Test, measures_of, read_curves, unit_by_name
from .fit import DIFFERENCE_STEP, constants_of, prior_of, worth_of
from .sweep import carry_out, executor_of, wall_time

OFFSET = "time_offset"  # in ``free``: the unknown time [s] of the scene at the zero of a curve
MAX_OFFSET = 0.5  # largest offset over the duration of the curve
SAMPLES = 100  # of a curve of a run
COARSENING = 2.0  # spacing of the runs of the fit over the scene's
SEARCH_FACTOR = 100.0  # largest factor between a constant and its initial value
START_FACTORS = 1.0, 0.1, 0.3, 3.0, 10.0  # of all constants at once, run first
RUN_STEP = 0.4  # of the logarithm of a constant, between runs; particles scatter more than smaller steps
RADIUS = 1.5 * RUN_STEP  # in the logarithms, within which runs enter the regression
MAX_ITERATIONS, MAX_CORRECTIONS = 10, 2  # regressions by coarse runs, and by these and a finer one
TOLERANCE = 0.05  # change of the logarithms that ends them
RELATIVE_ERROR = 0.01  # of a point over the largest value of its measure: weighs measures of different units
MAX_DISTANCE = 0.1  # of points beyond all runs, over the largest value of their measure


def run_with_history(case: Case) -> dict:  # Slurm's workers import it by name
    """Run a case to its end and return its row, with its measures over time in ``course``, {name: values}."""
    return run(case, SAMPLES)


def are_done(rows: dict) -> bool:
    """Whether the runs of all tests at a point came to their end."""
    return all(row["status"] == "done" for row in rows.values())


class Runs:
    """Runs of a scene beside measured curves, kept in the folder of a study.

    A point ``at`` holds the logarithms of the constants over their ``initial`` values, then the time of the scene at
    the zero of each ``shifted`` test over a tenth of the test's duration. ``done`` holds points of the search, whose
    runs have the spacing ``coarse`` [m], with their rows by test. Residuals are those of all measured points:
    (computed - measured)/error.
    """

    def __init__(
        self, scene: str, curves: list[Curve], settings: dict, initial: dict, is_shifted: bool, coarse, folder, report
    ):
        self.scene, self.curves, self.settings, self.initial = scene, curves, settings, initial
        self.coarse, self.folder, self.report = coarse, folder, report  # called with lines of progress
        self.pool, self.seconds = None, 0.0  # executor, wall time of a run
        self.tests = list(dict.fromkeys(curve.test for curve in curves))
        self.shifted = [test for test in self.tests if is_shifted and len(test.times)]
        self.curve_ends = np.cumsum([len(curve.values) for curve in curves])[:-1]  # in the residuals
        self.measured = np.concatenate([curve.values for curve in curves])
        alike = [np.concatenate([each.values for each in curves if each.measure == one.measure]) for one in curves]
        largest = [np.abs(values).max() or 1.0 for values in alike]
        self.errors = RELATIVE_ERROR * np.repeat(largest, [len(curve.values) for curve in curves])
        self.planned, self.rows, self.done = {}, {}, {}

    def mix(self, at) -> dict[str, float]:
        """Return the constants of a point, SI units, rounded to five figures, which identify a run."""
        values = zip(self.initial.items(), np.exp(at[: len(self.initial)]), strict=True)
        return {name: float(f"{initial * factor:.5g}") for (name, initial), factor in values}

    def offsets(self, at) -> dict[Test, float]:
        """Return the time [s] of the scene at the zero of each shifted test."""
        pairs = zip(self.shifted, at[len(self.initial) :], strict=True)
        return {test: 0.1 * float(np.ptp(test.times) * offset) for test, offset in pairs}

    def case(self, test: Test, at, spacing) -> Case:
        """Return the case of a test at a point and a spacing [m]."""
        margin = MAX_OFFSET * np.ptp(test.times) if test in self.shifted else 0.0
        until = {"until": float(test.times[-1] + margin)} if len(test.times) else {}
        return case(self.scene, **self.settings | test.settings | self.mix(at) | until | {"spacing": spacing})

    def compute(self, points, spacing) -> list[dict[Test, dict]]:
        """Return the rows of the tests at each point; runs that are new are carried out in parallel."""
        cases = [{test: self.case(test, at, spacing) for test in self.tests} for at in points]
        start, before = monotonic(), len(self.planned)
        self.planned |= {each.key: each for some in cases for each in some.values()}
        if new := len(self.planned) - before:
            rows = carry_out(list(self.planned.values()), self.folder, run_with_history, self.pool)
            self.rows, self.seconds = {row["key"]: row for row in rows}, (monotonic() - start) / new
            for row in (row for row in rows[before:] if row["status"] != "done"):
                self.report(f"a run {row['status']}: {row['reason']}")
        found = [{test: self.rows[each.key] for test, each in some.items()} for some in cases]
        if spacing == self.coarse:
            runs = zip(points, found, strict=True)
            self.done |= {tuple(self.mix(at).values()): (at, rows) for at, rows in runs if are_done(rows)}
        return found

    def residuals(self, at, rows) -> np.ndarray:
        """Return the residuals by rows of the tests, at the times of the curves with the offsets of a point, or at the
        end; SceneError where a run failed."""
        found, offsets = [], self.offsets(at)
        for curve in self.curves:
            test, name, row = curve.test, curve.measure, rows[curve.test]
            require(row["status"] == "done", f"curve = {test.name}: a run {row['status']}: {row['reason']}")
            values, times = row["course"] if len(test.times) else row, curve.times + offsets.get(test, 0.0)
            known = ", ".join(filter(is_measure, values))
            require(name in values, f"curve = {test.name}: the scene does not measure {name}; must be of {known}")
            value = np.atleast_1d(np.array(values[name], float))
            found.append(np.interp(times, values["time_s"], value) if len(times) else value)
        return (np.concatenate(found) - self.measured) / self.errors

    def model(self, residuals) -> list[np.ndarray]:
        """Return the values of each curve that have these residuals."""
        return np.split(self.measured + self.errors * residuals, self.curve_ends)

    def require_reached(self, at, residuals) -> None:
        """Raise SceneError, with the residuals at a point, where over a quarter of a curve's points lie beyond all
        runs."""
        found = np.array([self.residuals(at, each) for _, each in self.done.values()])
        beyond = np.maximum(found.min(0), -found.max(0)) > MAX_DISTANCE / RELATIVE_ERROR
        for curve, values, outside in zip(
            self.curves, self.model(residuals), np.split(beyond, self.curve_ends), strict=True
        ):
            measured, nearest = (written(curve.measure, float(each[-1])) for each in (curve.values, values))
            require(
                np.mean(outside) <= 0.25,
                f"curve = {curve.test.name}: no run comes to it, its {title(curve.measure)} ends at {measured}, that "
                f"of the nearest run at {nearest}, {self.describe(at)}",
            )

    def describe(self, at) -> str:
        """Format the constants of a point."""
        return ", ".join(f"{in_words(name)} {rounded(value)}" for name, value in self.mix(at).items())


class ResponseSurface:
    """Residuals near a point as a smooth function of it, which averages the scatter of runs: a quadratic regression on
    the logarithms of the constants over the runs within RADIUS. ``correction`` is added. Offsets of time need no runs.
    """

    def __init__(self, runs: Runs, centre):
        self.runs, self.centre, self.correction = runs, centre[: len(runs.initial)], 0.0
        near = [(at, rows) for at, rows in runs.done.values() if np.abs(self.distances(at)).max() <= RADIUS]
        require(near, f"curve = {runs.tests[0].name}: every run near {runs.describe(centre)} failed")
        self.rows, self.terms = [rows for _, rows in near], np.array([self.terms_at(at) for at, _ in near])
        self.inverse = np.linalg.pinv(self.terms, rcond=1e-3)

    def distances(self, at) -> np.ndarray:
        """Return the distances of the constants of a point from the centre."""
        return at[: len(self.centre)] - self.centre

    def terms_at(self, at) -> np.ndarray:
        """Return the terms of the quadratic at a point."""
        distances = self.distances(at)
        return np.array([1.0, *distances, *(a * b for a, b in combinations_with_replacement(distances, 2))])

    def run_residuals(self, at) -> np.ndarray:
        """Return the residuals of the runs with the offsets of a point, (runs, points)."""
        return np.array([self.runs.residuals(at, rows) for rows in self.rows])

    def residuals(self, at) -> np.ndarray:
        """Return the residuals at a point."""
        return self.terms_at(at) @ self.inverse @ self.run_residuals(at) + self.correction

    def scatter(self, at) -> np.ndarray:
        """Return errors of the residuals at a point by the scatter of runs, (runs, points), whose squares add up. A
        finer run that corrects the residuals scatters as much as one of the runs."""
        found, weights = self.run_residuals(at), self.terms_at(at) @ self.inverse
        freedom = max(len(self.terms) - np.linalg.matrix_rank(self.inverse), 1)  # degrees of it
        factor = (weights @ weights + bool(np.ndim(self.correction))) / freedom
        return (found - self.terms @ self.inverse @ found) * np.sqrt(factor)


def initial_values(scene: str, free: list[str], settings: dict) -> dict[str, float]:
    """Return initial values of the free constants, as given or the law's; SceneError for what is no constant of it."""
    defaults = {name: number.default for law in reversed(LAWS) for name, number in numbers_of(law).items()}
    for name in free:
        require(
            name in defaults,
            f"free = {name}: is no constant of a law{suggestion(name, defaults)}; must be of {', '.join(defaults)}",
        )
    own = catalogue.build(scene, **settings).material
    initial = {name: settings.get(name, getattr(own, name, defaults[name])) for name in free}
    law = catalogue.build(scene, **settings | initial).material
    known = numbers_of(type(law))
    for name in free:
        require(name in known, f"free = {name}: the law {type(law).__name__} has only {', '.join(known)}")
        initial[name] = value = getattr(law, name)
        require(
            isinstance(value, float) and value > 0.0,
            f"{name} = {value}: is where the search begins; must be above 0",
        )
    return initial


def log_bounds(initial: dict, fields) -> np.ndarray:
    """Return the bounds of the constants, logarithms over their initial values, (2, constants)."""

    marks = "ge", "gt", "le", "lt"  # each number has one of the first two and one of the others
    found = [[getattr(it, m) for m in marks for it in notes(fields[name]) if hasattr(it, m)] for name in initial]
    return np.log(np.clip(np.transpose(found) / list(initial.values()), 1.0 / SEARCH_FACTOR, SEARCH_FACTOR))


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
    for each in curves:
        where, given = f"curve = {each.test.name}: ", each.test.settings
        both = sorted(given.keys() & {*settings, *initial, "until"})
        require(not both, f"{where}{''.join(both[:1])} is a column of it; must not be given, too")
        room = 4.0 * np.ptp(catalogue.build(scene, **settings | initial | given).domain, axis=0).max()
        largest = np.abs(each.values).max() * (unit_by_name(each.measure) == "m")  # beyond room a unit is missing
        require(
            largest <= room,
            f"{where}{each.measure} = {largest:g} m: must be at most {room:.2g} m, or have a unit, as in [cm]",
        )
    folder, report, spacing = out or Path("studies") / f"calibrate-{built.name}", watch or str, built.spacing
    coarse = COARSENING * spacing if finer else spacing
    runs = Runs(scene, curves, settings, initial, OFFSET in names, coarse, folder, report)
    offsets = np.outer([-10.0 * MAX_OFFSET, 10.0 * MAX_OFFSET], np.ones(len(runs.shifted)))
    bounds = np.hstack([log_bounds(initial, type(built.material).model_fields), offsets])
    unknowns = bounds.shape[1]
    require(points > unknowns, f"free = {free}: {unknowns} numbers; must be fewer than the measured points, {points}")
    start, _ = executor_of(executor, workers)
    with start() as runs.pool:
        if watch:
            likely = len(runs.tests) * (len(START_FACTORS) + 6 * (1 + 2 * len(initial)))
            cases = [runs.case(test, np.zeros(unknowns), coarse) for test in runs.tests]
            duration = in_time(wall_time(cases, workers or os.cpu_count() or 1, likely))
            finely = f", besides {3 * len(runs.tests)} at {spacing:g} m" * finer
            report(f"some {likely} runs at a spacing of {coarse:g} m, about {duration}{finely}")
        return fit_result(runs, built.material, spacing, bounds, *search(runs, spacing, bounds))


def search(runs: Runs, spacing, bounds) -> tuple[np.ndarray, ResponseSurface, np.ndarray, np.ndarray]:
    """Return the best point within bounds, (2, unknowns), by coarse runs, corrected by finer ones of a ``spacing`` [m],
    the regression near it, and derivatives of the residuals: by the regression, (points, unknowns), and to both sides
    between runs, (2, points, unknowns), nan where a run failed."""
    from scipy.optimize import least_squares

    count, scaled = len(runs.initial), [name != "flow_index" for name in runs.initial] + [False] * len(runs.shifted)
    starts = np.clip(np.outer(np.log(START_FACTORS), scaled), *bounds)
    begun = zip(starts, runs.compute(starts, runs.coarse), strict=True)
    at, _ = min(runs.done.values() or begun, key=lambda run: np.sum(runs.residuals(*run) ** 2))
    are_constants, unknown = np.arange(len(at)) < count, np.full(len(runs.measured), np.nan)
    steps = np.diag(np.where(are_constants, RUN_STEP, DIFFERENCE_STEP))
    for is_corrected, most, reach in ((False, MAX_ITERATIONS, 2.0), (runs.coarse > spacing, MAX_CORRECTIONS, 1.0)):
        last = np.inf
        for _ in range(most):
            centre, around = at, np.clip([at - steps, at + steps], *bounds)
            points = [at, *np.concatenate(around)]
            pairs = zip(points, runs.compute(points, runs.coarse), strict=True)
            here, *others = (runs.residuals(*pair) if are_done(pair[1]) else unknown for pair in pairs)
            sides = (np.reshape(others, (2, len(at), -1)) - here) / (around - at).sum(2)[..., None]
            surface = ResponseSurface(runs, at)
            runs.require_reached(at, surface.residuals(at) if here is unknown else here)
            if is_corrected:
                surface.correction = runs.residuals(at, runs.compute([at], spacing)[0]) - surface.residuals(at)
            before, reaches = np.sum(surface.residuals(at) ** 2), np.where(are_constants, reach * RUN_STEP, np.inf)
            found = least_squares(surface.residuals, at, bounds=np.clip([at - reaches, at + reaches], *bounds))
            at, error = found.x, RELATIVE_ERROR * np.sqrt(np.mean(found.fun**2))
            runs.report(
                f"{len(runs.planned)} runs, {runs.seconds:.1f} s each: {runs.describe(at)}: misses by {error:.2%}"
            )
            is_stalled = 2.0 * found.cost > 0.99 * before or abs(before - last) < 0.03 * last
            if np.abs(at - centre)[:count].max() < TOLERANCE or is_stalled:
                break
            last = before
    return at, surface, found.jac, np.swapaxes(sides, 1, 2)


def fit_result(runs: Runs, material, spacing, bounds, at, surface: ResponseSurface, slopes, side_slopes) -> CurveFit:
    """Return the result at a point, with intervals by the slopes, the residuals there and the scatter of the runs.

    The residuals of a curve are correlated: their variance is scaled by (1 + r)/(1 - r), r the correlation of
    neighbouring points. Each end of an interval uses the slope to its side where that is less than the central one;
    the prior, which stands for the bounds, narrows no interval.
    """
    from scipy.stats import t

    count, (rows,) = len(runs.initial), runs.compute([at], spacing)
    residuals = runs.residuals(at, rows)
    runs.require_reached(at, residuals)
    sum_of_squares, degrees_of_freedom = max(float(residuals @ residuals), 1e-12), len(residuals) - len(at)
    products = sum(float(part[1:] @ part[:-1]) for part in np.split(residuals, runs.curve_ends))
    correlation = np.clip(products / sum_of_squares, 0.0, 0.9)
    error = np.sqrt(sum_of_squares / degrees_of_freedom * (1.0 + correlation) / (1.0 - correlation))
    slopes, sides, noise = slopes / error, side_slopes / error, surface.scatter(at) / error
    prior = prior_of(bounds)

    def covariance(slopes):
        spread = np.linalg.inv(prior + slopes.T @ slopes)
        shifts = spread @ slopes.T @ noise.T  # of the best point, by the scatter of runs
        return spread + shifts @ shifts.T

    flattest = np.where(np.linalg.norm(sides, axis=1, keepdims=True) < np.linalg.norm(slopes, axis=0), sides, slopes)
    least, quantile = np.diag(prior), t.ppf(0.975, degrees_of_freedom)
    precisions = np.array([1.0 / np.diag(covariance(side)) - least for side in flattest])
    ends = at + quantile / np.sqrt(np.maximum(precisions, 0.01 * least)) * [[-1.0], [1.0]]
    constants = constants_of(runs.initial, at[:count], ends[:, :count], bounds[:, :count])
    spread, parts = quantile**2 * covariance(slopes), np.split(slopes, runs.curve_ends)
    offsets, widths = runs.offsets(at), runs.offsets(np.sqrt(np.diag(spread)))
    names = [f"{title(curve.measure)} of {curve.test.name}" for curve in runs.curves]
    return CurveFit(
        scene=runs.scene,
        material=material.model_copy(update={name: it.value for name, it in constants.items()}),
        constants=constants,
        offsets={test.name: (offset, widths[test]) for test, offset in offsets.items()},
        spread=spread[:count, :count],
        curves=[
            {"name": curve.test.name, "settings": curve.test.settings, "measure": curve.measure}
            | {"times": curve.times.tolist(), "measured": curve.values.tolist(), "model": model.tolist()}
            for curve, model in zip(runs.curves, runs.model(residuals), strict=True)
        ],
        worth=dict(zip(names, worth_of(runs.initial, prior, parts), strict=True)) if len(parts) > 1 else {},
        runs=len(runs.planned),
        cpu_seconds=sum(
            row.get(name) or 0.0 for row in runs.rows.values() for name in ("cpu_seconds", "compile_seconds")
        ),
    )
