"""Processes, threads, several Simulations and repeated init: each works, or one clear error says how to do it."""

import os
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.engine.runtime.backend import ti
from taichi_mps.input import catalogue
from tests.support.child import child


def film(**keywords):
    return mps.Simulation(catalogue.build("film", depth=0.04, spacing=0.01, until=0.05, **keywords))


def steps(sim, count):
    for _ in range(count):
        sim.step()
    return sim.snapshot().u


def in_threads(*calls):
    """What calls return or raise, each in a thread of its own, all at once."""
    with ThreadPoolExecutor(len(calls)) as pool:
        futures = [pool.submit(call) for call in calls]
    return [future.exception() or future.result() for future in futures]


@pytest.mark.long
def test_two_simulations_take_turns_or_step_at_once_and_do_not_mix_until_init_is_called_again():
    """Two simulations are independent in turn and in parallel; the first step is taken in the thread that called
    init(), in which a Simulation is made."""
    sims = film(angle=20.0), film(angle=10.0)
    for error in in_threads(film, sims[0].step):
        assert isinstance(error, RuntimeError) and "takes its first step, in that which called init()" in str(error)
    starts = [sim.state() for sim in sims]

    def again():
        for sim, start in zip(sims, starts, strict=True):
            sim.load(start)

    alone = [steps(sim, 6) for sim in sims]
    assert not np.array_equal(*alone)
    again()
    for _ in range(6):
        for sim in sims:
            sim.step()
    for sim, u in zip(sims, alone, strict=True):
        assert np.array_equal(sim.snapshot().u, u)
    again()
    at_once = in_threads(*(partial(steps, sim, 6) for sim in sims))
    assert np.array_equal(at_once, alone)
    mps.init(precision="f64", threads=1)
    gone = sims[0]
    uses = [gone.step, gone.snapshot, gone.state, gone.measures, gone.summary, lambda: gone.fluid_particles]
    for use in (*uses, partial(gone.run, until=1.0), partial(gone.load, starts[0])):
        with pytest.raises(
            RuntimeError, match="this Simulation is gone: .* was called after it was made; make it anew"
        ):
            use()


@pytest.mark.slow
def test_a_simulation_is_gone_where_taichi_itself_is_started_after_init():
    """It is told; the process ended, with a notebook and all that it held."""
    sim = film()
    ti.init(arch=ti.cpu, log_level=ti.ERROR)
    for use in (sim.step, sim.snapshot, film):
        with pytest.raises(RuntimeError, match=r"started anew by ti.init or ti.reset: call taichi_mps.init\(\) in the"):
            use()
    mps.init(threads=1)
    film().step()


FORK = """
import os, sys
import taichi_mps as mps
from taichi_mps.input import catalogue
mps.init(threads=2)
sim = mps.Simulation(catalogue.build("film", depth=0.04, spacing=0.01, until=0.05))
sim.step()
pid = os.fork()
if pid == 0:
    for use in (sim.step, mps.init, sim.snapshot):
        try:
            use()
        except RuntimeError as error:
            print(error, flush=True)
    os._exit(7)
assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 7
sim.step()
"""


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
def test_a_forked_process_is_told_to_be_spawned():
    ran = child("-W", "ignore", "-c", FORK)
    said = [line for line in ran.stdout.splitlines() if line.startswith("Taichi was started before this process was")]
    assert ran.returncode == 0 and len(said) == 3, ran.stderr
