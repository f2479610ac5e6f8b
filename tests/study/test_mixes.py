"""A laboratory's list: finite elements come out as what they were made with, contradictions get two answers."""

import csv
import math
from concurrent.futures import ThreadPoolExecutor

import pytest

import taichi_mps as mps
from taichi_mps.cli.main import main
from taichi_mps.study import mixes, mixes_page
from taichi_mps.study.calibrate import calibrate
from taichi_mps.study.mixes import BOUNDED, EXPLAINED, REFUSED, TWO_ANSWERS, calibrate_list, one, read_list, tally
from tests.support.browser import chromium, needs_chromium

pytest.importorskip("scipy")

LIST = """# measured by finite elements of 500 and 1000 Pa, 50 Pa s
mix,slump [cm],spread [mm],plastic_viscosity
five,17.99,319.3,50
ten,10.15,265.6,50
far,15,600,
stands,0,200,
misread,20,200,
no length,tall,300,
"""


@pytest.fixture
def rows(tmp_path):
    (tmp_path / "mixes.csv").write_text(LIST)
    return read_list(tmp_path / "mixes.csv")


def test_each_line_gets_its_verdict(rows):
    found = {row["mix"]: row for row in calibrate_list(rows)}
    assert [found[mix]["verdict"] for mix in found] == [EXPLAINED, EXPLAINED, TWO_ANSWERS, BOUNDED, REFUSED, REFUSED]
    for mix, exact in (("five", 500.0), ("ten", 1000.0)):
        assert found[mix]["yield_value_lower"] <= exact <= found[mix]["yield_value_upper"]
        assert found[mix]["reason"] == ""
        assert abs(found[mix]["slump_m_missed"]) <= 0.01 and abs(found[mix]["spread_m_missed"]) <= 0.02


def test_two_answers_are_those_of_each_length_alone(rows):
    far = one(rows[2])
    for key, alone in (("slump", {"slump": "15cm"}), ("spread", {"spread": "600mm"})):
        told = calibrate(**alone, plastic_viscosity=50.0, check=False).yield_value
        assert far[f"yield_value_by_{key}"] == pytest.approx(told.value, rel=0.05)
    assert far["yield_value_by_slump"] > 3.0 * far["yield_value_by_spread"]
    assert "the slump alone says" in far["reason"] and "Trust that of the slump for how high" in far["reason"]


def test_one_that_stands_is_bounded_and_one_without_room_is_refused(rows):
    stands, misread = one(rows[3]), one(rows[4])
    assert stands["yield_value_lower"] > 1000.0 and "its yield stress is more than" in stands["reason"]
    room = math.pi / 4 * (0.2 + 0.03) ** 2 * (0.3 - 0.2 + 0.015)  # with three standard errors
    assert room < 5.5e-3 and "leaves room for 4.8 l at most" in misread["reason"]


def test_a_pair_without_room_for_the_mould_is_refused():
    with pytest.raises(mps.SceneError, match=r"leaves room for 4\.\d l at most, and the mould holds 5\.5 l"):
        calibrate(slump=0.2, spread=0.2, check=False)


def test_every_row_is_kept_and_counted(rows):
    found = calibrate_list(rows)
    assert [row["mix"] for row in found] == [row["mix"] for row in rows]
    assert sum(int(line.split()[0]) for line in tally(found).splitlines()) == len(rows)


def test_two_processes_find_what_one_finds(rows):
    """In the order of the list, and told one by one."""
    told = []
    both = calibrate_list(
        rows[:4], watch=lambda row, number: told.append((row["mix"], number)), executor="local", workers=2
    )
    assert both == calibrate_list(rows[:4])
    assert told == [("five", 1), ("ten", 2), ("far", 3), ("stands", 4)]


def test_a_worker_that_dies_loses_no_row(rows, monkeypatch):
    """Its initializer fails, so that the executor is broken before the first row."""
    broken = ThreadPoolExecutor(1, initializer=int, initargs=("no number",))
    monkeypatch.setattr(mixes, "named", lambda *_: (lambda: broken, None))
    assert calibrate_list(rows[4:], executor="local") == calibrate_list(rows[4:])


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--table", "{}", "--executor", "slurm://here"], "executor = slurm://here: a mix takes a tenth of a second"),
        (
            ["--table", "{}", "--executor", "dask://here:1", "--workers", "2"],
            "workers = 2: are processes of this machine",
        ),
        (["--table", "{}", "--workers", "0"], "workers = 0"),
        (["--slump", "20cm", "--workers", "2"], "workers = 2: belongs to --table"),
    ],
)
def test_workers_that_a_list_cannot_have_are_refused(tmp_path, capsys, options, said):
    (tmp_path / "mixes.csv").write_text(LIST)
    assert main(["calibrate", *(word.format(tmp_path / "mixes.csv") for word in options)]) == 2
    assert said in capsys.readouterr().err and len(list(tmp_path.iterdir())) == 1


def test_the_command_writes_a_table_and_overwrites_nothing(tmp_path, capsys):
    (tmp_path / "mixes.csv").write_text(LIST)
    assert main(["calibrate", "--table", str(tmp_path / "mixes.csv")]) == 0
    with open(tmp_path / "mixes-calibrated.csv", newline="") as file:
        table = list(csv.DictReader(file))
    assert [row["mix"] for row in table] == ["five", "ten", "far", "stands", "misread", "no length"]
    assert "2 explained" in capsys.readouterr().out
    assert main(["calibrate", "--table", str(tmp_path / "mixes.csv")]) == 2
    assert "is there already" in capsys.readouterr().err


@needs_chromium
def test_the_page_has_every_mix_and_opens_without_a_network(tmp_path):
    pytest.importorskip("plotly")
    pytest.importorskip("playwright")
    (tmp_path / "mixes.csv").write_text(LIST.replace("misread", "<b>misread</b>"))
    rows = read_list(tmp_path / "mixes.csv")
    found = calibrate_list(rows)
    path = mixes_page.write(found, list(rows[0]), tmp_path / "mixes.html", "mixes.csv")
    with chromium() as browser:
        tab, wrong, asked = browser.new_page(), [], []
        tab.on("pageerror", lambda error: wrong.append(str(error)))
        tab.on("request", lambda request: asked.append(request.url))
        tab.goto(path.as_uri())
        tab.evaluate("ready")
        lines = [line.locator("td").all_inner_texts() for line in tab.locator(".wide tbody tr").all()]
        assert tab.locator("#chart .scatterlayer .trace").count() > 0
    assert wrong == [] and asked and all(url.startswith(("file:", "data:", "blob:")) for url in asked)
    assert [line[0] for line in lines] == [row["mix"] for row in rows]
    assert [line[-2:] for line in lines] == [[row["verdict"], row["reason"]] for row in found]
    assert lines[0][5] == "slump" and lines[0][4].startswith(f"{found[0]['yield_value_found']:.3g} Pa (")


def test_columns_may_be_written_as_people_do_and_a_word_is_named(tmp_path):
    (tmp_path / "mixes.csv").write_text("mix,Mini-cone [cm],V funnel [s],slump [cm]\nD,9,6,\nF,,,soft\n")
    first, second = calibrate_list(read_list(tmp_path / "mixes.csv"))
    exact = calibrate(mini_cone=0.09, v_funnel=6.0, check=False)
    assert first["yield_value_found"] == exact.yield_value.value and first["verdict"] == EXPLAINED
    assert second["verdict"] == REFUSED and second["reason"].startswith("slump = soft")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("slmp,other\n1,2\n", "has no column slump, spread, t500, mini_cone, v_funnel, did you mean 'slump'"),
        ("", "has no column"),
    ],
)
def test_what_is_no_list_is_refused(tmp_path, text, said):
    (tmp_path / "mixes.csv").write_text(text)
    with pytest.raises(mps.SceneError, match=said):
        read_list(tmp_path / "mixes.csv")


def test_a_folder_after_table_is_a_study_of_before(tmp_path, capsys):
    assert main(["calibrate", "--table", str(tmp_path)]) == 2
    assert "a study is named by --study" in capsys.readouterr().err
