"""Memory is admitted before anything is allocated: the estimate beside the peak of whole runs, and what is refused."""

import re
import subprocess
import sys

import pytest

import taichi_mps as mps
from taichi_mps import memory
from taichi_mps.problem import catalogue
from taichi_mps.problem.problem import Problem
from taichi_mps.simulation import simulation
from taichi_mps.simulation.memory_estimate import estimate

RUN = """
import resource, subprocess, sys
run = subprocess.run([sys.executable, "-m", "taichi_mps", "run", *sys.argv[1:], "--quiet"])
print(run.returncode, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
"""


@pytest.mark.parametrize(
    ("scene", "keywords", "numerics", "until"),
    [
        ("slump", {"spacing": 0.01, "model": "full"}, mps.Implicit(), "0.002"),
        pytest.param("slump", {"spacing": 0.004, "model": "full"}, mps.Implicit(), "0.001", marks=pytest.mark.long),
        pytest.param("slump", {"spacing": 0.0025, "model": "full"}, mps.Implicit(), "0.001", marks=pytest.mark.long),
        pytest.param("slump", {"spacing": 0.0012}, mps.Implicit(), "0.001", marks=pytest.mark.long),
        pytest.param("slump", {"spacing": 0.004, "model": "full"}, mps.SemiImplicit(), "1e-4", marks=pytest.mark.long),
        pytest.param("dam_break", {"spacing": 0.001}, mps.Implicit(), "0.001", marks=pytest.mark.long),
    ],
)
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="a peak in kilobytes is Linux's")
def test_the_estimate_is_within_a_fifth_of_the_peak_of_a_run(scene, keywords, numerics, until, tmp_path):
    options = [f"--{key}={value}" for key, value in keywords.items()]
    options += [f"--scheme={numerics.scheme}", f"--until={until}", f"--every={until}", f"--out={tmp_path / 'run'}"]
    printed = subprocess.run(
        [sys.executable, "-c", RUN, scene, *options], capture_output=True, text=True, check=True
    ).stdout.split()
    assert printed[0] == "0"
    mps.init(precision="f32", threads=1)
    problem = Problem(catalogue.build(scene, **keywords), numerics)
    found = estimate(problem, 0, simulation.pairs_of(problem.scene))
    assert found == pytest.approx(1e3 * int(printed[1]), rel=0.2)
    assert found < estimate(problem, 0, simulation.pairs_of(problem.scene), precision="f64") < 2.0 * found


def refusal(spacing):
    with pytest.raises(mps.SceneError) as refused:
        mps.Simulation(catalogue.build("slump", spacing=spacing, model="full"))
    return str(refused.value)


def test_what_does_not_fit_is_refused_with_the_smallest_spacing_that_does(monkeypatch):
    monkeypatch.setattr(memory, "memory", lambda: 350_000_000)
    text = refusal(0.005)
    found = re.search(r"spacing = 0\.005 m: its 43992 particles take about (\d+) MB of memory, and 350 MB are", text)
    assert found and 400 < int(found[1]) < 800 and "\n" not in text
    smallest = float(re.search(r"must be at least ([0-9.]+) m", text)[1])
    assert mps.Simulation(catalogue.build("slump", spacing=smallest, model="full"))
    assert "must be at least" in refusal(0.9 * smallest)


def test_a_lattice_that_does_not_fit_is_refused_before_it_is_made(monkeypatch):
    monkeypatch.setattr(memory, "memory", lambda: 400_000_000)
    with pytest.raises(mps.SceneError, match=r"spacing = 0\.001 m: .* particles of a lattice take about .* MB"):
        catalogue.build("slump", spacing=0.001, model="full")


def a_system(root, files):
    for name, text in {"proc/self/statm": "9 0 0", "proc/meminfo": "MemAvailable: 8000000 kB\n", **files}.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text)
    return memory.memory(str(root))


def test_the_machine_bounds_the_memory(tmp_path):
    assert a_system(tmp_path, {"proc/self/cgroup": "0::/\n", "sys/fs/cgroup/memory.max": "max\n"}) == 8_192_000_000


def test_a_control_group_bounds_the_memory_and_its_cache_can_be_dropped(tmp_path):
    group = {"memory.max": "3000000000\n", "memory.current": "1000000000\n", "memory.stat": "inactive_file 400000000\n"}
    files = {f"sys/fs/cgroup/jobs/memory.{name.split('.')[1]}": text for name, text in group.items()}
    assert a_system(tmp_path, {"proc/self/cgroup": "0::/jobs/7\n", **files}) == 2_400_000_000


def test_a_control_group_of_the_first_version_bounds_it_too(tmp_path):
    group = {"limit_in_bytes": "2000000000", "usage_in_bytes": "500000000"}
    files = {f"sys/fs/cgroup/memory/job/memory.{name}": text for name, text in group.items()}
    files["sys/fs/cgroup/memory/memory.limit_in_bytes"] = "9223372036854771712"
    assert a_system(tmp_path, {"proc/self/cgroup": "9:cpu:/\n4:memory:/job\n", **files}) == 1_500_000_000
