"""The Bingham constants of a mix from its slump test, with intervals from the errors of the measurements."""

from dataclasses import asdict, dataclass, field, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from ..quantity import Density, Duration, Length, SceneError, checked
from .emulator import REACHED, Emulator
from .results import read

TABLE = Path(__file__).parent / "slump.csv"  # a sweep of the standard cone, axisymmetric, 10 mm; docs/studies.md
RISE = 3.841  # of chi squared, one degree of freedom, 95 %
CONTRADICTION = 9.0  # a misfit of three standard errors
NAMES = {"slump_m": "slump", "spread_m": "spread", "t500_s": "T500"}
CONSTANTS = {"yield_value": ("yield value", "Pa"), "plastic_viscosity": ("plastic viscosity", "Pa s")}


@dataclass(frozen=True)
class Constant:
    """A constant of the mix, SI units: the best value and the ends of its 95 % interval.

    An end is None where the measurements do not bound the constant within the table, which reaches from ``low`` to
    ``high``. Without either end it is not determined, and ``value`` is one of many that fit.
    """

    value: float
    lower: float | None
    upper: float | None
    low: float
    high: float

    @property
    def determined(self) -> bool:
        return self.lower is not None and self.upper is not None

    def told(self, unit: str) -> str:
        """In words."""
        ends = f"{self.low:.3g} to {self.high:.3g} {unit}"
        if self.determined:
            return f"{self.value:.3g} {unit}, 95 %: {self.lower:.3g} to {self.upper:.3g} {unit}"
        if self.lower is None and self.upper is None:
            return f"not determined by these measurements: anything from {ends} fits them"
        bound = f"at most {self.upper:.3g}" if self.lower is None else f"at least {self.lower:.3g}"
        return f"not determined by these measurements: {bound} {unit} (95 %; looked for from {ends})"


@dataclass(frozen=True)
class Calibration:
    """What a slump test says of its mix: constants, the measures of the model there, the misfit in standard errors."""

    yield_value: Constant
    plastic_viscosity: Constant
    measured: dict[str, tuple[float, float]]  # value and standard error, SI units
    model: dict[str, float]
    misfit: float  # chi squared
    finer: dict[str, float] = field(default_factory=dict)  # the run that checked: finer minus table, ratio for t500_s

    @property
    def contradictory(self) -> bool:
        return self.misfit > CONTRADICTION

    def facts(self) -> dict:
        """Everything, JSON-ready."""
        both = {name: getattr(self, name) for name in CONSTANTS}
        both = {name: asdict(constant) | {"determined": constant.determined} for name, constant in both.items()}
        return asdict(self) | both | {"contradictory": self.contradictory}

    def __str__(self):
        lines = [f"{word:18} {getattr(self, name).told(unit)}" for name, (word, unit) in CONSTANTS.items()]
        for name, (value, error) in self.measured.items():
            factor, unit = (100.0, "cm") if name.endswith("_m") else (1.0, "s")
            found = f"{factor * value:.2f} +- {factor * error:.2f} {unit}, of the model {factor * self.model[name]:.2f}"
            lines.append(f"{NAMES[name]:18} {found}")
        if self.contradictory:
            lines.append("no Bingham mix has all of these: the measurements contradict each other, or the model")
        if self.finer:
            apart = [f"{NAMES[name]} {1e3 * value:+.1f} mm" for name, value in self.finer.items() if name != "t500_s"]
            apart += [f"T500 {100.0 * (value - 1.0):+.1f} %" for name, value in self.finer.items() if name == "t500_s"]
            apart = ", ".join(apart)
            lines.append(f"the finer run      {apart} beside the table; the constants are corrected by it")
        return "\n".join(lines)


def fit(emulator: Emulator, measured: dict, density: float, correction: dict | None = None) -> Calibration:
    """The constants that fit ``measured`` {slump_m, spread_m or t500_s: (value, standard error)}.

    The least squares of all measurements over their errors, and the interval of each constant in which the least
    squares over the other rise by no more than 3.84 (profile likelihood): it needs no derivative, so it stays true where
    the measurements say nothing of a constant. ``correction`` is added to the emulator's lengths, multiplies its times.
    """
    from scipy.optimize import least_squares

    correction = correction or {}

    def corrected(measures):
        added = {name: value + correction.get(name, 0.0) for name, value in measures.items()}
        return added | {"t500_s": measures["t500_s"] * correction.get("t500_s", 1.0)}

    def residuals(measures):
        model = corrected(measures)
        return np.array([(model[name] - value) / error for name, (value, error) in measured.items()])

    chi2 = np.nan_to_num((residuals(emulator.grid) ** 2).sum(0), nan=np.inf)  # nan: no T500 there
    if not np.isfinite(chi2).any():
        raise SceneError("t500: no mix of the table spreads to 500 mm")
    best = np.unravel_index(np.argmin(chi2), chi2.shape)
    start = np.array([axis[k] for axis, k in zip(emulator.axes, best, strict=True)])
    step = [axis[1] - axis[0] for axis in emulator.axes]
    around = np.maximum(start - step, emulator.low), np.minimum(start + step, emulator.high)

    def near(point):
        return np.nan_to_num(residuals({name: value[0] for name, value in emulator.at(point).items()}), nan=1e3)

    polished = least_squares(near, start, bounds=around, x_scale=step)
    point = polished.x if 2.0 * polished.cost < chi2[best] else start
    least = min(2.0 * polished.cost, chi2[best])
    values = density * np.exp(point)
    constants = []
    for k, axis in enumerate(emulator.axes):
        ends = (density * np.exp(axis[[0, -1]])).tolist()
        constants.append(Constant(float(values[k]), *interval(axis, chi2.min(1 - k) - least, density), *ends))
    model = corrected({name: float(value[0]) for name, value in emulator.at(point).items()})
    return Calibration(*constants, measured, model, float(least))


def interval(axis, rise, density):
    """The ends of {rise <= RISE} along an axis as constants; None where it reaches the axis' end."""
    inside = np.flatnonzero(rise <= RISE)
    if len(inside) == 0:  # narrower than the grid
        inside = np.array([np.argmin(rise)])
    ends = []
    for last, beyond in ((inside[0], inside[0] - 1), (inside[-1], inside[-1] + 1)):
        if not 0 <= beyond < len(axis):
            ends.append(None)
            continue
        share = np.sqrt(max(rise[last], 0.0)), np.sqrt(rise[beyond])  # in which the rise is about linear
        part = min(1.0, max(0.0, (RISE**0.5 - share[0]) / (share[1] - share[0]))) if np.isfinite(share[1]) else 0.5
        ends.append(float(density * np.exp(axis[last] + part * (axis[beyond] - axis[last]))))
    return ends


@lru_cache(maxsize=4)
def emulator_of(table: Path) -> Emulator:
    return Emulator(read(table))


@checked
def calibrate(
    slump: Length | None = None,
    spread: Length | None = None,
    t500: Duration | None = None,
    rho: Density = 2300.0,
    slump_error: Length = 0.005,
    spread_error: Length = 0.01,
    t500_error: Duration = 0.2,
    table: str | None = None,
    check: bool = True,
) -> Calibration:
    """Yield value and plastic viscosity of a mix from what was measured in its slump test, lengths [m], time [s].

    ``table`` is a study of the slump test to look the answer up in, by default the package's own of the standard cone
    with the mould gone at once. With ``check`` the cone is computed once more at half the spacing with the constants
    found, and they are corrected by the difference.
    """
    given = {"slump_m": (slump, slump_error), "spread_m": (spread, spread_error), "t500_s": (t500, t500_error)}
    measured = {name: pair for name, pair in given.items() if pair[0] is not None}
    if not measured:
        raise SceneError("calibrate: give at least one of --slump, --spread, --t500")
    if t500 and spread and spread + 3.0 * spread_error < REACHED:
        raise SceneError(
            f"t500 = {t500:g} s: with spread = {spread:g} m it never spread to 0.5 m; leave one of them out"
        )
    emulator = emulator_of(Path(table) if table else TABLE)
    found = fit(emulator, measured, rho)
    if not check:
        return found
    apart = difference(emulator, found, rho)
    corrected = fit(emulator, measured, rho, apart)
    return replace(corrected, finer=apart)


def difference(emulator: Emulator, found: Calibration, density: float) -> dict:
    """What a finer run at the constants found measures beyond the emulator: lengths [m], and the ratio of T500."""
    from .case import case, run

    mix = {name: getattr(found, name).value for name in CONSTANTS}
    row = run(case("slump", **emulator.settings | mix | {"density": density, "spacing": 0.5 * emulator.spacing}))
    if row["status"] == "failed":
        raise SceneError(f"the finer run failed: {row['reason']}")
    table = emulator.at(np.log(np.array(list(mix.values())) / density))
    apart = {name: row[name] - float(table[name][0]) for name in ("slump_m", "spread_m")}
    if row["t500_s"] and np.isfinite(table["t500_s"][0]):
        apart["t500_s"] = row["t500_s"] / float(table["t500_s"][0])
    return apart
