"""Processes, threads, several Simulations, and init called again: it works, or one clear error says what does."""

import os
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.problem import catalogue

ROOT = Path(__file__).resolve().parents[2]


def film(**keywords):
    return mps.Simulation(catalogue.build("film", depth=0.04, spacing=0.01, until=0.05, **keywords))


def steps(sim, count):
    for _ in range(count):
        sim.step()
    return sim.snapshot().u


def in_threads(*calls):
    """What calls return or raise, each in a thread of its own, all at once."""
    results = [None] * len(calls)

    def work(k):
        try:
            results[k] = calls[k]()
        except Exception as error:
            results[k] = error

    threads = [threading.Thread(target=work, args=(k,)) for k in range(len(calls))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return results


def test_two_simulations_take_turns_and_do_not_mix():
    alone = steps(film(angle=20.0), 6)
    one, other = film(angle=20.0), film(angle=10.0)
    for _ in range(6):
        one.step(), other.step()
    assert np.array_equal(one.snapshot().u, alone) and not np.array_equal(other.snapshot().u, alone)


def test_threads_may_step_at_once_and_give_the_same():
    alone = steps(film(angle=20.0), 6)
    one, other = film(angle=20.0), film(angle=20.0)
    one.step(), other.step()
    for u in in_threads(lambda: steps(one, 5), lambda: steps(other, 5)):
        assert np.array_equal(u, alone)


def test_a_simulation_is_made_where_taichi_was_started():
    sim = film()
    for error in in_threads(film, sim.step):
        assert isinstance(error, RuntimeError) and "takes its first step, in that which called init()" in str(error)
    assert sim.step().step == 1


@pytest.mark.parametrize("use", ["step", "run", "snapshot", "state", "measures", "summary", "load", "fluid_particles"])
def test_a_simulation_of_before_init_says_so(use):
    sim = film()
    state = sim.state()
    mps.init(precision="f64", threads=1)
    with pytest.raises(RuntimeError, match="this Simulation is gone: .* was called after it was made; make it anew"):
        if use == "fluid_particles":
            sim.fluid_particles  # noqa: B018
        else:
            getattr(sim, use)(*([state] if use == "load" else []))


FORK = """
import os, sys
import taichi_mps as mps
from taichi_mps.problem import catalogue
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


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
def test_a_forked_process_is_told_to_be_spawned():
    command = [sys.executable, "-W", "ignore", "-c", FORK]
    ran = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=100)
    said = [line for line in ran.stdout.splitlines() if line.startswith("Taichi was started before this process was")]
    assert ran.returncode == 0 and len(said) == 3, ran.stderr
