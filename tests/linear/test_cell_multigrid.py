"""Levels on the binning cells: the cycle against dense algebra, its spectrum, and iterations that do not grow."""

import itertools

import numpy as np
import pyamg
import pytest
import scipy.sparse as sp

from taichi_mps.linear.cell_multigrid import CellMultigrid
from tests.support.linear import Always, applied, solve, with_levels


@pytest.mark.slow
def test_levels_make_the_iterations_independent_of_the_size():
    jacobi, cells, smoothed = [], [], []
    for n in (12, 36):
        a, levels, matrix, _ = with_levels(pyamg.gallery.poisson((n, n, n), format="csr"), (n, n, n), 3)
        b = np.random.default_rng(6).standard_normal(n**3)
        x, report = solve(a, b, preconditioner=levels, tolerance=1e-6)
        assert report.converged
        assert np.linalg.norm(b - matrix @ x) < 1e-5 * np.linalg.norm(b)
        cells.append(report.iterations)
        jacobi.append(solve(a, b, tolerance=1e-6)[1].iterations)
        residuals = []
        pyamg.smoothed_aggregation_solver(matrix).solve(b, tol=1e-6, accel="cg", residuals=residuals)
        smoothed.append(len(residuals) - 1)
    assert cells[1] < 1.3 * cells[0]
    assert jacobi[1] > 2.3 * jacobi[0]
    assert cells[1] <= 2.5 * smoothed[1], (cells, smoothed)


class Deep(Always):
    MAX_LAST_CELLS = 4


def constants(shape):
    """Piecewise constants (cells, merged cells) of the next level, which merges pairs along each side of more than
    three cells, and the shape of that; None of the last level."""
    merge = [2 if n > 3 else 1 for n in shape]
    if np.prod(shape) <= Deep.MAX_LAST_CELLS or max(merge) == 1:
        return None, None
    coarse = tuple(-(-n // m) for n, m in zip(shape, merge, strict=True))
    P = np.zeros((np.prod(shape), np.prod(coarse)))
    for row, place in enumerate(itertools.product(*map(range, shape))):
        P[row, np.ravel_multi_index([k // m for k, m in zip(place, merge, strict=True)], coarse)] = 1.0
    return P, coarse


def correction(A, shape):
    """The dense matrix C of the cycle on cells with the operator A: twice the cycle of the docstring, or the inverse.
    One cycle z <- z + M (r - A z) taken twice is M (2 I - A M)."""
    P, coarse = constants(shape)
    if P is None:
        return np.linalg.inv(A)
    M = cycle(A, P, correction(P.T @ A @ P, coarse))
    return 2.0 * M - M @ A @ M


def cycle(A, P, C):
    """M of z = w D^-1 r; z += s P C P^T (r - A z); z += w D^-1 (r - A z)."""
    I, D = np.eye(len(A)), CellMultigrid.DAMPING * np.diag(1.0 / np.diag(A))  # noqa: E741
    coarse = CellMultigrid.OVER_CORRECTION * P @ C @ P.T
    left = (I - A @ D) @ (I - A @ coarse) @ (I - A @ D)  # what is left of a residual
    return np.linalg.solve(A, I - left)


@pytest.mark.parametrize("n", [(22, 10), (9, 7, 6)], ids=["2-D", "3-D"])
def test_the_cycle_is_that_of_dense_matrices_with_galerkin_operators(n):
    """Across a periodic side too; to sqrt(eps), by which the last level is kept away from singular. So M is symmetric,
    and the eigenvalues of M A lie in (0, 2)."""
    a, side = sp.lil_matrix(pyamg.gallery.poisson(n)), np.arange(np.prod(n[1:]))
    a[side, side - len(side)] = a[side - len(side), side] = -1.0
    _, levels, matrix, cell = with_levels(a, n, 2, kind=Deep)
    A, P = matrix.toarray(), np.eye(np.prod(levels.shape))[cell]
    M = cycle(A, P, correction(P.T @ A @ P, levels.shape))
    v = np.random.default_rng(10).standard_normal((4, len(A)))
    np.testing.assert_allclose(applied(levels.apply, v), v @ M.T, rtol=0, atol=1e-6 * np.abs(v @ M.T).max())
    np.testing.assert_allclose(M, M.T, rtol=0, atol=1e-12 * np.abs(M).max())
    eigenvalues = np.linalg.eigvals(M @ A).real
    assert eigenvalues.min() > 0.0 and eigenvalues.max() < 2.0


def test_levels_with_masked_rows_empty_cells_and_contrast():
    n = 24
    rng = np.random.default_rng(8)
    a = pyamg.gallery.poisson((n, n), format="csr")
    d = sp.diags(np.where(np.arange(n * n) % n < n // 2, 1.0, 30.0))
    a = (d @ a @ d).tolil()
    masked = rng.random(n * n) < 0.1
    masked.reshape(n, n)[4:10, 4:10] = True  # whole cells without an unknown
    a[masked, masked] = 0.0
    a = a.tocsr()
    a.setdiag(np.where(masked, 0.0, a.diagonal()))
    operator, levels, matrix, _ = with_levels(a, (n, n), 2)
    free = matrix.diagonal() > 0
    exact = np.where(free, rng.standard_normal(n * n), 3.0)
    given = dict(x=np.where(free, 0.0, 3.0), preconditioner=levels, tolerance=1e-12)
    x, report = solve(operator, matrix @ exact, **given)
    assert report.converged
    np.testing.assert_allclose(x, exact, atol=1e-8)


@pytest.mark.slow
def test_neumann_problem_with_a_consistent_right_hand_side():
    n = 40
    a = pyamg.gallery.poisson((n, n), format="csr")
    a = (a - sp.diags(np.asarray(a.sum(axis=1)).ravel())).tocsr()
    operator, levels, matrix, _ = with_levels(a, (n, n), 2)
    exact = np.random.default_rng(9).standard_normal(n * n)
    x, report = solve(operator, matrix @ exact, preconditioner=levels, tolerance=1e-9)
    assert report.converged
    np.testing.assert_allclose(x - x.mean(), exact - exact.mean(), atol=1e-5)
