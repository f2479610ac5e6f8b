"""Checkpoints: one HDF5 file from which a run continues, written whole or not at all and checked when read."""

import hashlib
import json
import os
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from . import catalogue
from .quantity import SceneError
from .scene import NUMERICS, Scene

FORMAT = "taichi_mps checkpoint"
VERSION = 1


@dataclass(frozen=True)
class Checkpoint:
    """``header``: source, parameters, scheme, numerics, time [s], fluid, settings; ``state``: that of Simulation."""

    header: dict
    state: dict

    @classmethod
    def of(cls, sim, source: str | None = None, settings: dict | None = None) -> "Checkpoint":
        """Copy of a simulation now; ``source`` is the scene's name or file, ``settings`` the run's own options."""
        header = {
            "source": source or sim.scene.name,
            "parameters": dict(sim.scene.parameters),
            "scheme": next(name for name, kind in NUMERICS.items() if isinstance(sim.numerics, kind)),
            "numerics": sim.numerics.model_dump(mode="json"),
            "time": sim.time,
            "fluid": fingerprint(sim.scene),
            "settings": settings or {},
        }
        return cls(header, sim.state())

    def write(self, path) -> Path:
        """Write atomically; the file that was there becomes ``<stem>.previous.h5``."""
        path = Path(path)
        arrays = {key: value for key, value in self.state.items() if isinstance(value, np.ndarray)}
        scalars = {key: plain(value) for key, value in self.state.items() if key not in arrays}
        header = json.dumps({**self.header, "scalars": scalars})
        partial = path.with_suffix(".partial")
        with h5py.File(partial, "w") as file:
            file.attrs.update(format=FORMAT, version=VERSION, sha256=digest(header, arrays))
            file["header"] = header
            for key, value in arrays.items():
                file[f"state/{key}"] = value
        with open(partial, "rb+") as file:
            os.fsync(file.fileno())
        if path.exists():
            os.replace(path, previous(path))
        os.replace(partial, path)
        return path

    def scene(self, until: float | None = None) -> Scene:
        """The scene, built anew from its source and parameters; ``until`` [s] replaces its end."""
        keywords = dict(self.header["parameters"])
        if until is not None and "until" in keywords:
            keywords["until"] = until
        return catalogue.build(self.header["source"], **keywords)

    def simulation(self, scene: Scene | None = None, profile: bool = False):
        """A Simulation that continues from here. Taichi must be started (``taichi_mps.init``)."""
        from .simulation import Simulation

        scene = scene or self.scene()
        if fingerprint(scene) != self.header["fluid"]:
            raise SceneError(
                f"checkpoint: scene {self.header['source']} no longer makes the particles that it was written with"
            )
        numerics = NUMERICS[self.header["scheme"]](**self.header["numerics"])
        sim = Simulation(scene, numerics, profile=profile)
        sim.load(self.state)
        return sim


def save(sim, path) -> Path:
    """Write a checkpoint of the simulation. A scene outside the catalogue must be handed to ``restore`` again."""
    return Checkpoint.of(sim).write(path)


def restore(path, scene: Scene | None = None):
    """Simulation that continues from the checkpoint file, or from the previous one when that file is damaged."""
    return read_good(path)[0].simulation(scene)


def previous(path) -> Path:
    """Where the checkpoint before this one is kept."""
    path = Path(path)
    return path.with_name(f"{path.stem}.previous{path.suffix}")


def read_good(path) -> tuple[Checkpoint, str]:
    """The newest good checkpoint and a remark, '' unless the previous one had to be used."""
    try:
        return read(path), ""
    except SceneError as error:
        try:
            return read(previous(path)), f"{error}; continuing from {previous(path).name}"
        except SceneError:
            raise error from None


def read(path) -> Checkpoint:
    """Read and verify; SceneError naming the file if it is missing, foreign, damaged or of another version."""
    path = Path(path)
    if not path.is_file():
        raise SceneError(f"checkpoint {path}: no such file")
    try:
        with h5py.File(path, "r", locking=False) as file:
            if file.attrs.get("format") != FORMAT:
                raise SceneError(f"checkpoint {path}: not a checkpoint of taichi_mps")
            if file.attrs["version"] != VERSION:
                raise SceneError(f"checkpoint {path}: version {file.attrs['version']}, this program reads {VERSION}")
            text = file["header"].asstr()[()]
            arrays = {key: dataset[()] for key, dataset in file["state"].items()}
            good = file.attrs["sha256"] == digest(text, arrays)
    except (OSError, KeyError, RuntimeError, UnicodeError, TypeError) as error:
        raise SceneError(f"checkpoint {path}: damaged or not a checkpoint ({brief(error)})") from None
    if not good:
        raise SceneError(f"checkpoint {path}: damaged (its checksum is wrong)")
    header = json.loads(text)
    return Checkpoint(header, {**arrays, **header.pop("scalars")})


def digest(header: str, arrays: dict[str, np.ndarray]) -> str:
    """sha256 of the header and of every array's name, type, shape and bytes."""
    total = hashlib.sha256(header.encode())
    for key in sorted(arrays):
        array = np.ascontiguousarray(arrays[key])
        total.update(f"{key} {array.dtype.str} {array.shape}".encode())
        total.update(array.tobytes())
    return total.hexdigest()


def fingerprint(scene: Scene) -> str:
    """sha256 of what the arrays of a state depend on: spacing, particles, domain, inlets."""
    parts = {"fluid": scene.fluid, "domain": np.array(scene.domain, float)}
    if scene.wall_particles is not None:
        parts["walls"] = np.asarray(scene.wall_particles, float)
    inlets = f" {scene.inlets!r}" if scene.inlets else ""
    return digest(f"{scene.spacing!r}{inlets}", parts)


def plain(value):
    """A scalar, list or dict as JSON can hold it."""
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    return [plain(item) for item in value] if isinstance(value, list | tuple) else value


def brief(error: Exception) -> str:
    """The first line of an error, without h5py's details."""
    return str(error).split("\n", 1)[0].split("(", 1)[0].strip() or type(error).__name__
