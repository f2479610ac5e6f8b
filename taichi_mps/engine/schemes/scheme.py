"""Base class of the schemes: particles, neighbours and walls of a problem."""

import numpy as np

from ..boundaries import walls as boundaries
from ..geometry.walls import Plane
from ..particles.gradient import Gradient
from ..particles.kernels import PACKING, PACKING_IN_PLANE, lattice_sums, mps_weight, smooth_weight
from ..particles.neighbors import Bins, NeighborList
from ..particles.particles import DUMMY, FLUID, WALL, Carried, Particles
from ..problem.time_step import Speeds
from ..runtime.backend import double_field, ti
from ..runtime.field_io import FieldIO
from ..runtime.stages import flush
from .diagnostics import Diagnostics


class Scheme:
    """A time scheme: it owns its whole step, neighbour search and motion of the walls included.

    Besides these methods a scheme has ``step(dt, is_read)``: advance the particles by dt [s], to a state that is
    ``is_read`` or not, and report; CapacityError where the neighbour list is too short for what it meets, EscapedError
    where particles leave the domain: then the state is that of no time. ``state()`` gives the scalars that it carries
    from step to step, besides what the particles carry, and ``load(state)`` goes on from there.
    """

    REMEDY: str  # what a user can do where it diverges
    diagnostics: Diagnostics
    field_io: FieldIO  # what a snapshot shows besides what the particles carry: yielded, and p of ``implicit``
    all_active = True  # whether all particles took part in the last step
    may_leave_out = False  # whether the next step may leave particles out
    unmet = 0  # steps whose outer iterations ended before their tolerance was met
    left_out = 0.0  # part of the particles that was left out of the steps, mean of all [-]

    def __init__(self, problem, carried: dict[str, Carried], to_come: int, pairs_per_particle: float):
        self.fluid = Fluid(problem, carried, to_come, pairs_per_particle)
        self.numerics, self.spacing = problem.numerics, problem.scene.spacing
        self.gradient = self.fluid.gradient  # for notebooks (docs/howto/notebook.md)

    def time_step_limits(self, speeds: Speeds) -> dict[str, float]:
        """Largest allowed steps [s] by name, for what moves now: here by the Courant number."""
        return {"Courant": self.numerics.courant_number * self.spacing / speeds.speed} if speeds.speed > 0.0 else {}

    def set_forces(self, scene, start: float, dt: float) -> None:
        """Set gravity and the velocities of walls for a step of dt [s] from a time [s]: their means over the step,
        where they change. A jolt is a gravity during one step."""
        fluid, jolts = self.fluid, scene.jolts_at(start)
        if scene.gravity_in_time is not None or scene.jolts:
            flush()
            changing = scene.gravity_in_time
            mean = scene.gravity_vector if changing is None else changing.integral(start, start + dt) / dt
            fluid.gravity[None] = mean + sum(jolt.at_origin for jolt in jolts) / dt
        if fluid.twist is not None:
            fluid.twist[None] = np.sum([jolt.spin for jolt in jolts] or [0.0 * scene.jolts[0].spin], axis=0) / dt
        self.fluid.walls.set_velocities(dt)

    def relax(self) -> None:
        """Relax an uneven fill before the first step, where the scheme needs it."""

    def complete_fields(self) -> None:
        """Complete the carried fields of particles that did not take the last step, before ``fields_to_read``."""

    def fields_to_read(self, count: int) -> dict:
        """Arrays (count, ...) of the first rows that a snapshot shows besides what the particles carry."""
        return self.field_io.read(count)


class Fluid:
    """Discretised fluid of a problem: particles, neighbour list, walls, gradient and gravity, what every term is given.

    ``carried``: what the terms of a scheme want the particles to carry; ``pairs_per_particle``: room for neighbours,
    over those of a full lattice.
    """

    def __init__(self, problem, carried: dict[str, Carried], to_come: int, pairs_per_particle: float):
        scene, d = problem.scene, problem.scene.dimension
        walls, start = surfaces(problem), initial_state(problem)
        self.gravity = double_field(components=d)  # [m/s2]
        self.gravity[None] = scene.gravity_vector
        self.frame = problem.frame.tolist()  # [m/s]
        turns = any(jolt.angular_velocity for jolt in scene.jolts)
        self.twist = ti.Matrix.field(d, d, ti.f64, ()) if turns else None  # gradient of gravity [1/s2]
        volumes = np.resize(problem.scene.expected.volumes, len(start["x"]))
        self.particles = Particles(start, volumes, carried | boundaries.carried(walls), scene.axisymmetric, to_come)
        self.wall_particles = int((start["kind"] != FLUID).sum())
        self.lattice = lattice_sums(d, scene.spacing, problem.effective_radius, *kernels(problem))
        bins = Bins(self.particles, scene.domain, scene.periodic, problem.effective_radius + problem.skin)
        pair_capacity = int(pairs_per_particle * self.lattice.neighbours * self.particles.capacity) + 64
        self.neighbors = NeighborList(bins, pair_capacity, problem.skin)
        self.walls = boundaries.Walls(
            walls,
            d,
            scene.spacing,
            problem.effective_radius,
            self.particles.capacity,
            rings=scene.axisymmetric,
            particles=self.particles,
            slope=scene.material.typical_slope,
            weight=self.lattice.weight,
            packing_kernel=self.lattice.packing_kernel,
        )
        self.gradient = Gradient(self.neighbors, self.walls, self.lattice, scene.spacing)


def surfaces(problem) -> tuple:
    """The walls that are surfaces: none where walls are particles; the axis is a mirror plane of rings."""
    if problem.numerics.walls == "particles":
        return ()
    axis = (Plane((0.0, 0.0), (1.0, 0.0), mirror=True),) if problem.scene.axisymmetric else ()
    return (*axis, *problem.scene.walls)


def kernels(problem) -> tuple:
    """Weight of the gradient and kernel of the packing: the paper's weight in its own scheme."""
    semi_implicit = problem.scheme == "semi-implicit"
    in_plane = problem.scene.dimension == 2 and not problem.scene.axisymmetric and not semi_implicit
    return mps_weight if semi_implicit else smooth_weight, PACKING_IN_PLANE if in_plane else PACKING


def initial_state(problem) -> dict:
    """Arrays of what is there at 0 s: the fluid, first layers of inlets included, and behind it the wall particles, of
    which those deeper than a spacing are dummies."""
    scene = problem.scene
    start = scene.start
    start["kind"] = np.full(len(start["x"]), FLUID)
    start["structure"] = problem.initial_structure(start["mix"])
    if not problem.wall_particles:
        return start
    wall = np.asarray(scene.wall_particles, float)
    depth = np.max([-surface.distance(wall) for surface in scene.walls], axis=0)
    return {
        "x": np.vstack([start["x"], wall]),
        "u": np.vstack([start["u"], np.zeros_like(wall)]),
        "mix": np.concatenate([start["mix"], np.zeros(len(wall))]),
        "structure": np.concatenate([start["structure"], np.zeros(len(wall))]),
        "kind": np.concatenate([start["kind"], np.where(depth < scene.spacing, WALL, DUMMY)]),
    }
