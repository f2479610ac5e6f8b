"""Stages of a time step, written once; how they are launched is decided here, and nobody else knows it.

To start a kernel takes some 30 microseconds, each loop in it that is spread over
threads another 5 to 9, or 15 to 70 where they must be woken, to read a number from Python 7: more than the arithmetic
of a few hundred particles. So an ``Execution`` keeps the stages that are called and launches them together, where
Python has to look at a result:

    fused      few rows: what stands between two looks becomes one kernel of one thread, solves and all; below
               OPTIMISED rows to compile it takes longer than a run, so it is optimised less
    grouped    many rows: kernels that follow each other become one, whose loops Taichi spreads over the threads; a
               ``@team_stage`` is gone through by a team of threads (thread_team.py), on a GPU stage by stage
    timed      each stage by itself

A method becomes a stage by a decorator:

    @stage("gradient")        kernel code: a kernel, or a part of the one that calls it
    @sequence("solve")        calls of stages, with loops and choices, in words that Python and a kernel both understand
    @team_stage("solve")      the same for a team: loops from first(n) to last(n), rounds that end with regroup()
"""

import functools
import inspect
import time
from contextlib import contextmanager

from .backend import for_kernels, real, started, ti
from .thread_team import ThreadTeam, enter, leave
from .workarounds import compiled_plainly

OPTIMISED = 1000
"""Rows from which on a fused kernel is optimised: 6 s more to compile, once, for an eighth less of each run."""
FEW = 3000
"""Rows below which one thread works alone: to start kernels and threads would cost more than the work."""

MOST_NUMBERS = 8  # that the stages of one kernel may be given in all
TURN = object()  # the number of the present turn of ``repeat``


def one_thread() -> bool:
    """Whether Taichi has one thread of the processor."""
    return started()["arch"] == "cpu" and started()["threads"] == 1


def few(rows: int) -> bool:
    """Whether so many rows are work for one thread of the processor, whatever the number of threads."""
    return started()["arch"] == "cpu" and rows < FEW


# ---- what is launched -----------------------------------------------------------------------------------------------
@for_kernels
class Call:
    """A stage with its objects, as a part of a kernel whose arguments are its numbers."""

    def __init__(self, stage, arguments, slots):
        self.stage, self.arguments, self.slots = stage, arguments, slots  # of each number its slot, else None

    def __call__(self, turn, *numbers):
        bound = []
        for argument, slot, kind in zip(self.arguments, self.slots, self.stage.kinds(self.arguments), strict=True):
            value = turn if argument is TURN else argument if slot is None else numbers[slot]
            bound.append(value if kind is None else ti.cast(value, real() if kind is float else kind))
        return self.stage.part(*bound)


def fused(calls):
    """A kernel of one thread: calls one after the other, some times."""

    @ti.kernel
    def run(times: ti.i32, a: ti.f64, b: ti.f64, c: ti.f64, d: ti.f64, e: ti.f64, f: ti.f64, g: ti.f64, h: ti.f64):
        ti.loop_config(serialize=True)
        for turn in range(times):
            for call in ti.static(calls):
                call(turn, a, b, c, d, e, f, g, h)

    return run


def grouped(calls):
    """A kernel of all threads: calls one after the other."""

    @ti.kernel
    def run(turn: ti.i32, a: ti.f64, b: ti.f64, c: ti.f64, d: ti.f64, e: ti.f64, f: ti.f64, g: ti.f64, h: ti.f64):
        for call in ti.static(calls):
            call(turn, a, b, c, d, e, f, g, h)

    return run


def by_team(team, call):
    """A kernel in which a team of threads goes through a call, for so many rows."""

    @ti.kernel
    def run(rows: ti.i32, a: ti.f64, b: ti.f64, c: ti.f64, d: ti.f64, e: ti.f64, f: ti.f64, g: ti.f64, h: ti.f64):
        team.open(rows)
        for turn in range(team.turns):
            member = team.join(turn)
            if member >= 0:
                enter(team, member)
                call(0, a, b, c, d, e, f, g, h)
                leave()
                team.close()

    return run


class Execution:
    """How the stages of a simulation of so many rows are launched, and, with ``timed``, how long each takes."""

    def __init__(self, rows: int, timed: bool = False, team: ThreadTeam | None = None):
        self.rows, self.timed, self._team = rows, timed, team
        self.fuses = few(rows)
        self.spent: dict[str, list] = {}  # wall seconds and calls of each stage; of a solve its iterations
        self._kernels: dict = {}  # by the keys of their calls
        self._waiting: list[tuple] = []  # stages and arguments of the kernel that comes next
        self._timing = False

    @contextmanager
    def active(self):
        """Stages that are called meanwhile are launched by this Execution."""
        global _current
        before, _current = _current, self
        try:
            yield self
            self.flush()
        finally:
            self._waiting = []
            _current = before

    def launch(self, stage, arguments):
        """Launch a stage, or keep it for the kernel that is launched next."""
        if self.timed and not self._timing:
            return self._timed_launch(stage, arguments)
        if not self.timed and (self.fuses or isinstance(stage, Kernel)):
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
        entry[1] += result if isinstance(result, int) else 1
        return result

    def flush(self, times: int = 1):
        """Launch what waits, some times; in several kernels where one would be given too many numbers."""
        calls, self._waiting = self._waiting, []
        while calls:
            with compiled_plainly(self.fuses and self.rows < OPTIMISED):
                calls = self._start(fused if self.fuses else grouped, calls, times)

    def go_through(self, stage, arguments):
        """A stage by all threads in a team; on a GPU, or where it is not to be compiled as a whole, part by part."""
        if started()["arch"] != "cpu" or not arguments[0].fits_in_a_kernel:
            stage.function(*arguments)
            return
        alone = self._team is None and (one_thread() or few(self.rows))
        if self._team is None and not alone:
            self._team = ThreadTeam(started()["threads"])
        self.flush()
        make = fused if alone else lambda calls: by_team(self._team, calls[0])
        self._start(make, [(stage, arguments)], 1 if alone else self.rows)

    def _start(self, make, calls, whole: int) -> list:
        """Launch a kernel of as many calls as it can be given the numbers of, made once for the same stages and
        objects; and the calls that are left. A number that several stages are given, the time step above all, is handed
        over once."""
        key, numbers, made = (), [], []
        for stage, arguments in calls:
            known, slots = list(numbers), []
            for argument, kind in zip(arguments, stage.kinds(arguments), strict=True):
                slot = None
                if kind is not None and argument is not TURN:
                    same = (k for k, number in enumerate(known) if number is argument and type(number) is float)
                    slot = next(same, len(known))
                    known += [argument] * (slot == len(known))
                slots.append(slot)
            if len(known) > MOST_NUMBERS:
                break
            objects = [id(argument) if slot is None else slot for argument, slot in zip(arguments, slots, strict=True)]
            key, numbers = (*key, id(stage), *objects), known
            made.append(Call(stage, arguments, slots))
        left = calls[len(made) :]
        if not made or (left and make is fused and whole > 1):
            raise ValueError(f"stage {left[0][0].name}: more than {MOST_NUMBERS} numbers for one kernel")
        if key not in self._kernels:
            self._kernels[key] = make(made)
        self._kernels[key](whole, *map(float, numbers), *[0.0] * (MOST_NUMBERS - len(numbers)))
        return left


_current: Execution | None = None


def flush() -> None:
    """Before Python looks at a field: launch what waits. Nothing inside a kernel."""
    if _current and not ti.lang.impl.inside_kernel():
        _current.flush()


for_kernels(flush)


def repeat(times: int):
    """``for k in repeat(times)`` over stages: a loop in Python, or the kernel that they make gone through so often."""
    if _current and _current.fuses and not _current.timed:
        _current.flush()
        yield TURN
        _current.flush(times)
    else:
        for turn in range(times):
            flush()
            yield turn
        flush()


def nothing(*_) -> None:
    """No-op: a stage that a scene has no need of."""


class NoOp:
    """No-op: a term that a scene has no need of. The ``stages`` that a step calls do nothing; ``members`` is what else
    is read of it."""

    def __init__(self, *stages: str, **members):
        vars(self).update(dict.fromkeys(stages, nothing) | members)


# ---- decorators -----------------------------------------------------------------------------------------------------
class Kernel:
    """A stage of kernel code."""

    def __init__(self, name, function):
        self.name = name
        function.__annotations__["self"] = ti.template()
        self.kernel, self.part = ti.kernel(function), ti.func(function)
        kinds = [parameter.annotation for parameter in inspect.signature(function).parameters.values()]
        self._kinds = [None if isinstance(kind, ti.template) else kind for kind in kinds]

    def kinds(self, _arguments):
        """Of each argument: None for an object, else the type of a number."""
        return self._kinds

    def launch(self, _execution, arguments):
        return self.kernel(*arguments)


class Sequence:
    """A stage made of calls of stages."""

    def __init__(self, name, function):
        self.name, self.function, self.part = name, function, ti.func(function)

    def kinds(self, arguments):
        """Of each argument: None for an object, else the type of a number."""
        found = []
        for argument in arguments:
            whole = argument is TURN or isinstance(argument, int)
            found.append(ti.i32 if whole else ti.f64 if isinstance(argument, float) else None)
        return found

    def launch(self, _execution, arguments):
        return self.function(*arguments)


class TeamStage(Sequence):
    """A sequence that a team can go through."""

    def launch(self, execution, arguments):
        return execution.go_through(self, arguments) if execution else self.function(*arguments)


def _decorator(kind):
    """Makes a method one that is launched where Python calls it, and a part of any kernel that calls it."""

    def named(name: str):
        def decorate(function):
            stage = kind(name, function)

            @functools.wraps(function)
            def call(*arguments):
                if ti.lang.impl.inside_kernel():
                    return stage.part(*arguments)
                return _current.launch(stage, arguments) if _current else stage.launch(None, arguments)

            return for_kernels(call, stage.part)

        return decorate

    return named


stage, sequence, team_stage = (_decorator(kind) for kind in (Kernel, Sequence, TeamStage))
