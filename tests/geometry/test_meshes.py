"""A mesh as CAD programs write it is the solid that was meant, or it is refused with file and place."""

import shutil
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import taichi_mps as mps
from taichi_mps.engine.geometry import solid
from taichi_mps.engine.geometry.mesh_files import triangles_of_polygons
from taichi_mps.engine.geometry.meshes import MAX_GAP, mesh_distance, read_mesh
from taichi_mps.engine.problem.problem import Problem
from tests.support.cube import CORNERS, box

for library in ("igl", "trimesh", "manifold3d"):
    pytest.importorskip(library)


def inner(low, high):
    """Triangles of a box inside out."""
    return box(low, high)[:, ::-1]


def stl(path, triangles):
    """A binary STL file of triangles (n, 3, 3)."""
    record = np.zeros(len(triangles), [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    record["corners"] = triangles
    path.write_bytes(bytes(80) + np.uint32(len(triangles)).tobytes() + record.tobytes())
    return path


def volume(points, triangles):
    a, b, c = points[triangles].swapaxes(0, 1)
    return np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0


def told(path, **keywords):
    """What is read of a mesh, and what is said of it."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        points, triangles = read_mesh(path, **keywords)
    said = [str(line.message) for line in said if line.category is UserWarning]
    assert all(str(path) in line for line in said)
    return points, triangles, "; ".join(said)


def refuses(path, content, message):
    """A file of this content is refused with this message."""
    path.write_bytes(content)
    with pytest.raises(mps.SceneError, match=message):
        read_mesh(path)


def needle(cube):
    """The cube with a triangle of three corners in a row on one of its edges."""
    corner, far, other = cube[4]  # 0 4 5: its edge from 0 to 4 gets a corner in its middle
    middle = 0.5 * (corner + far)
    return np.vstack([cube[:4], [[corner, middle, other], [middle, far, other], [corner, far, middle]], cube[5:]])


def by_a_rounding(cube):
    """The cube, its corners moved by up to 2e-6, each triangle by another."""
    return cube + np.random.default_rng(1).uniform(-2e-6, 2e-6, cube.shape)


SHEET = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.5, 1.0, 1.0)]  # on an edge of the cube
CAVE = (0.25,) * 3, (0.75,) * 3
GRAIN = (0.4,) * 3, (0.6,) * 3
LEFT_OUT = "{} triangles without area, written twice or back to back left out"
SOLIDS = {  # triangles, volume of the solid, how many of them are left out
    "a cube": (box(), 1.0, 0),
    "inside out": (box()[:, ::-1], 1.0, 0),
    "two equal corners": (np.vstack([box(), [CORNERS[[0, 0, 1]]]]), 1.0, 1),
    "three corners in a row": (needle(box()), 1.0, 0),
    "a corner in the middle of an edge": (np.delete(needle(box()), 6, axis=0), 1.0, 0),
    "a sliver beside it": (np.vstack([box(), [[(0, 0, 0), (0.5, 0, 0), (1, 0, 0)]]]), 1.0, 0),
    "every triangle twice": (np.repeat(box(), 2, axis=0), 1.0, 12),
    "some triangles twice": (np.vstack([box(), box()[2:5]]), 1.0, 3),
    "corners a rounding apart": (by_a_rounding(box()), 1.0, 0),
    "a sheet on its edge": (np.vstack([box(), [SHEET, SHEET[::-1]]]), 1.0, 2),
    "an edge in common": (np.vstack([box(), box((1, 1, 0), (2, 2, 1))]), 2.0, 0),
    "a corner in common": (np.vstack([box(), box((1, 1, 1), (2, 2, 2))]), 2.0, 0),
    "a face in common": (np.vstack([box(), box((1, 0, 0), (2, 1, 1))]), 2.0, 4),
    "a part of a face": (np.vstack([box(), box((1, 0.2, 0.3), (1.5, 0.7, 0.8))]), 1.125, 0),
    "overlap": (np.vstack([box(), box((0.9, 0.2, 0.2), (1.9, 0.8, 0.8))]), 1.324, 0),
    "one in another": (np.vstack([box(), box(*CAVE)]), 1.0, 0),
    "the same body twice": (np.vstack([box(), box()[:, [1, 2, 0]] + 0.0]), 1.0, 12),
    "a cavity": (np.vstack([box(), inner(*CAVE)]), 0.875, 0),
    "a cavity, all inside out": (np.vstack([inner((0,) * 3, (1,) * 3), box(*CAVE)]), 0.875, 0),
    "a grain in a cavity": (np.vstack([box(*GRAIN), inner(*CAVE), box()]), 0.883, 0),
    "a cavity that breaks out": (np.vstack([box(), inner((0.5, 0.2, 0.2), (1.5, 0.8, 0.8))]), 1.0, 0),
    "one of two inside out": (np.vstack([box(), inner((2, 0, 0), (2.5, 0.5, 0.5))]), 1.125, 0),
}


@pytest.mark.parametrize("name", SOLIDS)
def test_a_mesh_is_the_solid_that_was_meant(tmp_path, name):
    """The distance is negative in the volume, the same at nodes of a grid as one by one; a sound mesh says nothing."""
    triangles, right, left_out = SOLIDS[name]
    points, faces, said = told(stl(tmp_path / "mesh.stl", triangles))
    assert bool(said) == bool(left_out) and LEFT_OUT.format(left_out) * bool(left_out) in said
    low, size = points.min(axis=0), np.ptp(points, axis=0)
    x = low + np.random.default_rng(2).uniform(0.0, 1.0, (20_000, 3)) * size
    assert np.mean(mesh_distance(x, points, faces) < 0.0) == pytest.approx(right / np.prod(size), abs=0.012)
    nodes = mps.lattice(low - 0.1 * size, low + 1.1 * size, size.max() / 40.0)
    order = np.random.default_rng(3).permutation(len(nodes))
    assert np.array_equal(mesh_distance(nodes, points, faces)[order], mesh_distance(nodes[order], points, faces))


def test_outside_of_bodies_that_overlap_the_distance_is_that_of_their_union(tmp_path):
    """Exact outside of two boxes, and negative inside of them, also on the faces between them."""
    low, high = np.array([(0, 0, 0), (0.9, 0.2, 0.2)]), np.array([(1, 1, 1), (1.9, 0.8, 0.8)])
    points, faces, _ = told(stl(tmp_path / "two.stl", np.vstack([box(*ends) for ends in zip(low, high, strict=True)])))
    x = np.random.default_rng(4).uniform(-0.5, 2.5, (4000, 3))
    x[:50] = np.linspace((0.9, 0.25, 0.25), (0.9, 0.75, 0.75), 50)
    beyond = np.maximum(low - x[:, None], x[:, None] - high)
    right = np.min(np.linalg.norm(np.maximum(beyond, 0.0), axis=2) + np.minimum(beyond.max(axis=2), 0.0), axis=1)
    distance = mesh_distance(x, points, faces)
    assert np.array_equal(distance < 0.0, right < 0.0)
    assert distance[right > 0.0] == pytest.approx(right[right > 0.0], abs=1e-6)


@pytest.mark.parametrize("suffix", ["stl", "ply"])
@pytest.mark.parametrize(("share", "found"), [(1.2, True), (0.3, False)])
def test_a_mesh_is_open_where_its_hole_is_wider_than_a_gap(tmp_path, share, found, suffix):
    """A square hole in the middle of a face of the cube, its side in widths of the largest gap."""
    import meshio

    cube, half = box(), 0.5 * share * MAX_GAP
    face = np.all(cube[..., 2] == 1.0, axis=1)
    outer = np.array([(0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)], float)
    hole = (0.5, 0.5, 1.0) + 2.0 * half * (outer - (0.5, 0.5, 1.0))
    ahead, hole_ahead = np.roll(outer, -1, axis=0), np.roll(hole, -1, axis=0)
    ring = np.concatenate([np.stack([outer, ahead, hole_ahead], 1), np.stack([outer, hole_ahead, hole], 1)])
    triangles = np.concatenate([cube[~face], ring])
    path = tmp_path / f"hole.{suffix}"
    if suffix == "stl":
        stl(path, triangles)
    else:
        rows = np.arange(3 * len(triangles)).reshape(-1, 3)
        meshio.write(path, meshio.Mesh(triangles.reshape(-1, 3), [("triangle", rows)]))
    if found:
        with pytest.raises(
            mps.SceneError, match=rf"{path.name}: [1-4] of its edges .*, the first at \(0\.\d+, 0\.\d+, 1\) m"
        ):
            read_mesh(path, tolerance=1.0)
    else:
        assert len(read_mesh(path, tolerance=1.0)[1]) == 18


@pytest.mark.parametrize("offset", [0.0, 1e5, 4e5])
def test_thin_bodies_stay_however_far_from_the_origin_they_are(tmp_path, offset):
    """A bar 4 mm thick beside a cube, whose corners differ in the last of 12 figures, is whole at 0, 100 and 400 m."""
    triangles = np.vstack([box((0, 0, 0), (40, 40, 40)), box((60, 0, 0), (64, 4, 40))])
    triangles[0, 0, 0] += 1e-6
    (tmp_path / "bar.stl").write_text(as_text(triangles + offset, ".12g"))
    points, faces, said = told(tmp_path / "bar.stl", scale=1e-3)
    assert (
        volume(points - points.min(axis=0), faces) == pytest.approx(1e-9 * (40**3 + 4 * 4 * 40), rel=1e-4) and not said
    )
    x = 1e-3 * (np.array([(20, 20, 20), (62, 2, 20), (50, 20, 20), (62, 2, 41)]) + offset)
    assert mesh_distance(x, points, faces) == pytest.approx([-0.02, -0.002, 0.01, 0.001], abs=1e-8)
    lost = "no node of the grid lies inside the body of 0.004 x 0.004 x 0.04 m at "
    with pytest.raises(mps.SceneError, match=lost):
        mps.Solid.from_mesh(tmp_path / "bar.stl", 0.005, 0.03, scale=1e-3)


@pytest.mark.parametrize("offset", [1e5, 1e6])
def test_corners_may_differ_in_the_last_place_of_a_file(tmp_path, offset):
    """The corners of a cube of 40 mm, one last place of 32 bits apart: 8e-6 m at 100 m, 6e-5 m at 1000 m."""
    cube = np.float32(box((0, 0, 0), (40, 40, 40)) + offset)
    step = 1e-3 * float(np.spacing(cube.max()))
    cube[::2] = np.nextafter(cube[::2], np.float32(2e6))
    points, faces, said = told(stl(tmp_path / "cube.stl", cube), scale=1e-3)
    x = 1e-3 * (np.array([(20, 20, 20), (39, 20, 20), (41, 20, 20)]) + offset)
    assert mesh_distance(x, points, faces) == pytest.approx([-0.02, -0.001, 0.001], abs=1.5 * step) and not said


def bars(overlap):
    """Three square bars across three, 12 mm thick, that overlap by so many mm."""
    along = [box((-100, p - 6, -6), (100, p + 6, 6)) for p in (-50, 0, 50)]
    low, high = 6 - overlap, 18 - overlap
    return np.vstack([*along, *(box((p - 6, -100, low), (p + 6, 100, high)) for p in (-50, 0, 50))])


@pytest.mark.parametrize("overlap", [0.1, 0.5, 2.0, 12.0])
def test_crossing_bars_are_one_solid_however_little_they_overlap(tmp_path, overlap):
    path = stl(tmp_path / "net.stl", bars(overlap))
    for cell in (0.003, 0.005, 0.008):
        net = mps.Solid.from_mesh(path, cell, 0.03, scale=1e-3)
        at = np.array([(0.0, 0.0, 1e-3 * z) for z in (0.0, 6.0 - 0.5 * overlap, 12.0 - overlap)])
        assert net.distance(at).max() < 0.0


@pytest.mark.parametrize(
    ("triangles", "message"),
    [
        (box()[:-1], r"3 of its edges .*, the first at \(0, 0.5, 1\) m; must be closed"),
        (np.vstack([box()[:-1], box()[-1:, ::-1]]), "must be closed"),
        (0.0 * box(), "must have a volume"),
        (box() * np.nan, ".* (not a finite number|damaged)"),
        (
            40.0 * box(),
            r"40 x 40 x 40 m; must have a volume and be at most 15 m long .*; scale = 0.001 for a file in mm",
        ),
        (0.004 * box(), r", 0.004 x 0.004 x 0.004 m with scale = 1: .* no node of the grid lies inside the body"),
        (1e9 * box((0, 0, 0), (1e-7, 1e-7, 1e-10)), "must have a volume and be at most 15 m long"),
    ],
)
def test_a_mesh_that_cannot_be_repaired_is_refused(tmp_path, triangles, message):
    path = stl(tmp_path / "bad.stl", triangles)
    with pytest.raises(mps.SceneError, match=f"mesh .*bad.stl.*{message}"), np.errstate(all="ignore"):
        mps.Solid.from_mesh(path, cell=0.005, reach=0.03)


def as_text(triangles, figures="e"):
    """The text of an STL file, its numbers in a format."""
    corners = "".join(
        "facet normal 0 0 0\nouter loop\n"
        + "".join(f"vertex {x:{figures}} {y:{figures}} {z:{figures}}\n" for x, y, z in triangle)
        + "endloop\nendfacet\n"
        for triangle in triangles
    )
    return f"solid cube\n{corners}endsolid cube\n"


def test_files_as_other_programs_write_them(tmp_path):
    """Suffixes and keywords in capitals, several solids in a file and quadrilaterals are read; decimal commas are
    refused by name."""
    text, quads = as_text(box()), [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = "".join("f {} {} {} {}\n".format(*(corner + 1 for corner in quad)) for quad in quads)
    good = {
        "CUBE.STL": text.upper(),
        "two.stl": as_text(box()[:6]) + as_text(box()[6:]),
        "quads.obj": "".join("v {} {} {}\n".format(*corner) for corner in CORNERS) + faces,
        "notes.obj": "".join("v {} {} {} # a\n".format(*corner) for corner in CORNERS) + faces.replace("\n", " # b\n"),
    }
    for name, content in good.items():
        (tmp_path / name).write_text(content)
        points, triangles, said = told(tmp_path / name)
        assert volume(points, triangles) == pytest.approx(1.0) and not said
    commas = {"stl": text.replace(".", ","), "obj": good["quads.obj"].replace(".", ",")}
    for suffix, content in commas.items():
        refuses(
            tmp_path / f"comma.{suffix}",
            content.encode(),
            r"comma.*: cannot be read .* decimal comma; must have a point",
        )
    refuses(tmp_path / "cube.dxf", text.encode(), "must be a file .stl, .obj, .ply, .step or .stp")


HEAD, FACET = 84, 50  # bytes of a binary STL file before its triangles, and of each


def test_an_stl_file_is_read_where_all_its_triangles_are_there(tmp_path):
    """Bytes after the last triangle, a last line that is missing or misspelled, any line ends and any name."""
    text, binary = as_text(box()).encode(), stl(tmp_path / "cube.stl", box()).read_bytes()
    contents = [binary + rest for rest in (b"\n", bytes(7), bytes(512))]
    contents += [text.replace(b"endsolid cube\n", last) for last in (b"", b"end solid cube\n")]
    contents += [text.replace(b"\n", ends) for ends in (b"\r", b"\r\n")]
    names = (b"gr\xfc\xdf", "\u578b".encode(), b"endsolid", b"facet vertex 1 2 3", b"")
    contents += [text.replace(b"cube", name) for name in names]
    for content in contents:
        (tmp_path / "cube.stl").write_bytes(content)
        points, triangles, said = told(tmp_path / "cube.stl")
        assert volume(points, triangles) == pytest.approx(1.0) and len(triangles) == 12 and not said


def test_an_stl_file_that_is_cut_or_of_another_format_is_told_as_such(tmp_path):
    text, binary = as_text(box()).encode(), stl(tmp_path / "cube.stl", box()).read_bytes()
    facets = text.split(b"endfacet")
    bad = {
        binary[: HEAD + 10 * FACET]: "holds 10 of 12 triangles",
        binary[: HEAD + 12 * FACET - 1]: "holds 11 of 12 triangles",
        binary + binary[HEAD : HEAD + 2 * FACET]: "holds 14 of 12 triangles",
        b"endfacet".join(facets[:8])[:-9]: "holds 7 of 8 triangles",
        text[: text.index(b"endfacet")]: "holds 0 of 1 triangles",
        b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n": "holds 0 of 0 triangles",
        b"ply\nformat ascii 1.0\n" + 100 * b"comment\n": "holds no facets",
    }
    for content, message in bad.items():
        whole = f"mesh .*cut.stl: cannot be read as STL .damaged or another format: it {message}"
        refuses(tmp_path / "cut.stl", content, whole)


NOTCH = [(0, 0), (90, 0), (90, 90), (60, 90), (60, 30), (30, 30), (30, 90), (0, 90)]
ANGLE = [(0, 0), (80, 0), (80, 40), (40, 40), (40, 80), (0, 80)]
PARTS = {
    "notch": ([(0, 0, 90, 30), (0, 0, 30, 90), (60, 0, 90, 90)], NOTCH),
    "angle": ([(0, 0, 80, 40), (0, 0, 40, 80)], ANGLE),
}


def prism(path, outline, start, turn):
    """An OBJ or PLY file of a prism of 60 over an outline, its caps one polygon each from a corner ``start`` on."""
    n, k = len(outline), np.arange(len(outline))
    corners = np.vstack([np.c_[outline, np.full(n, z)] for z in (0.0, 60.0)]) @ turn.T
    faces = [np.roll(k[::-1], start), np.roll(k + n, start), *np.stack([k, (k + 1) % n, (k + 1) % n + n, k + n], 1)]
    if path.suffix == ".obj":
        lines = [f"v {x} {y} {z}" for x, y, z in corners] + [f"f {' '.join(map(str, face + 1))}" for face in faces]
    else:
        lines = ["ply", "format ascii 1.0", f"element vertex {2 * n}", *(f"property double {axis}" for axis in "xyz")]
        lines += [f"element face {n + 2}", "property list uchar int vertex_indices", "end_header"]
        lines += [f"{x} {y} {z}" for x, y, z in corners] + [f"{len(f)} {' '.join(map(str, f))}" for f in faces]
    path.write_text("\n".join(lines) + "\n")
    return path


def distance_to_prism(x, outline, parts):
    """Exact signed distance (n,) of points (n, 3) to a prism of 60 over an outline that boxes (k, 4) fill."""
    start, along = np.array(outline, float), np.roll(outline, -1, axis=0) - np.array(outline, float)
    beside = x[:, None, :2] - start
    share = np.clip((beside * along).sum(-1) / (along**2).sum(-1), 0.0, 1.0)
    flat = np.linalg.norm(beside - share[..., None] * along, axis=-1).min(axis=1)
    inside = [np.all((x[:, :2] > part[:2]) & (x[:, :2] < part[2:]), axis=1) for part in np.array(parts)]
    both = np.stack([np.where(np.any(inside, axis=0), -flat, flat), np.abs(x[:, 2] - 30.0) - 30.0])
    return np.linalg.norm(np.maximum(both, 0.0), axis=0) + np.minimum(both.max(axis=0), 0.0)


@pytest.mark.parametrize("suffix", ["obj", "ply"])
@pytest.mark.parametrize("name", PARTS)
def test_faces_that_are_concave_polygons_are_cut_into_triangles_within_them(tmp_path, name, suffix):
    """The distance of a prism with a notch is exact, whichever corner its caps begin with and however it is turned."""
    parts, outline = PARTS[name]
    x = np.random.default_rng(3).uniform(-30.0, 120.0, (2000, 3))
    x[:13] = np.c_[np.full(13, 45.0), np.arange(45.0, 110.0, 5.0), np.full(13, 30.0)]  # through the mouth of the notch
    right = distance_to_prism(x, outline, parts)
    for start in range(len(outline)):
        turn = np.linalg.qr(np.random.default_rng(start).normal(size=(3, 3)))[0] if start else np.eye(3)
        turn *= np.linalg.det(turn)
        points, triangles, said = told(prism(tmp_path / f"prism.{suffix}", outline, start, turn), max_length=500.0)
        assert mesh_distance(x @ turn.T, points, triangles) == pytest.approx(right, abs=1e-9) and not said


@given(st.lists(st.tuples(*[st.integers(0, 2)] * 3), min_size=4, max_size=8))
def test_triangles_of_any_polygon_have_its_area(polygon):
    """The sum of their vector areas is that of the polygon, whatever of itself it crosses or touches."""
    x = np.array(polygon, float)
    a, b, c = triangles_of_polygons(x, [np.arange(len(x))]).transpose(1, 0, 2)
    assert np.cross(b - a, c - a).sum(0) == pytest.approx(np.cross(x, np.roll(x, -1, 0)).sum(0), abs=1e-9)


def test_an_obj_file_counts_its_corners_from_one_or_backwards(tmp_path):
    """A relative index counts from the last corner before it; 0 and corners that are not there are refused, and unused
    corners are no part of the body."""
    quads = np.array([(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)])
    corners = "".join("v {} {} {}\n".format(*corner) for corner in CORNERS)
    faces = "".join("f {}//1 {}//1 {}//1 \\\n {}//1\n".format(*quad) for quad in quads - 8)
    (tmp_path / "cube.obj").write_text(f"{corners}{faces}v 9 9 9\n")
    points, triangles, said = told(tmp_path / "cube.obj")
    assert volume(points, triangles) == pytest.approx(1.0) and points.max() == 1.0 and not said
    message = "cube.obj: cannot be read as OBJ .damaged; a triangle names a point that is not there"
    for face in ("0 1 2", "1 2 99", "-9 -1 -2"):
        refuses(tmp_path / "cube.obj", f"{corners}{faces}f {face}\n".encode(), message)


# a box 30 mm away from the origin along y, and a round post
STEP = Path(__file__).parents[1] / "reference" / "parts.step"
BLOCK, RADIUS = (20.0, 10.0, 5.0), 10.0  # sides of the box, radius of the post [mm]
MILLIMETRE = "(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.))"
UNITS = {  # size of a unit [m], and how a STEP file names it
    "m": (1.0, MILLIMETRE.replace(".MILLI.", "$")),
    "mm": (1e-3, MILLIMETRE),
    "inch": (0.0254, "(CONVERSION_BASED_UNIT('INCH',#3)LENGTH_UNIT()NAMED_UNIT(#1))"),
}


@pytest.fixture
def assembly(tmp_path):
    """The parts as a file of their own."""
    return Path(shutil.copy(STEP, tmp_path))


@pytest.mark.parametrize("unit", [pytest.param("m", marks=pytest.mark.slow), "mm", "inch"])
def test_a_step_file_has_its_own_unit_and_its_bodies_their_names(assembly, unit):
    """A STEP file of a known box is read exactly, and a round body within the stated tolerance."""
    pytest.importorskip("cascadio")
    size, name = UNITS[unit]
    assembly.write_text(assembly.read_text().replace(MILLIMETRE, name))
    points, triangles, said = told(assembly, body="box")
    points = points / size
    assert points.min(0) == pytest.approx((0.0, 30.0, 0.0)) and np.ptp(points, axis=0) == pytest.approx(BLOCK)
    assert volume(points, triangles) == pytest.approx(1e3, rel=1e-6) and "of body box of 2 bodies: " in said
    tolerance = 0.002
    points, triangles, said = told(assembly, body="post", tolerance=tolerance * size)
    points = points / size
    angles = np.unique(np.round(np.arctan2(points[:, 1], points[:, 0])[np.hypot(*points[:, :2].T) > 9.0], 6))
    depth = RADIUS * (1.0 - np.cos(0.5 * np.diff(angles).max()))  # of the chords below the round face
    assert 0.2 * tolerance < depth < tolerance and f"within {tolerance * size:.2g} m of the faces" in said
    both, faces, _ = told(assembly, tolerance=tolerance * size)
    assert volume(both / size, faces) == pytest.approx(volume(points, triangles) + 1e3, rel=1e-6)


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"body": "beam"}, "parts.stp: body = beam: must be one of its 2 bodies: (box, post|post, box)"),
        ({"scale": 1e-3}, "scale = 0.001: must be left out; a STEP file has its own unit"),
    ],
)
def test_a_body_that_is_not_there_and_a_scale_of_a_step_file_are_refused(tmp_path, keywords, message):
    pytest.importorskip("cascadio")
    with pytest.raises(mps.SceneError, match=message):
        read_mesh(shutil.copy(STEP, tmp_path / "parts.stp"), **keywords)


def test_a_damaged_step_file_is_one_line_and_what_is_missing_is_named(assembly, monkeypatch, capfd):
    text = assembly.read_text()
    for bad in ("STEP", text.replace("CLOSED_SHELL", "OPEN_SHELL").replace("#20", "#9")):
        assembly.write_text(bad)
        with pytest.raises(mps.SceneError, match="mesh .*parts.step: (cannot be read as STEP|.* bodies: )"):
            read_mesh(assembly, body="none")
    assert capfd.readouterr() == ("", "")
    monkeypatch.setattr("taichi_mps.engine.geometry.mesh_files.find_spec", lambda name: None)
    with pytest.raises(
        mps.SceneError, match=r'parts.step: a STEP file needs cascadio: pip install "taichi-mps\[step\]"'
    ):
        read_mesh(assembly)


@pytest.mark.parametrize("step", [box(), box((0, 0, 0), (1.2, 1, 1))])
def test_a_form_is_open_at_its_highest_face(tmp_path, step):
    """A form with 1 m beside one of 2 m, which it touches or overlaps, is open above the higher one alone, its
    walls go on there, and where both meet there is none."""
    path = stl(tmp_path / "steps.stl", np.vstack([step, box((1, 0, 0), (2, 1, 2))]))
    form = mps.Solid.from_mesh(path, 0.05, 0.2, inside=True, open_top=1.0)
    depth = form.distance(np.array([(1.5, 0.5, z) for z in (1.0, 2.0, 2.6, 3.1)] + [(0.5, 0.5, 0.9), (0.5, 0.5, 1.1)]))
    assert depth == pytest.approx([0.5, 0.5, 0.4, -0.1, 0.1, -0.1], abs=1e-6)
    between = form.distance(np.array([(x, 0.5, 0.5) for x in (0.95, 1.0, 1.05, 1.2)]))
    assert between == pytest.approx(0.5, abs=1e-6)


def test_a_form_may_have_a_cavity(tmp_path):
    """A block with a void in it touches another block: the fluid may not be in the void, and may pass between them."""
    path = stl(tmp_path / "void.stl", np.vstack([box(), inner(*CAVE), box((1, 0, 0), (2, 1, 2))]))
    form = mps.Solid.from_mesh(path, 0.05, 0.2, inside=True)
    depth = form.distance(np.array([(0.5, 0.5, 0.5), (0.9, 0.5, 0.5), (1.0, 0.5, 0.5), (1.5, 0.5, 0.5)]))
    assert depth == pytest.approx([-0.25, 0.15, 0.25, 0.5], abs=1e-6)


def test_files_that_promise_more_than_they_hold(tmp_path):
    """Meshes whose header counts 4e9 triangles, without an end, or with coordinates that are no numbers are refused."""
    head = "ply\nformat {}\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n"
    bad = {
        "a.stl": bytes(80) + np.uint32(4_000_000_000).tobytes() + bytes(500),
        "b.ply": (head.format("ascii 1.0", 8) + 1000 * "comment\n").encode(),
        "c.ply": (head.format("binary_little_endian 1.0", 4 * 10**12) + "end_header\n").encode() + bytes(500),
        "d.obj": b"v nan 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 4 2\nf 2 4 3\nf 1 3 4\n",
        "f.stl": b"no mesh",
        "g.stl": b"",
        "h.stl": np.random.default_rng(1).bytes(2_000_000),
        "e.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 2000000000\n",
    }
    for name, content in bad.items():
        refuses(tmp_path / name, content, f"mesh .*{name}: (?!.*comma)")


def test_a_ply_file_is_read_where_all_its_faces_are_there(tmp_path):
    """A text that ends after the first of two bodies is refused, and a binary file of triangles and quadrilaterals."""
    head = (
        "ply\nformat {} 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement face {}\n"
    )
    head += "property list uchar int vertex_indices\nend_header\n"
    corners, faces = np.vstack([np.zeros(3), np.eye(3)]), [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
    text = "".join("{} {} {}\n".format(*corner) for corner in corners)
    text += "".join("3 {} {} {}\n".format(*face) for face in faces)
    binary = corners.astype("<f4").tobytes() + b"".join(bytes([3]) + np.array(face, "<i4").tobytes() for face in faces)
    (tmp_path / "body.ply").write_text(head.format("ascii", 4) + text)
    assert volume(*told(tmp_path / "body.ply")[:2]) == pytest.approx(1.0 / 6.0)
    mixed = binary + bytes([4]) + np.array([0, 1, 2, 3], "<i4").tobytes()
    bad = {
        "ascii": (8, text.encode(), r"\(damaged or another format\)"),
        "binary_little_endian": (5, mixed, "as many corners"),
    }
    for kind, (count, content, message) in bad.items():
        content = head.format(kind, count).encode() + content
        refuses(tmp_path / "body.ply", content, f"body.ply: cannot be read .*{message}")


def test_who_waits_for_a_mesh_is_told_how_far_it_is(tmp_path, monkeypatch, caplog):
    caplog.set_level("INFO", "taichi_mps")
    monkeypatch.setattr(solid, "PROGRESS_INTERVAL", 0.0)
    monkeypatch.setattr(solid, "NODES_PER_CALL", 1000)
    mps.Solid.from_mesh(stl(tmp_path / "cube.stl", box()), 0.05, 0.2)
    lines = caplog.messages
    assert len(lines) > 10 and all("% of the distances of a solid at 2.4e+04 nodes" in line for line in lines)


def test_a_solid_much_larger_than_its_domain_is_one_in_millimetres(tmp_path):
    path = stl(tmp_path / "post.stl", box((100, 0, 0), (140, 40, 40)))
    post = mps.Solid.from_mesh(path, cell=2.0, reach=1.0)  # a cell so large that the millimetres fit
    fluid = mps.fill(mps.Box((0.0, 0.0, 0.0), (0.1, 0.1, 0.1)), 0.02)
    scene = dict(name="post", material=mps.Bingham(), spacing=0.02, fluid=fluid, domain=((-0.1,) * 3, (0.3,) * 3))
    with pytest.raises(mps.SceneError, match="a solid of 42 m in a domain of 0.4 m: .* scale = 0.001 for a mesh in mm"):
        Problem(mps.Scene(walls=(post,), **scene), mps.Implicit())
