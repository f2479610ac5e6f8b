"""MRPCG: known solutions, how it ends, reproducible bits, and what the cell levels promise."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyamg
import pytest
import scipy.sparse as sp

from taichi_mps.linear.cell_multigrid import CellMultigrid
from taichi_mps.linear.csr import SparseMatrix
from taichi_mps.linear.pcg import MRPCG
from taichi_mps.runtime.thread_team import ONE_THREAD
from tests.support.linear import BlockOperator, preconditioner, solve, sparse_matrix, spd, with_levels


@pytest.mark.parametrize("components", [1, 2, 3])
def test_dense_blocks_match_numpy(components):
    a = spd(20 * components)
    b = np.random.default_rng(1).standard_normal(len(a))
    x, report = solve(BlockOperator(a, components), b, components, tolerance=1e-13)
    assert report.converged
    np.testing.assert_allclose(x, np.linalg.solve(a, b), rtol=0, atol=1e-11 * np.abs(x).max())


@pytest.mark.parametrize("points", [(200,), (24, 20), (12, 10, 11)])
def test_poisson_of_the_gallery(points):
    a = pyamg.gallery.poisson(points, format="csr")
    exact = np.random.default_rng(2).standard_normal(a.shape[0])
    x, report = solve(sparse_matrix(a, capacity=a.shape[0] + 7), a @ exact)
    assert report.converged
    np.testing.assert_allclose(x, exact, rtol=0, atol=1e-7)


def test_contrast_of_a_million():
    d = sp.diags(10.0 ** np.random.default_rng(3).uniform(0, 3, 400))
    a = (d @ pyamg.gallery.poisson((20, 20), format="csr") @ d).tocsr()
    exact = np.ones(400)
    x, report = solve(sparse_matrix(a), a @ exact, tolerance=1e-12)
    assert report.converged
    np.testing.assert_allclose(x, exact, rtol=1e-7)


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


@pytest.mark.long
def test_one_kernel_does_what_many_do():
    """Same solution, iterations, status and residuals at both ends; with a guess, a limit, and without a solution."""
    rng = np.random.default_rng(4)
    operator = BlockOperator(spd(60), 2, masked=(3,))
    indefinite = BlockOperator(np.diag(np.where(np.arange(60) % 7 == 3, -1.0, 1.0)) + 0.0, 1)
    indefinite.inverse_diagonal.from_numpy(np.ones((60, 1, 1)))
    for a, components, options in (
        (operator, 2, {}),
        (operator, 2, {"x": rng.standard_normal(60), "reference": 1e-3}),
        (operator, 2, {"max_iterations": 7}),
        (indefinite, 1, {}),
    ):
        b = rng.standard_normal(60)
        (many, first), (one, second) = (solve(a, b, components, team=team, **options) for team in (None, ONE_THREAD))
        np.testing.assert_allclose(one, many, rtol=1e-12, atol=1e-14)
        assert (second.status, second.iterations) == (first.status, first.iterations)
        assert [second.residuals[0], second.residuals[-1]] == pytest.approx(
            [first.residuals[0], first.residuals[-1]], rel=1e-6
        )


@pytest.mark.parametrize("team", [None, ONE_THREAD])
def test_a_solve_goes_on_from_the_last_one(team):
    """The residual is known without A; a load that changes as it did last, or by a part of that, needs no iteration. No
    more than the last change is taken: where that was next to nothing, it is rounding."""
    rng = np.random.default_rng(11)
    a, (b, c) = spd(40), rng.standard_normal((2, 40))
    b[6:9], c[6:9] = 1e20, -1e20  # of a masked row
    operator = BlockOperator(a, 2, masked=(3, 4))
    free = np.repeat(np.abs(operator.inverse_diagonal.to_numpy()).sum((1, 2)) > 0, 2)
    block = a[np.ix_(free, free)]
    x, report = solve(operator, b, 2, tolerance=1e-12, team=team)
    for load, iterations in ((2.0 * b, 0), (2.5 * b, 0), (-3.0 * b, 3), (c, 3)):
        x, report = solve(operator, load, 2, x=x, tolerance=1e-8, team=team, again=True)
        assert report.converged and (report.iterations == 0) == (iterations == 0)
        assert np.abs(block @ x[free] - load[free]).max() < 1e-6


@pytest.mark.parametrize("team", [None, ONE_THREAD])
def test_a_guess_within_the_tolerance_is_improved_if_asked_for(team):
    """To 0.3 of its residual, but no further than to 1e-4."""
    a, b = spd(40), np.random.default_rng(12).standard_normal(40)
    exact, off = np.linalg.solve(a, b), np.random.default_rng(13).standard_normal(40)
    operator = BlockOperator(a, 1)
    for residual, least in ((1e-2, 3e-3), (1e-3, 3e-4), (2e-4, 1e-4), (5e-5, 1.0)):
        size = solve(operator, b, x=exact + 1e-3 * off, tolerance=1.0, team=team)[1].residuals[0]
        given = dict(x=exact + 1e-3 * residual / size * off, tolerance=0.05, team=team)
        _, report = solve(operator, b, reduction=0.3, **given)
        assert report.residuals[0] == pytest.approx(residual, rel=1e-6)
        assert report.converged and report.residuals[-1] <= least
        assert (report.iterations == 0) == (residual < 1e-4)
        assert solve(operator, b, **given)[1].iterations == 0


@pytest.mark.parametrize("team", [None, ONE_THREAD])
def test_a_solve_that_need_not_be_better_stops_where_it_is_enough(team):
    """Of 1e-6: at the first iteration that takes off nine tenths, then at the first that takes off half."""
    a, b = spd(40), np.random.default_rng(14).standard_normal(40)
    whole = solve(BlockOperator(a, 1), b, tolerance=1e-6, team=team, check_every=1)[1].iterations
    done = []
    for enough in (0.1, 0.5):
        _, report = solve(BlockOperator(a, 1), b, tolerance=1e-6, team=team, enough=enough, check_every=1)
        assert report.converged and 1e-6 < report.residuals[-1] / report.residuals[0] <= enough
        limit = solve(BlockOperator(a, 1), b, tolerance=1e-6, team=team, max_iterations=report.iterations - 1)[1]
        assert limit.residuals[-1] > enough * limit.residuals[0]
        done.append(report.iterations)
    assert 0 < done[1] < done[0] < whole


def test_a_finished_solve_changes_nothing_more():
    a, b = BlockOperator(np.eye(6), 1), np.arange(1.0, 7.0)
    x, report = solve(a, b, check_every=50)
    assert (report.status, report.iterations) == ("converged", 1)  # not the 50 that were launched
    np.testing.assert_array_equal(x, b)


def test_nothing_to_do():
    a = BlockOperator(spd(6), 1)
    assert solve(a, np.zeros(6))[1].iterations == 0
    assert solve(a, np.zeros(6))[1].converged
    x, report = solve(a, np.zeros(6), x=np.ones(6))  # b = 0 but a guess: relative to the first residual
    assert report.converged and np.abs(x).max() < 1e-8
    exact = np.linalg.solve(spd(6), np.ones(6))
    assert solve(a, np.ones(6), x=exact)[1].iterations == 0


def test_statuses():
    indefinite = BlockOperator(np.array([[1.0, 3.0], [3.0, 1.0]]), 1)
    broken = spd(8)
    broken[2, 3] = broken[3, 2] = np.nan
    broken = BlockOperator(broken, 1)
    poisson = sparse_matrix(pyamg.gallery.poisson((100,), format="csr"))
    for check_every in (1, 5, 100):
        x, report = solve(indefinite, np.array([1.0, -1.0]), check_every=check_every)
        assert report.status == "indefinite" and np.all(np.isfinite(x))
        x, report = solve(broken, np.ones(8), check_every=check_every)
        assert report.status == "broken" and np.all(np.isfinite(x))
        assert solve(poisson, np.full(100, np.inf), check_every=check_every)[1].status == "broken"
        x, report = solve(poisson, np.ones(100), max_iterations=7, check_every=check_every)
        assert (report.status, report.iterations) == ("limit", 7)


def test_energy_error_falls_monotonically_and_the_last_residual_is_true():
    a = pyamg.gallery.poisson((30, 30), format="csr")
    exact = np.random.default_rng(5).standard_normal(900)
    operator, errors = sparse_matrix(a), []
    for steps in range(0, 60, 6):
        x, report = solve(operator, a @ exact, tolerance=0.0, max_iterations=steps)
        errors.append((x - exact) @ (a @ (x - exact)))
    assert np.all(np.diff(errors) < 0)
    true = np.linalg.norm(a @ (exact - x)) / np.linalg.norm(a @ exact)  # D = 4 I: the factor cancels
    assert report.residuals[-1] == pytest.approx(true, rel=1e-8)
    assert len(report.residuals) == 1 + int(np.ceil(54 / 5))


def test_matrix_on_an_owned_neighbour_list():
    a = pyamg.gallery.poisson((50,), format="csr")
    first = sparse_matrix(a)
    shared = SparseMatrix(50, first.pair_capacity, row_start=first.row_start, column=first.column, count=first.count)
    shared.value.copy_from(first.value)
    shared.diagonal.copy_from(first.diagonal)
    shared.inverse_diagonal.copy_from(first.inverse_diagonal)
    np.testing.assert_array_equal(solve(first, np.ones(50))[0], solve(shared, np.ones(50))[0])


def test_levels_make_the_iterations_independent_of_the_size():
    jacobi, cells, smoothed = [], [], []
    for n in (12, 36):
        a, levels, matrix = with_levels(pyamg.gallery.poisson((n, n, n), format="csr"), (n, n, n), 3)
        b = np.random.default_rng(6).standard_normal(n**3)
        x, report = solve(a, b, levels=levels, tolerance=1e-6)
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


@pytest.mark.parametrize("points, per_cell", [((300,), 2), ((50, 31), 2), ((15, 14, 13), 2)])
def test_a_cycle_is_symmetric_positive_definite_and_bounded(points, per_cell):
    a, levels, matrix = with_levels(pyamg.gallery.poisson(points, format="csr"), points, per_cell)
    v = np.random.default_rng(7).standard_normal((6, matrix.shape[0]))
    gram = v @ preconditioner(levels, v).T
    np.testing.assert_allclose(gram, gram.T, rtol=0, atol=1e-12 * np.abs(gram).max())
    assert np.linalg.eigvalsh(gram).min() > 0
    w = v[:1]
    for _ in range(60):  # power iteration for the largest eigenvalue of M^-1 A
        w = preconditioner(levels, (matrix @ w[0])[None])
        largest = np.linalg.norm(w)
        w /= largest
    assert largest < 2.0


def test_galerkin_operators():
    """Every level equals P^T A P of the level before, across a periodic side too."""
    n = (22, 10)
    ring, line = sp.lil_matrix(pyamg.gallery.poisson((n[0],))), pyamg.gallery.poisson((n[1],))
    ring[0, -1] = ring[-1, 0] = -1.0
    a = sp.kron(ring, sp.identity(n[1])) + sp.kron(sp.identity(n[0]), line)

    class Deep(CellMultigrid):
        DENSE = 4

    _, levels, matrix = with_levels(a, n, 2, periodic=(True, False), kind=Deep)
    column, value, parent = (f.to_numpy() for f in (levels.column, levels.value, levels.parent))
    aggregate, fine = levels.cell_of.to_numpy(), matrix.toarray()
    assert len(levels.first) > 3
    for first, end in zip(levels.first, levels.first[1:], strict=False):
        p = np.eye(end - first)[aggregate]
        coarse = np.zeros((end - first,) * 2)
        rows = np.repeat(np.arange(end - first), column.shape[1])
        np.add.at(coarse, (rows, column[first:end].ravel() - first), value[first:end].ravel())
        np.testing.assert_allclose(coarse, p.T @ fine @ p, atol=1e-12)
        aggregate, fine = parent[first:end] - end, coarse


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
    operator, levels, matrix = with_levels(a, (n, n), 2)
    free = matrix.diagonal() > 0
    exact = np.where(free, rng.standard_normal(n * n), 3.0)
    x, report = solve(operator, matrix @ exact, x=np.where(free, 0.0, 3.0), levels=levels, tolerance=1e-12)
    assert report.converged
    np.testing.assert_allclose(x, exact, atol=1e-8)


def test_neumann_problem_with_a_consistent_right_hand_side():
    n = 40
    a = pyamg.gallery.poisson((n, n), format="csr")
    a = (a - sp.diags(np.asarray(a.sum(axis=1)).ravel())).tocsr()
    operator, levels, matrix = with_levels(a, (n, n), 2)
    exact = np.random.default_rng(9).standard_normal(n * n)
    x, report = solve(operator, matrix @ exact, levels=levels, tolerance=1e-9)
    assert report.converged
    np.testing.assert_allclose(x - x.mean(), exact - exact.mean(), atol=1e-5)


def test_levels_are_used_where_they_pay():
    a, levels, _ = with_levels(pyamg.gallery.poisson((6, 6), format="csr"), (6, 6), 2)
    solver = MRPCG(36, 1, a, levels=levels)
    assert solver.use_levels
    solver.prepare()
    assert not solver.use_levels  # 36 rows


CHILD = """
import hashlib, sys
import numpy as np, pyamg
from taichi_mps.runtime import backend
backend.init("cpu", sys.argv[2], int(sys.argv[1]))
from tests.support.linear import solve, with_levels
a, levels, matrix = with_levels(pyamg.gallery.poisson((20, 20, 20), format="csr"), (20, 20, 20), 2)
b = np.random.default_rng(0).standard_normal(8000)
for use in (None, levels):
    x, report = solve(a, b, levels=use, tolerance=1e-5)
    error = np.linalg.norm(b - matrix @ x) / np.linalg.norm(b)
    print(report.status, report.iterations, error < 1e-4, hashlib.sha256(x.tobytes()).hexdigest())
"""


def run_child(threads, precision):
    child = subprocess.run(
        [sys.executable, "-c", CHILD, str(threads), precision],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": str(Path(__file__).resolve().parents[2])},
    )
    assert child.returncode == 0, child.stderr
    return [line for line in child.stdout.splitlines() if line.startswith(("converged", "limit"))]


@pytest.mark.long  # test_reproducible.py does it for a whole run
@pytest.mark.parametrize("precision", ["f32", "f64"])
def test_same_bits_with_one_and_two_threads(precision):
    one, two = run_child(1, precision), run_child(2, precision)
    assert one == two
    assert len(one) == 2 and all(line.split()[0] == "converged" and line.split()[2] == "True" for line in one)
