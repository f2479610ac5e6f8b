"""What an editor knows of the package: types behind ``import taichi_mps as mps``, held by mypy against a user's right
script and a wrong one. tests/test_docstrings.py asks that all public functions are annotated."""

import re

import pytest

from taichi_mps.input.catalogue import SlumpKeywords, load
from tests.support.child import ROOT, child

RIGHT = """
import typing as t

import numpy as np
from typing_extensions import assert_type

import taichi_mps as mps

mps.init(threads=1)
concrete = mps.Bingham(density=2300.0, plastic_viscosity=50.0, yield_value=500.0)
assert_type(2.0 * concrete.yield_value, float)
assert_type(mps.Newtonian(), mps.Bingham)
scene = mps.slump_cone(concrete, model="axisymmetric", spacing="2 cm", until=0.1)
assert_type(scene, mps.Scene)
assert_type(mps.catalogue.build("slump", spacing="3 cm"), mps.Scene)
numerics = mps.Implicit(passes=8)
sim = mps.Simulation(scene, numerics)
assert_type(sim.run(until=0.05), str)
assert_type(sim.step(), mps.StepReport)
assert_type(sim.step().max_speed, float)
assert_type(sim.measures(), dict[str, float])
assert_type(sim.snapshot().yielded.mean(), t.Any)
assert_type(mps.measure.slump(sim.snapshot(), height=0.3), dict[str, float])
sim.every(0.02, mps.png("frames", view="speed"))
box = mps.Box((0.0, 0.0), (0.1, 0.1))
particles: np.ndarray = mps.fill(box, 0.01)
floor = mps.Plane((0.0, 0.0), (0.0, 1.0), friction=mps.Friction(yield_value=20.0))
room = ((-0.1, -0.1), (0.4, 0.2))
heap = mps.Scene("heap", concrete, 0.01, particles, room, walls=(floor,), measure=mps.measure.front)
assert_type(mps.Simulation(heap, mps.SemiImplicit(literal=True)).report, mps.StepReport | None)
assert_type(mps.rest_shapes.spread_at_rest(volume=0.0055, density=2300.0, yield_value=50.0), float)
assert_type(mps.checkpoint.restore("checkpoint.h5"), mps.Simulation)


@mps.ti.kernel
def stir(rate: float) -> None: ...


@mps.checked
def pool(depth: float = 0.1) -> mps.Scene:
    return scene


assert_type(pool(depth="10 cm"), mps.Scene)
"""

# each line is wrong, by one thing
WRONG = """
mps.Bingham(yeild_value=500.0)
mps.Bingham(yield_value=None)
mps.Implicit(passes=[6])
mps.Implicit(sleep="never")
mps.slump_cone(model="axisymetric")
mps.slump_cone(spacng=0.01)
mps.slump_cone(0.01)
mps.Simulation(concrete)
mps.Simulation(scene, numerics=6)
sim.run(untill=2.0)
mps.fill(box, spacing="fine")
mps.Plane((0.0, 0.0))
mps.Scene(name="heap")
mps.init(arch="abacus")
mps.png("frames", view="sped")
mps.Viscosity
mps.lattice((0.0, 0.0), (1.0, 1.0), 0.1).run
sim.report.dt_limt
"""


def checked_by_mypy(text, tmp_path):
    """Lines of a script that mypy refuses, {number: message}; errors inside of the package are not of the user."""
    script = tmp_path / "script.py"
    script.write_text(text, encoding="utf-8")
    options = "--strict", "--follow-imports=silent", "--no-incremental", "--no-error-summary", "--no-color-output"
    kernels = "--disable-error-code=untyped-decorator"  # the one thing that is let pass: Taichi has no types
    result = child("-m", "mypy", *options, kernels, script, MYPYPATH=str(ROOT))
    found = re.findall(r"script\.py:(\d+): error: (.*)", result.stdout)
    assert result.returncode == bool(found), result.stdout + result.stderr
    return {int(line): message for line, message in found}


@pytest.mark.slow
def test_an_editor_passes_a_right_script_and_refuses_each_wrong_line(tmp_path):
    assert not checked_by_mypy(RIGHT, tmp_path)
    known, wrong = len(RIGHT.splitlines()), len(WRONG.strip().splitlines())
    refused = checked_by_mypy(RIGHT + WRONG.lstrip(), tmp_path)
    assert set(refused) == set(range(known + 1, known + wrong + 1)), refused


def test_the_keywords_of_a_slump_that_an_editor_knows_are_those_of_its_scene():
    assert SlumpKeywords.__annotations__.keys() == load("slump").parameters.model_fields.keys()
