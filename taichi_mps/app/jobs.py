"""Queue of the commands requested on the page, each a child process of the command line, one after the other.

So Taichi is never started in the server, a run is stopped as on a terminal, and its folder is an ordinary one.
"""

import asyncio
import signal
import sys
import time
from asyncio.subprocess import DEVNULL, PIPE
from contextlib import nullcontext, suppress
from dataclasses import dataclass, field
from pathlib import Path

from ..cli.stopped import SIGNALS
from ..io.run_folder import RunFolder, next_free
from ..units import user_path
from .resident import OWN_SESSION

SHUTDOWN_TIMEOUT = 30.0  # time for a run to end after Ctrl-C [s]
INTERRUPT = getattr(signal, "CTRL_BREAK_EVENT", signal.SIGINT)  # Windows sends no SIGINT to a group of processes
KILL = getattr(signal, "SIGKILL", signal.SIGTERM)  # Windows has no SIGKILL
SIGNAL_CODES = {128 + number for number in SIGNALS}  # exit codes of a command stopped from elsewhere
MESSAGE_PREFIX = "taichi-mps: "  # beginning of messages of the program


@dataclass(eq=False)
class Job:
    """One command: ``words`` after ``taichi-mps``; for a run also the ``scene`` and its expected seconds, ``about``;
    for a list the file of its results, ``out``. One that is ``short`` waits for no other."""

    title: str
    words: list[str]
    scene: str = ""
    about: float | None = None
    out: Path | None = None
    short: bool = False
    state: str = "waiting"  # then running; at the end done, stopped or failed
    folder: RunFolder | None = None
    began: float = field(default_factory=time.monotonic)  # time of the request, then of its start
    message: str = ""  # messages of the program on stderr, after its end
    output: str = ""  # stdout, after its end
    stopping: bool = False
    process: asyncio.subprocess.Process | None = None
    task: asyncio.Task | None = None

    @property
    def spent(self) -> float:
        """Seconds since the start, or since the request of a job that waits."""
        return time.monotonic() - self.began

    @property
    def finished(self) -> bool:
        """Whether the job has finished or was cancelled."""
        return self.state not in ("waiting", "running")

    def stop(self, at_once: bool = False) -> None:
        """Cancel a job that waits; let one that runs finish its step and its folder, as Ctrl-C does, or end it
        ``at_once``, as at its last checkpoint."""
        if self.state == "waiting":
            self.state = "stopped"
        if at_once:
            self.send(KILL)
        elif not self.stopping:  # a second signal would end it before its folder is whole
            self.send(INTERRUPT)
        self.stopping = True

    def send(self, number) -> None:
        """Send a signal to the process of the job, if there is one."""
        with suppress(ProcessLookupError):  # it has just ended
            if self.process and self.process.returncode is None:
                self.process.send_signal(number)


class Queue:
    """Queue of jobs, executed one at a time in the order of their requests, short ones at once; shared by all
    pages."""

    def __init__(self, folder):
        self.folder = user_path(folder)
        self.jobs: list[Job] = []
        self.run_lock = asyncio.Lock()  # held by the job that runs

    def add(self, job: Job) -> Job:
        """Append a job, which starts when its turn comes."""
        self.jobs.append(job)
        job.task = asyncio.create_task(self.execute(job))
        return job

    async def execute(self, job: Job) -> None:
        """Wait for the turn of a job and execute it, unless it was stopped before; a run is written into the next free
        folder of its scene."""
        async with nullcontext() if job.short else self.run_lock:
            if job.finished:
                return
            job.state, job.began, words = "running", time.monotonic(), job.words
            if job.scene:
                job.folder = RunFolder(next_free(self.folder / job.scene))
                words = [*words, f"--out={job.folder.path}"]
            try:  # Ctrl-C in the terminal of the server reaches it once, by the server
                job.process = await asyncio.create_subprocess_exec(
                    *(sys.executable, "-m", "taichi_mps", *words),
                    stdin=DEVNULL,
                    stdout=PIPE,
                    stderr=PIPE,
                    **OWN_SESSION,
                )
            except (OSError, ValueError) as error:  # no process more, no memory; a word that no program can get
                job.state, job.message = "failed", str(error)
                return
            if job.stopping:  # was asked for while the process was made
                job.send(INTERRUPT)
            job.output, lines = (text.decode("utf-8", "replace").strip() for text in await job.process.communicate())
            job.message = "\n".join(
                line[len(MESSAGE_PREFIX) :] for line in lines.splitlines() if line.startswith(MESSAGE_PREFIX)
            )
            code = job.process.returncode
            job.state = "done" if code == 0 else "stopped" if job.stopping or code in SIGNAL_CODES else "failed"

    async def close(self) -> None:
        """Stop all jobs, and wait for the end of their processes."""
        for job in self.jobs:
            job.stop()
        if self.jobs:
            await asyncio.wait([job.task for job in self.jobs], timeout=SHUTDOWN_TIMEOUT)

    def kill(self) -> None:
        """Kill the processes that are left."""
        for job in self.jobs:
            job.send(KILL)
