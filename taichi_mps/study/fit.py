"""Least squares on the logarithms of constants: the best values, their 95 % intervals and what determines them.

Two classes fit two kinds of measurements. ``TableLeastSquares``: end values of standard tests, by tables, which is so
fast that a grid finds the start and profile likelihood the intervals; a mix may lack a T500, and an end value may bound
a constant on one side. ``calibrate_curves.RunLeastSquares``: curves of any measure, each point a run of the scene with
scatter, so that slopes take wide steps and finer runs correct coarse ones. End values of a scene without a table are
curves of one point.
"""

import numpy as np

from ..units import require
from .calibration import BINGHAM, CONSTANT_UNITS, Calibration, Constant, FrictionalMix, deviation, is_time
from .emulator import GRID, Emulator, require_covered, scale

CHI2_95 = 3.841  # 95 % quantile of chi squared with one degree of freedom
DIFFERENCE_STEP = 0.1  # of an unknown, for finite differences
FAILED_RESIDUAL = 1e3  # residual where a mix has no result
YIELD_STRESSES = 1001  # number tried for the best yield stress at a plastic viscosity
VISCOSITIES = (0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0)  # [Pa s], of ``pairs``


class LeastSquares:
    """Least squares for unknowns within ``bounds``, (2, unknowns); the first are logarithms of the constants over
    ``scales``, by name. A subclass has ``residuals(at)``: (model - measured)/(standard error)."""

    def __init__(self, scales: dict[str, float], bounds):
        self.scales, self.bounds = scales, bounds
        self.prior = np.diag(12.0 / np.ptp(bounds, axis=0) ** 2)  # inverse covariance of a uniform prior in the bounds

    def solve(self, start, residuals=None, **options):
        """Run SciPy's least_squares from a point and return its result."""
        from scipy.optimize import least_squares

        return least_squares(residuals or self.residuals, start, **{"bounds": self.bounds} | options)

    def steps(self, at) -> np.ndarray:
        """Return difference steps at a point, (unknowns, unknowns), downward unless that leaves the bounds."""
        return np.diag(np.where(at - DIFFERENCE_STEP < self.bounds[0], DIFFERENCE_STEP, -DIFFERENCE_STEP))

    def slopes(self, at) -> np.ndarray:
        """Return the Jacobian of the residuals at a point, (points, unknowns)."""
        here = self.residuals(at)
        sides = [(self.residuals(at + step) - here) / step.sum() for step in self.steps(at)]
        return np.reshape(sides, (len(at), len(here))).T

    def covariance(self, slopes) -> np.ndarray:
        """Return the covariance of the unknowns by the slopes of the residuals and the prior."""
        return np.linalg.inv(self.prior + slopes.T @ slopes)

    def constants(self, at, ends) -> dict[str, Constant]:
        """Return the constants at a point, with the ends of their intervals, (unknowns, 2), None beyond the bounds."""
        found = {}
        for (name, divisor), best, interval, limits in zip(self.scales.items(), at, ends, self.bounds.T, strict=False):
            value, *limits, lower, upper = (divisor * np.exp([best, *limits, *interval])).tolist()
            inside = [end if limits[0] < end < limits[1] else None for end in (lower, upper)]
            found[name] = Constant(value, *inside, *limits, CONSTANT_UNITS[name])
        return found

    def worth(self, parts) -> list[dict[str, float]]:
        """Return the factor by which the standard error of each constant would grow without each part of the
        measurements, by the slopes of the parts, each (points, unknowns)."""
        parts = np.array([part.T @ part for part in parts])
        covariances = np.linalg.inv([self.prior + parts.sum(0), *(self.prior + parts.sum(0) - part for part in parts)])
        errors = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
        return [dict(zip(self.scales, (each / errors[0]).tolist(), strict=False)) for each in errors[1:]]


class TableLeastSquares(LeastSquares):
    """Least squares of emulators to measurements, with the emulators' scatter included in the errors.

    emulators: of several tests of one mix, over the same constants; measured: {name: (value, standard error)}, lengths
    [m] and times [s]; known: {constant: value}, not fitted; each of ``corrections`` is added to lengths of the
    emulators and multiplies times.
    """

    def __init__(self, emulators: list[Emulator], measured: dict, density: float, corrections, known: dict):
        self.emulators, self.measured, self.corrections = emulators, measured, corrections
        low, high = np.max([each.low for each in emulators], 0), np.min([each.high for each in emulators], 0)
        names = " and ".join(each.scene for each in emulators)
        require(np.all(low < high), f"table: those of {names} have no mix in common; must be studies that overlap")
        scales = {name: float(scale(name, density)) for name in emulators[0].constants}
        self.point = np.clip(np.log([known.get(name, each) / each for name, each in scales.items()]), low, high)
        self.free = np.array([name not in known for name in scales])
        given, self.find_pairs = ~self.free, tuple(scales) == BINGHAM and self.free.all()
        if tuple(scales) == BINGHAM:
            require_covered(
                known, (low[given], high[given]), np.log([known[name] / scales[name] for name in known]), density
            )
        for name in known:
            scales.pop(name)
        super().__init__(scales, np.array([low, high])[:, self.free])
        self.set_errors([each.scatter for each in emulators])
        axes, chi2 = self.grid(*self.bounds)
        require(chi2.min() < FAILED_RESIDUAL**2, "t500: no mix of the table reaches a slump flow of 50 cm")
        best = np.unravel_index(chi2.argmin(), chi2.shape)
        self.point = np.array([axis[k] for axis, k in zip(axes, best, strict=True)])  # start of the search
        self.set_errors([each.scatter_at(*self.point) for each in emulators])

    def set_errors(self, scatters: list[dict]) -> None:
        """Set the standard errors, with the scatter of each emulator included."""
        scatter = {name: value for each in scatters for name, value in each.items()}
        self.errors = {
            name: float(np.hypot(error, scatter.get(name, 0.0) * (value if is_time(name) else 1.0)))
            for name, (value, error) in self.measured.items()
        }

    def mix(self, at) -> np.ndarray:
        """Return the logarithms of all constants over their scales, known ones included."""
        point = self.point.copy()
        point[self.free] = at
        return point

    def model(self, *point, grid=False) -> dict[str, np.ndarray]:
        """Return the corrected results at logarithms of the constants over their scales."""
        found = {name: value for each in self.emulators for name, value in each.at(*point, grid=grid).items()}
        for name, correction in (pair for each in self.corrections for pair in each.items()):
            found[name] = found[name] * correction if is_time(name) else found[name] + correction
        return found

    def scaled_residuals(self, model) -> np.ndarray:
        """Return the residuals of a model over the errors, a row a measurement; FAILED_RESIDUAL for nan."""
        pairs = self.measured.items()
        residuals = [deviation(name, model[name], value) / self.errors[name] for name, (value, _) in pairs]
        return np.nan_to_num(residuals, nan=FAILED_RESIDUAL)

    def residuals(self, at) -> np.ndarray:
        """Return the residuals of the model over the errors at a point."""
        return self.scaled_residuals(self.model(*self.mix(at)))

    def grid(self, low, high, nodes=GRID) -> tuple[list, np.ndarray]:
        """Return an axis for each constant between two points, and chi squared at all combinations."""
        ends = zip(self.mix(low), self.mix(high), nodes, self.free, strict=False)
        axes = [np.linspace(first, last, count if free else 1) for first, last, count, free in ends]
        return axes, (self.scaled_residuals(self.model(*axes, grid=True)) ** 2).sum(0)

    def interval_ends(self, at, least: float) -> np.ndarray:
        """Return the logarithms (unknowns, 2) of the ends of intervals by profile likelihood: chi squared, minimized
        over the other constants, rises by at most CHI2_95. This holds also for a constant that the measurements do not
        determine. nan where an end is open: beyond the bounds, or reached only at an end of the yield stresses."""
        widths = 2.0 * np.sqrt(CHI2_95 * np.diag(self.covariance(self.slopes(at))))
        node_spacing = np.ptp(self.bounds, axis=0) / (min(GRID) - 1)
        axes, chi2 = self.grid(*self.bounds)
        nodes = np.stack(np.meshgrid(*axes, indexing="ij"), -1)[chi2 <= least + CHI2_95][:, self.free]
        around = np.vstack([at - widths, at + widths, nodes - node_spacing, nodes + node_spacing])
        axes, chi2 = self.grid(*np.clip([around.min(0), around.max(0)], *self.bounds))
        rise, found = np.maximum(chi2 - min(least, chi2.min()), 0.0), []
        for k in np.flatnonzero(self.free):
            profile = rise.min(tuple(other for other in range(rise.ndim) if other != k))
            inside = np.flatnonzero(profile <= max(CHI2_95, profile.min()))
            for last, beyond in ((inside[0], inside[0] - 1), (inside[-1], inside[-1] + 1)):
                is_open = not 0 <= beyond < len(profile)
                if k == 1 and self.find_pairs and not is_open:
                    is_open = np.isclose(axes[0][rise[:, beyond].argmin()], self.bounds[:, 0]).any()
                root = np.sqrt(profile[[last, beyond * (not is_open)]])  # the root of the rise is about linear
                found.append(np.nan if is_open else np.interp(CHI2_95**0.5, root, axes[k][[last, beyond]]))
        return np.reshape(found, (-1, 2))

    def pairs(self, least: float) -> dict[float, float]:
        """Return the best yield stress [Pa] at each of VISCOSITIES [Pa s] with which a mix fits, by viscosity."""
        scales = np.array(list(self.scales.values()))
        within = [eta for eta in VISCOSITIES if self.bounds[0, 1] <= np.log(eta / scales[1]) <= self.bounds[1, 1]]
        yields = np.linspace(*self.bounds[:, 0], YIELD_STRESSES)
        chi2 = (self.scaled_residuals(self.model(yields, np.log(within / scales[1]), grid=True)) ** 2).sum(0)
        best = (scales[0] * np.exp(yields[chi2.argmin(0)])).tolist()
        candidates = zip(within, best, chi2.min(0), strict=True)
        return {eta: tau for eta, tau, misfit in candidates if misfit - least <= CHI2_95}


def fit(
    emulators: list[Emulator], measured: dict, density: float, corrections=(), known=None
) -> Calibration | FrictionalMix:
    """Fit constants that are not ``known``, {name: value}, to ``measured``, {name: (value, standard error)}, SI units.

    The result is a FrictionalMix where the emulators have a friction angle, else a Calibration. ``corrections``: see
    TableLeastSquares.
    """
    tables = TableLeastSquares(emulators, measured, density, corrections, known or {})
    at = tables.point[tables.free]
    at = tables.solve(at).x if len(at) else at
    least = float(np.sum(tables.residuals(at) ** 2))
    ends, pairs = tables.interval_ends(at, least), tables.pairs(least) if tables.find_pairs else {}
    if pairs and np.isnan(ends[1]).any():  # all pairs fit equally: take the one nearest to the default viscosity
        nearest = min(pairs, key=lambda eta: abs(np.log(eta / emulators[0].defaults["plastic_viscosity"])))
        at = np.log(np.divide([pairs[nearest], nearest], list(tables.scales.values())))
    given = {name: Constant(*[value] * 5, CONSTANT_UNITS[name]) for name, value in (known or {}).items()}
    constants = tables.constants(at, ends) | given
    return (Calibration if emulators[0].constants == BINGHAM else FrictionalMix)(
        constants={name: constants[name] for name in emulators[0].constants},
        density=float(density),
        measured=measured,
        errors=tables.errors,
        model={name: float(value) for name, value in tables.model(*tables.mix(at)).items()},
        misfit=least,
        by_viscosity=pairs,
        worth=dict(zip(measured, tables.worth(tables.slopes(at)[:, None]), strict=True)),
    )
