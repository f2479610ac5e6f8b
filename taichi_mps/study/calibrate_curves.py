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
from .calibration import short
from .case import case
from .case import run as run_case
from .curves import Curve, CurveFit, Test, measures_of, of_files
from .fit import FAILED, STEP, LeastSquares
from .surface import WIDE, Surface
from .sweep import carry_out, executor_of, wall_time

OFFSET = "time_offset"  # in ``free``: the unknown time [s] of the scene at the zero of a curve
LATE = 0.5  # largest such time over the length of the curve
SAMPLES = 100  # of a curve of a run
COARSER = 2.0  # spacing of the runs of the fit over that of those that correct them
RANGE = 100.0  # factor from the first value of a constant within which it is sought
LOOKS = 4  # first runs, in which all constants are made larger or smaller together
MOST, ENOUGH = 10, 0.05  # steps of the search, and the change of the logarithms that ends it
ERROR = 0.01  # of a point over the largest value of its measure: weighs measures of different units
OUTSIDE = 0.1  # of the largest value, by which points may lie beyond all runs


def course(case):
    """A case to its end, as ``run``, with its measures over time in ``course``, {name: values}."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "volume_error_max")  # coarse runs are corrected by finer ones
        return run_case(case, SAMPLES)


class Runs(LeastSquares):
    """Runs of a scene beside measured curves, kept in the folder of a study.

    A point ``at`` is the logarithms of the constants over their ``first`` values, then, with ``offsets``, the time of
    the scene at the zero of each test in units of a tenth of its length. Runs of the fit have a ``spacing`` [m];
    ``shift`` is added to their residuals, and their mixes are in ``known``.
    """

    def __init__(
        self, scene: str, curves: list[Curve], settings: dict, first: dict, ends, offsets: bool, spacing: float
    ):
        self.scene, self.curves, self.settings, self.first = scene, curves, settings, first
        self.folder, self.pool, self.seconds = None, None, 0.0  # of the study, its executor, of a run
        self.spacing, self.shift = spacing, 0.0
        self.cases, self.planned, self.rows, self.known = {}, {}, {}, {}
        self.tests = list(dict.fromkeys(curve.test for curve in curves))
        shifted = [test for test in self.tests if offsets and len(test.times)]
        self.places = {test: number for number, test in enumerate(shifted, len(first))}  # in a point
        self.units = np.array([0.1 * np.ptp(test.times) for test in shifted])  # of the offsets [s]
        alike = [np.concatenate([it.values for it in curves if it.measure == curve.measure]) for curve in curves]
        self.errors = [ERROR * (float(np.abs(values).max()) or 1.0) for values in alike]
        self.edges = np.cumsum([len(curve.values) for curve in curves])  # of the curves in the residuals
        self.reach = np.inf, -np.inf  # least and largest residual of each point so far
        super().__init__(first, np.hstack([ends, np.outer([-10.0, 10.0], np.full(len(shifted), LATE))]))

    def mix(self, at) -> dict[str, float]:
        """Constants of a point, SI units, of five figures: runs are known by them."""
        values = zip(self.first.items(), at[: len(self.first)], strict=True)
        return {name: float(f"{value * np.exp(by):.5g}") for (name, value), by in values}

    def late(self, at, test: Test) -> float:
        """Time [s] of the scene at the zero of a test."""
        place = self.places.get(test)
        return 0.0 if place is None else at[place] * self.units[place - len(self.first)]

    def case(self, test: Test, at, spacing):
        """The run of a test at a point and a spacing [m]."""
        mix = self.mix(at)
        name = test, spacing, *mix.values()
        if name not in self.cases:
            past = LATE * np.ptp(test.times) if test in self.places else 0.0
            until = {"until": float(test.times[-1] + past)} if len(test.times) else {}
            keywords = self.settings | test.settings | mix | until | {"spacing": spacing}
            self.cases[name] = case(self.scene, **keywords)
        return self.cases[name]

    def compute(self, points, spacing) -> None:
        """Compute what is not there yet of these points, side by side."""
        asked = [self.case(test, at, spacing) for at in points for test in self.tests]
        begun, new = monotonic(), [each for each in asked if each.key not in self.planned]
        self.planned |= {each.key: each for each in asked}
        if new:
            rows = carry_out(list(self.planned.values()), self.folder, course, self.pool)
            self.rows = {row["key"]: row for row in rows}
            self.seconds = (monotonic() - begun) / len(new)
        for at in points:
            keys = [self.case(test, at, spacing).key for test in self.tests]
            if spacing == self.spacing and all(self.rows[key]["status"] == "done" for key in keys):
                self.known[tuple(self.mix(at).values())] = at[: len(self.first)]

    def model(self, at, spacing) -> list[np.ndarray]:
        """Values of each curve by runs, at its times, or at the end; SceneError where one failed."""
        self.compute([at], spacing)
        found = []
        for curve in self.curves:
            test, name, row = curve.test, curve.measure, self.rows[self.case(curve.test, at, spacing).key]
            require(row["status"] == "done", f"curve = {test.name}: a run {row['status']}: {row['reason']}")
            values = row["course"] if len(test.times) else row
            known = ", ".join(filter(is_measure, values))
            require(name in values, f"curve = {test.name}: the scene does not measure {name}; must be of {known}")
            value = np.atleast_1d(np.array(values[name], float))
            found.append(
                np.interp(curve.times + self.late(at, test), values["time_s"], value) if len(test.times) else value
            )
        return found

    def beside(self, at, spacing) -> np.ndarray:
        """Model less measured over the error, of all points that were measured, by runs of a spacing [m]."""
        known = zip(self.model(at, spacing), self.curves, self.errors, strict=True)
        found = np.concatenate([(model - curve.values) / error for model, curve, error in known])
        self.reach = np.fmin(self.reach[0], found), np.fmax(self.reach[1], found)
        return found

    def residuals(self, at) -> np.ndarray:
        """Model less measured over the error, of all points that were measured, corrected."""
        return self.beside(at, self.spacing) + self.shift

    def by_curve(self, values) -> list[np.ndarray]:
        """Values of all points, such as residuals, of each curve."""
        return np.split(values, self.edges[:-1])

    def require_reached(self, at) -> None:
        """SceneError where a quarter of a curve's points lie beyond all runs, with what the run at a point says."""
        beyond = self.by_curve(np.maximum(self.reach[0], -self.reach[1]) > OUTSIDE / ERROR)
        for curve, model, part in zip(self.curves, self.model(at, self.spacing), beyond, strict=True):
            measured, nearest = (written(curve.measure, float(values[-1])) for values in (curve.values, model))
            require(
                np.mean(part) <= 0.25,
                f"curve = {curve.test.name}: no run comes to it, its {title(curve.measure)} ends at {measured}, that "
                f"of the nearest run at {nearest}, {self.words(at)}",
            )

    def sided(self, at) -> np.ndarray:
        """Derivatives of the residuals at a point, (2, points, unknowns), to both sides: by WIDE in the logarithm of a
        constant, by STEP in an offset. Runs are computed side by side."""
        steps, count = np.diag([WIDE] * len(self.first) + [STEP] * len(self.units)), len(self.first)
        around = np.clip([at - steps, at + steps], *self.bounds)
        self.compute([at, *around[0, :count], *around[1, :count]], self.spacing)
        found = np.array([[self.residuals(each) for each in side] for side in around]) - self.residuals(at)
        return np.swapaxes(found / (around - at).sum(2)[..., None], 1, 2)

    def slopes(self, at) -> np.ndarray:
        """Derivatives of the residuals at a point, (points, unknowns), between both sides."""
        return self.sided(at).mean(0)

    def with_offsets(self, at) -> tuple[np.ndarray, float]:
        """A point with the offset of each test that fits best, and the sum of squares there."""
        tried = np.linspace(-10.0 * LATE, 10.0 * LATE, 201) if self.places else np.zeros(1)
        squares = []
        for late in tried:
            at = np.concatenate([at[: len(self.first)], np.full(len(self.units), late)])
            squares.append([part @ part for part in self.by_curve(self.residuals(at))])
        for test, place in self.places.items():
            mine = [curve.test is test for curve in self.curves]
            at[place] = tried[np.argmin(np.array(squares)[:, mine].sum(1))]
        return at, float(np.sum(self.residuals(at) ** 2))

    def begin(self) -> np.ndarray:
        """Start of the fit: all constants smaller or larger by one factor, as far as that comes nearer to the curves;
        SceneError where none come to them."""
        from scipy.optimize import minimize_scalar

        way, ends = np.array([name != "flow_index" for name in self.first], float), np.log([1.0 / RANGE, RANGE])
        near = {"bounds": ends, "method": "bounded", "options": {"maxiter": LOOKS}}
        best = minimize_scalar(lambda by: self.with_offsets(by * way)[1], **near).x
        at, _ = self.with_offsets(best * way)
        self.require_reached(at)
        return at

    def words(self, at) -> str:
        """Constants of a point in words."""
        return ", ".join(f"{in_words(name)} {short(value)}" for name, value in self.mix(at).items())


def first_values(scene: str, free: list[str], settings: dict) -> dict[str, float]:
    """Values to begin with of the free constants: as given, or those of the law; SceneError for no constant of it."""
    usual = {name: each.default for law in reversed(LAWS) for name, each in numbers_of(law).items()}
    for name in free:
        known = f"{suggestion(name, usual)}; must be of {', '.join(usual)}"
        require(name in usual, f"free = {name}: is no constant of a law{known}")
    own = catalogue.build(scene, **settings).material
    first = {name: settings.get(name, getattr(own, name, usual[name])) for name in free}
    law = catalogue.build(scene, **settings | first).material
    for name in free:
        known = numbers_of(type(law))
        require(name in known, f"free = {name}: the law {type(law).__name__} has only {', '.join(known)}")
        first[name] = value = getattr(law, name)
        above = isinstance(value, float) and value > 0.0
        require(above, f"{name} = {value}: is where the search begins; must be above 0")
    return first


def ends_of(first: dict, fields) -> np.ndarray:
    """Logarithms over the first values between which constants are sought, (2, constants)."""
    ends = []
    for name, value in first.items():
        low, high = (
            [bound for note in notes(fields[name]) for mark in marks if (bound := getattr(note, mark, None))]
            for marks in (("ge", "gt"), ("le", "lt"))
        )
        ends.append(np.log([max([*low, value / RANGE]) / value, min([*high, value * RANGE]) / value]))
    return np.array(ends).T


def calibrate_curves(
    scene: str, curve: str, free: str, out=None, executor="local", workers=None, finer=True, watch=None, **settings
) -> CurveFit:
    """The constants of a law of which curves were measured.

    curve: CSV files with commas between them; free: names of constants of the law, and OFFSET for an unknown time of
    each curve; out: folder of the study, which goes on where it was left; finer: whether runs at the scene's spacing
    correct those of the fit, at twice that; watch: is told of the way in lines of text; settings: keywords of the
    scene. SceneError for what no run can be.
    """

    names = [name.strip().replace("-", "_").replace("yield_stress", "yield_value") for name in free.split(",")]
    first = first_values(scene, [name for name in names if name != OFFSET], settings)
    require(first, f"free = {free}: must be a constant of the law or more, such as yield_value,plastic_viscosity")
    function, built = catalogue.load(scene), catalogue.build(scene, **settings | first)
    curves = of_files(curve, function.parameters.model_fields, measures_of(built))
    for test in dict.fromkeys(curve.test for curve in curves):
        both = sorted(test.settings.keys() & {*settings, *first, "until"})
        require(not both, f"curve = {test.name}: {''.join(both[:1])} is a column of it; must not be given, too")
        catalogue.build(scene, **settings | first | test.settings)
    folder, say, fine = out or Path("studies") / f"calibrate-{built.name}", watch or str, built.spacing
    ends = ends_of(first, type(built.material).model_fields)
    runs = Runs(scene, curves, settings, first, ends, OFFSET in names, COARSER * fine if finer else fine)
    points, unknowns = runs.edges[-1], runs.bounds.shape[1]
    few = f"free = {free}: {unknowns} numbers; must be fewer than the measured points, {points}"
    require(points > unknowns, few)
    start, _ = executor_of(executor, workers, folder)
    with start() as runs.pool:
        runs.folder = folder
        if watch:
            likely = len(runs.tests) * (LOOKS + 7 * (1 + 2 * len(first)))
            at_start = [runs.case(test, np.zeros(len(first)), runs.spacing) for test in runs.tests]
            lasts = in_time(wall_time(at_start, workers or os.cpu_count() or 1, likely))
            finely = f", besides {3 * len(runs.tests)} at {fine:g} m" * finer
            say(f"some {likely} runs at a spacing of {runs.spacing:g} m, about {lasts}{finely}")

        def apart(at):
            try:
                found = runs.residuals(at)
            except SceneError as failure:
                say(str(failure))
                return np.full(points, FAILED)
            missed = ERROR * np.sqrt(np.mean(found**2))
            say(f"{len(runs.planned)} runs, {runs.seconds:.1f} s each: {runs.words(at)}: misses by {missed:.2%}")
            return found

        at = np.clip(runs.begin(), *(0.999 * runs.bounds))
        at = runs.solve(at, apart, jac=runs.slopes, xtol=ENOUGH, ftol=0.01, max_nfev=MOST).x
        for corrected in (finer, finer, False):
            centre, sided = at, runs.sided(at)
            if corrected:
                runs.shift = 0.0
                runs.shift = runs.beside(at, fine) - Surface(runs, at).residuals(at)
            at, slopes = Surface(runs, at).best()
            apart(at)
            if np.abs(at - centre)[: len(first)].max() < 0.4 * ENOUGH:
                break
        runs.require_reached(at)
        return result(runs, at, slopes, sided, built.material, fine)


def result(runs: Runs, at, slopes, sided, material, spacing) -> CurveFit:
    """The result at a point: intervals by the slopes, the scatter of the residuals there and that of the runs.

    Residuals of a curve go together, so that their scatter counts by (1 + r)/(1 - r), r their correlation from a point
    to the next. An end of an interval is by the slope to its side, ``sided``, where that is less than the one between;
    what the bounds alone say of a constant narrows no interval.
    """
    from scipy.stats import t

    residuals, model, count = runs.beside(at, spacing), runs.model(at, spacing), len(runs.first)
    square = max(float(residuals @ residuals), 1e-12)
    beside = sum(float(part[1:] @ part[:-1]) for part in runs.by_curve(residuals)) / square
    freedom, beside = len(residuals) - len(at), min(max(beside, 0.0), 0.9)
    error = np.sqrt(square / freedom * (1.0 + beside) / (1.0 - beside))
    quantile, noise, ends = t.ppf(0.975, freedom), Surface(runs, at).scatter(at) / error, []

    def covariance(slopes):
        spread = runs.covariance(slopes / error)
        moved = spread @ slopes.T @ noise.T / error  # the best point by the scatter of runs
        return spread + moved @ moved.T

    for sign, side in zip((-1.0, 1.0), sided, strict=True):
        least = np.where(np.linalg.norm(side, axis=0) < np.linalg.norm(slopes, axis=0), side, slopes)
        known = 1.0 / np.diag(covariance(least)) - np.diag(runs.before)
        ends.append(at + sign * quantile / np.sqrt(np.maximum(known, 0.01 * np.diag(runs.before))))
    constants, spread = runs.constants(at, np.transpose(ends)), covariance(slopes) * quantile**2
    wide, parts = np.sqrt(np.diag(spread)), runs.by_curve(slopes / error)
    curves, named = [], [f"{title(curve.measure)} of {curve.test.name}" for curve in runs.curves]
    for curve, values in zip(runs.curves, model, strict=True):
        facts = {"name": curve.test.name, "settings": curve.test.settings, "measure": curve.measure}
        known = {"times": curve.times, "measured": curve.values, "model": values}
        curves.append(facts | {name: each.tolist() for name, each in known.items()})
    spent = [row.get(name) or 0.0 for row in runs.rows.values() for name in ("cpu_seconds", "compile_seconds")]
    return CurveFit(
        scene=runs.scene,
        material=material.model_copy(update={name: it.value for name, it in constants.items()}),
        constants=constants,
        offsets={test.name: (runs.late(at, test), runs.late(wide, test)) for test in runs.places},
        spread=spread[:count, :count],
        curves=curves,
        worth=dict(zip(named, runs.worth(parts), strict=True)) if len(parts) > 1 else {},
        runs=len(runs.planned),
        cpu_seconds=sum(spent),
    )
