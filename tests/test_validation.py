"""The quick rows of the validation table, and the table itself."""

import json

import pytest

from taichi_mps.cli import main
from taichi_mps.validation import ROWS, Measured, Row, table

MISSED = ("volume", "no delay")  # quantities that miss their target, see docs/limits.md; all others must meet it


@pytest.mark.parametrize("name", [row.name for row in ROWS.values() if row.quick])
def test_quick_row_meets_its_targets(name):
    numbers = [item for item in ROWS[name].run() if isinstance(item, Measured)]
    assert numbers
    for number in numbers:
        assert abs(number.value) < 100.0 * number.target, number  # a number at all, and of the right size
        assert number.met or any(word in number.quantity for word in MISSED), number


def test_a_number_is_met_only_within_its_target():
    assert Measured("q", -0.05, 0.05).met and not Measured("q", 0.051, 0.05).met
    assert not Measured("q", float("nan"), 1.0).met


def test_every_row_says_what_it_is():
    assert len(ROWS) > 20
    assert all(isinstance(row, Row) and row.case and row.reference for row in ROWS.values())
    assert sum(row.quick for row in ROWS.values()) >= 3


def test_table_counts_misses_and_failures(tmp_path):
    number = {"quantity": "speed", "value": 0.02, "target": 0.01, "unit": "m/s", "met": False}
    good = {"case": "film", "reference": "exact", "numbers": [number], "error": None, "cpu_seconds": 1.0}
    bad = {"case": "cone", "reference": "exact", "numbers": [], "error": "DivergedError: x", "cpu_seconds": 1.0}
    text = table.markdown([good, bad])
    assert "| film | exact | speed | 0.02 m/s | <= 0.01 m/s | **missed** |" in text
    assert "**failed**: DivergedError: x" in text and "0 of 1 numbers meet their target; 1 rows failed" in text
    page = tmp_path / "page.md"
    page.write_text(f"before\n{table.BEGIN}\nold\n{table.END}\nafter\n")
    table.insert(page, text)
    written = page.read_text()
    assert written.startswith("before\n") and written.endswith("after\n") and text in written and "old" not in written


def test_command_refuses_an_unknown_row_and_writes_the_table(tmp_path, capsys, monkeypatch):
    assert main(["validate", "plane_couete", "--out", str(tmp_path / "out")]) == 2
    assert "did you mean" in capsys.readouterr().err and not (tmp_path / "out").exists()
    name = next(row.name for row in ROWS.values() if row.quick)
    result = {"row": name, "case": "c", "reference": "r", "numbers": [], "error": None}
    monkeypatch.setattr(table, "run_apart", lambda each: result | {"cpu_seconds": 0.0, "wall_seconds": 0.0})
    assert main(["validate", name, "--out", str(tmp_path / "out"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)[0]["row"] == name
    assert (tmp_path / "out" / "table.md").read_text().startswith("| case |")
