"""The run folder: history.csv, run.h5, summary.json and checkpoint.h5, written while a run goes on."""

import csv
import io
import json
import math
import os
import time
from pathlib import Path

import numpy as np

from . import checkpoint, lock
from .quantity import SceneError
from .vtkhdf import Trajectory, due

COLUMNS = ("time_s", "dt_s", "slump_m", "spread_m", "max_speed_m_s", "kinetic_energy_J")
COLUMNS += ("unyielded_fraction", "viscous_iterations", "pressure_iterations", "volume_error")
OURS = ("history.csv", "summary.json", "checkpoint.h5")  # any of them, or a lock, marks a folder as a run
PRODUCTS = (*OURS, "checkpoint.previous.h5", "checkpoint.partial", "summary.partial", "run.h5", "animation.gif")
PRODUCTS += ("history.partial", "run.twin1", "run.twin2")
PLOTS = ("slump.png", "history.png", "filling.png")
CHECKPOINT_SHARE = 0.02  # of the time that a run takes, spent on checkpoints


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
        return any((self.path / name).is_file() for name in (*OURS, lock.NAME))

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
        try:
            facts = json.loads(self.summary.read_text(encoding="utf-8"))
        except (ValueError, RecursionError):
            facts = None
        if not isinstance(facts, dict):
            raise SceneError(f"run = {self.path}: its summary.json is damaged")
        return facts


class History:
    """history.csv, one row a step, written as it goes.

    ``kept``: continue an existing file up to that time [s]. Measures other than slump and spread get columns of
    their own at the end.
    """

    def __init__(self, path, measures: dict, kept: float | None = None):
        self.columns = (*COLUMNS, *(key for key in measures if key not in (*COLUMNS, "slump_max_m")))
        rows = [] if kept is None or not Path(path).is_file() else read_rows(path)
        rows = [row for row in rows if number(row.get("time_s")) <= kept * (1 + 1e-8)]  # of nine digits
        self.empty = not rows
        partial = Path(path).with_suffix(".partial")  # a run killed just now keeps the rows that it had
        self.file = open(partial, "w", newline="", encoding="utf-8")  # noqa: SIM115  (closed in close)
        self.writer = csv.DictWriter(self.file, self.columns, restval="nan", extrasaction="ignore")
        self.writer.writeheader()
        self.writer.writerows(rows)
        self.file.flush()
        os.replace(partial, path)

    def add(self, row: dict) -> None:
        """Write a row and flush it."""
        self.writer.writerow({key: f"{v:.9g}" if isinstance(v, float) else v for key, v in row.items()})
        self.file.flush()

    def close(self) -> None:
        self.file.close()


def row_of(sim, measures: dict) -> dict:
    """Row of history.csv of a simulation now; before the first step there is no report, and little to say."""
    report = sim.report
    if report is None:
        s = sim.snapshot()
        masses = np.array([m.density for m in sim.scene.materials])[s.mix] * sim.scene.volumes_at(s.x)
        values = (
            0.0,
            0.0,
            float(s.speed.max()),
            0.5 * float((masses * s.speed**2).sum()),
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
    """Rows of a history.csv as text; SceneError for another file."""
    try:
        with open(path, newline="", encoding="utf-8") as file:
            text = file.read()
            whole = text[: text.rfind("\n") + 1]  # a process killed while it wrote leaves a torn row
            table = csv.DictReader(io.StringIO(whole, newline=""))
            if not set(COLUMNS) <= set(table.fieldnames or ()):
                raise SceneError(f"{path}: damaged or no history of a run; must have the columns {', '.join(COLUMNS)}")
            return [{key: row[key] for key in table.fieldnames} for row in table]
    except (UnicodeError, csv.Error) as error:
        raise SceneError(f"{path}: damaged or no history of a run ({type(error).__name__})") from None


def read_history(path) -> dict[str, np.ndarray]:
    """Columns of a history.csv as arrays."""
    if not Path(path).is_file():
        raise SceneError(f"run = {Path(path).parent}: holds no history.csv; must be the folder of a run")
    rows = read_rows(path)
    return {key: np.array([number(row[key]) for row in rows]) for key in (rows[0] if rows else COLUMNS)}


def number(text) -> float:
    """The number that a text of a table is, nan where it is none."""
    try:
        return float(text)
    except (TypeError, ValueError):
        return math.nan


def strict(value):
    """The same for JSON: plain types, null for a number that is not finite."""
    if isinstance(value, dict):
        return {str(key): strict(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [strict(item) for item in value]
    value = value.item() if isinstance(value, np.generic) else value
    return None if isinstance(value, float) and not math.isfinite(value) else value


class Recorder:
    """Writes a run as it goes: history every step, run.h5 and a picture every ``every`` [s], a checkpoint at the start
    and as often as costs no more than CHECKPOINT_SHARE of the time.

    ``settings`` are the options of the run that ``resume`` needs; ``picture(sim, number)`` draws one output.
    """

    def __init__(self, folder: RunFolder, sim, every: float, source: str, settings: dict, picture=None):
        self.folder, self.sim, self.source, self.settings, self.every = folder, sim, source, settings, every
        self.picture = picture
        self.trajectory = Trajectory(folder.trajectory)
        self.measures = sim.measures()  # of the last step
        resumed = sim.steps > 0 and folder.trajectory.is_file()
        if sim.steps > 0 and not resumed and any(folder.frames.glob("*.png")):
            raise SceneError(
                f"run = {folder.path}: run.h5 is gone, by whose outputs the pictures in frames/ are numbered; move the "
                "pictures elsewhere, then resume"
            )
        self.history = History(folder.history, self.measures, kept=sim.time if sim.steps > 0 else None)
        if resumed:
            if sim.time < sim.scene.until - 1e-9:  # of a run at its end the last output stays
                outputs = self.trajectory.cut(sim.time, every)
                for extra in sorted(folder.frames.glob("*.png"))[outputs:]:
                    extra.unlink()
        else:
            self.trajectory.create(sim, source, every)
        if self.history.empty:
            self.history.add(row_of(sim, self.measures))
        self.begun, self.next = sim.steps, time.monotonic()
        if resumed:
            self.good = self._checkpoint()
        else:
            self._save()
        sim.each_step(self.step)
        sim.every(every, self.output)

    def _checkpoint(self):
        return checkpoint.Checkpoint.of(self.sim, self.source, self.settings)

    def _save(self):
        begin = time.monotonic()
        self.good = self._checkpoint()
        self.good.write(self.folder.checkpoint)
        now = time.monotonic()
        self.next = now + (now - begin) / CHECKPOINT_SHARE

    def step(self, sim) -> None:
        self.measures = sim.measures()
        self.history.add(row_of(sim, self.measures))
        if time.monotonic() > self.next and not due(sim.time, self.every):
            self._save()

    def output(self, sim) -> None:
        if sim.steps == self.begun and not due(sim.time, self.every):
            return  # a run that goes on from between two outputs has none here
        number = self.trajectory.append(sim.snapshot())
        if number is not None:
            self.good = self._checkpoint()
            if self.picture:
                self.picture(sim, number)
        if time.monotonic() > self.next:  # not before: an output needs fields of the step, which no checkpoint keeps
            self._save()

    def finish(self, stopped_by: str, error: str | None = None) -> dict:
        """Write the checkpoint (after a divergence the last good one), the last row and the summary; return it."""
        good = self.good if error else self._checkpoint()
        good.write(self.folder.checkpoint)
        self.trajectory.close()
        summary = self.sim.summary() | {"stopped_by": stopped_by, "resume_from": str(self.folder.checkpoint)}
        self.history.close()
        if self.sim.scene.over_time:
            summary |= self.sim.scene.over_time(read_history(self.folder.history))
        if error:
            summary["error"] = error
        self.folder.write_summary(summary)
        return strict(summary)
