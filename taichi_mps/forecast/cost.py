"""Cost of a run before its first step: steps of the flow and their processor time.

The fastest part of the fluid moves courant_number l0 in a step, a jet that lands or what falls. What a step costs was
measured in pours, by the number of particles that are there; `python benchmarks/cubic_metre.py` measures it again and
writes MEASURED.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..engine import ONE_THREAD_BELOW_ROWS, Pouring, Problem, particles_of
from . import accuracy

MEASURED = Path(__file__).with_name("cost.csv")
# speed of a jet where it lands over that of a free fall to its heap, which is as high as the jet is wide
LANDING_RATIO = 0.9
# outer iterations of a step of the measured pours, and their fraction of its cost
MEASURED_ITERATIONS, ITERATIONS_FRACTION = 6, 0.45
# time to rest over sqrt(H/g), and over what eta/tau_y is longer than that; of slump cones
REST_OVER_FALL, REST_OVER_CREEP = 3.5, 12.0
# time until hardly anything yields over sqrt(H/g): 0.006 (rho g H/tau_y)^2.2; by semi-implicit, the paper's #2 and #3
UNYIELDED_OVER_FALL, UNYIELDED_EXPONENT = 0.006, 2.2
# path of the fastest particles over H: PATH (rho g H/tau_y)^PATH_EXPONENT; of slump cones
PATH, PATH_EXPONENT, MAX_PATH = 0.15, 0.6, 3.0
MIN_STEPS, PLANE_COST = 20.0, 0.6  # steps of a run to rest; cost of a step in a plane or rings over that in space
SEMI_IMPLICIT_SECONDS = (
    8.5e-7  # of a step of this scheme for each particle, those of walls among them; the paper's cases
)
SETTLING_TIME = 2.0  # [s] from the last layer to rest
TIMES = 2000  # intervals of the time, in each of which steps are equally long


@dataclass(frozen=True)
class Cost:
    """Cost of the flow: number of steps, CPU seconds of one thread without the start of the program, the time
    [s] at which it is expected to end, and of a pour the fraction of the seconds at equally spaced times from 0 s to
    the time limit."""

    steps: float
    cpu_seconds: float
    end: float
    course: np.ndarray | None = None


def cost_of(problem: Problem) -> Cost:
    """Cost of a problem, to the time limit for a pour by the implicit scheme in space, whose steps follow the jet, else
    to the expected rest. Steps of a slump cone were predicted within a factor of 1.5, of other flows within three, of
    the paper's cases by its own scheme within two."""
    scene, numerics, implicit = problem.scene, problem.numerics, problem.scheme == "implicit"
    if implicit and scene.dimension == 3 and scene.inlets:
        return cost_of_pour(problem)
    known, particles = accuracy.errors_of_run(problem.facts()), particles_of(problem)
    creep = max(m.typical_slope / max(m.yield_value, 1e-9) for m in problem.scene.materials) - problem.fall_time
    rests = scene.stop_at_rest and (problem.rests or (not implicit and all(m.yields for m in problem.scene.materials)))
    weight = max(m.density for m in problem.scene.materials) * problem.gravity * problem.height
    softness = weight / max(min(m.yield_value for m in problem.scene.materials), 1e-9 * weight)
    falls = REST_OVER_FALL if implicit else UNYIELDED_OVER_FALL * softness**UNYIELDED_EXPONENT
    rest = falls * problem.fall_time + REST_OVER_CREEP * max(creep, 0.0)
    end = min(scene.until, rest) if rests and not scene.jolts else scene.until
    path = min(PATH * softness**PATH_EXPONENT, MAX_PATH) * problem.height

    def steps_to(time):
        """Steps to a time [s], if none is limited by other numerics than the Courant number."""
        way = min(path, 0.5 * problem.gravity * time**2)
        way = (1 + len(scene.jolts)) * way if scene.jolts else way + time * problem.speed  # a jolt is one fall more
        slow = time / longest_step(problem, settles=True)
        return max(way / (numerics.courant_number * scene.spacing) + (not rests) * slow, min(MIN_STEPS, slow))

    usual = steps_to(end)
    each = seconds_of_a_step(particles, particles) if implicit else SEMI_IMPLICIT_SECONDS * particles
    seconds = float(usual * each * (1.0 if scene.dimension == 3 else PLANE_COST))
    if known and known[2]:  # which is to rest
        seconds = known[2].cpu_seconds * usual / steps_to(max(end, rest))
    steps = max(usual, end / ((numerics.max_time_step or np.inf) if implicit else longest_step(problem)))
    seconds *= steps / usual * iterations_factor(numerics)
    return Cost(steps, seconds, end, np.array([0.0, 1.0]) if scene.inlets else None)


def iterations_factor(numerics) -> float:
    """Cost of a step with the outer iterations of these numerics, over that with the usual ones [-]."""
    return 1.0 + ITERATIONS_FRACTION * (getattr(numerics, "passes", MEASURED_ITERATIONS) / MEASURED_ITERATIONS - 1.0)


def cost_of_pour(problem: Problem) -> Cost:
    """Cost of a pour from 0 s to the time limit, if no hose must wait for room."""
    scene, numerics = problem.scene, problem.numerics
    pours = [Pouring(scene, inlet) for inlet in scene.inlets]
    time = scene.until * (np.arange(TIMES) + 0.5) / TIMES
    layers = [np.clip(np.ceil((time - pour.start) / pour.interval), 0, pour.layers) for pour in pours]
    particles = len(scene.fluid) + sum(n * len(pour.layer) for n, pour in zip(layers, pours, strict=True))
    level = level_of(scene, particles * scene.spacing**3)
    flows = [(time >= pour.start) & (time < pour.start + pour.layers * pour.interval) for pour in pours]
    landing = [here * landing_speed(problem, pour, time, level) for here, pour in zip(flows, pours, strict=True)]
    speed = np.maximum(np.max(landing, axis=0), max((wall.speed for wall in scene.walls), default=0.0))
    step = np.where(np.any(flows, axis=0), longest_step(problem), longest_step(problem, settles=True))
    step = np.minimum(step, numerics.courant_number * scene.spacing / np.maximum(speed, 1e-9))
    steps = scene.until / TIMES / step
    seconds = steps * iterations_factor(numerics) * seconds_of_a_step(particles, particles_of(problem))
    spent = np.concatenate([[0.0], np.cumsum(seconds)])
    end = min(scene.until, max(pour.end for pour in pours) + SETTLING_TIME)
    return Cost(float(steps.sum()), float(spent[-1]), end, spent / spent[-1])


def landing_speed(problem: Problem, pour: Pouring, time, level):
    """Speed [m/s] of a jet at times [s] where it lands, on a heap above the level [m]. With LANDING_RATIO the steps of
    eight pours were predicted within 15 %; of one with a courant_number of 0.65 24 % too many."""
    if pour.inlet.height is not None:  # a nozzle lays its bead where that stays
        return np.full(len(time), pour.speed)
    mouth = np.array([pour.inlet.centre[-1] + pour.inlet.displacement(t)[-1] for t in time])
    fall = np.maximum(0.0, mouth - level - 2.0 * pour.inlet.radius)
    return LANDING_RATIO * np.sqrt(pour.speed**2 + 2.0 * problem.gravity * fall)


def level_of(scene, volume):
    """Level [m] of a volume of fluid [m3] that lies evenly in the cavity; without a cavity, the floor."""
    if scene.cavity is None:
        return np.full(np.shape(volume), scene.reach[:, -1].min() - 0.5 * scene.spacing)
    cells = scene.cavity.cells
    room = np.concatenate([[0.0], np.cumsum(cells.sum(axis=tuple(range(cells.ndim - 1))))])
    heights = scene.cavity.low[-1] + scene.cavity.cell[-1] * np.arange(len(room))
    return np.interp(volume, room * float(np.prod(scene.cavity.cell)), heights)


def longest_step(problem: Problem, settles: bool = False) -> float:
    """Longest step [s] in a slow flow; ``settles``: when it only settles. That of ``semi-implicit`` is bound by the
    diffusion number of unyielded material, as soon as there is any."""
    if problem.scheme == "implicit":
        return problem.time_step.slow_step if settles else problem.time_step.longest
    numerics, mix = problem.numerics, problem.scene.material
    return min(
        numerics.max_time_step,
        numerics.diffusion_number * problem.scene.spacing**2 * mix.density / mix.unyielded_viscosity,
    )


def seconds_of_a_step(particles, at_end: int):
    """CPU seconds of a step of a run with so many particles ``at_end``, by which its stages are fused or not:
    interpolated as a power between the measured numbers of particles, constant below, in proportion above."""
    counts, seconds, is_fused = np.loadtxt(MEASURED, delimiter=",").T
    like_this = is_fused == (at_end < ONE_THREAD_BELOW_ROWS)
    counts, seconds = counts[like_this], seconds[like_this]
    within = np.exp(np.interp(np.log(np.maximum(particles, 1.0)), np.log(counts), np.log(seconds)))
    return within * np.maximum(1.0, particles / counts[-1])
