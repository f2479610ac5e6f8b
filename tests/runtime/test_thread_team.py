"""Teams of threads: each waits for the others, whoever they are, and the result is that of one."""

import numpy as np
import pyamg
import pytest

from taichi_mps.runtime import backend
from taichi_mps.runtime import thread_team as team
from taichi_mps.runtime.backend import ti
from tests.support.linear import solve, sparse_matrix

ROWS, ROUNDS = 5000, 1000


@pytest.fixture(scope="module", autouse=True)
def taichi():
    backend.init(arch="cpu", precision="f64", threads=3)


@ti.data_oriented
class Mirror:
    """x_i <- x_(n-1-i) + 1 in each round, and how many did it: each needs what another member did just before."""

    def __init__(self, members):
        self.team = team.Team(members)
        self.x, self.y = (ti.field(ti.i32, ROWS) for _ in range(2))
        self.members = ti.field(ti.i32, ROUNDS)
        self.round = ti.field(ti.i32, ())

    @ti.kernel
    def run(self):
        self.round[None] = 0
        self.team.open(ROWS)
        for turn in range(self.team.turns):
            member = self.team.join(turn)
            if member >= 0:
                while self.team.has(member) and self.round[None] < ROUNDS:
                    this = self.round[None]
                    for i in range(self.team.first(member, ROWS), self.team.last(member, ROWS)):
                        self.y[i] = self.x[ROWS - 1 - i]
                    self.team.wait()
                    for i in range(self.team.first(member, ROWS), self.team.last(member, ROWS)):
                        self.x[i] = self.y[i] + 1
                    for _ in range(self.team.first(member, 1), self.team.last(member, 1)):
                        self.members[this] = self.team.size[None]
                    self.team.wait()
                    self.round[None] = this + 1
                    self.team.regroup()
                self.team.close()

    def members_of_each_round(self):
        """Runs, checks the result, and returns how many took part in each round."""
        self.x.from_numpy(np.arange(ROWS, dtype=np.int32))
        self.run()
        np.testing.assert_array_equal(self.x.to_numpy(), np.arange(ROWS) + ROUNDS)  # an even number of mirrors
        return self.members.to_numpy()


def until(mirror, seen, runs=200):
    """Runs until what is looked for is seen: when a thread comes is up to the machine."""
    return any(seen(mirror.members_of_each_round()) for _ in range(runs))


@pytest.mark.parametrize("members", [1, 2, 3])
def test_members_wait_for_each_other(members):
    mirror = Mirror(members)
    most = [mirror.members_of_each_round().max() for _ in range(10)]
    assert min(most) >= 1 and max(most) <= members
    assert members == 1 or until(mirror, lambda rounds: rounds.max() > 1)


def test_a_thread_that_comes_late_joins_at_a_later_round(monkeypatch):
    monkeypatch.setattr(team, "WELCOME", 0)  # the first does not look for the others before it begins
    assert until(Mirror(2), lambda rounds: rounds[0] == 1 and rounds[-1] == 2)


def test_where_threads_must_wait_too_often_one_goes_on_alone(monkeypatch):
    monkeypatch.setattr(team, "PATIENCE", -10 * ROWS)  # every wait is too long
    mirror = Mirror(2)
    assert until(mirror, lambda rounds: rounds.max() == 2 and rounds[-1] == 1)
    assert mirror.team.rest[None] == team.REST
    for left in range(team.REST - 1, 0, -1):
        assert np.all(mirror.members_of_each_round() == 1) and mirror.team.rest[None] == left


def test_more_members_than_threads_do_not_wait_for_ever():
    assert Mirror(8).members_of_each_round().max() <= 3


def test_a_team_solves_bit_for_bit_as_one_thread():
    a = pyamg.gallery.poisson((70, 70), format="csr")
    b = np.random.default_rng(3).standard_normal(4900)
    (x, report), (y, other) = (solve(sparse_matrix(a), b, team=who) for who in (team.Team(3), team.ONE_THREAD))
    assert report.converged and report.iterations == other.iterations > 50
    np.testing.assert_array_equal(x, y)
    assert np.linalg.norm(a @ x - b) < 1e-8 * np.linalg.norm(b)
