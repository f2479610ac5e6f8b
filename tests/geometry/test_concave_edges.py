"""Concave edges of solids: faces found from the distances alone, and sums in front of them against those of planes."""

from dataclasses import replace

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.engine.boundaries.sampled import search_faces
from taichi_mps.engine.boundaries.surfaces import FAR
from taichi_mps.engine.geometry.concave_edges import find_concave_edges
from tests.support.rigs import L0, Rig, cloud

CELL, REACH = 0.5 * L0, 1.6 * L0


def turned(angle):
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def upright(d, seed):
    """d normals at right angles, in any direction."""
    return np.linalg.qr(np.random.default_rng(seed).normal(size=(d, d)))[0]


@pytest.mark.parametrize(
    "normals",
    [
        np.eye(2),
        turned(0.5),
        np.array([(1.0, 0.0), (-0.5, 0.75**0.5)]),  # a wedge of 60 degrees
        np.eye(3),
        upright(3, seed=3),
    ],
    ids=["edge", "turned", "wedge", "corner", "turned corner"],
)
def test_all_faces_of_an_inner_edge_are_found_where_they_are(normals):
    """At an inner edge or corner all faces and no others are found, with their distances to rounding at nine places in
    ten and within a twentieth of a cell at all."""
    d, point = len(normals[0]), np.array((0.01, 0.013, 0.02))[: len(normals[0])]
    solid = mps.Solid.of(lambda x: np.min((x - point) @ normals.T, axis=1), (-0.8,) * d, (0.8,) * d, CELL)
    number, planes = find_concave_edges(solid.values, CELL, REACH, search_faces)
    x = point + np.random.default_rng(1).uniform(-0.4, 0.4, (4000, d))
    z = (x - point) @ normals.T
    x, z = (part[(z.min(1) > 0.1 * L0) & (z.min(1) < REACH)] for part in (x, z))
    first = np.floor((x + 0.8) / CELL).astype(int)
    around = first[:, None] + np.array(list(np.ndindex(*(2,) * d)))
    node = around[np.arange(len(x)), solid.values[tuple(around.T)].T.argmax(1)]
    several = (z < 0.99 * REACH).sum(1) > 1
    row = number[tuple(node.T)]
    assert several.sum() > 50 and np.mean(row[several] >= 0) > 0.99
    seen = row >= 0
    table, offset = planes[row[seen]], (x + 0.8 - node * CELL)[seen]
    found = np.where(np.isinf(table[..., 0]), np.inf, table[..., 0] + np.einsum("ika,ia->ik", table[..., 1:], offset))
    found[found > 0.99 * REACH] = np.inf
    wanted = np.where(z[seen] > 0.99 * REACH, np.inf, z[seen])
    found, wanted = np.sort(found), np.sort(wanted)[:, : found.shape[1]]
    assert np.array_equal(np.isinf(found), np.isinf(wanted))
    there = np.isfinite(found)
    error = np.abs(found[there] - wanted[there])
    assert error.max() < 0.05 * CELL and np.mean(error < 1e-9) > 0.9


BARE = {
    "ball": lambda x: np.linalg.norm(x, axis=1) - 0.12,
    "pipe": lambda x: 0.33 - np.linalg.norm(x[:, :2], axis=1),
    "cube": lambda x: (
        np.linalg.norm(np.maximum(np.abs(x) - 0.2, 0.0), axis=1) + np.minimum(0.0, (np.abs(x) - 0.2).max(1))
    ),
    "plate": lambda x: np.abs(x[:, 0]) - 0.6 * CELL,
}


@pytest.mark.parametrize("shape", BARE)
def test_round_walls_outer_edges_and_plates_have_one_face(shape):
    solid = mps.Solid.of(BARE[shape], (-0.6,) * 3, (0.6,) * 3, CELL)
    number, planes = find_concave_edges(solid.values, CELL, REACH, search_faces)
    assert number.max() == -1 and planes.shape[:2] == (0, 1)


def test_a_grid_coarser_than_the_reach_has_no_inner_edges():
    """A cell larger than the reach has no inner edges, since no place is near enough to a corner to see its other
    face."""
    x, y = np.meshgrid(np.arange(6.0), np.arange(6.0), indexing="ij")
    number, planes = find_concave_edges(np.minimum(x, y) - 1.0, 1.0, 0.5, search_faces)
    assert (number == -1).all() and len(planes) == 0


def test_a_round_tank_has_its_mantle_and_its_floor():
    solid = mps.Solid.of(
        lambda x: np.minimum(0.6 - np.hypot(x[:, 0], x[:, 1]), x[:, 2]), (-0.8, -0.8, -0.2), (0.8, 0.8, 0.5), CELL
    )
    number, planes = find_concave_edges(solid.values, CELL, REACH, search_faces)
    assert planes.shape[1] == 2
    nodes = np.argwhere(number >= 0)
    x = np.array(solid.low) + CELL * nodes
    upward = np.sort(np.abs(planes[number[number >= 0], :, 3]), axis=1)
    assert np.abs(upward - (0.0, 1.0)).max() < 0.05
    r = np.hypot(x[:, 0], x[:, 1])
    exact = np.sort(np.column_stack([0.6 - r, x[:, 2]]))  # the mantle as planes: within their arc over a few cells
    assert np.abs(np.sort(planes[number[number >= 0], :, 0]) - exact).max() < 0.5 * CELL


TANK = np.array([(-0.35, -0.35), (0.35, -0.35), (0.35, 0.35), (-0.35, 0.35)]) @ turned(0.4).T
BAY = np.array([(-0.4, -0.35), (0.4, -0.35), (0.2, 0.0), (-0.4, 0.35)])  # 90, 60, 150 and 60 degrees


def sampled(corners, **keywords):
    return mps.Solid.of(lambda x: -mps.polygon_distance(x, corners), (-0.8,) * 2, (0.8,) * 2, CELL, **keywords)


BALL = mps.Solid.of(BARE["ball"], (-0.6,) * 3, (0.6,) * 3, CELL)
SIDES = np.roll(TANK, -1, axis=0) - TANK
NORMALS = np.column_stack([-SIDES[:, 1], SIDES[:, 0]]) / np.linalg.norm(SIDES, axis=1)[:, None]
PLANES = tuple(mps.Plane(tuple(p), tuple(n)) for p, n in zip(TANK, NORMALS, strict=True))


def between(planes):
    """A solid: what lies behind any of these planes."""
    return mps.Solid.of(lambda x: np.min([plane.distance(x) for plane in planes], 0), (-0.8,) * 2, (0.8,) * 2, CELL)


@pytest.fixture(scope="module")
def rigged():
    """Particles in a tank, and its forces, n, packing and neighbours, given its walls."""
    rng = np.random.default_rng(4)
    x = mps.lattice((-0.35, -0.35), (0.35, 0.35), L0)
    x = (x + rng.uniform(-0.2, 0.2, x.shape) * L0) @ turned(0.4).T
    T = rng.standard_normal((len(x), 2, 2))

    def sums(walls):
        rig = Rig(x, planes=walls)
        sums = [getattr(rig.gradient, name).to_numpy() for name in ("n", "packing", "neighbour_count")]
        return rig.forces(T), *sums, rig.x

    return sums, sums(PLANES)


@pytest.mark.parametrize(
    "walls",
    [(sampled(TANK),), (PLANES[0], between(PLANES[1::2]), PLANES[2])],
    ids=["one solid", "sides between planes"],
)
def test_a_tank_as_a_solid_acts_as_its_planes(walls, rigged):
    """In a solid tank turned against its grid forces are those of planes to rounding, and n, packing and neighbours
    within 2 %, the interpolation of the tables; one face alone, or overlapping half-spaces, would miss a tenth and
    more."""
    sums, (forces, *exact, x) = rigged
    found_forces, *found, _x = sums(walls)
    corner = np.sort([plane.distance(x) for plane in PLANES], axis=0)[1] < L0
    assert corner.sum() >= 4
    assert np.abs(found_forces - forces).max() < 1e-9 * np.abs(forces).max()
    for one, other in zip(exact, found, strict=True):
        assert np.abs(other / one - 1.0).max() < 0.02


@pytest.mark.long
def test_a_tank_with_friction_pushes_with_all_its_faces(rigged, monkeypatch):
    """Before anything slips a solid tank acts as planes with friction, except in corners, where only the nearest face
    has friction and the forces are wrong by a fifth of the other faces' part."""
    sums, _rough = rigged
    law = mps.Friction(yield_value=10.0)
    exact, *_, x = sums(tuple(replace(plane, friction=law) for plane in PLANES))
    corner = np.sort([plane.distance(x) for plane in PLANES], axis=0)[1] < REACH
    errors = [sums((sampled(TANK, friction=law),))[0] - exact]
    monkeypatch.setattr(
        "taichi_mps.engine.boundaries.sampled.find_concave_edges",
        lambda values, *_: (np.full(values.shape, -1), np.zeros((0, 1, 3))),
    )
    errors.append(sums((sampled(TANK, friction=law),))[0] - exact)
    found, alone = (np.linalg.norm(error[corner]) for error in errors)
    assert found < 0.2 * alone


@pytest.mark.parametrize("solid", [sampled(BAY), BALL], ids=["bay", "ball"])
def test_force_is_the_negative_transpose_of_the_gradient_at_any_angle(solid):
    x = cloud((10, 10) if solid is not BALL else (6, 6, 6))
    rig = Rig(x[solid.distance(x) > 0.1 * L0], planes=(solid,))
    if solid is not BALL:  # some particles are before two of its faces
        z = rig.gradient.walls.surfaces[0].z.to_numpy()
        assert (np.sum(z < 0.9 * REACH, axis=1) == 2).sum() > 3 and z[:, 1].max() == FAR
    rng, d = np.random.default_rng(6), rig.x.shape[1]
    assert rig.imbalance(rng.standard_normal(rig.x.shape), rng.standard_normal((len(rig.x), d, d))) < 1e-12
