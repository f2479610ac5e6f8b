"""Headless Chromium of the system, for tests of pages."""

import shutil
from contextlib import contextmanager

import pytest

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
DRAWN = ["--no-sandbox", "--enable-unsafe-swiftshader", "--use-angle=swiftshader"]  # 3-D without a graphics card
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine (apt install chromium)")


@contextmanager
def chromium():
    """A browser of playwright."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=DRAWN)
        yield browser
        browser.close()


def opened(browser, address, allowed, width):
    """A page in a window of its own, and the list of what goes wrong in it: errors, and requests for what does not
    begin with one of ``allowed``."""
    page, wrong = browser.new_context(viewport={"width": width, "height": 850}).new_page(), []
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on("console", lambda said: wrong.append(said.text) if said.type == "error" else None)
    page.on("request", lambda request: None if request.url.startswith(allowed) else wrong.append(request.url))
    page.goto(address)
    return page, wrong
