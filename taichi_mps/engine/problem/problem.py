"""Problem: a scene and its numerics, checked once, and the properties that follow from both."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.linalg import norm

from ...units import INSTANT, instance, validated
from ..geometry.solid import Solid
from .feasibility import RULES
from .numerics import Implicit, SemiImplicit
from .scene import Scene
from .time_step import TimeStep

OUTPUTS = 20  # of a run to its time limit, by default
OUTPUT_INTERVAL = 0.3  # interval of the outputs over sqrt(H/g): a body falls much faster than it creeps
FREE_SURFACE_ROOM = 1.1  # room in front of the walls over the volume of the fluid from which on it has a free surface
SAMPLE_COUNT = 1 << 15  # points of the domain by which the room is estimated, within 1 % for a box of a third of it
# skin of the neighbour list over the spacing, where steps are short: the next neighbours of a lattice are left out
SKIN = 0.1
RUNAWAY = 10.0  # speed over the expected one beyond which a run has diverged
WEIGHTLESS = 0.1  # substitute for gravity in a scene without weight: over U^2/H, or [m/s2] where nothing moves


@validated
@dataclass(frozen=True, eq=False)
class Problem:
    """Scene with its numerics, checked once before anything is allocated.

    Parameters
    ----------
    scene : Scene
        What is to be computed.
    numerics : Implicit or SemiImplicit, optional
        How it is computed, ``Implicit()`` by default.

    Raises
    ------
    SceneError
        For the first rule that is broken, in one line with key, value and what is allowed.

    Notes
    -----
    A ``Scene`` checks itself when it is made (``scene_rules``). A Problem adds the rules that need the scheme, and
    those that reveal wrong units or a wrong origin (``feasibility``). Behind it nothing is checked again.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> from taichi_mps.engine.problem.problem import Problem
    >>> problem = Problem(mps.slump_cone(spacing=0.03))
    >>> problem.scheme, problem.law, problem.rests
    ('implicit', 'yield-stress', True)
    """

    scene: instance(Scene, "a Scene, such as slump_cone(...)")
    numerics: instance(Implicit | SemiImplicit, "Implicit(...) or SemiImplicit(...)") | None = None

    def __post_init__(self):
        if self.numerics is None:
            object.__setattr__(self, "numerics", Implicit())
        for rule in RULES:
            rule(self)

    @property
    def scheme(self) -> str:
        """Name of the scheme, 'implicit' or 'semi-implicit'."""
        return self.numerics.scheme

    @property
    def effective_radius(self) -> float:
        """Effective radius r_e [m]: farther particles are no neighbours."""
        return self.numerics.effective_radius_ratio * self.scene.spacing

    @property
    def skin(self) -> float:
        """Length [m] by which the search radius of neighbours exceeds the effective one: where steps are short."""
        return SKIN * self.scene.spacing if self.scheme == "semi-implicit" else 0.0

    @property
    def wall_particles(self) -> bool:
        """Whether walls are computed as particles, as in the paper, and not as surfaces."""
        return self.numerics.walls == "particles" and self.scene.wall_particles is not None

    @cached_property
    def law(self) -> str:
        """Law of all mixes: 'newtonian', 'yield-stress' (a true yield stress) or 'bi-viscosity'.

        A critical strain rate makes it 'bi-viscosity'; a flow curve has a true yield stress. So it is as the mixes are
        given: the scheme semi-implicit softens a true yield stress.
        """
        yielding = [material for material in self.scene.materials if not material.newtonian]
        if not yielding:
            return "newtonian"
        return "yield-stress" if yielding[0].critical_strain_rate is None else "bi-viscosity"

    @property
    def held_density(self) -> float:
        """Density whose weight a mean pressure gradient holds [kg/m3], 0 of none.

        That of mortar and grains together in a box that is periodic along gravity and has grains; what is all fluid
        falls freely there.
        """
        scene, down = self.scene, self.scene.gravity_vector != 0.0
        if not (scene.grains and down.any() and np.all(np.array(scene.periodic)[down])):
            return 0.0
        part = float((scene.grain_places[0] > 0).mean())
        return part * scene.grains.density + (1.0 - part) * scene.material.density

    @property
    def wall_loads(self) -> bool:
        """Whether force and torque on the walls are computed."""
        return self.scene.wall_loads or getattr(self.numerics, "wall_loads", False)

    @property
    def rests(self) -> bool:
        """Whether every mix has a true yield stress, without which nothing comes to rest."""
        return all(material.rests for material in self.scene.materials)

    @cached_property
    def height(self) -> float:
        """Largest expected height of the fluid [m], along the axis nearest to gravity, of equal ones the last."""
        scene = self.scene.expected  # weight along a periodic axis presses on nothing
        weight = np.abs(scene.gravity_vector) * ~np.array(scene.periodic)
        return float(np.ptp(scene.fluid[:, -1 - int(weight[::-1].argmax())])) + scene.spacing

    @cached_property
    def frame(self) -> np.ndarray:
        """Velocity [m/s], shape (d,), of the frame in which speeds set the scales and the time step.

        The velocity of the first wall; zero without walls, or if it changes in time.
        """
        walls = self.scene.walls
        return walls[0].fastest * (walls[0].in_time is None) if walls else np.zeros(self.scene.dimension)

    def wall_speed_at(self, time: float) -> float:
        """Return the largest speed of a wall in the ``frame`` from a time on.

        Parameters
        ----------
        time : float
            Time [s].

        Returns
        -------
        float
            Speed [m/s], 0 for a wall that has stopped for good.
        """
        walls = [w for w in self.scene.walls if w.speed == 0.0 or w.speed_at(time) > 0.0]
        return max((w.speed + float(norm(w.fastest - self.frame) - norm(w.fastest)) for w in walls), default=0.0)

    @cached_property
    def speed(self) -> float:
        """Largest prescribed speed, of the fluid at 0 s, of a wall or of a jolt, in the ``frame`` [m/s]."""
        velocity = self.scene.expected.velocity
        moved = np.atleast_2d(-self.frame if velocity is None else velocity - self.frame)
        return max(
            float((moved**2).sum(1).max() ** 0.5), self.wall_speed_at(0.0), self.scene.jolted(self.scene.expected.fluid)
        )

    @cached_property
    def gravity(self) -> float:
        """Gravity that sets the scales of the scene [m/s2]; without weight, derived from speed and height."""
        weight = float((self.scene.expected.gravity_vector**2).sum() ** 0.5)
        return max(weight, WEIGHTLESS * self.speed**2 / self.height) or WEIGHTLESS

    @cached_property
    def time_step(self) -> TimeStep:
        """Rule of the time step of ``implicit``."""
        return TimeStep(self)

    @cached_property
    def expected_speed(self) -> float:
        """Largest speed [m/s] of what falls, is thrown, poured, jolted and moved by walls, all together.

        The fall is through the whole domain; infinite where nothing moves the fluid.
        """
        scene = self.scene
        speeds = [
            (2.0 * norm(scene.gravity_vector) * norm(np.subtract(*scene.domain))) ** 0.5,
            max((wall.speed for wall in scene.walls), default=0.0),
            0.0 if scene.velocity is None else norm(scene.velocity, axis=1).max(),
            max((norm(inlet.fastest(scene.spacing)) for inlet in scene.inlets), default=0.0),
            scene.jolted(scene.initial),
        ]
        return float(sum(speeds)) or np.inf

    @cached_property
    def runaway_speed(self) -> float:
        """Speed [m/s] beyond which a run has diverged.

        RUNAWAY times the expected one, and what walls that travel and inlets push out through the gap of a particle, by
        continuity.
        """
        scene = self.scene
        gap = (float(np.ptp(scene.expected.fluid, axis=0).max()) / scene.spacing + 1.0) ** (scene.dimension - 1)
        travel = max((float(norm(wall.travel)) for wall in scene.walls), default=0.0)
        poured = sum(inlet.rate for inlet in scene.inlets) / scene.spacing ** (scene.dimension - 1)
        return RUNAWAY * self.expected_speed + travel * gap + poured

    def initial_structure(self, mix: np.ndarray) -> np.ndarray:
        """Return the structure at the start.

        Parameters
        ----------
        mix : ndarray of int, shape (n,)
            Numbers in ``scene.materials``.

        Returns
        -------
        ndarray, shape (n,)
            Structures [-].
        """
        return np.array([material.initial_structure for material in self.scene.materials])[np.asarray(mix, int)]

    def facts(self) -> dict:
        """Return what is known before a run starts.

        Returns
        -------
        dict
            Scene, parameters, materials, scheme and numerics, JSON-ready.
        """
        scene = self.scene
        return {
            "scene": scene.name,
            "parameters": dict(scene.parameters),
            "materials": [material.facts() for material in scene.materials],
            "scheme": self.scheme,
            "numerics": self.numerics.model_dump(),
            **({"grains": scene.grains.facts(scene.grain_places, scene.dimension)} if scene.grains else {}),
            **({"thin_solids_m": self.thin_solids} if self.thin_solids else {}),
        }

    def may_be_full(self, to_come: int = 0) -> bool:
        """Return whether the fluid may fill a closed vessel, so that it has no free surface.

        Parameters
        ----------
        to_come : int, optional
            Largest number of particles that inlets bring.

        Returns
        -------
        bool
            False where the room of the domain in front of the walls is larger than all fluid and no wall moves.
        """
        scene, (low, high) = self.scene, np.array(self.scene.domain)
        if any(wall.speed > 0.0 for wall in scene.walls):
            return True
        volume = scene.volumes.sum() + to_come * scene.spacing**scene.dimension
        # evenly spread: multiples of the powers of the root of x^(d+1) = x + 1, modulo 1
        root = {2: 1.32471795724474602596, 3: 1.22074408460575947536}[scene.dimension]
        steps = root ** -np.arange(1.0, scene.dimension + 1.0)
        x = low + (high - low) * np.mod(0.5 + np.arange(SAMPLE_COUNT)[:, None] * steps, 1.0)
        size = 2.0 * np.pi * np.maximum(0.0, x[:, 0]) if scene.axisymmetric else np.ones(SAMPLE_COUNT)
        size = size * np.all([wall.distance(x) > 0.0 for wall in scene.walls], axis=0)
        return bool(np.prod(high - low) * size.mean() < FREE_SURFACE_ROOM * volume)

    @property
    def thin_solids(self) -> dict[str, float]:
        """Thickness of the solids at rest that are thinner than a particle [m], by name; none of wall particles."""
        if self.numerics.walls == "particles":
            return {}
        solids = zip(self.scene.wall_names, self.scene.walls, strict=True)
        thickness = {name: wall.thickness for name, wall in solids if isinstance(wall, Solid) and wall.speed == 0.0}
        return {name: thick for name, thick in thickness.items() if thick < self.scene.spacing}

    @property
    def fall_time(self) -> float:
        """Time sqrt(H/g) [s] in which the body would fall half of its height."""
        return (self.height / self.gravity) ** 0.5

    @property
    def usual_interval(self) -> float:
        """Interval of the outputs of a run [s], of the nearest of 1, 2, 5 times a power of ten."""
        scene = self.scene
        once = scene.stop_at_rest and not (scene.jolts or scene.inlets)
        interval = max(INSTANT, min(scene.until / OUTPUTS, OUTPUT_INTERVAL * self.fall_time if once else scene.until))
        power = 10.0 ** np.floor(np.log10(interval))
        return float(min((k * power for k in (1.0, 2.0, 5.0, 10.0)), key=lambda value: abs(np.log(value / interval))))
