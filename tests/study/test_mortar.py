"""Constants of mortar and concrete from each other."""

import json

import pytest

import taichi_mps as mps
from taichi_mps.cli import main as cli
from taichi_mps.study.mortar import Suspension, growth


def test_few_spheres_thicken_as_einstein_has_it():
    """Viscosity 1 + 5/2 phi; yield stress, by sqrt((1 - phi) g), 1 + 3/4 phi."""
    by = growth(1e-6)
    assert (by["plastic_viscosity"] - 1.0) / 1e-6 == pytest.approx(2.5, rel=1e-5)
    assert (by["yield_value"] - 1.0) / 1e-6 == pytest.approx(0.75, rel=1e-5)


def test_the_way_back_is_the_inverse_and_a_closed_packing_is_solid():
    there = Suspension(yield_value=300.0, plastic_viscosity=50.0, grains_volume=0.3).facts()["mortar"]
    back = Suspension(**there, grains_volume=0.3).facts()["concrete"]
    assert back == pytest.approx({"yield_value": 300.0, "plastic_viscosity": 50.0})
    assert growth(0.57 - 1e-9)["plastic_viscosity"] > 1e9


def test_the_command_tells_both_ways(capsys):
    words = ["mortar", "--yield-stress", "300", "--plastic-viscosity", "50", "--grains-volume", "0.3"]
    assert cli.main([*words, "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    product = facts["mortar"]["yield_value"] * facts["concrete"]["yield_value"]
    assert product == pytest.approx(300.0**2)
    assert cli.main(words) == 0
    assert f"{facts['mortar']['yield_value']:.3g} Pa" in capsys.readouterr().out
    with pytest.raises(mps.SceneError, match="grains_volume = 0.6"):
        Suspension(grains_volume=0.6)
