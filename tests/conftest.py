"""One Taichi per test module: a process holds at most 512 trees of fields, and init drops them all."""

import pytest
from hypothesis import HealthCheck, settings

from taichi_mps.runtime import backend

slow = {"deadline": None, "suppress_health_check": list(HealthCheck)}
settings.register_profile("thorough", max_examples=2000, **slow)  # --hypothesis-profile thorough
settings.register_profile("quick", max_examples=25, derandomize=True, **slow)


@pytest.fixture(scope="module", autouse=True)
def taichi():
    backend.init(arch="cpu", precision="f64", threads=1)


# files of 20 s and more, the longest first: at the end of a run no worker waits for another's long file
LONGEST = ("cli", "semi_implicit", "axisymmetric", "pay_for_use", "validation", "mirror", "implicit", "mrpcg")
LONGEST += ("notebooks", "grid_levels", "scenes", "walls", "volume", "solids")
PLACE = {f"test_{name}.py": place for place, name in enumerate(LONGEST)}


def pytest_collection_modifyitems(items):
    items.sort(key=lambda item: PLACE.get(item.path.name, len(PLACE)))
