"""Spheres for the painter."""

import numpy as np

from .painter import expand_spans, pixels

EMPTY = np.uint64(0x4E6E6B28 << 32)  # key of a pixel without sphere: depth 1e9 m; others: depth bits << 32 | row
AT_ONCE = 4096  # spheres


class Beads:
    """Spheres of a radius, or of radii (n,) [m], at x (n, 3) [m], with colours (n, 3)."""

    def __init__(self, x, colours, radius):
        self.x, self.colours = x, np.asarray(colours, np.float32)
        self.radius = np.broadcast_to(np.float32(radius), len(x))

    def rasterize(self, camera, scale=1):
        """Pixels (k,) whose centres are covered by spheres, rows of the nearest spheres (k,) and their depths there
        (k,) [m]. Outlines are exact in perspective; spheres that reach behind the eye are left out."""
        height, width, focal = scale * camera.height, scale * camera.width, np.float32(scale * camera.focal)
        keys = np.full(height * width, EMPTY)
        seen = camera.camera_coordinates(self.x).astype(np.float32)
        order = np.argsort(seen[:, 2], kind="stable")  # front first: most hidden pixels are never computed
        order = order[seen[order, 2] > 2.0 * self.radius[order]]
        for first in range(0, len(order), AT_ONCE):
            x, y, z = seen[order[first : first + AT_ONCE]].T
            radius = self.radius[order[first : first + AT_ONCE]]
            away = z * z - radius**2
            (left, wide), (top, tall) = (
                pixels(*(0.5 * size + focal / away * (a * z + sign * half) for sign in (-1.0, 1.0)), size)
                for a, size in ((x, width), (y, height))
                for half in [radius * np.sqrt(a * a + away)]
            )
            sphere, row = expand_spans(top, tall)
            span, column = expand_spans(left[sphere], wide[sphere])
            sphere, row = sphere[span], row[span]
            pixel = row * width + column
            visible = (z - radius)[sphere] < (keys[pixel] >> np.uint64(32)).astype(np.uint32).view(np.float32)
            sphere, pixel = sphere[visible], pixel[visible]
            ray = [
                ((at[visible] + 0.5 - 0.5 * size) / focal).astype(np.float32)
                for at, size in ((column, width), (row, height))
            ]
            square = ray[0] ** 2 + ray[1] ** 2 + 1.0
            t = (x[sphere] * ray[0] + y[sphere] * ray[1] + z[sphere]) / square
            within = (
                radius[sphere] ** 2
                - (x[sphere] - t * ray[0]) ** 2
                - (y[sphere] - t * ray[1]) ** 2
                - (z[sphere] - t) ** 2
            )
            hit = within > 0.0
            depth = (t[hit] - np.sqrt(within[hit] / square[hit])).view(np.uint32).astype(np.uint64)
            np.minimum.at(keys, pixel[hit], depth << np.uint64(32) | (first + sphere[hit]).astype(np.uint64))
        pixel = np.flatnonzero(keys != EMPTY)
        keys = keys[pixel]
        near = (keys >> np.uint64(32)).astype(np.uint32).view(np.float32)
        return pixel, order[(keys & np.uint64(0xFFFFFFFF)).astype(int)], near

    def shade(self, painter, hit, near, columns, rows):
        """Shaded colours (k, 3) and depths (k,) at places of the picture on the spheres ``hit`` (k,)."""
        ahead = painter.camera.rays(columns, rows).astype(np.float32) * near[:, None]
        normals = (ahead - (self.x - painter.camera.eye).astype(np.float32)[hit]) / self.radius[hit, None]
        _, light = painter.light_at(self.x, hit, self.radius.max(initial=0.0))
        return painter.shade_colours(self.colours[hit], ahead, normals, light[:, hit]), near
