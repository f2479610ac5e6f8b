"""The validation table: cases with an exact or independent answer, run and judged by ``python -m validation``.

``cases.py`` is the table: each row names its case, its reference and the function that runs it, with its settings. A
function gives what it measured, each number beside its target. They stand by subject in ``flows.py`` (plane flows),
``curved.py``, ``slumps.py``, ``standing.py``, ``fluids.py``, ``vortices.py``, ``grains.py`` and ``measured.py``;
``table.py`` runs the rows, each in a process of its own, with the scheme that is set here. Some targets were changed
when the engine's numbers were known (those of the Bingham cavity), and on what some rows measure constants were chosen
(``CHOSEN_ON``): they are calibration. Read cases.py first.
"""

import csv
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np

import taichi_mps as mps
from taichi_mps.engine.problem.numerics import NUMERICS

REFERENCE = Path(__file__).parent / "reference"
L2_ERROR, SLUMP_ERROR = "L2 error of the velocity [-]", "largest error of the slump [mm]"
LAYERS = 3  # of wall particles behind a wall, as in the paper

# What the rows of this process run with: the scheme, the CPU time a row may take [s], None for any, and the CPU time of
# the process when the row began [s].
Setting = SimpleNamespace(scheme="implicit", budget=None, begin=0.0)


@dataclass(frozen=True)
class Measured:
    """Measured number of a row: name, value and bound (both in ``unit``)."""

    quantity: str
    value: float
    target: float
    unit: str = "-"

    @property
    def met(self) -> bool:
        return bool(abs(self.value) <= self.target)  # never true for a nan


@dataclass(frozen=True)
class Row:
    """Case of the validation table."""

    name: str
    case: str  # description of the flow
    reference: str  # source of the answer
    function: Callable  # of the settings: gives Measured, and dicts, which are points of table.convergence
    settings: dict = field(default_factory=dict)
    quick: bool = False  # belongs to --quick and to the default test suite


def lines_of(name: str) -> list[str]:
    """Lines of a reference CSV; those that start with # are comments."""
    return [line for line in (REFERENCE / name).read_text("utf-8").splitlines() if not line.startswith("#")]


def read_reference(name: str) -> list[dict[str, str]]:
    """Rows of a reference CSV by column name."""
    return list(csv.DictReader(lines_of(name)))


def columns(name: str, **wanted) -> dict[str, np.ndarray]:
    """Columns of a reference CSV as arrays, of the rows with these texts or numbers in some columns; nan where a number
    is missing."""
    form = {"delimiter": ",", "names": True, "dtype": None, "comments": None, "encoding": "utf-8"}
    table = np.atleast_1d(np.genfromtxt(lines_of(name), **form, deletechars="", replace_space=" "))
    for key, value in wanted.items():
        table = table[table[key] == value]
    return {key: table[key] for key in table.dtype.names}


# ---- running scenes ----------------------------------------------------------------------------------------------
def simulate(scene: mps.Scene, max_time_step: float | None = None, **others):
    """A Simulation of ``scene`` with the defaults of the present scheme but for ``others``; ``max_time_step`` [s] may
    only shorten its steps. The paper's scheme gets its wall particles where the scene has nothing but planes normal to
    axes."""
    numerics = NUMERICS[Setting.scheme]
    caps = [step for step in (numerics().max_time_step, max_time_step) if step is not None]
    normals = [wall.normal if isinstance(wall, mps.Plane) else () for wall in scene.walls]
    lattices = scene.walls and all(np.count_nonzero(normal) == 1 for normal in normals)
    if Setting.scheme == "semi-implicit" and lattices and scene.wall_particles is None:
        scene = with_wall_particles(scene)
    sim = mps.Simulation(scene, numerics(max_time_step=min(caps, default=None), **others))
    if Setting.budget is not None:
        sim.each_step(stop_beyond_budget)
    return sim


def run(scene: mps.Scene, until: float | None = None, max_time_step: float | None = None):
    """Run the Simulation of ``scene`` to ``until`` [s], or to the end of the scene, and return it."""
    sim = simulate(scene, max_time_step)
    sim.run(until)
    return sim


def record(scene: mps.Scene, read, interval: float | None = None, until=None, after=-1.0, **numerics):
    """Run a Simulation and record ``read(simulation)`` every ``interval`` [s], or after every step, later than
    ``after`` [s]. Returns the Simulation, the times [s] and the recorded values."""
    sim, found = simulate(scene, **numerics), []

    def note(s):
        if s.time > after:
            found.append((s.time, read(s)))

    if interval:
        sim.every(interval, note)
    else:
        sim.each_step(note)
    sim.run(until)
    times, values = zip(*found, strict=True)
    return sim, np.array(times), np.array(values)


def stop_beyond_budget(sim) -> None:
    """Raise a TimeoutError, with the cost of a simulated second, when the row has spent its CPU time."""
    spent = time.process_time() - Setting.begin
    if spent > Setting.budget:
        hours = sim.cpu_seconds / 3600.0 / sim.time  # without compiling
        raise TimeoutError(
            f"at t = {sim.time:.3g} s: {Setting.budget:g} CPU-s spent ({hours:.2g} CPU-h for each simulated second)"
        )


def with_wall_particles(scene: mps.Scene) -> mps.Scene:
    """The scene with LAYERS layers of wall particles behind its planes, each normal to an axis. The lattice goes on
    behind the wall, which stands half-way between two layers; the domain grows where it must hold them."""
    l0, periodic = scene.spacing, np.array(scene.periodic)
    low, high = (np.array(corner, float) for corner in scene.domain)
    origin = np.where(periodic, low, scene.fluid[0] - 0.5 * l0)
    for plane in scene.walls:
        axis = int(np.argmax(np.abs(plane.normal)))
        origin[axis] = plane.point[axis]
    first = np.where(periodic, 0.0, np.ceil((origin - low) / l0) + LAYERS)
    last = np.where(periodic, np.round((high - low) / l0), np.ceil((high - origin) / l0) + LAYERS)
    low = np.where(periodic, low, origin - first * l0)
    high = np.where(periodic, high, origin + last * l0)
    x = mps.lattice(low, high - 0.25 * l0, l0)
    return replace(scene, wall_particles=mps.behind(scene.walls, x, LAYERS * l0), domain=(tuple(low), tuple(high)))
