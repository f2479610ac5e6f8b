"""Sparse matrices in compressed rows: products, rows that are no unknowns, and lists that belong to someone else."""

import numpy as np
import scipy.sparse as sp

from taichi_mps.linear.csr import SparseMatrix
from taichi_mps.runtime.backend import real, ti
from tests.support.linear import sparse_matrix


def matrix(n=40, seed=1):
    """Symmetric, with empty rows, and a diagonal that is not positive in some."""
    a = sp.random(n, n, 0.1, random_state=np.random.default_rng(seed), format="csr")
    a = (a + a.T).tolil()
    a.setdiag(np.random.default_rng(2).uniform(1.0, 2.0, n))
    a[3, :], a[:, 3] = 0.0, 0.0
    a[5, 5] = -1.0
    return a.tocsr()


def product(a, x):
    fields = [ti.Vector.field(1, real(), len(x)) for _ in range(2)]
    fields[0].from_numpy(x[:, None])
    a.apply(*fields)
    return fields[1].to_numpy()[:, 0]


def test_the_product_is_that_of_scipy():
    m, x = matrix(), np.random.default_rng(3).standard_normal(40)
    np.testing.assert_allclose(product(sparse_matrix(m), x), m @ x, rtol=1e-13, atol=1e-13)


def test_a_diagonal_that_is_not_positive_marks_a_row_that_is_no_unknown():
    m = matrix()
    found = sparse_matrix(m).inverse_diagonal.to_numpy().ravel()
    diagonal = m.diagonal()
    assert set(np.flatnonzero(found == 0.0)) == {3, 5} == set(np.flatnonzero(diagonal <= 0.0))
    np.testing.assert_allclose(found[diagonal > 0.0], 1.0 / diagonal[diagonal > 0.0], rtol=1e-14)


def test_rows_may_be_fewer_than_there_is_room_for():
    m, x = matrix(), np.random.default_rng(4).standard_normal(47)
    np.testing.assert_allclose(product(sparse_matrix(m, capacity=47), x)[:40], m @ x[:40], rtol=1e-13, atol=1e-13)


def test_a_matrix_on_the_neighbour_list_of_another():
    m, x = matrix(), np.random.default_rng(5).standard_normal(40)
    first = sparse_matrix(m)
    shared = SparseMatrix(40, first.pair_capacity, row_start=first.row_start, column=first.column, count=first.count)
    shared.value.copy_from(first.value)
    shared.diagonal.copy_from(first.diagonal)
    np.testing.assert_array_equal(product(shared, x), product(first, x))
