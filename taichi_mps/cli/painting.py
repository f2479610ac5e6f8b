"""Pictures of a run: drawn at once, or by a process of their own while the flow is computed."""

import multiprocessing
import queue
import signal
import threading
import time
from contextlib import contextmanager, suppress
from pathlib import Path

from ..io.run_folder import PICTURE
from ..io.vtkhdf import Trajectory
from ..simulation.frame import Frame
from .stopped import SIGNALS

MOST_WAITING = 16  # outputs that the other process keeps until it has drawn them; then the flow waits


class Painter:
    """Draws frame_<number>.png of runs of these scenes side by side, as the options ask. ``seconds``: CPU time that
    this took."""

    def __init__(self, frames, options, scenes):
        self.frames, self.options, self.scenes = frames, options, scenes
        self.seconds, self.left, self.painter = 0.0, 0.0, None

    def draw(self, number: int, *outputs) -> Path:
        """Write the picture of a Simulation, or of one output of each run; its path."""
        from ..viz.film import SideBySide
        from ..viz.render import save

        begun, path, options = time.process_time(), self.frames / PICTURE.format(number), self.options
        if not self.painter:
            self.painter = SideBySide(self.scenes, view=options.view, backend=options.renderer, beads=options.beads)
        self.frames.mkdir(parents=True, exist_ok=True)
        save(self.painter.draw(outputs), path)
        self.seconds += time.process_time() - begun
        return path

    def film(self, folder) -> None:
        """Write the animation of a run folder, at the end of its run."""
        from ..viz.render import gif

        begun = time.process_time()
        if folder.pictures:
            gif(folder.pictures, folder.animation, every=Trajectory(folder.trajectory).origin()[2])
        self.seconds += time.process_time() - begun

    def finish(self) -> None:
        """All is drawn."""

    close = finish


class Apart:
    """Painter in a forked process, which draws what it is sent. It ends with this one, whatever ends this one."""

    def __init__(self, frames, options, scene):
        context = multiprocessing.get_context("fork")
        self.sent, self.drawn = 0, context.RawArray("d", 2)  # pictures, and their wall time [s]
        self.seconds, (self.line, line) = 0.0, context.Pipe()
        self.process = context.Process(target=self._work, args=(line, frames, options, scene), daemon=True)
        self.process.start()
        line.close()

    @property
    def left(self) -> float:
        """Wall time [s] of the pictures that wait."""
        number, seconds = self.drawn
        return (self.sent - number) * seconds / max(number, 1.0)

    def draw(self, number: int, output) -> None:
        """Have the picture of an output of the run drawn."""
        self._send(number, output.snapshot())
        self.sent += 1

    def film(self, folder) -> None:
        """Have the animation written."""
        self._send(folder)

    def _send(self, *order) -> None:
        try:
            self.line.send(order)
        except BrokenPipeError:  # it has ended, and said why
            self.finish()

    def finish(self) -> None:
        """Wait until all is drawn; raise what went wrong there."""
        with suppress(BrokenPipeError):
            self.line.send(())
        try:
            self.seconds, error = self.line.recv()
        except (EOFError, OSError):
            error = OSError("the process that draws the pictures was ended")
        if error:
            raise error

    def close(self) -> None:
        """End it, after the picture that it draws now."""
        self.line.close()
        self.process.join()

    def _work(self, line, frames, options, scene) -> None:
        """Draw what comes; what was sent by a process that has gone is left, for ``resume`` draws it again."""
        self.line.close()
        for number in SIGNALS:  # the other's to answer
            signal.signal(number, signal.SIG_IGN)
        orders, gone, error = queue.Queue(MOST_WAITING), threading.Event(), None

        def read():
            try:
                while orders.put(order := line.recv()) or order:
                    pass
            except (EOFError, OSError):
                gone.set()
                orders.put(())

        threading.Thread(target=read, daemon=True).start()
        try:
            painter = Painter(frames, options, [scene])
            while (order := orders.get()) and not gone.is_set():
                begun = time.perf_counter()
                if len(order) == 1:
                    painter.film(*order)
                else:
                    painter.draw(order[0], Frame(scene, order[1]))
                    self.drawn[:] = self.drawn[0] + 1.0, self.drawn[1] + time.perf_counter() - begun
        except Exception as failure:
            error = failure
        if not gone.is_set():
            line.send((time.process_time(), error))


@contextmanager
def painting(frames, options, scene, apart: bool):
    """What draws the pictures of a run, in a process of its own or not."""
    painter = Apart(frames, options, scene) if apart else Painter(frames, options, [scene])
    try:
        yield painter
    finally:
        painter.close()
