"""Mixes with internal friction: known ones come back, a Bingham pair stays one, what nobody explains stays so."""

from dataclasses import replace

import numpy as np
import pytest

from taichi_mps.cli.main import main
from taichi_mps.study.calibrate import calibrate, frictional_mix
from taichi_mps.study.emulator import FRICTION, HERE, emulator_of
from taichi_mps.study.fit import fit
from taichi_mps.study.mixes import TWO_ANSWERS, WITH_FRICTION, calibrate_list, tally
from taichi_mps.study.results import read

pytest.importorskip("scipy")

DENSITY = 2300.0
CONSTANTS = "yield_value", "friction_angle", "plastic_viscosity"
ALL = "slump", "spread", "t500"
CHECKS = [row for row in read(HERE / f"{FRICTION}.csv") if row["role"] == "check" and row["t500_s"]]  # no nodes


def cone(yield_value, friction_angle, plastic_viscosity=50.0, tests=("slump", "spread")):
    """What the table says of a mix: lengths [m], times [s]."""
    mix = np.log([yield_value / DENSITY, friction_angle, plastic_viscosity / DENSITY])
    found = emulator_of(test=FRICTION).at(*mix)
    return {test: float(found["t500_s" if test == "t500" else f"{test}_m"]) for test in tests}


def holds(constant, true):
    """Is it in the interval?"""
    return (constant.lower or 0.0) < true < (constant.upper or np.inf)


@pytest.mark.parametrize("plastic_viscosity", [20.0, 50.0, 120.0])
@pytest.mark.parametrize(("yield_value", "friction_angle"), [(60.0, 12.0), (40.0, 17.0), (25.0, 12.0)])
def test_a_known_mix_comes_back_within_its_interval(yield_value, friction_angle, plastic_viscosity):
    exact = cone(yield_value, friction_angle, plastic_viscosity)
    found = calibrate(**exact, plastic_viscosity=plastic_viscosity, check=False)
    mix = found.friction
    assert found.explained_by_friction and mix.source("plastic_viscosity") == "rheometer"
    assert all(abs(by) < 2e-3 for by in mix.missed.values())
    for name, true in (("yield_value", yield_value), ("friction_angle", friction_angle)):
        constant = getattr(mix, name)
        assert holds(constant, true)
        if plastic_viscosity == 50.0:  # the others scatter by what rings do: more than one mix is as near
            assert constant.value == pytest.approx(true, rel=1e-3)


def test_the_intervals_hold_a_known_mix():
    """At least as often as they say: the error of the table widens them, and is not drawn here."""
    random, held = np.random.default_rng(5), []
    for _ in range(40):
        c, phi = random.uniform(20.0, 60.0), random.uniform(8.0, 22.0)
        exact, errors = cone(c, phi), {"slump": 0.005, "spread": 0.01}
        measured = {f"{test}_m": (exact[test] + e * random.standard_normal(), e) for test, e in errors.items()}
        mix = frictional_mix(measured, DENSITY, {"plastic_viscosity": 50.0})
        held.append([holds(mix.yield_value, c), holds(mix.friction_angle, phi)])
    assert np.all(np.mean(held, 0) > 0.95 - 2.4 * (0.95 * 0.05 / 40) ** 0.5)  # 2.4 standard errors of so many draws


def test_the_density_scales_the_yield_stress_and_no_angle():
    light, heavy = (
        calibrate(**cone(60.0, 15.0), rho=rho, plastic_viscosity=50.0 * rho / DENSITY, check=False).friction
        for rho in (DENSITY, 2.0 * DENSITY)
    )
    assert heavy.yield_value.value == pytest.approx(2.0 * light.yield_value.value, rel=1e-3)
    assert heavy.friction_angle.value == pytest.approx(light.friction_angle.value, rel=1e-3)


def test_a_known_yield_stress_leaves_the_angle():
    found = calibrate(**cone(60.0, 15.0), yield_value=60.0, check=False).friction
    assert found.yield_value.lower == found.yield_value.upper == 60.0
    assert found.friction_angle.value == pytest.approx(15.0, rel=1e-2)
    assert found.source("yield_value") == "rheometer"


def test_the_bingham_answer_is_bit_for_bit_that_of_its_table():
    """Where it explains the measurements no friction is sought, nothing of it is told."""
    at = emulator_of().at(np.log(400.0 / DENSITY), np.log(50.0 / DENSITY))
    pair = calibrate(slump=float(at["slump_m"]), spread=float(at["spread_m"]), check=False)
    assert pair.friction is None and not pair.contradictory and "friction" not in str(pair)
    rubs = calibrate(**cone(25.0, 15.0), check=False)
    assert rubs.friction
    for found in (pair, rubs):
        table = fit([emulator_of()], found.measured, DENSITY)
        assert repr(replace(found, friction=None, alone={}, others={})) == repr(table)  # its T500 may be nan


def test_what_nobody_explains_is_told_with_the_nearest():
    found = calibrate(slump="15cm", spread="60cm", check=False)
    assert found.contradictory and not found.friction.near and not found.explained_by_friction
    far = max(abs(by) for by in found.friction.missed.values())
    assert far > 0.01 and "with internal friction not both: the nearest" in str(found)


def test_slump_flow_and_t500_give_three_constants_back():
    """A mix between the nodes."""
    true = dict(zip(CONSTANTS, (12.0, 14.0, 80.0), strict=True))
    found = calibrate(**cone(**true, tests=ALL), check=False)
    mix = found.friction
    assert found.explained_by_friction and mix.plastic_viscosity.determined and mix.by_viscosity == {}
    for name, value in true.items():
        assert getattr(mix, name).value == pytest.approx(value, rel=0.03) and holds(getattr(mix, name), value)
    assert mix.source("plastic_viscosity") == "T500" and "one mix does all three" in str(found)


@pytest.mark.parametrize("row", CHECKS, ids=lambda row: " ".join(f"{row[name]:g}" for name in CONSTANTS))
def test_mixes_that_were_run_are_in_their_intervals(row):
    """As the engine computed them: three of another viscosity than the nodes, two at a finer spacing."""
    measured = {"slump_m": (row["slump_m"], 0.005), "spread_m": (row["spread_m"], 0.01), "t500_s": (row["t500_s"], 0.2)}
    mix = frictional_mix(measured, DENSITY, {})
    assert mix.explains and all(holds(getattr(mix, name), row[name]) for name in CONSTANTS)


@pytest.mark.parametrize("t500", ["1s", "200s"])
def test_a_t500_that_contradicts_is_not_explained(t500):
    found = calibrate(**cone(25.0, 15.0), t500=t500, check=False)
    assert not found.friction.near and not found.explained_by_friction
    assert "not all three" in str(found) and "the T500 by" in str(found)
    assert np.isnan(cone(200.0, 15.0, tests=("t500",))["t500"])  # does not reach 500 mm


def test_another_test_that_contradicts_is_not_explained():
    found = calibrate(**cone(60.0, 15.0), mini_cone="15cm", check=False)
    assert found.friction.explains and not found.explained_by_friction
    assert "of slump and slump flow alone, not of mini-cone spread" in str(found)


def test_a_list_counts_them_apart():
    mixes = cone(25.0, 15.0), cone(12.0, 14.0, 80.0, tests=ALL), {"slump": 0.15, "spread": 0.6}
    rubs, timed, nobody = calibrate_list([{key: str(value) for key, value in mix.items()} for mix in mixes])
    assert rubs["verdict"] == timed["verdict"] == WITH_FRICTION and nobody["verdict"] == TWO_ANSWERS
    assert rubs["friction_angle_lower"] < 15.0 < rubs["friction_angle_upper"]
    assert rubs["plastic_viscosity_from"] == "usual" and "--friction-angle 15" in rubs["reason"]
    assert timed["plastic_viscosity_from"] == "T500" and abs(timed["t500_s_missed"]) < 0.1
    assert "with internal friction not both" in nobody["reason"]
    assert f"2 {WITH_FRICTION}" in tally([rubs, timed, nobody])


def test_the_command_told_computes_the_measured_slump(capsys):
    """The run that is told is one of the scene: its words are options of run."""
    known = cone(60.0, 15.0)
    assert main(["calibrate", "--no-check", *(f"--{name}={value}" for name, value in known.items())]) == 0
    line = next(line for line in capsys.readouterr().out.splitlines() if "to run it" in line)
    words = line.split("taichi-mps ")[1].split()
    assert main([*words, "--forecast"]) == 0
