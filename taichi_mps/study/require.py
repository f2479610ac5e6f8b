"""Which mixes fill a form: the border between those that do and those that do not, by bisection with few runs.

A stiffer mix fills less, and so does a more viscous one in a given time. So for each plastic viscosity the largest
yield stress that fills is found by bisection, and the result for one plastic viscosity bounds the others. A softer mix
presses more on the form, so a bound on the pressure is compared with that of the stiffest mix that fills.
"""

import math
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from pydantic import Field, model_validator

from ..engine import LAW_OF
from ..input import catalogue
from ..units import Checked, Duration, Ratio, SceneError, Text, YieldValue, quote, require, unit_of
from .case import case_of, run_case
from .emulator import DENSITY, emulator_of
from .sweep import cases, run_cases

MAX_ROUNDS = 30
FILLED = "filled_ratio"


class Wanted(Checked):
    """Requirement of a form: the fraction of it that is filled within a time."""

    filled: Ratio = Field(0.99, description="fraction of the form that must be filled")
    time: Duration = Field(60.0, description="time in which it must be")
    softest: YieldValue = Field(10.0, gt=0.0, description="smallest yield stress that is looked at")
    stiffest: YieldValue = Field(1000.0, gt=0.0, description="largest yield stress that is looked at")
    plastic_viscosity: Text = Field("10,30,100", description="plastic viscosities, as of sweep [Pa s]")
    within: Ratio = Field(0.2, description="how closely the yield stress is found, over itself")

    @model_validator(mode="after")
    def _spans_a_range(self):
        require(
            self.softest < self.stiffest,
            f"softest = {self.softest:g} Pa: must be less than stiffest = {self.stiffest:g} Pa",
        )
        return self


@dataclass(frozen=True)
class Border:
    """Border of the mixes that fill a form, for one plastic viscosity [Pa s]: the largest yield stress [Pa] known to
    fill the form, None where none does, and the smallest known not to, None where all do."""

    plastic_viscosity: float
    fills_up_to: float | None
    empty_from: float | None
    missing: float | None = None  # fraction of the form that ``empty_from`` leaves empty; nan if its run failed
    density: float = DENSITY  # [kg/m3]

    @property
    def slumps_m(self) -> list[tuple[float, float] | None]:
        """Slump and slump flow [m] of the stiffest mix that fills and of the softest that does not, None beyond the
        table of the slump test."""
        return [self.slump_of(self.fills_up_to), self.slump_of(self.empty_from)]

    def slump_of(self, tau_y: float | None) -> tuple[float, float] | None:
        """Return slump and slump flow [m] at a yield stress [Pa]; None without one, and beyond the table."""
        with suppress(SceneError):
            measures = emulator_of().at(*np.log(np.array([tau_y or math.inf, self.plastic_viscosity]) / self.density))
            return float(measures["slump_m"]), float(measures["spread_m"])
        return None

    def __str__(self):
        head = f"plastic viscosity {self.plastic_viscosity:g} Pa s: "
        if self.fills_up_to is None:
            return f"{head}no mix does{self.shortfall(f'{self.empty_from:g} Pa')}"
        order, softer = self.slumps_m
        text = f"{head}fills up to {self.fills_up_to:.3g} Pa"
        if order:
            text += f"; order a slump of {100 * order[0]:.1f} cm, a slump flow of {100 * order[1]:.0f} cm, or more"
        if self.empty_from is None:
            return f"{text}; nothing stiffer was looked at"
        apart = f" (slump {100 * softer[0]:.1f} cm)" if softer else ""
        return text + self.shortfall(f"{self.empty_from:.3g} Pa{apart}")

    def shortfall(self, mix: str) -> str:
        """Format why a mix, described by a text, does not fill the form; '' where it was not run itself."""
        if self.missing is None:
            return ""
        return f"; the run of {mix} failed" if math.isnan(self.missing) else f"; {mix} leave {self.missing:.1%} empty"


def fills(row: dict, wanted: Wanted) -> bool:
    """Whether a run is done and fills the form as wanted."""
    return row["status"] == "done" and row[FILLED] >= wanted.filled


def bracket(mixes: dict, eta: float, low: float, high: float) -> tuple[float | None, float | None]:
    """Return the largest yield stress known to fill at a plastic viscosity ``eta`` and the smallest known not to.

    mixes: {(yield stress, plastic viscosity): whether it fills}; a softer or less viscous mix fills, too.
    """
    full = max((tau_y for (tau_y, each), fills in mixes.items() if fills and each >= eta), default=None)
    least = min((tau_y for (tau_y, each), fills in mixes.items() if not fills and each <= eta), default=math.inf)
    return full, min(
        (tau_y for tau_y in {low, high, *(tau_y for tau_y, _ in mixes)} if tau_y >= least and tau_y > (full or 0.0)),
        default=None,
    )


def next_mixes(mixes: dict, viscosities, low: float, high: float, within: float) -> list[tuple[float, float]]:
    """Return the mixes to run next, at most one for each plastic viscosity whose border is not found yet, the middle
    viscosity first, which bounds most others: the geometric mean of the range, the end on the side of the border, then
    the mean of the bracket."""
    wanted = []
    for eta in sorted(viscosities, key=lambda eta: abs(math.log(eta**2 / (min(viscosities) * max(viscosities))))):
        full, empty = bracket(mixes, eta, low, high)
        if full is None and empty is not None and empty != low:
            wanted.append((low, eta))
        elif full is not None and empty is None and full < high:
            wanted.append((high, eta))
        elif full == empty or (full and empty and empty > full * (1.0 + within)):
            wanted.append((float(f"{math.sqrt((full or low) * (empty or high)):.4g}"), eta))
    return wanted


def runs_to_expect(wanted: Wanted, viscosities: int) -> int:
    """Return the largest number of runs that the borders take: two for each viscosity, then bisections."""
    halvings = math.log2(0.5 * math.log(wanted.stiffest / wanted.softest) / math.log1p(wanted.within))
    return viscosities * (2 + max(0, math.ceil(halvings)))


def require_bingham(form, parameters: dict) -> None:
    """Raise SceneError where the parameters of a form give its mixes another law than Bingham's."""
    fields = catalogue.load(form.name).parameters.model_fields
    given = [name for name in parameters if name in LAW_OF]
    numbers = ", ".join(f"{name} = {quote(form.parameters[name], unit_of(fields[name]))}" for name in given)
    require(
        form.material.straight and not parameters.keys() & form.material.viscous,
        f"{numbers}: the mixes that are looked for, and their slumps, are of Bingham's law; must be left out",
    )


def find_borders(
    scene: str, wanted: Wanted, out, executor="local", workers=None, watch=None, run=run_case, **parameters
):
    """Return the borders of all plastic viscosities and the rows of the runs that found them, which are kept in the
    folder ``out`` and not computed again."""
    low, high = wanted.softest, wanted.stiffest
    fills_all = {"fill_ratio": 1.0} if "fill_ratio" in catalogue.load(scene).parameters.model_fields else {}
    parameters = fills_all | parameters | {"until": wanted.time}
    form = catalogue.build(scene, **parameters)
    require(form.cavity is not None, f"scene {form.name}: has no cavity to fill; must be a form, such as wall")
    ratio = form.parameters.get("fill_ratio", 1.0)
    require(
        ratio >= wanted.filled,
        f"filled = {wanted.filled:g}: of the form only fill_ratio = {ratio:g} is poured; must be at most that",
    )
    require_bingham(form, parameters)
    of_viscosities = cases(scene, plastic_viscosity=wanted.plastic_viscosity)
    viscosities = sorted(each.parameters["plastic_viscosity"] for each in of_viscosities)
    planned, rows = {}, []
    for _ in range(MAX_ROUNDS):
        mixes = {mix: fills(row, wanted) for mix, row in zip(planned, rows, strict=True)}
        new = next_mixes(mixes, viscosities, low, high, wanted.within)
        brackets = {eta: bracket(mixes, eta, low, high) for eta in viscosities}
        if not new:
            break
        planned |= {
            (tau_y, eta): case_of(scene, **parameters, yield_value=tau_y, plastic_viscosity=eta) for tau_y, eta in new
        }
        rows = run_cases(list(planned.values()), out, run, executor, workers, watch)
    by_mix, density = dict(zip(planned, rows, strict=True)), rows[0].get("density") or DENSITY
    missing = {mix: 1.0 - row.get(FILLED, math.nan) for mix, row in by_mix.items()}
    borders = [Border(eta, full, empty, missing.get((empty, eta)), density) for eta, (full, empty) in brackets.items()]
    return borders, rows
