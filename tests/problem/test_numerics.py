"""Numerics: every number with help and unit."""

import pytest

from taichi_mps.problem.numerics import NUMERICS


@pytest.mark.parametrize("name", NUMERICS)
def test_every_number_of_a_scheme_has_a_help_and_the_scheme_its_name(name):
    assert NUMERICS[name].scheme == name
    for key, field in NUMERICS[name].model_fields.items():
        assert field.description and len(field.description) > 8, key
