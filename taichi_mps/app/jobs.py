"""Commands that were asked for on a page, each a child process of the command line, one after the other.

So Taichi is never started in the server, a run is stopped as on a terminal, and its folder is an ordinary one.
"""

import asyncio
import signal
import sys
from dataclasses import dataclass, field
from pathlib import Path

from ..io.history import newest
from ..io.run_folder import RunFolder, next_free

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
    process: asyncio.subprocess.Process | None = field(default=None, repr=False)

    @property
    def over(self) -> bool:
        """Will it never run again?"""
        return self.state not in ("waiting", "running")

    def progress(self) -> dict[str, float]:
        """The newest row of the run's history.csv, nothing before its first step."""
        return newest(self.folder.history) if self.folder else {}

    def stop(self) -> None:
        """Leave it out if it waits; if it runs, let it finish its step and its folder, as Ctrl-C does."""
        if self.state == "waiting":
            self.state = "stopped"
        if self.state == "running" and self.process and not self.stopping:  # a second signal would end it at once
            self._interrupt()
        self.stopping = True

    def _interrupt(self):
        if self.process.returncode is None:
            self.process.send_signal(signal.SIGINT)

    async def carry_out(self, folder: Path) -> None:
        """Run to the end; a run goes into the next free folder of its scene in ``folder``."""
        self.state, words = "running", self.words
        if self.scene:
            self.folder = RunFolder(next_free(folder / self.scene))
            words = [*words, "--out", str(self.folder.path)]
        pipes = {"stdin": asyncio.subprocess.DEVNULL} | dict.fromkeys(("stdout", "stderr"), asyncio.subprocess.PIPE)
        self.process = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "taichi_mps", *words, **pipes, start_new_session=True
        )  # a session of its own: Ctrl-C in the terminal of the server reaches it once, by the server
        if self.stopping:  # was asked for while the process was made
            self._interrupt()
        output, said = await self.process.communicate()
        self.output, lines = (text.decode("utf-8", "replace").strip() for text in (output, said))
        self.said = "\n".join(line[len(NAME) :] for line in lines.splitlines() if line.startswith(NAME))
        code = self.process.returncode
        self.state = "done" if code == 0 else "stopped" if self.stopping or code in BY_SIGNAL else "failed"


class Queue:
    """Jobs one at a time, in the order in which they came; shared by all pages."""

    def __init__(self, folder):
        self.folder = Path(folder)
        self.jobs: list[Job] = []
        self._worker: asyncio.Task | None = None

    @property
    def open(self) -> list[Job]:
        """Those that run or wait."""
        return [job for job in self.jobs if not job.over]

    def add(self, job: Job) -> Job:
        """Put it at the end, and start it when its turn comes."""
        self.jobs.append(job)
        if self._worker is None or self._worker.done():
            self._worker = asyncio.create_task(self._work())
        return job

    async def _work(self):
        while waiting := [job for job in self.jobs if job.state == "waiting"]:
            try:
                await waiting[0].carry_out(self.folder)
            except OSError as error:  # no process more, no memory
                waiting[0].state, waiting[0].said = "failed", str(error)

    async def close(self) -> None:
        """Stop all, and wait until their processes are gone."""
        for job in reversed(self.jobs):  # those that wait first, so that none of them starts
            job.stop()
        if self._worker:
            await asyncio.wait([self._worker], timeout=PATIENCE)
        self.kill()

    def kill(self) -> None:
        """End what is left at once."""
        for job in self.jobs:
            if job.process and job.process.returncode is None:
                job.process.kill()


def as_options(values: dict) -> list[str]:
    """Values of a form as options of the command line; switches are those that differ from their default."""
    flags = {name: name.replace("_", "-") for name in values}
    switch = {True: "--{}", False: "--no-{}"}
    return [
        switch[value].format(flags[name]) if isinstance(value, bool) else f"--{flags[name]}={value}"
        for name, value in values.items()
    ]
