"""Snapshot of a run, and what a technologist measures on it. Plain NumPy."""

import warnings
from dataclasses import dataclass, field, replace

import numpy as np

from ..units import array_of, said
from .loads import Load

HOLE = (0.75, 1.0)  # radius of a ring over its size: below, its particles cover the axis; above, another one fits in

SCALARS = "p", "shear_rate", "yielded", "density_ratio", "size", "mix"  # of each particle


@dataclass(frozen=True)
class Snapshot:
    """The fluid at one instant, ordered by persistent particle id. n particles, d dimensions."""

    time: float  # [s]
    spacing: float  # l0 [m]
    x: np.ndarray  # position [m], (n, d)
    u: np.ndarray  # velocity [m/s], (n, d)
    p: np.ndarray  # pressure [Pa], of `implicit` averaged over the neighbours, (n,)
    shear_rate: np.ndarray  # sqrt(2 D:D) [1/s], (n,)
    yielded: np.ndarray  # flowing, bool, (n,)
    density_ratio: np.ndarray  # particle number density over n0 [-], (n,)
    wall_x: np.ndarray  # wall particles [m], (m, d); empty where walls are surfaces
    size: np.ndarray | None = None  # side of each particle's square or cube [m], (n,); l0 by default
    mix: np.ndarray | None = None  # number of the mix, (n,); 0 by default
    loads: dict[str, Load] = field(default_factory=dict)  # on the walls by their names, where they are asked for

    def __post_init__(self):
        if self.size is None:
            object.__setattr__(self, "size", np.full(len(self.x), self.spacing))
        if self.mix is None:
            object.__setattr__(self, "mix", np.zeros(len(self.x), np.int32))

    @property
    def speed(self):
        """Speed [m/s] of each particle, (n,)."""
        return np.linalg.norm(self.u, axis=1)


class Measured:
    """A function of a scene that measures, ``key`` of the scene: what it gives, {name: float}, without what is no
    number, and nothing where it raises, for a mistake there must not cost the run. A warning says so the first time."""

    def __init__(self, key: str, function):
        self.key, self.function, self._told = key, function, set()

    def __call__(self, *given) -> dict[str, float]:
        try:
            found = self.function(*given)
            if not isinstance(found, dict):
                raise TypeError(f"gives {said(found, '')}; must give a dict of numbers")
        except Exception as error:  # of code of the user's
            self._tell("", f"{type(error).__name__}: {' '.join(str(error).split())}")
            return {}
        numbers = {}
        for name, value in found.items():
            array = array_of(value)
            if array.shape == () and array.dtype.kind == "f":
                numbers[name] = float(array)
            else:
                self._tell(name, f"{name} = {said(value, '')} is no number")
        return numbers

    def _tell(self, what, wrong):
        if what not in self._told:
            self._told.add(what)
            function = getattr(self.function, "func", self.function)  # of a partial
            name = getattr(function, "__name__", type(function).__name__)
            warnings.warn(f"{self.key} = {name}: {wrong}; left out, the run goes on", stacklevel=1)


def revolved(s: Snapshot) -> Snapshot:
    """The body of which ``s`` is the axisymmetric model (r, z): every ring as particles a size apart around the z axis,
    each ring turned by the golden angle against the one before. A ring with a hole that no other fits into has a
    particle on the axis, too: the fluid is whole there."""
    r = s.x[:, 0]
    around = np.maximum(1, np.round(2.0 * np.pi * r / s.size)).astype(int)
    count = around + ((HOLE[0] * s.size < r) & (r < HOLE[1] * s.size))
    ring = np.repeat(np.arange(len(count)), count)
    place = np.arange(len(ring)) - np.repeat(np.cumsum(count) - count, count)
    angle = 2.0 * np.pi * (place / around[ring] + 0.381966 * ring)
    across = np.stack([np.cos(angle), np.sin(angle)], 1) * (place < around[ring])[:, None]

    def turned(v):
        return np.column_stack([v[ring, :1] * across, v[ring, 1]])

    loads = {name: load.revolved(ring, around, across) for name, load in s.loads.items()}
    fields = {name: getattr(s, name)[ring] for name in SCALARS}
    return replace(s, x=turned(s.x), u=turned(s.u), wall_x=np.zeros((0, 3)), loads=loads, **fields)


def still(x, spacing: float) -> Snapshot:
    """A snapshot of points (n, d) [m] at rest, without pressure."""
    x = np.asarray(x, float)
    zero = np.zeros(len(x))
    return Snapshot(0.0, spacing, x, 0.0 * x, zero, zero, zero > 0.0, zero + 1.0, np.zeros((0, x.shape[1])))


def embed(x) -> np.ndarray:
    """Vectors (n, 3) of vectors (n, d): a two-dimensional scene lies in the plane y = 0."""
    x = np.asarray(x, float)
    return x if x.shape[1] == 3 else np.insert(x, 1, 0.0, axis=1)


def reflected(vectors, normal, point=None):
    """Mirror images (n, d) of vectors at a plane with this unit normal; of positions [m] with a ``point`` of it [m]."""
    normal = np.asarray(normal, float)
    origin = 0.0 if point is None else np.asarray(point, float)
    return vectors - 2.0 * np.outer((vectors - origin) @ normal, normal)


def mirrored(s: Snapshot, point, normal) -> Snapshot:
    """The snapshot and, after it and in the same order, its image at the plane through ``point`` [m] with this unit
    normal; pressure, shear rate, density ratio and the yielded flag are those of the particle itself."""
    twice = {name: np.tile(getattr(s, name), 2) for name in SCALARS}
    twice |= {name: np.vstack([x, reflected(x, normal, point)]) for name, x in (("x", s.x), ("wall_x", s.wall_x))}
    loads = {name: load.mirrored(point, normal) for name, load in s.loads.items()}
    return replace(s, u=np.vstack([s.u, reflected(s.u, normal)]), loads=loads, **twice)


def surface(s: Snapshot, points) -> np.ndarray:
    """Height (k,) [m] of the surface at horizontal places (k, d-1) [m]: of the highest particle within 0.75 spacings,
    and half its size; nan where there is none."""
    points = np.asarray(points, float)
    low, high = points.min(0) - s.spacing, points.max(0) + s.spacing
    close = np.all((s.x[:, :-1] > low) & (s.x[:, :-1] < high), axis=1)
    near, top = s.x[close, :-1], s.x[close, -1] + 0.5 * s.size[close]
    order, heights = np.argsort(-top), np.full(len(points), np.nan)
    for first in range(0, len(top), 500):  # from the highest down: most places are covered by the first few
        left, k = np.flatnonzero(np.isnan(heights)), order[first : first + 500]
        if len(left) == 0:
            break
        distance2 = sum((points[left, None, axis] - near[k, axis]) ** 2 for axis in range(near.shape[1]))
        found = np.where(distance2 < (0.75 * s.spacing) ** 2, top[k], -np.inf).max(1)
        heights[left] = np.where(np.isfinite(found), found, np.nan)
    return heights


def over(s: Snapshot, low, high) -> tuple[np.ndarray, np.ndarray]:
    """Horizontal places (k, d-1) [m], 0.4 spacings apart, between two of them, and the heights (k,) of the surface."""
    ticks = [np.arange(a, b + 1e-12, 0.4 * s.spacing) for a, b in zip(low, high, strict=True)]
    points = np.stack(np.meshgrid(*ticks), -1).reshape(-1, len(ticks))
    return points, surface(s, points)


def top_height(s: Snapshot, radius: float) -> float:
    """Mean height [m] of the surface (particle + half its size) within ``radius`` [m] of the axis; nan if none."""
    points, heights = over(s, (-radius, -radius), (radius, radius))
    heights = heights[(np.hypot(points[:, 0], points[:, 1]) <= radius) & np.isfinite(heights)]
    return float(heights.mean()) if len(heights) else float("nan")


def level(s: Snapshot, low, high) -> float:
    """Mean height [m] of the surface between two horizontal places (d-1,) [m]; 0 where there is nothing. As one reads
    a level: what hangs on the walls beside does not count."""
    return float(np.nan_to_num(over(s, low, high)[1]).mean())


def standing_level(s: Snapshot, low, high) -> float:
    """Level [m] between two horizontal places (d-1,) [m] as a rule set on the floor reads it: of what stands there
    without a gap. Drops that hang on a wall or fly, more than half a spacing clear above it, do not count."""
    x = s.x[:, :-1]
    near = np.all((x > np.subtract(low, s.spacing)) & (x < np.add(high, s.spacing)), axis=1)
    heights = np.sort(s.x[near, -1])
    gaps = np.flatnonzero(np.diff(heights, prepend=-0.5 * s.spacing) > 1.5 * s.spacing)
    top = heights[gaps[0]] if len(gaps) else np.inf
    return level(replace(s, **{name: getattr(s, name)[s.x[:, -1] < top] for name in ("x", "size")}), low, high)


def spread(s: Snapshot) -> float:
    """Diameter [m] of the widest layer: the mean over all directions.

    A layer one particle thick has, in a sector one particle wide, one particle to each spacing of depth: whatever their
    order, the outermost one lies half a spacing inside of the edge, in the mean. In thicker layers and wider sectors it
    is the one that stands out most, by up to 0.7 l0 of the diameter. A rim thinner than a particle is read too short.
    """
    r, angle = np.hypot(s.x[:, 0], s.x[:, 1]), np.arctan2(s.x[:, 1], s.x[:, 0])
    radius = np.quantile(r, 0.99)  # a stray particle does not set it
    size = float(np.median(s.size[r > radius - s.spacing]))
    sectors = max(4, int(2 * np.pi * radius / size))
    order = np.argsort(s.x[:, 2])
    # neither sectors nor layers end where lattices and mirror planes have particles, so rounding moves none across
    z, sector = s.x[order, 2], (np.floor((angle / (2 * np.pi) + 0.5) * sectors + 0.37).astype(int) % sectors)[order]
    edge, widest = (r + 0.5 * s.size)[order], 0.0
    for low in np.arange(z[0] - 0.57 * size, z[-1], 0.25 * size):
        layer, reach = slice(*np.searchsorted(z, (low, low + size))), np.zeros(sectors)
        np.maximum.at(reach, sector[layer], edge[layer])
        widest = max(widest, reach.sum() / max(1, np.count_nonzero(reach)))
    return float(2.0 * widest)


def slump(s: Snapshot, height: float, axis_radius: float = 0.02) -> dict[str, float]:
    """slump_m at the axis, slump_max_m of the highest point, spread_m [m] for a body of that initial height [m]."""
    return {
        "slump_m": height - top_height(s, axis_radius),
        "slump_max_m": height - float((s.x[:, 2] + 0.5 * s.size).max()),
        "spread_m": spread(s),
    }


def front(s: Snapshot) -> dict[str, float]:
    """front_m: the farthest reach along x [m]; height_m: the highest point [m] (last axis)."""
    return {
        "front_m": float(s.x[:, 0].max() + 0.5 * s.spacing),
        "height_m": float(s.x[:, -1].max() + 0.5 * s.spacing),
    }


def depth(s: Snapshot, where, area: float) -> float:
    """Mean depth [m] of the fluid over a part of the floor: the volume of the particles ``where`` is True, over the
    area [m2] (a length [m] in 2-D). Free of the choice of a surface; exact for a body without voids."""
    return float((s.size[where] ** s.x.shape[1]).sum() / area)


def by_height(s: Snapshot, values, edges) -> np.ndarray:
    """The sums (k,) of what particles have, ``values`` (n,), in layers between the heights ``edges`` (k + 1,) [m]; each
    is spread evenly over the size of its particle."""
    low, high = s.x[:, -1, None] - 0.5 * s.size[:, None], s.x[:, -1, None] + 0.5 * s.size[:, None]
    shared = np.maximum(0.0, np.minimum(high, edges[1:]) - np.maximum(low, edges[:-1]))
    return values @ (shared / s.size[:, None])


def clearance(s: Snapshot, walls) -> float:
    """Distance [m] of the particle that is nearest to any of the walls; negative if one is behind a wall."""
    return min(float(wall.distance(s.x, s.time).min()) for wall in walls)


def time_of(time, values, level: float) -> float:
    """First time [s] at which the values (n,) of a history reach a level, linear between two; nan if they do not."""
    time, reached = np.asarray(time, float), np.flatnonzero(np.asarray(values, float) >= level)
    if not len(reached):
        return float("nan")
    last = slice(max(0, reached[0] - 1), reached[0] + 1)
    return float(np.interp(level, values[last], time[last]))
