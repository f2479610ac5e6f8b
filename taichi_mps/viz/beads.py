"""Spheres for the painter.

A Taichi kernel finds the nearest one at each pixel, by an atomic minimum over keys of 64 bits, reproducible bit for
bit.
"""

import numpy as np

from ..engine import ti

Keys, Rows = ti.types.ndarray(dtype=ti.u64, ndim=2), ti.types.ndarray(dtype=ti.f32, ndim=2)
EMPTY = 0x4E6E6B28 << 32  # key of a pixel without sphere: depth 1e9 m; others: depth bits << 32 | row of the sphere


@ti.kernel
def _splat(centres: Rows, radius: ti.f32, focal: ti.f32, keys: Keys):
    """Find the nearest sphere of every pixel, with exact perspective outlines; centres in camera coordinates [m]."""
    for k in range(centres.shape[0]):
        x, y, z = centres[k, 0], centres[k, 1], centres[k, 2]
        r2 = radius * radius
        if z > 2.0 * radius:
            rows, columns = keys.shape[0], keys.shape[1]
            wide, tall = radius * ti.sqrt(x * x + z * z - r2), radius * ti.sqrt(y * y + z * z - r2)
            scale = focal / (z * z - r2)
            left, right = 0.5 * columns + scale * (x * z - wide), 0.5 * columns + scale * (x * z + wide)
            top, bottom = 0.5 * rows + scale * (y * z - tall), 0.5 * rows + scale * (y * z + tall)
            i0, i1 = ti.max(0, ti.cast(ti.floor(top), ti.i32)), ti.min(rows, ti.cast(ti.ceil(bottom), ti.i32))
            j0, j1 = ti.max(0, ti.cast(ti.floor(left), ti.i32)), ti.min(columns, ti.cast(ti.ceil(right), ti.i32))
            front = ti.cast(ti.bit_cast(ti.cast(z - radius, ti.f32), ti.u32), ti.u64) << 32  # no key of it is smaller
            for i in range(i0, i1):
                for j in range(j0, j1):
                    if front < keys[i, j]:
                        dx, dy = (j + 0.5 - 0.5 * columns) / focal, (i + 0.5 - 0.5 * rows) / focal
                        dd = dx * dx + dy * dy + 1.0
                        t = (x * dx + y * dy + z) / dd
                        qx, qy, qz = x - t * dx, y - t * dy, z - t
                        inside = r2 - qx * qx - qy * qy - qz * qz
                        if inside > 0.0:
                            depth = ti.cast(t - ti.sqrt(inside / dd), ti.f32)
                            key = (ti.cast(ti.bit_cast(depth, ti.u32), ti.u64) << 32) | ti.cast(k, ti.u64)
                            ti.atomic_min(keys[i, j], key)


class Beads:
    """Spheres of one radius [m] at x (n, 3) [m], with colours (n, 3)."""

    def __init__(self, x, colours, radius):
        self.x, self.colours, self.radius = x, np.asarray(colours, np.float32), radius

    def rasterize(self, camera, scale=1):
        """Pixels (k,) whose centres are covered by spheres, rows of the nearest spheres (k,) and their depths there
        (k,) [m]. Spheres that reach behind the eye are left out."""
        keys = np.full((scale * camera.height, scale * camera.width), EMPTY, np.uint64)
        seen = camera.camera_coordinates(self.x).astype(np.float32)
        order = np.argsort(seen[:, 2], kind="stable")  # front first: most hidden pixels are never written
        _splat(seen[order], self.radius, scale * camera.focal, keys)
        pixel = np.flatnonzero(keys != EMPTY)
        keys = keys.ravel()[pixel]
        return pixel, order[keys & 0x7FFFFFFF], (keys >> 32).astype(np.uint32).view(np.float32)

    def shade(self, painter, hit, near, columns, rows):
        """Shaded colours (k, 3) and depths (k,) at places of the picture on the spheres ``hit`` (k,)."""
        ahead = painter.camera.rays(columns, rows).astype(np.float32) * near[:, None]
        normals = (ahead - (self.x - painter.camera.eye).astype(np.float32)[hit]) / np.float32(self.radius)
        _, light = painter.light_at(self.x, hit)
        return painter.shade_colours(self.colours[hit], ahead, normals, light[:, hit]), near
