"""The MPS weight and its exact sums over a full lattice and over the lattice behind a plane wall (eqs 10, 13, 14)."""

from dataclasses import dataclass

import numpy as np

from .backend import ti


@ti.func
def weight(r, re):
    """w(r) = re/r - 1 inside the effective radius, else 0 [-] (eq 10); r [m] is kept away from zero."""
    return ti.max(re / ti.max(r, 0.01 * re) - 1.0, 0.0)


@dataclass(frozen=True)
class LatticeConstants:
    """Sums over a full cubic lattice of spacing l0 in d dimensions."""

    n0: float  # particle number density [-], eq 13
    lam: float  # lambda = sum w r^2 / sum w [m2], eq 14
    neighbours: int  # particles within the effective radius


def _weights(r, effective_radius):
    return np.where(r < effective_radius, effective_radius / np.maximum(r, 1e-300) - 1.0, 0.0)


def lattice_constants(dimension: int, spacing: float, effective_radius: float) -> LatticeConstants:
    """n0, lambda and the neighbour count of the initial arrangement."""
    reach = int(effective_radius / spacing) + 1
    axis = np.arange(-reach, reach + 1) * spacing
    points = np.stack(np.meshgrid(*[axis] * dimension), -1).reshape(-1, dimension)
    r = np.linalg.norm(points, axis=1)
    r = r[(r > 0.5 * spacing) & (r < effective_radius)]
    w = _weights(r, effective_radius)
    return LatticeConstants(float(w.sum()), float((w * r * r).sum() / w.sum()), len(r))


def half_space_table(dimension: int, spacing: float, effective_radius: float, entries: int = 256) -> np.ndarray:
    """Sums over the lattice that would fill the solid behind a plane wall, (entries, 6), for a particle at distance
    z = effective_radius * k/(entries - 1) in front of it: neighbours; n; sum (w/r^2) t t and sum (w/r^2) z z of the
    tangential and normal components; sum w z/r; sum max(0, 1 - r/(1.5 l0)) z/r (for the shift). The first ghost
    layer lies half a spacing behind the wall.
    """
    reach = int(effective_radius / spacing) + 2
    axis = np.arange(-reach, reach + 1) * spacing
    depth = (np.arange(reach) + 0.5) * spacing
    grid = np.stack(np.meshgrid(*[axis] * (dimension - 1), depth, indexing="ij"), -1).reshape(-1, dimension)
    table = np.zeros((entries, 6))
    for k in range(entries):
        point = grid.copy()
        point[:, -1] += effective_radius * k / (entries - 1)
        r = np.linalg.norm(point, axis=1)
        w = _weights(r, effective_radius)
        wr2 = w / r**2
        z = point[:, -1]
        near = np.maximum(0.0, 1.0 - r / (1.5 * spacing))
        table[k] = [
            (r < effective_radius).sum(),
            w.sum(),
            (wr2 * point[:, 0] ** 2).sum(),
            (wr2 * z**2).sum(),
            (w * z / r).sum(),
            (near * z / r).sum(),
        ]
    return table
