"""The command line, end to end: real runs of small scenes in processes of their own, and every kind of bad input."""

import io
import json
import os
import random
import re
import shutil
import signal
import time
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
from rich.console import Console

import taichi_mps as mps
from taichi_mps.cli import options, run
from taichi_mps.io.history import read_history
from taichi_mps.io.run_folder import RunFolder
from taichi_mps.io.vtkhdf import Trajectory
from taichi_mps.units import unit_of
from tests.support.child import ROOT, begun, child

BLOB = '''"""A square of concrete that sags."""
import numpy as np
import taichi_mps as mps
from taichi_mps.units import Duration, Length, Position


@mps.checked
def scene(spacing: Length = 0.05, until: Duration = 0.1, rise: Position = 0.0, side: Length = 0.2) -> mps.Scene:
    """Square on a floor, thrown upwards with ``rise`` [m/s]."""
    x = mps.fill(mps.Box((0.0, 0.0), (side, side)), spacing)
    return mps.Scene(
        name="blob", material=mps.Bingham(yield_value=100.0), spacing=spacing, fluid=x,
        velocity=np.tile([0.0, rise], (len(x), 1)), walls=(mps.Plane((0.0, 0.0), (0.0, 1.0)),),
        domain=((-1.0, -0.2), (1.0, 1.0)), until=until, measure=mps.measure.front,
    )
'''
EMPTY = BLOB.replace("fluid=x,", "fluid=x[:0],")


def done(folder, *words):
    """(exit code, stdout, stderr) of a process in a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    made = child(*words, cwd=folder)
    return made.returncode, made.stdout, made.stderr


@pytest.fixture(scope="module")
def work(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cli")
    (folder / "blob.py").write_text(BLOB)
    return folder


@pytest.fixture(scope="module")
def whole(work):
    """A run to 0.1 s, its exit code, stdout and stderr."""
    here = work / "whole"
    words = ["-m", "taichi_mps", "run", work / "blob.py", "--every", "0.05", "--out", "run", "--json"]
    return here / "run", *done(here, *words)


def test_a_run_leaves_a_whole_folder_and_prints_only_json(whole):
    folder, code, out, err = whole
    assert code == 0, err
    summary = json.loads(out)
    assert summary == RunFolder(folder).read_summary()
    assert summary["stopped_by"] == "time"
    assert summary["fluid_particles"] == 16
    assert summary["simulated_seconds"] == pytest.approx(0.1)
    assert summary["parameters"] == {"spacing": 0.05, "until": 0.1, "rise": 0.0, "side": 0.2}
    assert "dt " not in err, "no progress where there is no terminal"
    names = {path.name for path in folder.iterdir()}
    assert {"frames", "animation.gif", "history.csv", "run.h5", "checkpoint.h5", "summary.json"} <= names
    assert [path.name for path in sorted((folder / "frames").iterdir())] == [f"frame_{k:05d}.png" for k in range(3)]
    rows = read_history(folder / "history.csv")
    assert len(rows["time_s"]) == summary["steps"] + 1
    assert rows["front_m"][-1] == pytest.approx(summary["front_m"], rel=1e-6)


FAILING = """
import os, sys
from taichi_mps.__main__ import entry
from taichi_mps.viz import film
draw, main = film.SideBySide.draw, os.getpid()
def failing(self, number, *outputs):
    if os.getpid() != main and number == 1:
        os._exit(9)
    if "--beads" in sys.argv:
        raise ValueError("no ink")
    return draw(self, number, *outputs)
film.SideBySide.draw = failing
entry()
"""


@pytest.mark.parametrize(("words", "pictures", "told"), [((), 3, ""), (["--beads"], 0, "no more pictures: no ink\n")])
def test_the_answer_comes_first_and_stands_whatever_becomes_of_the_pictures(work, whole, words, pictures, told):
    """The second process dies at its second picture, and this one draws the others; or none can be drawn."""
    folder, command = RunFolder(work / f"failing{pictures}"), ["run", work / "blob.py", "--every", "0.05", *words]
    code, out, err = done(work, "-c", FAILING, *command, "--out", folder.path)
    at = [next(k for k, line in enumerate(out.splitlines()) if word in line) for word in ("Front", "It took", "Open")]
    assert (code, at) == (0, sorted(at)) and err.replace("taichi-mps: ", "") == told
    drawn = [path.read_bytes() for path in folder.pictures]
    assert len(drawn) == pictures and drawn == [path.read_bytes() for path in RunFolder(whole[0]).pictures][:pictures]


def test_what_is_missing_of_a_run_is_made_as_it_was(work, whole):
    folder = RunFolder(shutil.copytree(whole[0], work / "cut"))
    gone = folder.report, folder.animation, folder.pictures[1]
    before = [path.read_bytes() for path in gone[1:]]
    for path in gone:
        path.unlink()
    assert done(work, "-m", "taichi_mps", "resume", "cut", "--scene", "blob.py", "--quiet")[0] == 0
    assert [path.read_bytes() for path in gone[1:]] == before and folder.report.is_file()


def test_without_pictures_a_run_ends_at_the_answer(work, whole):
    code, out, _ = done(work, "-m", "taichi_mps", "run", "blob.py", "--no-pictures", "--out", "bare", "--json")
    assert code == 0 and json.loads(out)["front_m"] == json.loads(whole[2])["front_m"]
    assert not list((work / "bare").rglob("*.html")) + list((work / "bare").rglob("*.[gp][in][fg]"))


UNSEEN = """
import math, sys
from taichi_mps.__main__ import entry
from taichi_mps.io import recorder
from taichi_mps.viz import film
recorder.CHECKPOINT_COST = math.inf  # after every step, so that many a kill falls into the writing of one
film.SideBySide.draw = lambda *_: None
entry()
"""


def results(folder):
    """All that a run has left behind, as bytes: its history, the state in its checkpoint, the arrays of run.h5."""
    state = mps.checkpoint.read(folder.checkpoint).state.items()
    found = {name: value.tobytes() if isinstance(value, np.ndarray) else repr(value) for name, value in state}
    with h5py.File(folder.trajectory) as file:
        file["VTKHDF"].visititems(
            lambda name, item: found.update({name: item[()].tobytes()} if hasattr(item, "dtype") else {})
        )
    return found | {"history": folder.history.read_bytes()}


@pytest.mark.long
def test_a_run_killed_at_random_steps_goes_on_bit_for_bit(work, whole):
    """After each SIGKILL what was written can be read, and the resumed run ends with the same bits. 20 kills:
    TAICHI_MPS_KILLS=20 pytest -n0 -k killed."""
    kills, dice = int(os.environ.get("TAICHI_MPS_KILLS", 1)), random.Random()
    here, reference = work / "killed", RunFolder(whole[0])
    here.mkdir()
    until = 0.05 * max(kills, 2)
    words = [work / "blob.py", "--every", "0.05", "--until", until, "--threads", "1", "--quiet", "--out", "run"]
    if kills > 2:
        reference = RunFolder(work / "reference" / "run")
        code, _, err = done(reference.path.parent, "-c", UNSEEN, "run", *words)
        assert code == 0, err
    steps = len(read_history(reference.history)["time_s"]) - 1
    folder, seen, command = RunFolder(here / "run"), 0, ["run", *words]
    for kill in range(kills):
        target = dice.randint(seen + 1, max(seen + 1, steps * (kill + 1) // (kills + 1)))
        process, deadline = begun("-c", UNSEEN, *command, cwd=here), time.monotonic() + 400
        while not (folder.history.is_file() and folder.history.read_bytes().count(b"\n") > target + 1):
            assert process.poll() is None and time.monotonic() < deadline, target
            time.sleep(0.001)
        process.kill()
        assert process.wait() == -signal.SIGKILL
        times = read_history(folder.history)["time_s"]
        written = Trajectory(folder.trajectory).times()
        assert len(written) >= int(times[-2] / 0.05 + 1e-6) + 1, "an output of an earlier step is missing"
        saved = mps.checkpoint.read_good(folder.checkpoint)[0]
        assert saved.header["time"] >= times[max(0, len(times) - 4)] - 1e-12, "steps were lost"
        seen = len(times) - 1
        command = ["resume", "run", "--scene", work / "blob.py", "--quiet"]
    code, _, err = done(here, "-c", UNSEEN, *command)
    assert code == 0, err
    assert results(folder) == results(reference)


@pytest.mark.parametrize("verbose", [False, True])
def test_the_line_on_a_terminal_says_how_far_a_run_has_come(tmp_path, monkeypatch, verbose):
    shown, steps = io.StringIO(), []
    terminal = Console(file=shown, force_terminal=True, width=160)
    monkeypatch.setattr(run, "Console", lambda **_: terminal)
    report = SimpleNamespace(dt=0.01, dt_limit="Courant", outer_iterations=6, solver_iterations=40)
    sim = SimpleNamespace(time=250.0, steps=1, report=report, each_step=steps.append)
    told = {"fraction": 0.5, "left_s": 100.0, "end_s": 500.0}
    clock = SimpleNamespace(part="ready", cold=True, begin=lambda *_: None, now=lambda *_: told)
    recorder = SimpleNamespace(measures={"front_m": 0.3}, folder=RunFolder(tmp_path))
    with run.progress(sim, recorder, False, verbose, clock):
        steps[0](sim)
    words = "250.00 of about 500 s", "50 %", "1.7 min left", "front 30.0 cm", "first run takes longest"
    assert all(word in shown.getvalue() for word in words)
    assert json.loads(recorder.folder.clock.read_text()) == told | {"measures": {"front_m": 0.3}}
    assert ("dt 10.00 ms (Courant), iterations 6/40" in shown.getvalue()) == verbose


def test_a_divergence_exits_3_and_names_the_file_to_resume_from(work):
    here = work / "diverged"
    words = ["-m", "taichi_mps", "run", work / "blob.py", "--rise", "80", "--every", "0.005", "--out", "run", "--quiet"]
    code, out, err = done(here, *words)
    assert (code, out) == (3, "")
    assert "resume" in err.splitlines()[-1] and str(Path("run") / "checkpoint.h5") in err.splitlines()[-1]
    summary = RunFolder(here / "run").read_summary()
    assert summary["stopped_by"] == "edge of the domain" and "beyond z = 1 m, its upper end" in err
    assert summary["resume_from"] == str(Path("run") / "checkpoint.h5")
    # it escapes in a step: the state before may be kept as well
    kept = mps.checkpoint.read(here / "run" / "checkpoint.h5")
    assert kept.header["time"] <= summary["simulated_seconds"]
    assert np.isfinite(kept.state["x"]).all() and np.isfinite(kept.state["u"]).all()


@pytest.mark.long
def test_a_scene_file_runs_alone_and_the_pictures_can_be_drawn_again(work):
    here = work / "alone"
    words = [ROOT / "scenes" / "slump.py", "--yield-value", "300", "--spacing", "0.05", "--until", "0.02"]
    code, out, err = done(here, *words, "--every", "0.01")
    assert code == 0, err
    folder = here / "renders" / "slump"
    assert RunFolder(folder).read_summary()["parameters"]["yield_value"] == 300.0
    code, out, err = done(here, "-m", "taichi_mps", "render", folder, "--view", "speed", "--json")
    assert code == 0 and json.loads(out)["pictures"] == 3, err
    assert len(list((folder / "frames-speed").glob("*.png"))) == 3
    assert (folder / "animation-speed.gif").is_file()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("run slmp", "unknown scene 'slmp', did you mean 'slump'?"),
        ("run missing.py", "scene = missing.py: no such file"),
        ("run slump --yeld-value 300", "unknown option --yeld-value, did you mean '--yield-value'?"),
        ("run slump --model plane", "model = plane: must be 'full', 'half', 'quarter' or 'axisymmetric'"),
        ("run film --model quarter", "model = quarter: must be 'plane'"),
        (
            "run slump --model quarter --lift-speed 0.1",
            "lift_speed = 0.1 m/s: a mould that is lifted needs model = full",
        ),
        ("run slump --density -2300", "density = -2300 kg/m3: must be greater than or equal to 200 kg/m3"),
        (
            "run slump --density 2.3",
            "density = 2.3 kg/m3: must be greater than or equal to 200 kg/m3 (2300 for 2.3 t/m3)",
        ),
        (
            "run slump --spacing 0.00001",
            "spacing = 1e-05 m: fills the box with 1.6e+10 particles, at most 4e+07; must be at least 7.51e-05 m",
        ),
        (
            "run slump --effective-radius-ratio -1",
            "effective_radius_ratio = -1: must be greater than or equal to 1.6",
        ),
        ("run slump --effective-radius-ratio nan", "effective_radius_ratio = nan: must be a finite number"),
        (
            "run slump --critical-strain-rate rationel",
            "critical_strain_rate = rationel: must be a number [1/s], or 'rational'",
        ),
        ("run slump --density -2.3e6", "density = -2.3e6 kg/m3: must be greater than or equal to 200 kg/m3"),
        ("run slump --density 2.3e6", "density = 2.3e6 kg/m3: must be less than or equal to 20000 kg/m3"),
        ("sweep slump --density 2.3,2.4", "density = 2.3 kg/m3: must be greater than or equal to 200 kg/m3"),
        ("run slump --height 300", "height = 300 m: must be less than or equal to 100 m; add a unit: 300 mm"),
        ("run slump --height 30", "height = 30 m: must be at most 3 m; add a unit: 30 cm"),
        ("run mini_cone --height 5.72", "height = 5.72 m: must be at most 3 m"),
        ("run l_box --grains-seed 2", "grains_seed = 2: has no effect without grains; must be left out"),
        ("run l_box --grains 12mm", "grains_volume = none: must be given beside grains, such as 0.3"),
        ("run l_box --grains 12mm --grains-volume 0.4", "grains_volume = 0.4: must be less than or equal to 0.35"),
        (
            "run l_box --grains 16 --grains-volume 0.1",
            "grains = 16: must be a diameter, 12mm, or diameters and fractions, 8mm:0.4+16mm:0.6 (diameter = 16 m: "
            "must be less than or equal to 0.1 m; add a unit: 16 mm)",
        ),
        ("run slump --lift-speed 120", "lift_speed = 120 m/s: must be less than or equal to 5 m/s (0.1 for 100 mm/s)"),
        (
            "run slump --accuracy 5mm --scheme semi-implicit",
            "accuracy = 5mm: chooses model and particle size of the sch",
        ),
        (
            "run wall --rate 3m/h",
            "rate = 3m/h: must be a number in m3/s or a unit of that kind (a rise of 3 m/h over 1 m2 is 3 m3/h)",
        ),
        ("run wall --length 30", "length = 30 m: must be less than or equal to 24 m"),
        ("run wall --length 30m", "length = 30m: must be less than or equal to 24 m"),
        ("run wall --hose-diameter 25cm", "hose_diameter = 0.25 m: must be at most 0.2 m, as wide as the form"),
        ("run wall --bar-distance 1cm", "bar_distance = 0.01 m: must be more than the bars' 0.016 m"),
        ("run j_ring --ring-diameter 20cm", "ring_diameter = 0.2 m: must be at least 0.218 m, around the cone's base"),
        ("run slump --accuracy 5", "accuracy = 5 m: must be at most 0.1 m (0.005 or 5mm for 5 mm)"),
        (
            "run mini_cone --spacing 20mm",
            "spacing = 0.02 m: nothing of the filled body lies at the axis, where slump_m",
        ),
        (
            "run slump --model axisymmetric --spacing 0.1",
            "spacing = 0.1 m: nothing of the filled body lies at the axis",
        ),
        ("run film --spacing 10", "spacing = 10 m: larger than the film, 0.1 m deep"),
        ("run wall --spacing 10", "spacing = 10 m: must be at most a third of the hose, 0.04 m"),
        ("calibrate --spread 50", "spread = 50 m: must be less than 3 m; add a unit: 50 cm"),
        ("calibrate --slump-flow 50", "spread = 50 m: must be less than 3 m"),  # other names of the same options
        ("calibrate --slump 0.2 --density 1", "rho = 1 kg/m3: must be greater than or equal to 200 kg/m3"),
        *((f"{words} --yield-stress -1", "yield_value = -1") for words in ("run slump", "new film", "sweep slump")),
        ("run slump --slump-flow 0.5", "--slump-flow is a result; 'taichi-mps calibrate --slump-flow' finds the mix"),
        ("calibrate --slump 0.2 --slump-error 5", "slump_error = 5 m: must be less than 0.3 m"),
        ("run slump --density heavy", "density = heavy: must be a number [kg/m3]"),
        ("run slump --yield-value 300mm", "yield_value = 300mm: must be a number in Pa or a unit of that kind"),
        ("run slump --height -3cm", "height = -0.03 m: must be greater than 0 m"),
        ("run wall --rate 12l", "rate = 12l: must be a number in m3/s or a unit of that kind"),
        ("run slump --slump 3", "--slump is a result; 'taichi-mps calibrate --slump' finds the mix that has it"),
        ("run slump --yield-value nan", "yield_value = nan Pa: must be a finite number"),
        ("run slump --until inf", "until = inf s: must be a finite number"),
        ("run slump --spacing 0.5", "spacing = 0.5 m: larger than the body"),
        ("new slump --spacing 0.5", "spacing = 0.5 m: larger than the body"),
        ("new slump --out case.toml", "unknown option --out: run has it"),
        ("calibrate --table list.csv --executor local", "unknown option --executor: sweep has it"),
        (
            "run slump --renderer ggui",
            "unknown option --renderer: pictures are drawn in software; 'beads' shows the pa",
        ),
        ("render . --surface", "unknown option --surface: it is what is drawn; must be left out"),
        ("sweep slump --executor slurm://here", "executor = slurm://here: must be dask://HOST:PORT or local; Slurm st"),
        ("run slump --spacing 1e-300", "spacing = 1e-300 m: must be at least 1e-12 m"),
        ("run slump --height 0.004 --lift-speed 0.1", "spacing = 0.01 m: larger than the body, 0.004 m high"),
        ("run film --effective-radius-ratio 4.1", "domain = 0.05 m along periodic axis 0: must be at least three"),
        ("run slump --every 0", "every = 0 s: must be greater than 0 s"),
        ("run slump --threads 0", "threads = 0: must be greater than or equal to 1"),
        ("run slump --arch abacus", "arch = abacus: must be 'cpu', 'cuda' or 'vulkan'"),
        ("run slump --scheme explicit", "scheme = explicit: must be 'implicit' or 'semi-implicit'"),
        ("run slump --courant-number 2", "courant_number = 2: must be less than or equal to 1"),
        ("run slump --density", "argument --density: expected one argument"),
        ("run slump --out file/run", "out = file/run: cannot be written"),
        ("run slump --out file", "out = file: is a file"),
        ("run slump --out " + 300 * "a", "aaa: cannot be written"),
        ("run slump again", "unexpected argument 'again'"),
        ("run", "run: name a scene"),
        ("sweep ", "sweep: name a scene"),
        ("export ", "run = .: holds no run.h5"),
        ("run nowhere.toml", "case = nowhere.toml: no such file"),
        ("sweep slump --yield-value 1:2:1000000000", "yield_value = 1:2:1000000000: must be at most 100000 values"),
        ("sweep slump --yield-value 1:2:1000 --density 1000:2000:1000", "make 1e+06 cases; must be at most 100000"),
        ("run empty.py", "the geometry is empty"),
        ("run none.py", "scene none.py: its function returns int; must return a Scene"),
        ("run raises.py", "scene raises.py cannot be made: ZeroDivisionError: division by zero"),
        ("run --yield-value 500 --spacing 9 slump", "spacing = 9 m: larger than the body"),
        ("sweep --yield-value 50,-1 slump", "yield_value = -1 Pa: must be greater than or equal to 0 Pa"),
        ("sweep slump --chart", "chart: needs a parameter that is varied by numbers"),
        ("run broken.py", "broken.py cannot be loaded: SyntaxError"),
        ("run bare.py", "has no function 'scene'"),
        ("rnu slump", "unknown command 'rnu', did you mean 'run'?"),
        ("resume nowhere", "checkpoint nowhere/checkpoint.h5: no such file"),
        ("resume file", "checkpoint file: damaged, or not a checkpoint"),
        ("render nowhere", "run = nowhere: holds no run.h5"),
        (
            "plot nowhere",
            "the command plot is gone; report.html draws the curves of a run, history.csv holds them",
        ),
        ("run slump --plots", "unknown option --plots: report.html draws the curves of a run, history.csv holds them"),
        ("run film --arch metal", "arch = metal: must be cpu, cuda or vulkan; Metal has no 64-bit floats"),
        ("app --token a;b", "token = a;b: must be of letters, digits and . _ ~ -, as an address holds them"),
        ("app --token ä", "token = ä: must be of letters, digits and"),
        ("info nowhere", "run = nowhere: holds no summary.json"),
    ],
)
def test_bad_input_is_one_clear_line_exit_2_and_nothing_written(words, message, tmp_path, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    files = {"file": "", "empty.py": EMPTY, "broken.py": "def scene(:", "bare.py": "scene = 3"}
    returned = "import taichi_mps as mps\n@mps.checked\ndef scene() -> mps.Scene:\n    return "
    files |= {"none.py": returned + "3", "raises.py": returned + "1 / 0"}
    for name, text in files.items():
        Path(name).write_text(text)
    code, out, err = command(*words.split(" "))
    assert (code, out, err.count("\n")) == (2, "", 1) and message in err
    assert {path.name for path in tmp_path.iterdir()} - {"__pycache__"} == set(files)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("scenes", "  Slump and slump flow"),
        ("scenes --json", '"name": "slump", "description": "Slump and slump flow'),
        ("info --json", f'{{"version": "{mps.__version__}"'),
        ("--version", mps.__version__),
        ("run slump --forecast --verbose", " of processor time): start "),
        (
            "run slump --spacing 0.05 --critical-strain-rate 1 --forecast",
            "taichi-mps: critical_strain_rate = 1 1/s: the concrete yields at a knee stress of 400 Pa instead of "
            "yield_value = 300 Pa; at most 0.3 1/s keeps that within 10 %\n",
        ),
    ],
)
def test_what_is_asked_is_told(words, told, command):
    code, *said = command(*words.split())
    assert code == 0 and told in "".join(said)


def test_help_lists_every_keyword_with_unit_and_default_without_taichi(tmp_path):
    program = "import sys, taichi_mps as mps; code = mps.main(['run', 'slump', '--help']); "
    code, out, err = done(tmp_path, "-c", program + "sys.exit(code or 'taichi' in sys.modules)")
    assert code == 0, err
    for name, field in mps.catalogue.load("slump").parameters.model_fields.items():
        option = rf"\n  (?:--yield-stress \S+, )?--{name.replace('_', '-')} "
        told = " ".join(re.split(option, out)[1].split("\n  --")[0].split())
        assert unit_of(field) in told or options.choices(field)
        assert not isinstance(field.default, float) or f"default {field.default:g} {unit_of(field)}" in told
    for option in ("--scheme", "--every", "--out", "--arch", "--threads", "--precision", "--walls", "--quiet"):
        assert option in out


def test_a_forecast_tells_what_a_run_will_be_and_leaves_nothing(command, tmp_path, monkeypatch):
    pytest.importorskip("igl")
    monkeypatch.chdir(tmp_path)
    words = ["run", "wall", "--spacing", "4cm", "--until", "8s", "--forecast"]
    lines = json.loads(command(*words, "--json")[1])["forecast"]
    assert "particles of 40 mm, model half; about " in lines[0] and " MB of memory" in lines[0]
    assert re.fullmatch(r"Pours \S+ l\. Takes about [\d.]+ (s|min)(; shorter the next time)?\.", lines[1])
    assert lines[-1].startswith("bars: 16 mm thick, thinner than a particle. A bar as thin resists")
    assert command(*words)[:2] == (0, "\n".join(lines) + "\n")
    assert not any(tmp_path.iterdir())
