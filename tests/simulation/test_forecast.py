"""Forecasts: memory against the peak of whole runs, and the refusal of runs that do not fit; steps and particles of a
pour against integrals in closed form, and their cost against measured pours."""

import json
import re
import sys

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.engine import Problem, memory_of, pairs_of
from taichi_mps.engine.runtime import memory
from taichi_mps.forecast import cost
from taichi_mps.forecast.cost import LANDING_RATIO, cost_of
from tests.support.child import ROOT, child

RESULTS = ROOT / "benchmarks" / "results"
MEASURED = json.loads((RESULTS / "cubic_metre.json").read_text())
L0, SIDE, MOUTH, RATE, VOLUME, G = 0.02, 0.4, 2.0, 0.012, 0.192, 9.81
FULL = VOLUME / RATE  # [s]
RUN = """
import resource, subprocess, sys
run = subprocess.run([sys.executable, "-m", "taichi_mps", "run", *sys.argv[1:], "--quiet"])
print(run.returncode, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
"""


# ---- memory ----------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("scene", "keywords", "numerics", "until"),
    [
        pytest.param("slump", {"spacing": 0.01, "model": "full"}, mps.Implicit(), "0.002", marks=pytest.mark.slow),
        pytest.param("slump", {"spacing": 0.004, "model": "full"}, mps.Implicit(), "0.001", marks=pytest.mark.long),
        pytest.param("slump", {"spacing": 0.0025, "model": "full"}, mps.Implicit(), "0.001", marks=pytest.mark.long),
        pytest.param("slump", {"spacing": 0.0012}, mps.Implicit(), "0.001", marks=pytest.mark.long),
        pytest.param("slump", {"spacing": 0.004, "model": "full"}, mps.SemiImplicit(), "1e-4", marks=pytest.mark.long),
        pytest.param("dam_break", {"spacing": 0.001}, mps.Implicit(), "0.001", marks=pytest.mark.long),
    ],
)
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="a peak in kilobytes is Linux's")
def test_the_memory_is_within_a_fifth_of_the_peak_of_a_first_run(scene, keywords, numerics, until, tmp_path):
    options = [f"--{key}={value}" for key, value in keywords.items()]
    options += [f"--scheme={numerics.scheme}", f"--until={until}", f"--every={until}", f"--out={tmp_path / 'run'}"]
    compiles = {"XDG_CACHE_HOME": str(tmp_path), "TI_OFFLINE_CACHE_FILE_PATH": None}  # it peaks 35 MB higher
    code, peak = child("-c", RUN, scene, *options, **compiles).stdout.split()
    problem = Problem(mps.catalogue.build(scene, **keywords), numerics)
    single, double = (memory_of(problem, pairs_of(problem.scene), precision) for precision in ("f32", "f64"))
    assert code == "0" and single == pytest.approx(1e3 * int(peak), rel=0.2)
    assert single < double < 2.0 * single


def test_what_does_not_fit_is_refused_with_the_smallest_spacing_that_does(monkeypatch):
    mps.init(precision="f32", threads=1)
    monkeypatch.setattr(memory, "memory", lambda: 350_000_000)
    with pytest.raises(mps.SceneError) as refused:
        mps.Simulation(mps.catalogue.build("slump", spacing=0.005, model="full"))
    text = str(refused.value)
    found = re.search(r"spacing = 0\.005 m: its 43992 particles take about (\d+) MB of memory, and 350 MB are", text)
    assert found and 400 < int(found[1]) < 800 and "\n" not in text
    smallest = float(re.search(r"must be at least ([0-9.]+) m", text)[1])
    assert mps.Simulation(mps.catalogue.build("slump", spacing=smallest, model="full"))
    with pytest.raises(mps.SceneError, match="must be at least"):
        mps.Simulation(mps.catalogue.build("slump", spacing=0.9 * smallest, model="full"))
    with pytest.raises(mps.SceneError, match=r"spacing = 0\.001 m: .* particles of a lattice take about .* MB"):
        mps.catalogue.build("slump", spacing=0.001, model="full")  # before it is made


GROUP = {"memory.max": "3000000000", "memory.current": "1000000000", "memory.stat": "inactive_file 400000000"}
FIRST = {"memory.limit_in_bytes": "2000000000", "memory.usage_in_bytes": "500000000"}
NO_LIMIT = {"sys/fs/cgroup/memory/memory.limit_in_bytes": "9223372036854771712"}


@pytest.mark.parametrize(
    ("groups", "files", "left"),
    [
        ("0::/", {"sys/fs/cgroup/memory.max": "max"}, 8_192_000_000),
        ("0::/jobs/7", {f"sys/fs/cgroup/jobs/{name}": text for name, text in GROUP.items()}, 2_400_000_000),
        (
            "9:cpu:/\n4:memory:/a",
            {f"sys/fs/cgroup/memory/a/{k}": v for k, v in FIRST.items()} | NO_LIMIT,
            1_500_000_000,
        ),
    ],
    ids=["the machine", "a control group, whose cache can be dropped", "a control group of the first version"],
)
def test_the_memory_that_is_there(groups, files, left, tmp_path):
    files = {"proc/self/statm": "9 0 0", "proc/meminfo": "MemAvailable: 8000000 kB", "proc/self/cgroup": groups} | files
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(f"{text}\n")
    assert memory.memory(str(tmp_path)) == left


# ---- cost ------------------------------------------------------------------------------------------------------
def poured(**changes):
    """A hose over a box of 0.4 x 0.4 m that it fills to 1.2 m."""
    box = mps.box_planes((0.0, 0.0, 0.0), (SIDE, SIDE, MOUTH))
    return mps.Scene(
        name="box",
        material=mps.Bingham(yield_value=50.0, plastic_viscosity=1e5),  # so viscous that only the jet bounds a step
        spacing=L0,
        fluid=None,
        domain=((-L0, -L0, -L0), (SIDE + L0, SIDE + L0, MOUTH + 4 * L0)),
        walls=box,
        cavity=mps.Cavity((0.0, 0.0, 0.0), (SIDE, SIDE, MOUTH), box, L0),
        inlets=(mps.Inlet((0.2, 0.2, MOUTH), (0.0, 0.0, -1.0), 0.06, RATE, VOLUME),),
        **{"until": FULL} | changes,
    )


def test_steps_are_those_of_a_jet_that_falls_to_a_rising_level():
    """The steps are the integral of U/(C l0) dt with U^2 = LANDING_RATIO^2 (a - b t); the jet falls to a heap as high
    as it is wide."""
    scene = poured()
    a = scene.inlets[0].speed(L0) ** 2 + 2.0 * G * (MOUTH - 2.0 * scene.inlets[0].radius)
    b = 2.0 * G * RATE / SIDE**2
    way = LANDING_RATIO * 2.0 / (3.0 * b) * (a**1.5 - (a - b * FULL) ** 1.5)
    found = cost_of(Problem(scene, mps.Implicit(courant_number=0.1)))
    assert found.steps == pytest.approx(way / (0.1 * L0), rel=0.01)


def test_steps_of_a_nozzle_are_those_of_its_speed():
    """Concrete laid by a nozzle does not fall, however high the layer: 200 mm in 2 s are a fifth of a spacing in 10
    ms."""
    found = cost_of(Problem(mps.catalogue.build("printing", model="path", layers=10, spacing=0.005), mps.Implicit()))
    assert found.steps == pytest.approx(20.0 / 0.01, rel=0.01)


@pytest.mark.parametrize("name", [f"{scheme}-{k}" for scheme in ("implicit", "semi-implicit") for k in (1, 2, 3, 5)])
def test_the_steps_of_the_papers_cases_are_told_within_a_factor_of_two(name):
    """By either scheme, as benchmarks/paper_cases.py ran them; their processor time within one of three."""
    ran = json.loads((RESULTS / f"paper_{name}.json").read_text())["summary"]
    numerics = mps.Implicit() if ran["scheme"] == "implicit" else mps.SemiImplicit()
    told = cost_of(Problem(mps.slump_cone(**ran["parameters"] | {"floor_radius": None}), numerics))
    assert 0.5 < told.steps / ran["steps"] < 2.0
    assert 1 / 3 < told.cpu_seconds / ran["cpu_seconds"] < 3.0


def test_a_short_run_is_told_its_own_steps_and_draws_twenty_pictures():
    """In 0.05 s a cone falls g t^2/2 = 12 mm, a fifth of a spacing in a step; its 7 steps were counted."""
    problem = Problem(mps.slump_cone(until=0.05), mps.Implicit())
    short, whole = cost_of(problem), cost_of(Problem(mps.slump_cone(), mps.Implicit()))
    assert short.steps == pytest.approx(7, abs=1.0)
    assert short.cpu_seconds == pytest.approx(whole.cpu_seconds * short.steps / whole.steps)
    assert 10 <= 0.05 / problem.usual_interval <= 25


def test_each_jolt_of_a_table_is_a_fall_more():
    few, many = (cost_of(Problem(mps.catalogue.build("flow_table", jolts=jolts))).steps for jolts in (3, 15))
    assert many == pytest.approx(16 / 4 * few)


def test_particles_grow_at_the_rate_and_cost_what_was_measured(monkeypatch, tmp_path):
    """The cost is a power of the number of particles between measured sizes, and proportional to it beyond the
    largest; runs of few particles have sizes of their own."""
    monkeypatch.setattr(cost, "MEASURED", tmp_path / "cost.csv")
    (tmp_path / "cost.csv").write_text("100, 1e-3, 0\n10000, 4e-2, 0\n100, 2e-4, 1\n")
    sizes = np.array([1.0, 100.0, 1000.0, 10_000.0, 50_000.0])
    assert cost.seconds_of_a_step(sizes[:3], 1000) == pytest.approx([2e-4, 2e-4, 2e-3])
    told = cost.seconds_of_a_step(sizes, 50_000)
    assert told == pytest.approx([1e-3, 1e-3, (1e-3 * 4e-2) ** 0.5, 4e-2, 2e-1])
    (tmp_path / "cost.csv").write_text("1, 3e-6, 0\n1e6, 3, 0\n")  # 3 us each
    dt, after = 1e-5, 4.0
    found = cost_of(Problem(poured(until=FULL + after), mps.Implicit(max_time_step=dt)))
    particles = VOLUME / L0**3
    assert found.steps == pytest.approx((FULL + after) / dt)
    assert found.cpu_seconds == pytest.approx(3e-6 * (0.5 * particles * FULL + particles * after) / dt, rel=0.01)


@pytest.mark.slow
def test_a_forecast_is_within_thirty_percent_of_a_measured_pour():
    row = MEASURED["small_32"]
    told = cost_of(Problem(mps.catalogue.build("wall", **row["case"])))
    assert (told.steps, told.cpu_seconds) == pytest.approx((row["steps"], row["cpu_s"]), rel=0.3)
