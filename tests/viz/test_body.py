"""Contents of a picture: the body of revolution, the mould at 0 s, glass walls, and dimensions at their places."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pysplashsurf
import pytest
from PIL import Image

import taichi_mps as mps
from taichi_mps.viz import overlay
from taichi_mps.viz.body import contour, profile, smooth_surface, surface_of
from taichi_mps.viz.render import Renderer
from taichi_mps.viz.view_volume import dimensions, view_volume

WIDE, TALL = 640, 360


def enclosed(x, triangles, normals):
    """Volume [m3] within triangles, turned as the normals are."""
    a, b, c = (x[k] for k in triangles.T)
    area = 0.5 * np.cross(b - a, c - a)
    return float(np.abs((area * a).sum(1) @ np.sign((area * normals[triangles[:, 0]]).sum(1))) / 3.0)


@pytest.mark.parametrize("spacing", [0.01, 0.02])
def test_rings_of_a_cylinder_have_its_outline(spacing):
    x = mps.fill_rings(mps.Cone(0.1, 0.1, 0.2), spacing)
    points, normals, parts = contour(mps.measure.still(x, spacing), 0.0)
    side, top = points[(points[:, 1] < 0.15)], points[points[:, 0] < 0.05]
    np.testing.assert_allclose(side[:, 0], 0.1, atol=0.05 * spacing)
    np.testing.assert_allclose(top[:, 1], 0.2, atol=0.05 * spacing)
    np.testing.assert_allclose(normals[points[:, 1] < 0.1], [(1.0, 0.0)] * np.sum(points[:, 1] < 0.1), atol=0.05)
    assert points[:, 1].min() == 0.0 and points[:, 0].min() == 0.0 and len(parts) == len(points) - 1


def test_a_point_that_no_particle_reaches_has_finite_fields(monkeypatch):
    """Between drops the surface has a point now and then at which nothing can be interpolated."""
    made = pysplashsurf.reconstruction_pipeline

    def gaps(*positions, **options):
        whole, grid = made(*positions, **options)
        given = {name: np.array(values) for name, values in whole.point_attributes.items()}
        for values in given.values():
            values[0] = np.nan
        return SimpleNamespace(mesh=whole.mesh, point_attributes=given), grid

    monkeypatch.setattr(pysplashsurf, "reconstruction_pipeline", gaps)
    s, normals, _ = smooth_surface(mps.measure.still(mps.fill(mps.Cone(0.1, 0.1, 0.1), 0.02), 0.02))
    assert all(np.isfinite(values).all() for values in (s.u, s.shear_rate, s.p, normals))


def test_a_ring_alone_is_drawn_and_nothing_is_below_the_floor():
    points, _, _ = contour(mps.measure.still([[0.1, 0.005]], 0.01), 0.0)
    assert np.abs(points[:, 0] - 0.1).max() < 0.01 and points[:, 1].min() == 0.0


@pytest.mark.parametrize("model", ["axisymmetric", "quarter", "full"])
def test_at_the_start_the_body_is_the_mould(model):
    scene = mps.slump_cone(model=model, spacing=0.02)
    start = mps.measure.still(scene.fluid, 0.02)
    s, normals, triangles = surface_of(scene, start, 0.6, ())
    assert enclosed(s.x, triangles, normals) == pytest.approx(scene.mould.volume, rel=2e-3)  # of 72 sides
    found = scene.measure(scene.unfold(start))
    assert (found["slump_m"], found["spread_m"]) == (0.0, 0.2)
    assert scene.measure(scene.unfold(replace(start, time=0.01)))["spread_m"] != 0.2 or model == "axisymmetric"


def test_rings_that_have_moved_in_disorder_keep_the_slope_of_the_mould():
    scene = mps.slump_cone(model="axisymmetric")
    moved = scene.fluid + np.random.default_rng(1).uniform(-1.5e-3, 1.5e-3, scene.fluid.shape)
    line, normals, _ = profile(scene, replace(mps.measure.still(moved, 0.01), time=1e-3))
    inner = (line.x[:, 1] > 0.03) & (line.x[:, 1] < 0.27)
    assert line.x[:, 0].max() > 0.0995 and np.ptp(line.x[line.x[:, 0] < 0.02, 1]) == 0.0, (
        "its rim, and level at the axis"
    )
    np.testing.assert_allclose(line.x[inner] @ (1.0, 1.0 / 6.0), 0.1, atol=1.5e-3)  # steps of the lattice are 10 mm
    assert np.degrees(np.abs(np.arctan2(normals[inner, 1], normals[inner, 0]) - np.arctan(1.0 / 6.0))).max() < 3.0


def shown(scene, **measures):
    """Renderer and dimensions of a scene in which these lengths [m] are measured."""
    renderer = Renderer(scene, WIDE, TALL)
    return renderer, dimensions(scene, measures, *view_volume(scene)[:2], 0.7)


def test_a_diameter_stands_on_the_plane_of_the_axis():
    renderer, found = shown(mps.slump_cone(spacing=0.02), slump_m=0.18, spread_m=0.318)
    slump, flow = found
    assert (slump["text"], flow["text"]) == ("slump 18.0 cm", "slump flow 31.8 cm")
    assert (slump["a"], slump["b"]) == ([0.0, 0.0, 0.3], [0.0, 0.0, pytest.approx(0.12)])
    assert (flow["a"], flow["b"]) == ([-0.159, 0.0, 0.0], [0.159, 0.0, 0.0])
    # a disc of this diameter spans as much of the ruler: both lie at the depth of the axis
    rim = renderer.camera.project([(-0.159, 0.0, 0.0), (0.159, 0.0, 0.0)])
    ticks = renderer.camera.project([(-0.2, 0.5 * (renderer.low[1] + renderer.high[1]), 0.0), (0.2, 0.0, 0.0)])
    assert np.ptp(rim[:, 0]) / np.ptp(ticks[:, 0]) == pytest.approx(0.318 / 0.4)


def test_no_arrow_is_drawn_for_what_has_no_length():
    assert shown(mps.slump_cone(spacing=0.02), slump_m=0.0, spread_m=np.nan)[1] == []


def test_the_lengths_of_an_l_box_begin_at_its_walls():
    scene = mps.catalogue.build("l_box", spacing=0.02)
    _, found = shown(scene, front_m=0.6, h1_m=0.1, h2_m=0.05)
    ends = {one["text"].split()[-3]: (one["a"], one["b"]) for one in found}
    assert ends["front"][0][0] == 0.0 and ends["front"][1][0] == 0.6
    assert ends["H1"][0][0] == pytest.approx(0.1) and ends["H2"][0][0] == pytest.approx(0.7)  # behind the gate
    assert np.concatenate(scene.vessel).max(0) == pytest.approx([0.7, 0.1, 0.6])


@pytest.mark.parametrize("before", [False, True])
def test_glass_tints_what_is_behind_it_and_nothing_before_it(before):
    renderer, _ = shown(mps.slump_cone(spacing=0.02))
    image = Image.new("RGB", (WIDE, TALL), "white")
    face = np.array([(-0.1, 0.0, 0.05), (0.1, 0.0, 0.05), (0.1, 0.0, 0.2), (-0.1, 0.0, 0.2)])
    middle = renderer.camera.project(face.mean(0)[None])[0]
    overlay.Overlay(image, np.full((TALL, WIDE), (2.0 if before else 0.5) * middle[2]), renderer.camera).pane(face)
    tinted = np.any(np.asarray(image) != 255, axis=-1)
    corners = renderer.camera.project(face)[:, :2]
    area = 0.5 * abs(np.linalg.det([corners[2] - corners[0], corners[3] - corners[1]]))
    around = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).sum()
    assert tinted.sum() == pytest.approx(area * before, abs=around)  # a pixel at its edges


@pytest.mark.parametrize(
    ("speed", "words"),
    [(1.0, "real time"), (0.5, "half speed"), (0.46, "0.46x speed"), (5.0, "5x speed")],
)
def test_a_film_says_its_speed(speed, words):
    assert overlay.speed_in_words(speed) == words
