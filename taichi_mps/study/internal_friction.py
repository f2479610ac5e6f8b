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
OTHERS = 20.0, 200.0  # plastic viscosities [Pa s] at which a mix is told, too, where it was not measured
BEYOND = 0.1  # of the logarithm of a plastic viscosity outside of the table, for which its end does
TABLE = Path(__file__).parent / "internal_friction.csv"  # of the standard cone; benchmarks/calibration_tables.py


class Table:
    """Emulators over yield stress and friction angle: ``quarter``, of the model quarter at a usual plastic viscosity,
    and ``rings``, of the axisymmetric model, by the logarithm of plastic viscosity over density. ``usual`` is that of
    the quarters. Rows of the role check, quarters, too, are its error: ``scatter`` [m] at the usual viscosity, with
    that of the quarters in squares, and ``errors`` at the others, the root mean squares by which they are missed."""

    def __init__(self, rows: list[dict]):
        kinds = {}
        for row in rows:
            at = float(np.log(row["plastic_viscosity"] / row["density"]))
            kinds.setdefault((row["role"], row["model"]), {}).setdefault(at, []).append(row)
        ((self.usual, quarters),) = kinds["node", "quarter"].items()
        self.quarter = Emulator(quarters, CONSTANTS)
        self.rings = {at: Emulator(some, CONSTANTS) for at, some in kinds["node", "axisymmetric"].items()}
        self.scatter = {name: self.quarter.scatter[name] for name in CONE}
        self.errors, checks = dict.fromkeys(CONE, 0.0), kinds["check", "quarter"]
        here = self.missed(checks, lambda at: at == self.usual)
        self.errors = self.missed(checks, lambda at: at != self.usual)
        self.scatter = {name: float(np.hypot(self.scatter[name], here[name])) for name in CONE}

    def missed(self, checks: dict[float, list[dict]], some) -> dict[str, float]:
        """Root mean squares [m] by which it is off the cones of ``some`` viscosities."""
        away = []
        for at, row in ((at, row) for at, rows in checks.items() if some(at) for row in rows):
            point = np.log([row["yield_value"] / row["density"], row["friction_angle"]])
            found = AtViscosity(self, at).at(*point)
            away.append([float(found[name]) - row[name] for name in CONE])
        return dict(zip(CONE, np.sqrt(np.mean(np.square(away), 0)).tolist(), strict=True))


class AtViscosity:
    """Slump and slump flow over yield stress and friction angle at one plastic viscosity, as an Emulator: those of the
    quarters, and the change by viscosity of the rings, straight in its logarithm between two of them; so does the error
    of that grow. ``viscosity`` is the logarithm of it over the density."""

    def __init__(self, table: Table, viscosity: float):
        self.table, nodes = table, sorted(table.rings)
        viscosity = float(np.clip(viscosity, nodes[0], nodes[-1]))
        low, high = next(pair for pair in pairwise(nodes) if viscosity <= pair[1])
        part = (viscosity - low) / (high - low)
        self.change = (low, 1.0 - part), (high, part), (table.usual, -1.0)
        every = [table.quarter, *table.rings.values()]
        self.low, self.high = np.max([each.low for each in every], 0), np.min([each.high for each in every], 0)
        self.axes, away = table.quarter.axes, 1.0 - sum(weight for at, weight in self.change[:2] if at == table.usual)
        self.scatter = {name: float(np.hypot(table.scatter[name], away * table.errors[name])) for name in CONE}

    def at(self, yields, angles, grid=False) -> dict[str, np.ndarray]:
        """The measurements at logarithms of yield stress over density and of the angle [degrees]; as Emulator.at."""
        parts = [self.table.quarter.at(yields, angles, grid)]
        for node, weight in self.change:
            parts.append({name: weight * by for name, by in self.table.rings[node].at(yields, angles, grid).items()})
        return {name: sum(part[name] for part in parts) for name in CONE}


@lru_cache(maxsize=1)
def own_table() -> Table:
    """That of the package."""
    return Table(read(TABLE))


def frictional_mix(measured: dict, density: float, known: dict) -> FrictionalMix | None:
    """The mix with internal friction that is nearest to slump and slump flow, {name: (value, standard error)}, by least
    squares, with profile likelihood intervals as of ``fit``. A plastic viscosity that is not ``known`` is the usual one
    of the scene. None where slump or flow was not measured or the table does not reach what is known."""
    if not set(CONE) <= measured.keys():
        return None
    measured, table = {name: measured[name] for name in CONE}, own_table()
    eta = known.get("plastic_viscosity", table.quarter.usual["plastic_viscosity"])
    if not min(table.rings) - BEYOND <= np.log(eta / density) <= max(table.rings) + BEYOND:
        return None
    found = fit_at(eta, measured, density, known)
    if found is None or "plastic_viscosity" in known or not found.near:
        return found
    others = {other: fit_at(other, measured, density, known) for other in OTHERS}
    along = {eta: (mix.yield_value.value, mix.friction_angle.value) for eta, mix in others.items() if mix.near}
    return replace(found, by_viscosity=along)


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
