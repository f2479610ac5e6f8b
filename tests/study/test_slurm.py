"""Slurm: a job that dies is a row with its reason, the jobs of a study that was killed are found again, and nothing
that lies in their folder is run."""

import json
import os
import pickle
import shutil
import stat
import subprocess
import sys
from pathlib import Path

import pytest

import taichi_mps as mps
from taichi_mps.study.job import main, words
from taichi_mps.study.slurm import Jobs, Slurm, row_of
from taichi_mps.study.sweep import LOST, carry_out
from taichi_mps.units import SceneError
from tests.support import study_cases

ROOT = Path(__file__).resolve().parents[2]
ENDED, ROOM = "ended without a result", 100


class Cluster:
    """Jobs by number. They are computed at once, but those of the numbers ``waiting``; the first job of one that
    ``dies`` has no result and leaves the queue. There is room for ``most`` jobs."""

    def __init__(self, waiting=(), dies=(), most=ROOM):
        self.waiting, self.dies, self.most = waiting, list(dies), most
        self.given, self.queue, self.cancelled = [], set(), []

    def submit(self, command, name, log):
        if len(self.given) == self.most:
            raise OSError("sbatch: error: too many jobs")
        job, arguments = str(len(self.given)), command[3:]
        number = dict(json.loads(arguments[1])[1])["number"]
        self.given.append(arguments)
        if number in self.waiting:
            self.queue.add(job)
        elif number in self.dies:
            self.dies.remove(number)
            log.write_text("out of \x1b[31mmemory\n")
        else:
            main(*arguments)
        return job

    def finish(self, job):
        main(*self.given[int(job)])
        self.queue.discard(job)

    def queued(self):
        return set(self.queue)

    def last_state(self, number):
        return "OUT_OF_MEMORY"

    def cancel(self, number):
        self.cancelled.append(number)


def jobs(cluster, folder):
    return Jobs(cluster, "slurm://here", folder / "slurm-jobs", look_every=0.01, ask_every=0.05)


@pytest.fixture
def notes(tmp_path):
    (tmp_path / "notes").mkdir()
    return tmp_path / "notes"


def test_a_job_that_dies_without_a_word_is_a_row_with_its_reason(tmp_path, notes):
    cluster = Cluster(dies=[2])
    with jobs(cluster, tmp_path) as executor:
        rows = carry_out(study_cases.planned(4, notes), tmp_path / "s", study_cases.plain, executor)
    assert [row["status"] for row in rows] == ["done", "done", LOST, "done"]
    assert rows[2]["reason"].endswith(r"job 2 ended without a result (OUT_OF_MEMORY): out of \x1b[31mmemory")
    assert not cluster.cancelled
    with jobs(cluster, tmp_path) as executor:
        rows = carry_out(study_cases.planned(4, notes), tmp_path / "s", study_cases.plain, executor)
    assert [row["status"] for row in rows] == ["done"] * 4 and len(cluster.given) == 5


def test_the_jobs_of_a_study_that_was_killed_are_found_again(tmp_path, notes):
    """Two jobs came to their end while nobody looked, one still waits: none is given again."""
    cluster, planned = Cluster(waiting=[1]), study_cases.planned(3, notes)
    killed = jobs(cluster, tmp_path)
    for case in planned:
        killed.submit(study_cases.plain, case)
    killed.over.set()  # as if it were gone: nothing is cancelled
    killed.thread.join()
    executor = jobs(cluster, tmp_path)
    futures = [executor.submit(study_cases.plain, case) for case in planned]
    assert [futures[k].result(5)["number"] for k in (0, 2)] == [0, 2] and not futures[1].done()
    cluster.finish("1")
    assert futures[1].result(5)["number"] == 1
    assert len(cluster.given) == 3 and [path.stat().st_size for path in notes.iterdir()] == [1, 1, 1]
    executor.shutdown()


def test_an_interrupted_study_cancels_its_jobs_and_gives_them_anew(tmp_path, notes):
    cluster, (case,) = Cluster(waiting=[0]), study_cases.planned(1, notes)
    for count in (1, 2):
        executor = jobs(cluster, tmp_path)
        executor.submit(study_cases.plain, case)
        executor.shutdown()
        assert cluster.cancelled == [str(k) for k in range(count)] and len(cluster.given) == count


def test_what_sbatch_refuses_is_said(tmp_path, notes):
    cluster = Cluster(waiting=[0, 1], most=2)
    refused = pytest.raises(SceneError, match="slurm://here: sbatch: error: too many jobs; after 2 jobs, --workers")
    with refused, jobs(cluster, tmp_path) as executor:
        carry_out(study_cases.planned(3, notes), tmp_path / "s", study_cases.plain, executor)
    assert cluster.cancelled == ["0", "1"]


# ---- data is never run ----------------------------------------------------------------------------------------------
class Trap:
    """Unpickled, it makes a file."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return os.mkdir, (str(self.path),)


def test_planted_files_are_not_run(tmp_path, notes):
    """In the folder of the jobs lie pickles by all names that it has and submitit's had, as a job and as a result."""
    folder, sprung = tmp_path / "s" / "slurm-jobs", tmp_path / "sprung"
    folder.mkdir(parents=True)
    (tmp_path / "s" / "journal.jsonl").touch()
    planned = study_cases.planned(2, notes)
    kinds = ("json", "log", "pkl", "sh")
    names = [f"{case.key}.{kind}" for case in planned for kind in kinds]
    names += [f"{job}{end}" for job in (7, "7_0") for end in ("_0_result.pkl", "_result.pkl", "_submitted.pkl")]
    for name in names:
        (folder / name).write_bytes(pickle.dumps(Trap(sprung)))
    for case in planned:
        (folder / f"{case.key}.job").write_text("7")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(ROOT))
        rows = carry_out(planned, tmp_path / "s", study_cases.plain, "slurm://local?timeout_min=1")
    assert [(row["status"], row["number"]) for row in rows] == [("done", 0), ("done", 1)]
    assert not sprung.exists()


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("[]", "is no result"),
        ("{", "is no result"),
        ('{"key": "a", "status": "done", "x": {"y": 1}}', "is no result"),
        ('{"key": "b", "status": "done"}', "is the result of another case"),
        ('{"key": "a", "status": 3}', "is the result of another case"),
        ('{"error": "\\u001b[2J"}', r"job 5: \\x1b\[2J"),
    ],
)
def test_a_result_is_a_row_of_its_case(tmp_path, text, reason):
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(RuntimeError, match=reason):
        row_of(tmp_path / "a.json", "a", "5")


def test_nothing_in_the_package_runs_data():
    """No module that can run what it reads is imported, and no such function called."""
    found = []
    for path in [*(ROOT / "taichi_mps").rglob("*.py"), *(ROOT / "scenes").glob("*.py")]:
        text = path.read_text(encoding="utf-8")
        found += [
            (path.name, word) for word in ("pickle", "marshal", "shelve", "yaml", "dill", "joblib") if word in text
        ]
        found += [(path.name, word) for word in (" eval(", "=eval(", " exec(") if word in text]
    assert [name for name in found if name != ("slurm.py", "pickle")] == []  # its docstring says why there are none


# ---- jobs -----------------------------------------------------------------------------------------------------------
def test_a_job_whose_time_is_up_says_so(tmp_path, notes):
    case = study_cases.planned(3, notes)[2]
    command = [sys.executable, "-m", "taichi_mps.study.job"]
    command += words(study_cases.waits_at_two_at_first, case, tmp_path / "row.json", 0.03)
    subprocess.run(command, cwd=ROOT, check=True, timeout=60)
    with pytest.raises(RuntimeError, match=r"job 1: stopped, its 0\.03 minutes are up; timeout_min= gives more time"):
        row_of(tmp_path / "row.json", case.key, "1")


def test_jobs_of_this_machine(tmp_path, notes, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    planned = study_cases.planned(3, notes)
    rows = carry_out(planned, tmp_path / "s", study_cases.raises_at_two_at_first, "slurm://local")
    assert [row["status"] for row in rows] == ["done", "done", LOST] and "the disk is gone" in rows[2]["reason"]
    rows = carry_out(planned, tmp_path / "s", study_cases.raises_at_two_at_first, "slurm://local")
    assert [row["status"] for row in rows] == ["done"] * 3
    with pytest.raises(mps.SceneError, match="timeout_min and mem_gb must be numbers above 0"):
        carry_out(planned, tmp_path / "t", study_cases.plain, "slurm://local?timeout_min=soon")


def command_of(folder, name, text):
    """A program in the way of the real one."""
    path = folder / name
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)


def test_what_slurm_is_told(tmp_path, monkeypatch):
    command_of(tmp_path, "sbatch", f'printf "%s\\n" "$@" > {tmp_path}/told; echo "41;here"')
    command_of(tmp_path, "squeue", "echo 41; echo 42")
    command_of(tmp_path, "scontrol", "echo JobId=41 JobState=TIMEOUT Reason=None")
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    cluster = Slurm({"partition": "short", "mem": "2048M", "account": "me", "nodes_per_x": "1"}, 5.0)
    assert cluster.submit(["python", "it's", "a b"], "case", tmp_path / "log") == "41"
    told = (tmp_path / "told").read_text().splitlines()
    assert {"--partition=short", "--mem=2048M", "--account=me", "--nodes-per-x=1", "--time=5"} <= set(told)
    assert told[-1] == "--wrap=python 'it'\"'\"'s' 'a b'"
    assert cluster.queued() == {"41", "42"} and cluster.last_state("41") == "TIMEOUT"
    command_of(tmp_path, "sbatch", "echo 'sbatch: error: no such partition' >&2; exit 1")
    with pytest.raises(OSError, match="no such partition"):
        cluster.submit(["python"], "case", tmp_path / "log")


@pytest.mark.long
def test_a_real_slurm_whose_job_is_cancelled(tmp_path, notes, monkeypatch):
    asked = shutil.which("sinfo") and subprocess.run(["sinfo", "-h", "-o", "%R"], capture_output=True, text=True)
    if not asked or asked.returncode or not asked.stdout.split():
        pytest.skip("needs a Slurm cluster: sinfo names no partition")
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    address, out = f"slurm://{asked.stdout.split()[0]}?timeout_min=5&mem_gb=1", tmp_path / "s"

    def cancel(rows, total):
        if len(rows) == total - 1:
            subprocess.run(["scancel", (out / "slurm-jobs" / "case2.job").read_text()], check=True)

    planned = study_cases.planned(4, notes)
    rows = carry_out(planned, out, study_cases.waits_at_two_at_first, address, watch=cancel)
    assert [row["status"] for row in rows] == ["done", "done", LOST, "done"] and "CANCELLED" in rows[2]["reason"]
    rows = carry_out(planned, out, study_cases.waits_at_two_at_first, address)
    assert [row["number"] for row in rows] == [0, 1, 2, 3] and {row["status"] for row in rows} == {"done"}
    assert {path.name: path.stat().st_size for path in notes.iterdir()} == {
        "case0": 1,
        "case1": 1,
        "case2": 2,
        "case3": 1,
    }
