"""A laboratory's list: finite elements give back the constants of their input, and contradictory tests two answers."""

import csv
import io
import os
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import taichi_mps as mps
from taichi_mps.study import measured_mixes, tables
from taichi_mps.study.calibrate import Measurements, calibrate
from taichi_mps.study.measured_mixes import (
    BOUNDED,
    EXPLAINED,
    REFUSED,
    TWO_ANSWERS,
    calibrate_list,
    measurements_of,
    read_list,
    tally,
)

pytest.importorskip("scipy")
openpyxl = pytest.importorskip("openpyxl")

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
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


@pytest.fixture(scope="module")
def rows(tmp_path_factory):
    return read_list(written(tmp_path_factory.mktemp("list")))


@pytest.fixture(scope="module")
def found(rows):
    found = calibrate_list(rows)
    assert [row["mix"] for row in found] == [row["mix"] for row in rows]
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


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--slump", "20cm", "--t500-error", "1s"], "t500_error = 1 s: has no effect without t500; must be left out"),
        (["--slump", "20cm", "--out", "found.csv"], "out = found.csv: has no effect without table"),
        (["--table", "{}", "--slump", "20cm"], "slump: stands in the table's own columns"),
        (["--table", "{0.parent}"], "a study is named by --study"),
        (["--table", "{}", "--out", "{0.parent}/found.xlsx"], "found.xlsx: must be a CSV file in a folder that"),
    ],
)
def test_options_that_a_list_cannot_have_are_refused(tmp_path, capsys, options, said):
    assert mps.main(["calibrate", *(word.format(written(tmp_path)) for word in options)]) == 2
    assert said in capsys.readouterr().err and len(list(tmp_path.iterdir())) == 1


def test_a_folder_that_cannot_be_written_is_refused_before_the_first_mix(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(os, "access", lambda path, mode: mode != os.W_OK)
    monkeypatch.setattr(measured_mixes, "calibrate_list", lambda *_: pytest.fail("computes before"))
    assert mps.main(["calibrate", "--table", str(written(tmp_path))]) == 2
    assert "mixes-calibrated.csv: must be a CSV file in a folder that is there and can be" in capsys.readouterr().err


def test_the_command_writes_table_and_chart_and_overwrites_nothing(tmp_path, capsys):
    """The command writes table and chart, also of V-funnel, mini-cone and a rheometer's yield stress, and overwrites
    no file."""
    exact = calibrate(mini_cone=0.09, v_funnel=6.0, check=False)
    text = (
        "mix,Mini-cone [cm],V funnel [s],yield_value [Pa],slump\nboth,9,6,,\nknown,,6,60,\nnone,,,60,\nword,,,,soft\n"
    )
    command = ["calibrate", "--table", str(written(tmp_path, text))]
    assert mps.main(command) == 0
    with open(tmp_path / "mixes-calibrated.csv", newline="") as file:
        both, known, none, word = csv.DictReader(file)
    assert float(both["yield_value_found"]) == pytest.approx(exact.yield_value.value, rel=1e-4)
    assert both["plastic_viscosity_from"] == known["plastic_viscosity_from"] == "V-funnel time"
    assert (both["yield_value_from"], known["yield_value_from"]) == ("mini-cone flow", "rheometer")
    assert both["verdict"] == known["verdict"] == EXPLAINED and none["verdict"] == word["verdict"] == REFUSED
    assert "has no measurement" in none["reason"] and word["reason"].startswith("slump = soft")
    assert "2 fitted" in capsys.readouterr().out
    assert (tmp_path / "mixes-calibrated.png").is_file()
    assert mps.main(command) == 2 and "is there already" in capsys.readouterr().err


def test_the_chart_joins_each_mix_with_its_model(found, monkeypatch):
    from taichi_mps.study import chart

    monkeypatch.setattr(chart, "_save", lambda figure, out: figure)
    (axes,) = chart.mixes_chart(found, "no.png").axes
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert labels == ["fitted, measured", "two answers, measured"]
    *joints, measured, model = (line.get_xydata() for line in axes.lines[:4])  # of the first verdict
    assert measured == pytest.approx(np.array([[17.99, 31.93], [10.15, 26.56]]))
    assert model.shape == measured.shape and 0.0 < np.abs(model - measured).max() < 2.0
    assert np.array(joints) == pytest.approx(np.stack([measured, model], axis=1))


HEADS = {  # by field a cell, its value in SI units, and what people write above it
    "slump": (
        "18,5",
        0.185,
        "slump [cm]|Slump (cm)|SLUMP [CM]|slump_cm|slump, cm|slump in cm|Slump/cm|Slump value (cm)|Slump [cm] (lab 2)|"
        "Slump (EN 12350-2) [cm]|Setzmaß [cm]|SETZMASS (cm)|スランプ（cm）|ｽﾗﾝﾌﾟ(㎝)|スランプ値[cm]",
    ),
    "spread": (
        "55,5",
        0.555,
        "spread [cm]|Slump flow [cm]|slump-flow (cm)|Slump flow (SF) [cm]|SF, cm|slump_flow_cm|Setzfließmaß [cm]|"
        "setzfliessmass (cm)|スランプフロー（cm）|Mean slump flow diameter\n[cm]|Étalement [cm]",
    ),
    "t500": (
        "3,5",
        3.5,
        "T500 [s]|T500, sec.|t_500 (s)|T-500 [s]|T50 (sec)|T 500 time [S]|"
        "50cmフロー到達時間 (秒)|Ｔ５００［ｓ］|t500_s|T500",
    ),
    "mini_cone": ("9.5 cm", 0.095, "mini_cone|Mini-cone|mini-slump flow [mm]|ミニスランプフロー [mm]"),
    "v_funnel": (
        "9",
        9.0,
        "v_funnel [s]|V-funnel (s)|V funnel time [s]|t_v [s]|Ｖ漏斗流下時間 (秒)|Trichterauslaufzeit [Sek.]",
    ),
    "rho": (
        "2,35",
        2350.0,
        "density [t/m³]|Density (g/cm3)|ρ [kg/l]|rho [t/m3]|Rohdichte [t/m³]|Frischbetonrohdichte (t/m3)|密度（t/m3）|"
        "単位容積質量 [kg/l]|unit weight (t m⁻³)",
    ),
    "yield_value": ("0,05", 50.0, "yield_value [kPa]|Yield stress (kPa)|Fließgrenze [kPa]|降伏値 (kPa)"),
    "plastic_viscosity": (
        "50",
        50.0,
        "Plastic viscosity [Pa·s]|plastic_viscosity (Pa s)|塑性粘度 (Pa.s)|plastic viscosity Pas",
    ),
    "slump_error": ("1", 0.01, "slump_error [cm]|Slump error (cm)"),
    "spread_error": ("1", 0.01, "spread error [cm]|Slump flow error [cm]"),
}


@pytest.mark.parametrize("field", HEADS)
def test_a_column_is_known_by_what_people_write_above_it(field):
    cell, value, heads = HEADS[field]
    others = {"slump [cm]": "18", "slump flow [cm]": "40"} if "error" in field else {}  # of what it is an error
    for column in heads.split("|"):
        measured = measurements_of({column: cell, "note": "of 7 cm"} | others)
        assert measured.keys() == {field, *measurements_of(others)}, column
        assert getattr(Measurements(**measured), field) == value, column
        assert not others or not measurements_of({column: cell})  # alone it says nothing, as in a row without slump


def sheet(*rows) -> bytes:
    """An Excel workbook with these rows in its first sheet."""
    book, file = openpyxl.Workbook(), io.BytesIO()
    for row in rows:
        book.active.append(row)
    book.save(file)
    return file.getvalue()


ROWS = [(0.185, 0.321), (0.21, 0.344)]  # slump and slump flow [m] of the lists below


@pytest.mark.parametrize(
    "text",
    [
        "mix,slump [cm],spread [cm]\nA,18.5,32.1\nB,21,34.4\n",
        'mix,slump [cm],spread [cm]\nA,"18,5","32,1"\nB,21,"34,4"\n',
        "\ufeffmix;slump [cm];spread [cm]\nA;18,5;32,1\n\n;;\nB;21,000;34,400\n",
        "mix\tslump [cm], mean\tspread [cm]\r\nA\t18,5\t32,1\r\nB\t21\t34,4\r\n".encode("utf-16"),
        "mix;Setzmaß [cm];Setzfließmaß [cm]\nfür Röhre;18,5;32,1\nB – neu;21;34,4\n".encode("cp1252"),
        "配合;スランプ（cm）;スランプフロー（cm）\r\n普通;18.5;32.1\r\nB;21;34.4\r\n".encode("cp932"),
        "l’hiver;Affaissement [cm];Étalement (in cm);T500\nBœuf;18,5;32,1;-\n…;21;34,4;#N/A\n".encode("cp1252"),
        "mix;slump;spread;note\n;[cm];mm;[-]\nA;18,5;321;\nB;21;344;x\n",
        "mix;slump [cm];spread [cm];T500 [秒]\nA;18,5;32,1;\nB;21;34,4;-\n".encode("cp932"),
        "# Slump, 2026\n#\nslump [cm],mix,spread [cm]\n18.5,#1,32.1\n21,#2,34.4\n",
        "#,slump [cm],spread [cm]\n#1,18.5,32.1\n#2,21,34.4\n",
        "sep=;\r\nslump [cm];spread [cm]\r\n18,5;32,1\r\n21;34,4\r\n",
        'slump\n[cm];"spread\n[cm]";"a;""b"\n18,5;32,1;"two\nlines"\n21;34,4;\n'.replace("slump\n", "slump "),
        "\n#c\n".join(["", "mix,slump [mm],slump flow [mm],\nA,185,321,\nA,210,344,"]),
        sheet(["# 2026"], [], ["slump [cm]", "spread\n[cm]", "", "; day"], [18.5, "32,1"], ["21,0", 34.4, None, "5;6"]),
        sheet(["mix", "slump", "spread", True], ["", "cm", "mm"], [], ["A", 5 * 3.7, 321], [None, 21, 344.0]),
    ],
)
def test_a_list_is_read_as_a_spreadsheet_writes_it(tmp_path, text):
    rows = read_list(written(tmp_path, text))
    measured = [Measurements(**measurements_of(row | {"Density (t/m3)": "2350 kg/m3"})) for row in rows]
    assert {it.rho for it in measured} == {2350.0}
    assert [(it.slump, it.spread) for it in measured] == ROWS and tables.ROW_ERROR not in rows[0] | rows[1]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "slmp,other\n1,2\n",
            "has no column slump, slump flow, T500, mini-cone .*, V-funnel time; .* 'slmp' \\(did you mean 'slump'",
        ),
        ("Ausbreitmaß [cm]\n55\n", r"'Ausbreitmaß \[cm\]' \(of the flow table \(EN 12350-5\), no slump flow"),
        ("1;2\n3;4", "has no column slump, .*not used, but kept: '1', '2'"),
        ("slump\n" + 100_000 * "0.2\n", "table = .*mixes.csv: has 100001 lines; must have at most 100000"),
        ("", "is empty; must be"),
        ("# nothing\n\n;;\n", r"has comments \(#\) alone; its header must not begin with #"),
        ("mix,slump [cm]\n\n,\n", "has a header and no row"),
        ('mix,slump [cm]\n"7" slab",18\n', r"line 2 is no CSV \(',' expected after"),
        ('mix,slump [cm]\nB,18\n"A,18\nC,3\n', r"line 3 is no CSV \(unexpected end of data"),
        (f"mix,slump [cm]\nB,18\n{'x' * 131073},18\n", r"line 3 is no CSV \(field larger than field limit \(131072\)"),
        ("mix,slump [cm]\nA\0,18\n", "line 2 holds a NUL character"),
        ("mix,slump [cm]\nA,18\n".encode("utf-16-le"), "line 1 holds a NUL character"),
        (b"mix,slump\n\x81\x8d\x8f,18\n", "is no text in UTF-8"),
        (b"PK\x03\x04" + 99 * b"x", r"is no Excel workbook \(BadZipFile\); must be an .xlsx or a CSV file"),
        (sheet(["mix"], [1]), "has no column slump"),
        ("slump [cm],Slump (mm)\n1,2\n", r"'slump \[cm\]' and 'Slump \(mm\)' are both slump; must be one"),
        ("Slump flow,SF [mm]\n1,2\n", r"'Slump flow' and 'SF \[mm\]' are both spread"),
        ("note,slump,note\n1,2,3\n", "column 'note' stands there twice"),
        ("slump [kg]\n18\n", r"column 'slump \[kg\]': its unit must be m or one of that kind"),
    ],
)
def test_what_is_no_list_is_refused_in_one_line(tmp_path, text, said):
    with pytest.raises(mps.SceneError, match=said) as error:
        read_list(written(tmp_path, text))
    assert "\n" not in str(error.value)


CELLS = st.sampled_from(["20", "20,5", "45 cm", "nan", "inf", "-1", "1e300", "1e-300", "abc", "", "1,5", '"', "#", "é"])
HEAD = st.sampled_from(["slump [cm]", "slump", "spread [mm]", "T500", "density", "mix", "Setzmaß", "slump [K]", ""])


@settings(max_examples=50, deadline=None)
@given(
    st.lists(HEAD, min_size=1, max_size=4),
    st.lists(st.lists(CELLS, min_size=1, max_size=4), min_size=1, max_size=3),
    st.sampled_from(",;\t"),
    st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "cp1252"]),
    st.binary(max_size=4),
)
def test_any_list_is_refused_in_one_line_or_gives_every_row_a_verdict(tmp_path_factory, head, rows, sign, code, noise):
    data = "\n".join(sign.join(cells) for cells in (head, *rows)).encode(code) + noise
    try:
        found = calibrate_list(read_list(written(tmp_path_factory.mktemp("any"), data)))
    except mps.SceneError as error:
        assert "\n" not in str(error)
    else:
        assert found and all(row["verdict"] for row in found)


def test_a_sheet_without_the_extra_says_how_to_get_it(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("taichi_mps.units.find_spec", lambda name: None)
    assert mps.main(["calibrate", "--table", str(written(tmp_path, sheet(["slump"], [0.2])))]) == 2
    needs = "an Excel sheet needs openpyxl: pip install 'taichi-mps[excel]', or save it as CSV"
    assert capsys.readouterr().err.endswith(f"mixes.csv: {needs}\n")


def test_a_number_in_a_column_without_a_name_is_refused_but_for_the_first(tmp_path):
    """It may be the end of a decimal comma; the first column may number the rows."""
    rows = read_list(written(tmp_path, ",spread [cm],t500 [s],\n0,55,5,3\n1,55,3.5,\n2,55,3.5,wet\n"))
    assert rows[0][tables.ROW_ERROR].startswith(
        "line 2 has a number in column 4, which has no name: 0,55,5,3; a number with"
    )
    assert all(tables.ROW_ERROR not in row for row in rows[1:])


def test_what_a_list_cannot_say_is_told_and_its_own_columns_are_kept(tmp_path, capsys):
    """Columns with a name of the results are renamed and formulas are escaped; silica fume, SF, is no slump flow, and a
    row without a measurement is refused."""
    text = (
        "mix,slump [mm],slump flow [mm],t500 [s],SF [kg/m3],verdict,reason,yield_value_found,,=2*3\n"
        "A,180,320,,30,good,-1,1,x,@SUM(A1)\nA,180,320,3,5,30,,1,,,\nA,180\n#4,,,,,,,,,-5\n"
    )
    path = written(tmp_path, text)
    assert mps.main(["calibrate", "--table", str(path)]) == 0
    told = capsys.readouterr().err
    assert "not used, but kept: 'mix', 'SF [kg/m3]', 'verdict (given)', 'reason (given)', 'yield_val" in told
    assert "refused: A: line 3 has 11 cells, the header has 10: A,180,320,3,5,30,,1,,,; a number with a decimal" in told
    assert "refused: A: line 4 has 2 cells, the header has 10" in told
    assert "refused: #4: has no measurement, none of slump, slump flow" in told
    with open(tmp_path / "mixes-calibrated.csv", newline="", encoding="utf-8") as file:
        first, *_, last = rows = list(csv.DictReader(file))
    assert len(rows) == 4 and [row["verdict"] for row in rows] == [EXPLAINED, *[REFUSED] * 3]
    assert first["verdict (given)"] == "good" and first["reason (given)"] == "-1" and first["column 9"] == "x"
    assert first["yield_value_found (given)"] == "1" and float(first["yield_value_found"]) > 400.0
    assert first["'=2*3"] == "'@SUM(A1)" and last["'=2*3"] == "-5" and last["mix"] == "#4"
    again = read_list(tmp_path / "mixes-calibrated.csv")
    assert {"verdict (given)", "verdict (given) (given)"} <= again[0].keys()


@pytest.mark.parametrize(
    ("row", "reason"),
    [
        ({"spread": "0.65", "t500": "3"}, "such a mix has no .*t500 and no slump flow"),
        ({"v_funnel": "9"}, "such a mix has no .*v_funnel"),
        ({"slump_error": "0.25"}, "slump_error must be smaller"),  # with which any mix stands
    ],
    ids=str,
)
def test_a_mix_without_slump_that_flows_or_may_have_any_is_refused(row, reason):
    """Nor is a slump of 0 m read beside a slump flow or a time of flow, which would be left out."""
    (row,) = calibrate_list([{"slump": "0"} | row])
    assert row["verdict"] == "refused" and re.search(reason, row["reason"])


def test_a_list_is_looked_up_in_a_study(tmp_path):
    """The package's own table of the cone, named as a study, gives the same mix; one that is not there is refused
    before the first row."""
    (own,), rows = calibrate_list([{"slump": "0.18", "spread": "0.32"}]), [{"slump": "0.18", "spread": "0.32"}]
    (again,) = calibrate_list(rows, str(Path(tables.__file__).with_name("slump.csv")))
    assert again["yield_value_found"] == own["yield_value_found"]
    with pytest.raises(mps.SceneError, match="nowhere"):
        calibrate_list(rows, tmp_path / "nowhere")


@pytest.mark.parametrize(("rows", "code"), [("A,5,5\nB,,\n", 1), ("A,5,5\nB,18,32\n", 0)])
def test_a_list_of_which_every_row_is_refused_is_a_failure(tmp_path, rows, code):
    path = written(tmp_path, f"mix,slump [cm],spread [cm]\n{rows}")
    assert mps.main(["calibrate", "--table", str(path)]) == code


def test_the_density_of_a_list_counts_as_the_option_does(tmp_path):
    rows = read_list(written(tmp_path, "mix;Setzmaß [cm];Rohdichte [kg/m³]\nA;18;1800\nB;18;2500\n"))
    for row, rho in zip(calibrate_list(rows), (1800.0, 2500.0), strict=True):
        assert row["yield_value_upper"] == calibrate(slump=0.18, rho=rho, check=False).yield_value.upper
