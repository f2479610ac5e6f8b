"""A step of few particles: the same stages in a handful of kernels, and stage by stage where they are timed."""

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.runtime import stages
from taichi_mps.runtime.backend import ti
from taichi_mps.terms import shifting

SPACING = 0.02
STAGES = "drift reorder neighbours gradient sleep smooth-pressure prepare system right-hand-side solve stress shift"


@ti.data_oriented
class Numbers:
    def __init__(self):
        self.x = ti.field(ti.i32, 4)

    @stages.stage
    def add(self, amount: ti.i32):
        for i in range(4):
            self.x[i] += amount

    @ti.kernel
    def add_often(self, times: ti.i32):
        ti.loop_config(serialize=True)
        for k in range(times):
            self.add(k)


def test_a_stage_is_a_kernel_in_python_and_a_part_of_one_in_a_kernel():
    numbers = Numbers()
    numbers.add(5)
    numbers.add_often(4)
    assert numbers.x.to_numpy().tolist() == [5 + 0 + 1 + 2 + 3] * 4


def test_iterations_of_a_stage_count_as_calls():
    timed, quick = stages.Stages(timed=True), stages.Stages()
    for result in (None, 7):
        for run in (timed, quick):
            assert run("solve", lambda value: value, result) == result
    assert [(name, calls) for name, (_, calls) in timed.spent.items()] == [("solve", 8)] and quick.spent == {}


@pytest.mark.long
def test_few_kernels_do_what_the_stages_do_one_by_one(monkeypatch):
    """One step agrees to round-off; in later ones the iterations of the solve amplify that, up to their tolerance. The
    disturbance of the shift is left out: it follows from the last bits of the place."""
    monkeypatch.setattr(shifting, "UNEVENNESS", 0.0)
    x = mps.fill(mps.Box((0.0, 0.0), (0.1, 0.1)), SPACING)
    floor = mps.Plane((0.0, 0.0), (0.0, 1.0))
    material = mps.Bingham(plastic_viscosity=50.0, yield_value=300.0)
    scene = mps.Scene("block", material, SPACING, x, ((-0.5, -0.5), (0.5, 0.5)), walls=(floor,))
    sim = mps.Simulation(scene, mps.Implicit(sleep=True))
    launches, start_kernel = [], ti.lang.kernel_impl.Kernel.__call__

    def counted(kernel, *arguments):
        launches.append(kernel.func.__name__)
        return start_kernel(kernel, *arguments)

    start, ends, counts = sim.state(), [], []
    for timed in (False, True):
        sim.stages.timed = timed
        sim.load(start)
        sim.step()
        ends.append(sim.snapshot())
        for _ in range(9):
            sim.step()
        with monkeypatch.context() as patch:
            patch.setattr(ti.lang.kernel_impl.Kernel, "__call__", counted)
            launches.clear()
            sim.step()
        counts.append(len(launches))
        ends.append(sim.snapshot())
    assert counts[0] <= 6 and counts[1] > 30
    assert np.abs(ends[1].x - scene.initial).max() > 0.1 * SPACING  # it has moved
    for k, tolerance in enumerate((1e-9, 1e-5)):
        assert ends[k].x == pytest.approx(ends[k + 2].x, rel=0, abs=tolerance * SPACING)
    assert {name.replace(" ", "-") for name, _, _ in sim.profile()} >= set(STAGES.split())
