"""run.h5: the outputs of a run as temporal VTKHDF PolyData, written as it goes and read back."""

import errno
import json
import os
import shutil
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import h5py
import numpy as np

from ..problem import catalogue
from ..problem.measures import Snapshot, embed
from ..problem.scene import Scene
from ..units import SceneError, require
from . import untrusted_hdf5 as outside

BYTES, ROOM = 64, 1 << 20  # of a particle in an output, and of all else that a file may need
FORMAT = "v110", "v110"  # of HDF5: its structure is checksummed; without that damage can make it read for ever
CHECKED = {"fletcher32": True, "chunks": True}  # an array that HDF5 checks when it is read
OF_PARTICLES = "VTKHDF/Points", "VTKHDF/PointData/"  # datasets with a row for each particle of an output
FIELDS = {  # scalars of a Snapshot, {name: (name in the file, type in the file, type)}
    "yielded": ("yielded", np.uint8, bool),
    "mix": ("mix", np.uint8, np.int32),
    "p": ("pressure", np.float32, np.float32),
    "shear_rate": ("shear_rate", np.float32, np.float32),
    "density_ratio": ("density_ratio", np.float32, np.float32),
    "size": ("size", np.float32, float),
}
PARTS = ("Vertices", "Lines", "Strips", "Polygons")  # order of the columns of Steps/CellOffsets


class Trajectory:
    """run.h5: the fluid at every output as temporal VTKHDF PolyData, for ParaView >= 5.12, pyvista and VTK >= 9.3.

    The number of particles is constant (those that an inlet has yet to add wait at its mouth, with size 0), so one part
    and one set of vertices serve all steps: step k has its points at row k n. What was computed is kept: half the
    section of an axisymmetric body, with the size of its rings, or the part between mirror planes. Group ``taichi_mps``
    holds what VTK does not need: how the scene was made, the wall particles and the mouth of the first inlet.

    HDF5 leaves a damaged file behind when it is killed while it writes. So there are two files while a run goes on:
    outputs are added to the twin, which then takes the place of run.h5 in one step. Whoever reads run.h5, and whenever
    the run is killed, finds a whole file up to the last output.
    """

    def __init__(self, path):
        self.path = Path(path)
        self.twins = [self.path.with_suffix(f".twin{k}") for k in (1, 2)]
        self.missing: list[Snapshot] | None = None  # what the twin lacks of run.h5; None where there is no twin

    def create(self, sim, source: str, every: float) -> None:
        """Begin a file without outputs, for one every ``every`` [s]."""
        s, scene, inlets = sim.snapshot(), sim.scene, sim.scene.inlets
        n = sim.particles.capacity if inlets else len(s.x)
        self.close()
        self._require_room(n)
        with h5py.File(self.twins[0], "w", libver=FORMAT) as file:
            root, own = file.create_group("VTKHDF"), file.create_group("taichi_mps")
            root.attrs["Version"] = np.array([2, 0])
            root.attrs.create("Type", b"PolyData", dtype=h5py.string_dtype("ascii", 8))
            root.create_dataset("NumberOfPoints", data=[n], **CHECKED)
            for part in PARTS:
                used = n if part == "Vertices" else 0
                root[f"{part}/NumberOfCells"] = root[f"{part}/NumberOfConnectivityIds"] = np.array([used])
                root[f"{part}/Connectivity"] = np.arange(used)
                root[f"{part}/Offsets"] = np.arange(used + 1)
            fields = point_data(s)
            if not scene.axisymmetric and not inlets:
                del fields["size"]
            if len(scene.materials) == 1:
                del fields["mix"]
            for name, rows in output(s, 0, n, fields).items():
                chunk = min(n, 1 << 16) if name.startswith(OF_PARTICLES) else 256
                shape = rows.shape[1:]
                room = {"maxshape": (None, *shape), "chunks": (chunk, *shape)}
                file.create_dataset(name, (0, *shape), rows.dtype, **CHECKED | room)
            root["Steps"].attrs["NSteps"] = 0
            told = {"source": source, "parameters": json.dumps(scene.parameters)}
            texts = {name: np.bytes_(text.encode("utf-8", "surrogateescape")) for name, text in told.items()}
            own.attrs.update(texts, dimension=s.x.shape[1], every=every)  # of fixed length, which HDF5 checks, too
            own.create_dataset("wall_x", data=s.wall_x, **CHECKED if s.wall_x.size else {})
            if inlets:
                own.create_dataset("mouth", data=np.array(inlets[0].centre, float), **CHECKED)
        os.replace(self.twins[0], self.path)

    def append(self, s: Snapshot) -> int | None:
        """Add a snapshot; its number, or None if it is not later than the last one."""
        if self.missing is not None:
            try:
                number = self._extend([*self.missing, s])
            except OSError:  # somebody has the twin open: ParaView, with what was run.h5 one output ago
                self.missing = None
        if self.missing is None:
            self.close()
            shutil.copyfile(self.path, self.twins[0])
            number = self._extend([s])
        self.missing = [s] if number is not None and self._exchange() else None
        return number

    def _extend(self, snapshots) -> int | None:
        """Add snapshots to the twin; the number of the last, or None if it is not later than what is there."""
        self._require_room(sum(len(s.x) for s in snapshots))
        with h5py.File(self.twins[0], "r+", libver=FORMAT) as file:
            return [add(file, s) for s in snapshots][-1]

    def _require_room(self, particles: int) -> None:
        """OSError where the disk has no room for an output: HDF5 would not return from closing the file."""
        if shutil.disk_usage(self.path.parent).free < BYTES * particles + ROOM:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self.path))

    def _exchange(self) -> bool:
        """The twin becomes run.h5, and run.h5 the twin: False, and no twin, where the disk has no links."""
        with suppress(OSError):
            os.link(self.path, self.twins[1])
        os.replace(self.twins[0], self.path)
        self.twins.reverse()
        return self.twins[0].exists()

    def close(self) -> None:
        """Remove the twin: this run, or one that was killed, writes no more."""
        self.missing = None
        for twin in self.twins:
            twin.unlink(missing_ok=True)

    def cut(self, last: float, every: float) -> int:
        """Forget the outputs after the time ``last`` [s], and the last one that is left if it is not a multiple of the
        interval so far, for then an end of the run has made it; go on with the interval ``every`` [s]. Returns how many
        are left."""
        self.close()
        self.check()
        shutil.copyfile(self.path, self.twins[0])
        try:
            with outside.guarded("run", self.path), h5py.File(self.twins[0], "r+", libver=FORMAT) as file:
                root, own = file["VTKHDF"], file["taichi_mps"]
                steps = root["Steps"]
                times = instants(file)
                k = int(np.count_nonzero(times <= last + 1e-9))
                k -= int(k > 0 and not due(times[k - 1], own.attrs["every"]))
                own.attrs["every"], steps.attrs["NSteps"] = every, k
                for dataset in (root["Points"], *root["PointData"].values()):
                    dataset.resize(k * int(root["NumberOfPoints"][0]), axis=0)
                of_steps = [item for item in steps.values() if isinstance(item, h5py.Dataset)]
                for dataset in (*of_steps, *steps["PointDataOffsets"].values()):
                    dataset.resize(k, axis=0)
            os.replace(self.twins[0], self.path)
        finally:
            self.close()
        return k

    def check(self) -> None:
        """SceneError unless all outputs are as they were written."""
        self.origin()
        with self._opened() as file:
            for _ in stored(file):
                pass

    def whole(self, scene_file=None):
        """``replay``, once all of it has been read: a file without outputs or with damage anywhere is refused before
        anything is made of it."""
        require(sum(1 for _ in self.replay(scene_file)), f"run = {self.path.parent}: run.h5 holds no output yet")
        return self.replay(scene_file)

    def origin(self) -> tuple[str, dict, float]:
        """How the scene was made: name or file of its function, and the keywords; and the interval of the outputs
        [s]."""
        with self._opened() as file:
            own = outside.own(file, "taichi_mps")
            return outside.text(own, "source"), json.loads(outside.text(own, "parameters")), float(own.attrs["every"])

    def times(self) -> np.ndarray:
        """Times [s] of the outputs."""
        with self._opened() as file:
            return instants(file)

    def _opened(self):
        require(self.path.is_file(), f"run = {self.path.parent}: holds no run.h5; must be the folder of a run")
        return outside.opened(self.path, "run")

    def replay(self, scene_file=None, scene=None, chosen=None):
        """The outputs one by one, each with what a picture needs of a Simulation: scene, time, snapshot, measures.
        A scene that is not a built-in one is made by the code of ``scene_file``, which the caller must name, or given
        as ``scene``. ``chosen``: numbers of the outputs to read, all by default."""
        source, parameters, _ = self.origin()
        try:
            scene = scene or catalogue.rebuild(source, parameters, scene_file)
        except SceneError as error:
            raise SceneError(f"{self.path.name}: {error}") from None
        with self._opened() as file:
            n = int(outside.numbers(outside.own(file, "VTKHDF"), "NumberOfPoints")[0])
            wall = outside.numbers(outside.own(file, "taichi_mps"), "wall_x")
            require(
                n == len(scene.fluid) or scene.inlets,
                f"run {self.path}: has {n} particles, its scene makes {len(scene.fluid)}",
            )
            if wall.ndim != 2 or wall.shape[1] != scene.dimension:
                raise ValueError("wall_x does not hold positions")
            axes = [0, 2] if scene.dimension == 2 else [0, 1, 2]
            low, high = np.array(scene.domain, float)
            room = high - low  # a particle leaves the domain by less than that before the run ends
            usual = {"size": np.full(n, scene.spacing), "mix": np.zeros(n, np.int32)}
            for k, (instant, points, data) in enumerate(stored(file, chosen)):
                data = usual | data
                if points.shape != (n, 3) or any(
                    values.shape != ((n, 3) if name == "velocity" else (n,)) for name, values in data.items()
                ):
                    raise ValueError(f"output {k} is not whole")
                x, sizes = points[:, axes].astype(float), data["size"] / scene.spacing
                thin = (sizes == 0.0) | ((sizes > 0.01) & (sizes < 100.0))  # rings moved far outward are
                known = sizes.any() and np.all(thin) and np.all(np.isin(data["mix"], range(len(scene.materials))))
                if not known or not np.all((x > low - room) & (x < high + room)):
                    raise ValueError(f"output {k} is not one of this scene")
                there = sizes > 0.0
                fields = {key: data[name][there].astype(kind) for key, (name, _, kind) in FIELDS.items()}
                u = data["velocity"][there][:, axes]
                yield Replay(scene, Snapshot(instant, scene.spacing, x[there], u, wall_x=wall, **fields))


@dataclass(frozen=True)
class Replay:
    """One output of a run, read back."""

    scene: Scene
    state: Snapshot

    @property
    def time(self) -> float:
        """[s]"""
        return self.state.time

    def snapshot(self) -> Snapshot:
        """The particles at this output."""
        return self.state

    def measures(self) -> dict[str, float]:
        """The scene's measures of the whole body at this output."""
        return self.scene.measure(self.scene.unfold(self.state)) if self.scene.measure else {}


def instants(file) -> np.ndarray:
    """Times [s] of the outputs; ValueError where they do not rise."""
    steps = outside.own(outside.own(file, "VTKHDF"), "Steps")
    count = int(steps.attrs["NSteps"])
    found = outside.numbers(steps, "Values")[:count]
    if found.shape != (count,) or not np.all(np.isfinite(found)) or not np.all(np.diff(found) > 0.0):
        raise ValueError("the times of the outputs do not rise")
    return found


def stored(file, chosen=None):
    """(time [s], points, fields by name) of each output, or of the ``chosen`` ones, as stored."""
    root = outside.own(file, "VTKHDF")
    fields, times = outside.own(root, "PointData"), instants(file)
    n = int(outside.numbers(root, "NumberOfPoints")[0])
    for k in range(len(times)) if chosen is None else chosen:
        rows = slice(k * n, (k + 1) * n)
        data = {name: outside.numbers(fields, name, rows=rows) for name in fields}
        points = outside.numbers(root, "Points", rows=rows)
        yield float(times[k]), points, data


def due(time, every: float):
    """Is this time [s] a multiple of the interval of the outputs [s]?"""
    return np.abs(time / every - np.round(time / every)) < 1e-6


def add(file, s: Snapshot) -> int | None:
    """Add a snapshot; its number, or None if it is not later than the last one."""
    root, own = file["VTKHDF"], file["taichi_mps"]
    steps, n = root["Steps"], int(root["NumberOfPoints"][0])
    k = int(steps.attrs["NSteps"])
    if k and s.time <= steps["Values"][k - 1] + 1e-9:
        return None
    if len(s.x) < n:
        s = waiting(s, n, own["mouth"][()])
    for name, rows in output(s, k, n, root["PointData"]).items():
        first = k * n if name.startswith(OF_PARTICLES) else k
        file[name].resize(first + len(rows), axis=0)
        file[name][first:] = rows
    steps.attrs["NSteps"] = k + 1
    return k


def output(s: Snapshot, k: int, n: int, fields) -> dict[str, np.ndarray]:
    """What output k of n particles adds to a file with these fields: {dataset: rows}, n rows to what is of particles,
    one to what is of outputs."""
    points, data = single(s.x), {name: rows for name, rows in point_data(s).items() if name in fields}
    first = dict.fromkeys(["PointOffsets", *(f"PointDataOffsets/{name}" for name in data)], np.array([k * n]))
    steps = first | {"Values": np.array([s.time], float), "NumberOfParts": np.array([1]), "PartOffsets": np.array([0])}
    steps |= dict.fromkeys(("CellOffsets", "ConnectivityIdOffsets"), np.zeros((1, len(PARTS)), int))
    return {
        "VTKHDF/Points": points,
        **{f"VTKHDF/PointData/{name}": rows for name, rows in data.items()},
        **{f"VTKHDF/Steps/{name}": rows for name, rows in steps.items()},
    }


def waiting(s: Snapshot, n: int, mouth) -> Snapshot:
    """The snapshot with all n particles: those to come are at the mouth of the inlet [m] and have no size."""
    rows = {name: getattr(s, name) for name in ("x", "u", *FIELDS)}
    more = {name: np.zeros((n - len(s.x), *values.shape[1:]), values.dtype) for name, values in rows.items()}
    more["x"] += mouth
    return replace(s, **{name: np.concatenate([values, more[name]]) for name, values in rows.items()})


def single(x):
    """Vectors (n, 3) in single precision of vectors (n, d)."""
    return embed(x).astype(np.float32)


def point_data(s: Snapshot) -> dict[str, np.ndarray]:
    """velocity [m/s], pressure [Pa], shear_rate [1/s], yielded 0 or 1, density_ratio [-], size [m] and mix of every
    particle."""
    scalars = {name: np.asarray(getattr(s, key), kind) for key, (name, kind, _) in FIELDS.items()}
    return {"velocity": single(s.u), **scalars}
