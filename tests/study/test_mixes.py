"""A laboratory's list: finite elements come out as what they were made with, contradictions get two answers."""

import csv
import json
import re
from concurrent.futures import ThreadPoolExecutor

import pytest

import taichi_mps as mps
from taichi_mps.cli.main import main
from taichi_mps.study import mixes
from taichi_mps.study.calibrate import calibrate
from taichi_mps.study.mixes import BOUNDED, EXPLAINED, REFUSED, TWO_ANSWERS, calibrate_list, read_list, tally
from tests.support.browser import chromium, needs_chromium

pytest.importorskip("scipy")

LIST = """# measured by finite elements of 500 and 1000 Pa, 50 Pa s
mix,slump [cm],spread [mm],plastic_viscosity
five,17.99,319.3,50
ten,10.15,265.6,50
far,15,600,
<b>stands</b>,0,200,
misread,20,200,
no length,tall,300,
"""


def written(folder, text=LIST):
    path = folder / "mixes.csv"
    path.write_text(text)
    return path


@pytest.fixture(scope="module")
def rows(tmp_path_factory):
    return read_list(written(tmp_path_factory.mktemp("list")))


@pytest.fixture(scope="module")
def found(rows):
    told = []
    found = calibrate_list(rows, watch=lambda row, number: told.append((row["mix"], number)))
    assert told == [(row["mix"], number) for number, row in enumerate(rows, 1)]
    return found


def test_each_line_gets_its_verdict(found):
    verdicts = EXPLAINED, EXPLAINED, TWO_ANSWERS, BOUNDED, REFUSED, REFUSED
    assert tuple(row["verdict"] for row in found) == verdicts
    assert sum(int(line.split()[0]) for line in tally(found).splitlines()) == len(found)
    for row, exact in zip(found, (500.0, 1000.0), strict=False):
        assert row["yield_value_lower"] <= exact <= row["yield_value_upper"] and row["reason"] == ""
        assert abs(row["slump_m_missed"]) <= 0.01 and abs(row["spread_m_missed"]) <= 0.02
    far, stands, misread = found[2:5]
    assert far["yield_value_by_slump"] > 3.0 * far["yield_value_by_spread"] > 0.0
    assert "the slump alone says" in far["reason"] and "Trust that of the slump for how high" in far["reason"]
    assert stands["yield_value_lower"] > 1000.0 and "its yield stress is more than" in stands["reason"]
    assert "leaves room for 4.8 l at most" in misread["reason"]


@pytest.mark.parametrize("broken", [False, True])
def test_workers_find_what_one_process_finds(rows, found, broken, monkeypatch):
    """Also where they are broken before the first row."""
    pool = ThreadPoolExecutor(2, initializer=int, initargs=("no number",) * broken)
    monkeypatch.setattr(mixes, "executor_of", lambda *_: (lambda: pool, None))
    assert calibrate_list(rows, executor="local") == found


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--table", "{}", "--executor", "slurm://here"], "executor = slurm://here: a mix takes a tenth of a second"),
        (["--table", "{}", "--executor", "dask://here:1", "--workers", "2"], "workers = 2: are processes of this"),
        (["--table", "{}", "--workers", "0"], "workers = 0"),
        (["--slump", "20cm", "--workers", "2"], "workers = 2: belongs to --table"),
        (["--table", "{}", "--slump", "20cm"], "slump: stands in the table's own columns"),
        (["--table", "{0.parent}"], "a study is named by --study"),
    ],
)
def test_options_that_a_list_cannot_have_are_refused(tmp_path, capsys, options, said):
    assert main(["calibrate", *(word.format(written(tmp_path)) for word in options)]) == 2
    assert said in capsys.readouterr().err and len(list(tmp_path.iterdir())) == 1


def test_the_command_writes_table_chart_and_page_and_overwrites_nothing(tmp_path, capsys):
    """Also of V-funnel and mini-cone, and of a rheometer's yield stress."""
    exact = calibrate(mini_cone=0.09, v_funnel=6.0, check=False)
    text = (
        "mix,Mini-cone [cm],V funnel [s],yield_value [Pa],slump\nboth,9,6,,\nknown,,6,60,\nnone,,,60,\nword,,,,soft\n"
    )
    command = ["calibrate", "--table", str(written(tmp_path, text))]
    assert main(command) == 0
    with open(tmp_path / "mixes-calibrated.csv", newline="") as file:
        both, known, none, word = csv.DictReader(file)
    assert float(both["yield_value_found"]) == pytest.approx(exact.yield_value.value, rel=1e-4)
    assert both["plastic_viscosity_from"] == known["plastic_viscosity_from"] == "V-funnel time"
    assert (both["yield_value_from"], known["yield_value_from"]) == ("mini-cone spread", "rheometer")
    assert both["verdict"] == known["verdict"] == EXPLAINED and none["verdict"] == word["verdict"] == REFUSED
    assert "give at least one of --slump" in none["reason"] and word["reason"].startswith("slump = soft")
    assert "2 explained" in capsys.readouterr().out
    assert (tmp_path / "mixes-calibrated.png").is_file() and (tmp_path / "mixes-calibrated.html").is_file()
    assert main(command) == 2 and "is there already" in capsys.readouterr().err


def test_the_page_and_the_chart_join_each_mix_with_its_model(found, rows, tmp_path):
    pytest.importorskip("plotly")
    page = mixes.write_page(found, list(rows[0]), tmp_path / "mixes.html", "mixes.csv").read_text()
    traces = json.loads(re.search(r'id="data">(.*?)</script>', page)[1])["traces"]
    assert ">&lt;b&gt;stands&lt;/b&gt;<" in page and "<b>stands" not in page
    assert [trace["mode"] for trace in traces] == ["lines", "markers", "markers"] * 2
    lines, model, measured = traces[:3]
    assert measured["x"] == pytest.approx([17.99, 10.15]) and measured["y"] == pytest.approx([31.93, 26.56])
    assert lines["x"] == [measured["x"][0], model["x"][0], None, measured["x"][1], model["x"][1], None]


@pytest.mark.slow
@needs_chromium
def test_the_page_has_every_mix_and_opens_without_a_network(found, rows, tmp_path):
    pytest.importorskip("plotly")
    pytest.importorskip("playwright")
    path = mixes.write_page(found, list(rows[0]), tmp_path / "mixes.html", "mixes.csv")
    with chromium() as browser:
        tab, wrong, asked = browser.new_page(), [], []
        tab.on("pageerror", lambda error: wrong.append(str(error)))
        tab.on("request", lambda request: asked.append(request.url))
        tab.goto(path.as_uri())
        tab.evaluate("ready")
        lines = [line.locator("th, td").all_inner_texts() for line in tab.locator(".wide tr").all()[1:]]
        assert tab.locator("#chart .scatterlayer .trace").count() > 0
    assert wrong == [] and asked and all(url.startswith(("file:", "data:", "blob:")) for url in asked)
    told = [(row["mix"], row["verdict"], row["reason"]) for row in found]
    assert [(line[0], *line[-2:]) for line in lines] == told and lines[0][5] == "slump"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("slmp,other\n1,2\n", "has no column slump, spread, t500, mini_cone, v_funnel, did you mean 'slump'"),
        ("", "has no column"),
    ],
)
def test_what_is_no_list_is_refused(tmp_path, text, said):
    with pytest.raises(mps.SceneError, match=said):
        read_list(written(tmp_path, text))
