"""Commands that were asked for on a page, each a child process of the command line, one after the other.

So Taichi is never started in the server, a run is stopped as on a terminal, and its folder is an ordinary one.
"""

import asyncio
import signal
import sys
from asyncio.subprocess import DEVNULL, PIPE
from dataclasses import dataclass

from ..io.run_folder import RunFolder, next_free
from ..units import user_path

PATIENCE = 10.0  # [s] for a run to end well after Ctrl-C
BY_SIGNAL = 128 + signal.SIGINT, 128 + signal.SIGTERM  # what a command returns that somebody else stopped
NAME = "taichi-mps: "  # with which the program begins what it says


@dataclass(eq=False)
class Job:
    """One command: ``words`` after ``taichi-mps``; of a run also the ``scene`` and its end ``until`` [s]."""

    title: str
    words: list[str]
    scene: str = ""
    until: float = 0.0
    state: str = "waiting"  # then running; at the end done, stopped or failed
    folder: RunFolder | None = None
    said: str = ""  # on stderr, at the end, the lines of the program alone
    output: str = ""  # on stdout, at the end
    stopping: bool = False
    process: asyncio.subprocess.Process | None = None
    task: asyncio.Task | None = None

    @property
    def over(self) -> bool:
        """Whether the job has finished or was cancelled."""
        return self.state not in ("waiting", "running")

    def stop(self) -> None:
        """Leave it out if it waits; if it runs, let it finish its step and its folder, as Ctrl-C does."""
        if self.state == "waiting":
            self.state = "stopped"
        if not self.stopping:  # a second signal would end it at once
            self.send(signal.SIGINT)
        self.stopping = True

    def send(self, number) -> None:
        """Send a signal to the process, if there is one."""
        if self.process and self.process.returncode is None:
            self.process.send_signal(number)


class Queue:
    """Jobs one at a time, in the order in which they came; shared by all pages."""

    def __init__(self, folder):
        self.folder = user_path(folder)
        self.jobs: list[Job] = []
        self.turn = asyncio.Lock()  # of the job that runs; others get it in their order

    def add(self, job: Job) -> Job:
        """Put it at the end, and start it when its turn comes."""
        self.jobs.append(job)
        job.task = asyncio.create_task(self.carry_out(job))
        return job

    async def carry_out(self, job: Job) -> None:
        """Wait for the turn of a job and run it to the end, unless it was stopped before; a run goes into the next free
        folder of its scene."""
        async with self.turn:
            if job.over:
                return
            job.state, words = "running", job.words
            if job.scene:
                job.folder = RunFolder(next_free(self.folder / job.scene))
                words = [*words, f"--out={job.folder.path}"]
            words = sys.executable, "-m", "taichi_mps", *words
            try:  # in a session of its own: Ctrl-C in the terminal of the server reaches it once, by the server
                job.process = await asyncio.create_subprocess_exec(
                    *words, stdin=DEVNULL, stdout=PIPE, stderr=PIPE, start_new_session=True
                )
            except OSError as error:  # no process more, no memory
                job.state, job.said = "failed", str(error)
                return
            if job.stopping:  # was asked for while the process was made
                job.send(signal.SIGINT)
            job.output, lines = (text.decode("utf-8", "replace").strip() for text in await job.process.communicate())
            job.said = "\n".join(line[len(NAME) :] for line in lines.splitlines() if line.startswith(NAME))
            code = job.process.returncode
            job.state = "done" if code == 0 else "stopped" if job.stopping or code in BY_SIGNAL else "failed"

    async def close(self) -> None:
        """Stop all, and wait until their processes are gone."""
        for job in self.jobs:
            job.stop()
        if self.jobs:
            await asyncio.wait([job.task for job in self.jobs], timeout=PATIENCE)

    def kill(self) -> None:
        """End what is left at once."""
        for job in self.jobs:
            job.send(getattr(signal, "SIGKILL", signal.SIGTERM))  # Windows has no SIGKILL
