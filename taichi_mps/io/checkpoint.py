"""Checkpoints: one HDF5 file from which a run continues, written whole or not at all and checked when read.

The file begins with a line of text, in what HDF5 calls its user block: format, version and sha256 of all that follows.
It is checked before HDF5 sees the file.
"""

import hashlib
import io
import json
import os
import re
from dataclasses import dataclass, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np
from pydantic import BaseModel, InstanceOf

from ..engine import NUMERICS, Problem, Scene
from ..input import catalogue
from ..units import File, SceneError, quote, regular_file, require, unit_of, user_path, validated, writing
from . import untrusted_hdf5 as untrusted

if TYPE_CHECKING:
    from .notebook import Simulation
else:
    Simulation = Any  # imported where one is made

FORMAT = "taichi_mps checkpoint"
VERSION = 7
LABEL_BYTES = 512  # size of the user block
MAX_BYTES = 2e10  # some 1e8 particles
SAMPLED_FROM = 1_000_000  # numbers of an array from which on its digest is made of a sample
# attributes of a scene on which the arrays of a state depend, and those that a state does not show
PARTICLE_ATTRIBUTES = "spacing", "fluid", "domain", "wall_particles", "inlets"
LAW_ATTRIBUTES = "materials", "gravity_vector", "walls"
FORMER_NAMES = {"typical_slope": "plastic_viscosity"}  # names of numbers of a law in digests
KEYS_OF_0_2 = {"viscous_iterations", "source"}  # of a step report, of the numerics of semi-implicit
HEADER = {
    **dict.fromkeys(("source", "scheme", "fluid", "problem"), str),
    **dict.fromkeys(("parameters", "numerics", "settings"), dict),
    "time": float,
}
SCALARS = {"time", "steps", "last_dt", "rest", "report"}


@dataclass(frozen=True)
class Checkpoint:
    """Content of a checkpoint: how a run was made, and the state from which it continues.

    Parameters
    ----------
    header : dict
        source, parameters, scheme, numerics, time [s], fluid, problem and settings.
    state : dict
        What ``Simulation.state`` returned.
    """

    header: dict
    state: dict

    @classmethod
    def of(cls, sim, source: str | None = None, settings: dict | None = None) -> "Checkpoint":
        """Copy a simulation now.

        Parameters
        ----------
        sim : Simulation
            Simulation.
        source : str, optional
            Name or file of its scene, the scene's own name by default.
        settings : dict, optional
            Options of the run.

        Returns
        -------
        Checkpoint
            Copy.
        """
        header = {
            "source": source or sim.scene.name,
            "parameters": dict(sim.scene.parameters),
            "scheme": sim.numerics.scheme,
            "numerics": sim.numerics.model_dump(mode="json"),
            "time": sim.time,
            "fluid": digest(sim.scene, PARTICLE_ATTRIBUTES),
            "problem": digest(sim.scene, laws(sim.scene)),
            "settings": settings or {},
        }
        return cls(header, sim.state())

    def write(self, path) -> Path:
        """Write a file, whole or not at all.

        Parameters
        ----------
        path : path-like
            File; one that was there becomes ``<stem>.previous.h5``.

        Returns
        -------
        Path
            The file.
        """
        path = user_path(path)
        arrays = {key: value for key, value in self.state.items() if isinstance(value, np.ndarray)}
        scalars = {key: value for key, value in self.state.items() if key not in arrays}
        whole = io.BytesIO()  # HDF5 kills the process where a disk is full when it closes a file
        with h5py.File(whole, "w", userblock_size=LABEL_BYTES) as file:
            file["header"] = json.dumps({**self.header, "scalars": scalars}, default=np.generic.item)
            for key, value in arrays.items():
                file[f"state/{key}"] = value
        content = whole.getvalue()[LABEL_BYTES:]
        partial = path.with_suffix(".partial")
        with open(partial, "wb") as file:
            label = f"{FORMAT} {VERSION} sha256 {hashlib.sha256(content).hexdigest()}\n"
            file.write(label.encode().ljust(LABEL_BYTES, b"\0") + content)
            file.flush()
            os.fsync(file.fileno())
        if path.exists():  # killed between these two lines, the run goes on from the previous one
            os.replace(path, previous(path))
        os.replace(partial, path)
        return path

    def scene(self, until: float | None = None, scene_file=None) -> Scene:
        """Make the scene again.

        Parameters
        ----------
        until : float, optional
            Time limit [s], instead of the one it had.
        scene_file : path-like, optional
            File of a scene that is not built in, which is code that the caller must name.

        Returns
        -------
        Scene
            Scene.

        Raises
        ------
        SceneError
            If it has another material, gravity or wall than the run had.
        """
        keywords = dict(self.header["parameters"])
        if until is not None and "until" in keywords:
            if keywords.get("critical_strain_rate") == "rational":  # it stays as it was chosen for the time limit
                keywords["critical_strain_rate"] = self.scene(None, scene_file).material.critical_strain_rate
            keywords["until"] = until
        scene = catalogue.rebuild(self.header["source"], keywords, scene_file)
        require(
            self.header["problem"] == digest(scene, laws(scene)),
            f"checkpoint: scene {self.header['source']} has another material, gravity or wall than when it was "
            "written; must be the same, or handed over: restore(path, scene)",
        )
        return scene

    def differing(self, source: str, parameters: dict) -> str:
        """Compare the scene with that of another file of the run.

        Parameters
        ----------
        source : str
            Name or file of its function there.
        parameters : dict
            Keywords there.

        Returns
        -------
        str
            How they differ; empty where they do not but for the time limit, what depends on it, keywords of other
            versions, and a file of the user's own, which may have been moved.
        """
        require(isinstance(parameters, dict), f"scene = {source}: its parameters are damaged")
        own, name, builtin = self.header["parameters"], self.header["source"], catalogue.names()
        if source != name and {source, name} <= set(builtin):
            return f"scene = {name}, there {source}"
        free = {"until"} | {key for key in ("critical_strain_rate",) if parameters.get(key) == "rational"}
        keys = sorted(key for key in own.keys() & parameters.keys() - free if own[key] != parameters[key])
        fields = catalogue.load(name).parameters.model_fields if keys and name in builtin else {}
        units = {key: unit_of(fields[key]).strip("-") if key in fields else "" for key in keys}
        return ", ".join(f"{k} = {quote(own[k], units[k])}, there {quote(parameters[k], units[k])}" for k in keys)

    def admit(self, scene: Scene) -> Problem:
        """Join a scene with the numerics of the run.

        Parameters
        ----------
        scene : Scene
            Scene.

        Returns
        -------
        Problem
            Problem that the state belongs to.

        Raises
        ------
        SceneError
            If it cannot be computed, or the state is not one of its particles.
        """
        require(
            self.header["fluid"] == digest(scene, PARTICLE_ATTRIBUTES),
            f"checkpoint: scene {self.header['source']} no longer makes the particles that it was written with",
        )
        problem = Problem(scene, NUMERICS[self.header["scheme"]](**self.header["numerics"]))
        for key, value in self.state.items():
            require(
                not isinstance(value, np.ndarray) or np.all(np.isfinite(value)),
                f"checkpoint: a value of {key} is not a finite number",
            )
        low, high = np.array(scene.domain, float)
        beyond = np.any(np.abs(self.state["x"] - 0.5 * (low + high)) > 1.5 * (high - low), axis=1)
        require(
            not beyond.any(),  # one that leaves the domain ends the run before it comes so far
            f"checkpoint: a particle lies at {self.state['x'][np.argmax(beyond)]} m; must be in the domain, from {low} "
            f"to {high} m",
        )
        mix, mixes = np.asarray(self.state.get("mix", 0)), len(scene.materials)
        require(
            np.all((mix >= 0) & (mix < mixes)),
            f"checkpoint: mix: must be from 0 to {mixes - 1}, the mixes of the scene",  # a kernel would read beyond
        )
        slot = np.sort(self.state.get("slot", np.zeros(0, int)))
        slot, of = slot[slot != 0], np.sort(scene.grain_places[0]) if scene.grains else np.zeros(0, int)
        of = of[of > 0]  # grain of each slot
        whole = np.isin(of, of[slot[(slot > 0) & (slot <= len(of))] - 1]) if scene.inlets else of > 0
        require(
            np.array_equal(slot, 1 + np.flatnonzero(whole)),
            f"checkpoint: slot: must have each of the {len(of)} particles in grains of the scene once",
        )
        layers, poured = [inlet.layers(scene.spacing) for inlet in scene.inlets], self.state.get("pouring", [])
        require(
            isinstance(poured, list) and len(poured) == len(layers) and all(map(possible, poured, layers)),
            f"checkpoint: pouring = {poured!r:.60}: must be a number of layers and a delay for each inlet of the "
            f"scene; they have {layers} layers",
        )
        return problem

    def resume(self, problem: Problem, profile: bool = False) -> Simulation:
        """Make a Simulation that continues from here; Taichi must be started (``init``).

        Parameters
        ----------
        problem : Problem
            What ``admit`` returned.
        profile : bool, optional
            Whether to time the stages of a step.

        Returns
        -------
        Simulation
            Simulation at the time of the checkpoint.

        Raises
        ------
        SceneError
            If the state is not one of this version.
        """
        from ..engine import DUMMY, FLUID, WALL
        from .notebook import Simulation

        sim = Simulation(problem, profile=profile)
        rows = sim.particles.count[None]
        for pouring, (entered, _) in zip(sim.pouring, self.state.get("pouring", []), strict=True):
            rows += pouring.particles(entered) - pouring.particles(pouring.entered)
        for key, array in sim.particles.read().items():
            found, right = np.shape(self.state.get(key)), (rows, *array.shape[1:])
            require(found == right, f"checkpoint: {key} has the shape {found}; must have {right}")
        kinds = self.state["kind"]
        require(
            np.all(np.isin(kinds, (FLUID, WALL, DUMMY))) and np.any(kinds == FLUID),
            f"checkpoint: kind: must be {FLUID} of fluid, {WALL} or {DUMMY} of walls, and of some {FLUID}",
        )
        try:
            sim.load(self.state)
        except (TypeError, KeyError) as error:
            raise SceneError(f"checkpoint: its state is not one of this version ({error})") from None
        return sim


@validated
def save(sim: Simulation, path: File) -> Path:
    """Write a checkpoint of a simulation.

    Parameters
    ----------
    sim : Simulation
        Simulation. A scene that is not just a built-in one with its keywords must be handed to ``restore`` again.
    path : path-like
        File; one that was there becomes ``<stem>.previous.h5``.

    Returns
    -------
    Path
        The file.

    Examples
    --------
    >>> import tempfile, taichi_mps as mps
    >>> mps.init(threads=1)
    >>> sim = mps.Simulation(mps.slump_cone(model="axisymmetric", spacing=0.05))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = mps.checkpoint.save(sim, f"{folder}/start.h5")
    ...     mps.checkpoint.restore(file).time
    0.0
    """
    require(hasattr(sim, "state"), f"sim = {quote(sim, '')}: must be a Simulation")
    with writing("path", path):
        return Checkpoint.of(sim).write(path)


@validated
def restore(path: File, scene: InstanceOf[Scene] | None = None) -> Simulation:
    """Make a Simulation that continues from a checkpoint, or from the previous one when that file is damaged.

    Parameters
    ----------
    path : path-like
        File.
    scene : Scene, optional
        Scene of the run, where it is not a built-in one with its keywords.

    Returns
    -------
    Simulation
        Simulation at the time of the checkpoint.

    Raises
    ------
    SceneError
        If the file is missing, damaged or of another scene.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> mps.checkpoint.restore("nowhere.h5")
    Traceback (most recent call last):
        ...
    taichi_mps.units.SceneError: checkpoint nowhere.h5: ...
    """
    state, _ = read_good(path)
    return state.resume(state.admit(scene or state.scene()))


def previous(path) -> Path:
    """Return where the checkpoint before this one is kept.

    Parameters
    ----------
    path : path-like
        Checkpoint.

    Returns
    -------
    Path
        File.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> mps.checkpoint.previous("checkpoint.h5").name
    'checkpoint.previous.h5'
    """
    path = user_path(path)
    return path.with_name(f"{path.stem}.previous{path.suffix}")


def read_good(path) -> tuple[Checkpoint, str]:
    """Read the newest good checkpoint.

    Parameters
    ----------
    path : path-like
        File.

    Returns
    -------
    checkpoint : Checkpoint
        Content.
    remark : str
        '' unless the previous one had to be used.

    Raises
    ------
    SceneError
        If neither can be read.
    """
    try:
        return read(path), ""
    except SceneError as error:
        try:
            return read(previous(path)), f"{error}; continuing from {previous(path).name}"
        except SceneError:
            raise error from None


def read(path) -> Checkpoint:
    """Read and verify a checkpoint.

    Parameters
    ----------
    path : path-like
        File.

    Returns
    -------
    Checkpoint
        Content.

    Raises
    ------
    SceneError
        If the file is missing, foreign, damaged or of another version.
    """
    path, content = regular_file(f"checkpoint {path}", path, MAX_BYTES), hashlib.sha256()
    try:
        with open(path, "rb") as file:
            found = re.match(rf"{FORMAT} (\d+) sha256 (\w+)\n".encode(), file.read(LABEL_BYTES))
            for part in iter(lambda: file.read(SAMPLED_FROM) if found else b"", b""):
                content.update(part)
    except OSError as error:
        raise SceneError(f"checkpoint {path}: cannot be read ({error.strerror})") from None
    version = int(found[1]) if found else VERSION
    require(
        version == VERSION, f"checkpoint {path}: of format {version}; must be of {VERSION} (version 0.2.0 also reads 6)"
    )
    require(
        found and found[2].decode() == content.hexdigest(),
        f"checkpoint {path}: damaged, or not a checkpoint of taichi_mps (its checksum is wrong)",
    )
    with untrusted.opened(path, "checkpoint") as file:
        state = untrusted.own_member(file, "state")
        arrays = {key: untrusted.numbers(state, key) for key in state}
        header = json.loads(untrusted.text(file, "header"))
        scalars = header.pop("scalars")
        for key, kind in HEADER.items():
            untrusted.demand(isinstance(header[key], kind), f"{key} is wrong")
        whole = scalars.keys() >= SCALARS and not scalars.keys() & arrays.keys()
        untrusted.demand(header["scheme"] in NUMERICS and whole, "scheme or state is wrong")
        older = KEYS_OF_0_2 & {*header["numerics"], *(scalars["report"] or ())}
        require(not older, f"checkpoint {path}: of version 0.2; version 0.3.0 reads it")
        return Checkpoint(header, {**arrays, **scalars})


def laws(scene: Scene) -> tuple[str, ...]:
    """Return the attributes of a scene that a state does not show, such as a gravity that changes in time.

    Parameters
    ----------
    scene : Scene
        Scene.

    Returns
    -------
    tuple of str
        Attributes.
    """
    given = {"gravity": scene.gravity_in_time is not None, "jolts": bool(scene.jolts)}
    return (*LAW_ATTRIBUTES, *(name for name in given if given[name]))


def digest(scene: Scene, keys) -> str:
    """Return the sha256 of attributes of a scene.

    Names of records and numbers that are the usual ones do not count, so that a checkpoint stays good when records get
    another number. Functions count by their names, large arrays by a part.

    Parameters
    ----------
    scene : Scene
        Scene.
    keys : sequence of str
        Attributes.

    Returns
    -------
    str
        Hexadecimal digits.
    """
    total = hashlib.sha256()

    def take(value):
        if isinstance(value, np.ndarray):
            total.update(f"{value.dtype.str} {value.shape}".encode())
            total.update(np.ascontiguousarray(value.reshape(-1)[:: max(1, value.size // SAMPLED_FROM)]))
        elif isinstance(value, list | tuple):
            for item in value:
                take(item)
            total.update(f"{len(value)} ".encode())
        elif isinstance(value, BaseModel) or is_dataclass(value):
            fields = type(value).model_fields if isinstance(value, BaseModel) else value.__dataclass_fields__
            values = {name: getattr(value, name) for name in fields if name != "name"}
            differing = {k: v for k, v in values.items() if isinstance(v, np.ndarray) or v != fields[k].default}
            take([type(value).__name__, *(item for k, v in differing.items() for item in (FORMER_NAMES.get(k, k), v))])
        else:
            text = getattr(value, "__qualname__", type(value).__name__) if callable(value) else value
            total.update(f"{text} ".encode())

    for key in keys:
        take(getattr(scene, key))
    return total.hexdigest()


def possible(poured, layers: int) -> bool:
    """Return whether an inlet can have poured this.

    Parameters
    ----------
    poured : object
        [layers, delay in s].
    layers : int
        Number of layers of the inlet.

    Returns
    -------
    bool
        True if it can.
    """
    return (
        isinstance(poured, list)
        and [type(number) for number in poured] in ([int, float], [int, int])
        and 0 <= poured[0] <= layers
        and 0.0 <= poured[1] < np.inf
    )
