"""Triangles of mesh files: STL, OBJ, PLY, and STEP, cut into triangles by cascadio (extra ``step``); read by trimesh.

What trimesh takes for empty or reads wrongly is read here: STL as text, indices and concave faces of OBJ and PLY.
"""

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

from ...units import SceneError, regular_file, require

STEP = ("step", "stp")
MAX_BYTES = 5e8  # size of a mesh file: ten million triangles
HEAD, FACET = 84, 50  # bytes of a binary STL file before its triangles, and of each
DECIMAL_COMMAS = rb"^[ \t]*(v|vertex)?([ \t]*[-+]?\d+,\d[-+\de]*){3}\s"

logging.getLogger("trimesh").addHandler(logging.NullHandler())  # without a handler trimesh prints tracebacks


def read_triangles(path, scale, body, tolerance):
    """Triangles (m, 3, 3) of a file, and what is to be reported of them; SceneError if it cannot be read.

    Corners of a STEP file are in metres.
    """
    path = regular_file(f"mesh {path}", path, MAX_BYTES)
    kind = path.suffix.lower()[1:]
    if kind in STEP:
        require(scale == 1.0, f"mesh {path}: scale = {scale:g}: must be left out; a STEP file has its own unit")
        return read_step(path, body, tolerance)
    require(kind in READERS, f"mesh {path}: must be a file .stl, .obj, .ply, .step or .stp")
    require(not body, f"mesh {path}: body = {body}: must be left out; only bodies of a STEP file have names")
    data = path.read_bytes()
    try:
        require(not re.search(DECIMAL_COMMAS, data, re.I | re.M), "its numbers have a decimal comma; must have a point")
        with warnings.catch_warnings():
            warnings.filterwarnings("error", "string or file could not be read")  # NumPy returns the part before it
            return READERS[kind](data), []
    except Exception as error:
        why = error if isinstance(error, SceneError) else "damaged or another format"
        uneven = "; faces of a binary PLY must all have as many corners" if b"format binary" in data[:400] else ""
        raise SceneError(f"mesh {path}: cannot be read as {kind.upper()} ({why}{uneven})") from None


def read_stl(data):
    """Triangles (m, 3, 3) of an STL file, binary or text; SceneError if some are missing.

    The text may lack its last line, and bytes may follow the last triangle of a binary file.
    """
    import trimesh

    count, whole = int.from_bytes(data[80:HEAD], "little"), max(len(data) - HEAD, 0) // FACET
    end = HEAD + FACET * count
    if 0 < count <= whole and len(data[end:].strip(b"\0 \r\n\t")) < FACET:
        return trimesh.load_mesh(BytesIO(data[:end]), file_type="stl", process=False).triangles
    names = rb"^[ \t]*(end[ \t]*)?solid\b.*$"  # a name may hold any word and byte
    text = re.sub(names, b"", data.replace(b"\r", b"\n"), flags=re.I | re.M)
    if facets := len(re.findall(rb"\bfacet\b", text, re.I)):
        count, whole = facets, len(re.findall(rb"\bendfacet\b", text, re.I))
    bad = "damaged or another format: it holds"
    require(count <= MAX_BYTES / FACET, f"{bad} no facets")
    require(facets and whole == count, f"{bad} {whole} of {count} triangles")
    return np.fromstring(b" ".join(re.findall(rb"\bvertex\s+(\S+\s+\S+\s+\S+)", text, re.I)), sep=" ").reshape(-1, 3, 3)


def read_obj(data):
    """Triangles (m, 3, 3) of the text of an OBJ file."""
    corners, polygons = [], []
    for line in re.sub(rb"\\\r?\n", b"", data).splitlines():
        words = line.partition(b"#")[0].split()
        if words[:1] == [b"v"]:
            corners.append([float(word) for word in words[1:4]])
        elif words[:1] == [b"f"]:
            rows = [int(word.split(b"/")[0]) for word in words[1:]]  # from 1 on; -1 is the last corner so far
            polygons.append([row + (len(corners) if row < 0 else -1) for row in rows])
    return triangles_of_polygons(np.array(corners, float).reshape(-1, 3), polygons)


def read_ply(data):
    """Triangles (m, 3, 3) of a PLY file."""
    import trimesh

    raw = trimesh.load_mesh(BytesIO(data), file_type="ply", process=False, skip_materials=True).metadata["_ply_raw"]
    faces = raw["face"]
    polygons = faces["data"]["vertex_index" if "vertex_index" in faces["properties"] else "vertex_indices"]
    require(len(polygons) == faces["length"], "damaged or another format")
    corners = np.column_stack([raw["vertex"]["data"][axis] for axis in "xyz"])
    return triangles_of_polygons(corners.astype(float), polygons["f1"] if polygons.dtype.names else polygons)


READERS = {"stl": read_stl, "obj": read_obj, "ply": read_ply}


def triangles_of_polygons(corners, polygons):
    """Triangles (m, 3, 3) of polygons, rows of ``corners`` (n, 3); those of more than three corners are cut by
    manifold3d.

    A fan of triangles, which trimesh makes, leaves a concave polygon; libigl's ear clipping ends the process at one
    that crosses itself.
    """
    import manifold3d

    faces = [polygon for polygon in polygons if len(polygon) == 3]
    for polygon in (np.roll(polygon, 1) for polygon in polygons if len(polygon) > 3):
        x = corners[polygon] - corners[polygon[0]]
        normal = np.cross(x[1:-1], x[2:]).sum(axis=0)
        axis = np.abs(normal).argmax()
        plane = np.roll(range(3), -axis)[1:][:: 1 if normal[axis] > 0.0 else -1]  # seen from outside
        faces.extend(polygon[manifold3d.triangulate([x[:, plane]])])
    rows = np.array(faces, np.int64).reshape(-1, 3)
    require(np.all((rows >= 0) & (rows < len(corners))), "damaged; a triangle names a point that is not there")
    return corners[rows]


STEP_TO_GLB = "import sys, cascadio; a, b, t = sys.argv[1:]; sys.exit(cascadio.step_to_glb(a, b, float(t), 0.2) != 0)"
STEP_TIMEOUT = 600.0  # for cutting a STEP file into triangles [s]


def read_step(path, name, tolerance):
    """Triangles (m, 3, 3) [m] of all bodies of a STEP file, or of one by its name, and what is to be reported of them.

    OpenCASCADE works in millimetres. It runs in a process of its own, because it prints and a damaged file may end it.
    """
    import trimesh

    require(find_spec("cascadio"), f'mesh {path}: a STEP file needs cascadio: pip install "taichi-mps[step]"')
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / "mesh.glb"
        command = [sys.executable, "-c", STEP_TO_GLB, str(path), str(made), repr(1e3 * tolerance)]
        try:
            subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, timeout=STEP_TIMEOUT, check=True)
            bodies = [(mesh.metadata["name"], mesh.triangles) for mesh in trimesh.load_scene(made).dump()]
        except Exception as error:
            raise SceneError(f"mesh {path}: cannot be read as STEP ({type(error).__name__})") from None
    names = list(dict(bodies))
    listed = f"{len(names)} bodies: {', '.join(names[:20])}"
    require(not name or name in names, f"mesh {path}: body = {name}: must be one of its {listed}")
    triangles = np.concatenate([np.zeros((0, 3, 3)), *(own for key, own in bodies if name in ("", key))])
    return triangles, [
        f"{len(triangles)} triangles within {tolerance:.2g} m of the faces of "
        f"{f'body {name} of ' if name else ''}{listed}"
    ]
