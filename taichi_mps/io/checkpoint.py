"""Checkpoints: one HDF5 file from which a run continues, written whole or not at all and checked when read.

The file begins with a line of text, in what HDF5 calls its user block: format, version and sha256 of all that follows.
It is checked before HDF5 sees the file.
"""

import hashlib
import io
import json
import math
import os
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from ..geometry.solid import Solid
from ..problem import catalogue
from ..problem.materials import Material
from ..problem.numerics import NUMERICS
from ..problem.problem import Problem
from ..problem.scene import Scene
from ..units import SceneError
from . import untrusted_hdf5 as outside

FORMAT = "taichi_mps checkpoint"
VERSION = 6
LABEL = 512  # bytes of the user block
LARGE = 10_000  # numbers of an array from which on a part of it stands for all
HEADER = {"source": str, "parameters": dict, "scheme": str, "numerics": dict, "time": float, "fluid": str}
HEADER |= {"settings": dict, "problem": str}
LATER = ("fluidity",)  # what particles carry since VERSION; found anew in a step, from zero
OLDEST = {"density", "plastic_viscosity", "yield_value", "critical_strain_rate"}  # fields of the materials of VERSION
OLDEST |= {"consistency", "flow_index", "shear_stress", "growth"}
TURNING = {"angular_velocity", "pivot", "axis"}  # fields that solids had not yet in VERSION
SCALARS = {"time", "steps", "last_dt", "rest", "report"}


@dataclass(frozen=True)
class Checkpoint:
    """``header``: source, parameters, scheme, numerics, time [s], fluid, problem, settings; ``state``: that of
    Simulation."""

    header: dict
    state: dict

    @classmethod
    def of(cls, sim, source: str | None = None, settings: dict | None = None) -> "Checkpoint":
        """Copy of a simulation now; ``source`` is the scene's name or file, ``settings`` the run's own options."""
        header = {
            "source": source or sim.scene.name,
            "parameters": dict(sim.scene.parameters),
            "scheme": sim.numerics.scheme,
            "numerics": sim.numerics.model_dump(mode="json"),
            "time": sim.time,
            "fluid": particles_digest(sim.scene),
            "problem": laws_digest(sim.scene),
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
        whole = io.BytesIO()  # HDF5 kills the process where a disk is full when it closes a file
        with h5py.File(whole, "w", userblock_size=LABEL) as file:
            file["header"] = header
            for key, value in arrays.items():
                file[f"state/{key}"] = value
        whole.seek(LABEL)
        checksum = rest_of(whole)
        whole.seek(0)
        whole.write(f"{FORMAT} {VERSION} sha256 {checksum}\n".encode())
        with open(partial, "wb") as file:
            file.write(whole.getbuffer())
            file.flush()
            os.fsync(file.fileno())
        if path.exists():  # killed between these two lines, the run goes on from the previous one
            os.replace(path, previous(path))
        os.replace(partial, path)
        return path

    def scene(self, until: float | None = None, scene_file=None) -> Scene:
        """The scene, built anew from its source and parameters; ``until`` [s] replaces its end. A scene that is not a
        built-in one is made by the code of ``scene_file``, which the caller must name. SceneError if what is built has
        another material, gravity or wall than the run had."""
        keywords = dict(self.header["parameters"])
        if until is not None and "until" in keywords:
            keywords["until"] = until
        scene = catalogue.rebuild(self.header["source"], keywords, scene_file)
        if laws_digest(scene) != self.header["problem"]:
            raise SceneError(
                f"checkpoint: scene {self.header['source']} has another material, gravity or wall than when it was "
                "written; must be the same, or handed over: restore(path, scene)"
            )
        return scene

    def admit(self, scene: Scene) -> Problem:
        """The scene with the numerics of the run; SceneError unless it can be computed and the state is one of its
        particles."""
        if particles_digest(scene) != self.header["fluid"]:
            raise SceneError(
                f"checkpoint: scene {self.header['source']} no longer makes the particles that it was written with"
            )
        problem = Problem(scene, self.numerics)
        for key, value in self.state.items():
            if isinstance(value, np.ndarray) and not np.all(np.isfinite(value)):
                raise SceneError(f"checkpoint: a value of {key} is not a finite number")
        mix, mixes = np.asarray(self.state.get("mix", 0)), len(scene.materials)
        if not np.all((mix >= 0) & (mix < mixes)):  # a kernel would read beyond the mixes
            raise SceneError(f"checkpoint: mix: must be from 0 to {mixes - 1}, the mixes of the scene")
        layers, poured = [inlet.layers(scene.spacing) for inlet in scene.inlets], self.state.get("pouring", [])
        if not isinstance(poured, list) or len(poured) != len(layers) or not all(map(possible, poured, layers)):
            raise SceneError(
                f"checkpoint: pouring = {poured!r:.60}: must be a number of layers and a delay for each inlet of the "
                f"scene; they have {layers} layers"
            )
        return problem

    @property
    def numerics(self):
        """Those of the run. Before ``literal`` was an option there was no other form of semi-implicit."""
        numerics = NUMERICS[self.header["scheme"]]
        literal = {"literal": True} if "literal" in numerics.model_fields else {}
        return numerics(**literal | self.header["numerics"])

    def simulation(self, scene: Scene | None = None, profile: bool = False):
        """A Simulation that continues from here. Taichi must be started (``taichi_mps.init``)."""
        return self.resume(self.admit(scene or self.scene()), profile)

    def resume(self, problem: Problem, profile: bool = False):
        """The same, for a problem that was admitted."""
        from ..simulation.simulation import Simulation

        sim = Simulation(problem, profile=profile)
        rows = sim.particles.count[None]
        for pouring, (entered, _) in zip(sim.pouring, self.state.get("pouring", []), strict=True):
            rows += (entered - pouring.entered) * len(pouring.layer)
        state = {key: np.zeros(rows) for key in LATER} | self.state
        for key, array in sim.particles.read().items():
            found, right = np.shape(state.get(key)), (rows, *array.shape[1:])
            if found != right:
                raise SceneError(f"checkpoint: {key} has the shape {found}; must have {right}")
        try:
            sim.load(state)
        except (TypeError, KeyError) as error:
            raise SceneError(f"checkpoint: its state is not one of this version ({error})") from None
        return sim


def save(sim, path) -> Path:
    """Write a checkpoint of the simulation. A scene that is not just a built-in one with its keywords must be handed to
    ``restore`` again."""
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
    check_label(path)
    with outside.opened(path, "checkpoint") as file:
        state = outside.own(file, "state")
        arrays = {key: outside.numbers(state, key) for key in state}
        header = json.loads(outside.text(file, "header"))
        scalars = header.pop("scalars")
        for key, kind in HEADER.items():
            if not isinstance(header[key], kind):
                raise ValueError(f"{key} is wrong")
        if header["scheme"] not in NUMERICS or SCALARS - set(scalars) or set(scalars) & set(arrays):
            raise ValueError("scheme or state is wrong")
        return Checkpoint(header, {**arrays, **scalars})


def check_label(path) -> None:
    """Refuse a file without the label of this version, or with another checksum than it says."""
    try:
        with open(path, "rb") as file:
            words = file.read(LABEL).split(b"\n")[0].decode("ascii", "replace")
            checksum = rest_of(file)
    except OSError as error:
        raise SceneError(f"checkpoint {path}: cannot be read ({error.strerror})") from None
    if not words.startswith(f"{FORMAT} "):
        raise SceneError(f"checkpoint {path}: damaged, or not a checkpoint of taichi_mps {VERSION}")
    version = words.removeprefix(f"{FORMAT} ").split(" ")[0]
    if version != str(VERSION):
        raise SceneError(f"checkpoint {path}: version {version}, this program reads {VERSION}")
    if words != f"{FORMAT} {VERSION} sha256 {checksum}":
        raise SceneError(f"checkpoint {path}: damaged (its checksum is wrong)")


def rest_of(file) -> str:
    """sha256 of an open file from where it stands."""
    total = hashlib.sha256()
    while block := file.read(1 << 20):
        total.update(block)
    return total.hexdigest()


def digest(header: str, arrays: dict[str, np.ndarray]) -> str:
    """sha256 of the header and of every array's name, type, shape and bytes."""
    total = hashlib.sha256(header.encode())
    for key in sorted(arrays):
        array = np.ascontiguousarray(arrays[key])
        total.update(f"{key} {array.dtype.str} {array.shape}".encode())
        total.update(array.tobytes())
    return total.hexdigest()


def particles_digest(scene: Scene) -> str:
    """sha256 of what the arrays of a state depend on: spacing, particles, domain, inlets."""
    parts = {"fluid": scene.fluid, "domain": np.array(scene.domain, float)}
    if scene.wall_particles is not None:
        parts["walls"] = np.asarray(scene.wall_particles, float)
    inlets = f" {scene.inlets!r}" if scene.inlets else ""
    for later in (", path=None", ", height=None"):  # which inlets of VERSION had not yet
        inlets = inlets.replace(later, "")
    return digest(f"{scene.spacing!r}{inlets}", parts)


def laws_digest(scene: Scene) -> str:
    """sha256 of what no state shows: materials, gravity, walls but for their names; of functions their names, of large
    arrays a part. What mixes or solids had not yet counts only where it is given, so that older checkpoints stay good.
    """
    words, arrays = [f"{scene.gravity_vector.tolist()}"], {}
    for k, item in enumerate((*scene.materials, *scene.walls)):
        words.append(type(item).__name__)
        for name in getattr(item, "__dataclass_fields__", None) or type(item).model_fields:
            value = getattr(item, name)
            if isinstance(item, Material):
                if name not in OLDEST and value == type(item).model_fields[name].default:
                    continue
            elif name == "name" or (isinstance(item, Solid) and name in TURNING and not item.angular_velocity):
                continue
            if isinstance(value, np.ndarray) and value.size > LARGE:
                arrays[f"{k} {name}"] = value.reshape(-1)[:: value.size // LARGE]
            elif callable(value):
                words.append(f"{name} {getattr(value, '__qualname__', type(value).__name__)}")
            else:
                words.append(f"{name} {plain(value.tolist() if isinstance(value, np.ndarray) else value)!r}")
    return digest(" ".join(words), arrays)


def possible(poured, layers: int) -> bool:
    """Is this what an inlet of so many layers can have poured: [layers, delay in s]?"""
    return (
        isinstance(poured, list)
        and [type(number) for number in poured] in ([int, float], [int, int])
        and 0 <= poured[0] <= layers
        and 0.0 <= poured[1] < math.inf
    )


def plain(value):
    """A scalar, list or dict as JSON can hold it."""
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    return [plain(item) for item in value] if isinstance(value, list | tuple) else value
