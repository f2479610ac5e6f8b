"""The slump test as a smooth function of the Bingham constants, through the cases of a study."""

from functools import cached_property

import numpy as np

from .. import catalogue
from ..quantity import SceneError

DENSITY = 2300.0  # [kg/m3] of rows that name none: the default of scenes/slump.py
SMOOTHING = 1e-4  # of the thin plate: particles scatter the measures by tenths of a millimetre from case to case
NODES = 241, 121  # of the grid on which a fit looks for the constants: yield value, plastic viscosity
REACHED = 0.5  # spread [m] below which there is no T500


class Emulator:
    """slump_m, spread_m [m] and t500_s [s] of a cone for any yield value and plastic viscosity within a study.

    By similarity they depend on the ratios of both constants to the density alone. Between the cases a thin-plate
    spline over the logarithms of these ratios; T500 by its logarithm, nan where the spread stays below 500 mm.
    """

    def __init__(self, rows: list[dict]):
        done = [row for row in rows if row["status"] == "done" and row["yield_value"] > 0.0]
        constants = np.array([[row["yield_value"], row["plastic_viscosity"]] for row in done], float).reshape(-1, 2)
        if min((len(set(column)) for column in constants.T), default=0) < 3:
            raise SceneError("table: must hold done cases of at least 3 yield values and 3 plastic viscosities")
        known = catalogue.load("slump").parameters.model_fields
        self.settings = {name: done[0][name] for name in known if done[0].get(name) is not None}  # of the cone
        self.spacing = self.settings.get("spacing", 0.01)  # [m]
        density = np.array([row.get("density") or DENSITY for row in done])
        self.points = np.log(constants / density[:, None])  # of the cases, (n, 2)
        self.low, self.high = self.points.min(0), self.points.max(0)
        self.splines = {name: self._spline([row[name] for row in done]) for name in ("slump_m", "spread_m")}
        times = np.array([row.get("t500_s") or np.nan for row in done], float)
        self.splines["t500_s"] = self._spline(np.log(times)) if np.isfinite(times).sum() >= 6 else None

    def _spline(self, values):
        from scipy.interpolate import RBFInterpolator

        values = np.array(values, float)
        known = np.isfinite(values)
        return RBFInterpolator(self.points[known], values[known], smoothing=SMOOTHING)

    def at(self, points) -> dict[str, np.ndarray]:
        """The measures at points (n, 2): logarithms of yield value and plastic viscosity over the density."""
        points = np.atleast_2d(points)
        slump, spread = (self.splines[name](points) for name in ("slump_m", "spread_m"))
        time = np.exp(self.splines["t500_s"](points)) if self.splines["t500_s"] else np.full(len(points), np.nan)
        return {"slump_m": slump, "spread_m": spread, "t500_s": np.where(spread >= REACHED, time, np.nan)}

    @cached_property
    def axes(self):
        """The grid's two axes, logarithms as in ``at``."""
        return [np.linspace(*ends) for ends in zip(self.low, self.high, NODES, strict=True)]

    @cached_property
    def grid(self):
        """The measures on the grid, each (NODES)."""
        points = np.stack(np.meshgrid(*self.axes, indexing="ij"), -1).reshape(-1, 2)
        return {name: values.reshape(NODES) for name, values in self.at(points).items()}
