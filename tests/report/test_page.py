"""report.html, opened from the disk in a headless Chromium: what it shows is what the run folder holds."""

import base64
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.cli import console
from taichi_mps.io.history import read_history
from taichi_mps.io.run_folder import RunFolder
from taichi_mps.io.vtkhdf import Trajectory
from taichi_mps.problem import accuracy
from taichi_mps.problem.labels import written
from taichi_mps.problem.measures import still
from taichi_mps.report import drawings, inputs, page, sentences
from tests.support.browser import chromium, needs_chromium, opened
from tests.support.child import child
from tests.support.scenes import parts

EYE = "Object.values(view.layout.scene.camera.eye)"
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


def whole(folder):
    """Snapshots of the whole body at all outputs."""
    return [output.scene.unfold(output.state) for output in Trajectory(folder.trajectory).replay()]


@needs_chromium
def test_positions_and_colours_are_those_of_run_h5(run, tab):
    known = whole(run)
    drawn = tab.evaluate("film.times.map((_, k) => particles(k))")
    low, step = (np.array(tab.evaluate(f"film.{name}")) for name in ("low", "step"))
    top = max(s.speed.max() for s in known)
    assert step.max() < 1e-5 and np.all(low <= known[0].x.min(0) + 1e-9)
    np.testing.assert_allclose(tab.evaluate("film.times"), [s.time for s in known], atol=1e-6)
    for found, s in zip(drawn, known, strict=True):
        x = np.stack([found[axis] for axis in "xyz"], 1)
        assert np.all(np.abs(x - s.x) <= 0.5001 * step)
        assert np.abs(np.array(found["colour"]) - s.speed).max() <= 0.501 * top / 127
    tab.select_option("#colour", "flowing")
    drawn = tab.evaluate("film.times.map((_, k) => particles(k).colour)")
    for found, s in zip(drawn, known, strict=True):
        np.testing.assert_array_equal(np.array(found, bool), 50.0 * s.shear_rate > 0.05 * 500.0)


@needs_chromium
def test_the_numbers_are_those_of_the_summary_and_the_history(run, tab):
    summary, history = run.read_summary(), read_history(run.history)
    text = tab.inner_text("main")
    for key in ("slump_m", "spread_m"):
        assert written(key, summary[key]) in text
    assert "yield stress\t500 Pa" in text and "particle size\t20 mm" in text
    known = accuracy.expected("quarter", 0.02 / 0.3, accuracy.Mix.of(500.0, 50.0))
    assert f"20 mm\t{300.0 * known.slump:.1f} mm\t{600.0 * known.reach:.0f} mm\t{known.volume:.1%}" in text
    curves = {curve["name"]: curve for chart in tab.evaluate("data.charts") for curve in chart["curves"]}
    for name, key in (("slump", "slump_m"), ("share flowing", "flowing_fraction")):
        known = 100.0 * np.interp(curves[name]["x"], history["time_s"], history[key])
        tolerance = 1e-2 if name == "slump" else 2e-2  # times have four digits, and the second falls steeply
        np.testing.assert_allclose(curves[name]["y"], known, atol=tolerance)
    assert tab.evaluate("[...document.querySelectorAll('.chart')].map((place) => place.data.length)") == [2, 1]


@needs_chromium
def test_it_fits_a_phone(run, shown):
    assert shown(run.report, width=390).evaluate("document.documentElement.scrollWidth") <= 390


@needs_chromium
def test_it_plays_to_the_end(tab):
    last = tab.evaluate("film.times.length - 1")
    assert tab.evaluate("state.output") == last and tab.inner_text("#now") == "t = 0.40 s"
    tab.click("#play")
    tab.wait_for_function("0 < state.output && state.output < film.times.length - 1")
    assert tab.inner_text("#play") == "Pause"
    tab.wait_for_function("!state.playing && state.output === film.times.length - 1 && !state.drawing")
    assert tab.inner_text("#play") == "Play"
    np.testing.assert_allclose(tab.evaluate("Array.from(view.data[0].z)"), tab.evaluate(f"particles({last}).z"))


@needs_chromium
def test_it_turns_and_comes_nearer(tab):
    view = tab.locator("#view")
    before, size, picture = tab.evaluate(EYE), tab.evaluate("view.data[0].marker.size"), view.screenshot()
    view.drag_to(view, source_position={"x": 190, "y": 200}, target_position={"x": 300, "y": 200})
    tab.wait_for_function(f"Math.abs(view.layout.scene.camera.eye.x - {before[0]}) > 0.1")
    turned = tab.evaluate(EYE)
    assert np.linalg.norm(turned) == pytest.approx(np.linalg.norm(before), rel=1e-3) and view.screenshot() != picture
    tab.click("#nearer")
    tab.wait_for_function(f"view.data[0].marker.size > 1.2 * {size}")
    assert np.linalg.norm(tab.evaluate(EYE)) < 0.81 * np.linalg.norm(before)


@needs_chromium
@pytest.mark.parametrize(("axis", "keeps", "at"), [("x", -1, 50), ("y", 1, 50), ("z", -1, 20)])
def test_a_cut_takes_away_what_is_before_it(run, tab, axis, keeps, at):
    s = whole(run)[-1]
    tab.select_option("#cut", "")
    tab.wait_for_function(f"view.data[0].x.length === {len(s.x)}")
    tab.select_option("#cut", axis)
    tab.locator("#place").fill(str(at))
    tab.wait_for_function(f"view.data[0].x.length < {len(s.x)}")
    place, left = tab.evaluate("place()"), np.array(tab.evaluate(f"Array.from(view.data[0].{axis})"))
    assert np.all(keeps * (left - place) >= 0.0)
    assert len(left) == pytest.approx(np.count_nonzero(keeps * (s.x[:, "xyz".index(axis)] - place) >= 0.0), abs=2)


@needs_chromium
def test_text_from_outside_is_shown_as_text(run, shown, tmp_path):
    folder = RunFolder(shutil.copytree(run.path, tmp_path / "run"))
    summary = folder.read_summary()
    summary["scene"] = name = "</script><b id='hurt'>&amp; \u202e"
    summary["parameters"]["model"] = "<i id='hurt'>"
    summary["error"] = "<u id='hurt'>"
    folder.write_summary(summary)
    tab = shown(page.write(folder))
    assert tab.locator("#hurt").count() == 0
    assert tab.inner_text("h1") == name.replace("\u202e", "\\u202e") + ": report of a run"


@needs_chromium
def test_a_killed_run_has_its_page(run, shown, tmp_path):
    folder = RunFolder(shutil.copytree(run.path, tmp_path / "a run"))
    folder.summary.unlink()
    tab = shown(page.write(folder))
    last = read_history(folder.history)["slump_m"][-1]
    text = tab.inner_text("main")
    assert "This run has not ended: it has reached 0.40 s" in text and written("slump_m", last) in text
    assert f"taichi-mps resume '{folder.path}'" in text
    assert tab.evaluate("view.data[0].x.length") > 0


def test_the_command_names_what_is_not_by_default(run):
    words = shlex.split(inputs.command("slump", run.read_summary(), 0.05))
    assert words[:2] == ["run", "slump"]
    known = "--model=quarter --spacing=0.02 --yield-stress=500 --until=0.4 --every=0.05"
    assert sorted(words[2:]) == sorted(known.split())
    other = {"parameters": {"side": 0.5, "far": None, "rise": 0.0}, "scheme": "semi-implicit", "stopped_by": "rest"}
    other |= {"numerics": mps.SemiImplicit(literal=True).model_dump(), "backend": {"precision": "f64", "arch": "cpu"}}
    known = "run block.py --side=0.5 --rise=0 --scheme=semi-implicit --literal --source=density --gradient=literal"
    assert inputs.command("/home/me/block.py", other, None) == f"{known} --precision=f64"


def filmed(run, room):
    """The film of a run in so many bytes, and the positions at its first output."""
    trajectory, scene = Trajectory(run.trajectory), next(Trajectory(run.trajectory).replay()).scene
    film, _ = drawings.film(trajectory, scene, room)
    codes = np.frombuffer(base64.b64decode(film["positions"]), "<u2").reshape(-1, 3)[: film["counts"][0]]
    return film, film["low"] + np.array(film["step"]) * codes


def test_what_does_not_fit_is_left_out_evenly(run):
    known = whole(run)
    room = 4 * drawings.BYTES * len(known[0].x)
    film, _ = filmed(run, room)
    assert film["outputs"] == len(known) == 9
    np.testing.assert_allclose(film["times"], [known[k].time for k in (0, 3, 5, 8)], atol=1e-6)
    assert 3 * (len(film["positions"]) + len(film["colours"])) <= 4 * (room + 6)


def test_of_many_particles_mirror_images_stay_together(run, monkeypatch):
    monkeypatch.setattr(drawings, "MOST_SHOWN", 300)
    film, x = filmed(run, 10**7)
    assert set(film["counts"]) == {len(x)} and len(x) == pytest.approx(300, abs=8)
    sides = [x[(x[:, 0] > 0) == east][:, 0] for east in (True, False)]
    np.testing.assert_allclose(np.sort(sides[0]), np.sort(-sides[1]), atol=1e-5)


@pytest.mark.parametrize(
    ("summary", "told"),
    [
        ({"torque_N_m": 0.5, "lag_s": None, "gap_m": 0.02, "depth_m": 0.3}, "Torque 0.5 N m, gap 2.0 cm."),
        ({"torque_N_m": 0.5, "gap_m": 0.02, "spread_m": 0.6}, "Slump flow 60.0 cm."),
        ({"lag_s": None}, "Nothing was measured."),
    ],
)
def test_the_first_sentence_tells_the_scenes_own_results_where_it_has_none_of_a_known_test(summary, told):
    assert sentences.measured({"stopped_by": "time", "cpu_seconds": 1.0, **summary}) == told


def test_the_section_of_a_block_is_its_middle_layer():
    scene = mps.Scene(**parts(3))
    part = still(scene.fluid, scene.spacing)
    x, size, _ = drawings.in_the_middle(part, scene)
    assert len(x) == 25 and np.all(size == scene.spacing)
    drawn = drawings.section(part, scene)
    assert drawn["place"].endswith("y = 25 cm")
    assert np.nanmax(np.array(drawn["across"], float)) == pytest.approx(0.5)
    np.testing.assert_allclose(drawn["surface"][1], 0.5)


def test_without_plotly_a_run_ends_well_and_says_how_to_get_its_page(run, monkeypatch, capsys):
    monkeypatch.setattr(page, "find_spec", lambda name: None)
    console.report(run)
    assert (
        capsys.readouterr().err == "taichi-mps: no report.html: report needs plotly: pip install 'taichi-mps[report]'\n"
    )
