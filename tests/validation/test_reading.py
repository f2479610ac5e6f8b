"""Readings of the rows of the validation table on known fields, and closed forms against the references."""

import runpy

import numpy as np
import pytest

import taichi_mps as mps
from validation import columns, curved, flows
from validation.vortices import stream_function

ACROSS = 40


@pytest.mark.parametrize("power", [2, 8])
def test_the_stream_function_of_a_known_flow(power):
    """The stream function psi = (y^2 - y^(power + 2)) sin^2(pi x)/power is found; the lid's speed, -psi_y, is 1 in the
    middle, and a larger power makes a thinner layer under the lid."""
    x = mps.lattice((0.0, 0.0), (1.0, 1.0), 1.0 / ACROSS)
    x += np.random.default_rng(1).uniform(-0.2, 0.2, x.shape) / ACROSS

    def psi(px, py):
        return (py**2 - py ** (power + 2)) * np.sin(np.pi * px) ** 2 / power

    u = -(2 * x[:, 1] - (power + 2) * x[:, 1] ** (power + 1)) * np.sin(np.pi * x[:, 0]) ** 2 / power
    found = stream_function(x, np.column_stack([u, np.zeros_like(u)]), ACROSS)
    nodes = np.linspace(0.0, 1.0, ACROSS + 1)
    exact = psi(nodes[:, None], nodes[None])
    middle = found[ACROSS // 2, : ACROSS - 1], exact[ACROSS // 2, : ACROSS - 1]
    assert middle[0] == pytest.approx(middle[1], abs=3e-3 * exact.max())
    assert found.max() == pytest.approx(exact.max(), rel=3e-3)


@pytest.mark.filterwarnings("ignore:critical_strain_rate")
def test_closed_forms_are_those_of_the_references():
    """The closed forms of the bi-viscous channel, the film of the scene, and pipe and circular Couette flow of 50 Pa s
    are those of the references."""
    known = columns("B_poiseuille_bingham_biviscosity.csv")
    film_velocity = runpy.run_path(str(mps.catalogue.names()["film"]))["film_velocity"]
    for eta, tau_y, knee_rate, weight, y, bingham, bi_viscosity, *_ in zip(*known.values(), strict=True):
        height = np.array(0.05 - abs(y))  # the table measures from the surface of a film 0.05 m deep
        ours = flows.profile(height, weight, eta, tau_y, 0.05, knee_rate)
        assert ours == pytest.approx(bi_viscosity, rel=1e-4, abs=1e-9)
        mix = {"plastic_viscosity": eta, "yield_value": tau_y}
        for law, exact in ((mix, bingham), (mix | {"critical_strain_rate": 0.5 * knee_rate}, bi_viscosity)):
            ours = film_velocity(height, 0.05, weight, mps.Bingham(**law))
            assert ours == pytest.approx(exact, rel=1e-4, abs=1e-9)
    for tau_y, push in ((100.0, 8000.0), (100.0, 20000.0)):
        known = columns("B_pipe_buckingham_reiner.csv", **{"mu_Pas": curved.ETA, "ty_Pa": tau_y, "G_Pa/m": push})
        assert curved.pipe_profile(known["r_m"], push, tau_y) == pytest.approx(known["u_m/s"], abs=1e-6)
    for tau_y, turn in ((100.0, 1.0), (100.0, 5.0)):
        known = columns("B_taylor_couette.csv", mu_Pas=curved.ETA, ty_Pa=tau_y, Omega=turn)
        ours = curved.couette_profile(known["r_m"], turn, tau_y)
        assert ours == pytest.approx(known["utheta_m/s"], abs=1e-4 * curved.RADIUS * turn)
