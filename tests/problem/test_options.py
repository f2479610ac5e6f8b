"""A number of the mix is declared once, in its material, and thereby is an option of every scene."""

from contextlib import nullcontext
from typing import Annotated

import pytest
from pydantic import Field

import taichi_mps as mps
from taichi_mps.cli.options import allowed, choices, default
from taichi_mps.units import Checked, Duration, Length, Unit, YieldValue, unit_of

ImaginedAngle = Annotated[float, Field(ge=0.0, lt=45.0), Unit("deg")]


class Imagined(mps.Bingham):
    """A mix with one number more."""

    imagined_angle: ImaginedAngle = Field(0.0, description="angle that nobody has measured")


class Looked(Checked):
    softest: YieldValue = Field(10.0, gt=0.0)


@mps.checked
def made_up(material: Imagined = Imagined(imagined_angle=12.0, yield_value=40.0), spacing: Length = 0.1):  # noqa: B008
    """The material and the spacing."""
    return material, spacing


@mps.checked
def required(until: Duration, material: mps.HerschelBulkley):
    return material


@pytest.mark.parametrize(
    ("call", "found"),
    [
        (made_up, (Imagined(imagined_angle=12.0, yield_value=40.0), 0.1)),
        (
            lambda: made_up(imagined_angle="30", density=2000),
            (Imagined(imagined_angle=30.0, yield_value=40.0, density=2000.0), 0.1),
        ),
        (lambda: required(until=1.0, flow_index=0.5), mps.HerschelBulkley(flow_index=0.5)),
        (lambda: made_up(imagined_angle=50.0), "imagined_angle = 50.0 deg: must be less than 45 deg"),
        (lambda: made_up(imagined_angel=5.0), "unknown key 'imagined_angel', did you mean 'imagined_angle'?"),
        (
            lambda: made_up(density=2.3),
            r"density = 2.3 kg/m3: must be greater than or equal to 200 kg/m3 \(2300 for 2.3 t/m3\)",
        ),
        (lambda: made_up(material=mps.Bingham()), "unknown key 'material'"),
    ],
)
def test_options_are_flat_and_the_function_is_given_the_material(call, found):
    refused = pytest.raises(mps.SceneError, match=f"^{found}") if isinstance(found, str) else nullcontext()
    with refused:
        assert call() == found


def test_an_option_that_stands_twice_is_an_error_of_the_scene():
    with pytest.raises(TypeError, match="density is declared twice"):

        @mps.checked
        def scene(density: Length, material: mps.Bingham):
            """Nothing."""


def test_a_number_of_the_mix_is_an_option_with_its_unit_range_help_and_the_default_of_the_scene():
    fields = made_up.parameters.model_fields
    assert list(fields) == [*mps.Bingham.model_fields, "imagined_angle", "spacing"]
    angle = fields["imagined_angle"]
    assert (unit_of(angle), angle.default, angle.description) == ("deg", 12.0, "angle that nobody has measured")
    assert (default(angle), allowed(angle)) == ("default 12 deg", "(0 to below 45)")
    assert allowed(Looked.model_fields["softest"]) == "(above 0 to 1e+06)", "the narrower of two lower bounds"
    assert fields["yield_value"].default == 40.0 and fields["plastic_viscosity"].default == 50.0


LAWS = {
    mps.Bingham: {"plastic_viscosity": 33.0, "critical_strain_rate": 0.01},
    mps.HerschelBulkley: {"consistency": 33.0, "flow_index": 1.4, "structuration": 0.5, "destructuration": 0.01},
}


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.core
@pytest.mark.parametrize("name", mps.catalogue.names())
def test_every_scene_takes_every_number_of_the_mix(name, law):
    fields = mps.catalogue.load(name).parameters.model_fields
    assert set(mps.Concrete.model_fields) <= set(fields)
    assert all(fields[key].description == field.description for key, field in mps.Concrete.model_fields.items())
    given = {"density": 2100.0, "yield_value": 44.0, **LAWS[law]}
    scene = mps.catalogue.build(name, **given)
    assert scene.material == law(**given) and given.items() <= scene.parameters.items()
    assert scene.material.ages == (law is mps.HerschelBulkley)


@pytest.mark.parametrize("name", ["slump", "film", "mini_cone", "l_flow"])
def test_a_rational_critical_strain_rate_is_that_for_the_time_of_the_scene(name):
    """The rational critical strain rate of 400 Pa and 20 Pa s is min(0.01 tau_y/(2 eta), 0.01/T) = 0.01/4."""
    scene = mps.catalogue.build(
        name, yield_value=400.0, plastic_viscosity=20.0, critical_strain_rate="rational", until=4.0
    )
    assert scene.material.critical_strain_rate == pytest.approx(0.0025, rel=1e-12)
    assert scene.parameters["critical_strain_rate"] == "rational"


@pytest.mark.parametrize(
    ("scene", "given", "message"),
    [
        ("vane", {"body": "cylinder", "blades": 8}, "blades = 8: must be left out, or body = vane"),
        ("dam_break", {"lift_speed": 1.0}, "lift_speed = 1 m/s: must be left out, or model = half"),
        ("dam_break", {"depth": "5cm"}, "depth = 0.05 m: must be left out, or model = half"),
        (
            "wall",
            {"fill_point": (0.1, 0.1)},
            r"fill_point = \(0.1, 0.1\): has no effect without form; must be left out",
        ),
        ("l_flow", {"model": "plane", "width": 0.3}, "width = 0.3 m: must be left out, or model = half or full"),
        ("vane", {"turns": 0.1, "until": 1.0}, "turns = 0.1: has no effect with until; must be left out"),
    ],
)
def test_an_option_without_effect_is_refused_but_in_a_run_of_an_earlier_version(scene, given, message):
    with pytest.raises(mps.SceneError, match=f"^{message}$"):
        mps.catalogue.build(scene, **given)
    assert mps.catalogue.rebuild(scene, given).name == scene
    for name, note in mps.catalogue.load(scene).parameters.rules:
        other = mps.catalogue.load(scene).parameters.model_fields[note.key]
        assert name != note.key and set(note.values if isinstance(note.values, tuple) else ()) <= set(choices(other))
