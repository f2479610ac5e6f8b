"""Slurm through submitit: one job for each case. Jobs outlive a study that is killed; the next one finds them again."""

import getpass
import subprocess
import threading
from concurrent.futures import Executor, Future
from contextlib import contextmanager, suppress
from pathlib import Path
from time import monotonic

from ..units import SceneError

FOLDER = "slurm-jobs"  # in the study's folder, which all nodes must see: scripts, logs, results of the jobs
LOOK, ASK = 1.0, 20.0  # [s] from look to look for results, and from question to question to Slurm
MINUTES = 60  # of a job, where no timeout_min is given


@contextmanager
def slurm(text: str, partition: str, settings: dict, folder):
    """An executor of Slurm jobs in a partition, or with the partition 'local' of processes of this machine.

    settings: timeout_min, mem_gb, and submitit's other names of sbatch's options (account, qos, constraint, ...).
    """
    import submitit

    settings = {name: number(value) for name, value in settings.items()}
    settings = {"timeout_min": MINUTES, "cpus_per_task": 1} | settings
    try:
        if partition == "local":
            executor = submitit.LocalExecutor(Path(folder) / FOLDER)
        else:
            executor = submitit.SlurmExecutor(Path(folder) / FOLDER)
            settings |= {"partition": partition, "time": settings.pop("timeout_min")}
            if "mem_gb" in settings:
                settings["mem"] = f"{round(1024 * settings.pop('mem_gb'))}M"
        executor.update_parameters(**settings)
    except (RuntimeError, ValueError, TypeError) as error:
        raise SceneError(f"executor = {text}: {str(error).splitlines()[0]}") from None
    jobs = Jobs(executor, text, None if partition == "local" else queued)
    try:
        yield jobs
    finally:
        jobs.shutdown()


def number(text: str):
    """A setting as int or float where it is one."""
    for kind in (int, float):
        with suppress(ValueError):
            return kind(text)
    return text


def queued() -> set[str] | None:
    """The numbers of this user's jobs that wait or run; None where Slurm does not answer. Not submitit's own way,
    sacct: a cluster without accounts has none, and there a job that dies would be waited for without end."""
    try:
        command = ["squeue", "--noheader", "--format", "%i", "--user", getpass.getuser()]
        return set(subprocess.run(command, capture_output=True, text=True, check=True, timeout=60).stdout.split())
    except (OSError, subprocess.SubprocessError):
        return None


def last_state(number: str) -> str:
    """What Slurm says of a job that is over: CANCELLED, TIMEOUT, OUT_OF_MEMORY, ...; it forgets after some minutes."""
    with suppress(OSError, subprocess.SubprocessError):
        command = ["scontrol", "--oneliner", "show", "job", number]
        words = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60).stdout.split()
        return next(word.removeprefix("JobState=") for word in words if word.startswith("JobState="))
    return "no longer known"


def row_of(job) -> dict:
    """What a job that is over gives; RuntimeError with its last words if it did not come to the end of its case."""
    try:
        row = job.result()
    except Exception as error:  # submitit's, around the trace of the job
        lines = [line for line in str(error).splitlines() if line.strip() and not line.startswith("---")]
        trace = [line for line in lines if not line.startswith("You can check")]
        raise RuntimeError(f"job {job.job_id}: {(trace or [type(error).__name__])[-1].strip()}") from None
    _, stopped, why = row.get("reason", "").rpartition("UncompletedJobError: ")
    if stopped:  # submitit's, raised in the midst of the case 90 s before its time is up
        raise RuntimeError(f"job {job.job_id}: {why} timeout_min= gives more time")
    return row


class Jobs(Executor):
    """submitit's jobs as concurrent.futures: its own futures cannot be waited for together.

    ``queued()`` gives the numbers of the jobs that wait or run, None while that is not known. A job that is twice not
    among them and has no result is dead.
    """

    def __init__(self, jobs, text: str, queued=None, look_every=LOOK, ask_every=ASK):
        self.jobs, self.text, self.look_every, self.ask_every = jobs, text, look_every, ask_every
        self.flying, self.over = {}, threading.Event()
        self.there = None  # what was queued when the study went on, asked once
        self.queued = queued or (lambda: {job.job_id for job in list(self.flying) if not job.done()})
        self.thread = threading.Thread(target=self._watch, daemon=True)
        self.thread.start()

    def submit(self, function, case, /):
        """The future of a case: of the job that runs it already, or of a new one."""
        future = Future()
        self.flying[self._earlier(case) or self._new(function, case)] = future
        return future

    def _note(self, case) -> Path:
        """The file that keeps the number of a case's job."""
        return Path(self.jobs.folder) / f"{case.key}.job"

    def _earlier(self, case):
        """The job that a study which did not come to its end gave for the case, if it has a result or still runs."""
        note = self._note(case)
        if not note.is_file():
            return None
        job = self.jobs.job_class(self.jobs.folder, note.read_text())
        if job.paths.result_pickle.exists():
            with suppress(Exception):
                return row_of(job) and job
            return None
        if self.there is None:
            self.there = self.queued()
        return job if self.there is None or job.job_id in self.there else None  # what is over, _watch will find

    def _new(self, function, case):
        try:
            job = self.jobs.submit(function, case)
        except Exception as error:  # of sbatch: no such partition, too many jobs for this user, no space, ...
            many = f"; after {len(self.flying)} jobs, --workers bounds how many there are at once" * bool(self.flying)
            raise SceneError(f"executor = {self.text}: {error}{many}") from None
        self._note(case).write_text(job.job_id)
        return job

    def _watch(self):
        asked, missing = monotonic(), set()
        while not self.over.wait(self.look_every):
            with suppress(OSError):  # a disk that does not answer may do so later
                for job in [job for job in list(self.flying) if job.paths.result_pickle.exists()]:
                    self._deliver(job, self.flying.pop(job))
            if monotonic() - asked > self.ask_every:
                asked, there = monotonic(), self.queued()
                gone = {job for job in list(self.flying) if there is not None and job.job_id not in there}
                for job in gone & missing:
                    why = f"{self.text}: job {job.job_id} ended without a result ({last_state(job.job_id)})"
                    self.flying.pop(job).set_exception(RuntimeError(why))
                missing = gone

    def _deliver(self, job, future):
        try:
            future.set_result(row_of(job))
        except Exception as error:  # of the job: whoever waits shall know
            future.set_exception(error)

    def shutdown(self, wait=True, *, cancel_futures=False):
        """Whatever is still to come is not wanted any more."""
        self.over.set()
        self.thread.join()
        for job in self.flying:
            job.cancel(check=False)
        for note in Path(self.jobs.folder).glob("*.job") if self.flying else ():
            note.unlink()
