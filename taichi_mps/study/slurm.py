"""Slurm: one job for each case. Jobs outlive a study that is killed; the next one finds them again.

A job is a command line that only the study writes, with its case in it (``main``), and its result a JSON file: nothing
that lies in a folder is run. Libraries for Slurm are not used because they keep functions and results as pickles, which
are code.
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
POLL_INTERVAL, QUEUE_INTERVAL = 1.0, 20.0  # [s] between two looks for a result, and between two queries of the queue
COMMAND_TIMEOUT = 60.0  # [s] in which a program of Slurm must answer
TIME_LIMIT = 60.0  # [min] of a job, where no timeout_min is given
UNKNOWN_STATE = "no longer known"  # the state of a job of which Slurm says nothing
MAX_JOBS = 1000  # at once, without --workers: each has a thread that waits for it


def slurm(text: str, folder, workers: int | None):
    """Return the executor of an address, slurm://PARTITION?timeout_min=60; the partition 'local' runs processes of this
    machine. After ? stand timeout_min, mem_gb, and other options of sbatch (account, qos, constraint, ...)."""
    parts = urlsplit(text)
    settings = {
        "cpus_per_task": 1,
        "timeout_min": TIME_LIMIT,
        "partition": parts.netloc,
        **dict(parse_qsl(parts.query)),
    }
    try:
        settings["time"] = max(1, round(float(settings.pop("timeout_min"))))
        if "mem_gb" in settings:
            settings["mem"] = f"{round(1024 * float(settings.pop('mem_gb')))}M"
    except (ValueError, OverflowError):
        raise SceneError(f"executor = {text}: timeout_min and mem_gb must be numbers") from None
    cluster = Processes(60.0 * settings["time"]) if parts.netloc == "local" else Slurm(settings)
    return Jobs(cluster, text, user_path(folder) / FOLDER, workers or MAX_JOBS)


def run_command(*command: str) -> str:
    """Run a program and return its output; OSError with its message where it is missing, fails or times out."""
    try:
        process = subprocess.run(command, capture_output=True, text=True, timeout=COMMAND_TIMEOUT)
    except subprocess.TimeoutExpired:
        raise OSError(f"{command[0]} did not answer within {COMMAND_TIMEOUT:g} s") from None
    if process.returncode:
        raise OSError((process.stderr.strip().splitlines() or [f"{command[0]}: no job"])[-1])
    return process.stdout


class Slurm:
    """Cluster whose jobs are submitted by the commands of Slurm; ``options``: of sbatch, by name."""

    def __init__(self, options: dict):
        self.options = [f"--{name.replace('_', '-')}={value}" for name, value in options.items()]

    def submit(self, command: list[str], name: str, log: Path) -> str:
        """Submit a job and return its number; OSError with the message of sbatch where it is refused."""
        options = ["--parsable", f"--job-name={name}", f"--output={log}", "--open-mode=append", *self.options]
        return run_command("sbatch", *options, f"--wrap={shlex.join(command)}").strip().split(";")[0]

    def queued(self) -> set[str]:
        """Return the numbers of this user's jobs that wait or run."""
        return set(run_command("squeue", "--noheader", "--format", "%i", "--user", getpass.getuser()).split())

    def state(self, number: str) -> str:
        """Return Slurm's state of a finished job, such as CANCELLED or TIMEOUT, which Slurm keeps for minutes."""
        with suppress(OSError):
            return re.search(r"JobState=(\w+)|$", run_command("scontrol", "show", "job", number))[1] or UNKNOWN_STATE
        return UNKNOWN_STATE

    def cancel(self, number: str) -> None:
        """Cancel a job of the cluster."""
        run_command("scancel", number)


class Processes:
    """Stand-in for a cluster whose jobs are processes of this machine, ended after ``seconds`` as Slurm does."""

    def __init__(self, seconds: float):
        self.seconds, self.jobs = seconds, {}  # process and deadline by number

    def submit(self, command: list[str], name: str, log: Path) -> str:
        """Start a process and return its number."""
        with open(log, "ab") as out:
            job = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=out, stderr=out, start_new_session=os.name == "posix"
            )
        self.jobs[str(job.pid)] = job, monotonic() + self.seconds
        return str(job.pid)

    def queued(self) -> set[str]:
        """Return the numbers of the processes that run."""
        for job, deadline in list(self.jobs.values()):
            if monotonic() > deadline:
                job.kill()
        return {number for number, (job, _) in list(self.jobs.items()) if job.poll() is None}

    def state(self, number: str) -> str:
        """Return how a process ended: TIMEOUT or its exit status."""
        job, deadline = self.jobs[number]
        return "TIMEOUT" if monotonic() > deadline else f"exit {job.poll()}"

    def cancel(self, number: str) -> None:
        """Kill a process of this machine."""
        self.jobs[number][0].kill()


class Jobs(ThreadPoolExecutor):
    """An executor with a job for each call and a thread that waits for it. The thread looks for the result every
    POLL_INTERVAL; the cluster's queue is queried every QUEUE_INTERVAL. A job that is not queued for that long and has
    no result has failed."""

    def __init__(self, cluster, text: str, folder, max_jobs=MAX_JOBS):
        super().__init__(max_jobs)
        self.cluster, self.text, self.folder = cluster, text, user_path(folder).absolute()
        self.closing, self.lock = threading.Event(), threading.Lock()
        self.asked, self.queued = -math.inf, None  # time of the last query of the queue, and its answer
        self.refused: SceneError | None = None  # why the cluster refused a job; no other one is submitted then

    def submit(self, function, case: Case, /):
        """Return the future row of a case, by the job that runs it already or by a new one."""
        return super().submit(self.job, function, case)

    def shutdown(self, wait=True, *, cancel_futures=True):
        """Cancel what has no result yet."""
        self.closing.set()
        super().shutdown(wait, cancel_futures=cancel_futures)

    def file(self, case: Case, kind: str) -> Path:
        """Return a file of a case: 'job' holds the number of its job, 'log' the job's output, 'json' the result."""
        return self.folder / f"{case.key}.{kind}"

    def job(self, function, case: Case) -> dict:
        """Return the row of a case, by the job of an interrupted study or by a new one; RuntimeError with the last line
        of its log where it leaves none."""
        number = self.earlier_job(case) or self.new_job(function, case)
        seen = monotonic()
        while not self.file(case, "json").exists():
            if self.closing.wait(POLL_INTERVAL):
                with suppress(OSError):
                    self.cluster.cancel(number)
                self.file(case, "job").unlink(missing_ok=True)
                raise CancelledError
            if self.is_queued(number):
                seen = monotonic()
            elif monotonic() - seen > QUEUE_INTERVAL:
                log = self.file(case, "log")
                lines = log.read_bytes()[-4096:].decode(errors="replace").split("\n") if log.exists() else []
                last = "".join(f": {plain(line.strip())}" for line in [line for line in lines if line.strip()][-1:])
                message = f"{self.text}: job {number} ended without a result ({self.cluster.state(number)}){last}"
                raise RuntimeError(message)
        return row_of(self.file(case, "json"), case.key, number)

    def is_queued(self, number: str) -> bool:
        """Whether a job waits or runs, as far as is known."""
        with self.lock:
            if monotonic() - self.asked > QUEUE_INTERVAL:
                self.asked, self.queued = monotonic(), None
                with suppress(OSError):
                    self.queued = self.cluster.queued()
            return self.queued is None or number in self.queued

    def earlier_job(self, case: Case) -> str | None:
        """Return the number of an earlier study's job for the case, if it has a result or still runs."""
        with suppress(OSError, RuntimeError):
            number = self.file(case, "job").read_text()
            result = self.file(case, "json")
            valid = row_of(result, case.key, number) if result.exists() else self.is_queued(number)
            return number if valid else None
        return None

    def new_job(self, function, case: Case) -> str:
        """Submit a new job and return its number."""
        self.folder.mkdir(parents=True, exist_ok=True)
        result = self.file(case, "json")
        result.unlink(missing_ok=True)
        words = f"{function.__module__}:{function.__qualname__}", json.dumps(asdict(case)), str(result)
        with self.lock:
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
    """Read the row that a job has written; RuntimeError for what is no row of this case."""
    with suppress(OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError):
        row = json.loads(path.read_text(encoding="utf-8"))
        kinds = str, int, float, bool, type(None)
        if row["key"] == key and isinstance(row["status"], str) and all(isinstance(v, kinds) for v in row.values()):
            return row
    raise RuntimeError(f"job {number}: {path} is no result of this case")


def main(function: str, case: str, result: str) -> None:
    """Run a job: compute a case by a function MODULE:NAME and write its row, whole or not at all."""
    module, name = function.split(":")
    row = getattr(importlib.import_module(module), name)(Case(**json.loads(case)))
    write_whole(Path(result), json.dumps(strict(row)))


if __name__ == "__main__":
    main(*sys.argv[1:])
