"""Solids filled with a lattice of particles, and plane walls. Plain NumPy."""

from dataclasses import dataclass

import numpy as np

from .quantity import SceneError

MOST_POINTS = 1e8  # of one lattice: about 2.4 GB of coordinates


@dataclass(frozen=True)
class Box:
    """Axis-parallel box (rectangle in 2-D) between two corners [m]."""

    low: tuple[float, ...]
    high: tuple[float, ...]

    def contains(self, x):
        return np.all((x > self.low) & (x < self.high), axis=1)

    @property
    def bounds(self):
        return np.array(self.low, float), np.array(self.high, float)

    @property
    def volume(self):
        return float(np.prod(np.subtract(self.high, self.low)))


@dataclass(frozen=True)
class Cone:
    """Truncated cone on z = 0 around the z axis: radii [m] at the base and the top, height [m]."""

    base_radius: float
    top_radius: float
    height: float

    def contains(self, x):
        radius = self.base_radius + (self.top_radius - self.base_radius) * x[:, 2] / self.height
        return (x[:, 2] > 0) & (x[:, 2] < self.height) & (np.hypot(x[:, 0], x[:, 1]) < radius)

    @property
    def bounds(self):
        r = max(self.base_radius, self.top_radius)
        return np.array([-r, -r, 0.0]), np.array([r, r, self.height])

    @property
    def volume(self):
        a, b = self.base_radius, self.top_radius
        return np.pi * self.height / 3.0 * (a * a + a * b + b * b)


@dataclass(frozen=True)
class Plane:
    """Wall: the half-space behind the plane through ``point`` with unit ``normal`` into the fluid.

    ``velocity`` [m/s] moves the wall in its own plane; ``slip`` leaves the tangential motion free.
    """

    point: tuple[float, ...]
    normal: tuple[float, ...]
    velocity: tuple[float, ...] | None = None
    slip: bool = False

    def distance(self, x):
        """Signed distance [m] of points (n, d), positive in the fluid."""
        return (x - np.array(self.point)) @ np.array(self.normal)


def lattice(low, high, spacing, offset=0.5):
    """Points of a cubic lattice [m] in a box, (n, d); ``offset`` of the first point in spacings, per axis or one."""
    low, high = np.asarray(low, float), np.asarray(high, float)
    offsets = np.broadcast_to(offset, low.shape)
    points = float(np.prod(np.maximum(high - low, 0.0) / spacing))
    if points > MOST_POINTS:
        raise SceneError(
            f"spacing = {spacing:g} m: fills the box with {points:.2g} particles; at most {MOST_POINTS:.2g}"
        )
    axes = [
        lo + spacing * (o + np.arange(max(0, int(np.floor((hi - lo) / spacing - o + 1 + 1e-9)))))
        for lo, hi, o in zip(low, high, offsets, strict=True)
    ]
    return np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, len(low))


def shell(low, high, spacing, layers=3):
    """Wall particles [m], (m, d): ``layers`` around a box that is open at the top (last axis)."""
    low, high = np.asarray(low, float), np.asarray(high, float)
    thick = layers * spacing
    top = np.append(np.zeros(len(low) - 1), 1.0)
    x = lattice(low - thick, high + thick * (1.0 - top), spacing)
    inside = np.all((x > low) & (x < high + thick * top), axis=1)
    return x[~inside]


def box_planes(low, high, slip=False):
    """The walls of a box that is open at the top (last axis)."""
    low, high = tuple(map(float, low)), tuple(map(float, high))
    d = len(low)
    unit = np.eye(d)
    floor = Plane(low, tuple(unit[-1]), slip=slip)
    sides = [Plane(low, tuple(unit[a]), slip=slip) for a in range(d - 1)]
    sides += [Plane(high, tuple(-unit[a]), slip=slip) for a in range(d - 1)]
    return (floor, *sides)


def fill(solid, spacing):
    """Positions (n, d) [m] of the particles of a solid, one per spacing^d.

    Particles start half a spacing inside the lower faces. Of the lattices that keep the mirror symmetry of
    the solid (a particle or an edge on the middle) the one nearest to the solid's volume is taken.
    """
    low, high = solid.bounds
    size = high - low
    if np.any(size < 0.999 * spacing):
        raise SceneError(
            f"spacing = {spacing:g} m: larger than the body, whose smallest side is {size.min():.4g} m; "
            f"must be at most {size.min():.4g} m"
        )
    candidates = []
    for centred in (False, True):
        lo = low.copy()
        for axis in range(len(low) - 1):
            half = spacing * (np.ceil(0.5 * size[axis] / spacing) + (0.5 if centred else 0.0))
            lo[axis] = 0.5 * (low[axis] + high[axis]) - half
        if isinstance(solid, Box):
            lo = low
        x = lattice(lo, high, spacing)
        candidates.append(x[solid.contains(x)])
    best = min(candidates, key=lambda x: abs(len(x) * spacing ** len(low) - solid.volume))
    if len(best) == 0:
        raise SceneError(f"spacing = {spacing:g} m: no particle fits into the body; use a smaller spacing")
    return best
