"""Run folders and calibrations on the page, tested without a browser."""

import asyncio
import os
import re
import signal
import subprocess
from importlib.util import find_spec, module_from_spec
from types import SimpleNamespace

import pytest

from taichi_mps import __version__
from taichi_mps.app.form import wrong
from taichi_mps.app.jobs import Job, Queue
from taichi_mps.app.page import verdict
from taichi_mps.app.results import Runs
from taichi_mps.io import lock
from taichi_mps.study.calibrate import calibrate
from taichi_mps.units import Checked, Length, SceneError
from tests.support.recorded import recorded


def test_a_short_job_waits_for_no_run(tmp_path):
    async def course():
        jobs = Queue(tmp_path)
        async with jobs.run_lock:  # a run is under way
            short, long = (jobs.add(Job("version", ["--version"], short=short)) for short in (True, False))
            await short.task
            seen = short.state, short.output, long.state
        await jobs.close()
        return seen

    assert asyncio.run(course()) == ("done", __version__, "waiting")


def asked(*names, to=""):
    return SimpleNamespace(names=list(names), to=to)


@pytest.fixture
def runs(tmp_path):
    """Two runs, a folder of somebody else, and a link to a run elsewhere."""
    for path in (tmp_path / "runs" / "one", tmp_path / "runs" / "two", tmp_path / "elsewhere"):
        recorded(path, 1, "time")
    (tmp_path / "runs" / "notes").mkdir()
    (tmp_path / "runs" / "notes" / "mine.txt").write_text("mine")
    (tmp_path / "runs" / "link").symlink_to(tmp_path / "elsewhere")
    return Runs(Queue(tmp_path / "runs"))


def test_only_runs_are_moved_first_into_a_bin_and_never_links(runs, tmp_path):
    place = tmp_path / "runs"
    for name in ("notes", "../elsewhere", "..", "", ".", "one/frames", str(tmp_path / "elsewhere"), "link", "\0"):
        with pytest.raises(SceneError):
            runs.delete(asked(name))
    os.symlink(tmp_path / "elsewhere" / "history.csv", place / "one" / "away")  # a run that holds a link
    runs.delete(asked("one"))
    assert [row["name"] for row in runs.list(asked())["bin"]] == ["one"] and (place / ".bin" / "one").is_dir()
    runs.restore(asked("one"))
    assert (place / "one" / "history.csv").is_file()
    runs.delete(asked("one", "two"))
    (place / ".bin" / "link").symlink_to(tmp_path / "elsewhere")
    (place / ".bin" / "mine.txt").write_text("mine")
    runs.empty(asked())
    assert sorted(os.listdir(place / ".bin")) == ["link", "mine.txt"]
    assert (tmp_path / "elsewhere" / "history.csv").is_file() and (place / "notes" / "mine.txt").is_file()


def test_a_run_that_goes_on_is_left_alone(runs, tmp_path):
    with lock.held(tmp_path / "runs" / "one"), pytest.raises(SceneError, match="is writing there"):
        runs.delete(asked("one"))
    runs.queue.jobs.append(Job("two", ["run"], folder=runs.named("two"), state="waiting"))
    with pytest.raises(SceneError, match="is running"):
        runs.rename(asked("two", to="three"))
    assert {"one", "two"} <= set(os.listdir(tmp_path / "runs"))


def test_a_bin_that_is_a_link_is_refused(runs, tmp_path):
    (tmp_path / "runs" / ".bin").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(SceneError, match="is a link"):
        runs.delete(asked("one"))
    runs.empty(asked())
    assert (tmp_path / "elsewhere" / "history.csv").is_file() and (tmp_path / "runs" / "one").is_dir()


@pytest.mark.parametrize("to", ["", " ", "two", "a/b", "..", ".hidden", "a\\b", "x" * 101, "a\nb"])
def test_a_name_that_is_no_new_folder_is_refused(runs, tmp_path, to):
    with pytest.raises(SceneError, match="name = "):
        runs.rename(asked("one", to=to))
    assert (tmp_path / "runs" / "one").is_dir()


def test_a_run_gets_another_name(runs, tmp_path):
    runs.rename(asked("one", to=" Brücke 7, Probe 2 "))
    assert "Brücke 7, Probe 2" in [row["name"] for row in runs.rows()] and not (tmp_path / "runs" / "one").exists()


@pytest.mark.parametrize(
    ("tests", "begins", "ends"),
    [
        (
            {"slump": 0.18, "spread": 0.32},
            "Yield stress about ",
            "can't be told from these two: measure T500 or the V-funnel time.",
        ),
        ({"slump": 0.18}, "Yield stress about ", "can't be told from this: measure T500 or the V-funnel time."),
        ({"spread": 0.55, "t500": 4.0}, "Yield stress about ", ")."),
        (
            {"slump": 0.18, "spread": 0.55},
            "No mix of the table (2 to 1500 Pa) does all of this: the slump alone says ",
            " Pa.",
        ),
        (
            {"spread": 0.95, "t500": 3.0},  # softer than the table
            "No mix of the table (2 to 1500 Pa) does all of this: the slump flow alone says at most ",
            " Pa.",
        ),
        ({"slump": 0.18, "plastic_viscosity": 50.0}, "Yield stress about ", "plastic viscosity 50 Pa s, as given."),
    ],
)
def test_a_calibration_answers_in_a_sentence_with_its_numbers(tests, begins, ends):
    found = calibrate(**tests, check=False)
    text = verdict(found.facts())
    assert text.startswith(begins) and text.endswith(ends), text
    if found.fits:
        it = found.yield_value
        said = [float(number) for number in re.findall(r"[\d.]*\d", text)]
        assert said[:3] == pytest.approx([it.value, it.lower, it.upper], rel=0.06)  # two figures


def test_what_is_wrong_is_told_by_its_key():
    class Box(Checked):
        width: Length
        height: Length

    with pytest.raises(SceneError) as caught:
        Box(width="-3; depth = 2", hight=0.1)
    found = wrong(caught.value)
    assert list(found) == ["width", "height", ""] and found["height"] == "height is missing [m]"
    assert found["width"].startswith("width = -3; depth = 2: must be") and found[""].startswith("unknown key 'hight'")
    assert str(caught.value) == "; ".join(found.values())
    assert wrong(SceneError("spacing = 1 m: too large")) == {"spacing": "spacing = 1 m: too large"}
    assert wrong(SceneError("this scene; is odd")) == wrong(OSError("this scene; is odd")) == {"": "this scene; is odd"}


# ---- Windows --------------------------------------------------------------------------------------------------------
BREAK, CTRL_BREAK, NEW_GROUP = 21, 1, 0x200  # its SIGBREAK, CTRL_BREAK_EVENT and CREATE_NEW_PROCESS_GROUP


def anew(name):
    """A module made anew, beside the one that all others have."""
    module = module_from_spec(find_spec(f"taichi_mps.{name}"))
    module.__spec__.loader.exec_module(module)
    return module


def test_stop_reaches_a_run_on_windows_and_asked_again_kills_it(monkeypatch, tmp_path):
    """SIGINT is none that another process can get there, and SIGTERM kills; Ctrl-Break reaches a group of processes,
    and the program hears it as Ctrl-C, once."""
    monkeypatch.delattr(signal, "SIGHUP")
    monkeypatch.setattr(signal, "SIGBREAK", BREAK, raising=False)
    monkeypatch.setattr(signal, "CTRL_BREAK_EVENT", CTRL_BREAK, raising=False)
    monkeypatch.setattr(subprocess, "CREATE_NEW_PROCESS_GROUP", NEW_GROUP, raising=False)
    stopped, jobs, sent = anew("cli.stopped"), anew("app.jobs"), []
    job = jobs.Job("film", ["run", "film"], state="running")
    job.process = SimpleNamespace(returncode=None, send_signal=sent.append)
    for at_once in (False, False, True):
        job.stop(at_once)
    assert sent == [CTRL_BREAK, signal.SIGKILL] and anew("app.resident").OWN_SESSION["creationflags"] == NEW_GROUP
    assert stopped.SIGNALS == [signal.SIGINT, signal.SIGTERM, BREAK]
