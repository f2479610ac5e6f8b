"""report.html, opened from the disk in a headless Chromium, shows the content of the run folder."""

import re
import shlex
import shutil
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.engine.problem.measures import still
from taichi_mps.forecast import accuracy
from taichi_mps.input.labels import title, written
from taichi_mps.io.history import read_history
from taichi_mps.io.run_folder import RunFolder
from taichi_mps.io.vtkhdf import Trajectory
from taichi_mps.report import drawings, inputs, page, sentences
from taichi_mps.viz.body import surface_of
from tests.support.browser import chromium, needs_chromium, opened
from tests.support.child import child
from tests.support.scenes import parts

WORDS = "run slump --model quarter --spacing 0.02 --yield-value 500.0 --every 0.05 --until 0.4"


def computed(folder, *words) -> RunFolder:
    """The folder of a run by the command line, in a process of its own."""
    child("-m", "taichi_mps", *words, "--out", str(folder), "--quiet")
    return RunFolder(folder)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A quarter of a slump cone."""
    return computed(tmp_path_factory.mktemp("report") / "run", *WORDS.split())


@pytest.fixture(scope="module")
def shown():
    """Opens a report in a new tab; in none of them may be an error or a request that leaves the machine."""
    with chromium() as browser:
        found = []

        def show(path, width=1100):
            found.append(opened(browser, Path(path).as_uri(), ("file:", "data:", "blob:"), width))
            found[-1][0].evaluate("ready")
            return found[-1][0]

        yield show
        assert [wrong for _, wrong in found if wrong] == []


@pytest.fixture(scope="module")
def tab(run, shown):
    """The report of the run."""
    return shown(run.report)


@needs_chromium
def test_the_surfaces_and_colours_are_those_of_the_outputs(run, tab):
    outputs = list(Trajectory(run.trajectory).replay())
    times = tab.evaluate("film.times")
    low, step = (np.array(tab.evaluate(f"film.{name}")) for name in ("low", "step"))
    top = tab.evaluate("film.fastest")
    for output in outputs[1:]:
        x, normals, speed, flowing, links = drawings.surface_geometry(output.scene, output.state)
        k = int(np.argmin(np.abs(np.array(times) - output.time)))
        keys = "at", "normal", "shade", "triangles"
        at, normal, shade, rows = (np.array(tab.evaluate(f"[...state.meshes[{k}].{key}]")) for key in keys)
        at, normal, rows = at.reshape(-1, 3), normal.reshape(-1, 3), rows.reshape(-1, 3)
        assert len(at) == len(x) and np.all(low <= x.min(0) + step)
        same = ((at[:, None] - x) ** 2).sum(-1).argmin(1)  # the library of surfaces keeps no order
        assert np.abs(at - x[same]).max() <= 0.501 * step.max()
        assert np.abs(normal - 127 * normals[same]).max() <= 0.501
        assert np.abs(top * (shade & 127) / 127 - speed[same]).max() <= 0.501 * top / 127
        np.testing.assert_array_equal(shade >= 128, flowing[same])
        found, known = (set(map(frozenset, triangles.tolist())) for triangles in (same[rows], links))
        assert found == known


@needs_chromium
def test_a_body_of_rings_is_turned_about_the_axis(shown, tmp_path):
    rings = computed(tmp_path / "rings", *WORDS.replace("quarter", "axisymmetric").split())
    tab, (first, *_, last) = shown(rings.report), Trajectory(rings.trajectory).replay()
    for k, output in ((0, first), (-1, last)):
        known = surface_of(output.scene, output.state, drawings.SURFACE_CELL, ())[0].x
        found = np.reshape(tab.evaluate(f"[...state.meshes.at({k}).at]"), (-1, 3))
        np.testing.assert_allclose(found, known, atol=2e-4)
    assert rings.report.stat().st_size < 5e5


@needs_chromium
def test_the_numbers_are_those_of_the_summary_and_the_history(run, tab):
    summary, history = run.read_summary(), read_history(run.history)
    text = tab.inner_text("main")
    for key in ("slump_m", "spread_m"):
        assert written(key, summary[key]) in text
    assert re.search(r"yield stress\s+500 Pa", text) and re.search(r"particle size\s+20 mm", text)
    known = accuracy.expected("quarter", 0.02 / 0.3, accuracy.MixNumbers.of(500.0, 50.0))
    assert f"20 mm\t{300.0 * known.slump:.1f} mm\t{600.0 * known.reach:.0f} mm\t{known.volume:.1%}" in text
    curves = {curve["name"]: curve for chart in tab.evaluate("data.charts") for curve in chart["curves"]}
    for name, key in (("slump", "slump_m"), ("fraction flowing", "flowing_fraction")):
        known = 100.0 * np.interp(curves[name]["x"], history["time_s"], history[key])
        tolerance = 1e-2 if name == "slump" else 2e-2  # times have four digits, and the second falls steeply
        np.testing.assert_allclose(curves[name]["y"], known, atol=tolerance)
    assert tab.evaluate("document.querySelectorAll('#charts path').length") == 3


@needs_chromium
def test_it_fits_a_phone(run, shown):
    assert shown(run.report, width=390).evaluate("document.documentElement.scrollWidth") <= 390


@needs_chromium
def test_it_opens_moving_and_stops_where_it_is_told(tab):
    tab.wait_for_function("state.playing && 0 < state.output")
    assert tab.inner_text("#play") == "Pause" and tab.inner_text("#pace") == "quarter speed"
    tab.click("#play")
    assert not tab.evaluate("state.playing")
    tab.locator("#time").fill("0")
    assert tab.inner_text("#now") == "0.00 s" and tab.text_content("#over") == "slump flow 20.0 cm"
    tab.locator("#time").fill(str(tab.evaluate("film.times.length - 1")))
    assert tab.inner_text("#now") == "0.40 s"


@needs_chromium
def test_the_dimensions_have_the_measured_lengths_on_the_body(run, tab):
    summary = run.read_summary()
    tab.evaluate("play(false); show(film.times.length - 1)")
    text = tab.text_content("#over")
    assert all(f"{title(key)} {written(key, summary[key])}" in text for key in ("slump_m", "spread_m"))
    ends = tab.evaluate("film.dimensions.at(-1).map(({ a, b }) => Math.hypot(...subtract(a, b)))")
    assert sorted(ends) == pytest.approx(sorted([summary["slump_m"], summary["spread_m"]]), rel=1e-4)


@needs_chromium
def test_it_turns_and_comes_nearer(tab):
    tab.evaluate("play(false); show(film.times.length - 1)")
    view = tab.locator("#view")
    before, picture = tab.evaluate("state.viewer.turn"), view.screenshot()
    view.drag_to(view, source_position={"x": 190, "y": 200}, target_position={"x": 300, "y": 200})
    assert abs(tab.evaluate("state.viewer.turn") - before) > 0.1 and view.screenshot() != picture
    away = "Math.hypot(...subtract(state.viewer.eye, state.viewer.middle))"
    before = tab.evaluate(away)
    tab.click("#nearer")
    assert tab.evaluate(away) == pytest.approx(before / 1.25)


@needs_chromium
def test_without_webgl_it_shows_a_picture(run, shown, tmp_path):
    page_without = tmp_path / "report.html"
    page_without.write_text(run.report.read_text().replace('getContext("webgl2"', 'getContext("none"'))
    tab = shown(page_without)
    assert tab.locator("#still").is_visible() and not tab.locator("#view").is_visible()
    assert "This browser shows no moving film" in tab.inner_text("#why")
    assert tab.evaluate("document.querySelectorAll('#charts path').length") == 3


@needs_chromium
def test_in_print_it_is_one_page(tab):
    pdf = tab.pdf(prefer_css_page_size=True)
    assert len(re.findall(rb"/Type\s*/Page\b", pdf)) == 1


@needs_chromium
def test_text_from_outside_is_shown_as_text(run, shown, tmp_path):
    folder = RunFolder(shutil.copytree(run.path, tmp_path / "run"))
    summary = folder.read_summary()
    summary["scene"] = name = "</script><b id='hurt'>&amp; \u202e"
    summary["parameters"]["model"] = "<i id='hurt'>"
    summary["error"] = summary["note"] = "<u id='hurt'>"
    folder.write_summary(summary)
    tab = shown(page.write(folder))
    assert tab.locator("#hurt").count() == 0
    assert tab.inner_text(".remark") == "<u id='hurt'>"
    tab = shown(page.write(folder, title=name))
    assert tab.locator("#hurt").count() == 0 and tab.inner_text("h1") == name.replace("\u202e", "\\u202e")


@needs_chromium
def test_a_killed_run_has_its_page(run, shown, tmp_path):
    folder = RunFolder(shutil.copytree(run.path, tmp_path / "a run"))
    folder.summary.unlink()
    tab = shown(page.write(folder))
    last = read_history(folder.history)["slump_m"][-1]
    text = tab.inner_text("main")
    assert "This run has not ended: it has reached 0.40 s" in text and written("slump_m", last) in text
    assert f"taichi-mps resume '{folder.path}'" in text
    assert tab.evaluate("state.meshes.at(-1).triangles.length") > 0


def test_the_command_names_what_is_not_by_default(run):
    words = shlex.split(inputs.command("slump", run.read_summary(), 0.05))
    assert words[:2] == ["run", "slump"]
    known = "--model=quarter --spacing=0.02 --yield-stress=500 --until=0.4 --every=0.05"
    assert sorted(words[2:]) == sorted(known.split())
    record = page.RunRecord(run, None, None)
    assert shlex.split(page.repeat_command(record))[1:] == words[1:], "the time limit that was given"
    record.summary["parameters"]["until"] = None
    assert "--until=0.4" in page.repeat_command(record), "it went on to another"
    record.summary["simulated_seconds"] = 120.0
    assert "--until" not in page.repeat_command(record), "that of the scene"
    other = {
        "parameters": {"side": 0.5, "far": None, "rise": 0.0},
        "scheme": "semi-implicit",
        "stopped_by": "rest",
        "numerics": mps.SemiImplicit(literal=True).model_dump(),
        "backend": {"precision": "f64", "arch": "cpu"},
    }
    known = "run block.py --side=0.5 --rise=0 --scheme=semi-implicit --literal"
    assert inputs.command("/home/me/block.py", other, None) == f"{known} --precision=f64"


def test_what_does_not_fit_is_left_out_evenly(run):
    trajectory = Trajectory(run.trajectory)
    outputs = list(trajectory.replay())
    scene, history = outputs[0].scene, read_history(run.history)
    whole, _ = drawings.film_data(trajectory, scene, history)
    assert whole["outputs"] == len(outputs) == 9 and len(whole["times"]) == 17  # one between each two of them
    packed = drawings.pack(
        *drawings.surface_geometry(scene, outputs[-1].state),
        1.0,
        *drawings.position_scale([drawings.surface_geometry(scene, outputs[-1].state)]),
    )
    fewer, last = drawings.film_data(trajectory, scene, history, 4.2 * len(zlib.compress(b"".join(packed.values()))))
    np.testing.assert_allclose(fewer["times"], [outputs[k].time for k in (0, 3, 5, 8)], atol=1e-6)
    np.testing.assert_array_equal(last.x, outputs[-1].state.x)


@pytest.mark.parametrize(
    ("summary", "told"),
    [
        ({"torque_N_m": 0.5, "lag_s": None, "gap_m": 0.02, "depth_m": 0.3}, "Torque 0.5 N m, gap 2.0 cm."),
        ({"torque_N_m": 0.5, "gap_m": 0.02, "spread_m": 0.6}, "Slump flow 60.0 cm."),
        ({"lag_s": None}, "Nothing was measured."),
    ],
)
def test_the_first_sentence_tells_the_scenes_own_results_where_it_has_none_of_a_known_test(summary, told):
    assert sentences.main_results({"stopped_by": "time", "cpu_seconds": 1.0, **summary}) == told


def test_the_section_of_a_block_is_its_middle_layer():
    scene = mps.Scene(**parts(3))
    part = still(scene.fluid, scene.spacing)
    x, size, _ = drawings.middle_section(part, scene)
    assert len(x) == 25 and np.all(size == scene.spacing)
    drawn = drawings.section(part, scene)
    assert drawn["place"].endswith("y = 25 cm")
    assert np.nanmax(np.array(drawn["across"], float)) == pytest.approx(0.5)
    np.testing.assert_allclose(drawn["surface"][1], 0.5)


def test_the_section_of_a_cone_ends_at_the_floor():
    scene = mps.slump_cone(model="quarter", spacing=0.02)
    (across, *_, end), (up, *_, down) = drawings.section(replace(still(scene.fluid, 0.02), time=1.0), scene)["surface"]
    assert across == pytest.approx(-end) and up == down == pytest.approx(0.0, abs=1e-9)
