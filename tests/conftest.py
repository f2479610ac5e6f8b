"""One Taichi per test module: a process holds at most 512 trees of fields, and init drops them all."""

import pytest

from taichi_mps import backend


@pytest.fixture(scope="module", autouse=True)
def taichi():
    backend.init(arch="cpu", precision="f64", threads=1)
