"""Run folders without a simulation: a body in free fall, and its files."""

from types import SimpleNamespace

import numpy as np

import taichi_mps as mps
from taichi_mps.io.history import COLUMNS, REPORT_ATTRIBUTES
from taichi_mps.io.recorder import Recorder
from taichi_mps.io.run_folder import RunFolder


class Falling:
    """What the edges need of a Simulation: particles in free fall in ``dt`` [s] steps."""

    all_active = True

    def __init__(self, scene, dt=0.01):
        self.scene, self.numerics, self.dt = scene, mps.Implicit(), dt
        self.time, self.steps, self.report, self.stopped_by = 0.0, 0, None, "time"
        self.callbacks = []

    def every(self, interval, callback):
        self.record_output = callback

    def each_step(self, callback):
        self.callbacks.append(callback)

    def step(self):
        self.steps += 1
        self.time = self.steps * self.dt
        values = dict.fromkeys([REPORT_ATTRIBUTES.get(key, key) for key in COLUMNS], 1.0)
        self.report = SimpleNamespace(**values | {"step": self.steps, "time": self.time, "dt": self.dt})
        for callback in self.callbacks:
            callback(self)
        self.record_output(self)

    def snapshot(self):
        x = self.scene.fluid + self.scene.gravity_vector * 0.5 * self.time**2
        n, d = x.shape
        zero, wall = np.zeros(n), np.zeros((0, d))
        u = np.tile(self.scene.gravity_vector * self.time, (n, 1))
        return mps.measure.Snapshot(
            self.time, self.scene.spacing, x, u, zero, zero, np.arange(n) % 2 == 0, zero + 1.0, wall
        )

    def measures(self):
        return self.scene.measure(self.snapshot())

    def facts(self):
        return {
            "scene": self.scene.name,
            "scheme": "falling",
            "steps": self.steps,
            "volume_error": float("nan"),
            **self.measures(),
        }

    def state(self):
        scalars = {"time": self.time, "steps": self.steps, "last_dt": None, "rest": {"since": 0.1 + 0.2}}
        return {"x": self.snapshot().x, **scalars, "report": {"dt": self.dt}}


def recorded(path, steps, end="", scene=None, overwrite=False):
    """(folder, stand-in, recorder) after that many steps of a coarse slump cone or another scene, whole if it has ended
    by something."""
    folder, sim = RunFolder(path), Falling(scene or mps.catalogue.build("slump", spacing=0.05, until=1.0))
    folder.create(overwrite)
    recorder = Recorder(folder, sim, 0.01, "slump", {"every": 0.01})
    recorder.record_output(sim)
    for _ in range(steps):
        sim.step()
    if end:
        recorder.finish(end)
    return folder, sim, recorder


def contents(folder):
    """Bytes of the files of a folder by their paths in it."""
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
