"""The page, end to end: a server of its own, a headless Chromium, runs of a few seconds."""

import http.client
import json
import os
import re
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import pytest

import taichi_mps as mps
from taichi_mps.io.run_folder import RunFolder
from taichi_mps.problem import accuracy, catalogue
from taichi_mps.problem.labels import written
from taichi_mps.problem.problem import Problem
from taichi_mps.simulation.summary import described
from taichi_mps.units import plain
from tests.support.browser import chromium, needs_chromium, opened
from tests.support.recorded import recorded

ROOT = Path(__file__).resolve().parents[2]
pytestmark = pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="reads /proc of Linux")


@contextmanager
def serving(folder):
    """A server of the runs in a folder: its port and its process; at its end Ctrl-C, and no child is left."""
    words = [sys.executable, "-m", "taichi_mps", "app", "--port", "0", "--no-browser", "--folder", str(folder)]
    variables = os.environ | {"PYTHONPATH": str(ROOT)}
    server = subprocess.Popen(words, cwd=folder, env=variables, text=True, stdout=-1, stderr=-1)
    try:
        port = int(re.match(r"http://127\.0\.0\.1:(\d+)/", server.stdout.readline())[1])
        yield port, server
    finally:
        family = children(server.pid)
        server.send_signal(signal.SIGINT)
        _, said = server.communicate(timeout=60)
    assert (said, server.returncode) == ("taichi-mps: interrupted\n", 130)
    deadline = time.monotonic() + 2.0  # for what Python itself leaves to end by itself
    while left := [child for child in family if Path(f"/proc/{child}").exists()]:
        assert time.monotonic() < deadline, [Path(f"/proc/{child}/cmdline").read_text() for child in left]
        time.sleep(0.05)


def children(process: int) -> list[int]:
    """Processes that descend from one."""
    parents = {}
    for status in Path("/proc").glob("[0-9]*/status"):
        try:
            parents[int(status.parent.name)] = int(re.search(r"PPid:\s*(\d+)", status.read_text())[1])
        except OSError:  # gone meanwhile
            continue
    found = [child for child, parent in parents.items() if parent == process]
    return found + [grandchild for child in found for grandchild in children(child)]


class Tab:
    """A page in a window of its own, with what goes wrong in it."""

    def __init__(self, browser, port, width=1280):
        here = f"http://127.0.0.1:{port}/"
        self.page, self.wrong = opened(browser, here, (here, f"ws://127.0.0.1:{port}/", "data:"), width)
        self.page.set_default_timeout(60_000)
        self.forecast("particles")

    def part(self, name, text=None):
        return self.page.locator(f'[data-part="{name}"]', has_text=text)

    def forecast(self, text):
        self.part("forecast", text).wait_for()
        return self.part("forecast").inner_text()

    def set(self, **texts):
        for name, text in texts.items():
            self.page.locator(f'input[data-field="{name}"]').fill(text)

    def press(self, action):
        self.page.locator(f'[data-action="{action}"]').first.click()

    def job(self, state, text=None):
        """The card of a job in this state, waited for."""
        card = self.page.locator(f'[data-job="{state}"]', has_text=text).first
        card.wait_for()
        return card


def run_of(tab):
    """The folder that the sentences of the last result name."""
    text = tab.job("done").locator('[data-part="sentences"]').inner_text()
    return text, RunFolder(re.search(r"results lie in (.+)\.", text)[1])


@needs_chromium
def test_two_tabs_run_watch_stop_and_compare(tmp_path):
    with serving(tmp_path) as (port, server), chromium() as browser:
        one, two = Tab(browser, port), Tab(browser, port, width=390)
        one.set(yield_value="500 ", spacing="20 mm")
        error = accuracy.expected("full", 0.02 / 0.3, accuracy.Mix.of(500.0, 50.0))
        told = one.forecast("particles of 20 mm, model full")
        assert f"Expect the slump within {300.0 * error.slump:.1f} mm" in told
        one.press("run")
        two.set(yield_value="900", spacing="0.02")
        two.forecast("particles of 20 mm")
        two.press("run")
        status = one.job("running", "500").locator('[data-part="status"]')
        status.get_by_text("s of at most 120 s. Slump").wait_for()
        assert two.job("waiting", "900 Pa").is_visible()
        picture = one.job("running").locator('[data-part="picture"] img')
        assert "/runs/slump/frames/frame_0" in picture.get_attribute("src")
        assert picture.evaluate("image => image.decode().then(() => image.naturalWidth)") > 500

        one.job("done", "500")
        text, folder = run_of(one)
        summary = RunFolder(tmp_path / folder.path.name).read_summary()
        assert summary["parameters"]["yield_value"] == 500.0 and summary["parameters"]["spacing"] == 0.02
        assert f"Slump {written('slump_m', summary['slump_m'])}" in text
        assert "yield stress 500 Pa" in text and "Concrete stopped flowing" in text

        two.job("done", "900")
        _, other = run_of(two)
        assert other.path.name != folder.path.name
        one.page.locator(".q-tab", has_text="Results").click()
        rows = one.part("runs").locator("tbody .q-checkbox")
        rows.nth(1).wait_for()
        rows.nth(0).click()
        rows.nth(1).click()
        one.page.get_by_text("500 Pa", exact=True).wait_for()
        assert one.page.get_by_text("900 Pa", exact=True).is_visible()
        one.part("curves").locator("canvas").wait_for()

        two.set(yield_value="0")  # it never comes to rest
        two.press("run")
        two.job("running", "stress 0 Pa").locator('[data-part="status"]').get_by_text("s of at most 5 s").wait_for()
        two.press("stop")
        stopped = two.job("stopped", "stress 0 Pa")
        stopped.get_by_text("Stopped by you after").wait_for()
        assert RunFolder(tmp_path / "slump-3").read_summary()["stopped_by"] == "interrupted"
        two.press("run")
        two.job("running", "stress 0 Pa").locator('[data-part="status"]').get_by_text("s of at most 5 s").wait_for()
        assert one.wrong == two.wrong == []
    assert RunFolder(tmp_path / "slump-4").read_summary()["stopped_by"] == "interrupted"  # by the end of the server


@needs_chromium
def test_a_bad_value_is_one_line_and_a_calibration_fills_the_form(tmp_path):
    with serving(tmp_path) as (port, server), chromium() as browser:
        tab = Tab(browser, port)
        tab.set(yield_value="-3")
        tab.part("wrong", "yield_value = -3").wait_for()
        assert "\n" not in tab.part("wrong").inner_text() and "Traceback" not in tab.page.content()
        tab.press("run")
        tab.set(yield_value="400", spacing="0.0001")
        tab.part("wrong", "spacing = 0.0001 m").wait_for()
        tab.set(spacing="")
        tab.forecast("5,504 particles of 10 mm")
        assert tab.part("wrong").inner_text() == "" and not list(tmp_path.iterdir())

        slider = tab.page.locator(".q-slider").first
        slider.click(position={"x": slider.bounding_box()["width"] - 1, "y": 5})
        tab.page.wait_for_function("document.querySelector('input[data-field=yield_value]').value == '2000'")
        tab.set(yield_value="0.01 kPa")
        tab.page.locator('.q-slider[aria-valuenow="0"]').first.wait_for()

        tab.page.locator(".q-tab", has_text="Calibrate").click()
        tab.set(slump="50 cm")
        tab.press("calibrate")
        tab.page.locator('[role="alert"]', has_text="slump = 0.5 m: must be less than 0.3 m").wait_for()
        tab.set(slump="18 cm", spread="0.32")
        tab.page.get_by_text("check by one finer run").click()
        tab.press("calibrate")
        found = tab.part("constants", "yield stress")
        found.wait_for()
        value = re.search(r"yield stress ([\d.]+) Pa, 95 %", found.inner_text())[1]
        assert 400.0 < float(value) < 600.0
        tab.page.get_by_text("Run a test with").click()
        tab.page.wait_for_function(f"document.querySelector('input[data-field=yield_value]').value == '{value}'")
        assert tab.wrong == []


def told_of(scene):
    """What the summary of a run says besides its results."""
    seconds = dict.fromkeys(("wall_seconds", "cpu_seconds", "compile_seconds"), 1.0)
    return described(Problem(scene)) | seconds | {"simulated_seconds": 0.01, "volume_error_max": 0.0, "left_out": 0.0}


def summary_with(**changes):
    """Write another summary into a run folder, with its right checksum."""

    def spoil(folder):
        folder.write_summary(folder.read_summary() | changes)

    return spoil


def text_of_summary(text):
    """Write a text in place of the summary."""
    return lambda folder: folder.summary.write_text(text)


def pipe_in_place_of(name):
    """Put a pipe in the place of a file, which nobody fills."""

    def spoil(folder):
        path = folder.path / name
        path.unlink(missing_ok=True)
        os.mkfifo(path)

    return spoil


ODD = {  # what is odd in a run folder, and what is said when it is chosen; the last is made by the product itself
    "huge number": (summary_with(slump_m=10**400), "It runs, was cut off"),
    "text for mixes": (summary_with(materials="abc"), "It runs, was cut off"),
    "many measures": (summary_with(**{f"reach_{k}_m": 0.5 for k in range(20_000)}), "more, see summary.json"),
    "no JSON": (text_of_summary("[" * 100_000), "It runs, was cut off"),
    "pipe for summary": (pipe_in_place_of("summary.json"), "It runs, was cut off"),
    "pipe for picture": (pipe_in_place_of("frames/frame_00007.png"), "Pictures and results lie in"),
    "pipe for history": (pipe_in_place_of("history.csv"), "Pictures and results lie in"),
    "\udcff": (lambda folder: None, "Pictures and results lie in"),
}


@needs_chromium
def test_an_odd_run_folder_is_a_row_that_says_so_and_the_others_stay(tmp_path):
    scene = catalogue.build("slump", spacing=0.05, until=1.0)
    told = told_of(scene)
    for name, (spoil, _) in ODD.items():
        folder, sim, recorder = recorded(tmp_path / name, scene, 1)
        sim.summary = lambda results=sim.summary: told | results()
        recorder.finish("time")
        spoil(folder)
    (tmp_path / "mark").mkdir()
    os.mkfifo(tmp_path / "mark" / "taichi_mps.json")
    with serving(tmp_path) as (port, server), chromium() as browser:
        assert answer(port, "/runs/%FF/summary.json").status == 200
        assert answer(port, "/runs/mark/summary.json").status == 404
        tab = Tab(browser, port)
        tab.page.locator(".q-tab", has_text="Results").click()
        rows = tab.part("runs").locator("tbody tr")
        rows.nth(len(ODD) - 1).wait_for()
        assert rows.count() == len(ODD)
        for name, (_, said) in ODD.items():
            box = rows.filter(has_text=plain(name)).locator(".q-checkbox")
            box.click()
            tab.page.get_by_text(said).first.wait_for()
            box.click()
            tab.page.get_by_text(said).first.wait_for(state="detached")
        assert tab.wrong == []


@needs_chromium
def test_a_run_that_outlived_its_server_is_found_and_stopped(tmp_path):
    words = ["run", "film", "--spacing=0.02", "--until=5000", "--every=1", "--threads=1", "--quiet", "--out=run"]
    command = [sys.executable, "-m", "taichi_mps", *words]
    variables = os.environ | {"PYTHONPATH": str(ROOT)}
    run = subprocess.Popen(command, cwd=tmp_path, env=variables, stderr=-1, start_new_session=True)
    try:
        while not (tmp_path / "run" / "history.csv").exists():
            assert run.poll() is None
            time.sleep(0.05)
        with serving(tmp_path) as (port, server), chromium() as browser:
            tab = Tab(browser, port)
            tab.job("running", "run, begun elsewhere").get_by_text("s of at most 5000 s").wait_for()
            tab.press("stop")
            assert run.wait(timeout=60) == 130
            tab.job("stopped", "run, begun elsewhere").wait_for()
        assert RunFolder(tmp_path / "run").read_summary()["stopped_by"] == "interrupted"
    finally:
        run.kill()


FOREIGN = "http://evil.example", "null", "https://127.0.0.1"


def answer(port, path="/", **headers):
    """The answer to a request with these headers."""
    line = http.client.HTTPConnection("127.0.0.1", port, timeout=20)
    line.request("GET", path, headers=headers)
    return line.getresponse()


SOCKET = "/_nicegui_ws/socket.io/?EIO=4&transport=websocket"
UPGRADE = {"Sec-WebSocket-Version": "13", "Sec-WebSocket-Key": "AAAAAAAAAAAAAAAAAAAAAA=="}
UPGRADE |= {"Connection": "Upgrade", "Upgrade": "websocket"}
OUTSIDE = "run/checkpoint.h5", "run/../secret.json", "..%2Fsecret.json/x", "%2e%2e/summary.json", "./secret.json"
OUTSIDE += "%00/summary.json", f"{'a' * 300}/summary.json", "run/%00"


def test_only_this_machine_and_its_own_page_are_served(tmp_path):
    run = tmp_path / "run"
    (run / "frames").mkdir(parents=True)
    for name in ("summary.json", "checkpoint.h5", "taichi_mps.json", "report.html", "frames/frame_00000.png"):
        (run / name).write_text(json.dumps({"made_by": "taichi_mps"}))
    (tmp_path / "secret.json").write_text("{}")
    (run / "history.csv").symlink_to(tmp_path / "secret.json")
    with serving(tmp_path) as (port, server):
        own, others = (
            f"127.0.0.1:{port}",
            ("evil.example", f"evil.example:{port}", "127.0.0.1", f"127.0.0.1:{port + 1}"),
        )
        for headers in ({}, {"Host": f"localhost:{port}"}, {"Origin": f"http://{own}"}):
            assert answer(port, **headers).status == 200
        for headers in [{"Host": host} for host in others] + [{"Origin": origin} for origin in FOREIGN]:
            assert answer(port, **headers).status == 403
        for site, status in {"none": 200, "same-origin": 200, "same-site": 403, "cross-site": 403}.items():
            got = answer(port, "/runs/run/frames/frame_00000.png", **{"Sec-Fetch-Site": site})
            assert (got.status, got.headers["Cross-Origin-Resource-Policy"]) == (status, "same-origin")
        assert answer(port, "/_nicegui_ws/socket.io/?EIO=4&transport=polling&j=0").status == 403, "no JSONP"
        sockets = [answer(port, SOCKET, **UPGRADE, Origin=origin).status for origin in (*FOREIGN, f"http://{own}")]
        assert sockets == [403, 403, 403, 101]

        report = answer(port, "/runs/run/report.html")
        assert (report.status, report.headers["Content-Disposition"]) == (200, 'attachment; filename="run-report.html"')
        shown = {f"run/{name}": 200 for name in ("summary.json", "frames/frame_00000.png")}
        shown |= dict.fromkeys((*OUTSIDE, "run/frame_00000.png", "run/history.csv"), 404)
        assert {path: answer(port, f"/runs/{path}").status for path in shown} == shown

        listening = Path(f"/proc/{server.pid}/net/tcp").read_text() + Path(f"/proc/{server.pid}/net/tcp6").read_text()
        assert re.findall(rf"\b(\w+):{port:04X} 0+:0000 0A", listening) == ["0100007F"]  # 127.0.0.1 alone
        assert mps.main(["app", "--no-browser", "--port", str(port)]) == 2  # taken
    assert not (tmp_path / ".nicegui").exists()


def test_without_the_extra_it_says_how_to_get_it(monkeypatch, capsys):
    monkeypatch.setattr("taichi_mps.app.command.find_spec", lambda name: None)
    assert mps.main(["app"]) == 2
    assert capsys.readouterr().err == "taichi-mps: app needs nicegui: pip install 'taichi-mps[app]'\n"
