"""The cases all peers run, who runs them with which settings, and how a run is judged. No Taichi here.

Slump: the cone of the engine's `slump` scene, released at once, rho = 2300 kg/m3, eta = 50 Pa s, to t = 1 s. The
reference is finite elements of a true Bingham material with inertia (validation/reference, +-0.4 mm). Error:
the largest of slump at 0.1, 0.2, 0.3, 0.5 and 1 s. Dam break: the `dam_break` scene; front against Martin and Moyce.
"""

import sys
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

import taichi_mps as mps
from taichi_mps.engine.problem import measures as measure
from taichi_mps.input import catalogue

sys.path.append(str(Path(__file__).resolve().parents[1]))
from points import aside  # noqa: E402

from validation.fluids import COLUMN, front_errors  # noqa: E402
from validation.slumps import MILESTONES as TIMES  # noqa: E402
from validation.slumps import inertial  # noqa: E402

CONE = {"base_radius": 0.1, "top_radius": 0.05, "height": 0.3}  # [m]
MIX = {"density": 2300.0, "plastic_viscosity": 50.0}


@dataclass(frozen=True)
class Run:
    """One peer with one choice of its settings."""

    peer: str
    label: str
    settings: dict = field(default_factory=dict)


@dataclass(frozen=True)
class Case:
    """One problem that several peers solve, each in a process of its own, one after the other."""

    name: str
    title: str
    kind: str  # slump, lifted or dam
    spacing: float  # [m]
    runs: tuple[Run, ...]
    yield_value: float = 0.0  # [Pa]
    model: str = "full"
    until: float = 1.0  # [s]
    stop_at_rest: bool = False  # of this engine; the peers do not know when they are at rest
    lift_speed: float | None = None  # of the mould [m/s]

    @property
    def times(self) -> tuple[float, ...]:
        """Times at which the slump is read [s]."""
        return TIMES if self.until <= TIMES[-1] else (*TIMES, self.until)

    def scene(self) -> mps.Scene:
        """The engine's scene of this case."""
        if self.kind == "dam":
            return catalogue.build("dam_break", spacing=self.spacing, until=self.until)
        mix = MIX | {"yield_value": self.yield_value, "model": self.model, "lift_speed": self.lift_speed}
        return catalogue.build("slump", spacing=self.spacing, until=self.until, **mix)

    def data(self, run: Run, seed: int = 0) -> dict:
        """Return the input of a peer's script: the numbers of the case and, for particles, the engine's own filling. In
        a dam break, with the peers' own particles, all of the water is displaced from the wall by ``aside``."""
        common = {"spacing": self.spacing, "until": self.until, "settings": run.settings}
        if self.kind == "dam":
            times = np.arange(1, round(self.until / 0.01) + 1) * 0.01
            away = abs(float(aside((), self.spacing, seed)))
            water = {"width": COLUMN, "density": 1000.0, "viscosity": 1e-3, "aside": away}
            return common | water | {"times": times.tolist()}
        cone = mps.Cone(*CONE.values())
        fluid = np.zeros((0, 3)) if self.model == "axisymmetric" else self.scene().fluid
        return common | {
            **MIX,
            **CONE,
            "lift_speed": self.lift_speed,
            "yield_value": self.yield_value,
            "times": self.times,
            "volume": cone.volume,
            "fluid": (fluid + aside(fluid.shape, self.spacing, seed)).tolist(),
        }


def newton(voxel: float, dt: float = 0.005) -> Run:
    """Voxels of so many spacings; step [s]."""
    return Run("newton", f"Newton, voxel {voxel:g} l0, dt {1e3 * dt:g} ms", {"voxel": voxel, "dt": dt})


def openfoam(rate: float, max_dt: float) -> Run:
    """Creep rate of the bi-viscous law [1/s], largest step [s]."""
    label = f"interFoam, creep rate {rate:g} 1/s, dt <= {1e3 * max_dt:g} ms"
    return Run("openfoam", label, {"rate": rate, "courant": 0.5, "max_dt": max_dt, "krylov": True})


OURS = Run("taichi_mps", "taichi_mps, implicit")
LONG_STEPS = Run("taichi_mps", "taichi_mps, implicit, twice the Courant number", {"courant_number": 0.4})
PRACTICE = Run("taichi_mps", "taichi_mps, semi-implicit", {"scheme": "semi-implicit"})
LITERAL = Run("taichi_mps", "taichi_mps, semi-implicit, literal", {"scheme": "semi-implicit", "literal": True})


def slump(yield_value: float, spacing: float, *runs: Run, model: str = "full", to_rest: bool = False) -> Case:
    """A slump to 1 s; ``to_rest``: to 5 s, where this engine stops as soon as it is at rest."""
    mix, millimetres = f"{yield_value:g} Pa", f"{1e3 * spacing:.3g}"
    name = f"slump_{model}_{yield_value:g}Pa_{millimetres}mm"
    title = f"slump, {'3-D' if model == 'full' else model}, {mix}, {millimetres} mm"
    if to_rest:
        name, title = f"{name}_5s", f"{title}, to 5 s or rest"
    runs = (OURS, *runs) if to_rest else (OURS, LONG_STEPS, *runs)
    return Case(name, title, "slump", spacing, runs, yield_value, model, 5.0 if to_rest else 1.0, to_rest)


def lifted(yield_value: float, spacing: float, speed: float | None) -> Case:
    """A slump whose mould is lifted, or gone at once, to 2 s after that."""
    until = 2.0 + (CONE["height"] / speed if speed else 0.0)
    given = {"yield_value": yield_value, "until": until, "lift_speed": speed}
    return Case("lifted", "lifted mould", "lifted", spacing, (newton(1.5, dt=0.01),), **given)


CASES = (
    slump(500.0, 0.015, newton(1.5, dt=0.01), newton(1.5)),
    slump(500.0, 0.01, newton(1.5, dt=0.01), newton(1.5)),
    slump(100.0, 0.01, newton(1.5, dt=0.01), newton(1.5)),
    slump(500.0, 0.01, *(openfoam(0.02, dt) for dt in (0.002, 0.001, 0.0005)), model="axisymmetric"),
    slump(100.0, 0.01, openfoam(0.02, 0.002), openfoam(0.02, 0.0005), model="axisymmetric"),
    slump(500.0, 0.005, openfoam(0.02, 0.001), model="axisymmetric"),
    slump(500.0, 0.01, openfoam(0.02, 0.002), model="axisymmetric", to_rest=True),
    slump(500.0, 0.01, newton(1.5, dt=0.01), newton(1.5), to_rest=True),
    Case(
        "dam_break",
        "dam break of water, 2-D, a/l0 = 20",
        "dam",
        0.0073,
        (
            OURS,
            PRACTICE,
            Run("pysph", "PySPH, WCSPH", {"scheme": "wcsph"}),
            Run("splishsplash", "SPlisHSPlasH, DFSPH, 0.1 %", {"method": "DFSPH", "error": 0.1}),
            Run("splishsplash", "SPlisHSPlasH, DFSPH, 0.01 %", {"method": "DFSPH", "error": 0.01}),
            Run("splishsplash", "SPlisHSPlasH, IISPH, 0.01 %", {"method": "IISPH", "error": 0.01}),
            LITERAL,
            Run("pysph", "PySPH, EDAC", {"scheme": "edac"}),
            Run("pysph", "PySPH, IISPH", {"scheme": "iisph"}),
        ),
        until=0.26,
    ),
)


def reference(yield_value: float, times=TIMES) -> tuple[np.ndarray, np.ndarray]:
    """Slump over r < 20 mm and spread [m] of the finite elements at these times [s]."""
    known, slumps, spreads = inertial(yield_value)
    return np.interp(times, known, slumps), np.interp(times, known, spreads)


def slumps_of(output: dict, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Slump and spread [m] in a peer's output: as it says or, of particles, by the engine's own measure."""
    if "slump" in output:
        return np.asarray(output["slump"]), np.asarray(output["spread"])
    found = [measure.slump(measure.still(x, spacing), CONE["height"]) for x in output["x"]]
    return np.array([f["slump_m"] for f in found]), np.array([f["spread_m"] for f in found])


def judge_slump(case: Case, output: dict) -> dict:
    """Slump at the times of the case [m], the errors, and that of the spread at the end [-]."""
    t, (exact, wide) = np.asarray(output["t"]), reference(case.yield_value, case.times)
    if t[-1] < 0.999 * case.times[-1]:
        raise ValueError(f"{case.name}: the run ended at {t[-1]:g} s")
    slump, spread = (np.interp(case.times, t, values) for values in slumps_of(output, case.spacing))
    return {
        "slump_m": slump.tolist(),
        "slump_errors_m": (slump - exact).tolist(),
        "worst_slump_error_m": float(max(slump - exact, key=abs)),
        "spread_error": float(spread[-1] / wide[-1] - 1.0),
    }


def front_of(x: np.ndarray, spacing: float) -> float:
    """Front of the body [m]: the last particle along x before the first gap of two spacings, plus l0/2; drops ahead of
    it do not count."""
    along = np.sort(x[:, 0])
    gaps = np.flatnonzero(np.diff(along) > 2.0 * spacing)
    return float(along[gaps[0] if len(gaps) else -1] + 0.5 * spacing)


def judge_lifted(case: Case, output: dict) -> dict:
    """Slump and slump flow at the end [m]."""
    slump, spread = (float(values[-1]) for values in slumps_of(output, case.spacing))
    return {"slump_m": slump, "spread_m": spread}


def judge_dam(case: Case, output: dict) -> dict:
    """Largest relative error of the front for the gate's best delay (at most 0.3 sqrt(a/2g)), and without any delay."""
    error, delay, _ = front_errors(output["t"], [front_of(x, case.spacing) for x in output["x"]])
    return {"front_error": error(delay), "gate_delay": delay, "front_error_no_delay": error(0.0)}


def judge(case: Case, output: dict) -> dict:
    return {"slump": judge_slump, "lifted": judge_lifted, "dam": judge_dam}[case.kind](case, output)
