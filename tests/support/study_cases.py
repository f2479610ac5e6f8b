"""Cases that cost nothing, for tests/study; a separate module, because worker processes import it."""

import os
import signal
import time
from pathlib import Path

from taichi_mps.study.case import Case


def planned(count: int, notes) -> list[Case]:
    """``count`` cases that take their notes in a folder."""
    return [Case("none", {"number": k, "notes": str(notes)}, f"case{k}") for k in range(count)]


def runs(notes) -> dict[str, int]:
    """How often each case was run."""
    return {path.name: path.stat().st_size for path in sorted(notes.iterdir())}


def first(case, number: int = 2) -> bool:
    """Write down that a case is run; is it the first run of the case of this number?"""
    with open(Path(case.parameters["notes"]) / case.key, "a+", encoding="utf-8") as file:
        file.write("x")
        file.flush()
        return file.tell() == 1 and case.parameters["number"] == number


def row(case, status="done") -> dict:
    return {"key": case.key, "status": status, "reason": "", "number": case.parameters["number"]}


def plain(case):
    first(case)
    return row(case)


def fails_at_two(case):
    return row(case, "failed" if first(case) else "done")


def dies_at_two(case):
    first(case)
    if case.parameters["number"] == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    return row(case)


def kills_the_study_at_first(case):
    if first(case, 5):
        os.kill(os.getppid(), signal.SIGKILL)
    return row(case)


def interrupts_at_two(case):
    """Ctrl-C while it is under way, and the main thread waits: what it imports meanwhile would swallow that."""
    if first(case):
        time.sleep(0.2)
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.5)
    return row(case)
