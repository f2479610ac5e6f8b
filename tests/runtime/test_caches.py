"""Cache folders: runs and sweeps finish normally without a home folder, or with one that cannot be written."""

import os

import pytest

from taichi_mps.engine.runtime import caches
from tests.support.child import child

pytestmark = pytest.mark.skipif(os.name != "posix", reason="HOME is not what Taichi asks for there")
COMPILES = "import taichi_mps as mps; mps.init(); mps.runtime.backend.ti.field(float, 3).fill(1.0)"
SHORT = ["--spacing=0.02", "--until=0.002", "--quiet"]


def at(home, folder, *words, cache=None, caches=None):
    """Exit code, and lines of errors, of Python with another HOME, folder of kernels or of all caches; None: without
    one."""
    done = child(
        *words, cwd=folder, HOME=home, TMPDIR=str(folder), TI_OFFLINE_CACHE_FILE_PATH=cache, XDG_CACHE_HOME=caches
    )
    return done.returncode, done.stderr.splitlines()


@pytest.mark.parametrize(
    ("home", "cache", "caches", "unwritable"),
    [
        (None, None, None, ""),
        ("/dev/null", None, None, "/dev/null"),
        (None, "/proc/x", None, "/proc/x"),
        (None, None, "/proc/y", "/proc/y"),
    ],
)
def test_a_process_compiles_and_leaves_nothing_behind(home, cache, caches, unwritable, tmp_path):
    code, said = at(home, tmp_path, "-c", COMPILES, cache=cache, caches=caches)
    warning = f"{unwritable} cannot be written, so compiled kernels are not kept for the next run"
    assert (code, sum(warning in line for line in said), bool(said)) == (0, bool(unwritable), bool(unwritable))
    assert not list(tmp_path.iterdir()), "the temporary folder is still there"


def test_compiled_kernels_lie_where_they_are_looked_for(tmp_path):
    """Where the kernels are is where Taichi puts them: a forecast looks there for whether a run is the first."""
    assert at(os.environ["HOME"], tmp_path, "-c", COMPILES, caches=str(tmp_path / "caches"))[0] == 0
    told = (
        "from taichi_mps.engine.runtime import caches, workarounds; "
        "assert any(caches.kernels(workarounds.LANGUAGE).glob('*/*'))"
    )
    assert at(os.environ["HOME"], tmp_path, "-c", told, caches=str(tmp_path / "caches"))[0] == 0
    assert at(os.environ["HOME"], tmp_path, "-c", told, caches=str(tmp_path / "others"))[0] == 1


def test_on_windows_kernels_lie_in_the_folder_of_the_user(monkeypatch, tmp_path):
    """Not in C:/taichi_cache, which all users share."""
    monkeypatch.setattr("sys.platform", "win32")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("QD_OFFLINE_CACHE_FILE_PATH", "")
    caches.set_cache_folders("quadrants")
    assert os.environ["QD_OFFLINE_CACHE_FILE_PATH"] == str(tmp_path / "quadrants")


@pytest.mark.long
@pytest.mark.parametrize("home", [None, "/dev/null"])
def test_a_run_and_a_sweep_come_to_their_end(home, tmp_path):
    code, _ = at(home, tmp_path, "-m", "taichi_mps", "run", "film", *SHORT, "--threads=1", "--out=run")
    assert code == 0 and (tmp_path / "run" / "summary.json").is_file()
    code, said = at(home, tmp_path, "-m", "taichi_mps", "sweep", "film", *SHORT, "--angle=10", "--workers=1")
    assert code == 0 and "done" in (tmp_path / "studies" / "film" / "results.csv").read_text()
    assert sum("cannot be written" in line for line in said) == (home is not None)


def test_a_sweep_in_which_a_case_fails_says_which(tmp_path):
    words = ["sweep", "film", *SHORT, "--angle=10,20", "--depth=1e-9", "--workers=1"]
    code, said = at(os.environ["HOME"], tmp_path, "-m", "taichi_mps", *words)
    assert code == 1 and sum("failed: angle = " in line for line in said) == 2, said
