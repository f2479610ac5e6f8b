"""Bad input gives one SceneError that names the key, the value with its unit and what is allowed."""

import math
import re
import sys
from fractions import Fraction
from unittest.mock import Mock

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import taichi_mps as mps
from taichi_mps import spelling
from taichi_mps.cli import study
from taichi_mps.units import Count, Length, SceneError, Viscosity, in_unit
from taichi_mps.viz import render

NOTHING, TILTED = mps.measure.still(np.zeros((0, 3)), 0.01), mps.Plane((0, 0, 0), (0.6, 0.8, 0), mirror=True)


@mps.checked
def sample(spacing: Length, plastic_viscosity: Viscosity = 50.0, layers: Count = 3):
    return spacing, plastic_viscosity, layers


@pytest.mark.parametrize(
    ("call", "parts"),
    [
        (lambda: mps.Bingham(plastic_viscosity=-2.0), ["plastic_viscosity = -2.0 Pa s", "greater than 0 Pa s"]),
        (lambda: mps.Bingham(density=40000.0), ["density = 40000.0 kg/m3", "less than or equal to 30000 kg/m3"]),
        (lambda: mps.Bingham(yield_value=math.nan), ["yield_value = nan Pa", "finite number"]),
        (lambda: mps.Bingham(yield_value="stiff"), ["yield_value = stiff: must be a number [Pa]"]),
        (lambda: mps.Bingham(critical_strain_rate=0.0), ["critical_strain_rate = 0.0 1/s", "greater than 0 1/s"]),
        (lambda: mps.Bingham(yeild_value=3.0), ["unknown key 'yeild_value'", "did you mean 'yield_value'?"]),
        (lambda: mps.Implicit(courant_number=1.5), ["courant_number = 1.5", "less than or equal to 1"]),
        (lambda: mps.Implicit(walls="ghosts"), ["walls = ghosts", "'surfaces' or 'particles'"]),
        (lambda: mps.SemiImplicit(picard_limit=0), ["picard_limit = 0", "greater than or equal to 1"]),
        (lambda: sample(), ["spacing is missing [m]"]),
        (lambda: sample(spacing=0.01, layers=2.5), ["layers = 2.5", "valid integer"]),
        (lambda: sample(spacing=0.01, spacings=1.0), ["unknown key 'spacings'", "did you mean 'spacing'?"]),
        (lambda: mps.catalogue.build("slump", spacing=0.5), ["spacing = 0.5 m", "at most 0.2 m"]),
        (lambda: mps.catalogue.build("slumb"), ["unknown scene 'slumb'", "did you mean 'slump'?"]),
        (lambda: mps.slump_cone(mps.Bingham(), density=2000.0), ["density = 2000.0", "already given"]),
        (lambda: mps.backend.init(arch="tpu"), ["arch = tpu", "must be 'cpu', 'cuda' or 'vulkan'"]),
        (lambda: mps.backend.init(precision="f16"), ["precision = f16", "must be 'f32' or 'f64'"]),
        (lambda: mps.backend.init(threads=0), ["threads = 0", "greater than or equal to 1"]),
        (lambda: mps.backend.init(threads=2.5), ["threads = 2.5", "must be a valid integer"]),
        (lambda: mps.backend.init(arch=["cpu"]), ["arch = ['cpu']", "must be 'cpu', 'cuda' or 'vulkan'"]),
        (
            lambda: mps.rest_shapes.spread_at_rest(0.005, -1.0, 100.0),
            ["density = -1.0 kg/m3", "greater than or equal to 0.001 kg/m3"],
        ),
        (lambda: mps.rest_shapes.spread_at_rest(0.005, 2300.0, "x"), ["yield_value = x", "must be a number [Pa]"]),
        (lambda: mps.fill(mps.Box((0, 0), (1, 1)), math.nan), ["spacing = nan m", "must be a finite number"]),
        (lambda: mps.lattice((0, 0), (1, 1), -1.0), ["spacing = -1.0 m", "greater than 0 m"]),
        (lambda: mps.Plane((0, 0), (0, 1), friction="a"), ["friction = a", "must be an instance of Friction"]),
        (lambda: mps.Cylinder((0, 0), 1.0, inside="outside"), ["inside = outside", "must be a valid boolean"]),
        (lambda: mps.Cavity((0, 0), (1, 1), (), -1.0), ["spacing = -1.0 m", "greater than 0 m"]),
        (lambda: mps.backend.init(arch="vulkan", precision="f64"), ["precision = f64", "must be f32 on arch = vulkan"]),
        (lambda: mps.Box((1, 1), (0, 0)), ["high = (0, 0) m of a box: must be above low = (1, 1) m"]),
        (
            lambda: mps.Box((0, 0), np.ma.masked_equal((1, -1), -1)),
            ["high = ", "m: must be finite numbers of the shape"],
        ),
        (lambda: mps.Cone(-1.0, 1.0, 1.0), ["base_radius = -1.0 m: must be greater than or equal to 0 m"]),
        (lambda: mps.Cone(0.0, 0.0, 1.0), ["base_radius = 0 m, top_radius = 0 m: one must be greater than 0 m"]),
        (lambda: mps.Bingham(density="a\n b\n"), ["density = a b: must be a number [kg/m3]"]),
        (lambda: mps.Implicit(max_time_step=0.0), ["max_time_step = 0.0 s: must be greater than 0 s"]),
        (lambda: mps.Implicit(max_time_step=1e-300), ["max_time_step = 1e-300 s: must be at least 1e-09 s"]),
        (lambda: mps.Implicit(max_time_step=2e6), ["max_time_step = 2000000.0 s: must be less than or equal"]),
        (
            lambda: mps.Bingham(density=-1.0, plastic_viscosity=0.0, colour="grey"),
            ["density = -1.0", "; plastic_viscosity = 0.0", "; unknown key 'colour'"],
        ),
        (lambda: mps.Simulation(None), ["scene = None: must be a Scene"]),
        (lambda: mps.Simulation(mps.slump_cone(spacing=0.05), "implicit"), ["numerics = implicit: must be Implicit"]),
        (lambda: mps.Simulation(mps.slump_cone(spacing=0.05), mps.Implicit), ["numerics = <", ">: must be Implicit"]),
        (
            lambda: render.Renderer(mps.slump_cone(spacing=0.05), view="colour"),
            ["view = colour: must be 'concrete', '"],
        ),
        (lambda: sample(spacing="1,000"), ["spacing = 1,000 m: is 1.000 or 1000; must be written without a comma"]),
        (lambda: sample(spacing="-12,345 mm"), ["spacing = -12,345 mm: is 12.345 or 12345; must be written without"]),
        (
            lambda: mps.catalogue.build("film", yield_value=0.0, critical_strain_rate="rational"),
            ["yield_value = 0 Pa: a fluid without yield stress has no critical strain rate"],
        ),
        (lambda: mps.rest_shapes.spread_at_rest(5.5e-3, 2300.0, 0.0), ["yield_value = 0.0 Pa: must be greater"]),
        (lambda: mps.Plane((0, 0), (0, 1), velocity=((1.0,), (2.0,))), ["velocity = ", " rows of a time"]),
        (
            lambda: mps.fill(mps.Cone(0.1, 0.05, 0.3), 0.02, (TILTED,)),
            ["mirrors: normal = ", ": must be along an axis"],
        ),
        (lambda: mps.measure.front(NOTHING), ["no particles; must have one or more"]),
        (lambda: mps.measure.clearance(NOTHING, [TILTED]), ["no particles; must have one or more"]),
    ],
)
def test_message(call, parts):
    with pytest.raises(SceneError) as error:
        call()
    for part in parts:
        assert part in str(error.value)


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
    ("unit", "value", "texts"),
    [
        ("Pa", 500.0, "0.5kPa|500 Pa|0.5 kpa|0,5 KPa|5 mbar|500 N/m^2|500 N/m²|500 N m-2|500 N·m⁻²|500 Nm-2"
         "|0.0005 N/mm2|500 J/m3"),
        ("Pa", 3e6, "3 N/mm2|3 MPa|3 Mpa|3·10³ kPa|3x10^3 kPa|3 N/mm**2|3000000 Pascal|3,000,000"
         "|3.000.000,0 pascal|30 bar"),
        ("m", 0.3, "30 cm|300mm|0,3|0,300|３００ｍｍ|300 ㎜|300 millimetres|300000 µm|300000 μm|300\u202f000 um"
         "|300 MM"),
        ("m", -0.005, "-5mm|−5 mm|-0,5 cm|-5E-3|-.5cm"),
        ("m", 0.01016, "0.4 in|0.4\"|0.4″|0.4''|0.4 inches|0,4 in."),
        ("s", 120.0, "2 min|2 mins|120 sec.|2 minutes|2 Minuten|120 秒|2分|0.03333333333333333333333 h"),
        ("m3/s", 0.012, "12 l/s|12 L/s|43.2 m3/h|43,2 m³/h|720 l/min|720 lpm|12 dm³/s|12 litres per second"
         "|43.2 m^3 h^-1"),
        ("m/s", 0.1, "100 mm/s|0.1 m s-1|0.1 m·s⁻¹|0.1 ms-1|6 m/min|0,36 km/h"),
        ("kg/m3", 2300.0, "2.3 t/m3|2,3 g/cm³|2.3 g/cc|2.3 kg/l|2300 kg m-3|2300 kg m^{-3}|2300 kgm-3|2300 Kg/m3"
         "|2300 kg/cbm|2.3 T/M3|2.3 G/CM3|2300㎏/㎥"),
        ("kg/m3", 16.018463373960138, "1 lb/ft3|1 lbm/ft3|1 lbs/cu. ft|1 pcf"),
        ("Pa s", 0.3, "300 mPa s|300 mPa·s|300 mPas|300 mPa.s|300 cP|300 cps|3 dPa s|3 poise|0.3 kg/(m s)|0.3 kg/m·s"
         "|0.3 kg/ms"),
        ("Pa s", 50.0, "50 Pas|50 Pa-s|50 Pa*s|50 Ns/m2|50 Nsm-2|50 kg m-1 s-1|50 Pa ⋅ s|50 Pa s|5×10¹ Pa\u2009s"
         "|50 ㎩·s|50 [Pa s]|50 PA.S|50 pa-s|𝟓𝟎 𝑃𝑎·𝑠|50\u202aPa s\u202c|50 Ns·m−2|5*10**1 N.s.m-2"),
        ("Pa s^n", 20.0, "20 Pa s^n|20 Pa.s^n|20 Pa·sⁿ|20 Pasⁿ|0,02 kPa s^{n}|20 Nsⁿ/m²|20 Pa*s**(n)|20 Pa-s^n"),
        ("Pa/s", 0.5, "30 Pa/min|0.5 Pas⁻¹"),
        ("Pa s/m", 5.0, "5 Pa s/m|5 Pa/(m/s)|5 Pa·s·m⁻¹"),
        ("1/s", 0.1, "6 1/min|6 min^-1|6 min⁻¹|6/min|6 per minute|0.1 Hz|0.1 s-1|0.1 (1/s)|0,1 s^(-1)"),
        ("rpm", 30.0, "30 rpm|30 1/min|30 min^-1|30 min⁻¹|30 U/min|30 r/min|0.5 Hz|0,5 rev/s|0.5 s-1|180 °/s|30 RPM"
         "|30 turns per minute|30 rotations/min|30 r.p.m.|30 r/分|30 Umin-1|30 Umin⁻¹"),
        ("deg", 36.0, "36°|36 º|36 deg|36 degrees|40 gon"),
        ("-", 0.95, "95 %|0,95|９５％|950 ‰|.95"),
        ("l0", 3.1, "3.1 l0|3,1"),
        ("Pa", 1234.5, "1.234,5|1,234.5 Pa|1'234.5|1_234,5|1234,500 Pa|1\u2009234.5"),
    ],
)  # fmt: skip
def test_a_number_with_its_unit_is_the_nearest_number_in_ours(unit, value, texts):
    for text in texts.split("|"):
        assert float(in_unit(unit, text)) == value, text


@pytest.mark.parametrize("given", ["2.3e6", "nan", "inf", "rational", "", "e6", 3, None, "1e400", "nan Pa", "9" * 200])
def test_what_is_no_number_with_a_unit_is_left_as_it_is(given):
    assert in_unit("Pa", given) == given


REFUSED = {
    "Pa": "300mm|12 nonsense|1 Pa^(1/0)|5 Pa s|5 Pas|2e999 Pas|300 mpa|1 Pa Pa|0x10|10³ Pa|3½ Pa|2 300 Pa"
    "|10-20 Pa|1,5,3|1.5.3|1,23.4|5,|1;5|1 Pa, 2 Pa|10**10**10 Pa|5 N/mm 2|2e9999 Pa|1__0",
    "m": "5 mm 3|10 m**10**10|1 (((m)))|5 %|5'11\"|5 1/2 in|1e400 mmm|5 m^99",
    "kg/m3": "2.3 ton/m3|2.3 gr/cm3|2300 kg",  # a ton has two sizes, and gr is grain to some
    "1/s": "6 rpm|6 U/min|0.1 rad/s|6 min",
    "rpm": "10 %|10 min|10 m/s",
    "deg": "30 %|30 ppm|30 Grad|0.3 m/m",
    "-": "0.5 rad|30°",
    "Pa s": "50 cSt|50 Pa",
    "Pa s^n": "20 Pa s|20 Pa s^0.5",
}


@pytest.mark.parametrize("unit", REFUSED)
def test_a_unit_of_another_kind_is_refused(unit):
    kind = "must be a number " + (f"in {unit} or a unit of that kind" if unit != "-" else "without a unit, or in %")
    for text in REFUSED[unit].split("|"):
        with pytest.raises(ValueError, match=f"^{re.escape(kind)}$"):
            in_unit(unit, text)


INCH, POUND = Fraction("0.0254"), Fraction("0.45359237")  # in m and kg
SIZES = {  # of other units in ours, exactly
    "Pa": {"kPa": 1000, "µPa": Fraction(1, 10**6), "mbar": 100, "psi": Fraction("4.4482216152605") / INCH**2},
    "m": {"mm": Fraction(1, 1000), "um": Fraction(1, 10**6), "dm": Fraction(1, 10), "ft": 12 * INCH},
    "Pa s": {"mPa h": Fraction(36, 10), "kg cm^-1 s^-1": 100, "lb/(in s)": POUND / INCH},
    "kg/m3": {"t m^-3": 1000, "kg L^-1": 1000, "g/ml": 1000, "mg/mm^3": 1000, "lb/ft^3": POUND / (12 * INCH) ** 3},
    "m3/s": {"l s^-1": Fraction(1, 1000), "cc/min": Fraction(1, 6 * 10**7), "dm^3 h^-1": Fraction(1, 36 * 10**5)},
    "m/s": {"km h^-1": Fraction(10, 36), "in/min": INCH / 60},
    "1/s": {"1/min": Fraction(1, 60), "h^-1": Fraction(1, 3600)},
    "rpm": {"U s^-1": 60, "°/sec": Fraction(1, 6), "rev/h": Fraction(1, 60), "s^-1": 60},
}  # fmt: skip
MARKS = [("", "."), ("", ","), *map(tuple, (",.", ".,", "',", "’.", "\u00a0.", "\u2009.", "\u202f,"))]
RAISED = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")
WIDE = str.maketrans("0123456789", "０１２３４５６７８９")


@settings(max_examples=400, deadline=None)
@given(
    st.decimals(-(10**7), 10**7, places=2) | st.decimals(-(10**5), 10**5, places=4),
    st.sampled_from([(ours, *other) for ours, others in SIZES.items() for other in [("", 1), *others.items()]]),
    st.sampled_from(MARKS),
    st.integers(-9, 9),
    st.sampled_from(["", "e{0}", "E{0:+d}", "x10^{0}", " × 10{1}", "·10**{0}"]),
    st.sampled_from([*"*·⋅×. "]),
    st.sampled_from(["^{0}", "**{0}", "{0}", "{1}", "^{{{0}}}", "^({0})"]),
    st.sampled_from([{}, WIDE, {45: 0x2212}, {45: 0x2013}]),
)
def test_a_number_in_any_spelling_with_any_unit_is_the_nearest_in_ours(
    number, unit, marks, power, ten, times, exponent, letters
):
    ours, name, size = unit
    text = f"{number:,}".translate(str.maketrans(dict(zip(",.", marks, strict=True))))
    text += ten.format(power, str(power).translate(RAISED))
    name = re.sub(r"\^(-?\d)", lambda found: exponent.format(found[1], found[1].translate(RAISED)), name)
    found = in_unit(ours, f"{text.translate(letters)} {name.replace(' ', times)}")
    assert float(found) == float(Fraction(number) * Fraction(10) ** (power if ten else 0) * size)


@settings(max_examples=300, deadline=None)
@given(
    st.sampled_from(["Pa s", "m", "rpm", "deg", "-", "Pa s^n", "1/s"]),
    st.lists(
        st.sampled_from([*"1,.- /*()^²⁻s'\"%°nNx½", "Pa", "mm", "kg", "10", "e9", "per ", "min", "⁻¹"]), max_size=9
    ),
)
def test_any_text_is_read_or_refused_in_words(unit, parts):
    try:
        in_unit(unit, "5" + "".join(parts))
    except ValueError as error:
        assert "must be" in str(error)


@pytest.mark.parametrize(("module", "error"), [(None, ImportError), (Mock(UnitRegistry=3), TypeError)])
def test_where_pint_fails_the_number_is_not_called_wrong(monkeypatch, module, error):
    monkeypatch.setitem(sys.modules, "pint", module)
    spelling.registry.cache_clear()
    assert sample(spacing="0,5", plastic_viscosity="20 Pa s") == (0.5, 20.0, 3)
    with pytest.raises(error):
        sample(spacing="5 mm")
    spelling.registry.cache_clear()


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["new", "film", "--consistency", "20 Pa s^n", "--spacing=1,25 mm"], "\nconsistency = 20.0 "),
        (["new", "vane", "--speed", "10 1/min"], "\nspeed = 10.0 "),
        (["new", "film.toml"], "\nyield_value = 20.5 "),
        (["new", "pair.py", "--at", "0,5"], "taichi-mps: at: 2 values: 0, 5 m\n"),
        (["new", "pair.py", "--at", "0,5,1"], "at = ['0', '5', '1'] m: must be 2 values\n"),
        (["new", "pair.py", "--at", "5"], "at = ['5'] m: must be 2 values\n"),
        (["new", "pair.toml"], "taichi-mps: at: 2 values: 0.05, 5 m\n"),
        (["sweep", "film", "--yield-value", "200,5"], "taichi-mps: yield_value: 2 values: 200, 5 Pa\n"),
        (["sweep", "film", "--yield-value", "0,5:50:9"], "yield_value: 9 values: 0.5, 0.8891, 1.581, ..., 50 Pa\n"),
        (["require", "wall", "--plastic-viscosity", "10,5"], "plastic_viscosity: 2 values: 10, 5 Pa s\n"),
        (
            ["new", "film", "--friction-angle", "10 %"],
            "friction_angle = 10 %: must be a number in deg or a unit of that",
        ),
        (
            ["new", "film", "--yield-value", "1,000"],
            "yield_value = 1,000 Pa: is 1.000 or 1000; must be written without",
        ),
        (["new", "film", "--yield-value", "ü" * 9999], "ü: must be a number [Pa]\n"),
    ],
)
def test_the_command_line_reads_one_number_or_a_list(tmp_path, monkeypatch, capsys, words, told):
    monkeypatch.chdir(tmp_path)
    for name in ("sweep", "find_borders"):
        monkeypatch.setattr(study, name, Mock(side_effect=SceneError("computes nothing")))
    (tmp_path / "pair.py").write_text(
        "import taichi_mps as mps\nfrom taichi_mps.units import Position\n@mps.checked\n"
        "def scene(at: tuple[Position, Position] = (0.0, 0.0)) -> mps.Scene:\n"
        "    return mps.Scene('x', mps.Bingham(), 0.1, [at], ((-9, -9), (9, 9)), until=1.0)\n"
    )
    (tmp_path / "pair.toml").write_text("scene = 'pair.py'\n[test]\nat = ['5 cm', 5]\n")
    (tmp_path / "film.toml").write_text("scene = 'film'\n[mix]\nyield_value = '20,5'\n")
    mps.main(words)
    out, err = capsys.readouterr()
    assert told in out + err
