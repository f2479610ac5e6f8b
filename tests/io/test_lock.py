"""A run folder has one writer: a second one is refused before it does anything, readers are not, and a killed process
holds no lock."""

import os
import signal
from subprocess import PIPE

import pytest

import taichi_mps as mps
from taichi_mps.io import lock
from tests.support.child import begun
from tests.support.recorded import contents, recorded

HOLDER = (
    "import sys\nfrom taichi_mps.io import lock\nwith lock.held(sys.argv[1]):\n    print('held', flush=True), input()"
)


@pytest.fixture(scope="module", autouse=True)
def taichi():
    """None is started."""


@pytest.fixture
def run(tmp_path):
    """The folder of a run of two steps."""
    return recorded(tmp_path / "run", 2, "time")[0].path


@pytest.fixture
def holder(run):
    """A process that writes into the folder."""
    process = begun("-c", HOLDER, run, stdin=PIPE)
    assert process.stdout.readline() == "held\n"
    yield process
    process.communicate()


def test_a_second_writer_is_refused_until_the_first_is_killed_and_readers_never(run, holder, command, resumed):
    before = contents(run)
    for words in (["run", "slump", "--spacing", "0.05", "--out", str(run), "--overwrite"], ["resume", str(run)]):
        code, out, err = command(*words)
        assert (code, out, err.count("\n")) == (2, "", 1)
        assert f"out = {run}: process {holder.pid} of " in err and err.endswith("must be one at a time\n")
    assert contents(run) == before and not resumed
    for words in (["info", str(run)], ["export", str(run), "--out", str(run.parent / "vtu")]):
        assert mps.main(words) == 0
    holder.kill()
    assert holder.wait() == -signal.SIGKILL
    assert (run / lock.NAME).is_file(), "what is left of a killed process is no lock"
    assert mps.main(["resume", str(run)]) == 0 and resumed[0] == "started"
    assert contents(run) == {name: content for name, content in before.items() if name != lock.NAME}


def test_one_process_writes_into_several_folders_but_once_into_each(tmp_path):
    with lock.held(tmp_path / "new" / "a"), lock.held(tmp_path / "b"):
        assert (tmp_path / "b" / lock.NAME).read_text().startswith(f"process {os.getpid()} of ")
        refused = pytest.raises(mps.SceneError, match=f"b: process {os.getpid()} of .* is writing there")
        with refused, lock.held(tmp_path / "b"):
            pass
        (tmp_path / "b" / "result").touch()
    assert [path.name for path in tmp_path.rglob("*")] == ["b", "result"]
    with lock.held(tmp_path / "b"):
        pass


def test_a_lock_that_its_holder_removes_meanwhile_is_taken_anew(tmp_path, monkeypatch):
    """A lock file that its holder removes between opening and locking is opened again."""
    fcntl = pytest.importorskip("fcntl", reason="a file that is open cannot be removed here")
    first, taken = lock.held(tmp_path), fcntl.flock
    first.__enter__()

    def late(file, how):
        monkeypatch.setattr(fcntl, "flock", taken)
        first.__exit__(None, None, None)
        return taken(file, how)

    monkeypatch.setattr(fcntl, "flock", late)
    with lock.held(tmp_path), pytest.raises(mps.SceneError, match="one at a time"), lock.held(tmp_path):
        pass
