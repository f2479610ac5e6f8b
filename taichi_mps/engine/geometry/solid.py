"""Walls of any shape: a signed distance sampled on a grid, from a function or from a triangle mesh. Plain NumPy."""

import logging
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from time import monotonic
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, InstanceOf

from ...units import (
    File,
    Flag,
    Instant,
    SceneError,
    Size,
    Text,
    array,
    numbers_from,
    points,
    quote,
    real,
    require,
    validated,
    vector,
)
from .concave_edges import NODES_PER_SLAB, interpolate
from .meshes import MAX_LENGTH_IN_REACHES, check_bodies, extend_upwards, mesh_distance, read_mesh, unite_bodies
from .time_dependent import Moving, table_of_time
from .walls import Friction, check_surface, require_same_dimension, spin


def polygon_corners(corners):
    """Return corners (k, 2) [m] unchanged; ValueError unless they make a polygon."""
    if len(corners) < 3 or np.any(np.all(corners == np.roll(corners, 1, axis=0), axis=1)):
        raise ValueError("must be three corners or more, none of them twice")
    return corners


def evaluate_distance(function, x):
    """Evaluate a user's distance function [m] at points (n, d); SceneError where it gives no finite numbers."""
    found = numbers_from("distance", function, x)
    require(
        found.size == len(x) and np.all(np.isfinite(found)),
        f"distance = {quote(function, '')}: must give a finite number [m] for each point, (n,)",
    )
    return found


NodeValues = array("m", (None, None), (None, None, None))
Interval, PlanePoints = array("m", (2,)), array("m", (None, 2))
PolygonCorners = Annotated[PlanePoints, AfterValidator(polygon_corners)]
Scale = real("", gt=0.0, le=1e6)
MAX_NODES = 5e7  # of one grid: 400 MB of distances
NODES_PER_CALL = 2e4  # of a user's distance function; some seconds for a mesh of 96,000 triangles
PROGRESS_INTERVAL = 5.0  # time between two lines of progress in the log [s]


@validated
@dataclass(frozen=True)
class Solid(Moving):
    """Wall of any shape, given by its signed distance on a grid.

    Parameters
    ----------
    values : ndarray, shape (nx, ..., nz)
        Signed distance at the nodes [m], positive in the fluid; linear in between. Beyond the grid there is no wall.
    low : tuple of float, length d
        First node [m].
    cell : float
        Distance between nodes [m].
    velocity : tuple of float, length d, optional
        Translation [m/s]; rows of a time [s] and a velocity if it changes.
    slip : bool, optional
        Leave the tangential motion of the fluid free.
    loose : bool, optional
        Unilateral contact: the wall pushes and does not pull.
    friction : Friction, optional
        Resistance to the tangential motion, between no slip and slip.
    name : str, optional
        Name in the measured wall loads.
    angular_velocity : float, optional
        Rotation about the axis through ``pivot`` [rad/s], in two dimensions counter-clockwise.
    pivot : tuple of float, length d, optional
        Point of the axis at 0 s [m].
    axis : tuple of float, length 3, optional
        Direction of the axis [-]; None in two dimensions.

    Raises
    ------
    SceneError
        If the values are no distance (slope above 1.5), none is negative, or a rotation has no pivot.

    See Also
    --------
    Solid.of : sample a function.
    Solid.from_mesh : read a closed triangle mesh.

    Notes
    -----
    Fluid on two sides of the wall does not feel the other through it.

    Examples
    --------
    >>> import numpy as np, taichi_mps as mps
    >>> ball = mps.Solid.of(lambda x: np.linalg.norm(x, axis=1) - 0.1, (-0.2, -0.2), (0.2, 0.2), cell=0.01)
    >>> ball.distance(np.array([[0.15, 0.0]])).round(4).tolist()
    [0.05]
    """

    values: NodeValues
    low: vector("m")
    cell: Size
    velocity: vector("m/s") | table_of_time("m/s") | None = None
    slip: Flag = False
    loose: Flag = False
    friction: InstanceOf[Friction] | None = None
    name: Text = ""
    angular_velocity: real("rad/s", ge=-1e6, le=1e6) = 0.0
    pivot: vector("m") | None = None
    axis: vector("") | None = None
    thin = False

    def __post_init__(self):
        check_surface(self, "low")
        turns = self.pivot is not None and bool(np.any(self.unit_axis)) == (len(self.low) == 3)
        require(
            turns or not self.angular_velocity,
            f"angular_velocity = {self.angular_velocity:g} rad/s of a solid: needs a pivot, and an axis in 3-D only",
        )
        values = self.values
        require(
            values.ndim == len(self.low) and min(values.shape) >= 2,
            f"values of shape {values.shape}: must be a grid of two nodes or more along {self.low}",
        )
        require(
            np.any(values < 0.0),
            f"cell = {self.cell:g} m: no node of the grid lies inside the solid; must be at most half of its "
            "thickness, and the distance negative inside",
        )
        changes = (np.diff(values, axis=axis) for axis in range(values.ndim))
        steepest = max(float(np.abs(change, out=change).max()) for change in changes) / self.cell
        require(
            steepest <= 1.5,
            f"values: the distance changes by {steepest:.3g} m per metre; a distance changes by at most 1",
        )

    @classmethod
    @validated
    def of(cls, distance: Callable, low: vector("m"), high: vector("m"), cell: Size, **keywords: Any) -> "Solid":
        """Sample a signed distance function on a grid.

        Parameters
        ----------
        distance : callable
            Function of points, shape (n, d) [m], that gives signed distances, shape (n,) [m], positive in the fluid.
        low, high : array_like, shape (d,)
            Corners of the grid [m]; it reaches an effective radius beyond the solid where fluid may come.
        cell : float
            Distance between nodes [m], half of the particle size or less.
        **keywords
            Other parameters of ``Solid``, such as ``velocity`` or ``friction``.

        Returns
        -------
        Solid
            Wall.

        Raises
        ------
        SceneError
            If the grid has too many nodes or no node lies inside the solid.
        """
        require(len(low) == len(high), f"high = {high} m: must have as many coordinates as low = {low} m")
        low, high = np.array(low, float), np.array(high, float)
        require(
            np.all(high - low >= cell),
            f"cell = {cell:g} m: must be greater than 0 m and fit between {low} and {high} m",
        )
        with np.errstate(over="ignore"):  # a tiny cell overflows
            shape = np.ceil((high - low) / cell - 1e-9) + 1.0
            needed = float(np.prod(shape))
        require(needed <= MAX_NODES, f"cell = {cell:g} m: needs {needed:.2g} nodes; at most {MAX_NODES:.2g}")
        shape = shape.astype(int)
        ticks = [lo + cell * np.arange(n) for lo, n in zip(low, shape, strict=True)]
        slab, values, logged = max(1, int(NODES_PER_CALL / np.prod(shape[1:]))), [], monotonic()
        for first in range(0, shape[0], slab):  # slab by slab, to save memory and to log the progress
            if monotonic() - logged > PROGRESS_INTERVAL:
                logged, part = monotonic(), first / shape[0]
                logging.getLogger(__name__).info(f"{part:.0%} of the distances of a solid at {needed:.2g} nodes")
            nodes = np.stack(np.meshgrid(ticks[0][first : first + slab], *ticks[1:], indexing="ij"))
            values.append(evaluate_distance(distance, nodes.reshape(len(low), -1).T).reshape(nodes.shape[1:]))
        return cls(np.concatenate(values), tuple(low), cell, **keywords)

    @classmethod
    @validated
    def prism(
        cls, corners: PolygonCorners, cell: Size, reach: Size, along: Interval | None = None, **keywords: Any
    ) -> "Solid":
        """Make a solid whose section in the (x, z) plane is a convex polygon: a plate, a gate.

        Parameters
        ----------
        corners : array_like, shape (k, 2)
            Corners (x, z) [m], counter-clockwise.
        cell : float
            Distance between nodes [m].
        reach : float
            How far the grid goes beyond the polygon [m].
        along : tuple of float, length 2, optional
            In three dimensions the lowest and highest y of the grid [m]; the prism has no ends there.
        **keywords
            Other parameters of ``Solid``.

        Returns
        -------
        Solid
            Wall, in two dimensions without ``along``.
        """
        low, high = np.min(corners, axis=0) - reach, np.max(corners, axis=0) + reach
        if along is None:
            return cls.of(lambda x: polygon_distance(x, corners), low, high, cell, **keywords)
        low, high = np.insert(low, 1, along[0]), np.insert(high, 1, along[1])
        return cls.of(lambda x: polygon_distance(x[:, [0, 2]], corners), low, high, cell, **keywords)

    @classmethod
    @validated
    def bars(
        cls, places: PlanePoints, radius: Size, upright: Interval, cell: Size, reach: Size, **keywords: Any
    ) -> "Solid":
        """Make a solid of upright round bars.

        Parameters
        ----------
        places : array_like, shape (k, 2)
            Axes (x, y) of the bars [m].
        radius : float
            Radius of a bar [m].
        upright : tuple of float, length 2
            Lowest and highest z of the grid [m].
        cell : float
            Distance between nodes [m].
        reach : float
            How far the grid goes beyond the bars to the sides [m].
        **keywords
            Other parameters of ``Solid``.

        Returns
        -------
        Solid
            Wall.
        """
        require(len(places), "places: must be one bar or more")
        low = [*(places.min(0) - radius - reach), upright[0]]
        return cls.of(
            lambda x: np.min([np.hypot(*(x[:, :2] - place).T) for place in places], axis=0) - radius,
            low,
            [*(places.max(0) + radius + reach), upright[1]],
            cell,
            **keywords,
        )

    @classmethod
    @validated
    def from_mesh(
        cls,
        path: File,
        cell: Size,
        reach: Size,
        inside: Flag = False,
        scale: Scale = 1.0,
        body: Text = "",
        open_top: real("m", ge=0.0, le=100.0) = 0.0,
        **keywords: Any,
    ) -> "Solid":
        """Make a solid from a closed triangle mesh (extra ``cad``), or from a STEP file (extra ``step``).

        Parameters
        ----------
        path : path-like
            STL, OBJ, PLY or STEP file; faces of the latter are cut into triangles to a tenth of a cell.
        cell : float
            Distance between nodes [m].
        reach : float
            How far the grid goes beyond the mesh [m], at least an effective radius.
        inside : bool, optional
            Whether the fluid is inside.
        scale : float, optional
            Metres for one unit of the file, 0.001 for a file in millimetres; a STEP file has its own unit.
        body : str, optional
            Name of the only body of a STEP file to be read; all by default.
        open_top : float, optional
            How far the section at the highest face goes on above it [m], with the fluid inside: a form that is open
            there.
        **keywords
            Other parameters of ``Solid``.

        Returns
        -------
        Solid
            Wall.

        Raises
        ------
        SceneError
            If the file is missing, damaged, not closed, or longer than 100 m, or a body holds no node.

        Notes
        -----
        Inside is where the surface goes round a node: where the winding number is 1 or more, or -1 of a body inside
        out. Bodies may touch and overlap. Outside of them the distance is that of their union; inside, the depth may be
        that below a face between two of them. With the fluid inside, the bodies are united by manifold3d.
        """
        points, triangles = read_mesh(
            path, scale, min(100.0, MAX_LENGTH_IN_REACHES * reach), body, tolerance=0.1 * cell
        )
        if open_top > 0.0:
            points, triangles = extend_upwards(points, triangles, open_top, 0.5 * cell)
        if inside:
            points, triangles = unite_bodies(points, triangles)
        side = -1.0 if inside else 1.0
        low, high = points.min(0) - reach, points.max(0) + reach
        try:
            check_bodies(points, triangles, low, cell)
            return cls.of(lambda x: side * mesh_distance(x, points, triangles), low, high, cell, **keywords)
        except SceneError as error:
            size = " x ".join(f"{s:.4g}" for s in np.ptp(points, axis=0))
            raise SceneError(f"mesh {path}, {size} m with scale = {scale:g}: {error}") from None

    @validated
    def section(self, y: real("m", ge=-1e9, le=1e9) = 0.0, time: Instant = 0.0) -> list[np.ndarray]:
        """Return where the distance is zero, as short line segments.

        Parameters
        ----------
        y : float, optional
            Position of the section of a solid in three dimensions [m].
        time : float, optional
            Time at which the wall is looked at [s].

        Returns
        -------
        list of ndarray, shape (2, d)
            End points of the segments [m].
        """
        x, z = (np.arange(lo, hi + self.cell, self.cell) for lo, hi in np.transpose(self.reach(time))[[0, -1]])
        nodes = np.stack(np.meshgrid(x, z, indexing="ij"), -1).reshape(-1, 2)
        placed = nodes if len(self.low) == 2 else np.insert(nodes, 1, y, axis=1)
        values = self.distance(placed, time).reshape(len(x), len(z))
        corners, lines = ((0, 0), (1, 0), (1, 1), (0, 1)), []
        sides = np.stack([values[a : a + len(x) - 1, b : b + len(z) - 1] < 0.0 for a, b in corners])
        ends = np.stack([values[a : a + len(x) - 1, b : b + len(z) - 1] == np.inf for a, b in corners]).any(0)
        for cell in np.argwhere(sides.any(0) & ~sides.all(0) & ~ends):
            found = []
            for p, q in zip(cell + corners, cell + np.roll(corners, -1, axis=0), strict=True):
                u, v = values[tuple(p)], values[tuple(q)]
                if (u < 0.0) != (v < 0.0):
                    found.append((x[0], z[0]) + self.cell * (p + (q - p) * u / (u - v)))
            lines += [np.array(pair) for pair in zip(found[::2], found[1::2], strict=True)]
        return lines if len(self.low) == 2 else [np.insert(line, 1, y, axis=1) for line in lines]

    @cached_property
    def thickness(self) -> float:
        """Estimated thickness of the thickest part [m].

        The largest sum of the depths of two neighbouring nodes and their distance, where the depth falls beyond both;
        at least twice the depth of the deepest node.
        """
        depth, inside, found = -self.values, np.argwhere(self.values < 0.0), [-2.0 * float(self.values.min())]
        for way in product((0, 1), (-1, 0, 1), (-1, 0, 1)):
            way = np.array(way[-depth.ndim :])
            line = [inside + k * way for k in (-1, 0, 1, 2)]
            there = np.all([(x >= 0) & (x < depth.shape) for x in line], axis=(0, 2))
            before, here, beside, beyond = (depth[tuple(x[there].T)] for x in line)
            apart = self.cell * np.linalg.norm(way)
            across = (here - before > 0.95 * apart) & (beside - beyond > 0.95 * apart)
            found.append((here + beside)[across].max(initial=-apart) + apart)
        return max(found)

    @cached_property
    def steepest(self) -> float:
        """Largest slope of the distance between nodes [-]."""
        largest, across = 0.0, max(1, int(NODES_PER_SLAB / np.prod(self.values.shape[1:])))
        for first in range(0, len(self.values), across):  # slabs and their neighbours, for the sake of memory
            low, square = max(0, first - 1), 0.0
            slab = self.values[low : first + across + 1]
            for axis in range(slab.ndim):
                slope = np.abs(np.diff(np.moveaxis(slab, axis, 0), axis=0)) / self.cell
                ends = np.zeros_like(slope[:1])
                both = np.maximum(np.concatenate([slope, ends]), np.concatenate([ends, slope]))
                square = square + np.moveaxis(both, 0, axis) ** 2
            largest = max(largest, square[first - low :][:across].max())
        return float(np.sqrt(largest))

    @property
    def point(self) -> tuple[float, ...]:
        """First node of the grid [m]."""
        return self.low

    @property
    def high(self) -> tuple[float, ...]:
        """Last node of the grid [m]."""
        return tuple(np.array(self.low) + self.cell * (np.array(self.values.shape) - 1))

    @property
    def travel(self) -> np.ndarray:
        """Velocity of translation [m/s], shape (d,)."""
        return self.fastest

    @property
    def centre(self) -> np.ndarray:
        """Pivot, or the first node where there is none [m], shape (d,)."""
        return np.array(self.low if self.pivot is None else self.pivot, float)

    @property
    def spin(self) -> np.ndarray:
        """Gradient of the velocity of rotation [1/s], shape (d, d)."""
        return spin(self.angular_velocity, self.unit_axis, len(self.low))

    def turned(self, time: float) -> np.ndarray:
        """Return the rotation from 0 s to a time.

        Parameters
        ----------
        time : float
            Time [s].

        Returns
        -------
        ndarray, shape (d, d)
            Rotation matrix [-].
        """
        if not self.angular_velocity:
            return np.eye(len(self.low))
        angle, K = self.angular_velocity * time, self.spin / self.angular_velocity
        return np.eye(len(K)) + np.sin(angle) * K + (1.0 - np.cos(angle)) * K @ K

    def placed(self, x: np.ndarray, time: float) -> np.ndarray:
        """Move points of the solid with it.

        Parameters
        ----------
        x : ndarray, shape (n, d)
            Positions at 0 s [m].
        time : float
            Time [s].

        Returns
        -------
        ndarray, shape (n, d)
            Positions at that time [m].
        """
        return (x - self.centre) @ self.turned(time).T + self.centre + self.displacement(time)

    def reach(self, time: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the box that encloses the grid at a time.

        Parameters
        ----------
        time : float
            Time [s].

        Returns
        -------
        low, high : ndarray, shape (d,)
            Corners [m].
        """
        corners = self.placed(self.corners, time)
        return corners.min(0), corners.max(0)

    @property
    def corners(self) -> np.ndarray:
        """Corners of the grid [m], shape (2^d, d)."""
        return np.stack(np.meshgrid(*np.stack([self.low, self.high], 1), indexing="ij"), -1).reshape(-1, len(self.low))

    @cached_property
    def speed(self) -> float:
        """Largest speed of the wall [m/s]."""
        return float(np.linalg.norm(self.travel + (self.corners - self.centre) @ self.spin.T, axis=1).max())

    @validated
    def distance(self, x: points("m"), time: Instant = 0.0) -> np.ndarray:
        """Return the signed distance of points from the wall.

        Parameters
        ----------
        x : ndarray, shape (n, d)
            Points [m].
        time : float, optional
            Time at which the wall is looked at [s].

        Returns
        -------
        ndarray, shape (n,)
            Distance [m], positive in the fluid; infinite beyond the grid.
        """
        require_same_dimension(x, self.low)
        arm = (x - self.centre - self.displacement(time)) @ self.turned(time)
        return interpolate(self.values, (arm + self.centre - np.array(self.low)) / self.cell)


@validated
def polygon_distance(x: PlanePoints, corners: PolygonCorners) -> np.ndarray:
    """Return the signed distance of points from a convex polygon.

    Parameters
    ----------
    x : ndarray, shape (n, 2)
        Points [m].
    corners : array_like, shape (k, 2)
        Corners [m], counter-clockwise.

    Returns
    -------
    ndarray, shape (n,)
        Distance [m], positive outside.

    Raises
    ------
    SceneError
        If the polygon is not convex, or its corners are clockwise.

    Examples
    --------
    >>> import numpy as np, taichi_mps as mps
    >>> square = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
    >>> mps.polygon_distance(np.array([[0.5, 0.75], [2.0, 0.5]]), square).tolist()
    [-0.25, 1.0]
    """
    sides = np.roll(corners, -1, axis=0) - corners
    after = np.roll(sides, -1, axis=0)
    turns = sides[:, 0] * after[:, 1] - sides[:, 1] * after[:, 0]  # to the left, of an angle below 180 degrees
    require(
        turns.max() > 0.0 and turns.min() > -1e-9 * (sides**2).max(),
        f"corners = {corners.tolist()}: must be those of a convex polygon, counter-clockwise",
    )
    nearest, inside = np.full(len(x), np.inf), np.full(len(x), True)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        along, offset = b - a, x - a
        t = np.clip(offset @ along / (along @ along), 0.0, 1.0)
        nearest = np.minimum(nearest, np.linalg.norm(offset - np.outer(t, along), axis=1))
        inside &= along[0] * offset[:, 1] - along[1] * offset[:, 0] > 0.0
    return np.where(inside, -nearest, nearest)
