"""A law is defined by its numbers; a number that the chosen law does not have is refused by name, however it is
given."""

import json
from dataclasses import replace

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.app.worker import forecast
from taichi_mps.engine.problem.materials import LAWS, TYPICAL_RATE, numbers_of
from taichi_mps.engine.problem.problem import Problem
from taichi_mps.study.reuse import shape_of
from taichi_mps.study.sweep import cases
from taichi_mps.units import YieldValue


class Thinning(mps.Law):
    """A law of somebody's own: tau_y + k sqrt(rate)."""

    yield_value: YieldValue = 40.0
    k: float = 30.0

    def shear_stress(self, rate, structure):
        return (1.0 + structure) * self.yield_value + self.k * rate**0.5


class Building(Thinning):
    """And thixotropic."""

    def growth(self, rate, structure):
        return 0.5 - rate * structure


class Falling(Thinning):
    def shear_stress(self, rate, structure):
        return self.yield_value - self.k * rate


def curve(rate, structure):
    return 40.0 + 30.0 * rate


# ---- what a law answers -------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("material", "at_4", "slope", "ages"),
    [
        (mps.Bingham(yield_value=40.0, plastic_viscosity=30.0), 160.0, 30.0, False),
        (mps.HerschelBulkley(yield_value=40.0, consistency=30.0, flow_index=0.5), 100.0, 30.0 / 5.0**0.5, False),
        (mps.HerschelBulkley(yield_value=40.0, consistency=30.0, structuration=0.5), 160.0, 30.0, True),
        (mps.FlowCurve(yield_value=40.0, typical_slope=7.0, shear_stress=curve), 160.0, 7.0, False),
        (Thinning(), 100.0, 30.0 / 5.0**0.5, False),
        (Building(k=60.0), 160.0, 60.0 / 5.0**0.5, True),
    ],
    ids=lambda value: type(value).__name__ if isinstance(value, mps.Law) else None,
)
def test_stress_typical_slope_and_thixotropy_follow_from_the_numbers(material, at_4, slope, ages):
    assert material.shear_stress(4.0, 0.0) == pytest.approx(at_4, rel=1e-14)
    assert material.shear_stress(0.0, 0.0) == pytest.approx(material.yield_value, rel=1e-4)
    assert material.typical_slope == pytest.approx(slope, rel=1e-12) and TYPICAL_RATE == 5.0
    assert material.ages is ages and not material.newtonian and material.rests
    assert ("growth" in material.functions) is ages


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.__name__)
def test_the_rate_at_the_stress_of_a_rate_is_that_rate(law):
    index = {"flow_index": 0.6} if "flow_index" in numbers_of(law) else {}
    material = law(**{"yield_value": 30.0, law.viscous[0]: 0.7, **index})
    rates = np.array([1e-3, 0.5, 20.0])
    stresses = np.array([material.shear_stress(rate, 0.0) for rate in rates])
    np.testing.assert_allclose(material.shear_rate(stresses), rates, rtol=1e-9)
    assert material.shear_rate(np.array([0.0, 29.0, 30.0])).tolist() == [0.0] * 3
    assert np.all(np.diff(stresses) > 0.0)


def test_a_class_of_ones_own_is_a_law_as_any(monkeypatch):
    """A user's law is compiled with its numbers, tested, and named in errors; it has its own key in the compile cache,
    and as a parameter of a scene its numbers are keywords."""
    from taichi_mps.engine.terms.rheology import OwnLaw

    mps.init(arch="cpu")
    rates, structure = np.array([0.0, 1.0, 9.0]), np.array([0.0, 1.0, 2.0])
    stress, growth = OwnLaw(Building(k=10.0)).evaluate(rates, structure)
    np.testing.assert_allclose(stress, 40.0 * (1.0 + structure) + 10.0 * rates**0.5, rtol=1e-6)
    np.testing.assert_allclose(growth, 0.5 - rates * structure, rtol=1e-6)
    film = replace(mps.catalogue.build("film", spacing=0.02), check=None, measure=None)
    monkeypatch.setattr(mps.Simulation, "_build", lambda sim: pytest.fail("allocated"))
    for mix, message in (
        (Falling(), "shear_stress = Falling.shear_stress: .*must"),
        (Thinning(k=0), "typical_slope = 0 "),
    ):
        with pytest.raises(mps.SceneError, match=f"material: {message}"):
            mps.Simulation(replace(film, material=mix))
    mixes = Thinning(), Building(), Thinning(k=20.0), mps.FlowCurve(shear_stress=curve), mps.HerschelBulkley()
    assert len({shape_of(Problem(replace(film, material=mix))) for mix in mixes}) == len(mixes)  # compiled whole
    assert all(mix.own is not isinstance(mix, mps.HerschelBulkley) for mix in mixes)

    @mps.checked
    def scene(material: Thinning = Thinning(k=20.0)):  # noqa: B008
        return material

    assert scene(yield_value="0.05 kPa") == Thinning(yield_value=50.0, k=20.0) and scene() == Thinning(k=20.0)


@pytest.mark.parametrize(
    ("base", "body", "message"),
    [
        (mps.Bingham, {"shear_stress": curve}, "a law with a flow curve of its own must derive from mps.Law"),
        (mps.Law, {}, "abstract"),
        (mps.Law, {"shear_stress": lambda _law, rate, _structure: 30.0 * rate}, "yield_value is missing"),
    ],
)
def test_a_class_that_is_no_law_is_refused_where_it_is_made(base, body, message):
    with pytest.raises((TypeError, mps.SceneError), match=message):
        type("Mine", (base,), body)()


# ---- refused by name ----------------------------------------------------------------------------------------------
TWICE = "plastic_viscosity = {} Pa s: stands for consistency, which is given; must be left out"
NEITHER = "flow_index = 0.5: the law Bingham, by friction_angle, has no such number; must be left out"
BINGHAM = "the mixes that are looked for, and their slumps, are of Bingham's law; must be left out"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("run slump --consistency 20 --flow-index 0.5 --plastic-viscosity 77", TWICE.format(77)),
        ("run slump --consistency 20 --plastic-viscosity 50", TWICE.format(50)),
        ("run slump --friction-angle 20 --flow-index 0.5", NEITHER),
        ("run slump --destructuration 0.5", "destructuration = 0.5: undoes structuration, which must be given"),
        ("new slump --friction-angle 20 --flow-index 0.5", NEITHER),
        ("sweep slump --plastic-viscosity 20,50 --consistency 30", TWICE.format(20)),
        ("sweep film --friction-angle 20 --flow-index 0.5,1", NEITHER),
        ("require wall --consistency 20", f"consistency = 20 Pa s^n: {BINGHAM}"),
        ("require wall --flow-index 0.5", f"flow_index = 0.5: {BINGHAM}"),
        ("require wall --friction-angle 10", f"friction_angle = 10 deg: {BINGHAM}"),
        ("calibrate --slump 0.2 --consistency 5", "unknown option --consistency: the law HerschelBulkley has it"),
        (
            "run slump --scheme semi-implicit --consistency 5",
            "material HerschelBulkley: must be Bingham with the scheme",
        ),
    ],
)
def test_the_command_line_refuses_a_number_that_the_law_has_not(words, message, tmp_path, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    code, _, told = command(*words.split())
    assert code == 2 and message in told.splitlines()[-1] and not list(tmp_path.iterdir())
    if words.startswith("run"):
        assert message in "; ".join(forecast(words.split()[1:])["wrong"].values()), "the page"


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: mps.Concrete(consistency=20.0, plastic_viscosity=50.0), TWICE.format(50)),
        (lambda: mps.slump_cone(consistency=20.0, plastic_viscosity=50.0), TWICE.format(50)),
        (lambda: mps.slump_cone(mps.Bingham(), consistency=20.0), "consistency = 20.0: already given by the material"),
        (lambda: cases("slump", plastic_viscosity=[20, 50], consistency=30), TWICE.format(20)),
        (lambda: mps.Bingham(consistency=20.0), "unknown key 'consistency': the law HerschelBulkley has it"),
        (
            lambda: mps.Concrete(structuration=1.0, yield_value=0.0),
            "structuration = 1 Pa/s: needs a yield stress to grow",
        ),
        (
            lambda: mps.HerschelBulkley(age="2 min"),
            "age = 120 s: needs a yield stress that grows at rest; structuration must be given",
        ),
        (
            lambda: mps.Concrete(structuration=-1.0),
            "structuration = -1.0 Pa/s: must be greater than or equal to 0 Pa/s",
        ),
        (lambda: mps.Concrete(flow_index=9.0), "flow_index = 9.0: must be less than or equal to 4"),
        (lambda: mps.slump_cone(friction_angle=90.0), "friction_angle = 90"),
        (
            lambda: mps.slump_cone(friction_angle=20.0, critical_strain_rate=0.1),
            "friction_angle = 20 deg: needs a true yield stress",
        ),
        (
            lambda: mps.HerschelBulkley(plastic_viscosity=20.0),
            "unknown key 'plastic_viscosity': the law Bingham has it",
        ),
    ],
)
def test_python_refuses_a_number_that_the_law_has_not_or_cannot_have(call, message):
    with pytest.raises(mps.SceneError, match=f"^{message}"):
        call()


def test_a_case_file_has_the_numbers_of_its_law_and_takes_those_of_one_written_before(tmp_path, command):
    """A case file written before 0.3 has the numbers of all laws, those without effect at their defaults, and is
    read."""
    case = tmp_path / "case.toml"
    text = command("new", "slump", "--consistency", "20", "--flow-index", "0.5")[1]
    assert "\nconsistency = 20.0" in text and "# plastic_viscosity = " in text and "# friction_angle = " in text
    for mix, wrong in (("plastic_viscosity = 50.0\nconsistency = 20.0\nfriction_angle = 0.0\n", False),
                       ("plastic_viscosity = 77.0\nconsistency = 20.0\n", True)):  # fmt: skip
        case.write_text(
            f"scene = 'slump'\n[mix]\n{mix}flow_index = 0.5\nstructuration = 0.0\ndestructuration = 0.005\n"
        )
        code, _, told = command("run", case, "--forecast")
        assert (code, TWICE.format(77) in told) == (2 * wrong, wrong)


@pytest.mark.parametrize("numbers", [{}, {"consistency": 9.0}, {"structuration": 0.5}, {"flow_index": 1.0}])
def test_parameters_are_the_numbers_of_the_law_and_make_the_same_scene_again(numbers):
    scene = mps.catalogue.build("l_flow", **numbers)
    viscous = {law.viscous[0] for law in LAWS if scene.parameters[law.viscous[0]] is not None}
    assert viscous == {scene.material.viscous[0]} and numbers.items() <= scene.parameters.items()
    assert mps.catalogue.rebuild("l_flow", json.loads(json.dumps(scene.parameters))).material == scene.material
