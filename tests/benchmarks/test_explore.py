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
NUMBERS = "['slump', 'flow', 't500', 'class'].map((name) => element(`${name}-value`).textContent)"


@pytest.fixture(scope="module")
def show():
    """Opens the page, or another, in a tab of its own, with no error in it and no request for anything else."""
    with chromium() as browser:
        found = []

        def show(address="", page=explore.PAGE, width=1280):
            found.append(opened(browser, page.as_uri() + address, (page.as_uri(), "data:"), width))
            found[-1][0].evaluate("ready")
            found[-1][0].wait_for_function("element('over').childElementCount > 0")
            return found[-1][0]

        yield show
        assert [wrong for _, wrong in found if wrong] == []


@pytest.fixture(scope="module")
def tab(show):
    """The page."""
    return show()


def test_the_page_is_that_of_the_table_and_the_scripts():
    text = explore.PAGE.read_text(encoding="utf-8")
    shown = json.loads(re.search(r'id="table">(.*?)</script>', text, re.S)[1])
    assert shown == explore.data(explore.columns([KNOWN[mix] for mix in explore.NODES]))
    assert all((ROOT / name).read_text(encoding="utf-8") in text for name in explore.PARTS)
    assert explore.PAGE.stat().st_size < 3e6 and (ROOT / explore.PARTS[-1]).read_text().count("\n") < 300


def test_the_table_is_good_between_its_mixes():
    """Slump within 2 mm, slump flow within 1.5 %, at mixes that are not in it."""
    table = explore.columns([KNOWN[mix] for mix in explore.NODES])
    for mix in explore.checks():
        assert mix not in explore.NODES
        (known,) = ({name: values[0] for name, values in explore.columns([KNOWN[mix]]).items()},)
        off = explore.at_rest(explore.at(table, mix)) - explore.at_rest(known)
        assert abs(off[0]) < 2.0 and abs(off[1]) < 0.015, mix


@needs_chromium
@pytest.mark.parametrize("mix", explore.NODES[:: len(explore.NODES) // 5])
def test_a_mix_of_the_table_has_its_numbers(tab, mix):
    row = KNOWN[mix]
    tab.evaluate("([tau, eta]) => { location.hash = `yield=${tau}&viscosity=${eta}` }", list(mix))
    tab.wait_for_function(f"state.yield === {mix[0]} && state.viscosity === {mix[1]}")
    slump, flow, _, _ = tab.evaluate(NUMBERS)
    assert slump == f"{100 * row['slump_m'][-1]:.1f} cm" and flow == f"{100 * row['spread_m'][-1]:.1f} cm"
    np.testing.assert_allclose(tab.evaluate("state.course.time"), row["time_s"], rtol=1e-3, atol=1e-9)
    drawn = tab.evaluate("outline(state.course, 12).map(([r, z]) => [r, z])")
    angle = np.linspace(0.0, 0.5 * np.pi, explore.RAYS)
    size = row["rays"][12][:, None] * (row["spread_m"][12] / 2.0, explore.HEIGHT - row["slump_m"][12])
    np.testing.assert_allclose(drawn, size * np.stack([np.cos(angle), np.sin(angle)], 1), atol=1e-4)


@needs_chromium
def test_a_pulled_slider_shows_the_mix_between(tab):
    """The same numbers as those whose error the command measures."""
    table = explore.columns([KNOWN[mix] for mix in explore.NODES])
    for part in (0.31, 0.62, 0.83):
        tab.locator("#yield").fill(str(part))
        tab.locator("#viscosity").fill(str(1.0 - part))
        mix = tab.evaluate("[state.yield, state.viscosity]")
        assert mix not in explore.NODES
        slump, flow, t500 = explore.at_rest(explore.at(table, mix))
        found = tab.evaluate("[1000 * state.course.slump.at(-1), Math.log(state.course.spread.at(-1))]")
        np.testing.assert_allclose(found, (slump, flow), atol=0.03)
        assert np.isnan(t500) == (tab.evaluate("state.course.t500") is None)
        assert f"{0.1 * slump:.1f} cm" == tab.inner_text("#slump-value")


@needs_chromium
def test_a_link_brings_back_mix_and_time(tab, show):
    tab.locator("#yield").fill("0.5")
    tab.locator("#time").fill("0.4")
    address = tab.evaluate("location.hash")
    again = show(address)
    assert "time=" in address and again.inner_text("#now") == tab.inner_text("#now")
    assert again.evaluate(NUMBERS) == tab.evaluate(NUMBERS)
    tab.locator("#time").fill("1")
    assert "time=" not in tab.evaluate("location.hash")


@needs_chromium
def test_a_class_is_pulled_to_and_the_film_ends_at_rest(tab):
    for name in ("S1", "S3", "SF1"):
        tab.get_by_role("button", name=name, exact=True).click()
        assert tab.inner_text("#class-value") == name
    tab.get_by_role("button", name="#2", exact=True).click()
    assert tab.evaluate("[state.yield, state.viscosity]") == [300, 50]
    tab.click("#play")
    tab.wait_for_function("state.time > 0 && state.time < 0.1 * state.course.end")
    tab.wait_for_function("state.time === Infinity && !state.playing")


@needs_chromium
def test_it_fits_a_phone_and_needs_no_webgl(show, tmp_path):
    flat = tmp_path / "explore.html"
    text = explore.PAGE.read_text(encoding="utf-8")
    flat.write_text(text.replace('getContext("webgl2"', 'getContext("none"'), encoding="utf-8")
    tab = show(page=flat, width=390)
    assert tab.evaluate("document.documentElement.scrollWidth") <= 390
    before = tab.get_attribute("#over .body", "d")
    tab.locator("#yield").press("ArrowLeft")
    tab.wait_for_function(
        "([known]) => document.querySelector('#over .body').getAttribute('d') !== known", arg=[before]
    )
