"""The constants of a mix that fit what was measured, with intervals, and which measurement determines which."""

import numpy as np

from ..units import require
from .calibration import BINGHAM, Calibration, Constant, FrictionalMix, is_time, over
from .emulator import NODES, Emulator, scale

RISE = 3.841  # of chi squared, one degree of freedom, 95 %
ZOOMS = 2  # onto where the misfit is near its least
VISCOSITIES = (0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0)  # at which pairs are told [Pa s]
FEW = 3  # pairs, of which closer ones are sought
STEP = 0.01  # of the logarithm of a constant, between two points that tell a sensitivity


class LeastSquares:
    """Measurements beside those of emulators, over their standard errors, with the emulators' scatter among them.

    emulators: of several tests of one mix, over the constants that all of them hold; measured: {name: (value, standard
    error)}, lengths [m] and times [s]; ``correction`` is added to lengths of the emulators and multiplies times.
    """

    def __init__(self, emulators: list[Emulator], measured: dict, density: float, correction: dict):
        self.emulators, self.measured, self.correction = emulators, measured, correction
        self.constants = emulators[0].constants
        self.low = np.max([each.low for each in emulators], 0)
        self.high = np.min([each.high for each in emulators], 0)
        names = " and ".join(each.scene for each in emulators)
        apart = f"table: those of {names} have no mix in common; must be studies that overlap"
        require(np.all(self.low < self.high), apart)
        self.axes = [np.linspace(*ends) for ends in zip(self.low, self.high, NODES, strict=False)]
        self.scales = np.array([float(scale(name, density)) for name in self.constants])
        self.weigh([each.scatter for each in emulators])

    def weigh(self, scatters: list[dict]) -> None:
        """Set the standard errors, with these scatters of the emulators."""
        scatter = {name: value for each in scatters for name, value in each.items()}
        self.errors = {
            name: float(np.hypot(error, scatter.get(name, 0.0) * (value if is_time(name) else 1.0)))
            for name, (value, error) in self.measured.items()
        }

    def model(self, *point, grid=False) -> dict[str, np.ndarray]:
        """The corrected measurements at logarithms of the constants over their scales."""
        found = {name: each for it in self.emulators for name, each in it.at(*point, grid=grid).items()}
        by = {name: float(is_time(name)) for name in found} | self.correction
        return {name: each * by[name] if is_time(name) else each + by[name] for name, each in found.items()}

    def residuals(self, *point, grid=False) -> np.ndarray:
        """Residuals of the model over the errors, a row a measurement; nan where a mix has none, as of T500."""
        model = self.model(*point, grid=grid)
        return np.array(
            [over(name, model[name], value) / self.errors[name] for name, (value, _) in self.measured.items()]
        )

    def misfit(self, axes) -> np.ndarray:
        """Chi squared at all combinations of the axes, one for each constant."""
        return np.nan_to_num((self.residuals(*axes, grid=True) ** 2).sum(0), nan=np.inf)

    def sensitivities(self, point, free) -> np.ndarray:
        """Derivatives of the residuals by the logarithms of the ``free`` constants, (measurements, constants)."""
        slopes = np.zeros((len(self.measured), len(free)))
        for column, k in enumerate(free):
            ends = np.clip(point[k] + STEP * np.array([-0.5, 0.5]), self.low[k], self.high[k])
            sides = np.array([np.where(np.arange(len(point)) == k, end, point) for end in ends])
            slopes[:, column] = np.diff(self.residuals(*sides.T), axis=1)[:, 0] / np.diff(ends)
        return np.nan_to_num(slopes)

    def by_name(self, table, free) -> dict[str, dict[str, float]]:
        """A table (measurements, free constants) by their names."""
        names = [self.constants[k] for k in free]
        return {
            test: dict(zip(names, row, strict=True)) for test, row in zip(self.measured, table.tolist(), strict=True)
        }

    def pairs(self, axes, viscosities, least) -> dict[float, float]:
        """The best yield stress [Pa] at each of these plastic viscosities [Pa s] that fits, by viscosity."""
        within = [eta for eta in viscosities if axes[1][0] <= np.log(eta / self.scales[1]) <= axes[1][-1]]
        fits = [self.misfit((axes[0], np.log([eta / self.scales[1]])))[:, 0] for eta in within]
        best = {
            eta: axes[0][each.argmin()] for eta, each in zip(within, fits, strict=True) if each.min() - least <= RISE
        }
        return {eta: float(self.scales[0] * np.exp(at)) for eta, at in best.items()}


def fit(
    emulators: list[Emulator], measured: dict, density: float, correction=None, known=None
) -> Calibration | FrictionalMix:
    """The constants that fit ``measured``, {name: (value, standard error)}, or those that are not ``known``, {name of
    the constant: value in SI units}: a Calibration, or a FrictionalMix of emulators over its constants.

    The least squares of all measurements over their errors, and the interval of each constant in which the least
    squares over the others rise by no more than 3.84 (profile likelihood): it needs no derivative, so it stays true
    where the measurements say nothing of a constant. ``correction`` as of LeastSquares.
    """
    squares, known = LeastSquares(emulators, measured, density, correction or {}), known or {}
    names, scales = squares.constants, squares.scales
    axes = [
        np.clip(np.log([known[name] / each]), *axis[[0, -1]]) if name in known else axis
        for name, each, axis in zip(names, scales, squares.axes, strict=True)
    ]
    chi2 = squares.misfit(axes)
    require(np.isfinite(chi2).any(), "t500: no mix of the table reaches a slump flow of 50 cm")
    near = [axis[k] for axis, k in zip(axes, np.unravel_index(chi2.argmin(), chi2.shape), strict=True)]
    squares.weigh([each.scatter_at(*near) for each in emulators])
    axes, chi2 = zoomed(squares, axes, squares.misfit(axes))
    free = [k for k, axis in enumerate(axes) if len(axis) > 1]
    point, least = polished(squares, axes, chi2, free)
    paired = names == BINGHAM and len(free) == 2
    # open where, at the best yield stress of the table, a softer or stiffer mix would fit better
    open_at = np.isclose(axes[0][chi2.argmin(0)][:, None], squares.axes[0][[0, -1]]).any(1) if paired else None
    intervals = [
        interval(axis, profile(chi2, k) - least, scales[k], open_at if k == 1 else None) for k, axis in enumerate(axes)
    ]
    along = squares.pairs(axes, VISCOSITIES, least) if paired else {}
    if None in intervals[1] and along:  # any of these is as good: the one of a usual mix
        usual = min(along, key=lambda eta: abs(np.log(eta / emulators[0].usual["plastic_viscosity"])))
        point = np.log(np.array([along[usual], usual]) / scales)
    if paired and len(along) < FEW:
        along = squares.pairs(axes, closer(axes[1], chi2.min(0) - least, scales[1]), least)
    constants = {
        name: Constant(*[known[name]] * 5) if name in known else Constant(float(best), *ends, *reach.tolist())
        for name, best, ends, reach in zip(
            names, scales * np.exp(point), intervals, (scales * np.exp([squares.low, squares.high])).T, strict=True
        )
    }
    slopes = squares.sensitivities(point, free)
    return (Calibration if names == BINGHAM else FrictionalMix)(
        **constants,
        density=float(density),
        measured=measured,
        errors=squares.errors,
        model={name: float(value) for name, value in squares.model(*point).items()},
        misfit=float(least),
        by_viscosity=along,
        sensitivities=squares.by_name(slopes, free),
        worth=squares.by_name(worth(slopes[:, None], np.diag(12.0 / (squares.high - squares.low)[free] ** 2)), free),
    )


def worth(parts, before) -> np.ndarray:
    """By which factor the standard error of each constant would grow without each part of the measurements, (parts,
    constants): with J the slopes of the residuals of all ``parts``, each (points, constants), the covariance is
    (JT J + P)^-1, where P = ``before``, 12 over the squared length of a range, is what that alone says of it."""
    whole = before + sum(part.T @ part for part in parts)
    without = [np.diag(np.linalg.inv(whole - part.T @ part)) for part in parts]
    return np.sqrt(np.array(without) / np.diag(np.linalg.inv(whole))).reshape(len(parts), len(before))


def zoomed(squares: LeastSquares, axes, chi2):
    """Axes over where the misfit is near its least, and the misfit there."""
    for _ in range(ZOOMS):
        limit = chi2.min() + 4.0 * RISE + unevenness(chi2)
        axes = [around(axis, profile(chi2, k) <= limit) for k, axis in enumerate(axes)]
        chi2 = squares.misfit(axes)
    return axes, chi2


def profile(chi2, k):
    """The least misfit along axis ``k`` of a grid, over all others."""
    return chi2.min(tuple(other for other in range(chi2.ndim) if other != k))


def polished(squares: LeastSquares, axes, chi2, free):
    """The point of least squares beside the best node of a grid, and its misfit."""
    from scipy.optimize import least_squares

    best = np.unravel_index(np.argmin(chi2), chi2.shape)
    point, least = np.array([axis[k] for axis, k in zip(axes, best, strict=True)]), chi2[best]
    if not free:
        return point, least
    start, step = point.copy(), np.array([axes[k][1] - axes[k][0] for k in free])

    def near(values):
        start[free] = values
        return np.nan_to_num(squares.residuals(*start), nan=1e3)

    box = np.maximum(point[free] - step, squares.low[free]), np.minimum(point[free] + step, squares.high[free])
    found = least_squares(near, point[free], bounds=box, x_scale=step)
    if 2.0 * found.cost < least:
        point[free], least = found.x, 2.0 * found.cost
    return point, least


def closer(axis, rise, scale) -> list[float]:
    """Five plastic viscosities of two figures [Pa s] over what fits of an axis."""
    ends = scale * np.exp(axis[rise <= max(RISE, rise.min())][[0, -1]])
    return [float(f"{eta:.2g}") for eta in np.geomspace(*ends, 5)]


def unevenness(chi2):
    """By how much a grid's least value may lie above the least between its nodes: the change to the nodes beside it."""
    best = np.unravel_index(np.argmin(chi2), chi2.shape)
    beside = chi2[tuple(slice(max(i - 1, 0), i + 2) for i in best)]
    return beside[np.isfinite(beside)].max() - chi2[best]


def around(axis, inside):
    """An axis of as many nodes over what is inside and a node on either side of it."""
    first, last = np.flatnonzero(inside)[[0, -1]]
    return np.linspace(axis[max(first - 1, 0)], axis[min(last + 1, len(axis) - 1)], len(axis))


def interval(axis, rise, scale, open_at=None):
    """The ends of {rise <= RISE} along an axis as constants; None where it reaches the axis' end, or a node at which it
    is open whether something beyond the table would fit better."""
    inside = np.flatnonzero(rise <= max(RISE, rise.min()))
    ends = []
    for last, beyond in ((inside[0], inside[0] - 1), (inside[-1], inside[-1] + 1)):
        if not 0 <= beyond < len(axis) or (open_at is not None and open_at[beyond]):
            ends.append(None)
            continue
        inner, outer = np.sqrt(max(rise[last], 0.0)), np.sqrt(rise[beyond])  # the root of the rise is about linear
        part = min(1.0, max(0.0, (RISE**0.5 - inner) / (outer - inner))) if np.isfinite(outer) else 0.5
        ends.append(float(scale * np.exp(axis[last] + part * (axis[beyond] - axis[last]))))
    return ends
