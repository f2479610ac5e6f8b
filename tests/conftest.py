"""One Taichi for the whole test session."""

import pytest

from taichi_mps import backend


@pytest.fixture(scope="session", autouse=True)
def taichi():
    backend.init(arch="cpu", precision="f64", threads=2)
