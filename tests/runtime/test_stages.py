"""Stages give the same result however they are launched: one by one, in groups, fused into a kernel, by a team,
timed."""

from contextlib import nullcontext

import numpy as np
import pytest

from taichi_mps.engine.runtime.backend import ti
from taichi_mps.engine.runtime.stages import Execution, flush, repeat, sequence, stage, team_stage
from taichi_mps.engine.runtime.thread_team import first, last, wait

WAYS = {"fused": {"rows": 1}, "grouped": {"rows": 1 << 30}, "timed": {"rows": 1, "timed": True}}


@ti.data_oriented
class Numbers:
    """x_i = i + 1, and what stages make of it."""

    def __init__(self):
        self.x, self.three = ti.field(ti.f64, 4), ti.field(ti.i32, ())
        self.three[None] = 3
        self.x.from_numpy(np.arange(1.0, 5.0))

    @stage("add")
    def add(self, amount: ti.f64):
        for i in range(4):
            self.x[i] += amount

    @stage("multiply")
    def multiply(self, factor: ti.f64, times: ti.i32):
        for i in range(4):
            for _ in range(times):
                self.x[i] *= factor

    @stage("divide")
    def divide(self, by: ti.template()):
        for i in range(4):
            self.x[i] /= by[i]

    @sequence("both")
    def both(self, amount: ti.f64, factor: ti.f64):
        self.add(amount)
        if factor != 1:
            self.multiply(factor, 2)
        return self.three

    @team_stage("shared")
    def shared(self, amount: ti.f64):
        for i in range(first(4), last(4)):
            self.x[i] -= amount
        wait()

    def work(self):
        """(((x + 0.1) * 3^2 + 0.1) * 2^2 - 0.7) / 4, and 0 + 1 + 2 times 10 added in a loop."""
        tenth, fours = 0.1, ti.field(ti.f64, 4)
        fours.fill(4.0)
        self.add(tenth)
        self.multiply(3.0, 2)
        self.both(tenth, 2.0)
        self.shared(0.7)
        self.divide(fours)
        for k in repeat(3):
            self.add(k)
            self.multiply(10.0, 1)
            self.divide(fours)
        flush()
        return self.x.to_numpy()


@pytest.mark.parametrize("way", [*WAYS, "at once"])
def test_stages_do_the_same_however_they_are_launched(way):
    with Execution(**WAYS[way]).active() if way in WAYS else nullcontext():
        found = Numbers().work()
    x = (((np.arange(1.0, 5.0) + 0.1) * 9.0 + 0.1) * 4.0 - 0.7) / 4.0
    for k in range(3):
        x = (x + k) * 10.0 / 4.0
    assert found == pytest.approx(x, rel=1e-14)


def test_kernels_are_made_once_and_numbers_are_handed_over_anew():
    """Stages launched again with other numbers use these, not the ones with which the kernel was compiled."""
    execution, numbers = Execution(rows=1), Numbers()
    for amount in (0.25, 1e-300, 7.0):
        before = numbers.x.to_numpy()
        with execution.active():
            numbers.add(amount)
            numbers.multiply(2.0, 1)
        assert numbers.x.to_numpy().tolist() == ((before + amount) * 2.0).tolist()


def test_more_numbers_than_a_kernel_takes_go_to_several_kernels_but_in_a_loop():
    numbers = Numbers()
    with Execution(rows=1).active():
        for k in range(30):
            numbers.add(float(k))
    assert numbers.x.to_numpy().tolist() == [i + 1 + sum(range(30)) for i in range(4)]
    with pytest.raises(ValueError, match="more than 8 numbers for one kernel"), Execution(rows=1).active():
        for _ in repeat(2):
            for k in range(30):
                numbers.add(float(k))


def test_a_timed_execution_knows_its_stages_and_counts_iterations_as_calls():
    execution = Execution(rows=1, timed=True)
    with execution.active():
        Numbers().work()
    calls = {name: calls for name, (seconds, calls) in execution.spent.items() if seconds > 0.0}
    assert calls == {"add": 4, "multiply": 4, "both": 3, "shared": 1, "divide": 4}
