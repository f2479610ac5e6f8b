"""Bodies filled with a lattice of particles. Plain NumPy."""

from dataclasses import dataclass

import numpy as np

from ..runtime.memory import admit
from ..units import check_numbers, check_vectors, finite, positive, require

MOST_POINTS = 1e8  # of one lattice
MANY_POINTS = 1e6  # from here on a lattice is admitted first
POINT = 90  # bytes of a point while a body is cut out of the lattice


@dataclass(frozen=True)
class Box:
    """Axis-parallel box (rectangle in 2-D) between two corners [m]."""

    low: tuple[float, ...]
    high: tuple[float, ...]

    def __post_init__(self):
        check_vectors(self, "a box", {"low": "m", "high": "m"})
        above = np.all(np.less(self.low, self.high))
        require(above, f"high = {self.high} m of a box: must be above low = {self.low} m along each axis")

    def contains(self, x):
        """Are points x (n, d) [m] inside? (n,)"""
        return np.all((x > self.low) & (x < self.high), axis=1)

    @property
    def bounds(self):
        """Corners (d,), (d,) [m] of the box around it."""
        return np.array(self.low, float), np.array(self.high, float)

    @property
    def volume(self):
        """[m3]; in 2-D [m2]."""
        return float(np.prod(np.subtract(self.high, self.low)))


@dataclass(frozen=True)
class Cone:
    """Truncated cone on z = 0 around the z axis: radii [m] at the base and the top, height [m]."""

    base_radius: float
    top_radius: float
    height: float

    def __post_init__(self):
        check_numbers(self, {"base_radius": "m", "top_radius": "m", "height": "m"})
        for key in ("base_radius", "top_radius"):
            require(getattr(self, key) >= 0.0, f"{key} = {getattr(self, key):g} m: must be at least 0 m")
        wrong = f"height = {self.height:g} m: must be greater than 0 m, and one radius of a cone, too"
        require(self.volume > 0.0, wrong)

    def contains(self, x):
        """Are points x (n, 3) [m] inside? (n,)"""
        radius = self.base_radius + (self.top_radius - self.base_radius) * x[:, 2] / self.height
        return (x[:, 2] > 0) & (x[:, 2] < self.height) & (np.hypot(x[:, 0], x[:, 1]) < radius)

    @property
    def bounds(self):
        """Corners (3,), (3,) [m] of the box around it."""
        r = max(self.base_radius, self.top_radius)
        return np.array([-r, -r, 0.0]), np.array([r, r, self.height])

    @property
    def volume(self):
        """[m3]"""
        a, b = self.base_radius, self.top_radius
        return np.pi * self.height / 3.0 * (a * a + a * b + b * b)


def lattice(low, high, spacing, offset=0.5):
    """Points of a cubic lattice [m] in a box between two corners (d,) [m], (n, d); ``offset`` of the first point in
    spacings [m], per axis or one."""
    positive("spacing", spacing)
    low = finite("low", low, "m", dimensions=1)
    high = finite("high", high, "m", shape=low.shape)
    offsets = np.broadcast_to(offset, low.shape)
    with np.errstate(over="ignore"):  # of a spacing next to nothing
        points = float(np.prod(np.maximum(high - low, 0.0) / spacing))
    many = f"spacing = {spacing:g} m: fills the box with {points:.2g} particles; at most {MOST_POINTS:.2g}"
    require(points <= MOST_POINTS, many)
    if points > MANY_POINTS:
        admit(POINT * points, f"spacing = {spacing:g} m: {points:.2g} particles of a lattice take")
    axes = [
        lo + spacing * (o + np.arange(max(0, int(np.floor((hi - lo) / spacing - o + 1 + 1e-9)))))
        for lo, hi, o in zip(low, high, offsets, strict=True)
    ]
    return np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, len(low))


def rings(inner_radius, outer_radius, spacing):
    """Points (n, 2) [m] on circles about the origin, a spacing apart: a disc (inner radius 0) or what is between two
    circles, without the steps that a square lattice has there."""
    positive("spacing", spacing)
    count = round((outer_radius - inner_radius) / spacing)
    require(
        count >= 1 and inner_radius >= 0.0,
        f"rings from {inner_radius:g} to {outer_radius:g} m: the inner radius must be at least 0 m and the outer one "
        f"greater by a spacing of {spacing:g} m",
    )
    width = (outer_radius - inner_radius) / count
    points = []
    for k in range(count):
        radius = inner_radius + (k + 0.5) * width
        number = round(2.0 * np.pi * radius * width / spacing**2)
        angle = 2.0 * np.pi * (np.arange(number) / number + 0.618034 * k)  # no ring starts where another does
        points.append(radius * np.stack([np.cos(angle), np.sin(angle)], -1))
    return np.vstack(points)


def shell(low, high, spacing, layers=3):
    """Wall particles [m], (m, d): ``layers`` around a box that is open at the top (last axis), its corners (d,) [m]."""
    positive("spacing", spacing)
    low, high = np.asarray(low, float), np.asarray(high, float)
    thick = layers * spacing
    top = np.append(np.zeros(len(low) - 1), 1.0)
    x = lattice(low - thick, high + thick * (1.0 - top), spacing)
    inside = np.all((x > low) & (x < high + thick * top), axis=1)
    return x[~inside]


def fill_rings(solid, spacing):
    """Positions (n, 2) [m] (r, z) of the rings of a solid around the z axis, one per spacing^2, half a spacing from the
    axis and the base: those whose middle lies in the solid."""
    positive("spacing", spacing)
    low, high = solid.bounds
    x = lattice((0.0, low[2]), (high[0] + spacing, high[2]), spacing)
    x = x[solid.contains(np.insert(x, 1, 0.0, axis=1))]
    require(len(x), f"spacing = {spacing:g} m: no ring fits into the body; use a smaller spacing")
    return x


def fill(solid, spacing, mirrors=()):
    """Positions (n, d) [m] of the particles of a solid, one per spacing^d.

    Particles start half a spacing inside the lower faces. Of the lattices that keep the mirror symmetry of
    the solid (a particle or an edge on the middle) the one nearest to the solid's volume is taken. With ``mirrors``,
    planes across axes, it is the one with an edge on the middle and on these planes, and only what is in front of them.
    """
    positive("spacing", spacing)
    low, high = solid.bounds
    size = high - low
    require(
        np.all(size >= 0.999 * spacing),
        f"spacing = {spacing:g} m: larger than the body, whose smallest side is {size.min():.4g} m; must be at most "
        f"{size.min():.4g} m",
    )
    for mirror in mirrors:
        along = np.count_nonzero(np.abs(mirror.normal) > 1e-9) == 1
        require(along, f"mirrors: normal = {mirror.normal}: must be along an axis")
    candidates = []
    for centred in (0.0,) if mirrors else (0.0, 0.5):
        lo = low.copy()
        if not isinstance(solid, Box):
            half = spacing * (np.ceil(0.5 * size / spacing) + centred)
            lo[:-1] = (0.5 * (low + high) - half)[:-1]
        for mirror in mirrors:
            axis = int(np.argmax(np.abs(mirror.normal)))
            lo[axis] = mirror.point[axis] - spacing * np.ceil((mirror.point[axis] - low[axis]) / spacing - 1e-9)
        x = lattice(lo, high, spacing)
        candidates.append(x[solid.contains(x)])
    best = min(candidates, key=lambda x: abs(len(x) * spacing ** len(low) - solid.volume))
    for mirror in mirrors:
        best = best[mirror.distance(best) > 0.0]
    require(len(best), f"spacing = {spacing:g} m: no particle fits into the body; use a smaller spacing")
    return best
