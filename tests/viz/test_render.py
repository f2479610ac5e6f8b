"""Pictures: geometry of the projection, colours, determinism, files."""

import sys
from dataclasses import replace
from types import SimpleNamespace

import imageio.v3 as iio
import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.cli import run as show
from taichi_mps.engine.simulation.frame import Frame
from taichi_mps.io import vtu as export
from taichi_mps.viz import painter, render
from taichi_mps.viz.beads import Beads
from taichi_mps.viz.body import grains_of
from taichi_mps.viz.painter import Camera, Mesh, Painter

SIZE = {"width": 320, "height": 180}
RED, GREEN = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)


def snapshot(scene, **changes):
    start = mps.measure.still(scene.fluid, scene.spacing)
    return replace(start, **{key: np.broadcast_to(value, getattr(start, key).shape) for key, value in changes.items()})


@pytest.fixture(scope="module")
def body():
    ring = np.linspace(0, 2 * np.pi, 25)
    return mps.Scene(
        name="cone",
        material=mps.Bingham(),
        spacing=0.03,
        fluid=mps.fill(mps.Cone(0.1, 0.05, 0.3), 0.03),
        walls=(mps.Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)),),
        domain=((-0.5, -0.5, -0.1), (0.5, 0.5, 0.5)),
        outline=(np.column_stack([0.1 * np.cos(ring), 0.1 * np.sin(ring), 0 * ring]),),
    )


@pytest.fixture(scope="module")
def camera():
    corners = np.array([(x, y, z) for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
    return Camera((0.0, 1.0, 0.0), corners, 640, 360), corners


def draw(camera, x, colours, radius):
    return Painter(*camera, radius, relief=0.0).draw(Beads(np.array(x, float), np.array(colours), radius))


@pytest.mark.parametrize("centre", [(0.0, 0.0, 0.0), (0.7, -0.5, 0.6)])
def test_a_sphere_covers_the_disc_of_its_perspective_projection(camera, centre):
    radius = 0.3
    pixels, depth = draw(camera, [centre], [RED], radius)
    covered = pixels[..., 1] < 0.5 * 255 * painter.BACKGROUND[1]
    view = camera[0]
    across, up, ahead = (np.array(centre) - view.eye) @ view.axes.T
    # the outline of a sphere at (a, z): an ellipse of these half axes, along and across the direction from the middle
    away2 = across**2 + up**2
    along = view.focal * radius * np.sqrt(away2 + ahead**2 - radius**2) / (ahead**2 - radius**2)
    aside = view.focal * radius / np.sqrt(ahead**2 - radius**2)
    assert covered.sum() == pytest.approx(np.pi * along * aside, rel=0.02)
    rows, columns = np.nonzero(covered)
    column, row, _ = view.project([centre])[0]
    stretch = ahead**2 / (ahead**2 - radius**2)  # the middle of the ellipse lies a little further out
    assert columns.mean() + 0.5 == pytest.approx(320 + (column - 320) * stretch, abs=0.5)
    assert rows.mean() + 0.5 == pytest.approx(180 + (row - 180) * stretch, abs=0.5)
    assert depth[covered].min() == pytest.approx(ahead - radius, abs=0.05 * radius)


def test_scenes_beside_each_other_share_camera_and_range(body):
    wide = replace(body, fluid=body.fluid * [1.5, 1.0, 1.0], domain=((-0.8, -0.5, -0.1), (0.8, 0.5, 0.9)))
    fast = replace(wide, velocity=np.full(wide.fluid.shape, 9.0))
    one, other = (render.Renderer(scene, view="speed", beside=(body, fast), **SIZE) for scene in (body, fast))
    assert one.limits == other.limits == render.Renderer(fast, view="speed", **SIZE).limits
    np.testing.assert_array_equal(one.camera.eye, other.camera.eye)
    assert np.array_equal(one.low, other.low) and np.array_equal(one.high, other.high)
    assert render.Renderer(body, view="speed", **SIZE).limits != one.limits


def test_the_nearest_of_two_overlapping_spheres_wins_whatever_their_order(camera):
    near, far = (0.0, -0.2, 0.0), (0.1, 0.2, 0.0)
    for x, colours in (([near, far], [RED, GREEN]), ([far, near], [GREEN, RED])):
        pixels, _ = draw(camera, x, colours, 0.3)
        column, row = camera[0].project([near])[0, :2].astype(int)
        assert tuple(pixels[row, column]) == (255, 0, 0)
        column, row = camera[0].project([(0.37, 0.2, 0.0)])[0, :2].astype(int)
        assert tuple(pixels[row, column]) == (0, 255, 0)


NOTHING = np.zeros((0, 3))


@pytest.mark.parametrize("body", [None, Mesh(NOTHING, NOTHING, NOTHING, np.zeros((0, 3), int))])
def test_spheres_behind_or_around_the_eye_are_left_out_and_a_mesh_may_have_no_triangles(camera, body):
    eye = camera[0].eye
    body = body or Beads(np.array([eye, eye - (0.0, 1.0, 0.0)]), np.array([RED, RED]), 0.3)
    pixels, depth = Painter(*camera, 0.3, relief=0.0).draw(body)
    assert np.ptp(pixels.reshape(-1, 3), axis=0).max() == 0 and depth.min() > 1e8


def test_the_camera_frames_its_points():
    corners = np.array([(x, y, z) for x in (0.0, 3.0) for y in (-1.0, 0.0) for z in (0.0, 1.0)])
    frame = np.array((0.1, 0.2, 0.8, 0.9))
    for direction in ((0.0, 1.0, -0.3), (0.0, 0.0, -1.0), (1.0, 1.0, -1.0)):
        camera = Camera(direction, corners, 400, 300, frame)
        at = camera.project(corners)[:, :2] / (400, 300)
        assert np.all(at > frame[:2] - 1e-9) and np.all(at < frame[2:] + 1e-9)
        assert np.isclose(np.ptp(at, axis=0), frame[2:] - frame[:2]).any()  # one direction is filled


def test_the_body_is_grey_with_a_shadow_on_a_light_floor(body):
    renderer = render.Renderer(body, beads=True, **SIZE)
    beads = Beads(body.fluid, renderer.colours(snapshot(body)), 0.62 * body.spacing)
    pixels, depth = renderer.painter.draw(beads)
    shown = depth < 1e8
    assert 0.02 < shown.mean() < 0.3
    assert np.ptp(pixels[shown].mean(0)) < 12 and 80 < pixels[shown].mean() < 190
    floor = pixels[~shown].astype(int).sum(1)
    assert np.median(floor) > 3 * 190 and floor.min() < 3 * 150


@pytest.mark.parametrize(
    ("view", "changes", "colour"),
    [
        ("concrete", {}, render.CONCRETE),
        ("speed", {"u": (0.0, 0.0, -1.0)}, render.viridis(0.25)),
        ("pressure", {"p": 2e3}, render.viridis(0.5)),
        ("shear-rate", {"shear_rate": 4.0}, render.viridis(1.0)),
        ("yielded", {"yielded": True}, render.FLOWING),
        ("yielded", {"yielded": False}, render.RIGID),
        ("mix", {"mix": 5}, render.MIXES[1]),
    ],
)
def test_views_show_the_colours_of_their_values(body, view, changes, colour):
    renderer = render.Renderer(body, view=view, limits=(0.0, 4.0), **SIZE)
    found = renderer.colours(snapshot(body, **changes))
    np.testing.assert_allclose(found, np.tile(colour, (len(body.fluid), 1)), atol=1e-6)


def test_viridis_is_that_of_matplotlib():
    from matplotlib import colormaps

    t = np.linspace(0, 1, 101)
    np.testing.assert_allclose(render.viridis(t), colormaps["viridis"](t)[:, :3], atol=0.08)
    np.testing.assert_array_equal(render.viridis([-1.0, 2.0]), render.viridis([0.0, 1.0]))
    np.testing.assert_array_equal(render.viridis(np.nan), [0.5, 0.5, 0.5])


def test_ranges_come_from_the_scene(body):
    head = 9.81 * 0.27
    for view, expected in (("speed", 0.5 * np.sqrt(2 * head)), ("pressure", 2.3 * head), ("shear-rate", 10.0)):
        low, high = render.Renderer(body, view=view, **SIZE).limits
        assert low == 0.0 and 0.95 * expected < high < 1.6 * expected


def test_a_two_dimensional_scene_is_drawn_in_its_plane_between_its_walls():
    scene = mps.catalogue.build("dam_break", spacing=0.02, column_width=0.2)
    renderer = render.Renderer(scene, **SIZE)
    np.testing.assert_allclose(renderer.low, (0.0, 0.0, 0.0), atol=1e-12)
    np.testing.assert_allclose(renderer.high, (0.8, 0.0, 0.4))
    _, depth = renderer.painter.draw(Beads(render.embed(scene.fluid), np.ones((200, 3)), 0.62 * scene.spacing))
    rows, columns = np.nonzero(depth < 1e8)
    (left, bottom), (right, top) = renderer.camera.project([(0.0, 0.0, 0.0), (0.2, 0.0, 0.4)])[:, :2]
    assert (columns.min(), columns.max()) == pytest.approx((left, right), abs=3)
    assert (rows.min(), rows.max()) == pytest.approx((top, bottom), abs=3)
    assert renderer.draw(snapshot(scene), {"front_m": 0.2, "height_m": 0.4}).shape == (180, 320, 3)


def test_png_numbers_its_pictures_and_gif_reads_them(body, tmp_path):
    sim = SimpleNamespace(scene=body)
    frames, speed = render.png(tmp_path / "frames", **SIZE), render.png(tmp_path / "frames", view="speed", **SIZE)
    for k in range(3):
        sim.snapshot = lambda k=k: replace(snapshot(body), time=0.1 * k, x=body.fluid * (1, 1, 1 - 0.1 * k))
        sim.measures = lambda k=k: {"slump_m": 0.03 * k, "spread_m": 0.2}
        frames(sim)
        speed(sim)
    names = sorted(path.name for path in (tmp_path / "frames").iterdir())
    assert names == [f"{view}_{k:05d}.png" for view in ("frame", "speed") for k in range(3)]
    for source in (tmp_path / "frames", sorted((tmp_path / "frames").glob("speed*"))):
        render.gif(source, tmp_path / "run.gif", fps=5)
        pictures = iio.imread(tmp_path / "run.gif", index=None)
        assert pictures.shape[:3] == (3, 360, 640)
        assert iio.immeta(tmp_path / "run.gif")["duration"] == 200
    with pytest.raises(mps.SceneError, match="frames = .* holds no pictures"):
        render.gif(tmp_path, tmp_path / "none.gif")
    with pytest.raises(mps.SceneError, match="must end in .gif; 'taichi-mps render RUN --film' writes an MP4"):
        render.gif(tmp_path / "frames", tmp_path / "run.mp4")


# ---- triangles and the smooth surface ----------------------------------------------------------------------------
BALL = 0.3


def triangles_of(rows, columns):
    """Triangles (m, 3) between the points of a grid, two in each of its cells."""
    k = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = (part.ravel() for part in (k[:-1, :-1], k[:-1, 1:], k[1:, 1:], k[1:, :-1]))
    return np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)])


def test_a_ball_of_triangles_is_drawn_as_a_sphere(camera):
    centre, colour = np.array([(0.4, 0.1, -0.2)]), np.array([(0.7, 0.5, 0.3)])
    floor = -0.8
    polar, around = np.meshgrid(np.linspace(0.0, np.pi, 49), np.linspace(0.0, 2.0 * np.pi, 97))
    normals = np.stack([np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)], -1)
    normals = normals.reshape(-1, 3)
    mesh = Mesh(centre + BALL * normals, np.tile(colour, (len(normals), 1)), normals, triangles_of(97, 49))
    bodies = Beads(centre, colour, BALL), mesh
    (sphere, far), (mesh, near) = (Painter(*camera, BALL, floor).draw(body) for body in bodies)
    assert 0.02 < (far < 1e8).mean() < 0.5
    differ = (far < 1e8) != (near < 1e8)
    assert differ.sum() <= 0.02 * (far < 1e8).sum()  # an outline of 96 corners
    both = (far < 1e8) & (near < 1e8)
    inside = both & (far < np.quantile(far[both], 0.8))  # not the rim, which is steep
    assert np.abs(far - near)[inside].max() < 0.05 * BALL  # of one sample of the pixel
    away = np.abs(sphere.astype(int) - mesh).max(-1)
    assert away[inside].max() <= 4 and np.mean(away > 4) < 0.005  # light, shadow and floor are the same


def test_triangles_that_share_edges_leave_no_hole_and_cover_their_area(camera):
    x, z = np.meshgrid(np.linspace(-0.5, 0.7, 41), np.linspace(-0.6, 0.4, 37))
    points = np.stack([x, 0 * x, z], -1).reshape(-1, 3)
    shades = (points[:, :1] + 0.5) / 1.2 * np.ones(3)  # dark at the left, light at the right
    mesh = Mesh(points, shades, np.tile((0, -1.0, 0), (len(points), 1)), triangles_of(37, 41))
    pixels, depth = Painter(*camera, 0.1, relief=0.0).draw(mesh)
    (left, bottom), (right, top) = camera[0].project(points[[0, -1]])[:, :2]
    rows, columns = (np.arange(round(low) + 1, round(high) - 1) for low, high in ((top, bottom), (left, right)))
    inner = depth[np.ix_(rows, columns)]
    np.testing.assert_allclose(inner, -camera[0].eye[1], rtol=1e-5)
    assert (depth < 1e8).sum() == pytest.approx((right - left) * (bottom - top), rel=0.01)
    shown = pixels[rows[len(rows) // 2], columns].mean(-1)
    np.testing.assert_allclose(shown, 255 * (columns + 0.5 - left) / (right - left), atol=2)


def test_a_scene_in_the_plane_has_no_surface_and_shows_particles(tmp_path):
    plane = mps.catalogue.build("dam_break", spacing=0.05)
    assert render.Renderer(plane, **SIZE).beads
    with pytest.raises(mps.SceneError, match="surface: the scene is a plane one; must have three dimensions"):
        export.vtu([Frame(plane, snapshot(plane))], tmp_path / "vtu", smooth=True)
    assert not list(tmp_path.iterdir())


def test_pictures_that_cannot_be_made_are_refused_before_any_is(body, tmp_path, monkeypatch):
    replay, options = (
        [Frame(body, snapshot(body))],
        SimpleNamespace(view="concrete", beads=False, cut=False),
    )
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(mps.SceneError, match=r"film: needs imageio-ffmpeg: pip install 'taichi-mps\[film\]'"):
        show.redraw([iter(replay)], tmp_path, "", options, film=True)
    assert not list(tmp_path.iterdir())
    (tmp_path / "frames-x").write_text("mine")
    with pytest.raises(mps.SceneError, match="frames-x cannot be written"):
        show.redraw([iter(replay)], tmp_path, "-x", options)
    with pytest.raises(mps.SceneError, match="out = .*frames-x: cannot be written .*; choose another folder"):
        export.vtu(replay, tmp_path / "frames-x")
    assert [path.name for path in tmp_path.iterdir()] == ["frames-x"]


def test_a_film_tells_its_mean_speed_where_steps_are_longer_than_the_interval(body, tmp_path, monkeypatch):
    """Three pictures of 0.09 s at ten a second: 0.45 of the speed, whatever interval was asked for."""
    told, options = [], SimpleNamespace(view="concrete", beads=True, cut=False)
    monkeypatch.setattr(render, "with_film_speed", lambda picture, every, fps: told.append(every * fps) or picture)
    replay = [Frame(body, replace(snapshot(body), time=time)) for time in (0.0, 0.03, 0.09)]
    assert show.redraw([iter(replay)], tmp_path, "", options)["pictures"] == 3
    assert told == pytest.approx([0.45] * 3)


def test_a_surface_has_the_camera_the_range_and_the_colours_of_the_particles(body):
    spheres, smooth = (render.Renderer(body, view="pressure", beads=on, **SIZE) for on in (True, False))
    assert spheres.limits == smooth.limits
    np.testing.assert_array_equal(spheres.camera.eye, smooth.camera.eye)
    state = snapshot(body, p=0.5e3 * smooth.limits[1])
    expected = render.viridis(0.5)
    for pixels in (spheres.draw(state), smooth.draw(state)):
        seen = np.median(pixels[80:120, 140:170].reshape(-1, 3), axis=0)  # on the cone; shaded, but of the same hue
        np.testing.assert_allclose(seen / seen.max(), expected / expected.max(), atol=0.05)
    assert np.array_equal(smooth.draw(state), smooth.draw(state))
    fields = ("x", "u", "p", "shear_rate", "yielded", "density_ratio", "size", "mix", "grain")
    nothing = replace(state, **{name: getattr(state, name)[:0] for name in fields})
    assert smooth.draw(nothing).shape == (180, 320, 3)  # before the first layer of an inlet


# ---- grains ------------------------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def stones():
    """A block, periodic across: grains before its middle plane, beyond it but reaching through, and over its period."""
    return mps.Scene(
        name="block",
        material=mps.Bingham(),
        spacing=0.01,
        fluid=mps.fill(mps.Box((-0.2, -0.1, 0.0), (0.2, 0.1, 0.2)), 0.01),
        domain=((-0.5, -0.1, -0.1), (0.5, 0.1, 0.5)),
        periodic=(False, True, False),
        walls=(mps.Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)),),
        grains=mps.Grains(diameter=0.06, centres=[(-0.1, -0.05, 0.1), (0.1, 0.01, 0.1), (0.0, 0.1, 0.1)]),
    )


def moved(scene, by=(0.0, 0.0, 0.0)):
    """Snapshot of the scene with its grains, all moved [m] and put back into the period."""
    x = scene.fluid + by
    x[:, 1] = (x[:, 1] + 0.1) % 0.2 - 0.1
    return replace(snapshot(scene), x=x, grain=scene.grain_places[0])


def test_grains_are_where_and_as_large_as_their_particles_and_no_period_counts_as_way(stones):
    x, radii, kinds, way = grains_of(stones, moved(stones, (0.03, 0.07, 0.04)))
    off = x - stones.grain_places[1] - (0.03, 0.07, 0.04)
    np.testing.assert_allclose(off - (0.0, 0.2, 0.0) * np.round(off / 0.2), 0.0, atol=1e-12)
    np.testing.assert_allclose(
        radii, 0.01 * (123.0 * 0.75 / np.pi) ** (1 / 3)
    )  # 123 points of a lattice in a ball of 3
    np.testing.assert_allclose(way + kinds, 0.05, atol=1e-12)


def test_grains_are_seen_in_the_mortar_or_beyond_the_plane_that_cuts_it_open(stones):
    centres = stones.grain_places[1]
    for cut, known in ((False, [True, True, True]), (True, [False, True, False])):
        renderer = render.Renderer(stones, cut=cut, **SIZE)
        columns, rows = renderer.camera.project(centres)[:, :2].astype(int).T
        red, _, blue = renderer.draw(moved(stones)).astype(int)[rows, columns].T
        assert (red - blue > 20).tolist() == known, red - blue
    ways = render.Renderer(stones, cut=True, view="distance", limits=(0.0, 0.2), **SIZE)
    column, row = ways.camera.project(centres + (0.1, 0.0, 0.0))[1, :2].astype(int)
    seen, half = ways.draw(moved(stones, (0.1, 0.0, 0.0)))[row, column], render.viridis([0.5])[0]
    np.testing.assert_allclose(seen / seen.max(), half / half.max(), atol=0.05)
    with pytest.raises(mps.SceneError, match="the scene has no grains; must be left out"):
        render.Renderer(replace(stones, grains=None), view="distance")
