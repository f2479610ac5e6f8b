"""Yield stress and angle of internal friction of a mix from its slump and slump flow, where no Bingham mix has both;
its plastic viscosity from T500, where that was measured."""

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from .calibration import CONE, FRICTIONAL, Constant, FrictionalMix
from .emulator import MEASURED, Emulator, as_measured, is_time, scale
from .fit import LeastSquares, interval, polished, profile, zoomed
from .results import read

TESTS = tuple(MEASURED["slump"])
PLANE = "yield_value", "friction_angle"  # the constants of the emulator at one plastic viscosity
OTHERS = 20.0, 200.0  # other plastic viscosities [Pa s] at which a mix is sought where it was not measured
BEYOND = 0.1  # of the logarithm of a plastic viscosity outside of the table, for which its end does
NODES = 31  # of the plastic viscosities at which a fit looks first
TABLE = Path(__file__).parent / "internal_friction.csv"  # of the standard cone; benchmarks/calibration_tables.py


class Table:
    """Slump, slump flow and T500 over yield stress, friction angle and plastic viscosity, as an Emulator: emulators
    over the first two, ``planes``, and between them straight in the logarithm of the viscosity over the density.
    ``scatter``: the root mean squares by which they miss a case that they were made without and, added in squares,
    rows of the role check: other mixes, and a finer spacing; of lengths [m], of times the logarithm."""

    def __init__(self, rows: list[dict]):
        nodes = {}
        for row in (row for row in rows if row["role"] == "node"):
            nodes.setdefault(float(np.log(row["plastic_viscosity"] / row["density"])), []).append(row)
        self.planes = {at: Emulator(nodes[at], PLANE) for at in sorted(nodes)}
        every, ends = list(self.planes.values()), [min(nodes), max(nodes)]
        self.usual, self.axes = every[0].usual, [*every[0].axes, np.linspace(*ends, NODES)]
        self.low = np.append(np.max([each.low for each in every], 0), ends[0])
        self.high = np.append(np.min([each.high for each in every], 0), ends[1])
        missed = self.missed([row for row in rows if row["role"] == "check"])
        self.scatter = {
            name: float(np.sqrt(np.mean([each.scatter[name] ** 2 for each in every]) + np.nanmean(missed[name] ** 2)))
            for name in TESTS
        }

    def covers(self, known: dict, density: float) -> bool:
        """Does it reach these constants, a plastic viscosity within BEYOND?"""
        for name, low, high in zip(FRICTIONAL, self.low, self.high, strict=True):
            room = BEYOND if name == "plastic_viscosity" else 0.0
            if name in known and not low - room <= np.log(known[name] / scale(name, density)) <= high + room:
                return False
        return True

    def missed(self, checks: list[dict]) -> dict[str, np.ndarray]:
        """By how much it is above each of the checks, as ``scatter`` has it; nan where one of them has no T500."""
        density = np.array([row["density"] for row in checks])
        mixes = [np.array([row[name] for row in checks]) / scale(name, density) for name in FRICTIONAL]
        found = {name: np.log(value) if is_time(name) else value for name, value in self.at(*np.log(mixes)).items()}
        return {name: found[name] - Emulator.values(name, MEASURED["slump"][name], checks) for name in TESTS}

    def at(self, yields, angles, viscosities, grid=False) -> dict[str, np.ndarray]:
        """The measurements at logarithms of yield stress over density, of the angle [degrees] and of plastic viscosity
        over density; as Emulator.at, for which the end of the table does beyond it."""
        nodes, found = list(self.planes), dict.fromkeys(TESTS, 0.0)
        for plane, one in zip(self.planes.values(), np.eye(len(nodes)), strict=True):
            weight = np.interp(viscosities, nodes, one)
            if weight.any():
                for name, value in plane.surfaces(yields, angles, grid).items():
                    found[name] = found[name] + weight * (value[..., None] if grid else value)
        return as_measured(found, "slump")


@lru_cache(maxsize=1)
def own_table() -> Table:
    """That of the package."""
    return Table(read(TABLE))


def frictional_mix(measured: dict, density: float, known: dict) -> FrictionalMix | None:
    """The mix with internal friction that is nearest to slump, slump flow and T500, {name: (value, standard error)}, by
    least squares, with profile likelihood intervals as of ``fit``. A plastic viscosity that is not ``known`` is found
    with the others from T500. Where that was not measured, it is the usual one of the scene or, where no mix is near
    with that, the first of OTHERS with which one is. None where slump or flow was not measured or the table does not
    reach what is known."""
    if not set(CONE) <= measured.keys():
        return None
    measured, table = {name: measured[name] for name in TESTS if name in measured}, own_table()
    usual = table.usual["plastic_viscosity"]
    if not table.covers({"plastic_viscosity": usual} | known, density):
        return None
    if "t500_s" in measured or "plastic_viscosity" in known:
        return fit_with(known, measured, density)
    found = {eta: fit_with(known | {"plastic_viscosity": eta}, measured, density) for eta in (usual, *OTHERS)}
    near = {eta: mix for eta, mix in found.items() if mix.near}
    best = next(iter(near), usual)
    others = {eta: (mix.yield_value.value, mix.friction_angle.value) for eta, mix in near.items() if eta != best}
    return replace(found[best], usual=True, by_viscosity=others)


def fit_with(known: dict, measured: dict, density: float) -> FrictionalMix | None:
    """That with the constants that are known; None where no such mix spreads to 500 mm and T500 was measured."""
    table = own_table()
    scales = [scale(name, density) for name in FRICTIONAL]
    axes = [
        np.log([known[name] / each]) if name in known else axis
        for name, each, axis in zip(FRICTIONAL, scales, table.axes, strict=True)
    ]
    squares = LeastSquares(table, measured, {})
    chi2 = squares.misfit(axes)
    if not np.isfinite(chi2).any():
        return None
    axes, chi2 = zoomed(squares, axes, chi2)
    free = [k for k, axis in enumerate(axes) if len(axis) > 1]
    point, least = polished(squares, axes, chi2, free)
    constants = []
    for k, (name, value, low, high) in enumerate(zip(FRICTIONAL, point, table.low, table.high, strict=True)):
        if name in known:
            constants.append(Constant(*[known[name]] * 5))
            continue
        ends = interval(axes[k], profile(chi2, k) - least, scales[k])
        constants.append(Constant(float(scales[k] * np.exp(value)), *ends, *(scales[k] * np.exp([low, high])).tolist()))
    told = {"worth": squares.worth, "sensitivities": squares.sensitivities}
    return FrictionalMix(
        *constants,
        usual=False,
        density=float(density),
        measured=measured,
        errors=squares.errors,
        model={name: float(value) for name, value in squares.model(*point).items()},
        by_viscosity={},
        **{key: squares.by_name(of(point, free), free, FRICTIONAL) for key, of in told.items()},
    )
