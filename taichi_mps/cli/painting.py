"""Pictures of a run: drawn at once, or by a process of their own while the flow is computed."""

import multiprocessing
import signal
import time
from concurrent.futures import BrokenExecutor, ProcessPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path

from ..io.run_folder import PICTURE
from ..io.vtkhdf import Trajectory
from ..simulation.frame import Frame
from ..study.sweep import live_with_the_parent

MOST_WAITING = 16  # outputs that wait to be drawn; then the flow waits


class Painter:
    """Draws frame_<number>.png of runs of these scenes side by side, as the options ask. ``seconds``: processor time
    of another process, ``left``: wall time of the pictures that wait [s]."""

    seconds = left = 0.0

    def __init__(self, frames, options, scenes):
        self.frames, self.options, self.scenes, self.painter = frames, options, scenes, None

    def draw(self, number: int, *outputs) -> Path:
        """Write the picture of a Simulation, or of one output of each run; its path."""
        from ..viz.film import SideBySide
        from ..viz.render import save

        path, options = self.frames / PICTURE.format(number), self.options
        if not self.painter:
            self.painter = SideBySide(self.scenes, view=options.view, backend=options.renderer, beads=options.beads)
        self.frames.mkdir(parents=True, exist_ok=True)
        save(self.painter.draw(outputs), path)
        return path

    def film(self, folder) -> None:
        """Write the animation of a run folder, at the end of its run."""
        from ..viz.render import gif

        if folder.pictures:
            gif(folder.pictures, folder.animation, every=Trajectory(folder.trajectory).origin()[2])

    def finish(self) -> None:
        """All is drawn."""

    close = finish


class Apart(Painter):
    """Painter in a process forked off, which ends with this one; what it has not drawn by then ``resume`` draws."""

    def __init__(self, frames, options, scene):
        super().__init__(frames, options, [scene])
        self.pool = ProcessPoolExecutor(1, multiprocessing.get_context("fork"), _begin, (frames, options, scene))
        self.jobs, self.begun = [self.pool.submit(time.process_time)], time.monotonic()

    @property
    def left(self) -> float:
        """Wall time of the pictures that wait [s]."""
        waiting = sum(not job.done() for job in self.jobs)
        return waiting * (time.monotonic() - self.begun) / (1 + len(self.jobs) - waiting)

    def draw(self, number: int, output) -> None:
        """Have the picture of an output of the run drawn."""
        for job in self.jobs[-MOST_WAITING:][:1]:
            self._result(job)
        self.jobs.append(self.pool.submit(_draw, number, output.snapshot()))

    def film(self, folder) -> None:
        """Have the animation written."""
        self.jobs.append(self.pool.submit(_film, folder))

    def _result(self, job) -> float:
        try:
            return job.result()
        except BrokenExecutor:
            raise OSError("the process that draws the pictures was ended") from None

    def finish(self) -> None:
        """Wait until all is drawn; raise what went wrong there."""
        self.seconds = [self._result(job) for job in self.jobs][-1]

    def close(self) -> None:
        """End it, after the picture that it draws now."""
        self.pool.shutdown(cancel_futures=True)


# ---- in the other process --------------------------------------------------------------------------------------
def _begin(frames, options, scene) -> None:
    global _painter
    _painter = Painter(frames, options, [scene])
    live_with_the_parent()
    signal.signal(signal.SIGTERM, signal.SIG_IGN)  # the other's to answer


def _draw(number: int, state) -> float:
    _painter.draw(number, Frame(_painter.scenes[0], state))
    return time.process_time()


def _film(folder) -> float:
    _painter.film(folder)
    return time.process_time()


@contextmanager
def painting(frames, options, scene, apart: bool):
    """What draws the pictures of a run, in a process of its own or not."""
    painter = Painter(frames, options, [scene])
    if apart:
        with suppress(OSError, ImportError, NotImplementedError):  # no process more, or no semaphores
            painter = Apart(frames, options, scene)
    try:
        yield painter
    finally:
        painter.close()
