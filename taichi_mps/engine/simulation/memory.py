"""Memory that a run takes at its peak, and the refusal of one that does not fit: bytes of the fields of f32 that the
terms allocate, and of what is read, shown and written; tests/simulation/test_forecast.py holds the sum against the peak
of whole runs.
"""

import math

import numpy as np

from ..geometry.solid import Solid
from ..linear.node_multigrid import NodeMultigrid
from ..particles.kernels import lattice_sums
from ..problem.feasibility import cells_along_axes
from ..problem.problem import Problem
from ..runtime.backend import started
from ..runtime.memory import require_available
from ..schemes.scheme import kernels
from .pouring import Pouring

PAIRS, PAIRS_OF_RINGS = 1.6, 4.0  # room for neighbours over those of a lattice; rings that moved outward are thin
PROCESS, MESHES = 300e6, 90e6  # Python, Taichi, compiled kernels, pictures; what reads the mesh of a solid
BYTES_SHOWN = 190  # of a particle of the whole body, in NumPy
BYTES_OF_CELL = 8  # of a cell
BYTES_OF_NODE = 32  # of a node of a sampled solid: distance, its row among the faces of concave edges, and those
DOUBLE_RATIO = 1.85  # fields of f64 over those of f32: positions always are, numbers of rows never
FIELDS = {  # bytes of a particle, of a pair, with multigrid of a particle and a cell more, of a particle that is read
    ("implicit", "plane"): (440, 20, 60, 180, 650),
    ("implicit", "rings"): (625, 20, 60, 180, 650),
    ("implicit", "space"): (930, 24, 180, 260, 650),
    ("semi-implicit", "plane"): (250, 20, 0, 0, 250),
    ("semi-implicit", "space"): (345, 24, 0, 0, 250),
}


def pairs_of(scene) -> float:
    """Initial capacity for neighbour pairs, over the pairs of a lattice."""
    return PAIRS_OF_RINGS if scene.axisymmetric else PAIRS


def particles_of(problem: Problem) -> int:
    """Number of particles at the end of a pour, those of walls included."""
    scene = problem.scene
    wall = len(scene.wall_particles) if problem.wall_particles else 0
    return len(scene.initial) + wall + sum(Pouring(scene, inlet).to_come for inlet in scene.inlets)


def memory_of(problem: Problem, pairs: float, precision: str, finer: float = 1.0) -> float:
    """Bytes at the peak of a run, with room for ``pairs`` times the pairs of a lattice, and the spacing divided by
    ``finer``."""
    scene, d = problem.scene, problem.scene.dimension
    kind = "rings" if scene.axisymmetric else "plane" if d == 2 else "space"
    of_particle, of_pair, coarse_particle, coarse_cell, read = FIELDS[problem.scheme, kind]
    neighbours = lattice_sums(d, scene.spacing, problem.effective_radius, *kernels(problem)).neighbours
    rows, cells = particles_of(problem) * finer**d, float(np.prod(cells_along_axes(problem))) * finer**d
    taken = rows * (of_particle + pairs * neighbours * of_pair) + cells * BYTES_OF_CELL
    if problem.wall_loads:  # force and torque on each wall
        taken += 12 * (3 if d == 2 else 6) * len(scene.measured_walls) * rows  # f32, and f64 where they are read
    if problem.scheme == "implicit" and rows >= NodeMultigrid.MIN_ROWS:
        taken += rows * coarse_particle + cells * coarse_cell
    taken *= DOUBLE_RATIO if precision == "f64" else 1.0
    nodes = [wall.values.size for wall in scene.walls if isinstance(wall, Solid)]
    taken += BYTES_OF_NODE * sum(nodes) + MESHES * bool(nodes)
    body = float(scene.volumes.sum()) / scene.spacing**3 * finer**3 if scene.axisymmetric else 0.0
    return PROCESS + taken + read * rows + BYTES_SHOWN * (body + rows * (2 ** len(scene.mirrors) - 1))


def require_memory(problem: Problem, pairs: float, precision: str | None = None) -> None:
    """Raise a SceneError, with the smallest spacing that fits, if the problem needs more memory in a precision, by
    default that of the started backend, than the machine has."""
    spacing, precision = problem.scene.spacing, precision or started()["precision"]

    def smallest(there: float) -> str:
        at = next(
            (k for k in 1.02 ** np.arange(1, 400) if memory_of(problem, pairs, precision, 1.0 / k) <= there), None
        )
        return "" if at is None else f"; spacing must be at least {math.ceil(1e5 * spacing * at) / 1e5:g} m"

    require_available(
        memory_of(problem, pairs, precision),
        f"spacing = {spacing:g} m: its {particles_of(problem):.6g} particles take",
        smallest,
    )
