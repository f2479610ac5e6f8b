"""Overlay on the picture of a body: glass, walls, outlines, rulers and dimensions, by Pillow."""

from functools import cache

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from ..engine import embed
from .painter import BACKGROUND

INK, FAINT, MOULD, GLASS = (38, 42, 48), (112, 118, 126), (196, 62, 38), (96, 150, 176)  # colours (RGB)
GLASS_OPACITY = 0.15  # of a pane [-]
DASH = 2, 3  # parts of a dashed line that are drawn, and parts of its period


class Overlay:
    """Draws on an image of a body with these depths (h, w) [m], by the projection of the camera."""

    def __init__(self, image, depth, camera):
        self.image, self.depth, self.camera, self.pen = image, depth, camera, ImageDraw.Draw(image)
        self.unit = camera.height / 720

    def pane(self, face) -> None:
        """Draw a plane face (k, 3) [m] of glass where no body is in front of it."""
        corners = self.camera.project(face)[:, :2]
        (left, top), (right, bottom) = np.clip([corners.min(0), corners.max(0) + 1], 0, self.image.size).astype(int)
        normal = np.cross(face[1] - face[0], face[2] - face[1])
        rays = self.camera.rays(*np.meshgrid(np.arange(left, right) + 0.5, np.arange(top, bottom) + 0.5)) @ normal
        if rays.size and normal.any():
            mask = Image.new("L", (right - left, bottom - top))
            ImageDraw.Draw(mask).polygon([tuple(corner) for corner in corners - (left, top)], fill=1)
            with np.errstate(divide="ignore"):
                away = (face[0] - self.camera.eye) @ normal / rays
            seen = np.asarray(mask, bool) & (away < self.depth[top:bottom, left:right])
            self.image.paste(GLASS, (left, top), Image.fromarray((255 * GLASS_OPACITY * seen).astype(np.uint8)))

    def lines(self, lines, colour, dashed=False) -> None:
        """Draw polylines (k, d) [m] where the body does not hide them, anti-aliased by drawing at twice the size."""
        mask = Image.new("L", (2 * self.image.width, 2 * self.image.height))
        pen, width = ImageDraw.Draw(mask), max(2, round(self.image.height / 240))
        drawn, of = DASH if dashed else (1, 1)
        for line in lines:
            corner = self.camera.project(embed(np.asarray(line, float)))
            length = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(corner[:, :2], axis=0), axis=1)))
            at = np.linspace(0.0, length[-1], 2 + int(length[-1] / (self.image.height / 180)))
            point = np.stack([np.interp(at, length, corner[:, k]) for k in range(3)], -1)
            j, i = np.clip(point[:, :2].astype(int), 0, np.array(self.image.size) - 1).T
            seen = point[:-1, 2] < self.depth[i, j][:-1] + 0.02 * point[:-1, 2].min()
            for k in np.flatnonzero(seen & (np.arange(len(seen)) % of < drawn)):
                pen.line([tuple(p) for p in 2 * point[k : k + 2, :2]], fill=255, width=width)
        if box := mask.getbbox():
            left, top, right, bottom = (2 * (edge // 2 + k) for edge, k in zip(box, (0, 0, 1, 1), strict=True))
            self.image.paste(colour, (left // 2, top // 2), mask.crop((left, top, right, bottom)).reduce(2))

    def rulers(self, low, high, tick) -> None:
        """Draw rulers in cm in the plane through the axis or the middle of the width: along the floor where no body
        hides it, and upright at its left."""
        corner = np.array([low[0], 0.5 * (low[1] + high[1]), low[2]])
        for axis, zero, side, anchor in ((0, 0.0, (0, 1), "mt"), (2, low[2], (-1, 0), "rm")):
            first, last = (np.array([low[axis], high[axis]]) - zero) / tick
            ticks = np.arange(np.ceil(first - 1e-6), np.floor(last + 1e-6) + 1)
            points = np.tile(corner, (len(ticks), 1))
            points[:, axis] = zero + tick * ticks
            points[:, 0] -= 0.04 * (high[0] - low[0]) * (axis == 2)  # beside what may stand there
            self.lines([points], FAINT)
            at, side, width = self.camera.project(points), self.unit * np.array(side), max(1, round(1.5 * self.unit))
            j, i = np.clip(at[:, :2].astype(int), 0, np.array(self.image.size) - 1).T
            seen = np.flatnonzero((at[:, 2] < self.depth[i, j]) | (low[1] == high[1]))  # none is behind a plane body
            for k, p in zip(ticks[seen].astype(int), at[seen, :2], strict=True):
                self.pen.line([tuple(p), tuple(p + (5 if k % 2 else 9) * side)], fill=FAINT, width=width)
                if k % 2 == 0:
                    self.write(
                        p + 14 * side, f"{100 * tick * k:.4g}" + " cm" * int(k > ticks[-1] - 2), 15, FAINT, anchor
                    )

    def dimensions(self, found) -> None:
        """Draw dimensions from ``view_volume.dimensions`` as arrows with text; horizontal ones below the body, joined
        with their ends."""
        for one in found:
            a, b = np.array([one["a"], one["b"]])
            level = a[2] == b[2]
            ends = self.camera.project([a, b])[:, :2]
            if level:
                below = self.camera.project([(a[0], one["near"], a[2])])[0, 1] + 30 * self.unit
                for p in ends:
                    self.pen.line([tuple(p), (p[0], below + 5 * self.unit)], fill=INK)
                ends[:, 1] = below
            self.arrow(ends)
            middle = ends.mean(0) + (0, 6 * self.unit) if level else ends.mean(0) + (8 * self.unit, 0)
            self.write(middle, one["text"], 17, INK, "mt" if level else "lm", halo=3)

    def arrow(self, ends) -> None:
        """Draw a line between two places (2, 2) [pixels] with an arrow head at either end."""
        self.pen.line([tuple(p) for p in ends], fill=INK, width=max(1, round(1.5 * self.unit)))
        along = (ends[1] - ends[0]) / max(np.linalg.norm(ends[1] - ends[0]), 1e-9) * 10 * self.unit
        across = 0.3 * along[::-1] * (-1, 1)
        for p, way in zip(ends, (along, -along), strict=True):
            self.pen.polygon([tuple(p), tuple(p + way + across), tuple(p + way - across)], fill=INK)

    def write(self, at, text, size=17, colour=INK, anchor="la", halo=0) -> None:
        """Write text, its size in pixels of a picture 720 high; ``halo``: width of the background around it."""
        paper = tuple(int(255 * part) for part in BACKGROUND)
        self.pen.text(
            tuple(at),
            text,
            fill=colour,
            font=font(size * self.unit),
            anchor=anchor,
            stroke_width=round(halo * self.unit),
            stroke_fill=paper,
        )


@cache
def font(size):
    """Load the font that ships with Pillow, at a size [pixels]."""
    return ImageFont.load_default(size)


def with_film_speed(image, every, fps):
    """Write the speed of a film into the lower right corner of one of its images and return it; ``every``: flow time
    between two images [s], without which the image stays as it is; ``fps``: images per second."""
    if every:
        at = 0.98 * image.width, 0.97 * image.height
        ImageDraw.Draw(image).text(
            at, speed_in_words(every * fps), fill=INK, font=font(max(12, image.height / 26)), anchor="rs"
        )
    return image


def speed_in_words(speed: float) -> str:
    """Format the speed of a film relative to the flow in words."""
    words = {1.0: "real time", 0.5: "half speed", 0.25: "quarter speed", 2.0: "double speed"}
    return next((name for value, name in words.items() if abs(speed / value - 1.0) < 0.01), f"{speed:.2g}x speed")
