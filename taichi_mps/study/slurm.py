"""Slurm: one job for each case. Jobs outlive a study that is killed; the next one finds them again.

A job is a command line with its case in it (job.py), and its result a JSON file: nothing that lies in a folder is run.
That is why jobs are not given by a library: those for Python keep functions and results as pickles, which are code.
"""

import getpass
import json
import os
import shlex
import subprocess
import sys
import threading
from concurrent.futures import Executor, Future
from contextlib import contextmanager, suppress
from pathlib import Path
from time import monotonic

from ..units import SceneError, plain

FOLDER = "slurm-jobs"  # in the study's folder, which all nodes must see: numbers, logs and results of the jobs
LOOK, ASK = 1.0, 20.0  # [s] from look to look for results, and from question to question to Slurm
MINUTES = 60.0  # of a job, where no timeout_min is given


@contextmanager
def slurm(text: str, partition: str, settings: dict, folder):
    """An executor of Slurm jobs in a partition, or with the partition 'local' of processes of this machine.

    settings: timeout_min, mem_gb, and other options of sbatch by their names (account, qos, constraint, ...).
    """
    settings = dict(settings)
    try:
        minutes = float(settings.pop("timeout_min", MINUTES))
        if "mem_gb" in settings:
            settings["mem"] = f"{round(1024 * float(settings.pop('mem_gb')))}M"
        if not 0.0 < minutes < float("inf"):
            raise ValueError(minutes)
    except (ValueError, OverflowError):
        raise SceneError(f"executor = {text}: timeout_min and mem_gb must be numbers above 0") from None
    cluster = Processes() if partition == "local" else Slurm({"partition": partition, **settings}, minutes)
    jobs = Jobs(cluster, text, Path(folder) / FOLDER, minutes)
    try:
        yield jobs
    finally:
        jobs.shutdown()


class Slurm:
    """Jobs by the commands of Slurm. ``options`` of sbatch by name."""

    def __init__(self, options: dict, minutes: float):
        options = {"cpus_per_task": 1, "time": max(1, round(minutes))} | options
        self.options = [f"--{name.replace('_', '-')}={value}" for name, value in options.items()]

    def submit(self, command: list[str], name: str, log: Path) -> str:
        """The number of a new job; OSError with what sbatch says where it gives none."""
        told = ["--parsable", f"--job-name={name}", f"--output={log}", "--open-mode=append", *self.options]
        made = subprocess.run(["sbatch", *told, f"--wrap={shlex.join(command)}"], capture_output=True, text=True)
        if made.returncode:
            raise OSError((made.stderr.strip().splitlines() or ["sbatch: no job"])[-1])
        return made.stdout.strip().split(";")[0]

    def queued(self) -> set[str] | None:
        """The numbers of this user's jobs that wait or run; None where Slurm does not answer."""
        with suppress(OSError, subprocess.SubprocessError):
            command = ["squeue", "--noheader", "--format", "%i", "--user", getpass.getuser()]
            return set(subprocess.run(command, capture_output=True, text=True, check=True, timeout=60).stdout.split())
        return None

    def last_state(self, number: str) -> str:
        """What Slurm says of a job that is over: CANCELLED, TIMEOUT, OUT_OF_MEMORY, ...; it forgets after minutes."""
        with suppress(OSError, subprocess.SubprocessError):
            command = ["scontrol", "--oneliner", "show", "job", number]
            words = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60).stdout.split()
            return next((w.removeprefix("JobState=") for w in words if w.startswith("JobState=")), "no longer known")
        return "no longer known"

    def cancel(self, number: str) -> None:
        """End a job."""
        with suppress(OSError):
            subprocess.run(["scancel", number], capture_output=True)


class Processes:
    """Jobs as processes of this machine, to try a study before it goes to a cluster."""

    def __init__(self):
        self.made: dict[str, subprocess.Popen] = {}

    def submit(self, command: list[str], name: str, log: Path) -> str:
        """The number of a new process."""
        with open(log, "ab") as out:
            job = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=out, stderr=out, start_new_session=os.name == "posix"
            )
        self.made[str(job.pid)] = job
        return str(job.pid)

    def queued(self) -> set[str] | None:
        """The numbers of those that run."""
        return {number for number, job in self.made.items() if job.poll() is None}

    def last_state(self, number: str) -> str:
        """How a process ended."""
        return f"exit {self.made[number].returncode}" if number in self.made else "no longer known"

    def cancel(self, number: str) -> None:
        """End a process, if it is still one of ours."""
        if number in self.made:
            self.made[number].kill()


class Jobs(Executor):
    """Jobs of a cluster as concurrent.futures. A job that is twice not among those that wait or run and has no result
    is dead."""

    def __init__(self, cluster, text: str, folder, minutes=MINUTES, look_every=LOOK, ask_every=ASK):
        self.cluster, self.text, self.minutes = cluster, text, minutes
        self.folder = Path(folder).absolute()
        self.look_every, self.ask_every = look_every, ask_every
        self.flying: dict[str, tuple[Future, str]] = {}  # by the key of the case: its future and the number of its job
        self.over = threading.Event()
        self.there = None  # what was queued when the study went on, asked once
        self.thread = threading.Thread(target=self._watch, daemon=True)
        self.thread.start()

    def submit(self, function, case, /):
        """The future of a case: of the job that runs it already, or of a new one."""
        self.folder.mkdir(parents=True, exist_ok=True)
        future = Future()
        self.flying[case.key] = future, self._earlier(case) or self._new(function, case)
        return future

    def file(self, key: str, kind: str) -> Path:
        """A file of a case: 'job' has the number of its job, 'log' what that printed, 'json' its result."""
        return self.folder / f"{key}.{kind}"

    def _earlier(self, case) -> str | None:
        """The job that a study which did not come to its end gave for the case, if it has a result or still runs."""
        try:
            number = self.file(case.key, "job").read_text()
        except OSError:
            return None
        if self.file(case.key, "json").exists():
            with suppress(RuntimeError):
                return row_of(self.file(case.key, "json"), case.key, number) and number
            return None
        if self.there is None:
            self.there = self.cluster.queued()
        return number if self.there is None or number in self.there else None  # what is over, _watch will find

    def _new(self, function, case) -> str:
        from .job import words

        self.file(case.key, "json").unlink(missing_ok=True)
        command = [sys.executable, "-m", "taichi_mps.study.job"]
        command += words(function, case, self.file(case.key, "json"), self.minutes)
        try:
            number = self.cluster.submit(command, case.key, self.file(case.key, "log"))
        except OSError as error:  # no such partition, too many jobs for this user, no space, no sbatch, ...
            many = f"; after {len(self.flying)} jobs, --workers bounds how many there are at once" * bool(self.flying)
            raise SceneError(f"executor = {self.text}: {error}{many}") from None
        self.file(case.key, "job").write_text(number)
        return number

    def _watch(self):
        asked, missing = monotonic(), set()
        while not self.over.wait(self.look_every):
            with suppress(OSError):  # a disk that does not answer may do so later
                for key in [key for key in list(self.flying) if self.file(key, "json").exists()]:
                    self._deliver(key, *self.flying.pop(key))
            if monotonic() - asked > self.ask_every:
                asked, there = monotonic(), self.cluster.queued()
                gone = {
                    key for key, (_, number) in list(self.flying.items()) if there is not None and number not in there
                }
                for key in gone & missing:
                    future, number = self.flying.pop(key)
                    state = self.cluster.last_state(number)
                    why = (
                        f"{self.text}: job {number} ended without a result ({state}){last_words(self.file(key, 'log'))}"
                    )
                    future.set_exception(RuntimeError(why))
                missing = gone

    def _deliver(self, key, future, number):
        try:
            future.set_result(row_of(self.file(key, "json"), key, number))
        except RuntimeError as error:  # of the job: whoever waits shall know
            future.set_exception(error)

    def shutdown(self, wait=True, *, cancel_futures=False):
        """Whatever is still to come is not wanted any more."""
        self.over.set()
        self.thread.join()
        for key, (_, number) in self.flying.items():
            self.cluster.cancel(number)
            self.file(key, "job").unlink(missing_ok=True)


def row_of(path: Path, key: str, number: str) -> dict:
    """The row that a job has left; RuntimeError with its last words if it did not come to the end of its case."""
    try:
        row = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        row = None
    kinds = str, int, float, bool, type(None)
    if not isinstance(row, dict) or not all(isinstance(value, kinds) for value in row.values()):
        raise RuntimeError(f"job {number}: {path} is no result")
    if "error" in row:
        raise RuntimeError(f"job {number}: {plain(row['error'])}")
    if row.get("key") != key or not isinstance(row.get("status"), str):
        raise RuntimeError(f"job {number}: {path} is the result of another case")
    return row


def last_words(log: Path) -> str:
    """What a job printed last, after a colon; nothing where it printed nothing."""
    with suppress(OSError):
        lines = log.read_bytes()[-4096:].decode(errors="replace").strip().splitlines()
        return f": {plain(lines[-1])}" if lines else ""
    return ""
