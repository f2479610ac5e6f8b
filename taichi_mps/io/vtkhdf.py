"""Outputs of a run, run.h5: temporal VTKHDF PolyData, written as it goes and read back."""

import errno
import json
import os
import shutil
import warnings
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from typing import Annotated, Any

import h5py
import numpy as np
from pydantic import Field, InstanceOf

from ..engine import Frame, Grains, Scene, Snapshot, embed
from ..input import catalogue
from ..units import File, SceneError, require, validated
from . import untrusted_hdf5 as untrusted

BYTES_PER_PARTICLE, SPARE_BYTES = 64, 1 << 20  # room on the disk for an output: for each particle, and in addition
HDF5_FORMAT = "v110", "v110"  # with checksums of its structure, without which damage can make HDF5 read for ever
CHECKSUMMED = {"fletcher32": True, "chunks": True}  # options of a dataset that HDF5 checks when it is read
PARTICLE_DATASETS = "VTKHDF/Points", "VTKHDF/PointData/"  # datasets with a row for each particle of an output
FIELDS = {  # scalars of particles, {name in a Snapshot: (name in the file, type in the file, type in a Snapshot)}
    "yielded": ("yielded", np.uint8, bool),
    "mix": ("mix", np.uint8, np.int32),
    "grain": ("grain", np.int32, np.int32),
    "p": ("pressure", np.float32, np.float32),
    "shear_rate": ("shear_rate", np.float32, np.float32),
    "density_ratio": ("density_ratio", np.float32, np.float32),
    "size": ("size", np.float32, float),
}
CELL_KINDS = ("Vertices", "Lines", "Strips", "Polygons")  # order of the columns of Steps/CellOffsets


class Trajectory:
    """Outputs of a run in run.h5, for ParaView >= 5.12, pyvista and VTK >= 9.3.

    Parameters
    ----------
    path : path-like
        File.

    Notes
    -----
    The number of particles is constant (those that an inlet has yet to add wait at its mouth, with size 0), so one part
    and one set of vertices serve all steps: step k has its points at row k n. The file holds the computed part: half
    the section of an axisymmetric body, with the size of its rings, or the part between mirror planes. Group
    ``taichi_mps`` holds how the scene was made, the wall particles and the mouth of the first inlet.

    HDF5 leaves a damaged file behind when it is killed while it writes. So outputs are added to a second file, which
    then takes the place of run.h5 in one step: whoever reads run.h5, and whenever the run is killed, finds a whole file
    up to the last output.

    Examples
    --------
    >>> from taichi_mps.io.vtkhdf import Trajectory
    >>> Trajectory("nowhere/run.h5").times()
    Traceback (most recent call last):
        ...
    taichi_mps.units.SceneError: run = nowhere: holds no run.h5; must be the folder of a run
    """

    @validated
    def __init__(self, path: File):
        self.path = path
        self.twins = [self.path.with_suffix(f".twin{k}") for k in (1, 2)]
        self.pending: list[Snapshot] | None = None  # outputs that the twin lacks; None without a twin

    def create(self, sim: Any, source: str, every: float) -> None:
        """Begin a file without outputs.

        Parameters
        ----------
        sim : Simulation
            Simulation whose outputs it will hold.
        source : str
            Name or file of the scene.
        every : float
            Time between outputs [s].

        Raises
        ------
        OSError
            If the disk is full.
        """
        s, scene, inlets = sim.snapshot(), sim.scene, sim.scene.inlets
        n = sim.particles.capacity if inlets else len(s.x)
        self.close()
        self._require_room(n)
        with h5py.File(self.twins[0], "w", libver=HDF5_FORMAT) as file:
            root, own = file.create_group("VTKHDF"), file.create_group("taichi_mps")
            root.attrs["Version"] = np.array([2, 0])
            root.attrs.create("Type", b"PolyData", dtype=h5py.string_dtype("ascii", 8))
            root.create_dataset("NumberOfPoints", data=[n], **CHECKSUMMED)
            for part in CELL_KINDS:
                used = n if part == "Vertices" else 0
                root[f"{part}/NumberOfCells"] = root[f"{part}/NumberOfConnectivityIds"] = np.array([used])
                root[f"{part}/Connectivity"] = np.arange(used)
                root[f"{part}/Offsets"] = np.arange(used + 1)
            constant = {"size": not scene.axisymmetric and not inlets, "mix": len(scene.materials) == 1}
            constant["grain"] = not s.grain.any()
            for name, rows in output_rows(s, 0, n, [name for name in point_data(s) if not constant.get(name)]).items():
                chunk, shape = min(n, 1 << 16) if name.startswith(PARTICLE_DATASETS) else 256, rows.shape[1:]
                room = {"maxshape": (None, *shape), "chunks": (chunk, *shape)}
                file.create_dataset(name, (0, *shape), rows.dtype, **CHECKSUMMED | room)
            root["Steps"].attrs["NSteps"] = 0
            origin = {"source": source, "parameters": json.dumps(scene.parameters)}
            if scene.grains and scene.grains.centres is None:  # those of a grading are not of the scene's function
                names = "volume_fraction", "density", "friction", "seed", "shape"
                grains = {"diameter": scene.grains.grading} | {key: getattr(scene.grains, key) for key in names}
                origin["grains"] = json.dumps(grains, default=np.ndarray.tolist)
            texts = {name: np.bytes_(text.encode("utf-8", "surrogateescape")) for name, text in origin.items()}
            own.attrs.update(texts, dimension=s.x.shape[1], every=every)  # of fixed length, which HDF5 checks, too
            own.create_dataset("wall_x", data=s.wall_x, **CHECKSUMMED if s.wall_x.size else {})
            if inlets:
                own.create_dataset("mouth", data=np.array(inlets[0].centre, float), **CHECKSUMMED)
        os.replace(self.twins[0], self.path)

    def append(self, s: Snapshot) -> int | None:
        """Add a snapshot.

        Parameters
        ----------
        s : Snapshot
            Computed part of the fluid.

        Returns
        -------
        int or None
            Number of the output; None if it is not later than the last one.
        """
        if self.pending is not None:
            try:
                number = self._extend([*self.pending, s])
            except OSError:  # somebody has the twin open: ParaView, with what was run.h5 one output ago
                self.pending = None
        if self.pending is None:
            self.close()
            shutil.copyfile(self.path, self.twins[0])
            number = self._extend([s])
        self.pending = [s] if number is not None and self._swap_with_twin() else None
        return number

    def _extend(self, snapshots) -> int | None:
        """Add snapshots to the twin; return the number of the last one, None if it is not later than those before."""
        self._require_room(sum(len(s.x) for s in snapshots))
        with h5py.File(self.twins[0], "r+", libver=HDF5_FORMAT) as file:
            return [add_snapshot(file, s) for s in snapshots][-1]

    def _require_room(self, particles: int) -> None:
        """Raise an OSError if the disk has no room for an output: HDF5 would not return from closing the file."""
        if shutil.disk_usage(self.path.parent).free < BYTES_PER_PARTICLE * particles + SPARE_BYTES:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self.path))

    def _swap_with_twin(self) -> bool:
        """Swap run.h5 and its twin; return False if no twin is left, since the file system has no links."""
        with suppress(OSError):
            os.link(self.path, self.twins[1])
        os.replace(self.twins[0], self.path)
        self.twins.reverse()
        return self.twins[0].exists()

    def close(self) -> None:
        """Remove the twins, of this run or of one that was killed; the next output makes a new one."""
        self.pending = None
        for twin in self.twins:
            twin.unlink(missing_ok=True)

    def cut(self, last: float, every: float) -> int:
        """Remove the outputs after a time, to continue from there.

        Parameters
        ----------
        last : float
            Time of the last output to keep [s]; it is removed, too, if it was written at the end of a run between two
            regular outputs.
        every : float
            Time between outputs from now on [s].

        Returns
        -------
        int
            Number of outputs left.
        """
        self.close()
        self.check()
        shutil.copyfile(self.path, self.twins[0])
        try:
            with untrusted.readable("run", self.path), h5py.File(self.twins[0], "r+", libver=HDF5_FORMAT) as file:
                root, own = file["VTKHDF"], file["taichi_mps"]
                steps = root["Steps"]
                times = output_times(file)
                k = int(np.count_nonzero(times <= last + 1e-9))
                k -= int(k > 0 and not is_output_time(times[k - 1], own.attrs["every"]))
                own.attrs["every"], steps.attrs["NSteps"] = every, k
                for dataset in (root["Points"], *root["PointData"].values()):
                    dataset.resize(k * int(root["NumberOfPoints"][0]), axis=0)
                step_rows = [item for item in steps.values() if isinstance(item, h5py.Dataset)]
                for dataset in (*step_rows, *steps["PointDataOffsets"].values()):
                    dataset.resize(k, axis=0)
            os.replace(self.twins[0], self.path)
        finally:
            self.close()
        return k

    def check(self) -> None:
        """Check that all outputs are as they were written.

        Raises
        ------
        SceneError
            If an output is not.
        """
        self.origin()
        with self._opened() as file:
            for _ in stored_outputs(file):
                pass

    def checked_replay(self, scene_file: Any = None) -> Iterator:
        """Return ``replay`` after all outputs have been read and checked.

        Parameters
        ----------
        scene_file : path-like, optional
            File of a scene that is not built in.

        Returns
        -------
        iterator of Frame
            Outputs.

        Raises
        ------
        SceneError
            If the file is damaged or holds no output.
        """
        require(sum(1 for _ in self.replay(scene_file)), f"run = {self.path.parent}: run.h5 holds no output yet")
        return self.replay(scene_file)

    def origin(self) -> tuple[str, dict, float]:
        """Return how the scene was made.

        Returns
        -------
        source : str
            Name or file of its function.
        parameters : dict
            Keywords.
        every : float
            Time between outputs [s].
        """
        with self._opened() as file:
            own = untrusted.own_member(file, "taichi_mps")
            return (
                untrusted.text(own, "source"),
                json.loads(untrusted.text(own, "parameters")),
                float(own.attrs["every"]),
            )

    def rebuilt(self, scene_file: Any = None) -> Scene:
        """Make the scene of the run again, with its grains.

        Parameters
        ----------
        scene_file : path-like, optional
            File of a scene that is not built in.

        Returns
        -------
        Scene
            Scene.

        Raises
        ------
        SceneError
            If the file is damaged, or the scene is not built in and ``scene_file`` is not given.
        """
        source, parameters, _ = self.origin()
        scene = catalogue.rebuild(source, parameters, scene_file)
        with self._opened() as file:
            own = untrusted.own_member(file, "taichi_mps")
            if "grains" in own.attrs:
                scene = replace(scene, grains=Grains(**json.loads(untrusted.text(own, "grains"))))
        return scene

    def times(self) -> np.ndarray:
        """Return the times of the outputs.

        Returns
        -------
        ndarray, shape (k,)
            Times [s].
        """
        with self._opened() as file:
            return output_times(file)

    def _opened(self):
        require(self.path.is_file(), f"run = {self.path.parent}: holds no run.h5; must be the folder of a run")
        return untrusted.opened(self.path, "run")

    @validated
    def replay(
        self,
        scene_file: File | None = None,
        scene: InstanceOf[Scene] | None = None,
        chosen: list[Annotated[int, Field(ge=0, le=10**9)]] | None = None,
    ) -> Iterator:
        """Read the outputs one by one.

        Parameters
        ----------
        scene_file : path-like, optional
            File of a scene that is not built in, which is code that the caller must name.
        scene : Scene, optional
            Scene of the run, which is otherwise made again.
        chosen : sequence of int, optional
            Numbers of the outputs to read, all by default.

        Yields
        ------
        Frame
            Scene, time, snapshot and measures.

        Raises
        ------
        SceneError
            If the file is damaged, or belongs to another scene.
        """
        try:
            scene = scene or self.rebuilt(scene_file)
        except SceneError as error:
            raise SceneError(f"{self.path.name}: {error}") from None
        with self._opened() as file:
            n = int(untrusted.numbers(untrusted.own_member(file, "VTKHDF"), "NumberOfPoints")[0])
            wall = untrusted.numbers(untrusted.own_member(file, "taichi_mps"), "wall_x")
            require(
                n == len(scene.fluid) or scene.inlets,
                f"run {self.path}: has {n} particles, its scene makes {len(scene.fluid)}",
            )
            untrusted.demand(wall.shape[1:] == (scene.dimension,), "wall_x does not hold positions")
            axes = [0, 2] if scene.dimension == 2 else [0, 1, 2]
            low, high = np.array(scene.domain, float)
            room = high - low  # a particle leaves the domain by less than that before the run ends
            defaults = {"size": np.full(n, scene.spacing), **dict.fromkeys(("mix", "grain"), np.zeros(n, np.int32))}
            for time, points, data in stored_outputs(file, chosen):
                data = defaults | data
                untrusted.demand(
                    points.shape == data["velocity"].shape == (n, 3)
                    and all(values.shape == (n,) for name, values in data.items() if name != "velocity"),
                    f"the output at {time:g} s is incomplete",
                )
                if data["grain"].any() and not scene.grains:
                    warnings.warn(
                        f"{self.path}: of before 0.4.0, does not tell its grains: shown as mortar", stacklevel=2
                    )
                x, sizes = points[:, axes].astype(float), data["size"] / scene.spacing
                plausible = (sizes == 0.0) | ((sizes > 0.01) & (sizes < 100.0))  # a ring moved far outward is thin
                fits = sizes.any() and np.all(plausible) and np.all(np.isin(data["mix"], range(len(scene.materials))))
                inside = np.all((x > low - room) & (x < high + room))
                untrusted.demand(fits and inside, f"the output at {time:g} s is not one of this scene")
                present = sizes > 0.0
                fields = {key: data[name][present].astype(kind) for key, (name, _, kind) in FIELDS.items()}
                u = data["velocity"][present][:, axes]
                yield Frame(scene, Snapshot(time, scene.spacing, x[present], u, wall_x=wall, **fields))


def output_times(file) -> np.ndarray:
    """Return the times of the outputs in an open file.

    Parameters
    ----------
    file : h5py.File
        File.

    Returns
    -------
    ndarray, shape (k,)
        Times [s].

    Raises
    ------
    ValueError
        If they do not rise.
    """
    steps = untrusted.own_member(untrusted.own_member(file, "VTKHDF"), "Steps")
    count = int(steps.attrs["NSteps"])
    found = untrusted.numbers(steps, "Values")[:count]
    rise = found.shape == (count,) and np.all(np.isfinite(found)) and np.all(np.diff(found) > 0.0)
    untrusted.demand(rise, "the times of the outputs do not rise")
    return found


def stored_outputs(file, chosen=None):
    """Read outputs as they are stored.

    Parameters
    ----------
    file : h5py.File
        File.
    chosen : sequence of int, optional
        Numbers of the outputs, all by default.

    Yields
    ------
    tuple
        Time [s], points [m], fields by name.
    """
    root = untrusted.own_member(file, "VTKHDF")
    fields, times = untrusted.own_member(root, "PointData"), output_times(file)
    n = int(untrusted.numbers(root, "NumberOfPoints")[0])
    for k in range(len(times)) if chosen is None else chosen:
        rows = slice(k * n, (k + 1) * n)
        data = {name: untrusted.numbers(fields, name, rows=rows) for name in fields}
        yield float(times[k]), untrusted.numbers(root, "Points", rows=rows), data


def is_output_time(time, every: float):
    """Return whether times are multiples of the interval of the outputs.

    Parameters
    ----------
    time : float or ndarray
        Times [s].
    every : float
        Interval [s].

    Returns
    -------
    bool or ndarray of bool
        True for a multiple.
    """
    return np.abs(time / every - np.round(time / every)) < 1e-6


def add_snapshot(file, s: Snapshot) -> int | None:
    """Add a snapshot to an open file.

    Parameters
    ----------
    file : h5py.File
        File.
    s : Snapshot
        Fluid.

    Returns
    -------
    int or None
        Number of the output; None if it is not later than the last one.
    """
    root, own = file["VTKHDF"], file["taichi_mps"]
    steps, n = root["Steps"], int(root["NumberOfPoints"][0])
    k = int(steps.attrs["NSteps"])
    if k and s.time <= steps["Values"][k - 1] + 1e-9:
        return None
    if len(s.x) < n:
        s = with_waiting_particles(s, n, own["mouth"][()])
    for name, rows in output_rows(s, k, n, root["PointData"]).items():
        first = k * n if name.startswith(PARTICLE_DATASETS) else k
        (dataset := file[name]).resize(first + len(rows), axis=0)
        dataset[first:] = rows
    steps.attrs["NSteps"] = k + 1
    return k


def output_rows(s: Snapshot, k: int, n: int, fields) -> dict[str, np.ndarray]:
    """Return the rows that an output adds to the datasets of a file.

    Parameters
    ----------
    s : Snapshot
        Fluid.
    k : int
        Number of the output.
    n : int
        Number of particles.
    fields : container of str
        Names of the fields that the file has.

    Returns
    -------
    dict of str to ndarray
        Rows by name of the dataset: n of a dataset of particles, one of a dataset of steps.
    """
    points, data = embed_single(s.x), {name: rows for name, rows in point_data(s).items() if name in fields}
    steps = {
        **dict.fromkeys(["PointOffsets", *(f"PointDataOffsets/{name}" for name in data)], np.array([k * n])),
        "Values": np.array([s.time], float),
        "NumberOfParts": np.array([1]),
        "PartOffsets": np.array([0]),
        **dict.fromkeys(("CellOffsets", "ConnectivityIdOffsets"), np.zeros((1, len(CELL_KINDS)), int)),
    }
    return {
        "VTKHDF/Points": points,
        **{f"VTKHDF/PointData/{name}": rows for name, rows in data.items()},
        **{f"VTKHDF/Steps/{name}": rows for name, rows in steps.items()},
    }


def with_waiting_particles(s: Snapshot, n: int, mouth) -> Snapshot:
    """Add to a snapshot the particles that an inlet has yet to add, with no size.

    Parameters
    ----------
    s : Snapshot
        Fluid.
    n : int
        Number of particles of the whole run.
    mouth : ndarray, shape (d,)
        Mouth of the inlet, where they wait [m].

    Returns
    -------
    Snapshot
        Fluid of n particles.
    """
    rows = {name: getattr(s, name) for name in ("x", "u", *FIELDS)}
    more = {name: np.zeros((n - len(s.x), *values.shape[1:]), values.dtype) for name, values in rows.items()}
    more["x"] += mouth
    return replace(s, **{name: np.concatenate([values, more[name]]) for name, values in rows.items()})


def embed_single(x):
    """Embed vectors in three dimensions, in single precision.

    Parameters
    ----------
    x : ndarray, shape (n, d)
        Vectors.

    Returns
    -------
    ndarray of float32, shape (n, 3)
        Vectors.
    """
    return embed(x).astype(np.float32)


def point_data(s: Snapshot) -> dict[str, np.ndarray]:
    """Return the fields of every particle, as run.h5 names them.

    Parameters
    ----------
    s : Snapshot
        Fluid.

    Returns
    -------
    dict of str to ndarray
        velocity [m/s], pressure [Pa], shear_rate [1/s], yielded (0 or 1), density_ratio [-], size [m] and mix, and
        with grains the number of the grain.
    """
    return {"velocity": embed_single(s.u)} | {
        name: np.asarray(getattr(s, key), kind)
        for key, (name, kind, _) in FIELDS.items()
        if key != "grain" or s.grain.any()
    }
