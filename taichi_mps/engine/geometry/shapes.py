"""Bodies filled with a lattice of particles. Plain NumPy."""

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from pydantic import InstanceOf

from ...units import Count, Size, array, points, real, require, validated, vector
from ..runtime.memory import require_available

Offset = real("", ge=-1e6, le=1e6) | array("", (None,))
MAX_POINTS = 4e7  # of one lattice, of which a cone fills two fifths: 95 GB
MAX_LEFT_OUT = 0.1  # of a body, without a warning [-]
CHECK_MEMORY_FROM = 1e6  # points of a lattice from which on the free memory is checked first
BYTES_PER_POINT = 90  # memory of a point while a body is cut out of the lattice


@runtime_checkable
class Body(Protocol):
    """Protocol of a body that can be filled: it has ``contains(x)``, ``bounds`` and ``volume``.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> from taichi_mps.engine.geometry.shapes import Body
    >>> isinstance(mps.Box((0.0, 0.0), (0.5, 0.2)), Body)
    True
    """

    @property
    def contains(self) -> Callable:
        """Function of positions (n, d) [m]: which lie inside, (n,)."""


@runtime_checkable
class HasDistance(Protocol):
    """Protocol of a surface that bounds a fluid: it has ``distance(x)``.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> from taichi_mps.engine.geometry.shapes import HasDistance
    >>> isinstance(mps.Plane((0.0, 0.0), (0.0, 1.0)), HasDistance)
    True
    """

    @property
    def distance(self) -> Callable:
        """Function of positions (n, d) [m]: distance [m] of the surface, (n,)."""


@validated
@dataclass(frozen=True)
class Box:
    """Axis-parallel box, in two dimensions a rectangle, between two corners.

    Parameters
    ----------
    low, high : tuple of float, length d
        Lowest and highest corner [m], d = 2 or 3.

    Raises
    ------
    SceneError
        If ``high`` is not above ``low`` along each axis.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> mps.Box((0.0, 0.0), (0.5, 0.2)).volume
    0.1
    """

    low: vector("m")
    high: vector("m")

    def __post_init__(self):
        require(
            len(self.low) == len(self.high) and np.all(np.less(self.low, self.high)),
            f"high = {self.high} m of a box: must be above low = {self.low} m along each axis",
        )

    @validated
    def contains(self, x: points("m")) -> np.ndarray:
        """Return which points are inside.

        Parameters
        ----------
        x : ndarray, shape (n, d)
            Points [m].

        Returns
        -------
        ndarray of bool, shape (n,)
            True inside, False on the surface and outside.
        """
        require(x.shape[1] == len(self.low), f"x = points of {x.shape[1]} coordinates: must have {len(self.low)}")
        return np.all((x > self.low) & (x < self.high), axis=1)

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest corner [m] of the enclosing box, each of shape (d,)."""
        return np.array(self.low, float), np.array(self.high, float)

    @property
    def volume(self) -> float:
        """Volume [m3], in two dimensions the area [m2]."""
        return float(np.prod(np.subtract(self.high, self.low)))


@validated
@dataclass(frozen=True)
class Cone:
    """Truncated cone around the z axis, standing on z = 0.

    Parameters
    ----------
    base_radius, top_radius : float
        Radii at the base and at the top [m]; one of them may be 0.
    height : float
        Height [m].

    Raises
    ------
    SceneError
        If a radius is negative or the cone has no volume.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> cone = mps.Cone(base_radius=0.1, top_radius=0.05, height=0.3)
    >>> round(1e3 * cone.volume, 3)  # litres
    5.498
    """

    base_radius: real("m", ge=0.0, le=1e9)
    top_radius: real("m", ge=0.0, le=1e9)
    height: Size

    def __post_init__(self):
        require(
            self.volume > 0.0,
            f"base_radius = {self.base_radius:g} m, top_radius = {self.top_radius:g} m: one must be greater than 0 m",
        )

    @validated
    def contains(self, x: points("m")) -> np.ndarray:
        """Return which points are inside.

        Parameters
        ----------
        x : ndarray, shape (n, 3)
            Points [m].

        Returns
        -------
        ndarray of bool, shape (n,)
            True inside, False on the surface and outside.
        """
        require(x.shape[1] == 3, f"x = points of {x.shape[1]} coordinates: must have 3")
        radius = self.base_radius + (self.top_radius - self.base_radius) * x[:, 2] / self.height
        return (x[:, 2] > 0) & (x[:, 2] < self.height) & (np.hypot(x[:, 0], x[:, 1]) < radius)

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest corner [m] of the enclosing box, each of shape (3,)."""
        r = max(self.base_radius, self.top_radius)
        return np.array([-r, -r, 0.0]), np.array([r, r, self.height])

    @property
    def volume(self) -> float:
        """Volume [m3]."""
        a, b = self.base_radius, self.top_radius
        return np.pi * self.height / 3.0 * (a * a + a * b + b * b)


@validated
def lattice(low: array("m", (None,)), high: array("m", (None,)), spacing: Size, offset: Offset = 0.5) -> np.ndarray:
    """Return the points of a cubic lattice in a box.

    Parameters
    ----------
    low, high : array_like, shape (d,)
        Lowest and highest corner of the box [m].
    spacing : float
        Distance between neighbouring points [m].
    offset : float or array_like of shape (d,), optional
        Distance of the first point from ``low``, in spacings [-], for all axes or for each.

    Returns
    -------
    ndarray, shape (n, d)
        Positions [m]; the last coordinate varies fastest.

    Raises
    ------
    SceneError
        If the spacing is not positive, or there would be more points than memory or 1e8.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> mps.lattice((0.0, 0.0), (0.2, 0.1), 0.1).round(3).tolist()
    [[0.05, 0.05], [0.15, 0.05]]
    """
    require(len(low) == len(high), f"high = {high} m: must have as many coordinates as low = {low} m")
    require(np.size(offset) in (1, len(low)), f"offset = {offset}: must be one number, or {len(low)}")
    with np.errstate(over="ignore"):  # a tiny spacing overflows
        points = float(np.prod(np.maximum(high - low, 0.0) / spacing))
    least = spacing * (points / MAX_POINTS) ** (1.0 / len(low))
    require(
        points <= MAX_POINTS,
        f"spacing = {spacing:g} m: fills the box with {points:.2g} particles, at most {MAX_POINTS:.2g}; must be at "
        f"least {1.01 * least:.3g} m",
    )
    if points > CHECK_MEMORY_FROM:
        require_available(
            BYTES_PER_POINT * points, f"spacing = {spacing:g} m: {points:.2g} particles of a lattice take"
        )
    axes = [
        lo + spacing * (o + np.arange(max(0, int(np.floor((hi - lo) / spacing - o + 1 + 1e-9)))))
        for lo, hi, o in zip(low, high, np.broadcast_to(offset, low.shape), strict=True)
    ]
    return np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, len(low))


@validated
def rings(inner_radius: real("m", ge=0.0, le=1e9), outer_radius: Size, spacing: Size) -> np.ndarray:
    """Return points on concentric circles about the origin, a spacing apart.

    Parameters
    ----------
    inner_radius, outer_radius : float
        Radii between which the circles lie [m]; a disc has the inner radius 0.
    spacing : float
        Wanted distance of circles, and of points along a circle [m].

    Returns
    -------
    ndarray, shape (n, 2)
        Positions [m].

    Raises
    ------
    SceneError
        If the radii are not at least a spacing apart.

    Notes
    -----
    Unlike a square lattice, circles follow a round wall without steps.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> mps.rings(0.0, 0.1, 0.02).shape
    (78, 2)
    """
    number = np.pi * (outer_radius**2 - inner_radius**2) / spacing / spacing
    require(
        number <= MAX_POINTS,
        f"outer_radius = {outer_radius:g} m with spacing = {spacing:g} m: makes {number:.2g} points; must be at most "
        f"{MAX_POINTS:.2g}",
    )
    count = round((outer_radius - inner_radius) / spacing)
    require(
        count >= 1,
        f"outer_radius = {outer_radius:g} m: must be greater than inner_radius = {inner_radius:g} m by a spacing of "
        f"{spacing:g} m",
    )
    width = (outer_radius - inner_radius) / count
    points = []
    for k in range(count):
        radius = inner_radius + (k + 0.5) * width
        number = round(2.0 * np.pi * radius * width / spacing**2)
        angle = 2.0 * np.pi * (np.arange(number) / number + 0.618034 * k)  # no ring starts where another does
        points.append(radius * np.stack([np.cos(angle), np.sin(angle)], -1))
    return np.vstack(points)


@validated
def shell(low: vector("m"), high: vector("m"), spacing: Size, layers: Count = 3) -> np.ndarray:
    """Return wall particles in layers around a box that is open at the top.

    Parameters
    ----------
    low, high : array_like, shape (d,)
        Lowest and highest corner of the inside of the box [m]; the last axis points up.
    spacing : float
        Distance between particles [m].
    layers : int, optional
        Number of layers.

    Returns
    -------
    ndarray, shape (m, d)
        Positions [m].

    Examples
    --------
    >>> import taichi_mps as mps
    >>> mps.shell((0.0, 0.0), (0.3, 0.1), 0.1, layers=1).shape
    (7, 2)
    """
    low, high = Box(low, high).bounds
    thick = layers * spacing
    top = np.append(np.zeros(len(low) - 1), 1.0)
    x = lattice(low - thick, high + thick * (1.0 - top), spacing)
    return x[~np.all((x > low) & (x < high + thick * top), axis=1)]


@validated
def fill_rings(solid: InstanceOf[Body], spacing: Size) -> np.ndarray:
    """Fill a body of revolution with rings, for an axisymmetric scene.

    Parameters
    ----------
    solid : Cone or object with ``bounds`` and ``contains``
        Body around the z axis [m].
    spacing : float
        Particle size [m].

    Returns
    -------
    ndarray, shape (n, 2)
        Positions (r, z) of the rings [m], one for each spacing squared of the section, the first half a spacing from
        the axis and from the base.

    Raises
    ------
    SceneError
        If no ring fits into the body.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> mps.fill_rings(mps.Cone(0.1, 0.1, 0.2), 0.1).round(3).tolist()
    [[0.05, 0.05], [0.05, 0.15]]
    """
    low, high = solid.bounds
    require(len(low) == 3, f"solid = {solid}: must be a body with three coordinates")
    x = lattice((0.0, low[2]), (high[0] + spacing, high[2]), spacing)
    x = x[solid.contains(np.insert(x, 1, 0.0, axis=1))]
    require(len(x), f"spacing = {spacing:g} m: no ring fits into the body; use a smaller spacing")
    return x


@validated
def fill(solid: InstanceOf[Body], spacing: Size, mirrors: Sequence[InstanceOf[HasDistance]] = ()) -> np.ndarray:
    """Fill a body with particles on a lattice.

    Parameters
    ----------
    solid : Box, Cone or object with ``bounds``, ``contains`` and ``volume``
        Body to fill [m].
    spacing : float
        Particle size l0 [m].
    mirrors : sequence of Plane, optional
        Mirror planes across axes; only what lies in front of them is filled, with the edge of the lattice on them.

    Returns
    -------
    ndarray, shape (n, d)
        Positions [m], one for each volume l0^d of the body.

    Raises
    ------
    SceneError
        If the spacing is larger than the body, or a mirror is not across an axis.

    Notes
    -----
    Particles start half a spacing above the lower faces. Of the lattices that keep the mirror symmetry of the body,
    with a particle or an edge in the middle, the one whose volume is nearest to that of the body is taken. A box has
    whole layers alone: of sides of 7.5 spacings it holds 7; a warning tells where more than a tenth is left out.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> len(mps.fill(mps.Box((0.0, 0.0, 0.0), (0.1, 0.1, 0.2)), 0.02))
    250
    """
    low, high = solid.bounds
    size = high - low
    require(
        np.all(size >= 0.999 * spacing),
        f"spacing = {spacing:g} m: larger than the body, whose smallest side is {size.min():.4g} m; must be at most "
        f"{size.min():.4g} m",
    )
    for mirror in mirrors:
        require(
            np.count_nonzero(np.abs(mirror.normal) > 1e-9) == 1,
            f"mirrors: normal = {mirror.normal}: must be along an axis",
        )
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
    fraction = len(best) * spacing ** len(low) / solid.volume
    if len(best) and abs(fraction - 1.0) > MAX_LEFT_OUT:
        warnings.warn(
            f"spacing = {spacing:g} m: particles fill {fraction:.0%} of the body; a spacing of which its sides are "
            "multiples, or a smaller one, fills it",
            stacklevel=3,
        )
    for mirror in mirrors:
        best = best[mirror.distance(best) > 0.0]
    require(len(best), f"spacing = {spacing:g} m: no particle fits into the body; use a smaller spacing")
    return best
