"""Materials: derived properties, and their form in a summary."""

import json

import pytest

import taichi_mps as mps
from taichi_mps.engine import Pouring, Problem
from tests.support.scenes import two_mixes


def curve(rate, structure):
    return 10.0 + 20.0 * rate


CURVE = mps.FlowCurve(shear_stress=curve)


@pytest.mark.parametrize(
    ("material", "yields", "newtonian", "rests"),
    [
        (mps.Bingham(), True, False, True),
        (mps.Bingham(critical_strain_rate=0.01), True, False, False),
        (mps.Bingham(critical_strain_rate="rational"), True, False, False),
        (mps.Bingham(yield_value=0.0, friction_angle=30.0), True, False, True),
        (mps.Newtonian(), False, True, False),
        (mps.HerschelBulkley(), True, False, True),
        (mps.HerschelBulkley(yield_value=0.0), False, False, False),
        (CURVE, False, False, False),
        (mps.FlowCurve(shear_stress=curve, yield_value=10.0), True, False, True),
    ],
)
def test_what_yields_what_is_newtonian_and_what_comes_to_rest(material, yields, newtonian, rests):
    assert (material.yields, material.newtonian, material.rests) == (yields, newtonian, rests)


def test_the_facts_of_a_material_are_json_with_its_law_its_numbers_and_the_names_of_its_functions():
    facts = [json.loads(json.dumps(material.facts())) for material in (mps.Bingham(yield_value=40.0), CURVE)]
    assert facts[0] == {"law": "Bingham", **mps.Bingham(yield_value=40.0).model_dump()}
    assert facts[1]["law"] == "FlowCurve" and facts[1]["shear_stress"] == "curve" and facts[1]["growth"] is None


@pytest.mark.parametrize(
    ("given", "law"),
    [
        ({}, mps.Bingham()),
        ({"flow_index": 1.0, "plastic_viscosity": 20.0}, mps.Bingham(plastic_viscosity=20.0)),
        ({"yield_value": 0.0, "density": 1000.0}, mps.Newtonian(1000.0, 50.0)),
        ({"critical_strain_rate": 0.01}, mps.Bingham(critical_strain_rate=0.01)),
        ({"flow_index": 0.7, "plastic_viscosity": 20.0}, mps.HerschelBulkley(consistency=20.0, flow_index=0.7)),
        ({"flow_index": 0.7, "consistency": 30.0}, mps.HerschelBulkley(consistency=30.0, flow_index=0.7)),
        ({"structuration": 0.5}, mps.HerschelBulkley(structuration=0.5)),
        ({"structuration": 0.0, "friction_angle": 10.0}, mps.Bingham(friction_angle=10.0)),
    ],
)
def test_what_a_scene_is_told_of_concrete_is_the_simplest_law(given, law):
    assert mps.Concrete(**given) == law


def test_roussels_growth_of_the_yield_stress():
    """The yield stress tau_y (1 + lambda) grows by A at rest, and is steady at alpha rate lambda = A/tau_y."""
    mix = mps.HerschelBulkley(yield_value=50.0, structuration=0.5, destructuration=0.005)
    assert mix.ages and 50.0 * mix.growth(0.0, 3.0) == pytest.approx(0.5)
    assert mix.growth(2.0, 0.01 / (0.005 * 2.0)) == pytest.approx(0.0, abs=1e-15)
    aged = mps.HerschelBulkley(yield_value=300.0, structuration=0.5, age="10min")
    assert aged.initial_structure == 1.0 and mix.initial_structure == CURVE.initial_structure == 0.0
    scene = two_mixes(mix, aged)
    assert Problem(scene).initial_structure([1, 0]).tolist() == [1.0, 0.0]
    assert Pouring(scene, scene.inlets[0]).structure == 1.0
    assert not mps.HerschelBulkley().ages and not mps.Bingham().ages and not CURVE.ages
