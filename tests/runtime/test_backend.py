"""How kernels of the package are started: a call like an earlier one does what Taichi's own call does, and is quick."""

import numpy as np
import pytest

from taichi_mps.linear.csr import SparseMatrix
from taichi_mps.runtime import backend
from taichi_mps.runtime.backend import ti

ROWS = 5


def matrix():
    made = SparseMatrix(ROWS, 1)
    made.count[None] = ROWS
    return made


@pytest.fixture
def calls(monkeypatch):
    """Names of the kernels of the package that went through Taichi's own call."""
    names, own = [], backend._call

    def call(kernel, *arguments, **named):
        if kernel.func.__module__.startswith("taichi_mps"):
            names.append(kernel.func.__name__)
        return own(kernel, *arguments, **named)

    monkeypatch.setattr(backend, "_call", call)
    return names


def test_only_the_first_call_with_the_same_objects_goes_through_taichi(calls):
    first, second, values = matrix(), matrix(), np.arange(1.0, 1 + ROWS)
    for k in range(1, 4):
        for owner, factor in ((first, 1.0), (second, 10.0)):
            values[:] = factor * np.arange(k, k + ROWS)
            owner._load_diagonal(values)
            assert owner.diagonal.to_numpy() == pytest.approx(factor * np.arange(k, k + ROWS))
    assert calls == ["_load_diagonal"] * 2


def test_an_array_in_the_place_of_a_lost_one_is_another_one():
    """Objects that are dropped leave their ids to the next."""
    owner, seen, again = matrix(), set(), 0
    for k in range(100):
        values = np.full(ROWS, float(k))
        again += id(values) in seen
        seen.add(id(values))
        for _ in range(2):
            owner._load_diagonal(values)
        assert np.all(owner.diagonal.to_numpy() == k)
        del values
    assert again > 0
    assert len(SparseMatrix._load_diagonal._primal.ready) < 10  # and nothing is kept of them


def test_what_does_not_fit_is_refused_as_by_taichi():
    owner, values = matrix(), np.ones(ROWS)
    for _ in range(2):
        owner._load_diagonal(values)
    for wrong in (np.ones(ROWS, np.float32), np.ones((ROWS, 2)), np.ones(2 * ROWS)[::2], 1.0):
        with pytest.raises((ValueError, TypeError, ti.TaichiRuntimeTypeError, AttributeError)):
            owner._load_diagonal(wrong)
    with pytest.raises(ti.TaichiSyntaxError, match="Too many arguments"):
        owner._load_diagonal(values, values)
    assert np.all(owner.diagonal.to_numpy() == 1.0)


@ti.kernel
def total(numbers: ti.template(), result: ti.template()):
    result[None] = numbers[0] + numbers[1]


def test_templates_whose_end_nobody_can_tell_are_looked_up_in_each_call(monkeypatch):
    """Tuples: an id alone could be that of another one."""
    monkeypatch.setattr(total._primal.func, "__module__", "taichi_mps.none")
    result = ti.field(ti.i32, ())
    for numbers in ((1, 2), (1, 2), (3, 4)):
        total(numbers, result)
        assert result[None] == sum(numbers)
    assert total._primal.quick and not total._primal.ready


def test_a_new_start_of_taichi_forgets_what_was_compiled_before():
    values = np.arange(float(ROWS))
    for _ in range(2):
        owner = matrix()
        for _ in range(2):
            owner._load_diagonal(values)
        assert np.all(owner.diagonal.to_numpy() == values)
        backend.init(arch="cpu", precision="f64", threads=1)
