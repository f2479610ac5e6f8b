"""The kernel language as other rooms use it: types, fields, and Python objects that kernels call."""

import math

import numpy as np
import pytest

from taichi_mps.engine.runtime import backend
from taichi_mps.engine.runtime.backend import ti
from taichi_mps.engine.runtime.workarounds import in_own_memory, sine_by_f32


@pytest.mark.parametrize(("precision", "kind"), [("f32", np.float32), ("f64", np.float64)])
def test_fields_have_the_precision_that_was_asked_for_and_double_ones_f64(precision, kind):
    backend.init(arch="cpu", precision=precision, threads=1)
    assert backend.started() == {"arch": "cpu", "precision": precision, "threads": 1}
    assert ti.field(backend.real(), 3).to_numpy().dtype == kind
    for shape, components in (((), None), (3, None), ((2, 3), None), (3, 2)):
        for field in (backend.double_field(shape, components), in_own_memory(ti.field(ti.f64), shape)):
            numbers = np.full_like(field.to_numpy(), 0.1, float)
            field.from_numpy(numbers)
            assert field.to_numpy().dtype == np.float64 and np.array_equal(field.to_numpy(), numbers)
    backend.init(arch="cpu", precision="f64", threads=1)


@ti.kernel
def sines(sine: ti.template(), angles: ti.types.ndarray(ti.f64, 1), out: ti.types.ndarray(ti.f64, 1)):
    for i in range(angles.shape[0]):
        out[i] = sine(angles[i])


@pytest.mark.parametrize(("sine", "largest", "accuracy"), [(backend.sine, 20.0, 1e-14), (sine_by_f32, 1e6, 2e-6)])
def test_sine(sine, largest, accuracy):
    """The sine computed by that of f32, the only one of Vulkan, is accurate to f32 also for an angle of many turns."""
    angles = np.linspace(-largest, largest, 1001)
    out = np.zeros_like(angles)
    sines(sine, angles, out)
    assert out == pytest.approx(np.sin(angles), abs=accuracy)


@ti.func
def doubled(x):
    return 2.0 * x


@ti.pyfunc
def tripled(x):
    return 3.0 * x


def test_what_is_meant_for_kernels_is_known_by_its_mark():
    assert all(backend.is_for_kernels(function) for function in (backend.for_kernels(lambda x: x), doubled, tripled))
    assert not any(backend.is_for_kernels(function) for function in (sines, math.sin, None))
