"""Deferred correction of the hourglass resistance: complete for a curved velocity, and none that would let particles
slip."""

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.engine.particles.kernels import lattice_sums
from tests.support.rigs import L0, System, cloud


def weights(x):
    """w/r^2 [1/m2], zero of a particle with itself, and r_ij [m]."""
    r = x[None] - x[:, None]
    size = np.linalg.norm(r, axis=-1) + 9.0 * np.eye(len(r))
    return np.maximum(2.1 * L0 / size - 1.0, 0.0) / size**2, r


def energies(rig, u):
    """By brute force over all bonds: (1/2) h_i (w/r^2) |delta_ij|^2, and its least for what is resisted [W]."""
    w, r = weights(rig.x)
    jump = u[None] - u[:, None]
    inverse = np.linalg.inv(np.einsum("ij,ija,ijb->iab", w, r, r))
    G = np.einsum("ij,ija,ijb->iab", w, jump, r) @ inverse
    left = jump - np.einsum("iab,ijb->ija", G, r)
    opposite = 0.5 * (left - left.transpose(1, 0, 2))
    together = 2.0 * rig.h[:, None] * rig.h / (rig.h[:, None] + rig.h)
    whole = 0.5 * (rig.h[:, None] * w * (left**2).sum(-1)).sum()
    return whole, 0.5 * (together * w * (opposite**2).sum(-1)).sum()


def without_sharp_corners(x):
    """The fit is stiffened in a nearly flat neighbourhood, and is no least-squares fit there."""
    healthy = np.zeros(len(x), bool)
    while not healthy.all():
        w, r = weights(x)
        moment = np.linalg.det(np.einsum("ij,ija,ijb->iab", w, r, r))
        healthy = moment > 0.05 * (lattice_sums(x.shape[1], L0, 2.1 * L0).n0 / x.shape[1]) ** x.shape[1]
        x = x[healthy]
    return x


@pytest.fixture(scope="module", params=[(7, 6), (5, 4, 5)], ids=["2-D", "3-D"])
def rig(request):
    """The resistance alone (neither viscosity, bulk nor inertia) of particles with a random h, and its correction."""
    return System(without_sharp_corners(cloud(request.param)), resistance_only=True)


@pytest.fixture
def velocities(rig):
    return np.random.default_rng(5).normal(size=(2, *rig.x.shape))


def test_it_is_the_force_of_the_energy_that_is_not_resisted(rig, velocities):
    """The energy of the correction is quadratic: half of the power of its own force, which is symmetric in two
    velocities. The rest of the resistance dissipates, and never more than the matrix."""
    u, v = velocities
    whole, resisted = energies(rig, u)
    back, against = rig.correct(u), (rig.multiply(u) * u).sum()
    assert (back * u).sum() == pytest.approx(2.0 * (whole - resisted), rel=1e-10)
    assert (back * v).sum() == pytest.approx((rig.correct(v) * u).sum(), rel=1e-10)
    assert against == pytest.approx(2.0 * whole, rel=1e-10)
    assert 0.0 < resisted < whole and 0.0 < (back * u).sum() < against


def test_curved_motion_of_a_lattice_meets_no_resistance_whatever_the_viscosities():
    """A curved velocity meets no resistance inside, where the fit of a parabola has its gradient: seven layers away
    from the edge."""
    rig = System(mps.lattice((-1.0, -1.0), (1.0, 1.0), L0), resistance_only=True)
    x, y = rig.x.T
    u = np.stack([y**2 - 0.7 * x * y, 0.3 * x**2 + 2.0 * x * y], 1)
    inside = np.abs(rig.x).max(1) < 1.0 - 6.5 * L0
    resisted, back = rig.multiply(u)[inside], rig.correct(u)[inside]
    assert np.abs(resisted).max() > 0.0
    assert np.abs(resisted - back).max() < 1e-10 * np.abs(resisted).max()
