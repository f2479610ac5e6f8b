"""Which slump to order: the border of mixes that fill a form, found with few runs, kept, and reported as a slump."""

import json
from concurrent.futures import ThreadPoolExecutor

import pytest

import taichi_mps as mps
from taichi_mps.study.chart import borders_chart
from taichi_mps.study.require import Border, Wanted, bracket, find_borders, next_mixes

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
    return row | {"filled_ratio": 1.0 if spare >= 0.0 else 0.9}


def test_the_border_is_found_with_fewer_runs_than_a_map_has_points():
    """Bisection alone would take log2(ln 100/ln 1.1) = 6 runs after both ends of each viscosity, 32 in all; the borders
    take fewer."""
    mixes = {}
    while ahead := next_mixes(mixes, VISCOSITIES, LOW, HIGH, WITHIN):
        assert len(ahead) <= len(VISCOSITIES) and not set(ahead) & set(mixes)
        mixes |= {(tau_y, eta): tau_y <= limit(eta) for tau_y, eta in ahead}
    for eta in VISCOSITIES:
        does, does_not = bracket(mixes, eta, LOW, HIGH)
        assert does <= limit(eta) < does_not <= does * (1.0 + WITHIN)
    assert len(mixes) <= 32


@pytest.mark.parametrize(
    ("eta", "full", "short"), [(20.0, 100.0, HIGH), (50.0, 100.0, 400.0), (80.0, None, 400.0), (10.0, 100.0, HIGH)]
)
def test_what_a_stiffer_mix_does_a_softer_one_does_too(eta, full, short):
    """From 100 Pa that fill and 400 Pa that do not at 50 Pa s, and 1000 Pa that do not at 10 Pa s, the bracket of each
    viscosity follows."""
    mixes = {(100.0, 50.0): True, (400.0, 50.0): False, (HIGH, 10.0): False}
    assert bracket(mixes, eta, LOW, HIGH) == (full, short)


def study(folder, wanted, calls=None, **settings):
    def counted(case):
        if calls is not None:
            calls.append(case.key)
        return run(case)

    with ThreadPoolExecutor(2) as executor:
        return find_borders(**{"scene": "wall"} | settings, wanted=wanted, out=folder, executor=executor, run=counted)


def test_a_study_is_kept_and_tells_a_slump_to_order(tmp_path):
    wanted, calls = Wanted(plastic_viscosity="20,50", time=20.0), []
    borders, rows = study(tmp_path / "study", wanted, calls)
    assert len(set(calls)) == len(calls) == len(rows)
    for border in borders:
        assert border.fills_up_to <= limit(border.plastic_viscosity) < border.empty_from <= 1.2 * border.fills_up_to
        assert border.missing == pytest.approx(0.1)
        (slump, flow), (less, _) = border.slumps_m
        assert 0.0 < less < slump < 0.3 < flow
        assert f"order a slump of {100 * slump:.1f} cm" in str(border)
    chart = borders_chart(borders, rows, wanted, tmp_path / "chart.png")
    assert chart.read_bytes().startswith(b"\x89PNG")
    again, same = study(tmp_path / "study", wanted, calls)
    assert again == borders and same == rows and len(set(calls)) == len(calls)


def test_ends_of_what_is_looked_at(tmp_path):
    (soft,), _ = study(tmp_path / "soft", Wanted(plastic_viscosity="20", stiffest=50.0))
    assert (soft.fills_up_to, soft.empty_from) == (50.0, None) and "nothing stiffer was looked at" in str(soft)
    (stiff,), _ = study(tmp_path / "stiff", Wanted(plastic_viscosity="20", softest=500.0))
    assert (stiff.fills_up_to, stiff.empty_from) == (None, 500.0) and "no mix does; 500 Pa leave" in str(stiff)
    assert Border(20.0, 1.0, None).slumps_m == [None, None], "softer than the table of the slump test"
    assert str(Border(20.0, None, 10.0, float("nan"))).endswith("no mix does; the run of 10 Pa failed")


def test_the_command_gives_borders_and_slumps(tmp_path, monkeypatch, capsys):
    border = Border(20.0, 200.0, 220.0, 0.1)
    told = []

    def found(scene, wanted, folder, executor, workers, watch, **parameters):
        told.append((scene, wanted.time, executor, workers, parameters))
        return [border], [{"scene": "wall", "status": "done", "yield_value": 200.0, "plastic_viscosity": 20.0,
                           "filled_ratio": 1.0}]  # fmt: skip

    monkeypatch.setattr("taichi_mps.cli.study.find_borders", found)
    words = ["require", "wall", "--time", "20s", "--workers", "2", "--spacing", "25mm", "--out", str(tmp_path)]
    assert mps.main(words) == 0 and str(border) in capsys.readouterr().out
    assert mps.main([*words, "--json"]) == 0
    (facts,) = json.loads(capsys.readouterr().out)
    assert facts["fills_up_to"] == 200.0 and facts["slumps_m"] == [list(pair) for pair in border.slumps_m]
    assert told[0] == ("wall", 20.0, "local", 2, {"spacing": "25mm"}) and (tmp_path / "require.png").is_file()


@pytest.mark.parametrize(
    ("settings", "wanted", "message"),
    [
        ({"scene": "slump"}, {}, "scene slump: has no cavity to fill"),
        ({"fill_ratio": 0.95}, {}, "filled = 0.99: of the form only fill_ratio = 0.95 is poured"),
        ({}, {"softest": 100.0, "stiffest": 50.0}, "softest = 100 Pa: must be less than stiffest = 50 Pa"),
        ({}, {"filled": 1.2}, "filled = 1.2: must be less than or equal to 1"),
        ({}, {"plastic_viscosity": "thin"}, "plastic_viscosity = thin"),
    ],
)
def test_what_cannot_be_wanted_is_refused(tmp_path, settings, wanted, message):
    with pytest.raises(mps.SceneError, match=message):
        study(tmp_path / "study", Wanted(**wanted), **settings)
