"""An invalid flow curve of a user is refused before the run, or named at the step in which it fails."""

from dataclasses import replace

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.engine.runtime.backend import ti
from taichi_mps.engine.terms.rheology import OwnLaw


@pytest.fixture(scope="module", autouse=True)
def taichi():
    mps.init(arch="cpu")


def sound(rate, structure):
    return 40.0 + 20.0 * rate


def of_the_rate_alone(rate):
    return 40.0 + 20.0 * rate


def infinite(rate, structure):
    return 40.0 / rate


def above_a_rate(rate, structure):
    return 40.0 + 20.0 * ti.sqrt(100.0 - rate)


def negative(rate, structure):
    return 20.0 * rate - 40.0


def falling(rate, structure):
    return 40.0 + 100.0 * rate / (1.0 + rate * rate)


def of_two_numbers(rate, structure):
    return 40.0 + 20.0 * rate, 0.0  # what would end the process where it is compiled as a number


def cut_to_integers(rate, structure):
    x = 0
    if rate > 0.0:
        x = rate / (rate + 2.0)
    return 40.0 + 20.0 * rate + 60.0 * x


def with_the_structure_an_integer(rate, structure):
    x = 1
    if structure > 0.0:
        x = 1.0 + 0.5 * structure
    return 40.0 * x + 20.0 * rate


def nan_times_zero(rate, structure):
    return 40.0 + 20.0 * rate + 0.0 * (rate - 0.5) ** 1.5


@ti.func
def doubled(rate):
    return 2.0 * rate


def of_a_part_for_kernels(rate, structure):
    return 40.0 + doubled(10.0 * rate)


def until_it_has_grown(rate, structure):
    return 40.0 * ti.sqrt(1.0 - structure) + 20.0 * rate


def one(rate, structure):
    return 20.0  # 1/s


def film(law, growth=None):
    material = mps.FlowCurve(density=2300.0, yield_value=40.0, typical_slope=20.0, shear_stress=law, growth=growth)
    return replace(mps.catalogue.build("film", angle=15.0, spacing=0.02), material=material, check=None, measure=None)


@pytest.mark.parametrize(
    ("law", "growth", "message"),
    [
        (of_the_rate_alone, None, r"shear_stress = of_the_rate_alone: must take two numbers, \(rate, structure\)"),
        (ti.func(of_the_rate_alone), None, "shear_stress = of_the_rate_alone: must take two numbers"),
        (sound, of_the_rate_alone, "growth = of_the_rate_alone: must take two numbers"),
        (infinite, None, "shear_stress = infinite: is inf Pa at a shear rate of 0 1/s"),
        (above_a_rate, None, r"shear_stress = above_a_rate: is nan Pa at a shear rate of 1\d\d 1/s"),
        (negative, None, "shear_stress = negative: is -40 Pa at a shear rate of 0 1/s .*; must be finite and at least"),
        (falling, None, r"shear_stress = falling: falls from 90 to 88.7 Pa from 1 to 1.26 1/s; must not fall"),
        (of_two_numbers, None, "shear_stress = of_two_numbers: cannot be compiled"),
        (
            cut_to_integers,
            None,
            "shear_stress = cut_to_integers: is [0-9.e+]+ Pa compiled and [0-9.e+]+ Pa in Python, at a shear rate",
        ),
        (
            ti.func(cut_to_integers),
            None,
            "shear_stress = cut_to_integers: is .* must be the same .x = 0 makes an integer",
        ),
        (
            with_the_structure_an_integer,
            None,
            "shear_stress = with_the_structure_an_integer: is 40 Pa compiled and 60 Pa in Python, at .* of 1;",
        ),
        (sound, cut_to_integers, "growth = cut_to_integers: is .* 1/s compiled and"),
        (
            nan_times_zero,
            None,
            # with fast_math 0 times what is no number is 0
            "shear_stress = nan_times_zero: is (40 Pa compiled and nan Pa in Python,|nan Pa) at a shear rate of 0 1/s",
        ),
        (sound, infinite, "growth = infinite: is inf 1/s at a shear rate of 0 1/s and a structure of 0; must be fin"),
    ],
)
def test_what_is_no_law_is_refused_in_one_line_before_anything_is_allocated(law, growth, message, monkeypatch):
    monkeypatch.setattr(mps.Simulation, "_build", lambda sim: pytest.fail("allocated"))
    with pytest.raises(mps.SceneError, match=f"^material: {message}") as refusal:
        mps.Simulation(film(law, growth))
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("law", [sound, ti.func(sound), of_a_part_for_kernels])
def test_a_sound_law_is_taken_whether_python_can_call_it_or_not(law):
    assert OwnLaw(film(law).material).evaluate(np.array([2.0]), np.zeros(1))[0] == pytest.approx(80.0)


@pytest.mark.slow
def test_a_law_that_fails_with_its_structure_is_named_at_the_step():
    """sqrt(1 - lambda) with d lambda/dt = 20 1/s is no number after 0.05 s, which is reported at that step."""
    sim = mps.Simulation(film(until_it_has_grown, one))
    with pytest.raises(
        mps.DivergedError, match="shear_stress = until_it_has_grown: is nan Pa .* structure of 1"
    ) as end:
        sim.run(until=0.5)
    assert 0.05 < end.value.report.time < 0.06 and np.isfinite(sim.snapshot().u).all()
