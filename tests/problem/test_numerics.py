"""Numerics: every number with help and unit; what is accepted and does nothing says so."""

import warnings

import pytest

import taichi_mps as mps
from taichi_mps.problem.numerics import NUMERICS


@pytest.mark.parametrize("name", NUMERICS)
def test_every_number_of_a_scheme_has_a_help_and_the_scheme_its_name(name):
    assert NUMERICS[name].scheme == name
    for key, field in NUMERICS[name].model_fields.items():
        assert field.description and len(field.description) > 8, key


def test_sleep_is_taken_and_says_in_one_line_that_it_does_nothing(capsys):
    with pytest.warns(UserWarning, match="^sleep = True: does nothing until a later version") as told:
        assert mps.Implicit(sleep=True).sleep
    assert len(told) == 1 and "\n" not in str(told[0].message)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        mps.Implicit(sleep=False)
        mps.Implicit()
