"""Neighbour lists against brute force, the order of the rows, full lists and lost particles."""

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.engine.particles.neighbors import CapacityError, EscapedError, NeighborList
from tests.support.rigs import lists, particles

RE, CAPACITY = 0.105, 240
DOMAINS = {  # name: low corner, high corner, periodic
    "2-D": ((-0.5, 0.0), (0.5, 0.8), (False, False)),
    "2-D periodic, 3 cells": ((-0.5, 0.0), (-0.18, 0.32), (True, True)),
    "3-D": ((0.0, -0.2, 0.0), (0.4, 0.2, 0.7), (False, False, False)),
    "3-D periodic": ((0.0, -0.2, 0.0), (0.4, 0.2, 0.7), (True, True, False)),
    "3-D all periodic": ((0.0, -0.2, 0.0), (0.4, 0.2, 0.7), (True, True, True)),
}
SETS = ("random", "clustered", "empty", "lattice", "corners", "one", "two")


class Rig:
    """Particles, bins and a list that every set of positions is loaded into, so that kernels compile once."""

    def __init__(self, low, high, periodic):
        self.low, self.high, self.periodic = np.array(low), np.array(high), np.array(periodic)
        x = np.zeros((CAPACITY, len(low)))
        self.particles = particles(x)
        self.list = lists(self.particles, (low, high), periodic, CAPACITY, RE)
        self.bins = self.list.bins

    def load(self, x, ids=None):
        ids = np.arange(len(x)) if ids is None else ids
        self.particles.load({"x": x, "u": 2.0 * x, "id": ids, "kind": ids % 3})
        self.list.search()
        return self.particles.read()

    def pairs(self):
        """Neighbours' rows of every row."""
        start, column = self.list.row_start.to_numpy(), self.list.column.to_numpy()
        return [column[start[i] : start[i + 1]] for i in range(self.particles.count[None])]

    def points(self, kind):
        rng = np.random.default_rng(3)
        low, size, d = self.low, self.high - self.low, len(self.low)
        corners = np.stack(np.meshgrid(*zip(low, self.high, strict=True)), -1).reshape(-1, d)
        random = low + size * rng.random((CAPACITY, d))
        clump = low + 0.5 * size + 0.02 * rng.standard_normal((CAPACITY - 20, d))
        return {
            "random": random,
            "clustered": np.vstack([clump, random[:20]]),  # most of them in one cell, a few far away
            "empty": mps.lattice(low, self.high, 1.3 * RE)[:CAPACITY],  # nobody near, across the periodic sides neither
            "lattice": mps.lattice(low, self.high, 0.05 if d == 2 else 0.08)[:CAPACITY],
            "corners": np.vstack([corners[: 2 ** (d - 1)], low + 0.02, self.high - 0.02]),
            "one": clump[:1],
            "two": clump[:2],
        }[kind]

    def brute_force(self, x):
        """{(row, row)} of all ordered pairs nearer than RE, by distances to the nearest image."""
        r = x[None] - x[:, None]
        size = self.high - self.low
        r -= np.where(self.periodic, size * np.round(r / size), 0.0)
        near = (r**2).sum(-1) < RE**2
        np.fill_diagonal(near, False)
        return {(int(i), int(j)) for i, j in zip(*np.nonzero(near), strict=True)}


@pytest.fixture(scope="module", params=list(DOMAINS))
def rig(request):
    return Rig(*DOMAINS[request.param])


@pytest.mark.parametrize("kind", SETS)
@pytest.mark.numbering("rows are in the order of the numbers")
def test_neighbours_are_those_of_brute_force_in_rows_ordered_by_cell_and_id(rig, kind):
    """Neighbours are those of brute force and rows are ordered by cell and id, whatever the order before."""
    x = rig.points(kind)
    rows = rig.load(x)
    listed = [(i, int(j)) for i, columns in enumerate(rig.pairs()) for j in columns]
    expected = rig.brute_force(rows["x"])
    assert len(listed) == len(set(listed))
    assert set(listed) == expected
    assert kind != "empty" or not listed
    assert rig.periodic.any() or listed == sorted(listed)  # sums over neighbours run in row order
    cell_size = (rig.high - rig.low) / rig.bins.shape
    cell = np.clip(np.floor((rows["x"] - rig.low) / cell_size).astype(int), 0, np.array(rig.bins.shape) - 1)
    linear = np.ravel_multi_index(cell.T, rig.bins.shape)
    assert np.array_equal(np.lexsort((rows["id"], linear)), np.arange(len(x)))
    assert np.array_equal(rig.bins.cell_of.to_numpy()[: len(x)], linear)
    assert np.array_equal(rows["u"], 2.0 * x[rows["id"]])  # every field moved with its particle
    assert np.array_equal(rows["kind"], rows["id"] % 3)
    shuffled = np.random.default_rng(5).permutation(len(x))
    assert np.array_equal(rig.load(x[shuffled], shuffled)["id"], rows["id"])


def test_periodic_positions_come_back_into_the_domain(rig):
    x = rig.points("random")
    shift = np.where(rig.periodic, rig.high - rig.low, 0.0)
    rows, moved = rig.load(x), rig.load(x + 2 * shift)
    assert np.array_equal(moved["id"], rows["id"])
    assert np.allclose(moved["x"], rows["x"], atol=1e-12)


def test_lost_particles_are_counted_each_once(rig):
    x = rig.points("random")
    x[3, -1] = rig.high[-1] + 1e-6
    x[7] = np.nan
    x[9, 0] = np.inf
    x[11] = rig.low - 1.0
    x[13] = np.where(rig.periodic, rig.low - 1.0, rig.low)  # comes back in through the periodic sides
    lost = 2 + (not rig.periodic[-1]) + (not rig.periodic.all())
    with pytest.raises(EscapedError, match=f"^{lost} particles left the domain"):
        rig.load(x)
    assert len(rig.load(rig.points("random"))["x"]) == CAPACITY  # usable afterwards


def test_list_is_full_at_its_capacity_and_not_before():
    rig = Rig(*DOMAINS["2-D"])
    expected = rig.brute_force(rig.load(rig.points("clustered"))["x"])
    rig.list = NeighborList(rig.bins, len(expected))
    rig.list.search()
    assert {(i, int(j)) for i, columns in enumerate(rig.pairs()) for j in columns} == expected
    message = f"{len(expected)} neighbour pairs do not fit into pair_capacity = {len(expected) - 1}"
    with pytest.raises(CapacityError, match=message):
        NeighborList(rig.bins, len(expected) - 1).search()
