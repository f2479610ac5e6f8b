"""Expected errors of a slump cone, and model and spacing for a wanted accuracy, from measurements of
benchmarks/models.py against finite elements with inertia. Dimensionless: lengths over the height H, two numbers of a
mix."""

import csv
import math
from dataclasses import dataclass, replace
from itertools import combinations, groupby
from operator import itemgetter
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..units import SceneError, require

MEASURED = Path(__file__).parent / "accuracy.csv"
MAX_ACCURACY = 0.1  # largest accuracy to ask for [m]; a larger number was meant in millimetres
MAX_VOLUME_ERROR = 0.01  # of a model that is chosen [-]: a coarse cone may have the right slump by luck
GRAVITY, DENSITY, HEIGHT = 9.81, 2300.0, 0.3  # of the standard cone [m/s2], [kg/m3], [m]
# Twice the standard deviation of the difference of a run from the mean of five, over the standard deviation of a run
SCATTER_FACTOR = 2.0 * math.sqrt(1.0 + 1.0 / 5.0)
# A mould that is lifted, by benchmarks/lifted.py: what lifting changes of the slump and of half of the slump flow, at
# 10 mm beside rings of 5 mm, and in rings beside half the step: largest differences, summed, over the spacing; and the
# coarsest spacing over H
LIFTED = {"axisymmetric": (0.27, 0.36, 1.0 / 30.0), "full": (0.16, 0.33, 1.0 / 15.0)}
# range of these: slowest and fastest speed [m/s], softest and stiffest mix [Pa], [Pa s]
SLOWEST, FASTEST, LIFTED_MIXES = 0.06, 0.3, ((100.0, 50.0), (500.0, 50.0))
STANDARD = {"base_diameter": 2.0 / 3.0, "top_diameter": 1.0 / 3.0}  # of the cone that was measured, over its height


class MixNumbers(NamedTuple):
    """Dimensionless numbers of a Bingham mix in a cone of height H."""

    yield_number: float  # tau_y/(rho g H)
    viscosity_number: float  # eta/(rho sqrt(g H^3))

    @classmethod
    def of(cls, yield_value: float, plastic_viscosity: float, density: float = DENSITY, height: float = HEIGHT):
        """Make a mix from yield stress [Pa], plastic viscosity [Pa s], density [kg/m3] and height [m]."""
        return cls(
            yield_value / (density * GRAVITY * height), plastic_viscosity / (density * (GRAVITY * height**3) ** 0.5)
        )

    def __str__(self):
        """Format the mix as yield stress and plastic viscosity in the standard cone at the standard density."""
        tau_y = self.yield_number * DENSITY * GRAVITY * HEIGHT
        eta = self.viscosity_number * DENSITY * (GRAVITY * HEIGHT**3) ** 0.5
        return "{:g} Pa and {:g} Pa s".format(*(float(f"{number:.3g}") for number in (tau_y, eta)))


REFERENCE_MIX = MixNumbers.of(1000.0, 50.0)  # the stiffest mix that is meant where none is given


class ModelErrors(NamedTuple):
    """Errors of a model and a spacing for a mix, measured (a row of the file) or interpolated."""

    model: str
    spacing: float  # over H
    yield_number: float
    viscosity_number: float
    slump: float  # largest error of the slump at any time, over H
    reach: float  # error of half of the slump flow at rest, over H
    volume: float  # largest error of the volume at any time [-]
    cpu_seconds: float  # to rest, without compiling
    # standard deviations, over H, of slump and half of the slump flow of runs whose particles start 1e-6 l0 aside
    slump_scatter: float
    reach_scatter: float

    @property
    def mix(self) -> MixNumbers:
        """Mix of this row."""
        return MixNumbers(self.yield_number, self.viscosity_number)

    @property
    def error(self) -> float:
        """Larger of the errors of slump and reach, over H."""
        return max(self.slump, self.reach)

    def of_one_run(self) -> "ModelErrors":
        """Errors of one run: those of the mean of five, and the scatter of runs."""
        slump, reach = (
            error + SCATTER_FACTOR * scatter
            for error, scatter in ((self.slump, self.slump_scatter), (self.reach, self.reach_scatter))
        )
        return self._replace(slump=slump, reach=reach)


def error_table() -> list[ModelErrors]:
    """Every row of the file of measured errors."""
    lines = [line for line in MEASURED.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    return [ModelErrors(model, *map(float, numbers)) for model, *numbers in csv.reader(lines[1:])]


# ---- interpolation ---------------------------------------------------------------------------------------------
def log_coordinates(mix) -> tuple[float, float]:
    """Logarithms of the two numbers of a mix, the coordinates for interpolation."""
    return math.log(max(mix.yield_number, 1e-30)), math.log(max(mix.viscosity_number, 1e-30))


def weighted_mean(rows, weights) -> ModelErrors:
    """Weighted mean of all numbers of rows of one model."""
    return ModelErrors(rows[0].model, *np.dot(weights, [row[1:] for row in rows]).tolist())


def interpolate_in_mixes(rows: list[ModelErrors], mix: MixNumbers) -> ModelErrors | None:
    """Interpolate errors for a mix from rows of one model and spacing, linearly in the smallest triangle of measured
    mixes around it; None where no triangle surrounds it."""

    def size(corners):
        return sum(math.dist(log_coordinates(a), log_coordinates(b)) for a, b in combinations(corners, 2))

    for corners in sorted(combinations(rows, 3), key=size):
        triangle = np.vstack([np.transpose([log_coordinates(row) for row in corners]), np.ones(3)])
        if abs(np.linalg.det(triangle)) > 1e-9:
            weights = np.linalg.solve(triangle, [*log_coordinates(mix), 1.0])
            if weights.min() > -1e-6:  # numbers in the file are rounded
                return weighted_mean(corners, weights)._replace(spacing=rows[0].spacing, **mix._asdict())
    return None


def expected(model: str, spacing: float, mix: MixNumbers, rows: list[ModelErrors] | None = None) -> ModelErrors | None:
    """Expected errors of a model, a spacing over H and a mix, with the scatter of runs added: interpolated between the
    two nearest measured spacings, linear in the logarithm. None outside of the measured range."""
    rows = sorted(row for row in (error_table() if rows is None else rows) if row.model == model)
    found = [interpolate_in_mixes(list(some), mix) for _, some in groupby(rows, key=itemgetter(0, 1))]
    finer = [it for it in found if it and it.spacing <= spacing * (1.0 + 1e-6)]
    coarser = [it for it in found if it and it.spacing >= spacing * (1.0 - 1e-6)]
    if not finer or not coarser:
        return None
    fine, coarse = finer[-1], coarser[0]
    spacing = min(max(spacing, fine.spacing), coarse.spacing)  # numbers in the file are rounded
    part = math.log(spacing / fine.spacing) / math.log(coarse.spacing / fine.spacing) if spacing > fine.spacing else 0.0
    row = weighted_mean([fine, coarse], [1.0 - part, part])
    return row.of_one_run()._replace(spacing=spacing, **mix._asdict())


def nearest(mix: MixNumbers) -> MixNumbers:
    """Measured mix nearest to a mix by the logarithms of the two numbers."""
    return min(
        (row.mix for row in error_table()), key=lambda other: math.dist(log_coordinates(mix), log_coordinates(other))
    )


def errors_of_run(summary: dict) -> tuple[MixNumbers, float, ModelErrors | None] | None:
    """Mix and height [m] of a run, from its summary, and its expected errors, None where no such mix was measured.
    None instead of all three if the run is of another kind than those measured: the scheme implicit, a cone of standard
    shape at any scale whose mould is gone at once, or lifted off the whole or rings, one Bingham mix."""
    given, mixes = summary.get("parameters", {}), summary.get("materials") or []
    walls = summary.get("numerics", {}).get("walls", "surfaces")
    if (summary["scene"], summary["scheme"], walls, len(mixes)) != ("slump", "implicit", "surfaces", 1):
        return None
    mix, height = mixes[0], given.get("height")
    bingham = mix.get("law") == "Bingham" and mix["yield_value"] and not mix.get("friction_angle")
    if (
        not (height and bingham)
        or mix.get("critical_strain_rate") is not None
        or any(not math.isclose(given.get(key, 0.0), part * height, rel_tol=1e-6) for key, part in STANDARD.items())
    ):
        return None
    mix = MixNumbers.of(mix["yield_value"], mix["plastic_viscosity"], mix["density"], height)
    error = expected(given.get("model"), given.get("spacing", 0.0) / height, mix)
    if given.get("lift_speed") is None:
        return mix, height, error
    error = error and errors_of_lifted(error, given["lift_speed"] * math.sqrt(HEIGHT / height))
    return (mix, height, error) if error else None


def errors_of_lifted(error: ModelErrors, speed: float) -> ModelErrors | None:
    """Expected errors with a mould lifted at a ``speed`` [m/s], at the scale of the standard cone, from the errors with
    a mould that is gone at once; None outside of the measured range."""
    soft, stiff = (MixNumbers.of(*mix) for mix in LIFTED_MIXES)
    between = soft.yield_number <= error.yield_number <= stiff.yield_number
    as_viscous = 0.5 <= error.viscosity_number / soft.viscosity_number <= 2.0
    slump, reach, coarsest = LIFTED.get(error.model, (0.0, 0.0, 0.0))
    fine, slow = error.spacing <= coarsest * (1.0 + 1e-6), SLOWEST <= speed <= FASTEST
    lifted = error._replace(slump=error.slump + slump * error.spacing, reach=error.reach + reach * error.spacing)
    return lifted if between and as_viscous and fine and slow else None


# ---- choice of model and spacing -------------------------------------------------------------------------------
@dataclass(frozen=True)
class Choice:
    """Model and spacing chosen for a wanted accuracy, with their expected error and cost."""

    model: str
    spacing: float  # [m]
    error: float  # largest error of the slump at any time, and of half of the slump flow at rest [m]
    volume_error: float  # largest at any time [-]
    cpu_seconds: float  # to rest, without compiling
    where: str  # mixes for which that was measured

    def __str__(self):
        return (
            f"model = {self.model}, spacing = {1e3 * self.spacing:g} mm, scheme = implicit: slump and half of the "
            f"slump flow within {1e3 * self.error:.1f} mm in {self.cpu_seconds:.2g} CPU-seconds and some to compile, "
            f"{self.where}"
        )


def choices(mix: MixNumbers | None = None, height: float = HEIGHT, lift_speed: float | None = None) -> list[Choice]:
    """Every measured model and spacing with its error for this mix, the cheapest first. No error is less than the error
    of a finer spacing, so that a small error by luck does not count."""
    found = []
    for _, rows in groupby(sorted(error_table()), key=itemgetter(0, 1)):  # model and spacing
        row, where = errors_for_mix([row.of_one_run() for row in rows], mix)
        if row and lift_speed:
            row = errors_of_lifted(row, lift_speed * math.sqrt(HEIGHT / height))
        if row:
            facts = height * row.error, row.volume, row.cpu_seconds, f"measured for {where}, standard cone"
            found.append(Choice(row.model, round(height * row.spacing, 9), *facts))
    promised = [replace(c, error=max(o.error for o in found if o.model == c.model and o.spacing <= c.spacing))
                for c in found]  # fmt: skip
    return sorted(promised, key=lambda choice: choice.cpu_seconds)


def errors_for_mix(rows: list[ModelErrors], mix: MixNumbers | None) -> tuple[ModelErrors | None, str]:
    """Errors and cost for a mix from rows of one model and spacing, and as text the mixes for which they were measured:
    interpolated, or of the nearest mix if none surround it; without a mix, the largest errors and the mean cost of all
    mixes of 50 Pa s."""
    if mix is None:
        rows = [row for row in rows if math.isclose(row.viscosity_number, REFERENCE_MIX.viscosity_number, rel_tol=1e-3)]
        return weighted_mean(rows, np.full(len(rows), 1.0 / len(rows)))._replace(
            **{key: max(getattr(row, key) for row in rows) for key in ("slump", "reach", "volume")}
        ), f"Bingham mixes of 100 to {REFERENCE_MIX}"
    if between := interpolate_in_mixes(rows, mix):
        return between, "mixes beside this one"
    nearest_mix = nearest(mix)
    return next((row for row in rows if row.mix == nearest_mix), None), f"the nearest mix, {nearest_mix}"


def choose(
    accuracy: float,
    model: str | None = None,
    spacing: float | None = None,
    mix: MixNumbers | None = None,
    height: float = HEIGHT,
    lift_speed: float | None = None,
) -> Choice:
    """Choose the cheapest model and spacing whose slump and reach are expected within ``accuracy`` [m] of the
    reference, and whose volume is kept within 1 %; a model or a spacing [m] that is given stays. With a ``lift_speed``
    [m/s] of the mould those with its error. SceneError if no measured one is that accurate."""
    require(
        accuracy <= MAX_ACCURACY,
        f"accuracy = {accuracy:g} m: must be at most {MAX_ACCURACY:g} m (0.005 or 5mm for 5 mm)",
    )
    fitting = [
        c
        for c in choices(mix, height, lift_speed)
        if model in (None, c.model) and (spacing is None or math.isclose(c.spacing, spacing, rel_tol=1e-6))
    ]
    keeping = [choice for choice in fitting if choice.volume_error <= MAX_VOLUME_ERROR]
    for choice in keeping:
        if choice.error <= accuracy:
            return choice
    given = ", ".join(
        ([f"model = {model}"] if model else []) + ([f"spacing = {spacing} m"] if spacing is not None else [])
    )
    best = min(keeping, key=lambda choice: choice.error, default=None)
    allowed = f"must be at least {best.error:g} m, which is {best}" if best else "nothing was measured there"
    if not fitting:
        sizes = sorted({f"{1e3 * c.spacing:g}" for c in choices(mix, height) if model in (None, c.model)}, key=float)
        allowed += f"; spacings of {', '.join(sizes)} mm were" if sizes else ""
    if fitting and not keeping:
        allowed += f" that keeps the volume within {100.0 * MAX_VOLUME_ERROR:g} %"
    raise SceneError(f"accuracy = {accuracy:g} m{' with ' if given else ''}{given}: {allowed}")
