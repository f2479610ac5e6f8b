"""--accuracy: the cheapest measured model and spacing that is good enough; what is given stays."""

from dataclasses import replace

import pytest

import taichi_mps as mps
from taichi_mps.problem import catalogue
from taichi_mps.problem.accuracy import choose, measured
from taichi_mps.units import Length, SceneError


@pytest.mark.parametrize("accuracy", [0.002, 0.003, 0.005, 0.01, 0.02])
@pytest.mark.parametrize("given", [{}, {"model": "quarter"}, {"spacing": 0.01}], ids=["free", "quarter", "10 mm"])
def test_nothing_that_is_good_enough_is_cheaper(accuracy, given):
    there = [c for c in measured() if all(getattr(c, key) == value for key, value in given.items())]
    fitting = [c for c in there if c.error <= accuracy and c.volume_error <= 0.01]
    if not fitting:
        with pytest.raises(SceneError, match="must be at least"):
            choose(accuracy, **given)
        return
    choice = choose(accuracy, **given)
    assert choice.error <= accuracy and choice.cpu_seconds == min(c.cpu_seconds for c in fitting)
    assert all(getattr(choice, key) == value for key, value in given.items())


def test_every_model_was_measured_at_more_than_one_spacing():
    for model in ("full", "quarter", "axisymmetric"):
        assert len({c.spacing for c in measured() if c.model == model}) > 1
    assert all(0.0 < c.error < 0.05 and c.cpu_seconds > 0.0 for c in measured())


def test_the_scene_is_made_as_chosen_and_says_so(capsys):
    choice = choose(0.005)
    scene = mps.slump_cone(accuracy=0.005, yield_value=500.0)
    assert (scene.spacing, scene.parameters["model"]) == (choice.spacing, choice.model)
    assert scene.axisymmetric == (choice.model == "axisymmetric")
    out, err = capsys.readouterr()
    assert out == "" and err == f"taichi-mps: accuracy = 5 mm: {choice}\n"
    again = catalogue.build("slump", **scene.parameters)  # as a checkpoint does: nothing is chosen anew
    assert again.spacing == scene.spacing and capsys.readouterr().err == ""


def test_what_is_given_rules(capsys):
    assert mps.slump_cone(accuracy=0.02, model="full").parameters["model"] == "full"
    assert mps.slump_cone(accuracy=0.02, lift_speed=0.12).parameters["model"] == "full"
    scene = mps.slump_cone(accuracy=0.001, model="half", spacing=0.03)
    assert scene.spacing == 0.03 and len(scene.mirrors) == 1
    assert "0.03" not in capsys.readouterr().err


def test_what_nothing_reaches_is_refused_with_the_best_there_is(monkeypatch):
    with pytest.raises(SceneError, match=r"accuracy = 1e-06 m: must be at least 0.\d+ m, which is model = "):
        mps.slump_cone(accuracy=1e-6)
    with pytest.raises(SceneError, match="with spacing = 0.013: nothing was measured there$"):
        mps.slump_cone(accuracy=0.005, spacing=0.013)
    swollen = [replace(c, volume_error=0.011) if c.spacing == 0.02 else c for c in measured()]
    monkeypatch.setattr("taichi_mps.problem.accuracy.measured", lambda: swollen)
    with pytest.raises(
        SceneError, match="with spacing = 0.02: nothing was measured there that keeps the volume within 1 %$"
    ):
        mps.slump_cone(accuracy=0.05, spacing=0.02)


@mps.checked
def side(length: Length):
    return length


@pytest.mark.parametrize(
    ("text", "metres"), [("5mm", 0.005), ("1.5 cm", 0.015), ("2m", 2.0), ("0.03", 0.03), (0.04, 0.04)]
)
def test_lengths_with_a_unit(text, metres):
    assert side(length=text) == pytest.approx(metres, rel=1e-15)


@pytest.mark.parametrize("text", ["5km", "mm", "5 mm2", "-5mm"])
def test_bad_lengths_are_refused(text):
    with pytest.raises(SceneError, match="length = "):
        side(length=text)
