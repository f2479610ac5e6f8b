"""Cases that cost nothing, for tests/study; a module of its own, because worker processes import it."""

import os
import signal
import time
from pathlib import Path


def note(case) -> int:
    """Write down that a case is run; how often it has been."""
    with open(Path(case.parameters["notes"]) / case.key, "a+", encoding="utf-8") as file:
        file.write("x")
        file.flush()
        return file.tell()


def row(case) -> dict:
    return {"key": case.key, "status": "done", "reason": "", "number": case.parameters["number"]}


def plain(case):
    note(case)
    return row(case)


def fails_at_two(case):
    note(case)
    return row(case) | ({"status": "failed", "reason": "it is two"} if case.parameters["number"] == 2 else {})


def raises_at_two_at_first(case):
    if note(case) == 1 and case.parameters["number"] == 2:
        raise OSError("the disk is gone")
    return row(case)


def dies_at_two(case):
    note(case)
    if case.parameters["number"] == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    return row(case)


def kills_its_process_at_first(case):
    if note(case) == 1 and case.parameters["number"] == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    return row(case)


def kills_the_study_at_first(case):
    if note(case) == 1 and case.parameters["number"] == 5:
        os.kill(os.getppid(), signal.SIGKILL)
    return row(case)


def planned(count: int, notes) -> list:
    """``count`` cases that take their notes in a folder."""
    from taichi_mps.study.case import Case

    return [Case("none", (("number", k), ("notes", str(notes))), f"case{k}") for k in range(count)]


def waits_at_two_at_first(case):
    if note(case) == 1 and case.parameters["number"] == 2:
        time.sleep(600.0)
    return row(case)
