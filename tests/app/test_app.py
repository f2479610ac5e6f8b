"""The page, end to end: a server of its own, a headless Chromium, runs of a few seconds."""

import asyncio
import http.client
import json
import os
import re
import signal
from pathlib import Path
from unittest.mock import AsyncMock

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import taichi_mps as mps
from taichi_mps.app.resident import RESTARTED, Resident
from taichi_mps.engine.problem.problem import Problem
from taichi_mps.forecast import accuracy
from taichi_mps.input import catalogue
from taichi_mps.input.labels import written
from taichi_mps.io.run_folder import RunFolder
from taichi_mps.report.drawings import beginning
from taichi_mps.report.page import write
from taichi_mps.units import plain
from tests.support.browser import chromium, needs_chromium, opened
from tests.support.recorded import recorded
from tests.support.served import serving

pytestmark = pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="reads /proc of Linux")


TOKEN = "kept.by~its_owner-1"
# time that a pointer at the right end of the first chart reads
READ = """(() => { const chart = document.querySelector('[data-part=curves] svg'), box = chart.getBoundingClientRect();
  chart.dispatchEvent(new PointerEvent('pointermove', {clientX: box.right, clientY: box.top + 50}));
  return parseFloat(chart.querySelector('.read').textContent); })()"""


class Tab:
    """A page in a window of its own, with what goes wrong in it."""

    def __init__(self, browser, port, place="", width=1280):
        here = f"http://127.0.0.1:{port}/"
        self.page, self.wrong = opened(browser, here + place, (here, "data:"), width)
        self.page.set_default_timeout(120_000)

    def part(self, name, text=None):
        return self.page.locator(f'[data-part="{name}"]', has_text=text)

    def forecast(self, text):
        self.page.locator("#about").evaluate("details => { details.open = true }")
        self.part("forecast", text).wait_for()
        return self.part("forecast").inner_text()

    def field(self, name):
        return self.page.locator(f'[data-field="{name}"]')

    def set(self, **texts):
        for name, text in texts.items():
            self.field(name).fill(text)

    def press(self, action):
        self.page.locator(f'[data-action="{action}"]').first.click()

    def result(self):
        """The text of each number of the preview, when it is computed."""
        self.page.locator("#stage[data-result]").wait_for()
        self.part("source", "Preview").wait_for()
        return {cell.get_attribute("data-number"): cell.inner_text() for cell in self.page.locator(".number").all()}


@needs_chromium
def test_sliders_preview_a_mix_and_its_address_brings_it_back(tmp_path):
    """The previewed slump and slump flow of a mix are those of a run of the same model, its class that of its highest
    point, as EN 12350-2 reads it: of 300 Pa, 50 Pa s another than that of the slump at the axis."""

    def measures(yield_value, plastic_viscosity):
        sim = mps.Simulation(
            catalogue.build(
                "slump",
                yield_value=yield_value,
                plastic_viscosity=plastic_viscosity,
                model="axisymmetric",
                spacing=0.01,
            )
        )
        sim.run()
        return sim.measures()

    found, error = (
        measures(1500.0, 30.0),
        accuracy.expected("axisymmetric", 1.0 / 30.0, accuracy.MixNumbers.of(1500.0, 30.0)),
    )
    softer = measures(300.0, 50.0)
    assert softer["slump_max_m"] < 0.215 < softer["slump_m"]
    with serving(tmp_path) as (port, server), chromium() as browser:
        tab = Tab(browser, port, "#slump?yield_value=1%2C5+kPa&plastic_viscosity=30")
        numbers = tab.result()
        assert written("slump_m", found["slump_m"]) in numbers["slump_m"]
        assert written("spread_m", found["spread_m"]) in numbers["spread_m"]
        assert error is None or f"{300.0 * error.slump:.0f} mm" in numbers["slump_m"]
        assert "not reached" in numbers["t500_s"] and "SF" not in numbers["spread_m"]
        for width, height in ((1280, 900), (390, 844)):
            tab.page.set_viewport_size({"width": width, "height": height})
            box = tab.page.locator("#go").bounding_box()
            assert 0.0 < box["y"] < box["y"] + box["height"] <= height, "Run is in sight"
        tab.page.set_viewport_size({"width": 640, "height": 450})  # a zoom of 200 %
        numbers, mix = (tab.page.locator(name).bounding_box() for name in ("#numbers", "#mix"))
        assert numbers["y"] + numbers["height"] <= mix["y"], "the form covers no number"
        tab.page.set_viewport_size({"width": 1280, "height": 900})

        slider = tab.page.locator('[data-slider="yield_value"]')
        slider.focus()
        slider.press("End")  # the keyboard moves it, too
        tab.page.locator("#stage:not([data-result])").wait_for(state="detached")
        assert tab.field("yield_value").input_value() == "2000"
        tab.part("numbers", "0.0 cm").wait_for()
        tab.part("forecast", "model full").wait_for(state="attached")
        tab.page.locator('[data-test="l_box"]').click()
        assert "model full" not in tab.part("forecast").text_content(), "that of the test before"
        tab.part("forecast", "model half").wait_for(state="attached")
        assert tab.field("yield_value").input_value() == "2000", "the mix goes with another test"
        tab.page.go_back()
        tab.page.locator('[data-test="slump"][aria-current]').wait_for()
        assert tab.field("yield_value").input_value() == "2000"
        tab.page.reload()
        assert tab.field("plastic_viscosity").input_value() == "30"
        top, flow = tab.page.evaluate(
            "import('/static/ask.js').then(m => [[0.044, 0.046, 0.2, 0.22].map(v => m.en206('slump_m', v)),"
            "[0.54, 0.6, 0.7, 0.8].map(v => m.en206('spread_m', v))])"
        )
        tab.page.goto(f"http://127.0.0.1:{port}/#slump?yield_value=300&plastic_viscosity=50")
        tab.part("numbers", written("slump_m", softer["slump_m"])).wait_for()  # not those of the mix before
        assert tab.result()["slump_m"].split()[-1] == "S4"
        assert (top, flow) == (["S1", "S2", "S4", "S5"], ["", "SF1", "SF2", "SF3"])  # EN 206, to the nearest 10 mm
        assert tab.wrong == []


@needs_chromium
def test_two_tabs_run_watch_stop_and_compare(tmp_path):
    """Each a browser of its own, which has the token from its address."""
    with serving(tmp_path, TOKEN) as (port, server), chromium() as browser:
        one = Tab(browser, port, f"?token={TOKEN}")
        two = Tab(browser, port, f"?token={TOKEN}#slump?yield_value=900&spacing=0.02&model=axisymmetric", width=390)
        assert TOKEN not in one.page.url + two.page.url
        one.set(yield_value="500 ")
        one.page.locator("#more").evaluate("details => { details.open = true }")
        one.set(spacing="20 mm")
        one.field("model").select_option("axisymmetric")
        error = accuracy.expected("axisymmetric", 0.02 / 0.3, accuracy.MixNumbers.of(500.0, 50.0))
        told = one.forecast("particles of 20 mm, model axisymmetric")
        assert f"Expect the slump within {300.0 * error.slump:.1f} mm" in told
        one.press("run")
        one.part("status", "Slump").wait_for()
        assert one.page.evaluate(
            "document.querySelector('#picture[src]') || document.querySelector('#section').checkVisibility()"
        ), "the preview until the run has a picture"
        picture = one.page.locator("#picture[src]")
        picture.wait_for()
        assert "/runs/slump/frames/frame_0" in picture.get_attribute("src")
        assert picture.evaluate("image => image.decode().then(() => image.naturalWidth)") > 500
        assert two.page.locator('#go[data-action="stop"]').is_visible()

        last = one.part("last", "yield stress 500 Pa")
        last.wait_for()
        one.page.locator("#stage[data-body] #over", has_text="slump flow").wait_for()  # the lit body of its report
        summary = RunFolder(tmp_path / "slump").read_summary()
        assert summary["parameters"]["yield_value"] == 500.0 and summary["parameters"]["spacing"] == 0.02
        assert f"Slump {written('slump_m', summary['slump_m'])}" in last.inner_text()

        two.forecast("particles of 20 mm")
        two.press("run")
        two.part("last", "yield stress 900 Pa").wait_for()
        two.page.locator('[data-part="last"][data-job="done"]').wait_for()
        one.page.goto(f"http://127.0.0.1:{port}/#runs")
        rows = one.page.locator(".row")
        rows.nth(1).wait_for()
        assert "900 Pa" in rows.nth(0).inner_text(), "newest first"
        for row in rows.all():
            row.locator('[type="checkbox"]').check()
        one.press("compare")
        one.part("curves").locator("svg").first.locator("path").nth(1).wait_for()
        assert one.page.evaluate(READ) == pytest.approx(
            max(RunFolder(tmp_path / name).read_summary()["simulated_seconds"] for name in ("slump", "slump-2")),
            rel=0.01,
        ), "where the longest curve ends"
        assert (
            one.page.get_by_role("cell", name="500 Pa").is_visible()
            and one.page.get_by_role("cell", name="900 Pa").is_visible()
        )

        two.set(yield_value="0")  # it never comes to rest
        two.press("run")
        two.part("status", "the concrete at").wait_for()
        two.press("stop")
        two.part("source", "Stopped before its end: ").wait_for()
        assert two.page.locator(".number").count() == 0, "no result"
        assert RunFolder(tmp_path / "slump-3").read_summary()["stopped_by"] == "interrupted"
        assert "900 Pa" in two.part("last").inner_text(), "the last result stays"
        two.press("run")
        two.part("status", "the concrete at").wait_for()
        assert one.wrong == two.wrong == []
    assert RunFolder(tmp_path / "slump-4").read_summary()["stopped_by"] == "interrupted"  # by the end of the server


@needs_chromium
def test_a_bad_value_is_told_at_its_field_and_a_calibration_fills_the_form(tmp_path):
    with serving(tmp_path) as (port, server), chromium() as browser:
        tab = Tab(browser, port)
        tab.set(yield_value="-3")
        tab.page.locator("#field-yield_value-wrong", has_text="Must be greater than or equal to 0 Pa").wait_for()
        assert tab.field("yield_value").get_attribute("aria-invalid") == "" and tab.page.locator("#go").is_disabled()
        tab.page.locator("#more").evaluate("details => { details.open = true }")
        tab.set(plastic_viscosity="x", density="-1")
        tab.page.locator("#field-density-wrong", has_text="0 kg/m3").wait_for(state="attached")
        told = [text for text in tab.page.locator("#mix .wrong").all_text_contents() if text]
        assert len(told) == 3 and not any("_" in text or " = " in text for text in told), "each its own, in words"
        tab.page.route("**/ask/*", lambda route: None)  # no answer comes any more
        tab.set(density="2300")
        assert tab.field("density").get_attribute("aria-invalid") is None, "a corrected field is not red"
        assert "estimating" in tab.page.locator("#go:disabled").inner_text(), "no forecast of the mix before"
        assert tab.page.locator("#stage[data-old]").count() == 1, "nor its body, undimmed"
        tab.page.unroute("**/ask/*")
        tab.set(plastic_viscosity="")
        assert tab.page.locator(".number").count() == 0, "no numbers of the mix before"
        tab.set(yield_value="400")
        tab.set(spacing="0.0001")
        tab.page.locator("#field-spacing-wrong", has_text="Fills the box with").wait_for()
        tab.set(spacing="2,0 cm")
        tab.part("forecast", "675 particles of 20 mm").wait_for(state="attached")
        tab.field("spacing").press("Enter")  # which runs nothing
        tab.set(consistency="30", plastic_viscosity="20")
        tab.page.locator("#field-plastic_viscosity-wrong", has_text="empty its field").wait_for()
        tab.set(consistency="", plastic_viscosity="")
        tab.page.locator('[data-test="flow"]').click()
        assert tab.field("yield_value").input_value() == "400", "what was typed goes along"
        tab.page.go_back()
        tab.page.locator("#more").evaluate("details => { details.open = true }")
        tab.set(accuracy="7mm")
        tab.page.locator(".remark", has_text="model = ").wait_for()
        tab.field("model").select_option("half")
        tab.page.locator(".remark", has_text="has no effect").wait_for()
        assert not list(tmp_path.iterdir())

        tab.page.locator('[data-page="calibrate"]').click()
        tab.field("calibrate-slump").fill("50 cm")
        tab.page.locator("#finer").uncheck()
        tab.press("calibrate")
        tab.page.locator("#measured-slump-wrong", has_text="Must be less than 0.3 m").wait_for()
        tab.field("calibrate-slump").fill("18 cm")
        tab.field("calibrate-spread").fill("0.32")
        tab.press("calibrate")
        found = tab.part("constants", "measure T500")
        found.wait_for()
        value = re.search(r"Yield stress about (\d+) Pa \(\d+ to \d+\)", found.inner_text())[1]
        assert 400.0 < float(value) < 600.0
        tab.press("use")
        tab.page.locator('[data-test="slump"][aria-current]').wait_for()
        assert float(tab.field("yield_value").input_value()) == pytest.approx(float(value), rel=0.05)
        assert tab.wrong == []


@needs_chromium
def test_a_test_without_preview_shows_its_last_run_then_its_vessel_to_scale_which_follows_the_fields(tmp_path):
    folder, sim, recorder = recorded(tmp_path / "earlier", 2, scene=catalogue.build("l_box", spacing=0.05, until=1.0))
    sim.facts = lambda results=sim.facts: told_of(sim.scene) | results()
    recorder.finish("time")
    write(folder, sim.scene)
    with serving(tmp_path) as (port, server), chromium() as browser:
        tab = Tab(browser, port, "#l_box")
        tab.part("source", "Last run of this test, earlier: ").wait_for()
        tab.page.locator("#stage[data-body] #time", has_text="0.02 s").wait_for()  # it moves
        tab.page.locator("#more").evaluate("details => { details.open = true }")
        for length in ("70 cm", "80 cm"):
            tab.set(length=length)
            over = tab.page.locator("#stage[data-body]:not([data-old]) #over", has_text=length)
            over.wait_for(state="attached")
            assert {"20 cm", "60 cm", length} <= set(over.locator("text").all_text_contents())
            assert "Last run" not in tab.part("source").inner_text()
        before = tab.page.locator("#solid").screenshot()
        tab.page.locator("#solid").press("ArrowRight")
        assert tab.page.locator("#solid").screenshot() != before
        tab.page.locator('[data-test="l_flow"]').click()
        assert "flow_m" in tab.result() and "without side walls" in tab.part("source").inner_text()
        assert tab.page.locator("#stage[data-body]").count() == 0 and tab.wrong == []


@needs_chromium
def test_a_length_asks_for_its_unit_and_the_tests_are_one_stop_of_the_keyboard(tmp_path):
    with serving(tmp_path) as (port, server), chromium() as browser:
        tab = Tab(browser, port, "#wall")
        tab.page.locator("#more").evaluate("details => { details.open = true }")
        units = tab.page.locator(".field", has=tab.page.locator("#field-height")).locator(".unit")
        assert tab.field("rate").get_attribute("placeholder") == "720 l/min" and units.inner_text() == ""
        tab.set(height="40")
        assert units.inner_text() == "m"
        tab.page.get_by_role("button", name="40 cm?").click()
        assert tab.field("height").input_value() == "40 cm" and units.inner_text() == "", "a unit stands once"
        assert "height=40+cm" in tab.page.url and tab.page.locator(".asked button").count() == 0
        tab.set(rate="30", hose_diameter="90", age="10", spacing="0.02")
        # what the units of SI explain is not asked
        assert set(tab.page.locator(".asked button").all_inner_texts()) == {"30 l/min?", "90 mm?", "10 min?"}
        assert tab.field("age").get_attribute("placeholder") == "0 min"
        assert tab.page.locator('#tests a[tabindex="0"]').count() == 1
        tab.page.locator('[data-test="wall"]').focus()
        tab.page.keyboard.press("ArrowRight")
        assert tab.page.evaluate("document.activeElement.dataset.test") == "printing"
        x = tab.page.evaluate(  # in a period of 100
            "import('/static/stage.js').then(({Stage}) => [...Stage.prototype.now.call({"
            "frames: [{t: 0, x: [90, 10, 1]}, {t: 1, x: [10, 30, 1]}], film: 0.5,"
            "scene: {periodic: true, low: [0, 0], high: [1, 1], unit: 0.01}}).x])"
        )
        assert x == [100.0, 20.0, 1.0], "the nearer way, across the end of the period"
        assert tab.wrong == []


@pytest.mark.parametrize(
    ("test", "lengths"),
    [("l_box", ["70 cm", "20 cm", "60 cm"]), ("flow_table", ["70 cm", "20 cm"]), ("vane", ["10 cm", "10 cm"])],
)
def test_a_vessel_has_its_lengths_a_round_one_its_diameter_and_a_section_no_depth(test, lengths):
    assert [each["text"] for each in beginning(catalogue.build(test))["film"]["dimensions"][0]] == lengths


def test_a_first_layer_is_drawn_whole_at_the_end_of_its_nozzle():
    """A column 40 mm wide, of which a quarter is computed; the nozzle as long as it is wide."""
    drawn = beginning(catalogue.build("printing", model="column"))
    for low, step in zip(drawn["film"]["low"][:2], drawn["film"]["step"][:2], strict=True):
        assert low + 0.5 * 4095 * step == pytest.approx(0.0, abs=1e-3)
        assert 4095 * step == pytest.approx(0.04, abs=0.005), "a lattice of 5 mm"
    assert max(z for z in drawn["outline"][2] if z is not None) == pytest.approx(0.04)


LIST = "mix,slump [cm],spread [mm],note\nfive,17.99,319.3,<b>dry\nfar,15,600,\nmisread,20,200,=1\n"


@needs_chromium
def test_a_dropped_list_gives_the_table_of_the_command_line_with_reasons_chart_and_download(tmp_path):
    """As CSV, chosen and dropped, and as an Excel sheet; what is no list says so at its field."""
    book, lines = pytest.importorskip("openpyxl").Workbook(), [line.split(",") for line in LIST.splitlines()]
    for line in lines:
        book.active.append(line)
    book.active["D4"].data_type = "s"  # no formula
    book.save(tmp_path / "mixes.xlsx")
    (tmp_path / "mixes.csv").write_text(LIST)
    assert mps.main(["calibrate", "--table", str(tmp_path / "mixes.csv")]) == 0
    with serving(tmp_path) as (port, server), chromium() as browser:
        tab = Tab(browser, port, "#calibrate")
        tab.field("list").set_input_files({"name": "notes.csv", "mimeType": "text/csv", "buffer": b"a,b\n1,2\n"})
        tab.page.locator("#list-wrong", has_text="notes.csv: Has no column slump").wait_for()
        for name in ("mixes.csv", "mixes.xlsx"):
            tab.field("list").set_input_files(tmp_path / name)
            tab.part("verdicts", "3 mixes: 1 fitted, 1 two answers, 1 refused").wait_for()
            with tab.page.expect_download() as given:
                tab.press("save-list")
            assert Path(given.value.path()).read_text() == (tmp_path / "mixes-calibrated.csv").read_text()
            assert re.search(r"five\s+fitted\s+\d+ \(\d+ to \d+\)[^$]+alone says", tab.part("list").inner_text())
            assert tab.part("list-chart").evaluate("image => image.decode().then(() => image.naturalWidth)") > 500
            tab.page.reload()
            tab.field("list").wait_for()
        tab.page.evaluate(
            "text => { const dataTransfer = new DataTransfer();"
            "dataTransfer.items.add(new File([text], 'dropped.csv'));"
            "const drop = new DragEvent('drop', {dataTransfer, bubbles: true, cancelable: true});"
            "document.getElementById('calibrate').dispatchEvent(drop) }",
            LIST,
        )
        tab.part("verdicts", "3 mixes").wait_for()
        assert tab.wrong == []


def test_a_resident_answers_is_started_again_when_it_dies_and_ends_when_nobody_asks():
    async def said(resident, **values):
        return [part async for part in resident.ask({"test": "slump", "values": values})]

    async def course():
        resident = Resident("forecast", idle=3600.0)
        first = await said(resident, yield_value="-3")
        begun = resident.process
        os.kill(begun.pid, signal.SIGKILL)
        await begun.wait()
        again = await said(resident, yield_value="-3")
        asking = asyncio.create_task(said(resident))
        while not resident.unanswered:
            await asyncio.sleep(0.01)
        resident.process.kill()  # while it is asked
        told = await asking
        resident.idle = 0.2
        await said(resident, yield_value="-3")
        failing = await said(Resident("nothing"))
        return first, again, told, failing, await resident.process.wait()

    first, again, told, failing, code = asyncio.run(course())
    assert first == again and first[0]["wrong"].keys() == {"yield_value"} and first[-1] == {"end": True}
    assert told[0] == {"remark": RESTARTED} and told[-2]["space"]
    assert code == 0, "it ended by itself"
    assert failing[-1]["wrong"].endswith("asked for this: KeyError: 'nothing'")


def test_nobody_waits_for_the_preview_of_a_mix_that_was_moved_on():
    """A new request cancels the preview of an older one while it computes."""

    async def course():
        resident = Resident("preview")
        try:
            asked = resident.ask({"test": "slump", "values": {"yield_value": "0", "plastic_viscosity": "500"}})
            async for part in asked:  # 5 s of flow
                if part.get("t", 0.0) > 0.1:
                    break
            await asked.aclose()
            newer = [part async for part in resident.ask({"test": "slump", "values": {"yield_value": "2000"}})]
            return part["t"], [part for part in newer if "t" in part], newer[-2]["result"]
        finally:
            await resident.close()

    reached, pictures, result = asyncio.run(course())
    assert reached < 1.0 and pictures[0]["t"] == 0.0 and result["m"]["slump_m"][0] < 0.01


def told_of(scene):
    """What the summary of a run says besides its results."""
    seconds = dict.fromkeys(("wall_seconds", "cpu_seconds", "compile_seconds"), 1.0)
    return Problem(scene).facts() | seconds | {"simulated_seconds": 0.01, "volume_error_max": 0.0, "left_out": 0.0}


def with_results(**changes):
    """Write another summary into a run folder, with its right checksum."""
    return lambda folder: folder.write_summary(folder.read_summary() | changes)


def pipe(path):
    """Put a pipe in the place of a file, which nobody fills."""
    path.unlink(missing_ok=True)
    os.mkfifo(path)


ODD = {  # what is odd in a run folder, and what is said when it is chosen; the last is made by the product itself
    "huge number": (with_results(slump_m=10**400), "It runs, was cut off"),
    "text for mixes": (with_results(materials="abc"), "It runs, was cut off"),
    "many measures": (with_results(**{f"reach_{k}_m": 0.5 for k in range(20_000)}), "more, see summary.json"),
    "no JSON": (lambda folder: folder.summary.write_text("[" * 100_000), "It runs, was cut off"),
    "pipe for summary": (lambda folder: pipe(folder.path / "summary.json"), "It runs, was cut off"),
    "pipe for picture": (lambda folder: pipe(folder.path / "frames/frame_00007.png"), "The results lie in"),
    "pipe for history": (lambda folder: pipe(folder.path / "history.csv"), "The results lie in"),
    "\udcff": (lambda folder: None, "The results lie in"),
}


@needs_chromium
def test_an_odd_run_folder_is_a_row_that_says_so_and_the_others_stay(tmp_path):
    for name, (spoil, _) in ODD.items():
        folder, sim, recorder = recorded(tmp_path / name, 1)
        sim.facts = lambda sim=sim, results=sim.facts: told_of(sim.scene) | results()
        recorder.finish("time")
        spoil(folder)
    (tmp_path / "mark").mkdir()
    os.mkfifo(tmp_path / "mark" / "taichi_mps.json")
    with serving(tmp_path) as (port, server), chromium() as browser:
        assert answer(port, "/runs/%FF/summary.json").status == 200
        assert answer(port, "/runs/mark/summary.json").status == 404
        tab = Tab(browser, port, "#runs")
        rows = tab.page.locator(".row")
        rows.nth(len(ODD) - 1).wait_for()
        assert rows.count() == len(ODD)
        for name, (_, said) in ODD.items():
            rows.filter(has_text=plain(name)).locator(".what a").click()
            tab.part("run", said).wait_for()
            tab.page.go_back()
        rows.filter(has_text=plain("\udcff")).locator('[data-action="delete"]').wait_for()
        tab.page.on("dialog", lambda dialog: dialog.accept("another name" if dialog.type == "prompt" else None))
        rows.filter(has_text="pipe for picture").locator('[data-action="rename"]').click()
        rows.filter(has_text="another name").locator('[data-action="delete"]').click()
        tab.page.locator("details.bin", has_text="Bin (1)").wait_for()
        assert (tmp_path / ".bin" / "another name" / "summary.json").is_file() and rows.count() == len(ODD) - 1
        assert tab.wrong == []


FOREIGN = "http://evil.example", "null", "https://127.0.0.1"


def answer(port, path="/", body=None, **headers):
    """The answer to a request with these headers; with a body it is a question."""
    line = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
    line.request("GET" if body is None else "POST", path, body, headers)
    return line.getresponse()


JSON = {"Content-Type": "application/json"}
OUTSIDE = (
    "run/checkpoint.h5",
    "run/frames/../../secret.json",
    "run/../secret.json",
    "..%2Fsecret.json/x",
    "%2e%2e/summary.json",
    "./secret.json",
    "%00/summary.json",
    f"{'a' * 300}/summary.json",
    "run/%00",
)
PARTS = st.sampled_from(
    ["", "..", ".", "%2e%2e", "..%2f", "%00", "%ff", "\\", "a" * 3000, "~", "*", "{}", "?", ";", "%C3%A9", "run"]
    + ["secret.json", "checkpoint.h5", "summary.json", "report.html", "frames/frame_00000.png", "history.csv"]
)
ASKED = st.sampled_from(
    ["result", "stop", "list", "show", "compare", "draw", "resume", "rename", "delete", "restore", "calibrate", "jobs"]
    + ["calibrate_list"]
)
BODIES = st.sampled_from([b"[", b"[" * 5000, b"\xff", b"{}" * 3, b"1e999", b'{"job":1' + b"0" * 5000 + b"}"])
TEXTS = st.sampled_from(["-1", "nan", "1e400", "\x00", "\u202e", "../run", "<b>x</b>", "", "9" * 5000])
VALUES = TEXTS | st.sampled_from([None, True, -1, 1e300, [], [1, 2], {}, {"slump": 1}, float("nan")])
KEYS = {
    "file": VALUES,
    "test": VALUES,
    "to": VALUES,
    "job": VALUES,
    "check": VALUES,
    "more": VALUES,
    "names": st.lists(PARTS) | VALUES,
}
FIELDS = st.sampled_from(["yield_value", "spacing", "model", "slump", "spread", "scheme", "out", "threads", ""])
KEYS["values"] = st.dictionaries(FIELDS, TEXTS, min_size=1) | VALUES
QUESTIONS = BODIES | st.fixed_dictionaries({}, optional=KEYS).map(json.dumps)
ODD_HEADERS = {
    "Range": "bytes=-1|bytes=9-1|bytes=0-0,1-1,2-2|" + "b" * 999 + "|bytes=" + "0-1," * 500,
    "Cookie": "session=" + "A" * 4000 + "|a=b; a=c|\x01",
    "X-Forwarded-Prefix": '/evil|"><script>',
    "If-Modified-Since": "yesterday|0",
}
HEADERS = st.sampled_from([{}, *({name: text} for name, them in ODD_HEADERS.items() for text in them.split("|"))])


def test_only_this_machine_and_its_own_page_are_served(tmp_path):
    run = tmp_path / "run"
    (run / "frames").mkdir(parents=True)
    for name in ("summary.json", "checkpoint.h5", "taichi_mps.json", "report.html", "frames/frame_00000.png"):
        (run / name).write_text(json.dumps({"made_by": "somebody" if name == "checkpoint.h5" else "taichi_mps"}))
    (tmp_path / "secret.json").write_text("somebody")
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
        for kind, status in {"application/json": 200, "text/plain": 403, None: 403}.items():  # what a form can send
            sent = {} if kind is None else {"Content-Type": kind}
            assert answer(port, "/ask/jobs", "{}", **sent).status == status
        for origin in FOREIGN:
            assert answer(port, "/ask/empty", "{}", **JSON, Origin=origin).status == 403
        assert answer(port, "/ask/jobs", json.dumps({"to": "x" * 10**5}), **JSON).status == 413
        assert answer(port, "/ask/serve", "{}", **JSON).status == answer(port, "/static/..%2Fpage.py").status == 404
        code = tmp_path / "code.py"
        code.write_text(f"open({str(tmp_path / 'ran')!r}, 'w')")
        questions = {"test": str(code), "names": ["."]}, {"values": {"out": "/"}, "names": [".."]}, {"values": []}, []
        for what, asked in ((what, asked) for what in ("run", "preview", "show", "rename") for asked in questions):
            got = answer(port, f"/ask/{what}", json.dumps(asked), **JSON)
            assert got.status == 200 and b"wrong" in got.read(), (what, asked)
        assert not (tmp_path / "ran").exists() and (tmp_path / "run").is_dir()

        report = answer(port, "/runs/run/report.html")
        assert (report.status, report.headers["Content-Disposition"]) == (200, 'attachment; filename="run-report.html"')
        assert (
            answer(port, "/report/run")
            .headers["Content-Security-Policy"]
            .startswith("sandbox allow-scripts allow-downloads; default-src 'unsafe-inline'")
        )
        assert "script" not in answer(port).headers["Content-Security-Policy"], "none but those of the page itself"
        shown = {f"run/{name}": 200 for name in ("summary.json", "frames/frame_00000.png")}
        shown |= dict.fromkeys((*OUTSIDE, "run/frame_00000.png", "run/history.csv"), 404)
        assert {path: answer(port, f"/runs/{path}").status for path in shown} == shown

        listening = Path(f"/proc/{server.pid}/net/tcp").read_text() + Path(f"/proc/{server.pid}/net/tcp6").read_text()
        assert re.findall(rf"\b(\w+):{port:04X} 0+:0000 0A", listening) == ["0100007F"]  # 127.0.0.1 alone
        assert mps.main(["app", "--no-browser", "--port", str(port)]) == 2  # taken

        @settings(max_examples=50, deadline=None)
        @given(
            st.sampled_from(["runs", "runs/run", "report", "static"]), st.lists(PARTS, min_size=1, max_size=3), HEADERS
        )
        def discloses_nothing_of_others(place, parts, headers):
            got = answer(port, "/".join(["", place, *parts]), **headers)
            assert got.status < 500 and b"somebody" not in got.read()

        @settings(max_examples=50, deadline=None)
        @given(ASKED, QUESTIONS)
        def answers_any_question(what, body):
            got = answer(port, f"/ask/{what}", body, **JSON)
            assert got.status in (200, 404, 413) and b"somebody" not in got.read()

        discloses_nothing_of_others()
        answers_any_question()


def test_without_the_token_nothing_is_read_or_changed(tmp_path):
    """Whoever lacks the token of the address gets one line: for the page, its code, a file and a report of a run, each
    question and the preview; and a run stays where it is. The token gives a cookie, and with that all is there."""
    from taichi_mps.app.server import NO_TOKEN

    recorded(tmp_path / "run", 1, "time")
    asked = [
        ("/ask/delete", '{"names": ["run"]}'),
        ("/ask/preview", "{}"),
        ("/ask/list", "{}"),
        ("/ask/serve", "{}"),
    ] + [(path, None) for path in ("/", "/static/page.js", "/runs/run/summary.json", "/report/run", "/docs")]
    with serving(tmp_path, TOKEN) as (port, _):
        name = f"taichi_mps_{port}"
        for cookie in ("", f"{name}=", f"{name}={TOKEN}1", f"{name}=\xff", f"another={TOKEN}"):
            for path, body in [*asked, ("/?token=", None), ("/?token=%FF", None), (f"/?token={TOKEN}1", None)]:
                got = answer(port, path, body, **JSON, Cookie=cookie)
                assert (got.status, got.read()) == (403, NO_TOKEN.encode()), (path, cookie)
        assert (tmp_path / "run" / "summary.json").is_file()
        assert answer(port, f"/?token={TOKEN}", Host="evil.example").status == 403
        got = answer(port, f"/?token={TOKEN}")
        assert (got.status, got.headers["Location"], got.read()) == (303, "/", b"")
        kept, *settings = got.headers["Set-Cookie"].split("; ")
        assert kept == f"{name}={TOKEN}" and set(settings) == {"HttpOnly", "Path=/", "SameSite=strict"}
        own = JSON | {"Cookie": kept}
        assert [answer(port, path, body, **own).status for path, body in asked[2:]] == [
            200,
            404,
            200,
            200,
            200,
            404,
            404,
        ]
        assert answer(port, *asked[0], **own, Origin="http://evil.example").status == 403
        assert answer(port, *asked[0], **own).status == 200 and not (tmp_path / "run").exists()


def test_what_starts_the_browser_is_good_once():
    """The list of processes shows with which address a browser was started: a second one is refused with it."""
    from starlette.requests import Request
    from starlette.responses import PlainTextResponse

    from taichi_mps.app.server import OnlyHere

    only, home = OnlyHere(None, 80, TOKEN, "once"), AsyncMock(return_value=PlainTextResponse("home"))
    head = {"type": "http", "method": "GET", "path": "/", "headers": [(b"host", b"127.0.0.1:80")]}
    asked = [Request(head | {"query_string": b"token=" + word}) for word in (b"once", b"once", b"", TOKEN.encode())]
    assert [asyncio.run(only.dispatch(request, home)).status_code for request in asked] == [303, 403, 403, 303]


def test_its_end_is_silent_about_a_preview_under_way(tmp_path):
    with serving(tmp_path) as (port, _):
        line = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
        line.request("POST", "/ask/preview", json.dumps({"test": "slump", "values": {}}), JSON)
        assert line.getresponse().status == 200  # begun: its result takes some seconds


def test_without_the_extra_it_says_how_to_get_it(monkeypatch, command):
    monkeypatch.setattr("taichi_mps.units.find_spec", lambda name: None)
    assert command("app") == (2, "", "taichi-mps: app needs starlette: pip install 'taichi-mps[app]'\n")
