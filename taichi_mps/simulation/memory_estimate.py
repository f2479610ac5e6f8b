"""How many bytes a problem will take, before any of them is allocated: fields, and what is read, shown and written.

Bytes are those of fields of f32, counted from the fields that the terms allocate. tests/simulation/test_memory.py holds
the sum against the peak of whole runs.
"""

import math
from dataclasses import dataclass

import numpy as np

from ..geometry.solid import Solid
from ..linear.cell_multigrid import CellMultigrid
from ..linear.node_multigrid import NodeMultigrid
from ..memory import admit
from ..particles.kernels import lattice_sums
from ..problem.feasibility import sides
from ..runtime.backend import started
from ..schemes.scheme import kernels

PROCESS = 300e6  # Python, Taichi, compiled kernels, pictures
SHOWN = 190  # of a particle of the whole body, in NumPy
GRID = 8  # of a cell
SOLID = 32  # of a node of a sampled solid: distance, its row among the faces of inner edges, and those
DOUBLE = 1.85  # fields of f64 over those of f32: positions always are, numbers of rows never


@dataclass(frozen=True)
class Fields:
    """Bytes that a scheme takes: of a particle, a pair of neighbours, with multigrid of a particle and a cell more, and
    of a particle in NumPy where it is read and written."""

    particle: int
    pair: int
    multigrid_particle: int
    multigrid_cell: int
    read: int


FIELDS = {  # by scheme and kind of scene
    ("implicit", "plane"): Fields(440, 20, 60, 180, 650),
    ("implicit", "rings"): Fields(625, 20, 60, 180, 650),
    ("implicit", "space"): Fields(930, 24, 180, 260, 650),
    ("semi-implicit", "plane"): Fields(250, 20, 8, 215, 250),
    ("semi-implicit", "space"): Fields(345, 24, 8, 455, 250),
}


def particles_of(problem, to_come: int) -> int:
    """How many there will be at most, those of walls and ``to_come`` of inlets included."""
    wall = len(problem.scene.wall_particles) if problem.wall_particles else 0
    return len(problem.scene.initial) + wall + to_come


def estimate(problem, to_come: int, pairs_per_particle: float, finer: float = 1.0, precision=None) -> float:
    """Bytes at the peak of a run, with room for so many times the pairs of a lattice. ``finer``: with the spacing
    divided by that; ``precision``: f32 or f64, by default that of the started backend."""
    scene, d = problem.scene, problem.scene.dimension
    kind = "rings" if scene.axisymmetric else "plane" if d == 2 else "space"
    fields = FIELDS[problem.scheme, kind]
    neighbours = lattice_sums(d, scene.spacing, problem.effective_radius, *kernels(problem)).neighbours
    rows, cells = particles_of(problem, to_come) * finer**d, float(np.prod(sides(problem))) * finer**d
    multigrid = NodeMultigrid if problem.scheme == "implicit" else CellMultigrid
    coarse = rows >= multigrid.PAY_FROM
    taken = rows * (fields.particle + pairs_per_particle * neighbours * fields.pair) + cells * GRID
    if problem.wall_loads:  # force and torque on each wall
        taken += 12 * (3 if d == 2 else 6) * len(scene.measured_walls) * rows  # f32, and f64 where they are read
    taken += coarse * (rows * fields.multigrid_particle + cells * fields.multigrid_cell)
    taken *= DOUBLE if (precision or started()["precision"]) == "f64" else 1.0
    taken += SOLID * sum(wall.values.size for wall in scene.walls if isinstance(wall, Solid))
    body = float(scene.volumes.sum()) / scene.spacing**3 * finer**3 if scene.axisymmetric else 0.0
    return PROCESS + taken + fields.read * rows + SHOWN * (body + rows * (2 ** len(scene.mirrors) - 1))


def require_memory(problem, to_come: int, pairs_per_particle: float) -> None:
    """SceneError, with the smallest spacing that fits, where the machine has not as much as the problem takes."""
    spacing = problem.scene.spacing

    def needed(at: float) -> float:
        return estimate(problem, to_come, pairs_per_particle, spacing / at)

    def smallest(there: float) -> str:
        at = next((at for at in spacing * 1.02 ** np.arange(1, 400) if needed(at) <= there), None)
        return "" if at is None else f"; spacing must be at least {math.ceil(1e5 * at) / 1e5:g} m"

    what = f"spacing = {spacing:g} m: its {particles_of(problem, to_come):.6g} particles take"
    admit(needed(spacing), what, smallest)
