"""The least-squares gradient on linear fields, and the force of a stress field as its exact adjoint."""

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.engine.particles.kernels import smooth_weight
from taichi_mps.engine.particles.particles import DUMMY, FLUID, WALL
from tests.support.rigs import L0, Rig, cloud

ROUNDING = 1e-12
FLOOR, LEFT = -0.43, -0.53  # places of the two walls [m]


@pytest.fixture(scope="module")
def plain():
    return Rig(cloud((7, 6)))


@pytest.fixture(scope="module")
def cube():
    """A 3-D cloud with wall and dummy particles in it, a pair and a line of three apart."""
    x = cloud((5, 4, 4))
    kinds = np.where(x[:, 2] < -0.1, WALL, FLUID)
    kinds[x[:, 2] < -0.17] = DUMMY
    apart = np.array([[1.0, 1, 1], [1.1, 1, 1], [-1.0, -1, 1], [-1.0, -1.1, 1], [-1.0, -1.2, 1], [0.0, 1.5, 0.0]])
    return Rig(np.vstack([x, apart]), np.concatenate([kinds, np.full(6, FLUID)]))


@pytest.fixture(scope="module")
def walled():
    """Fluid on a no-slip floor that moves, between a slip wall on the left and a free surface; with the weight of the
    scheme ``implicit``, the others with that of the paper."""
    planes = (
        mps.Plane((0.0, FLOOR), (0.0, 1.0), velocity=(0.7, 0.0)),
        mps.Plane((LEFT, 0.0), (1.0, 0.0), slip=True),
    )
    return Rig(cloud((10, 8)), planes=planes, weight=smooth_weight)


@pytest.fixture(params=["plain", "cube", "walled"])
def rig(request):
    return request.getfixturevalue(request.param)


def linear(rig):
    rng = np.random.default_rng(4)
    A = rng.standard_normal((rig.dimension, rig.dimension))
    return A, rig.x @ A.T + rng.standard_normal(rig.dimension)


def random_fields(rig):
    rng, (n, d) = np.random.default_rng(5), rig.x.shape
    return rng.standard_normal((n, d)), rng.standard_normal((n, d, d))


@pytest.mark.parametrize("case", ["plain", "cube"])
def test_what_the_fit_leaves_is_the_sum_over_the_bonds(case, request):
    rig = request.getfixturevalue(case)
    A, u = linear(rig)
    noise, _ = random_fields(rig)
    assert rig.fits(u)[1][rig.healthy].max() < 1e-10 * (A**2).sum()
    G, left = rig.fits(u + noise)
    r, jump = rig.x[None] - rig.x[:, None], (u + noise)[None] - (u + noise)[:, None]
    delta = jump - np.einsum("iab,ijb->ija", G, r)
    exact = (rig.weight_r2 * (delta**2).sum(-1)).sum(1) / rig.gradient.n0
    assert np.allclose(left[rig.healthy], exact[rig.healthy], rtol=1e-9, atol=1e-9 * exact.max())
    assert np.allclose(G, rig.gradients(u + noise), rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize("case", ["plain", "cube"])
def test_linear_field_is_exact_inside_and_at_free_surfaces(case, request):
    rig = request.getfixturevalue(case)
    A, u = linear(rig)
    G = rig.gradients(u)[rig.healthy]
    assert len(G) > 0.5 * len(rig.x[rig.kind == FLUID])
    surface = rig.gradient.neighbour_count.to_numpy()[rig.healthy] < 0.7 * rig.gradient.lattice_neighbours
    assert surface.sum() >= 8  # there are many at the surface among them
    assert np.abs(G - A).max() < 1e-11


def test_linear_field_that_vanishes_on_a_no_slip_wall_is_exact(walled):
    inside = walled.healthy & (walled.x[:, 0] > LEFT + 2.1 * L0)  # beyond the reach of the slip wall
    assert (inside & (walled.x[:, 1] < FLOOR + L0)).sum() >= 4
    a = np.array([1.3, -0.4])
    u = np.outer(walled.x[:, 1] - FLOOR, a)
    G = np.outer(a, [0.0, 1.0])
    assert np.abs(walled.gradients(u)[inside] - G).max() < 1e-11
    assert np.abs(walled.gradients(u + [0.7, 0.0], wall_motion=1.0)[inside] - G).max() < 1e-11  # on the moving wall


def test_linear_field_along_a_slip_wall_is_exact(walled):
    inside = walled.healthy & (walled.x[:, 1] > FLOOR + 2.1 * L0)
    assert (inside & (walled.x[:, 0] < LEFT + L0)).sum() >= 4
    u = np.stack([0.8 * (walled.x[:, 0] - LEFT), 1.0 - 0.8 * walled.x[:, 1]], 1)
    assert np.abs(walled.gradients(u)[inside] - np.diag([0.8, -0.8])).max() < 1e-11


def test_force_is_the_negative_adjoint_of_the_gradient(rig):
    """The force of a stress is the negative adjoint of the gradient, and without walls it conserves momentum."""
    u, T = random_fields(rig)
    assert rig.imbalance(u, T) < ROUNDING
    F = rig.forces(T)
    assert rig.planes or np.abs(F.sum(0)).max() < ROUNDING * np.abs(F).sum()


def test_single_and_paired_particles_carry_no_stress(cube):
    lonely = np.linalg.norm(cube.x, axis=1) > 1.0
    in_a_pair = lonely & (cube.gradient.neighbour_count.to_numpy() < cube.dimension)
    assert in_a_pair.sum() == 6
    assert not np.any(cube.gradient.B.to_numpy()[in_a_pair])
    assert np.all(np.isfinite(cube.gradient.B.to_numpy()))
    assert not np.any(cube.gradient.B.to_numpy()[cube.kind == DUMMY])
    assert np.any(cube.gradient.B.to_numpy()[cube.kind == WALL])


def test_surface_normal_is_one_at_a_flat_surface_and_points_into_the_lattice():
    """The surface normal is that of sums over the missing half by hand: one layer at the surface, in the second row
    only what is 2 l0 away."""
    rig = Rig(mps.lattice((-0.45,) * 3, (0.4,) * 3, L0))
    surface_normal, top = rig.gradient.surface_normal.to_numpy(), rig.x[:, -1].max()
    middle = np.all(np.abs(rig.x[:, :-1]) < 0.06, axis=1)
    first, second = middle & (rig.x[:, -1] > top - 0.01), middle & (np.abs(rig.x[:, -1] - top + L0) < 0.01)
    down = np.array([0.0, 0.0, -1.0])
    w = [2.1 / r - 1.0 for r in (1.0, 2.0**0.5, 3.0**0.5, 2.0)]
    whole = w[0] + w[1] * 4 / 2.0**0.5 + w[2] * 4 / 3.0**0.5 + w[3]  # 1, 4, 4 and 1 neighbours, times cosines
    assert first.sum() > 0 and np.abs(surface_normal[first] - down).max() < ROUNDING
    assert np.abs(surface_normal[second] - w[3] / whole * down).max() < ROUNDING
