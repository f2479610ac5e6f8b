"""Slurm: a job that dies is a row with its reason, and the jobs of a study that was killed are found again."""

import shutil
import subprocess
from pathlib import Path
from types import SimpleNamespace

import pytest

from taichi_mps.study.slurm import Jobs
from taichi_mps.study.sweep import LOST, carry_out
from taichi_mps.units import SceneError
from tests.support import study_cases

ROOT = Path(__file__).resolve().parents[2]


class Cluster:
    """What a study sees of submitit and Slurm: jobs by number, each with a file once it has a result.

    Cases are computed at once, but those of the numbers ``waiting``; the first job of one that ``dies`` has no result
    and leaves the queue. There is room for ``most`` jobs."""

    def __init__(self, folder, waiting=(), dies=(), most=100):
        self.folder, self.waiting, self.dies, self.most = folder, waiting, list(dies), most
        self.given, self.results, self.queue, self.cancelled = [], {}, set(), []
        folder.mkdir(parents=True, exist_ok=True)

    def submit(self, run, case):
        if len(self.given) == self.most:
            raise OSError("sbatch: error: too many jobs")
        job_id, number = str(len(self.given)), case.parameters["number"]
        self.given.append((run, case))
        if number in self.waiting:
            self.queue.add(job_id)
        elif number in self.dies:
            self.dies.remove(number)
        else:
            self.finish(job_id)
        return self.job_class(self.folder, job_id)

    def finish(self, job_id):
        run, case = self.given[int(job_id)]
        self.results[job_id] = run(case)
        (self.folder / job_id).touch()
        self.queue.discard(job_id)

    def job_class(self, folder, job_id):
        return Job(
            job_id=job_id,
            paths=SimpleNamespace(result_pickle=folder / job_id),
            result=lambda: self.results[job_id],
            exception=lambda: None,
            cancel=lambda check: self.cancelled.append(job_id),
        )


class Job(SimpleNamespace):
    __hash__ = object.__hash__  # jobs are keys


def jobs(cluster):
    return Jobs(cluster, "slurm://here", lambda: set(cluster.queue), look_every=0.01, ask_every=0.05)


@pytest.fixture
def notes(tmp_path):
    (tmp_path / "notes").mkdir()
    return tmp_path / "notes"


def test_a_job_that_dies_without_a_word_is_a_row_with_its_reason(tmp_path, notes):
    cluster = Cluster(tmp_path / "s" / "slurm-jobs", dies=[2])
    (tmp_path / "s" / "journal.jsonl").touch()
    with jobs(cluster) as executor:
        rows = carry_out(study_cases.planned(4, notes), tmp_path / "s", study_cases.plain, executor)
    assert [row["status"] for row in rows] == ["done", "done", LOST, "done"]
    assert "job 2 ended without a result" in rows[2]["reason"] and not cluster.cancelled
    with jobs(cluster) as executor:
        rows = carry_out(study_cases.planned(4, notes), tmp_path / "s", study_cases.plain, executor)
    assert [row["status"] for row in rows] == ["done"] * 4 and len(cluster.given) == 5


def test_the_jobs_of_a_study_that_was_killed_are_found_again(tmp_path, notes):
    """Two jobs came to their end while nobody looked, one still waits: none is given again."""
    cluster, planned = Cluster(tmp_path / "slurm-jobs", waiting=[1]), study_cases.planned(3, notes)
    killed = jobs(cluster)
    for case in planned:
        killed.submit(study_cases.plain, case)
    killed.over.set()  # as if it were gone: nothing is cancelled
    killed.thread.join()
    executor = jobs(cluster)
    futures = [executor.submit(study_cases.plain, case) for case in planned]
    assert [futures[k].result(5)["number"] for k in (0, 2)] == [0, 2] and not futures[1].done()
    cluster.finish("1")
    assert futures[1].result(5)["number"] == 1
    assert len(cluster.given) == 3 and [path.stat().st_size for path in notes.iterdir()] == [1, 1, 1]
    executor.shutdown()


def test_an_interrupted_study_cancels_its_jobs_and_gives_them_anew(tmp_path, notes):
    cluster, (case,) = Cluster(tmp_path / "slurm-jobs", waiting=[0]), study_cases.planned(1, notes)
    for count in (1, 2):
        executor = jobs(cluster)
        executor.submit(study_cases.plain, case)
        executor.shutdown()
        assert cluster.cancelled == [str(k) for k in range(count)] and len(cluster.given) == count


def test_what_sbatch_refuses_is_said(tmp_path, notes):
    cluster = Cluster(tmp_path / "slurm-jobs", waiting=[0, 1], most=2)
    refused = pytest.raises(SceneError, match="slurm://here: sbatch: error: too many jobs; after 2 jobs, --workers")
    with refused, jobs(cluster) as executor:
        carry_out(study_cases.planned(3, notes), tmp_path / "s", study_cases.plain, executor)
    assert cluster.cancelled == ["0", "1"]


@pytest.mark.long
def test_a_real_slurm_whose_job_is_cancelled(tmp_path, notes, monkeypatch):
    pytest.importorskip("submitit", reason="needs submitit: pip install 'taichi-mps[cluster]'")
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
