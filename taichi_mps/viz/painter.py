"""Software renderer of a body, its shadow and the floor, in NumPy, without compiling.

A body, a Mesh or Beads, finds the nearest of its elements at each pixel and shades it there.
"""

import numpy as np
from PIL import Image, ImageFilter

BACKGROUND = (0.955, 0.96, 0.965)  # background colour
SUN_DIRECTION = np.array((0.45, -0.6, 0.72))  # direction of its light: right, up, away from the eye
TEXELS = 256, 72  # of the sides of the shadow maps of the sun and of the sky
FAR = 1e9  # depth where there is nothing
FILTER = 5  # texels of a shadow map, along a side, over which a light is averaged
SAMPLES_PER_SIDE = 2  # along the sides of a pixel, that find the outline of a body
SHADOW = 720  # texels of a side of a shadow on the floor, drawn out from its map
FLOOR_CELL = 4  # pixels along the side of a place for which the light on the floor is computed


def expand_spans(first, lengths):
    """Expand spans of consecutive integers, given by first numbers and lengths: span of each integer, and the
    integers."""
    span = np.repeat(np.arange(len(lengths)), lengths)
    return span, np.arange(len(span)) + np.repeat(first - np.cumsum(lengths) + lengths, lengths)


def pixels(low, high, size):
    """Range of the pixels whose centres lie between two places of a line of pixels: first pixel and number."""
    first, last = (np.clip(np.ceil(place - 0.5), 0, size).astype(np.int64) for place in (low, high))
    return first, np.maximum(0, last - first)


class Camera:
    """Pinhole camera that looks along ``direction``, from where the given points just fill ``frame`` of its picture.

    frame: left, top, right, bottom as fractions of the picture.
    """

    def __init__(self, direction, points, width, height, frame=(0.05, 0.05, 0.95, 0.95), view_angle=22.0):
        forward = np.asarray(direction, float) / np.linalg.norm(direction)
        right = np.cross(forward, (0, 0, 1) if abs(forward[2]) < 0.99 else (0, 1, 0))
        right /= np.linalg.norm(right)
        self.axes = np.array([right, np.cross(right, forward), forward])  # rows: right, up, forward
        self.width, self.height, self.view_angle = width, height, view_angle
        self.focal = 0.5 * height / np.tan(0.5 * np.radians(view_angle))  # [pixels]
        across, up, ahead = (np.asarray(points, float) @ self.axes.T).T
        left, top, right, bottom = (np.array(frame) - 0.5) * [width, height, width, height] / self.focal
        bounds = [
            (max(across - right * ahead), min(across - left * ahead), right - left),
            (max(up + top * ahead), min(up + bottom * ahead), bottom - top),
        ]
        z = min((low - high) / room for high, low, room in bounds)  # nearest at which both directions fit
        x, y = 0.5 * (sum(bounds[0][:2]) + (right + left) * z), 0.5 * (sum(bounds[1][:2]) - (bottom + top) * z)
        self.eye = np.array([x, y, z]) @ self.axes
        self.middle = np.mean([np.min(points, 0), np.max(points, 0)], 0)

    def camera_coordinates(self, points):
        """Transform world points (n, 3) [m] to camera coordinates: to the right, down, ahead [m]."""
        return (np.asarray(points, float) - self.eye) @ (self.axes * [[1.0], [-1.0], [1.0]]).T

    def project(self, points, scale=1):
        """Project world points (n, 3) [m]: columns, rows (in pixels of 1/scale) and depths [m]."""
        x, y, z = self.camera_coordinates(points).T
        across, down = (0.5 * size + self.focal * a / z for size, a in ((self.width, x), (self.height, y)))
        return np.column_stack([scale * across, scale * down, z])

    def rays(self, columns, rows):
        """World directions (..., 3), of depth 1, through places of the picture."""
        across, down = (columns - 0.5 * self.width) / self.focal, (rows - 0.5 * self.height) / self.focal
        return across[..., None] * self.axes[0] + (self.axes[2] - down[..., None] * self.axes[1])


class Mesh:
    """Triangles (m, 3) between points x (n, 3) [m] with colours and outward unit normals (n, 3). Light falls on the
    points and is interpolated between them."""

    def __init__(self, x, colours, normals, triangles):
        self.x, self.colours, self.normals, self.triangles = x, colours, normals, triangles

    def rasterize(self, camera, scale=1):
        """Pixels (k,) whose centres are covered by triangles, rows of the nearest triangles (k,) and their mean depths
        (k,) [m].

        Painted back to front. Triangles that share an edge have no pixel between them and none in common. Triangles
        that reach behind the eye are left out; intersecting triangles are not resolved.
        """
        height, width = scale * camera.height, scale * camera.width
        picture = np.full(height * width, -1, np.int32)
        points = camera.project(self.x, scale)
        towards = ((self.x - camera.eye) * self.normals).sum(1) < 0.0
        column, row, ahead = points.T
        a, b, c = self.triangles.T
        depth = ahead[a] + ahead[b] + ahead[c]
        behind = ahead <= 1e-6
        shown = (towards[a] | towards[b] | towards[c]) & ~(behind[a] | behind[b] | behind[c])
        shown &= (row[a] != row[b]) | (row[b] != row[c])  # not edge-on
        shown = np.flatnonzero(shown)
        shown = shown[np.argsort(-depth[shown], kind="stable")]
        corners = self.triangles[shown].T
        corners = np.take_along_axis(corners, np.argsort(row[corners], axis=0), 0)  # from top to bottom
        (ax, bx, cx), (ay, by, cy) = column[corners], row[corners]
        which, row = expand_spans(*pixels(ay, cy, height))
        y, upper = row + 0.5, row + 0.5 < by[which]
        px, py, qx, qy = (np.where(upper, p[which], q[which]) for p, q in ((ax, bx), (ay, by), (bx, cx), (by, cy)))
        long = ax[which] + (y - ay[which]) * ((cx - ax) / (cy - ay))[which]
        short = px + (y - py) * ((qx - px) / (qy - py))
        first, lengths = pixels(np.minimum(long, short), np.maximum(long, short), width)
        span, pixel = expand_spans(row * width + first, lengths)
        picture[pixel] = shown[which][span]
        pixel = np.flatnonzero(picture >= 0)
        return pixel, picture[pixel], depth[picture[pixel]] / 3.0

    def shade(self, painter, hit, near, columns, rows):
        """Shaded colours (k, 3) and depths (k,) at places of the picture in the triangles ``hit`` (k,)."""
        points, values = painter.camera.project(self.x), np.zeros((len(self.x), 4), np.float32)
        seen, light = painter.light_at(self.x, self.triangles[hit])
        ahead = self.x[seen] - painter.camera.eye
        values[seen, :3] = painter.shade_colours(self.colours[seen], ahead, self.normals[seen], light[:, seen])
        values[:, 3] = points[:, 2]
        a, b, c = self.triangles[hit].T
        column, row = points[:, :2].T.astype(np.float32)
        x, y, left, top = column[b] - column[a], row[b] - row[a], columns - column[a], rows - row[a]
        across, down = column[c] - column[a], row[c] - row[a]
        area = x * down - y * across
        u, v = (left * down - top * across) / area, (x * top - y * left) / area
        shown = (1.0 - u - v)[:, None] * values[a] + u[:, None] * values[b] + v[:, None] * values[c]
        return shown[:, :3], shown[:, 3]


def grid_line_darkness(x, step, pixel):
    """Darkness of grid lines at multiples of ``step``, every second one bolder, for pixels that cover ``pixel`` [m]."""
    nearest = np.round(x / step)
    bold = 1.0 - abs(nearest - 2.0 * np.round(0.5 * nearest))
    cover = np.clip(1.0 + 0.2 * bold - abs(x - step * nearest) / pixel, 0.0, 1.0)
    return (0.05 + 0.06 * bold) * cover * np.minimum(1.0, 0.1 * step / pixel)


class Lamp(Camera):
    """Light source with its shadow map: distance [m] of the nearest part of a body in each direction."""

    def __init__(self, direction, points, texels):
        super().__init__(direction, points, texels, texels)
        self.depth = np.full((texels, texels), FAR)

    def light_at(self, x, bias):
        """Fraction of the light (n,) that reaches places (n, 3) [m], averaged over FILTER x FILTER texels; ``bias``:
        depth of a soft edge [m]."""
        column, row, ahead = self.project(x).T
        depth, taps = np.pad(self.depth, FILTER + 1, constant_values=FAR), np.arange(FILTER + 1)
        (i, down), (j, across) = (np.divmod(a - 0.5 * FILTER, 1.0) for a in (row, column))
        i, j = (np.clip(a, -FILTER - 1, self.width).astype(int)[:, None] + FILTER + 1 + taps for a in (i, j))
        fractions = (
            np.clip(np.minimum(taps + 1 - f[:, None], FILTER + f[:, None] - taps), 0.0, 1.0) for f in (down, across)
        )
        behind = np.clip((ahead[:, None, None] - depth[i[:, :, None], j[:, None]]) / bias - 1.0, 0.0, 1.0)
        return 1.0 - np.einsum("na,nb,nab->n", *fractions, behind) / FILTER**2


class Painter:
    """Renderer of a body, its shadow, and the floor at height ``floor`` [m] (None: no floor) with lines every ``grid``
    [m]. ``points`` (n, 3) [m]: bounds of the view; ``radius`` [m] of a particle."""

    def __init__(self, camera, points, radius, floor=None, grid=0.05, relief=1.0):
        self.camera, self.radius, self.relief = camera, radius, relief
        self.lamps = Lamp(SUN_DIRECTION @ camera.axes, points, TEXELS[0]), Lamp((0.0, 0.0, -1.0), points, TEXELS[1])
        level = camera.eye[2] if floor is None else floor
        t, x = floor_intersections(camera, level)
        pixel = t / camera.focal
        upright = pixel * t / max(camera.eye[2] - level, 1e-9)
        lines = np.maximum(grid_line_darkness(x[..., 0], grid, pixel), grid_line_darkness(x[..., 1], grid, upright))
        away = np.hypot(x[..., 0] - camera.middle[0], x[..., 1] - camera.middle[1]) / (0.5 * np.ptp(points[:, 0]))
        away = np.clip((away - 0.8) / 1.6, 0.0, 1.0)
        far = away**2 * (3.0 - 2.0 * away)  # 1 where the floor has faded into the background
        self.far, self.near = np.float32([255.0 * far + 0.5, 255.0 * (1.0 - far) * 0.93 * (1.0 - lines)])
        # floor colour at each brightness
        self.papers = (np.linspace(0, 255, 256)[:, None] * BACKGROUND + 0.5).astype(np.uint8)
        coarse = x[FLOOR_CELL // 2 :: FLOOR_CELL, FLOOR_CELL // 2 :: FLOOR_CELL]
        for lamp in self.lamps:
            lamp.floor = floor_intersections(lamp, level)[0]
            places = np.clip(lamp.project(coarse.reshape(-1, 3), SHADOW / lamp.width)[:, :2], 0, SHADOW - 1).astype(int)
            lamp.of_floor = tuple(places.reshape(*coarse.shape[:2], 2).transpose(2, 0, 1)[::-1])

    def draw(self, *bodies, clear=1e-9):
        """Draw bodies, Mesh or Beads: picture (h, w, 3) uint8 and depth (h, w) [m]. The first casts its shadow on the
        floor, each on itself. Others are seen through it: their light falls by a factor of e over ``clear`` [m]."""
        picture, depth = None, np.full(self.far.shape, FAR, np.float32)
        for body in bodies:
            for lamp in self.lamps:
                place, _, near = body.rasterize(lamp)
                lamp.depth = np.full((lamp.height, lamp.width), FAR, np.float32)
                lamp.depth.ravel()[place] = near
            picture = self._floor_in_light() if picture is None else picture
            self._paint(body, picture, depth, clear)
        return picture, depth

    def _paint(self, body, picture, depth, clear):
        """Draw a body into a picture with depths of earlier bodies, through which it is seen as in ``draw``."""
        place, hit, near = body.rasterize(self.camera, SAMPLES_PER_SIDE)
        row, column = np.divmod(place.astype(np.int32), SAMPLES_PER_SIDE * self.camera.width)
        pixel = row // SAMPLES_PER_SIDE * self.camera.width + column // SAMPLES_PER_SIDE
        chosen = np.full(self.far.size, -1, np.int32)
        chosen[pixel] = np.arange(len(pixel))  # sample of each pixel that is shaded
        at = np.flatnonzero(chosen >= 0)
        chosen = chosen[at]
        places = ((a[chosen].astype(np.float32) + 0.5) / SAMPLES_PER_SIDE for a in (column, row))
        colours, near = body.shade(self, hit[chosen], near[chosen], *places)
        fraction = np.bincount(pixel)[at, None].astype(np.float32) / SAMPLES_PER_SIDE**2
        flat, before = picture.reshape(-1, 3), depth.ravel()[at]
        fraction *= np.exp(np.minimum(before - near, 0.0) / np.float32(clear))[:, None]
        mixed = flat[at] * ((1.0 - fraction) / np.float32(255.0)) + np.minimum(colours, 1.0) * fraction
        flat[at] = (np.float32(255.0) * mixed + np.float32(0.5)).astype(np.uint8)
        depth.ravel()[at] = np.minimum(near, before)

    def _floor_in_light(self):
        """Picture (h, w, 3) uint8 of the floor with the shadow of the body, without the body."""
        light = np.float32(1.0)
        for lamp in self.lamps:
            blocked = np.clip((lamp.floor - lamp.depth) / (1.5 * self.radius) - 1.0, 0.0, 1.0)
            shadow = Image.fromarray((255.0 * blocked + 0.5).astype(np.uint8)).filter(ImageFilter.BoxBlur(FILTER // 2))
            shadow = np.asarray(shadow.resize((SHADOW, SHADOW), Image.Resampling.BILINEAR))
            light = light * (1.0 - np.float32(0.38 / 255.0) * shadow[lamp.of_floor])
        fine = np.asarray(Image.fromarray(light).resize(self.far.shape[::-1], Image.Resampling.BILINEAR))
        return np.take(self.papers, (self.far + self.near * fine).astype(np.uint8), axis=0)

    def light_at(self, x, used, radius=0.0):
        """Rows of places x (n, 3) [m] that occur in ``used``, and the fractions (2, n) of sun and sky light there.
        ``radius`` [m] of spheres larger than particles, whose own surface is no shadow on their centre."""
        light = np.zeros((2, len(x)), np.float32)
        light[0, used.ravel()] = 1.0
        rows = np.flatnonzero(light[0])
        light[:, rows] = [lamp.light_at(x[rows], 2.5 * max(radius, self.radius)) for lamp in self.lamps]
        return rows, light

    def shade_colours(self, colours, ahead, normals, light):
        """Shade colours (n, 3) of places in the directions ``ahead`` (n, 3) from the eye, with these normals (n, 3) and
        fractions (2, n) of the light."""
        sun, sky = light
        facing = np.maximum(0.0, -np.einsum("ij,ij->i", normals, ahead) / np.linalg.norm(ahead, axis=1))
        ambient = (0.5 + 0.14 * normals[:, 2]) * (0.6 + 0.4 * sky) * (0.6 + 0.4 * facing)
        direct = 0.72 * sun * np.maximum(0.0, -normals @ self.lamps[0].axes[2].astype(normals.dtype))
        return colours * (1.0 - self.relief + self.relief * (ambient + direct))[:, None]


def floor_intersections(camera, level):
    """Intersections of the rays through the pixels with a floor at a height [m]: depths (h, w) [m], FAR where there is
    none, and points (h, w, 3) [m]."""
    columns, rows = np.arange(camera.width) + 0.5, np.arange(camera.height)[:, None] + 0.5
    rays, above = camera.rays(columns.astype(np.float32), rows.astype(np.float32)), camera.eye[2] - level
    down = -rays[..., 2]
    depth = np.where((down > 1e-4) & (above > 0.0), above / np.maximum(down, 1e-4), FAR)
    return depth, camera.eye + depth[..., None] * rays
