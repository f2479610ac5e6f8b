"""Walls: planes, circles, cylinders and mantles of cones, and the friction on them. Plain NumPy."""

from dataclasses import dataclass

import numpy as np
from pydantic import Field, model_validator

from ..units import Checked, ViscousConstant, YieldValue, array_of, check_kinds, check_numbers, check_vectors, require
from .shapes import Box


class Friction(Checked):
    """Friction between the fluid and a wall, as a tribometer measures it. The wall holds the fluid up to the yield
    stress of the interface, ``yield_value`` [Pa]; beyond, it slips against that stress plus
    ``viscous_constant`` [Pa s/m] times the slip velocity. Without a yield stress this is Navier's slip, with the slip
    length viscosity/viscous_constant.
    """

    yield_value: YieldValue = Field(0.0, description="yield stress of the interface")
    viscous_constant: ViscousConstant = Field(0.0, description="viscous resistance of the interface")

    @model_validator(mode="after")
    def _holds_something(self):
        if self.yield_value == 0.0 and self.viscous_constant == 0.0:
            raise ValueError("no friction at all; must be slip = True of the wall, not Friction()")
        return self


def check_surface(wall):
    """SceneError unless a wall has either friction or slip, a name that is a word, and what is no number its type."""
    check_kinds(wall, {"friction": (Friction, "Friction(...)"), "name": (str, "text")})
    named = not wall.name or wall.name.isidentifier()
    require(named, f"name = {wall.name!r} of a wall: must be one word of letters, digits and _")
    flags = [key for key in ("slip", "loose", "mirror", "inside") if hasattr(wall, key)]
    check_kinds(wall, {key: (bool | np.bool_, "True or False") for key in flags})
    both = f"slip = True with friction = {wall.friction}: a wall has one of them; must be left out"
    require(wall.friction is None or not wall.slip, both)


def spin(turns: float, unit_axis, d: int) -> np.ndarray:
    """Gradient (d, d) of the velocity of what turns with ``turns`` [rad/s] about a unit vector (3,), in two dimensions
    counter-clockwise [1/s]."""
    x, y, z = unit_axis if d == 3 else (0.0, 0.0, 1.0)
    return turns * np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])[:d, :d]


@dataclass(frozen=True)
class Plane:
    """Wall: the half-space behind the plane through ``point`` with unit ``normal`` into the fluid.

    ``velocity`` [m/s] moves the wall, in its own plane or out of it; ``slip`` leaves the tangential motion free. A
    ``loose`` wall is unilateral: it pushes, and the fluid parts from it where it would have to pull. ``friction``
    resists the tangential motion, between no slip and slip.
    ``mirror`` makes it a plane of symmetry: a slip wall to the fluid, while measures and pictures show what lies behind
    it, too.
    """

    point: tuple[float, ...]
    normal: tuple[float, ...]
    velocity: tuple[float, ...] | None = None
    slip: bool = False
    loose: bool = False
    mirror: bool = False
    friction: Friction | None = None
    name: str = ""
    thin = False

    def __post_init__(self):
        check_surface(self)
        check_vectors(self, "a plane", {"point": "m", "normal": "", "velocity": "m/s"})
        kind = "mirror plane" if self.mirror else "plane"
        unit = abs(np.linalg.norm(self.normal) - 1.0) <= 1e-6
        require(unit, f"normal = {self.normal} of a {kind}: must have the length 1")
        if self.mirror:
            rubs = f"friction = {self.friction} of a mirror plane: nothing rubs there; must be left out"
            require(self.friction is None, rubs)
            moves = f"velocity = {self.velocity} m/s: a mirror plane cannot move; must be left out"
            require(self.velocity is None, moves)
            object.__setattr__(self, "slip", True)

    @property
    def travel(self):
        """Velocity [m/s] at which the place of the wall changes; zero for a wall that moves in its own plane."""
        velocity = np.zeros(len(self.point)) if self.velocity is None else np.array(self.velocity, float)
        return velocity if abs(velocity @ np.array(self.normal)) > 1e-9 * np.linalg.norm(velocity) else 0.0 * velocity

    def distance(self, x, time=0.0):
        """Signed distance [m] of points (n, d) at a time [s], positive in the fluid."""
        return (x - np.array(self.point) - time * self.travel) @ np.array(self.normal)

    @property
    def speed(self):
        """Largest speed [m/s] of the wall."""
        return float(np.linalg.norm(self.velocity or 0.0))


@dataclass(frozen=True)
class Cylinder:
    """Wall: a circle (2-D, no axis), or a cylinder around the line through ``point`` along ``axis``, with the fluid
    inside or outside. It turns about its axis with ``angular_velocity`` [rad/s], counter-clockwise seen against the
    axis, and moves along it with ``velocity`` [m/s], its ends too; ``slip`` leaves the tangential motion free,
    ``friction`` resists it.

    With a ``length`` [m] the wall ends at ``point`` and this far along the axis; its radius grows by ``slope`` per
    metre between them: the mantle of a truncated cone, a funnel. It may be a ``thin`` sheet that has fluid on both
    sides, a mould that is lifted; they do not feel each other through it. A ``loose`` wall is unilateral.
    """

    point: tuple[float, ...]
    radius: float  # at ``point`` [m]
    axis: tuple[float, ...] | None = None
    inside: bool = True
    angular_velocity: float = 0.0
    velocity: float = 0.0
    slip: bool = False
    slope: float = 0.0  # [-]
    length: float | None = None  # endless if None
    loose: bool = False
    thin: bool = False
    friction: Friction | None = None
    name: str = ""

    def __post_init__(self):
        check_surface(self)
        check_vectors(self, "a cylinder", {"point": "m"})
        units = {"radius": "m", "angular_velocity": "rad/s", "velocity": "m/s", "slope": "", "length": "m"}
        check_numbers(self, units)
        d = len(self.point)
        given = array_of([] if self.axis is None else self.axis)
        is_direction = given.shape == (3,) and np.all(np.isfinite(given)) and given.any()
        wrong = f"axis = {self.axis}: must be a direction of 3 numbers in 3-D and None in 2-D"
        require(is_direction if d == 3 else given.shape == (0,), wrong)
        require(
            d == 3 or not (self.velocity or self.slope or self.length),
            f"velocity = {self.velocity:g} m/s, slope = {self.slope:g}, length = {self.length} m: a circle has no "
            "axis; must be left out in 2-D",
        )
        endless = self.length is None
        tip = f"slope = {self.slope:g}: needs a length; a cone that goes on has no radius at its tip"
        require(not (self.slope and endless), tip)
        require(not (self.thin and endless), "thin = True: needs a length; what is thin must end somewhere")
        for key, value in {"length": 1.0 if endless else self.length, "radius": self.smallest_radius}.items():
            require(value > 0.0, f"{key} = {value:g} m: must be greater than 0 m")

    @property
    def smallest_radius(self):
        """At the narrower end [m]."""
        return self.radius + min(0.0, self.slope * (self.length or 0.0))

    @property
    def unit_axis(self):
        """Unit vector along the axis; zero, a vector of the plane, in 2-D."""
        axis = np.zeros(len(self.point)) if self.axis is None else np.array(self.axis, float)
        return axis / (np.linalg.norm(axis) or 1.0)

    @property
    def speed(self):
        """Largest speed [m/s] of the wall."""
        largest = self.radius + max(0.0, self.slope * (self.length or 0.0))
        return float(np.hypot(self.angular_velocity * largest, self.velocity))

    @property
    def travel(self):
        """Velocity [m/s] at which the place of the wall changes; zero for one without ends."""
        return self.velocity * self.unit_axis if self.length is not None else 0.0 * self.unit_axis

    @property
    def circles(self):
        """Polylines (k, d) [m] to draw: the circle at ``point``, and that at the other end."""
        angle = np.linspace(0.0, 2.0 * np.pi, 73)
        across = np.eye(2) if len(self.point) == 2 else np.linalg.svd(self.unit_axis[None])[2][1:]
        unit = np.stack([np.cos(angle), np.sin(angle)], -1) @ across
        ends = [0.0] if self.length is None else [0.0, self.length]
        return [np.array(self.point) + s * self.unit_axis + (self.radius + self.slope * s) * unit for s in ends]

    def distance(self, x, time=0.0):
        """Signed distance [m] of points (n, d) from the wall at a time [s], positive in the fluid (from a thin wall on
        both sides); infinite beyond its ends."""
        offset = x - np.array(self.point) - time * self.travel
        s = offset @ self.unit_axis
        r = np.linalg.norm(offset - np.outer(s, self.unit_axis), axis=1)
        cosine = 1.0 / np.hypot(1.0, self.slope)
        z = (1.0 if self.inside else -1.0) * cosine * (self.radius + self.slope * s - r)
        if self.length is None:
            return z
        foot = s - z * (1.0 if self.inside else -1.0) * cosine * self.slope
        return np.where((foot >= 0.0) & (foot <= self.length), np.abs(z) if self.thin else z, np.inf)


def box_planes(low, high, slip=False, friction=None):
    """The walls of a box that is open at the top (last axis), its corners (d,) [m]."""
    corners = Box(low, high)
    low, high = (tuple(map(float, corner)) for corner in (corners.low, corners.high))
    d = len(low)
    unit = np.eye(d)
    surface = {"slip": slip, "friction": friction}
    floor = Plane(low, tuple(unit[-1]), **surface)
    sides = [Plane(low, tuple(unit[a]), **surface) for a in range(d - 1)]
    sides += [Plane(high, tuple(-unit[a]), **surface) for a in range(d - 1)]
    return (floor, *sides)


def behind(walls, x, thick):
    """Those of the positions x, (n, d) [m], that lie behind a wall, but none deeper than ``thick`` [m]: places of wall
    particles, (m, d) [m]."""
    depth = np.max([-wall.distance(x) for wall in walls], axis=0)
    return x[(depth > 0.0) & (depth < thick)]
