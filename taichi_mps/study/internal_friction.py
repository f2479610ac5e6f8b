"""Yield stress and angle of internal friction of a mix from its slump and slump flow, where no Bingham mix has both."""

from dataclasses import replace
from functools import lru_cache
from itertools import pairwise
from pathlib import Path

import numpy as np

from .calibration import CONE, Constant, FrictionalMix
from .emulator import Emulator, scale
from .fit import LeastSquares, interval, polished, zoomed
from .results import read

CONSTANTS = "yield_value", "friction_angle"
OTHERS = 20.0, 200.0  # other plastic viscosities [Pa s] at which a mix is sought where it was not measured
BEYOND = 0.1  # of the logarithm of a plastic viscosity outside of the table, for which its end does
TABLE = Path(__file__).parent / "internal_friction.csv"  # of the standard cone; benchmarks/calibration_tables.py


class Table:
    """Emulators over yield stress and friction angle, ``planes``, by the logarithm of plastic viscosity over density.
    ``scatter`` [m]: the root mean squares by which they miss a case that they were made without and, added in squares,
    rows of the role check: other mixes, and a finer spacing."""

    def __init__(self, rows: list[dict]):
        kinds = {"node": {}, "check": {}}
        for row in rows:
            at = float(np.log(row["plastic_viscosity"] / row["density"]))
            kinds[row["role"]].setdefault(at, []).append(row)
        self.planes = {at: Emulator(kinds["node"][at], CONSTANTS) for at in sorted(kinds["node"])}
        every = list(self.planes.values())
        self.usual, self.axes = every[0].usual, every[0].axes
        self.low, self.high = np.max([each.low for each in every], 0), np.min([each.high for each in every], 0)
        self.scatter = {name: np.mean([each.scatter[name] ** 2 for each in every]) ** 0.5 for name in CONE}
        missed = np.sqrt(np.mean(np.square(self.missed(kinds["check"])), 0))
        self.scatter = {name: float(np.hypot(self.scatter[name], by)) for name, by in zip(CONE, missed, strict=True)}

    def missed(self, checks: dict[float, list[dict]]) -> list[list[float]]:
        """By how much [m] it is above each of the checks, by the logarithm of their plastic viscosity over density."""
        away = []
        for at, row in ((at, row) for at, rows in checks.items() for row in rows):
            found = AtViscosity(self, at).at(*np.log([row["yield_value"] / row["density"], row["friction_angle"]]))
            away.append([float(found[name]) - row[name] for name in CONE])
        return away


class AtViscosity:
    """Slump and slump flow over yield stress and friction angle at one plastic viscosity, as an Emulator: straight
    between two planes in the logarithm of the viscosity. ``viscosity`` is the logarithm of it over the density."""

    def __init__(self, table: Table, viscosity: float):
        nodes = list(table.planes)
        viscosity = float(np.clip(viscosity, nodes[0], nodes[-1]))
        low, high = next(pair for pair in pairwise(nodes) if viscosity <= pair[1])
        part = (viscosity - low) / (high - low)
        self.planes = (table.planes[low], 1.0 - part), (table.planes[high], part)
        self.low, self.high, self.axes = table.low, table.high, table.axes
        self.scatter = table.scatter

    def at(self, yields, angles, grid=False) -> dict[str, np.ndarray]:
        """The measurements at logarithms of yield stress over density and of the angle [degrees]; as Emulator.at."""
        parts = [(plane.at(yields, angles, grid), weight) for plane, weight in self.planes]
        return {name: sum(weight * part[name] for part, weight in parts) for name in CONE}


@lru_cache(maxsize=1)
def own_table() -> Table:
    """That of the package."""
    return Table(read(TABLE))


def frictional_mix(measured: dict, density: float, known: dict) -> FrictionalMix | None:
    """The mix with internal friction that is nearest to slump and slump flow, {name: (value, standard error)}, by least
    squares, with profile likelihood intervals as of ``fit``. A plastic viscosity that is not ``known`` is the usual one
    of the scene or, where no mix is near with that, the first of OTHERS with which one is. None where slump or flow was
    not measured or the table does not reach what is known."""
    if not set(CONE) <= measured.keys():
        return None
    measured, table = {name: measured[name] for name in CONE}, own_table()
    usual = known.get("plastic_viscosity", table.usual["plastic_viscosity"])
    if not min(table.planes) - BEYOND <= np.log(usual / density) <= max(table.planes) + BEYOND:
        return None
    sought = (usual,) if "plastic_viscosity" in known else (usual, *OTHERS)
    found = {eta: fit_at(eta, measured, density, known) for eta in sought}
    if found[usual] is None or len(found) == 1:
        return found[usual]
    near = {eta: mix for eta, mix in found.items() if mix.near}
    best = next(iter(near), usual)
    others = {eta: (mix.yield_value.value, mix.friction_angle.value) for eta, mix in near.items() if eta != best}
    return replace(found[best], by_viscosity=others)


def fit_at(eta: float, measured: dict, density: float, known: dict) -> FrictionalMix | None:
    """The same at one plastic viscosity [Pa s]."""
    emulator = AtViscosity(own_table(), np.log(eta / density))
    scales = [scale(name, density) for name in CONSTANTS]
    looked = [each * np.exp([low, high]) for each, low, high in zip(scales, emulator.low, emulator.high, strict=True)]
    yield_value = known.get("yield_value")
    if yield_value is not None and not looked[0][0] <= yield_value <= looked[0][1]:
        return None
    squares, axes = LeastSquares(emulator, measured, {}), list(emulator.axes)
    if yield_value is not None:
        axes[0] = np.log([yield_value / density])
    axes, chi2 = zoomed(squares, axes, squares.misfit(axes))
    free = [k for k, axis in enumerate(axes) if len(axis) > 1]
    point, least = polished(squares, axes, chi2, free)
    constants = []
    for k, (value, reach) in enumerate(zip(scales * np.exp(point), looked, strict=True)):
        if k in free:
            ends = interval(axes[k], chi2.min(1 - k) - least, scales[k])
            constants.append(Constant(float(value), *ends, *reach.tolist()))
        else:
            constants.append(Constant(*[yield_value] * 5))
    told = {"worth": squares.worth, "sensitivities": squares.sensitivities}
    return FrictionalMix(
        *constants,
        plastic_viscosity=float(eta),
        given="plastic_viscosity" in known,
        density=float(density),
        measured=measured,
        model={name: float(value) for name, value in squares.model(*point).items()},
        by_viscosity={},
        **{key: squares.by_name(of(point, free), free, CONSTANTS) for key, of in told.items()},
    )
