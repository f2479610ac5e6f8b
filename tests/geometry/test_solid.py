"""Walls of any shape: the sampled distance against exact surfaces, bad grids, thin plates, no leak."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import taichi_mps as mps
from taichi_mps.viz import render
from tests.support.rigs import L0, RE, Probe, Rig, cloud
from tests.support.scenes import ran

PIPE = mps.Cylinder((0.05, 0.0, 0.02), 0.33, axis=(1.0, 2.0, -2.0))
WATER = mps.Newtonian(density=1000.0, viscosity=1e-3)
CONCRETE = mps.Bingham(density=2300.0, plastic_viscosity=50.0, yield_value=300.0)


def seen(wall, x, time=0.0):
    """Distances and normals of a wall at x, as kernels see them."""
    probe = Probe((wall,), x, time=time)
    return probe.z.to_numpy(), probe.normal.to_numpy()


@pytest.mark.parametrize("velocity, turn", [((0.3, 0.0, 0.0), 0.0), ((0.0,) * 3, 0.7)], ids=["travels", "turns"])
def test_a_flat_solid_is_exact_wherever_it_has_moved_to(velocity, turn):
    """A linear distance is interpolated to rounding by the kernels and by NumPy, also after the solid has travelled or
    turned; its surface moves as the solid does."""
    normal, pivot, axis = np.array([1.0, 2.0, -2.0]) / 3.0, (0.1, -0.2, 0.0), (0.0, 0.0, 1.0)
    moves = {"velocity": velocity, "angular_velocity": turn, "pivot": pivot, "axis": axis}
    solid = mps.Solid.of(lambda x: x @ normal - 0.1, (-1.0,) * 3, (1.0,) * 3, 0.07, **moves)
    x = np.random.default_rng(1).uniform(-0.7, 0.7, (60, 3))
    for time in (0.0, 0.2):
        probe = Probe((solid,), x, time=time)
        turned = Rotation.from_rotvec(turn * time * np.array(axis)).apply(normal)
        exact = (x - pivot - time * np.array(velocity)) @ turned + normal @ pivot - 0.1
        foot = x - exact[:, None] * turned
        known = {"z": exact, "normal": turned, "velocity": velocity + np.cross(turn * np.array(axis), foot - pivot)}
        for name, values in known.items():
            np.testing.assert_allclose(getattr(probe, name).to_numpy() - values, 0.0, atol=1e-12)
        np.testing.assert_allclose(solid.distance(x, time), exact, atol=1e-12)
    beyond = np.array([[1.5, 0.0, 0.0]])
    assert np.isinf(solid.distance(beyond)[0]) and seen(solid, beyond)[0][0] > 1e8


@pytest.mark.long
def test_a_sampled_pipe_comes_near_the_exact_one_with_second_order():
    """Near the wall the distance to a sampled pipe is within about cell^2/(4 R), and its normal within cell/R."""
    x = np.random.default_rng(3).uniform(-0.3, 0.3, (300, 3))
    x = x[np.abs(PIPE.distance(x)) < RE]
    errors = []
    for cell in (0.1, 0.05):
        z, n = seen(mps.Solid.of(PIPE.distance, (-0.6,) * 3, (0.6,) * 3, cell), x)
        exact = seen(PIPE, x)[1]
        errors.append((np.abs(z - PIPE.distance(x)).max(), np.linalg.norm(n - exact, axis=1).max()))
        r = 0.33 - PIPE.distance(x).max()  # curvature is largest where the radius is smallest
        assert errors[-1][0] < cell**2 / (2.0 * r) and errors[-1][1] < cell / r
    assert errors[1][0] < 0.4 * errors[0][0]


@pytest.mark.parametrize(("dimension", "across"), [(2, 10), (3, 8)])
def test_what_a_solid_hides_is_what_lies_beyond_it(dimension, across):
    """A pair of particles around a bar is hidden where the point that divides their connection in the ratio of their
    distances lies in the bar. Most pairs are not tested: far from the bar none can be hidden."""
    bar = mps.Solid.of(
        lambda x: np.hypot(x[:, 0] - 0.01, x[:, -1] + 0.02) - 0.3 * L0, (-0.7,) * dimension, (0.7,) * dimension, 0.02
    )
    x = cloud((across,) * dimension)
    x = x[bar.distance(x) > 0.05 * L0]
    rig = Rig(x, planes=(bar,))
    z, inside = bar.distance(rig.x), np.zeros((len(x), len(x)), bool)
    for i, row in enumerate(inside):
        middle = (z[i] * rig.x + z[:, None] * rig.x[i]) / (z[i] + z)[:, None]
        row[:] = bar.distance(middle) < 0.0
    first, other = rig.neighbors.row_start.to_numpy(), rig.neighbors.column.to_numpy()
    weight, hidden = rig.gradient.weight_r2.to_numpy(), 0
    for i in range(len(x)):
        for k in range(first[i], first[i + 1]):
            assert (weight[k] == 0.0) == inside[i, other[k]]
            hidden += weight[k] == 0.0
    assert hidden > 5


def tank(material, walls, width=1.0, depth=0.6, **keywords):
    return mps.Scene(
        name="tank",
        material=material,
        spacing=0.05,
        fluid=mps.fill(mps.Box((0.0, 0.0), (width, depth)), 0.05),
        walls=walls,
        domain=((-0.5, -0.5), (3.0, 2.0)),
        **keywords,
    )


@pytest.mark.long
def test_a_thin_plate_holds_a_column():
    """A plate half a spacing thick holds a column in a box: after 0.5 s no particle is on its other side."""
    l0 = 0.05

    def distance(x):
        return np.abs(x[:, 0] - 1.0 - 0.25 * l0) - 0.25 * l0

    gate = mps.Solid.of(distance, (0.7, -0.4), (1.4, 1.9), 0.25 * l0, slip=True)
    scene = tank(CONCRETE, (*mps.box_planes((0.0, 0.0), (2.5, 1.0), slip=True), gate))
    s = ran(scene, until=0.5).snapshot()
    assert s.x[:, 0].max() < 1.0
    assert abs(s.x[:, 1].max() + 0.5 * l0 - 0.6) < 1.5 * l0


@pytest.mark.long
def test_nothing_leaks_where_walls_meet():
    """A block that collapses in a tilted box with a step, one solid, does not leak at inner and outer edges and
    corners."""
    tilt = 0.3
    Q = np.array([[np.cos(tilt), np.sin(tilt)], [-np.sin(tilt), np.cos(tilt)]])
    box = np.array([(0.0, 0.0), (2.0, 0.0), (2.0, 1.2), (0.0, 1.2)])
    step = np.array([(1.3, -0.5), (3.0, -0.5), (3.0, 0.2), (1.3, 0.2)])

    def distance(x):
        return np.minimum(-mps.polygon_distance(x @ Q, box), mps.polygon_distance(x @ Q, step))

    solid = mps.Solid.of(distance, (-0.3, -1.0), (2.6, 1.5), 0.025)
    scene = tank(WATER, (solid,))
    scene = replace(scene, fluid=scene.fluid @ Q.T, domain=((-0.5, -1.2), (3.0, 2.0)))
    sim = ran(scene, until=0.6)
    s = sim.snapshot()
    assert sim.walls.surfaces[0].faces == 2
    assert solid.distance(s.x).min() > 0.0 and distance(s.x).min() > 0.0
    assert len(s.x) == len(scene.fluid) and (s.x @ Q)[:, 0].max() > 1.3


def grid(values, **keywords):
    return mps.Solid(values, **({"low": (0.0, 0.0), "cell": 0.1} | keywords))


def turning(axis):
    """A solid in three dimensions that turns about this axis."""
    values, origin = np.broadcast_to(np.eye(4) - 0.5, (4, 4, 4)), (0.0, 0.0, 0.0)
    return grid(values, low=origin, angular_velocity=1.0, pivot=origin, axis=axis)


def sampled(cell):
    return mps.Solid.of(lambda x: x[:, 0], (0.0, 0.0), (1.0, 1.0), cell)


GOOD = np.eye(4) - 0.5


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: grid(np.ones((4, 4))), "no node of the grid lies inside the solid"),
        (lambda: grid(np.ones(4)), r"values = .* m: must be finite numbers of the shape \(n, n\) or \(n, n, n\)"),
        (lambda: grid(np.full((4, 4), np.nan)), "must be finite"),
        (lambda: grid(np.diag([-1.0, 1.0, 1.0, 1.0])), "the distance changes by 10 m per metre"),
        (lambda: grid(GOOD, low=(np.nan, 0.0)), r"low = .* m: must be finite numbers of the shape \(2,\) or \(3,\)"),
        (lambda: grid(GOOD, velocity=(0.0, 0.0, 1.0)), "velocity = .* must be 2 finite numbers"),
        (lambda: grid(GOOD, cell=np.nan), "cell = nan m: must be a finite number"),
        (lambda: grid(GOOD, angular_velocity=1.0), "1 rad/s of a solid: needs a pivot, and an axis in 3-D"),
        (lambda: turning(None), "needs a pivot, and an axis in 3-D"),
        (lambda: turning((0.0, 0.0, 0.0)), "needs a pivot, and an axis in 3-D"),
        (lambda: sampled(0.0), "cell = 0.0 m: must be greater than 0 m"),
        (lambda: sampled(1e-300), "cell = 1e-300 m: must be at least 1e-12 m"),
    ],
)
def test_a_bad_grid_is_refused(make, message):
    with pytest.raises(mps.SceneError, match=message):
        make()


def test_the_section_is_where_the_distance_is_zero():
    """The section of a cylinder and of a sphere cut off its middle are circles within cell^2/(4 R), with their
    circumference."""
    for d, radius in ((2, 0.3), (3, (0.3**2 - 0.1**2) ** 0.5)):
        ball = mps.Solid.of(lambda x: np.linalg.norm(x, axis=1) - 0.3, (-0.5,) * d, (0.5,) * d, 0.02)
        lines = np.array(ball.section(0.1))
        ends = lines[..., [0, -1]]
        assert lines.shape[1:] == (2, d)
        assert np.abs(np.linalg.norm(ends, axis=2) - radius).max() < 0.02**2 / (4.0 * radius)
        assert np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum() == pytest.approx(2.0 * np.pi * radius, rel=0.01)


def test_a_solid_is_drawn_where_it_has_travelled_to():
    ball = mps.Solid.of(lambda x: np.linalg.norm(x - (1.6, 0.4), axis=1) - 0.2, (1.2, 0.0), (2.0, 0.8), 0.05)
    pictures = []
    for velocity in (None, (0.0, 1.0)):
        scene = tank(WATER, (*mps.box_planes((0.0, 0.0), (2.5, 1.0)), replace(ball, velocity=velocity)))
        still = replace(mps.measure.still(scene.fluid, 0.05), time=0.3)
        pictures.append(render.Renderer(scene, width=320, height=180).draw(still))
    assert np.any(pictures[0] != pictures[1], axis=2).sum() > 50


def test_thickness_is_that_of_a_bar_wherever_its_axis_lies():
    """On a grid of 2.5 cells across a bar its thickness is never more than the diameter, and at most a tenth less."""
    for place in np.random.default_rng(1).uniform(0.0, 0.004, (20, 2)):
        bar = mps.Solid.of(lambda x, p=place: np.linalg.norm(x - p, axis=1) - 0.005, (-0.02,) * 2, (0.02,) * 2, 0.004)
        assert 0.009 < bar.thickness <= 0.01 + 1e-12
    plate = mps.Solid.of(lambda x: np.abs(x[:, 2] - 0.0123) - 0.03, (-0.05,) * 3, (0.05,) * 3, 0.01)
    assert plate.thickness == pytest.approx(0.06)


@pytest.mark.parametrize("nodes", [1, 20, 10_000])
@pytest.mark.parametrize("shape", [(12, 9), (6, 5, 7)])
def test_the_steepest_slope_is_that_of_brute_force_however_thin_the_slabs(monkeypatch, shape, nodes):
    """At a node each axis counts with the steeper of its two sides; the largest length of these over all nodes."""
    monkeypatch.setattr("taichi_mps.engine.geometry.solid.NODES_PER_SLAB", nodes)
    values = np.random.default_rng(3).uniform(-0.7, 0.7, shape)
    cell, steepest = 0.5, 0.0
    values *= cell
    for node in np.ndindex(*shape):
        squares = 0.0
        for axis in np.eye(len(shape), dtype=int):
            sides = [tuple(node + side * axis) for side in (-1, 1)]
            inside = [k for k in sides if all(0 <= at < n for at, n in zip(k, shape, strict=True))]
            squares += max(abs(values[k] - values[node]) / cell for k in inside) ** 2
        steepest = max(steepest, squares**0.5)
    assert mps.Solid(values, (0.0,) * len(shape), cell).steepest == pytest.approx(steepest, rel=1e-12)
