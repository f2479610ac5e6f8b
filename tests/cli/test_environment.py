"""Unusual environments of the program: without streams, in another encoding or home, with little memory; each run ends
as it should or is refused in one line."""

import json
import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest

import taichi_mps as mps
from taichi_mps.io.run_folder import RunFolder, write_whole
from taichi_mps.units import user_path
from tests.support.child import ROOT
from tests.support.recorded import contents, recorded

RUN = ["run", "film", "--spacing=0.02", "--until=0.002", "--threads=1"]
MAIN = [sys.executable, "-m", "taichi_mps"]
ODD = {
    "MPLBACKEND": "module://not_installed.backend_inline",
    "PYTHONIOENCODING": "cp1252",
    "PYTHONOPTIMIZE": "2",
    "PYTHONWARNINGS": "error",
    "PYTHONCOERCECLOCALE": "0",
    "PYTHONUTF8": "0",
    "LC_ALL": "C",
    "COLUMNS": "1",
    "TMPDIR": "/nonexistent",
}


@pytest.fixture(scope="module", autouse=True)
def taichi():
    """None is started."""


def program(folder, words, **settings):
    """What a command did, with these more variables."""
    more = settings.pop("env", {})
    cache = os.environ.get("TI_OFFLINE_CACHE_FILE_PATH") or os.path.expanduser("~/.cache/taichi/ticache")
    variables = os.environ | {"PYTHONPATH": str(ROOT), "TI_OFFLINE_CACHE_FILE_PATH": cache} | more
    return subprocess.run(words, cwd=folder, env=variables, timeout=120, **settings)


@pytest.mark.slow
def test_a_run_in_an_odd_environment(tmp_path):
    words = [*MAIN, *RUN, "--out=~/型"]
    done = program(tmp_path, words, env=ODD | {"HOME": str(tmp_path / "home")}, capture_output=True)
    assert (done.returncode, done.stderr) == (0, b"")
    folder = RunFolder(tmp_path / "home" / "型")
    assert folder.report.is_file() and len(folder.pictures) == 2
    assert b"home/\\udce5" in done.stdout.replace(b"\n", b"") and b"Time limit after" in done.stdout


THREADS = """
import atexit, os
import taichi_mps.__main__ as program
atexit.register(lambda: print(len(os.listdir("/proc/self/task"))))
program.entry()
"""


def test_numpy_takes_one_thread_beside_a_run(tmp_path):
    done = program(tmp_path, [sys.executable, "-c", THREADS, "--version"], capture_output=True, text=True)
    assert done.stdout.splitlines() == [mps.__version__, "1"]


NO_STREAMS = """
import os, sys
import taichi_mps as mps
places = [os.readlink(f"/proc/self/fd/{n}") for n in range(3) if mps.main(["--version"]) == 0]
codes = [mps.main(words.split()) for words in sys.argv[2:]]
open(sys.argv[1], "w").write(f"{codes} {places}")
"""


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="reads /proc of Linux")
def test_without_standard_streams_commands_end_as_with_them_and_no_file_takes_their_place(tmp_path):
    words = ["scenes", "calibrate --slump 20cm --no-check", "new slump", "info --json", "chart", "nope"]
    command = ["sh", "-c", 'exec "$@" <&- >&- 2>&-', "sh", sys.executable, "-c", NO_STREAMS, "told", *words]
    assert program(tmp_path, command).returncode == 0
    assert (tmp_path / "told").read_text() == f"[0, 0, 0, 0, 0, 2] {['/dev/null'] * 3}"
    assert program(tmp_path, ["sh", "-c", 'exec "$@" >&-', "sh", *MAIN, "--version"]).returncode == 0


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full of Linux")
@pytest.mark.parametrize("buffered", ["", "1"])
@pytest.mark.parametrize("words", [["--version"], ["scenes", "--json"], ["info", ROOT / "tests/io/written_by_0.3.0"]])
def test_output_that_cannot_be_written_is_one_line(tmp_path, words, buffered):
    with open("/dev/full", "w") as full:
        settings = {"stdout": full, "stderr": subprocess.PIPE, "env": {"PYTHONUNBUFFERED": buffered}}
        done = program(tmp_path, [*MAIN, *words], **settings)
    told = b"taichi-mps: stdout: cannot be written (No space left on device)\n"
    assert (done.returncode, done.stderr) == (2, told)


@pytest.mark.skipif(not Path("/proc/self/limits").exists(), reason="reads /proc of Linux")
def test_a_limit_of_address_space_is_one_line(tmp_path):
    def limited():
        resource.setrlimit(resource.RLIMIT_AS, (1_000_000 * 1024,) * 2)

    done = program(tmp_path, [*MAIN, *RUN], preexec_fn=limited, capture_output=True, text=True)
    assert done.returncode == 2 and not list(tmp_path.iterdir())
    assert (
        done.stderr.startswith("taichi-mps: memory: Taichi takes 1.07 GB of address space")
        and " (ulimit" in done.stderr
    )
    assert done.stderr.count("\n") == 1


@pytest.mark.skipif(sys.platform == "win32", reason="a folder in use stays there")
def test_a_current_folder_that_is_gone_is_named(tmp_path, monkeypatch, command):
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    (tmp_path / "here").rmdir()
    told = "taichi-mps: the current folder has been removed; must be one that is there\n"
    assert command("run", "film") == (2, "", told)


# ---- paths -----------------------------------------------------------------------------------------------------
def test_a_path_with_a_tilde_lies_at_home_wherever_a_user_names_one(tmp_path, monkeypatch, capsys):
    home, here = tmp_path / "home", tmp_path / "here"
    for folder in (home, here):
        folder.mkdir()
    monkeypatch.chdir(here)
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.setenv("USERPROFILE", str(home))
    assert user_path("~/a") == home / "a" and user_path("a~") == Path("a~") and user_path("~") == home
    assert user_path(user_path("./~/a")) == here / "~" / "a", "as with a shell"

    scene = ROOT.joinpath("scenes", "film.py").read_text(encoding="utf-8")
    (home / "own.py").write_text(scene, encoding="utf-8")
    (home / "case.toml").write_text('scene = "~/own.py"\n', encoding="utf-8")
    assert mps.catalogue.source("~/own.py") == str(home / "own.py")
    assert mps.main(["run", "~/case.toml", "--forecast"]) == 0
    folder, *_ = recorded("~/run", 2, "time")
    for words in (["info", "~/run"], ["export", "~/run"], ["export", "~/run", "--out=~/vtu"]):
        assert mps.main(words) == 0, capsys.readouterr().err
    mps.checkpoint.read_good("~/run/checkpoint.h5")
    mps.write_bars("~/bars.stl", [[(0.0, 0.0, 0.0), (0.0, 0.0, 1.0)]], 0.01)
    mps.gif("~/run/frames", "~/film.gif") if folder.pictures else None
    (home / "mixes.csv").write_text("slump [cm],spread [cm]\n20,35\n", encoding="utf-8")
    assert mps.main(["calibrate", "--table=~/mixes.csv"]) == 0
    made = {"own.py", "case.toml", "run", "vtu", "bars.stl", "mixes.csv", "mixes-calibrated.csv"}
    assert made <= {path.name for path in home.iterdir()} and not list(here.iterdir())


# ---- runs that end before they begin ---------------------------------------------------------------------------
@pytest.fixture
def run(tmp_path):
    """The folder of a run of two steps to 0.02 s."""
    folder, *_ = recorded(tmp_path / "run", 2, "interrupted")
    folder.case.write_text("until = 1.0", encoding="utf-8")
    return folder


def test_a_time_limit_that_has_passed_is_refused_and_the_case_stays(run, command):
    told = "taichi-mps: until = 0.01 s: 0.02 s of the run have passed; must be longer\n"
    assert command("resume", run.path, "--until", "10ms") == (2, "", told)
    assert run.case.read_text(encoding="utf-8") == "until = 1.0"


@pytest.fixture
def ended(tmp_path, monkeypatch):
    """Folder of a run that has ended after 0.02 s, and a function that ends it."""
    folder, sim, recorder = recorded(tmp_path / "run", 2)
    whole = sim.facts
    monkeypatch.setattr(sim, "facts", lambda: whole() | {"simulated_seconds": sim.time, "wall_seconds": 8.0})
    for name in ("report.html", "animation.gif", *(f"frames/frame_{k:05d}.png" for k in range(3))):
        (folder.path / name).write_text("the page", encoding="utf-8")
    folder.case.write_text("until = 0.02", encoding="utf-8")
    return folder, recorder.finish


@pytest.mark.parametrize(
    ("end", "words", "told"),
    [
        ("time", [], "; --until TIME goes on"),
        ("time", ["--until=20ms"], "; --until TIME goes on"),
        (
            "time",
            ["--courant-number=0.1", "--every=1"],
            "; --until TIME goes on; without effect: every, courant_number",
        ),
        ("rest", ["--until=5"], ", it is at rest"),
        ("unyielded", ["--note=mine"], ", it is at rest; without effect: note"),
    ],
)
def test_where_nothing_is_left_to_compute_it_is_told_and_all_files_stay(ended, command, end, words, told):
    folder, finish = ended
    finish(end)
    before = contents(folder.path)
    code, out, err = command("resume", folder.path, "--json", *words)
    assert (code, err) == (0, f"taichi-mps: run = {folder.path}: nothing left to compute{told}\n")
    assert json.loads(out) == folder.read_summary() and contents(folder.path) == before


def test_numerics_are_refused_where_only_the_summary_is_missing(ended, command):
    folder, finish = ended
    finish("time")
    folder.summary.unlink()
    keywords = mps.checkpoint.read(folder.checkpoint)
    keywords.header["parameters"]["until"] = 0.02
    keywords.write(folder.checkpoint)
    before = contents(folder.path)
    told = "taichi-mps: max_time_step: nothing is left to compute; must be left out, or with a later until\n"
    assert command("resume", folder.path, "--max-time-step=1ms") == (2, "", told) and contents(folder.path) == before


@pytest.mark.parametrize("foreign", [[], ["notes.txt", "history.csv"]])
def test_a_checkpoint_without_its_run_is_refused_and_nothing_written(run, tmp_path, command, foreign):
    here = tmp_path / "copied"
    here.mkdir()
    (here / "checkpoint.h5").write_bytes(run.checkpoint.read_bytes())
    for name in foreign:
        (here / name).write_text("mine")
    before = contents(here)
    told = f"taichi-mps: run = {here}: holds a checkpoint but not its run; must be the whole folder of the run\n"
    for path in (here, here / "checkpoint.h5"):
        assert command("resume", path) == (2, "", told) and contents(here) == before


@pytest.mark.parametrize(
    ("gone", "told"),
    [
        (["history.csv"], "history.csv missing; written anew from 0.02 s on"),
        (["history.csv", "run.h5"], "history.csv and run.h5 missing; written anew from 0.02 s on"),
        (["taichi_mps.json"], ""),
    ],
)
def test_missing_files_of_a_run_are_told_and_its_mark_is_made_again(run, command, resumed, gone, told):
    for name in gone:
        (run.path / name).unlink()
    assert command("resume", run.path) == (0, "", f"taichi-mps: run = {run.path}: {told}\n" * bool(told)) and run.ours


def test_a_file_in_the_place_of_the_pictures_is_named(run, command):
    run.frames.rmdir()
    run.frames.write_text("mine")
    told = f"taichi-mps: out = {run.path}: {run.frames} is a file; must be a folder or absent\n"
    for words in (["resume", run.path], ["run", "slump", f"--out={run.path}", "--overwrite"]):
        assert command(*words) == (2, "", told)


@pytest.mark.parametrize(
    ("steps", "gone", "told"),
    [
        (0, [], "ended before its first checkpoint; 'taichi-mps run' with --overwrite begins it anew"),
        (1, [], "its checkpoint.h5 is missing; what was computed is in history.csv, run.h5"),
        (1, ["history.csv"], "its checkpoint.h5 is missing; what was computed is in run.h5"),
    ],
)
def test_both_commands_say_alike_what_a_run_without_checkpoint_holds(tmp_path, command, steps, gone, told):
    folder, *_ = recorded(tmp_path / "run", steps)
    code, _, err = command("run", "slump", f"--out={folder.path}")
    assert code == 2 and "resume" in err
    for name in ("checkpoint.h5", *gone):
        (folder.path / name).rename(folder.path / f"my-{name}")
    for name in ("resume", "info"):
        assert command(name, folder.path) == (2, "", f"taichi-mps: run = {folder.path}: {told}\n")
    code, _, err = command("run", "slump", f"--out={folder.path}")
    assert code == 2 and "resume" not in err


def test_what_cannot_be_written_whole_leaves_what_was_there(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    write_whole(tmp_path / "case.toml", "before")
    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(OSError, match="No space"):
        write_whole(tmp_path / "case.toml", "after")
    assert [(path.name, path.read_text(encoding="utf-8")) for path in tmp_path.iterdir()] == [("case.toml", "before")]
