"""Constants of a mix by end values of standard tests: on a grid over the tables' mixes, the least chi squared is the
best mix, and profile likelihood gives 95 % intervals."""

import numpy as np

from ..io.run_folder import strict
from ..units import require
from .calibration import BINGHAM, CONSTANT_UNITS, MAX_MISFIT, Calibration, Constant, FrictionalMix, deviation, is_time
from .emulator import GRID, Emulator, require_covered, scale

CHI2_95 = 3.841  # 95 % quantile of chi squared with one degree of freedom
RISES = 64.0, 8.0, 0.1, 1e-3, 1e-5, 0.0  # rises of chi squared within which the next grid lies
INTERVALS = 2  # number of the grid for the intervals; those after it refine the best mix
DIFFERENCE_STEP = 0.1  # of an unknown, for finite differences
FAILED_RESIDUAL = 1e3  # residual where a mix has no result
YIELD_STRESSES = 1001  # number tried for the best yield stress at a plastic viscosity
VISCOSITIES = (0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0)  # [Pa s], of ``pairs``


def constants_of(scales: dict[str, float], at, ends, bounds) -> dict[str, Constant]:
    """Return constants by the logarithms over their scales: the best ``at``, (n,), the ``ends`` of the intervals and
    the bounds, (2, n). An end that is nan or beyond the bounds is None."""
    ends = np.where((bounds[0] < ends) & (ends < bounds[1]), ends, np.nan)
    rows = np.exp([at, *ends, *bounds]).T * np.reshape(list(scales.values()), (-1, 1))
    return {name: Constant(*row, CONSTANT_UNITS[name]) for name, row in zip(scales, strict(rows.tolist()), strict=True)}


def prior_of(bounds) -> np.ndarray:
    """Return the inverse covariance of a uniform prior within bounds, (2, unknowns)."""
    return np.diag(12.0 / np.ptp(bounds, axis=0) ** 2)


def worth_of(names, prior, parts) -> list[dict[str, float]]:
    """Return the factor by which the standard error of each constant would grow without each part of the
    measurements, by the slopes of the residuals of the parts, each (points, unknowns), and the prior's
    inverse covariance."""
    parts = np.array([part.T @ part for part in parts])
    covariances = np.linalg.inv([prior + parts.sum(0), *(prior + parts.sum(0) - part for part in parts)])
    errors = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
    return [dict(zip(names, (each / errors[0]).tolist(), strict=False)) for each in errors[1:]]


class Tables:
    """Measurements of one mix beside the emulators of their tests, whose scatter at the best mix is in the errors.

    emulators: over the same constants; measured: {name: (value, standard error)}, lengths [m] and times [s]; known:
    {constant: value}, not fitted; finer: what is added to lengths of the emulators and multiplies times. A mix is given
    by the logarithms of its constants over their ``scales``, within ``bounds``, which are equal for a known constant.
    """

    def __init__(self, emulators: list[Emulator], measured: dict, density: float, finer: dict, known: dict):
        self.emulators, self.measured, self.finer = emulators, measured, finer
        low, high = np.max([each.low for each in emulators], 0), np.min([each.high for each in emulators], 0)
        require(
            np.all(low < high),
            f"table: those of {' and '.join(each.scene for each in emulators)} have no mix in common; must be studies "
            "that overlap",
        )
        self.scales = {name: float(scale(name, density)) for name in emulators[0].constants}
        at = np.log([known.get(name, divisor) / divisor for name, divisor in self.scales.items()])
        given = np.isin(list(self.scales), list(known))
        if tuple(self.scales) == BINGHAM:
            require_covered(known, (low[given], high[given]), at[given], density)
        self.bounds, self.free = np.where(given, np.clip(at, low, high), [low, high]), ~given
        self.set_errors([each.scatter for each in emulators])
        *_, at = next(self.search())
        self.set_errors([each.scatter_at(*at) for each in emulators])

    def set_errors(self, scatters: list[dict]) -> None:
        """Set the standard errors, with the scatter of each emulator included."""
        scatter = {name: value for each in scatters for name, value in each.items()}
        self.errors = {
            name: float(np.hypot(error, scatter.get(name, 0.0) * (value if is_time(name) else 1.0)))
            for name, (value, error) in self.measured.items()
        }

    def model(self, axes) -> dict[str, np.ndarray]:
        """Return the corrected results of the mixes of a grid."""
        found = {name: value for each in self.emulators for name, value in each.at(*axes, grid=True).items()}
        for name, correction in self.finer.items():
            found[name] = found[name] * correction if is_time(name) else found[name] + correction
        return found

    def residuals(self, axes) -> np.ndarray:
        """Return the residuals over the errors of the mixes of a grid, (measurements, ...); FAILED_RESIDUAL for nan."""
        model, pairs = self.model(axes), self.measured.items()
        return np.nan_to_num(
            [deviation(name, model[name], value) / self.errors[name] for name, (value, _) in pairs], nan=FAILED_RESIDUAL
        )

    def search(self):
        """Yield grids, the axes, chi squared and the best mix of each: over all mixes, then around those of the grid
        before whose chi squared is within a rise from the least."""
        ends = self.bounds.T
        for rise in RISES:
            axes = [np.unique(np.linspace(*pair, count)) for pair, count in zip(ends, GRID, strict=False)]
            chi2 = (self.residuals(axes) ** 2).sum(0)
            require(chi2.min() < FAILED_RESIDUAL**2, "t500: no mix of the table reaches a slump flow of 50 cm")
            best = np.unravel_index(chi2.argmin(), chi2.shape)
            yield axes, chi2, np.array([axis[k] for axis, k in zip(axes, best, strict=True)])
            near = np.argwhere(chi2 <= chi2.min() + rise)
            around = np.stack([near.min(0) - 1, near.max(0) + 1], 1)
            ends = [axis[np.clip(pair, 0, len(axis) - 1)] for axis, pair in zip(axes, around, strict=True)]

    def beside_the_others(self) -> dict[str, tuple[float, float]]:
        """Return the least and the greatest value of each measurement by the mixes that are within three standard
        errors of all others, where there are such mixes."""
        axes, *_ = next(self.search())
        model, squares, found = self.model(axes), self.residuals(axes) ** 2, {}
        for name, square in zip(self.measured, squares, strict=True):
            values = model[name][(squares.sum(0) - square <= MAX_MISFIT) & np.isfinite(model[name])]
            if values.size:
                found[name] = float(values.min()), float(values.max())
        return found

    def slopes(self, at) -> np.ndarray:
        """Return the derivatives of the residuals at a mix by the constants that are not known, (measurements, n)."""
        steps = np.diag(np.where(at - DIFFERENCE_STEP < self.bounds[0], DIFFERENCE_STEP, -DIFFERENCE_STEP))[self.free]
        found = np.array([self.residuals(point[:, None]).ravel() for point in (at, *(at + steps))])
        return (found[1:] - found[0]).T / steps.sum(1)

    def interval_ends(self, axes, rise, are_pairs: bool) -> np.ndarray:
        """Return the logarithms (2, constants) of the ends of intervals by profile likelihood on a grid.

        The root of the rise of chi squared, minimized over the other constants, is about linear; it is at most that of
        CHI2_95, also for a constant that the measurements do not determine. nan where an end is open: beyond the bounds
        or, of a viscosity where ``are_pairs``, reached only at an end of the yield stresses.
        """
        ends, most = [], CHI2_95**0.5
        for k, axis in enumerate(axes):
            root = np.pad(
                np.sqrt(rise.min(tuple(other for other in range(len(axes)) if other != k))), 1, constant_values=np.inf
            )
            beyond = np.pad(axis, 1, constant_values=np.nan)
            if are_pairs and k == 1:
                beyond[1:-1][np.isin(axes[0][rise.argmin(0)], self.bounds[:, 0])] = np.nan
            inside = 1 + np.flatnonzero(root[1:-1] <= max(most, root[1:-1].min()))
            for last, after in ((inside[0], inside[0] - 1), (inside[-1], inside[-1] + 1)):
                fraction = (most - root[last]) / (root[after] - root[last])
                ends.append(axis[last - 1] + fraction * (beyond[after] - axis[last - 1]))
        return np.reshape(ends, (-1, 2)).T


def pairs_of(tables: Tables, least: float) -> dict[float, float]:
    """Return the best yield stress [Pa] at each of VISCOSITIES [Pa s] with which a mix fits, by viscosity."""
    (low, high), (tau, eta) = tables.bounds, tables.scales.values()
    within = [each for each in VISCOSITIES if low[1] <= np.log(each / eta) <= high[1]]
    yields = np.linspace(low[0], high[0], YIELD_STRESSES)
    chi2 = (tables.residuals([yields, np.log(np.divide(within, eta))]) ** 2).sum(0)
    best = (tau * np.exp(yields[chi2.argmin(0)])).tolist()
    return {each: b for each, b, misfit in zip(within, best, chi2.min(0), strict=True) if misfit - least <= CHI2_95}


def fit(
    emulators: list[Emulator], measured: dict, density: float, finer=None, known=None
) -> Calibration | FrictionalMix:
    """Fit constants that are not ``known``, {name: value}, to ``measured``, {name: (value, standard error)}, SI units.

    The result is a FrictionalMix where the emulators have a friction angle, else a Calibration. finer: see Tables.
    """
    known = known or {}
    tables = Tables(emulators, measured, density, finer or {}, known)
    *_, (_, final, at) = grids = list(tables.search())
    axes, chi2, _ = grids[INTERVALS]
    are_bingham, least = emulators[0].constants == BINGHAM, float(final.min())
    are_pairs = are_bingham and not known
    ends, pairs = (
        tables.interval_ends(axes, np.maximum(chi2 - least, 0.0), are_pairs),
        pairs_of(tables, least) if are_pairs else {},
    )
    if pairs and np.isnan(ends[:, 1]).any():  # all pairs fit equally: take the one nearest to the default viscosity
        nearest = min(pairs, key=lambda eta: abs(np.log(eta / emulators[0].defaults["plastic_viscosity"])))
        at = np.log(np.divide([pairs[nearest], nearest], list(tables.scales.values())))
    given = {name: Constant(*[value] * 5, CONSTANT_UNITS[name]) for name, value in known.items()}
    fitted, parts = [name for name in tables.scales if name not in known], tables.slopes(at)[:, None]
    return (Calibration if are_bingham else FrictionalMix)(
        constants=constants_of(tables.scales, at, ends, tables.bounds) | given,
        density=float(density),
        measured=measured,
        errors=tables.errors,
        model={name: float(value.item()) for name, value in tables.model(at[:, None]).items()},
        misfit=least,
        by_viscosity=pairs,
        worth=dict(zip(measured, worth_of(fitted, prior_of(tables.bounds[:, tables.free]), parts), strict=True)),
    )
