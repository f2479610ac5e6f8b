"""Mini-cone, V-funnel, slump test and rheometer together: known mixes come back, by the test that tells them."""

import csv
import math

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.problem.rest_shapes import spread_at_rest
from taichi_mps.study.calibrate import calibrate, emulator_of, emulators_of
from taichi_mps.study.emulator import Emulator, Together
from taichi_mps.study.fit import fit

pytest.importorskip("scipy")

DENSITY = 2300.0
OPTIONS = {"slump_m": "slump", "spread_m": "spread", "t500_s": "t500", "mini_cone_m": "mini_cone"}
OPTIONS |= {"v_funnel_s": "v_funnel"}
ERRORS = {"slump_m": 0.005, "spread_m": 0.01, "mini_cone_m": 0.002}
TRUE = {"yield_value": 60.0, "plastic_viscosity": 30.0}


def measures(names, yield_value, plastic_viscosity):
    """What the tables of the package say of a mix, without errors."""
    tables = Together(list(emulators_of(dict.fromkeys(names)).values()))
    found = tables.at(*np.log(np.array([yield_value, plastic_viscosity]) / DENSITY))
    return {name: float(found[name]) for name in names}


@pytest.mark.parametrize(
    ("names", "known"),
    [
        (("mini_cone_m", "v_funnel_s"), ()),
        (("spread_m", "v_funnel_s"), ()),
        (("spread_m", "t500_s", "mini_cone_m", "v_funnel_s"), ()),
        (("v_funnel_s",), ("yield_value",)),
        (("mini_cone_m",), ("plastic_viscosity",)),
        (("mini_cone_m", "v_funnel_s"), ("yield_value", "plastic_viscosity")),
    ],
)
def test_a_mix_put_through_the_tables_comes_back_within_its_interval(names, known):
    exact = {OPTIONS[name]: value for name, value in measures(names, **TRUE).items()}
    found = calibrate(**exact, **{name: TRUE[name] for name in known}, check=False)
    for name, true in TRUE.items():
        constant = getattr(found, name)
        assert constant.value == pytest.approx(true, rel=1e-3 if name in known else 0.05)
        assert constant.lower <= true <= constant.upper and (constant.lower < constant.upper) == (name not in known)
    assert not found.contradictory and found.misfit < 0.01


def test_the_intervals_of_two_tests_hold_a_known_mix():
    """At least as often as they say: the errors of the tables widen them, and are not drawn here."""
    random, held = np.random.default_rng(4), []
    names = "mini_cone_m", "v_funnel_s"
    tables = Together(list(emulators_of(dict.fromkeys(names)).values()))
    for _ in range(60):
        mix = {"yield_value": random.uniform(30.0, 90.0), "plastic_viscosity": random.uniform(12.0, 50.0)}
        measured = {}
        for name, value in measures(names, **mix).items():
            error = ERRORS.get(name, 0.1 * value)
            measured[name] = value + error * random.standard_normal(), error
        found = fit(tables, measured, DENSITY)
        ends = [(getattr(found, name).lower or 0.0, getattr(found, name).upper or math.inf) for name in mix]
        held.append([low <= true <= high for (low, high), true in zip(ends, mix.values(), strict=True)])
    assert np.all(np.mean(held, 0) > 0.95 - 2.4 * math.sqrt(0.95 * 0.05 / 60))  # 2.4 standard errors of so many draws


def test_it_says_which_constant_each_test_determines():
    exact = {OPTIONS[name]: value for name, value in measures(("mini_cone_m", "v_funnel_s"), **TRUE).items()}
    both, cone = calibrate(**exact, check=False), calibrate(mini_cone=exact["mini_cone"], check=False)
    assert both.source("yield_value") == "mini-cone spread" and both.source("plastic_viscosity") == "V-funnel time"
    lines = {line.split("  ")[0]: line for line in str(both).splitlines()}
    assert "determines the yield stress" in lines["mini-cone spread"]
    assert (
        "determines the plastic viscosity" in lines["V-funnel time"] and "yield stress (" not in lines["V-funnel time"]
    )
    assert cone.source("plastic_viscosity") == "" and not cone.plastic_viscosity.determined
    assert both.facts()["worth"]["v_funnel_s"]["plastic_viscosity"] > 2.0


def test_cones_of_one_shape_are_alike():
    """Kantro's cone is the standard one, 5.24 times smaller: over the height it spreads alike where tau/(rho g H) and
    eta/(rho sqrt(g H^3)) are the same."""
    small, large = emulator_of(scene="mini_cone"), emulator_of()
    ratio = 0.0572 / 0.3
    yields, viscosities = np.log(np.geomspace(60.0, 1000.0, 9) / DENSITY), np.log(np.full(9, 100.0) / DENSITY)
    mini = small.at(yields + np.log(ratio), viscosities + 1.5 * np.log(ratio))["mini_cone_m"]
    apart = mini / ratio - large.at(yields, viscosities)["spread_m"]
    error = math.hypot(small.scatter["mini_cone_m"] / ratio, large.scatter["spread_m"])
    assert np.sqrt(np.mean(apart**2)) < 2.0 * error


def test_a_funnel_that_runs_empty_faster_than_in_a_free_fall_is_refused():
    """Its tapered part through its outlet at sqrt(2 g H): 0.59 s."""
    with pytest.raises(mps.SceneError, match="v_funnel = 0.1 s: must be more than 0.6 s"):
        calibrate(v_funnel=0.1, mini_cone=0.095)


@pytest.mark.parametrize("yield_value", [9.0, 14.0, 20.0])
def test_a_mini_cone_alone_finds_the_yield_stress_of_the_closed_form(yield_value):
    """Roussel and Coussot's spread at rest, without inertia; the error of the form, two standard errors, is a depth at
    either end (scenes/mini_cone.py)."""
    volume = math.pi / 12.0 * 0.0572 * (0.0381**2 + 0.0381 * 0.019 + 0.019**2)
    spread = spread_at_rest(volume, 1900.0, yield_value)
    depth = math.sqrt(yield_value * spread / (1900.0 * 9.81))
    found = calibrate(mini_cone=spread, mini_cone_error=depth, rho=1900.0, plastic_viscosity=10.0, check=False)
    assert (found.yield_value.lower or 0.0) <= yield_value <= (found.yield_value.upper or math.inf)
    assert found.yield_value.upper < 5.0 * yield_value


def test_contradictions_are_one_sentence_with_both_answers():
    """Each alone at the plastic viscosity that was found or, where none is determined, at a usual one."""
    found = calibrate(slump=0.15, mini_cone=0.1, check=False)
    said = found.alone["yield_value"]
    assert not found.plastic_viscosity.determined and found.others["plastic_viscosity"] == 50.0
    for option, name in (("slump", "slump_m"), ("mini_cone", "mini_cone_m")):
        value = {"slump": 0.15, "mini_cone": 0.1}[option]
        one = calibrate(**{option: value}, plastic_viscosity=50.0, check=False).yield_value
        assert said[name][0] == pytest.approx(one.value, rel=1e-6)
    first = str(found).splitlines()[0]
    assert (
        "contradict each other" in first and "the slump alone says" in first and "the mini-cone spread alone" in first
    )
    assert "Trust" not in first  # of slump and slump flow only
    known = calibrate(slump=0.25, yield_value=400.0, plastic_viscosity=50.0, check=False)
    assert "the rheometer says 400 Pa, the slump alone says" in str(known).splitlines()[0]
    late = calibrate(v_funnel=10.0, yield_value=50.0, plastic_viscosity=10.0, check=False)
    assert "the rheometer says 10 Pa s, the V-funnel time alone says" in str(late).splitlines()[0]


def test_a_list_takes_all_tests(tmp_path):
    from taichi_mps.cli.main import main

    exact = measures(("mini_cone_m", "v_funnel_s"), **TRUE)
    text = (
        f"mix,mini_cone [mm],v_funnel [s],yield_value [Pa]\n<b>,{1e3 * exact['mini_cone_m']},{exact['v_funnel_s']},\n"
    )
    (tmp_path / "mixes.csv").write_text(text + f"known,,{exact['v_funnel_s']},60\nnone,,,60\n")
    assert main(["calibrate", "--table", str(tmp_path / "mixes.csv")]) == 0
    with open(tmp_path / "mixes-calibrated.csv", newline="") as file:
        both, known, none = csv.DictReader(file)
    for row in (both, known):
        assert float(row["plastic_viscosity_lower"]) < 30.0 < float(row["plastic_viscosity_upper"])
        assert row["plastic_viscosity_from"] == "V-funnel time" and row["verdict"] == "explained"
    assert (both["yield_value_from"], known["yield_value_from"]) == ("mini-cone spread", "rheometer")
    assert none["verdict"] == "refused" and "give at least one of --slump" in none["reason"]


def test_finer_cases_of_a_table_are_its_error_and_no_nodes():
    rows, off = [], 0.003
    for tau in np.geomspace(20.0, 2000.0, 5):
        for eta in np.geomspace(5.0, 500.0, 4):
            mix = {"status": "done", "scene": "mini_cone", "yield_value": tau, "plastic_viscosity": eta}
            rows.append(mix | {"spacing": 0.002, "spread_m": 0.2 - 0.02 * np.log(tau)})
    plain = Emulator(rows)
    finer = Emulator(rows + [rows[7] | {"spacing": 0.001, "spread_m": rows[7]["spread_m"] + off}])
    assert finer.scatter["mini_cone_m"] == pytest.approx(math.hypot(plain.scatter["mini_cone_m"], off), rel=0.01)
    assert len(finer.points) == len(rows)


@pytest.mark.parametrize(
    ("told", "said"),
    [
        ({"mini_cone": 50.0}, "mini_cone = 50 m: must be less than 0.572 m"),
        ({"mini_cone": 0.02}, "mini_cone = 0.02 m: must be more than 0.0381 m, the base of the cone"),
        ({"mini_cone": 0.09, "mini_cone_error": 0.1}, "mini_cone_error = 0.1 m: must be less than 0.0572 m"),
        (
            {"v_funnel": 5.0, "yield_value": 5000.0},
            "yield_value = 5000 Pa: must be 10 to 120 Pa, what the table covers",
        ),
        ({"yield_value": 60.0}, "give at least one of --slump, --spread, --t500, --mini-cone, --v-funnel"),
    ],
)
def test_bad_input_is_refused(told, said):
    with pytest.raises(mps.SceneError, match=said):
        calibrate(**told, check=False)


def test_a_study_of_a_test_that_was_not_measured_is_refused(tmp_path):
    with pytest.raises(mps.SceneError, match="is one of v_funnel, which was not measured; must be of slump"):
        calibrate(slump=0.2, study=str(emulator_path("v_funnel")), check=False)


def emulator_path(scene):
    """The package's own table of a test."""
    from taichi_mps.study import calibrate as room

    return room.HERE / f"{scene}.csv"
