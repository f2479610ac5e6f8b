"""Constitutive laws: the bi-viscosity law of eqs (1)-(3), (5), (9) and the return mapping of the true yield law."""

import numpy as np
import pytest
from scipy.integrate import trapezoid

import taichi_mps as mps
from taichi_mps.engine.runtime.backend import ti
from taichi_mps.engine.terms.rheology import bi_viscosity, magnitude, shear_rate
from taichi_mps.engine.terms.stress import return_mapping

ETA, TAU_Y, PI_C, MU_R = 50.0, 300.0, 0.1, 400.0


@ti.kernel
def mapped(T: ti.types.ndarray(dtype=ti.math.mat3, ndim=1), out: ti.types.ndarray(dtype=ti.f64, ndim=2), spread: float):
    for i in range(T.shape[0]):
        stress, q, rate = return_mapping(T[i], ETA, TAU_Y, MU_R, spread)
        out[i, 0] = magnitude(stress)
        out[i, 1] = magnitude(q)
        out[i, 2] = rate
        out[i, 3] = (stress + 2.0 * MU_R * q - T[i]).norm()  # the trial is split without a rest
        out[i, 4] = (stress * magnitude(T[i]) - T[i] * magnitude(stress)).norm()  # both point the same way


@ti.kernel
def rate_of(G: ti.math.mat3) -> float:
    return shear_rate(G)


@ti.kernel
def viscosity_in_a_kernel(rate: float) -> float:
    return bi_viscosity(rate, ETA, TAU_Y, PI_C)


def deviatoric(sizes, seed=1):
    """Random symmetric trace-free tensors of given |T| = sqrt(T:T/2)."""
    T = np.random.default_rng(seed).standard_normal((len(sizes), 3, 3))
    T = T + T.transpose(0, 2, 1)
    T -= np.trace(T, axis1=1, axis2=2)[:, None, None] / 3.0 * np.eye(3)
    return T * (np.array(sizes) / np.sqrt(0.5 * (T**2).sum((1, 2))))[:, None, None]


def mapping_of(spread):
    """Sizes of trial stresses [Pa] around the yield stress, and what becomes of them."""
    sizes = np.concatenate([[1e-9, 0.5 * TAU_Y, 0.999999 * TAU_Y, 1.000001 * TAU_Y], np.geomspace(1.0, 1e6, 200)])
    T = ti.Matrix.ndarray(3, 3, ti.f64, len(sizes))
    T.from_numpy(deviatoric(sizes))
    out = np.zeros((len(sizes), 5))
    mapped(T, out, spread)
    stress, q, rate, rest, turn = out.T
    assert np.all(rest <= 1e-12 * sizes) and np.all(turn <= 1e-12 * sizes**2)
    return sizes, stress, q, rate


def test_return_mapping_is_the_scalar_closed_form():
    """The mapped stress solves |stress| = tau_y + eta g and |trial| = |stress| + mu_r g, and is rigid below the yield
    stress."""
    size, stress, q, rate = mapping_of(0.0)
    g = np.maximum(0.0, (size - TAU_Y) / (ETA + MU_R))
    assert np.allclose(rate, g, rtol=1e-12, atol=1e-12)
    assert np.allclose(stress, np.where(size <= TAU_Y, size, TAU_Y + ETA * g), rtol=1e-12)
    assert np.allclose(2.0 * q, g, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("spread", [1.0, 40.0, 250.0])
def test_where_the_stress_differs_the_rate_is_the_mean_of_the_law(spread):
    """The rate is the mean of max(0, s - tau_y)/eta over the stresses s within ``spread`` of the particle's."""
    size, stress, q, rate = mapping_of(spread)
    ends = np.maximum(0.0, stress + spread - TAU_Y) ** 2 - np.maximum(0.0, stress - spread - TAU_Y) ** 2
    assert np.allclose(rate, ends / (4.0 * spread * ETA), rtol=1e-9, atol=1e-12)
    assert np.allclose(2.0 * q, rate, rtol=1e-6, atol=1e-9)
    assert (rate[size < TAU_Y] > 0.0).any() and np.all(rate[size < TAU_Y - spread] == 0.0)


@pytest.mark.parametrize(
    ("gradient", "rate"),
    [
        (((0.0, 3.0, 0.0), (0.0,) * 3, (0.0,) * 3), 3.0),  # simple shear
        (((0.0, 3.0, 0.0), (-3.0, 0.0, 0.0), (0.0,) * 3), 0.0),  # rotation
        (np.diag([2.0, 2.0, 2.0]), 0.0),  # pure expansion
        (np.diag([2.0, -2.0, 0.0]), 4.0),  # pure shear
        (((2.0, 5.0, 0.0), (-5.0, -1.0, 0.0), (0.0, 0.0, -1.0)), 2.0 * 3.0**0.5),  # stretched along an axis, and turned
    ],
)
def test_shear_rate(gradient, rate):
    assert rate_of(ti.Matrix(np.array(gradient).tolist())) == pytest.approx(rate, rel=1e-12, abs=1e-12)


def test_bi_viscosity_law_is_continuous_at_the_knee_and_has_two_branches():
    """Pi = 2 D:D, Pi_c = (2 pi_c)^2 (eq 3): mu = eta + tau_y/sqrt(Pi) above Pi_c (eqs 1, 5), eta + tau_y/sqrt(Pi_c)
    below (eqs 2, 9); the stress is mu sqrt(Pi)."""
    knee = 2.0 * PI_C
    above, below = np.geomspace(knee, 1e4, 50), np.geomspace(1e-9, knee, 50)
    flowing, rigid = (np.array([viscosity_in_a_kernel(rate) for rate in rates]) for rates in (above, below))
    assert np.allclose(flowing * above, TAU_Y + ETA * above, rtol=1e-14)
    assert np.allclose(rigid, ETA + TAU_Y / np.sqrt((2 * PI_C) ** 2), rtol=1e-14)
    assert rigid[-1] == pytest.approx(flowing[0], rel=1e-12)
    stress = np.concatenate([rigid * below, flowing * above])
    assert np.all(np.diff(stress) >= 0.0)


# ---- the rational critical strain rate -------------------------------------------------------------------------
def film_errors(wall_stress, eta, tau_y, pi_c, depth=0.1):
    """Excess of the surface speed [m/s] and of the flux [m2/s] of a film of the bi-viscosity law over one of a true
    Bingham material: u' = rate(stress), stress linear in depth, both integrated over it; the stress of the law is
    tabulated from its apparent viscosity and inverted."""
    stress = np.linspace(0.0, wall_stress, 20001)
    rate = np.concatenate([[0.0], np.geomspace(1e-6 * pi_c, 2.0 * pi_c + wall_stress / eta, 20000), [2.0 * pi_c]])
    rate = np.sort(rate)
    law = (eta + tau_y / np.maximum(rate, 2.0 * pi_c)) * rate  # that of bi_viscosity [Pa]
    excess = np.interp(stress, law, rate) - np.maximum(0.0, stress - tau_y) / eta
    below = stress * depth / wall_stress  # depth below the surface [m]: what flows faster above a sheared layer
    return trapezoid(excess, below), trapezoid(excess * below, below)


@pytest.mark.parametrize("tau_y", [50.0, 150.0, 500.0, 1500.0])
@pytest.mark.parametrize("eta", [20.0, 80.0, 350.0, 1500.0])
@pytest.mark.parametrize(("time", "error"), [(5.0, 0.01), (60.0, 0.01), (2.0, 0.1)])
def test_rational_critical_strain_rate_keeps_its_promise_and_wastes_nothing(tau_y, eta, time, error):
    """Films of every wall stress are displaced by at most ``error`` of their depth, and the knee stress is at most
    ``error`` too high; one of the two bounds is nearly reached."""
    pi_c = mps.rational_critical_strain_rate(plastic_viscosity=eta, yield_value=tau_y, time=time, error=error)
    knee = mps.Bingham(plastic_viscosity=eta, yield_value=tau_y, critical_strain_rate=pi_c).knee_stress / tau_y - 1.0
    films = [
        film_errors(s * tau_y, eta, tau_y, pi_c)[0] for s in (0.1, 0.5, 0.9, 1.0, 1.0 + 0.5 * knee, 1.1, 2.0, 10.0)
    ]
    displaced = np.array(films) * time / 0.1
    assert np.all(displaced > 0.0) and displaced.max() <= error * (1.0 + 1e-3)
    assert knee <= error * (1.0 + 1e-9)
    assert max(knee, displaced.max()) > 0.9 * error


@pytest.mark.parametrize("wall_stress", [400.0, 1200.0])
def test_excess_of_a_flowing_film_is_the_closed_form(wall_stress):
    """The excess (R4) is pi_c h at the surface and pi_c h^2 (2 + k)/3 of flux, h the thickness of the plug."""
    plug, k = 0.1 * TAU_Y / wall_stress, 2.0 * ETA * PI_C / TAU_Y
    speed, flux = film_errors(wall_stress, ETA, TAU_Y, PI_C)
    assert speed == pytest.approx(PI_C * plug, rel=1e-4)
    assert flux == pytest.approx(PI_C * plug**2 * (2.0 + k) / 3.0, rel=1e-4)


@pytest.mark.parametrize(
    ("eta", "tau_y", "pi_c"),
    [(50.0, 100.0, 0.1), (50.0, 100.0 - 1e-10, 0.1), (50.0, 0.0, 0.1), (1500.0, 100.0, None), (1500.0, 100.0, 0.00333)],
)
@pytest.mark.filterwarnings("error::UserWarning")
def test_a_knee_stress_within_ten_per_cent_is_silent(eta, tau_y, pi_c):
    """The paper's case #1 has exactly 10 %; a Newtonian fluid and a true yield stress have no knee."""
    assert mps.Bingham(plastic_viscosity=eta, yield_value=tau_y, critical_strain_rate=pi_c)
