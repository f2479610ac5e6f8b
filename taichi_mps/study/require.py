"""Which mixes fill a form: the border between those that do and those that do not, from as few runs as it needs.

A stiffer mix fills less, and so does a more viscous one in a given time. So for each plastic viscosity the largest
yield stress that fills is found by halving an interval, and what is known of one plastic viscosity bounds the others. A
softer mix presses more on the form, so where a pressure is bounded it is that of this stiffest one that fills.
"""

import math
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from pydantic import Field

from ..problem import catalogue
from ..units import Checked, Duration, Ratio, SceneError, YieldValue, _real, in_unit
from .calibrate import emulator_of
from .case import case
from .case import run as run_case
from .emulator import DENSITY
from .sweep import carry_out, values

MOST_ROUNDS = 30
FILLED = "filled_ratio"
PRESSURE = "pressure_at_"  # a measure of a pressure on the form starts with this


class Wanted(Checked):
    """What a form must be: filled to a share of its room within a time, without more than a pressure on it."""

    filled: Ratio = Field(0.99, description="share of the form that must be filled")
    time: Duration = Field(60.0, description="time in which it must be")
    pressure: _real("Pa", gt=0.0) | None = Field(None, description="largest pressure on the form, if it is bounded")
    softest: YieldValue = Field(10.0, gt=0.0, description="smallest yield stress that is looked at")
    stiffest: YieldValue = Field(1000.0, gt=0.0, description="largest yield stress that is looked at")
    plastic_viscosity: str = Field("10,30,100", description="plastic viscosities, as of sweep [Pa s]")
    within: Ratio = Field(0.2, description="how closely the yield stress is found, over itself")


@dataclass(frozen=True)
class Border:
    """For one plastic viscosity [Pa s]: the largest yield stress that was seen to fill the form, and the smallest that
    was seen not to [Pa]; None where none that was looked at fills it, or all do."""

    plastic_viscosity: float
    fills_up_to: float | None
    empty_from: float | None
    missing: float | None = None  # share of the form that ``empty_from`` leaves empty; nan if its run failed
    pressure: float | None = None  # [Pa] on the form by ``fills_up_to``, where it is bounded
    allowed: float | None = None  # bound of it [Pa]

    def slumps(self, density: float) -> list[tuple[float, float] | None]:
        """Slump and slump flow [m] of the stiffest mix that fills, and of the softest that does not; None beyond the
        table of the slump test."""
        emulator, found = emulator_of(), []
        for tau_y in (self.fills_up_to, self.empty_from):
            at = None if tau_y is None else np.log(np.array([tau_y, self.plastic_viscosity]) / density)
            if at is None or np.any(at < emulator.low) or np.any(at > emulator.high):
                found.append(None)
                continue
            measures = emulator.at(*at)
            found.append((float(measures["slump_m"]), float(measures["spread_m"])))
        return found

    def told(self, density: float) -> str:
        """In a sentence."""
        head = f"plastic viscosity {self.plastic_viscosity:g} Pa s: "
        if self.fills_up_to is None:
            return head + f"no mix does{self.shortfall(f'{self.empty_from:g} Pa')}"
        order, short = self.slumps(density)
        if self.pressure is not None and self.pressure > self.allowed:
            presses = f"{1e-3 * self.pressure:.3g} kPa, over {1e-3 * self.allowed:.3g}"
            return (
                head
                + f"no mix does: up to {self.fills_up_to:.3g} Pa fill it, which press with {presses}, softer ones more"
            )
        text = head + f"fills up to {self.fills_up_to:.3g} Pa"
        if order:
            text += f"; order a slump of {100 * order[0]:.1f} cm, a slump flow of {100 * order[1]:.0f} cm, or more"
        if self.empty_from is None:
            return text + "; nothing stiffer was looked at"
        apart = f" (slump {100 * short[0]:.1f} cm)" if short else ""
        return text + self.shortfall(f"{self.empty_from:.3g} Pa{apart}")

    def shortfall(self, mix: str) -> str:
        """What is wrong with the mix that does not, called so; nothing where it was not run itself."""
        if self.missing is None:
            return ""
        return (
            f"; {mix} leave {self.missing:.1%} empty" if math.isfinite(self.missing) else f"; the run of {mix} failed"
        )


def fills(row: dict, wanted: Wanted) -> bool:
    """Whether a run fills the form as wanted; what failed does not."""
    return row["status"] == "done" and row[FILLED] >= wanted.filled


def pressure_of(row: dict) -> float:
    """The largest pressure [Pa] on the form at the end of a run."""
    pressures = [value for name, value in row.items() if name.startswith(PRESSURE)]
    if not pressures:
        raise SceneError(f"pressure: scene {row['scene']} measures none, {PRESSURE}...; must be one that does, as wall")
    return max(pressures)


def known(mixes: dict, tau_y: float, eta: float) -> bool | None:
    """What runs, {(yield stress, plastic viscosity): whether it fills}, say of a mix: what a stiffer one
    fills, a softer one fills, too. None where they say nothing."""
    if any(full and tau_y <= t and eta <= e for (t, e), full in mixes.items()):
        return True
    if any(not full and tau_y >= t and eta >= e for (t, e), full in mixes.items()):
        return False
    return None


def next_mixes(mixes: dict, viscosities, low: float, high: float, within: float) -> list[tuple[float, float]]:
    """The mixes to run next, one at most of each plastic viscosity whose border is not yet found: the softest and the
    stiffest, then the middle of what is left, in equal ratios."""
    wanted = []
    for eta in viscosities:
        full, short = bracket(mixes, eta, low, high)
        if full is None and short is None or full is None and short > low:
            wanted.append((low, eta))
        elif full is not None and short is None and full < high:
            wanted.append((high, eta))
        elif full is not None and short is not None and short > full * (1.0 + within):
            wanted.append((float(f"{math.sqrt(full * short):.4g}"), eta))
    return wanted


def bracket(mixes: dict, eta: float, low: float, high: float) -> tuple[float | None, float | None]:
    """The largest yield stress known to do at a plastic viscosity, and the smallest known not to."""
    looked = sorted({low, high, *(tau_y for tau_y, _ in mixes)})
    full = [tau_y for tau_y in looked if known(mixes, tau_y, eta) is True]
    short = [tau_y for tau_y in looked if known(mixes, tau_y, eta) is False]
    return max(full, default=None), min(short, default=None)


def require(scene: str, wanted: Wanted, out, executor="local", workers=None, watch=None, run=run_case, **parameters):
    """The borders of all plastic viscosities, and the rows of the runs that found them, which the folder ``out`` keeps
    and does not compute again."""
    if wanted.softest >= wanted.stiffest:
        raise SceneError(f"softest = {wanted.softest:g} Pa: must be less than stiffest = {wanted.stiffest:g} Pa")
    keywords = catalogue.load(scene).parameters.model_fields
    usual = {"fill_ratio": 1.0} | ({"measure_pressure": True} if wanted.pressure is not None else {})
    parameters = {name: value for name, value in usual.items() if name in keywords} | parameters
    form = catalogue.build(scene, **parameters | {"until": wanted.time})
    if form.cavity is None:
        raise SceneError(f"scene {form.name}: has no cavity to fill; must be a form, such as wall")
    poured = form.parameters.get("fill_ratio", 1.0)
    if poured < wanted.filled:
        raise SceneError(
            f"filled = {wanted.filled:g}: of the form only fill_ratio = {poured:g} is poured; must be at most that"
        )
    if wanted.pressure is not None and form.parameters.get("measure_pressure") is False:
        raise SceneError(f"pressure = {wanted.pressure:g} Pa: measure_pressure = False; must be True, or left out")
    viscosities = sorted(map(number, values(wanted.plastic_viscosity, "plastic_viscosity")))
    planned, mixes = {}, {}

    def carried_out(ahead):
        """Whether each mix so far fills, and the rows of all, once those ahead have been run, too."""
        for tau_y, eta in ahead:
            mix = {"yield_value": tau_y, "plastic_viscosity": eta}
            planned.setdefault((tau_y, eta), case(scene, **parameters | mix | {"until": wanted.time}))
        rows = carry_out(list(planned.values()), out, run, executor, workers, watch)
        return {mix: fills(row, wanted) for mix, row in zip(planned, rows, strict=True)}, rows

    for _ in range(MOST_ROUNDS):
        ahead = next_mixes(mixes, viscosities, wanted.softest, wanted.stiffest, wanted.within)
        if not ahead:
            break
        mixes, rows = carried_out(ahead)
    ends = {eta: bracket(mixes, eta, wanted.softest, wanted.stiffest) for eta in viscosities}
    if wanted.pressure is not None:  # by its own run also where others told that a mix fills
        mixes, rows = carried_out([(full, eta) for eta, (full, _) in ends.items() if full is not None])
    borders, by_mix = [], dict(zip(planned, rows, strict=True))
    for eta, (full, short) in ends.items():
        missing = 1.0 - by_mix[short, eta].get(FILLED, math.nan) if (short, eta) in by_mix else None
        border = Border(eta, full, short, missing)
        if wanted.pressure is not None and full is not None:
            border = replace(border, pressure=pressure_of(by_mix[full, eta]), allowed=wanted.pressure)
        borders.append(border)
    return borders, rows


def number(text: str) -> float:
    """A plastic viscosity [Pa s]."""
    value = in_unit("Pa s", text)
    with suppress(ValueError):
        value = float(value)
    if not isinstance(value, float) or not 0.0 < value < math.inf:
        raise SceneError(f"plastic_viscosity = {text}: must be numbers above 0 Pa s, 10,30,100")
    return value


def density_of(rows) -> float:
    """Density [kg/m3] of the mixes of a study."""
    return rows[0].get("density") or DENSITY
