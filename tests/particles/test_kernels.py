"""Lattice sums n0 and lambda (eqs 13, 14) and the sums over the ghost lattice behind a plane wall."""

import csv
import itertools
from pathlib import Path

import numpy as np
import pytest

from taichi_mps.engine.particles.kernels import (
    GHOST_SUMS,
    PACKING,
    PACKING_IN_PLANE,
    ghost_table,
    lattice_sums,
    mps_weight,
    smooth_weight,
)

REFERENCE = Path(__file__).parents[1] / "reference" / "C_mps_lattice_constants_viscous_limit.csv"
ROWS = list(csv.DictReader(line for line in REFERENCE.read_text(encoding="utf-8").splitlines() if line[0] != "#"))
RE = 2.1


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row['dim']}-D re {row['re/l0']}")
@pytest.mark.parametrize("spacing", [1.0, 0.01])
def test_lattice_constants(row, spacing):
    found = lattice_sums(int(row["dim"]), spacing, float(row["re/l0"]) * spacing)
    assert found.neighbours == int(row["neighbours"])
    assert found.n0 == pytest.approx(float(row["n0"]), rel=1e-5)  # the file has six digits
    assert found.lam / spacing**2 == pytest.approx(float(row["lambda/l0^2"]), rel=1e-5)


def full_lattice(dimension, weight=mps_weight):
    """Displacements [l0] of the neighbours in a full lattice and their weights."""
    r = np.array([c for c in itertools.product(range(-3, 4), repeat=dimension) if any(c)], float)
    size = np.linalg.norm(r, axis=1)
    near = size < RE
    return r[near], size[near], weight(size[near] / RE)


@pytest.mark.parametrize("dimension", [2, 3])
def test_the_smooth_weight_by_hand(dimension):
    """w/r^2 is Wendland's kernel, summed by hand over 4, 4 and 4 neighbours in two dimensions, 6, 12 and 8 and 6 in
    three."""
    distances, many = ([1.0, 2.0, 4.0], [4, 4, 4]) if dimension == 2 else ([1.0, 2.0, 3.0, 4.0], [6, 12, 8, 6])
    q = np.sqrt(distances) / RE
    kernel = (1.0 - q) ** 4 * (4.0 * q + 1.0)
    found = lattice_sums(dimension, 1.0, RE, smooth_weight)
    assert found.n0 == pytest.approx(many @ (kernel * q**2), rel=1e-12)
    assert found.lam == pytest.approx(many @ (kernel * q**2 * distances) / found.n0, rel=1e-12)


@pytest.mark.parametrize("weight", [mps_weight, smooth_weight], ids=["paper", "smooth"])
@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("layer", [0, 1])
def test_ghosts_complete_the_lattice(dimension, layer, weight):
    """A particle at z = l0/2 or 3 l0/2 has, with the ghosts, exactly the neighbourhood of the interior. In the
    tangential moment ghosts at depth d count 1 + d/z times: they carry -(d/z) times the velocity of the particle."""
    z = layer + 0.5
    row = ghost_table(dimension, 1.0, RE, 22, weight=weight)[int(10 * z)]  # at z = 2.1 k/21
    sums = dict(zip(GHOST_SUMS, row, strict=True))
    lattice = lattice_sums(dimension, 1.0, RE, weight)
    r, size, w = full_lattice(dimension, weight)
    real = r[:, -1] > -z
    normal, e = r[:, -1], r[:, -1] / size
    tangential = (w / size**2 * r[:, 0] ** 2 * -normal / z)[~real].sum()
    assert sums["tangential"] == pytest.approx(tangential, rel=1e-13)
    near = np.maximum(0.0, 1.0 - size / 1.5)
    assert real.sum() + sums["neighbours"] == lattice.neighbours
    assert w[real].sum() + sums["n"] == pytest.approx(lattice.n0, rel=1e-13)
    moment = (w / size**2 * normal**2)[real].sum() + sums["normal"]
    assert moment == pytest.approx(lattice.n0 / dimension, rel=1e-13)
    assert (w * e)[real].sum() == pytest.approx(sums["inward"], rel=1e-13)  # the pull of both sides balances
    assert (near * e)[real].sum() == pytest.approx(sums["repulsion"], abs=1e-13)
    assert (w / size**2 * normal)[real].sum() == pytest.approx(0.5 * sums["gradient"], rel=1e-13)
    crowd = 1.0 + PACKING(size / RE)[real].sum() + sums["packing"]
    assert crowd == pytest.approx(lattice.packing, rel=1e-13)


@pytest.mark.parametrize(("kernel", "b"), [(PACKING, 10.0), (PACKING_IN_PLANE, 11.0)])
def test_the_packing_kernel_is_the_window_of_kaiser_and_bessel(kernel, b):
    """The packing kernel is (I0(b sqrt(1 - q^2)) - 1)/(I0(b) - 1), 1 at the particle and 0 at the effective radius."""
    q = np.linspace(0.0, 1.0, 101)
    assert np.abs(kernel(q) - (np.i0(b * np.sqrt(1.0 - q**2)) - 1.0) / (np.i0(b) - 1.0)).max() < 1e-7


@pytest.mark.parametrize("basis", [
    [[1.0, 0.0], [0.5, 0.75**0.5]],  # hexagonal
    [[1.0, 0.0], [0.25, 1.0]], [[1.0, 0.0], [0.5, 1.0]],  # square, sheared
    [[-1.0, 1.0, 1.0], [1.0, -1.0, 1.0], [1.0, 1.0, -1.0]],  # body-centred cubic
    [[0.0, 1.0, 1.0], [1.0, 0.0, 1.0], [1.0, 1.0, 0.0]],  # face-centred cubic
    [[1.0, 0.0, 0.0], [0.25, 1.0, 0.0], [0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0], [0.5, 1.0, 0.0], [0.0, 0.0, 1.0]],
])  # fmt: skip
def test_packing_of_other_lattices_of_the_same_density(basis):
    """The packing does not depend on order: other lattices have that of the square or simple cubic lattice within 0.4
    %, with the kernel of the plane within 0.06 %."""
    basis = np.array(basis)
    d = len(basis)
    basis /= abs(np.linalg.det(basis)) ** (1.0 / d)  # one particle in each unit of volume
    q = np.linalg.norm(np.array(list(itertools.product(range(-6, 7), repeat=d))) @ basis, axis=1) / RE
    for kernel, within in ((PACKING, 4e-3), (PACKING_IN_PLANE, 6e-4))[: 4 - d]:  # rings have the first, too
        expected = lattice_sums(d, 1.0, RE, smooth_weight, kernel).packing
        assert kernel(q[q < 1.0]).sum() == pytest.approx(expected, rel=within)
