"""Numbers in sentences of the pages are those of committed results, and results state how they were made. Compiles no
kernels."""

import json
import re
import subprocess

import claims
import points
import pytest

from tests.support.child import ROOT
from validation import provenance, table

KNOWN = claims.claims()
TOLD = ["README.md", *(f"docs/{name}.md" for name in ("accuracy", "limits", "models", "paper", "speed", "peers"))]
MEASURED = re.compile(r"(?<![\w.])(\d+\.\d+ mm|\d[\d.]* %|\d[\d.]* CPU-s|\d[\d.]* times)(?!\w*<)")
# what references, settings and rules say
GIVEN = {"0.4 mm", "0.5 mm", "12.5 mm", "15 CPU-s", "45 CPU-s", "1 %"}
SLUMP = {"quantity": "slump at rest", "value": 7.0, "target": 5.0, "unit": "mm", "met": False}


def result(*numbers):
    return {
        "row": "slump_500",
        "case": "a cone",
        "reference": "",
        "numbers": list(numbers),
        "error": None,
        "cpu_seconds": 1.0,
    }


@pytest.mark.parametrize("page", claims.PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_a_page_has_the_numbers_of_the_results(page):
    """`python benchmarks/claims.py` would change no page."""
    assert claims.filled(page, KNOWN) == page.read_text(encoding="utf-8")


@pytest.mark.parametrize("page", TOLD)
def test_a_measured_number_in_a_sentence_has_a_mark(page):
    """Numbers with a unit of a measured quantity have a mark, except in tables that a command writes and in printed
    output."""
    text = re.sub(
        r"<!-- written by .*?<!-- end.*?-->|^```.*?^```$", "", (ROOT / page).read_text("utf-8"), flags=re.S | re.M
    )
    sentences = [line for line in text.splitlines() if not re.match(r"\| [\w -]+ \| [\d.]+%? \|", line)]
    assert set(MEASURED.findall("\n".join(sentences))) <= GIVEN


@pytest.mark.parametrize("spoiled", ["1.2<!--full-slump-->, a line", "before 9,999<!--paper3-s--> after"])
def test_a_number_that_differs_is_found_and_filled_in(spoiled, tmp_path):
    page = tmp_path / "page.md"
    page.write_text(spoiled, encoding="utf-8")
    page.write_text(text := claims.filled(page, KNOWN), encoding="utf-8")
    assert text != spoiled and claims.MARK.sub("", text) == claims.MARK.sub("", spoiled)
    assert claims.filled(page, KNOWN) == text


@pytest.mark.parametrize("text", ["1.2<!--nobody-->", "no number<!--full-slump-->"])
def test_a_mark_without_a_number_or_of_an_unknown_name_is_refused(text, tmp_path):
    (tmp_path / "page.md").write_text(text, encoding="utf-8")
    with pytest.raises(SystemExit, match="page.md: .*mark"):
        claims.filled(tmp_path / "page.md", KNOWN)


def test_an_error_is_the_worst_of_the_means():
    """The worst mean error equals that computed by hand from the tables of docs/models.md (600 Pa, 10 Pa s; 300 Pa; 40
    Pa) and of peers.md (100 and 500 Pa)."""
    names = "full-slump", "full-flow80", "full-flow", "full-volume", "rings500", "foam500", "foam5"
    assert [KNOWN[name] for name in names] == ["2.1", "1.6", "3.7", "1.2", "2.4", "3.4", "21.8"]


def test_what_misses_its_target_is_all_that_does(monkeypatch):
    text = claims.accuracy().split("**What misses its target**")[1]
    kept = table.read_results(points.RESULTS, "implicit")
    misses = [item for row in kept.values() for item in row["numbers"] if not item["met"]]
    of_mixes = [item for *_, items in claims.accuracy_rows() for item in items if item["quantity"] in claims.SOFT]
    missed = [item for item in of_mixes if item["value"] > item["target"]]
    assert text.count("\n- ") == len(misses) + len(missed) and missed
    assert all(table.written(item, "value") in text for item in misses + missed)
    monkeypatch.setattr(table, "read_results", lambda *_: {**kept, "slump_500": result(SLUMP) | {"error": "diverged"}})
    assert "- a cone: slump at rest, 7 mm (target 5 mm)\n" in claims.accuracy()
    assert claims.accuracy().endswith("- a cone: diverged")


def test_a_row_that_constants_were_chosen_on_is_called_calibration():
    """The table marks as calibration the rows on which constants of docs/theory/constants.md with an asterisk, and the
    packing window, were chosen."""
    page = (ROOT / "docs" / "theory" / "constants.md").read_text(encoding="utf-8")
    lines = re.findall(r"^\| (`.*?) \| `\S+\.py` \| .*? \| .*? \| (.*?) \|$", page, re.M)
    marked = {name for cell, origin in lines if "*" in origin for name in re.findall(r"`([\w.]+)`", cell)}
    assert {name for names in table.CHOSEN_ON.values() for name in names} == marked | {"PACKING"}
    assert set(table.CHOSEN_ON) <= set(table.ROWS)
    assert "| a cone (calibration: `CORRECTION_RATE`, `PACKING`" in table.markdown({"slump_500": result(SLUMP)})


@pytest.fixture
def results(tmp_path, monkeypatch):
    """An empty folder of results, and a hash of the numerics that costs nothing."""
    run = subprocess.run

    def quick(words, **options):
        hashed = subprocess.CompletedProcess(words, 0, stdout="c0ffee\n")
        return hashed if "--numerics" in words else run(words, **options)

    monkeypatch.setattr(provenance.subprocess, "run", quick)
    monkeypatch.setattr(provenance, "ROOT", tmp_path)
    monkeypatch.setattr(points, "RESULTS", tmp_path / "benchmarks" / "results")
    points.RESULTS.mkdir(parents=True)
    (tmp_path / "benchmarks" / "fingerprint.py").touch()
    points.head.cache_clear()
    yield points.RESULTS
    points.head.cache_clear()


def test_a_result_says_what_it_was_made_with(results, tmp_path, monkeypatch):
    """Results of benchmarks and of rows state commit, date, processor and versions; outside of benchmarks/ without
    the hash."""
    points.save("mine", {"rows": []})
    monkeypatch.setattr(table, "run_apart", lambda name, *how: result() | {"row": name})
    for folder in (results, tmp_path / "elsewhere"):
        table.run_table(["couette"], False, folder)
    heads = [json.loads(file.read_text("utf-8"))["machine"] for file in sorted(tmp_path.rglob("*.json"))]
    assert [head["fingerprint"] for head in heads] == ["c0ffee", "c0ffee", None]
    for head in heads:
        assert head.keys() >= {"commit", "date", "processor", "python", "taichi", "taichi_mps"} and head["processor"]
    assert "fingerprint c0ffee" in points.stamp()


def test_a_commit_is_that_of_a_checkout(tmp_path):
    assert provenance.commit(tmp_path / "none") is None
    for words in ("init -q", "-c user.name=a -c user.email=a commit -q --allow-empty -m a"):
        subprocess.run(["git", *words.split()], cwd=tmp_path, check=True)
    assert re.fullmatch("[0-9a-f]{7,}", provenance.commit(tmp_path))


def test_results_of_other_numerics_or_without_a_head_are_listed(results):
    points.save("same", {"rows": []})
    points.save("points", {"points": {"old": {"machine": {"fingerprint": "other"}}, "new": {"machine": points.head()}}})
    (results / "headless.json").write_text('{"rows": []}')
    (results / "cases.json").write_text(json.dumps({"one": {"machine": points.head()}, "two": {"machine": "x86_64"}}))
    (results / "same.md").write_text(f"Made so ({points.stamp()}).")
    (results / "headless.md").write_text("Made some day.")
    (results / "elements.json").write_text('{"machine": {"fingerprint": "none"}}')
    (results / "elements.md").write_text("Made so (fingerprint none).")
    (results / "drawn.md").write_text(provenance.origin([{}]))
    assert claims.of_other_numerics("c0ffee") == ["cases.json", "headless.json", "headless.md", "points.json"]
    assert claims.of_other_numerics("c0ffee", "other") == ["cases.json", "headless.json", "headless.md"]


@pytest.mark.parametrize(("heads", "text"), [
    ([None, "x86_64", {"cpu": "AMD"}], "*Made with: no commit is kept of 3 of 3 results.*"),
    ([{"commit": "abc", "date": "2026-11-27", "processor": "EPYC"}] * 2, "*Made with: commit abc, 2026-11-27, EPYC.*"),
])  # fmt: skip
def test_a_table_says_where_its_results_come_from(heads, text):
    assert provenance.origin([{"machine": head} for head in heads]) == text
