"""run.h5: the outputs of a run as temporal VTKHDF PolyData, written as it goes and read back."""

import json
from dataclasses import dataclass, replace
from pathlib import Path

import h5py
import numpy as np

from . import catalogue
from .measure import Snapshot
from .quantity import SceneError
from .scene import Scene

PARTS = ("Vertices", "Lines", "Strips", "Polygons")  # order of the columns of Steps/CellOffsets


class Trajectory:
    """run.h5: the fluid at every output as temporal VTKHDF PolyData, for ParaView and VTK >= 9.4, and for ``frame``.

    The number of particles is constant (those that an inlet has yet to add wait at its mouth, with size 0), so one part
    and one set of vertices serve all steps: step k has its points at row k n. What was computed is kept: half the
    section of an axisymmetric body, with the size of its rings, or the part between mirror planes. The file is closed
    between outputs, so that it is whole whenever something else reads it. Group ``taichi_mps`` holds what VTK does not
    need: how the scene was made and the wall particles.
    """

    def __init__(self, path):
        self.path = Path(path)

    def create(self, sim, source: str) -> None:
        s, inlets = sim.snapshot(), sim.scene.inlets
        n = sim.particles.capacity if inlets else len(s.x)
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
            fields = point_data(s)
            if not sim.scene.axisymmetric and not inlets:
                del fields["size"]
            for name, rows in {"Points": embed(s.x), **fields}.items():
                where = name if name == "Points" else f"PointData/{name}"
                growing(root, where, rows.shape[1:], rows.dtype, min(n, 1 << 16))
            steps = root.create_group("Steps")
            steps.attrs["NSteps"] = 0
            offsets = [f"PointDataOffsets/{name}" for name in fields]
            for name in ("PartOffsets", "NumberOfParts", "PointOffsets", *offsets):
                growing(steps, name)
            growing(steps, "Values", dtype=np.float64)
            for name in ("CellOffsets", "ConnectivityIdOffsets"):
                growing(steps, name, (len(PARTS),))
            own = file.create_group("taichi_mps")
            own.attrs.update(source=source, parameters=json.dumps(sim.scene.parameters), dimension=s.x.shape[1])
            own["wall_x"] = s.wall_x
            if inlets:
                own["mouth"] = np.array(inlets[0].centre, float)

    def append(self, s: Snapshot) -> int | None:
        """Add a snapshot; its number, or None if it is not later than the last one."""
        with h5py.File(self.path, "r+", libver=("earliest", "v110")) as file:
            root = file["VTKHDF"]
            n = int(root["NumberOfPoints"][0])
            steps = root["Steps"]
            k = int(steps.attrs["NSteps"])
            if k and s.time <= steps["Values"][k - 1] + 1e-9:
                return None
            if len(s.x) < n:
                s = waiting(s, n, file["taichi_mps/mouth"][()])
            put(root["Points"], k * n, embed(s.x))
            for name, rows in point_data(s).items():
                if name in root["PointData"]:
                    put(root[f"PointData/{name}"], k * n, rows)
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
                there = data["size"] > 0.0 if "size" in data else slice(None)
                data = {name: values[there] for name, values in data.items()}
                x, u = root["Points"][rows][there][:, axes].astype(float), data["velocity"][:, axes]
                fields = data["pressure"], data["shear_rate"], data["yielded"].astype(bool), data["density_ratio"]
                size = data["size"].astype(float) if "size" in data else None
                yield Replay(scene, Snapshot(float(instant), scene.spacing, x, u, *fields, wall, size))


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
        return self.scene.measure(self.scene.unfold(self.state)) if self.scene.measure else {}


def waiting(s: Snapshot, n: int, mouth) -> Snapshot:
    """The snapshot with all n particles: those to come are at the mouth of the inlet [m] and have no size."""
    names = ("x", "u", "p", "shear_rate", "yielded", "density_ratio", "size")
    rows = {name: getattr(s, name) for name in names}
    more = {name: np.zeros((n - len(s.x), *values.shape[1:]), values.dtype) for name, values in rows.items()}
    more["x"] = more["x"] + mouth
    return replace(s, **{name: np.concatenate([rows[name], more[name]]) for name in names})


def embed(x):
    """Vectors (n, 3) in single precision of vectors (n, d); a two-dimensional scene lies in the plane y = 0."""
    x = np.asarray(x, np.float32)
    return x if x.shape[1] == 3 else np.insert(x, 1, 0.0, axis=1)


def point_data(s: Snapshot) -> dict[str, np.ndarray]:
    """velocity [m/s], pressure [Pa], shear_rate [1/s], yielded 0 or 1, density_ratio [-] and size [m] of every
    particle."""
    scalars = {"pressure": s.p, "shear_rate": s.shear_rate, "density_ratio": s.density_ratio, "size": s.size}
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
