"""Bad input ends in one SceneError that names the key, the value with its unit and what is allowed."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import taichi_mps as mps
from taichi_mps.problem import catalogue
from taichi_mps.problem.problem import Problem
from taichi_mps.runtime import backend
from taichi_mps.units import Count, Length, SceneError, Viscosity, in_unit


@mps.checked
def sample(spacing: Length, plastic_viscosity: Viscosity = 50.0, layers: Count = 3):
    return spacing, plastic_viscosity, layers


def block(**other):
    """A scene of one particle, with other keywords."""
    given = {"name": "x", "material": mps.Bingham(), "spacing": 0.1, "fluid": [[0.5, 0.5]], "domain": ((0, 0), (1, 1))}
    return mps.Scene(**given | other)


def hose(spacing):
    """A scene of a hose alone."""
    inlet = mps.Inlet((0.2, 1.5), (0.0, -1.0), radius=0.3, rate=1.0, volume=1.0)
    return mps.Scene("hose", mps.Bingham(), spacing, None, ((-3.0, -3.0), (3.0, 3.0)), inlets=(inlet,))


@pytest.mark.parametrize(
    ("call", "parts"),
    [
        (lambda: mps.Bingham(plastic_viscosity=-2.0), ["plastic_viscosity = -2.0 Pa s", "greater than 0 Pa s"]),
        (lambda: mps.Bingham(density=40000.0), ["density = 40000.0 kg/m3", "less than or equal to 30000 kg/m3"]),
        (lambda: mps.Bingham(yield_value=math.nan), ["yield_value = nan Pa", "finite number"]),
        (lambda: mps.Bingham(yield_value="stiff"), ["yield_value = stiff Pa", "must be a number [Pa]"]),
        (lambda: mps.Bingham(critical_strain_rate=0.0), ["critical_strain_rate = 0.0 1/s", "greater than 0 1/s"]),
        (lambda: mps.Bingham(yeild_value=3.0), ["unknown key 'yeild_value'", "did you mean 'yield_value'?"]),
        (lambda: mps.Implicit(courant_number=1.5), ["courant_number = 1.5", "less than or equal to 1"]),
        (lambda: mps.Implicit(walls="ghosts"), ["walls = ghosts", "'surfaces' or 'particles'"]),
        (lambda: mps.SemiImplicit(picard_limit=0), ["picard_limit = 0", "greater than or equal to 1"]),
        (lambda: sample(), ["spacing is missing [m]"]),
        (lambda: sample(spacing=0.01, layers=2.5), ["layers = 2.5", "valid integer"]),
        (lambda: sample(spacing=0.01, spacings=1.0), ["unknown key 'spacings'", "did you mean 'spacing'?"]),
        (lambda: catalogue.build("slump", spacing=0.5), ["spacing = 0.5 m", "at most 0.2 m"]),
        (lambda: catalogue.build("slumb"), ["unknown scene 'slumb'", "did you mean 'slump'?"]),
        (lambda: catalogue.slump_cone(mps.Bingham(), density=2000.0), ["density = 2000.0", "already given"]),
        (lambda: backend.init(arch="tpu"), ["arch = tpu", "cpu, cuda, vulkan"]),
        (lambda: backend.init(precision="f16"), ["precision = f16", "f32 or f64"]),
        (lambda: backend.init(threads=0), ["threads = 0", "at least 1"]),
        (lambda: backend.init(threads="2"), ["threads = 2", "a whole number"]),
        (lambda: backend.init(arch=["cpu"]), ["arch = ['cpu']", "cpu, cuda, vulkan"]),
        (lambda: mps.rest_shapes.spread_at_rest(0.005, -1.0, 100.0), ["density = -1 kg/m3", "greater than 0 kg/m3"]),
        (lambda: mps.rest_shapes.spread_at_rest(0.005, 2300.0, "x"), ["yield_value = x", "must be numbers"]),
        (lambda: mps.fill(mps.Box((0, 0), (1, 1)), math.nan), ["spacing = nan m", "greater than 0 m"]),
        (lambda: mps.lattice((0, 0), (1, 1), -1.0), ["spacing = -1 m", "greater than 0 m"]),
        (lambda: mps.Plane((0, 0), (0, 1), friction="a"), ["friction = a", "must be Friction"]),
        (lambda: mps.Cylinder((0, 0), 1.0, inside="outside"), ["inside = outside", "must be True or False"]),
        (lambda: mps.Cavity((0, 0), (1, 1), (), -1.0), ["spacing = -1 m", "greater than 0 m"]),
        (lambda: backend.init(arch="vulkan", precision="f64"), ["precision = f64", "must be f32 on arch = vulkan"]),
        (lambda: mps.Box((1, 1), (0, 0)), ["high = (0, 0) m of a box: must be above low = (1, 1) m"]),
        (lambda: mps.Cone(-1.0, 1.0, 1.0), ["base_radius = -1 m: must be at least 0 m"]),
        (lambda: mps.Cone(0.0, 0.0, 1.0), ["height = 1 m: must be greater than 0 m, and one radius"]),
        (lambda: hose(1e-233), ["inlet: radius = 0.3 m: must be at most 1000 spacings of 1e-233 m"]),  # an overflow
        (lambda: hose(1e-5), ["inlet: radius = 0.3 m: must be at most 1000 spacings of 1e-05 m"]),  # no such memory
        (lambda: mps.Bingham(density="a\n b\n"), ["density = a b kg/m3: must be a number [kg/m3]"]),
        (lambda: mps.Implicit(max_time_step=0.0), ["max_time_step = 0.0 s: must be greater than 0 s"]),
        (lambda: mps.Implicit(max_time_step=1e-300), ["max_time_step = 1e-300 s: must be at least 1e-09 s"]),
        (lambda: mps.Implicit(max_time_step=2e6), ["max_time_step = 2000000.0 s: must be less than or equal"]),
        (lambda: block(spacing="0.1"), ["spacing = 0.1: must be numbers"]),
        (lambda: block(fluid=[[2.0, 0.5]]), ["lies outside"]),
        (lambda: block(fluid=[[math.nan, 0.5]]), ["finite"]),
        (lambda: block(fluid=[]), ["at least one particle"]),
        (lambda: block(name=None), ["name = None: must be text"]),
        (lambda: block(walls=mps.Plane((0, 0), (0, 1))), ["walls = ", "must be a tuple, each Plane or Cylinder or"]),
        (lambda: block(walls=(None,)), ["walls = ", "must be a tuple, each Plane or Cylinder or Solid"]),
        (lambda: block(inlets=None), ["inlets = ", "must be a tuple, each Inlet"]),
        (lambda: block(periodic=True), ["periodic = ", "must be a tuple, each True or False"]),
        (lambda: block(periodic="ab"), ["periodic = ", "must be a tuple, each True or False"]),
        (lambda: block(cavity=1), ["cavity = ", "must be a Cavity"]),
        (lambda: block(measure="a"), ["measure = ", "must be a function"]),
        (lambda: block(until="5"), ["until = ", "must be numbers"]),
        (
            lambda: mps.Bingham(density=-1.0, plastic_viscosity=0.0, colour="grey"),
            ["density = -1.0", "; plastic_viscosity = 0.0", "; unknown key 'colour'"],
        ),
        (lambda: mps.Simulation(None), ["scene = None: must be a Scene"]),
        (lambda: mps.Simulation(block(), "implicit"), ["numerics = implicit: must be Implicit"]),
        (lambda: mps.Simulation(block(), mps.Implicit), ["numerics = ", "must be Implicit"]),
    ],
)
def test_message(call, parts):
    with pytest.raises(SceneError) as error:
        call()
    for part in parts:
        assert part in str(error.value)


@pytest.mark.parametrize("bad", [None, "x", {}, (0,), (0, None), ("a", "b"), [[1, 2], [1]], (math.nan, 0), (0.0,) * 4])
def test_a_wrong_type_in_a_body_a_wall_or_an_inlet_is_named(bad):
    distance = np.eye(4) - 0.5
    for key, make in {
        "point": lambda: mps.Plane(bad, (0, 1)),
        "normal": lambda: mps.Plane((0, 0), bad),
        "low": lambda: mps.Box(bad, (1, 1)),
        "high": lambda: mps.Box((0, 0), bad),
        "base_radius": lambda: mps.Cone(bad, 1.0, 1.0),
        "height": lambda: mps.Cone(1.0, 1.0, bad),
        "point =": lambda: mps.Cylinder(bad, 1.0),
        "radius": lambda: mps.Cylinder((0, 0), bad),
        "axis": lambda: mps.Cylinder((0, 0, 0), 1.0, bad),
        "centre = .* of an inlet": lambda: mps.Inlet(bad, (0, -1), 1.0, 1.0, 1.0),
        "direction = .* of an inlet": lambda: mps.Inlet((0, 0), bad, 1.0, 1.0, 1.0),
        "inlet: rate": lambda: mps.Inlet((0, 0), (0, -1), 1.0, bad, 1.0),
        "values": lambda: mps.Solid(bad, (0, 0), 1.0),
        "low =": lambda: mps.Solid(distance, bad, 1.0),
        "cell": lambda: mps.Solid(distance, (0, 0), bad),
    }.items():
        with pytest.raises(SceneError, match=f"^{key}.*must be"):
            make()


def test_a_step_back_is_refused():
    sim = mps.Simulation(mps.slump_cone(spacing=0.05))
    for call, message in (
        (lambda: sim.step(until=0.0), "until = 0.0 s: must be later than the present time, 0 s"),
        (lambda: sim.step(until=math.nan), "until: a value is not a finite number"),
        (lambda: sim.run(until=math.nan), "until: a value is not a finite number"),
        (lambda: sim.every(None, print), "every = None s: must be greater than 0 s"),
    ):
        with pytest.raises(SceneError, match=message):
            call()


@pytest.mark.parametrize(("density", "gravity"), [(2.3, None), (23.0, (0.0, -9.81)), (2.3e4, (6.9, -6.9))])
def test_a_density_in_another_unit_is_refused_where_things_weigh_as_on_earth(density, gravity):
    """And only there: in numbers without dimension it is 1, and so may gravity be."""

    def admit(density, gravity):
        Problem(block(material=mps.Bingham(density=density), gravity=gravity), mps.Implicit())

    with pytest.raises(SceneError, match=f"^density = {density:g} kg/m3: must be from 200 to 20000 kg/m3 .*2.3 t/m3"):
        admit(density, gravity)
    admit(1.0, (0.0, 0.0))
    admit(1.0, (0.0, -1.0))
    admit(1000.0, gravity)


@pytest.mark.filterwarnings("ignore:critical_strain_rate")
@settings(max_examples=60, deadline=None)
@given(
    st.floats(min_value=1e-300, max_value=30000.0),  # Taichi flushes denormal numbers to zero
    st.just(0.0) | st.floats(min_value=1e-300, max_value=1e6),
    st.none() | st.floats(min_value=1e-300, max_value=1e4),
)
def test_any_value_inside_its_range_is_taken_and_kept(density, yield_value, rate):
    material = mps.Bingham(density=density, yield_value=yield_value, critical_strain_rate=rate)
    assert (material.density, material.yield_value, material.critical_strain_rate) == (density, yield_value, rate)
    assert material.knee_stress >= yield_value
    with pytest.raises(ValueError, match="frozen"):
        material.density = 3.0


@pytest.mark.parametrize(
    ("unit", "text", "value"),
    [
        ("Pa", "0.5kPa", 500.0),
        ("Pa", "3 N/mm2", 3e6),
        ("m", "30 cm", 0.3),
        ("m", "-5mm", -0.005),
        ("m", "0.4 in", 0.01016),
        ("s", "2 min", 120.0),
        ("m3/s", "12 l/s", 0.012),
        ("m3/s", "43.2 m3/h", 0.012),
        ("m/s", "100 mm/s", 0.1),
        ("kg/m3", "2.3 t/m3", 2300.0),
        ("Pa s", "300 mPa s", 0.3),
        ("Pa s", "300 mPa·s", 0.3),
        ("1/s", "6 1/min", 0.1),
        ("-", "95 %", 0.95),
    ],
)
def test_a_number_with_its_unit_is_the_nearest_number_in_ours(unit, text, value):
    assert in_unit(unit, text) == value


@pytest.mark.parametrize("given", ["2.3e6", "nan", "inf", "rational", "", "e6", 3, None, "1_000"])
def test_what_is_no_number_with_a_unit_is_left_as_it_is(given):
    assert in_unit("Pa", given) is given


@pytest.mark.parametrize("text", ["300mm", "12 nonsense", "1 Pa^(1/0)", "5 Pa s", "2e999 Pas"])
def test_a_unit_of_another_kind_is_refused(text):
    with pytest.raises(ValueError, match="must be a number in Pa or a unit of that kind"):
        in_unit("Pa", text)
