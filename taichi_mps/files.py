"""The run folder: history.csv, run.h5, summary.json and checkpoint.h5, written while a run goes on."""

import csv
import json
import math
import os
import time
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from . import catalogue, checkpoint
from .measure import Snapshot
from .quantity import SceneError
from .scene import Scene

COLUMNS = ("time_s", "dt_s", "slump_m", "spread_m", "max_speed_m_s", "kinetic_energy_J")
COLUMNS += ("unyielded_fraction", "viscous_iterations", "pressure_iterations", "volume_error")
OURS = ("history.csv", "summary.json", "checkpoint.h5")  # any of them marks a folder as a run
PRODUCTS = (*OURS, "checkpoint.previous.h5", "checkpoint.partial", "summary.partial", "run.h5", "animation.gif")
PLOTS = ("slump.png", "history.png")
CHECKPOINT_INTERVAL = 60.0  # wall seconds
PARTS = ("Vertices", "Lines", "Strips", "Polygons")  # order of the columns of Steps/CellOffsets


class RunFolder:
    """Paths of one run. Nothing is written before ``create``; only files that a run makes are ever removed."""

    def __init__(self, path):
        self.path = Path(path)
        self.frames = self.path / "frames"
        self.history = self.path / "history.csv"
        self.summary = self.path / "summary.json"
        self.trajectory = self.path / "run.h5"
        self.checkpoint = self.path / "checkpoint.h5"
        self.animation = self.path / "animation.gif"

    @property
    def ours(self) -> bool:
        return any((self.path / name).is_file() for name in OURS)

    def check(self) -> None:
        """Refuse, before anything is computed, a path that is a file, somebody else's folder, or not writable."""
        path = self.path
        if path.exists() and not path.is_dir():
            raise SceneError(f"out = {path}: is a file; must be a folder")
        if path.is_dir() and any(path.iterdir()) and not self.ours:
            raise SceneError(f"out = {path}: holds other files and no run; must be a new or empty folder or an old run")
        parent = next(folder for folder in (path.absolute(), *path.absolute().parents) if folder.exists())
        if not parent.is_dir() or not os.access(parent, os.W_OK | os.X_OK):
            raise SceneError(f"out = {path}: cannot be written, {parent} does not allow it; choose another folder")

    def create(self) -> None:
        """Make the folder empty of earlier results; SceneError, and nothing left behind, when that is impossible."""
        self.check()
        missing = [folder for folder in (self.path, *self.path.parents) if not folder.exists()]
        try:
            self.frames.mkdir(parents=True, exist_ok=True)
            for name in (*PRODUCTS, *PLOTS):
                (self.path / name).unlink(missing_ok=True)
            for picture in self.frames.glob("*.png"):
                picture.unlink()
        except OSError as error:
            for folder in (self.frames, *missing):
                if folder.is_dir():
                    folder.rmdir()
            raise SceneError(
                f"out = {self.path}: cannot be written ({error.strerror}); choose another folder"
            ) from None

    def write_summary(self, summary: dict) -> None:
        """Write summary.json whole or not at all; numbers that are not finite become null."""
        partial = self.summary.with_suffix(".partial")
        partial.write_text(json.dumps(strict(summary), indent=2, allow_nan=False) + "\n", encoding="utf-8")
        os.replace(partial, self.summary)

    def read_summary(self) -> dict:
        if not self.summary.is_file():
            raise SceneError(f"run = {self.path}: holds no summary.json; must be the folder of a run")
        return json.loads(self.summary.read_text(encoding="utf-8"))


class History:
    """history.csv, one row a step. Measures not taken in a step repeat the last ones; see Recorder.

    ``kept``: continue an existing file up to that time [s]. Measures other than slump and spread get columns of
    their own at the end.
    """

    def __init__(self, path, measures: dict, kept: float | None = None):
        self.columns = (*COLUMNS, *(key for key in measures if key not in (*COLUMNS, "slump_max_m")))
        rows = [] if kept is None or not Path(path).is_file() else read_rows(path)
        rows = [row for row in rows if float(row["time_s"]) <= kept * (1 + 1e-9)]
        self.empty = not rows
        self.file = open(path, "w", newline="", encoding="utf-8")  # noqa: SIM115  (closed in close)
        self.writer = csv.DictWriter(self.file, self.columns, restval="nan", extrasaction="ignore")
        self.writer.writeheader()
        self.writer.writerows(rows)
        self.pending = None

    def add(self, row: dict) -> None:
        """Write the row before and keep this one until the next, so that the last can get its final measures."""
        self._write()
        self.pending = row

    def _write(self):
        if self.pending:
            self.writer.writerow({key: f"{v:.9g}" if isinstance(v, float) else v for key, v in self.pending.items()})
            self.file.flush()
            self.pending = None

    def close(self, measures: dict | None = None) -> None:
        if self.pending and measures:
            self.pending.update(measures)
        self._write()
        self.file.close()


def row_of(sim, measures: dict) -> dict:
    """Row of history.csv of a simulation now; before the first step there is no report, and little to say."""
    report = sim.report
    if report is None:
        s = sim.snapshot()
        mass = sim.scene.material.density * s.spacing ** s.x.shape[1]
        values = (
            0.0,
            0.0,
            float(s.speed.max()),
            0.5 * mass * float((s.speed**2).sum()),
            1.0 - s.yielded.mean(),
            0,
            0,
            0.0,
        )
    else:
        values = (report.time, report.dt, report.max_speed, report.kinetic_energy, report.unyielded_fraction)
        values += (report.viscous_iterations, report.pressure_iterations, report.volume_error)
    keys = [key for key in COLUMNS if key not in ("slump_m", "spread_m")]
    return {**measures, **dict(zip(keys, values, strict=True))}


def read_rows(path) -> list[dict[str, str]]:
    """Rows of a history.csv as text."""
    with open(path, newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def read_history(path) -> dict[str, np.ndarray]:
    """Columns of a history.csv as arrays."""
    if not Path(path).is_file():
        raise SceneError(f"run = {Path(path).parent}: holds no history.csv; must be the folder of a run")
    rows = read_rows(path)
    return {key: np.array([float(row[key]) for row in rows]) for key in (rows[0] if rows else COLUMNS)}


class Trajectory:
    """run.h5: the fluid at every output as temporal VTKHDF PolyData, for ParaView and VTK >= 9.4, and for ``frame``.

    The number of particles is constant, so one part and one set of vertices serve all steps: step k has its points
    at row k n. The file is closed between outputs, so that it is whole whenever something else reads it. Group
    ``taichi_mps`` holds what VTK does not need: how the scene was made and the wall particles.
    """

    def __init__(self, path):
        self.path = Path(path)

    def create(self, sim, source: str) -> None:
        s = sim.snapshot()
        n = len(s.x)
        with h5py.File(self.path, "w", libver=("earliest", "v110")) as file:
            root = file.create_group("VTKHDF")
            root.attrs["Version"] = np.array([2, 0])
            root.attrs.create("Type", b"PolyData", dtype=h5py.string_dtype("ascii", 8))
            root["NumberOfPoints"] = np.array([n])
            for part in PARTS:
                used = n if part == "Vertices" else 0
                root[f"{part}/NumberOfCells"] = root[f"{part}/NumberOfConnectivityIds"] = np.array([used])
                root[f"{part}/Connectivity"] = np.arange(used)
                root[f"{part}/Offsets"] = np.arange(used + 1)
            for name, rows in {"Points": embed(s.x), **point_data(s)}.items():
                where = name if name == "Points" else f"PointData/{name}"
                growing(root, where, rows.shape[1:], rows.dtype, min(n, 1 << 16))
            steps = root.create_group("Steps")
            steps.attrs["NSteps"] = 0
            offsets = [f"PointDataOffsets/{name}" for name in point_data(s)]
            for name in ("PartOffsets", "NumberOfParts", "PointOffsets", *offsets):
                growing(steps, name)
            growing(steps, "Values", dtype=np.float64)
            for name in ("CellOffsets", "ConnectivityIdOffsets"):
                growing(steps, name, (len(PARTS),))
            own = file.create_group("taichi_mps")
            own.attrs.update(source=source, parameters=json.dumps(sim.scene.parameters), dimension=s.x.shape[1])
            own["wall_x"] = s.wall_x

    def append(self, s: Snapshot) -> int | None:
        """Add a snapshot; its number, or None if it is not later than the last one."""
        with h5py.File(self.path, "r+", libver=("earliest", "v110")) as file:
            root, n = file["VTKHDF"], len(s.x)
            steps = root["Steps"]
            k = int(steps.attrs["NSteps"])
            if k and s.time <= steps["Values"][k - 1] + 1e-9:
                return None
            for name, rows in {"Points": embed(s.x), **point_data(s)}.items():
                put(root[name if name == "Points" else f"PointData/{name}"], k * n, rows)
            put(steps["Values"], k, [s.time])
            put(steps["NumberOfParts"], k, [1])
            for name in ("PartOffsets", "CellOffsets", "ConnectivityIdOffsets"):
                put(steps[name], k, np.zeros((1, *steps[name].shape[1:]), int))
            for dataset in (steps["PointOffsets"], *steps["PointDataOffsets"].values()):
                put(dataset, k, [k * n])
            steps.attrs["NSteps"] = k + 1
        return k

    def cut(self, last: float) -> int:
        """Forget the outputs after the time ``last`` [s]; returns how many are left."""
        with h5py.File(self.path, "r+", libver=("earliest", "v110")) as file:
            root = file["VTKHDF"]
            steps = root["Steps"]
            k = int((steps["Values"][: steps.attrs["NSteps"]] <= last + 1e-9).sum())
            steps.attrs["NSteps"] = k
            offsets = [item for item in steps.values() if isinstance(item, h5py.Dataset)]
            for dataset in (*offsets, *steps["PointDataOffsets"].values()):
                dataset.resize(k, axis=0)
            for dataset in (root["Points"], *root["PointData"].values()):
                dataset.resize(k * int(root["NumberOfPoints"][0]), axis=0)
        return k

    def replay(self):
        """The outputs one by one, each with what a picture needs of a Simulation: scene, time, snapshot, measures."""
        if not self.path.is_file():
            raise SceneError(f"run = {self.path.parent}: holds no run.h5; must be the folder of a run")
        with h5py.File(self.path, "r", locking=False) as file:
            root, own = file["VTKHDF"], file["taichi_mps"]
            scene = catalogue.build(own.attrs["source"], **json.loads(own.attrs["parameters"]))
            n, wall = int(root["NumberOfPoints"][0]), own["wall_x"][()]
            axes = [0, 2] if own.attrs["dimension"] == 2 else [0, 1, 2]
            for k, instant in enumerate(root["Steps/Values"][: root["Steps"].attrs["NSteps"]]):
                rows = slice(k * n, (k + 1) * n)
                data = {name: values[rows] for name, values in root["PointData"].items()}
                x, u = root["Points"][rows][:, axes].astype(float), data["velocity"][:, axes]
                fields = data["pressure"], data["shear_rate"], data["yielded"].astype(bool), data["density_ratio"]
                yield Replay(scene, Snapshot(float(instant), scene.spacing, x, u, *fields, wall_x=wall))


@dataclass(frozen=True)
class Replay:
    """One output of a run, read back."""

    scene: Scene
    state: Snapshot

    @property
    def time(self) -> float:
        return self.state.time

    def snapshot(self) -> Snapshot:
        return self.state

    def measures(self) -> dict[str, float]:
        return self.scene.measure(self.state) if self.scene.measure else {}


def embed(x):
    """Vectors (n, 3) in single precision of vectors (n, d); a two-dimensional scene lies in the plane y = 0."""
    x = np.asarray(x, np.float32)
    return x if x.shape[1] == 3 else np.insert(x, 1, 0.0, axis=1)


def point_data(s: Snapshot) -> dict[str, np.ndarray]:
    """velocity [m/s], pressure [Pa], shear_rate [1/s], yielded 0 or 1, density_ratio [-] of every particle."""
    scalars = {"pressure": s.p, "shear_rate": s.shear_rate, "density_ratio": s.density_ratio}
    return {
        "velocity": embed(s.u),
        "yielded": s.yielded.astype(np.uint8),
        **{name: np.asarray(values, np.float32) for name, values in scalars.items()},
    }


def growing(group, name, width=(), dtype=np.int64, chunk=256):
    """An empty dataset of rows that ``put`` can lengthen."""
    group.create_dataset(name, (0, *width), dtype, maxshape=(None, *width), chunks=(chunk, *width))


def put(dataset, first, rows):
    """Write rows from row ``first`` on and end the dataset there."""
    dataset.resize(first + len(rows), axis=0)
    dataset[first:] = rows


def strict(value):
    """The same for JSON: plain types, null for a number that is not finite."""
    if isinstance(value, dict):
        return {str(key): strict(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [strict(item) for item in value]
    value = value.item() if isinstance(value, np.generic) else value
    return None if isinstance(value, float) and not math.isfinite(value) else value


class Recorder:
    """Writes a run as it goes: history every step, run.h5 and a picture every ``every`` [s], checkpoint every minute.

    Measures cost as much as a fifth of a step, so they are taken 200 times in a run and at every output.
    ``settings`` are the options of the run that ``resume`` needs; ``picture(sim, number)`` draws one output.
    """

    def __init__(self, folder: RunFolder, sim, every: float, source: str, settings: dict, picture=None):
        self.folder, self.sim, self.source, self.settings = folder, sim, source, settings
        self.picture = picture
        self.trajectory = Trajectory(folder.trajectory)
        self.measures = sim.measures()
        self.measure_interval = max(sim.scene.until, 1e-9) / 200
        self.measured = int(sim.time / self.measure_interval)
        resumed = sim.steps > 0 and folder.trajectory.is_file()
        self.history = History(folder.history, self.measures, kept=sim.time if resumed else None)
        if resumed:
            outputs = self.trajectory.cut(sim.time)
            for extra in sorted(folder.frames.glob("*.png"))[outputs:]:
                extra.unlink()
        else:
            self.trajectory.create(sim, source)
        if self.history.empty:
            self.history.add(row_of(sim, self.measures))
        self.good = self._checkpoint()
        self.saved = time.monotonic()
        sim.each_step(self.step)
        sim.every(every, self.output)

    def _checkpoint(self):
        return checkpoint.Checkpoint.of(self.sim, self.source, self.settings)

    def step(self, sim) -> None:
        due = int(sim.time / self.measure_interval)
        if due > self.measured:
            self.measured, self.measures = due, sim.measures()
        self.history.add(row_of(sim, self.measures))
        if time.monotonic() - self.saved > CHECKPOINT_INTERVAL:
            self.good = self._checkpoint()
            self.good.write(self.folder.checkpoint)
            self.saved = time.monotonic()

    def output(self, sim) -> None:
        number = self.trajectory.append(sim.snapshot())
        if number is not None:
            self.good = self._checkpoint()
            if self.picture:
                self.picture(sim, number)

    def finish(self, stopped_by: str, error: str | None = None) -> dict:
        """Write the checkpoint (after a divergence the last good one), the last row and the summary; return it."""
        good = self.good if error else self._checkpoint()
        good.write(self.folder.checkpoint)
        summary = self.sim.summary() | {"stopped_by": stopped_by, "resume_from": str(self.folder.checkpoint)}
        self.history.close({key: value for key, value in summary.items() if key in self.measures})
        if error:
            summary["error"] = error
        self.folder.write_summary(summary)
        return strict(summary)
