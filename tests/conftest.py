"""One Taichi per test module: a process holds at most 512 trees of fields, and init drops them all."""

import pytest
from hypothesis import HealthCheck, settings

from taichi_mps import backend

slow = {"deadline": None, "suppress_health_check": list(HealthCheck)}
settings.register_profile("thorough", max_examples=2000, **slow)  # --hypothesis-profile thorough
settings.register_profile("quick", max_examples=25, derandomize=True, **slow)


@pytest.fixture(scope="module", autouse=True)
def taichi():
    backend.init(arch="cpu", precision="f64", threads=1)
