"""The slump test as a smooth function of the Bingham constants, through the cases of a study."""

from importlib.util import find_spec

import numpy as np

from ..problem import catalogue
from ..problem.materials import Bingham
from ..units import SceneError
from .case import REACHED

DENSITY = Bingham().density  # [kg/m3] of rows that name none: the default of scenes/slump.py
SMOOTHING = 0.03  # of the thin plate: particles scatter the measures of soft mixes by millimetres from case to case
MIX = "yield_value", "plastic_viscosity"
NEEDED = ("status", *MIX, "slump_m", "spread_m")  # columns of a table
FEWEST = 6  # cases with a T500 from which on it is known
NODES = 121, 61  # of the grid on which a fit looks first: yield stress, plastic viscosity


def positive(value) -> bool:
    """Is this a number above 0?"""
    return isinstance(value, float | int) and 0.0 < value < np.inf


class Emulator:
    """slump_m, spread_m [m] and t500_s [s] of a cone for any yield stress and plastic viscosity within a study.

    By similarity they depend on the ratios of both constants to the density alone. Between the cases a thin-plate
    spline over the logarithms of these ratios; T500 by its logarithm, nan where the spread stays below 500 mm.
    """

    def __init__(self, rows: list[dict]):
        if not find_spec("scipy"):
            raise SceneError("calibrate and chart need scipy: pip install 'taichi-mps[calibrate]'")
        missing = [name for name in NEEDED if name not in (rows[0] if rows else {})]
        if missing:
            raise SceneError(
                f"table: has no column {', '.join(missing)}; must be a study of the slump over both constants"
            )
        done = [row for row in rows if row["status"] == "done" and all(map(positive, (row[name] for name in MIX)))]
        constants = np.array([[row["yield_value"], row["plastic_viscosity"]] for row in done], float).reshape(-1, 2)
        if min((len(set(column)) for column in constants.T), default=0) < 3:
            raise SceneError("table: must hold done cases of at least 3 yield stresses and 3 plastic viscosities")
        known = catalogue.load("slump").parameters.model_fields
        self.settings = {name: done[0][name] for name in known if done[0].get(name) is not None}  # of the cone
        self.spacing = self.settings.get("spacing", 0.01)  # [m]
        density = np.array([row.get("density") or DENSITY for row in done])
        self.points = np.log(constants / density[:, None])  # of the cases, (n, 2)
        self.low, self.high = self.points.min(0), self.points.max(0)
        self.axes = [np.linspace(*ends) for ends in zip(self.low, self.high, NODES, strict=True)]
        self.splines, self.scatter = {}, {}  # scatter of the cases about the surface, T500: of its logarithm
        for name in ("slump_m", "spread_m", "t500_s"):
            values = np.array([row[name] if positive(row.get(name)) else np.nan for row in done], float)
            values = np.log(values) if name == "t500_s" else values
            if np.isfinite(values).sum() >= FEWEST:
                self.splines[name], self.scatter[name] = self._surface(values)
            elif name != "t500_s":
                raise SceneError(f"table: column {name} holds fewer than {FEWEST} numbers; must hold that many")

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
        """The measures at pairs of logarithms of yield stress and plastic viscosity over the density, (n,) each; with
        ``grid`` at all combinations of two ascending sequences."""
        slump, spread = (self.splines[name](yields, viscosities, grid=grid) for name in ("slump_m", "spread_m"))
        known = self.splines.get("t500_s")
        time = np.exp(known(yields, viscosities, grid=grid)) if known else np.full(slump.shape, np.nan)
        return {"slump_m": slump, "spread_m": spread, "t500_s": np.where(spread >= REACHED, time, np.nan)}
