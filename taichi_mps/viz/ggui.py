"""Pictures of spheres by Taichi's GGUI."""

import atexit
from pathlib import Path

import numpy as np

from ..runtime.backend import ti
from .painter import PAPER, SUN


class Ggui:
    """Painter by Taichi's GGUI in a hidden window: needs Vulkan, draws no shadows. RuntimeError where it cannot.

    All share one window: Taichi 1.7.4 crashes when it closes a second one.
    """

    name, shared = "ggui", None  # shared: the Taichi program, size and window of this process

    def __init__(self, camera, points, radius, floor=None, grid=0.05, relief=1.0):
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

    def draw(self, body):
        x, colours = body.x, body.colours
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
        return (image * 255 + 0.5).clip(0, 255).astype(np.uint8), np.full(image.shape[:2], np.inf)
