"""Without a home, or with one that cannot be written, runs and sweeps come to their end."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
pytestmark = pytest.mark.skipif(os.name != "posix", reason="HOME is not what Taichi asks for there")
SHORT = ["--spacing=0.02", "--until=0.002", "--quiet"]


def taichi_mps(home, folder, *words):
    """Exit code and errors of the program with another HOME; None: without one."""
    variables = {k: v for k, v in os.environ.items() if k not in ("HOME", "TI_OFFLINE_CACHE_FILE_PATH", "MPLCONFIGDIR")}
    variables |= {"PYTHONPATH": str(ROOT), "TMPDIR": str(folder)} | ({} if home is None else {"HOME": home})
    command = [sys.executable, "-m", "taichi_mps", *words]
    done = subprocess.run(command, cwd=folder, env=variables, capture_output=True, text=True)
    return done.returncode, done.stderr


@pytest.mark.parametrize("home", [pytest.param(None, marks=pytest.mark.long), "/dev/null"])
def test_a_run(home, tmp_path):
    code, said = taichi_mps(home, tmp_path, "run", "film", *SHORT, "--threads=1", "--out=run")
    assert code == 0 and (tmp_path / "run" / "summary.json").is_file()
    one_line = [f"taichi-mps: {home} cannot be written, so compiled kernels are not kept for the next run"]
    assert said.splitlines() == ([] if home is None else one_line)
    assert [path.name for path in tmp_path.iterdir()] == ["run"], "the temporary folder is still there"


def test_a_sweep_whose_processes_have_no_home(tmp_path):
    code, said = taichi_mps("/dev/null", tmp_path, "sweep", "film", *SHORT, "--angle=10", "--workers=1")
    assert code == 0 and "done" in (tmp_path / "studies" / "film" / "results.csv").read_text()
    assert said.count("cannot be written") == 1


def test_a_sweep_in_which_a_case_fails_says_which(tmp_path):
    words = ["sweep", "film", *SHORT, "--angle=10,20", "--depth=1e-9", "--workers=1"]
    code, said = taichi_mps(os.environ["HOME"], tmp_path, *words)
    assert code == 1
    lines = said.splitlines()
    assert len(lines) == 2 and all("failed: angle = " in line for line in lines), said
