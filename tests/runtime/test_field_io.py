"""Writing and reading of several fields: equal numbers, whatever their shapes and types."""

import numpy as np
import pytest

from taichi_mps.engine.runtime.backend import double_field, real, ti
from taichi_mps.engine.runtime.field_io import FieldIO

SHAPES = {"place": (2,), "number": (), "stress": (3, 3), "share": ()}


@pytest.fixture(scope="module")
def rows():
    fields = {
        "place": double_field(5, 2),
        "number": ti.field(ti.i32, 5),
        "stress": ti.Matrix.field(3, 3, real(), 5),
        "share": ti.field(ti.f32, 5),
    }
    return FieldIO(fields | {f"a{k}": ti.field(ti.f64, 5) for k in range(33)}, 5)


@pytest.mark.filterwarnings("error")
def test_what_is_put_in_is_read_back_and_stands_in_the_fields(rows):
    """Values written to several fields are read back exactly, up to the last bit of f64 and the largest i32 and for the
    first n rows, as by Taichi's to_numpy; more than 32 fields give no warning of unrolling."""
    rng = np.random.default_rng(1)
    put = {name: rng.normal(size=(4, *shape)) for name, shape in SHAPES.items()}
    put["number"] = np.array([2**31 - 1, -(2**31), 0, 7])
    put["share"] = put["share"].astype(np.float32)
    rows.load(put, 4)
    found = rows.read(4)
    for name in SHAPES:
        values, own = found[name], rows.fields[name].to_numpy()
        assert np.array_equal(values, put[name]) and values.flags.c_contiguous
        assert np.array_equal(own[:4], put[name]) and values.dtype == own.dtype
    assert {len(values) for values in rows.read(2).values()} == {2}


def test_what_is_not_named_and_rows_beyond_become_zero_and_one_number_is_for_all(rows):
    rows.load({name: np.ones((5, *shape)) for name, shape in SHAPES.items()}, 5)
    rows.load({"number": 3, "place": np.full((2, 2), 0.1)}, 2)
    now = rows.read(5)
    assert now["number"].tolist() == [3, 3, 0, 0, 0]
    assert now["place"].tolist() == [[0.1, 0.1]] * 2 + [[0.0, 0.0]] * 3
    assert not now["stress"].any() and not now["share"].any()
