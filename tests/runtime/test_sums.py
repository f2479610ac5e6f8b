"""Sums and loops over rows as a GPU does them, run on the processor, against NumPy, the processor and a count."""

import numpy as np
import pytest
import scipy.sparse as sp

import taichi_mps as mps
from taichi_mps.engine.linear.node_multigrid import NodeMultigrid
from taichi_mps.engine.runtime import stages
from taichi_mps.engine.runtime.backend import ti
from taichi_mps.engine.runtime.stages import Execution, block_stage, loop_stage
from taichi_mps.engine.runtime.sums import CHUNK, running_sums
from taichi_mps.engine.runtime.thread_team import first, last, wait
from taichi_mps.engine.runtime.workarounds import HAS_DEVICE_LOOPS
from taichi_mps.engine.schemes.implicit import ImplicitScheme
from tests.support.devices import as_gpu
from tests.support.linear import solve, sparse_matrix, spd


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


@ti.data_oriented
class Rows:
    """Numbers x of rows, as many as a field tells."""

    def __init__(self, rows: int):
        self.rows, self.x = ti.field(ti.i32, ()), ti.field(ti.i32, 100)
        self.rows[None] = rows

    @loop_stage("add")
    def add(self, amount: ti.template()):
        for i in range(first(self.rows[None]), last(self.rows[None])):
            self.x[i] += amount
        wait()

    @block_stage("add twice")
    def add_twice(self):
        for amount in range(100, 102):
            self.add(amount)


@pytest.mark.parametrize("rows", [0, 1, 7, 8, 9, 100])
def test_threads_of_a_gpu_take_each_row_once_and_are_started_once_a_loop(monkeypatch, rows):
    monkeypatch.setenv("TI_KERNEL_PROFILER", "1")
    monkeypatch.setenv("QD_KERNEL_PROFILER", "1")
    as_gpu(monkeypatch)
    numbers, profiler = Rows(rows), ti.profiler.kernel_profiler.get_default_kernel_profiler()
    ti.profiler.clear_kernel_profiler_info()
    with Execution(rows=8).active():
        numbers.add(1)
        numbers.add_twice()
        numbers.add(10)
    profiler._update_records()
    assert [record.name.split("kernel_")[-1] for record in profiler._traced_records] == [
        f"{k}_range_for" for k in range(3)
    ]  # one kernel, and no thread before a loop to read its length
    assert numbers.x.to_numpy().tolist() == [1 + 100 + 101 + 10] * rows + [0] * (100 - rows)


of_quadrants = pytest.mark.skipif(not HAS_DEVICE_LOOPS, reason="a graph that repeats itself, of Quadrants")


@of_quadrants
def test_a_solve_that_a_gpu_repeats_has_the_bits_of_one_that_asks_python_at_each_iteration(gpu, monkeypatch):
    a, b = spd(40), np.random.default_rng(1).standard_normal(40)
    found = []
    for on_device in (True, False):
        monkeypatch.setattr(stages, "HAS_DEVICE_LOOPS", on_device)
        x, report = solve(sparse_matrix(sp.csr_matrix(a)), b)
        found.append((x.tobytes(), report.iterations))
        assert not solve(sparse_matrix(sp.csr_matrix(a)), b, limit=0)[0].any()
    assert found[0] == found[1] and np.frombuffer(found[0][0]) == pytest.approx(np.linalg.solve(a, b), abs=1e-8)


@of_quadrants
@pytest.mark.slow
def test_an_outer_iteration_on_a_gpu_is_one_kernel_with_the_bits_of_those_between_which_python_reads(gpu, monkeypatch):
    """Also where the guess already solves the system: Python then starts two kernels and reads a number."""
    events, found = [], []

    def noted(event, method):
        return lambda *arguments: events.append(event) or method(*arguments)

    for event, owner, name in (
        ("iterate ", ImplicitScheme, "iterate"),
        ("launch ", Execution, "_launch_kernel"),
        ("read ", ti.ScalarField, "__getitem__"),
    ):
        monkeypatch.setattr(owner, name, noted(event, getattr(owner, name)))
    x, domain = mps.lattice((0.0, 0.0), (0.06, 0.06), 0.02), ((-0.1, -0.1), (0.2, 0.2))
    sim = mps.Simulation(mps.Scene("block", mps.Newtonian(viscosity=100.0), 0.02, x, domain, velocity=x[:, ::-1]))
    start = sim.state()
    for again in (sim.execution._again, None):
        monkeypatch.setattr(sim.execution, "_again", again)
        sim.load(start)
        found.append([sim.step().solver_iterations, sim.snapshot().u.tobytes()])
        found.append(set("".join(events).split("iterate ")[1:-1]))  # the last one goes on to the end of the step
    assert found[0] == found[2] and found[1] == {"launch "} and "launch read launch " in found[3]


@pytest.mark.long
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
