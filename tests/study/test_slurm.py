"""Slurm: a job that dies is a row with its reason, jobs of a killed study are found again, and no file in their folder
is run."""

import os
import shutil
import subprocess
from pathlib import Path
from threading import Semaphore

import pytest

from taichi_mps.study import slurm
from taichi_mps.study.slurm import Jobs, Processes, main, row_of
from taichi_mps.study.sweep import LOST, carry_out
from taichi_mps.units import SceneError
from tests.support import study_cases

ROOT = Path(__file__).resolve().parents[2]


class Cluster:
    """Jobs by number. They are computed at once, but those of the cases ``waiting``; the first job of one that
    ``dies`` has no result and leaves the queue. There is room for ``most`` jobs."""

    def __init__(self, waiting=(), dies=(), most=100):
        self.waiting, self.dies, self.most = waiting, list(dies), most
        self.given, self.queue, self.cancelled, self.waits = [], set(), [], Semaphore(0)

    def submit(self, command, name, log):
        if len(self.given) == self.most:
            raise OSError("sbatch: error: too many jobs")
        job, number = f"{name}:{len(self.given)}", int(name.removeprefix("case"))
        self.given.append(command[3:])
        if number in self.waiting:
            self.queue.add(job)
            self.waits.release()
        elif number in self.dies:
            self.dies.remove(number)
            log.write_text("out of \x1b[31mmemory\n")
        else:
            main(*command[3:])
        return job

    def queued(self):
        return set(self.queue)

    def state(self, number):
        return "OUT_OF_MEMORY"

    def cancel(self, number):
        self.cancelled.append(number)


def jobs(cluster, folder):
    return Jobs(cluster, "slurm://here", folder / "slurm-jobs")


@pytest.fixture
def notes(tmp_path, monkeypatch):
    """Of the cases, which look for results and ask for jobs more often, and are found by processes."""
    (tmp_path / "notes").mkdir()
    monkeypatch.setattr(slurm, "POLL_INTERVAL", 0.01)
    monkeypatch.setattr(slurm, "QUEUE_INTERVAL", 0.3)
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    return tmp_path / "notes"


def test_a_job_that_dies_without_a_word_is_a_row_with_its_reason(tmp_path, notes):
    cluster, planned = Cluster(dies=[2]), study_cases.planned(4, notes)
    for status, count in ((LOST, 4), ("done", 5)):
        with jobs(cluster, tmp_path) as executor:
            rows = carry_out(planned, tmp_path / "s", study_cases.plain, executor)
        assert [row["status"] for row in rows] == ["done", "done", status, "done"] and len(cluster.given) == count
        assert status != LOST or rows[2]["reason"].endswith(r" without a result (OUT_OF_MEMORY): out of \x1b[31mmemory")
    assert not cluster.cancelled


def test_the_jobs_of_a_study_that_was_killed_are_found_again(tmp_path, notes):
    """Two jobs that ended after the study was killed and one that still waits are found, and none is submitted
    again."""
    cluster, planned = Cluster(waiting=[1]), study_cases.planned(3, notes)
    killed = jobs(cluster, tmp_path)
    for case in planned:
        killed.new_job(study_cases.plain, case)
    with jobs(cluster, tmp_path) as executor:
        futures = [executor.submit(study_cases.plain, case) for case in planned]
        assert [futures[k].result(5)["number"] for k in (0, 2)] == [0, 2] and not futures[1].done()
        main(*cluster.given[1])
        assert futures[1].result(5)["number"] == 1
    assert len(cluster.given) == 3 and [*study_cases.runs(notes).values()] == [1, 1, 1] and not cluster.cancelled


def test_an_interrupted_study_cancels_its_jobs_and_gives_them_anew(tmp_path, notes):
    cluster, (case,) = Cluster(waiting=[0]), study_cases.planned(1, notes)
    for count in (1, 2):
        with jobs(cluster, tmp_path) as executor:
            executor.submit(study_cases.plain, case)
            assert cluster.waits.acquire(timeout=20.0)
        assert cluster.cancelled == [f"case0:{k}" for k in range(count)] and len(cluster.given) == count


def test_what_sbatch_refuses_is_said(tmp_path, notes):
    cluster = Cluster(waiting=[0, 1, 2], most=2)
    refused = pytest.raises(SceneError, match="slurm://here: sbatch: error: too many jobs; --workers bounds")
    with refused, jobs(cluster, tmp_path) as executor:
        carry_out(study_cases.planned(3, notes), tmp_path / "s", study_cases.plain, executor)
    assert len(cluster.cancelled) == 2


def test_an_sbatch_that_never_answers_is_asked_once(tmp_path, notes, monkeypatch):
    command_of(tmp_path, "sbatch", "echo . >> asked\nexec sleep 60")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")
    monkeypatch.setattr(slurm, "COMMAND_TIMEOUT", 0.5)
    with pytest.raises(SceneError, match=r"slurm://here: sbatch did not answer within 0.5 s"):
        carry_out(study_cases.planned(3, notes), tmp_path / "s", study_cases.plain, "slurm://here")
    assert (tmp_path / "asked").read_text() == ".\n"


# ---- data is never run ----------------------------------------------------------------------------------------------
def test_jobs_of_this_machine_go_by_nothing_that_lies_in_their_folder(tmp_path, notes):
    """Jobs, results and logs of somebody else in the folder are ignored."""
    folder, planned = tmp_path / "s" / "slurm-jobs", study_cases.planned(3, notes)
    folder.mkdir(parents=True)
    (tmp_path / "s" / "journal.jsonl").touch()
    for case in planned:
        for kind in ("json", "log", "job"):
            (folder / f"{case.key}.{kind}").write_text("7")
    first, again = (
        carry_out(planned, tmp_path / "s", study_cases.raises_at_two_at_first, "slurm://local") for _ in range(2)
    )
    assert [row["status"] for row in first] == ["done", "done", LOST]
    assert first[2]["reason"].endswith(" without a result (exit 1): OSError: the disk is gone")
    assert [row["number"] for row in again] == [0, 1, 2]


def test_a_job_of_this_machine_ends_when_its_time_is_up(tmp_path, notes):
    (case,) = study_cases.planned(3, notes)[2:]
    with Jobs(Processes(seconds=0.0), "slurm://local", tmp_path / "jobs") as executor:
        error = executor.submit(study_cases.waits_at_two_at_first, case).exception(20)
    assert "ended without a result (TIMEOUT)" in str(error)
    with pytest.raises(SceneError, match="timeout_min and mem_gb must be numbers"):
        slurm.slurm("slurm://local?timeout_min=soon", tmp_path, None)


@pytest.mark.parametrize(
    "text",
    [
        "[]",
        "{",
        "[" * 100_000,
        '{"key": "a", "status": "done", "x": {"y": 1}}',
        '{"key": "b", "status": "done"}',
        '{"key": "a", "status": 3}',
        '{"status": "done"}',
    ],
)
def test_a_result_is_a_row_of_its_case(tmp_path, text):
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(RuntimeError, match="job 5: .* is no result of this case"):
        row_of(tmp_path / "a.json", "a", "5")


def test_nothing_in_the_package_runs_data():
    """No module that can run what it reads is imported, and no such function is called."""
    found, words = [], ("pickle", "marshal", "shelve", "yaml", "dill", "joblib", " eval(", "=eval(", " exec(")
    for path in [*(ROOT / "taichi_mps").rglob("*.py"), *(ROOT / "scenes").glob("*.py")]:
        text = path.read_text(encoding="utf-8")
        found += [(path.name, word) for word in words if word in text]
    assert [name for name in found if name != ("slurm.py", "pickle")] == []  # its docstring says why there are none


# ---- the commands of Slurm ----------------------------------------------------------------------------------------
def command_of(folder, name, text):
    """A program in the way of the real one."""
    (folder / name).write_text(f"#!/bin/sh\n{text}\n")
    (folder / name).chmod(0o755)


def test_what_slurm_is_told(tmp_path, monkeypatch):
    command_of(tmp_path, "sbatch", f'printf "%s\\n" "$@" > {tmp_path}/told; echo "41;here"')
    command_of(tmp_path, "squeue", "echo 41; echo 42")
    command_of(tmp_path, "scontrol", "echo '   JobState=TIMEOUT Reason=None'")
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    cluster = slurm.slurm("slurm://short?timeout_min=5&mem_gb=2&account=me&nodes_per_x=1", tmp_path, None).cluster
    assert cluster.submit(["python", "it's", "a b"], "case", tmp_path / "log") == "41"
    told = (tmp_path / "told").read_text().splitlines()
    assert {"--partition=short", "--mem=2048M", "--account=me", "--nodes-per-x=1", "--time=5"} <= set(told)
    assert told[-1] == "--wrap=python 'it'\"'\"'s' 'a b'"
    assert cluster.queued() == {"41", "42"} and cluster.state("41") == "TIMEOUT"
    command_of(tmp_path, "sbatch", "echo 'sbatch: error: no such partition' >&2; exit 1")
    for name in ("squeue", "scontrol"):
        command_of(tmp_path, name, "exit 1")
    with pytest.raises(OSError, match="no such partition"):
        cluster.submit(["python"], "case", tmp_path / "log")
    assert cluster.state("41") == "no longer known"
    with pytest.raises(OSError, match="squeue"):
        cluster.queued()


@pytest.mark.long
def test_a_real_slurm_whose_job_is_cancelled(tmp_path, notes):
    asked = shutil.which("sinfo") and subprocess.run(["sinfo", "-h", "-o", "%R"], capture_output=True, text=True)
    if not asked or asked.returncode or not asked.stdout.split():
        pytest.skip("needs a Slurm cluster: sinfo names no partition")
    address, out = f"slurm://{asked.stdout.split()[0]}?timeout_min=5&mem_gb=1", tmp_path / "s"

    def cancel(rows, total):
        if len(rows) == total - 1:
            subprocess.run(["scancel", (out / "slurm-jobs" / "case2.job").read_text()], check=True)

    planned = study_cases.planned(4, notes)
    rows = carry_out(planned, out, study_cases.waits_at_two_at_first, address, watch=cancel)
    assert [row["status"] for row in rows] == ["done", "done", LOST, "done"] and "(CANCELLED)" in rows[2]["reason"]
    rows = carry_out(planned, out, study_cases.waits_at_two_at_first, address)
    assert [row["number"] for row in rows] == [0, 1, 2, 3] and {row["status"] for row in rows} == {"done"}
    assert [*study_cases.runs(notes).values()] == [1, 1, 2, 1]
