"""Numerics: every number with help and unit; what an earlier version wrote is read."""

import pytest

import taichi_mps as mps
from taichi_mps.problem.numerics import NUMERICS


@pytest.mark.parametrize("name", NUMERICS)
def test_every_number_of_a_scheme_has_a_help_and_the_scheme_its_name(name):
    assert NUMERICS[name].scheme == name
    for key, field in NUMERICS[name].model_fields.items():
        assert field.description and len(field.description) > 8, key


def test_sleep_is_taken_as_earlier_versions_wrote_it():
    """A switch then; two words now, and auto by default."""
    assert [mps.Implicit(sleep=sleep).sleep for sleep in (False, True, "off", "on")] == ["off", "on", "off", "on"]
    assert mps.Implicit().sleep == "auto"
    with pytest.raises(mps.SceneError, match="sleep = sometimes: must be 'auto', 'on' or 'off'"):
        mps.Implicit(sleep="sometimes")
