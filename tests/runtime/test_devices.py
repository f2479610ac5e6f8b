"""Devices: a run computes on the requested device, with the results of the processor, or is refused."""

import json

import numpy as np
import pytest

from tests.support.child import child

ASK = """
import sys
from taichi_mps import SceneError, backend
try:
    backend.init(arch=sys.argv[1])
    print("on", backend.ti.cfg.arch.name)
except SceneError as error:
    print(error)
    try:
        backend.started()
    except RuntimeError as error:
        print("not started")
"""

RUN = """
import json, sys
import taichi_mps as mps
from taichi_mps import backend, catalogue
from taichi_mps.engine.terms import shifting
shifting.PERTURBATION = 0.0  # e(x) looks random because it takes rounding 40,000 times: another device, other numbers
backend.init(arch=sys.argv[1])
scheme = {"implicit": mps.Implicit(), "semi-implicit": mps.SemiImplicit()}
sim = mps.Simulation(catalogue.load(sys.argv[2])(**json.loads(sys.argv[3])), scheme[sys.argv[4]])
for _ in range(6):
    sim.step()
s = sim.snapshot()
print(json.dumps({"time": sim.time, "spacing": s.spacing, "x": s.x.tolist(), "u": s.u.tolist(), "p": s.p.tolist()}))
"""


def said(code, *arguments):
    """Lines that code prints in a process of its own."""
    return child("-c", code, *arguments).stdout.strip().splitlines()


@pytest.mark.parametrize("arch", ["cuda", "vulkan"])
def test_a_device_that_is_not_here_is_refused_and_not_replaced_by_the_processor(arch):
    lines = said(ASK, arch)
    refused = [f"arch = {arch}: no such device is found here; must be one that this machine has, such as cpu"]
    assert lines[-1] == f"on {arch}" or lines[-2:] == [*refused, "not started"]


@pytest.mark.long
@pytest.mark.parametrize(
    ("scene", "keywords", "scheme"),
    [
        ("dam_break", {}, "implicit"),  # 800 particles: what the processor does in one thread
        ("slump", {"spacing": 0.02, "yield_value": 300.0}, "implicit"),
        ("slump", {"spacing": 0.009, "yield_value": 300.0}, "implicit"),  # with the coarse grids of the solver
        ("slump", {"spacing": 0.01, "yield_value": 300.0, "model": "axisymmetric"}, "implicit"),
        ("dam_break", {}, "semi-implicit"),
    ],
)
def test_vulkan_computes_what_the_processor_computes(scene, keywords, scheme):
    if said(ASK, "vulkan")[-1] != "on vulkan":
        pytest.skip("no Vulkan device here; Mesa's lavapipe is one in software")
    runs = [json.loads(said(RUN, arch, scene, json.dumps(keywords), scheme)[-1]) for arch in ("cpu", "vulkan")]
    ours, theirs = ({name: np.array(run[name]) for name in "xup"} for run in runs)
    assert runs[0]["time"] == pytest.approx(runs[1]["time"], rel=1e-3)
    difference = {name: np.sqrt(((ours[name] - theirs[name]) ** 2).mean()) for name in "xup"}
    assert difference["x"] < 0.01 * runs[0]["spacing"]  # solves end at a tolerance, in another order of sums
    assert difference["u"] < 5e-3 * np.sqrt((ours["u"] ** 2).mean())
    assert difference["p"] < 2e-2 * np.sqrt((ours["p"] ** 2).mean())
