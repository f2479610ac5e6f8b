"""Pictures of a run. Layer 4: it reads scenes and snapshots, the numerics never see it.

A software sphere splatter in Taichi kernels draws the body, its shadow and the floor on any machine; Pillow writes
rulers, the lifted mould and the measures over it. Two-dimensional scenes are drawn in the plane y = 0, z up.
"""

import atexit
import sys
from functools import cache
from pathlib import Path

import imageio.v3 as iio
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from .backend import ti
from .quantity import SceneError

vec3, mat3, mat34 = ti.types.vector(3, ti.f32), ti.types.matrix(3, 3, ti.f32), ti.types.matrix(3, 4, ti.f32)
Keys, Rows = ti.types.ndarray(dtype=ti.u64, ndim=2), ti.types.ndarray(dtype=ti.f32, ndim=2)
Pixels = ti.types.ndarray(dtype=ti.u8, ndim=3)
EMPTY = 0x4E6E6B28 << 32  # key of a pixel without sphere: depth 1e9 m; others: depth bits << 32 | row of the sphere
PAPER = (0.955, 0.96, 0.965)  # background colour
SUN = np.array((0.45, -0.6, 0.72))  # where its light goes: right, up, away from the eye
RADIUS = 0.62  # of a drawn sphere over l0
INK, FAINT, MOULD = (38, 42, 48), (112, 118, 126), (196, 62, 38)  # of text, rulers and outlines
CONCRETE, FLOWING, RIGID = np.array([(0.68, 0.675, 0.66), (0.93, 0.50, 0.16), (0.45, 0.53, 0.64)])
FIELDS = {  # values of a view, and the label of its colour bar
    "speed": (lambda s: s.speed, "speed [m/s]"),
    "pressure": (lambda s: 1e-3 * s.p, "pressure [kPa]"),
    "shear-rate": (lambda s: s.shear_rate, "shear rate [1/s]"),
}
VIEWS = ("concrete", *FIELDS, "yielded")
MEASURES = {"slump_m": "slump", "spread_m": "spread", "front_m": "front", "height_m": "height"}  # shown in cm
VIRIDIS = np.array(
    [(68, 1, 84), (71, 44, 122), (59, 81, 139), (44, 113, 142), (33, 144, 141), (39, 173, 129), (92, 200, 99)]
    + [(170, 220, 50), (253, 231, 37)]
)


def viridis(t):
    """Colours (n, 3) in 0..1 of values in 0..1; beyond the ends the end colours, nan is grey."""
    t = np.asarray(t, float)
    colours = np.stack([np.interp(t, np.linspace(0, 1, 9), VIRIDIS[:, k] / 255.0) for k in range(3)], -1)
    return np.where(np.isnan(t)[..., None], 0.5, colours)


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
def _depth(key):
    return ti.bit_cast(ti.cast(key >> 32, ti.u32), ti.f32)


@ti.func
def _light(shadow: ti.template(), project: mat34, p: vec3, bias: ti.f32, taps: ti.template()):
    """Share of a light that reaches p: a box of taps x taps texels, bilinear at its rim."""
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
    keys: Keys, sun_map: Keys, sky_map: Keys, centres: Rows, colours: Rows, radius: ti.f32, relief: ti.f32,
    ray: mat3, sun: vec3, sun_project: mat34, sky_project: mat34, eye: vec3, middle: vec3, reach: ti.f32,
    floor: ti.f32, grid: ti.f32, image: Pixels, depth: Rows,
):  # fmt: skip
    """Colour of every pixel from its s x s samples, and the depth of its nearest sphere. Positions from the eye."""
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
                    n = (t * d - vec3(centres[hit, 0], centres[hit, 1], centres[hit, 2])) / radius
                    facing = ti.max(0.0, -n.dot(d.normalized()))
                    ambient = (0.5 + 0.14 * n.z) * (0.6 + 0.4 * sky) * (0.6 + 0.4 * facing)
                    shade = 1.0 - relief + relief * (ambient + 0.72 * direct * ti.max(0.0, n.dot(sun)))
                    total += vec3(colours[hit, 0], colours[hit, 1], colours[hit, 2]) * shade
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


class Camera:
    """Pinhole camera that looks along ``direction``, so near that the points given just fill ``frame`` of its picture.

    frame: left, top, right, bottom in shares of the picture.
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
        bounds = [(max(across - right * ahead), min(across - left * ahead), right - left)]
        bounds += [(max(up + top * ahead), min(up + bottom * ahead), bottom - top)]
        z = min((low - high) / room for high, low, room in bounds)  # nearest at which both directions fit
        x = 0.5 * (bounds[0][0] + bounds[0][1] + (right + left) * z)
        y = 0.5 * (bounds[1][0] + bounds[1][1] - (bottom + top) * z)
        self.eye = np.array([x, y, z]) @ self.axes
        self.middle = np.mean([np.min(points, 0), np.max(points, 0)], 0)

    def matrix(self, origin, scale=1):
        """(3, 4) matrix from points relative to ``origin`` to (column depth, row depth, depth), pixels 1/scale."""
        f = self.focal * scale
        lens = np.array([[f, 0, 0.5 * self.width * scale], [0, -f, 0.5 * self.height * scale], [0, 0, 1]])
        return lens @ np.column_stack([self.axes, self.axes @ (origin - self.eye)])

    def project(self, points):
        """Columns, rows and depths of world points [m] (n, 3)."""
        q = np.asarray(points, float) @ self.matrix(np.zeros(3))[:, :3].T + self.matrix(np.zeros(3))[:, 3]
        return np.column_stack([q[:, :2] / q[:, 2:], q[:, 2]])


class Splatter:
    """The software picture: spheres, their shadow, and the floor at height ``floor`` (None: there is none)."""

    name = "software"

    def __init__(self, camera, points, radius, floor=None, grid=0.05, samples=2):
        self.camera, self.radius, self.samples, self.grid = camera, radius, samples, grid
        self.floor = 0.0 if floor is None else floor - camera.eye[2]
        self.reach = 0.5 * np.ptp(points[:, 0])
        self.sun = Camera(SUN @ camera.axes, points, 256, 256)
        self.sky = Camera((0.0, 0.0, -1.0), points, 72, 72)
        self.keys = ti.ndarray(ti.u64, (camera.height * samples, camera.width * samples))
        self.sun_map, self.sky_map = ti.ndarray(ti.u64, (256, 256)), ti.ndarray(ti.u64, (72, 72))

    def _project(self, x, camera, scale, keys):
        _clear(keys)
        centres = np.ascontiguousarray((x - camera.eye) @ camera.axes.T, np.float32)
        _splat(centres, self.radius, camera.focal * scale, keys)

    def draw(self, x, colours, relief=1.0):
        """Picture (h, w, 3) uint8 and depth (h, w) of spheres at x (n, 3) [m]."""
        camera, sun = self.camera, self.sun
        order = np.argsort(x @ camera.axes[2], kind="stable")  # front first: most hidden pixels are never written
        x, colours = x[order], np.ascontiguousarray(colours[order], np.float32)
        self._project(x, camera, self.samples, self.keys)
        self._project(x, sun, 1, self.sun_map)
        self._project(x, self.sky, 1, self.sky_map)
        image = np.empty((camera.height, camera.width, 3), np.uint8)
        depth = np.empty((camera.height, camera.width), np.float32)
        ray = camera.axes.T @ np.linalg.inv(camera.matrix(camera.eye)[:, :3] @ camera.axes.T)
        _shade(
            self.keys, self.sun_map, self.sky_map, np.ascontiguousarray(x - camera.eye, np.float32), colours,
            self.radius, relief, mat3(ray), vec3(-sun.axes[2]), mat34(sun.matrix(camera.eye)),
            mat34(self.sky.matrix(camera.eye)), vec3(camera.eye), vec3(camera.middle - camera.eye), self.reach,
            self.floor, self.grid, image, depth,
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


def embed(x):
    """Points (n, 3) of points (n, d): a two-dimensional scene lies in the plane y = 0."""
    x = np.asarray(x, float)
    return x if x.shape[1] == 3 else np.column_stack([x[:, 0], np.zeros(len(x)), x[:, 1]])


def stage(scene):
    """Low and high corner [m] (3,) of what a run may show, the body with room to spread up to the walls; its floor."""
    low, high = scene.fluid.min(0) - 0.5 * scene.spacing, scene.fluid.max(0) + 0.5 * scene.spacing
    body, domain, touch = (low.copy(), high.copy()), np.array(scene.domain, float), 0.6 * scene.spacing
    for axis in range(scene.dimension - 1):
        room = np.inf if scene.periodic_axes[axis] else 0.85 * (body[1][-1] - body[0][-1])
        walls = [wall.point[axis] for wall in scene.walls if abs(wall.normal[axis]) > 0.99]
        low[axis] = max((w for w in walls if w < low[axis] + touch), default=max(low[axis] - room, domain[0, axis]))
        high[axis] = min((w for w in walls if w > high[axis] - touch), default=min(high[axis] + room, domain[1, axis]))
    floors = [w.point[-1] for w in scene.walls if w.normal[-1] > 0.99 and w.point[-1] < low[-1] + touch]
    low[-1] = max(floors, default=low[-1])
    return *embed([low, high]), low[-1] if floors else None


class Renderer:
    """Pictures of one run; camera, rulers and the range of the colours are fixed.

    view: one of VIEWS; backend: software, or ggui where Vulkan is there (else one line on stderr, and software);
    limits: (low, high) of the colour bar in its unit, by default from the scene.
    """

    def __init__(self, scene, width=1280, height=720, view="concrete", backend="software", limits=None):
        if view not in VIEWS:
            raise SceneError(f"view = {view}: must be one of {', '.join(VIEWS)}")
        if backend not in ("software", "ggui"):
            raise SceneError(f"backend = {backend}: must be software or ggui")
        self.scene, self.view, self.limits = scene, view, limits or self._limits(scene, view)
        self.low, self.high, floor = stage(scene)
        corners = np.stack(np.meshgrid(*zip(self.low, self.high, strict=True)), -1).reshape(-1, 3)
        steps = [digit * 10.0**power for power in range(-6, 4) for digit in (1, 2, 5)]
        self.tick = min(steps, key=lambda t: abs(np.log(np.ptp(corners) / 14 / t)))  # about 14 on the longest side
        tilt = np.radians(15.0 if scene.dimension == 3 else 0.0)
        self.camera = Camera((0.0, np.cos(tilt), -np.sin(tilt)), corners, width, height, (0.09, 0.17, 0.88, 0.89))
        arguments = (self.camera, corners, RADIUS * scene.spacing, floor, self.tick)
        self.painter = self._ggui(*arguments) if backend == "ggui" else Splatter(*arguments)

    @staticmethod
    def _ggui(*arguments):
        try:
            return Ggui(*arguments)
        except Exception as error:  # RuntimeError without a driver; a bare Exception where Taichi was built without it
            reason = " ".join(str(error).split())[:100]
            print(f"ggui: no hidden window can be made here ({reason}); drawing in software instead", file=sys.stderr)
            return Splatter(*arguments)

    @staticmethod
    def _limits(scene, view):
        head = np.linalg.norm(scene.gravity_vector) * np.ptp(scene.fluid[:, -1])  # g H
        moved = [np.linalg.norm(wall.velocity) for wall in scene.walls if wall.velocity is not None]
        moved += [] if scene.velocity is None else [np.linalg.norm(scene.velocity, axis=1).max()]
        highest = {"speed": max([0.5 * np.sqrt(2.0 * head), *moved]), "pressure": 1e-3 * scene.material.density * head}
        top = float(highest.get(view, 10.0)) or 1.0
        return 0.0, min(
            v for v in (d * 10.0 ** np.floor(np.log10(top)) for d in (1, 1.5, 2, 3, 4, 5, 6, 8, 10)) if v > 0.97 * top
        )

    def colours(self, snapshot):
        """Colours (n, 3) in 0..1 of the particles in this view."""
        if self.view == "concrete":
            return CONCRETE * (0.94 + 0.12 * np.modf(0.618034 * np.arange(len(snapshot.x)))[0])[:, None]
        if self.view == "yielded":
            return np.where(np.asarray(snapshot.yielded, bool)[:, None], FLOWING, RIGID)
        low, high = self.limits
        return viridis((np.asarray(FIELDS[self.view][0](snapshot), float) - low) / (high - low))

    def draw(self, snapshot, measures=None):
        """The picture, (h, w, 3) uint8."""
        relief = 1.0 if self.view == "concrete" else 0.7
        pixels, depth = self.painter.draw(embed(snapshot.x), self.colours(snapshot), relief)
        image = Image.fromarray(pixels)
        self._lines(image, depth)
        pen = ImageDraw.Draw(image)
        self._rulers(pen)
        self._titles(pen, snapshot, measures or {})
        if self.view != "concrete":
            self._legend(image, pen)
        return np.asarray(image)

    def _write(self, pen, at, text, size=17, colour=INK, anchor="la"):
        pen.text(at, text, fill=colour, font=font(size * self.camera.height / 720), anchor=anchor)

    def _titles(self, pen, snapshot, measures):
        mix, unit = self.scene.material, self.camera.height / 720
        flow = f"yield value {mix.yield_value:g} Pa   plastic " * (not mix.newtonian) + "viscosity "
        flow += f"{mix.plastic_viscosity:g} Pa s   density {mix.density:g} kg/m3   l0 {1e3 * self.scene.spacing:g} mm"
        self._write(pen, (28 * unit, 22 * unit), self.scene.name, 26)
        self._write(pen, (28 * unit, 58 * unit), flow, 16, FAINT)
        shown = [f"{name} {100 * measures[key]:.1f} cm" for key, name in MEASURES.items() if key in measures]
        self._write(pen, (28 * unit, 86 * unit), "   ".join([f"t = {snapshot.time:.2f} s", *shown]), 22)

    def _rulers(self, pen):
        """Ticks in cm: along x on the floor in front of the body, and upright at its left in the middle plane."""
        low, high, unit = self.low, self.high, self.camera.height / 720
        upright = np.array([low[0], 0.5 * (low[1] + high[1]), low[2]])
        for start, axis, zero, side, anchor in ((low, 0, 0.0, (0, 1), "mt"), (upright, 2, low[2], (-1, 0), "rm")):
            first, last = (np.array([low[axis], high[axis]]) - zero) / self.tick
            ticks = np.arange(np.ceil(first - 1e-6), np.floor(last + 1e-6) + 1)
            points = np.tile(start, (len(ticks), 1))
            points[:, axis] = zero + self.tick * ticks
            at, side, width = self.camera.project(points)[:, :2], unit * np.array(side), max(1, round(1.5 * unit))
            pen.line([tuple(p) for p in at], fill=FAINT, width=width)
            for k, p in zip(ticks.astype(int), at, strict=True):
                pen.line([tuple(p), tuple(p + (5 if k % 2 else 9) * side)], fill=FAINT, width=width)
                if k % 2 == 0:
                    label = f"{100 * self.tick * k:.4g}" + " cm" * int(k > ticks[-1] - 2)
                    self._write(pen, p + 14 * side, label, 15, FAINT, anchor)

    def _lines(self, image, depth):
        """Walls, and the lifted mould (dashed) where nothing hides it; smoothed by drawing at twice the size."""
        masks = [Image.new("L", (2 * image.width, 2 * image.height)) for _ in range(2)]
        pens, width = [ImageDraw.Draw(mask) for mask in masks], max(2, round(image.height / 240))
        (x0, y0, z0), (x1, y1, z1) = self.low, self.high
        for wall in self.scene.walls:
            at, y = wall.point, 0.5 * (y0 + y1)
            if abs(wall.normal[0]) > 0.99:
                ends = [(at[0], y, z0), (at[0], y, z1)]
            elif wall.normal[-1] < -0.99:
                ends = [(x0, y, at[-1]), (x1, y, at[-1])]
            else:
                continue
            pens[0].line([tuple(p) for p in 2 * self.camera.project(ends)[:, :2]], fill=255, width=width)
        for polyline in self.scene.outline:
            corner = self.camera.project(embed(polyline))
            length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corner[:, :2], axis=0), axis=1))])
            at = np.arange(0.0, length[-1], image.height / 180)
            point = np.stack([np.interp(at, length, corner[:, k]) for k in range(3)], -1)
            j, i = point[:, :2].astype(int).T
            seen = (i >= 0) & (j >= 0) & (i < image.height) & (j < image.width)
            if depth is not None:
                near = depth[np.clip(i, 0, image.height - 1), np.clip(j, 0, image.width - 1)]
                seen &= point[:, 2] < near + 1.5 * self.scene.spacing
            for k in range(len(at) - 1):
                if k % 3 < 2 and seen[k]:
                    pens[1].line([tuple(p) for p in 2 * point[k : k + 2, :2]], fill=255, width=width)
        for mask, colour in zip(masks, (FAINT, MOULD), strict=True):
            image.paste(colour, mask=mask.reduce(2))

    def _legend(self, image, pen):
        unit, (low, high) = self.camera.height / 720, self.limits
        x, y, wide, tall = (round(v * unit) for v in (image.width / unit - 105, 150, 20, 300))
        if self.view == "yielded":
            for k, (name, colour) in enumerate((("flowing", FLOWING), ("below the yield value", RIGID))):
                top = round((28 + 30 * k) * unit)
                pen.rectangle((x + 57 * unit, top, x + 77 * unit, top + wide), fill=tuple(int(255 * c) for c in colour))
                self._write(pen, (x + 48 * unit, top + 0.5 * wide), name, 16, INK, "rm")
            return
        bar = (255 * viridis(np.linspace(1, 0, tall))[:, None] + 0.5).astype(np.uint8)
        image.paste(Image.fromarray(np.repeat(bar, wide, 1)), (x, y))
        self._write(pen, (x + 77 * unit, y - 24 * unit), FIELDS[self.view][1], 16, INK, "rm")
        for t in np.linspace(0, 1, 6):
            at = y + (1 - t) * (tall - 1)
            pen.line((x + wide, at, x + wide + 5 * unit, at), fill=FAINT)
            self._write(pen, (x + wide + 10 * unit, at), f"{low + t * (high - low):.3g}", 15, FAINT, "lm")


@cache
def font(size):
    """The font that ships with Pillow."""
    return ImageFont.load_default(size)


def png(folder, view="concrete", **options):
    """Callback of a simulation that writes folder/frame_00000.png, ... (speed_00000.png, ... for the view speed)."""
    folder, count, renderer = Path(folder), 0, None

    def write(sim):
        nonlocal count, renderer
        if renderer is None:
            folder.mkdir(parents=True, exist_ok=True)
            renderer = Renderer(sim.scene, view=view, **options)
        name = f"{'frame' if view == 'concrete' else view}_{count:05d}.png"
        iio.imwrite(folder / name, renderer.draw(sim.snapshot(), sim.measures()), compress_level=1)
        count += 1

    return write


def gif(frames, out, fps=10, width=640):
    """Animated GIF of a folder of pictures (its frame_*.png, or else all), or of a list of files."""
    paths = [Path(frames)] if isinstance(frames, str | Path) else list(frames)
    if len(paths) == 1 and Path(paths[0]).is_dir():
        paths = sorted(Path(paths[0]).glob("frame_*.png")) or sorted(Path(paths[0]).glob("*.png"))
    if not paths:
        raise FileNotFoundError(f"gif: no pictures in {frames}")
    pictures = []
    for path in paths:
        with Image.open(path) as picture:
            size = (width, round(width * picture.height / picture.width))
            pictures.append(picture.convert("RGB").resize(size, Image.Resampling.BOX))
    sample = pictures[:: max(1, len(pictures) // 8)]
    sheet, palette = (
        Image.fromarray(np.concatenate([np.asarray(picture) for picture in sample])),
        Image.new("P", (1, 1)),
    )
    common, rare = sheet.quantize(208), sheet.quantize(48, Image.Quantize.MAXCOVERAGE)  # smooth greys, thin red lines
    palette.putpalette(common.getpalette()[: 3 * 208] + rare.getpalette()[: 3 * 48])
    pictures = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    pictures[0].save(out, save_all=True, append_images=pictures[1:], duration=round(1000 / fps), loop=0, optimize=True)
