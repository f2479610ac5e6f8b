"""Simulation: owns the fields and the time, takes steps, calls the callbacks, and knows when to stop."""

import math
import time
import warnings
from dataclasses import asdict

import numpy as np

from ..boundaries.walls import Walls
from ..geometry.walls import Plane
from ..linear.pcg import INDEFINITE, STATUS
from ..particles.kernels import PACKING, PACKING_IN_PLANE, lattice_sums, mps_weight, smooth_weight
from ..particles.neighbors import Bins, CapacityError, EscapedError, NeighborList
from ..particles.particles import DUMMY, FLUID, WALL, Particles
from ..problem.measures import Snapshot
from ..problem.numerics import Implicit as ImplicitNumerics
from ..problem.numerics import SemiImplicit as SemiImplicitNumerics
from ..problem.problem import Problem
from ..problem.scene import Scene
from ..runtime.backend import require_room, started
from ..runtime.field_io import FieldIO
from ..runtime.stages import Stages
from ..schemes.diagnostics import NOT_A_NUMBER, Diagnostics
from ..schemes.implicit import Implicit
from ..schemes.semi_implicit import SemiImplicit
from ..schemes.step_report import DivergedError, StepReport
from ..terms.constants import law_of, resting_time
from ..terms.initial_relaxation import TIMES
from ..units import SceneError, finite, positive
from .pouring import Pouring
from .rest import Rest
from .snapshot import snapshot
from .summary import summary

MOST_LOST = 0.2  # of the volume; impacts and thin films lose up to 0.05 (docs/stability.md)


class Simulation:
    """A scene in motion: ``step``, ``run``, ``every``, ``snapshot``, ``summary``."""

    def __init__(self, scene: Scene, numerics=None, profile: bool = False):
        started()
        self._clock = time.process_time(), time.perf_counter()
        self.scene = scene
        self.numerics = numerics or ImplicitNumerics()
        Problem(scene, self.numerics)
        self._pairs_per_particle = 4.0 if scene.axisymmetric else 1.5  # rings that moved outward are thin
        self._walls_at = 0.0  # time [s] at which the walls stand
        self.wall_particles = 0
        self.pouring = tuple(Pouring(scene, inlet) for inlet in scene.inlets)
        self.stages = Stages(timed=profile)
        self._build()
        self.time, self.steps, self.report = 0.0, 0, None
        self.stopped_by = None
        self.compile_seconds = self.cpu_seconds = self.wall_seconds = 0.0
        self._schedules: list = []
        self._each_step: list = []
        self._interrupted = False
        self._last_dt = None
        self._wall_speed = max((wall.speed for wall in scene.walls), default=0.0)
        self._runaway_speed = self._find_runaway_speed()
        self._volume = float(scene.volumes.sum())  # of the fluid that is there [m3]
        self.rest = Rest()

    def _build(self):
        require_room()
        scene, numerics = self.scene, self.numerics
        d = scene.dimension
        re = numerics.effective_radius_ratio * scene.spacing
        semi_implicit = isinstance(numerics, SemiImplicitNumerics)
        use_particles = semi_implicit or numerics.walls == "particles"
        kinds, positions = np.full(len(scene.initial), FLUID), scene.initial
        velocity, mixes = scene.initial_velocity, scene.initial_mixes
        if use_particles and scene.wall_particles is not None:
            wall = np.asarray(scene.wall_particles, float)
            depth = np.max([-surface.distance(wall) for surface in scene.walls], axis=0)
            positions = np.vstack([positions, wall])
            kinds = np.concatenate([kinds, np.where(depth < scene.spacing, WALL, DUMMY)])
            velocity = np.vstack([velocity, np.zeros_like(wall)])
            mixes = np.concatenate([mixes, np.zeros(len(wall))])
            self.wall_particles = len(wall)
        expected = scene.expected
        to_come = sum((pouring.layers - (pouring.start == 0.0)) * len(pouring.layer) for pouring in self.pouring)
        in_plane = d == 2 and not scene.axisymmetric and not semi_implicit
        kernels = mps_weight if semi_implicit else smooth_weight, PACKING_IN_PLANE if in_plane else PACKING
        lattice = lattice_sums(d, scene.spacing, re, *kernels)
        carries_stress = law_of(scene.materials) == "bingham" and not semi_implicit
        volumes = np.resize(expected.volumes, len(positions))
        sleeps = carries_stress and numerics.sleep and math.isfinite(resting_time(scene.materials))
        ages = getattr(scene.material, "growth", None) is not None
        extra = [] if semi_implicit else ["a"]
        extra += ["still"] * sleeps + ["structure"] * ages + ["mix"] * (len(scene.materials) > 1)
        extra += [f"released_{k}" for k in range(sum(wall.loose for wall in scene.walls))]
        frictions = [wall.friction for wall in scene.walls if wall.friction]
        self.particles = Particles(
            positions, kinds, velocity, volumes, carries_stress, scene.axisymmetric, extra, frictions, to_come, mixes
        )
        self.bins = Bins(self.particles, scene.domain, scene.periodic_axes, re)
        capacity = int(self._pairs_per_particle * lattice.neighbours * self.particles.capacity) + 64
        self.neighbors = NeighborList(self.bins, capacity)
        self.lattice = lattice
        axis = (Plane((0.0, 0.0), (1.0, 0.0), mirror=True),) if scene.axisymmetric else ()
        surfaces = () if use_particles else (*axis, *scene.walls)
        self.walls = Walls(
            surfaces,
            d,
            scene.spacing,
            re,
            self.particles.capacity,
            rings=scene.axisymmetric,
            particles=self.particles,
            plastic_viscosity=scene.material.plastic_viscosity,
            weight=lattice.weight,
            packing_kernel=lattice.packing_kernel,
        )
        self.walls.place(self._walls_at)
        parts = expected, numerics, self.particles, self.neighbors, self.walls, lattice
        self.scheme = SemiImplicit(*parts) if semi_implicit else Implicit(*parts, scene.materials[1:], self.stages)
        self.diagnostics = Diagnostics(self.particles, self.scheme, lattice)
        read = {"yielded": self.scheme.yielded} | ({} if semi_implicit else {"p": self.scheme.smoothing.p})
        self.to_read = FieldIO(read, self.particles.capacity)  # with what the particles carry

    # ---- stepping -------------------------------------------------------------------------------------------
    def step(self, until: float | None = None) -> StepReport:
        """One time step, at most to ``until`` [s]."""
        if until is not None and not finite("until", until, "s", shape=()) > self.time:
            raise SceneError(f"until = {until} s: must be later than the present time, {self.time:.9g} s")
        cpu = time.process_time()
        jets = [pouring.pour(self.time, self.particles) for pouring in self.pouring]
        if jets:
            self._volume = self.fluid_particles * self.particles.usual_volume
            starts = [pouring.next for pouring in self.pouring if not pouring.entered and pouring.next > self.time]
            until = min([until or math.inf, *starts])
        speed = max([self.report.max_speed if self.report else self._initial_speed(), self._wall_speed, *jets])
        limits = self.scheme.time_step_limits(speed, self.report.acceleration if self.report else math.inf)
        if self._last_dt is not None:
            limits["growth"] = 2.0 * self._last_dt
        name = min(limits, key=limits.get)
        dt = limits[name]
        self._last_dt = dt
        if until is not None and until - self.time < dt * (1 + 1e-9):
            dt, name = until - self.time, "output"
        elif until is not None and until - self.time < 2 * dt:
            dt, name = 0.5 * (until - self.time), "output"
        if self.steps == 0 and hasattr(self.scheme, "initial_relaxation"):
            self._even()
        if hasattr(self.scheme, "drift"):  # the implicit scheme works at the middle of the step
            self._walls_at = self.time + 0.5 * dt
            self.walls.place(self._walls_at)
            self.stages("drift", self.scheme.drift, dt)
        self._neighbours()
        if hasattr(self.scheme, "predict"):  # the semi-implicit scheme moves twice in a step
            self.stages("predictor", self.scheme.predict, dt)
            self._neighbours()
        passes = self.scheme.step(dt)
        self.time += dt
        self.steps += 1
        self.report = self.stages("report", self._make_report, dt, name, passes)
        if self.steps == 1:
            self.stages.spent.clear()  # they held the compilation
            self.compile_seconds = time.process_time() - self._clock[0]
        else:
            self.cpu_seconds += time.process_time() - cpu
        self.wall_seconds = time.perf_counter() - self._clock[1]
        return self.report

    def _even(self):
        """Even an uneven fill, and say so."""
        self._neighbours()
        if self.scheme.initial_relaxation.needed():
            warnings.warn(
                f"fluid: unevenly filled, so it is evened before the first step ({TIMES} shifts)", stacklevel=3
            )
            for _ in range(TIMES):
                self.scheme.initial_relaxation.move()
                self._neighbours()

    @property
    def fluid_particles(self) -> int:
        """Number of fluid particles that are there now."""
        return self.particles.count[None] - self.wall_particles

    def _neighbours(self):
        try:
            if self.neighbors.alone and not self.stages.timed:
                self.neighbors.search()
            else:
                self.stages("reorder", self.bins.sort)
                self.stages("neighbours", self.neighbors.build)
        except EscapedError as error:
            self._diverge(f"{error}; {self.scheme.REMEDY}, or enlarge the scene's domain")
        except CapacityError:
            self._pairs_per_particle *= 2.0
            state = self.state()
            self._build()
            self.load(state)
            self._neighbours()

    def profile(self) -> list[tuple[str, float, int]]:
        """(stage, wall seconds, calls; of a solve its iterations) since the first step, when made with profile=True."""
        return [(name, seconds, calls) for name, (seconds, calls) in self.stages.spent.items()]

    def _initial_speed(self) -> float:
        return float(np.linalg.norm(self.particles.read()["u"], axis=1).max())

    def _make_report(self, dt, name, passes) -> StepReport:
        speed2, mean2, moving2, kinetic, unyielded, error, lost, acceleration2, *solve = self.diagnostics.take()
        iterations, residual, status = solve
        report = StepReport(
            step=self.steps,
            time=self.time,
            dt=dt,
            dt_limit=name,
            max_speed=math.sqrt(speed2),
            mean_speed=math.sqrt(mean2),
            moving_speed=math.sqrt(moving2),
            acceleration=math.sqrt(acceleration2),
            kinetic_energy=kinetic,
            unyielded_fraction=unyielded,
            viscous_iterations=passes,
            pressure_iterations=iterations,
            residual=residual,
            volume_error=error,
        )
        crossed = None
        if speed2 >= NOT_A_NUMBER:
            crossed = "a velocity is not a finite number"
        elif report.max_speed > self._runaway_speed:
            crossed = f"a speed of {report.max_speed:.4g} m/s, over {self._runaway_speed:.4g} m/s, is a runaway"
        elif lost > MOST_LOST * self._volume:
            crossed = f"{lost / self._volume:.0%} of the volume is lost, over {MOST_LOST:.0%}: particles overlap"
        elif status >= INDEFINITE:
            crossed = f"the matrix of the linear solve is {STATUS[status]}"
        if crossed:
            self.report = report
            self._diverge(f"{crossed}; {self.scheme.REMEDY}")
        return report

    def _diverge(self, why: str):
        self.stopped_by = "diverged"
        raise DivergedError(f"diverged at t = {self.time:.6g} s, step {self.steps}: {why}", self.report) from None

    def _find_runaway_speed(self) -> float:
        """Ten times the speed [m/s] of a fall through the whole domain, or of what moves at the start."""
        scene = self.scene
        size = float(np.linalg.norm(np.subtract(*scene.domain)))
        fall = math.sqrt(2.0 * float(np.linalg.norm(scene.gravity_vector)) * size)
        start = 0.0 if scene.velocity is None else float(np.linalg.norm(scene.velocity, axis=1).max())
        jet = max((pouring.speed for pouring in self.pouring), default=0.0)
        return 10.0 * (fall + self._wall_speed + start + jet) or math.inf

    # ---- running --------------------------------------------------------------------------------------------
    def every(self, interval: float, callback) -> None:
        """Call callback(simulation) at t = 0, every ``interval`` [s] and at the end."""
        positive("every", interval, "s")
        self._schedules.append([interval, callback, -1])

    def each_step(self, callback) -> None:
        """Call callback(simulation) after every step."""
        self._each_step.append(callback)

    def interrupt(self) -> None:
        """Ask run() to stop after the step in progress."""
        self._interrupted = True

    def run(self, until: float | None = None) -> str:
        """Step until ``until`` [s] (the scene's by default) or rest; returns what stopped it."""
        until = float(finite("until", self.scene.until if until is None else until, "s", shape=()))
        self.stopped_by = None
        self._interrupted = False
        self._call_schedules()
        if self.time >= until - 1e-9:
            self.stopped_by = "time"
        while self.stopped_by is None:
            upcoming = min([until] + [interval * (done + 1) for interval, _, done in self._schedules])
            self.step(max(upcoming, self.time + 1e-12))
            self._why_stop(until)  # notes since when the body rests, which a checkpoint of this step must know
            for callback in self._each_step:
                callback(self)
            self.stopped_by = self._why_stop(until)
            self._call_schedules(last=self.stopped_by is not None)
        return self.stopped_by

    def _call_schedules(self, last=False):
        for schedule in self._schedules:
            interval, callback, done = schedule
            due = math.floor(self.time / interval + 1e-6)
            if due > done or last:
                schedule[2] = max(due, done)
                callback(self)

    def _why_stop(self, until) -> str | None:
        rests = self.scene.stop_at_rest and self.numerics.unyielded_stop is None and self.rest.reached(self)
        if self._interrupted:
            return "interrupted"
        if self.time >= until - 1e-9:
            return "time"
        numerics = self.numerics
        if numerics.unyielded_stop is not None:
            moved = self.time > 0.05 and self.scene.stop_at_rest
            return "unyielded" if moved and self.report.unyielded_fraction >= numerics.unyielded_stop else None
        if not all(pouring.done for pouring in self.pouring):
            return None
        return "rest" if rests else None

    # ---- reading --------------------------------------------------------------------------------------------
    def snapshot(self) -> Snapshot:
        """The computed fluid now, ordered by id; ``scene.unfold`` completes it where the scene is part of a body."""
        return snapshot(self)

    def measures(self) -> dict[str, float]:
        """The scene's measures of the whole body now (slump_m, spread_m, ...)."""
        return self.scene.measure(self.scene.unfold(self.snapshot())) if self.scene.measure else {}

    def summary(self) -> dict:
        """Everything that describes the run, JSON-ready."""
        return summary(self)

    def state(self) -> dict:
        """All that is needed to continue bit for bit: arrays by row and plain scalars."""
        report = asdict(self.report) if self.report else None
        return {
            **self.particles.read(),
            "time": self.time,
            "steps": self.steps,
            "last_dt": self._last_dt,
            "rest": asdict(self.rest),
            "report": report,
            **({"pouring": [[pouring.entered, pouring.delay] for pouring in self.pouring]} if self.pouring else {}),
            **self.scheme.state(),
        }

    def load(self, state: dict) -> None:
        """Continue from a state()."""
        self.particles.load({name: state[name] for name in self.particles.carried})
        self.time, self.steps, self._last_dt = state["time"], state["steps"], state["last_dt"]
        self.report = StepReport(**state["report"]) if state["report"] else None
        self.rest = Rest(**state["rest"])
        for pouring, carried in zip(self.pouring, state.get("pouring", []), strict=True):
            pouring.entered, pouring.delay = carried
        self.scheme.load(state)
