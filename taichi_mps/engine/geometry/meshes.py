"""Triangle meshes: closed or not, inside or outside by libigl's winding number, distances (extra ``cad``)."""

import warnings
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from ...units import Count, File, Size, array, require, validated, writing
from .mesh_files import READERS, read_triangles
from .shapes import lattice

MAX_LENGTH_IN_REACHES = 500.0  # a mesh longer than this times the grid's ``reach`` is in millimetres; a scene has 100
MAX_GAP = 0.01  # distance from an open edge at which the winding number is looked at, over the size, at most
MAX_FRACTION = 0.1  # of a winding number that is whole; libigl's fast one is within 0.01
# unit vectors (8, 1, 3) to where it is looked at, one in each octant and in no face that is likely
BESIDE = np.sqrt([0.2, 0.3, 0.5]) * (2 * np.indices((2, 2, 2)).reshape(3, 8).T[:, None] - 1)
ROUNDING = 1e-6  # distance over the size within which a point is on the surface; libigl's winding number has 32 bits


def require_cad(what: str) -> None:
    """Raise SceneError unless what ``what`` needs is installed."""
    missing = [name for name in ("igl", "trimesh") if not find_spec(name)]
    require(not missing, f'{what} needs {missing}: pip install "taichi-mps[cad]"')


def read_mesh(path, scale=1.0, max_length=100.0, body="", tolerance=1e-3):
    """Read closed bodies as triangles, with a warning that lists what was left out.

    Triangles without area, written twice or back to back are left out. The bodies may touch, overlap, lie in each other
    and be inside out; corners may be a rounding apart.

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
        How far the triangles may be from the faces of a STEP file [m]. A hole a fifth wider than this, or than a
        hundredth of the mesh, is found; a crack of a quarter of it counts as closed.

    Returns
    -------
    points : ndarray, shape (n, 3)
        Vertices [m].
    triangles : ndarray of int, shape (m, 3)
        Rows of ``points``, counter-clockwise seen from outside for most of the volume.

    Raises
    ------
    SceneError
        If the file cannot be read, its surface is not closed, or it has another size.
    """
    require_cad("a solid from a mesh")
    corners, notes = read_triangles(path, scale, body, tolerance)
    require(len(corners), f"mesh {path}: holds no triangles; is empty, damaged or of another format")
    with np.errstate(over="ignore"):
        points, rows = np.unique(scale * corners.reshape(-1, 3), axis=0, return_inverse=True)
    require(np.all(np.isfinite(points)), f"mesh {path}: a coordinate is not a finite number [m]")
    triangles = rows.reshape(-1, 3)
    kept = surplus(triangles, np.sign(np.roll(triangles, -1, axis=1) - triangles).prod(axis=1))
    size = np.ptp(points, axis=0)
    require(
        len(kept) and size.min() > 0.0 and size.max() <= max_length,
        f"mesh {path}: {' x '.join(f'{s:.4g}' for s in size)} m; must have a volume and be at most {max_length:.4g} m "
        f"long (read with scale = {scale:g}; scale = 0.001 for a file in mm)",
    )
    gaps = find_gaps(points, kept, min(tolerance, MAX_GAP * size.max()))
    require(
        not len(gaps),
        f"mesh {path}: {len(gaps)} of its edges belong to one triangle only, or two triangles face against each other, "
        f"the first {' '.join(map(point_text, gaps[:1]))}; must be closed",
    )
    if np.linalg.det(points[kept] - points.mean(axis=0)).sum() < 0.0:
        kept = kept[:, ::-1]
    if len(kept) < len(triangles):
        notes += [f"{len(triangles) - len(kept)} triangles without area, written twice or back to back left out"]
    if notes:
        warnings.warn(f"mesh {path}: {'; '.join(notes)}", stacklevel=3)
    return points, kept


def surplus(simplices, orientation):
    """Rows of edges or triangles: of several on the same corners one, and none where opposite orientations cancel."""
    group = np.unique(np.sort(simplices, axis=1), axis=0, return_inverse=True)[1].reshape(-1)
    good = np.flatnonzero(orientation * np.bincount(group, orientation)[group] > 0.0)
    return simplices[np.sort(good[np.unique(group[good], return_index=True)[1]])]


def open_edges(triangles):
    """Edges (k, 2) along which more triangles run than against them."""
    edges = triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    return surplus(edges, np.sign(edges[:, 1] - edges[:, 0]))


def find_gaps(points, triangles, apart):
    """Middles (k, 3) [m] of open edges where the winding number is no whole number ``apart`` [m] beside them.

    It is one beside a seam whose corners are a rounding apart, and where a triangle ends in the middle of another.
    """
    middles = points[open_edges(triangles)].mean(axis=1)
    winding = winding_number(middles + apart * BESIDE, points, triangles)
    return middles[np.abs(winding - np.round(winding)).max(axis=0) > MAX_FRACTION]


def point_text(point) -> str:
    """Coordinates of a point (3,) [m] as text for a message."""
    return "at ({:.4g}, {:.4g}, {:.4g}) m".format(*np.round(point, 9) + 0.0)


def winding_number(x, points, triangles):
    """Winding number (...) of points ``x`` (..., 3) [m]: how often the surface goes round them, to a hundredth.

    By libigl, which counts in 32 bits, hence from the middle of the surface on.
    """
    import igl

    middle, triangles = points.mean(axis=0), np.array(triangles, np.int64, order="C")
    return igl.fast_winding_number(points - middle, triangles, (x - middle).reshape(-1, 3)).reshape(x.shape[:-1])


def mesh_distance(x, points, triangles):
    """Signed distance (n,) [m] of points ``x`` (n, 3) [m] from the nearest triangle, negative inside, by libigl.

    Inside is where the surface goes round, in either direction. Where bodies overlap, the nearest triangle of a point
    inside may be one between them; that of a point outside lies on their union. The winding number is counted again
    only where the surface may lie between a point and the one before it.
    """
    import igl

    triangles, rounding = np.array(triangles, np.int64, order="C"), ROUNDING * np.ptp(points, axis=0).max()
    signed = igl.signed_distance(x, points, triangles, igl.SIGNED_DISTANCE_TYPE_PSEUDONORMAL)[0]
    distance, near = np.abs(signed), np.abs(signed) <= rounding
    apart = np.linalg.norm(np.diff(x, axis=0, prepend=np.inf), axis=1)
    anew = distance + np.roll(distance, 1) <= apart + rounding
    winding = np.abs(winding_number(x[anew], points, triangles))[np.cumsum(anew) - 1]
    winding[near] = np.abs(winding_number(x[near] + rounding * BESIDE, points, triangles)).min(axis=0)
    return np.where(winding > 0.5, -np.maximum(distance, 1e-3 * rounding), np.where(near, signed, distance))


def closed_bodies(points, triangles):
    """Bodies of a surface that are closed by themselves, as meshes of trimesh; a cavity has a negative volume."""
    import trimesh

    return trimesh.Trimesh(points, triangles, process=False).split(repair=False)


def check_bodies(points, triangles, low, cell):
    """Refuse a body thinner than two ``cell`` [m] that holds no node of the grid from ``low`` [m] on."""
    for body in closed_bodies(points, triangles):
        if 4.0 * abs(body.volume) < 2.0 * cell * body.area:
            first = low + cell * np.ceil((body.bounds[0] - low) / cell)
            nodes = lattice(first, np.maximum(first, body.bounds[1]), cell, offset=0.0)
            require(
                np.any(mesh_distance(nodes, np.array(body.vertices), body.faces) < 0.0),
                f"cell = {cell:g} m: no node of the grid lies inside the body of "
                f"{' x '.join(f'{s:.4g}' for s in body.extents)} m {point_text(body.bounds.mean(axis=0))}; must be "
                "finer",
            )


def unite_bodies(points, triangles):
    """Surface of the union of bodies, without the faces between them, which are no walls to a fluid inside."""
    import trimesh

    bodies = closed_bodies(points, triangles)
    solids = [body for body in bodies if body.volume > 0.0]
    if len(solids) < 2 or sum(len(body.faces) for body in bodies) < len(triangles):
        return points, triangles
    union = trimesh.boolean.union(solids, engine="manifold", check_volume=False)
    surface = trimesh.util.concatenate([union, *(body for body in bodies if body.volume < 0.0)])  # cavities
    return np.array(surface.vertices), np.array(surface.faces)


def extend_upwards(points, triangles, height, depth):
    """Surface whose triangles within a depth [m] of its highest point are raised by a height [m] on upright walls."""
    top = np.all(points[triangles][..., 2] > points[:, 2].max() - depth, axis=1)
    a, b = open_edges(triangles[top]).T
    raised = len(points)
    walls = np.vstack([np.stack([a, b, b + raised], 1), np.stack([a, b + raised, a + raised], 1)])
    points = np.vstack([points, points + (0.0, 0.0, height)])
    return points, np.vstack([triangles[~top], triangles[top] + raised, walls])


@validated
def write_bars(
    path: File, ends: array("m", (None, 2, 3)), radius: Size, sides: Annotated[Count, Field(ge=3, le=1000)] = 12
) -> Path:
    """Write round bars as a triangle mesh of closed bodies; ``Solid.from_mesh`` reads them also where they overlap.

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
    require_cad("a mesh of bars")
    import trimesh

    require(path.suffix.lower()[1:] in READERS, f"path = {path}: must be a file .stl, .obj or .ply")
    require(
        len(ends) and np.all(np.ptp(ends, axis=1).max(1) > 0.0),
        f"ends of shape {ends.shape}: must be one bar or more, each between two places",
    )
    outer = radius * np.sqrt(2.0 * np.pi / (sides * np.sin(2.0 * np.pi / sides)))
    bars = [trimesh.creation.cylinder(outer, segment=pair, sections=sides) for pair in ends]
    with writing("path", path):
        trimesh.util.concatenate(bars).export(path)
    return path
