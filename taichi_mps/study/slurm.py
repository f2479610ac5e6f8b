"""Slurm: one job for each case. Jobs outlive a study that is killed; the next one finds them again.

A job is a command line, which only the study writes, with its case in it (``main``), and its result a JSON file:
nothing that lies in a folder is run. That is why jobs are not given by a library: those for Python keep functions and
results as pickles, which are code.
"""

import getpass
import importlib
import json
import math
import os
import re
import shlex
import subprocess
import sys
import threading
from concurrent.futures import CancelledError, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from time import monotonic
from urllib.parse import parse_qsl, urlsplit

from ..io.run_folder import strict, write_whole
from ..units import SceneError, plain, user_path
from .case import Case

FOLDER = "slurm-jobs"  # in the study's folder, which all nodes must see: numbers, logs and results of the jobs
LOOK, ASK = 1.0, 20.0  # [s] from look to look for results, and from question to question to Slurm
ANSWER = 60.0  # [s] in which a program of Slurm must answer
MINUTES = 60.0  # of a job, where no timeout_min is given
FORGOTTEN = "no longer known"  # the state of a job of which Slurm says nothing
MOST_JOBS = 1000  # at once, where --workers does not say how many: each has a thread that waits for it


def slurm(text: str, folder, workers: int | None):
    """An executor of jobs by its address, slurm://PARTITION?timeout_min=60, or with the partition 'local' of processes
    of this machine. After ? stand timeout_min, mem_gb, and other options of sbatch (account, qos, constraint, ...)."""
    parts = urlsplit(text)
    settings = {"cpus_per_task": 1, "timeout_min": MINUTES, "partition": parts.netloc, **dict(parse_qsl(parts.query))}
    try:
        settings["time"] = max(1, round(float(settings.pop("timeout_min"))))
        if "mem_gb" in settings:
            settings["mem"] = f"{round(1024 * float(settings.pop('mem_gb')))}M"
    except (ValueError, OverflowError):
        raise SceneError(f"executor = {text}: timeout_min and mem_gb must be numbers") from None
    cluster = Processes(60.0 * settings["time"]) if parts.netloc == "local" else Slurm(settings)
    return Jobs(cluster, text, user_path(folder) / FOLDER, workers or MOST_JOBS)


def answer(*command: str) -> str:
    """Output of a program; OSError with what it says where it is missing, fails, or does not answer in time."""
    try:
        made = subprocess.run(command, capture_output=True, text=True, timeout=ANSWER)
    except subprocess.TimeoutExpired:
        raise OSError(f"{command[0]} did not answer within {ANSWER:g} s") from None
    if made.returncode:
        raise OSError((made.stderr.strip().splitlines() or [f"{command[0]}: no job"])[-1])
    return made.stdout


class Slurm:
    """Jobs by the commands of Slurm. ``options`` of sbatch by name."""

    def __init__(self, options: dict):
        self.options = [f"--{name.replace('_', '-')}={value}" for name, value in options.items()]

    def submit(self, command: list[str], name: str, log: Path) -> str:
        """The number of a new job; OSError with what sbatch says where it gives none."""
        told = ["--parsable", f"--job-name={name}", f"--output={log}", "--open-mode=append", *self.options]
        return answer("sbatch", *told, f"--wrap={shlex.join(command)}").strip().split(";")[0]

    def queued(self) -> set[str]:
        """The numbers of this user's jobs that wait or run."""
        return set(answer("squeue", "--noheader", "--format", "%i", "--user", getpass.getuser()).split())

    def state(self, number: str) -> str:
        """Slurm's word for a job that is over: CANCELLED, TIMEOUT, OUT_OF_MEMORY, ...; it forgets it after minutes."""
        with suppress(OSError):
            return re.search(r"JobState=(\w+)|$", answer("scontrol", "show", "job", number))[1] or FORGOTTEN
        return FORGOTTEN

    def cancel(self, number: str) -> None:
        """Cancel a job of the cluster."""
        answer("scancel", number)


class Processes:
    """Jobs as processes of this machine, to try a study before it goes to a cluster; a job is ended after ``seconds``,
    as Slurm does."""

    def __init__(self, seconds: float):
        self.seconds, self.made = seconds, {}  # of each number the process, and when its time is up

    def submit(self, command: list[str], name: str, log: Path) -> str:
        """The number of a new process."""
        with open(log, "ab") as out:
            job = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=out, stderr=out, start_new_session=os.name == "posix"
            )
        self.made[str(job.pid)] = job, monotonic() + self.seconds
        return str(job.pid)

    def queued(self) -> set[str]:
        """The numbers of those that run."""
        for job, end in list(self.made.values()):
            if monotonic() > end:
                job.kill()
        return {number for number, (job, _) in list(self.made.items()) if job.poll() is None}

    def state(self, number: str) -> str:
        """Ending of a process in words."""
        job, end = self.made[number]
        return "TIMEOUT" if monotonic() > end else f"exit {job.poll()}"

    def cancel(self, number: str) -> None:
        """Kill a process of this machine."""
        self.made[number][0].kill()


class Jobs(ThreadPoolExecutor):
    """An executor with a job for each call and a thread that waits for it: it looks for its result every LOOK
    seconds, and asks the cluster every ASK seconds which jobs there are. A job that is not among them for as long and
    has no result is dead."""

    def __init__(self, cluster, text: str, folder, most=MOST_JOBS):
        super().__init__(most)
        self.cluster, self.text, self.folder = cluster, text, user_path(folder).absolute()
        self.over, self.turn = threading.Event(), threading.Lock()
        self.asked, self.there = -math.inf, None  # when the cluster was asked, and its answer
        self.refused: SceneError | None = None  # why it gave no job; it is not asked for another one

    def submit(self, function, case: Case, /):
        """The future row of a case: of the job that runs it already, or of a new one."""
        return super().submit(self.job, function, case)

    def shutdown(self, wait=True, *, cancel_futures=True):
        """Cancel what has no result yet."""
        self.over.set()
        super().shutdown(wait, cancel_futures=cancel_futures)

    def file(self, case: Case, kind: str) -> Path:
        """A file of a case: 'job' has the number of its job, 'log' what that printed, 'json' its result."""
        return self.folder / f"{case.key}.{kind}"

    def job(self, function, case: Case) -> dict:
        """The row of a case, by the job of a study that did not come to its end or by a new one; RuntimeError with its
        last words where it leaves none."""
        number = self.earlier(case) or self.new(function, case)
        seen = monotonic()
        while not self.file(case, "json").exists():
            if self.over.wait(LOOK):
                with suppress(OSError):
                    self.cluster.cancel(number)
                self.file(case, "job").unlink(missing_ok=True)
                raise CancelledError
            if self.is_there(number):
                seen = monotonic()
            elif monotonic() - seen > ASK:
                log = self.file(case, "log")
                lines = log.read_bytes()[-4096:].decode(errors="replace").split("\n") if log.exists() else []
                last = "".join(f": {plain(line.strip())}" for line in [line for line in lines if line.strip()][-1:])
                how = f"{self.text}: job {number} ended without a result ({self.cluster.state(number)}){last}"
                raise RuntimeError(how)
        return row_of(self.file(case, "json"), case.key, number)

    def is_there(self, number: str) -> bool:
        """Whether a job waits or runs, as far as is known."""
        with self.turn:
            if monotonic() - self.asked > ASK:
                self.asked, self.there = monotonic(), None
                with suppress(OSError):
                    self.there = self.cluster.queued()
            return self.there is None or number in self.there

    def earlier(self, case: Case) -> str | None:
        """The number of the job that an earlier study gave for the case, if it has a result or still runs."""
        with suppress(OSError, RuntimeError):
            number = self.file(case, "job").read_text()
            result = self.file(case, "json")
            known = row_of(result, case.key, number) if result.exists() else self.is_there(number)
            return number if known else None
        return None

    def new(self, function, case: Case) -> str:
        """The number of a new job."""
        self.folder.mkdir(parents=True, exist_ok=True)
        result = self.file(case, "json")
        result.unlink(missing_ok=True)
        words = f"{function.__module__}:{function.__qualname__}", json.dumps(asdict(case)), str(result)
        with self.turn:
            if self.refused:
                raise self.refused
            try:
                number = self.cluster.submit([sys.executable, "-m", __name__, *words], case.key, self.file(case, "log"))
            except OSError as error:  # no such partition, too many jobs for this user, no space, no sbatch, ...
                bound = "--workers bounds how many jobs there are at once"
                self.refused = SceneError(f"executor = {self.text}: {error}; {bound}")
                raise self.refused from None
        self.file(case, "job").write_text(number)
        return number


def row_of(path: Path, key: str, number: str) -> dict:
    """The row that a job has left; RuntimeError for what is none of this case."""
    with suppress(OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError):
        row = json.loads(path.read_text(encoding="utf-8"))
        kinds = str, int, float, bool, type(None)
        if row["key"] == key and isinstance(row["status"], str) and all(isinstance(v, kinds) for v in row.values()):
            return row
    raise RuntimeError(f"job {number}: {path} is no result of this case")


def main(function: str, told: str, result: str) -> None:
    """A job: compute a case by a function MODULE:NAME and write its row, whole or not at all."""
    module, name = function.split(":")
    row = getattr(importlib.import_module(module), name)(Case(**json.loads(told)))
    write_whole(Path(result), json.dumps(strict(row)))


if __name__ == "__main__":
    main(*sys.argv[1:])
