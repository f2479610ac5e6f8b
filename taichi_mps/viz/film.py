"""Films of finished runs, and several runs side by side."""

from pathlib import Path

import numpy as np
from PIL import Image

from .overlay import with_film_speed
from .render import Renderer, save


def align_in_time(*replays):
    """Yield tuples of outputs of several runs, one for each output time of any run: the last output of each run up to
    then."""
    upcoming = [next(replay, None) for replay in replays]
    now = list(upcoming)
    while any(upcoming):
        time = min(output.time for output in upcoming if output)
        for k, output in enumerate(upcoming):
            if output and output.time <= time + 1e-9:
                now[k], upcoming[k] = output, next(replays[k], None)
        yield tuple(now)


class SideBySide:
    """Draws one output of each run, left to right, with the same camera and the same range of colours, as numbered
    pictures in the folder ``frames``. ``options``: view, beads, cut; ``size``: width and height of each [pixels]."""

    def __init__(self, scenes, frames, options, **size):
        how = {"view": options.view, "beads": options.beads, "cut": options.cut, "beside": scenes} | size
        self.frames, self.painters = frames, [Renderer(scene, **how) for scene in scenes]

    def draw(self, number: int, *outputs) -> Path:
        """Write frame_<number>.png; its path."""
        path, pairs = self.frames / f"frame_{number:05d}.png", zip(self.painters, outputs, strict=True)
        self.frames.mkdir(parents=True, exist_ok=True)
        save(np.hstack([painter.draw(output.snapshot(), output.measures()) for painter, output in pairs]), path)
        return path


def mp4(pictures, out, fps: float = 10.0, every: float | None = None) -> Path:
    """Write a film (H.264) of a list of picture files by imageio-ffmpeg (extra ``film``); with ``every`` [s], the time
    between two pictures, its speed is written into it."""
    import imageio.v2 as iio

    with iio.get_writer(out, fps=fps, codec="libx264", quality=8, macro_block_size=16) as film:
        for path in pictures:
            with Image.open(path) as picture:
                film.append_data(np.asarray(with_film_speed(picture.convert("RGB"), every, fps)))
    return out
