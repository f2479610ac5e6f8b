"""One case as a process of its own: ``python -m taichi_mps.study.job FUNCTION CASE RESULT MINUTES``.

Everything that it does stands on its command line, which only the study writes; the result is a JSON file. What else
lies in the folder of the jobs is neither read nor run.
"""

import importlib
import json
import os
import signal
import sys
from pathlib import Path

from ..io.run_folder import strict
from .case import Case

MARGIN = 90.0  # [s] before its time is up at which a job stops, to say so


class TimeIsUp(BaseException):
    """Not an Exception: a case that fails is a row, and this is none."""


def words(function, case: Case, result: Path, minutes: float) -> list[str]:
    """The arguments of the job of a case: a function of a module, the case, the file of its result, its time."""
    told = json.dumps([case.scene, case.given, case.key])
    return [f"{function.__module__}:{function.__qualname__}", told, str(result), f"{minutes:g}"]


def main(function: str, told: str, result: str, minutes: str) -> None:
    """Compute a case and write its row, or what went wrong, whole or not at all."""
    module, _, name = function.partition(":")
    scene, given, key = json.loads(told)
    case = Case(scene, tuple((name, value) for name, value in given), key)

    def stop(*_):
        raise TimeIsUp

    if hasattr(signal, "setitimer"):
        seconds = 60.0 * float(minutes)
        signal.signal(signal.SIGALRM, stop)
        signal.setitimer(signal.ITIMER_REAL, max(seconds - MARGIN, 0.9 * seconds))
    try:
        row = getattr(importlib.import_module(module), name)(case)
    except TimeIsUp:
        row = {"error": f"stopped, its {minutes} minutes are up; timeout_min= gives more time"}
    except Exception as error:  # who waits shall know
        row = {"error": f"{type(error).__name__}: {' '.join(str(error).split())}"}
    partial = Path(f"{result}.{os.getpid()}.part")
    partial.write_text(json.dumps(strict(row)), encoding="utf-8")
    os.replace(partial, result)


if __name__ == "__main__":
    main(*sys.argv[1:])
