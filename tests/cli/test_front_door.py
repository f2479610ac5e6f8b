"""Any outside input is accepted or refused in one clear message: no crash, no hang, no partly written file.

Generated command lines, scenes, meshes, checkpoints and run folders. 25 of each here; thousands by ``pytest -n0
tests/test_front_door.py --hypothesis-profile thorough``. No Taichi: a command stops where it would start.
"""

import contextlib
import hashlib
import io
import json
import os
import re
import shutil
import sys
import warnings
from pathlib import Path
from types import SimpleNamespace

import h5py
import meshio
import numpy as np
import pytest
from hypothesis import currently_in_test_context, event, given, settings
from hypothesis import strategies as st

import taichi_mps as mps
from taichi_mps.cli import main as cli
from taichi_mps.cli import options
from taichi_mps.cli import run as console
from taichi_mps.cli import study as commands
from taichi_mps.engine.geometry.meshes import read_mesh
from taichi_mps.engine.problem.numerics import NUMERICS
from taichi_mps.io import checkpoint
from taichi_mps.io.run_folder import RunFolder
from taichi_mps.io.vtkhdf import Trajectory
from taichi_mps.viz import film
from tests.support.cube import CORNERS, CUBE
from tests.support.recorded import contents, recorded

if settings.get_current_profile_name() in ("default", "ci"):
    settings.load_profile("quick")


class Admitted(Exception):
    """Raised in the place of what would start Taichi."""


@pytest.fixture(scope="module", autouse=True)
def taichi():
    """None is started: in the place of that of the other tests."""


@pytest.fixture(scope="module", autouse=True)
def door(tmp_path_factory):
    """An empty folder to work in, bodies of a few particles, and no start."""

    def refuse(*_, **__):
        raise Admitted

    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("door"))
        patch.setattr(mps.backend, "init", refuse)
        patch.setattr(cli, "redraw", refuse)
        patch.setattr(commands, "sweep", refuse)
        patch.setattr(commands.one_mix, "calibrate", refuse)
        patch.setattr("taichi_mps.engine.geometry.shapes.MAX_POINTS", 2e4)
        yield Path.cwd()


REMARKS = re.compile(
    r" keeps that within 10 %$|^taichi-mps: accuracy = \S+ mm: model = |; continuing from checkpoint.previous.h5$"
    r"|^taichi-mps: \w+: \d+ values: | of a run without them; has no effect here$|, or a smaller one, fills it$"
)


def knock(words):
    """Exit code of a command line, or 'admitted'. A refusal is one line on stderr and nothing on stdout."""
    before = {path.name for path in Path.cwd().iterdir()}
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            code = mps.main(words)
        except Admitted:
            code = "admitted"
    lines = [line for line in err.getvalue().splitlines() if not REMARKS.search(line)]
    if code == 2:
        assert len(lines) == 1 and lines[0].startswith("taichi-mps: ") and len(lines[0]) > 25, (words, lines)
        assert out.getvalue() == "", words
    else:
        assert not lines, (words, lines)
    assert {path.name for path in Path.cwd().iterdir()} == before, words
    if currently_in_test_context():
        event(str(code))
    return code


NUMBERS = st.one_of(
    st.floats(-10.0, 10.0),
    st.floats(),
    st.integers(-5, 10**9),
    st.sampled_from(
        ["1e400", "-0", "5mm", "0.3cm", "0.02", "1e-3", "nan", "inf", "", " ", "1_0", "0x10", "٣", "1,5", "3%"]
    ),
    st.text(max_size=6),
).map(str)
PLAUSIBLE = st.floats(0.005, 0.5).map(lambda v: f"{v:.3g}")


@st.composite
def command_lines(draw):
    """run SCENE with some of its options, in which each value may be anything."""
    name = draw(st.sampled_from(sorted(mps.catalogue.names())))
    scheme = draw(st.sampled_from(sorted(NUMERICS)))
    fields = {**mps.catalogue.load(name).parameters.model_fields, **NUMERICS[scheme].model_fields}
    fields |= {key: field for key, field in options.Run.model_fields.items() if key not in ("out", "scheme", "profile")}
    words = ["run", name, "--scheme", scheme]
    for key in draw(st.lists(st.sampled_from(sorted(fields)), max_size=5, unique=True)):
        if fields[key].annotation is bool:
            words.append("--quiet")
            continue
        value = draw(PLAUSIBLE | NUMBERS | st.sampled_from(options.choices(fields[key]) or ["0.05"]))
        words += draw(st.sampled_from([["--" + key.replace("_", "-"), value], [f"--{key.replace('_', '-')}={value}"]]))
    return words


@given(command_lines())
def test_a_command_line_is_taken_or_refused(words):
    assert knock(words) in ("admitted", 2)


# these have an answer without a scene, a chart is a file, and the app waits for a browser
ANSWERED = {"scenes", "info", "--help", "-h", "--version", "chart", "app", "mortar"}


@pytest.mark.parametrize("command", sorted(set(cli.commands()) - ANSWERED))
def test_a_command_alone_is_answered(command):
    assert knock([command]) in ("admitted", 2)


@given(
    st.lists(
        st.text(max_size=8) | st.sampled_from([*cli.commands(), "--json", "--out", "--help", "slump"]),
        min_size=1,
        max_size=5,
    )
)
def test_any_words_are_answered(words):
    if ANSWERED & set(words):
        return
    assert knock(words) in ("admitted", 2)


RANGES = st.lists(PLAUSIBLE | NUMBERS, min_size=1, max_size=4)


@given(st.data())
def test_a_study_is_planned_or_refused(data):
    command, model = data.draw(st.sampled_from([("sweep", None), ("calibrate", commands.Measurements)]))
    name = data.draw(st.sampled_from(["slump", "slump", "dam_break"]))
    words = [command] + [name] * (command == "sweep")
    fields = (model or mps.catalogue.load(name).parameters).model_fields
    for key in data.draw(st.lists(st.sampled_from(sorted(fields)), max_size=3, unique=True)):
        value = data.draw(st.sampled_from([":", ",", ""])).join(data.draw(RANGES))
        words.append(f"--{key.replace('_', '-')}={value}")
    assert knock(words) in ("admitted", 2)


@st.composite
def damaged(draw, whole: bytes):
    """Bytes of a file with a few of them changed, cut out, put in or repeated."""
    content = whole
    for _ in range(draw(st.integers(1, 4))):
        at = draw(st.integers(0, max(0, len(content) - 1)))
        end = at + draw(st.sampled_from([0, 1, 20, 64, len(content)]))
        content = content[:at] + draw(st.binary(max_size=16) | st.just(2 * content[at:end])) + content[end:]
    return content


MESHES = [
    ("cube.stl", {"binary": False}),
    ("cube.stl", {"binary": True}),
    ("cube.obj", {}),
    ("cube.ply", {"binary": False}),
    ("cube.ply", {"binary": True}),
]


@pytest.fixture(scope="module", params=MESHES, ids=lambda param: f"{param[0]}{param[1].get('binary', '')}")
def mesh(door, request):
    """A file of a closed cube, and its bytes."""
    path, how = door / request.param[0], request.param[1]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        meshio.Mesh(0.1 * CORNERS, [("triangle", CUBE)]).write(path, **how)
    return path, path.read_bytes()


@given(data=st.data())
def test_a_mesh_is_read_whole_or_refused(mesh, data):
    path, whole = mesh
    path.write_bytes(data.draw(damaged(whole)))
    try:
        points, triangles = read_mesh(path)
    except mps.SceneError as refusal:
        event("refused")
        assert str(path) in str(refusal)
        return
    event("read")
    assert np.isfinite(points).all() and triangles.min() >= 0 and triangles.max() < len(points)
    assert np.ptp(points, axis=0).min() > 0.0 and np.ptp(points, axis=0).max() <= 100.0


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """The folder of a run of 3 steps, with two checkpoints."""
    folder, *_ = recorded(tmp_path_factory.mktemp("outside") / "run", 3, "time")
    return SimpleNamespace(path=folder.path, contents=contents(folder.path), state=checkpoint.read(folder.checkpoint))


@contextlib.contextmanager
def replaced(run, name, content):
    """The run folder with another file in it."""
    (run.path / name).write_bytes(content)
    try:
        yield run.path / name
    finally:
        for key, value in run.contents.items():
            (run.path / key).write_bytes(value)


@given(data=st.data())
def test_no_damage_of_a_checkpoint_is_missed(run, data):
    whole = run.contents["checkpoint.h5"]
    content = data.draw(damaged(whole))
    with replaced(run, "checkpoint.h5", content) as path:
        try:
            state = checkpoint.read(path)
        except mps.SceneError as refusal:
            assert str(path) in str(refusal)
            assert checkpoint.read_good(path)[1].endswith("continuing from checkpoint.previous.h5")
        else:
            used = len(checkpoint.FORMAT) + 75  # behind the label the user block is empty, and nobody's
            assert content[: used - 1] + content[512:] == whole[: used - 1] + whole[512:]
            assert state.header == run.state.header


@pytest.mark.parametrize("words", [["--until", "-1"], ["--every", "0"], ["--scene", "nowhere.py"], []])
def test_a_resume_that_is_refused_or_not_yet_begun_leaves_a_damaged_checkpoint(run, words):
    before = contents(run.path) | {"checkpoint.h5": b"damaged"}
    with replaced(run, "checkpoint.h5", b"damaged"):
        assert knock(["resume", str(run.path), *words]) == (2 if words else "admitted")
        assert contents(run.path) == before


@pytest.mark.parametrize(("words", "every"), [([], 0.01), (["--every", "0.5"], 0.5)])
def test_a_resumed_run_keeps_its_interval_unless_another_is_given(run, resumed, words, every):
    assert mps.main(["resume", str(run.path), *words]) == 0 and resumed[-1].every == every


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)


STATES = (  # what a checkpoint may hold instead of its positions, the first being right
    lambda file, run: file.create_dataset("state/x", data=run.state.state["x"]),
    lambda file, run: file.create_dataset("state/x", (10**7, 10**7, 3), "f8", chunks=(1000, 1000, 3)),
    lambda file, run: file.create_group("state").update({"x": h5py.ExternalLink(run.path / "run.h5", "VTKHDF/Points")}),
    lambda file, run: file.create_dataset("state/x", data=["a", "b"]),
    lambda file, run: file.create_group("state/x/y"),
    lambda file, run: None,
)


@given(data=st.data())
def test_a_made_up_checkpoint_with_a_good_checksum_is_taken_or_refused(run, data):
    header = {
        **run.state.header,
        "scalars": {"time": 0.0, "steps": 1, "last_dt": None, "rest": {}, "report": None},
    }
    for key in data.draw(st.lists(st.sampled_from(sorted(header)), max_size=2)):
        header[key] = data.draw(JSON)
    header["source"] = data.draw(st.sampled_from(["slump", "../slump", "/etc/passwd", "slump.py", "os", "__init__"]))
    text = data.draw(st.sampled_from([json.dumps(header)] * 3 + ["", "[" * 100000, "null", "{}"]))
    path = run.path / "made.h5"
    with h5py.File(path, "w", userblock_size=512) as file:
        file["header"] = text
        data.draw(st.sampled_from(STATES))(file, run)
    content = path.read_bytes()[512:]
    label = f"{checkpoint.FORMAT} {checkpoint.VERSION} sha256 {hashlib.sha256(content).hexdigest()}\n"
    path.write_bytes(label.encode().ljust(512, b"\0") + content)
    try:
        assert knock(["resume", str(path)]) in ("admitted", 2)
    finally:
        path.unlink()


@st.composite
def edited(draw, path):
    """Other members in the place of some of run.h5: a run that nobody has written."""
    with h5py.File(path, "r+") as file:
        names = []
        file.visit(names.append)
        for name in draw(st.lists(st.sampled_from(sorted(names)), min_size=1, max_size=2, unique=True)):
            if name not in file:
                continue  # its group is gone
            old = file[name][()] if isinstance(file[name], h5py.Dataset) else np.zeros(3)
            kind = draw(st.sampled_from(["nothing", "less", "more", "nan", "text", "wide", "empty", "group", "big"]))
            del file[name]
            if kind == "group":
                file.create_group(name)
            elif kind != "nothing":
                file[name] = {
                    "less": old[:-1],
                    "more": np.concatenate([old, old]),
                    "nan": np.full(old.shape, np.nan),
                    "text": np.array([b"a", b"b"]),
                    "wide": old[..., None],
                    "empty": old[:0],
                    "big": np.full(old.shape, 1e30),
                }[kind]
        if draw(st.booleans()) and "VTKHDF/Steps" in file:
            file["VTKHDF/Steps"].attrs["NSteps"] = draw(st.sampled_from([-1, 0, 1, 5, 10**12, 2.5, "two", np.nan]))
        if draw(st.booleans()) and "taichi_mps" in file:
            text = st.sampled_from(["", "{}", "[]", "null", '{"spacing": 1e9}', '{"spacing": 0.04}', '{"a": 1}', "{"])
            file["taichi_mps"].attrs["parameters"] = draw(text | JSON.map(json.dumps))


@pytest.mark.parametrize("command", ["render", "export"])
@given(data=st.data())
def test_an_edited_run_h5_is_shown_or_refused_and_nothing_is_made_of_a_part(run, command, data):
    made = run.path / "vtu"
    with replaced(run, "run.h5", run.contents["run.h5"]) as path:
        data.draw(edited(path))
        code = knock([command, str(run.path)])
        assert code in ("admitted", 0, 2) and made.exists() == (code == 0)
        shutil.rmtree(made, ignore_errors=True)
        outputs = list(Trajectory(path).checked_replay()) if code == "admitted" else []
        assert len(list(film.align_in_time(iter(outputs)))) == len(outputs)
        for output in outputs:  # what is drawn then
            assert "slump_m" in output.measures() and output.scene.unfold(output.snapshot()).u.shape[1] == 3


# ---- what a terminal is shown -------------------------------------------------------------------------------------
ESCAPES = "\x1b[2J\x1b]0;title\x07\x9b31m\u202e"


def test_errors_and_info_show_no_terminal_escapes(tmp_path, capsys):
    RunFolder(tmp_path).write_summary({"scene": ESCAPES, "version": "\r"})
    assert mps.main(["info", str(tmp_path)]) == 0
    assert mps.main(["info", f"{tmp_path}/{ESCAPES}"]) == 2
    assert mps.main(["run", "slump", f"--density={ESCAPES}"]) == 2
    printed = capsys.readouterr()
    assert not set(ESCAPES + "\r") & set(printed.out + printed.err) - set("[]031m2J;title")
    assert "\\x1b" in printed.out and printed.err.count("\\x1b") >= 2


@pytest.mark.skipif(sys.platform == "win32", reason="names of files are texts there")
def test_a_folder_whose_name_is_no_text(tmp_path, capsys):
    folder, _, recorder = recorded(tmp_path / os.fsdecode(b"r\xff\xfe"), 1)
    told = {"scheme": "implicit", "wall_seconds": 1.0, "cpu_seconds": 1.0, "compile_seconds": 1.0}
    console.show_end(recorder.finish("time") | told, folder, quiet=False, as_json=False)
    assert r"r\udcff\udcfe" in "".join(capsys.readouterr().out.split())  # lines are wrapped
    assert mps.main(["export", str(folder.path)]) == 0
    assert r"r\udcff\udcfe" in capsys.readouterr().out
