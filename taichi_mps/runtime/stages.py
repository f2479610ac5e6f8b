"""Stages of a time step: each a kernel of its own, or parts of one kernel where starting kernels costs more.

To start a kernel takes 5 microseconds (backend.py), each loop in it that is spread over threads another 5 to 9, or 15
to 70 where they must be woken, to read a number from Python 7: more than the arithmetic of a few hundred particles. So
a step is written once, as calls of its stages. In Python they are kernels, one after the other; in a kernel parts.
"""

import functools
import time
from types import SimpleNamespace

from .backend import started, ti

ALONE_BELOW = 3000
"""Rows up to which one thread works alone: to start kernels and threads would cost more than the work."""


def alone() -> bool:
    """Whether Taichi has one thread of the processor."""
    return started()["arch"] == "cpu" and started()["threads"] == 1


def few(rows: int) -> bool:
    """Whether so many rows are work for one thread of the processor, whatever the number of threads."""
    return started()["arch"] == "cpu" and rows < ALONE_BELOW


def stage(function):
    """A method of a @ti.data_oriented class: a kernel where Python calls it, part of any kernel that calls it."""
    function.__annotations__["self"] = ti.template()
    kernel, part = ti.kernel(function), ti.func(function)

    @functools.wraps(function)
    def call(*arguments):
        return (part if ti.lang.impl.inside_kernel() else kernel)(*arguments)

    call._is_taichi_function, call.func = True, part.func  # what Taichi asks of a function that a kernel calls
    return call


class Stages:
    """Calls the stages of a step by name, and times them if it was made with ``timed``."""

    _is_taichi_function, func = True, SimpleNamespace(has_print=False)  # a kernel may call it

    def __init__(self, timed: bool = False):
        self.timed = timed
        self.spent: dict[str, list] = {}  # wall seconds and calls of each stage

    def __call__(self, name: str, call, *arguments):
        """call(*arguments); what returns a number of iterations counts as so many calls."""
        if not self.timed or ti.lang.impl.inside_kernel():
            return call(*arguments)
        begin = time.perf_counter()
        result = call(*arguments)
        ti.sync()
        entry = self.spent.setdefault(name, [0.0, 0])
        entry[0] += time.perf_counter() - begin
        entry[1] += result if isinstance(result, int) else 1
        return result
