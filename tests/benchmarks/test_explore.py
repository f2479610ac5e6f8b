"""docs/explore.html in a headless Chromium: it shows the mixes of its table, and between them what the command measures
the error of."""

import json
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from tests.support.browser import chromium, needs_chromium, opened

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "benchmarks"))

import explore  # noqa: E402

pytestmark = needs_chromium
PAGE = ROOT / "docs" / "explore.html"
TABLE = explore.rows()


@pytest.fixture(scope="module")
def show():
    """Opens the page, or another, in a tab that may make no request and have no error."""
    with chromium() as browser:
        found = []

        def show(address="", page=PAGE, width=1280):
            found.append(opened(browser, page.as_uri() + address, ("file:", "data:"), width))
            found[-1][0].evaluate("ready")
            found[-1][0].wait_for_function("element('over').childElementCount > 0")
            return found[-1][0]

        yield show
        assert [wrong for _, wrong in found if wrong] == []


@pytest.fixture(scope="module")
def tab(show):
    """The page."""
    return show()


def pull(tab, slider, value):
    """Pull a slider, as a finger does, to the value nearest to this one."""
    part = tab.evaluate(f"toLog('{slider}', {value})")
    tab.locator(f"#{slider}").fill(str(round(part / 0.002) * 0.002))


def test_the_page_is_made_of_the_table_and_the_scripts():
    text = PAGE.read_text(encoding="utf-8")
    for part in (explore.SCRIPTS, explore.packed_table(explore.columns(explore.nodes()))):
        assert all(each in text for each in part.values())
    assert PAGE.stat().st_size < 3e6


def test_a_mix_of_the_table_has_its_numbers(tab):
    for row in TABLE[7 :: len(TABLE) // 6]:
        tau_y, eta = row["mix"]
        tab.evaluate(f"set({{ yield: {tau_y}, viscosity: {eta} }})")
        if row["mix"] in explore.checks().tolist():
            continue
        assert tab.inner_text("#slump-value") == f"{100 * row['slump_m'][-1]:.1f} cm"
'''
