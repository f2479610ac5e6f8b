"""docs/explore.html in a headless Chromium: it shows the mixes of its table, and between them what the command measures
the error of."""

import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.support.browser import chromium, needs_chromium, opened

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "benchmarks"))

import explore  # noqa: E402

KNOWN = explore.courses()
TABLE = explore.columns([KNOWN[mix] for mix in explore.NODES])
TOLD = "[...document.querySelectorAll('dd, output')].map((each) => each.textContent)"


@pytest.fixture(scope="module")
def show():
    """Opens a page in a tab of its own, with no error in it and no request for anything else."""
    with chromium() as browser:
        found = []

        def show(address="", page=explore.PAGE, width=1280):
            found.append(opened(browser, page.as_uri() + address, (page.as_uri(), "data:"), width))
            found[-1][0].evaluate("ready")
            found[-1][0].wait_for_function("element('over').childElementCount > 0")
            return found[-1][0]

        yield show
        assert [wrong for _, wrong in found if wrong] == []


def test_the_page_is_made_of_the_table_and_the_scripts():
    text = explore.PAGE.read_text(encoding="utf-8")
    assert json.loads(re.search(r'id="table">(.*?)</script>', text, re.S)[1]) == explore.data(TABLE)
    assert all((ROOT / name).read_text(encoding="utf-8") in text for name in explore.PARTS)


@pytest.mark.parametrize("mix", explore.checks())
def test_the_table_is_good_between_its_mixes(mix):
    """Slump within 2 mm, slump flow within 1.5 %, at mixes that are not in it."""
    known = {name: values[0] for name, values in explore.columns([KNOWN[mix]]).items()}
    slump, flow, _ = explore.at_rest(explore.at(TABLE, mix)) - explore.at_rest(known)
    assert mix not in explore.NODES and abs(slump) < 2.0 and abs(flow) < 0.015


@needs_chromium
def test_it_shows_the_mixes_of_the_table_and_those_between_as_the_command_measures_them(show):
    """By a link, by a pulled slider, which a link brings back with the time, and by buttons."""
    for k in range(0, len(explore.NODES), 33):
        row, tab = KNOWN[explore.NODES[k]], show("#yield={}&viscosity={}".format(*explore.NODES[k]))
        assert f"{100 * row['slump_m'][-1]:.1f} cm" == tab.inner_text("#slump-value")
        assert f"{100 * row['spread_m'][-1]:.1f} cm" == tab.inner_text("#flow-value")
        np.testing.assert_allclose(tab.evaluate("state.course.time"), row["time_s"], rtol=1e-3, atol=1e-9)
        angle = np.linspace(0.0, 0.5 * np.pi, explore.RAYS)
        shape = TABLE["away"][k, 12] * np.array([np.cos(angle), np.sin(angle)])
        size = row["spread_m"][12] / 2.0, explore.HEIGHT - row["slump_m"][12]
        np.testing.assert_allclose(tab.evaluate("outline(state.course, 12)"), shape.T * size, atol=1e-4)
    for part in ("0.31", "0.62", "0.83"):
        tab.locator("#yield").fill(part)
        tab.locator("#viscosity").fill(part)
        slump, flow, _ = explore.at_rest(explore.at(TABLE, tab.evaluate("[state.yield, state.viscosity]")))
        found = tab.evaluate("[1000 * state.course.slump.at(-1), Math.log(state.course.spread.at(-1))]")
        np.testing.assert_allclose(found, (slump, flow), atol=0.03)
    tab.locator("#time").fill("0.4")
    assert show(tab.evaluate("location.hash")).evaluate(TOLD) == tab.evaluate(TOLD)
    for name in ("S1", "S3", "S5"):
        tab.get_by_role("button", name=name, exact=True).click()
        assert tab.inner_text("#class-value") == name
    tab.click("#play")
    tab.wait_for_function("0 < state.time && state.time < 0.1 * state.course.end")
    tab.wait_for_function("state.time === Infinity && !state.playing")


@needs_chromium
def test_it_fits_a_phone_and_draws_a_section_without_webgl(show, tmp_path):
    (tmp_path / "flat.html").write_text(explore.PAGE.read_text("utf-8").replace('"webgl2"', '"none"'), encoding="utf-8")
    tab = show(page=tmp_path / "flat.html", width=390)
    assert tab.evaluate("document.documentElement.scrollWidth") <= 390
    before = tab.locator("#over .body").get_attribute("d")
    tab.locator("#yield").press("ArrowLeft")
    tab.wait_for_function("(known) => document.querySelector('#over .body').getAttribute('d') !== known", arg=before)
