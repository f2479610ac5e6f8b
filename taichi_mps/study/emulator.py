"""Emulator of a test: its measures as smooth functions of the constants of a mix, through the cases of a study."""

from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from ..problem import catalogue
from ..problem.labels import in_words
from ..problem.materials import Bingham
from ..units import Flag, Place, SceneError, array, real, require, user_path, validated
from .calibration import BINGHAM, FRICTIONAL, UNITS, is_time, short
from .case import REACHED
from .tables import read

HERE = Path(__file__).parent
"""Holds the package's own table of each test, slump.csv and so on; docs/howto/calibrate.md."""
FRICTION = "internal_friction"  # the table of the standard cone over FRICTIONAL
DENSITY = Bingham().density  # [kg/m3] of rows that name none: the default of scenes/slump.py
SMOOTHING = 0.03  # of the thin plate: particles scatter the measures of soft mixes by millimetres from case to case
MEASURED = {  # by the scene of a test: what is measured in it, and the column of a study that holds it
    "slump": {"slump_m": "slump_m", "spread_m": "spread_m", "t500_s": "t500_s"},
    "mini_cone": {"mini_cone_m": "spread_m"},
    "v_funnel": {"v_funnel_s": "flow_time_s"},
}
ROUNDING = 1e-6  # of a logarithm, by which a mix may lie outside of a table
FEWEST = 6  # cases with a T500 from which on it is known
Constants = Annotated[tuple[Literal[FRICTIONAL], ...], Field(min_length=2, max_length=3)]
LOG = real("", ge=-700.0, le=700.0) | array("", (None,))
NODES = 121, 61, 31  # of the grid on which a fit looks first: one number for each constant


def positive(value) -> bool:
    """Whether this is a number above 0."""
    return isinstance(value, float | int) and 0.0 < value < np.inf


def scale(constant: str, density):
    """Divisor of a constant for similarity: an angle by nothing, a stress or a viscosity by the density."""
    return np.ones_like(density) if constant == "friction_angle" else density


@validated
def emulator_of(table: Place | None = None, test: Literal["slump", "mini_cone", "v_funnel", FRICTION] = "slump"):
    """The emulator of a study's folder or table, by default the package's own of a test; made once, and again when the
    table changes."""
    path = user_path(table) if table else HERE / f"{test}.csv"
    file = path / "results.csv" if path.is_dir() else path
    return _emulator(
        path, FRICTIONAL if test == FRICTION else BINGHAM, file.stat().st_mtime_ns if file.is_file() else 0
    )


@lru_cache(maxsize=8)
def _emulator(path: Path, constants: tuple[str, ...], changed: int):
    return Emulator(read(path), constants)


class Emulator:
    """The measurements of a test, MEASURED, lengths [m] and times [s], for any mix within a study of its scene; the
    slump's where the rows name no scene.

    The mix is given by two or three ``constants``. By similarity the measurements depend on the ratios of these to the
    density alone (``scale``). Over the logarithms of the first two ratios lies a thin-plate spline through the cases;
    there is one for each value of the third, and between these values the measurements are linear in its logarithm.
    T500 is nan where the spread stays below 500 mm. ``scatter`` is the root mean square over the table by which the
    splines miss a case that they were made without and, added in squares, cases that are no nodes: those with the role
    'check', and those of a finer spacing than the first; of lengths [m], of times the logarithm. ``scatter_at`` is that
    of one mix.
    """

    @validated
    def __init__(self, rows: list[dict], constants: Constants = BINGHAM):
        require(find_spec("scipy"), "calibrate and chart need scipy: pip install 'taichi-mps[calibrate]'")
        first = rows[0] if rows else {}
        self.scene, self.constants = Path(str(first.get("scene") or "slump")).stem, constants
        require(self.scene in MEASURED, f"table: is a study of {self.scene}; must be one of {', '.join(MEASURED)}")
        self.columns = MEASURED[self.scene]
        needed = ["status", *constants, *(column for name, column in self.columns.items() if name != "t500_s")]
        missing = ", ".join(name for name in needed if name not in first)
        require(not missing, f"table: has no column {missing}; must be a study of the {self.scene} over both constants")
        done = [row for row in rows if row["status"] == "done" and all(positive(row[name]) for name in constants)]
        checks = [row for row in done if row.get("role") == "check" or spacing(row) < spacing(done[0])]
        nodes = [row for row in done if row not in checks]
        words = " and ".join(f"3 values of {in_words(name)}" for name in constants)
        enough = all(len({row[name] for row in nodes}) >= 3 for name in constants)
        require(enough, f"table: must hold done cases of at least {words}")
        known = catalogue.load(self.scene).parameters.model_fields
        self.usual = {name: field.default for name, field in known.items()}  # of the scene
        self.settings = {name: nodes[0][name] for name in known if nodes[0].get(name) is not None}  # of the test
        self.spacing = self.settings.get("spacing", 0.01)  # [m]
        self.points = self.place(nodes)  # of the cases, (n, constants)
        self.low, self.high = self.points.min(0), self.points.max(0)
        self.axes = [np.linspace(*ends) for ends in zip(self.low, self.high, NODES, strict=False)]
        third = self.points[:, 2] if len(constants) == 3 else np.zeros(len(nodes))
        self.thirds, self.planes, self.scatter, self.of_cases = np.unique(third), [], {}, {}
        for value in self.thirds:
            plane = [row for row, at in zip(nodes, third, strict=True) if at == value]
            self.planes.append(self.splines(plane))
        found = self.at(*self.place(checks).T)
        for name in self.planes[0]:
            each = (np.log(found[name]) if is_time(name) else found[name]) - self.values(name, checks)
            self.of_cases[name] = np.mean([np.mean(plane[name][2] ** 2) for plane in self.planes])
            self.scatter[name] = float(np.sqrt(self.of_cases[name] + (np.nanmean(each**2) if len(each) else 0.0)))

    def place(self, rows) -> np.ndarray:
        """Logarithms of the constants over their scales, (n, constants)."""
        density = np.array([row.get("density") or self.usual["density"] for row in rows])
        return np.log(
            np.column_stack(
                [np.array([row[name] for row in rows], float) / scale(name, density) for name in self.constants]
            )
        )

    def values(self, name, rows) -> np.ndarray:
        """A measurement of these rows as the splines have it, (n,); nan where a row holds no number."""
        column = self.columns[name]
        values = np.array([row[column] if positive(row.get(column)) else np.nan for row in rows], float)
        return np.log(values) if is_time(name) else values

    def splines(self, rows) -> dict:
        """Splines of the measurements: for each a bicubic through a thin plate on a fine grid, within 1e-5 and much
        cheaper; the first coordinate of its cases, and by how much the plate misses each of them where it was made
        without it."""
        from scipy.interpolate import RBFInterpolator, RectBivariateSpline

        found, every = {}, self.place(rows)[:, :2]
        grid = np.stack(np.meshgrid(*self.axes[:2], indexing="ij"), -1).reshape(-1, 2)
        for name, column in self.columns.items():
            values = self.values(name, rows)
            points, values = every[np.isfinite(values)], values[np.isfinite(values)]
            if len(values) >= FEWEST:
                plate = RBFInterpolator(points, values, smoothing=SMOOTHING)
                hat = RBFInterpolator(points, np.eye(len(points)), smoothing=SMOOTHING)(points)
                missed = (values - hat @ values) / (1.0 - np.diag(hat))
                spline = RectBivariateSpline(*self.axes[:2], plate(grid).reshape(NODES[:2]))
                found[name] = spline, points[:, 0], missed
            else:
                few = f"table: column {column} holds fewer than {FEWEST} numbers; must hold that many"
                require(name == "t500_s", few)
        return found

    @validated
    def at(self, *point: LOG, grid: Flag = False) -> dict[str, np.ndarray]:
        """The measurements at logarithms of the constants over their scales, (n,) each; with ``grid`` at all
        combinations of ascending sequences. SceneError for a mix outside of the table."""
        covered(self.constants, (self.low, self.high), point, self.usual["density"])
        found = dict.fromkeys(self.planes[0], 0.0)
        for plane, weight in self.weighted(*point[2:]):
            for name, (spline, *_) in plane.items():
                value = spline(*point[:2], grid=grid)
                found[name] = found[name] + weight * (value[..., None] if grid and np.ndim(weight) else value)
        found = {name: np.exp(value) if is_time(name) else value for name, value in found.items()}
        if "t500_s" in self.columns:
            found["t500_s"] = np.where(found["spread_m"] >= REACHED, found.get("t500_s", np.nan), np.nan)
        return found

    def weighted(self, third=0.0):
        """The planes that count at values of the third constant, and their weights."""
        for plane, one in zip(self.planes, np.eye(len(self.planes)), strict=True):
            weight = np.interp(third, self.thirds, one)
            if weight.any():
                yield plane, weight

    def scatter_at(self, *point) -> dict[str, float]:
        """The scatter for one mix, as of ``at``: the mean square over the cases of its yield stress, between two of
        them linear, in the ratio of that over the table to ``scatter``."""
        squares = dict.fromkeys(self.scatter, 0.0)
        for plane, weight in self.weighted(*point[2:]):
            for name, (_, first, missed) in plane.items():
                known, case = np.unique(first, return_inverse=True)
                of_rows = np.bincount(case, missed**2) / np.bincount(case)
                squares[name] += float(weight * np.interp(point[0], known, of_rows))
        return {name: self.scatter[name] * (square / self.of_cases[name]) ** 0.5 for name, square in squares.items()}


def covered(constants, ends, point, density) -> None:
    """SceneError for a mix outside of a table, whose ``ends``, least and greatest, and the mix are logarithms of the
    constants over their scales."""
    for name, low, high, at in zip(constants, *ends, point, strict=False):
        outside = np.extract((np.asarray(at) < low - ROUNDING) | (at > high + ROUNDING), at)
        if outside.size:
            value, low, high = (scale(name, density) * np.exp(each) for each in (outside[0], low, high))
            unit = UNITS[name]
            raise SceneError(
                f"{name} = {value:g} {unit}: must be {short(low)} to {short(high)} {unit}, what the table covers at "
                f"{density:g} kg/m3"
            )


def spacing(row) -> float:
    """The spacing of a row [m], 0 where it names none."""
    return row.get("spacing") or 0.0
