"""What the rows of cavities read off the particles: of known fields, put on particles, it must come back."""

import numpy as np
import pytest

from taichi_mps.validation.fits import fitted
from taichi_mps.validation.fluids import columns
from taichi_mps.validation.vortices import stream_function

ACROSS = 40


def particles(jitter, seed=1):
    g = (np.arange(ACROSS) + 0.5) / ACROSS
    x = np.array(np.meshgrid(g, g, indexing="ij")).reshape(2, -1).T
    return x + np.random.default_rng(seed).uniform(-jitter, jitter, x.shape) / ACROSS


@pytest.mark.parametrize("jitter", [0.0, 0.3])
def test_a_parabola_is_read_exactly(jitter):
    x = particles(jitter)
    places = np.array([(0.5, 0.5), (0.31, 0.97), (0.02, 0.4)])

    def field(p):
        return 1.0 + p[:, 0] - 3.0 * p[:, 1] + 2.0 * p[:, 0] * p[:, 1] - p[:, 0] ** 2 + 4.0 * p[:, 1] ** 2

    assert fitted(places, x, field(x), 1.0 / ACROSS) == pytest.approx(field(places), rel=1e-9)


def test_the_profile_of_a_cavity_is_read_to_a_tenth_of_a_per_cent():
    """The reference's own profile on the particles; its thin layer under the lid is what a mean would smooth."""
    from scipy.interpolate import CubicSpline

    known = columns("C_lid_cavity_ghia.csv", Re="400", component="u(x=0.5 y)")
    order = np.argsort(known["position"])
    profile = CubicSpline(known["position"][order], known["own"][order])
    y = known["position"][(known["position"] > 0.5 / ACROSS) & (known["position"] < 1 - 0.5 / ACROSS)]
    x = particles(0.2)
    read = fitted(np.column_stack([np.full(len(y), 0.5), y]), x, profile(x[:, 1]), 1.0 / ACROSS)
    assert np.sqrt(np.mean((read - profile(y)) ** 2)) < 1e-3


@pytest.mark.parametrize("power", [2, 8])
def test_the_stream_function_of_a_known_flow(power):
    """psi = (y^2 - y^(power + 2)) sin^2(pi x)/power, the lid's speed -psi_y at the middle 1: the larger the power, the
    thinner the layer under the lid."""
    x = particles(0.2)

    def psi(px, py):
        return (py**2 - py ** (power + 2)) * np.sin(np.pi * px) ** 2 / power

    u = -(2 * x[:, 1] - (power + 2) * x[:, 1] ** (power + 1)) * np.sin(np.pi * x[:, 0]) ** 2 / power
    found = stream_function(x, np.column_stack([u, np.zeros_like(u)]), ACROSS)
    nodes = np.linspace(0.0, 1.0, ACROSS + 1)
    exact = psi(nodes[:, None], nodes[None])
    middle = found[ACROSS // 2, : ACROSS - 1], exact[ACROSS // 2, : ACROSS - 1]
    assert middle[0] == pytest.approx(middle[1], abs=3e-3 * exact.max())
    assert found.max() == pytest.approx(exact.max(), rel=3e-3)


@pytest.mark.parametrize("bingham_number", ("2", "5", "10", "20", "50"))
def test_the_references_of_the_bingham_cavity_agree_on_two_grids(bingham_number):
    """To a tenth of what the case allows: its targets are 2 % to Bn = 10 and 4 % above."""
    coarse, fine = (columns("B_bingham_cavity_vortex.csv", n=n, Bn=bingham_number) for n in ("32", "40"))
    tenth = 0.002 if float(bingham_number) <= 10.0 else 0.004
    assert len(coarse["psi"]) == len(fine["psi"]) == 1
    for key in ("psi", "yc"):
        assert coarse[key] == pytest.approx(fine[key], rel=tenth)
