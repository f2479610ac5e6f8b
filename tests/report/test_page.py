"""report.html, opened from the disk in a headless Chromium, shows the content of the run folder."""

import re
import shlex
import shutil
import zlib
from pathlib import Path

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.forecast import accuracy
from taichi_mps.input.labels import title, written
from taichi_mps.io.history import read_history
from taichi_mps.io.run_folder import RunFolder
from taichi_mps.io.vtkhdf import Trajectory
from taichi_mps.report import drawings, inputs, page, sentences
from taichi_mps.report.verdict import verdict
from taichi_mps.viz.body import surface_of
from tests.support.browser import chromium, needs_chromium, opened
from tests.support.child import ROOT, child

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
    assert set(words[2:]) == {"--model=quarter", "--spacing=0.02", "--yield-stress=500", "--until=0.4", "--every=0.05"}
    rate = inputs.fields_of("wall")["rate"]
    assert [inputs.shorter(value, rate) for value in (10.0 / 6e4, 0.1234567890123)] == ["10 l/min", 0.1234567890123]
    record = page.RunRecord(run, None, None)
    assert shlex.split(page.repeat_command(record))[1:] == words[1:], "the time limit that was given"
    record.summary["parameters"]["until"] = None
    assert "--until=0.4" in page.repeat_command(record), "it went on to another"
    record.summary["simulated_seconds"] = 120.0
    assert "--until" not in page.repeat_command(record), "that of the scene"
    fields = inputs.fields_of("block.py", ROOT / "scenes" / "slump.py")
    assert shlex.split(inputs.command("block.py", run.read_summary(), 0.05, None, fields)) == [
        "run",
        "block.py",
        *words[2:],
    ], "its file"
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


@needs_chromium
def test_the_section_is_where_the_surface_meets_the_middle_plane(tab):
    """Closed lines on the mesh of the last output, none below the floor; of a cube of two triangles a side, a closed
    square."""
    lines = tab.evaluate("sliced(state.meshes.at(-1), data.section.middle, data.floor)")
    x, z = np.transpose(max(lines, key=len))
    assert np.ptp(x) == pytest.approx(
        np.ptp(np.reshape(tab.evaluate("[...state.meshes.at(-1).at]"), (-1, 3))[:, 0]), rel=0.02
    )
    assert z.min() == tab.evaluate("data.floor") and tab.locator("#section .particles").count() == 0
    at = [float(k) for corner in np.ndindex(2, 2, 2) for k in corner]
    sides = [0, 1, 3, 0, 3, 2, 4, 7, 5, 4, 6, 7, 0, 4, 5, 0, 5, 1, 2, 3, 7, 2, 7, 6, 0, 2, 6, 0, 6, 4, 1, 5, 7, 1, 7, 3]
    (square,) = tab.evaluate(f"sliced({{at: {at}, triangles: {sides}}}, 0.25, null)")
    (x, z), corners = np.transpose(square), {tuple(place) for place in square}
    assert {(0, 0), (0, 1), (1, 0), (1, 1)} < corners and len(square) == len(corners)
    assert 0.5 * abs(np.dot(x, np.roll(z, 1)) - np.dot(z, np.roll(x, 1))) == pytest.approx(1.0)


@needs_chromium
def test_results_and_curves_are_saved_and_a_pointer_reads_them(run, tab):
    summary, history = run.read_summary(), read_history(run.history)
    files = []
    for button in ("results", "curves"):
        with tab.expect_download() as download:
            tab.click(f"#save-{button}")
        files.append(Path(download.value.path()).read_text().splitlines())
    results, curves = ([line.split(",") for line in lines] for lines in files)
    error = f"{max(1.0, 1e3 * summary['slump_expected_error_m']):.0f}"
    assert results[1][:4] == ["slump", f"{100 * summary['slump_m']:.1f}", "cm", error]
    assert curves[0] == ["time [s]", "slump [cm]", "slump flow [cm]", "fraction flowing [%]"]
    assert [float(cell) for cell in curves[-1][:2]] == pytest.approx(
        [history["time_s"][-1], 100 * summary["slump_m"]], rel=1e-4
    )
    chart = tab.locator("#charts svg").first
    chart.hover(position={"x": chart.bounding_box()["width"] - 12, "y": 60})
    read = re.split("[:,]", chart.locator(".read").text_content())
    assert float(read[1]) == pytest.approx(100 * summary["slump_m"], rel=5e-3)  # three digits


STANDARD = {"height": 0.3, "base_diameter": 0.2, "top_diameter": 0.1}
FORM = {"height": 0.4, "fill_ratio": 0.95, "spacing": 0.02}


@pytest.mark.parametrize(
    ("scene", "known", "results", "told"),
    [
        (
            "slump",
            STANDARD,
            {"slump_max_m": 0.194, "spread_m": 0.33},
            "Class S4 of EN 206: slump at the highest point 19.4 cm.",
        ),
        ("slump", STANDARD, {"slump_max_m": 0.27, "spread_m": 0.655}, "Class SF2 of EN 206: slump flow 65.5 cm."),
        ("slump", {}, {"slump_max_m": 0.194}, "Not at rest after 10.6 s."),
        ("mini_cone", {}, {"spread_m": 0.3, "stopped_by": "rest"}, "At rest after 10.6 s."),
        ("slump", STANDARD, {"slump_max_m": 0.194, "stopped_by": "interrupted"}, ""),
        (
            "l_box",
            {"bars": "3"},
            {"passing_ratio": 0.7},
            "Does not pass so far: passing ratio H2/H1 0.700, EN 206 asks for 0.80.",
        ),
        (
            "j_ring",
            {},
            {"blocking_step_m": 0.004},
            "Passes as a fluid, without grains that jam: blocking step 0.4 cm, EN 206 allows 1 cm.",
        ),
        (
            "u_box",
            {"bars": "yes"},
            {"h2_m": 0.25, "stopped_by": "rest"},
            "Does not pass: height H2 25.0 cm, JSCE asks for 30 cm.",
        ),
        ("v_funnel", {}, {"flow_time_s": None, "left_m3": 0.004}, "Does not run out: 4 l are left in the funnel."),
        ("printing", {}, {"failure_height_m": 0.231, "height_m": 0.2}, "Collapses at 23.1 cm."),
        ("printing", {}, {"failure_height_m": None, "height_m": 0.2}, "Stands: 20.0 cm high."),
        (
            "wall",
            FORM,
            {"filled_ratio": 0.56, "near_m": 0.46, "far_m": 0.0},
            "Does not fill: 56 % after 10.6 s, the far end is empty; the concrete stands 6 cm above the rim at the "
            "hose: it overflows.",
        ),
        (
            "wall",
            {"form": "pit.stl", "fill_ratio": 0.95},
            {"filled_ratio": 0.7, "above_m3": 2e-3, "poured_m3": 0.02, "stopped_by": "rest"},
            "Does not fill: 70 % after 10.6 s; 2 l stand above the rim: it overflows.",
        ),
        ("wall", FORM, {"filled_ratio": 0.94, "near_m": 0.39, "far_m": 0.36}, "Fills: 94 % after 10.6 s."),
    ],
)
def test_the_verdict_says_what_a_client_asks(scene, known, results, told):
    run = {"scene": scene, "parameters": known, "stopped_by": "time", "simulated_seconds": 10.6}
    assert verdict(run | results) == told
