"""What a test measures as a smooth function of two constants of a mix, through the cases of a study of its scene."""

from importlib.util import find_spec
from pathlib import Path

import numpy as np

from ..problem import catalogue
from ..problem.materials import Bingham
from ..units import SceneError
from .case import REACHED

DENSITY = Bingham().density  # [kg/m3] of rows that name none: the default of scenes/slump.py
SMOOTHING = 0.03  # of the thin plate: particles scatter the measures of soft mixes by millimetres from case to case
MIX = "yield_value", "plastic_viscosity"
NAMES = {"yield_value": "yield stresses", "plastic_viscosity": "plastic viscosities", "friction_angle": "angles"}
MEASURED = {  # by the scene of a test: what is measured in it, and the column of a study that holds it
    "slump": {"slump_m": "slump_m", "spread_m": "spread_m", "t500_s": "t500_s"},
    "mini_cone": {"mini_cone_m": "spread_m"},
    "v_funnel": {"v_funnel_s": "flow_time_s"},
}
FEWEST = 6  # cases with a T500 from which on it is known
NODES = 121, 61  # of the grid on which a fit looks first: yield stress, plastic viscosity


def positive(value) -> bool:
    """Is this a number above 0?"""
    return isinstance(value, float | int) and 0.0 < value < np.inf


def scale(constant: str, density):
    """What a constant is divided by for similarity: an angle by nothing, a stress or a viscosity by the density."""
    return np.ones_like(density) if constant == "friction_angle" else density


def is_time(name: str) -> bool:
    """Is this a measured time? It goes by its logarithm, a length as it is."""
    return name.endswith("_s")


class Emulator:
    """The measurements of a test, MEASURED, lengths [m] and times [s], for any yield stress and plastic viscosity, or
    other two ``constants``, within a study of its scene; the slump's where the rows name no scene.

    By similarity they depend on the ratios of both constants to the density alone (``scale``). Between the cases a
    thin-plate spline over the logarithms of these ratios; T500 is nan where the spread stays below 500 mm. ``scatter``
    is the root mean square by which the surface misses a case that it was made without and, added in squares, cases at
    a finer spacing than the first, which are no nodes; of lengths [m], of times the logarithm.
    """

    def __init__(self, rows: list[dict], constants: tuple[str, str] = MIX):
        if not find_spec("scipy"):
            raise SceneError("calibrate and chart need scipy: pip install 'taichi-mps[calibrate]'")
        scene = Path(str((rows[0] if rows else {}).get("scene") or "slump")).stem
        if scene not in MEASURED:
            raise SceneError(f"table: is a study of {scene}; must be one of {', '.join(MEASURED)}")
        columns = MEASURED[scene]
        needed = ["status", *constants, *(column for name, column in columns.items() if name != "t500_s")]
        missing = [name for name in needed if name not in (rows[0] if rows else {})]
        if missing:
            raise SceneError(
                f"table: has no column {', '.join(missing)}; must be a study of the {scene} over both constants"
            )
        done = [
            row for row in rows if row["status"] == "done" and all(map(positive, (row[name] for name in constants)))
        ]
        known = catalogue.load(scene).parameters.model_fields
        finest = [row for row in done if (row.get("spacing") or 0.0) < (done[0].get("spacing") or 0.0)]
        done = [row for row in done if row not in finest]
        if min((len({row[name] for row in done}) for name in constants), default=0) < 3:
            words = " and ".join(f"3 {NAMES[name]}" for name in constants)
            raise SceneError(f"table: must hold done cases of at least {words}")
        self.constants = constants
        self.scene, self.usual = scene, {name: field.default for name, field in known.items()}  # usual: of the scene
        self.settings = {name: done[0][name] for name in known if done[0].get(name) is not None}  # of the test
        self.spacing = self.settings.get("spacing", 0.01)  # [m]
        self.points = self._points(done, known)  # of the cases, (n, 2)
        self.low, self.high = self.points.min(0), self.points.max(0)
        self.axes = [np.linspace(*ends) for ends in zip(self.low, self.high, NODES, strict=True)]
        self.splines, self.scatter = {}, {}
        for name, column in columns.items():
            values = self.values(name, column, done)
            if np.isfinite(values).sum() >= FEWEST:
                self.splines[name], scatter = self._surface(values)
                self.scatter[name] = scatter
            elif name != "t500_s":
                raise SceneError(f"table: column {column} holds fewer than {FEWEST} numbers; must hold that many")
        for name in self.splines if finest else ():
            missed = self.splines[name](*self._points(finest, known).T, grid=False)
            missed -= self.values(name, columns[name], finest)
            self.scatter[name] = float(np.hypot(self.scatter[name], np.sqrt(np.nanmean(missed**2))))

    def _points(self, rows, known):
        """Logarithms of the constants over their scales, (n, 2)."""
        constants = np.array([[row[name] for name in self.constants] for row in rows], float)
        density = np.array([row.get("density") or known["density"].default for row in rows])
        return np.log(constants / np.column_stack([scale(name, density) for name in self.constants]))

    @staticmethod
    def values(name, column, rows):
        """A column as the spline has it, nan where a row holds no number."""
        values = np.array([row[column] if positive(row.get(column)) else np.nan for row in rows], float)
        return np.log(values) if is_time(name) else values

    def _surface(self, values):
        """A bicubic through a thin plate on a fine grid, the same within 1e-5 and much cheaper; and the root mean
        square by which the plate misses a case that it was made without."""
        from scipy.interpolate import RBFInterpolator, RectBivariateSpline

        points, values = self.points[np.isfinite(values)], values[np.isfinite(values)]
        grid = np.stack(np.meshgrid(*self.axes, indexing="ij"), -1).reshape(-1, 2)
        plate = RBFInterpolator(points, values, smoothing=SMOOTHING)
        hat = RBFInterpolator(points, np.eye(len(points)), smoothing=SMOOTHING)(points)
        missed = (values - hat @ values) / (1.0 - np.diag(hat))
        return RectBivariateSpline(*self.axes, plate(grid).reshape(NODES)), float(np.sqrt(np.mean(missed**2)))

    def at(self, yields, viscosities, grid=False) -> dict[str, np.ndarray]:
        """The measurements at pairs of logarithms of yield stress and plastic viscosity over the density, (n,) each;
        with ``grid`` at all combinations of two ascending sequences."""
        return as_measured(self.surfaces(yields, viscosities, grid), self.scene)

    def surfaces(self, yields, viscosities, grid=False) -> dict[str, np.ndarray]:
        """The same as the splines have it: times by their logarithm, and T500 everywhere."""
        return {name: spline(yields, viscosities, grid=grid) for name, spline in self.splines.items()}


def as_measured(surfaces: dict[str, np.ndarray], scene: str) -> dict[str, np.ndarray]:
    """Lengths [m] and times [s] of a test from ``Emulator.surfaces``; T500 nan where the spread stays below 500 mm."""
    found = {name: np.exp(value) if is_time(name) else value for name, value in surfaces.items()}
    if scene == "slump":
        spread = found["spread_m"]
        time = found.get("t500_s", np.full(spread.shape, np.nan))
        found["t500_s"] = np.where(spread >= REACHED, time, np.nan)
    return found


class Together:
    """Several tests of one mix as one emulator, over the constants that all their tables hold."""

    def __init__(self, emulators: list[Emulator]):
        self.emulators, self.usual = emulators, emulators[0].usual
        self.low = np.max([each.low for each in emulators], 0)
        self.high = np.min([each.high for each in emulators], 0)
        if np.any(self.low >= self.high):
            names = " and ".join(each.scene for each in emulators)
            raise SceneError(f"table: those of {names} have no mix in common; must be studies that overlap")
        self.axes = [np.linspace(*ends) for ends in zip(self.low, self.high, NODES, strict=True)]
        self.scatter = {name: value for each in emulators for name, value in each.scatter.items()}

    def at(self, yields, viscosities, grid=False) -> dict[str, np.ndarray]:
        """The measurements of all tests; arguments as of Emulator.at."""
        return {name: value for each in self.emulators for name, value in each.at(yields, viscosities, grid).items()}
