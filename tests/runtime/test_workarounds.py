"""What Taichi 1.7.4 does wrong and backend.py keeps from the user.

It miscompiles a vector local that is read, conditionally changed and overwritten (taichi issue 8744): init turns the
guilty pass off (cfg_optimization=False); these are the patterns that were wrong. Its 513th tree of fields kills the
process: require_room refuses before.
"""

import numpy as np
import pytest

from taichi_mps.runtime import backend
from taichi_mps.runtime.backend import ti


@ti.kernel
def overwritten(a: ti.f64, b: ti.f64, raise_it: ti.i32) -> ti.types.vector(2, ti.f64):
    v = ti.Vector([a, 0.0], dt=ti.f64)
    w = ti.Vector([b, 0.0], dt=ti.f64)
    x0 = v[0]
    if raise_it == 1:
        x0 = x0 + 5.0
    v = w
    x1 = v[0]
    return ti.Vector([x0, x1])


@ti.kernel
def overwritten_in_a_loop(values: ti.types.ndarray(dtype=ti.f64, ndim=1), out: ti.types.ndarray(dtype=ti.f64, ndim=2)):
    for i in range(values.shape[0]):
        v = ti.Vector([values[i], 2.0 * values[i]], dt=ti.f64)
        w = ti.Vector([-values[i], 7.0], dt=ti.f64)
        x0 = v[0]
        if i % 2 == 0:
            x0 = x0 + 5.0
        v = w
        out[i, 0] = x0
        out[i, 1] = v[0]
        out[i, 2] = v[1]


@pytest.mark.parametrize(("raise_it", "expected"), [(0, [1.0, 10.0]), (1, [6.0, 10.0])])
def test_vector_local_keeps_its_old_value(raise_it, expected):
    assert list(overwritten(1.0, 10.0, raise_it)) == expected


def test_vector_local_in_a_parallel_loop():
    values = np.arange(100.0)
    out = np.zeros((100, 3))
    overwritten_in_a_loop(values, out)
    assert np.array_equal(out[:, 0], values + np.where(np.arange(100) % 2 == 0, 5.0, 0.0))
    assert np.array_equal(out[:, 1], -values)
    assert np.all(out[:, 2] == 7.0)


def test_fields_are_refused_before_the_tree_that_kills_the_process(monkeypatch):
    """With a limit of 64 trees, for those of Taichi's own 512 take half a minute to make."""
    monkeypatch.setattr(backend, "MOST_TREES", 64)
    made = []
    with pytest.raises(RuntimeError, match="call taichi_mps.init"):
        for _ in range(backend.MOST_TREES + 1):
            backend.require_room()
            made.append(ti.field(ti.i32, 8))
            made[-1].fill(1)
    assert backend.MOST_TREES - 2 * backend.TREES_OF_A_SIMULATION < len(made) < backend.MOST_TREES
    backend.init(arch="cpu", precision="f64", threads=2)
    backend.require_room()


@ti.kernel
def misspelt():
    for i in range(3):
        missing[i] = 1.0  # noqa: F821


def test_a_kernel_that_does_not_compile_names_its_line():
    with pytest.raises(Exception, match=r'test_compiler.py", line \d+, in misspelt: missing\[i\] = 1.0'):
        misspelt()
