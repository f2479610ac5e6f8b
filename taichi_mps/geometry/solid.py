"""Walls of any shape: a signed distance sampled on a grid, from a function or from a triangle mesh. Plain NumPy."""

import re
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, product
from pathlib import Path

import numpy as np

from ..units import SceneError, array_of, check_numbers, check_vectors, finite, positive, require, user_path
from .concave_edges import interpolate
from .walls import Friction, check_surface, spin

MOST_NODES = 5e7  # of one grid: 400 MB of distances
AT_ONCE = 2e6  # nodes that a distance is asked for


@dataclass(frozen=True)
class Solid:
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
        Translation [m/s].
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

    values: np.ndarray
    low: tuple[float, ...]
    cell: float
    velocity: tuple[float, ...] | None = None
    slip: bool = False
    loose: bool = False
    friction: Friction | None = None
    name: str = ""
    angular_velocity: float = 0.0
    pivot: tuple[float, ...] | None = None
    axis: tuple[float, ...] | None = None
    thin = False

    def __post_init__(self):
        check_surface(self)
        check_vectors(self, "a solid", {"low": "m", "velocity": "m/s", "pivot": "m", "axis": ""})
        check_numbers(self, {"angular_velocity": "rad/s"})
        turns = self.pivot is not None and bool(np.any(self.unit_axis)) == (len(self.low) == 3)
        turning = f"angular_velocity = {self.angular_velocity:g} rad/s of a solid"
        require(turns or not self.angular_velocity, f"{turning}: needs a pivot, and an axis in 3-D only")
        values = array_of(self.values)
        is_grid = values.ndim == len(self.low) and min(values.shape) >= 2
        require(is_grid, f"values of shape {values.shape}: must be a grid of two nodes or more along {self.low}")
        positive("cell", self.cell)
        finite_ones = np.all(np.isfinite(values))
        require(finite_ones, "values: a distance is not a finite number; all must be finite [m]")
        require(
            np.any(values < 0.0),
            f"cell = {self.cell:g} m: no node of the grid lies inside the solid; must be at most half of its "
            "thickness, and the distance negative inside",
        )
        steepest = max(float(np.abs(np.diff(values, axis=axis)).max()) for axis in range(values.ndim)) / self.cell
        change = f"values: the distance changes by {steepest:.3g} m per metre; a distance changes by at most 1"
        require(steepest <= 1.5, change)
        object.__setattr__(self, "values", values)

    @classmethod
    def of(cls, distance, low, high, cell, **keywords):
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
        positive("cell", cell)
        low = finite("low", low, "m", dimensions=1)
        high = finite("high", high, "m", shape=low.shape)
        fits = f"cell = {cell:g} m: must be greater than 0 m and fit between {low} and {high} m"
        require(np.all(high - low >= cell), fits)
        with np.errstate(over="ignore"):  # of a cell next to nothing
            shape = np.ceil((high - low) / cell - 1e-9) + 1.0
            needed = float(np.prod(shape))
        require(needed <= MOST_NODES, f"cell = {cell:g} m: needs {needed:.2g} nodes; at most {MOST_NODES:.2g}")
        shape = shape.astype(int)
        ticks = [lo + cell * np.arange(n) for lo, n in zip(low, shape, strict=True)]
        across, values = max(1, int(AT_ONCE / np.prod(shape[1:]))), []
        for first in range(0, shape[0], across):  # slabs, for the sake of memory
            nodes = np.stack(np.meshgrid(ticks[0][first : first + across], *ticks[1:], indexing="ij"))
            values.append(np.asarray(distance(nodes.reshape(len(low), -1).T)).reshape(nodes.shape[1:]))
        return cls(np.concatenate(values), tuple(low), cell, **keywords)

    @classmethod
    def prism(cls, corners, cell, reach, along=None, **keywords):
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
    def bars(cls, places, radius, upright, cell, reach, **keywords):
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
        places = np.asarray(places, float)
        low = [*(places.min(0) - radius - reach), upright[0]]
        high = [*(places.max(0) + radius + reach), upright[1]]

        def distance(x):
            return np.min([np.hypot(*(x[:, :2] - place).T) for place in places], axis=0) - radius

        return cls.of(distance, low, high, cell, **keywords)

    @classmethod
    def from_mesh(cls, path, cell, reach, inside=False, scale=1.0, **keywords):
        """Make a solid from a closed triangle mesh (extra ``cad``).

        Parameters
        ----------
        path : path-like
            STL, OBJ or PLY file.
        cell : float
            Distance between nodes [m].
        reach : float
            How far the grid goes beyond the mesh [m], at least an effective radius.
        inside : bool, optional
            Whether the fluid is inside.
        scale : float, optional
            Metres for one unit of the file, 0.001 for a file in millimetres.
        **keywords
            Other parameters of ``Solid``.

        Returns
        -------
        Solid
            Wall.

        Raises
        ------
        SceneError
            If the file is missing, damaged, not closed, or longer than 100 m.
        """
        points, triangles = read_mesh(path, scale)
        side = -1.0 if inside else 1.0
        low, high = points.min(0) - reach, points.max(0) + reach
        return cls.of(lambda x: side * mesh_distance(x, points, triangles), low, high, cell, **keywords)

    def section(self, y: float = 0.0, time: float = 0.0) -> list[np.ndarray]:
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
        values = np.minimum(self.distance(placed, time), self.cell).reshape(len(x), len(z))
        corners, lines = ((0, 0), (1, 0), (1, 1), (0, 1)), []
        sides = np.stack([values[a : a + len(x) - 1, b : b + len(z) - 1] < 0.0 for a, b in corners])
        for cell in np.argwhere(sides.any(0) & ~sides.all(0)):
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
        square = 0.0
        for axis in range(self.values.ndim):
            slope = np.abs(np.diff(np.moveaxis(self.values, axis, 0), axis=0)) / self.cell
            ends = np.zeros_like(slope[:1])
            both = np.maximum(np.concatenate([slope, ends]), np.concatenate([ends, slope]))
            square = square + np.moveaxis(both, 0, axis) ** 2
        return float(np.sqrt(square.max()))

    @property
    def point(self):
        """First node [m]."""
        return self.low

    @property
    def high(self) -> tuple[float, ...]:
        """Last node [m]."""
        return tuple(np.array(self.low) + self.cell * (np.array(self.values.shape) - 1))

    @property
    def travel(self):
        """Velocity of translation [m/s], shape (d,)."""
        return np.zeros(len(self.low)) if self.velocity is None else np.array(self.velocity, float)

    @property
    def unit_axis(self):
        """Unit vector along the axis, shape (d,); zero where there is none."""
        axis = np.zeros(len(self.low)) if self.axis is None else np.array(self.axis, float)
        return axis / (np.linalg.norm(axis) or 1.0)

    @property
    def centre(self):
        """Pivot, or the first node where there is none [m], shape (d,)."""
        return np.array(self.low if self.pivot is None else self.pivot, float)

    @property
    def spin(self):
        """Gradient of the velocity of rotation [1/s], shape (d, d)."""
        return spin(self.angular_velocity, self.unit_axis, len(self.low))

    def turned(self, time) -> np.ndarray:
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

    def placed(self, x, time) -> np.ndarray:
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
        return (x - self.centre) @ self.turned(time).T + self.centre + time * self.travel

    def reach(self, time) -> tuple[np.ndarray, np.ndarray]:
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
        ends = zip(self.low, self.high, strict=True)
        return np.stack(np.meshgrid(*ends, indexing="ij"), -1).reshape(-1, len(self.low))

    @property
    def speed(self):
        """Largest speed of the wall [m/s]."""
        corners = self.corners
        return float(np.linalg.norm(self.travel + (corners - self.centre) @ self.spin.T, axis=1).max())

    def distance(self, x, time=0.0):
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
        arm = (x - self.centre - time * self.travel) @ self.turned(time)
        return interpolate(self.values, (arm + self.centre - np.array(self.low)) / self.cell)


def polygon_distance(x, corners):
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

    Examples
    --------
    >>> import numpy as np, taichi_mps as mps
    >>> square = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
    >>> mps.polygon_distance(np.array([[0.5, 0.75], [2.0, 0.5]]), square).tolist()
    [-0.25, 1.0]
    """
    corners = np.asarray(corners, float)
    nearest, inside = np.full(len(x), np.inf), np.full(len(x), True)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        along, offset = b - a, x - a
        t = np.clip(offset @ along / (along @ along), 0.0, 1.0)
        nearest = np.minimum(nearest, np.linalg.norm(offset - np.outer(t, along), axis=1))
        inside &= along[0] * offset[:, 1] - along[1] * offset[:, 0] > 0.0
    return np.where(inside, -nearest, nearest)


def read_mesh(path, scale=1.0):
    """Read a closed triangle mesh.

    Parameters
    ----------
    path : path-like
        STL, OBJ or PLY file.
    scale : float, optional
        Metres for one unit of the file.

    Returns
    -------
    points : ndarray, shape (n, 3)
        Vertices [m].
    triangles : ndarray of int, shape (m, 3)
        Rows of ``points``, counter-clockwise seen from outside.

    Raises
    ------
    SceneError
        If the file cannot be read, or its surface is not closed.
    """
    import meshio

    path = user_path(path)
    require(path.is_file(), f"mesh {path}: no such file")
    if path.suffix.lower() == ".ply":
        check_ply(path)
    try:
        with np.errstate(over="ignore"):  # meshio takes the text of an STL file for a number first
            mesh = meshio.read(path)
        faces = np.vstack(
            [np.zeros((0, 3), np.uint8), *(block.data for block in mesh.cells if block.type == "triangle")]
        )
    except (Exception, SystemExit) as error:  # meshio leaves the program for a file that it cannot read
        raise SceneError(f"mesh {path}: cannot be read as STL, OBJ or PLY ({type(error).__name__})") from None
    require(len(faces), f"mesh {path}: holds no triangles")
    known = faces.dtype.kind in "iu" and 0 <= faces.min() <= faces.max() < len(mesh.points)
    whole = known and np.shape(mesh.points)[1:] == (3,)
    require(whole, f"mesh {path}: damaged; a triangle names a point that is not there")
    points, renumbered = np.unique(np.asarray(mesh.points, float) * scale, axis=0, return_inverse=True)
    triangles = renumbered.reshape(-1)[faces]  # STL repeats each corner
    size = np.ptp(points, axis=0)
    require(
        np.all(np.isfinite(points)) and size.min() > 0.0 and size.max() <= 100.0,
        f"mesh {path}: {' x '.join(f'{s:.4g}' for s in size)} m; must have a volume and be at most 100 m long "
        f"(scale = {scale:g}; 0.001 for a file in mm)",
    )
    edges = np.vstack([triangles[:, [a, b]] for a, b in ((0, 1), (1, 2), (2, 0))])
    there, back = ({tuple(edge) for edge in e.tolist()} for e in (edges, edges[:, ::-1]))
    require(
        len(there) == len(edges) and there == back,
        f"mesh {path}: {len(there ^ back) // 2} of its edges belong to one triangle only, or two triangles face "
        "against each other; must be closed",
    )
    corners = points[triangles]
    if np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) < 0.0:  # six times the volume
        triangles = triangles[:, ::-1]
    return points, triangles


def check_ply(path):
    """Refuse a PLY file whose header has no end or promises more than the file holds.

    Parameters
    ----------
    path : Path
        File.

    Raises
    ------
    SceneError
        If the header is damaged.
    """
    content = path.read_bytes()
    end = re.search(rb"^[ \t]*end_header[ \t\r]*$", content, re.M)
    counts = re.findall(rb"element \w+ (\d+)", content[: end.start()]) if end else [b"0"]
    held = end and all(len(count) <= 18 and int(count) <= len(content) for count in counts)
    require(held, f"mesh {path}: damaged; its header has no end, or promises more than the file holds")


def mesh_distance(x, points, triangles):
    """Return the signed distance of points from a closed surface, by libigl (extra ``cad``).

    Parameters
    ----------
    x : ndarray, shape (n, 3)
        Points [m].
    points : ndarray, shape (k, 3)
        Vertices [m].
    triangles : ndarray of int, shape (m, 3)
        Rows of ``points``.

    Returns
    -------
    ndarray, shape (n,)
        Distance [m], negative inside.

    Raises
    ------
    SceneError
        If libigl is not installed.
    """
    try:
        import igl
    except ImportError:
        raise SceneError('a solid from a mesh needs libigl: pip install "taichi-mps[cad]"') from None
    return igl.signed_distance(x, points, triangles.astype(np.int64), igl.SIGNED_DISTANCE_TYPE_PSEUDONORMAL)[0]


def write_bars(path, ends, radius: float, sides: int = 12) -> Path:
    """Write round bars as a closed triangle mesh.

    Parameters
    ----------
    path : path-like
        STL, OBJ or PLY file, by its suffix.
    ends : array_like, shape (k, 2, 3)
        End points of the bars [m].
    radius : float
        Radius of a bar [m].
    sides : int, optional
        Sides of the prisms, which have the cross-section of the round bar.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    SceneError
        If two bars are nearer to each other than a tenth of the radius: bars that cross lie one behind the other.

    Examples
    --------
    >>> import tempfile, pathlib, taichi_mps as mps
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = mps.write_bars(pathlib.Path(folder) / "bars.stl", [[(0, 0, 0), (0, 0, 0.5)]], radius=0.01)
    ...     file.stat().st_size
    2484
    """
    import meshio

    ends = np.asarray(ends, float)
    for (k, (start, end)), (other, (first, last)) in combinations(enumerate(ends), 2):
        along, beside = end - start, last - first
        x = start + np.linspace(0.0, 1.0, 2 + int(4 * np.linalg.norm(along) / radius))[:, None] * along - first
        t = np.clip(x @ beside / (beside @ beside), 0.0, 1.0)
        gap = float(np.linalg.norm(x - t[:, None] * beside, axis=1).min()) - 2.0 * radius
        least = f"a tenth of it, {0.1 * radius:.3g} m"
        left = f"radius = {radius:g} m: bars {k} and {other} leave a gap of {gap:.3g} m"
        require(gap >= 0.1 * radius, f"{left}; must be at least {least}")
    turn = 2.0 * np.pi * np.arange(sides) / sides
    outer = radius * np.sqrt(2.0 * np.pi / (sides * np.sin(2.0 * np.pi / sides)))
    k, n = np.arange(sides), (np.arange(sides) + 1) % sides
    middle = np.full(sides, 2 * sides)
    faces = ((k, n, sides + n), (k, sides + n, sides + k), (middle, n, k), (middle + 1, sides + k, sides + n))
    triangles, points = np.concatenate([np.stack(face, 1) for face in faces]), []
    for start, end in ends:
        along = (end - start) / np.linalg.norm(end - start)
        first = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
        first /= np.linalg.norm(first)
        rim = outer * (np.outer(np.cos(turn), first) + np.outer(np.sin(turn), np.cross(along, first)))
        points.append(np.vstack([start + rim, end + rim, start, end]))
    every = (2 * sides + 2) * np.arange(len(ends))[:, None, None] + triangles
    path = user_path(path)
    options = {"binary": True} if path.suffix.lower() == ".stl" else {}
    meshio.write(path, meshio.Mesh(np.vstack(points), [("triangle", np.int32(every).reshape(-1, 3))]), **options)
    return path
