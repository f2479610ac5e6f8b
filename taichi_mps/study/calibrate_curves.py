"""Constants of a law from measured curves: least squares on the logarithms of the constants, by a regression over runs
of the scene near the best point; the regression averages their scatter."""

from functools import partial
from itertools import combinations_with_replacement
from time import monotonic

import numpy as np

from ..engine import LAWS, Scene, numbers_of
from ..input import catalogue
from ..input.labels import in_words, is_measure, title, written
from ..report.sentences import duration_text
from ..units import notes, require, suggestion
from .calibration import rounded
from .case import Case, case, run
from .curves import Curve, CurveFit, Test, measures_of, read_curves, stem_and_unit
from .fit import DIFFERENCE_STEP, constants_of, prior_of, worth_of
from .sweep import executor_of, run_cases, wall_time

OFFSET = "time_offset"  # in ``free``: the unknown time [s] of the scene at the zero of a curve
MAX_OFFSET = 0.5  # largest offset over the duration of the curve
SAMPLES = 100  # of a curve of a run
COARSENING = 2.0  # spacing of the runs of the fit over the scene's
SEARCH_FACTOR = 100.0  # largest factor between a constant and its initial value
START_FACTORS = 1.0, 0.1, 0.3, 3.0, 10.0  # of all constants at once, run first
RUN_STEP = 0.4  # of the logarithm of a constant, between runs; particles scatter more than smaller steps
RADIUS = 1.5 * RUN_STEP  # in the logarithms, within which runs enter the regression
RUN = partial(run, samples=SAMPLES)  # of a case, to its end: its row, with its measures over time in ``course``
MAX_ITERATIONS, MAX_CORRECTIONS = 10, 2  # regressions by coarse runs, and by these and a finer one
TOLERANCE = 0.05  # change of the logarithms that ends them
RELATIVE_ERROR = 0.01  # of a point over the largest value of its measure: weighs measures of different units
MAX_DISTANCE = 0.1  # of points beyond all runs, over the largest value of their measure


class Runs:
    """Runs of a scene beside measured curves, kept in the folder of a study.

    A point ``at`` holds the logarithms of the constants over their ``initial`` values, then the time of the scene at
    the zero of each ``shifted`` test over a tenth of the test's duration, within ``bounds``, (2, unknowns). ``done``
    holds the points whose runs have the spacing ``coarse`` [m] and came to their end, with their rows by test.
    Residuals are those of all measured points: (computed - measured)/error.
    """

    def __init__(
        self, scene, settings: dict, initial: dict, bounds, curves: list[Curve], shifted, coarse, folder, report
    ):
        self.scene, self.settings, self.initial, self.bounds = scene, settings, initial, bounds
        self.curves, self.shifted, self.coarse, self.folder, self.report = curves, shifted, coarse, folder, report
        self.pool, self.start, self.planned, self.rows, self.done = None, monotonic(), {}, {}, {}
        self.tests = list(dict.fromkeys(curve.test for curve in curves))
        lengths = [len(curve.values) for curve in curves]
        self.curve_ends = np.cumsum(lengths)[:-1]  # in the residuals
        self.measures = np.repeat([curve.measure for curve in curves], lengths)
        self.measured = np.concatenate([curve.values for curve in curves])
        largest = {name: np.abs(self.measured[self.measures == name]).max() or 1.0 for name in {*self.measures}}
        self.errors = RELATIVE_ERROR * np.array([largest[name] for name in self.measures])

    def mix(self, at) -> dict[str, float]:
        """Return the constants of a point, SI units, rounded to five figures, which identify a run."""
        return {
            name: float(f"{initial * factor:.5g}")
            for (name, initial), factor in zip(self.initial.items(), np.exp(at), strict=False)
        }

    def offsets(self, at) -> dict[Test, float]:
        """Return the time [s] of the scene at the zero of each shifted test."""
        return {
            test: 0.1 * float(np.ptp(test.times) * offset)
            for test, offset in zip(self.shifted, at[len(self.initial) :], strict=True)
        }

    def case(self, test: Test, at, spacing) -> Case:
        """Return the case of a test at a point and a spacing [m]."""
        margin = MAX_OFFSET * np.ptp(test.times) if test in self.shifted else 0.0
        until = {"until": float(test.times[-1] + margin)} if len(test.times) else {}
        return case(self.scene, **self.settings | test.settings | self.mix(at) | until | {"spacing": spacing})

    def compute(self, points, spacing) -> list[dict[Test, dict]]:
        """Return the rows of the tests at each point; runs that are new are carried out in parallel."""
        cases = [{test: self.case(test, at, spacing) for test in self.tests} for at in points]
        before = len(self.planned)
        self.planned |= {each.key: each for some in cases for each in some.values()}
        if len(self.planned) > before:
            rows = run_cases(list(self.planned.values()), self.folder, RUN, self.pool)
            for row in (row for row in rows[before:] if row["status"] != "done"):
                self.report(f"a run {row['status']}: {row['reason']}")
            self.rows = {row["key"]: row for row in rows}
        found = [{test: self.rows[each.key] for test, each in some.items()} for some in cases]
        if spacing == self.coarse:
            self.done |= {
                tuple(self.mix(at).values()): (at, rows)
                for at, rows in zip(points, found, strict=True)
                if are_done(rows)
            }
        return found

    def residuals(self, at, rows) -> np.ndarray:
        """Return the residuals by rows of the tests, at the times of the curves with the offsets of a point, or at the
        end; SceneError where a run failed."""
        found, offsets = [], self.offsets(at)
        for curve in self.curves:
            test, name, row = curve.test, curve.measure, rows[curve.test]
            require(row["status"] == "done", f"curve = {test.name}: a run {row['status']}: {row['reason']}")
            values, times = row["course"] if len(test.times) else row, curve.times + offsets.get(test, 0.0)
            require(
                name in values,
                f"curve = {test.name}: the scene does not measure {name}; must be of "
                f"{', '.join(filter(is_measure, values))}",
            )
            value = np.array(values[name], float, ndmin=1)
            found.append(np.interp(times, values["time_s"], value) if len(times) else value)
        return (np.concatenate(found) - self.measured) / self.errors

    def model(self, residuals) -> list[np.ndarray]:
        """Return the values of each curve that have these residuals."""
        return np.split(self.measured + self.errors * residuals, self.curve_ends)

    def require_reached(self, at, residuals) -> None:
        """Raise SceneError, with the residuals at a point, where over a quarter of a curve's points lie beyond all
        runs."""
        found = np.array([self.residuals(at, rows) for _, rows in self.done.values()])
        beyond = np.maximum(found.min(0), -found.max(0)) > MAX_DISTANCE / RELATIVE_ERROR
        parts = zip(self.curves, np.split(beyond, self.curve_ends), self.model(residuals), strict=True)
        for curve, are_beyond, model in parts:
            measured, nearest = (written(curve.measure, float(values[-1])) for values in (curve.values, model))
            require(
                np.mean(are_beyond) <= 0.25,
                f"curve = {curve.test.name}: no run comes to it, its {title(curve.measure)} ends at {measured}, that "
                f"of the nearest run at {nearest}, {self.describe(at)}",
            )

    def describe(self, at) -> str:
        """Format the constants of a point."""
        return ", ".join(f"{in_words(name)} {rounded(value)}" for name, value in self.mix(at).items())


def are_done(rows: dict) -> bool:
    """Whether the runs of all tests at a point came to their end."""
    return all(row["status"] == "done" for row in rows.values())


class ResponseSurface:
    """Residuals near a point as a smooth function of it, which averages the scatter of runs: a quadratic regression on
    the logarithms of the constants over the runs within RADIUS. Offsets of time need no runs. It begins with runs at
    the point and a step to each side. ``correction`` is added."""

    def __init__(self, runs: Runs, centre):
        self.runs, self.centre, self.correction = runs, centre[: len(runs.initial)], 0.0
        steps = np.diag([RUN_STEP] * len(runs.initial) + [DIFFERENCE_STEP] * len(runs.shifted))
        self.points = np.clip([centre, *(centre - steps), *(centre + steps)], *runs.bounds)
        self.rows = runs.compute(self.points, runs.coarse)
        near = [
            (self.terms_at(at), rows)
            for at, rows in runs.done.values()
            if np.abs(at - centre)[: len(self.centre)].max() <= RADIUS
        ] or [(self.terms_at(centre), self.rows[0])]  # which failed, and tells why
        self.terms, self.near = np.array([terms for terms, _ in near]), [rows for _, rows in near]
        self.inverse = np.linalg.pinv(self.terms, rcond=1e-3)

    def terms_at(self, at) -> np.ndarray:
        """Return the terms of the quadratic at a point."""
        distances = at[: len(self.centre)] - self.centre
        return np.array([1.0, *distances, *(a * b for a, b in combinations_with_replacement(distances, 2))])

    def run_residuals(self, at) -> np.ndarray:
        """Return the residuals of the runs with the offsets of a point, (runs, points)."""
        return np.array([self.runs.residuals(at, rows) for rows in self.near])

    def residuals(self, at) -> np.ndarray:
        """Return the residuals at a point."""
        return self.terms_at(at) @ self.inverse @ self.run_residuals(at) + self.correction

    def sides(self) -> np.ndarray:
        """Return the derivatives of the residuals between the run at the centre and those to each side, (2, points,
        unknowns); nan where a run failed."""
        pairs, unknown = zip(self.points, self.rows, strict=True), np.full(len(self.runs.measured), np.nan)
        here, *beside = (self.runs.residuals(*pair) if are_done(pair[1]) else unknown for pair in pairs)
        slopes = (np.array(beside) - here).T / (self.points[1:] - self.points[0]).sum(1)
        return np.stack(np.split(slopes, 2, axis=1))

    def scatter(self, at) -> np.ndarray:
        """Return errors of the residuals at a point by the scatter of runs, (runs, points), whose squares add up. A
        finer run that corrects the residuals scatters as much as one of the runs."""
        found, weights = self.run_residuals(at), self.terms_at(at) @ self.inverse
        variance = weights @ weights + bool(np.ndim(self.correction))  # over that of a run
        freedom = max(len(self.terms) - np.linalg.matrix_rank(self.inverse), 1)  # degrees of it
        return (found - self.terms @ self.inverse @ found) * np.sqrt(variance / freedom)


def initial_values(scene: str, free: list[str], settings: dict) -> tuple[Scene, dict[str, float]]:
    """Return the scene with initial values of the free constants, as given or the law's, and these; SceneError for what
    is no constant of it."""
    defaults = {name: number.default for law in reversed(LAWS) for name, number in numbers_of(law).items()}
    for name in free:
        require(
            name in defaults,
            f"free = {name}: is no constant of a law{suggestion(name, defaults)}; must be of {', '.join(defaults)}",
        )
    own = catalogue.build(scene, **settings).material
    built = catalogue.build(scene, **settings | {name: getattr(own, name, defaults[name]) for name in free})
    initial, law = {name: getattr(built.material, name, None) for name in free}, type(built.material)
    for name, value in initial.items():
        require(
            name in numbers_of(law),
            f"free = {name}: the law {law.__name__}, which the constants given choose, has only "
            f"{', '.join(numbers_of(law))}",
        )
        require(
            isinstance(value, float) and value > 0.0,
            f"{name} = {value}: is where the search begins; must be above 0",
        )
    return built, initial


def bounds_of(initial: dict, fields, offsets: int) -> np.ndarray:
    """Return the bounds of a point: of the constants by the fields of the law, and of a number of offsets."""
    marks = "ge", "gt", "le", "lt"  # each number has one of the first two and one of the others
    found = [[getattr(it, m) for m in marks for it in notes(fields[name]) if hasattr(it, m)] for name in initial]
    constants = np.clip(np.transpose(found) / list(initial.values()), 1.0 / SEARCH_FACTOR, SEARCH_FACTOR)
    return np.hstack([np.log(constants), np.outer([-10.0 * MAX_OFFSET, 10.0 * MAX_OFFSET], np.ones(offsets))])


def calibrate_curves(
    scene: str, curve: str, free: str, out, executor="local", workers=None, finer=True, watch=None, **settings
) -> CurveFit:
    """Fit the constants of a law to measured curves.

    curve: CSV files, separated by commas; free: names of constants of the law, and OFFSET for an unknown time offset of
    each curve; out: folder of the study, which is resumed; finer: whether runs at the scene's spacing correct those of
    the fit, at twice that; watch: is called with lines of progress; settings: keywords of the scene. SceneError for
    invalid input.
    """
    names = [name.strip().replace("-", "_").replace("yield_stress", "yield_value") for name in free.split(",")]
    built, initial = initial_values(scene, [name for name in names if name != OFFSET], settings)
    require(initial, f"free = {free}: must be a constant of the law or more, such as yield_value,plastic_viscosity")
    keywords, given = catalogue.load(scene).parameters.model_fields, [*settings, *initial, "until"]
    paths, measures = [path.strip() for path in curve.split(",")], measures_of(built)
    curves = [each for path in paths for each in read_curves(path, keywords, measures, given)]
    shifted = [test for test in dict.fromkeys(each.test for each in curves) if OFFSET in names and len(test.times)]
    points, least = sum(len(each.values) for each in curves), max(5, 1 + len(initial) + len(shifted))
    require(points >= least, f"curve = {curve}: holds {points} points; must be at least {least}")
    for each in curves:
        room = 4.0 * np.ptp(catalogue.build(scene, **settings | initial | each.test.settings).domain, axis=0).max()
        largest = np.abs(each.values).max() * (stem_and_unit(each.measure)[1] == "m")  # beyond room a unit is missing
        require(
            largest <= room,
            f"curve = {each.test.name}: {each.measure} = {largest:g} m: must be at most {room:.2g} m, or have a unit, "
            "as in [cm]",
        )
    spacing, bounds = built.spacing, bounds_of(initial, type(built.material).model_fields, len(shifted))
    coarse = COARSENING * spacing if finer else spacing
    runs = Runs(scene, settings, initial, bounds, curves, shifted, coarse, out, watch or str)
    start, at_once = executor_of(executor, workers)
    with start() as runs.pool:
        if watch:
            likely = len(runs.tests) * (len(START_FACTORS) + 6 * (1 + 2 * len(initial)))
            cases = [runs.case(test, np.zeros(bounds.shape[1]), coarse) for test in runs.tests]
            duration = duration_text(wall_time(cases, at_once or 1, likely))
            finely = f", besides {3 * len(runs.tests)} at {spacing:g} m" * finer
            watch(f"some {likely} runs at a spacing of {coarse:g} m, about {duration}{finely}")
        return fit_result(runs, built.material, spacing, *search(runs, spacing))


def search(runs: Runs, spacing) -> tuple[np.ndarray, np.ndarray, ResponseSurface]:
    """Return the best point by coarse runs, corrected by finer ones of a ``spacing`` [m], the derivatives of the
    residuals there, (points, unknowns), and the regression near it."""
    from scipy.optimize import least_squares

    count, scaled = len(runs.initial), [name != "flow_index" for name in runs.initial] + [False] * len(runs.shifted)
    starts = np.clip(np.outer(np.log(START_FACTORS), scaled), *runs.bounds)
    runs.compute(starts, runs.coarse)
    at, _ = min(runs.done.values(), key=lambda run: np.sum(runs.residuals(*run) ** 2), default=(starts[0], None))
    for is_corrected, most, steps in ((False, MAX_ITERATIONS, 2.0), (runs.coarse > spacing, MAX_CORRECTIONS, 1.0)):
        before, radius = np.inf, np.where(np.arange(len(at)) < count, steps * RUN_STEP, np.inf)
        for _ in range(most):
            surface = ResponseSurface(runs, at)
            runs.require_reached(at, surface.residuals(at))
            if is_corrected:
                surface.correction = runs.residuals(at, runs.compute([at], spacing)[0]) - surface.residuals(at)
            last, before = before, np.sum(surface.residuals(at) ** 2)
            found = least_squares(surface.residuals, at, bounds=np.clip([at - radius, at + radius], *runs.bounds))
            moved, at = np.abs(found.x - at)[:count].max(), found.x
            runs.report(
                f"{len(runs.planned)} runs, {(monotonic() - runs.start) / len(runs.planned):.1f} s each: "
                f"{runs.describe(at)}: misses by {RELATIVE_ERROR * np.sqrt(np.mean(found.fun**2)):.2%}"
            )
            if moved < TOLERANCE or 2.0 * found.cost > 0.99 * before or abs(before - last) < 0.03 * last:
                break
    return at, found.jac, surface


def fit_result(runs: Runs, material, spacing, at, slopes, surface: ResponseSurface) -> CurveFit:
    """Return the result at a point, with intervals by the slopes, the residuals there and the scatter of the runs.

    The residuals of a curve are correlated: their variance is scaled by (1 + r)/(1 - r), r the correlation of
    neighbouring points. Each end of an interval uses the slope to its side where that is less than the central one;
    the prior, which stands for the bounds, narrows no interval.
    """
    from scipy.stats import t

    count, (rows,) = len(runs.initial), runs.compute([at], spacing)
    residuals, prior = runs.residuals(at, rows), prior_of(runs.bounds)
    runs.require_reached(at, residuals)
    sum_of_squares, degrees_of_freedom = max(float(residuals @ residuals), 1e-12), len(residuals) - len(at)
    products = sum(float(part[1:] @ part[:-1]) for part in np.split(residuals, runs.curve_ends))
    correlation = np.clip(products / sum_of_squares, 0.0, 0.9)
    error = np.sqrt(sum_of_squares / degrees_of_freedom * (1.0 + correlation) / (1.0 - correlation))
    slopes, sides, noise = slopes / error, surface.sides() / error, surface.scatter(at) / error

    def covariance(slopes):
        spread = np.linalg.inv(prior + slopes.T @ slopes)
        return spread + spread @ slopes.T @ noise.T @ noise @ slopes @ spread  # the best point's by the scatter of runs

    flattest = np.where(np.linalg.norm(sides, axis=1, keepdims=True) < np.linalg.norm(slopes, axis=0), sides, slopes)
    least, quantile = np.diag(prior), t.ppf(0.975, degrees_of_freedom)
    precisions = np.array([1.0 / np.diag(covariance(side)) - least for side in flattest])
    ends = at + quantile / np.sqrt(np.maximum(precisions, 0.01 * least)) * [[-1.0], [1.0]]
    constants = constants_of(runs.initial, at[:count], ends[:, :count], runs.bounds[:, :count])
    spread, parts = quantile**2 * covariance(slopes), np.split(slopes, runs.curve_ends)
    offsets, widths = runs.offsets(at), runs.offsets(np.sqrt(np.diag(spread)))
    return CurveFit(
        scene=runs.scene,
        material=material.model_copy(update={name: it.value for name, it in constants.items()}),
        constants=constants,
        offsets={test.name: (offset, widths[test]) for test, offset in offsets.items()},
        spread=spread[:count, :count],
        missed={
            name: float(RELATIVE_ERROR * np.sqrt(np.mean(residuals[runs.measures == name] ** 2)))
            for name in dict.fromkeys(curve.measure for curve in runs.curves)
        },
        curves=[
            {"name": curve.test.name, "settings": curve.test.settings, "measure": curve.measure}
            | {"times": curve.times.tolist(), "measured": curve.values.tolist(), "model": model.tolist()}
            for curve, model in zip(runs.curves, runs.model(residuals), strict=True)
        ],
        worth={
            f"{title(curve.measure)} of {curve.test.name}": worth
            for curve, worth in zip(runs.curves, worth_of(runs.initial, prior, parts), strict=True)
            if len(parts) > 1
        },
        runs=len(runs.planned),
        cpu_seconds=sum(
            row.get(name) or 0.0 for row in runs.rows.values() for name in ("cpu_seconds", "compile_seconds")
        ),
    )
