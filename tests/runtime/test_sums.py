"""Sums over rows by the algorithm for GPUs, run on the processor, against those of NumPy and of the processor."""

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.engine.linear.node_multigrid import NodeMultigrid
from taichi_mps.engine.runtime.backend import ti
from taichi_mps.engine.runtime.sums import CHUNK, running_sums
from tests.support.devices import as_gpu


@pytest.fixture
def gpu(monkeypatch):
    as_gpu(monkeypatch)


@pytest.mark.parametrize("n", [0, 1, CHUNK - 1, CHUNK, CHUNK + 1, 3 * CHUNK - 1, 3 * CHUNK, 3 * CHUNK + 7])
def test_running_sums_in_chunks_are_those_of_numpy(gpu, n):
    counts = np.random.default_rng(n).integers(0, 9, n + 2).astype(np.int32)
    field = ti.field(ti.i32, n + 2)
    field.from_numpy(counts)

    @ti.kernel
    def add_up(many: ti.i32):
        running_sums(field, many)

    add_up(n)
    assert np.array_equal(field.to_numpy(), [*np.cumsum(counts[: n + 1]), counts[n + 1]])


@pytest.mark.slow
def test_a_step_with_multigrid_is_that_of_the_processor(monkeypatch):
    monkeypatch.setattr(NodeMultigrid, "MIN_ROWS", 0)
    monkeypatch.setattr(NodeMultigrid, "SMALL_ROWS", 100)  # some grids by all threads of a GPU, others by one block
    reports = []
    for start in (lambda _: mps.init(precision="f64"), as_gpu):
        start(monkeypatch)
        sim = mps.Simulation(mps.slump_cone(yield_value=500.0, spacing=0.0119))  # more rows than one thread works at
        for _ in range(3):
            report = sim.step()
        reports.append((report.solver_iterations, report.kinetic_energy, report.volume_error, report.residual))
    assert reports[0] == pytest.approx(reports[1], rel=1e-7)  # rounding: 4e-9
