"""The operators on the grids of nodes: the energy of linear fields on each, and inverses of blocks however small."""

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.runtime.backend import ti
from tests.support.linear import Nodes, Springs


def operators(levels):
    """Of each grid from grid 1 on: (node numbers on their grid's axes, dense matrix)."""
    first, start, uses, used, shape = (
        f.to_numpy() for f in (levels.first, levels.start, levels.uses, levels.used, levels.shape)
    )
    column, stencil = levels.column.to_numpy(), levels.stencil.to_numpy()
    for grid in range(1, levels.grids):
        nodes = used[first[grid] : first[grid] + uses[grid]]
        number = {node: m for m, node in enumerate(nodes)}
        dense = np.zeros((len(nodes), len(nodes), 2, 2))
        for m in range(len(nodes)):
            for k in range(levels.points):
                if np.any(stencil[start[grid] + m, k]):
                    dense[m, number[column[start[grid] + m, k]]] += stencil[start[grid] + m, k].T
        yield np.array(np.unravel_index(nodes - first[grid], shape[grid])).T, dense


def test_the_operators_of_all_grids_have_the_energy_of_linear_fields():
    """Shape functions reproduce them: a constant has the energy of the masses, G x that of the elastic body."""
    springs = Springs(24)
    levels = Nodes(springs, springs.bins)
    G = np.array([[0.3, -1.1], [0.4, 0.8]])
    shear, bulk = springs.shear, springs.shear  # mu and lambda
    strain = shear * (np.sum(G * G) + np.sum(G * G.T)) + bulk * np.trace(G) ** 2
    for mass in (0.7, 0.0):
        springs.mass[None] = mass
        levels.build()
        found = list(operators(levels))
        assert len(found) >= 3
        for grid, (place, A) in enumerate(found, start=1):
            np.testing.assert_allclose(A, A.transpose(1, 0, 3, 2), atol=1e-12)
            np.testing.assert_allclose(A.sum((0, 1)), 24 * 24 * mass * np.eye(2), atol=1e-9)
            if mass == 0.0:
                u = place * np.array(levels.bins.cell_size) * levels.stride.to_numpy()[grid] @ G.T
                assert np.einsum("na,nmab,mb", u, A, u) == pytest.approx(24 * 24 * strain, rel=1e-9)


@ti.kernel
def inverse_of(levels: ti.template(), size: float) -> ti.types.matrix(2, 2, ti.f32):
    levels.invert(0, size * ti.Matrix([[0.6, 0.2], [0.2, 0.4]]))
    return levels.inverse[0]


def test_a_node_that_particles_hardly_touch_has_an_inverse_in_single_precision():
    """Its block may be so small that the determinant is not a number of f32; last, as it starts Taichi anew."""
    mps.init(arch="cpu", precision="f32")
    springs = Springs(24)
    levels = Nodes(springs, springs.bins)
    for size in (1e-25, 1.0, 1e6):
        found = np.array(inverse_of(levels, size).to_numpy()) * size
        np.testing.assert_allclose(found, np.linalg.inv([[0.6001, 0.2], [0.2, 0.4001]]), rtol=1e-5)
    assert np.all(inverse_of(levels, 1e-38).to_numpy() == 0.0)  # as good as no particle there
