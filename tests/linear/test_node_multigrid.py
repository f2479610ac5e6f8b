"""Grids of nodes: a symmetric positive definite preconditioner, the same answer, iterations that hardly grow."""

import numpy as np
import pytest

from taichi_mps.linear.node_multigrid import NodeMultigrid
from tests.support.linear import REACH, Nodes, Springs, applied, solve


def solved(springs, grids, across):
    """(solution, report) for a smooth and a rough load."""
    x = springs.particles.x.to_numpy()
    b = np.sin(3.0 * x / across) + np.random.default_rng(1).standard_normal(x.shape)
    u, report = solve(springs, b.ravel(), 2, tolerance=1e-8, preconditioner=grids, limit=5000)
    assert report.converged
    return u, report


def made(across, periodic=False):
    springs = Springs(across, periodic)
    grids = Nodes(springs, springs.bins)
    grids.build()
    return springs, grids


def assert_symmetric_and_positive(springs, grids):
    """v.M w and zero in rows that are no unknowns."""
    rng = np.random.default_rng(2)
    mask = np.abs(springs.inverse_diagonal.to_numpy()).sum((1, 2)) > 0
    a, c = (v * mask[:, None] for v in rng.standard_normal((2, len(mask), 2)))
    Ma, Mc = (m.reshape(-1, 2) for m in applied(grids, np.array([a.ravel(), c.ravel()]), 2))
    assert (a * Mc).sum() == pytest.approx((c * Ma).sum(), rel=1e-12)
    assert (a * Ma).sum() > 0.0 and (c * Mc).sum() > 0.0
    assert not mask.all() and np.all(Ma[~mask] == 0.0)


def test_the_preconditioner_is_symmetric_and_positive():
    """Of a body that is periodic along one axis."""
    assert_symmetric_and_positive(*made(24, periodic=True))


@pytest.mark.slow
def test_nodes_of_a_spray_for_which_there_is_no_room_are_left_out():
    """Drops far from each other touch more nodes of grid 1, of 4 cells each, than there are rows, one for four
    particles: the preconditioner stays symmetric and positive, and the answer is that of Jacobi."""
    across = 100
    grid = np.stack(np.meshgrid(*[np.arange(5.0, across, 10.0)] * 2), -1).reshape(-1, 2)
    x = np.vstack([grid + offset for offset in ((0.0, 0.0), (1.1, 0.3), (0.2, 1.2))])
    springs = Springs(across, x=x)

    class Scarce(Nodes):
        ROWS = 9

    grids = Scarce(springs, springs.bins)
    grids.build()
    width = 2.0 * (across + 2 * REACH) / springs.bins.shape[0]  # of a cell between nodes of grid 1
    assert len(np.unique((x + REACH) // width, axis=0)) > len(x) // 4
    assert_symmetric_and_positive(springs, grids)
    coarse, plain = (solved(springs, kind, across)[0] for kind in (grids, None))
    np.testing.assert_allclose(coarse, plain, atol=1e-6 * np.abs(plain).max())


def test_levels_change_the_iterations_and_not_the_answer():
    """For 16 times as many particles they hardly grow."""
    small, large = made(24), made(96)
    plain, many = solved(large[0], None, 96)
    coarse, few = solved(*large, 96)
    np.testing.assert_allclose(coarse, plain, atol=1e-6 * np.abs(plain).max())
    assert few.iterations < 0.1 * many.iterations
    assert few.iterations <= 1.3 * solved(*small, 24)[1].iterations


def test_with_few_rows_it_is_jacobi():
    springs = Springs(12)
    grids = NodeMultigrid(springs, springs.bins)
    grids.build()
    v = np.random.default_rng(3).standard_normal((1, 2 * 144))
    D = springs.inverse_diagonal.to_numpy()
    expected = np.einsum("iab,ib->ia", D, v.reshape(-1, 2)).ravel()
    np.testing.assert_allclose(applied(grids, v, 2)[0], expected, rtol=1e-12, atol=1e-14)
