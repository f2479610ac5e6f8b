"""Materials: what follows from their numbers, and their form in a summary."""

import json

import pytest

import taichi_mps as mps


def curve(rate, structure):
    return 10.0 + 20.0 * rate


CURVE = mps.FlowCurve(shear_stress=curve)


@pytest.mark.parametrize(
    ("material", "yields", "newtonian", "rests"),
    [
        (mps.Bingham(), True, False, True),
        (mps.Bingham(critical_strain_rate=0.01), True, False, False),
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


def test_a_rational_rate_is_a_number_once_the_time_is_known():
    """min(0.01 tau_y/(2 eta), 0.01/T) = 0.01 min(3, 1/5)."""
    mix = mps.Bingham(critical_strain_rate="rational")
    assert mix.knee_stress == mix.yield_value and not mix.rests
    assert mix.within(5.0).critical_strain_rate == pytest.approx(0.002, rel=1e-12)
    assert mps.Bingham().within(5.0) == mps.Bingham()
    scene = mps.Scene("x", mix, 0.1, [[0.5, 0.5]], ((0.0, 0.0), (1.0, 1.0)), until=100.0)
    assert scene.material.critical_strain_rate == pytest.approx(1e-4, rel=1e-12)
