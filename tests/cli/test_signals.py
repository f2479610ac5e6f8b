"""Signals and closed pipes end the program quietly and leave no partly written file, whenever they come."""

import os
import re
import signal
import time
from pathlib import Path

import pytest

from taichi_mps.io.run_folder import RunFolder
from tests.support.child import ROOT, begun

pytestmark = pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="reads /proc of Linux")
MAIN = "-m", "taichi_mps"
RUN = ["run", "film", "--spacing=0.02", "--until=500", "--every=0.5", "--threads=1", "--out=run", "--quiet"]


def listens(process, number=signal.SIGTERM):
    """Has the process a handler for a signal? That for SIGTERM is set after the one for SIGINT, which Python itself has
    before."""
    status = Path(f"/proc/{process}/status").read_text(encoding="utf-8")
    return int(re.search(r"SigCgt:\s*(\w+)", status)[1], 16) >> (number - 1) & 1


def wait_for(run, path):
    """Wait until a process has made a file."""
    while not path.exists():
        assert run.poll() is None
        time.sleep(0.01)


@pytest.fixture(autouse=True)
def hang_up():
    """SIGHUP as without nohup, for the processes of the tests."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


@pytest.mark.parametrize(
    ("moment", "number"),
    [
        ("imports", signal.SIGTERM),
        ("imports", signal.SIGINT),
        ("start", signal.SIGTERM),
        ("start", signal.SIGHUP),
        pytest.param("start", signal.SIGINT, marks=pytest.mark.slow),
        pytest.param("steps", signal.SIGTERM, marks=pytest.mark.long),
        pytest.param("steps", signal.SIGINT, marks=pytest.mark.long),
        pytest.param("steps", signal.SIGHUP, marks=pytest.mark.long),
    ],
)
def test_a_signal(tmp_path, number, moment):
    run = begun(*MAIN, *RUN, cwd=tmp_path)
    if moment == "imports":
        while not listens(run.pid):
            assert run.poll() is None
    else:
        wait_for(run, tmp_path / "run" / ("taichi_mps.lock" if moment == "start" else "run.h5"))
    run.send_signal(number)
    _, said = run.communicate(timeout=120)
    assert run.returncode == 128 + number, said
    assert said in ("", "taichi-mps: interrupted\n")
    if (tmp_path / "run").exists():
        assert RunFolder(tmp_path / "run").read_summary()["stopped_by"] == "interrupted"
        again = begun(*MAIN, "resume", "run", "--until=1", "--quiet", cwd=tmp_path)
        assert (again.communicate(timeout=120)[1], again.returncode) == ("", 0)


def test_under_nohup_a_closed_terminal_does_not_stop_a_run(tmp_path):
    run = begun(*MAIN, *RUN, cwd=tmp_path, preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_IGN))
    wait_for(run, tmp_path / "run" / "taichi_mps.lock")
    assert listens(run.pid) and not listens(run.pid, signal.SIGHUP)
    run.send_signal(signal.SIGHUP)
    run.send_signal(signal.SIGTERM)
    assert run.communicate(timeout=120) and run.returncode == 128 + signal.SIGTERM


@pytest.mark.slow
def test_a_run_whose_terminal_is_closed_leaves_a_whole_folder(tmp_path):
    """Whatever a run prints on a terminal that is gone is an error, and the shell sends a second SIGHUP."""
    screen, terminal = os.openpty()
    run = begun(*MAIN, *RUN[:-1], cwd=tmp_path, stdout=terminal, stderr=terminal)
    os.close(terminal)
    wait_for(run, tmp_path / "run" / "run.h5")
    os.close(screen)
    run.send_signal(signal.SIGHUP)
    run.send_signal(signal.SIGHUP)
    assert run.wait(timeout=120) == 128 + signal.SIGHUP
    assert RunFolder(tmp_path / "run").read_summary()["stopped_by"] == "interrupted"
    assert not {"taichi_mps.lock", "run.twin1", "run.twin2"} & {path.name for path in (tmp_path / "run").iterdir()}


SWALLOWED = """
import os, signal, sys, weakref
from taichi_mps.cli.stopped import listen
listen()
gone = {1}
callback = weakref.ref(gone, lambda _: os.kill(os.getpid(), signal.SIGINT))
del gone
from taichi_mps.cli.main import main
sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.slow
def test_a_signal_that_an_import_swallowed_still_stops_the_run(tmp_path):
    run = begun("-c", SWALLOWED, *RUN, cwd=tmp_path)
    assert (run.communicate(timeout=120)[1], run.returncode) == ("", 130)
    assert RunFolder(tmp_path / "run").read_summary()["stopped_by"] == "interrupted"


@pytest.mark.parametrize(
    "words",
    [
        ["scenes"],
        ["--help"],
        ["run", "slump", "--help"],
        ["info", "--json"],
        ["info", ROOT / "tests" / "io" / "written_by_0.3.0"],
        pytest.param([*RUN[:-1], "--until=0.002"], marks=pytest.mark.slow),
    ],
)
def test_a_closed_pipe(tmp_path, words):
    read, write = os.pipe()
    os.close(read)
    run = begun(*MAIN, *words, cwd=tmp_path, stdout=write)
    os.close(write)
    assert run.communicate(timeout=120)[1] == ""
    swallowed = words == ["run", "slump", "--help"]  # argparse keeps silent of it, unless it is buffered
    assert run.returncode == 141 or (swallowed and run.returncode == 0)
