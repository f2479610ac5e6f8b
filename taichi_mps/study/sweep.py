"""Sweep: a scene at every combination of some values, in parallel; failures are rows too, and a sweep is resumed."""

import math
import multiprocessing
import os
import re
import signal
import threading
import warnings
from collections import deque
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, ProcessPoolExecutor, wait
from contextlib import contextmanager, nullcontext, suppress
from itertools import product
from pathlib import Path
from time import monotonic
from typing import Any

import numpy as np
from pydantic import InstanceOf

from ..engine import Concrete, Problem
from ..forecast.accuracy import choose
from ..input import catalogue
from ..input.catalogue import SceneName
from ..units import Count, Place, SceneError, Text, in_unit, require, require_package, validated
from .case import LOST, Case, case_of, row_without_result, run_case
from .tables import open_results

ACCURACY = 0.005  # of the slump [m], which chooses model and spacing where the scene can and none is given
CHOOSES = {"accuracy", "model", "spacing", "lift_speed"}  # keywords of which one that is given says what is computed
MAX_CASES = 100_000  # of a study
SAMPLED, SERIAL = 8, {"precision": "f32", "threads": 1}  # cases to forecast, and how they run
IN_FIELDS = {*Concrete.model_fields} - {"friction_angle"}  # numbers read from fields
TABLE_INTERVAL = 2.0  # [s] between two tables of an unfinished study; the journal has every row at once


@validated
def values(text: Text, key: Text = "values") -> list[str]:
    """Return the values of a text.

    '20,50,100' is a list; '50:1500:12' is 12 values from 50 to 1500 in equal ratios, to four figures, and with
    ':linear' in equal steps.
    """
    if ":" not in text:
        return [word.strip() for word in text.split(",")]
    try:
        low, high, count, *steps = text.split(":")
        low, high, count = float(in_unit("", low)), float(in_unit("", high)), int(count)
        if steps not in ([], ["linear"]) or count < 2 or not math.isfinite(high - low):
            raise ValueError
    except ValueError:
        raise SceneError(f"{key} = {text}: must be a list, 20,50,100, or first:last:number[:linear]") from None
    require(steps or min(low, high) > 0.0, f"{key} = {text}: equal ratios need values above 0; must be, or add :linear")
    require(count <= MAX_CASES, f"{key} = {text}: must be at most {MAX_CASES} values")
    return [f"{point:.4g}" for point in (np.linspace if steps else np.geomspace)(low, high, count)]


@validated
def cases(scene: SceneName, **parameters) -> list[Case]:
    """Return the cases of every combination of the parameters that are lists or texts of ``values``, each case once.

    The last parameter varies fastest. SceneError for a value that the scene does not accept.
    """
    known = catalogue.load(scene).parameters.model_fields
    given = {name: list_of_values(name, value) for name, value in parameters.items()}
    if "accuracy" in known and not given.keys() & CHOOSES:
        choice = choose(ACCURACY)
        given |= {"model": [choice.model], "spacing": [choice.spacing]}
    count = math.prod(len(choices) for choices in given.values())
    require(count <= MAX_CASES, f"{', '.join(given)}: make {count:.3g} cases; must be at most {MAX_CASES}")
    found = [case_of(scene, **dict(zip(given, combination, strict=True))) for combination in product(*given.values())]
    return list({c.key: c for c in found}.values())


def list_of_values(name, value) -> list:
    """Return the list of values of a parameter."""
    if isinstance(value, str):
        return values(value, name)
    value = value.tolist() if isinstance(value, np.ndarray) else value
    found = list(value) if hasattr(value, "__iter__") else [value]
    require(found, f"{name} = {value}: must be one value or more")
    return found


@validated
def sweep(
    scene: SceneName,
    out: Place | None = None,
    executor: Text | InstanceOf[Executor] = "local",
    workers: Count | None = None,
    watch: Callable | None = None,
    **parameters: Any,
) -> list[dict]:
    """Compute a scene at every combination of parameters.

    Parameters
    ----------
    scene : str
        Name of a built-in scene or path of a Python file.
    out : path-like, optional
        Folder of the study, studies/SCENE by default; what it holds is not computed again.
    executor : str or concurrent.futures.Executor, optional
        'local' (processes of this machine) or 'dask://HOST:PORT' (workers of Dask, on any machines).
    workers : int, optional
        Cases at once; of this machine the number of CPUs by default.
    watch : callable, optional
        ``watch(rows, total)`` is called with the rows so far.
    **parameters
        Keywords of the scene: a number, a list, or text such as '50:1500:12' (12 values in equal ratios).

    Returns
    -------
    list of dict
        A row for each case, in the order of the combinations: its parameters, results and status.

    Raises
    ------
    SceneError
        If a parameter is unknown or out of range, before anything is computed.

    Notes
    -----
    A script that calls this needs ``if __name__ == "__main__":``, because its processes import it.

    Examples
    --------
    >>> from taichi_mps.study.sweep import sweep
    >>> sweep("slump", yield_value="50:1500")
    Traceback (most recent call last):
        ...
    taichi_mps.units.SceneError: yield_value = 50:1500: must be a list, 20,50,100, or first:last:number[:linear]
    """
    return run_cases(
        cases(scene, **parameters), out or Path("studies") / Path(scene).stem, run_case, executor, workers, watch
    )


def run_cases(planned: list[Case], out, run=run_case, executor="local", workers=None, watch=None) -> list[dict]:
    """Return the rows of the cases, by ``run`` on an executor; rows in the folder ``out`` are not computed again.

    ``run`` is a function of a module, which the workers import; it returns a row, a dict with the key of its case.
    """
    start, max_running = executor_of(executor, workers)
    with open_results(out) as results:
        written = monotonic()

        def rows():
            return [results.rows[c.key] for c in planned if c.key in results.rows]

        def finished(row):
            nonlocal written
            results.add(row)
            if monotonic() - written > TABLE_INTERVAL:
                results.write(rows())
                written = monotonic()
            if watch:
                watch(rows(), len(planned))

        results.rows = {key: row for key, row in results.rows.items() if row["status"] != LOST}
        remaining = sorted((c for c in planned if c.key not in results.rows), key=kernel_key)
        if watch:
            watch(rows(), len(planned))
        try:
            for suspect in run_side_by_side(remaining, run, start, max_running, finished):
                if run_side_by_side([suspect], run, start, 1, finished):
                    finished(row_without_result(suspect, LOST, "its process died, beside others and alone"))
        finally:
            results.write(rows())
        return rows()


def kernel_key(case: Case) -> str:
    """Return all parameters but those that kernels read from fields: cases with equal ones share their kernels."""
    return str([(name, value) for name, value in case.parameters.items() if name not in IN_FIELDS])


def wall_time(planned: list[Case], workers: int, runs: int | None = None) -> float:
    """Return the expected wall time [s] of cases on some workers, or of ``runs`` cases like these.

    It is the mean forecast of a sample; kernels are compiled at least once by each worker.
    """
    sample = planned[:: max(1, len(planned) // SAMPLED)]
    from ..forecast.clock import Clock

    problems = [Problem(catalogue.build(c.scene, **c.parameters)) for c in sample]
    clocks = [Clock(problem, SERIAL, math.inf) for problem in problems]
    own = any(not problem.scene.material.from_fields for problem in problems)  # a law that compiles its numbers
    runs, shapes = runs or len(planned), len({case.key if own else kernel_key(case) for case in planned})
    stepping = runs * sum(clock.cost.cpu_seconds for clock in clocks) / len(clocks)
    start_up = sum(clock.expected["start"] + clock.expected["ready"] for clock in clocks) / len(clocks)
    return (stepping + start_up * max(shapes, min(workers, runs))) / min(workers, runs)


def run_side_by_side(planned, run, start, max_running, finished) -> list[Case]:
    """Compute cases in parallel, at most ``max_running`` at once; return those that ran when a process died.

    A process that dies ends the others, so which case caused it is not known. After Ctrl-C running cases are finished.
    """
    waiting, suspects = deque(planned), []
    while waiting:
        running, stopped = {}, None
        with start() as executor, suppress(BrokenExecutor):
            while waiting or running:
                try:
                    while waiting and (max_running is None or len(running) < max_running):
                        running[executor.submit(run, waiting[0])] = waiting[0]
                        waiting.popleft()
                    for future in wait(running, return_when=FIRST_COMPLETED).done:
                        finished(row_of_future(future, running[future]))
                        del running[future]
                except KeyboardInterrupt as interrupt:
                    if stopped or not running or max_running is None:
                        raise
                    stopped = interrupt
                    waiting.clear()
                    warnings.warn(f"no new case begins; Ctrl-C again ends the {len(running)} under way", stacklevel=2)
        if stopped:
            raise stopped
        if waiting and not running:  # an executor that was broken when it came
            return [*suspects, *waiting]
        suspects += running.values()
    return suspects


def row_of_future(future, case: Case) -> dict:
    """Return the row of a finished case; BrokenExecutor where a process died."""
    try:
        return future.result()
    except BrokenExecutor:
        raise
    except Exception as error:  # of the executor; what goes wrong in a case is in its row
        return row_without_result(case, LOST, f"{type(error).__name__}: {str(error) or 'given up by the executor'}")


# ---- executors: processes of this machine, the workers of Dask ---------------------------------------------------
@contextmanager
def processes(workers: int):
    """Open processes of this machine, each with one thread; none survives this one."""
    pool = ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), initializer=end_with_parent)
    try:
        if threading.current_thread() is threading.main_thread():
            before = signal.signal(signal.SIGINT, signal.SIG_IGN)  # what they inherit, for the time of their imports
            try:
                pool.submit(int)  # begins all of them
            finally:
                signal.signal(signal.SIGINT, before or signal.SIG_DFL)
        yield pool
        pool.shutdown()
    except BaseException:
        for process in list((pool._processes or {}).values()):  # 3.14 has terminate_workers for this
            process.terminate()
        pool.shutdown(wait=False, cancel_futures=True)
        raise


def end_with_parent():
    """Leave Ctrl-C to the parent process, and end this process when the parent is killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch():
        multiprocessing.parent_process().join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def dask(address: str):
    """Open the workers of a running scheduler: dask worker ADDRESS --nworkers N --nthreads 1."""
    require_package("distributed", f"executor = {address}: needs", "cluster")
    from distributed import Client

    try:
        client = Client(address.replace("dask://", "tcp://"), timeout=10, set_as_default=False)
    except OSError as error:
        raise SceneError(f"executor = {address}: no scheduler answers there ({error})") from None
    with client:
        yield client.get_executor(pure=False)


def executor_of(text: str | Executor, workers: int | None):
    """Return a function that opens an executor, and how many cases to submit at once (None: all).

    ``text`` is an address or an executor.
    """
    if isinstance(text, Executor):
        return lambda: nullcontext(text), None
    if text == "local":
        workers = workers or os.cpu_count() or 1
        return lambda: processes(workers), workers
    slurm = "; Slurm starts workers of Dask, see docs/howto/cluster.md" * text.startswith("slurm:")
    require(
        re.fullmatch(r"dask://[^\s/]+:\d{1,5}", text), f"executor = {text}: must be dask://HOST:PORT or local{slurm}"
    )
    return lambda: dask(text), workers
