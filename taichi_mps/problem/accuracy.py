"""Errors to expect of a slump cone, and model and spacing for a wanted one, from what benchmarks/models.py has measured
beside finite elements with inertia. All without units: lengths over the height H, a mix by its two numbers."""

import csv
import math
from dataclasses import dataclass, replace
from itertools import combinations, groupby
from operator import itemgetter
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..units import SceneError

MEASURED = Path(__file__).parent / "accuracy.csv"
COARSEST = 0.1  # [m]; what is asked for beyond is millimetres
MOST_VOLUME_ERROR = 0.02  # at any time [-], beyond which a result is doubted
MOST_VOLUME = 0.01  # largest volume error of what is chosen [-]: a coarse cone may have the right slump by luck
GRAVITY, DENSITY, HEIGHT = 9.81, 2300.0, 0.3  # of the standard cone [m/s2], [kg/m3], [m]
# Twice the standard deviation of what a run is off the mean of five, over that of a run
OFF_THE_MEAN = 2.0 * math.sqrt(1.0 + 1.0 / 5.0)
# Of rings whose mould is lifted, by benchmarks/lifted.py: by how much half the spacing, and half the step at 10 mm,
# change what lifting does at most, summed, over the spacing: of the slump and of half of the slump flow
LIFTED, LIFTED_REACH = 0.53, 0.51
# slowest speed [m/s] and coarsest spacing over H of these, and softest and stiffest mix [Pa], [Pa s]
SLOWEST, LIFTED_SPACING, LIFTED_MIXES = 0.06, 1.0 / 30.0, ((100.0, 50.0), (500.0, 50.0))
STANDARD = {"base_diameter": 2.0 / 3.0, "top_diameter": 1.0 / 3.0}  # of the cone that was measured, over its height


class Mix(NamedTuple):
    """A Bingham mix in a cone of a height H."""

    yield_number: float  # tau_y/(rho g H)
    viscosity_number: float  # eta/(rho sqrt(g H^3))

    @classmethod
    def of(cls, yield_value: float, plastic_viscosity: float, density: float = DENSITY, height: float = HEIGHT):
        """Mix of a yield stress [Pa], a plastic viscosity [Pa s], a density [kg/m3] and a height [m]."""
        return cls(
            yield_value / (density * GRAVITY * height), plastic_viscosity / (density * (GRAVITY * height**3) ** 0.5)
        )

    def __str__(self):
        """Yield stress and plastic viscosity that the mix has in the standard cone at the standard density."""
        eta = self.viscosity_number * DENSITY * (GRAVITY * HEIGHT**3) ** 0.5
        return f"{self.yield_number * DENSITY * GRAVITY * HEIGHT:.3g} Pa and {eta:.3g} Pa s"


USUAL = Mix.of(1000.0, 50.0)  # the last of the mixes that are meant where none is named


class Measured(NamedTuple):
    """A model and a spacing with their errors for a mix: measured, or in between. A row of the file."""

    model: str
    spacing: float  # over H
    yield_number: float
    viscosity_number: float
    slump: float  # largest error of the slump at any time, over H
    reach: float  # error of half of the slump flow at rest, over H
    volume: float  # largest error of the volume at any time [-]
    cpu_seconds: float  # to rest, without compiling
    # standard deviations, over H, of runs whose particles start 1e-6 l0 aside, of slump and of half of the spread
    slump_scatter: float
    reach_scatter: float

    @property
    def mix(self) -> Mix:
        return Mix(self.yield_number, self.viscosity_number)

    @property
    def error(self) -> float:
        """Larger of the errors of slump and reach, over H."""
        return max(self.slump, self.reach)


def measured() -> list[Measured]:
    """Every row of the file of measured errors."""
    lines = [line for line in MEASURED.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    return [Measured(model, *map(float, numbers)) for model, *numbers in csv.reader(lines[1:])]


# ---- between what was measured ---------------------------------------------------------------------------------
def place(mix) -> tuple[float, float]:
    """Coordinates of a mix among others: the logarithms of its numbers."""
    return math.log(max(mix.yield_number, 1e-30)), math.log(max(mix.viscosity_number, 1e-30))


def mean(rows, weights) -> Measured:
    """Weighted mean of all numbers of rows of one model."""
    return Measured(rows[0].model, *np.dot(weights, [row[1:] for row in rows]).tolist())


def at_mix(rows: list[Measured], mix: Mix) -> Measured | None:
    """Errors for a mix by rows of one model and spacing, linear in the smallest triangle of measured mixes around it;
    None where no triangle surrounds it."""

    def size(corners):
        return sum(math.dist(place(a), place(b)) for a, b in combinations(corners, 2))

    for corners in sorted(combinations(rows, 3), key=size):
        triangle = np.vstack([np.transpose([place(row) for row in corners]), np.ones(3)])
        if abs(np.linalg.det(triangle)) > 1e-9:
            weights = np.linalg.solve(triangle, [*place(mix), 1.0])
            if weights.min() > -1e-6:  # numbers in the file are rounded
                return mean(corners, weights)._replace(spacing=rows[0].spacing, **mix._asdict())
    return None


def expected(model: str, spacing: float, mix: Mix, rows: list[Measured] | None = None) -> Measured | None:
    """Errors to expect of a model, a spacing over H and a mix, with the scatter of runs added: interpolated between the
    two nearest measured spacings, linear in the logarithm. None outside of the measured range."""
    rows = sorted(row for row in (measured() if rows is None else rows) if row.model == model)
    found = [at_mix(list(some), mix) for _, some in groupby(rows, key=itemgetter(0, 1))]
    finer = [it for it in found if it and it.spacing <= spacing * (1.0 + 1e-6)]
    coarser = [it for it in found if it and it.spacing >= spacing * (1.0 - 1e-6)]
    if not finer or not coarser:
        return None
    fine, coarse = finer[-1], coarser[0]
    spacing = min(max(spacing, fine.spacing), coarse.spacing)  # numbers in the file are rounded
    part = math.log(spacing / fine.spacing) / math.log(coarse.spacing / fine.spacing) if spacing > fine.spacing else 0.0
    row = mean([fine, coarse], [1.0 - part, part])
    slump, reach = row.slump + OFF_THE_MEAN * row.slump_scatter, row.reach + OFF_THE_MEAN * row.reach_scatter
    return row._replace(spacing=spacing, slump=slump, reach=reach, **mix._asdict())


def nearest(mix: Mix) -> Mix:
    """Measured mix that is nearest to a mix, by the logarithms of the two numbers."""
    return min((row.mix for row in measured()), key=lambda other: math.dist(place(mix), place(other)))


def of_run(summary: dict) -> tuple[Mix, float, Measured | None] | None:
    """Mix and height [m] of a run, from its summary, and the errors to expect, None where no such mix was
    measured. In all None for another run than those that were measured: the scheme implicit, a cone as the
    standard's at any scale, gone at once or lifted in rings, one Bingham mix."""
    given, mixes = summary.get("parameters", {}), summary.get("materials") or []
    walls = summary.get("numerics", {}).get("walls", "surfaces")
    if (summary["scene"], summary["scheme"], walls, len(mixes)) != ("slump", "implicit", "surfaces", 1):
        return None
    mix, height = mixes[0], given.get("height")
    bingham = mix.get("law") == "Bingham" and mix["yield_value"] and not mix.get("friction_angle")
    if not (height and bingham) or mix.get("critical_strain_rate") is not None:
        return None
    if any(not math.isclose(given.get(key, 0.0), part * height, rel_tol=1e-6) for key, part in STANDARD.items()):
        return None
    mix = Mix.of(mix["yield_value"], mix["plastic_viscosity"], mix["density"], height)
    error = expected(given.get("model"), given.get("spacing", 0.0) / height, mix)
    if given.get("lift_speed") is None:
        return mix, height, error
    error = error and of_lifted(error, given["lift_speed"] * math.sqrt(HEIGHT / height))
    return (mix, height, error) if error else None


def of_lifted(error: Measured, speed: float) -> Measured | None:
    """Errors to expect where the mould is lifted, at a ``speed`` [m/s] at the scale of the standard cone, from those of
    the mould that is gone at once; None outside of what was measured."""
    soft, stiff = (Mix.of(*mix) for mix in LIFTED_MIXES)
    between = soft.yield_number <= error.yield_number <= stiff.yield_number
    as_viscous = 0.5 <= error.viscosity_number / soft.viscosity_number <= 2.0
    fine = error.model == "axisymmetric" and error.spacing <= LIFTED_SPACING * (1.0 + 1e-6)
    if not (between and as_viscous and fine and speed >= SLOWEST):
        return None
    more = LIFTED * error.spacing, LIFTED_REACH * error.spacing
    return error._replace(slump=error.slump + more[0], reach=error.reach + more[1])


# ---- a choice --------------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Choice:
    """Model and spacing chosen for a wanted accuracy, with their expected error and cost."""

    model: str
    spacing: float  # [m]
    error: float  # largest error of the slump at any time, and of half of the slump flow at rest [m]
    volume_error: float  # largest at any time [-]
    cpu_seconds: float  # to rest, without compiling
    where: str  # for which mixes that was measured

    def __str__(self):
        return (
            f"model = {self.model}, spacing = {1e3 * self.spacing:g} mm, scheme = implicit: slump and reach within "
            f"{1e3 * self.error:.1f} mm in {self.cpu_seconds:.2g} CPU-seconds and some to compile, {self.where}"
        )


def choices(mix: Mix | None = None, height: float = HEIGHT) -> list[Choice]:
    """Every measured model and spacing with its error for this mix, the cheapest first. No error is less than that of a
    finer spacing, lest a lucky number be promised."""
    found = []
    for _, rows in groupby(sorted(measured()), key=itemgetter(0, 1)):  # model and spacing
        row, where = at_any_mix(list(rows), mix)
        if row:
            facts = height * row.error, row.volume, row.cpu_seconds, f"measured for {where}, standard cone"
            found.append(Choice(row.model, round(height * row.spacing, 9), *facts))
    promised = [replace(c, error=max(o.error for o in found if o.model == c.model and o.spacing <= c.spacing))
                for c in found]  # fmt: skip
    return sorted(promised, key=lambda choice: choice.cpu_seconds)


def at_any_mix(rows: list[Measured], mix: Mix | None) -> tuple[Measured | None, str]:
    """Errors and cost for a mix by rows of one model and spacing, and in words for which mixes they were measured:
    interpolated, or of the nearest mix where none surround it; without a mix the largest errors and the mean cost of
    all mixes of 50 Pa s."""
    if mix is None:
        usual = [row for row in rows if math.isclose(row.viscosity_number, USUAL.viscosity_number, rel_tol=1e-3)]
        worst = {key: max(getattr(row, key) for row in usual) for key in ("slump", "reach", "volume")}
        return mean(usual, np.full(len(usual), 1.0 / len(usual)))._replace(**worst), f"100 to {USUAL}"
    if between := at_mix(rows, mix):
        return between, "mixes beside this one"
    known = nearest(mix)
    return next((row for row in rows if row.mix == known), None), f"the nearest mix, {known}"


def choose(
    accuracy: float,
    model: str | None = None,
    spacing: float | None = None,
    mix: Mix | None = None,
    height: float = HEIGHT,
) -> Choice:
    """Cheapest model and spacing whose slump and reach are expected within ``accuracy`` [m] of the reference, and whose
    volume is kept within 1 %; a model or a spacing [m] that is given stays as it is. SceneError where nothing measured
    is that good."""
    if not accuracy <= COARSEST:
        raise SceneError(f"accuracy = {accuracy:g} m: must be at most {COARSEST:g} m (0.005 or 5mm for 5 mm)")
    fitting = [
        c
        for c in choices(mix, height)
        if model in (None, c.model) and (spacing is None or math.isclose(c.spacing, spacing, rel_tol=1e-6))
    ]
    keeping = [choice for choice in fitting if choice.volume_error <= MOST_VOLUME]
    for choice in keeping:
        if choice.error <= accuracy:
            return choice
    given = ", ".join(
        f"{key} = {value}" for key, value in (("model", model), ("spacing", spacing)) if value is not None
    )
    best = min(keeping, key=lambda choice: choice.error, default=None)
    allowed = f"must be at least {best.error:g} m, which is {best}" if best else "nothing was measured there"
    if fitting and not keeping:
        allowed += f" that keeps the volume within {100.0 * MOST_VOLUME:g} %"
    raise SceneError(f"accuracy = {accuracy:g} m{' with ' * bool(given)}{given}: {allowed}")
