"""How many steps a pour will take, and what processor time, before the first of them is taken.

The steps follow from the rule of the scheme: a jet that lands at the speed U allows courant_number l0/U. Their cost was
measured in pours, by how many particles are there; `python benchmarks/cubic_metre.py` measures it again and writes
MEASURED.
"""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..problem.problem import Problem
from ..terms.constants import LONG, longest_step
from .pouring import Pouring

MEASURED = Path(__file__).with_name("cost.csv")
LANDS = 0.9  # speed of a jet where it lands over that of a free fall to its heap, which is as high as the jet is wide
PASSES, OF_PASSES = 6, 0.45  # passes of a step of the measured pours, and the share of its cost that goes with them
PARTS = 2000  # of the time, in each of which steps are equally long


@dataclass(frozen=True)
class Cost:
    """What a pour takes to ``ends`` [s], the time limit: number of steps, the sum of the particles that are there over
    all steps, and CPU seconds of one thread without the start of the program."""

    ends: float
    steps: float
    particle_steps: float
    cpu_seconds: float


def estimate_cost(problem: Problem) -> Cost | None:
    """That of a problem of the implicit scheme in space into which concrete is poured from 0 s on; None of others, of
    which nothing is known. No hose waits for room."""
    scene = problem.scene
    if problem.scheme != "implicit" or scene.dimension != 3 or not scene.inlets:
        return None
    pours = [Pouring(scene, inlet) for inlet in scene.inlets]
    time = scene.until * (np.arange(PARTS) + 0.5) / PARTS
    flow = [(time >= pour.start) & (time < pour.start + pour.layers * pour.interval) for pour in pours]
    layers = [np.clip(np.ceil((time - pour.start) / pour.interval), 0, pour.layers) for pour in pours]
    particles = len(scene.fluid) + sum(n * len(pour.layer) for n, pour in zip(layers, pours, strict=True))
    level = level_of(scene, particles * scene.spacing**3)
    landing = [here * landing_speed(problem, pour, time, level) for here, pour in zip(flow, pours, strict=True)]
    speed = np.maximum(np.max(landing, axis=0), max((wall.speed for wall in scene.walls), default=0.0))
    quiet = own_step(problem, quiet=True), own_step(problem)
    step = np.where(np.any(flow, axis=0), quiet[1], quiet[0])
    step = np.minimum(step, problem.numerics.courant_number * scene.spacing / np.maximum(speed, 1e-9))
    steps = scene.until / PARTS / step
    by_passes = 1.0 + OF_PASSES * (problem.numerics.passes / PASSES - 1.0)
    seconds = by_passes * seconds_of_a_step(particles, *measured())
    return Cost(scene.until, float(steps.sum()), float(steps @ particles), float(steps @ seconds))


def landing_speed(problem: Problem, pour: Pouring, time, level):
    """Speed [m/s] at times [s] of a jet where it lands, on a heap above the level [m]. With LANDS the steps of eight
    pours were met within 15 %; of one with a courant_number of 0.65 24 % too many were told."""
    mouth = np.array([pour.inlet.centre[-1] + pour.inlet.displacement(t)[-1] for t in time])
    heap = level + 2.0 * pour.inlet.radius
    return LANDS * np.sqrt(pour.speed**2 + 2.0 * problem.gravity * np.maximum(0.0, mouth - heap))


def level_of(scene, volume):
    """Level [m] of so much fluid [m3] in the cavity, if it lies evenly; without a cavity the floor of all that may
    be."""
    if scene.cavity is None:
        return np.full(np.shape(volume), scene.reach[:, -1].min() - 0.5 * scene.spacing)
    cells = scene.cavity.cells
    room = np.concatenate([[0.0], np.cumsum(cells.sum(axis=tuple(range(cells.ndim - 1))))])
    heights = scene.cavity.low[-1] + scene.cavity.cell[-1] * np.arange(len(room))
    return np.interp(volume, room * float(np.prod(scene.cavity.cell)), heights)


def own_step(problem: Problem, quiet: bool = False) -> float:
    """Longest step [s] of the scheme where nothing is fast; ``quiet``: and what yields only settles."""
    times = LONG if quiet and all(m.yields for m in problem.materials) else 1.0
    body = problem.gravity, problem.height, problem.scene.spacing
    return problem.numerics.max_time_step or min(
        longest_step(m.plastic_viscosity / m.density, *body, times) for m in problem.materials
    )


def measured() -> tuple[np.ndarray, np.ndarray]:
    """Numbers of particles, rising, and the CPU seconds that a step with so many took."""
    rows = np.loadtxt(MEASURED, delimiter=",", comments="#", skiprows=0, ndmin=2)
    return rows[:, 0], rows[:, 1]


def seconds_of_a_step(particles, known, seconds):
    """CPU seconds of a step: between the known numbers of particles by a power of them, below as of the fewest, above
    in proportion."""
    particles = np.maximum(particles, known[0])
    within = np.exp(np.interp(np.log(particles), np.log(known), np.log(seconds)))
    return within * np.maximum(1.0, particles / known[-1])


def size_of(cost: Cost) -> str:
    """Its CPU time as text: 40 s, 5.2 min, 1.4 h."""
    for unit, seconds in (("h", 3600.0), ("min", 60.0)):
        if cost.cpu_seconds >= 1.5 * seconds:
            return f"{cost.cpu_seconds / seconds:.2g} {unit}"
    return f"{max(1, math.ceil(cost.cpu_seconds))} s"
