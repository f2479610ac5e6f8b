"""A sweep: a scene at every combination of some values, in parallel; what fails is a row, what is done stays done."""

import math
from collections import deque
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, wait
from contextlib import contextmanager
from itertools import product
from pathlib import Path
from time import monotonic

from ..problem import catalogue
from ..problem.accuracy import choose
from ..problem.materials import Bingham
from ..units import SceneError
from .case import Case, case
from .case import run as run_case
from .executors import named
from .results import Results

ACCURACY = 0.005  # of the slump [m], by which model and spacing are chosen where the scene can and nothing is given
LOST = "lost"  # status of a case that its executor did not bring to an end; computed again when the study is resumed
MOST_CASES = 100_000  # of a study
TABLE_EVERY = 2.0  # [s] between two tables of an unfinished study; the journal has every row at once


def values(text: str, key: str = "values") -> list[str]:
    """'20,50,100' is those; '50:1500:12' is 12 values from 50 to 1500 in equal ratios, to four figures, and with
    ':linear' in equal steps."""
    if ":" not in text:
        return [word.strip() for word in text.split(",")]
    words = text.split(":")
    try:
        low, high, count = float(words[0]), float(words[1]), int(words[2])
        linear = words[3:] == ["linear"]
        if words[3:] and not linear or not count >= 2 or not math.isfinite(high - low):
            raise ValueError
    except (ValueError, IndexError):
        raise SceneError(f"{key} = {text}: must be a list, 20,50,100, or first:last:number[:linear]") from None
    if not linear and min(low, high) <= 0.0:
        raise SceneError(f"{key} = {text}: equal ratios need values above 0; must be, or add :linear")
    if count > MOST_CASES:
        raise SceneError(f"{key} = {text}: must be at most {MOST_CASES} values")
    parts = [k / (count - 1) for k in range(count)]
    points = [low + s * (high - low) if linear else low * (high / low) ** s for s in parts]
    return [f"{point:.4g}" for point in points]


def cases(scene: str, **parameters) -> list[Case]:
    """Every combination of the parameters that are lists or texts of ``values``, the last varied fastest, each once. A
    value that the scene does not accept is refused at once."""
    known = catalogue.load(scene).parameters.model_fields
    given = {name: spelled(name, value) for name, value in parameters.items()}
    if "accuracy" in known and not given.keys() & {"accuracy", "model", "spacing", "lift_speed"}:
        choice = choose(ACCURACY)
        given |= {"model": [choice.model], "spacing": [choice.spacing]}
    count = math.prod(len(choices) for choices in given.values())
    if count > MOST_CASES:
        raise SceneError(f"{', '.join(given)}: make {count:.3g} cases; must be at most {MOST_CASES}")
    found = [case(scene, **dict(zip(given, combination, strict=True))) for combination in product(*given.values())]
    return list({c.key: c for c in found}.values())


def spelled(name, value) -> list:
    """A parameter as the list of its values."""
    if isinstance(value, str):
        return values(value, name)
    return list(value) if hasattr(value, "__iter__") else [value]


def sweep(
    scene: str, out=None, executor: str | Executor = "local", workers: int | None = None, watch=None, **parameters
):
    """Compute a scene at every combination of parameters: the rows in their order, each a dict (``case.run``).

    Parameters are numbers, lists or text such as '50:1500:12' (``values``). The folder ``out``, by default
    studies/SCENE, keeps every row; what it holds is not computed again. ``executor`` is 'local' (this machine's
    processes, as many as ``workers``, the number of CPUs by default), 'dask://HOST:PORT', 'slurm://PARTITION' or a
    concurrent.futures.Executor. ``watch(rows, total)`` is called with the rows so far. A script that calls this needs
    ``if __name__ == "__main__":``, because its processes import it.
    """
    return carry_out(
        cases(scene, **parameters), out or Path("studies") / Path(scene).stem, run_case, executor, workers, watch
    )


def carry_out(planned: list[Case], out, run=run_case, executor="local", workers=None, watch=None) -> list[dict]:
    """The rows of the cases, by ``run`` on an executor; those in the folder ``out`` are taken from there.

    ``run`` is a function of a module, which the workers import; it gives a row, a dict with the key of its case.
    """
    if isinstance(executor, Executor):
        opened, room = (lambda: as_it_is(executor)), None
    else:
        opened, room = named(executor, workers, out)
    with Results(out) as results:
        written = monotonic()

        def rows():
            return [results.rows[c.key] for c in planned if c.key in results.rows]

        def finished(row):
            nonlocal written
            results.add(row)
            if monotonic() - written > TABLE_EVERY:
                results.write(rows())
                written = monotonic()
            if watch:
                watch(rows(), len(planned))

        results.rows = {key: row for key, row in results.rows.items() if row["status"] != LOST}
        left = {c.key: c for c in planned if c.key not in results.rows}
        left = sorted(left.values(), key=shape)  # compiled once for all
        if watch:
            watch(rows(), len(planned))
        try:
            for suspect in together(left, run, opened, room, finished):
                if together([suspect], run, opened, 1, finished):
                    finished(without_row(suspect, LOST, "its process died, beside others and alone"))
        finally:
            results.write(rows())
        return rows()


@contextmanager
def as_it_is(executor):
    """An executor that its owner closes."""
    yield executor


def shape(case: Case) -> str:
    """All parameters but the material's: cases that share it share their kernels."""
    return str([(name, value) for name, value in case.given if name not in Bingham.model_fields])


def together(planned, run, opened, room, finished) -> list[Case]:
    """Compute cases side by side, at most ``room`` at once; returns those in whose time a process died. It took the
    others with it, so which of them it was is not known."""
    waiting, suspects = deque(planned), []
    while waiting:
        before = len(waiting)
        with opened() as executor:
            flying, broken = {}, False
            while flying or (waiting and not broken):
                try:
                    while waiting and not broken and (room is None or len(flying) < room):
                        flying[executor.submit(run, waiting[0])] = waiting[0]
                        waiting.popleft()
                except BrokenExecutor:
                    broken = True
                for future in wait(flying, return_when=FIRST_COMPLETED).done:
                    it = flying.pop(future)
                    try:
                        row = future.result()
                    except BrokenExecutor:
                        broken = True
                        suspects.append(it)
                        continue
                    except Exception as error:  # of the executor; what goes wrong in a case is in its row
                        why = " ".join(str(error).split()) or "given up by the executor"
                        row = without_row(it, LOST, f"{type(error).__name__}: {why}")
                    finished(row)
        if len(waiting) == before:  # an executor that was broken when it came
            return [*suspects, *waiting]
    return suspects


def without_row(case: Case, status: str, reason: str) -> dict:
    """The row of a case that gave none."""
    return {"key": case.key, "status": status, "reason": reason, "scene": case.scene, **case.parameters}
