"""Simulation: it owns the time, takes steps, calls the callbacks, and knows when to stop."""

import math
import time
from collections.abc import Callable
from dataclasses import asdict, replace

import numpy as np
from pydantic import InstanceOf, SkipValidation

from ...units import INSTANT, Duration, Flag, Instant, quote, require, validated
from ..particles.neighbors import CapacityError, EscapedError
from ..problem.measures import Snapshot
from ..problem.numerics import Implicit, SemiImplicit
from ..problem.problem import Problem
from ..problem.scene import Scene
from ..problem.time_step import Speeds
from ..runtime.backend import in_session, require_room, require_thread, session
from ..runtime.stages import Execution
from ..schemes.implicit import ImplicitScheme
from ..schemes.semi_implicit import SemiImplicitScheme
from ..schemes.step_report import DivergedError, DomainError, StepReport
from ..terms.rheology import OwnLaw
from .facts import facts_of, judge
from .frame import Frame, frame_between
from .grain_state import GrainState
from .memory import pairs_of, require_memory
from .pouring import Pouring
from .rest import Rest
from .snapshot import crossing, of_state, snapshot

SCHEMES = {"implicit": ImplicitScheme, "semi-implicit": SemiImplicitScheme}
FREE_FALL_RATIO = 1.2  # maximum over inlet speed above which a jet is in free fall: too loose to judge the volume error
MIN_ENCLOSED_FRACTION = 0.1  # fraction of enclosed volume from which on the volume error is meaningful: a jet has less


class Simulation:
    """Scene in motion: it takes time steps, calls back, and knows when to stop.

    Parameters
    ----------
    scene : Scene or Problem
        What is to be computed.
    numerics : Implicit or SemiImplicit, optional
        How it is computed, ``Implicit()`` by default; None with a Problem.
    profile : bool, optional
        Whether to time the stages of a step.

    Raises
    ------
    SceneError
        For what cannot be computed or does not fit into memory, before anything is allocated.
    RuntimeError
        If ``init`` was not called.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> mps.init(threads=1)
    >>> sim = mps.Simulation(mps.slump_cone(model="axisymmetric", spacing=0.05, until=0.02))
    >>> sim.run()
    'time'
    >>> report = sim.report
    >>> report.step == sim.steps, 0.0 < report.max_speed < 0.3
    (True, True)
    >>> sorted(sim.measures())
    ['slump_m', 'slump_max_m', 'spread_m']
    """

    @validated
    def __init__(
        self,
        scene: SkipValidation[Scene | Problem],
        numerics: SkipValidation[Implicit | SemiImplicit | None] = None,
        profile: Flag = False,
    ):
        self.session = session()
        self._begin(scene if isinstance(scene, Problem) else Problem(scene, numerics))
        scene = self.scene
        self._own_laws = [OwnLaw(m, k) for k, m in enumerate(scene.materials) if m.own]
        self._profile = profile
        self._pairs_per_particle = pairs_of(scene)
        self.pouring = tuple(Pouring(scene, inlet) for inlet in scene.inlets)
        self._build()
        self._time, self.steps = 0.0, 0
        self.report: StepReport | None = None
        self._interrupted = self._compiled = False
        self._last_dt = None
        self._volume = float(scene.volumes.sum())  # of the fluid that is there [m3]
        self.rest = Rest()

    def _begin(self, problem: Problem):
        """Set a problem before its first step: no callbacks, and the clocks at zero."""
        self.problem, self.scene, self.numerics = problem, problem.scene, problem.numerics
        self._schedules, self._each_step, self.stopped_by = [], [], None
        self._last_frame = None  # last complete frame, for interpolation
        # state before the step that passes the time limit of ``run``, and that limit [s] once it is passed
        self._before = self._passed = None
        self._clock = time.process_time(), time.perf_counter()
        self.compile_seconds = self.cpu_seconds = self.wall_seconds = 0.0

    def _build(self):
        """Allocate the scheme with its particles, and how its stages are launched."""
        require_room()
        require_memory(self.problem, self._pairs_per_particle)
        to_come = sum(pouring.to_come for pouring in self.pouring)
        self.scheme = SCHEMES[self.problem.scheme](self.problem, to_come, self._pairs_per_particle)
        fluid = self.scheme.fluid
        self.particles, self.neighbors, self.walls = fluid.particles, fluid.neighbors, fluid.walls
        self.wall_particles = fluid.wall_particles
        self.execution = Execution(self.particles.capacity, timed=self._profile)

    # ---- stepping -------------------------------------------------------------------------------------------
    @validated
    @in_session
    def step(self, until: Instant | None = None) -> StepReport:
        """Take one time step.

        Parameters
        ----------
        until : float, optional
            Time not to be passed [s].

        Returns
        -------
        StepReport
            What the step did.

        Raises
        ------
        SceneError
            If ``until`` is not later than the present time.
        DivergedError
            If the numbers mean nothing any more.
        DomainError
            If the fluid has reached an edge of the domain.
        """
        cpu = time.process_time()
        self._passed = None
        require(
            until is None or until - self.time >= 0.999 * INSTANT,
            f"until = {until} s: must be later than the present time, {self.time:.9g} s, by {INSTANT:g} s at least",
        )
        if not self._compiled:
            require_thread()
        dt, limit = self._choose_time_step(self._pour(), math.inf if until is None else until)
        report = self._advance(dt, limit == "end")
        self._time, self.steps = self.time + dt, self.steps + 1
        jet = max((pouring.speed for pouring in self.pouring if pouring.entered), default=math.inf)
        is_known = self.scheme.diagnostics.enclosed > MIN_ENCLOSED_FRACTION and report.max_speed < FREE_FALL_RATIO * jet
        worst = max(self.report.volume_error_max if self.report else 0.0, is_known * abs(report.volume_error))
        self.report = replace(report, step=self.steps, time=self.time, dt_limit=limit, volume_error_max=worst)
        self._require_sound()
        if self.all_active or report.moving_speed > 0.0:  # a step without active particles tells nothing
            self.rest.observe(report.moving_speed, self.time)
        self._rests = self.rest.reached(self)  # once a step: it notes since when, and may read particles
        self._count_seconds(cpu)
        return self.report

    def _pour(self) -> float:
        """Let in what is due; return the speed [m/s] of the fastest jet."""
        jets = [pouring.pour(self.time, self.particles, self.scheme.rigid) for pouring in self.pouring]
        if jets:
            self._volume = self.fluid_particles * self.particles.usual_volume
        return max(jets, default=0.0)

    def _limits(self, jet) -> dict[str, float]:
        """Return what bounds the next step [s], by name, beside a jet of this speed [m/s]."""
        frame, acceleration, at_rest = self.problem.frame, math.inf, 0.0
        if self.report:
            speed, acceleration = self.report.max_speed, self.report.acceleration
            at_rest = self.rest.lasting(self) if jet == 0.0 else 0.0
            if any(part.changes(self.time) for part in self.scene.in_time):
                acceleration, at_rest = math.inf, 0.0  # the values of the last step do not apply
        if not self.report or np.any(frame):
            speed = float(np.linalg.norm(self.particles.read()["u"] - frame, axis=1).max())
        speed = max(speed, self.problem.wall_speed_at(self.time), jet + float(np.linalg.norm(frame)) * (jet > 0.0))
        if self.scene.jolts_at(self.time):
            speed += self.scene.jolted(self.particles.read()["x"], self.time)
        limits = self.scheme.time_step_limits(Speeds(speed, acceleration, self.rest.fold, self.time, at_rest))
        if self._last_dt is not None:
            limits["growth"] = 2.0 * self._last_dt
        return limits

    def _choose_time_step(self, jet, until) -> tuple[float, str]:
        """Return the next step [s] and the name of the limit that set it.

        It never passes ``until`` [s], the opening of an inlet or a change of a prescribed force.
        """
        limits = self._limits(jet)
        name = min(limits, key=limits.get)
        dt = self._last_dt = limits[name]
        openings = [pouring.next for pouring in self.pouring if not pouring.entered]
        changes = [time for part in self.scene.in_time for time in part.times]
        left = min([end for end in openings + changes if end > self.time + INSTANT] + [until]) - self.time
        if left < dt * (1 + 1e-9):
            return left, "end"
        return (0.5 * left, "end") if left < 2 * dt else (dt, name)

    def _advance(self, dt, is_read) -> StepReport:
        """Take a step of the scheme.

        Where the neighbour list turns out too short, go back to the start of the step, make it longer, and take the
        step again.
        """
        start = self.state() if self.neighbors.nearly_full else None
        try:
            with self.execution.active():
                if self.steps == 0:
                    self.scheme.relax()
                self.scheme.set_forces(self.scene, self.time, dt)
                return self.scheme.step(dt, is_read)
        except EscapedError as error:
            where, speed = crossing(self.particles.read(), self.scene) or ("", math.inf)
            if speed <= self.problem.expected_speed:
                self._diverge(where, DomainError)
            self._diverge(f"{error}; {self.scheme.REMEDY}")  # no number, or faster than what fell or was thrown
        except CapacityError as error:
            fits = self.neighbors.pairs[None] <= self.neighbors.pair_capacity  # then another list is full
            if start is None or fits:  # a quarter more pairs in one step: particles that clump
                self._diverge(f"{error}; {self.scheme.REMEDY}")
            self._pairs_per_particle *= 2.0
            self._build()
            self.load(start)
            return self._advance(dt, is_read)

    def _require_sound(self):
        """Raise DivergedError where the numbers mean nothing any more."""
        if failure := self.scheme.diagnostics.failure(self.report, self.problem.runaway_speed, self._volume):
            self._diverge(f"{failure}; {self.scheme.REMEDY}")
        for law in self._own_laws:
            if failure := law.failure(self.particles):
                self._diverge(failure)

    def _diverge(self, why: str, kind=DivergedError):
        self.stopped_by = kind.stopped_by
        raise kind(f"{kind.stopped_by} at t = {self.time:.6g} s, step {self.steps}: {why}", self.report) from None

    def _count_seconds(self, cpu):
        self._compiled = True
        if self.steps == 1:
            self.execution.spent.clear()  # these times include the compilation
            self.compile_seconds = time.process_time() - self._clock[0]
        else:
            self.cpu_seconds += time.process_time() - cpu
        self.wall_seconds = time.perf_counter() - self._clock[1]

    @property
    def time(self) -> float:
        """Time [s]: end of the last step, or the time limit at which ``run`` stopped, which lies in that step."""
        return self._time if self._passed is None else self._passed

    @property
    @in_session
    def fluid_particles(self) -> int:
        """Number of fluid particles that are there now."""
        return self.particles.number - self.wall_particles

    @property
    @in_session
    def grains(self) -> GrainState:
        """Grains at the end of the last step, a part of a step after ``time``; SceneError without grains."""
        require(self.scene.grains, f"grains: scene {self.scene.name} has none; must be a Scene with grains")
        return GrainState.of(self.scheme.rigid)

    @property
    def all_active(self) -> bool:
        """Whether all particles took part in the last step (I30)."""
        return self.scheme.all_active

    def profile(self) -> list[tuple[str, float, int]]:
        """Return the time that each stage took since the first step, of a Simulation made with ``profile=True``.

        Returns
        -------
        list of tuple
            Name, wall-clock time [s] and calls of each stage, of a solve its iterations.
        """
        return [(name, seconds, calls) for name, (seconds, calls) in self.execution.spent.items()]

    # ---- running --------------------------------------------------------------------------------------------
    @validated
    def every(self, interval: Duration, callback: Callable) -> None:
        """Call a function of a frame at regular times: at 0 s, at the multiples of an interval, and at the end.

        Steps don't end for it: between the ends of two steps the frame is interpolated. A step that is longer than the
        interval gives one frame, at the last multiple in it.

        Parameters
        ----------
        interval : float
            Time between frames [s].
        callback : callable
            Function of a ``Frame``: time, snapshot(), measures() and report.

        Raises
        ------
        SceneError
            If the interval is not positive.
        """
        self._schedules.append([interval, callback, -1])

    @validated
    def each_step(self, callback: Callable) -> None:
        """Call a function after every step.

        Parameters
        ----------
        callback : callable
            Function of this Simulation.
        """
        self._each_step.append(callback)

    @property
    def watched(self) -> bool:
        """Whether any callback is registered; else nothing is measured."""
        return bool(self._schedules or self._each_step)

    def interrupt(self) -> None:
        """Ask ``run`` to stop after the step in progress."""
        self._interrupted = True

    @validated
    def run(self, until: Instant | None = None) -> str:
        """Step until a time or rest.

        Steps don't end for the time limit: the run stops after the step that passes it. Time, snapshot, measures and
        facts are then those at the limit, interpolated; ``state``, a checkpoint and the next ``run`` go on from the
        step before, as if there had been no limit.

        Parameters
        ----------
        until : float, optional
            Time limit [s], the scene's by default.

        Returns
        -------
        str
            What stopped it: 'time', 'rest', 'unyielded' or 'interrupted'.

        Raises
        ------
        DivergedError
            If the numbers mean nothing any more.
        DomainError
            If the fluid has reached an edge of the domain.
        UnmeasuredError
            If the slump is no number at the end.

        Warns
        -----
        UserWarning
            If the volume was not kept.
        """
        until = float(self.scene.until if until is None else until)
        self.stopped_by = "time" if self.time >= until - INSTANT else None
        if self._passed is not None and self.stopped_by is None:
            self.load(self._before)
        self._output()
        while self.stopped_by is None:
            # the step may pass the limit, or be followed by others up to it that leave particles out
            if self.all_active and (
                self.time + 2.0 * (self._last_dt or math.inf) >= until or self.scheme.may_leave_out
            ):
                self._before = self.state()
            self.step()
            if self.time > until + INSTANT and self.all_active:
                self._passed = until
            self._output()
            for callback in self._each_step:
                callback(self)
            self.stopped_by = self._why_stop(until)
        self._output(last=True)
        self._interrupted = False
        judge(self)
        return self.stopped_by

    def _output(self, last=False):
        """Call the schedules with what is due since the state before.

        After a step that excluded particles, output is deferred to the next full step.
        """
        if not self._schedules or not (self.all_active or last):
            return
        now = Frame(self.scene, self.snapshot(), self.report)
        for schedule in self._schedules:
            interval, callback, done = schedule
            number = math.floor(self.time / interval + 1e-6)
            on_time = abs(self.time - number * interval) < INSTANT
            schedule[2] = max(number, done)
            if number > done and (done >= 0 or on_time):
                callback(now if on_time else frame_between(self._last_frame, now, number * interval))
            if last and not on_time:
                callback(now)
        self._last_frame = now if self._passed is None else self._last_frame

    def _why_stop(self, until) -> str | None:
        unyielded, at_rest = self.numerics.unyielded_stop, self.scene.stop_at_rest
        reasons = {
            "interrupted": self._interrupted,
            "time": self.time >= until - INSTANT and self.all_active,
            "unyielded": at_rest
            and unyielded
            and self.time > max(0.05, self.scene.last_change)
            and self.report.unyielded_fraction >= unyielded,
            "rest": at_rest
            and unyielded is None
            and self._rests
            and all(pouring.done for pouring in self.pouring)
            and self.all_active,
        }
        return next((reason for reason, holds in reasons.items() if holds), None)

    # ---- reading --------------------------------------------------------------------------------------------
    @in_session
    def snapshot(self) -> Snapshot:
        """Return the computed fluid now, ordered by particle number.

        Returns
        -------
        Snapshot
            Computed part; ``scene.unfold`` completes it to the whole body.
        """
        now = snapshot(self)
        if self._passed is not None:
            before, now = of_state(self._before, now.spacing), replace(now, time=self._time)
            now = frame_between(Frame(self.scene, before), Frame(self.scene, now), self._passed).state
        return now

    def measures(self) -> dict[str, float]:
        """Return what the scene measures of the whole body now.

        Returns
        -------
        dict of str to float
            Results such as ``slump_m`` and ``spread_m``, and loads on the walls if asked for.
        """
        if not (self.scene.measure or self.problem.wall_loads):
            return {}
        last = self._last_frame  # that of this step, if ``every`` has asked for it
        known = last and last.report is self.report
        return (last if known else Frame(self.scene, self.snapshot(), self.report)).measures()

    @in_session
    def facts(self) -> dict:
        """Return everything that describes the run.

        Returns
        -------
        dict
            Content of summary.json, JSON-ready, but for the version and the errors to be expected.
        """
        return facts_of(self)

    @in_session
    def state(self) -> dict:
        """Return all that is needed to continue bit for bit.

        Returns
        -------
        dict
            Arrays by row, and scalars; after a time limit of ``run`` those before the step that passed it.
        """
        if self._passed is not None:
            return self._before
        return {
            **self.particles.read(),
            **self.neighbors.state(),
            "time": self.time,
            "steps": self.steps,
            "last_dt": self._last_dt,
            "rest": asdict(self.rest),
            "report": asdict(self.report) if self.report else None,
            **({"pouring": [[pouring.entered, pouring.delay] for pouring in self.pouring]} if self.pouring else {}),
            **self.scheme.state(),
        }

    @validated
    @in_session
    def restart(self, problem: InstanceOf[Problem], state: dict) -> None:
        """Begin another problem from a state, without compiling anew.

        Parameters
        ----------
        problem : Problem
            Problem that differs in the numbers of its materials only.
        state : dict
            What ``state`` returned.

        Notes
        -----
        Callbacks are forgotten.
        """
        self._begin(problem)
        self.scheme.set_problem(problem)
        self.load(state)

    @validated
    @in_session
    def load(self, state: dict) -> None:
        """Continue from a state.

        Parameters
        ----------
        state : dict
            What ``state`` returned.
        """
        missing = {*self.particles.carried, "time", "steps", "last_dt", "report", "rest"} - set(state)
        require(not missing, f"state = {quote(state, '')}: has no {', '.join(sorted(missing))}; must come from state()")
        carried = {name: state[name] for name in self.particles.carried}
        count, room = len(carried["x"]), self.particles.capacity
        require(count <= room, f"state: has {count} particles; must be of this scene, at most {room}")
        self.particles.load(carried)
        self._passed = None
        self._time, self.steps, self._last_dt = state["time"], state["steps"], state["last_dt"]
        self.report = StepReport(**state["report"]) if state["report"] else None
        self.rest = Rest(**state["rest"])
        for pouring, carried in zip(self.pouring, state.get("pouring", []), strict=True):
            pouring.entered, pouring.delay = carried
        self.walls.place(self.time)
        self.neighbors.forget()
        if "listed_at" in state:  # the same pairs in the same order, or sums would be rounded otherwise
            self.particles.load({**carried, "x": state["listed_at"]})
            with self.execution.active():
                self.neighbors.search()
            self.particles.load(carried)
        self.scheme.load(state)
