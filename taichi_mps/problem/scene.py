"""Scene: everything that defines what is to be computed, immutable and free of Taichi. How is said by the numerics."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from ..geometry.cavity import Cavity
from ..geometry.solid import Solid
from ..geometry.walls import Cylinder, Plane
from ..units import obey
from .inlet import ROOM, Inlet, buried
from .materials import Material
from .measures import Measured, Snapshot, mirrored, revolved
from .scene_rules import KINDS, RULES, numbers


@dataclass(frozen=True)
class Scene:
    """A body of fluid, its walls and its inlets. Lengths [m], d = 2 or 3 dimensions, gravity along the last axis unless
    given.

    ``axisymmetric``: the two coordinates are (r, z), each particle is a ring around the z axis. A scene that cannot be
    is refused when it is made: SceneError by the first rule of ``scene_rules`` that it breaks. What it needs of a
    scheme is checked by ``Problem``.
    """

    name: str
    material: Material
    spacing: float  # l0 [m]
    fluid: np.ndarray | None  # particle positions [m], (n, d); may be None with an inlet that starts at 0 s
    domain: tuple[tuple[float, ...], tuple[float, ...]]  # low, high corner [m]; leaving it is an error
    walls: tuple[Plane | Cylinder | Solid, ...] = ()
    wall_particles: np.ndarray | None = None  # the paper's walls [m], (m, d)
    velocity: np.ndarray | None = None  # initial velocity [m/s], (n, d)
    gravity: tuple[float, ...] | None = None  # [m/s2], (d,)
    periodic: tuple[bool, ...] | None = None  # per axis
    axisymmetric: bool = False
    until: float = 5.0  # [s]
    stop_at_rest: bool = False
    inlets: tuple[Inlet, ...] = ()  # where concrete enters, scheme implicit
    cavity: Cavity | None = None  # what it is to fill, for the report
    measure: Callable[[Snapshot], dict[str, float]] | None = None  # of the whole body, see unfold
    check: Callable[[Snapshot, dict], None] | None = None  # raises AssertionError when the result is wrong
    over_time: Callable[[dict], dict[str, float]] | None = None  # of the columns of history.csv, for the summary
    enlarged_by: str = ""  # the keyword of the scene's function that enlarges the domain
    wall_loads: bool = False  # whether ``measure`` reads the loads on the walls
    outline: tuple[np.ndarray, ...] = ()  # polylines to draw [m], each (k, d)
    parameters: dict = field(default_factory=dict)  # as given, for the summary

    def __post_init__(self):
        obey(KINDS, self)
        taken = numbers(self) | {"walls": tuple(self.walls)}
        taken["periodic"] = None if self.periodic is None else tuple(self.periodic)
        taken["material"] = self.material.within(taken["until"])
        taken["inlets"] = tuple(inlet.within(taken["until"]) for inlet in self.inlets)
        for key in ("measure", "over_time"):
            function = getattr(self, key)
            if function is not None and not isinstance(function, Measured):
                taken[key] = Measured(key, function)
        for key, value in taken.items():
            object.__setattr__(self, key, value)
        obey(RULES, self)

    def copies_of(self, inlet: Inlet) -> int:
        """How often the whole body has this inlet: twice for each mirror plane that does not cut it."""
        clear = [abs(float(mirror.distance(np.array([inlet.centre]))[0])) >= inlet.radius for mirror in self.mirrors]
        return 2 ** sum(clear)

    def inlet_layer(self, inlet: Inlet) -> np.ndarray:
        """Places (m, d) [m] of the particles of a layer at the inlet that are in front of all mirror planes."""
        layer = inlet.layer(self.spacing)
        for mirror in self.mirrors:
            layer = layer[mirror.distance(layer) > 0.0]
        return layer

    @property
    def initial(self) -> np.ndarray:
        """Positions (n, d) [m] of all that is there at t = 0: the fluid and the first layers of the inlets."""
        return np.vstack([self.fluid, *(x for _, x in self._first_layers)])

    @property
    def initial_velocity(self) -> np.ndarray:
        """Velocities (n, d) [m/s] of what is there at t = 0."""
        own = np.zeros_like(self.fluid) if self.velocity is None else np.asarray(self.velocity, float)
        first = [np.tile(inlet.velocity(self.spacing), (len(x), 1)) for inlet, x in self._first_layers]
        return np.vstack([own, *first])

    @property
    def initial_mixes(self) -> np.ndarray:
        """Number (n,) in ``materials`` of the mix of what is there at t = 0."""
        first = [np.full(len(x), self.mix_of(inlet)) for inlet, x in self._first_layers]
        return np.concatenate([np.zeros(len(self.fluid), int), *first])

    @property
    def _first_layers(self):
        there = [inlet for inlet in self.inlets if inlet.start == 0.0]
        return [(inlet, self.inlet_layer(inlet) + inlet.displacement(0.0)) for inlet in there]

    @property
    def materials(self) -> tuple:
        """The mixes: ``material`` and the others that inlets bring."""
        others = [inlet.material for inlet in self.inlets if inlet.material not in (None, self.material)]
        return (self.material, *dict.fromkeys(others))

    def mix_of(self, inlet: Inlet) -> int:
        """Number in ``materials`` of the mix that an inlet brings."""
        return 0 if inlet.material is None else self.materials.index(inlet.material)

    @property
    def reach(self) -> np.ndarray:
        """Points (n, d) [m] that say how far the fluid extends: the fluid, and a layer at each inlet, there and on the
        floor."""
        floors = [wall.point[-1] for wall in self.walls if isinstance(wall, Plane) and wall.normal[-1] > 0.99]
        bottom = max([self.domain[0][-1], *(z + 0.5 * self.spacing for z in floors)])
        points = [self.fluid]
        for inlet in self.inlets:
            fallen = self.inlet_layer(inlet)
            fallen[:, -1] = np.minimum(fallen[:, -1], bottom)
            points += [self.inlet_layer(inlet), fallen]
            for displacement in inlet.farthest:
                moved = self.inlet_layer(inlet) + displacement
                if not buried(moved, np.vstack(points), self.spacing / ROOM):
                    points.append(moved)
        points = np.vstack(points)
        _, first = np.unique(np.round(points / self.spacing, 6), axis=0, return_index=True)
        return points[np.sort(first)]

    @property
    def expected(self) -> "Scene":
        """The scene, without inlets as high and as fast as it will be: that from which a scheme takes its constants."""
        if not self.inlets:
            return self
        jet = max((inlet.fastest(self.spacing) for inlet in self.inlets), key=np.linalg.norm)
        velocity = np.tile(jet, (len(self.reach), 1))
        if self.velocity is not None:
            velocity[: len(self.fluid)] = self.velocity
        return replace(self, fluid=self.reach, velocity=velocity, inlets=())

    @property
    def mirrors(self) -> tuple[Plane, ...]:
        """The planes of symmetry among the walls."""
        return tuple(wall for wall in self.walls if isinstance(wall, Plane) and wall.mirror)

    @property
    def measured_walls(self) -> dict[str, int]:
        """The numbers of the walls whose loads can be measured, by name: ``wall_0`` of the first if it has none."""
        return {wall.name or f"wall_{k}": k for k, wall in enumerate(self.walls) if not getattr(wall, "mirror", False)}

    def unfold(self, snapshot: Snapshot) -> Snapshot:
        """The whole body of which a snapshot of this scene is the computed part: completed behind the mirror planes,
        revolved about the axis. What is measured and shown."""
        for plane in self.mirrors:
            snapshot = mirrored(snapshot, plane.point, plane.normal)
        return revolved(snapshot) if self.axisymmetric else snapshot

    @property
    def dimension(self) -> int:
        """d: 2 or 3 coordinates."""
        return self.fluid.shape[1]

    @property
    def volumes(self) -> np.ndarray:
        """Volume of each fluid particle [m3], (n,): l0^d, 2 pi r l0^2 of a ring; per metre of depth in 2-D [m2]."""
        return self.volumes_at(self.fluid)

    def volumes_at(self, x) -> np.ndarray:
        """Volumes (n,) [m3] of particles that start at x (n, d) [m]."""
        if self.axisymmetric:
            return 2.0 * np.pi * x[:, 0] * self.spacing**2
        return np.full(len(x), self.spacing**self.dimension)

    @property
    def gravity_vector(self) -> np.ndarray:
        """Gravity (d,) [m/s2]; 9.81 down the last axis unless given."""
        if self.gravity is not None:
            return np.array(self.gravity, float)
        return np.array([0.0] * (self.dimension - 1) + [-9.81])

    @property
    def periodic_axes(self) -> tuple[bool, ...]:
        """Is it periodic along each axis? (d,)"""
        return self.periodic or (False,) * self.dimension
