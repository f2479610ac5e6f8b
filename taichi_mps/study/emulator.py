"""Emulator of a test: its results as smooth functions of the constants of a mix, through the cases of a study."""

from functools import lru_cache
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from ..engine import Bingham
from ..input import catalogue
from ..input.labels import in_words
from ..units import Flag, Place, SceneError, array, real, require, require_package, user_path, validated
from .calibration import BINGHAM, CONSTANT_UNITS, FRICTIONAL, is_time, rounded
from .case import T500_SLUMP_FLOW
from .tables import read

TABLES = Path(__file__).parent
"""Folder of the package's own table of each test, slump.csv and so on; docs/howto/calibrate.md."""
FRICTION_TABLE = "internal_friction"  # the table of the standard cone over FRICTIONAL
DENSITY = Bingham().density  # [kg/m3] of rows that name none: the default of scenes/slump.py
SMOOTHING = 0.03  # of the thin plate: results of soft mixes scatter by millimetres from case to case
RESULT_COLUMNS = {  # by the scene of a test: its results, and the column of a study that holds each
    "slump": {"slump_m": "slump_m", "spread_m": "spread_m", "t500_s": "t500_s"},
    "mini_cone": {"mini_cone_m": "spread_m"},
    "v_funnel": {"v_funnel_s": "flow_time_s"},
}
ROUNDING = 1e-6  # of a logarithm, by which a mix may lie outside of a table
MIN_CASES = 6  # with a result, for a spline of it
Constants = Annotated[tuple[Literal[FRICTIONAL], ...], Field(min_length=2, max_length=3)]
LOG = real("", ge=-700.0, le=700.0) | array("", (None,))
GRID = 121, 61, 31  # nodes for each constant of the grid that a fit searches first


def positive(value) -> bool:
    """Whether this is a number above 0."""
    return isinstance(value, float | int) and 0.0 < value < np.inf


def scale(constant: str, density):
    """Return the divisor of a constant for similarity: 1 of an angle, the density of a stress or a viscosity."""
    return np.ones_like(density) if constant == "friction_angle" else density


@validated
def emulator_of(table: Place | None = None, test: Literal["slump", "mini_cone", "v_funnel", FRICTION_TABLE] = "slump"):
    """Return the emulator of a study's folder or table, by default the package's own of a test; cached until the table
    changes."""
    path = user_path(table) if table else TABLES / f"{test}.csv"
    file = path / "results.csv" if path.is_dir() else path
    return _emulator(
        path, FRICTIONAL if test == FRICTION_TABLE else BINGHAM, file.stat().st_mtime_ns if file.is_file() else 0
    )


@lru_cache(maxsize=8)
def _emulator(path: Path, constants: tuple[str, ...], changed: int):
    return Emulator(read(path), constants)


class Emulator:
    """Results of a test, RESULT_COLUMNS, lengths [m] and times [s], for any mix within a study of its scene, the slump
    where the rows name no scene.

    The mix is given by two or three ``constants``. By similarity the results depend only on their ratios to the density
    (``scale``). A thin-plate spline over the logarithms of the first two ratios passes through the cases; there is one
    for each value of the third, and between these values the results are linear in its logarithm. T500 is nan where the
    slump flow stays below 500 mm. ``scatter`` is the root mean square of the leave-one-out errors of the splines and,
    added in squares, of the errors of cases that are no nodes: those with the role 'check' or a finer spacing than the
    first where they have no role; of lengths [m], of times the logarithm. ``scatter_at`` is the scatter for one mix.
    """

    @validated
    def __init__(self, rows: list[dict], constants: Constants = BINGHAM):
        require_package("scipy", "calibrate and chart need", "calibrate")
        first = rows[0] if rows else {}
        self.scene, self.constants = Path(str(first.get("scene") or "slump")).stem, constants
        require(
            self.scene in RESULT_COLUMNS,
            f"table: is a study of {self.scene}; must be one of {', '.join(RESULT_COLUMNS)}",
        )
        self.columns = RESULT_COLUMNS[self.scene]
        needed = ["status", *constants, *(column for name, column in self.columns.items() if name != "t500_s")]
        missing = ", ".join(name for name in needed if name not in first)
        require(not missing, f"table: has no column {missing}; must be a study of the {self.scene} over both constants")
        done = [row for row in rows if row["status"] == "done" and all(positive(row[name]) for name in constants)]
        sizes = [row.get("spacing") or 0.0 for row in done]  # of particles [m], 0 where none is named
        roles = [
            row.get("role") or ("check" if size < sizes[0] else "node") for row, size in zip(done, sizes, strict=True)
        ]
        nodes, checks = ([r for r, it in zip(done, roles, strict=True) if it == role] for role in ("node", "check"))
        require(
            all(len({row[name] for row in nodes}) >= 3 for name in constants),
            "table: must hold done cases of at least "
            + " and ".join(f"3 values of {in_words(name)}" for name in constants),
        )
        fields = catalogue.load(self.scene).parameters.model_fields
        self.defaults = {name: field.default for name, field in fields.items()}  # of the scene
        self.settings = {name: nodes[0][name] for name in fields if nodes[0].get(name) is not None}  # of the test
        self.spacings = np.array([row.get("spacing") or 0.01 for row in nodes])  # of the cases [m]
        self.points = self.log_ratios(nodes)  # of the cases, (n, constants)
        self.low, self.high = self.points.min(0), self.points.max(0)
        self.axes = [np.linspace(*ends) for ends in zip(self.low, self.high, GRID, strict=False)]
        third = self.points[:, 2] if len(constants) == 3 else np.zeros(len(nodes))
        self.third_values, self.scatter, self.checks = np.unique(third), {}, {}
        self.planes = [
            self.splines([row for row, at in zip(nodes, third, strict=True) if at == value])
            for value in self.third_values
        ]
        found = self.at(*self.log_ratios(checks).T)
        for name in self.planes[0]:
            errors = (np.log(found[name]) if is_time(name) else found[name]) - self.values(name, checks)
            known = np.isfinite(errors)
            self.checks[name] = mean_squares(self.log_ratios(checks)[known, 0], errors[known])
            square = np.mean([np.mean(plane[name][2] ** 2) for plane in self.planes])
            self.scatter[name] = float(np.sqrt(square + (np.mean(errors[known] ** 2) if known.any() else 0.0)))

    def spacing_at(self, *point) -> float:
        """Return the spacing [m] of the case that is nearest to a mix, the constants given as for ``at``."""
        return float(self.spacings[((self.points - point) ** 2).sum(1).argmin()])

    def log_ratios(self, rows) -> np.ndarray:
        """Return the logarithms of the constants over their scales, (n, constants)."""
        density = np.array([row.get("density") or self.defaults["density"] for row in rows])
        return np.log(
            np.column_stack(
                [np.array([row[name] for row in rows], float) / scale(name, density) for name in self.constants]
            )
        )

    def values(self, name, rows) -> np.ndarray:
        """Return a result of these rows, (n,), of a time the logarithm; nan where a row holds no number."""
        column = self.columns[name]
        values = np.array([row[column] if positive(row.get(column)) else np.nan for row in rows], float)
        return np.log(values) if is_time(name) else values

    def splines(self, rows) -> dict:
        """Return for each result a bicubic spline through the thin plate on a fine grid, within 1e-5 and much cheaper,
        the first coordinate of its cases, and the leave-one-out error of the thin plate at each case."""
        from scipy.interpolate import RBFInterpolator, RectBivariateSpline

        found, coordinates = {}, self.log_ratios(rows)[:, :2]
        grid = np.stack(np.meshgrid(*self.axes[:2], indexing="ij"), -1).reshape(-1, 2)
        for name, column in self.columns.items():
            values = self.values(name, rows)
            points, values = coordinates[np.isfinite(values)], values[np.isfinite(values)]
            if len(values) >= MIN_CASES:
                thin_plate = RBFInterpolator(points, values, smoothing=SMOOTHING)
                hat = RBFInterpolator(points, np.eye(len(points)), smoothing=SMOOTHING)(points)
                errors = (values - hat @ values) / (1.0 - np.diag(hat))
                spline = RectBivariateSpline(*self.axes[:2], thin_plate(grid).reshape(GRID[:2]))
                found[name] = spline, points[:, 0], errors
            else:
                require(
                    name == "t500_s",
                    f"table: column {column} holds fewer than {MIN_CASES} numbers; must hold that many",
                )
        return found

    @validated
    def at(self, *point: LOG, grid: Flag = False) -> dict[str, np.ndarray]:
        """Return the results at logarithms of the constants over their scales, (n,) each; with ``grid`` at all
        combinations of ascending sequences. SceneError for a mix outside of the table."""
        require_covered(self.constants, (self.low, self.high), point, self.defaults["density"])
        found = dict.fromkeys(self.planes[0], 0.0)
        for plane, weight in self.planes_at(*point[2:]):
            for name, (spline, *_) in plane.items():
                value = spline(*point[:2], grid=grid)
                found[name] = found[name] + weight * (value[..., None] if grid and np.ndim(weight) else value)
        found = {name: np.exp(value) if is_time(name) else value for name, value in found.items()}
        if "t500_s" in self.columns:
            found["t500_s"] = np.where(found["spread_m"] >= T500_SLUMP_FLOW, found.get("t500_s", np.nan), np.nan)
        return found

    def planes_at(self, third=0.0):
        """Yield the planes of splines with a weight at values of the third constant, and the weights."""
        for plane, one in zip(self.planes, np.eye(len(self.planes)), strict=True):
            weight = np.interp(third, self.third_values, one)
            if weight.any():
                yield plane, weight

    def scatter_at(self, *point) -> dict[str, float]:
        """Return the scatter for one mix: the root of the mean squares at its yield stress, linear between those of the
        nodes' leave-one-out errors and, added, of the other cases' errors."""
        squares = {name: np.interp(point[0], *checks) for name, checks in self.checks.items()}
        for plane, weight in self.planes_at(*point[2:]):
            for name, (_, first, errors) in plane.items():
                squares[name] += weight * np.interp(point[0], *mean_squares(first, errors))
        return {name: float(square) ** 0.5 for name, square in squares.items()}


def mean_squares(at, errors) -> tuple[np.ndarray, np.ndarray]:
    """Return the different values of ``at``, ascending, and the mean square of the errors at each; without errors a
    zero."""
    if not len(errors):
        return np.zeros(1), np.zeros(1)
    values, group = np.unique(at, return_inverse=True)
    return values, np.bincount(group, errors**2) / np.bincount(group)


def require_covered(constants, ends, point, density) -> None:
    """Raise SceneError for a mix outside of a table; its ``ends``, least and greatest, and the mix are logarithms of
    the constants over their scales."""
    for name, low, high, at in zip(constants, *ends, point, strict=False):
        outside = np.extract((np.asarray(at) < low - ROUNDING) | (at > high + ROUNDING), at)
        if outside.size:
            value, low, high = (scale(name, density) * np.exp(each) for each in (outside[0], low, high))
            unit = CONSTANT_UNITS[name]
            raise SceneError(
                f"{name} = {value:g} {unit}: must be {rounded(low)} to {rounded(high)} {unit}, what the table covers "
                f"at {density:g} kg/m3"
            )
