"""The Bingham constants of a mix from its slump test, with intervals from the errors of the measurements."""

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from pydantic import Field

from ..units import Checked, Density, Duration, Length, SceneError, Viscosity, checked
from .calibration import CONSTANTS, Calibration, Constant, short
from .case import REACHED
from .emulator import DENSITY, Emulator
from .results import read

TABLE = Path(__file__).parent / "slump.csv"  # a sweep of the standard cone, rings of 10 mm; docs/howto/calibrate.md
RISE = 3.841  # of chi squared, one degree of freedom, 95 %
ZOOMS = 2  # onto where the misfit is near its least
VISCOSITIES, USUAL = (10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0), 50.0  # [Pa s]


def fit(emulator: Emulator, measured: dict, density: float, correction=None, known=None) -> Calibration:
    """The constants that fit ``measured`` {slump_m, spread_m or t500_s: (value, standard error)}, or the yield stress
    alone where the plastic viscosity is ``known`` [Pa s].

    The least squares of all measurements over their errors, with the emulator's scatter among them, and the interval of
    each constant in which the least squares over the other rise by no more than 3.84 (profile likelihood): it needs no
    derivative, so it stays true where the measurements say nothing of a constant. ``correction`` is added to the
    emulator's lengths and multiplies its times.
    """
    from scipy.optimize import least_squares

    correction = correction or {}

    def corrected(measures):
        added = {name: value + correction.get(name, 0.0) for name, value in measures.items()}
        return added | {"t500_s": measures["t500_s"] * correction.get("t500_s", 1.0)}

    errors = {}
    for name, (value, error) in measured.items():
        scatter = emulator.scatter.get(name, 0.0) * (value if name == "t500_s" else 1.0)
        errors[name] = float(np.hypot(error, scatter))

    def residuals(measures):
        model = corrected(measures)
        return np.array([(model[name] - value) / errors[name] for name, (value, _) in measured.items()])

    def misfit(axes):
        return np.nan_to_num((residuals(emulator.at(*axes, grid=True)) ** 2).sum(0), nan=np.inf)  # nan: no T500 there

    axes = emulator.axes if known is None else [emulator.axes[0], np.log([known / density])]
    chi2 = misfit(axes)
    if not np.isfinite(chi2).any():
        raise SceneError("t500: no mix of the table spreads to 500 mm")
    for _ in range(ZOOMS):
        limit = chi2.min() + 4.0 * RISE + unevenness(chi2)
        axes = [around(axis, chi2.min(1 - k) <= limit) for k, axis in enumerate(axes)]
        chi2 = misfit(axes)
    best = np.unravel_index(np.argmin(chi2), chi2.shape)
    start = np.array([axis[k] for axis, k in zip(axes, best, strict=True)])

    free = [k for k, axis in enumerate(axes) if len(axis) > 1]

    def near(values):
        point = start.copy()
        point[free] = values
        return np.nan_to_num(residuals(emulator.at(*point)), nan=1e3)

    step = np.array([axes[k][1] - axes[k][0] for k in free])
    box = np.maximum(start[free] - step, emulator.low[free]), np.minimum(start[free] + step, emulator.high[free])
    polished = least_squares(near, start[free], bounds=box, x_scale=step)
    point, least = start.copy(), min(2.0 * polished.cost, chi2[best])
    if 2.0 * polished.cost < chi2[best]:
        point[free] = polished.x
    if known is not None:
        ends = interval(axes[0], chi2[:, 0] - least, density)
        looked = density * np.exp(emulator.axes[0][[0, -1]])
        yield_value = Constant(float(density * np.exp(point[0])), *ends, *looked.tolist())
        model = {name: float(value) for name, value in corrected(emulator.at(*point)).items()}
        return Calibration(yield_value, Constant(*[known] * 5), measured, model, float(least), {})
    ends = np.isclose(axes[0][chi2.argmin(0)][:, None], emulator.axes[0][[0, -1]]).any(1)  # a softer or stiffer mix
    intervals = [interval(axes[0], chi2.min(1) - least, density), interval(axes[1], chi2.min(0) - least, density, ends)]
    along = {}
    for eta in VISCOSITIES:
        fits = misfit((axes[0], np.log([eta / density])))[:, 0] if within(eta, axes[1], density) else np.array([np.inf])
        if fits.min() - least <= RISE:
            along[eta] = float(density * np.exp(axes[0][fits.argmin()]))
    if None in intervals[1] and along:  # any of these is as good: the one of a usual concrete
        usual = min(along, key=lambda eta: abs(np.log(eta / USUAL)))
        point = np.log(np.array([along[usual], usual]) / density)
    values, constants = density * np.exp(point), []
    for value, ends, axis in zip(values, intervals, emulator.axes, strict=True):
        constants.append(Constant(float(value), *ends, *(density * np.exp(axis[[0, -1]])).tolist()))
    model = {name: float(value) for name, value in corrected(emulator.at(*point)).items()}
    return Calibration(*constants, measured, model, float(least), along)


def within(eta, axis, density) -> bool:
    """Does a plastic viscosity lie on an axis of logarithms over the density?"""
    return axis[0] <= np.log(eta / density) <= axis[-1]


def unevenness(chi2):
    """By how much a grid's least value may lie above the least between its nodes: the change to the nodes beside it."""
    i, j = np.unravel_index(np.argmin(chi2), chi2.shape)
    beside = chi2[max(i - 1, 0) : i + 2, max(j - 1, 0) : j + 2]
    return beside[np.isfinite(beside)].max() - chi2[i, j]


def around(axis, inside):
    """An axis of as many nodes over what is inside and a node on either side of it."""
    first, last = np.flatnonzero(inside)[[0, -1]]
    return np.linspace(axis[max(first - 1, 0)], axis[min(last + 1, len(axis) - 1)], len(axis))


def interval(axis, rise, density, open_at=None):
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
        ends.append(float(density * np.exp(axis[last] + part * (axis[beyond] - axis[last]))))
    return ends


def emulator_of(table=None) -> Emulator:
    """That of a study's folder or table, by default the package's own; made once, and again when the table changes."""
    path = Path(table) if table else TABLE
    file = path / "results.csv" if path.is_dir() else path
    return _emulator(path, file.stat().st_mtime_ns if file.is_file() else 0)


@lru_cache(maxsize=4)
def _emulator(path: Path, changed: int) -> Emulator:
    return Emulator(read(path))


class Measurements(Checked):
    """What was measured in a slump test, and how well: lengths [m], time [s], density [kg/m3]."""

    slump: Length | None = Field(None, description="slump")
    spread: Length | None = Field(None, description="diameter of the spread, mean of two")
    t500: Duration | None = Field(None, description="time to a spread of 500 mm")
    plastic_viscosity: Viscosity | None = Field(None, description="plastic viscosity, if known")
    rho: Density = Field(DENSITY, description="density")
    slump_error: Length = Field(0.005, description="standard error of the slump")
    spread_error: Length = Field(0.01, description="standard error of the spread")
    t500_error: Duration = Field(0.2, description="standard error of the time")


@checked
def calibrate(test: Measurements, study: str | None = None, check: bool = True) -> Calibration:
    """Yield stress and plastic viscosity of a mix from what was measured in its slump test: the keywords are those of
    ``Measurements``.

    ``study`` is one of the slump test to look the answer up in, by default the package's own of the standard cone with
    the mould gone at once. With ``check`` the cone is computed once more at half the spacing with the constants
    found, and they are corrected by the difference.
    """
    slump, spread, t500 = test.slump, test.spread, test.t500
    given = {"slump_m": (slump, test.slump_error), "spread_m": (spread, test.spread_error)}
    given["t500_s"] = t500, test.t500_error
    measured = {name: pair for name, pair in given.items() if pair[0] is not None}
    if not measured:
        raise SceneError("calibrate: give at least one of --slump, --spread, --t500")
    if t500 and spread and spread + 3.0 * test.spread_error < REACHED:
        raise SceneError(
            f"t500 = {t500:g} s: with spread = {spread:g} m it never spread to 0.5 m; leave one of them out"
        )
    emulator = emulator_of(study)
    height = emulator.settings.get("height", 0.3)
    if slump and slump >= height:
        raise SceneError(
            f"slump = {slump:g} m: must be less than {height:g} m, the height of the cone; 21cm is a length, too"
        )
    largest = {"spread": (spread or 0.0, 10.0 * height)}
    largest |= {"slump_error": (test.slump_error, height), "spread_error": (test.spread_error, height)}
    for key, (value, most) in largest.items():
        if value >= most:
            raise SceneError(f"{key} = {value:g} m: must be less than {most:g} m; 21cm and 5mm are lengths, too")
    base = emulator.settings.get("base_diameter", 0.2)
    if spread and spread + 3.0 * test.spread_error < base:
        raise SceneError(f"spread = {spread:g} m: must be more than {base:g} m, the base of the cone")
    if slump and spread:
        check_room(emulator, slump - 3.0 * test.slump_error, spread + 3.0 * test.spread_error, slump, spread)
    known = test.plastic_viscosity
    low, high = test.rho * np.exp(emulator.axes[1][[0, -1]])
    if known is not None and not low <= known <= high:
        raise SceneError(
            f"plastic_viscosity = {known:g} Pa s: must be {short(low)} to {short(high)} Pa s, what the table covers"
        )
    found = fit(emulator, measured, test.rho, known=known)
    if not check:
        return with_each_alone(emulator, found, test.rho)
    apart = difference(emulator, found, test.rho)
    corrected = fit(emulator, measured, test.rho, apart, known)
    return with_each_alone(emulator, replace(corrected, finer=apart), test.rho)


def check_room(emulator: Emulator, least: float, widest: float, slump: float, spread: float) -> None:
    """SceneError where even with three standard errors, ``least`` slump and ``widest`` spread [m], a cylinder around
    the body holds less than the mould."""
    height = emulator.settings.get("height", 0.3)
    base, top = (emulator.settings.get(f"{end}_diameter", usual) for end, usual in (("base", 0.2), ("top", 0.1)))
    mould = np.pi / 12.0 * height * (base**2 + base * top + top**2)
    room = np.pi / 4.0 * widest**2 * (height - max(0.0, least))
    if room < mould:
        raise SceneError(
            f"slump = {slump:g} m with spread = {spread:g} m: leaves room for {1e3 * room:.1f} l at most, and the "
            f"mould holds {1e3 * mould:.1f} l; one of them must be misread"
        )


def with_each_alone(emulator: Emulator, found: Calibration, density: float) -> Calibration:
    """A contradictory one with what slump and spread say alone, at its plastic viscosity."""
    lengths = {name: pair for name, pair in found.measured.items() if name.endswith("_m")}
    if not found.contradictory or len(lengths) < 2:
        return found
    eta, alone = found.plastic_viscosity.value, {}
    for name, pair in lengths.items():
        constant = fit(emulator, {name: pair}, density, found.finer, eta).yield_value
        alone[name] = constant.value, constant.lower, constant.upper
    return replace(found, alone=alone)


def difference(emulator: Emulator, found: Calibration, density: float) -> dict:
    """What a finer run at the constants found measures beyond the emulator: lengths [m], and the ratio of T500."""
    from .case import case, run

    mix = {name: getattr(found, name).value for name in CONSTANTS}
    finer = case("slump", **emulator.settings | mix | {"density": density, "spacing": 0.5 * emulator.spacing})
    row = run(finer)
    if row["status"] == "failed":
        raise SceneError(f"the finer run failed: {row['reason']}")
    table = emulator.at(*np.log(np.array(list(mix.values())) / density))
    apart = {name: row[name] - float(table[name]) for name in ("slump_m", "spread_m")}
    if row["t500_s"] and np.isfinite(table["t500_s"]):
        apart["t500_s"] = row["t500_s"] / float(table["t500_s"])
    return apart
