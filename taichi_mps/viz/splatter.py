"""Painters of spheres: a software splatter in Taichi kernels, or Taichi's GGUI. The painter of triangles, `facets`, has
the same light and floor.

Depth and row of the nearest sphere of each pixel are found by an atomic minimum over 64-bit keys, then each pixel is
shaded on its own: light, shadow, floor. The bits are the same on every run.
"""

import atexit
from pathlib import Path

import numpy as np

from ..runtime.backend import ti
from .camera import PAPER, SKY_TEXELS, SUN, SUN_TEXELS, Camera

vec3 = ti.types.vector(3, ti.f32)
mat3, mat34 = ti.types.matrix(3, 3, ti.f32), ti.types.matrix(3, 4, ti.f32)
Keys, Rows = ti.types.ndarray(dtype=ti.u64, ndim=2), ti.types.ndarray(dtype=ti.f32, ndim=2)
Pixels = ti.types.ndarray(dtype=ti.u8, ndim=3)
EMPTY = 0x4E6E6B28 << 32  # key of a pixel without sphere: depth 1e9 m; others: depth bits << 32 | row of the sphere


@ti.kernel
def _clear(keys: Keys):
    for i in range(keys.shape[0]):
        for j in range(keys.shape[1]):
            keys[i, j] = ti.u64(EMPTY)


@ti.kernel
def _splat(centres: Rows, radius: ti.f32, focal: ti.f32, keys: Keys):
    """Nearest sphere of every pixel; centres in camera axes (right, up, depth), exact perspective outlines."""
    for k in range(centres.shape[0]):
        x, y, z = centres[k, 0], centres[k, 1], centres[k, 2]
        r2 = radius * radius
        if z > 2.0 * radius:
            rows, columns = keys.shape[0], keys.shape[1]
            wide, tall = radius * ti.sqrt(x * x + z * z - r2), radius * ti.sqrt(y * y + z * z - r2)
            scale = focal / (z * z - r2)
            left, right = 0.5 * columns + scale * (x * z - wide), 0.5 * columns + scale * (x * z + wide)
            top, bottom = 0.5 * rows - scale * (y * z + tall), 0.5 * rows - scale * (y * z - tall)
            i0, i1 = ti.max(0, ti.cast(ti.floor(top), ti.i32)), ti.min(rows, ti.cast(ti.ceil(bottom), ti.i32))
            j0, j1 = ti.max(0, ti.cast(ti.floor(left), ti.i32)), ti.min(columns, ti.cast(ti.ceil(right), ti.i32))
            for i in range(i0, i1):
                for j in range(j0, j1):
                    dx, dy = (j + 0.5 - 0.5 * columns) / focal, (0.5 * rows - i - 0.5) / focal
                    dd = dx * dx + dy * dy + 1.0
                    t = (x * dx + y * dy + z) / dd
                    qx, qy, qz = x - t * dx, y - t * dy, z - t
                    inside = r2 - qx * qx - qy * qy - qz * qz
                    if inside > 0.0:
                        depth = ti.cast(t - ti.sqrt(inside / dd), ti.f32)
                        key = (ti.cast(ti.bit_cast(depth, ti.u32), ti.u64) << 32) | ti.cast(k, ti.u64)
                        if key < keys[i, j]:
                            ti.atomic_min(keys[i, j], key)


@ti.func
def row(rows: ti.template(), k):
    return vec3(rows[k, 0], rows[k, 1], rows[k, 2])


@ti.func
def _depth(key):
    return ti.bit_cast(ti.cast(key >> 32, ti.u32), ti.f32)


@ti.func
def _light(shadow: ti.template(), project: mat34, p: vec3, bias: ti.f32, taps: ti.template()):
    """Fraction of a light that reaches p: a box of taps x taps texels, bilinear at its rim."""
    q = project @ ti.Vector([p.x, p.y, p.z, 1.0])
    u, v = q.x / q.z - 0.5 * taps, q.y / q.z - 0.5 * taps
    i0, j0 = ti.cast(ti.floor(v), ti.i32), ti.cast(ti.floor(u), ti.i32)
    light = 1.0
    if i0 >= 0 and j0 >= 0 and i0 + taps < shadow.shape[0] and j0 + taps < shadow.shape[1]:
        blocked = 0.0
        for a, b in ti.ndrange(taps + 1, taps + 1):
            wi, wj = 1.0, 1.0
            if a == 0:
                wi = 1.0 - (v - i0)
            if a == taps:
                wi = v - i0
            if b == 0:
                wj = 1.0 - (u - j0)
            if b == taps:
                wj = u - j0
            behind = (q.z - _depth(shadow[i0 + a, j0 + b])) / bias - 1.0
            blocked += wi * wj * ti.math.clamp(behind, 0.0, 1.0)
        light = 1.0 - blocked / (taps * taps)
    return light


@ti.func
def _line(x, step, pixel):
    """Darkness of lines at multiples of step, every second one bolder, where a pixel covers ``pixel`` [m]."""
    nearest = ti.round(x / step)
    bold = 1.0 - ti.abs(nearest - 2.0 * ti.round(0.5 * nearest))
    cover = ti.math.clamp(1.0 + 0.2 * bold - ti.abs(x - step * nearest) / pixel, 0.0, 1.0)
    return (0.05 + 0.06 * bold) * cover * ti.min(1.0, 0.1 * step / pixel)


@ti.kernel
def _shade(
    keys: Keys, sun_map: Keys, sky_map: Keys, points: Rows, colours: Rows, radius: ti.f32, relief: ti.f32,
    ray: mat3, sun: vec3, sun_project: mat34, sky_project: mat34,
    eye: vec3, middle: vec3, reach: ti.f32, floor: ti.f32, grid: ti.f32, image: Pixels, depth: Rows,
):  # fmt: skip
    """Colour of every pixel from its s x s samples, and the depth of its nearest sphere; points: their centres, from
    the eye."""
    s = keys.shape[0] // image.shape[0]
    for i in range(image.shape[0]):
        for j in range(image.shape[1]):
            total = vec3(0.0, 0.0, 0.0)
            near, last, direct, sky, empty = 1e9, -1, 1.0, 1.0, 0
            for a, b in ti.ndrange(s, s):
                key = keys[i * s + a, j * s + b]
                if key == ti.u64(EMPTY):
                    empty += 1
                else:
                    hit = ti.cast(key & 0x7FFFFFFF, ti.i32)
                    t = _depth(key)
                    d = ray @ vec3(j + (b + 0.5) / s, i + (a + 0.5) / s, 1.0)
                    if hit != last:
                        direct = _light(sun_map, sun_project, t * d, 2.5 * radius, 5)
                        sky = _light(sky_map, sky_project, t * d, 2.5 * radius, 5)
                        last = hit
                    n, colour = (t * d - row(points, hit)) / radius, row(colours, hit)
                    facing = ti.max(0.0, -n.dot(d.normalized()))
                    ambient = (0.5 + 0.14 * n.z) * (0.6 + 0.4 * sky) * (0.6 + 0.4 * facing)
                    shade = 1.0 - relief + relief * (ambient + 0.72 * direct * ti.max(0.0, n.dot(sun)))
                    total += colour * shade
                    near = ti.min(near, t)
            if empty > 0:
                d = ray @ vec3(j + 0.5, i + 0.5, 1.0)
                light = 1.0
                if floor < 0.0 and d.z < -1e-4:
                    t = floor / d.z
                    p = t * d
                    pixel = t * ti.abs(ray[0, 0])
                    x = _line(p.x + eye.x, grid, pixel)
                    y = _line(p.y + eye.y, grid, pixel * t / -floor)
                    direct = _light(sun_map, sun_project, p, 1.5 * radius, 5)
                    sky = _light(sky_map, sky_project, p, 1.5 * radius, 5)
                    far = ti.math.smoothstep(0.8, 2.4, (p - middle).xy.norm() / reach)
                    lit = 0.93 * (0.62 + 0.38 * direct) * (0.62 + 0.38 * sky) * (1.0 - ti.max(x, y))
                    light = lit + (1.0 - lit) * far
                total += empty * light * vec3(PAPER[0], PAPER[1], PAPER[2])
            for k in ti.static(range(3)):
                image[i, j, k] = ti.cast(ti.math.clamp(total[k] / (s * s), 0.0, 1.0) * 255.0 + 0.5, ti.u8)
            depth[i, j] = near


class Splatter:
    """The software picture: spheres, their shadow, and the floor at height ``floor`` (None: there is none)."""

    name = "software"

    def __init__(self, camera, points, radius, floor=None, grid=0.05, samples=2):
        self.camera, self.radius, self.samples, self.grid = camera, radius, samples, grid
        self.floor = 0.0 if floor is None else floor - camera.eye[2]
        self.reach = 0.5 * np.ptp(points[:, 0])
        self.sun = Camera(SUN @ camera.axes, points, SUN_TEXELS, SUN_TEXELS)
        self.sky = Camera((0.0, 0.0, -1.0), points, SKY_TEXELS, SKY_TEXELS)
        self.keys = ti.ndarray(ti.u64, (camera.height * samples, camera.width * samples))
        self.sun_map, self.sky_map = (
            ti.ndarray(ti.u64, (SUN_TEXELS, SUN_TEXELS)),
            ti.ndarray(ti.u64, (SKY_TEXELS, SKY_TEXELS)),
        )

    def _hits(self, x, camera, focal, keys):
        _splat(np.ascontiguousarray((x - camera.eye) @ camera.axes.T, np.float32), self.radius, focal, keys)

    def draw(self, x, colours, relief=1.0):
        """Picture (h, w, 3) uint8 and depth (h, w) of spheres at x (n, 3) [m]."""
        order = np.argsort(x @ self.camera.axes[2], kind="stable")  # front first: most hidden pixels are never written
        x, colours = x[order], np.ascontiguousarray(colours[order], np.float32)
        camera, sun, sky = self.camera, self.sun, self.sky
        for view, scale, keys in ((camera, self.samples, self.keys), (sun, 1, self.sun_map), (sky, 1, self.sky_map)):
            _clear(keys)
            self._hits(x, view, view.focal * scale, keys)
        image = np.empty((camera.height, camera.width, 3), np.uint8)
        depth = np.empty((camera.height, camera.width), np.float32)
        ray = camera.axes.T @ np.linalg.inv(camera.matrix(camera.eye)[:, :3] @ camera.axes.T)
        _shade(
            self.keys, self.sun_map, self.sky_map, np.ascontiguousarray(x - camera.eye, np.float32), colours,
            self.radius, relief, mat3(ray), vec3(-sun.axes[2]),
            mat34(sun.matrix(camera.eye)), mat34(sky.matrix(camera.eye)), vec3(camera.eye),
            vec3(camera.middle - camera.eye), self.reach, self.floor, self.grid, image, depth,
        )  # fmt: skip
        return image, depth


class Ggui:
    """The same by Taichi's GGUI in a hidden window: needs Vulkan, draws no shadows. RuntimeError where it cannot.

    All share one window: Taichi 1.7.4 crashes when it closes a second one.
    """

    name, shared = "ggui", None  # shared: the Taichi program, size and window of this process

    def __init__(self, camera, points, radius, floor=None, grid=0.05):
        self.camera, self.capacity = camera, 0
        self.radius = radius * camera.height / camera.width  # GGUI measures it along the width
        key = ti.lang.impl.get_runtime().prog, camera.width, camera.height
        if Ggui.shared is None:
            litter = Path("imgui.ini").absolute()  # GGUI drops it in the working folder when the window closes
            window = ti.ui.Window("taichi_mps", key[1:], show_window=False)
            atexit.register(self._close, window, None if litter.exists() else litter)
            Ggui.shared = key, window
        if Ggui.shared[0] != key:
            raise RuntimeError("one picture size and one start of Taichi per process")
        self.window = Ggui.shared[1]
        self.canvas, self.scene, self.view = self.window.get_canvas(), self.window.get_scene(), ti.ui.Camera()
        self.view.position(*camera.eye)
        self.view.lookat(*(camera.eye + camera.axes[2]))
        self.view.up(*camera.axes[1])
        self.view.fov(camera.view_angle)
        self.lamp = camera.middle - np.ptp(points) * (SUN @ camera.axes)
        steps = np.arange(-24, 25) * grid if floor is not None else np.zeros(1)
        ends = np.stack(np.meshgrid(steps, steps[[0, -1]], indexing="ij"), -1).reshape(-1, 2)
        lines = np.column_stack([np.concatenate([ends, ends[:, ::-1]]), np.full(2 * len(ends), floor or 0.0)])
        self.lines = ti.Vector.field(3, ti.f32, len(lines))
        self.lines.from_numpy(lines.astype(np.float32))

    @staticmethod
    def _close(window, litter):
        window.destroy()
        if litter:
            litter.unlink(missing_ok=True)

    def draw(self, x, colours, relief=1.0):
        if len(x) > self.capacity:
            self.capacity = 2 * len(x)
            self.x, self.colours = (ti.Vector.field(3, ti.f32, self.capacity) for _ in range(2))
        for field, values in ((self.x, x), (self.colours, colours)):
            field.from_numpy(np.pad(values, ((0, self.capacity - len(x)), (0, 0)), mode="edge").astype(np.float32))
        self.scene.set_camera(self.view)
        self.scene.ambient_light((0.5, 0.5, 0.5))
        self.scene.point_light(tuple(self.lamp), (0.6, 0.6, 0.6))
        self.scene.lines(self.lines, width=1.0, color=(0.85, 0.86, 0.87))
        self.scene.particles(self.x, radius=self.radius, per_vertex_color=self.colours)
        self.canvas.set_background_color(PAPER)
        self.canvas.scene(self.scene)
        image = np.flipud(self.window.get_image_buffer_as_numpy().transpose(1, 0, 2))[..., :3]
        return (image * 255 + 0.5).clip(0, 255).astype(np.uint8), None
