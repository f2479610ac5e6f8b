"""docs/explore.html in a headless Chromium: it shows the mixes of its table, and between them what the command measures
the error of."""

import json
import re

import explore
import numpy as np
import pytest

from tests.support.browser import chromium, needs_chromium, opened
from tests.support.child import ROOT

KNOWN = explore.courses()
TABLE = explore.columns([KNOWN[mix] for mix in explore.NODES])
TOLD = "[...document.querySelectorAll('dd, output')].map((each) => each.textContent)"


@pytest.fixture(scope="module")
def browser():
    with chromium() as browser:
        yield browser


@pytest.fixture(scope="module")
def show(browser):
    """Opens a page in a tab of its own, with no error in it and no request for anything else."""
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
    """By a link, which brings back the time, too; a pulled slider and buttons show others."""
    for mix in [*explore.NODES[::33], *explore.checks()[:3]]:
        known, tab = explore.at(TABLE, mix), show("#yield={}&viscosity={}".format(*mix))
        assert f"{100 * known['slump'][-1]:.1f} cm" == tab.inner_text("#slump-value")
        assert mix not in explore.NODES or f"{known['slump'][-1]:.5g}" == f"{KNOWN[mix]['slump_m'][-1]}"
        for name in ("slump", "spread", "highest"):
            np.testing.assert_allclose(tab.evaluate(f"state.course.{name}"), known[name], atol=1e-4)
        np.testing.assert_allclose(tab.evaluate("state.course.time.slice(1)"), np.exp(known["time"][1:]), rtol=2e-3)
        found = tab.evaluate("mixed(state.course.rows, 'away', table.stages * table.rays)")
        np.testing.assert_allclose(found, known["away"].ravel(), atol=2e-4)
    before = tab.inner_text("#flow-value")
    tab.locator("#yield").press("PageDown")
    assert float(tab.inner_text("#flow-value")[:4]) > float(before[:4])
    tab.locator("#time").fill("0.4")
    assert show(tab.evaluate("location.hash")).evaluate(TOLD) == tab.evaluate(TOLD)
    for name in ("S1", "S3", "S5"):
        tab.get_by_role("button", name=name, exact=True).click()
        assert tab.inner_text("#class-value") == name
    tab.click("#play")
    tab.wait_for_function("0 < state.time && state.time < 0.1 * state.course.end")
    tab.wait_for_function("state.time === Infinity && !state.playing")


PULLS = {  # what a finger pulls on an emulated phone, how far [pixels], and what is then so
    "#yield": (-80, 0, "state.yield < 200"),
    "#view": (60, 0, "Math.abs(state.viewer.turn - 0.83) < 0.1"),
    "#stage": (0, -150, "scrollY > 50"),
}


@needs_chromium
@pytest.mark.parametrize("what", PULLS)
def test_a_finger_pulls_the_yield_stress_turns_the_cone_and_scrolls_the_page(what, browser):
    across, up, then = PULLS[what]
    tab = browser.new_context(viewport={"width": 390, "height": 600}, has_touch=True, is_mobile=True).new_page()
    tab.goto(f"{explore.PAGE.as_uri()}#yield=300")
    tab.evaluate("ready")
    hand, box = tab.context.new_cdp_session(tab), tab.locator(what).bounding_box()
    x, y = box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"]
    for kind, k in [("Start", 0), *(("Move", k) for k in range(1, 11)), ("End", None)]:
        at = [] if k is None else [{"x": x + 0.1 * k * across, "y": y + 0.1 * k * up}]
        hand.send("Input.dispatchTouchEvent", {"type": f"touch{kind}", "touchPoints": at})
    assert tab.wait_for_function(then)


@needs_chromium
def test_it_fits_a_phone_and_draws_a_section_without_webgl(show, tmp_path):
    (tmp_path / "flat.html").write_text(explore.PAGE.read_text("utf-8").replace('"webgl2"', '"none"'), encoding="utf-8")
    tab = show(page=tmp_path / "flat.html", width=390)
    assert tab.evaluate("document.documentElement.scrollWidth") <= 390
    before = tab.locator("#over .body").get_attribute("d")
    tab.locator("#yield").press("ArrowLeft")
    tab.wait_for_function("(known) => document.querySelector('#over .body').getAttribute('d') !== known", arg=before)
