"""The painter of triangles: the software picture of a closed mesh, with the light, shadow and floor of the spheres."""

import numpy as np

from ..runtime.backend import ti
from .splatter import Corners, Keys, Rows, Splatter, row, vec2


@ti.func
def _turn(a, b, c):
    """Twice the area of a triangle in the picture, positive where its corners turn clockwise."""
    return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x)


@ti.kernel
def _fill(points: Rows, corners: Corners, focal: ti.f32, keys: Keys):
    """Nearest triangle of every pixel; points in camera axes (right, up, depth)."""
    for k in range(corners.shape[0]):
        rows, columns = keys.shape[0], keys.shape[1]
        p, q, r = row(points, corners[k, 0]), row(points, corners[k, 1]), row(points, corners[k, 2])
        if ti.min(p.z, q.z, r.z) > 1e-6:
            a = vec2(0.5 * columns + focal * p.x / p.z, 0.5 * rows - focal * p.y / p.z)
            b = vec2(0.5 * columns + focal * q.x / q.z, 0.5 * rows - focal * q.y / q.z)
            c = vec2(0.5 * columns + focal * r.x / r.z, 0.5 * rows - focal * r.y / r.z)
            area = _turn(a, b, c)
            low, high = ti.floor(ti.min(a, b, c) - 0.5), ti.ceil(ti.max(a, b, c) + 0.5)
            i0, i1 = ti.max(0, ti.cast(low.y, ti.i32)), ti.min(rows, ti.cast(high.y, ti.i32))
            j0, j1 = ti.max(0, ti.cast(low.x, ti.i32)), ti.min(columns, ti.cast(high.x, ti.i32))
            if area != 0.0:
                for i in range(i0, i1):
                    for j in range(j0, j1):
                        at = vec2(j + 0.5, i + 0.5)
                        u, v, w = _turn(at, b, c) / area, _turn(a, at, c) / area, _turn(a, b, at) / area
                        if ti.min(u, v, w) >= -1e-5:  # an edge belongs to both sides: rounding leaves no holes
                            depth = ti.cast(1.0 / (u / p.z + v / q.z + w / r.z), ti.f32)
                            key = (ti.cast(ti.bit_cast(depth, ti.u32), ti.u64) << 32) | ti.cast(k, ti.u64)
                            if key < keys[i, j]:
                                ti.atomic_min(keys[i, j], key)


class Facets(Splatter):
    """The software picture: a mesh of triangles shaded by the normals of its points."""

    smooth = True

    def _hits(self, x, camera, focal, keys):
        _fill(np.ascontiguousarray((x - camera.eye) @ camera.axes.T, np.float32), self.corners, focal, keys)

    def draw(self, x, colours, relief=1.0, normals=None, triangles=None):
        """Picture (h, w, 3) uint8 and depth (h, w) of triangles (m, 3) between points x (n, 3) [m], which have
        colours and unit normals (n, 3)."""
        order = np.argsort(x[triangles].mean(1) @ self.camera.axes[2], kind="stable")  # front first, as the spheres
        self.corners = np.ascontiguousarray(triangles[order], np.int32)
        return self._shaded(x, np.ascontiguousarray(colours, np.float32), relief,
                            np.ascontiguousarray(normals, np.float32))  # fmt: skip
