"""Stages of a time step, written once; only this module decides how they are launched.

To start a kernel takes some 30 microseconds, each loop in it that is spread over threads another 5 to 9, or 15 to 70
where they must be woken, to read a number from Python 7: more than the arithmetic of a few hundred particles. So an
``Execution`` queues the stages that are called and launches them together, before Python reads a result:

    fused      few rows: all stages between two readings become one kernel of one thread, solves included; one of few
               stages is optimised more from OPTIMISED_FROM_ROWS rows on
    grouped    many rows: kernels that follow each other become one, whose loops Taichi spreads over the threads; a
               ``@team_stage`` is optimised more and executed by a team of threads (thread_team.py), on a GPU stage by
               stage
    timed      each stage by itself

On a GPU each loop is started by itself, and before it one thread is, to read how long it is. A ``@loop_stage`` spares
that: its loop is divided among as many threads as there are rows. A ``@block_stage`` is started once, with all its
loops. On Quadrants a kernel is a graph, started at once, and a loop while ``unfinished(left)`` is a part of it.

A method becomes a stage by a decorator:

    @stage("gradient")        kernel code: a kernel, or a part of the kernel that calls it
    @sequence("solve")        calls of stages, with loops and branches, in syntax valid both in Python and in a kernel
    @team_stage("solve")      a sequence for a team: loops from first(n) to last(n), rounds that end with barrier()
    @loop_stage("sweep")      a stage that is one loop from first(n) to last(n)
    @block_stage("cycle")     a sequence of small loops from first(n) to last(n), for one block of threads of a GPU

Its numbers are annotated with their types; arguments without annotation are objects.
"""

import functools
import inspect
import time
from contextlib import contextmanager

from .backend import for_kernels, real, started, ti
from .thread_team import Block, GPUThreads, ThreadTeam, enter
from .workarounds import HAS_DEVICE_LOOPS, graph_kernel, optimised

OPTIMISED_FROM_ROWS, OPTIMISED_STAGES = 1000, 12
"""Number of rows from which on a fused kernel of at most so many stages is compiled at an opt_level of 1: it spares 4 %
of a step and costs no time to speak of; with the larger kernels it were 5 %, for half as long again to compile."""
ONE_THREAD_BELOW_ROWS = 3000
"""Number of rows below which one thread works alone: starting kernels and threads would cost more than the work."""

MAX_NUMBERS = 8  # numbers that the stages of one kernel may take in all
ITERATION = object()  # stands for the number of the present iteration of ``repeat``


def one_thread(rows: int) -> bool:
    """Whether one thread of the processor works alone: because of few rows, or because there is only one."""
    return started()["arch"] == "cpu" and (started()["threads"] == 1 or rows < ONE_THREAD_BELOW_ROWS)


# ---- launching ------------------------------------------------------------------------------------------------------
@for_kernels
class Call:
    """Call of a stage with its objects, as a part of a kernel whose arguments are its numbers."""

    def __init__(self, gpu_threads, stage, arguments, slots):
        self.gpu_threads = gpu_threads.get(stage.kind)  # threads of a GPU that divide its loops among them
        self.stage, self.arguments, self.slots = stage, arguments, slots  # slots: of numbers, None for objects

    def __call__(self, iteration, numbers):
        bound = []
        for argument, slot, kind in zip(self.arguments, self.slots, self.stage.kinds, strict=True):
            value = iteration if argument is ITERATION else argument if slot is None else numbers[slot]
            bound.append(value if kind is None else ti.cast(value, real() if kind is float else kind))
        return self.stage.part(*bound)


def kernel_of(calls, alone: bool, team: ThreadTeam | None):
    """Make a kernel of calls in order: executed by a team, for ``whole`` rows; ``whole`` times by one thread if
    ``alone``; else by all threads."""

    @graph_kernel
    def run(whole: ti.i32, a: ti.f64, b: ti.f64, c: ti.f64, d: ti.f64, e: ti.f64, f: ti.f64, g: ti.f64, h: ti.f64):
        numbers = ti.static((a, b, c, d, e, f, g, h))  # a vector as argument takes 0.1 ms more to launch
        if ti.static(bool(team)):
            team.open(whole)
            for iteration in range(team.iterations):
                member = team.join(iteration)
                if member >= 0:
                    enter(team, member)
                    for call in ti.static(calls):
                        call(0, numbers)
                    team.close()
        elif ti.static(alone):
            ti.loop_config(serialize=True)
            for iteration in range(whole):
                for call in ti.static(calls):
                    call(iteration, numbers)
        else:
            spread(calls, numbers)

    return run


class DeviceLoop:
    """Calls without numbers, as a stage that a GPU repeats by itself until the field ``left`` is 0, once at least."""

    kind, kinds = "device loop", ()

    def __init__(self, calls, left):
        self.calls, self.left = calls, left


def looping_kernel_of(calls):
    """Make a kernel of calls in order, device loops among them, for all threads; ``again``: whether a loop goes on."""

    @graph_kernel
    def run(
        again: ti.types.ndarray(ti.i32, ndim=0),
        a: ti.f64,
        b: ti.f64,
        c: ti.f64,
        d: ti.f64,
        e: ti.f64,
        f: ti.f64,
        g: ti.f64,
        h: ti.f64,
    ):
        numbers = ti.static((a, b, c, d, e, f, g, h))
        for call in ti.static(calls):
            if ti.static(call.stage.kind == "device loop"):
                again[None] = 1
                while ti.graph.do_while(again):
                    spread(call.stage.calls, ())
                    again[None] = call.stage.left[None]
            else:
                spread([call], numbers)

    return run


@ti.func
def spread(calls: ti.template(), numbers: ti.template()):
    """Execute calls in order; all threads divide the loops of each among them."""
    for call in ti.static(calls):
        if ti.static(bool(call.gpu_threads)):
            ti.loop_config(block_dim=call.gpu_threads.in_a_block)
            for thread in range(call.gpu_threads.size):
                enter(call.gpu_threads, thread)
                call(0, numbers)
        else:
            enter(None, 0)
            call(0, numbers)


class Execution:
    """Launcher of the stages of a simulation with a given number of rows; ``timed`` measures each stage."""

    def __init__(self, rows: int, timed: bool = False, team: ThreadTeam | None = None):
        self.rows, self.timed, self._team = rows, timed, team
        self.fuses = started()["arch"] == "cpu" and rows < ONE_THREAD_BELOW_ROWS
        gpu = {"loop": GPUThreads(rows)} if started()["arch"] != "cpu" else {}
        self._again = ti.ndarray(ti.i32, ()) if gpu and HAS_DEVICE_LOOPS else None  # whether a loop goes on
        self._gpu_threads = gpu | ({"block": Block()} if started()["arch"] == "cuda" else {})
        self.spent: dict[str, list] = {}  # wall seconds and calls of each stage, or iterations of a solve
        self._kernels: dict = {}  # by the keys of their calls, device loops as well
        self._waiting: list[tuple] = []  # stages and arguments of the next kernel
        self._before_loop: list[tuple] | None = None  # what waits before a device loop whose stages are being queued
        self._timing = False

    @contextmanager
    def active(self):
        """Context in which stages are launched by this Execution."""
        global _current
        before, _current = _current, self
        try:
            yield self
            self.flush()
        finally:
            self._waiting, self._before_loop = [], None
            _current = before

    def launch(self, stage, arguments):
        """Launch a stage, or queue it for the next kernel."""
        if self.timed and not self._timing:
            return self._timed_launch(stage, arguments)
        if not self.timed and (self.fuses or stage.kind in ("kernel", "loop", *self._gpu_threads)):
            return self._waiting.append((stage, arguments))
        return stage.launch(self, arguments)

    def _timed_launch(self, stage, arguments):
        begin, self._timing = time.perf_counter(), True
        try:
            result = stage.launch(self, arguments)
        finally:
            self._timing = False
        ti.sync()
        entry = self.spent.setdefault(stage.name, [0.0, 0])
        entry[0] += time.perf_counter() - begin
        entry[1] += result[None] if isinstance(result, ti.Field) else 1
        return result

    def flush(self, times: int = 1):
        """Launch the queued stages ``times`` times, in several kernels where one would have too many arguments."""
        if self._before_loop is not None:
            raise RuntimeError("a loop of the GPU itself: Python can read nothing in it")
        calls, self._waiting = self._waiting, []
        while calls:
            with optimised(self.fuses and self.rows >= OPTIMISED_FROM_ROWS and len(calls) <= OPTIMISED_STAGES):
                calls = self._launch_kernel(calls, times, self.fuses)

    def unfinished(self, left) -> bool:
        """Whether the stages that follow are wanted. A device loop begins at the first look, ends at the second."""
        if self._again is None or self.timed:
            self.flush()
            return left[None] > 0
        if self._before_loop is None:
            self._before_loop, self._waiting = self._waiting, []
            return True
        calls, self._waiting, self._before_loop = self._waiting, self._before_loop, None
        key = (id(left), *((id(stage), *map(identity, arguments)) for stage, arguments in calls))
        if key not in self._kernels:
            made = [Call(self._gpu_threads, *call, [None] * len(call[1])) for call in calls]
            self._kernels[key] = DeviceLoop(made, left)
        self._waiting.append((self._kernels[key], ()))
        return False

    def launch_team(self, stage, arguments):
        """Launch a stage for a team of all threads; on a GPU part by part."""
        if started()["arch"] != "cpu":
            stage.function(*arguments)
            return
        alone = self._team is None and one_thread(self.rows)
        if self._team is None and not alone:
            self._team = ThreadTeam(started()["threads"])
        self.flush()
        with optimised(True):
            self._launch_kernel([(stage, arguments)], 1 if alone else self.rows, alone, self._team)

    def _launch_kernel(self, calls, whole: int, alone: bool, team: ThreadTeam | None = None) -> list:
        """Launch a kernel of as many calls as its numbers allow and return the remaining calls. A kernel is compiled
        once for the same stages and objects. A number of several stages, such as the time step, is passed once."""
        key, numbers, made = (), [], []
        for stage, arguments in calls:
            known, slots = list(numbers), []
            for argument, kind in zip(arguments, stage.kinds, strict=True):
                slot = None
                constant = stage.kind == "loop" and type(argument) is int  # such as that of a grid
                if kind is not None and argument is not ITERATION and not constant:
                    same = (k for k, number in enumerate(known) if number is argument and type(number) is float)
                    slot = next(same, len(known))
                    known += [argument] if slot == len(known) else []
                slots.append(slot)
            if len(known) > MAX_NUMBERS:
                break
            objects = [
                slot if slot is not None else identity(argument)
                for argument, slot in zip(arguments, slots, strict=True)
            ]
            key, numbers = (*key, id(stage), *objects), known
            made.append((stage, arguments, slots))
        left = calls[len(made) :]
        if not made or (left and alone and whole > 1):
            raise ValueError(f"stage {left[0][0].name}: more than {MAX_NUMBERS} numbers for one kernel")
        loops = any(stage.kind == "device loop" for stage, *_ in made)
        if key not in self._kernels:
            parts = [Call(self._gpu_threads, *call) for call in made]
            self._kernels[key] = looping_kernel_of(parts) if loops else kernel_of(parts, alone, team)
        first = self._again if loops else whole
        self._kernels[key](first, *map(float, numbers), *[0.0] * (MAX_NUMBERS - len(numbers)))
        return left


def identity(argument):
    """Key of an argument that is compiled into a kernel: the text of a number, the id of another object."""
    return repr(argument) if type(argument) in (int, float) else id(argument)


_current: Execution | None = None


@for_kernels
def flush() -> None:
    """Launch the queued stages before Python reads a field; no effect inside a kernel."""
    if _current and not ti.lang.impl.inside_kernel():
        _current.flush()


@ti.func
def _is_positive(number: ti.template()):
    return number[None] > 0


@for_kernels
def unfinished(left):
    """Whether the stages that follow are wanted, as ``while unfinished(left)``: while the 0-D field ``left``, which
    they count down, is positive. A GPU that can repeats them until then without asking Python, and executes them once
    where it is 0 at the start: they must change nothing then."""
    if ti.lang.impl.inside_kernel():
        return _is_positive(left)
    return _current.unfinished(left) if _current else left[None] > 0


def repeat(times: int):
    """Repeat stages, as ``for k in repeat(times)``, by a loop in Python or in the kernel of these stages."""
    if _current and _current.fuses and not _current.timed:
        _current.flush()
        yield ITERATION
        _current.flush(times)
    else:
        for iteration in range(times):
            flush()
            yield iteration
        flush()


def no_op(*_) -> None:
    """No-op: a stage that the scene does not need."""


class NoOp:
    """No-op: a term that the scene does not need. Its ``stages`` do nothing; ``members`` are its other attributes."""

    def __init__(self, *stages: str, **members):
        vars(self).update(dict.fromkeys(stages, no_op) | members)


# ---- decorators -----------------------------------------------------------------------------------------------------
class Stage:
    """A method that is a kernel, or a sequence of calls of stages, which a team or a block may execute."""

    def __init__(self, kind, name, function):
        self.kind, self.name = kind, name
        function.__annotations__["self"] = ti.template()
        types = [parameter.annotation for parameter in inspect.signature(function).parameters.values()]
        # for each argument None for an object, else the type of a number
        self.kinds = [
            None if kind is inspect.Parameter.empty or isinstance(kind, ti.template) else kind for kind in types
        ]
        self.part, self.function = ti.func(function), ti.kernel(function) if kind in ("kernel", "loop") else function

    def launch(self, execution, arguments):
        if execution and self.kind == "team":
            return execution.launch_team(self, arguments)
        return self.function(*arguments)


def _decorator(kind, name: str):
    """Make a decorator of methods that are launched if called from Python, and compiled into a kernel that calls
    them."""

    def decorate(function):
        stage = Stage(kind, name, function)

        @functools.wraps(function)
        def call(*arguments):
            if ti.lang.impl.inside_kernel():
                return stage.part(*arguments)
            return _current.launch(stage, arguments) if _current else stage.launch(None, arguments)

        return for_kernels(call, stage.part)

    return decorate


stage, sequence, team_stage, loop_stage, block_stage = (
    functools.partial(_decorator, kind) for kind in ("kernel", "sequence", "team", "loop", "block")
)
