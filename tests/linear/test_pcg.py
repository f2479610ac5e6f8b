"""Conjugate gradients: known solutions, the start of a solve, and its end."""

import numpy as np
import pyamg
import pytest
import scipy.sparse as sp

from tests.support.linear import FUSED, LAUNCHED, BlockOperator, applied, solve, sparse_matrix, spd

LAUNCHES = pytest.mark.parametrize("launch", [FUSED, LAUNCHED], ids=["fused", "launched"])


# ---- sparse matrices ----------------------------------------------------------------------------------------------
def test_the_product_of_a_sparse_matrix_is_that_of_scipy():
    """The product is SciPy's where only some of the allocated rows are used; an empty row and one with a negative
    diagonal are no unknowns."""
    rng = np.random.default_rng(1)
    a = sp.random(40, 40, 0.1, random_state=rng)
    a = (a + a.T).tolil()
    a.setdiag(rng.uniform(1.0, 2.0, 40))
    a[3, :], a[:, 3], a[5, 5] = 0.0, 0.0, -1.0
    a, v = a.tocsr(), rng.standard_normal((1, 47))
    operator = sparse_matrix(a, capacity=47)
    np.testing.assert_allclose(applied(operator.multiply, v)[0, :40], a @ v[0, :40], rtol=1e-13, atol=1e-13)
    expected = [1.0 / d if d > 0.0 else 0.0 for d in a.diagonal()]
    np.testing.assert_allclose(operator.inverse_diagonal.to_numpy().ravel()[:40], expected, rtol=1e-14)


# ---- known solutions --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("points", [(200,), (24, 20), (12, 10, 11)])
def test_poisson_of_the_gallery(points):
    a = pyamg.gallery.poisson(points, format="csr")
    exact = np.random.default_rng(2).standard_normal(a.shape[0])
    x, report = solve(sparse_matrix(a, capacity=a.shape[0] + 7), a @ exact)
    assert report.converged
    np.testing.assert_allclose(x, exact, rtol=0, atol=1e-7)


def test_masked_rows_keep_their_values_and_act_as_dirichlet_values():
    n, masked = 30, (0, 7, 29)
    a, free = spd(3 * n), np.repeat(~np.isin(np.arange(n), masked), 3)
    guess = np.where(free, 0.0, np.arange(3.0 * n))
    b = np.random.default_rng(4).standard_normal(3 * n)
    b[~free] = 1e20  # takes no part
    x, report = solve(BlockOperator(a, 3, masked), b, 3, x=guess, tolerance=1e-13)
    assert report.converged
    np.testing.assert_array_equal(x[~free], guess[~free])
    expected = np.linalg.solve(a[np.ix_(free, free)], b[free] - a[np.ix_(free, ~free)] @ guess[~free])
    np.testing.assert_allclose(x[free], expected, rtol=0, atol=1e-9 * np.abs(expected).max())


def test_the_error_in_the_energy_norm_falls_from_step_to_step():
    a = pyamg.gallery.poisson((30, 30), format="csr")
    exact = np.random.default_rng(5).standard_normal(900)
    operator = sparse_matrix(a)
    errors = [exact - solve(operator, a @ exact, tolerance=0.0, limit=steps)[0] for steps in range(0, 60, 6)]
    assert np.all(np.diff([error @ (a @ error) for error in errors]) < 0.0)


# ---- where a solve starts ---------------------------------------------------------------------------------------
@LAUNCHES
def test_a_solve_goes_on_from_the_last_one(launch):
    """A load that changes as at the last solve, or by a part of that change, needs no iteration and no product with A.
    At most the last change is extrapolated: where it was negligible, it is rounding."""
    a, (b, c) = spd(40), np.random.default_rng(11).standard_normal((2, 40))
    b[6:9], c[6:9] = 1e20, -1e20  # of a masked row
    operator = BlockOperator(a, 2, masked=(3, 4))
    free = np.repeat(np.abs(operator.inverse_diagonal.to_numpy()).sum((1, 2)) > 0, 2)
    block = a[np.ix_(free, free)]
    x, report = solve(operator, b, 2, tolerance=1e-12, launch=launch)
    for load, iterations in ((2.0 * b, 0), (2.5 * b, 0), (-3.0 * b, 3), (c, 3)):
        x, report = solve(operator, load, 2, x=x, tolerance=1e-8, launch=launch, again=1)
        assert report.converged and (report.iterations == 0) == (iterations == 0)
        assert np.abs(block @ x[free] - load[free]).max() < 1e-6


def test_nothing_to_do():
    a = BlockOperator(spd(6), 1)
    exact = np.linalg.solve(spd(6), np.ones(6))
    for b, guess in ((np.zeros(6), 0.0), (np.ones(6), exact)):
        _, report = solve(a, b, x=guess)
        assert report.converged and report.iterations == 0
    x, report = solve(a, np.zeros(6), x=np.ones(6))  # b = 0 but a guess: relative to the first residual
    assert report.converged and np.abs(x).max() < 1e-8


# ---- when it stops ----------------------------------------------------------------------------------------------
@LAUNCHES
def test_a_guess_within_the_tolerance_is_improved_if_asked_for(launch):
    """A guess within the tolerance is improved to 0.3 of its residual on request, but not below 1e-4."""
    a, b = spd(40), np.random.default_rng(12).standard_normal(40)
    exact, off = np.linalg.solve(a, b), np.random.default_rng(13).standard_normal(40)
    operator = BlockOperator(a, 1)
    for residual, least in ((1e-2, 3e-3), (1e-3, 3e-4), (2e-4, 1e-4), (5e-5, 1.0)):
        size = solve(operator, b, x=exact + 1e-3 * off, tolerance=1.0, launch=launch)[1].residual
        given = dict(x=exact + 1e-3 * residual / size * off, tolerance=0.05, launch=launch)
        assert solve(operator, b, limit=0, **given)[1].residual == pytest.approx(residual, rel=1e-6)
        _, report = solve(operator, b, reduction=0.3, **given)
        assert report.converged and report.residual <= least
        assert (report.iterations == 0) == (residual < 1e-4)
        assert solve(operator, b, **given)[1].iterations == 0


@LAUNCHES
def test_a_solve_that_need_not_be_better_stops_where_it_is_enough(launch):
    """With a tolerance of 1e-6 and ``enough`` of 0.1 or 0.5 a solve stops at the first iteration with that fraction of
    its first residual."""
    a, b = spd(40), np.random.default_rng(14).standard_normal(40)
    operator = BlockOperator(a, 1)
    whole = solve(operator, b, tolerance=1e-6, launch=launch)[1].iterations
    start = solve(operator, b, limit=0, launch=launch)[1].residual
    done = []
    for enough in (0.1, 0.5):
        _, report = solve(operator, b, tolerance=1e-6, launch=launch, enough=enough)
        assert report.converged and 1e-6 < report.residual / start <= enough
        before = solve(operator, b, tolerance=1e-6, launch=launch, limit=report.iterations - 1)[1]
        assert before.residual > enough * start
        done.append(report.iterations)
    assert 0 < done[1] < done[0] < whole


def test_what_the_tolerance_is_relative_to_can_be_bounded():
    """A solve ends at sqrt((r, z)) <= tolerance sqrt(most) where that is less than tolerance times the norm of the
    right-hand side."""
    a, b = spd(40), np.random.default_rng(15).standard_normal(40)
    operator = BlockOperator(a, 1)
    norm = b @ (b / np.diag(a))
    loose, strict = (solve(operator, b, tolerance=1e-3, most=most)[1] for most in (2.0 * norm, 1e-4 * norm))
    for most, first in ((2.0 * norm, 1.0), (1e-4 * norm, 100.0)):
        assert solve(operator, b, limit=0, most=most)[1].residual == pytest.approx(first)
    assert loose.converged and strict.converged and strict.iterations > loose.iterations
    assert strict.residual <= 1e-3


def test_statuses():
    holed = spd(8)
    holed[2, 3] = holed[3, 2] = np.nan
    indefinite, holed = BlockOperator(np.array([[1.0, 3.0], [3.0, 1.0]]), 1), BlockOperator(holed, 1)
    poisson = sparse_matrix(pyamg.gallery.poisson((100,), format="csr"))
    for operator, b, status in (
        (indefinite, np.array([1.0, -1.0]), "indefinite"),
        (holed, np.ones(8), "broken"),
        (poisson, np.full(100, np.inf), "broken"),
        (poisson, np.ones(100), "limit"),
    ):
        x, report = solve(operator, b, limit=7)
        assert report.status == status and not report.converged
        assert np.all(np.isfinite(x)) or not np.all(np.isfinite(b))
    assert report.iterations == 7
