"""Multigrid on grids of nodes: a symmetric positive definite preconditioner with the same solution and nearly constant
iterations; operators of known energy, and inverses of blocks however small."""

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.engine.linear.node_multigrid import NodeMultigrid
from taichi_mps.engine.runtime.backend import ti
from tests.support.linear import REACH, Nodes, Springs, applied, solve


def solved(springs, grids, across):
    """(solution, report) for a smooth and a rough load."""
    rows = springs.particles.read()
    x = rows["x"]
    b = np.sin(3.0 * x / across) + np.random.default_rng(1).standard_normal(x.shape)[rows["id"]]
    u, report = solve(springs, b.ravel(), 2, tolerance=1e-8, preconditioner=grids, limit=5000)
    assert report.converged
    return u, report


def made(across, periodic=False):
    springs = Springs(across, periodic)
    grids = Nodes(springs, springs.bins)
    grids.build()
    return springs, grids


@pytest.fixture(scope="module")
def small():
    """A body of 24 x 24 particles and its grids."""
    return made(24)


def assert_symmetric_and_positive(springs, grids):
    """v.M w and zero in rows that are no unknowns."""
    rng = np.random.default_rng(2)
    mask = np.abs(springs.inverse_diagonal.to_numpy()).sum((1, 2)) > 0
    a, c = (v * mask[:, None] for v in rng.standard_normal((2, len(mask), 2)))
    Ma, Mc = (m.reshape(-1, 2) for m in applied(grids.apply, np.array([a.ravel(), c.ravel()]), 2))
    assert (a * Mc).sum() == pytest.approx((c * Ma).sum(), rel=1e-12)
    assert (a * Ma).sum() > 0.0 and (c * Mc).sum() > 0.0
    assert not mask.all() and np.all(Ma[~mask] == 0.0)


def test_the_preconditioner_is_symmetric_and_positive():
    """The preconditioner is symmetric and positive for a body that is periodic along one axis."""
    assert_symmetric_and_positive(*made(24, periodic=True))


@pytest.mark.long
def test_nodes_of_a_spray_for_which_there_is_no_room_are_left_out():
    """Drops far from each other touch more nodes of grid 1, of 4 cells each, than there are rows, one for four
    particles: the preconditioner stays symmetric and positive, and the solution is that of Jacobi."""
    across = 100
    grid = np.stack(np.meshgrid(*[np.arange(5.0, across, 10.0)] * 2), -1).reshape(-1, 2)
    x = np.vstack([grid + offset for offset in ((0.0, 0.0), (1.1, 0.3), (0.2, 1.2))])
    springs = Springs(across, x=x)

    class Scarce(Nodes):
        MIN_GRID_ROWS = 9

    grids = Scarce(springs, springs.bins)
    grids.build()
    width = 2.0 * (across + 2 * REACH) / springs.bins.shape[0]  # of a cell between nodes of grid 1
    assert len(np.unique((x + REACH) // width, axis=0)) > len(x) // 4
    assert_symmetric_and_positive(springs, grids)
    coarse, plain = (solved(springs, kind, across)[0] for kind in (grids, None))
    np.testing.assert_allclose(coarse, plain, atol=1e-6 * np.abs(plain).max())


@pytest.mark.slow
def test_levels_change_the_iterations_and_not_the_answer(small):
    """Multigrid gives the solution of Jacobi in a tenth of the iterations, and 16 times as many particles need more of
    them by the ratio of the numbers of grids at most, 6 to 4: each adds no more than its own error."""
    large = made(96)
    plain, many = solved(large[0], None, 96)
    coarse, few = solved(*large, 96)
    np.testing.assert_allclose(coarse, plain, atol=1e-6 * np.abs(plain).max())
    assert few.iterations < 0.1 * many.iterations
    assert few.iterations <= large[1].grids / small[1].grids * solved(*small, 24)[1].iterations


def test_with_few_rows_it_is_jacobi(small):
    springs, _ = small
    grids = NodeMultigrid(springs, springs.bins)
    grids.build()
    v = np.random.default_rng(3).standard_normal((1, 2 * 24**2))
    expected = np.einsum("iab,ib->ia", springs.inverse_diagonal.to_numpy(), v.reshape(-1, 2)).ravel()
    np.testing.assert_allclose(applied(grids.apply, v, 2)[0], expected, rtol=1e-12, atol=1e-14)


# ---- operators on the grids ---------------------------------------------------------------------------------------
def energy(levels, grid, motion):
    """u.A u of the operator on a grid, of a motion (2,) or a linear one (2, 2) with u = motion x."""
    first, shape = levels.first_node[grid], tuple(levels.shape[grid])
    x = np.indices(shape).reshape(2, -1).T * np.array(levels.bins.cell_size) * np.array(levels.stride[grid])
    u = np.zeros((2, levels.nodes, 2))
    u[0, first : first + len(x)] = x @ motion.T if motion.ndim == 2 else motion
    levels.z.from_numpy(u)
    for field in (levels.b, levels.defect):
        field.fill(0.0)
    levels.store_defect(grid)
    return -(u[0] * levels.defect.to_numpy()).sum()


def test_the_operators_of_all_grids_have_the_energy_of_linear_fields(small):
    """On each grid a constant field has the energy of the masses and a linear one, G x, that of the elastic body, since
    the shape functions reproduce both."""
    springs, levels = small
    G = np.array([[0.3, -1.1], [0.4, 0.8]])
    strain = springs.shear * (np.sum(G * G) + np.sum(G * G.T) + np.trace(G) ** 2)  # mu = lambda
    assert levels.grids >= 4
    for mass in (0.7, 0.0):
        springs.mass[None] = mass
        levels.build()
        for grid in range(1, levels.grids):
            for u in np.array([[1.0, 0.0], [0.3, -2.0]]):
                assert energy(levels, grid, u) == pytest.approx(24 * 24 * mass * u @ u, rel=1e-9, abs=1e-9)
            assert mass > 0.0 or energy(levels, grid, G) == pytest.approx(24 * 24 * strain, rel=1e-9)


@ti.kernel
def inverse_of(levels: ti.template(), size: float) -> ti.types.matrix(2, 2, ti.f32):
    levels.set_inverse_diagonal(0, size * ti.Matrix([[0.6, 0.2], [0.2, 0.4]]))
    return levels.inverse[0]


def test_a_node_that_particles_hardly_touch_has_an_inverse_in_single_precision():
    """A block whose determinant underflows in f32 is inverted. Last, because it starts Taichi again."""
    mps.init(arch="cpu", precision="f32")
    _, levels = made(12)
    for size in (1e-25, 1.0, 1e6):
        found = np.array(inverse_of(levels, size).to_numpy()) * size
        np.testing.assert_allclose(found, np.linalg.inv([[0.6001, 0.2], [0.2, 0.4001]]), rtol=1e-5)
    assert np.all(inverse_of(levels, 1e-38).to_numpy() == 0.0)  # as good as no particle there
