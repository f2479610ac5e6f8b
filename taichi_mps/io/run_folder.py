"""Folder of a run: history.csv, run.h5, summary.json and checkpoint.h5, written while a run goes on."""

import json
import os
import re
import zlib
from contextlib import suppress
from itertools import chain, count
from pathlib import Path

import numpy as np

from .. import __version__
from ..units import Flag, Place, SceneError, regular_file, require, user_path, validated, writing
from . import lock
from .vtkhdf import Trajectory

CHECKSUM = "crc32"  # key of the summary: checksum of all other keys
MARKER_FILE = "taichi_mps.json"  # written first; marks a folder as a run
RUN_FILES = (
    "case.toml",
    "history.csv",
    "summary.json",
    "checkpoint.h5",
    "checkpoint.previous.h5",
    "run.h5",
    "animation.gif",
    "history.partial",
    "summary.partial",
    "clock.partial",
    "checkpoint.partial",
    "run.twin1",
    "run.twin2",
    "slump.png",  # like the next two, which 0.2 wrote
    "history.png",
    "filling.png",
)
REPORT = "report.html"
CLOCK_FILE = "clock.json"  # while a run goes on: seconds passed and left of it, and its measures
ENDED = "rest", "time", "unyielded"  # values of ``stopped_by`` of a run that has come to its end
PICTURE_NAME = re.compile(r"frame_\d{5,}\.png")


class RunFolder:
    """Paths of the files of one run.

    Nothing is written before ``create``; only files that a run makes are ever removed.

    Parameters
    ----------
    path : path-like
        Folder.

    Examples
    --------
    >>> from taichi_mps.io.run_folder import RunFolder
    >>> RunFolder("renders/slump").history.name
    'history.csv'
    """

    @validated
    def __init__(self, path: Place):
        self.path = path
        self.frames = self.path / "frames"
        self.case = self.path / "case.toml"
        self.history = self.path / "history.csv"
        self.summary = self.path / "summary.json"
        self.trajectory = self.path / "run.h5"
        self.checkpoint = self.path / "checkpoint.h5"
        self.animation = self.path / "animation.gif"
        self.report = self.path / REPORT
        self.clock = self.path / CLOCK_FILE

    @property
    def ours(self) -> bool:
        """Whether there is a run in the folder."""
        return read_json(self.path / MARKER_FILE).get("made_by") == "taichi_mps"

    @property
    def resumable(self) -> bool:
        """Whether there is a checkpoint: a run that ended before its first one, as on a full disk, has none."""
        return self.checkpoint.is_file() or self.checkpoint.with_name("checkpoint.previous.h5").is_file()

    @property
    def lost(self) -> str:
        """Text on a run without a checkpoint: whether anything has been computed that a new run would replace."""
        begun = self.trajectory.is_file()
        if self.history.is_file():
            begun = len(self.history.read_bytes().splitlines()) > 2  # names, start, first step
        names = [path.name for path in (self.history, self.trajectory, self.summary) if path.is_file()]
        if begun or self.summary.is_file():
            return f"its {self.checkpoint.name} is missing; what was computed is in {', '.join(names)}"
        return "ended before its first checkpoint; 'taichi-mps run' with --overwrite begins it anew"

    @property
    def pictures(self) -> list[Path]:
        """Pictures that the run has made, in their order."""
        return sorted(path for path in self.frames.glob("frame_*.png") if PICTURE_NAME.fullmatch(path.name))

    @validated
    def check(self, overwrite: Flag = False) -> None:
        """Refuse a path that cannot become the folder of a run, before anything is computed.

        Parameters
        ----------
        overwrite : bool, optional
            Whether a run that is there may be replaced.

        Raises
        ------
        SceneError
            If the path is a file, somebody else's folder, or holds a run that may not be replaced.
        """
        path = self.path
        require(os.path.isdir(path) or not os.path.exists(path), f"out = {path}: is a file; must be a folder")
        with writing("out", path, " folder"):
            there = {item.name for item in path.iterdir()} - {lock.NAME} if path.exists() else set()
        require(not there or self.ours, f"out = {path}: holds other files and no run; must be a new or empty folder")
        if there and not overwrite:
            done = read_json(self.summary).get("stopped_by") in ENDED
            other = f"'taichi-mps resume {path}' goes on with it, " if self.resumable and not done else ""
            raise SceneError(f"out = {path}: holds a run already; {other}--overwrite replaces it")
        self.check_frames()

    def check_frames(self) -> None:
        """Refuse a folder whose pictures lie elsewhere.

        Raises
        ------
        SceneError
            If ``frames`` is a link or a file.
        """
        require(not self.frames.is_symlink(), f"out = {self.path}: its frames lie elsewhere; must be another folder")
        require(
            self.frames.is_dir() or not self.frames.exists(),
            f"out = {self.path}: {self.frames} is a file; must be a folder or absent",
        )

    def check_pictures(self) -> None:
        """Refuse to go on with a run whose pictures have lost their outputs.

        Raises
        ------
        SceneError
            If there are pictures but no run.h5.
        """
        require(
            self.trajectory.is_file() or not self.pictures,
            f"run = {self.path}: run.h5 is gone, by whose outputs the pictures in frames/ are numbered; move the "
            "pictures elsewhere, then resume",
        )

    @validated
    def create(self, overwrite: Flag = False) -> None:
        """Make the folder, and remove the files of an earlier run.

        Parameters
        ----------
        overwrite : bool, optional
            Whether a run that is there may be replaced.

        Raises
        ------
        SceneError
            If that is impossible.
        """
        self.check(overwrite)
        with writing("out", self.path, " folder"):
            self.path.mkdir(parents=True, exist_ok=True)
            self.mark()
            for name in (*RUN_FILES, REPORT, CLOCK_FILE):
                (self.path / name).unlink(missing_ok=True)
            clear_pictures(self.frames)

    def mark(self) -> None:
        """Mark the folder as that of a run."""
        write_whole(self.path / MARKER_FILE, json.dumps({"made_by": "taichi_mps", "version": __version__}) + "\n")

    @validated
    def write_summary(self, summary: dict) -> None:
        """Write summary.json whole or not at all; numbers that are not finite become null.

        Parameters
        ----------
        summary : dict
            What ``Simulation.summary`` returned, and how the run ended.
        """
        facts = strict(summary)
        facts |= {CHECKSUM: facts_checksum(facts)}
        write_whole(self.summary, json.dumps(facts, indent=2, allow_nan=False) + "\n")

    def read_summary(self) -> dict:
        """Read summary.json.

        Returns
        -------
        dict
            Results and settings of the run.

        Raises
        ------
        SceneError
            If the file is missing or damaged.
        """
        why = f"'taichi-mps resume {self.path}' goes on with it, 'taichi-mps report {self.path}' shows how far it came"
        why = f"did not come to its end: {why}" if self.resumable else self.lost
        why = why if self.ours else "holds no summary.json; must be the folder of a run"
        require(self.summary.is_file(), f"run = {self.path}: {why}")
        facts = read_json(self.summary)
        require(facts.pop(CHECKSUM, None) == facts_checksum(facts), f"run = {self.path}: its summary.json is damaged")
        return facts

    def summary_at(self, time: float) -> dict:
        """Read summary.json if the run has come to its end at a time.

        Parameters
        ----------
        time : float
            Time of its checkpoint [s].

        Returns
        -------
        dict
            Results and settings of the run; empty if it has not ended then, or the file is missing or damaged.
        """
        with suppress(SceneError):
            facts = self.read_summary()
            return facts if facts.get("stopped_by") in ENDED and facts.get("simulated_seconds") == time else {}
        return {}

    def check_checkpoint(self, path: Path, state: dict) -> str:
        """Refuse a checkpoint of another run than the one in the folder.

        Parameters
        ----------
        path : Path
            File of the checkpoint.
        state : Checkpoint
            Content.

        Returns
        -------
        str
            Names of the files of the run that are missing, empty if there are all.

        Raises
        ------
        SceneError
            If the folder is not that of a run, has pictures but no run.h5, or the checkpoint's scene is not that of
            run.h5.
        """
        require(
            self.ours or self.trajectory.is_file(),
            f"run = {self.path}: holds a checkpoint but not its run; must be the whole folder of the run",
        )
        self.check_pictures()
        if self.trajectory.is_file():
            differing = state.differing(*Trajectory(self.trajectory).origin()[:2])
            require(not differing, f"checkpoint {path}: of another run than {self.trajectory}: {differing}")
        return " and ".join(path.name for path in (self.history, self.trajectory) if not path.is_file())


def next_free(path) -> Path:
    """Return a path where nothing is.

    Parameters
    ----------
    path : path-like
        Wanted path.

    Returns
    -------
    Path
        The path, or the first of path-2, path-3, ... where nothing is.
    """
    path = user_path(path)
    others = (path.with_name(f"{path.name}-{number}") for number in count(2))
    return next(free for free in chain([path], others) if not os.path.lexists(free))


def write_whole(path: Path, text: str) -> None:
    """Write a text file whole or not at all; an existing file stays until then."""
    partial = path.with_suffix(".partial")
    try:
        partial.write_text(text, encoding="utf-8")
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)


def clear_pictures(folder: Path) -> None:
    """Make a folder for pictures, and remove those of an earlier run.

    Parameters
    ----------
    folder : Path
        Folder.

    Raises
    ------
    SceneError
        If it is a link to another folder.
    """
    require(not folder.is_symlink(), f"{folder}: is a link to another folder; must be a folder, or nothing")
    folder.mkdir(exist_ok=True)
    for picture in folder.iterdir():
        if PICTURE_NAME.fullmatch(picture.name):
            picture.unlink()


def read_json(path: Path) -> dict:
    """Read the object in a JSON file.

    Parameters
    ----------
    path : Path
        File.

    Returns
    -------
    dict
        Object; empty where there is none.
    """
    with suppress(OSError, ValueError, RecursionError):
        facts = json.loads(regular_file(path.name, path, 1e8).read_text(encoding="utf-8"))
        return facts if isinstance(facts, dict) else {}
    return {}


def facts_checksum(facts: dict) -> str:
    """Return the CRC-32 of a JSON object, in hexadecimal digits."""
    return f"{zlib.crc32(json.dumps(facts, sort_keys=True).encode()):08x}"


def strict(value):
    """Convert a value for JSON: plain types, null for a number that is not finite.

    Parameters
    ----------
    value : object
        Value, with NumPy scalars and nan.

    Returns
    -------
    object
        Value that JSON can hold.
    """
    return json.loads(json.dumps(value, default=np.generic.item), parse_constant=lambda _: None)
