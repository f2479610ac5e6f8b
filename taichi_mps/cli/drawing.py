"""Pictures of a run, drawn from its run.h5: by a second process while the run goes on, and what is missing at its
end."""

import sys
from concurrent.futures import BrokenExecutor, ProcessPoolExecutor
from contextlib import suppress
from multiprocessing import get_context

from ..io.vtkhdf import Trajectory
from .stopped import handle, program_start

SIZE = {"width": 640, "height": 360}  # of the pictures of a run [pixels], half of those of 'render'


class Drawing:
    """Pictures and animation of a run.

    A context around a run. On Linux the program ``taichi-mps`` forks a second process before Taichi starts, which draws
    each output while the run goes on. Outputs that it has not drawn are drawn by this process at the end, as are all of
    them elsewhere. The options turn ``pictures`` off.
    """

    def __init__(self, folder, options, scene=None, scene_file=None):
        self.folder, self.options, self.scene, self.scene_file = folder, options, scene, scene_file
        self.trajectory, self.painter, self.second = Trajectory(folder.trajectory), None, None

    def __enter__(self):
        if self.options.pictures and sys.platform == "linux" and program_start:
            self.second = ProcessPoolExecutor(1, get_context("fork"), begin, (self,))
            self.second.submit(int)  # forks it
        return self

    def __exit__(self, *_):
        if self.second:
            self.second.shutdown(cancel_futures=True)

    def submit(self, last=False):
        """Let the second process draw outputs, up to the ``last`` one or not yet. Its future; None without one."""
        with suppress(BrokenExecutor):
            return self.second and self.second.submit(draw_in_second, last)

    def finish(self, drawn) -> None:
        """Wait for the future of the last output; draw here where it has failed or is none."""
        if not drawn or drawn.exception():
            self.draw(last=True)
        self.__exit__()  # now, so that its processor time counts

    def draw(self, last: bool) -> None:
        """Draw the outputs that have no picture, and after the ``last`` one the animation, if there is none."""
        from ..viz.film import SideBySide
        from ..viz.render import gif

        times, there = self.trajectory.times(), {path.name for path in self.folder.pictures}
        missing = [k for k in range(len(times)) if f"frame_{k:05d}.png" not in there]
        for number, frame in zip(missing, self.trajectory.replay(self.scene_file, self.scene, missing), strict=False):
            self.scene = frame.scene
            self.painter = self.painter or SideBySide([frame.scene], self.folder.frames, self.options, **SIZE)
            self.painter.draw(number, frame)
        if last and not self.folder.animation.is_file():
            gif(self.folder.pictures, self.folder.animation, every=times[-1] / max(len(times) - 1, 1))


def begin(drawing: Drawing) -> None:
    """Begin as the second process of a drawing, which signals do not end: the run decides."""
    from ..study.sweep import end_with_parent

    handle(lambda *_: None)
    end_with_parent()
    draw_in_second.drawing = drawing


def draw_in_second(last: bool) -> None:
    """Draw in the second process."""
    draw_in_second.drawing.draw(last)
