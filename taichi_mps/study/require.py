"""Which mixes fill a form: the border between those that do and those that do not, from as few runs as it needs.

A stiffer mix fills less, and so does a more viscous one in a given time. So for each plastic viscosity the largest
yield stress that fills is found by halving an interval, and what is known of one plastic viscosity bounds the others.
"""

import math
from contextlib import suppress
from dataclasses import dataclass

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
    """For one plastic viscosity [Pa s]: the largest yield stress that was seen to do, and the smallest that was not
    [Pa]; None where all that was looked at does not, or does."""

    plastic_viscosity: float
    does: float | None
    does_not: float | None
    missing: float | None = None  # share of the form that ``does_not`` leaves empty; nan if its run failed

    def slumps(self, density: float) -> list[tuple[float, float] | None]:
        """Slump and slump flow [m] of the mix that does, and of the one that does not; None beyond the table of the
        slump test."""
        emulator, found = emulator_of(), []
        for tau_y in (self.does, self.does_not):
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
        if self.does is None:
            return head + f"no mix does{self.shortfall(f'{self.does_not:g} Pa')}"
        order, short = self.slumps(density)
        text = head + f"fills up to {self.does:.3g} Pa"
        if order:
            text += f"; order a slump of {100 * order[0]:.1f} cm, a slump flow of {100 * order[1]:.0f} cm, or more"
        if self.does_not is None:
            return text + "; nothing stiffer was looked at"
        apart = f" (slump {100 * short[0]:.1f} cm)" if short else ""
        return text + self.shortfall(f"{self.does_not:.3g} Pa{apart}")

    def shortfall(self, mix: str) -> str:
        """What is wrong with the mix that does not, called so; nothing where it was not run itself."""
        if self.missing is None:
            return ""
        return (
            f"; {mix} leave {self.missing:.1%} empty" if math.isfinite(self.missing) else f"; the run of {mix} failed"
        )


def judged(row: dict, wanted: Wanted) -> bool:
    """Whether a run does what is wanted; what failed does not."""
    if row["status"] != "done":
        return False
    full = row[FILLED] >= wanted.filled
    pressures = [value for name, value in row.items() if name.startswith(PRESSURE)]
    if wanted.pressure is not None and not pressures:
        raise SceneError(
            f"pressure = {wanted.pressure:g} Pa: the scene measures none; wall does with --measure-pressure"
        )
    return full and (wanted.pressure is None or max(pressures) <= wanted.pressure)


def known(mixes: dict, tau_y: float, eta: float) -> bool | None:
    """What runs, {(yield stress, plastic viscosity): does}, say of a mix: what a stiffer one does, a softer one does,
    too. None where they say nothing."""
    if any(does and tau_y <= t and eta <= e for (t, e), does in mixes.items()):
        return True
    if any(not does and tau_y >= t and eta >= e for (t, e), does in mixes.items()):
        return False
    return None


def next_mixes(mixes: dict, viscosities, low: float, high: float, within: float) -> list[tuple[float, float]]:
    """The mixes to run next, one at most of each plastic viscosity whose border is not yet found: the softest and the
    stiffest, then the middle of what is left, in equal ratios."""
    wanted = []
    for eta in viscosities:
        does, does_not = bracket(mixes, eta, low, high)
        if does is None and does_not is None or does is None and does_not > low:
            wanted.append((low, eta))
        elif does is not None and does_not is None and does < high:
            wanted.append((high, eta))
        elif does is not None and does_not is not None and does_not > does * (1.0 + within):
            wanted.append((float(f"{math.sqrt(does * does_not):.4g}"), eta))
    return wanted


def bracket(mixes: dict, eta: float, low: float, high: float) -> tuple[float | None, float | None]:
    """The largest yield stress known to do at a plastic viscosity, and the smallest known not to."""
    looked = sorted({low, high, *(tau_y for tau_y, _ in mixes)})
    does = [tau_y for tau_y in looked if known(mixes, tau_y, eta) is True]
    does_not = [tau_y for tau_y in looked if known(mixes, tau_y, eta) is False]
    return max(does, default=None), min(does_not, default=None)


def require(scene: str, wanted: Wanted, out, executor="local", workers=None, watch=None, run=run_case, **parameters):
    """The borders of all plastic viscosities, and the rows of the runs that found them, which the folder ``out`` keeps
    and does not compute again."""
    if wanted.softest >= wanted.stiffest:
        raise SceneError(f"softest = {wanted.softest:g} Pa: must be less than stiffest = {wanted.stiffest:g} Pa")
    form = catalogue.build(scene, **parameters | {"until": wanted.time})
    if form.cavity is None:
        raise SceneError(f"scene {form.name}: has no cavity to fill; must be a form, such as wall")
    poured = form.parameters.get("fill_ratio", 1.0)
    if poured < wanted.filled:
        raise SceneError(
            f"filled = {wanted.filled:g}: of the form only fill_ratio = {poured:g} is poured; must be at most that, or "
            "give --fill-ratio 1"
        )
    if wanted.pressure is not None and form.parameters.get("measure_pressure") is False:
        raise SceneError(f"pressure = {wanted.pressure:g} Pa: is not measured; must be given with --measure-pressure")
    viscosities = sorted(map(number, values(wanted.plastic_viscosity, "plastic_viscosity")))
    planned, mixes, rows = {}, {}, []
    for _ in range(MOST_ROUNDS):
        ahead = next_mixes(mixes, viscosities, wanted.softest, wanted.stiffest, wanted.within)
        if not ahead:
            break
        for tau_y, eta in ahead:
            mix = {"yield_value": tau_y, "plastic_viscosity": eta}
            planned[tau_y, eta] = case(scene, **parameters | mix | {"until": wanted.time})
        rows = carry_out(list(planned.values()), out, run, executor, workers, watch)
        by_key = {row["key"]: row for row in rows}
        mixes = {mix: judged(by_key[it.key], wanted) for mix, it in planned.items()}
    empty = {mix: 1.0 - by_key[it.key].get(FILLED, math.nan) for mix, it in planned.items()}
    borders = []
    for eta in viscosities:
        does, does_not = bracket(mixes, eta, wanted.softest, wanted.stiffest)
        borders.append(Border(eta, does, does_not, empty.get((does_not, eta))))
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
