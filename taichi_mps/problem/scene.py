"""Scene: everything that defines a problem, immutable and free of Taichi; and the numerics that solve it."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from ..geometry.cavity import Cavity
from ..geometry.solid import Solid
from ..geometry.walls import Cylinder, Plane
from ..units import SceneError, check_kinds, finite, said
from .inlet import Inlet
from .materials import Bingham, FlowCurve, HerschelBulkley
from .measures import Snapshot, mirrored, revolved


@dataclass(frozen=True)
class Scene:
    """One problem. Lengths [m], d = 2 or 3 dimensions, gravity along the last axis unless given.

    ``axisymmetric``: the two coordinates are (r, z), each particle is a ring around the z axis.
    """

    name: str
    material: Bingham | HerschelBulkley | FlowCurve
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
    outline: tuple[np.ndarray, ...] = ()  # polylines to draw [m], each (k, d)
    parameters: dict = field(default_factory=dict)  # as given, for the summary

    def __post_init__(self):
        self._check_kinds()
        poured = self.inlets and (self.fluid is None or np.size(self.fluid) == 0)
        given = np.zeros((0, len(self.inlets[0].centre))) if poured else self.fluid
        if not poured and np.size(given) == 0:
            raise SceneError("fluid: the geometry is empty; it must hold at least one particle")
        object.__setattr__(self, "fluid", given if poured else finite("fluid", given, "m", dimensions=2))
        if self.fluid.shape[1] not in (2, 3):
            raise SceneError(f"fluid: positions have {self.fluid.shape[1]} coordinates; must have 2 or 3")
        self._check_numbers()
        for inlet in self.inlets:
            self._check_inlet(inlet)
        self._check_mixes()
        x = self.initial if self.inlets else self.fluid
        if len(x) == 0:
            raise SceneError("fluid: the geometry is empty; it must hold at least one particle")
        low, high = np.array(self.domain, float)
        if np.any(x < low) or np.any(x > high):
            raise SceneError(f"domain = {self.domain} m: a particle lies outside; the domain must hold all of them")
        if self.axisymmetric and x.shape[1] != 2:
            raise SceneError(f"axisymmetric = True: the fluid has {x.shape[1]} coordinates; must have 2, (r, z)")
        if self.axisymmetric and x[:, 0].min() <= 0.0:
            raise SceneError(f"axisymmetric = True: a particle lies at r = {x[:, 0].min():g} m; r must be above 0 m")
        if self.axisymmetric and self.gravity_vector[0] != 0.0:
            raise SceneError(f"gravity = {tuple(self.gravity_vector.tolist())} m/s2: must be along z, axisymmetric")
        if self.axisymmetric and self.periodic_axes[0]:
            raise SceneError("axisymmetric = True: periodic along r; only z may be periodic")
        for wall in self.walls:
            if len(wall.point) != x.shape[1]:
                raise SceneError(f"walls: point = {wall.point} m: must have {x.shape[1]} coordinates, as the fluid has")
        self._check_mirrors(x)

    def _check_kinds(self):
        """What is no number has its type, and walls and inlets stand in a tuple."""
        flag = (bool | np.bool_, "True or False")
        function = (Callable, "a function")
        check_kinds(self, {"name": (str, "text"), "parameters": (dict, "a dict"), "cavity": (Cavity, "a Cavity")})
        check_kinds(self, {"axisymmetric": flag, "stop_at_rest": flag})
        check_kinds(self, {"measure": function, "check": function, "over_time": function})
        for key, kind in (("walls", Plane | Cylinder | Solid), ("inlets", Inlet), ("periodic", bool | np.bool_)):
            value = getattr(self, key)
            if value is None and key == "periodic":
                continue
            if not isinstance(value, tuple | list) or not all(isinstance(item, kind) for item in value):
                kinds = getattr(kind, "__args__", (kind,))
                words = "True or False" if key == "periodic" else " or ".join(item.__name__ for item in kinds)
                raise SceneError(f"{key} = {said(value, '')}: must be a tuple, each {words}")
            object.__setattr__(self, key, tuple(value))

    def _check_numbers(self):
        """Shapes, units and ranges of what is given as plain numbers."""
        n, d = self.fluid.shape
        if not isinstance(self.material, Bingham | HerschelBulkley | FlowCurve):
            raise SceneError(f"material = {self.material!r}: must be Bingham, Newtonian, HerschelBulkley or FlowCurve")
        for key, unit in (("spacing", "m"), ("until", "s")):
            if not finite(key, getattr(self, key), unit, shape=()) > 0.0:
                raise SceneError(f"{key} = {getattr(self, key)} {unit}: must be greater than 0 {unit}")
            object.__setattr__(self, key, float(getattr(self, key)))
        low, high = finite("domain", self.domain, "m", shape=(2, d))
        if not np.all(low < high):
            raise SceneError(f"domain = {self.domain} m: the second corner must be above the first along each axis")
        for key, unit, shape in (("gravity", "m/s2", (d,)), ("velocity", "m/s", (n, d))):
            if getattr(self, key) is not None:
                array = finite(key, getattr(self, key), unit, shape)
                object.__setattr__(self, key, array if key == "velocity" else tuple(array.tolist()))
        if self.wall_particles is not None:
            wall = finite("wall_particles", self.wall_particles, "m", dimensions=2)
            if wall.shape[1] != d:
                raise SceneError(f"wall_particles: have {wall.shape[1]} coordinates; must have {d}, as the fluid has")
        if self.periodic is not None and len(self.periodic) != d:
            raise SceneError(f"periodic = {self.periodic}: must have one word for each of {d} axes")

    def _check_mixes(self):
        """Mixes differ in their numbers only: one law, and nothing on a wall that is of one of them."""
        for inlet in self.inlets:
            if not isinstance(inlet.material, Bingham | HerschelBulkley | FlowCurve | None):
                raise SceneError(f"inlet: material = {str(inlet.material)[:60]}: must be Bingham or Newtonian")
        if len(self.materials) == 1:
            return
        if len(self.materials) > 256:
            raise SceneError(f"inlets: bring {len(self.materials)} mixes; must be at most 256")
        for inlet in self.inlets:
            if inlet.material is not None and not isinstance(inlet.material, Bingham):
                raise SceneError(f"inlet: material = {inlet.material!r}: must be Bingham or Newtonian")
        if not isinstance(self.material, Bingham):
            raise SceneError(
                f"material = {type(self.material).__name__}: must be Bingham or Newtonian where an inlet has "
                "a material of its own"
            )
        knees = [m.critical_strain_rate for m in self.materials if not m.newtonian]
        if None in knees and any(knees):
            raise SceneError(
                "inlet: critical_strain_rate: must be given for all mixes or for none; some have a true yield value"
            )
        if any(wall.friction for wall in self.walls):
            raise SceneError("inlet: material: must be that of the scene where a wall has friction")

    def _check_inlet(self, inlet):
        """The mouth has the dimension of the fluid and no wall in it; mirror planes leave it whole or halve it."""
        layer = inlet.layer(self.spacing)
        if self.axisymmetric:
            raise SceneError("inlet: the scene is axisymmetric; must be a scene without rings")
        if self.fluid.ndim != 2 or self.fluid.shape[1] != layer.shape[1]:
            raise SceneError(f"inlet: centre = {inlet.centre} m: must have as many coordinates as the fluid")
        least = 0.5 * inlet.layer_volume(self.spacing)
        if inlet.volume < least:
            raise SceneError(f"inlet: volume = {inlet.volume:g} m3: must be at least half a layer, {least:g} m3")
        for mirror in self.mirrors:
            away = abs(float(mirror.distance(np.array([inlet.centre]))[0]))
            aligned = abs(inlet.unit_direction @ mirror.normal) < 1e-6
            if away < inlet.radius and not (away < 1e-9 and aligned):
                raise SceneError(
                    f"inlet: the mirror plane with normal = {mirror.normal} cuts the hose; its axis must lie in the "
                    "plane, or it must be clear of it"
                )
        if not len(self.inlet_layer(inlet)):
            raise SceneError(f"inlet: centre = {inlet.centre} m: lies behind a mirror plane; must be in front of it")
        for wall in self.walls:
            if np.min(wall.distance(self.inlet_layer(inlet))) <= 0.0:
                raise SceneError(f"inlet: centre = {inlet.centre} m: the mouth reaches into a wall; must be free of it")

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
        return [(inlet, self.inlet_layer(inlet)) for inlet in self.inlets if inlet.start == 0.0]

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
        return np.vstack(points)

    @property
    def expected(self) -> "Scene":
        """The scene, without inlets as high and as fast as it will be: that from which a scheme takes its constants."""
        if not self.inlets:
            return self
        jet = max((inlet.velocity(self.spacing) for inlet in self.inlets), key=np.linalg.norm)
        velocity = np.tile(jet, (len(self.reach), 1))
        if self.velocity is not None:
            velocity[: len(self.fluid)] = self.velocity
        return replace(self, fluid=self.reach, velocity=velocity, inlets=())

    def _check_mirrors(self, x):
        """A mirror plane has all the fluid x on one side; gravity lies in it, other mirror planes stand across it."""
        gravity = self.gravity_vector
        for k, mirror in enumerate(self.mirrors):
            name = f"walls: mirror plane, normal = {mirror.normal}"
            if np.min(mirror.distance(x)) <= 0.0:
                raise SceneError(f"{name}: a fluid particle lies on it or behind it; all must be in front")
            if abs(gravity @ mirror.normal) > 1e-6 * np.linalg.norm(gravity):
                raise SceneError(f"{name}: gravity = {tuple(gravity.tolist())} m/s2 must lie in the plane")
            for other in self.mirrors[:k]:
                if abs(np.dot(other.normal, mirror.normal)) > 1e-6:
                    raise SceneError(f"{name}: must be at right angles to that with normal = {other.normal}")

    @property
    def mirrors(self) -> tuple[Plane, ...]:
        """The planes of symmetry among the walls."""
        return tuple(wall for wall in self.walls if isinstance(wall, Plane) and wall.mirror)

    def unfold(self, snapshot: Snapshot) -> Snapshot:
        """The whole body of which a snapshot of this scene is the computed part: completed behind the mirror planes,
        revolved about the axis. What is measured and shown."""
        for plane in self.mirrors:
            snapshot = mirrored(snapshot, plane.point, plane.normal)
        return revolved(snapshot) if self.axisymmetric else snapshot

    @property
    def dimension(self) -> int:
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
        if self.gravity is not None:
            return np.array(self.gravity, float)
        return np.array([0.0] * (self.dimension - 1) + [-9.81])

    @property
    def periodic_axes(self) -> tuple[bool, ...]:
        return self.periodic or (False,) * self.dimension
