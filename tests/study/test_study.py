"""Studies: every case is computed once, no row is lost when a process dies, and mixes of one law share their
kernels."""

import json
import re
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.cli.study import outcome
from taichi_mps.engine.problem.problem import Problem
from taichi_mps.engine.problem.time_step import longest_step
from taichi_mps.engine.runtime.memory import ShortOfMemoryError
from taichi_mps.forecast.accuracy import choices
from taichi_mps.study import case as cases
from taichi_mps.study import sweep
from taichi_mps.study.reuse import begin, shape_of
from taichi_mps.study.sweep import ACCURACY, LOST, run_cases, run_side_by_side, values
from taichi_mps.study.sweep import cases as combinations
from taichi_mps.study.tables import open_results, read
from tests.support import study_cases
from tests.support.child import ROOT, begun


# ---- what is to be computed ------------------------------------------------------------------------------------
def test_values_in_equal_ratios_and_equal_steps():
    assert values("20,50, 100") == ["20", "50", "100"] and values("full") == ["full"]
    assert values("1:16:5") == ["1", "2", "4", "8", "16"]
    assert values("-1:1:3:linear") == ["-1", "0", "1"]


@pytest.mark.parametrize("text", ["1:2", "1:2:1", "1:2:x", "0:2:3", "1:2:3:log", "1:inf:3", "1:2:3:linear:4"])
def test_bad_values_are_refused(text):
    with pytest.raises(mps.SceneError, match=f"yield_value = {text}: "):
        values(text, "yield_value")


def test_a_key_is_the_scene_and_all_its_parameters(tmp_path):
    known = cases.case_of("slump", yield_value="300")
    assert (
        known.key == cases.case_of("slump", yield_value=300.0, plastic_viscosity=50).key == cases.case_of("slump").key
    )
    assert known.key != cases.case_of("slump", yield_value=301.0).key
    changed = tmp_path / "slump.py"
    changed.write_text(Path(mps.catalogue.locate("slump")).read_text() + "\n")
    assert known.key != cases.case_of(str(changed), yield_value=300.0).key
    with pytest.raises(mps.SceneError, match="yield_value = -1 Pa"):
        cases.case_of("slump", yield_value=-1)
    bars, keys = tmp_path / "bars.stl", set()
    for text in ("one", "another"):
        bars.write_text(text)
        keys.add(cases.case_of("wall", rebar=str(bars)).key)
    assert len(keys) == 2


def test_model_and_spacing_are_the_cheapest_that_are_good_enough():
    planned = combinations("slump", yield_value="100:400:3", plastic_viscosity=[20, 50])
    mixes = [(c.parameters["yield_value"], c.parameters["plastic_viscosity"]) for c in planned]
    assert mixes == [(100, 20), (100, 50), (200, 20), (200, 50), (400, 20), (400, 50)]
    good = [c for c in choices() if c.error <= ACCURACY and c.volume_error <= 0.01]
    cheapest = min(good, key=lambda c: c.cpu_seconds)
    assert {(c.parameters["model"], c.parameters["spacing"]) for c in planned} == {(cheapest.model, cheapest.spacing)}
    assert combinations("slump", model="quarter")[0].parameters == {"model": "quarter"}
    assert len(combinations("slump", yield_value="300,3e2", model="quarter,quarter")) == 1


def test_what_is_under_way_at_ctrl_c_goes_on_and_nothing_else_begins(tmp_path):
    notes, rows = tmp_path, []
    warns = pytest.warns(UserWarning, match="no new case begins; Ctrl-C again ends the 1 under way")
    was = signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell may start its background jobs without
    with warns, pytest.raises(KeyboardInterrupt), ThreadPoolExecutor(1) as threads:
        pool = nullcontext(threads)
        run_side_by_side(study_cases.planned(5, notes), study_cases.interrupts_at_two, lambda: pool, 1, rows.append)
    signal.signal(signal.SIGINT, was)
    assert [row["number"] for row in rows] == [0, 1, 2] and len(study_cases.runs(notes)) == 3


def test_ctrl_c_does_not_reach_a_process_that_is_still_being_imported(monkeypatch):
    """A process is begun with Ctrl-C ignored, before it can ignore it by itself; this one has it as before."""
    monkeypatch.setattr(sweep, "end_with_parent", int)
    was = signal.signal(signal.SIGINT, signal.default_int_handler)
    with sweep.processes(1) as pool:
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
        assert pool.submit(signal.getsignal, signal.SIGINT).result() == signal.SIG_IGN
    signal.signal(signal.SIGINT, was)


def test_cases_that_share_kernels_are_run_one_after_the_other(tmp_path):
    mixed, seen = combinations("slump", yield_value="100,200", height="0.3,0.2"), []

    def look(case):
        seen.append(case.parameters["height"])
        return {"key": case.key, "status": "done", "reason": ""}

    with ThreadPoolExecutor(1) as threads:
        rows = run_cases(mixed, tmp_path / "s", look, threads)
    assert seen[0] == seen[1] != seen[2] == seen[3]
    assert [row["key"] for row in rows] == [case.key for case in mixed]


# ---- nothing lost, nothing twice -------------------------------------------------------------------------------
@pytest.fixture
def notes(tmp_path):
    folder = tmp_path / "notes"
    folder.mkdir()
    return folder


def numbers(rows):
    return [row["number"] for row in rows if row["status"] == "done"]


def test_finished_cases_are_not_run_again(tmp_path, notes):
    out, seen = tmp_path / "study", []
    with ThreadPoolExecutor(2) as threads:
        first = run_cases(study_cases.planned(4, notes), out, study_cases.fails_at_two, threads)
        again = run_cases(study_cases.planned(6, notes), out, study_cases.plain, threads,
                          watch=lambda rows, total: seen.append((len(rows), total)))  # fmt: skip
    assert [row["status"] for row in first] == ["done", "done", "failed", "done"]
    assert again[:4] == first and numbers(again) == [0, 1, 3, 4, 5]
    assert seen == [(4, 6), (5, 6), (6, 6)] and set(study_cases.runs(notes).values()) == {1}
    table = read(out)
    assert [row["number"] for row in table] == [0, 1, 2, 3, 4, 5] and table[2]["status"] == "failed"


def test_a_broken_executor_loses_the_cases_and_ends(tmp_path, notes):
    with ThreadPoolExecutor(1, initializer=int, initargs=("no number",)) as threads:
        rows = run_cases(study_cases.planned(3, notes), tmp_path / "s", study_cases.plain, threads)
    assert [row["status"] for row in rows] == [LOST] * 3 and not study_cases.runs(notes)


def test_a_case_for_which_memory_is_missing_is_computed_again(monkeypatch):
    def begin(_scene):
        raise ShortOfMemoryError("spacing = 0.01 m: its particles take 3 GB")

    monkeypatch.setattr("taichi_mps.study.reuse.begin", begin)
    row = cases.run_case(cases.case_of("film", spacing=0.05))
    assert row["status"] == LOST and row["reason"].endswith("take 3 GB")


def test_a_case_that_kills_its_process_takes_no_other_with_it(tmp_path, notes):
    rows = run_cases(study_cases.planned(5, notes), tmp_path / "s", study_cases.dies_at_two, workers=2)
    assert numbers(rows) == [0, 1, 3, 4] and rows[2]["status"] == LOST and "process died" in rows[2]["reason"]
    assert study_cases.runs(notes)["case2"] == 2


def test_a_study_that_is_killed_goes_on_where_it_was(tmp_path, notes):
    script = (
        "import sys\nfrom taichi_mps.study.sweep import run_cases\nfrom tests.support import study_cases as s\n"
        "if __name__ == '__main__':\n"
        "    run_cases(s.planned(9, sys.argv[1]), sys.argv[2], s.kills_the_study_at_first, workers=2)\n"
    )
    (tmp_path / "study.py").write_text(script)
    command, journal = [sys.executable, tmp_path / "study.py", notes, tmp_path / "s"], tmp_path / "s" / "journal.jsonl"
    path = {"PYTHONPATH": str(ROOT), "PATH": ""}
    assert subprocess.run(command, env=path, timeout=60).returncode == -9
    before = [json.loads(line)["key"] for line in journal.read_text().splitlines()]
    assert 1 <= len(before) < 9
    with open(journal, "a") as file:
        file.write('{"key": "case8", "stat')  # a line that was cut off
    assert subprocess.run(command, env=path, timeout=60).returncode == 0
    written = [json.loads(line)["key"] for line in journal.read_text().splitlines()]
    assert written[: len(before)] == before and sorted(written) == sorted(f"case{k}" for k in range(9))
    assert all(study_cases.runs(notes)[key] == 1 for key in before) and len(read(tmp_path / "s")) == 9


@pytest.mark.long
def test_the_cases_of_a_dask_worker_that_is_killed_are_computed_by_the_other(tmp_path):
    """A scheduler and two workers are processes of this machine; one is killed as soon as both have cases. Rows are
    those of a sweep without Dask, but for the seconds that they took."""
    distributed = pytest.importorskip("distributed", reason="needs distributed: pip install 'taichi-mps[cluster]'")
    mixes = {"yield_value": "200:900:8", "model": "axisymmetric", "spacing": 0.03, "until": 0.05}
    file, running = tmp_path / "scheduler.json", []

    def dask(*words):
        running.append(begun("-m", "dask", *words, "--no-dashboard", "--scheduler-file", file, stdout=log, stderr=log))

    with open(tmp_path / "log", "w") as log, ThreadPoolExecutor(1) as thread:
        try:
            dask("scheduler", "--host", "127.0.0.1", "--port", "0")
            for k in range(2):
                dask("worker", "--nthreads", "1", "--no-nanny", "--local-directory", tmp_path / f"worker{k}")
            with distributed.Client(scheduler_file=str(file), timeout=60, set_as_default=False) as client:
                client.wait_for_workers(2, timeout=60)
                address = client.scheduler.address.replace("tcp://", "dask://")
                study = thread.submit(sweep.sweep, "slump", tmp_path / "dask", address, **mixes)
                while not study.done() and sum(map(bool, client.processing().values())) < 2:
                    time.sleep(0.05)
                assert not study.done()
                running[1].kill()
                rows = study.result()
                assert running[1].wait(10) == -signal.SIGKILL and len(client.processing()) == 1
        finally:
            for process in running:
                process.kill()
                process.wait()
    own = sweep.sweep("slump", tmp_path / "own", workers=1, **mixes)
    for row in (*rows, *own):
        assert row["status"] == "done" and row.pop("cpu_seconds") > 0.0 <= row.pop("compile_seconds")
    assert rows == own and len(read(tmp_path / "dask")) == 8


def test_one_study_at_a_time_and_no_foreign_folder(tmp_path):
    with (
        open_results(tmp_path / "s"),
        pytest.raises(mps.SceneError, match="another study"),
        open_results(tmp_path / "s"),
    ):
        pass
    (tmp_path / "other.txt").write_text("mine\nyours")
    with pytest.raises(mps.SceneError, match="holds other files"), open_results(tmp_path):
        pass
    for line in ("nonsense", '{"key": "b"}', '{"status": "done"}'):
        (tmp_path / "s" / "journal.jsonl").write_text('{"key": "a", "status": "done"}\n' + line + "\n")
        with pytest.raises(mps.SceneError, match="line 2 is no row"), open_results(tmp_path / "s"):
            pass
    with pytest.raises(mps.SceneError, match="other.txt: has no column status"):
        read(tmp_path / "other.txt")


def test_the_tables_hold_text_beside_numbers_and_what_is_missing(tmp_path):
    """A column may hold a number in one row, a word in the next, or be missing."""
    rows = [{"key": "a", "status": "done", "rate": 0.1, "steps": 3},
            {"key": "b", "status": "failed", "rate": "rational", "reason": "[Errno 5] out, of order"}]  # fmt: skip
    with open_results(tmp_path / "s") as results:
        results.write([])
        assert not results.table.exists()
        results.write(rows)
    again = read(tmp_path / "s")
    assert [row["rate"] for row in again] == [0.1, "rational"] and [row["steps"] for row in again] == [3.0, None]
    assert again[1]["reason"] == rows[1]["reason"] and again[0]["reason"] is None


@pytest.mark.parametrize("name", ["dask", "dask://", "dask://host", "dask://host:port", "ssh://there", "4"])
def test_an_executor_that_is_none_is_refused(tmp_path, name):
    with pytest.raises(mps.SceneError, match=f"executor = {re.escape(name)}: must be"):
        run_cases([], tmp_path / "s", executor=name)
    assert not (tmp_path / "s").exists()


def test_the_chart_of_a_study_names_unit_and_values_and_leaves_out_what_failed(monkeypatch):
    from taichi_mps.study import chart

    monkeypatch.setattr(chart, "_save", lambda figure, out: figure)
    rows = [{"scene": "slump", "status": "done", "yield_value": tau, "slump_m": 60.0 / tau} for tau in (250.0, 200.0)]
    failed = {"scene": "slump", "status": "failed", "yield_value": 320.0, "reason": "it is"}
    (axes,) = chart.study_chart([*rows, failed], ["yield_value"], "no.png").axes
    assert axes.get_xlabel() == "yield stress [Pa]" and axes.get_ylabel() == "slump [cm]"
    assert axes.lines[0].get_xydata() == pytest.approx(np.array([[200.0, 30.0], [250.0, 24.0]]))
    assert list(axes.get_xticks()) == [200.0, 250.0]
    with pytest.raises(mps.SceneError, match="needs a case that is done"):
        chart.study_chart([failed], ["yield_value"], "no.png")


# ---- one compilation for all materials -------------------------------------------------------------------------
@pytest.mark.slow
def test_materials_of_one_law_share_their_kernels(tmp_path):
    """Half the density, viscosity and yield stress are the same motion under gravity to the last bit, since every
    number of the material reaches kernels compiled for another one. A row has all measures, those of the course
    included."""
    text = Path(mps.catalogue.locate("film")).read_text()
    over_time = "over_time=lambda h: {'steps_s': float(len(h['time_s']))}"
    film, shape = tmp_path / "slow.py", {"depth": 0.04, "spacing": 0.01, "until": 0.05}
    film.write_text(text.replace("measure=measure,", f"measure=measure, {over_time},"))
    mixes = (100, 50, 2300), (40, 20, 2000), (50, 25, 1150), (100, 50, 2300)
    rows = [cases.run_case(cases.case_of(str(film), yield_value=tau, plastic_viscosity=eta, density=rho, **shape))
            for tau, eta, rho in mixes]  # fmt: skip
    assert [row["status"] for row in rows] == ["done"] * 4
    assert all(row["compile_seconds"] < 0.2 * rows[0]["compile_seconds"] for row in rows[1:])
    for name in ("surface_speed_m_s", "velocity_error", "steps", "simulated_seconds"):
        assert rows[0][name] == rows[3][name] == pytest.approx(rows[2][name], rel=1e-9), name
    assert rows[1]["surface_speed_m_s"] > 1.1 * rows[0]["surface_speed_m_s"] > 0.0
    assert rows[0]["steps_s"] == rows[0]["steps"] + 1
    sim = begin(mps.catalogue.build(str(film), plastic_viscosity=20, density=2000, **shape))
    height = np.ptp(sim.scene.fluid[:, 1]) + 0.01
    assert sim.scheme.constants.time_step.longest == longest_step(0.01, 9.81, height, 0.01)  # what similarity leaves
    failed = cases.run_case(cases.case_of("slump", lift_speed=0.1, model="quarter", spacing=0.03))
    assert failed["status"] == "failed" and "lift_speed = 0.1 m/s" in failed["reason"]


@pytest.mark.slow
def test_a_run_of_a_study_tells_its_warnings_in_its_row_and_not_on_the_screen(tmp_path, recwarn):
    text = Path(mps.catalogue.locate("film")).read_text().replace("measure=measure", "measure=lambda s: {'odd': 'x'}")
    (tmp_path / "odd.py").write_text(text)
    row = cases.run_case(cases.case_of(str(tmp_path / "odd.py"), spacing=0.02, until=0.002))
    assert row["status"] == "done" and "odd = x is no number" in row["reason"]
    assert f"({row['reason']})" in outcome(row) and not any(each.category is UserWarning for each in recwarn)


@pytest.mark.long
def test_a_case_of_a_flow_table_has_its_flow():
    """The flow is the spread after the last jolt over the mould's foot of 200 mm."""
    how = {"spacing": 0.02, "model": "axisymmetric", "wait": 0.3, "period": 0.3}
    row = cases.run_case(cases.case_of("flow_table", jolts=1, **how))
    assert row["flow_ratio"] == pytest.approx(row["spread_after_1_jolts_m"] / 0.2 - 1.0) and row["flow_ratio"] > 0.3


class Imagined(mps.Bingham):
    """A mix with a number that no kernel reads from a field."""

    imagined_angle: float = 0.0


def test_what_is_compiled_in_is_in_the_key_of_what_is_compiled_once():
    """Two mixes share kernels only where their numbers differ in those that the law's kernels read from a field."""
    scene = mps.catalogue.build("slump", spacing=0.05, model="axisymmetric")

    def key(numerics=None, kind=Imagined, **numbers):
        return shape_of(Problem(replace(scene, material=kind(**numbers)), numerics))

    for shared in ({"yield_value": 40.0}, {"plastic_viscosity": 10.0}, {"density": 2000.0}):
        assert key(**shared) == key(), shared
    assert key(critical_strain_rate=0.01) == key(critical_strain_rate=0.02)
    kinds = ({}, {"imagined_angle": 20.0}, {"kind": mps.Bingham}, {"yield_value": 0.0}, {"critical_strain_rate": 0.01})
    kinds += ({"numerics": mps.Implicit(passes=7)}, {"numerics": mps.Implicit(courant_number=0.1)})
    hb = {"kind": mps.HerschelBulkley}
    assert key(**hb, yield_value=40.0, consistency=9.0, flow_index=0.5) == key(**hb)
    assert key(**hb, structuration=1.0) == key(**hb, structuration=2.0, destructuration=0.1)
    kinds += (hb, hb | {"structuration": 1.0}, {"kind": mps.Casson})
    moved = replace(scene, fluid=scene.fluid + 1e-9)
    assert len({shape_of(Problem(moved)), *(key(**kind) for kind in kinds)}) == len(kinds) + 1
    assert set(mps.Bingham.from_fields) <= set(mps.Bingham.model_fields)


def test_a_sweep_of_a_law_of_ones_own_is_told_to_compile_for_each_case(tmp_path):
    path = tmp_path / "own.py"
    path.write_text(
        "import taichi_mps as mps\n"
        "class Own(mps.Law):\n"
        "    yield_value: float = 40.0\n"
        "    slope: float = 30.0\n"
        "    def shear_stress(self, rate, structure):\n"
        "        return self.yield_value + self.slope * rate\n"
        "@mps.checked\n"
        "def scene(material: Own = Own()):\n"
        "    fluid = mps.fill(mps.Box((0.0, 0.0), (0.5, 0.5)), 0.1)\n"
        "    return mps.Scene('own', material, 0.1, fluid, ((-1.0, -1.0), (1.0, 1.0)), until=0.01)\n"
    )
    one, three = (sweep.wall_time(combinations(str(path), slope=slopes), 1) for slopes in ("30", "20,30,40"))
    film = [sweep.wall_time(combinations("film", plastic_viscosity=slopes), 1) for slopes in ("30", "20,30,40")]
    assert three == pytest.approx(3.0 * one, rel=0.2) and film[1] - film[0] < three - one


@pytest.mark.long
def test_t500_of_a_case_is_that_of_all_steps():
    """A case measures the slump flow at some steps only; T500, interpolated in time, is that of all within 1 %."""
    soft = {"model": "axisymmetric", "spacing": 0.02, "yield_value": 30.0, "plastic_viscosity": 50.0, "until": 5.0}
    found, sim = cases.run_case(cases.case_of("slump", **soft))["t500_s"], mps.Simulation(mps.slump_cone(**soft))
    course = [(0.0, sim.measures()["spread_m"])]
    sim.each_step(lambda sim: course.append((sim.time, sim.measures()["spread_m"])))
    sim.run()
    assert found == pytest.approx(mps.measure.time_of(*np.array(course).T, 0.5), rel=0.01)
