"""The painter of triangles: the picture of a closed mesh and its shadow on a floor, in NumPy, which compiles nothing.

Light falls on the points of the mesh and is interpolated between them; triangles are painted back to front. Light and
floor look as those of the spheres (`splatter`).
"""

import numpy as np
from PIL import Image, ImageFilter

from .camera import PAPER, SKY_TEXELS, SUN, SUN_TEXELS, Camera

FAR = 1e9  # depth where there is nothing
TAPS = 5  # texels of a shadow map, along a side, over which a light is averaged


def expand(first, lengths):
    """Of runs of whole numbers, of these first ones and lengths: the run of each number, and the numbers in turn."""
    run = np.repeat(np.arange(len(lengths)), lengths)
    return run, np.arange(len(run)) + np.repeat(first - np.cumsum(lengths) + lengths, lengths)


def paint(points, triangles, width, height):
    """Row of the nearest of triangles (m, 3) at the middle of each pixel, (height, width), -1 where there is none.

    points (n, 3): column, row, depth. Triangles that share an edge have no pixel between them and none in common. What
    reaches behind the eye is left out; triangles that pass through each other are not told apart.
    """
    picture = np.full(height * width, -1, np.int32)
    seen = np.flatnonzero(points[triangles, 2].min(1, initial=FAR) > 1e-6)
    seen = seen[np.argsort(-points[triangles[seen], 2].sum(1), kind="stable")]  # back to front: the nearest comes last
    corners = points[triangles[seen], :2]
    corners = np.take_along_axis(corners, np.argsort(corners[..., 1:], axis=1), 1)  # from top to bottom
    (ax, ay), (bx, by), (cx, cy) = corners.transpose(1, 2, 0)
    first, last = (np.clip(np.ceil(y - 0.5), 0, height).astype(np.int64) for y in (ay, cy))
    which, row = expand(first, last - first)
    y, upper = row + 0.5, row + 0.5 < by[which]
    across = []
    for px, py, qx, qy in (
        (ax[which], ay[which], cx[which], cy[which]),
        tuple(np.where(upper, p[which], q[which]) for p, q in ((ax, bx), (ay, by), (bx, cx), (by, cy))),
    ):
        across.append(px + (y - py) * ((qx - px) / (qy - py)))
    left, right = np.clip(np.ceil(np.sort(across, axis=0) - 0.5), 0, width).astype(np.int64)
    run, pixel = expand(row * width + left, right - left)
    picture[pixel] = seen[which][run]
    return picture.reshape(height, width)


def across(points, values, triangles, which, column, row):
    """Values (k, c) f32 at places in triangles of these rows (k,), between those (n, c) of their points: linear in the
    picture."""
    a, b, c = (points[triangles[:, k], :2] for k in range(3))
    first, second = b - a, c - a
    area = (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])[:, None]
    area[area == 0.0] = 1.0  # of what no pixel is in
    start, there, beyond = (values[triangles[:, k]] for k in range(3))
    there, beyond = (there - start) / area, (beyond - start) / area
    to_right = there * second[:, 1:] - beyond * first[:, 1:]
    down = beyond * first[:, :1] - there * second[:, :1]
    start = start - to_right * a[:, :1] - down * a[:, 1:]
    start, to_right, down = (v.astype(np.float32)[which] for v in (start, to_right, down))
    return start + to_right * column.astype(np.float32)[:, None] + down * row.astype(np.float32)[:, None]


class Lamp:
    """A light with its shadow map, of ``texels`` along a side; floor: its height over the eye of the picture [m]."""

    def __init__(self, camera, eye, ray, floor, texels):
        self.camera, self.texels = camera, texels
        self.matrix = camera.matrix(eye)
        self.depth = np.full((texels, texels), FAR)
        self.of_pixel = (floor * self.matrix[:, :3] + np.outer(self.matrix[:, 3], (0, 0, 1))) @ ray
        column, row = np.meshgrid(np.arange(texels) + 0.5, np.arange(texels) + 0.5)
        texel = np.stack([column.ravel(), row.ravel(), np.ones(texels**2)])
        down, start = (np.linalg.solve(self.matrix[:, :3], v)[2] for v in (texel, self.matrix[:, 3]))
        self.floor = ((floor + start) / np.where(down < 0.0, down, -1e-30)).reshape(texels, texels)  # its depth there

    def places(self, points):
        """Column, row and depth (n, 3) in the shadow map of points (n, 3) from the eye."""
        q = points @ self.matrix[:, :3].T + self.matrix[:, 3]
        return np.column_stack([q[:, :2] / q[:, 2:], q[:, 2]])

    def fall(self, points, triangles):
        """Light a mesh."""
        places = self.places(points)
        hit = paint(places, triangles, self.texels, self.texels)
        self.depth = np.where(hit < 0, FAR, places[triangles, 2].mean(1)[hit])
        return places

    def light(self, places, bias):
        """Fraction of the light (n,) that reaches places in the shadow map; bias: depth of a soft edge [m]."""
        u, v = places[:, 0] - 0.5 * TAPS, places[:, 1] - 0.5 * TAPS
        j, i = np.floor(u).astype(int), np.floor(v).astype(int)
        inside = (i >= 0) & (j >= 0) & (i + TAPS < self.texels) & (j + TAPS < self.texels)
        i, j = np.where(inside, i, 0), np.where(inside, j, 0)
        taps = np.arange(TAPS + 1)
        near = self.depth.ravel()[((i[:, None] + taps) * self.texels + j[:, None])[:, :, None] + taps]
        behind = np.clip((places[:, 2, None, None] - near) / bias - 1.0, 0.0, 1.0)
        weights = []
        for start in (v - i, u - j):
            weight = np.ones((len(start), TAPS + 1))
            weight[:, 0], weight[:, TAPS] = 1.0 - start, start
            weights.append(weight)
        blocked = np.einsum("na,nb,nab->n", *weights, behind) / TAPS**2
        return np.where(inside, 1.0 - blocked, 1.0)

    def shadow(self, bias):
        """What is blocked of the light on the floor, as a picture of the shadow map."""
        blocked = np.clip((self.floor - self.depth) / bias - 1.0, 0.0, 1.0)
        return Image.fromarray((255.0 * blocked + 0.5).astype(np.uint8)).filter(ImageFilter.BoxBlur(TAPS // 2))

    def on_floor(self, shadow, box):
        """Fraction of the light on the floor in a box of the picture (left, top, right, bottom)."""
        left, top, right, bottom = box
        h = self.of_pixel @ np.array([[1.0, 0.0, left], [0.0, 1.0, top], [0.0, 0.0, 1.0]])
        h = (h / h[2, 2]).ravel()[:8]
        how = Image.Transform.PERSPECTIVE, h, Image.Resampling.BILINEAR
        return 1.0 - np.asarray(shadow.transform((right - left, bottom - top), *how)) / 255.0

    def outline(self, shadow):
        """Corners (4, 2) in the picture of the rectangle of the shadow map that holds the shadow; none of an empty
        one."""
        box = shadow.getbbox()
        if box is None:
            return np.zeros((0, 2))
        corners = np.array([(x, y, 1.0) for x in (box[0] - 1, box[2] + 1) for y in (box[1] - 1, box[3] + 1)])
        at = np.linalg.solve(self.of_pixel, corners.T)
        return (at[:2] / at[2]).T


class Facets:
    """The picture of a mesh of triangles shaded by the normals of its points, its shadow, and the floor at height
    ``floor`` [m] (None: there is none) with lines every ``grid`` [m]; arguments as those of `splatter.Splatter`."""

    name = "software"

    def __init__(self, camera, points, radius, floor=None, grid=0.05, samples=2):
        self.camera, self.radius, self.samples = camera, radius, samples
        self.ray = camera.axes.T @ np.linalg.inv(camera.matrix(camera.eye)[:, :3] @ camera.axes.T)
        level = 0.0 if floor is None else floor - camera.eye[2]
        self.has_floor = level < 0.0
        lamps = (Camera(SUN @ camera.axes, points, SUN_TEXELS, SUN_TEXELS), SUN_TEXELS)
        lamps = lamps, (Camera((0.0, 0.0, -1.0), points, SKY_TEXELS, SKY_TEXELS), SKY_TEXELS)
        self.lamps = [Lamp(lamp, camera.eye, self.ray, level, texels) for lamp, texels in lamps]
        self._paper(level, grid, 0.5 * np.ptp(points[:, 0]))

    def _paper(self, level, grid, reach):
        """The empty picture: lines on the floor, which fades into the paper far away."""
        height, width = self.camera.height, self.camera.width
        self.lit, self.far = np.ones((2, height, width), np.float32)
        if self.has_floor:
            column, row = np.arange(width, dtype=np.float32) + 0.5, np.arange(height, dtype=np.float32)[:, None] + 0.5
            ray = self.ray.astype(np.float32)
            d = [ray[k, 1] * row + ray[k, 2] for k in range(3)]  # of a row of the picture, the same in all its columns
            d = [d[k] + ray[k, 0] * column if ray[k, 0] else d[k] for k in range(3)]  # but for this
            down = d[2] < -1e-4
            t = np.float32(level) / np.where(down, d[2], np.float32(-1.0))
            x, y = (t * d[k] + np.float32(self.camera.eye[k]) for k in (0, 1))
            pixel = t * abs(self.ray[0, 0])
            lines = np.maximum(line(x, np.float32(grid), pixel), line(y, np.float32(grid), pixel * t / -level))
            away = np.hypot(x - self.camera.middle[0], y - self.camera.middle[1]) / reach
            away = np.clip((away - 0.8) / 1.6, 0.0, 1.0)
            self.far = np.where(down, away**2 * (3.0 - 2.0 * away), 1.0)
            self.lit = 0.93 * (1.0 - lines)
        self.paper = bytes_of(self._floor((0, 0, width, height), np.float32(1.0)))

    def _floor(self, box, light):
        left, top, right, bottom = box
        lit = self.lit[top:bottom, left:right] * light
        return (lit + (1.0 - lit) * self.far[top:bottom, left:right])[..., None] * np.float32(PAPER)

    def _box(self, places):
        """Left, top, right, bottom of the part of the picture that holds places (n, 2), at most all of it."""
        size = self.camera.width, self.camera.height
        low, high = np.floor(places.min(0)), np.ceil(places.max(0))
        return [int(edge) for edge in (*np.clip(low, 0, size), *np.clip(high, 0, size))]

    def draw(self, x, colours, relief=1.0, normals=None, triangles=None):
        """Picture (h, w, 3) uint8 and depth (h, w) of triangles (m, 3) between points x (n, 3) [m], which have
        colours and outward unit normals (n, 3)."""
        picture = self.paper.copy()
        depth = np.full(picture.shape[:2], FAR, np.float32)
        if len(triangles):
            places = [lamp.fall(x - self.camera.eye, triangles) for lamp in self.lamps]
            self._shadows(picture)
            self._body(picture, depth, x, *self._shaded(x, triangles, colours, normals, relief, places))
        return picture, depth

    def _shaded(self, x, triangles, colours, normals, relief, places):
        """The triangles that may be seen, and the colours of the points in the light, of these places in its maps."""
        ahead = x - self.camera.eye
        facing = -(normals * ahead).sum(1) / np.linalg.norm(ahead, axis=1)
        triangles = triangles[facing[triangles].max(1) > 0.0]
        seen = np.unique(triangles)
        sun, sky = (lamp.light(at[seen], 2.5 * self.radius) for lamp, at in zip(self.lamps, places, strict=True))
        n, facing = normals[seen], np.maximum(0.0, facing[seen])
        ambient = (0.5 + 0.14 * n[:, 2]) * (0.6 + 0.4 * sky) * (0.6 + 0.4 * facing)
        direct = 0.72 * sun * np.maximum(0.0, -n @ self.lamps[0].camera.axes[2])
        shaded = np.zeros((len(x), 3))
        shaded[seen] = colours[seen] * (1.0 - relief + relief * (ambient + direct))[:, None]
        return triangles, shaded

    def _shadows(self, picture):
        """Darken the floor."""
        if not self.has_floor:
            return
        shadows = [lamp.shadow(1.5 * self.radius) for lamp in self.lamps]
        corners = np.vstack([lamp.outline(shadow) for lamp, shadow in zip(self.lamps, shadows, strict=True)])
        if not len(corners):
            return
        box = left, top, right, bottom = self._box(corners)
        if right > left and bottom > top:
            sun, sky = (lamp.on_floor(shadow, box) for lamp, shadow in zip(self.lamps, shadows, strict=True))
            picture[top:bottom, left:right] = bytes_of(self._floor(box, (0.62 + 0.38 * sun) * (0.62 + 0.38 * sky)))

    def _body(self, picture, depth, x, triangles, colours):
        """Lay the mesh over the picture, as far as it covers s x s samples of each pixel."""
        s, points = self.samples, self.camera.project(x)
        left, top, right, bottom = self._box(points[:, :2])
        if right == left or bottom == top:
            return
        points = (points - (left, top, 0.0)) * (s, s, 1.0)
        hits = paint(points, triangles, s * (right - left), s * (bottom - top))
        hits = np.stack([hits[a::s, b::s] for a in range(s) for b in range(s)])
        covered = (hits >= 0).mean(0, dtype=np.float32)
        i, j = np.nonzero(covered)
        chosen = hits[:, i, j].argmax(0)  # of the samples of a pixel the one that is shaded
        hit = hits[chosen, i, j]
        shown = np.column_stack([colours, points[:, 2]])
        shown = across(points, shown, triangles, hit, s * j + chosen % s + 0.5, s * i + chosen // s + 0.5)
        part, share = picture[top:bottom, left:right], covered[i, j, None]
        part[i, j] = bytes_of(part[i, j] * ((1.0 - share) / np.float32(255.0)) + shown[:, :3] * share)
        depth[top:bottom, left:right][i, j] = shown[:, 3]


def bytes_of(colours):
    """Colours of at least 0 as uint8, 255 from 1 on."""
    return (np.minimum(colours, 1.0) * np.float32(255.0) + np.float32(0.5)).astype(np.uint8)


def line(x, step, pixel):
    """Darkness of lines at multiples of step, every second one bolder, where a pixel covers ``pixel`` [m]."""
    nearest = np.round(x / step)
    bold = 1.0 - abs(nearest - 2.0 * np.round(0.5 * nearest))
    cover = np.clip(1.0 + 0.2 * bold - abs(x - step * nearest) / pixel, 0.0, 1.0)
    return (0.05 + 0.06 * bold) * cover * np.minimum(1.0, 0.1 * step / pixel)
