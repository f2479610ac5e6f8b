"""Filling: which part of a form the concrete has filled, and where it stayed empty. Plain NumPy."""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, runtime_checkable

import numpy as np
from pydantic import InstanceOf

from ...units import Size, require, validated, vector
from .shapes import MAX_POINTS, HasDistance


@runtime_checkable
class HasPositions(Protocol):
    """Protocol of the fluid in a cavity: it has positions ``x`` (n, d) [m]."""

    x: np.ndarray


@validated
@dataclass(frozen=True)
class Cavity:
    """Form that concrete is to fill, as a grid of cells in front of all walls.

    Parameters
    ----------
    low, high : tuple of float, length d
        Corners [m]; the last coordinate of ``high`` is the level to which the form is filled.
    walls : tuple of Plane, Cylinder or Solid
        Walls of the form.
    spacing : float
        Particle size [m].

    Raises
    ------
    SceneError
        If the cavity is shorter than half a spacing, or lies in the walls.

    Notes
    -----
    Cells are half a spacing wide. A cell is filled if a particle's centre is within half the diagonal of a particle's
    square or cube, so that a full lattice fills all cells and a void is a place where a ball of that radius finds no
    centre. At a surface up to 0.37 spacings too much (0.21 in two dimensions) are counted, so the filled ratio as a
    whole is bounded by the volume of the particles. Voids are those of the computed part.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> form = mps.Cavity((0.0, 0.0), (0.2, 0.1), mps.box_planes((0.0, 0.0), (0.2, 0.1)), 0.02)
    >>> body = mps.measure.still(mps.lattice((0.0, 0.0), (0.2, 0.05), 0.02), 0.02)
    >>> round(form.report(body)["filled_ratio"], 2)
    0.6
    """

    low: vector("m")
    high: vector("m")
    walls: tuple[InstanceOf[HasDistance], ...]
    spacing: Size

    def __post_init__(self):
        form = f"cavity: low = {self.low} m, high = {self.high} m, spacing = {self.spacing:g} m"
        require(len(self.low) == len(self.high), f"{form}: low and high must have as many coordinates")
        size = np.subtract(self.high, self.low)
        require(
            np.all(size >= 0.5 * self.spacing),
            f"{form}: must be at least half a spacing long, {0.5 * self.spacing:g} m, along each axis",
        )
        cells = float(np.prod(size / (0.5 * self.spacing)))
        require(cells <= MAX_POINTS, f"{form}: has {cells:.2g} cells; must be at most {MAX_POINTS:.2g}")
        for wall in self.walls:
            require(
                len(getattr(wall, "point", self.low)) == len(self.low),
                f"walls = {wall}: must have {len(self.low)} coordinates, as low has",
            )
        require(self.cells.any(), f"{form}: lies in the walls; must hold some room")

    @cached_property
    def shape(self) -> tuple[int, ...]:
        """Number of cells along each axis."""
        return tuple(
            np.maximum(1, np.rint(np.subtract(self.high, self.low) / (0.5 * self.spacing))).astype(int).tolist()
        )

    @cached_property
    def cell(self) -> np.ndarray:
        """Sides of a cell [m], shape (d,): about half a spacing."""
        return np.subtract(self.high, self.low) / self.shape

    def middles(self, axis: int) -> np.ndarray:
        """Return the centres of the cells along an axis.

        Parameters
        ----------
        axis : int
            Number of the axis.

        Returns
        -------
        ndarray, shape (k,)
            Coordinates [m].
        """
        return self.low[axis] + self.cell[axis] * (np.arange(self.shape[axis]) + 0.5)

    @cached_property
    def cells(self) -> np.ndarray:
        """True where a cell is part of the cavity, shape (nx, ..., nz)."""
        axes = map(self.middles, range(len(self.shape)))
        x = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, len(self.shape))
        return np.broadcast_to(np.all([wall.distance(x) > 0.0 for wall in self.walls], axis=0), len(x)).reshape(
            self.shape
        )

    @validated
    def filled(self, s: InstanceOf[HasPositions]) -> np.ndarray:
        """Return which cells of the cavity are filled.

        Parameters
        ----------
        s : Snapshot
            Fluid.

        Returns
        -------
        ndarray of bool, shape (nx, ..., nz)
            True where a cell is filled.
        """
        low, radius = np.array(self.low), 0.5 * np.sqrt(len(self.shape)) * self.spacing * (1.0 + 1e-6)
        width = np.ceil(radius / self.cell).astype(int)  # cells to each side of a particle's that the radius may reach
        own_cell, filled = np.floor((s.x - low) / self.cell).astype(int), np.zeros(self.shape, bool)
        for step in np.ndindex(*(2 * width + 1)):
            k = own_cell + (step - width)
            within = ((low + self.cell * (k + 0.5) - s.x) ** 2).sum(1) <= radius**2
            within &= np.all((k >= 0) & (k < self.shape), axis=1)
            filled[tuple(k[within].T)] = True
        return filled & self.cells

    @validated
    def by_height(self, s: InstanceOf[HasPositions]) -> tuple[np.ndarray, np.ndarray]:
        """Return the filled fraction of each layer of cells.

        Parameters
        ----------
        s : Snapshot
            Fluid.

        Returns
        -------
        heights : ndarray, shape (nz,)
            Centres of the layers [m].
        fractions : ndarray, shape (nz,)
            Filled fraction [-], nan where a layer is all wall.
        """
        rest = tuple(range(len(self.shape) - 1))
        room, filled = self.cells.sum(rest), self.filled(s).sum(rest)
        return self.middles(len(rest)), np.where(room > 0, filled / np.maximum(room, 1), np.nan)

    @validated
    def report(self, s: InstanceOf[HasPositions]) -> dict:
        """Summarize how the cavity is filled.

        Parameters
        ----------
        s : Snapshot
            Fluid.

        Returns
        -------
        dict
            ``filled_ratio`` [-], of the cells, and no more than the particles in the form and above it are;
            ``void_m3``, volume of the rest, and ``above_m3``, that of the fluid above the form (m2 in two dimensions);
            ``void_centre`` [m] of the cells that are not filled, None without one;
            ``filled_by_height``, pairs of height [m] and filled fraction [-] of the cells.
        """
        void, room = self.cells & ~self.filled(s), float(self.cells.sum() * np.prod(self.cell))
        inside = np.all(s.x >= self.low, axis=1) & np.all(s.x[:, :-1] <= self.high[:-1], axis=1)
        sides = np.broadcast_to(getattr(s, "size", self.spacing), len(s.x))
        ratio = min(1.0 - void.sum() / self.cells.sum(), (1.0 + 1e-9) * (sides[inside] ** len(self.shape)).sum() / room)
        places = np.argwhere(void)
        centre = np.array(self.low) + self.cell * (places.mean(0) + 0.5) if len(places) else None
        return {
            "filled_ratio": float(ratio),
            "void_m3": float((1.0 - ratio) * room),
            "above_m3": float((sides[inside & (s.x[:, -1] > self.high[-1])] ** len(self.shape)).sum()),
            "void_centre": None if centre is None else centre.tolist(),
            "filled_by_height": [row for row in np.transpose(self.by_height(s)).tolist() if not np.isnan(row[1])],
        }
