"""Calibration with a known plastic viscosity: the slump alone gives the yield stress."""

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.study.calibrate import calibrate, emulator_of

DENSITY = 2300.0


def slump(yield_value, plastic_viscosity):
    """Of the package's own table [m]."""
    return float(emulator_of().at(np.log(yield_value / DENSITY), np.log(plastic_viscosity / DENSITY))["slump_m"])


@pytest.mark.parametrize("plastic_viscosity", [20.0, 50.0, 200.0])
@pytest.mark.parametrize("yield_value", [300.0, 600.0])
def test_the_slump_gives_the_yield_stress_back_with_the_error_of_the_ruler(yield_value, plastic_viscosity):
    """The interval is 1.96 standard errors of the slump over its slope, which is nearly straight over so little; the
    table's own scatter widens it."""
    measured, error = slump(yield_value, plastic_viscosity), 0.005
    found = calibrate(
        slump=measured, slump_error=error, rho=DENSITY, plastic_viscosity=plastic_viscosity, check=False
    ).yield_value
    assert found.value == pytest.approx(yield_value, rel=2e-3)
    slope = (slump(1.01 * yield_value, plastic_viscosity) - slump(0.99 * yield_value, plastic_viscosity)) / (
        0.02 * yield_value
    )
    wide = 1.96 * np.hypot(error, emulator_of().scatter["slump_m"]) / abs(slope)
    assert found.upper - found.lower == pytest.approx(2.0 * wide, rel=0.1)


def test_it_says_more_than_with_an_unknown_one():
    free = calibrate(slump=0.18, check=False)
    known = calibrate(slump=0.18, plastic_viscosity="50 Pa s", check=False)
    assert not free.plastic_viscosity.determined and known.plastic_viscosity.value == 50.0
    assert known.yield_value.upper - known.yield_value.lower < 0.5 * (free.yield_value.upper - free.yield_value.lower)
    assert "50 Pa s, as given" in str(known) and known.facts()["plastic_viscosity"]["determined"]


def test_what_the_table_does_not_cover_is_refused():
    with pytest.raises(mps.SceneError, match="plastic_viscosity = 5000 Pa s: must be 10 to 1000 Pa s, what the table"):
        calibrate(slump=0.18, plastic_viscosity=5000.0)
