"""Places for grains in a body of particles: random insertion without overlap on its lattice, shaken where that jams.

A grain is N particles of the lattice, so that N l0^d is as near to the volume of its sphere (disc) as a lattice
allows. One that is no sphere is placed in one of few rotations. Plain NumPy.
"""

from functools import cached_property, lru_cache

import numpy as np

from ...units import SceneError, require
from .clumps import orientations

SHAKES = 200  # times that all grains are moved by a spacing at most, after each of which more are inserted


@lru_cache
def template(across: float, d: int, spheres: tuple = ()) -> tuple[np.ndarray, np.ndarray]:
    """Particles of a sphere ``across`` spacings wide: offset (d,) of its centre from a lattice point, 0 or 1/2, and the
    lattice points (n, d) that it holds, both over the spacing. Or of a clump of that volume, whose
    ``spheres`` are rows of an offset and a radius over its diameter: its centre is that of these particles."""
    parts = across * np.array(spheres or [(0.0,) * d + (0.5,)])
    half = int(np.ceil((np.linalg.norm(parts[:, :d], axis=1) + parts[:, d]).max())) + 1
    points = np.stack(np.meshgrid(*[np.arange(-half, half + 1)] * d, indexing="ij"), -1).reshape(-1, d)
    volume = {2: np.pi / 4.0, 3: np.pi / 6.0}[d] * across**d
    found = []
    for offset in (np.zeros(d), np.full(d, 0.5)):
        apart = np.linalg.norm(points - offset - parts[:, None, :d], axis=-1) - parts[:, d:]
        found.append(points[apart.min(0) <= 1e-9])
    best = min(found, key=lambda inside: abs(len(inside) - volume))
    return best.mean(0), best


class Lattice:
    """The lattice of a body: cells (n, d) of its particles x (n, d) [m], in a grid that wraps where it is periodic and
    has empty cells around it elsewhere."""

    def __init__(self, x, spacing: float, room: int, domain, periodic):
        low = x.min(0)
        cells = np.round((x - low) / spacing).astype(int)
        require(
            np.abs((x - low) / spacing - cells).max() < 1e-3,
            "grains: the particles of the fluid stand on no lattice; must be filled by mps.fill",
        )
        size = np.round(np.subtract(*domain[::-1]) / spacing).astype(int)
        pad = np.where(periodic, 0, room)
        self.shape = np.where(periodic, size, cells.max(0) + 1 + 2 * pad)
        self.periodic = np.array(periodic)
        self.x0, self.spacing = low - pad * spacing, spacing
        self.row = np.full(self.shape, -1)  # of the particle in each cell
        self.row[tuple((cells + pad).T)] = np.arange(len(x))

    def at(self, cells) -> tuple:
        """Index of cells (n, d), wrapped."""
        return tuple(np.mod(cells, self.shape).T)


class Size:
    """Grains of one diameter and rotation (d, d) on a lattice: where their centres may lie, and where others keep them
    off. ``spheres``: those of their clump, rows of an offset and a radius over the diameter."""

    def __init__(self, lattice: Lattice, diameter: float, spheres, rotation):
        self.radius, self.rotation, d = 0.5 * diameter, rotation, lattice.row.ndim
        across = diameter / lattice.spacing
        parts = np.column_stack([spheres[:, :d] @ rotation.T, spheres[:, d]])
        self.offset, self.cells = template(across, d, () if len(parts) == 1 else tuple(map(tuple, parts.tolist())))
        self.centres, self.radii = self.offset + across * parts[:, :d], across * parts[:, d]
        self.reach = (across * np.linalg.norm(parts[:, :d], axis=1) + self.radii).max()
        # and the cells into which its surface reaches along the axes
        ways = np.vstack([np.eye(d), -np.eye(d)])
        tips = self.centres[:, None] + self.radii[:, None, None] * ways
        axes = np.where(ways < 0.0, np.floor(tips + 0.5 + 1e-9), np.ceil(tips - 0.5 - 1e-9)).reshape(-1, d).astype(int)
        self.allowed = np.ones(lattice.row.shape, bool)
        for cell in np.unique(np.vstack([self.cells, axes]), axis=0):
            self.allowed &= np.roll(lattice.row >= 0, -cell, axis=tuple(range(d)))
        self.blocked = np.zeros(lattice.row.shape, np.int32)  # number of grains that keep a centre off

    def blocks(self, other: "Size") -> np.ndarray:
        """Cells (k, d), from the centre cell of a grain of this size, in which no centre of the other may lie."""
        d = len(self.offset)
        width = int(np.ceil(self.reach + other.reach)) + 1
        steps = np.stack(np.meshgrid(*[np.arange(-width, width + 1)] * d, indexing="ij"), -1).reshape(-1, d)
        apart = (other.centres - self.centres[:, None]).reshape(-1, d)  # of all pairs of their spheres
        squares = (steps**2).sum(1)[:, None] + 2.0 * steps @ apart.T + (apart**2).sum(1)
        near = np.any(squares < (np.add.outer(self.radii, other.radii).ravel() - 1e-9) ** 2, axis=1)
        shared = np.isin(encode(steps), np.unique(np.concatenate([encode(self.cells - cell) for cell in other.cells])))
        return steps[near | shared]


def encode(cells) -> np.ndarray:
    """One number for each of the cells (n, d)."""
    return cells @ (4096 ** np.arange(cells.shape[1]))


class Packing:
    """Grains of several diameters, each in all ``rotations``, put into a body one by one; ``placed``: number of the
    size and centre cell of each."""

    def __init__(self, x, spacing: float, domain, periodic, diameters, spheres, rotations):
        reach = np.linalg.norm(spheres[:, :-1], axis=1) + spheres[:, -1]
        room = int(np.ceil(reach.max() * max(diameters) / spacing)) + 2  # cells that no grain reaches across
        self.lattice = Lattice(x, spacing, room, domain, periodic)
        self.sizes = [Size(self.lattice, diameter, spheres, turn) for diameter in diameters for turn in rotations]
        self.placed: list[tuple[int, np.ndarray]] = []

    @cached_property
    def blocks(self) -> list[list[np.ndarray]]:
        """``Size.blocks`` of each size for each."""
        return [[a.blocks(b) for b in self.sizes] for a in self.sizes]

    def is_free(self, k: int, cell) -> bool:
        at = self.lattice.at(cell[None])
        return bool(self.sizes[k].allowed[at][0] and self.sizes[k].blocked[at][0] == 0)

    def block(self, k: int, cell, by: int) -> None:
        """Count a grain of size k at a cell, or take it away, ``by`` 1 or -1."""
        for size, steps in zip(self.sizes, self.blocks[k], strict=True):
            np.add.at(size.blocked, self.lattice.at(cell + steps), by)

    def put(self, k: int, cell) -> None:
        self.block(k, cell, 1)
        self.placed.append((k, cell))

    def insert(self, k: int, count: int, random) -> int:
        """Insert up to ``count`` grains of size k at random free cells; return how many found none."""
        size = self.sizes[k]
        for cell in random.permutation(np.argwhere(size.allowed & (size.blocked == 0))):
            if count and self.is_free(k, cell):
                self.put(k, cell)
                count -= 1
        return count

    def shake(self, random) -> None:
        """Move each grain to a random free cell beside its own, where there is one."""
        for n, (k, cell) in enumerate(self.placed):
            self.block(k, cell, -1)
            to = np.mod(cell + random.integers(-1, 2, len(cell)), self.lattice.shape)
            self.placed[n] = (k, to if self.is_free(k, to) else cell)
            self.block(k, self.placed[n][1], 1)

    def fill(self, counts, random) -> bool:
        """Insert so many grains of each size, the largest first; False where they do not fit."""
        for k in np.argsort([-size.radius for size in self.sizes]):
            left = self.insert(k, counts[k], random)
            for _ in range(SHAKES):
                if left:
                    self.shake(random)
                    left = self.insert(k, left, random)
            if left:
                return False
        return True

    def result(self, particles: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Number (n,) of the grain of each particle, 0 of none; centres (g, d) [m]; radii (g,) [m]; rotations (g, d, d)
        of their clumps."""
        number, found = np.zeros(particles, int), []
        for g, (k, cell) in enumerate(self.placed, 1):
            size = self.sizes[k]
            number[self.lattice.row[self.lattice.at(cell + size.cells)]] = g
            found.append((self.lattice.x0 + self.lattice.spacing * (cell + size.offset), size.radius, size.rotation))
        return number, *map(np.array, zip(*found, strict=True))


def pack(x, spacing: float, domain, periodic, spheres, diameters, fractions, seed: int):
    """Places of grains of the ``diameters`` (k,) [m] that take the ``fractions`` (k,) [-] of the volume of a body of
    particles x (n, d) [m], clumps of the ``spheres`` of ``scaled``: as ``Packing.result``. SceneError where they do not
    fit."""
    d, counts = x.shape[1], []
    rotations = orientations(d, seed) if len(spheres) > 1 else [np.eye(d)]
    packing = Packing(x, spacing, domain, periodic, diameters, spheres, rotations)
    for j, (diameter, fraction) in enumerate(zip(diameters, fractions, strict=True)):
        kinds = packing.sizes[j * len(rotations) : (j + 1) * len(rotations)]
        count = round(fraction * len(x) / np.mean([len(size.cells) for size in kinds]))
        fitting = np.flatnonzero([size.allowed.any() for size in kinds])
        require(
            count and len(fitting),
            f"grains: diameter = {diameter:g} m: the body holds none; must be smaller, or of a larger volume_fraction",
        )
        counts += np.bincount(fitting[np.arange(count) % len(fitting)], minlength=len(kinds)).tolist()
    if not packing.fill(counts, np.random.default_rng(seed)):
        there = sum(len(packing.sizes[k].cells) for k, _ in packing.placed) / len(x)
        raise SceneError(
            f"grains: volume_fraction = {sum(fractions):g}: only {there:.3f} of the body found room; must be less, or "
            "diameter smaller"
        )
    return packing.result(len(x))


def place(x, spacing: float, domain, periodic, spheres, centres, diameters):
    """Places of grains with given ``centres`` (g, d) [m] and ``diameters`` (g,) [m], each moved to the nearest place of
    the lattice, by half a spacing along an axis at most, not rotated; else as ``pack``."""
    sizes, kinds = np.unique(diameters, return_inverse=True)
    packing = Packing(x, spacing, domain, periodic, sizes, spheres, [np.eye(x.shape[1])])
    for centre, k in zip(centres, kinds, strict=True):
        lattice, size = packing.lattice, packing.sizes[k]
        cell = np.floor((centre - lattice.x0) / spacing - size.offset + 0.5 - 1e-6).astype(int)
        cell = np.where(lattice.periodic, np.mod(cell, lattice.shape), cell)
        where = f"grains: centre = {tuple(centre.tolist())} m"
        require(
            np.all((cell >= 0) & (cell < lattice.shape)) and size.allowed[lattice.at(cell[None])][0],
            f"{where}: the grain of {2 * size.radius:g} m reaches out of the fluid; must lie in it",
        )
        require(packing.is_free(k, cell), f"{where}: overlaps another; all must be apart")
        packing.put(k, cell)
    return packing.result(len(x))
