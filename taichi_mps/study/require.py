"""Which mixes fill a form: the border between those that do and those that do not, from as few runs as it needs.

A stiffer mix fills less, and so does a more viscous one in a given time. So for each plastic viscosity the largest
yield stress that fills is found by halving an interval, and what is known of one plastic viscosity bounds the others. A
softer mix presses more on the form, so where a pressure is bounded it is that of this stiffest one that fills.
"""

import math
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from pydantic import Field

from ..problem import catalogue
from ..units import NUMBERS, Checked, Duration, Ratio, SceneError, Text, YieldValue, real, said, unit_of
from ..units import require as check
from .case import case
from .case import run as run_case
from .emulator import DENSITY, emulator_of
from .sweep import carry_out, cases

MOST_ROUNDS = 30
FILLED = "filled_ratio"
PRESSURE = "pressure_at_"  # a measure of a pressure on the form starts with this


class Wanted(Checked):
    """Requirement of a form: filled to a share of its room within a time, without more than a pressure on it."""

    filled: Ratio = Field(0.99, description="share of the form that must be filled")
    time: Duration = Field(60.0, description="time in which it must be")
    pressure: real("Pa", gt=0.0) | None = Field(None, description="largest pressure on the form, if it is bounded")
    softest: YieldValue = Field(10.0, gt=0.0, description="smallest yield stress that is looked at")
    stiffest: YieldValue = Field(1000.0, gt=0.0, description="largest yield stress that is looked at")
    plastic_viscosity: Text = Field("10,30,100", description="plastic viscosities, as of sweep [Pa s]")
    within: Ratio = Field(0.2, description="how closely the yield stress is found, over itself")


@dataclass(frozen=True)
class Border:
    """Border of the mixes that fill a form, for one plastic viscosity [Pa s]: the largest yield stress that was seen to
    fill the form, and the smallest that was seen not to [Pa]; None where none that was looked at fills it, or all
    do."""

    plastic_viscosity: float
    fills_up_to: float | None
    empty_from: float | None
    missing: float | None = None  # share of the form that ``empty_from`` leaves empty; nan if its run failed
    pressure: float | None = None  # [Pa] on the form by ``fills_up_to``, where it is bounded
    allowed: float | None = None  # bound of it [Pa]
    density: float = DENSITY  # [kg/m3]

    @property
    def slumps_m(self) -> list[tuple[float, float] | None]:
        """Slump and slump flow [m] of the stiffest mix that fills, and of the softest that does not; None beyond the
        table of the slump test."""
        return [self.slump_of(self.fills_up_to), self.slump_of(self.empty_from)]

    def slump_of(self, tau_y: float | None) -> tuple[float, float] | None:
        """Slump and slump flow [m] of a yield stress; None of none, and beyond the table."""
        with suppress(SceneError):
            measures = emulator_of().at(*np.log(np.array([tau_y or math.inf, self.plastic_viscosity]) / self.density))
            return float(measures["slump_m"]), float(measures["spread_m"])
        return None

    def __str__(self):
        head = f"plastic viscosity {self.plastic_viscosity:g} Pa s: "
        if self.fills_up_to is None:
            return f"{head}no mix does{self.shortfall(f'{self.empty_from:g} Pa')}"
        if self.pressure is not None and self.pressure > self.allowed:
            presses = f"{1e-3 * self.pressure:.3g} kPa, over {1e-3 * self.allowed:.3g}"
            mix = f"up to {self.fills_up_to:.3g} Pa fill it"
            return f"{head}no mix does: {mix}, which press with {presses}, softer ones more"
        order, less = self.slumps_m
        text = f"{head}fills up to {self.fills_up_to:.3g} Pa"
        if order:
            text += f"; order a slump of {100 * order[0]:.1f} cm, a slump flow of {100 * order[1]:.0f} cm, or more"
        if self.empty_from is None:
            return f"{text}; nothing stiffer was looked at"
        apart = f" (slump {100 * less[0]:.1f} cm)" if less else ""
        return text + self.shortfall(f"{self.empty_from:.3g} Pa{apart}")

    def shortfall(self, mix: str) -> str:
        """Reason why a mix does not do, called so; nothing where it was not run itself."""
        if self.missing is None:
            return ""
        return f"; the run of {mix} failed" if math.isnan(self.missing) else f"; {mix} leave {self.missing:.1%} empty"


def fills(row: dict, wanted: Wanted) -> bool:
    """Whether a run fills the form as wanted; what failed does not."""
    return row["status"] == "done" and row[FILLED] >= wanted.filled


def pressure_of(row: dict) -> float:
    """The largest pressure [Pa] on the form at the end of a run."""
    pressures = [value for name, value in row.items() if name.startswith(PRESSURE)]
    check(pressures, f"pressure: scene {row['scene']} measures none, {PRESSURE}...; must be one that does, as wall")
    return max(pressures)


def bracket(mixes: dict, eta: float, low: float, high: float) -> tuple[float | None, float | None]:
    """The largest yield stress known to fill at a plastic viscosity, and the smallest known not to, from the runs
    {(yield stress, plastic viscosity): whether it fills}: what a stiffer mix fills, a softer one fills, too."""
    full = max((tau_y for (tau_y, e), fills in mixes.items() if fills and e >= eta), default=None)
    least = min((tau_y for (tau_y, e), fills in mixes.items() if not fills and e <= eta), default=math.inf)
    looked = {low, high, *(tau_y for tau_y, _ in mixes)}
    return full, min((tau_y for tau_y in looked if tau_y >= least and tau_y > (full or 0.0)), default=None)


def next_mixes(mixes: dict, viscosities, low: float, high: float, within: float) -> list[tuple[float, float]]:
    """The mixes to run next, one at most of each plastic viscosity whose border is not yet found, those of the middle
    viscosity first, which tell most of the others: the middle of all, in equal ratios, the end on the side of the
    border, then the middle of what is left."""
    wanted = []
    for eta in sorted(viscosities, key=lambda eta: abs(math.log(eta**2 / (min(viscosities) * max(viscosities))))):
        full, short = bracket(mixes, eta, low, high)
        if full is None and short is not None and short != low:
            wanted.append((low, eta))
        elif full is not None and short is None and full < high:
            wanted.append((high, eta))
        elif full == short or (full and short and short > full * (1.0 + within)):
            wanted.append((float(f"{math.sqrt((full or low) * (short or high)):.4g}"), eta))
    return wanted


def runs_to_expect(wanted: Wanted, viscosities: int) -> int:
    """The most runs that the borders take: of each viscosity the middle and an end, then halvings."""
    halvings = math.log2(0.5 * math.log(wanted.stiffest / wanted.softest) / math.log1p(wanted.within))
    return viscosities * (2 + max(0, math.ceil(halvings)))


def require_bingham(form, parameters: dict) -> None:
    """SceneError where the parameters of a form give its mixes another law than Bingham's."""
    fields = catalogue.load(form.name).parameters.model_fields
    own = [name for name in parameters if name in NUMBERS]
    numbers = ", ".join(f"{name} = {said(form.parameters[name], unit_of(fields[name]))}" for name in own)
    bingham = form.material.straight and not parameters.keys() & form.material.viscous
    check(
        bingham, f"{numbers}: the mixes that are looked for, and their slumps, are of Bingham's law; must be left out"
    )


def require(scene: str, wanted: Wanted, out, executor="local", workers=None, watch=None, run=run_case, **parameters):
    """The borders of all plastic viscosities, and the rows of the runs that found them, which the folder ``out`` keeps
    and does not compute again."""
    look = wanted.softest, wanted.stiffest
    check(look[0] < look[1], "softest = {:g} Pa: must be less than stiffest = {:g} Pa".format(*look))
    keywords = catalogue.load(scene).parameters.model_fields
    usual = {"fill_ratio": 1.0} | ({"measure_pressure": True} if wanted.pressure is not None else {})
    usual = {name: value for name, value in usual.items() if name in keywords}
    parameters = usual | parameters | {"until": wanted.time}
    form = catalogue.build(scene, **parameters)
    check(form.cavity is not None, f"scene {form.name}: has no cavity to fill; must be a form, such as wall")
    poured = form.parameters.get("fill_ratio", 1.0)
    less = f"filled = {wanted.filled:g}: of the form only fill_ratio = {poured:g} is poured; must be at most that"
    check(poured >= wanted.filled, less)
    if wanted.pressure is not None:
        measured = form.parameters.get("measure_pressure") is not False
        check(measured, f"pressure = {wanted.pressure:g} Pa: measure_pressure = False; must be True, or left out")
    require_bingham(form, parameters)
    named = cases(scene, plastic_viscosity=wanted.plastic_viscosity)
    viscosities = sorted(each.parameters["plastic_viscosity"] for each in named)
    planned, rows = {}, []
    for _ in range(MOST_ROUNDS):
        mixes = {mix: fills(row, wanted) for mix, row in zip(planned, rows, strict=True)}
        ahead = next_mixes(mixes, viscosities, *look, wanted.within)
        ends = {eta: bracket(mixes, eta, *look) for eta in viscosities}
        if not ahead and wanted.pressure is not None:  # asked of its own run also where others told that a mix fills
            ahead = [(full, eta) for eta, (full, _) in ends.items() if full is not None and (full, eta) not in planned]
        if not ahead:
            break
        for tau_y, eta in ahead:
            planned[tau_y, eta] = case(scene, **parameters, yield_value=tau_y, plastic_viscosity=eta)
        rows = carry_out(list(planned.values()), out, run, executor, workers, watch)
    by_mix, density = dict(zip(planned, rows, strict=True)), rows[0].get("density") or DENSITY
    missing = {mix: 1.0 - row.get(FILLED, math.nan) for mix, row in by_mix.items()}
    stiffest = {eta: full for eta, (full, _) in ends.items() if wanted.pressure is not None and full is not None}
    presses = {eta: (pressure_of(by_mix[full, eta]), wanted.pressure) for eta, full in stiffest.items()}
    return [
        Border(eta, full, short, missing.get((short, eta)), *presses.get(eta, (None, None)), density)
        for eta, (full, short) in ends.items()
    ], rows
