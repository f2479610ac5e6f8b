"""Results are equal bit for bit with one thread or two, and from a saved state.

Compiled without fast_math: with it one thread and a team of two run kernels in which LLVM may contract and regroup the
same arithmetic in two ways, and on some processors it does.
"""

import pytest

from tests.support.child import begun

RUN = """
import hashlib, sys
import taichi_mps as mps
from taichi_mps.engine.runtime import backend
from taichi_mps.input import catalogue

def bits(sim):
    s = sim.snapshot()
    return hashlib.sha256(b"".join(a.tobytes() for a in (s.x, s.u, s.p, s.shear_rate))).hexdigest()

def steps(sim, count):
    for _ in range(count):
        sim.step()
    return bits(sim)

start = backend.ti.init
backend.ti.init = lambda **settings: start(**(settings | {"fast_math": False}))
mps.init(precision=sys.argv[1], threads=int(sys.argv[2]))
sim = mps.Simulation(catalogue.build("slump", model=sys.argv[3], spacing=float(sys.argv[4])))
assert sim.fluid_particles > 6000  # a team of threads, grids of nodes
start = bits(sim)
steps(sim, 4)
saved = sim.state()
end = steps(sim, 4)
later = sim.time
sim.load(saved)
assert sim.steps == 4 and sim.time < later
again = steps(sim, 4)
assert (sim.steps, sim.time) == (8, later)
print(start, end, again)
"""


@pytest.mark.parametrize(
    ("precision", "model", "spacing"),
    [
        pytest.param("f32", "axisymmetric", "0.0019", marks=pytest.mark.long),
        pytest.param("f32", "full", "0.0095", marks=pytest.mark.long),
        pytest.param("f64", "full", "0.0095", marks=pytest.mark.long),
    ],
)
def test_same_bits_with_any_number_of_threads_and_from_a_saved_state(precision, model, spacing):
    runs = [begun("-c", RUN, precision, threads, model, spacing) for threads in ("1", "2")]
    outputs = [run.communicate(timeout=300)[0].split() for run in runs]
    assert [run.returncode for run in runs] == [0, 0]
    (start, end, again), other = outputs[0][-3:], outputs[1][-3:]
    assert start != end
    assert again == end, "a saved state does not continue as before"
    assert other == [start, end, again], "the number of threads changes the result"
