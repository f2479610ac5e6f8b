"""Scene: immutable definition of the body of fluid, its walls and its inlets; the numerics define how to compute it."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from pydantic import InstanceOf

from ...units import Duration, Size, array, instance, points, validated, vector
from ..geometry.cavity import Cavity
from ..geometry.shapes import Cone
from ..geometry.solid import Solid
from ..geometry.time_dependent import TimeDependent, table_of_time
from ..geometry.walls import Cylinder, Plane
from .grains import Grains
from .inlet import MIN_GAP, Inlet, buried
from .jolt import Jolt
from .materials import AnyMaterial
from .measures import GuardedMeasure, Snapshot, mirrored, revolved
from .scene_rules import RULES, complete_fields
from .stream import Stream

if TYPE_CHECKING:
    from builtins import bool as SceneFlag, str as SceneText  # isort: skip

    SceneFunction = Callable
    SceneWalls = tuple[Plane | Cylinder | Solid, ...]
else:
    SceneText, SceneFunction = instance(str, "text"), instance(Callable, "a function")
    SceneFlag = instance(bool | np.bool_, "True or False")
    SceneWalls = instance(
        Plane | Cylinder | Solid,
        "a tuple, each Plane or Cylinder or Solid; in place of a Box *mps.box_planes(low, high) holds fluid, "
        "mps.Solid.of stands in it",
        several=True,
    )


@validated
@dataclass(frozen=True, eq=False)
class Scene:
    """Everything that defines what is to be computed: a body of fluid, its walls and its inlets.

    Coordinates have d = 2 or 3 dimensions, gravity acts along the last axis unless given. A scene is immutable and free
    of Taichi; how it is computed is said by the numerics, ``Implicit`` or ``SemiImplicit``.

    Parameters
    ----------
    name : str
        Name of the scene and of the folder of its results.
    material : Material
        Mix of the fluid.
    spacing : float
        Particle size l0 [m].
    fluid : ndarray, shape (n, d), or None
        Positions of the particles at 0 s [m]; may be None with an inlet that opens at 0 s.
    domain : tuple of two tuples of float, length d
        Lowest and highest corner [m]; leaving it ends the run.
    walls : tuple of Plane, Cylinder or Solid, optional
        Walls as surfaces.
    wall_particles : ndarray, shape (m, d), optional
        Walls as particles, for the scheme ``semi-implicit`` [m].
    velocity : ndarray, shape (n, d), optional
        Velocity at 0 s [m/s], zero by default.
    gravity : tuple of float, length d, optional
        Gravity [m/s2], 9.81 down the last axis by default; of what is computed in a frame that is accelerated, less its
        acceleration. If it changes: rows of a time [s] and a gravity, linear in between and with a jump where a time is
        there twice.
    jolts : tuple of Jolt, optional
        Jumps of the velocity of the fluid, scheme ``implicit``.
    periodic : tuple of bool, length d, optional
        Whether an axis is periodic; none is by default.
    axisymmetric : bool, optional
        Whether coordinates are (r, z) and particles rings around the z axis.
    until : float, optional
        Time limit [s].
    stop_at_rest : bool, optional
        Whether the run ends when the fluid has come to rest.
    inlets : tuple of Inlet, optional
        Where concrete enters, scheme ``implicit``.
    cavity : Cavity, optional
        Form that is to be filled, for the report.
    measure : callable, optional
        ``measure(snapshot)`` gives results of the whole body, {name: float}.
    check : callable, optional
        ``check(snapshot, measures)`` raises AssertionError when the result is wrong; tests call it, a run does not.
    over_time : callable, optional
        ``over_time(history)`` gives results from the columns of history.csv, {name: float}.
    enlarged_by : str, optional
        Keyword of the scene's function that enlarges the domain.
    wall_loads : bool, optional
        Whether ``measure`` reads the loads on the walls.
    outline : tuple of ndarray, shape (k, d), optional
        Polylines to draw [m].
    mould : Cone, optional
        Shape of the fluid at 0 s, drawn in place of its particles then.
    vessel : tuple of ndarray, shape (k, 3), optional
        Convex faces of the whole vessel, drawn as glass [m].
    parameters : dict, optional
        Keywords that the scene was made from, for the summary.
    grains : Grains, optional
        Coarse aggregate in the fluid, which is then the mortar; scheme ``implicit``.

    Raises
    ------
    SceneError
        For the first rule that the scene breaks. What it needs of a scheme is checked by ``Problem``.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> scene = mps.Scene(
    ...     name="heap",
    ...     material=mps.Bingham(yield_value=100.0, plastic_viscosity=20.0),
    ...     spacing=0.02,
    ...     fluid=mps.fill(mps.Box((-0.1, 0.0), (0.1, 0.2)), 0.02),
    ...     domain=((-0.5, -0.1), (0.5, 0.3)),
    ...     walls=(mps.Plane((0.0, 0.0), (0.0, 1.0)),),
    ... )
    >>> scene.dimension, len(scene.fluid)
    (2, 100)
    """

    name: SceneText
    material: AnyMaterial
    spacing: Size
    fluid: points("m") | None
    domain: array("m", (2, 2), (2, 3), kind=tuple)
    walls: SceneWalls = ()
    wall_particles: points("m") | None = None
    velocity: points("m/s") | None = None
    gravity: vector("m/s2") | table_of_time("m/s2") | None = None
    periodic: instance(bool | np.bool_, "a tuple, each True or False", several=True) | None = None
    axisymmetric: SceneFlag = False
    until: Duration = 5.0
    stop_at_rest: SceneFlag = False
    inlets: instance(Inlet, "a tuple, each Inlet", several=True) = ()
    cavity: instance(Cavity, "a Cavity") | None = None
    measure: SceneFunction | None = None
    check: SceneFunction | None = None
    over_time: SceneFunction | None = None
    enlarged_by: SceneText = ""
    wall_loads: SceneFlag = False
    outline: tuple[points("m"), ...] = ()
    mould: instance(Cone, "a Cone") | None = None
    vessel: tuple[array("m", (None, 3)), ...] = ()
    parameters: instance(dict, "a dict") = field(default_factory=dict)
    jolts: instance(Jolt, "a tuple, each Jolt", several=True) = ()
    grains: instance(Grains, "Grains") | None = None

    def __post_init__(self):
        taken = complete_fields(self)
        taken["material"] = self.material.within(taken["until"])
        taken["inlets"] = tuple(inlet.within(taken["until"]) for inlet in self.inlets)
        for key in ("measure", "over_time"):
            function = getattr(self, key)
            if function is not None and not isinstance(function, GuardedMeasure):
                taken[key] = GuardedMeasure(key, function)
        for key, value in taken.items():
            object.__setattr__(self, key, value)
        for rule in RULES:
            rule(self)

    def inlet_layer(self, inlet: Inlet) -> np.ndarray:
        """Return the positions of a layer at an inlet that are in front of all mirror planes.

        Parameters
        ----------
        inlet : Inlet
            Inlet of this scene.

        Returns
        -------
        ndarray, shape (m, d)
            Positions [m].
        """
        layer = inlet.layer(self.spacing)
        for mirror in self.mirrors:
            layer = layer[mirror.distance(layer) > 0.0]
        return layer

    @property
    def start(self) -> dict[str, np.ndarray]:
        """Fluid and first layers of the inlets at 0 s.

        Positions ``x`` [m], shape (n, d), velocities ``u`` [m/s], shape (n, d), and numbers ``mix`` in ``materials``,
        shape (n,).
        """
        u = np.zeros_like(self.fluid) if self.velocity is None else self.velocity
        mix = np.zeros(len(u), int)
        parts = [(self.fluid, u, mix, self.slots[: len(u)] if self.grains else mix)]
        for inlet in self.inlets:
            if inlet.start == 0.0:
                x, slot = self.entering(inlet, 0)
                u = np.tile(inlet.velocity(self.spacing), (len(x), 1))
                parts.append((x + inlet.displacement(0.0), u, np.full(len(x), self.mix_of(inlet)), slot))
        x, u, mix, slot = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
        return {"x": x, "u": u, "mix": mix} | ({"slot": slot} if self.grains else {})

    @cached_property
    def streams(self) -> list[Stream]:
        """Stream of each inlet in a scene with grains; none without grains."""
        return [Stream(self, inlet) for inlet in self.inlets] if self.grains else []

    @cached_property
    def grain_places(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Grains at 0 s.

        Number (n,) of the grain of each particle of the fluid and then of the ``streams``, 0 of mortar; centres (g, d)
        [m], radii (g,) [m] and rotations (g, d, d).
        """
        parts = [stream.places for stream in self.streams]
        if len(self.fluid):
            parts = [self.grains.places(self.fluid, self.spacing, self.domain, self.periodic), *parts]
        numbers, *others = zip(*parts, strict=True)
        before = np.cumsum([0, *map(len, others[0])])
        numbers = [np.where(number > 0, number + k, 0) for number, k in zip(numbers, before, strict=False)]
        return np.concatenate(numbers), *map(np.concatenate, others)

    @cached_property
    def slots(self) -> np.ndarray:
        """Place of each particle of ``grain_places`` among those of grains, in their order, from 1; 0 of mortar."""
        number = self.grain_places[0]
        slots = np.zeros(len(number), int)
        slots[np.argsort(number, kind="stable")] = np.maximum(0, 1 + np.arange(len(number)) - (number == 0).sum())
        return slots

    def entering(self, inlet: Inlet, layer: int) -> tuple[np.ndarray, np.ndarray]:
        """Return what enters with a layer: that layer, or of grains all that enter with it.

        Parameters
        ----------
        inlet : Inlet
            Inlet of this scene.
        layer : int
            Number of the layer.

        Returns
        -------
        x : ndarray, shape (m, d)
            Positions as it begins to leave the mouth at its ``centre`` [m].
        slot : ndarray of int, shape (m,)
            Their ``slots``, 0 without grains.
        """
        if not self.grains:
            x = self.inlet_layer(inlet)
            return x, np.zeros(len(x), int)
        k = next(k for k, other in enumerate(self.inlets) if other is inlet)
        ends = np.cumsum([len(self.fluid), *(len(stream.x) for stream in self.streams)])
        stream, now = self.streams[k], self.streams[k].layer == layer
        return stream.x[now] + layer * stream.step, self.slots[ends[k] : ends[k + 1]][now]

    @property
    def initial(self) -> np.ndarray:
        """Positions of all particles at 0 s [m], shape (n, d)."""
        return self.start["x"]

    @cached_property
    def materials(self) -> tuple:
        """Mixes: ``material`` first, then others that inlets bring."""
        others = [inlet.material for inlet in self.inlets if inlet.material not in (None, self.material)]
        return (self.material, *dict.fromkeys(others))

    def mix_of(self, inlet: Inlet) -> int:
        """Return the number of the mix that an inlet brings.

        Parameters
        ----------
        inlet : Inlet
            Inlet of this scene.

        Returns
        -------
        int
            Number in ``materials``.
        """
        return 0 if inlet.material is None else self.materials.index(inlet.material)

    @property
    def reach(self) -> np.ndarray:
        """Points that mark the expected extent of the fluid [m], shape (n, d).

        They are the fluid, and a layer at each inlet, at its mouth and on the floor.
        """
        floors = [wall.point[-1] for wall in self.walls if isinstance(wall, Plane) and wall.normal[-1] > 0.99]
        bottom = max([self.domain[0][-1], *floors]) + 0.5 * self.spacing
        points = [self.fluid]
        for inlet in self.inlets:
            layer, turns = self.inlet_layer(inlet), inlet.turns[:, 1:]
            fallen = np.column_stack([layer[:, :-1], np.minimum(layer[:, -1], bottom)])
            # and where the hose is farthest along each axis
            for places in (layer, fallen, *(layer + turns[np.unique([turns.argmin(0), turns.argmax(0)]), None])):
                if not buried(places, np.vstack(points), self.spacing / MIN_GAP):
                    points.append(places)
        points = np.vstack(points)
        _, first = np.unique(np.round(points / self.spacing, 6), axis=0, return_index=True)
        return points[np.sort(first)]

    @cached_property
    def expected(self) -> "Scene":
        """Scene without inlets whose fluid is as high and as fast as this one is expected to become.

        A scheme takes its constants from it.
        """
        if not self.inlets:
            return self
        jet = max((inlet.fastest(self.spacing) for inlet in self.inlets), key=np.linalg.norm)
        velocity = np.tile(jet, (len(self.reach), 1))
        if self.velocity is not None:
            velocity[: len(self.fluid)] = self.velocity
        return replace(self, fluid=self.reach, velocity=velocity, inlets=(), grains=None)

    @property
    def mirrors(self) -> tuple[Plane, ...]:
        """Planes of symmetry among the walls."""
        return tuple(wall for wall in self.walls if isinstance(wall, Plane) and wall.mirror)

    @property
    def wall_names(self) -> list[str]:
        """Name of each wall, ``wall_0`` of the first if it has none."""
        return [wall.name or f"wall_{k}" for k, wall in enumerate(self.walls)]

    @property
    def measured_walls(self) -> dict[str, int]:
        """Numbers of the walls whose loads can be measured, by name."""
        return {name: k for k, name in enumerate(self.wall_names) if self.walls[k] not in self.mirrors}

    @validated
    def unfold(self, snapshot: InstanceOf[Snapshot]) -> Snapshot:
        """Complete the computed part to the whole body, for measures and pictures.

        Parameters
        ----------
        snapshot : Snapshot
            Computed part: half of a body, or a section of rings.

        Returns
        -------
        Snapshot
            Whole body, mirrored at the planes of symmetry and revolved about the axis.
        """
        for plane in self.mirrors:
            snapshot = mirrored(snapshot, plane.point, plane.normal)
        return revolved(snapshot) if self.axisymmetric else snapshot

    @property
    def dimension(self) -> int:
        """Number d of coordinates, 2 or 3."""
        return self.fluid.shape[1]

    @property
    def volumes(self) -> np.ndarray:
        """Volume of each fluid particle [m3], shape (n,); in two dimensions [m2]."""
        return self.volumes_at(self.fluid)

    @validated
    def volumes_at(self, x: points("m")) -> np.ndarray:
        """Return the volumes of particles that start at given positions.

        Parameters
        ----------
        x : ndarray, shape (n, d)
            Positions [m].

        Returns
        -------
        ndarray, shape (n,)
            l0^d [m3], in two dimensions [m2]; 2 pi r l0^2 of rings.
        """
        if self.axisymmetric:
            return 2.0 * np.pi * x[:, 0] * self.spacing**2
        return np.full(len(x), self.spacing**self.dimension)

    @property
    def gravity_vector(self) -> np.ndarray:
        """Largest gravity in time [m/s2], shape (d,)."""
        return np.array(self.gravity) if self.gravity_in_time is None else self.gravity_in_time.largest

    @cached_property
    def gravity_in_time(self) -> TimeDependent | None:
        """Gravity that changes; None if it is constant."""
        return TimeDependent(self.gravity, "gravity", "m/s2", self.dimension) if np.ndim(self.gravity) == 2 else None

    @cached_property
    def in_time(self) -> tuple[TimeDependent | Jolt, ...]:
        """Gravity, wall velocities and jolts that change in time."""
        return tuple(filter(None, [self.gravity_in_time, *(wall.in_time for wall in self.walls), *self.jolts]))

    def jolts_at(self, time: float) -> list[Jolt]:
        """Return the jolts at a time.

        Parameters
        ----------
        time : float
            Time [s].

        Returns
        -------
        list of Jolt
            Jolts.
        """
        return [jolt for jolt in self.jolts if jolt.changes(time)]

    def jolted(self, x: np.ndarray, time: float | None = None) -> float:
        """Return the largest speed that jolts give to particles.

        Parameters
        ----------
        x : ndarray, shape (n, d)
            Positions [m].
        time : float, optional
            Time [s]; all jolts by default.

        Returns
        -------
        float
            Speed [m/s], 0 without jolts.
        """
        return max(
            (
                float(np.linalg.norm(jolt.jump(x), axis=1).max())
                for jolt in (self.jolts if time is None else self.jolts_at(time))
            ),
            default=0.0,
        )

    @cached_property
    def last_change(self) -> float:
        """Time [s] after which gravity and wall velocities are constant."""
        return max((part.last for part in self.in_time), default=-np.inf)
