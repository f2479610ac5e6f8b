"""Triangle meshes: repaired, bodies united by manifold3d, distances by libigl (extra ``cad``)."""

import warnings
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from ..units import Count, File, SceneError, Size, array, require, validated, writing
from .mesh_files import FORMATS, corners_and_faces

Sides = Annotated[Count, Field(ge=3, le=1000)]

ROUNDING = 1e-5  # distance of corners that are one, over the size: text has six figures, 32 bits seven
STEPS = 2.0  # that distance over the last place of the coordinates as written, which is coarser far from the origin
MAX_STEPS = 1e-3  # that distance over the size beyond which corners are not merged: parts of the body would vanish
MAX_LENGTH_IN_REACHES = 500.0  # a mesh longer than this times the grid's ``reach`` is in millimetres; a scene has 100
MAX_FOLD = 1e-3  # depth over length to which a surface may cross itself, as small fillets do


def read_mesh(path, scale=1.0, max_length=100.0, body="", tolerance=1e-3):
    """Read closed bodies as a triangle mesh and repair it, with a warning that lists the repairs.

    Corners within rounding of each other become one where the surface is not closed without that; triangles without
    area, written twice or back to back are dropped; bodies that touch or overlap are united; a body that stands alone
    inside out is turned.

    Parameters
    ----------
    path : path-like
        STL, OBJ, PLY or STEP file.
    scale : float, optional
        Metres for one unit of the file; a STEP file has its own unit.
    max_length : float, optional
        Largest length of the mesh along an axis [m].
    body : str, optional
        Name of the only body of a STEP file to be read; all by default.
    tolerance : float, optional
        How far the triangles may be from the faces of a STEP file [m].

    Returns
    -------
    points : ndarray, shape (n, 3)
        Vertices [m].
    triangles : ndarray of int, shape (m, 3)
        Rows of ``points``, counter-clockwise seen from outside.

    Raises
    ------
    SceneError
        If the file cannot be read, its surface is not closed or crosses itself, or it has another size.
    """
    try:
        import igl.predicates  # noqa: F401
        import manifold3d  # noqa: F401
        from trimesh.grouping import clusters
    except ImportError as error:
        raise SceneError(f'a solid from a mesh needs {error.name}: pip install "taichi-mps[cad]"') from None
    corners, faces, repairs = corners_and_faces(path, scale, body, tolerance)
    require(len(faces), f"mesh {path}: holds no triangles; is empty, damaged or of another format")
    whole = 0 <= faces.min() <= faces.max() < len(corners)
    require(whole, f"mesh {path}: damaged; a triangle names a point that is not there")
    used, faces = np.unique(faces, return_inverse=True)
    with np.errstate(over="ignore"):
        corners, scaled = corners[used], corners[used] * scale
    require(np.all(np.isfinite(scaled)), f"mesh {path}: a coordinate is not a finite number [m]")
    points, inverse = np.unique(scaled, axis=0, return_inverse=True)
    triangles = inverse.reshape(-1)[faces.reshape(-1, 3)]  # STL repeats each corner
    size, largest, steps = np.ptp(points, axis=0), np.abs(points).max(), STEPS * last_place(corners) * scale
    rounding = min(ROUNDING * largest, max(ROUNDING * size.max(), steps))
    require(
        size.min() > 0.0 and size.max() <= max_length,
        f"mesh {path}: {' x '.join(f'{s:.4g}' for s in size)} m; must have a volume and be at most {max_length:.4g} m "
        f"long (read with scale = {scale:g}; scale = 0.001 for a file in mm)",
    )
    triangles_kept, opposed = drop_degenerate(triangles)
    if len(open_edges(triangles_kept)):
        require(
            rounding <= MAX_STEPS * size.max(),
            f"mesh {path}: is not closed, and coordinates of up to {largest:.4g} m are too coarse to tell which of its "
            f"corners are one: steps of {steps / STEPS:.2g} m for {size.max():.4g} m in all; must be near the origin",
        )
        first = np.arange(len(points))
        for group in clusters(points, rounding):
            first[group] = min(group)
        repairs += [f"{np.sum(first != np.arange(len(first)))} corners merged with others within {rounding:.2g} m"]
        triangles_kept, opposed = drop_degenerate(first[triangles])
        with_area = triangles_kept[heights(points[triangles_kept]) > rounding]
        if not len(open_edges(with_area)):
            triangles_kept = with_area
    if len(edges := open_edges(triangles_kept)):
        raise SceneError(
            f"mesh {path}: {len(edges)} of its edges belong to one triangle only, or two triangles face against each "
            f"other, the first {point_text(points[edges[0]].mean(axis=0))}; must be closed"
        )
    if opposed:
        repairs += [f"{opposed} triangles back to back left out, of sheets without thickness or between bodies"]
    if dropped := len(triangles) - len(triangles_kept) - opposed:
        repairs += [f"{dropped} triangles without area or written twice left out"]
    points, triangles_kept, united = unite_bodies(path, points, triangles_kept, rounding)
    if repairs + united:
        warnings.warn(f"mesh {path}: {'; '.join(repairs + united)}", stacklevel=3)
    return points, triangles_kept


def drop_degenerate(triangles):
    """Return the triangles without those that have two equal corners, and how many lay back to back.

    Of several triangles on the same corners one is kept, and none where as many face one way as the other.
    """
    orientation = np.prod(np.sign(triangles - np.roll(triangles, 1, axis=1)), axis=1)  # 0: two corners are equal
    group = np.unique(np.sort(triangles, axis=1), axis=0, return_inverse=True)[1].reshape(-1)
    net = np.bincount(group, orientation)[group]
    good = np.flatnonzero((orientation != 0) & (orientation == np.sign(net)))
    kept = triangles[np.sort(good[np.unique(group[good], return_index=True)[1]])]
    return kept, np.count_nonzero((orientation != 0) & (net == 0.0))


def last_place(coordinates):
    """Return the unit in the last place of the largest coordinates as written: 32 bits, or six figures or more."""
    large = coordinates[np.abs(coordinates) >= 0.1 * np.abs(coordinates).max()]
    with np.errstate(over="ignore"):
        bits = large.astype(np.float32)
    if np.array_equal(large, bits):
        return float(np.spacing(np.abs(bits).max()))
    decade = np.floor(np.log10(np.abs(large).max()))
    units = 10.0 ** (decade - np.arange(5, 16))
    return next(u for u in units if np.allclose(np.round(large / u), large / u, rtol=1e-13, atol=0.0))


def heights(corners):
    """Heights [m] of triangles, (n, 3, 3), on their longest sides."""
    sides = corners - np.roll(corners, 1, axis=1)
    area2 = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    return area2 / np.maximum(np.linalg.norm(sides, axis=2).max(axis=1), 1e-300)


def open_edges(triangles):
    """Edges (k, 2) along which unequal numbers of triangles run in the two directions."""
    edges = np.vstack([triangles[:, [a, b]] for a, b in ((0, 1), (1, 2), (2, 0))])
    names, group = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True)
    return names[np.bincount(group.reshape(-1), np.sign(edges[:, 1] - edges[:, 0])) != 0.0]


def point_text(point) -> str:
    """Coordinates of a point (3,) [m] as text for a message."""
    return "at ({:.4g}, {:.4g}, {:.4g}) m".format(*np.round(point, 9) + 0.0)


def lost_bodies(points, triangles, low, cell) -> list[str]:
    """Describe which of several bodies, thinner than a ``cell`` [m], hold no node of the grid from ``low`` [m] on."""
    lost, bodies = [], to_manifold(points, triangles).decompose()
    for body in bodies:
        if len(bodies) == 1 or 4.0 * abs(body.volume()) > 2.0 * cell * body.surface_area():
            continue
        ends = np.array(body.bounding_box()).reshape(2, 3)
        axes = [low[a] + cell * np.arange(*np.ceil((ends[:, a] - low[a]) / cell)) for a in range(3)]
        nodes = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
        if not (len(nodes) and (mesh_distance(nodes, *from_manifold(body)) < 0.0).any()):
            lost.append(f"{' x '.join(f'{s:.4g}' for s in np.ptp(ends, axis=0))} m {point_text(ends.mean(axis=0))}")
    return lost


def unite_bodies(path, points, triangles, rounding):
    """Unite all bodies and subtract their cavities, which are bodies inside out within another.

    Returns the surface, and lines for a warning that list the repairs; without a repair the surface is unchanged.
    """
    bodies = sorted(to_manifold(points, triangles).decompose(), key=lambda body: -abs(body.volume()))
    sign = [s for body in bodies if (s := np.sign(body.volume()))]
    require(sign, f"mesh {path}: its bodies have no volume")
    if sign[0] < 0.0:  # all of the file is inside out
        triangles, sign = triangles[:, ::-1], [-s for s in sign]
    bodies = [body if body.volume() > 0.0 else flipped(body) for body in bodies[: len(sign)]]
    low, high = np.array([body.bounding_box() for body in bodies]).reshape(-1, 2, 3).swapaxes(0, 1)
    contacts, turned, overlaps = 0, 0, []
    for k, body in enumerate(bodies):
        if (middle := find_self_intersection(*from_manifold(body))) is not None:
            raise SceneError(
                f"mesh {path}: a body crosses itself {point_text(middle)}; must be made of bodies that do not"
            )
        within, before = 0.0, len(overlaps)
        for other in np.flatnonzero(np.all((low[:k] <= high[k] + rounding) & (low[k] <= high[:k] + rounding), axis=1)):
            common = bodies[other] ^ body
            if common.volume() > (1.0 - 1e-6) * body.volume():
                within += sign[other]
            elif not common.is_empty() and (deep := overlap_depth_and_place(common))[0] > rounding:
                overlaps.append(deep)
            else:
                contacts += bodies[other].min_gap(body, 2.0 * rounding) < rounding
        if len(overlaps) == before and within + sign[k] not in (0.0, 1.0):
            if within:
                overlaps.append(overlap_depth_and_place(body))
            else:
                sign[k], turned = 1.0, turned + 1
    repairs = [f"{turned} of {len(bodies)} bodies inside out, turned"] * bool(turned)
    if contacts or overlaps:
        deepest = ", the deepest {:.3g} m {}".format(*max(overlaps)) if overlaps else ""
        repairs += [f"{len(overlaps)} overlaps{deepest}, and {contacts} contacts of {len(bodies)} bodies united"]
    if not repairs:
        return points, triangles, repairs
    solid = bodies[0]
    for s, body in zip(sign[1:], bodies[1:], strict=True):  # the largest first: what lies in a cavity comes after it
        solid = solid + body if s > 0.0 else solid - body
    return *from_manifold(solid), repairs


def to_manifold(points, triangles):
    """Convert a closed surface to a body of manifold3d."""
    import manifold3d

    return manifold3d.Manifold(manifold3d.Mesh64(points, np.array(triangles, np.uint64, order="C")))


def from_manifold(body):
    """Vertices (n, 3) [m] and triangles (m, 3) of a body of manifold3d."""
    mesh = body.to_mesh64()
    return np.array(mesh.vert_properties[:, :3], order="C"), mesh.tri_verts.astype(np.int64)


def extend_upwards(points, triangles, height, depth):
    """Surface of a body extended upwards by a height [m], with its section at a depth [m] below its highest point."""
    body, level = to_manifold(points, triangles), points[:, 2].max() - depth
    return from_manifold(body + body.slice(level).extrude(depth + height).translate((0.0, 0.0, level)))


def flipped(body):
    """Body of manifold3d whose triangles face the other way."""
    points, triangles = from_manifold(body)
    return to_manifold(points, triangles[:, ::-1])


def unit_normals(corners):
    """Compute unit normals (..., 3) of triangles by their corners (..., 3, 3) [m]; zero for a degenerate triangle."""
    sides = corners - np.roll(corners, 1, axis=-2)
    normal = np.cross(sides[..., 1, :], sides[..., 2, :])
    size, least = np.linalg.norm(normal, axis=-1), 1e-6 * (sides**2).sum(-1).max(-1)
    return np.where(size > least, 1.0, 0.0)[..., None] * normal / np.maximum(size, 1e-300)[..., None]


def overlap_depth_and_place(body):
    """Smallest width [m] of the intersection of two bodies, across a face or along an axis, and its place as text."""
    points, triangles = from_manifold(body)
    normal = unit_normals(points[triangles[:: 1 + len(triangles) // 200]])
    across = np.vstack([np.eye(3), normal[normal.any(axis=1)]])
    return np.ptp(points @ across.T, axis=0).min(), point_text(points.mean(axis=0))


def find_self_intersection(points, triangles):
    """Point (3,) [m] where a surface crosses itself most deeply; None if by no more than MAX_FOLD of its length."""
    from igl.predicates import find_intersections

    pairs = find_intersections(points, triangles, points, triangles)[1]
    pairs = triangles[pairs[pairs[:, 0] < pairs[:, 1]]]
    pairs = points[pairs[~np.any(pairs[:, 0, :, None] == pairs[:, 1, None, :], axis=(1, 2))]]
    plane = unit_normals(pairs)
    height = np.einsum("kabi,kai->kab", pairs - pairs[:, ::-1, :1], plane[:, ::-1])  # of corners over the other plane
    ahead, next_height = np.roll(pairs, -1, axis=2), np.roll(height, -1, axis=2)
    cut = height * next_height < 0.0
    share = np.where(cut, height / np.where(cut, height - next_height, 1.0), 0.0)
    ends = pairs + share[..., None] * (ahead - pairs)  # where sides cut the plane of the other triangle
    line = np.cross(plane[:, 0], plane[:, 1])
    line /= np.maximum(np.linalg.norm(line, axis=1, keepdims=True), 1e-300)
    along = np.einsum("kabi,ki->kab", ends - pairs[:, :1, :1], line)
    first = np.where(cut, along, np.inf).min(2).max(1)
    last = np.where(cut, along, -np.inf).max(2).min(1)
    depth = np.minimum(np.minimum(height.max(2), -height.min(2)).min(1), last - first)
    if depth.max(initial=0.0) <= MAX_FOLD * np.ptp(points, axis=0).max():
        return None
    k = depth.argmax()
    return ends[k][cut[k]][0] + (0.5 * (first[k] + last[k]) - along[k][cut[k]][0]) * line[k]


def mesh_distance(x, points, triangles):
    """Signed distance (n,) [m] of points ``x`` (n, 3) [m] from a closed surface, negative inside, by libigl."""
    import igl

    triangles = np.ascontiguousarray(triangles, np.int64)
    distance = igl.signed_distance(x, points, triangles, igl.SIGNED_DISTANCE_TYPE_PSEUDONORMAL)[0]
    if unit_normals(points[triangles]).any(axis=1).all():
        return distance
    winding = igl.fast_winding_number(points, triangles, x)  # 1 inside; right also for degenerate triangles, but slow
    clear = (np.abs(winding - 0.5) > 0.25) & (np.abs(distance) > ROUNDING * np.ptp(points, axis=0).max())
    return np.where(clear & (distance * (0.5 - winding) < 0.0), -distance, distance)


@validated
def write_bars(path: File, ends: array("m", (None, 2, 3)), radius: Size, sides: Sides = 12) -> Path:
    """Write round bars as a triangle mesh of closed bodies, which ``Solid.from_mesh`` unites where they overlap.

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

    Examples
    --------
    >>> import tempfile, pathlib, taichi_mps as mps
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = mps.write_bars(pathlib.Path(folder) / "bars.stl", [[(0, 0, 0), (0, 0, 0.5)]], radius=0.01)
    ...     file.stat().st_size
    2484
    """
    import meshio

    kind = path.suffix.lower()[1:]
    require(kind in FORMATS, f"path = {path}: must be a file .stl, .obj or .ply")
    wrong = f"ends of shape {ends.shape}: must be one bar or more, each between two places"
    require(len(ends) and np.all(np.ptp(ends, axis=1).max(1) > 0.0), wrong)
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
    options = {"binary": True} if kind == "stl" else {}
    with writing("path", path):
        meshio.write(path, meshio.Mesh(np.vstack(points), [("triangle", np.int32(every).reshape(-1, 3))]), **options)
    return path
