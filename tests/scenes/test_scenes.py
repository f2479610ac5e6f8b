"""Every scene of scenes/, coarse and short, passes its own check, and each check can fail; of the test methods
(test_methods.py) only that they exist and describe themselves."""

import ast
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import taichi_mps as mps

COARSE = {  # keywords that make a scene a matter of seconds; a new scene needs a line here
    "dam_break": {"spacing": 0.0146, "until": 0.25},
    "film": {"spacing": 0.01, "plastic_viscosity": 100.0, "until": 1.0},
    "slump": {"spacing": 0.025, "yield_value": 1000.0, "until": 0.6},
    "still_pool": {"spacing": 0.025, "until": 0.5},
    "vane": {"spacing": 0.004, "body": "cylinder", "turns": 0.1},
}
METHODS = {"flow_table", "j_ring", "l_box", "l_flow", "lcpc_box", "mini_cone", "u_box", "v_funnel"}
POURED = {"wall", "printing"}  # test_pouring.py and test_printing.py judge them


@pytest.fixture(scope="module", params=sorted(COARSE))
def ran(request):
    scene = mps.catalogue.build(request.param, **COARSE[request.param])
    sim = mps.Simulation(scene)
    sim.run()
    return sim


def test_every_scene_is_tested():
    assert set(COARSE) | METHODS | POURED == set(mps.catalogue.names())


@pytest.mark.parametrize("name", mps.catalogue.names())
def test_a_scene_is_made_again_from_its_parameters(name):
    """As resume, render and report make it from what a run folder says, also where a scene takes over another."""
    made = mps.catalogue.build(name)
    again = mps.catalogue.rebuild(name, json.loads(json.dumps(made.parameters)))
    assert again.parameters == made.parameters and np.array_equal(again.expected.fluid, made.expected.fluid)


def test_scene_passes_its_check(ran):
    snapshot, measures = ran.snapshot(), ran.measures()
    ran.scene.check(snapshot, measures)
    assert all(np.isfinite(list(measures.values()))) and abs(ran.report.volume_error) < 0.06
    with pytest.raises(AssertionError):  # a body that has left is noticed
        away = replace(snapshot, x=snapshot.x + 0.3, u=snapshot.u + 1.0)
        ran.scene.check(away, ran.scene.measure(away))


@pytest.mark.parametrize("settings", [{"spacing": 0.008}, {"spacing": 0.04}, {"depth": 0.05, "spacing": 0.02}])
def test_a_film_is_of_whole_rows_the_nearest_to_its_depth(settings):
    scene = mps.catalogue.build("film", **settings)
    columns, counts = np.unique(scene.fluid[:, 0], return_counts=True)
    rows = round(settings.get("depth", 0.1) / scene.spacing)
    assert set(counts) == {rows} and len(columns) * scene.spacing == pytest.approx(scene.domain[1][0])


@pytest.mark.parametrize("name", sorted(mps.catalogue.names()))
def test_scene_file_says_what_it_is(name):
    path = mps.catalogue.names()[name]
    text = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8")))
    assert "Source:" in text and "Run time:" in text
    assert mps.catalogue.describe()[name] == text.splitlines()[0]
    scene = mps.catalogue.build(name, **COARSE.get(name, {}))
    assert scene.name == name and scene.measure is not None
    assert name in METHODS | POURED | {"vane"} or len(scene.wall_particles) > 0  # also for the paper's scheme


@pytest.mark.parametrize(("name", "key"), [("wall", "form"), ("wall", "rebar"), ("printing", "gcode")])
def test_a_file_that_a_run_reads_is_kept_by_its_full_path(name, key):
    parameters = mps.catalogue.load(name).parameters
    assert getattr(parameters(**{key: "here.stl"}), key) == str(Path("here.stl").absolute())
    assert getattr(parameters(), key) == ""


def test_a_vane_is_measured_without_loads_too_as_a_replay_has_none():
    scene = mps.catalogue.build("vane", spacing=0.004)
    assert scene.measure(mps.measure.still(scene.fluid, scene.spacing)) == {}
