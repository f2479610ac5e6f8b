"""Kernel language for all other rooms, its start by ``init``, and helpers to make fields."""

import functools
import os
import threading
import weakref
from contextlib import redirect_stdout
from dataclasses import dataclass
from io import StringIO
from typing import Literal

import numpy as np

from ...units import Arch, Count, Flag, SceneError, T, require, validated
from .caches import kernels
from .memory import ShortOfMemoryError, left_by_process_limits, size
from .workarounds import LANGUAGE, OPTIONS, compiled_now, for_kernels, in_own_memory, is_for_kernels, sine_by_f32, ti

__all__ = [
    "compiled_before",
    "compiled_now",
    "constant_fields",
    "double_field",
    "for_kernels",
    "in_session",
    "init",
    "is_for_kernels",
    "real",
    "require_room",
    "require_thread",
    "session",
    "sine",
    "started",
    "ti",
]

ADDRESS_SPACE = 1.5e9  # bytes that init needs: 2^30 for the memory pool of Taichi, the rest measured with short runs
ADDRESS_SPACE_PER_THREAD = 1e8  # further bytes for each thread: its stack, and the arena of the C library
MAX_TREES, TREES_OF_A_SIMULATION = 512, 32  # measured 5 to 6 a Simulation, and 3 more for a solid with concave edges
FORKED = (
    "Taichi was started before this process was forked, and does not survive that; start processes by "
    "multiprocessing.get_context('spawn') and call taichi_mps.init() in each"
)
_one_at_a_time = threading.RLock()


@dataclass(frozen=True, eq=False)
class Session:
    """Record of one call of ``init`` in this process, replaced by the next call."""

    settings: dict  # arch, precision, threads
    process: int
    thread: int  # thread that called init, the only one in which Taichi makes fields
    runtime: weakref.ref  # state of Taichi, which another ti.init replaces


_session: Session | None = None


@validated
def init(
    arch: Arch = "cpu",
    precision: Literal["f32", "f64"] = "f32",
    threads: Count | None = None,
    debug: Flag = False,
) -> None:
    """Start Taichi; call it once before a ``Simulation``.

    Parameters
    ----------
    arch : {'cpu', 'cuda', 'vulkan'}, optional
        Where to compute.
    precision : {'f32', 'f64'}, optional
        Floating-point type of the solver's fields; positions are always f64.
    threads : int, optional
        CPU threads, by default all that this process may use.
    debug : bool, optional
        Whether Taichi checks bounds of its fields, which is slow.

    Raises
    ------
    SceneError
        For another value, or a device that is not found here.
    RuntimeError
        In a process that was forked after Taichi had been started.

    Notes
    -----
    Calling it again drops every earlier Simulation, which says so when used. A process may hold several Simulations.
    They are made, and take their first step, in the thread that called ``init``; then any thread may step and read
    them, one at a time. Taichi does not survive a fork: start processes by ``multiprocessing.get_context("spawn")``.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> mps.init(arch="abacus")
    Traceback (most recent call last):
        ...
    taichi_mps.units.SceneError: arch = abacus: must be 'cpu', 'cuda' or 'vulkan'
    """
    architectures = {"cpu": ti.cpu, "cuda": ti.cuda, "vulkan": ti.vulkan}
    global _session
    if _session and _session.process != os.getpid():
        raise RuntimeError(FORKED)
    require(
        (arch, precision) != ("vulkan", "f64"),
        "precision = f64: must be f32 on arch = vulkan, which has no sine or power of f64",
    )
    if threads is None:
        threads = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    needed = ADDRESS_SPACE + threads * ADDRESS_SPACE_PER_THREAD
    left = min(left_by_process_limits(), default=needed)
    if left < needed and not _session:  # a second init uses the pool of the first
        raise ShortOfMemoryError(
            "memory: Taichi takes 1.07 GB of address space at once when it starts, and a run more; the limit of this "
            f"process (ulimit -v, -d) leaves {size(max(0, left))}; must be at least {size(needed)}"
        )
    with redirect_stdout(StringIO()):  # its greeting would spoil --json
        ti.init(
            arch=architectures[arch],
            default_fp=ti.f64 if precision == "f64" else ti.f32,
            default_ip=ti.i32,
            fast_math=True,
            debug=debug,
            log_level=ti.ERROR,
            cpu_max_num_threads=threads,
            **OPTIONS,
        )
    if ti.lang.impl.current_cfg().arch != architectures[arch]:  # Taichi silently falls back to the processor
        _session = None
        raise SceneError(f"arch = {arch}: no such device is found here; must be one that this machine has, such as cpu")
    _session = Session(
        {"arch": arch, "precision": precision, "threads": threads},
        os.getpid(),
        threading.get_ident(),
        weakref.ref(ti.lang.impl.get_runtime()),
    )


def compiled_before() -> bool:
    """Return whether any kernel was compiled on this machine.

    Returns
    -------
    bool
        Whether the cache holds one.
    """
    return any(kernels(LANGUAGE).glob("*/*"))


def session() -> Session:
    """Return the record of the last ``init``.

    Returns
    -------
    Session
        Settings, process and thread.

    Raises
    ------
    RuntimeError
        If ``init`` was not called, or ``ti.init`` after it, or in a forked process.
    """
    if _session is None:
        raise RuntimeError("Taichi is not started: call taichi_mps.init() before making a Simulation")
    if _session.process != os.getpid():
        raise RuntimeError(FORKED)
    if _session.runtime() is not ti.lang.impl.get_runtime():
        raise RuntimeError(
            "Taichi was started anew by ti.init or ti.reset: call taichi_mps.init() in the place of these"
        )
    return _session


def started() -> dict:
    """Return the settings of the running backend.

    Returns
    -------
    dict
        arch, precision and threads.
    """
    return dict(session().settings)


def in_session(method: T) -> T:
    """Guard a method of an object with a ``session``: refuse an outdated session, and admit one thread at a time.

    Parameters
    ----------
    method : callable
        Method.

    Returns
    -------
    callable
        Guarded method.
    """

    @functools.wraps(method)
    def guarded(self, *arguments, **keywords):
        if session() is not self.session:
            raise RuntimeError(
                f"this {type(self).__name__} is gone: taichi_mps.init() was called after it was made; make it anew"
            )
        with _one_at_a_time:
            return method(self, *arguments, **keywords)

    return guarded


def require_thread() -> None:
    """Refuse new fields in a thread that did not call ``init``.

    Raises
    ------
    RuntimeError
        In another thread.
    """
    if session().thread != threading.get_ident():
        raise RuntimeError(
            "Taichi was started in another thread: a Simulation is made, and takes its first step, in that which "
            "called init()"
        )


def require_room() -> None:
    """Refuse new fields when Taichi can hold no more of them: the 513th tree of fields kills the process.

    Raises
    ------
    RuntimeError
        When this process holds nearly as many, or in a thread that did not call ``init``.
    """
    require_thread()
    used = ti.lang.impl.get_runtime().prog.get_snode_tree_size()
    if used > MAX_TREES - TREES_OF_A_SIMULATION:
        raise RuntimeError(
            f"this process holds {used} groups of Taichi fields of at most {MAX_TREES}, a Simulation needs up to "
            f"{TREES_OF_A_SIMULATION}: call taichi_mps.init() again, which drops every earlier Simulation"
        )


def double_field(shape=(), components=None):
    """Return a field of f64, or of vectors of them.

    Parameters
    ----------
    shape : tuple of int or int, optional
        Shape.
    components : int, optional
        Components of a vector; scalars by default.

    Returns
    -------
    ti.Field
        Field.
    """
    make = ti.field if components is None else functools.partial(ti.Vector.field, components)
    return in_own_memory(make(ti.f64), shape) if started()["arch"] == "vulkan" else make(ti.f64, shape)


def constant_fields(*tables, vectors: bool = False) -> list:
    """Return fields that hold these arrays.

    Parameters
    ----------
    *tables : ndarray
        Arrays; of int8 they stay so, of other integers they become i32, of real numbers the solver's type.
    vectors : bool, optional
        Whether the last axis is that of the components of vectors.

    Returns
    -------
    list of ti.Field
        Fields.
    """
    fields = []
    for table in tables:
        kind = ti.i8 if table.dtype == np.int8 else ti.i32 if table.dtype.kind == "i" else real()
        shape = table.shape
        fields.append(ti.Vector.field(shape[-1], kind, shape[:-1]) if vectors else ti.field(kind, shape))
    for field, table in zip(fields, tables, strict=True):
        field.from_numpy(np.ascontiguousarray(table, ti.lang.util.to_numpy_type(field.dtype)))
    return fields


def real():
    """Return the floating-point type of the solver's fields.

    Returns
    -------
    type
        ti.f32 or ti.f64.
    """
    return ti.f64 if started()["precision"] == "f64" else ti.f32


@ti.func
def sine(angle):
    """Return the sine of an angle in f64.

    Parameters
    ----------
    angle : float
        Angle [rad].

    Returns
    -------
    float
        Sine [-].
    """
    return sine_by_f32(angle) if ti.static(started()["arch"] == "vulkan") else ti.sin(angle)
