"""Limit analysis: at which height a column of von Mises material fails on a smooth floor under its own weight."""

import numpy as np
import scipy.sparse as sp
from numpy.polynomial.legendre import leggauss
from scipy.interpolate import BSpline
from scipy.sparse.linalg import spsolve

DEGREE = 3


def splines(count: int, length: float, grade: float):
    """Places (q,) and weights (q,) of Gauss points over 0..length, values, first and second derivatives (q, count) of
    cubic B-splines there; their knots are closer towards 0 if ``grade`` is above 1."""
    inner = length * np.linspace(0.0, 1.0, count - DEGREE + 1) ** grade
    knots = np.concatenate([[0.0] * DEGREE, inner, [length] * DEGREE])
    at, weights = leggauss(4)
    middle, half = 0.5 * (inner[1:] + inner[:-1])[:, None], 0.5 * np.diff(inner)[:, None]
    x = (middle + half * at).ravel()
    basis = BSpline(knots, np.eye(count), DEGREE)
    return x, (half * weights).ravel(), *(sp.csr_matrix(basis.derivative(k)(x) if k else basis(x)) for k in range(3))


def column_height(radius: float, ratio: float, across: int = 5, along: int = 20) -> float:
    """Upper bound of the height [m] up to which a column of this radius [m] stands; ratio = tau_y/(rho g) [m].

    Over the velocities u_r = -r phi_z, u_z = 2 phi + r phi_r, free of divergence, that rest on the floor and are rigid
    above the zone Z, with u_z = -1 there, H = Z + [ratio int sqrt(2 D:D) dV + int u_z dV]/(pi R^2) is least. Newton's
    method, with sqrt(2 D:D + e^2) and e towards 0.
    """
    zone = min(10.0 * radius, 3.0**0.5 * ratio)
    r, r_weights, *a = splines(across, radius, 0.7)
    z, z_weights, *b = splines(along, zone, 1.5)
    far = np.repeat(r, len(z))
    volume = np.kron(r_weights, z_weights) * far * 2.0 / radius**2  # over pi R^2
    times_r = sp.diags(far)
    phi, phi_r, phi_rr, phi_z, phi_rz, phi_zz = (
        sp.kron(a[i], b[j]).tocsr() for i, j in ((0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (0, 2))
    )
    rates = [phi_z + times_r @ phi_rz, phi_z, 2.0 * phi_z + times_r @ phi_rz]  # -D_rr, -D_tt, D_zz
    shear = -times_r @ phi_zz + 3.0 * phi_r + times_r @ phi_rr  # 2 D_rz
    parts = [2.0**0.5 * rate for rate in rates] + [shear]  # sqrt(2 D:D) is the length of these
    falling = (2.0 * phi + times_r @ phi_r).T @ volume
    x = np.tile(-0.5 * np.clip(3.0 * np.linspace(0.0, 1.0, along) ** 1.5, 0.0, 1.0), (across, 1))
    free = np.ones_like(x, bool)
    free[:, [0, -2, -1]] = False
    x, free = x.ravel(), np.flatnonzero(free)

    def height(x, e):
        return zone + ratio * volume @ np.sqrt(sum((part @ x) ** 2 for part in parts) + e**2) + falling @ x

    for e in 0.3 * 10.0 ** -np.arange(0.0, 4.0, 0.5) / zone:
        for _ in range(50):
            values = [part @ x for part in parts]
            size = np.sqrt(sum(value**2 for value in values) + e**2)
            gradient = ratio * sum(p.T @ (volume * v / size) for p, v in zip(parts, values, strict=True)) + falling
            mean = sum(sp.diags(v / size) @ p for p, v in zip(parts, values, strict=True))
            hessian = sum(p.T @ sp.diags(volume / size) @ p for p in parts) - mean.T @ sp.diags(volume / size) @ mean
            move = np.zeros_like(x)
            move[free] = -spsolve(ratio * hessian.tocsc()[free][:, free], gradient[free])
            slope, share = gradient @ move, 1.0
            while height(x + share * move, e) > height(x, e) + 1e-4 * share * slope and share > 1e-6:
                share *= 0.5
            x = x + share * move
            if -slope < 1e-9 * zone:
                break
    return height(x, 0.0)
