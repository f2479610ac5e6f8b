"""Expected errors, interpolated between measured ones, and --accuracy: the cheapest model and spacing that reach it."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.forecast import accuracy
from taichi_mps.forecast.accuracy import MixNumbers, ModelErrors, choices, choose, error_table, expected

MIX = MixNumbers.of(500.0, 50.0)
SPEEDS = "0.3 m/s", "0.15 m/s", "0.06 m/s"


def linear(spacing: float, mix: MixNumbers) -> ModelErrors:
    """A measurement whose errors are linear in the logarithms of the mix and of the spacing."""
    x, y = math.log(mix.yield_number), math.log(mix.viscosity_number)
    error = 1.0 + 0.1 * x - 0.05 * y + 0.2 * math.log(spacing)
    return ModelErrors("quarter", spacing, *mix, *(k * error for k in range(1, 7)))


CORNERS = [MixNumbers(0.01, 0.01), MixNumbers(0.2, 0.02), MixNumbers(0.05, 0.5), MixNumbers(0.03, 0.05)]
ROWS = [linear(spacing, mix) for spacing in (0.02, 0.05) for mix in CORNERS]


@pytest.mark.parametrize("mix", [*CORNERS, MixNumbers(0.03, 0.03), MixNumbers(0.06, 0.06), MixNumbers(0.1, 0.1)])
@pytest.mark.parametrize("spacing", [0.02, 0.03, 0.05])
def test_between_what_was_measured_it_is_linear(mix, spacing):
    found, exact = expected("quarter", spacing, mix, ROWS), linear(spacing, mix)
    slump, reach = (
        getattr(exact, k) + accuracy.SCATTER_FACTOR * getattr(exact, f"{k}_scatter") for k in ("slump", "reach")
    )
    np.testing.assert_allclose(found[1:], exact._replace(slump=slump, reach=reach)[1:], rtol=1e-9)


@pytest.mark.parametrize(
    ("spacing", "mix"),
    [
        (0.03, MixNumbers(0.001, 0.05)),
        (0.03, MixNumbers(0.05, 5.0)),
        (0.03, MixNumbers(0.3, 0.3)),
        (0.01, CORNERS[3]),
        (0.06, CORNERS[3]),
    ],
)
def test_nothing_is_said_beyond_the_measured_mixes_and_spacings(spacing, mix):
    assert expected("quarter", spacing, mix, ROWS) is None


def test_the_file_has_what_the_words_promise():
    for model in ("full", "half", "quarter", "axisymmetric"):
        assert expected(model, 0.01 / 0.3, MIX), model
    for mix in (MixNumbers.of(40.0, 30.0), MixNumbers.of(1000.0, 200.0), MixNumbers.of(200.0, 500.0)):
        assert expected("full", 0.02 / 0.3, mix)
    assert all(0.0 <= row.error < 0.2 and row.cpu_seconds > 0.0 for row in error_table())


def facts_of(scene) -> dict:
    """What a summary says of a scene."""
    mixes = [scene.material.facts()]
    return {"scene": "slump", "scheme": "implicit", "parameters": dict(scene.parameters), "materials": mixes}


@pytest.mark.parametrize(
    ("model", "runs", "coarsest"),
    [("axisymmetric", "rings, 10 mm", "rings, 10 mm"), ("full", "whole, 10 mm", "whole, 20 mm")],
)
def test_a_lifted_mould_adds_what_finer_particles_and_shorter_steps_change_at_most(model, runs, coarsest):
    """The error added for a lifted mould is how far the effect of lifting on slump and slump flow, of three mixes in
    benchmarks/results/lifted.json, is at most from that in rings of half the spacing, and by halved steps."""
    kept = json.loads((Path(__file__).parents[2] / "benchmarks/results/lifted.json").read_text(encoding="utf-8"))[
        "points"
    ]

    def changes(runs, step="1"):
        mixes = {mould: kept[f"{mould}, {runs}"]["mixes"] for mould in ("at once", *SPEEDS)}
        means = {mould: [mix[f"{tau} {step}"]["mean"][:2] for tau in (100, 300, 500)] for mould, mix in mixes.items()}
        return np.array([means[mould] for mould in SPEEDS]) - means["at once"]

    fine, rings, shorter = changes("rings, 5 mm"), changes("rings, 10 mm"), changes("rings, 10 mm", "0.5")
    beside, more = (np.abs(changes(one) - fine).max(axis=(0, 1)) for one in (coarsest, runs))
    more += np.abs(shorter - rings).max(axis=(0, 1))
    slump, reach, spacing = accuracy.LIFTED[model]
    np.testing.assert_allclose((slump, 2.0 * reach), more / 0.01, atol=0.01)
    assert np.all(beside <= 0.3 * spacing * np.array([slump, 2.0 * reach]))
    cone = {"model": model, "spacing": 0.3 * spacing, "yield_value": 300.0}
    (_, _, once), (_, _, lifted) = (
        accuracy.errors_of_run(facts_of(mps.slump_cone(**cone, lift_speed=speed))) for speed in (None, 0.1)
    )
    assert lifted.slump - once.slump == pytest.approx(slump * spacing)


@pytest.mark.parametrize("times", [0.25, 4.0])
def test_a_cone_of_another_size_has_the_errors_of_the_same_numbers(times):
    """A cone of another height with the same tau_y/(rho g H) and eta/(rho sqrt(g H^3)) has errors in proportion to its
    height."""
    cone = dict(base_diameter=0.2 * times, top_diameter=0.1 * times, height=0.3 * times, spacing=0.01 * times)
    other = mps.slump_cone(yield_value=500.0 * times, plastic_viscosity=50.0 * times**1.5, **cone)
    _, _, usual = accuracy.errors_of_run(facts_of(mps.slump_cone(yield_value=500.0)))
    _, height, found = accuracy.errors_of_run(facts_of(other))
    np.testing.assert_allclose([height, found.slump, found.reach], [0.3 * times, usual.slump, usual.reach], rtol=1e-6)


@pytest.mark.parametrize(
    "change",
    [{"lift_speed": 0.5}, {"top_diameter": 0.2}, {"height": 0.4}, {"friction_angle": 20.0}, {"casson_viscosity": 20.0}],
    ids=["lifted", "a cylinder", "a slender cone", "friction", "another law"],
)
def test_nothing_is_said_of_other_tests_and_laws(change):
    assert accuracy.errors_of_run(facts_of(mps.slump_cone(yield_value=500.0, **change))) is None


# ---- a choice --------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("wanted", [0.002, 0.003, 0.005, 0.01, 0.02])
@pytest.mark.parametrize("given", [{}, {"model": "quarter"}, {"spacing": 0.01}], ids=["free", "quarter", "10 mm"])
@pytest.mark.parametrize("mix", [None, MIX, MixNumbers.of(50.0, 40.0)], ids=["any mix", "500 Pa", "50 Pa"])
def test_nothing_that_is_good_enough_is_cheaper(wanted, given, mix):
    there = [c for c in choices(mix) if all(getattr(c, key) == value for key, value in given.items())]
    fitting = [c for c in there if c.error <= wanted and c.volume_error <= 0.01]
    if not fitting:
        exact = any(c.volume_error <= 0.01 for c in there)  # if only not small enough
        with pytest.raises(mps.SceneError, match="must be at least" if exact else "keeps the volume within 1 %"):
            choose(wanted, **given, mix=mix)
        return
    choice = choose(wanted, **given, mix=mix)
    assert choice.error <= wanted and choice.cpu_seconds == min(c.cpu_seconds for c in fitting)
    assert all(getattr(choice, key) == value for key, value in given.items())


def test_no_error_is_promised_below_that_of_a_finer_spacing():
    for mix in (None, MIX):
        for choice in choices(mix):
            finer = [c.error for c in choices(mix) if c.model == choice.model and c.spacing < choice.spacing]
            assert choice.error >= max(finer, default=0.0)


def told_by(warned) -> list[str]:
    """Its warnings of ours: Python adds its own, of what is collected meanwhile."""
    return [str(each.message) for each in warned if each.category is UserWarning]


def test_the_scene_is_made_as_chosen_and_says_so(recwarn):
    choice = choose(0.005, mix=MIX)
    scene = mps.slump_cone(accuracy=0.005, yield_value=500.0)
    assert (scene.spacing, scene.parameters["model"]) == (choice.spacing, choice.model)
    assert scene.axisymmetric == (choice.model == "axisymmetric")
    assert told_by(recwarn) == [f"accuracy = 5 mm: {choice}"] and "mixes beside this one" in str(choice)
    again = mps.catalogue.build("slump", **scene.parameters)  # as a checkpoint does: nothing is chosen anew
    assert again.spacing == scene.spacing and len(told_by(recwarn)) == 1


@pytest.mark.parametrize("change", [{}, {"lift_speed": 0.1}, {"model": "full", "lift_speed": 0.1}], ids=str)
def test_a_run_expects_no_more_than_its_choice_promised(change):
    _, height, error = accuracy.errors_of_run(facts_of(mps.slump_cone(accuracy=0.006, yield_value=500.0, **change)))
    assert height * error.error <= 0.006


def test_what_is_given_rules(capsys):
    assert mps.slump_cone(accuracy=0.02, model="full").parameters["model"] == "full"
    assert mps.slump_cone(accuracy=0.02, lift_speed=0.12).parameters["model"] == "axisymmetric"
    scene = mps.slump_cone(accuracy=0.001, model="half", spacing=0.03)
    assert scene.spacing == 0.03 and len(scene.mirrors) == 1
    assert "0.03" not in capsys.readouterr().err


def test_what_nothing_reaches_is_refused_with_the_best_there_is(monkeypatch):
    with pytest.raises(mps.SceneError, match=r"accuracy = 1e-06 m: must be at least 0.\d+ m, which is model = "):
        mps.slump_cone(accuracy=1e-6)
    with pytest.raises(
        mps.SceneError, match="with spacing = 0.013 m: nothing was measured there; spacings of 2.5, .* mm were$"
    ):
        mps.slump_cone(accuracy=0.005, spacing=0.013)
    swollen = [row._replace(volume=0.011) for row in error_table()]
    monkeypatch.setattr("taichi_mps.forecast.accuracy.error_table", lambda: swollen)
    with pytest.raises(
        mps.SceneError, match="with spacing = 0.02 m: nothing was measured there that keeps the volume within 1 %$"
    ):
        mps.slump_cone(accuracy=0.05, spacing=0.02)
