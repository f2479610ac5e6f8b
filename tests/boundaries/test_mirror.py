"""Half and quarter models: the body unfolded at the mirror planes, the sums beside them, and runs against the whole
model."""

from dataclasses import replace

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.viz import render, view_volume
from tests.support.rigs import L0, Rig, cloud
from tests.support.scenes import ran

WEST = mps.Plane((0.0, 0.0), (1.0, 0.0), mirror=True)
FLOOR = mps.Plane((0.0, 0.0), (0.0, 1.0))
EAST_3D = mps.Plane((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), mirror=True)
NORTH_3D = mps.Plane((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), mirror=True)
FLOOR_3D = mps.Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))


def scene(fluid, walls, **keywords):
    d = fluid.shape[1]
    settings = {"material": mps.Bingham(), "spacing": L0, "domain": ((-2.0,) * d, (2.0,) * d)} | keywords
    return mps.Scene("body", fluid=fluid, walls=walls, **settings)


def moving(x):
    rng = np.random.default_rng(5)
    scalars = rng.uniform(0.0, 1.0, (3, len(x)))
    return mps.measure.Snapshot(
        0.3, L0, x, rng.normal(size=x.shape), *scalars[:2], scalars[2] > 0.5, scalars[2], 0.0 * x[:0]
    )


# ---- the body behind the planes -------------------------------------------------------------------------------
def test_a_quarter_unfolds_to_the_four_quarters():
    """Unfolding mirrors positions and velocities at the axes exactly: tangential parts stay, normal parts change
    sign."""
    x = cloud((4, 4, 3)) + 1.0
    part = moving(x)
    whole = scene(x, (FLOOR_3D, EAST_3D, NORTH_3D), domain=((-1.0,) * 3, (3.0,) * 3)).unfold(part)
    signs = np.array([(1.0, 1.0, 1.0), (-1.0, 1.0, 1.0), (1.0, -1.0, 1.0), (-1.0, -1.0, 1.0)])
    for k, sign in enumerate(signs):
        rows = slice(k * len(x), (k + 1) * len(x))
        assert np.array_equal(whole.x[rows], sign * x) and np.array_equal(whole.u[rows], sign * part.u)
        for name in ("p", "shear_rate", "yielded", "density_ratio"):
            assert np.array_equal(getattr(whole, name)[rows], getattr(part, name))
    assert len(whole.x) == 4 * len(x) and (whole.time, whole.spacing) == (part.time, part.spacing)
    assert np.allclose(whole.u.sum(0), [0.0, 0.0, 4.0 * part.u[:, 2].sum()], atol=1e-12)  # momentum


def test_a_tilted_plane_reflects_distances():
    normal = np.array([0.6, 0.8])
    s = moving(cloud((5, 5)) + 2.0)
    whole = mps.measure.mirrored(s, (1.0, 0.5), normal)
    n = len(s.x)
    height = (whole.x - (1.0, 0.5)) @ normal
    assert np.allclose(height[n:], -height[:n], atol=1e-12)
    assert np.allclose((whole.x[n:] - s.x) @ (-0.8, 0.6), 0.0, atol=1e-12)
    assert np.allclose(whole.u[n:] @ normal, -s.u @ normal, atol=1e-12)
    assert np.allclose(np.linalg.norm(whole.u[n:], axis=1), s.speed, atol=1e-12)


# ---- the lattice ----------------------------------------------------------------------------------------------


def test_no_particle_starts_on_a_mirror_plane():
    """Where the lattice of the whole cone has particles on a mirror plane, its half and quarter take a lattice without
    them."""
    assert np.any(np.abs(mps.slump_cone(spacing=0.02).fluid[:, 0]) < 1e-9)
    assert mps.slump_cone(spacing=0.02, model="quarter").fluid[:, :2].min() == pytest.approx(0.01)
    box = mps.fill(mps.Box((-0.15, 0.0), (0.15, 0.1)), 0.02, (WEST,))
    assert box[:, 0].min() == pytest.approx(0.01) and box[:, 1].min() == pytest.approx(0.01)
    shifted = mps.fill(mps.Box((-0.15, 0.0), (0.15, 0.1)), 0.02, (replace(WEST, point=(0.055, 0.0)),))
    assert shifted[:, 0].min() == pytest.approx(0.065)


# ---- the fit and the sums beside a plane ----------------------------------------------------------------------
@pytest.fixture(scope="module")
def rigs():
    """A disordered cloud right of the plane x = 0, on no floor, and the same with its images."""
    x = cloud((6, 7)) + (0.31, 0.0)
    x = x[x[:, 0] > 0.1 * L0]
    return Rig(x, planes=(WEST,)), Rig(np.vstack([x, x * (-1.0, 1.0)]))


def on_the_right(rig, values):
    """Values of the particles right of the plane, ordered by position."""
    right = np.flatnonzero(rig.x[:, 0] > 0.0)
    return values[right[np.lexsort(rig.x[right].T)]]


def test_symmetric_linear_fields_have_the_gradient_of_the_whole(rigs):
    """The gradient of u_x = a x, u_y = b + c y is exact on any particles, in the half and in the whole model."""
    exact = np.diag([0.7, -0.4])
    for rig in rigs:
        assert np.abs(rig.gradients(rig.x @ exact + (0.0, 0.2))[rig.healthy] - exact).max() < 1e-12


def test_forces_are_those_of_the_whole_far_from_the_plane_and_never_along_it(rigs):
    """Under a stress without shear the forces far from the mirror plane are those of the whole model, and the plane
    exerts no force along itself."""
    half, whole = rigs
    forces = []
    for rig in rigs:
        T = np.zeros((len(rig.x), 2, 2))
        T[:, 0, 0], T[:, 1, 1] = 3.0 + rig.x[:, 0] ** 2, -2.0 + rig.x[:, 1]
        forces.append(rig.forces(T))
    assert np.abs(forces[0][:, 1].sum()) < 1e-12 * np.abs(forces[0]).sum()
    far = on_the_right(half, half.x)[:, 0] > 2 * 2.1 * L0
    difference = on_the_right(half, forces[0]) - on_the_right(whole, forces[1])
    assert far.sum() > 5 and np.abs(difference[far]).max() < 1e-12


@pytest.mark.parametrize(
    ("d", "mirrors", "tolerance"),
    [(2, 1, 2e-3), pytest.param(3, 1, 2e-3, marks=pytest.mark.slow), (3, 2, 4e-3)],
    ids=["2-D", "half", "quarter"],
)
def test_corners_count_every_neighbour_once(d, mirrors, tolerance):
    """Number density, packing and neighbours of a lattice on a floor, cut by mirror planes, are those of the whole
    lattice within the interpolation of the tables; overlapping half-spaces would make the corner 3 to 14 % too
    dense."""
    size = 0.55 if d == 2 else 0.35
    low, high = -size * np.ones(d), size * np.ones(d)
    low[-1], high[-1] = 0.0, 0.4
    x = mps.lattice(np.round(low / L0 - 0.5) * L0, high, L0)
    x = x[x[:, -1] > 0.0]
    floor, planes = (FLOOR, (WEST,)) if d == 2 else (FLOOR_3D, (EAST_3D, NORTH_3D)[:mirrors])
    part = Rig(x[np.all(x[:, :mirrors] > 0.0, axis=1)], planes=(floor, *planes))
    whole = Rig(x, planes=(floor,))
    keep = np.all(whole.x[:, :mirrors] > 0.0, axis=1)
    rows = np.flatnonzero(keep)[np.lexsort(whole.x[keep].T)], np.lexsort(part.x.T)
    assert np.allclose(whole.x[rows[0]], part.x[rows[1]], atol=1e-12)
    beside = np.all(part.x[rows[1]][:, :mirrors] < 2.1 * L0, axis=1)
    beside &= np.all(np.abs(part.x[rows[1]]) < 0.2, axis=1)  # away from the lattice's own ends
    assert beside.sum() >= 2**d / 2
    for name, size in (("n", None), ("packing", None), ("neighbour_count", None), ("surface_normal", 1.0)):
        of_whole, of_part = (getattr(r.gradient, name).to_numpy()[k] for r, k in zip((whole, part), rows, strict=True))
        assert np.abs((of_part - of_whole) / (size or of_whole))[beside].max() < tolerance, name


# ---- runs -----------------------------------------------------------------------------------------------------
def cone_scenes(spacing, slip=False, **keywords):
    """A quarter of the cone, and the whole of the same lattice."""
    quarter, whole = (mps.slump_cone(model=model, spacing=spacing, **keywords) for model in ("quarter", "full"))
    body = quarter.unfold(mps.measure.still(quarter.fluid, spacing)).x
    floors = ((replace(each.walls[0], slip=slip), *each.walls[1:]) for each in (quarter, whole))
    return [
        replace(each, fluid=fluid, walls=walls, wall_particles=None)
        for each, fluid, walls in zip((quarter, whole), (quarter.fluid, body), floors, strict=True)
    ]


@pytest.mark.long
def test_a_quarter_of_the_cone_slumps_as_the_whole():
    """On a frictionless floor, where the whole height flows, a quarter comes to rest within a fifth of a spacing in
    slump and one in spread of the whole cone (docs/limits.md). Floors with friction: rows slump_*_quarter of the
    validation table."""
    quarter, whole = map(ran, cone_scenes(0.015, slip=True, yield_value=500.0))
    assert 4 * len(quarter.scene.fluid) == len(whole.scene.fluid) and whole.measures()["slump_m"] > 0.05
    for name, bound in {"slump_m": 0.003, "spread_m": 0.015}.items():
        assert quarter.measures()[name] == pytest.approx(whole.measures()[name], abs=bound)


def test_the_picture_of_a_quarter_is_that_of_the_whole_body():
    quarter, whole = cone_scenes(0.0125, until=0.2)
    part = replace(moving(quarter.fluid), spacing=0.0125, time=0.0)
    size = {"width": 320, "height": 180, "view": "speed"}
    ours = render.Renderer(quarter, **size).draw(part)
    differ = np.any(ours != render.Renderer(whole, **size).draw(quarter.unfold(part)), axis=2)
    assert differ.mean() < 1e-3  # single pixels where two spheres meet
    assert np.any(ours != render.Renderer(replace(quarter, walls=quarter.walls[:1]), **size).draw(part))


def test_walls_are_drawn_on_both_sides():
    box = scene(cloud((4, 4)) + 1.0, (WEST, FLOOR, mps.Plane((1.5, 0.0), (-1.0, 0.0))))
    low, high, floor = view_volume.view_volume(box)
    assert (low[0], high[0], floor) == (-1.5, 1.5, 0.0)
    ends = [line[:, 0].tolist() for line in view_volume.with_mirror_images(box, [(1.5, 0.0), (1.5, 1.0)])]
    assert ends == [[1.5, 1.5], [-1.5, -1.5]]
