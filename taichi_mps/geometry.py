"""Solids filled with a lattice of particles, and walls. Plain NumPy."""

from dataclasses import dataclass

import numpy as np

from .material import Friction
from .quantity import SceneError, array_of, check_kinds, check_numbers, check_vectors, finite, positive

MOST_POINTS = 1e8  # of one lattice: about 2.4 GB of coordinates


@dataclass(frozen=True)
class Box:
    """Axis-parallel box (rectangle in 2-D) between two corners [m]."""

    low: tuple[float, ...]
    high: tuple[float, ...]

    def __post_init__(self):
        check_vectors(self, "a box", {"low": "m", "high": "m"})
        if not np.all(np.less(self.low, self.high)):
            raise SceneError(f"high = {self.high} m of a box: must be above low = {self.low} m along each axis")

    def contains(self, x):
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
            if getattr(self, key) < 0.0:
                raise SceneError(f"{key} = {getattr(self, key):g} m: must be at least 0 m")
        if not self.volume > 0.0:
            raise SceneError(f"height = {self.height:g} m: must be greater than 0 m, and one radius of a cone, too")

    def contains(self, x):
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


def check_friction(wall):
    """SceneError unless a wall has either friction or slip, and what is no number has its type."""
    check_kinds(wall, {"friction": (Friction, "Friction(...)")})
    flags = [key for key in ("slip", "loose", "mirror", "inside") if hasattr(wall, key)]
    check_kinds(wall, {key: (bool | np.bool_, "True or False") for key in flags})
    if wall.friction is not None and wall.slip:
        raise SceneError(f"slip = True with friction = {wall.friction}: a wall has one of them; must be left out")


@dataclass(frozen=True)
class Plane:
    """Wall: the half-space behind the plane through ``point`` with unit ``normal`` into the fluid.

    ``velocity`` [m/s] moves the wall, in its own plane or out of it; ``slip`` leaves the tangential motion free. A
    ``loose`` wall only pushes: the fluid parts from it where it would have to pull. ``friction`` resists it in between.
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
    thin = False

    def __post_init__(self):
        check_friction(self)
        check_vectors(self, "a plane", {"point": "m", "normal": "", "velocity": "m/s"})
        if not abs(np.linalg.norm(self.normal) - 1.0) <= 1e-6:
            kind = "mirror plane" if self.mirror else "plane"
            raise SceneError(f"normal = {self.normal} of a {kind}: must have the length 1")
        if not self.mirror:
            return
        if self.friction is not None:
            raise SceneError(f"friction = {self.friction} of a mirror plane: nothing rubs there; must be left out")
        if self.velocity is not None:
            raise SceneError(f"velocity = {self.velocity} m/s: a mirror plane cannot move; must be left out")
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
    sides, a mould that is lifted; they do not feel each other through it. A ``loose`` wall only pushes.
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

    def __post_init__(self):
        check_friction(self)
        check_vectors(self, "a cylinder", {"point": "m"})
        units = {"radius": "m", "angular_velocity": "rad/s", "velocity": "m/s", "slope": "", "length": "m"}
        check_numbers(self, units)
        d = len(self.point)
        given = array_of([] if self.axis is None else self.axis)
        if given.shape != ((3,) if d == 3 else (0,)) or not np.all(np.isfinite(given)) or (d == 3 and not given.any()):
            raise SceneError(f"axis = {self.axis}: must be a direction of 3 numbers in 3-D and None in 2-D")
        if d == 2 and (self.velocity or self.slope or self.length):
            raise SceneError(
                f"velocity = {self.velocity:g} m/s, slope = {self.slope:g}, length = {self.length} m: a circle has no "
                "axis; must be left out in 2-D"
            )
        if self.slope and self.length is None:
            raise SceneError(f"slope = {self.slope:g}: needs a length; a cone that goes on has no radius at its tip")
        if self.thin and self.length is None:
            raise SceneError("thin = True: needs a length; what is thin must end somewhere")
        if self.length is not None and not self.length > 0.0:
            raise SceneError(f"length = {self.length:g} m: must be greater than 0 m")
        if not self.smallest_radius > 0.0:
            raise SceneError(f"radius = {self.smallest_radius:g} m: must be greater than 0 m")

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


def lattice(low, high, spacing, offset=0.5):
    """Points of a cubic lattice [m] in a box between two corners (d,) [m], (n, d); ``offset`` of the first point in
    spacings [m], per axis or one."""
    positive("spacing", spacing)
    low = finite("low", low, "m", dimensions=1)
    high = finite("high", high, "m", shape=low.shape)
    offsets = np.broadcast_to(offset, low.shape)
    with np.errstate(over="ignore"):  # of a spacing next to nothing
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


def rings(inner_radius, outer_radius, spacing):
    """Points (n, 2) [m] on circles about the origin, a spacing apart: a disc (inner radius 0) or what is between two
    circles, without the steps that a square lattice has there."""
    positive("spacing", spacing)
    count = round((outer_radius - inner_radius) / spacing)
    if count < 1 or inner_radius < 0.0:
        raise SceneError(
            f"rings from {inner_radius:g} to {outer_radius:g} m: the inner radius must be at least 0 m and the outer "
            f"one greater by a spacing of {spacing:g} m"
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


def fill_rings(solid, spacing):
    """Positions (n, 2) [m] (r, z) of the rings of a solid around the z axis, one per spacing^2, half a spacing from the
    axis and the base: those whose middle lies in the solid."""
    positive("spacing", spacing)
    low, high = solid.bounds
    x = lattice((0.0, low[2]), (high[0] + spacing, high[2]), spacing)
    x = x[solid.contains(np.insert(x, 1, 0.0, axis=1))]
    if len(x) == 0:
        raise SceneError(f"spacing = {spacing:g} m: no ring fits into the body; use a smaller spacing")
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
    if np.any(size < 0.999 * spacing):
        raise SceneError(
            f"spacing = {spacing:g} m: larger than the body, whose smallest side is {size.min():.4g} m; "
            f"must be at most {size.min():.4g} m"
        )
    candidates = []
    for mirror in mirrors:
        if np.count_nonzero(np.abs(mirror.normal) > 1e-9) != 1:
            raise SceneError(f"mirrors: normal = {mirror.normal}: must be along an axis")
    for centred in (False,) if mirrors else (False, True):
        lo = low.copy()
        for axis in range(len(low) - 1):
            half = spacing * (np.ceil(0.5 * size[axis] / spacing) + (0.5 if centred else 0.0))
            lo[axis] = 0.5 * (low[axis] + high[axis]) - half
        if isinstance(solid, Box):
            lo = low.copy()
        for mirror in mirrors:
            axis = int(np.argmax(np.abs(mirror.normal)))
            lo[axis] = mirror.point[axis] - spacing * np.ceil((mirror.point[axis] - low[axis]) / spacing - 1e-9)
        x = lattice(lo, high, spacing)
        candidates.append(x[solid.contains(x)])
    best = min(candidates, key=lambda x: abs(len(x) * spacing ** len(low) - solid.volume))
    for mirror in mirrors:
        best = best[mirror.distance(best) > 0.0]
    if len(best) == 0:
        raise SceneError(f"spacing = {spacing:g} m: no particle fits into the body; use a smaller spacing")
    return best
