"""Teams of threads: members wait for each other, and the result is that of one thread."""

import numpy as np
import pytest
import scipy.sparse as sp

from taichi_mps.engine.runtime import backend
from taichi_mps.engine.runtime import thread_team as team
from taichi_mps.engine.runtime.backend import ti
from taichi_mps.engine.runtime.stages import Execution, stage, team_stage
from tests.support.linear import solve, sparse_matrix

ROWS, ROUNDS = 5000, 1000


@pytest.fixture(scope="module", autouse=True)
def taichi():
    backend.init(arch="cpu", precision="f64", threads=3)


@ti.data_oriented
class Mirror:
    """x_i <- x_(n-1-i) + 1 in each round, and how many did it: each needs what another member did just before."""

    def __init__(self, members):
        self.team = team.ThreadTeam(members)
        self.execution = Execution(ROWS, team=self.team)
        self.x, self.y = (ti.field(ti.i32, ROWS) for _ in range(2))
        self.members = ti.field(ti.i32, ROUNDS)
        self.round = ti.field(ti.i32, ())

    @team_stage("mirror")
    def mirror(self):
        while team.takes_part() and self.round[None] < ROUNDS:
            self.turn_round()
            team.barrier()

    @stage("round")
    def turn_round(self):
        for i in range(team.first(ROWS), team.last(ROWS)):
            self.y[i] = self.x[ROWS - 1 - i]
        team.wait()
        for i in range(team.first(ROWS), team.last(ROWS)):
            self.x[i] = self.y[i] + 1
        for _ in range(team.first(1), team.last(1)):
            self.members[self.round[None]] = self.team.size[None]
        team.wait()
        for _ in range(team.first(1), team.last(1)):
            self.round[None] += 1
        team.wait()

    def members_of_each_round(self):
        """Runs, checks the result, and returns how many took part in each round."""
        self.x.from_numpy(np.arange(ROWS, dtype=np.int32))
        self.round[None] = 0
        with self.execution.active():
            self.mirror()
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
    monkeypatch.setattr(team, "JOIN_POLLS", 0)  # the first does not look for the others before it begins
    monkeypatch.setattr(team, "MAX_POLLS", 1 << 30)  # however busy the machine is, no wait is too long
    assert until(Mirror(2), lambda rounds: rounds[0] == 1 and rounds[-1] == 2)


def test_where_threads_must_wait_too_often_one_goes_on_alone(monkeypatch):
    monkeypatch.setattr(team, "MAX_POLLS", -10 * ROWS)  # every wait is too long
    monkeypatch.setattr(team, "SOLO_KERNELS", 20)
    mirror = Mirror(2)
    assert until(mirror, lambda rounds: rounds.max() == 2 and rounds[-1] == 1)
    assert mirror.team.solo_kernels[None] == team.SOLO_KERNELS
    for left in range(team.SOLO_KERNELS - 1, 0, -1):
        assert np.all(mirror.members_of_each_round() == 1) and mirror.team.solo_kernels[None] == left


def test_more_members_than_threads_do_not_wait_for_ever():
    assert Mirror(8).members_of_each_round().max() <= 3


def test_a_team_solves_bit_for_bit_as_one_thread():
    line = 2 * np.eye(70) - np.eye(70, k=1) - np.eye(70, k=-1)
    a = sp.kronsum(line, line, format="csr")
    b = np.random.default_rng(3).standard_normal(4900)
    (x, report), (y, other) = (
        solve(sparse_matrix(a), b, launch={"rows": rows, "team": who})
        for rows, who in ((4900, team.ThreadTeam(3)), (1, None))
    )
    assert report.converged and report.iterations == other.iterations > 50
    np.testing.assert_array_equal(x, y)
    assert np.linalg.norm(a @ x - b) < 1e-8 * np.linalg.norm(b)
