"""Constants of a law from measured curves: least squares on the logarithms of the constants, by a regression over runs
of the scene near the best point; the regression averages their scatter."""

from functools import partial
from time import monotonic

import numpy as np

from ..engine import LAWS, Scene, numbers_of
from ..input import catalogue
from ..input.labels import in_words, is_measure, title, unit_of_measure
from ..report.sentences import duration_text
from ..units import notes, require, suggestion
from .calibration import rounded
from .case import Case, case_of, run_case
from .fit import constants_of, prior_of, worth_of
from .measured_curves import Curve, CurveFit, Test, measures_of, read_curves
from .sweep import executor_of, run_cases, wall_time

OFFSET = "time_offset"  # in ``free``: the unknown time [s] of the scene at the zero of a curve
MAX_OFFSET = 20.0  # largest offset over its unit, a fortieth of the duration of the curve
COARSENING = 2.0  # spacing of the runs of the fit over the scene's
SEARCH_FACTOR = 100.0  # largest factor between a constant and its initial value
START_FACTORS = 1.0, 0.1, 0.3, 3.0, 10.0  # of all constants at once, run first
RUN_STEP = 0.4  # of the logarithm of a constant, between runs; particles scatter more than smaller steps
RADIUS = 1.5 * RUN_STEP  # in the logarithms, within which runs enter the regression
RUN = partial(run_case, samples=100)  # of a case, to its end: its row, with that many values over time in ``course``
MAX_ITERATIONS, MAX_CORRECTIONS = 10, 2  # regressions by coarse runs, and by these and a finer one
TOLERANCE = 0.05  # change of the logarithms that ends them
RELATIVE_ERROR = 0.01  # of a point over the largest value of its measure: weighs measures of different units


class CurveRuns:
    """Runs of a scene beside measured curves, kept in the folder of a study.

    A point ``at`` holds the logarithms of the constants over their ``initial`` values, then the time of the scene at
    the zero of each test in ``shifted``, {test: unit of its offset [s]}, in that unit, within ``bounds``, (2,
    unknowns). Its runs are rows, one of the test of each curve; ``done`` holds the points whose runs have the spacing
    ``coarse`` [m] and came to their end, with these rows, by the key of the first. Residuals are those of all measured
    points: (computed - measured)/error.
    """

    def __init__(
        self, scene, settings: dict, initial: dict, bounds, curves: list[Curve], shifted, coarse, folder, report
    ):
        self.scene, self.settings, self.initial, self.bounds = scene, settings, initial, bounds
        self.curves, self.shifted, self.coarse, self.folder, self.report = curves, shifted, coarse, folder, report
        self.pool, self.start, self.planned, self.rows, self.done = None, monotonic(), {}, {}, {}
        self.curve_ends = np.cumsum([len(curve.values) for curve in curves])[:-1]  # in the residuals
        self.measures = np.concatenate([[curve.measure] * len(curve.values) for curve in curves])
        self.measured = np.concatenate([curve.values for curve in curves])
        largest = {name: np.abs(self.measured[self.measures == name]).max() or 1.0 for name in {*self.measures}}
        self.errors = RELATIVE_ERROR * np.array([largest[name] for name in self.measures])

    def mix(self, at) -> dict[str, float]:
        """Return the constants of a point, SI units, rounded to five figures, which identify a run."""
        return {
            name: float(f"{initial * factor:.5g}")
            for (name, initial), factor in zip(self.initial.items(), np.exp(at), strict=False)
        }

    def case(self, test: Test, at, spacing) -> Case:
        """Return the case of a test at a point and a spacing [m]."""
        until = {"until": float(test.times[-1] + MAX_OFFSET * self.shifted.get(test, 0.0))} if len(test.times) else {}
        return case_of(self.scene, **self.settings | test.settings | self.mix(at) | until | {"spacing": spacing})

    def compute(self, points, spacing) -> list[list[dict]]:
        """Return the rows of each point; runs that are new are carried out in parallel."""
        cases = [[self.case(curve.test, at, spacing) for curve in self.curves] for at in points]
        self.planned |= {each.key: each for some in cases for each in some}
        rows = run_cases(list(self.planned.values()), self.folder, RUN, self.pool)
        for row in (row for row in rows if row["status"] != "done" and row["key"] not in self.rows):
            self.report(f"a run {row['status']}: {row['reason']}")
        self.rows = {row["key"]: row for row in rows}
        found = [[self.rows[each.key] for each in some] for some in cases]
        self.done |= {
            rows[0]["key"]: (at, rows)
            for at, rows in zip(points, found, strict=True)
            if spacing == self.coarse and all(row["status"] == "done" for row in rows)
        }
        return found

    def residuals(self, at, rows) -> np.ndarray:
        """Return the residuals by the rows of a point, at the times of the curves with the offsets of a point, or at
        the end; SceneError where a run failed."""
        offsets = {
            test: unit * shift
            for (test, unit), shift in zip(self.shifted.items(), at[len(self.initial) :], strict=True)
        }
        found = []
        for curve, row in zip(self.curves, rows, strict=True):
            where, times = f"curve = {curve.test.name}: ", curve.times + offsets.get(curve.test, 0.0)
            require(row["status"] == "done", f"{where}a run {row['status']}: {row['reason']}")
            known = row["course"] if len(times) else row
            require(
                curve.measure in known,
                f"{where}the scene does not measure {curve.measure}; must be of {', '.join(filter(is_measure, known))}",
            )
            values = np.array(known[curve.measure], float)
            found.append(np.interp(times, known["time_s"], values) if len(times) else [values])
        return (np.concatenate(found) - self.measured) / self.errors


class ResponseSurface:
    """Residuals near a point as a smooth function of it, which averages the scatter of runs: a quadratic regression on
    the logarithms of the constants over the runs within RADIUS. Offsets of time need no runs. It begins with runs at
    the point and a step to each side. ``correction`` is added."""

    def __init__(self, runs: CurveRuns, centre):
        self.runs, self.count, self.centre, self.correction = runs, len(runs.initial), centre, 0.0
        steps = RUN_STEP * np.eye(len(centre))
        self.points = np.clip([centre, *(centre - steps), *(centre + steps)], *runs.bounds)
        self.rows = runs.compute(self.points, runs.coarse)
        near = [run for run in runs.done.values() if np.abs(run[0] - centre)[: self.count].max() <= RADIUS]
        points, self.near = zip(*near or [(centre, self.rows[0])], strict=True)  # which failed, and tells why
        self.terms = np.array([self.terms_at(at) for at in points])
        self.inverse = np.linalg.pinv(self.terms, rcond=1e-3)

    def terms_at(self, at) -> np.ndarray:
        """Return the terms of the quadratic at a point."""
        distances = (at - self.centre)[: self.count]
        return np.array([1.0, *distances, *np.outer(distances, distances)[np.triu_indices(self.count)]])

    def run_residuals(self, at) -> np.ndarray:
        """Return the residuals of the runs with the offsets of a point, (runs, points)."""
        return np.array([self.runs.residuals(at, rows) for rows in self.near])

    def residuals(self, at) -> np.ndarray:
        """Return the residuals at a point."""
        return self.terms_at(at) @ self.inverse @ self.run_residuals(at) + self.correction

    def sides(self) -> np.ndarray:
        """Return the derivatives of the residuals between the run at the centre and those to each side, (2, points,
        unknowns); nan where a run failed."""
        unknown, runs = np.full(len(self.runs.measured), np.nan), zip(self.points, self.rows, strict=True)
        found = [self.runs.residuals(*run) if run[1][0]["key"] in self.runs.done else unknown for run in runs]
        slopes = (np.array(found[1:]) - found[0]).T / (self.points[1:] - self.points[0]).sum(1)
        return np.stack(np.split(slopes, 2, axis=1))

    def scatter(self, at) -> np.ndarray:
        """Return errors of the residuals at a point by the scatter of runs, (runs, points), whose squares add up. A
        finer run that corrects the residuals scatters as much as one of the runs."""
        weights, found = self.terms_at(at) @ self.inverse, self.run_residuals(at)
        variance = weights @ weights + bool(np.ndim(self.correction))  # over that of a run
        freedom = max(len(self.terms) - np.linalg.matrix_rank(self.inverse), 1)  # degrees of it
        return (found - self.terms @ self.inverse @ found) * np.sqrt(variance / freedom)


def initial_values(scene: str, free: list[str], settings: dict) -> tuple[Scene, dict[str, float], np.ndarray]:
    """Return the scene with initial values of the free constants, as given or the law's, these, and the bounds of the
    logarithms over them, (2, constants); SceneError for what is no constant of it."""
    defaults = {name: number.default for law in reversed(LAWS) for name, number in numbers_of(law).items()}
    own = catalogue.build(scene, **settings).material
    built = catalogue.build(
        scene, **settings | {name: getattr(own, name, defaults[name]) for name in free if name in defaults}
    )
    initial, law = {name: getattr(built.material, name, None) for name in free}, type(built.material)
    for name, value in initial.items():
        require(
            name in numbers_of(law),
            f"free = {name}: is no constant of the law {law.__name__}, which the constants given choose"
            f"{suggestion(name, defaults.keys() - {name})}; must be of {', '.join(numbers_of(law))}",
        )
        require(
            isinstance(value, float) and value > 0.0,
            f"{name} = {value}: is where the search begins; must be above 0",
        )
    found = [  # a number has one of the first two bounds and one of the others
        [
            getattr(it, name)
            for name in ("ge", "gt", "le", "lt")
            for it in notes(numbers_of(law)[each])
            if hasattr(it, name)
        ]
        for each in initial
    ]
    bounds = np.clip(np.transpose(found) / list(initial.values()), 1.0 / SEARCH_FACTOR, SEARCH_FACTOR)
    return built, initial, np.log(bounds)


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
    built, initial, bounds = initial_values(scene, [name for name in names if name != OFFSET], settings)
    require(initial, f"free = {free}: must be a constant of the law or more, such as yield_value,plastic_viscosity")
    keywords, given = catalogue.load(scene).parameters.model_fields, [*settings, *initial, "until"]
    paths, measures = [path.strip() for path in curve.split(",")], measures_of(built)
    curves = [each for path in paths for each in read_curves(path, keywords, measures, given)]
    tests = list(dict.fromkeys(each.test for each in curves))
    shifted = {test: 0.025 * float(np.ptp(test.times)) for test in tests if OFFSET in names and len(test.times)}
    points, least = sum(len(each.values) for each in curves), max(5, 1 + len(initial) + len(shifted))
    require(points >= least, f"curve = {curve}: holds {points} points; must be at least {least}")
    for each in (each for each in curves if unit_of_measure(each.measure)[1] == "cm"):  # beyond room a unit is missing
        room = 4.0 * np.ptp(catalogue.build(scene, **settings | initial | each.test.settings).domain, axis=0).max()
        largest = np.abs(each.values).max()
        require(
            largest <= room,
            f"curve = {each.test.name}: {each.measure} = {largest:g} m: must be at most {room:.2g} m, or have a unit, "
            "as in [cm]",
        )
    bounds = np.hstack([bounds, MAX_OFFSET * np.outer([-1.0, 1.0], np.ones(len(shifted)))])
    coarse, report = (COARSENING if finer else 1.0) * built.spacing, watch or str
    runs = CurveRuns(scene, settings, initial, bounds, curves, shifted, coarse, out, report)
    start, at_once = executor_of(executor, workers)
    likely = len(tests) * (len(START_FACTORS) + 6 * (1 + 2 * len(initial)))
    duration = wall_time([runs.case(test, np.zeros(bounds.shape[1]), coarse) for test in tests], at_once or 1, likely)
    report(
        f"some {likely} runs at a spacing of {coarse:g} m, about {duration_text(duration)}"
        + (f", besides {3 * len(tests)} at {built.spacing:g} m" if finer else "")
    )
    with start() as runs.pool:
        return fit_result(runs, built.material, built.spacing, *search(runs, built.spacing))


def search(runs: CurveRuns, spacing) -> tuple[np.ndarray, np.ndarray, ResponseSurface]:
    """Return the best point by coarse runs, corrected by finer ones of a ``spacing`` [m], the derivatives of the
    residuals there, (points, unknowns), and the regression near it."""
    from scipy.optimize import least_squares

    are_constants = np.arange(runs.bounds.shape[1]) < len(runs.initial)
    scaled = [name != "flow_index" for name in runs.initial] + [False] * len(runs.shifted)
    starts = np.clip(np.outer(np.log(START_FACTORS), scaled), *runs.bounds)
    runs.compute(starts, runs.coarse)
    at, _ = min(runs.done.values(), key=lambda run: np.sum(runs.residuals(*run) ** 2), default=(starts[0], None))
    for is_corrected, most, steps in ((False, MAX_ITERATIONS, 2.0), (runs.coarse > spacing, MAX_CORRECTIONS, 1.0)):
        before, radius = np.inf, np.where(are_constants, steps * RUN_STEP, np.inf)
        for _ in range(most):
            surface = ResponseSurface(runs, at)
            if is_corrected:
                surface.correction = runs.residuals(at, *runs.compute([at], spacing)) - surface.residuals(at)
            last, before = before, np.sum(surface.residuals(at) ** 2)
            found = least_squares(surface.residuals, at, bounds=np.clip([at - radius, at + radius], *runs.bounds))
            moved, at = np.abs(found.x - at)[are_constants].max(), found.x
            mix = ", ".join(f"{in_words(name)} {rounded(value)}" for name, value in runs.mix(at).items())
            runs.report(
                f"{len(runs.planned)} runs, {(monotonic() - runs.start) / len(runs.planned):.1f} s each: "
                f"{mix}: misses by {RELATIVE_ERROR * np.sqrt(np.mean(found.fun**2)):.2%}"
            )
            if moved < TOLERANCE or 2.0 * found.cost > 0.99 * before or abs(before - last) < 0.03 * last:
                break
    return at, found.jac, surface


def fit_result(runs: CurveRuns, material, spacing, at, slopes, surface: ResponseSurface) -> CurveFit:
    """Return the result at a point, with intervals by the slopes, the residuals there and the scatter of the runs.

    The residuals of a curve are correlated: their variance is scaled by (1 + r)/(1 - r), r the correlation of
    neighbouring points. Each end of an interval uses the slope to its side where that is less than the central one;
    the prior, which stands for the bounds, narrows no interval.
    """
    from scipy.stats import t

    count, prior, residuals = len(runs.initial), prior_of(runs.bounds), runs.residuals(at, *runs.compute([at], spacing))
    parts, degrees_of_freedom = np.split(residuals, runs.curve_ends), len(residuals) - len(at)
    sum_of_squares = max(float(residuals @ residuals), 1e-12)
    correlation = np.clip(sum(part[1:] @ part[:-1] for part in parts) / sum_of_squares, 0.0, 0.9)
    error = np.sqrt(sum_of_squares / degrees_of_freedom * (1.0 + correlation) / (1.0 - correlation))
    slopes, sides, noise = slopes / error, surface.sides() / error, surface.scatter(at) / error

    def covariance(slopes):
        inverse = np.linalg.inv(prior + slopes.T @ slopes)
        # the last: of the best point by the scatter of runs
        return inverse + inverse @ slopes.T @ noise.T @ noise @ slopes @ inverse

    flattest = np.where(np.linalg.norm(sides, axis=1, keepdims=True) < np.linalg.norm(slopes, axis=0), sides, slopes)
    least, quantile = np.diag(prior), t.ppf(0.975, degrees_of_freedom)
    precisions = np.array([1.0 / np.diag(covariance(side)) - least for side in flattest])
    ends = at + quantile / np.sqrt(np.maximum(precisions, 0.01 * least)) * [[-1.0], [1.0]]
    constants = constants_of(runs.initial, at[:count], ends[:, :count], runs.bounds[:, :count])
    spread, worth = quantile**2 * covariance(slopes), worth_of(runs.initial, prior, np.split(slopes, runs.curve_ends))
    widths = np.sqrt(np.diag(spread))[count:]
    return CurveFit(
        scene=runs.scene,
        material=material.model_copy(update={name: it.value for name, it in constants.items()}),
        constants=constants,
        offsets={
            test.name: (float(unit * offset), float(unit * by))
            for (test, unit), offset, by in zip(runs.shifted.items(), at[count:], widths, strict=True)
        },
        spread=spread[:count, :count],
        missed={
            name: float(RELATIVE_ERROR * np.sqrt(np.mean(residuals[runs.measures == name] ** 2)))
            for name in dict.fromkeys(curve.measure for curve in runs.curves)
        },
        curves=[
            {"name": curve.test.name, "settings": curve.test.settings, "measure": curve.measure}
            | {"times": curve.times.tolist(), "measured": curve.values.tolist(), "model": model.tolist()}
            for curve, model in zip(
                runs.curves, np.split(runs.measured + runs.errors * residuals, runs.curve_ends), strict=True
            )
        ],
        worth={
            f"{title(curve.measure)} of {curve.test.name}": each
            for curve, each in zip(runs.curves, worth, strict=True)
            if len(parts) > 1
        },
        runs=len(runs.planned),
        cpu_seconds=sum(
            row.get(name) or 0.0 for row in runs.rows.values() for name in ("cpu_seconds", "compile_seconds")
        ),
    )
