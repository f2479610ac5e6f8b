"""Weights and their exact sums over a full lattice and over the lattice behind a wall (eqs 10, 13, 14)."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..runtime.backend import ti


@ti.pyfunc
def mps_weight(q):
    """w = re/r - 1 of the paper (eq 10) at q = r/re, 0 < q <= 1 [-]."""
    return 1.0 / q - 1.0


@ti.pyfunc
def smooth_weight(q):
    """w = q^2 (1 - q)^4 (1 + 4 q), with which the fit has Wendland's kernel for w/r^2, at q = r/re, 0 < q <= 1 [-]."""
    return q * q * (1.0 - q) ** 4 * (1.0 + 4.0 * q)


def kaiser_bessel(b: float) -> Callable:
    """The window (I0(b sqrt(1 - q^2)) - 1)/(I0(b) - 1) at q = r/re, 0 to 1 [-], as a series in 1 - q^2, the highest
    power first; for b up to 11 the terms left out are below 1e-7."""
    terms = [(0.25 * b**2) ** k / math.factorial(k) ** 2 for k in range(1, 17)]
    series = tuple(term / sum(terms) for term in reversed(terms))

    @ti.pyfunc
    def window(q):
        remainder = 1.0 - q * q
        total = 0.0 * q
        for factor in ti.static(series):
            total = (total + factor) * remainder
        return total

    return window


# Packing kernels, whose sums hardly depend on the order of the particles (docs/equations.md, I11). In the plane rows
# stay rows and slide past each other: all lattices alike to 0.06 %. In space, and among rings, disorder counts.
PACKING_IN_PLANE, PACKING = kaiser_bessel(11.0), kaiser_bessel(10.0)


@dataclass(frozen=True)
class LatticeSums:
    """Sums over a full cubic lattice of spacing l0 in d dimensions."""

    n0: float  # particle number density [-], eq 13
    lam: float  # lambda = sum w r^2 / sum w [m2], eq 14
    neighbours: int  # particles within the effective radius
    surface_normal: float  # sum w cos, to the normal, of a particle in the first row below a flat surface [-]
    packing: float  # 1 + sum of the packing kernel [-]
    weight: Callable  # weight function w
    packing_kernel: Callable  # kernel of ``packing``


def lattice_sums(
    dimension: int,
    spacing: float,
    effective_radius: float,
    weight: Callable = mps_weight,
    packing_kernel: Callable = PACKING,
) -> LatticeSums:
    """Sums over the cubic lattice in which the particles begin."""
    cells = int(effective_radius / spacing) + 1
    points = np.stack(np.meshgrid(*[np.arange(-cells, cells + 1) * spacing] * dimension), -1).reshape(-1, dimension)
    r = np.linalg.norm(points, axis=1)
    near = (r > 0.5 * spacing) & (r < effective_radius)
    r, height = r[near], points[near, 0]
    w = weight(r / effective_radius)
    return LatticeSums(
        n0=float(w.sum()),
        lam=float((w * r * r).sum() / w.sum()),
        neighbours=len(r),
        surface_normal=float(0.5 * (w * np.abs(height) / r).sum()),
        packing=float(1.0 + packing_kernel(r / effective_radius).sum()),
        weight=weight,
        packing_kernel=packing_kernel,
    )


def ring_table(spacing: float, effective_radius: float, ratios, weight: Callable = mps_weight) -> np.ndarray:
    """(n, 2): n0, and the packing with each particle counted by its cross-section ratio, of square lattices whose cells
    are these ratios of spacing^2 [-]. The effective radius stays that of the spacing."""
    lattices = [lattice_sums(2, spacing * ratio**0.5, effective_radius, weight) for ratio in ratios]
    return np.array([[sums.n0, ratio * sums.packing] for ratio, sums in zip(ratios, lattices, strict=True)])


GHOST_SUMS = ("neighbours", "n", "gradient", "tangential", "normal", "inward", "repulsion", "packing")


def ghost_table(
    dimension,
    spacing,
    effective_radius,
    entries=256,
    curvature=0.0,
    size=1.0,
    weight=mps_weight,
    packing_kernel=PACKING,
) -> np.ndarray:
    """Sums over the ghost lattice behind a wall, (entries, 8), columns GHOST_SUMS, for a particle at distance
    z = effective_radius * max(k, 1)/(entries - 1) in front of it. A ghost lies at depth d = l0/2, 3 l0/2, ... behind
    the wall and h, t are its normal and one tangential distance from the particle: h = z + d and t = 0, l0, ... behind
    a plane. Behind a wall with a curvature [1/m] along t, positive with the fluid inside, they are bent onto arcs:

    neighbours 1; n w; gradient 2 (w/r^2) h [1/m]; tangential (w/r^2) t^2 (1 + d/z); normal (w/r^2) h^2;
    inward w h/r; repulsion max(0, 1 - r/(1.5 l0)) h/r; packing the packing kernel.

    ``size`` over l0 is the spacing of ghosts that stand closer than l0; each then counts size^2 in neighbours, n and
    packing.
    """
    spacing = size * spacing
    ghosts = _lattice_behind(dimension, spacing, effective_radius)
    z = effective_radius * np.maximum(np.arange(entries), 1) / (entries - 1)
    table = _terms(ghosts, z[:, None], spacing, effective_radius, weight, packing_kernel, curvature).sum(2).T.copy()
    table[:, [GHOST_SUMS.index(name) for name in ("neighbours", "n", "packing")]] *= size**2
    return table


def _lattice_behind(dimension, spacing, effective_radius):
    """Ghosts (n, d): tangential distances from the particle, and last the depth behind the wall [m]."""
    cells = int(effective_radius / spacing) + 2
    axis = np.arange(-cells, cells + 1) * spacing
    depth = (np.arange(cells) + 0.5) * spacing
    return np.stack(np.meshgrid(*[axis] * (dimension - 1), depth, indexing="ij"), -1).reshape(-1, dimension)


def _terms(ghosts, z, spacing, effective_radius, weight, packing_kernel, curvature=0.0):
    """Contributions of each ghost to GHOST_SUMS of particles at the distances z, (k, 1): (8, k, n)."""
    t, d = ghosts[:, 0], ghosts[:, -1]
    h = z + d
    if curvature != 0.0:
        arc = 1.0 / curvature + d
        h, t = h - arc * (1.0 - np.cos(t / arc)), arc * np.sin(t / arc)
    r = np.sqrt(t**2 + (ghosts[:, 1:-1] ** 2).sum(1) + h**2)
    q = np.minimum(1.0, r / effective_radius)
    w = weight(q)
    wr2 = w / r**2
    return np.stack(
        [
            r < effective_radius,
            w,
            2 * wr2 * h,
            wr2 * t**2 * (1 + d / z),
            wr2 * h**2,
            w * h / r,
            np.maximum(0.0, 1.0 - r / (1.5 * spacing)) * h / r,
            packing_kernel(q),
        ]
    )


def corner_table(
    dimension, spacing, effective_radius, entries=64, cosine=0.0, weight=mps_weight, packing_kernel=PACKING
) -> np.ndarray:
    """Fraction of GHOST_SUMS that is left of the ghosts behind a wall where they end at another, whose normal has this
    ``cosine`` with that of the wall: (entries, entries, 8), for distances effective_radius * max(k, 1)/(entries - 1)
    from the wall and from the other. Ghosts half a spacing or less from the other count in part, so that nothing jumps.
    """
    ghosts = _lattice_behind(dimension, spacing, effective_radius)
    distances = effective_radius * np.maximum(np.arange(entries), 1) / (entries - 1)
    table = np.ones((entries, entries, len(GHOST_SUMS)))
    each = _terms(ghosts, distances[:, None], spacing, effective_radius, weight, packing_kernel).swapaxes(0, 1)
    for z, terms, remaining in zip(distances, each, table, strict=True):
        ahead = (1.0 - cosine**2) ** 0.5 * ghosts[:, 0] - cosine * (z + ghosts[:, -1])  # of the other wall [m]
        some = terms.sum(1) > 0.0
        visible = np.clip((distances[:, None] + ahead) / spacing + 0.5, 0.0, 1.0)
        remaining[:, some] = (terms[some, None] * visible).sum(2).T / terms[some].sum(1)
    return table
