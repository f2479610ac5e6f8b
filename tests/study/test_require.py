"""Which slump to order: the border of mixes that fill a form, found with few runs, kept, and told as a slump."""

from concurrent.futures import ThreadPoolExecutor

import pytest

import taichi_mps as mps
from taichi_mps.study.chart import require_chart
from taichi_mps.study.require import Border, Wanted, bracket, known, next_mixes, require

LOW, HIGH, WITHIN = 10.0, 1000.0, 0.1
VISCOSITIES = (10.0, 20.0, 50.0, 100.0)


def limit(eta):
    """The largest yield stress [Pa] that fills: a form made up for this test."""
    return 300.0 * (10.0 / eta) ** 0.6


def run(case):
    """Its runs."""
    mix = case.parameters
    spare = limit(mix["plastic_viscosity"]) - mix["yield_value"]
    row = {"key": case.key, "status": "done", "reason": "", "scene": case.scene, **mix}
    return row | {"filled_ratio": 1.0 if spare >= 0.0 else 0.9, "pressure_at_40mm_Pa": 8000.0}


def test_the_border_is_found_with_fewer_runs_than_a_map_has_points():
    """Halving alone would take log2(ln 100/ln 1.1) = 6 runs after both ends of each viscosity, 32 in all."""
    mixes = {}
    while ahead := next_mixes(mixes, VISCOSITIES, LOW, HIGH, WITHIN):
        assert len(ahead) <= len(VISCOSITIES) and not set(ahead) & set(mixes)
        mixes |= {(tau_y, eta): tau_y <= limit(eta) for tau_y, eta in ahead}
    for eta in VISCOSITIES:
        does, does_not = bracket(mixes, eta, LOW, HIGH)
        assert does <= limit(eta) < does_not <= does * (1.0 + WITHIN)
    assert len(mixes) <= 32


def test_what_a_stiffer_mix_does_a_softer_one_does_too():
    mixes = {(100.0, 50.0): True, (400.0, 50.0): False}
    assert known(mixes, 90.0, 20.0) and known(mixes, 100.0, 50.0)
    assert known(mixes, 500.0, 50.0) is False and known(mixes, 400.0, 80.0) is False
    assert known(mixes, 200.0, 50.0) is None and known(mixes, 90.0, 80.0) is None and known(mixes, 500.0, 20.0) is None


def study(folder, calls, wanted, **settings):
    def counted(case):
        calls.append(case.key)
        return run(case)

    with ThreadPoolExecutor(2) as executor:
        return require(**{"scene": "wall"} | settings, wanted=wanted, out=folder, executor=executor, run=counted)


def test_a_study_is_kept_and_tells_a_slump_to_order(tmp_path):
    wanted, calls = Wanted(plastic_viscosity="20,50", time=20.0), []
    borders, rows = study(tmp_path / "study", calls, wanted)
    assert len(set(calls)) == len(calls) == len(rows)
    for border in borders:
        assert border.fills_up_to <= limit(border.plastic_viscosity) < border.empty_from <= 1.2 * border.fills_up_to
        assert border.missing == pytest.approx(0.1)
        (slump, flow), (less, _) = border.slumps(2300.0)
        assert 0.0 < less < slump < 0.3 < flow
        assert f"order a slump of {100 * slump:.1f} cm" in border.told(2300.0)
    chart = require_chart(borders, rows, wanted, tmp_path / "chart.png")
    assert chart.read_bytes().startswith(b"\x89PNG")
    again, same = study(tmp_path / "study", calls, wanted)
    assert again == borders and same == rows and len(set(calls)) == len(calls)


def test_ends_of_what_is_looked_at_and_a_bound_of_the_pressure(tmp_path):
    soft, _ = study(tmp_path / "soft", [], Wanted(plastic_viscosity="20", stiffest=50.0))
    assert (soft[0].fills_up_to, soft[0].empty_from) == (50.0, None) and "nothing stiffer was looked at" in soft[
        0
    ].told(2300.0)
    stiff, _ = study(tmp_path / "stiff", [], Wanted(plastic_viscosity="20", softest=500.0))
    assert (stiff[0].fills_up_to, stiff[0].empty_from) == (None, 500.0) and "no mix does; 500 Pa leave" in stiff[
        0
    ].told(2300.0)
    for bound, fine in ((7000.0, False), (9000.0, True)):
        found, rows = study(tmp_path / f"{bound}", [], Wanted(plastic_viscosity="20,50", pressure=bound))
        for border in found:
            assert (
                border.fills_up_to <= limit(border.plastic_viscosity) < border.empty_from and border.pressure == 8000.0
            )
            assert ("no mix does" in border.told(2300.0)) is not fine
        assert all(row["measure_pressure"] for row in rows)
    assert Border(20.0, 5.0, None).slumps(2300.0) == [None, None], "softer than the table of the slump test"


def test_what_is_no_form_or_is_not_poured_full_is_refused(tmp_path):
    with pytest.raises(mps.SceneError, match="scene slump: has no cavity to fill"):
        require("slump", Wanted(), tmp_path / "study")
    with pytest.raises(mps.SceneError, match="filled = 0.99: of the form only fill_ratio = 0.95 is poured"):
        study(tmp_path / "study", [], Wanted(), fill_ratio=0.95)
    with pytest.raises(mps.SceneError, match="pressure = 7000 Pa: measure_pressure = False; must be"):
        study(tmp_path / "study", [], Wanted(pressure=7000.0), measure_pressure=False)


def test_a_run_that_failed_is_said_to_have_failed():
    assert Border(20.0, None, 10.0, float("nan")).told(2300.0).endswith("no mix does; the run of 10 Pa failed")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"softest": 100.0, "stiffest": 50.0}, "softest = 100 Pa: must be less than stiffest = 50 Pa"),
        ({"filled": 1.2}, "filled = 1.2: must be less than or equal to 1"),
        ({"plastic_viscosity": "thin"}, "plastic_viscosity"),
    ],
)
def test_what_cannot_be_wanted_is_refused(tmp_path, change, message):
    with pytest.raises(mps.SceneError, match=message):
        study(tmp_path / "study", [], Wanted(**change))
