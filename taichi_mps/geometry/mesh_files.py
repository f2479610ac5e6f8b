"""Corners and triangles of mesh files: STL, OBJ, PLY by trimesh, and STEP, cut by cascadio (extra ``step``)."""

import logging
import re
import subprocess
import sys
import tempfile
import warnings
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path

import numpy as np

from ..units import SceneError, ordinary, require

FORMATS, STEP = ("stl", "obj", "ply"), ("step", "stp")
MAX_BYTES = 5e8  # size of a mesh file: ten million triangles

logging.getLogger("trimesh").addHandler(logging.NullHandler())  # without a handler trimesh prints tracebacks


def corners_and_faces(path, scale, body, tolerance):
    """Corners (n, 3) and triangles (m, 3) of a file, and lines for a warning; SceneError if it cannot be read.

    Corners of a STEP file are in metres.
    """
    path = ordinary(f"mesh {path}", path, MAX_BYTES)
    kind = path.suffix.lower()[1:]
    if kind in STEP:
        require(scale == 1.0, f"mesh {path}: scale = {scale:g}: must be left out; a STEP file has its own unit")
        return bodies_of_step(path, body, tolerance)
    require(kind in FORMATS, f"mesh {path}: must be a file .stl, .obj, .ply, .step or .stp")
    require(not body, f"mesh {path}: body = {body}: must be left out; only bodies of a STEP file have names")
    data = path.read_bytes()
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("error", "string or file could not be read")  # NumPy returns the part before it
            if kind == "stl":
                return *read_stl(path, data), []
            corners, polygons = read_obj(data) if kind == "obj" else read_ply(data)
            return corners, triangles_of_polygons(corners, polygons), []
    except SceneError:
        raise
    except Exception:
        comma = re.search(rb"^[ \t]*(v|vertex)?([ \t]*[-+]?\d+,\d[-+\de]*){3}\s", data, re.I | re.M)
        why = "its numbers have a decimal comma; must have a point" if comma else "damaged or another format"
        why += "; faces of a binary PLY must all have as many corners" * (b"format binary" in data[:400])
        raise SceneError(f"mesh {path}: cannot be read as STL, OBJ or PLY ({why})") from None


def read_stl(path, data):
    """Corners (3 m, 3) and triangles (m, 3) of an STL file, binary or text; SceneError if some are missing.

    The text may lack its last line, and bytes may follow the last triangle of a binary file.
    """
    count, found = int.from_bytes(data[80:84], "little"), max(len(data) - 84, 0) // 50
    if 0 < count <= found and len(data[84 + 50 * count :].strip(b"\0 \r\n\t")) < 50:
        record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
        numbers = np.frombuffer(data, record, count, 84)["corners"]
    else:
        names = rb"^[ \t]*(end[ \t]*)?solid\b.*$"  # a name may hold any word and byte
        text = re.sub(names, b"", data.replace(b"\r", b"\n"), flags=re.I | re.M)
        if facets := len(re.findall(rb"\bfacet\b", text, re.I)):
            count, found = facets, len(re.findall(rb"\bendfacet\b", text, re.I))
        known = 0 < count <= MAX_BYTES / 50
        require(known, f"mesh {path}: is no STL; must have facets as text or a head that counts its triangles")
        require(facets and found == count, f"mesh {path}: is damaged: holds {found} of {count} triangles")
        numbers = np.fromstring(b" ".join(re.findall(rb"\bvertex\s+(\S+\s+\S+\s+\S+)", text, re.I)), sep=" ")
    corners = np.array(numbers, float).reshape(-1, 3)
    return corners, np.arange(len(corners)).reshape(-1, 3)


def read_obj(data):
    """Corners (n, 3) and polygons, each a list of rows of the corners, of the text of an OBJ file."""
    corners, polygons = [], []
    for line in re.sub(rb"\\\r?\n", b"", data).splitlines():
        words = line.partition(b"#")[0].split()
        if words[:1] == [b"v"]:
            corners.append([float(word) for word in words[1:4]])
        elif words[:1] == [b"f"]:
            rows = [int(word.split(b"/")[0]) for word in words[1:]]  # from 1 on; -1 is the last corner so far
            polygons.append([row + (len(corners) if row < 0 else -1) for row in rows])
    return np.array(corners, float).reshape(-1, 3), polygons


def read_ply(data):
    """Corners (n, 3) and polygons, each a row of rows of the corners, of a PLY file."""
    import trimesh

    raw = trimesh.load_mesh(BytesIO(data), file_type="ply", process=False, skip_materials=True).metadata["_ply_raw"]
    name = "vertex_index" if "vertex_index" in raw["face"]["properties"] else "vertex_indices"
    polygons = raw["face"]["data"][name]
    if len(polygons) < raw["face"]["length"]:
        raise ValueError("cut")
    corners = np.column_stack([raw["vertex"]["data"][axis] for axis in "xyz"])
    return corners.astype(float), polygons["f1"] if polygons.dtype.names else polygons


def triangles_of_polygons(points, polygons):
    """Triangles (m, 3) of polygons with three corners or more: a fan of each, or of a concave one by manifold3d.

    In the fan of a polygon that is concave as seen from its first corner, some triangles face against the others.
    """
    from manifold3d import triangulate

    triangles, sides = [np.zeros((0, 3), np.int64)], np.array([len(polygon) for polygon in polygons])
    for n in np.unique(sides[sides >= 3]):
        rows = np.array([polygons[k] for k in np.flatnonzero(sides == n)], np.int64)
        fan = rows[:, [(0, k, k + 1) for k in range(1, n - 1)]]
        with np.errstate(all="ignore"):  # corners that are not finite, or not there, are refused later
            a, b, c = np.moveaxis(points.take(fan, axis=0, mode="clip"), 2, 0)
            area = np.cross(b - a, c - a)
            whole = area.sum(axis=1)
            along = np.einsum("kij,kj->ki", area, whole)
            concave = along.min(axis=1) < -1e-9 * along.sum(axis=1)
        for k in np.flatnonzero(concave):
            axis = np.abs(whole[k]).argmax()
            plane = np.roll(range(3), -axis)[1:][:: int(np.sign(whole[k, axis]))]  # seen from outside
            fan[k] = rows[k][triangulate([points[rows[k]][:, plane]])]
        triangles.append(fan.reshape(-1, 3))
    return np.concatenate(triangles)


STEP_TO_GLB = "import sys, cascadio; a, b, t = sys.argv[1:]; sys.exit(cascadio.step_to_glb(a, b, float(t), 0.2) != 0)"
STEP_TIMEOUT = 600.0  # for cutting a STEP file into triangles [s]


def bodies_of_step(path, name, tolerance):
    """Corners (n, 3) [m], triangles (m, 3) and lines for a warning of all bodies of a STEP file, or of one by its name.

    OpenCASCADE works in millimetres. It runs in a process of its own, because it prints and a damaged file may end it.
    """
    import trimesh

    require(find_spec("cascadio"), f'mesh {path}: a STEP file needs cascadio: pip install "taichi-mps[step]"')
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / "mesh.glb"
        command = [sys.executable, "-c", STEP_TO_GLB, str(path), str(made), repr(1e3 * tolerance)]
        try:
            subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, timeout=STEP_TIMEOUT, check=True)
            scene = trimesh.load_scene(made)
        except Exception as error:
            raise SceneError(f"mesh {path}: cannot be read as STEP ({type(error).__name__})") from None
    bodies = {}
    for node in scene.graph.nodes_geometry:
        place, own = scene.graph[node]
        bodies.setdefault(own, []).append(scene.geometry[own].copy().apply_transform(place))
    body_names = f"{len(bodies)} bodies: {', '.join(list(bodies)[:20])}"
    require(not name or name in bodies, f"mesh {path}: body = {name}: must be one of its {body_names}")
    mesh = trimesh.util.concatenate([mesh for own in bodies if name in ("", own) for mesh in bodies[own]])
    note = f"{len(mesh.faces)} triangles within {tolerance:.2g} m of the faces of " + (f"body {name} of " * bool(name))
    return np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64), [note + body_names]
