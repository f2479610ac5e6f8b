"""Walls: planes, circles, cylinders and mantles of cones, and the friction on them. Plain NumPy."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from pydantic import Field, InstanceOf, model_validator

from ...units import (
    Checked,
    Flag,
    Instant,
    Size,
    Text,
    YieldValue,
    array,
    array_of,
    points,
    quote,
    real,
    require,
    validated,
    vector,
)
from .shapes import Box, HasDistance
from .time_dependent import Moving, table_of_time


class Friction(Checked):
    """Friction between the fluid and a wall, as a tribometer measures it.

    Without a yield stress this is Navier's slip, with the slip length viscosity/``viscous_constant``. The parameters
    are the fields below.

    Raises
    ------
    SceneError
        If both numbers are 0: that is a wall with ``slip=True``.

    Notes
    -----
    The wall holds the fluid up to the yield stress of the interface tau_0; beyond, it slips at the velocity v against
    the stress tau_0 + k v (eq I23): a lubricating layer, as of pumped concrete, slips at (tau - tau_0)/k.
    The layer between a particle and the wall has the ``typical_slope`` of the fluid's flow curve: of Bingham's law the
    plastic viscosity, of Herschel and Bulkley's k 5^(n-1), of others the slope of the chord up to 5 1/s.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> oiled = mps.Friction(yield_value=20.0, viscous_constant=100.0)
    >>> floor = mps.Plane((0.0, 0.0), (0.0, 1.0), friction=oiled)
    """

    yield_value: YieldValue = Field(default=0.0, description="yield stress of the interface")
    viscous_constant: real("Pa s/m", ge=0.0, le=1e9) = Field(
        default=0.0, description="viscous resistance of the interface"
    )

    @model_validator(mode="after")
    def _require_resistance(self):
        if self.yield_value == 0.0 and self.viscous_constant == 0.0:
            raise ValueError("no friction at all; must be slip = True of the wall, not Friction()")
        return self


def check_surface(wall, first="point"):
    """Refuse a wall with both friction and slip, or with a name, flag or friction of the wrong type.

    Parameters
    ----------
    wall : Plane, Cylinder or Solid
        Wall to check.
    first : str, optional
        Name of the key that gives the number of dimensions, for messages.

    Raises
    ------
    SceneError
        For the first key that is wrong.
    """
    require(
        not wall.name or wall.name.isidentifier(),
        f"name = {wall.name!r} of a wall: must be one word of letters, digits and _",
    )
    d = len(wall.point)
    for key in ("normal", "velocity", "pivot", "axis"):
        value = getattr(wall, key, None)
        require(
            value is None or np.ndim(value) != 1 or len(value) == d,
            f"{key} = {value} of a wall with {first} = {wall.point}: must be {d} finite numbers",
        )
    require(
        wall.friction is None or not wall.slip,
        f"slip = True with friction = {wall.friction}: a wall has one of them; must be left out",
    )
    wall.in_time  # noqa: B018  (evaluated here, so that an error in it is raised here)


def require_same_dimension(x, point):
    """Raise a SceneError unless points x (n, d) [m] have as many coordinates as a point of a wall."""
    require(x.shape[1] == len(point), f"x = points of {x.shape[1]} coordinates: must have {len(point)}")


def spin(turns: float, unit_axis, d: int) -> np.ndarray:
    """Return the velocity gradient of a rigid rotation.

    Parameters
    ----------
    turns : float
        Angular velocity [rad/s], in two dimensions counter-clockwise.
    unit_axis : array_like, shape (3,)
        Unit vector along the axis; not read in two dimensions.
    d : int
        Number of dimensions.

    Returns
    -------
    ndarray, shape (d, d)
        Gradient W [1/s]: the velocity is W x.
    """
    x, y, z = unit_axis if d == 3 else (0.0, 0.0, 1.0)
    return turns * np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])[:d, :d]


@validated
@dataclass(frozen=True)
class Plane(Moving):
    """Wall that fills the half-space behind a plane.

    Parameters
    ----------
    point : tuple of float, length d
        Point of the plane [m].
    normal : tuple of float, length d
        Unit normal into the fluid [-].
    velocity : tuple of float, length d, optional
        Velocity of the wall [m/s], in its own plane or out of it; at rest by default. If it changes: rows of a time [s]
        and a velocity, linear in between and with a jump where a time is there twice.
    slip : bool, optional
        Leave the tangential motion of the fluid free.
    loose : bool, optional
        Unilateral contact: the wall pushes, and the fluid parts from it where it would have to pull.
    mirror : bool, optional
        Plane of symmetry: a slip wall to the fluid, while measures and pictures show what lies behind it, too.
    friction : Friction, optional
        Resistance to the tangential motion, between no slip and slip.
    name : str, optional
        Name in the measured wall loads; ``wall_0``, ``wall_1``, ... by default.

    Raises
    ------
    SceneError
        If the normal is no unit vector, or two keys contradict each other.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> floor = mps.Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    >>> floor.distance([[0.3, 0.0, 0.25]]).tolist()
    [0.25]
    """

    point: vector("m")
    normal: vector("")
    velocity: vector("m/s") | table_of_time("m/s") | None = None
    slip: Flag = False
    loose: Flag = False
    mirror: Flag = False
    friction: InstanceOf[Friction] | None = None
    name: Text = ""
    thin = False

    def __post_init__(self):
        check_surface(self)
        kind = "mirror plane" if self.mirror else "plane"
        require(
            abs(np.linalg.norm(self.normal) - 1.0) <= 1e-6,
            f"normal = {self.normal} of a {kind}: must have the length 1",
        )
        if self.mirror:
            require(
                self.friction is None,
                f"friction = {self.friction} of a mirror plane: nothing rubs there; must be left out",
            )
            require(
                self.velocity is None,
                f"velocity = {self.velocity} m/s: a mirror plane cannot move; must be left out",
            )
            object.__setattr__(self, "slip", True)

    @property
    def travel(self) -> np.ndarray:
        """Velocity at which the wall changes its position [m/s], shape (d,); zero if it moves in its own plane."""
        velocities = np.atleast_2d(self.fastest if self.in_time is None else self.in_time.values)
        normal_motion = np.abs(velocities @ np.array(self.normal)) > 1e-9 * np.linalg.norm(velocities, axis=1)
        return self.fastest if normal_motion.any() else 0.0 * self.fastest

    @validated
    def distance(self, x: points("m"), time: Instant = 0.0) -> np.ndarray:
        """Return the signed distance of points from the wall.

        Parameters
        ----------
        x : array_like, shape (n, d)
            Points [m].
        time : float, optional
            Time at which the wall is looked at [s].

        Returns
        -------
        ndarray, shape (n,)
            Distance [m], positive in the fluid.
        """
        require_same_dimension(x, self.point)
        return (x - np.array(self.point) - self.displacement(time)) @ np.array(self.normal)

    @cached_property
    def speed(self) -> float:
        """Largest speed of the wall [m/s]."""
        return float(np.linalg.norm(self.fastest))


@validated
@dataclass(frozen=True)
class Cylinder(Moving):
    """Wall that is a cylinder, the mantle of a truncated cone, or in two dimensions a circle.

    Parameters
    ----------
    point : tuple of float, length d
        Point of the axis [m], at the first end of a wall with a length; in two dimensions the centre.
    radius : float
        Radius at ``point`` [m].
    axis : tuple of float, length 3, optional
        Direction of the axis [-]; None in two dimensions.
    inside : bool, optional
        Whether the fluid is inside.
    angular_velocity : float, optional
        Rotation about the axis [rad/s], counter-clockwise seen against the axis.
    velocity : float, optional
        Velocity along the axis [m/s]; rows of a time [s] and a velocity if it changes.
    slip : bool, optional
        Leave the tangential motion of the fluid free.
    slope : float, optional
        Change of the radius along the axis [-]: a funnel or a slump cone.
    length : float, optional
        Length along the axis [m]; endless by default.
    loose : bool, optional
        Unilateral contact: the wall pushes and does not pull.
    thin : bool, optional
        Thin sheet with fluid on both sides, which do not feel each other through it: a mould that is lifted.
    friction : Friction, optional
        Resistance to the tangential motion, between no slip and slip.
    name : str, optional
        Name in the measured wall loads.

    Raises
    ------
    SceneError
        If a radius is not positive, a sloped or thin wall has no length, or a circle has an axis.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> pipe = mps.Cylinder((0.0, 0.0, 0.0), radius=0.1, axis=(0.0, 0.0, 1.0))
    >>> pipe.distance([[0.04, 0.0, 1.0]]).round(3).tolist()
    [0.06]
    """

    point: vector("m")
    radius: Size
    axis: array("", (0,), (3,), kind=tuple) | None = None
    inside: Flag = True
    angular_velocity: real("rad/s", ge=-1e6, le=1e6) = 0.0
    velocity: real("m/s", ge=-1e6, le=1e6) | table_of_time("m/s") = 0.0
    slip: Flag = False
    slope: real("", ge=-1e6, le=1e6) = 0.0
    length: Size | None = None
    loose: Flag = False
    thin: Flag = False
    friction: InstanceOf[Friction] | None = None
    name: Text = ""

    def __post_init__(self):
        check_surface(self)
        d = len(self.point)
        given = array_of([] if self.axis is None else self.axis)
        require(
            (given.shape == (3,) and given.any()) if d == 3 else given.shape == (0,),
            f"axis = {self.axis}: must be a direction of 3 numbers in 3-D and None in 2-D",
        )
        require(
            d == 3 or not (self.velocity or self.slope or self.length),
            f"velocity = {quote(self.velocity, 'm/s')}, slope = {self.slope:g}, length = {self.length} m: a circle has "
            "no axis; must be left out in 2-D",
        )
        endless = self.length is None
        require(
            not (self.slope and endless),
            f"slope = {self.slope:g}: needs a length; a cone that goes on has no radius at its tip",
        )
        require(not (self.thin and endless), "thin = True: needs a length; what is thin must end somewhere")
        narrow = self.smallest_radius
        require(narrow > 0.0, f"slope = {self.slope:g}: radius = {narrow:g} m at an end; must be greater than 0 m")

    @property
    def smallest_radius(self) -> float:
        """Radius at the narrower end [m]."""
        return self.radius + min(0.0, self.slope * (self.length or 0.0))

    @cached_property
    def speed(self) -> float:
        """Largest speed of the wall [m/s]."""
        return float(
            np.hypot(
                self.angular_velocity * (self.radius + max(0.0, self.slope * (self.length or 0.0))),
                np.linalg.norm(self.fastest),
            )
        )

    @property
    def travel(self) -> np.ndarray:
        """Velocity at which the wall changes its position [m/s], shape (d,); zero for an endless wall."""
        return self.fastest if self.length is not None else 0.0 * self.unit_axis

    @property
    def components(self) -> int:
        """Number of components of the velocity: 1, along the axis."""
        return 1

    def _as_vector(self, velocity):
        """Convert the velocity along the axis to a vector (d,) [m/s]."""
        return np.ravel(velocity)[0] * self.unit_axis

    @property
    def circles(self) -> list[np.ndarray]:
        """Outlines to draw: the circles at the ends as arrays of shape (k, d) [m]."""
        angle = np.linspace(0.0, 2.0 * np.pi, 73)
        across = np.eye(2) if len(self.point) == 2 else np.linalg.svd(self.unit_axis[None])[2][1:]
        unit = np.stack([np.cos(angle), np.sin(angle)], -1) @ across
        ends = [0.0] if self.length is None else [0.0, self.length]
        return [np.array(self.point) + s * self.unit_axis + (self.radius + self.slope * s) * unit for s in ends]

    @validated
    def distance(self, x: points("m"), time: Instant = 0.0) -> np.ndarray:
        """Return the signed distance of points from the wall.

        Parameters
        ----------
        x : array_like, shape (n, d)
            Points [m].
        time : float, optional
            Time at which the wall is looked at [s].

        Returns
        -------
        ndarray, shape (n,)
            Distance [m], positive in the fluid, from a thin wall on both sides; infinite beyond its ends.
        """
        require_same_dimension(x, self.point)
        offset = x - np.array(self.point) - self.displacement(time)
        s = offset @ self.unit_axis
        r = np.linalg.norm(offset - np.outer(s, self.unit_axis), axis=1)
        cosine = 1.0 / np.hypot(1.0, self.slope)
        z = (1.0 if self.inside else -1.0) * cosine * (self.radius + self.slope * s - r)
        if self.length is None:
            return z
        foot = s - z * (1.0 if self.inside else -1.0) * cosine * self.slope
        return np.where((foot >= 0.0) & (foot <= self.length), np.abs(z) if self.thin else z, np.inf)


@validated
def box_planes(
    low: vector("m"), high: vector("m"), slip: Flag = False, friction: InstanceOf[Friction] | None = None
) -> tuple[Plane, ...]:
    """Return the walls of a box that is open at the top.

    Parameters
    ----------
    low, high : array_like, shape (d,)
        Lowest and highest corner [m]; the last axis points up.
    slip : bool, optional
        Leave the tangential motion of the fluid free.
    friction : Friction, optional
        Resistance to the tangential motion.

    Returns
    -------
    tuple of Plane
        Floor, walls at ``low``, walls at ``high``.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> floor, left, right = mps.box_planes((0.0, 0.0), (0.4, 0.2))
    >>> left.distance([[0.1, 0.05]]).tolist(), right.distance([[0.1, 0.05]]).round(3).tolist()
    ([0.1], [0.3])
    """
    corners = Box(low, high)
    low, high = (tuple(map(float, corner)) for corner in (corners.low, corners.high))
    *across, up = np.eye(len(low))
    places = [(low, up), *((low, normal) for normal in across), *((high, -normal) for normal in across)]
    return tuple(Plane(point, tuple(normal), slip=slip, friction=friction) for point, normal in places)


@validated
def vessel(section: Sequence, sides: Sequence, half_width: real("m", ge=0.0, le=1e9)) -> tuple[np.ndarray, ...]:
    """Return the faces of a vessel whose section is the same all across its width, for pictures.

    Parameters
    ----------
    section : sequence of array_like, shape (k, 2)
        Lines (x, z) of walls across the vessel [m].
    sides : sequence of array_like, shape (k, 2)
        Convex polygons (x, z) that make up each of its two sides [m].
    half_width : float
        Half width of the vessel along y [m].

    Returns
    -------
    tuple of ndarray, shape (k, 3)
        Faces [m].

    Examples
    --------
    >>> import taichi_mps as mps
    >>> trough = [(0.0, 0.2), (0.0, 0.0), (0.7, 0.0), (0.7, 0.2)]
    >>> len(mps.vessel([trough], [trough], half_width=0.1))
    5
    """
    y = np.array([0.0, half_width, 0.0])
    lines, faces = ([np.insert(np.array(line, float), 1, 0.0, axis=1) for line in some] for some in (section, sides))
    across = [np.array([a - y, b - y, b + y, a + y]) for line in lines for a, b in zip(line, line[1:], strict=False)]
    return (*across, *(face + side for face in faces for side in (-y, y)))


@validated
def behind(walls: Sequence[InstanceOf[HasDistance]], x: points("m"), thick: Size) -> np.ndarray:
    """Return the positions that lie behind a wall, as places of wall particles.

    Parameters
    ----------
    walls : sequence of Plane, Cylinder or Solid
        Walls.
    x : ndarray, shape (n, d)
        Candidates [m], such as a ``lattice``.
    thick : float
        Largest depth behind a wall [m].

    Returns
    -------
    ndarray, shape (m, d)
        Candidates behind a wall and not deeper than ``thick`` [m].

    Examples
    --------
    >>> import taichi_mps as mps
    >>> floor = mps.Plane((0.0, 0.0), (0.0, 1.0))
    >>> mps.behind([floor], mps.lattice((0.0, -0.3), (0.1, 0.1), 0.1), 0.2).round(3).tolist()
    [[0.05, -0.15], [0.05, -0.05]]
    """
    require(walls, "walls = (): must be one wall or more")
    depth = np.max([-wall.distance(x) for wall in walls], axis=0)
    return x[(depth > 0.0) & (depth < thick)]
