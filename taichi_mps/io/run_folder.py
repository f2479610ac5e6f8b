"""The run folder: history.csv, run.h5, summary.json and checkpoint.h5, written while a run goes on."""

import json
import math
import os
from pathlib import Path

import numpy as np

from ..units import SceneError
from . import lock

OURS = ("history.csv", "summary.json", "checkpoint.h5")  # any of them, or a lock, marks a folder as a run
PRODUCTS = (*OURS, "checkpoint.previous.h5", "checkpoint.partial", "summary.partial", "run.h5", "animation.gif")
PRODUCTS += ("history.partial", "run.twin1", "run.twin2")
PLOTS = ("slump.png", "history.png", "filling.png")


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
        """Is there a run in the folder?"""
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
        """summary.json; SceneError where it is missing or damaged."""
        if not self.summary.is_file():
            raise SceneError(f"run = {self.path}: holds no summary.json; must be the folder of a run")
        try:
            facts = json.loads(self.summary.read_text(encoding="utf-8"))
        except (ValueError, RecursionError):
            facts = None
        if not isinstance(facts, dict):
            raise SceneError(f"run = {self.path}: its summary.json is damaged")
        return facts


def strict(value):
    """The same for JSON: plain types, null for a number that is not finite."""
    if isinstance(value, dict):
        return {str(key): strict(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [strict(item) for item in value]
    value = value.item() if isinstance(value, np.generic) else value
    return None if isinstance(value, float) and not math.isfinite(value) else value
