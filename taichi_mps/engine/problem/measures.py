"""Snapshot of a run, and measurements on it as in a laboratory, in plain NumPy."""

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from pydantic import InstanceOf

from ...units import Flag, SceneError, Size, Time, array, array_of, points, quote, real, require, validated, vector
from ..geometry.shapes import MAX_POINTS, HasDistance
from .loads import Load

# Bounds of radius over size of the rings that get a particle on the axis: particles of smaller rings cover the axis,
# and inside larger ones another ring fits
AXIS_PARTICLE = (0.75, 1.0)

HorizontalPoint, HorizontalPoints = array("m", (1,), (2,)), array("m", (None, 1), (None, 2))
Values = array("", (None,))
SCALARS = "p", "shear_rate", "yielded", "density_ratio", "size", "mix", "grain"  # scalar fields of particles


@validated
@dataclass(frozen=True, eq=False)
class Snapshot:
    """Fluid at one instant, ordered by persistent particle number: n particles, d dimensions.

    Parameters
    ----------
    time : float
        Time [s].
    spacing : float
        Particle size l0 [m].
    x : ndarray, shape (n, d)
        Positions [m].
    u : ndarray, shape (n, d)
        Velocities [m/s].
    p : ndarray, shape (n,)
        Pressure [Pa], of the scheme ``implicit`` averaged over the neighbours.
    shear_rate : ndarray, shape (n,)
        sqrt(2 D:D) [1/s].
    yielded : ndarray of bool, shape (n,)
        Whether the particle flows.
    density_ratio : ndarray, shape (n,)
        Particle number density over n0 [-].
    wall_x : ndarray, shape (m, d)
        Wall particles [m]; empty where walls are surfaces.
    size : ndarray, shape (n,), optional
        Side of each particle's square or cube [m], l0 by default.
    mix : ndarray of int, shape (n,), optional
        Number of the mix, 0 by default.
    grain : ndarray of int, shape (n,), optional
        Number of the grain, from 1; 0 of mortar, by default.
    loads : dict of str to Load, optional
        Forces and torques on the walls by name, where the scene computes them.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> body = mps.measure.still([[0.0, 0.0, 0.01], [0.02, 0.0, 0.01]], spacing=0.02)
    >>> body.x.shape, body.speed.tolist()
    ((2, 3), [0.0, 0.0])
    """

    time: Time
    spacing: Size
    x: points("m")
    u: np.ndarray
    p: np.ndarray
    shear_rate: np.ndarray
    yielded: np.ndarray
    density_ratio: np.ndarray
    wall_x: points("m")
    size: np.ndarray | None = None
    mix: np.ndarray | None = None
    grain: np.ndarray | None = None
    loads: dict[str, Load] = field(default_factory=dict)

    def __post_init__(self):
        for name in ("u", *SCALARS):
            value = getattr(self, name)
            require(
                value is None or np.shape(value)[:1] == np.shape(self.x)[:1],
                f"{name} of shape {np.shape(value)}: must have {len(self.x)} rows, as x has",
            )
        for name, usual in (("size", self.spacing), ("mix", np.int32(0)), ("grain", np.int32(0))):
            if getattr(self, name) is None:
                object.__setattr__(self, name, np.full(len(self.x), usual))

    @property
    def speed(self) -> np.ndarray:
        """Speed of each particle [m/s], shape (n,)."""
        return np.linalg.norm(self.u, axis=1)


class GuardedMeasure:
    """Measuring function of a scene, guarded so that its errors do not end the run.

    A result that is no number is left out; where the function raises, all results are. The first time, a warning says
    so.

    Parameters
    ----------
    key : str
        Key of the scene, ``measure`` or ``over_time``.
    function : callable
        Function that gives {name: float}.

    Examples
    --------
    >>> from taichi_mps.engine.problem.measures import GuardedMeasure
    >>> GuardedMeasure("measure", lambda snapshot: {"width_m": 0.25})(None)
    {'width_m': 0.25}
    """

    def __init__(self, key: str, function: Callable):
        self.key, self.function, self._warned = key, function, set()

    def __call__(self, *given) -> dict[str, float]:
        """Call the function and keep the results that are numbers.

        Parameters
        ----------
        *given
            Arguments of the function.

        Returns
        -------
        dict of str to float
            Results.
        """
        try:
            found = self.function(*given)
            if not isinstance(found, dict):
                raise TypeError(f"gives {quote(found, '')}; must give a dict of numbers")
        except Exception as error:  # the function is the user's code
            self._warn_once("", f"{type(error).__name__}: {' '.join(str(error).split())}")
            return {}
        numbers = {}
        for name, value in found.items():
            result = array_of(value)
            if result.shape == () and result.dtype.kind == "f":
                numbers[name] = float(result)
            else:
                self._warn_once(name, f"{name} = {quote(value, '')} is no number")
        return numbers

    def _warn_once(self, what, wrong):
        if what not in self._warned:
            self._warned.add(what)
            function = getattr(self.function, "func", self.function)  # of a partial
            name = getattr(function, "__name__", type(function).__name__)
            warnings.warn(f"{self.key} = {name}: {wrong}; left out, the run goes on", stacklevel=1)


@validated
def revolved(s: InstanceOf[Snapshot]) -> Snapshot:
    """Revolve an axisymmetric snapshot (r, z) into the whole body.

    Parameters
    ----------
    s : Snapshot
        Rings in two dimensions.

    Returns
    -------
    Snapshot
        Particles in three dimensions, one size apart around the z axis; each ring is turned by the golden angle against
        the one before. A ring with room for one particle inside, but not for another ring, also has one on the axis.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> ring = mps.measure.still([[0.1, 0.01]], 0.02)
    >>> mps.measure.revolved(ring).x.shape  # 2 pi 0.1/0.02 particles
    (31, 3)
    """
    r = s.x[:, 0]
    around = np.maximum(1, np.round(2.0 * np.pi * r / s.size)).astype(int)
    count = around + ((AXIS_PARTICLE[0] * s.size < r) & (r < AXIS_PARTICLE[1] * s.size))
    ring = np.repeat(np.arange(len(count)), count)
    place = np.arange(len(ring)) - np.repeat(np.cumsum(count) - count, count)
    angle = 2.0 * np.pi * (place / around[ring] + 0.381966 * ring)
    across = np.stack([np.cos(angle), np.sin(angle)], 1) * (place < around[ring])[:, None]

    def turned(v):
        return np.column_stack([v[ring, :1] * across, v[ring, 1]])

    loads = {name: load.revolved(ring, around, across) for name, load in s.loads.items()}
    fields = {name: getattr(s, name)[ring] for name in SCALARS}
    return replace(s, x=turned(s.x), u=turned(s.u), wall_x=np.zeros((0, 3)), loads=loads, **fields)


@validated
def still(x: points("m"), spacing: Size) -> Snapshot:
    """Make a snapshot of points at rest, without pressure.

    Parameters
    ----------
    x : array_like, shape (n, d)
        Positions [m].
    spacing : float
        Particle size [m].

    Returns
    -------
    Snapshot
        Body at 0 s, unyielded.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> mps.measure.still([[0.0, 0.01], [0.0, 0.03]], spacing=0.02).p.tolist()
    [0.0, 0.0]
    """
    zero = np.zeros(len(x))
    return Snapshot(0.0, spacing, x, 0.0 * x, zero, zero, zero > 0.0, zero + 1.0, np.zeros((0, x.shape[1])))


@validated
def embed(x: points("")) -> np.ndarray:
    """Embed vectors of a two-dimensional scene in the plane y = 0.

    Parameters
    ----------
    x : array_like, shape (n, d)
        Vectors, d = 2 (x, z) or 3.

    Returns
    -------
    ndarray, shape (n, 3)
        Vectors in three dimensions.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> mps.measure.embed([[1.0, 2.0]]).tolist()
    [[1.0, 0.0, 2.0]]
    """
    return x if x.shape[1] == 3 else np.insert(x, 1, 0.0, axis=1)


@validated
def reflected(vectors: points(""), normal: vector(""), point: vector("m") | None = None) -> np.ndarray:
    """Reflect vectors or positions at a plane.

    Parameters
    ----------
    vectors : ndarray, shape (n, d)
        Vectors, or positions [m].
    normal : array_like, shape (d,)
        Unit normal of the plane.
    point : array_like, shape (d,), optional
        Point of the plane, for positions [m].

    Returns
    -------
    ndarray, shape (n, d)
        Images.

    Examples
    --------
    >>> import numpy as np, taichi_mps as mps
    >>> mps.measure.reflected(np.array([[0.25, 0.5]]), (1.0, 0.0)).tolist()
    [[-0.25, 0.5]]
    """
    for key, value in {"normal": normal, "point": point}.items():
        require(
            value is None or len(value) == vectors.shape[1],
            f"{key} = {value}: must have {vectors.shape[1]} numbers, as vectors have",
        )
    return vectors - 2.0 * np.outer((vectors - (0.0 if point is None else point)) @ normal, normal)


@validated
def mirrored(s: InstanceOf[Snapshot], point: vector("m"), normal: vector("")) -> Snapshot:
    """Complete a snapshot by its image at a plane.

    Parameters
    ----------
    s : Snapshot
        Half of a body.
    point : array_like, shape (d,)
        Point of the plane [m].
    normal : array_like, shape (d,)
        Unit normal of the plane.

    Returns
    -------
    Snapshot
        The particles and, after them and in the same order, their images, with the scalars of the particles.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> half = mps.measure.still([[0.25, 0.5]], 0.02)
    >>> mps.measure.mirrored(half, (0.0, 0.0), (1.0, 0.0)).x.tolist()
    [[0.25, 0.5], [-0.25, 0.5]]
    """
    require_axes(s, vertical=1, point=point, normal=normal)
    doubled = {name: np.tile(getattr(s, name), 2) for name in SCALARS}
    doubled |= {name: np.vstack([x, reflected(x, normal, point)]) for name, x in (("x", s.x), ("wall_x", s.wall_x))}
    loads = {name: load.mirrored(point, normal) for name, load in s.loads.items()}
    return replace(s, u=np.vstack([s.u, reflected(s.u, normal)]), loads=loads, **doubled)


def require_axes(s: Snapshot, vertical: int = 0, **places: Any) -> None:
    """Raise SceneError for places whose number of coordinates does not fit the particles.

    Parameters
    ----------
    s : Snapshot
        Fluid.
    vertical : int, optional
        1 if places have the vertical coordinate, 0 if they are horizontal.
    **places
        Places by their names [m].

    Raises
    ------
    SceneError
        For the first place that does not fit.

    Examples
    --------
    >>> from taichi_mps.engine.problem.measures import require_axes, still
    >>> require_axes(still([[0.0, 0.01]], 0.02), low=[0.0])
    """
    d = s.x.shape[1]
    for key, place in places.items():
        if np.shape(place)[-1] != d - 1 + vertical:
            raise SceneError(
                f"{key} = {quote(place, 'm')}: must have {d - 1 + vertical} coordinates, for particles that have {d}"
            )


def require_heap(s: Snapshot) -> None:
    """Raise SceneError for a snapshot that is not a body in three dimensions.

    Parameters
    ----------
    s : Snapshot
        Fluid.

    Raises
    ------
    SceneError
        In two dimensions, or without particles.

    Examples
    --------
    >>> from taichi_mps.engine.problem.measures import require_heap, still
    >>> require_heap(still([[0.0, 0.0, 0.01]], 0.02))
    """
    require(s.x.shape[1] == 3 and len(s.x), f"s of shape {s.x.shape}: must be a body in 3-D; scene.unfold gives it")


@validated
def surface(s: InstanceOf[Snapshot], points: HorizontalPoints) -> np.ndarray:
    """Return the height of the surface at horizontal places.

    Parameters
    ----------
    s : Snapshot
        Fluid.
    points : array_like, shape (k, d - 1)
        Horizontal places [m].

    Returns
    -------
    ndarray, shape (k,)
        Height of the highest particle within 0.75 spacings plus half its size [m]; nan where there is none.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> body = mps.measure.still(mps.lattice((0.0, 0.0), (0.2, 0.1), 0.02), 0.02)
    >>> mps.measure.surface(body, [[0.1]]).round(3).tolist()
    [0.1]
    """
    if not len(points):
        return np.zeros(0)
    require_axes(s, points=points)
    low, high = points.min(0) - s.spacing, points.max(0) + s.spacing
    close = np.all([(a < x) & (x < b) for a, x, b in zip(low, s.x.T, high, strict=False)], axis=0)
    near, top = s.x[close, :-1], s.x[close, -1] + 0.5 * s.size[close]
    order, heights = np.argsort(-top), np.full(len(points), np.nan)
    ends = near.min(0, initial=np.inf) - s.spacing, near.max(0, initial=-np.inf) + s.spacing
    over_body = np.all((points > ends[0]) & (points < ends[1]), axis=1)
    for first in range(0, len(top), 100):  # from the highest down: most places are covered by the first few
        left, k = np.flatnonzero(over_body & np.isnan(heights)), order[first : first + 100]
        if len(left) == 0:
            break
        distance2 = sum((points[left, None, axis] - near[k, axis]) ** 2 for axis in range(near.shape[1]))
        found = np.where(distance2 < (0.75 * s.spacing) ** 2, top[k], -np.inf).max(1)
        heights[left] = np.where(np.isfinite(found), found, np.nan)
    return heights


@validated
def over(s: InstanceOf[Snapshot], low: HorizontalPoint, high: HorizontalPoint) -> tuple[np.ndarray, np.ndarray]:
    """Sample the surface between two horizontal places.

    Parameters
    ----------
    s : Snapshot
        Fluid.
    low, high : array_like, shape (d - 1,)
        Lowest and highest place [m].

    Returns
    -------
    points : ndarray, shape (k, d - 1)
        Horizontal places, 0.4 spacings apart [m].
    heights : ndarray, shape (k,)
        Heights of the surface [m], nan where there is none.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> body = mps.measure.still(mps.lattice((0.0, 0.0), (0.2, 0.1), 0.02), 0.02)
    >>> points, heights = mps.measure.over(body, [0.05], [0.15])
    >>> points.shape, float(heights.max().round(3))
    ((13, 1), 0.1)
    """
    require_axes(s, low=low, high=high)
    with np.errstate(over="ignore"):
        places = float(np.prod(np.maximum(1.0, np.subtract(high, low) / (0.4 * s.spacing))))
    require(
        np.all(np.less_equal(low, high)) and places <= MAX_POINTS,
        f"from low = {low} to high = {high} m: must be above each other and hold at most {MAX_POINTS:.2g} places",
    )
    ticks = [np.arange(a, b + 1e-12, 0.4 * s.spacing) for a, b in zip(low, high, strict=True)]
    points = np.stack(np.meshgrid(*ticks), -1).reshape(-1, len(ticks))
    return points, surface(s, points)


@validated
def top_height(s: InstanceOf[Snapshot], radius: Size) -> float:
    """Return the mean height of the surface around the axis.

    Parameters
    ----------
    s : Snapshot
        Fluid in three dimensions.
    radius : float
        Radius of the disc around the z axis [m].

    Returns
    -------
    float
        Height [m], nan without particles there.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> cone = mps.measure.still(mps.fill(mps.Cone(0.1, 0.05, 0.3), 0.02), 0.02)
    >>> round(mps.measure.top_height(cone, 0.02), 3)
    0.3
    """
    require_heap(s)
    points, heights = over(s, (-radius, -radius), (radius, radius))
    heights = heights[(np.hypot(points[:, 0], points[:, 1]) <= radius) & np.isfinite(heights)]
    return float(heights.mean()) if len(heights) else float("nan")


@validated
def level(s: InstanceOf[Snapshot], low: HorizontalPoint, high: HorizontalPoint) -> float:
    """Return the mean height of the surface between two horizontal places, 0 where there is no fluid.

    Parameters
    ----------
    s : Snapshot
        Fluid.
    low, high : array_like, shape (d - 1,)
        Lowest and highest place [m].

    Returns
    -------
    float
        Mean height [m].

    Examples
    --------
    >>> import taichi_mps as mps
    >>> body = mps.measure.still(mps.lattice((0.0, 0.0), (0.2, 0.1), 0.02), 0.02)
    >>> round(mps.measure.level(body, [0.02], [0.18]), 3)
    0.1
    """
    return float(np.nan_to_num(over(s, low, high)[1]).mean())


@validated
def standing_level(s: InstanceOf[Snapshot], low: HorizontalPoint, high: HorizontalPoint) -> float:
    """Return the level of the fluid that stands on the floor z = 0 without a gap.

    Parameters
    ----------
    s : Snapshot
        Fluid.
    low, high : array_like, shape (d - 1,)
        Lowest and highest place [m].

    Returns
    -------
    float
        Mean height [m], as read with a ruler that stands on the floor. Drops that fly or hang on a wall, with a gap of
        more than half a spacing below them, do not count.

    Examples
    --------
    >>> import numpy as np, taichi_mps as mps
    >>> body = mps.lattice((0.0, 0.0), (0.2, 0.1), 0.02)
    >>> with_drop = mps.measure.still(np.vstack([body, [[0.1, 0.3]]]), 0.02)
    >>> round(mps.measure.standing_level(with_drop, [0.02], [0.18]), 3)
    0.1
    """
    require_axes(s, low=low, high=high)
    x = s.x[:, :-1]
    near = np.all((x > np.subtract(low, s.spacing)) & (x < np.add(high, s.spacing)), axis=1)
    heights = np.sort(s.x[near, -1])
    gaps = np.flatnonzero(np.diff(heights, prepend=-0.5 * s.spacing) > 1.5 * s.spacing)
    top = heights[gaps[0]] if len(gaps) else np.inf
    standing = {name: getattr(s, name)[s.x[:, -1] < top] for name in ("x", "u", *SCALARS)}
    return level(replace(s, **standing), low, high)


@validated
def spread(s: InstanceOf[Snapshot]) -> float:
    """Return the slump flow: the mean diameter of the widest layer.

    Parameters
    ----------
    s : Snapshot
        Whole body in three dimensions, around the z axis.

    Returns
    -------
    float
        Diameter [m], mean over all directions.

    Notes
    -----
    In a layer one particle thick and a sector one particle wide, each spacing of depth holds one particle, so the
    outermost one lies half a spacing inside the edge on average. In thicker layers and wider sectors the outermost
    particle is the one that stands out most, which makes the diameter up to 0.7 l0 too large. A rim thinner than a
    particle is read too short.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> cone = mps.measure.still(mps.fill(mps.Cone(0.1, 0.05, 0.3), 0.01), 0.01)
    >>> abs(mps.measure.spread(cone) - 0.2) < 0.01
    True
    """
    require_heap(s)
    r, angle = np.hypot(s.x[:, 0], s.x[:, 1]), np.arctan2(s.x[:, 1], s.x[:, 0])
    radius = np.quantile(r, 0.99)  # not the largest, which may belong to a stray particle
    size = float(np.median(s.size[r > radius - s.spacing]))
    sectors = max(4, int(2 * np.pi * radius / size))
    # no sector or layer ends where lattices and mirror planes have particles, so that rounding moves none across
    sector = np.floor((angle / (2 * np.pi) + 0.5) * sectors + 0.37).astype(int) % sectors
    quarter = ((s.x[:, 2] - s.x[:, 2].min()) / (0.25 * size) + 2.28).astype(int)  # number of the quarter of a layer
    outermost = np.zeros((quarter.max() + 4) * sectors)
    np.maximum.at(outermost, quarter * sectors + sector, r + 0.5 * s.size)
    outermost = outermost.reshape(-1, sectors)
    layers = np.max([outermost[k : len(outermost) - 3 + k] for k in range(4)], axis=0)
    return float(2.0 * (layers.sum(1) / np.maximum(1, (layers > 0.0).sum(1))).max())


@validated
def slump(s: InstanceOf[Snapshot], height: Size, axis_radius: Size = 0.02) -> dict[str, float]:
    """Return slump and slump flow of a body.

    Parameters
    ----------
    s : Snapshot
        Whole body in three dimensions, around the z axis.
    height : float
        Height of the body before the test [m].
    axis_radius : float, optional
        Radius around the axis within which the top is read [m].

    Returns
    -------
    dict
        ``slump_m`` at the axis, ``slump_max_m`` of the highest point and the slump flow ``spread_m`` [m].

    Examples
    --------
    >>> import taichi_mps as mps
    >>> cone = mps.measure.still(mps.fill(mps.Cone(0.1, 0.05, 0.3), 0.02), 0.02)
    >>> sorted(mps.measure.slump(cone, height=0.3))
    ['slump_m', 'slump_max_m', 'spread_m']
    """
    return {
        "slump_m": height - top_height(s, axis_radius),
        "slump_max_m": height - float((s.x[:, 2] + 0.5 * s.size).max()),
        "spread_m": spread(s),
    }


@validated
def front(s: InstanceOf[Snapshot]) -> dict[str, float]:
    """Return how far and how high a body reaches.

    Parameters
    ----------
    s : Snapshot
        Fluid.

    Returns
    -------
    dict
        ``front_m``, the farthest reach along x [m]; ``height_m``, the highest point [m] at which it is three
        particles wide.

    Notes
    -----
    The front is the end of the uniform distribution that has the mean and the variance of x of the foremost particles,
    four for each row along the flow. It is exact for an upright front and for a layer, and a single particle hardly
    moves it. Particles with no other within 2 l0 are drops, not the body. What sticks to a wall above the body, a
    particle thick, is not its height.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> body = mps.measure.still(mps.lattice((0.0, 0.0), (0.2, 0.1), 0.02), 0.02)
    >>> {name: round(value, 3) for name, value in mps.measure.front(body).items()}
    {'front_m': 0.2, 'height_m': 0.1}
    """
    require(len(s.x), "s: has no particles; must have one or more")
    rows = round(float(np.ptp(s.x[:, 1])) / s.spacing) + 1 if s.x.shape[1] == 3 else 1
    foremost = s.x[np.argsort(-s.x[:, 0], kind="stable")[: 8 * rows]]
    distances = np.linalg.norm(foremost[:, None] - foremost, axis=2) + 9.0 * s.spacing * np.eye(len(foremost))
    near = distances.min(axis=0) < 2.0 * s.spacing
    body = foremost[near | ~near.any(), 0][: 4 * rows]
    z = np.sort(s.x[:, -1])
    wide = z[np.arange(1, len(z) + 1) - np.searchsorted(z, z - 1.2 * s.spacing) >= 3 * rows]
    return {
        "front_m": float(body.mean() + np.sqrt(3.0 * (body.var() + s.spacing**2 / 12.0))),
        "height_m": float((wide if len(wide) else z)[-1] + 0.5 * s.spacing),
    }


@validated
def depth(
    s: InstanceOf[Snapshot], where: InstanceOf[np.ndarray] | list[Flag], area: real("m2", gt=0.0, le=1e9)
) -> float:
    """Return the mean depth of the fluid over a part of the floor.

    Parameters
    ----------
    s : Snapshot
        Fluid.
    where : ndarray of bool, shape (n,)
        Which particles count.
    area : float
        Area of that part of the floor [m2], in two dimensions its length [m].

    Returns
    -------
    float
        Volume of the particles over the area [m]; exact for a body without voids.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> body = mps.measure.still(mps.lattice((0.0, 0.0), (0.2, 0.1), 0.02), 0.02)
    >>> round(mps.measure.depth(body, body.x[:, 0] < 0.1, 0.1), 3)
    0.1
    """
    where = np.asarray(where)
    require(
        where.dtype == bool and where.shape == (len(s.x),),
        f"where = {quote(where, '')}: must be True or False for each of {len(s.x)} particles",
    )
    return float((s.size[where] ** s.x.shape[1]).sum() / area)


@validated
def by_height(s: InstanceOf[Snapshot], values: Values, edges: array("m", (None,))) -> np.ndarray:
    """Sum a quantity of the particles in horizontal layers.

    Parameters
    ----------
    s : Snapshot
        Fluid.
    values : ndarray, shape (n,)
        Quantity of each particle, which is spread evenly over its height.
    edges : ndarray, shape (k + 1,)
        Heights of the lower and upper ends of the layers [m], ascending.

    Returns
    -------
    ndarray, shape (k,)
        Sum of each layer, in the unit of ``values``.

    Examples
    --------
    >>> import numpy as np, taichi_mps as mps
    >>> body = mps.measure.still([[0.0, 0.01], [0.0, 0.03]], 0.02)
    >>> mps.measure.by_height(body, np.ones(2), np.array([0.0, 0.03, 0.04])).round(3).tolist()
    [1.5, 0.5]
    """
    require(len(values) == len(s.x), f"values of shape {values.shape}: must have one number a particle, {len(s.x)}")
    require(
        len(edges) >= 2 and np.all(np.diff(edges) > 0.0),
        f"edges = {quote(edges, 'm')}: must be two or more, each above the one before",
    )
    low, high = s.x[:, -1, None] - 0.5 * s.size[:, None], s.x[:, -1, None] + 0.5 * s.size[:, None]
    shared = np.maximum(0.0, np.minimum(high, edges[1:]) - np.maximum(low, edges[:-1]))
    return values @ (shared / s.size[:, None])


@validated
def grains(s: InstanceOf[Snapshot], beyond: InstanceOf[Callable] | None = None) -> dict[str, float]:
    """Count the grains, by height and beyond a place such as the far side of bars.

    Parameters
    ----------
    s : Snapshot
        Fluid with grains.
    beyond : callable, optional
        ``beyond(x)`` tells of positions (k, d) [m] whether they are beyond, bool (k,).

    Returns
    -------
    dict
        ``grains_number``; ``grains_top_ratio``, ``grains_middle_ratio`` and ``grains_bottom_ratio``, fractions of the
        grains whose centre is in these thirds of the depth at its place, from the lowest point of the body; with
        ``beyond``: ``grains_passed_number``, grains whose centre is beyond, and ``mortar_passed_ratio``, the fraction
        of the volume of mortar that is. Empty without grains.

    Notes
    -----
    The surface above a grain is that of the column of two spacings in which its highest particle is.

    Examples
    --------
    >>> import numpy as np, taichi_mps as mps
    >>> from dataclasses import replace
    >>> body = mps.measure.still([[0.0, 0.01], [0.02, 0.01], [0.2, 0.01], [0.24, 0.01]], spacing=0.02)
    >>> body = replace(body, grain=np.array([1, 1, 0, 0]))
    >>> found = mps.measure.grains(body, lambda x: x[:, 0] > 0.22)
    >>> found["grains_number"], found["grains_passed_number"], found["mortar_passed_ratio"]
    (1.0, 0.0, 0.5)
    """
    member = s.grain > 0
    if not member.any():
        return {}
    _, number = np.unique(s.grain[member], return_inverse=True)
    x, d = s.x[member], s.x.shape[1]
    centres = np.stack([np.bincount(number, column) for column in x.T], -1) / np.bincount(number)[:, None]
    # columns of two spacings, with no lattice plane on their faces
    column = ((s.x[:, :-1] - s.x[:, :-1].min(0)) / (2.0 * s.spacing) + 1.0 / 12.0).astype(int)
    column = np.ravel_multi_index(column.T, column.max(0) + 1)
    tops = np.full(column.max() + 1, -np.inf)
    np.maximum.at(tops, column, s.x[:, -1] + 0.5 * s.size)
    rising, highest = np.argsort(x[:, -1], kind="stable"), np.zeros(len(centres), int)
    highest[number[rising]] = rising  # the last one of each grain
    floor = (s.x[:, -1] - 0.5 * s.size).min()
    heights = (centres[:, -1] - floor) / (tops[column[member][highest]] - floor)
    thirds = np.bincount(np.clip((3.0 * heights).astype(int), 0, 2), minlength=3) / len(centres)
    found = {
        "grains_number": float(len(centres)),
        "grains_top_ratio": float(thirds[2]),
        "grains_middle_ratio": float(thirds[1]),
        "grains_bottom_ratio": float(thirds[0]),
    }
    if beyond:
        mortar = s.size**d * ~member
        found["grains_passed_number"] = float(np.count_nonzero(beyond(centres)))
        found["mortar_passed_ratio"] = float(mortar[beyond(s.x)].sum() / max(mortar.sum(), np.finfo(float).tiny))
    return found


@validated
def clearance(s: InstanceOf[Snapshot], walls: Sequence[InstanceOf[HasDistance]]) -> float:
    """Return the least distance of a particle from the walls.

    Parameters
    ----------
    s : Snapshot
        Fluid.
    walls : sequence of Plane, Cylinder or Solid
        Walls.

    Returns
    -------
    float
        Distance [m], negative if a particle is behind a wall.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> body = mps.measure.still([[0.0, 0.01], [0.0, 0.03]], 0.02)
    >>> mps.measure.clearance(body, [mps.Plane((0.0, 0.0), (0.0, 1.0))])
    0.01
    """
    require(walls, "walls = (): must be one wall or more")
    require(len(s.x), "s: has no particles; must have one or more")
    return min(float(wall.distance(s.x, s.time).min()) for wall in walls)


@validated
def time_of(time: Values, values: array("", (None,), gaps=True), level: real("")) -> float:
    """Return the first time at which a history reaches a level.

    Parameters
    ----------
    time : array_like, shape (n,)
        Times [s].
    values : array_like, shape (n,)
        Values at these times.
    level : float
        Level, in the unit of ``values``.

    Returns
    -------
    float
        Time [s], linear between two values; nan if the level is not reached.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> mps.measure.time_of([0.0, 1.0, 2.0], [0.2, 0.4, 0.6], 0.5)
    1.5
    """
    require(len(time) == len(values), f"values: {len(values)} numbers; must be as many as of time, {len(time)}")
    time, values = time[~np.isnan(values)], values[~np.isnan(values)]
    reached = np.flatnonzero(values >= level)
    if not len(reached):
        return float("nan")
    last = slice(max(0, reached[0] - 1), reached[0] + 1)
    return float(np.interp(level, values[last], time[last]))
