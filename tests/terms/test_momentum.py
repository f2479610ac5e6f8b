"""The implicit system: symmetric, positive definite, equal to a dense matrix, blind to rigid motion."""

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.engine.particles.particles import FLUID, WALL
from tests.support.rigs import BULK, L0, MASS_RATE, System, cloud

FLOOR = mps.Plane((0.0, -0.33), (0.0, 1.0), velocity=(0.5, 0.0))


def mixed():
    """A small 3-D cloud on a layer of wall particles, with a single particle and a line of four apart."""
    x = cloud((3, 3, 3))
    lines = np.array([[1.0, 1.0, 1.0], [-1.0, -1, 1], [-1.0, -1.1, 1], [-1.0, -1.2, 1], [-1.0, -1.3, 1]])
    kinds = np.where(x[:, 2] < -0.05, WALL, FLUID)
    return np.vstack([x, lines]), np.concatenate([kinds, np.full(5, FLUID)])


SLIP = mps.Plane((0.0, -0.33), (0.0, 1.0), slip=True), mps.Plane((-0.29, 0.0), (1.0, 0.0), slip=True)
MIRROR = mps.Plane((0.0, 0.0), (1.0, 0.0), mirror=True)
RINGS = cloud((5, 5)) + (0.3, 0.0)  # beside the axis
SYSTEMS = {
    "plain": lambda: System(cloud((6, 5))),
    "with walls": lambda: System(*mixed()),
    "no slip": lambda: System(cloud((5, 6)), planes=(FLOOR,)),
    "slip": lambda: System(cloud((5, 6)), planes=SLIP),
    "mirror": lambda: System(cloud((5, 5)) + 0.3, planes=(mps.Plane((0.0, 0.0), (0.0, 1.0)), MIRROR)),
    "rings": lambda: System(RINGS, planes=(FLOOR, MIRROR), rings=2.0 * np.pi * RINGS[:, 0] * L0**2),
}


@pytest.fixture(scope="module", params=SYSTEMS)
def system(request):
    return SYSTEMS[request.param]()


def on(*names):
    """Run a test on these systems."""
    return pytest.mark.parametrize("system", names, indirect=True)


def test_matrix_is_symmetric_positive_definite(system):
    A, blocks = system.dense()
    assert np.abs(A - A.T).max() < 1e-12 * np.abs(A).max()
    least = MASS_RATE * system.volumes.min() / system.volume
    assert np.linalg.eigvalsh(A)[0] >= least * (1 - 1e-9)  # the viscous part alone never gains energy
    inverse = system.inverse_diagonal()[system.unknown]
    assert np.linalg.eigvalsh(inverse).min() > 0.0
    assert np.allclose(inverse, inverse.transpose(0, 2, 1), rtol=1e-12)


@on("plain", "with walls", "no slip")
def test_block_jacobi_is_the_inverse_of_the_diagonal_blocks(system):
    _, blocks = system.dense()
    inverse = system.inverse_diagonal()
    assert np.allclose(inverse[system.unknown] @ blocks, np.eye(system.dimension), atol=1e-9)
    assert not np.any(inverse[~system.unknown])  # a zero block marks a row that is not an unknown


@on("with walls")
def test_translation_meets_no_resistance_however_few_the_neighbours(system):
    apart = np.linalg.norm(system.x, axis=1) > 1.0
    u = np.where(apart[:, None], [1.0, 2.0, -3.0], 0.0)
    assert apart.sum() == 5
    assert np.abs(system.multiply(u) - MASS_RATE * u).max() < 1e-9 * BULK * L0


@on("plain")
def test_expansion_is_resisted_by_the_bulk_and_shear_by_the_viscosity(system):
    """The work of a linear field, u.A u - m/dt u.u, is V sum (2 mu D':D' + K (div u)^2): H does not resist affine
    motion."""
    for A in (np.diag([1.0, 1.0]), np.array([[0.0, 2.0], [0.0, 0.0]]), np.array([[0.7, -0.4], [1.1, 0.2]])):
        u = system.x @ A.T
        D = 0.5 * (A + A.T) - 0.5 * np.trace(A) * np.eye(2)
        work = (u * (system.multiply(u) - MASS_RATE * u)).sum()
        expected = system.volume * (2.0 * system.mu * (D**2).sum() + BULK * np.trace(A) ** 2).sum()
        assert work == pytest.approx(expected, rel=1e-9)


@on("no slip")
def test_moving_wall_drags_the_fluid(system):
    """A moving wall acts as A applied to u - u_wall: fluid that moves with the wall feels no force."""
    push = system.push_of_moving_walls()
    u = np.tile(FLOOR.velocity, (len(system.x), 1))
    assert push.sum(0) @ FLOOR.velocity > 0.0
    assert np.abs(system.multiply(u) - MASS_RATE * u - push).max() < 1e-9 * np.abs(push).max()
