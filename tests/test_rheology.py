"""Constitutive laws: the bi-viscosity law of eqs (1)-(3), (5), (9) and the return mapping of the true yield law."""

import numpy as np
import pytest

from taichi_mps.backend import ti
from taichi_mps.rheology import apparent_viscosity, bi_viscosity, magnitude, return_mapping, shear_rate

ETA, TAU_Y, PI_C, MU_R = 50.0, 300.0, 0.1, 400.0


@ti.kernel
def mapped(T: ti.types.ndarray(dtype=ti.math.mat3, ndim=1), out: ti.types.ndarray(dtype=ti.f64, ndim=2)):
    for i in range(T.shape[0]):
        stress, q, rate = return_mapping(T[i], ETA, TAU_Y, MU_R)
        out[i, 0] = magnitude(stress)
        out[i, 1] = magnitude(q)
        out[i, 2] = rate
        out[i, 3] = (stress + 2.0 * MU_R * q - T[i]).norm()  # the trial is split without a rest
        out[i, 4] = (stress * magnitude(T[i]) - T[i] * magnitude(stress)).norm()  # both point the same way


@ti.kernel
def rate_in_a_plane(a: float, b: float, c: float, e: float) -> float:
    return shear_rate(ti.Matrix([[a, b], [c, e]]))


@ti.kernel
def rate_in_space(k: float, turn: float) -> float:
    """Uniaxial stretching k with the rotation ``turn`` added."""
    return shear_rate(ti.Matrix([[k, turn, 0.0], [-turn, -0.5 * k, 0.0], [0.0, 0.0, -0.5 * k]]))


@ti.kernel
def viscosity_in_a_kernel(rate: float) -> float:
    return bi_viscosity(rate, ETA, TAU_Y, PI_C)


def deviatoric(sizes, seed=1):
    """Random symmetric trace-free tensors of given |T| = sqrt(T:T/2)."""
    T = np.random.default_rng(seed).standard_normal((len(sizes), 3, 3))
    T = T + T.transpose(0, 2, 1)
    T -= np.trace(T, axis1=1, axis2=2)[:, None, None] / 3.0 * np.eye(3)
    return T * (np.array(sizes) / np.sqrt(0.5 * (T**2).sum((1, 2))))[:, None, None]


@pytest.fixture(scope="module")
def mapping():
    sizes = np.concatenate([[1e-9, 0.5 * TAU_Y, 0.999999 * TAU_Y, 1.000001 * TAU_Y], np.geomspace(1.0, 1e6, 200)])
    T = ti.Matrix.ndarray(3, 3, ti.f64, len(sizes))
    T.from_numpy(deviatoric(sizes))
    out = np.zeros((len(sizes), 5))
    mapped(T, out)
    return sizes, out.T


def test_return_mapping_is_the_scalar_closed_form(mapping):
    """|stress| = tau_y + eta g and |trial| = |stress| + mu_r g; rigid below the yield value."""
    size, (stress, q, rate, rest, turn) = mapping
    g = np.maximum(0.0, (size - TAU_Y) / (ETA + MU_R))
    assert np.allclose(rate, g, rtol=1e-12, atol=1e-12)
    assert np.allclose(stress, np.where(size <= TAU_Y, size, TAU_Y + ETA * g), rtol=1e-12)
    assert np.allclose(2.0 * q, g, rtol=1e-9, atol=1e-12)
    assert np.all(rest <= 1e-12 * size) and np.all(turn <= 1e-12 * size**2)


def test_stress_never_exceeds_the_law(mapping):
    size, (stress, q, rate, *_) = mapping
    assert np.all(stress <= (TAU_Y + ETA * 2.0 * q) * (1 + 1e-12))
    assert np.all(q[size <= TAU_Y] == 0.0) and np.all(rate[size <= TAU_Y] == 0.0)


def test_shear_rate():
    assert rate_in_a_plane(0.0, 3.0, 0.0, 0.0) == pytest.approx(3.0, rel=1e-12)  # simple shear
    assert rate_in_a_plane(0.0, 3.0, -3.0, 0.0) == pytest.approx(0.0, abs=1e-12)  # rotation
    assert rate_in_a_plane(2.0, 0.0, 0.0, 2.0) == pytest.approx(0.0, abs=1e-12)  # pure expansion
    assert rate_in_a_plane(2.0, 0.0, 0.0, -2.0) == pytest.approx(4.0, rel=1e-12)  # pure shear
    assert rate_in_space(2.0, 5.0) == pytest.approx(2.0 * 3.0**0.5, rel=1e-12)


def test_bi_viscosity_law_is_continuous_at_the_knee_and_has_two_branches():
    """Pi = 2 D:D, Pi_c = (2 pi_c)^2 (eq 3): mu = eta + tau_y/sqrt(Pi) above Pi_c (eqs 1, 5), eta + tau_y/sqrt(Pi_c)
    below (eqs 2, 9); the stress is mu sqrt(Pi)."""
    knee = 2.0 * PI_C
    above, below = np.geomspace(knee, 1e4, 50), np.geomspace(1e-9, knee, 50)
    flowing, rigid = (apparent_viscosity(rate, ETA, TAU_Y, PI_C, np.maximum) for rate in (above, below))
    assert np.allclose(flowing * above, TAU_Y + ETA * above, rtol=1e-14)
    assert np.allclose(rigid, ETA + TAU_Y / np.sqrt((2 * PI_C) ** 2), rtol=1e-14)
    assert rigid[-1] == pytest.approx(flowing[0], rel=1e-12)
    stress = np.concatenate([rigid * below, flowing * above])
    assert np.all(np.diff(stress) >= 0.0)


@pytest.mark.parametrize("rate", [0.0, 0.1, 0.2, 0.3, 40.0])
def test_the_kernel_uses_the_same_law(rate):
    assert viscosity_in_a_kernel(rate) == pytest.approx(apparent_viscosity(rate, ETA, TAU_Y, PI_C), rel=1e-12)
