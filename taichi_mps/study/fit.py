"""Least squares on the logarithms of constants: the best values, their 95 % intervals and what determines them.

Two kinds of measurements share LeastSquares and calibration.Found. ``Tables``: end values of standard tests, looked
up, which takes no time, so that a grid finds the start and profile likelihood the intervals; a mix may lack a T500,
and an end value may bound a constant on one side. ``calibrate_curves.Runs``: curves of any measure, each point a run
of the scene with a scatter of its own, so that slopes take wide steps and finer runs correct coarse ones. End values
of a scene without a table are curves of one point there.
"""

import numpy as np

from ..units import require
from .calibration import BINGHAM, UNITS, Calibration, Constant, FrictionalMix, is_time, over
from .emulator import NODES, Emulator, covered, scale

RISE = 3.841  # of chi squared, one degree of freedom, 95 %
STEP = 0.1  # of an unknown, to a point that tells a slope
FAILED = 1e3  # residual where there is no measure
YIELDS = 1001  # yield stresses among which the best at a plastic viscosity is sought
VISCOSITIES = (0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0)  # at which pairs are told [Pa s]


class LeastSquares:
    """Unknowns between ``bounds``, (2, unknowns), of which the first are logarithms of constants over ``scales``, by
    name. A subclass has ``residuals(at)``: model less measured over the standard errors."""

    def __init__(self, scales: dict[str, float], bounds):
        self.scales, self.bounds = scales, bounds
        self.before = np.diag(12.0 / np.ptp(bounds, axis=0) ** 2)  # inverse of the covariance by the bounds alone

    def solve(self, start, residuals=None, **how):
        """Least squares from a point on, a result of SciPy."""
        from scipy.optimize import least_squares

        return least_squares(residuals or self.residuals, start, **{"bounds": self.bounds} | how)

    def steps(self, at) -> np.ndarray:
        """Steps from a point, (unknowns, unknowns), one unknown each, to softer and thinner mixes where there are."""
        return np.diag(np.where(at - STEP < self.bounds[0], STEP, -STEP))

    def slopes(self, at) -> np.ndarray:
        """Derivatives of the residuals at a point, (points, unknowns)."""
        here = self.residuals(at)
        sides = [(self.residuals(at + step) - here) / step.sum() for step in self.steps(at)]
        return np.reshape(sides, (len(at), len(here))).T

    def covariance(self, slopes) -> np.ndarray:
        """Covariance of the unknowns by slopes of residuals, and by the bounds."""
        return np.linalg.inv(self.before + slopes.T @ slopes)

    def constants(self, at, ends) -> dict[str, Constant]:
        """Constants at a point, with the ends of their intervals, (unknowns, 2), open where not within the bounds."""
        found = {}
        for (name, by), best, pair, limits in zip(self.scales.items(), at, ends, self.bounds.T, strict=False):
            value, *limits, lower, upper = (by * np.exp([best, *limits, *pair])).tolist()
            inside = [end if limits[0] < end < limits[1] else None for end in (lower, upper)]
            found[name] = Constant(value, *inside, *limits, UNITS[name])
        return found

    def worth(self, parts) -> list[dict[str, float]]:
        """By which factor the standard error of each constant would grow without each part of the measurements, by the
        slopes of the parts, each (points, unknowns)."""
        parts = np.array([part.T @ part for part in parts])
        known = np.linalg.inv([self.before + parts.sum(0), *(self.before + parts.sum(0) - part for part in parts)])
        errors = np.sqrt(np.diagonal(known, axis1=1, axis2=2))
        return [dict(zip(self.scales, (each / errors[0]).tolist(), strict=False)) for each in errors[1:]]


class Tables(LeastSquares):
    """Measurements beside those of emulators, with the emulators' scatter among the errors.

    emulators: of several tests of one mix, over the constants that all of them hold; measured: {name: (value, standard
    error)}, lengths [m] and times [s]; known: {constant: value}, which are no unknowns; each of ``corrections`` is
    added to lengths of the emulators and multiplies times.
    """

    def __init__(self, emulators: list[Emulator], measured: dict, density: float, corrections, known: dict):
        self.emulators, self.measured, self.corrections = emulators, measured, corrections
        low, high = np.max([each.low for each in emulators], 0), np.min([each.high for each in emulators], 0)
        names = " and ".join(each.scene for each in emulators)
        require(np.all(low < high), f"table: those of {names} have no mix in common; must be studies that overlap")
        scales = {name: float(scale(name, density)) for name in emulators[0].constants}
        self.point = np.clip(np.log([known.get(name, by) / by for name, by in scales.items()]), low, high)
        self.free = np.array([name not in known for name in scales])
        given, self.paired = ~self.free, tuple(scales) == BINGHAM and self.free.all()
        if tuple(scales) == BINGHAM:
            covered(known, (low[given], high[given]), np.log([known[name] / scales[name] for name in known]), density)
        for name in known:
            scales.pop(name)
        super().__init__(scales, np.array([low, high])[:, self.free])
        self.weigh([each.scatter for each in emulators])
        axes, chi2 = self.grid(*self.bounds)
        require(chi2.min() < FAILED**2, "t500: no mix of the table reaches a slump flow of 50 cm")
        best = np.unravel_index(chi2.argmin(), chi2.shape)
        self.point = np.array([axis[k] for axis, k in zip(axes, best, strict=True)])  # from which a search begins
        self.weigh([each.scatter_at(*self.point) for each in emulators])

    def weigh(self, scatters: list[dict]) -> None:
        """Set the standard errors, with these scatters of the emulators."""
        scatter = {name: value for each in scatters for name, value in each.items()}
        self.errors = {
            name: float(np.hypot(error, scatter.get(name, 0.0) * (value if is_time(name) else 1.0)))
            for name, (value, error) in self.measured.items()
        }

    def mix(self, at) -> np.ndarray:
        """Logarithms of all constants over their scales."""
        point = self.point.copy()
        point[self.free] = at
        return point

    def model(self, *point, grid=False) -> dict[str, np.ndarray]:
        """The corrected measurements at logarithms of the constants over their scales."""
        found = {name: each for it in self.emulators for name, each in it.at(*point, grid=grid).items()}
        for name, by in (pair for each in self.corrections for pair in each.items()):
            found[name] = found[name] * by if is_time(name) else found[name] + by
        return found

    def beside(self, model) -> np.ndarray:
        """Residuals of a model over the errors, a row a measurement; FAILED where a mix has none, as of T500."""
        pairs = self.measured.items()
        apart = [over(name, model[name], value) / self.errors[name] for name, (value, _) in pairs]
        return np.nan_to_num(apart, nan=FAILED)

    def residuals(self, at) -> np.ndarray:
        """Residuals of the model over the errors at a point."""
        return self.beside(self.model(*self.mix(at)))

    def grid(self, low, high, nodes=NODES) -> tuple[list, np.ndarray]:
        """An axis for each constant between two points, and chi squared at all combinations."""
        ends = zip(self.mix(low), self.mix(high), nodes, self.free, strict=False)
        axes = [np.linspace(first, last, count if free else 1) for first, last, count, free in ends]
        return axes, (self.beside(self.model(*axes, grid=True)) ** 2).sum(0)

    def ends(self, at, least: float) -> np.ndarray:
        """Logarithms (unknowns, 2) of the ends of intervals within which the least squares over the other constants
        rise by no more than RISE (profile likelihood), which stays true where the measurements say nothing of a
        constant; nan where an end is open: beyond the bounds, or only for the end of the yield stresses."""
        wide = 2.0 * np.sqrt(RISE * np.diag(self.covariance(self.slopes(at))))
        beside = np.ptp(self.bounds, axis=0) / (min(NODES) - 1)
        axes, chi2 = self.grid(*self.bounds)
        near = np.stack(np.meshgrid(*axes, indexing="ij"), -1)[chi2 <= least + RISE][:, self.free]
        room = np.clip([at - wide, at + wide, *(near - beside), *(near + beside)], *self.bounds)
        axes, chi2 = self.grid(room.min(0), room.max(0))
        rise, found = np.maximum(chi2 - min(least, chi2.min()), 0.0), []
        for k in np.flatnonzero(self.free):
            profile = rise.min(tuple(other for other in range(rise.ndim) if other != k))
            inside = np.flatnonzero(profile <= max(RISE, profile.min()))
            for last, beyond in ((inside[0], inside[0] - 1), (inside[-1], inside[-1] + 1)):
                opened = not 0 <= beyond < len(profile)
                if k == 1 and self.paired and not opened:
                    opened = np.isclose(axes[0][rise[:, beyond].argmin()], self.bounds[:, 0]).any()
                root = np.sqrt(profile[[last, beyond * (not opened)]])  # of the rise is about linear
                found.append(np.nan if opened else np.interp(RISE**0.5, root, axes[k][[last, beyond]]))
        return np.reshape(found, (-1, 2))

    def pairs(self, least: float) -> dict[float, float]:
        """The best yield stress [Pa] at each of VISCOSITIES [Pa s] that fits, by viscosity."""
        by = np.array(list(self.scales.values()))
        within = [eta for eta in VISCOSITIES if self.bounds[0, 1] <= np.log(eta / by[1]) <= self.bounds[1, 1]]
        yields = np.linspace(*self.bounds[:, 0], YIELDS)
        chi2 = (self.beside(self.model(yields, np.log(within / by[1]), grid=True)) ** 2).sum(0)
        best = (by[0] * np.exp(yields[chi2.argmin(0)])).tolist()
        known = zip(within, best, chi2.min(0), strict=True)
        return {eta: tau for eta, tau, each in known if each - least <= RISE}


def fit(
    emulators: list[Emulator], measured: dict, density: float, corrections=(), known=None
) -> Calibration | FrictionalMix:
    """The constants that fit ``measured``, {name: (value, standard error)}, or those that are not ``known``, {name of
    the constant: value in SI units}: a Calibration, or a FrictionalMix of emulators over its constants; ``corrections``
    as of Tables."""
    tables = Tables(emulators, measured, density, corrections, known or {})
    at = tables.point[tables.free]
    at = tables.solve(at).x if len(at) else at
    least = float(np.sum(tables.residuals(at) ** 2))
    ends, pairs = tables.ends(at, least), tables.pairs(least) if tables.paired else {}
    if pairs and np.isnan(ends[1]).any():  # any of these is as good: the one of a usual mix
        usual = min(pairs, key=lambda eta: abs(np.log(eta / emulators[0].usual["plastic_viscosity"])))
        at = np.log(np.divide([pairs[usual], usual], list(tables.scales.values())))
    given = {name: Constant(*[value] * 5, UNITS[name]) for name, value in (known or {}).items()}
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
