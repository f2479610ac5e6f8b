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

COLUMNS = (
    "time_s",
    "dt_s",
    "slump_m",
    "spread_m",
    "max_speed_m_s",
    "kinetic_energy_J",
    "unyielded_fraction",
    "viscous_iterations",
    "pressure_iterations",
    "volume_error",
)
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
            raise SceneError(f"out = {self.path}: cannot be written ({error.strerror}); choose another folder") from None

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
        values = (0.0, 0.0, float(s.speed.max()), 0.5 * mass * float((s.speed**2).sum()), 1.0 - s.yielded.mean(), 0, 0, 0.0)
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
                chunk = (min(len(rows), 1 << 16), *rows.shape[1:])
                where = name if name == "Points" else f"PointData/{name}"
                root.create_dataset(where, (0, *rows.shape[1:]), rows.dtype, maxshape=(None, *rows.shape[1:]), chunks=chunk)
            steps = root.create_group("Steps")
            steps.attrs["NSteps"] = 0
            offsets = [f"PointDataOffsets/{name}" for name in point_data(s)]
            for name in ("PartOffsets", "NumberOfParts", "PointOffsets", *offsets):
                steps.create_dataset(name, (0,), np.int64, maxshape=(None,), chunks=(1024,))
            steps.create_dataset("Values", (0,), np.float64, maxshape=(None,), chunks=(1024,))
            for name in ("CellOffsets", "ConnectivityIdOffsets"):
                steps.create_dataset(name, (0, len(PARTS)), np.int64, maxshape=(None, len(PARTS)), chunks=(256, len(PARTS)))
            own = file.create_group("taichi_mps")
            own.attrs.update(source=source, parameters=json.dumps(sim.scene.parameters), dimension=s.x.shape[1])
            own["wall_x"] = s.wall_x

    def append(self, s: Snapshot) -> bool:
        """Add a snapshot; False if it is not later than the last one."""
        with h5py.File(self.path, "r+", libver=("earliest", "v110")) as file:
            root, n = file["VTKHDF"], len(s.x)
            steps = root["Steps"]
            k = int(steps.attrs["NSteps"])
            if k and s.time <= steps["Values"][k - 1] + 1e-9:
                return False
            for name, rows in {"Points": embed(s.x), **point_data(s)}.items():
                put(root[name if name == "Points" else f"PointData/{name}"], k * n, rows)
            put(steps["Values"], k, [s.time])
            put(steps["NumberOfParts"], k, [1])
            for name in ("PartOffsets", "CellOffsets", "ConnectivityIdOffsets"):
                put(steps[name], k, np.zeros((1, *steps[name].shape[1:]), int))
            for dataset in (steps["PointOffsets"], *steps["PointDataOffsets"].values()):
                put(dataset, k, [k * n])
            steps.attrs["NSteps"] = k + 1
        return True

    def cut(self, last: float) -> int:
        """Forget the outputs after the time ``last`` [s]; returns how many are left."""
        with h5py.File(self.path, "r+", libver=("earliest", "v110")) as file:
            root = file["VTKHDF"]
            steps = root["Steps"]
            k = int((steps["Values"][: steps.attrs["NSteps"]] <= last + 1e-9).sum())
            steps.attrs["NSteps"] = k
            for dataset in (*(item for item in steps.values() if isinstance(item, h5py.Dataset)), *steps["PointDataOffsets"].values()):
                dataset.resize(k, axis=0)
            for dataset in (root["Points"], *root["PointData"].values()):
                dataset.resize(k * int(root["NumberOfPoints"][0]), axis=0)
        return k
