"""Studies: nothing lost and nothing twice, whatever dies; constants found again from a slump test, within intervals."""

import json
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.cli import main as cli
from taichi_mps.problem import catalogue
from taichi_mps.problem.accuracy import choices
from taichi_mps.problem.problem import Problem
from taichi_mps.study import case as cases
from taichi_mps.study.calibrate import calibrate, fit
from taichi_mps.study.emulator import Emulator
from taichi_mps.study.results import Results, read, uniform
from taichi_mps.study.reuse import shape_of
from taichi_mps.study.sweep import ACCURACY, LOST, carry_out, values
from taichi_mps.study.sweep import cases as combinations
from taichi_mps.terms.constants import FIELDS_OF_A_MIX, longest_step
from taichi_mps.units import SceneError
from tests.support import study_cases

ROOT = Path(__file__).resolve().parents[2]


# ---- what is to be computed ------------------------------------------------------------------------------------
def test_values_in_equal_ratios_and_equal_steps():
    assert values("20,50, 100") == ["20", "50", "100"] and values("full") == ["full"]
    assert values("1:16:5") == ["1", "2", "4", "8", "16"]
    assert values("-1:1:3:linear") == ["-1", "0", "1"]


@pytest.mark.parametrize("text", ["1:2", "1:2:1", "1:2:x", "0:2:3", "1:2:3:log", "1:inf:3", "1:2:3:linear:4"])
def test_bad_values_are_refused(text):
    with pytest.raises(SceneError, match=f"yield_value = {text}: "):
        values(text, "yield_value")


def test_a_key_is_the_scene_and_all_its_parameters(tmp_path):
    known = cases.case("slump", yield_value="300")
    assert known.key == cases.case("slump", yield_value=300.0, plastic_viscosity=50).key == cases.case("slump").key
    assert known.key != cases.case("slump", yield_value=301.0).key
    changed = tmp_path / "slump.py"
    changed.write_text(Path(catalogue.locate("slump")).read_text() + "\n")
    assert known.key != cases.case(str(changed), yield_value=300.0).key
    with pytest.raises(SceneError, match="yield_value = -1 Pa"):
        cases.case("slump", yield_value=-1)
    bars = tmp_path / "bars.stl"
    keys = []
    for text in ("one", "another"):
        bars.write_text(text)
        keys.append(cases.case("wall", rebar=str(bars)).key)
    assert keys[0] != keys[1]


def test_model_and_spacing_are_the_cheapest_that_are_good_enough():
    planned = combinations("slump", yield_value="100:400:3", plastic_viscosity=[20, 50])
    mixes = [(c.parameters["yield_value"], c.parameters["plastic_viscosity"]) for c in planned]
    assert mixes == [(100, 20), (100, 50), (200, 20), (200, 50), (400, 20), (400, 50)]
    good = [c for c in choices() if c.error <= ACCURACY and c.volume_error <= 0.01]
    cheapest = min(good, key=lambda c: c.cpu_seconds)
    assert {(c.parameters["model"], c.parameters["spacing"]) for c in planned} == {(cheapest.model, cheapest.spacing)}
    assert combinations("slump", model="quarter")[0].parameters == {"model": "quarter"}
    assert len(combinations("slump", yield_value="300,3e2", model="quarter,quarter")) == 1


def test_cases_that_share_kernels_are_run_one_after_the_other(tmp_path):
    mixed = combinations("slump", yield_value="100,200", height="0.3,0.2")
    seen = []

    def look(case):
        seen.append((case.parameters["height"], case.parameters["yield_value"]))
        return {"key": case.key, "status": "done", "reason": ""}

    with ThreadPoolExecutor(1) as threads:
        rows = carry_out(mixed, tmp_path / "s", look, threads)
    assert sorted(seen[:2]) + sorted(seen[2:]) in ([(0.2, 100), (0.2, 200), (0.3, 100), (0.3, 200)],
                                                    [(0.3, 100), (0.3, 200), (0.2, 100), (0.2, 200)])  # fmt: skip
    assert [row["key"] for row in rows] == [case.key for case in mixed]


# ---- nothing lost, nothing twice -------------------------------------------------------------------------------
@pytest.fixture
def notes(tmp_path):
    folder = tmp_path / "notes"
    folder.mkdir()
    return folder


def runs(notes) -> dict[str, int]:
    """How often each case was run."""
    return {path.name: path.stat().st_size for path in notes.iterdir()}


def numbers(rows):
    return [row["number"] for row in rows if row["status"] == "done"]


def test_finished_cases_are_not_run_again(tmp_path, notes):
    out, seen = tmp_path / "study", []
    with ThreadPoolExecutor(2) as threads:
        first = carry_out(study_cases.planned(4, notes), out, study_cases.fails_at_two, threads)
        again = carry_out(study_cases.planned(6, notes), out, study_cases.plain, threads,
                          watch=lambda rows, total: seen.append((len(rows), total)))  # fmt: skip
    assert [row["status"] for row in first] == ["done", "done", "failed", "done"]
    assert again[:4] == first and numbers(again) == [0, 1, 3, 4, 5]
    assert seen == [(4, 6), (5, 6), (6, 6)] and set(runs(notes).values()) == {1}
    table = read(out)
    assert [row["number"] for row in table] == [0, 1, 2, 3, 4, 5] and table[2]["reason"] == "it is two"


def test_what_an_executor_lost_is_computed_when_the_study_goes_on(tmp_path, notes):
    with ThreadPoolExecutor(1) as threads:
        first = carry_out(study_cases.planned(4, notes), tmp_path / "s", study_cases.raises_at_two_at_first, threads)
        again = carry_out(study_cases.planned(4, notes), tmp_path / "s", study_cases.raises_at_two_at_first, threads)
    assert (first[2]["status"], first[2]["reason"]) == (LOST, "OSError: the disk is gone")
    assert numbers(again) == [0, 1, 2, 3] and runs(notes) == {"case0": 1, "case1": 1, "case2": 2, "case3": 1}


def test_a_broken_executor_loses_the_cases_and_ends(tmp_path, notes):
    with ThreadPoolExecutor(1, initializer=int, initargs=("no number",)) as threads:
        rows = carry_out(study_cases.planned(3, notes), tmp_path / "s", study_cases.plain, threads)
    assert [row["status"] for row in rows] == [LOST] * 3 and not runs(notes)


def test_a_case_that_kills_its_process_takes_no_other_with_it(tmp_path, notes):
    rows = carry_out(study_cases.planned(5, notes), tmp_path / "s", study_cases.dies_at_two, workers=2)
    assert numbers(rows) == [0, 1, 3, 4] and rows[2]["status"] == LOST and "process died" in rows[2]["reason"]
    assert runs(notes)["case2"] == 2


def test_a_study_that_is_killed_goes_on_where_it_was(tmp_path, notes):
    script = (
        "import sys\nfrom taichi_mps.study.sweep import carry_out\nfrom tests.support import study_cases as s\n"
        "if __name__ == '__main__':\n"
        "    carry_out(s.planned(9, sys.argv[1]), sys.argv[2], s.kills_the_study_at_first, workers=2)\n"
    )
    (tmp_path / "study.py").write_text(script)
    command = [sys.executable, tmp_path / "study.py", notes, tmp_path / "s"]
    path = {"PYTHONPATH": str(ROOT), "PATH": ""}
    assert subprocess.run(command, env=path, timeout=60).returncode == -9
    journal = tmp_path / "s" / "journal.jsonl"
    before = [json.loads(line)["key"] for line in journal.read_text().splitlines()]
    assert 1 <= len(before) < 9
    with open(journal, "a") as file:
        file.write('{"key": "case8", "stat')  # a line that was cut off
    assert subprocess.run(command, env=path, timeout=60).returncode == 0
    written = [json.loads(line)["key"] for line in journal.read_text().splitlines()]
    assert written[: len(before)] == before and sorted(written) == sorted(f"case{k}" for k in range(9))
    assert all(runs(notes)[key] == 1 for key in before) and len(read(tmp_path / "s")) == 9


def test_dask_two_workers_one_killed(tmp_path, notes):
    distributed = pytest.importorskip("distributed", reason="needs distributed: pip install 'taichi-mps[cluster]'")
    settings = {"n_workers": 2, "threads_per_worker": 1, "processes": True, "dashboard_address": None}
    with distributed.LocalCluster(**settings) as cluster:
        address = cluster.scheduler_address.replace("tcp://", "dask://")
        rows = carry_out(
            study_cases.planned(12, notes), tmp_path / "s", study_cases.kills_its_process_at_first, address
        )
    assert numbers(rows) == list(range(12)) and runs(notes)["case2"] >= 2
    assert len((tmp_path / "s" / "journal.jsonl").read_text().splitlines()) == 12


def test_one_study_at_a_time_and_no_foreign_folder(tmp_path):
    with Results(tmp_path / "s"), pytest.raises(SceneError, match="another study"), Results(tmp_path / "s"):
        pass
    (tmp_path / "other.txt").write_text("mine")
    with pytest.raises(SceneError, match="holds other files"), Results(tmp_path):
        pass
    for line in ("nonsense", '{"key": "b"}', '{"status": "done"}'):
        (tmp_path / "s" / "journal.jsonl").write_text('{"key": "a", "status": "done"}\n' + line + "\n")
        with pytest.raises(SceneError, match="line 2 is no row"), Results(tmp_path / "s"):
            pass
    with pytest.raises(SceneError, match="other.txt: has no column status"):
        read(tmp_path / "other.txt")


def test_the_tables_hold_text_beside_numbers_and_what_is_missing(tmp_path):
    """A column may be a number in one row and a word in the next, or miss; Parquet has columns of one kind."""
    rows = [{"key": "a", "status": "done", "rate": 0.1, "steps": 3},
            {"key": "b", "status": "failed", "rate": "rational", "reason": "[Errno 5] out, of order"}]  # fmt: skip
    with Results(tmp_path / "s") as results:
        results.write([])
        assert not results.table.exists()
        results.write(rows)
    again = read(tmp_path / "s")
    assert [row["rate"] for row in again] == [0.1, "rational"] and [row["steps"] for row in again] == [3.0, None]
    assert again[1]["reason"] == rows[1]["reason"]
    assert uniform([0.1, "rational", None]) == ["0.1", "rational", None] and uniform([3, None]) == [3.0, None]
    parquet = pytest.importorskip("pyarrow.parquet", reason="needs pyarrow for results.parquet")
    table = parquet.read_table(tmp_path / "s" / "results.parquet").to_pylist()
    assert [row["rate"] for row in table] == ["0.1", "rational"] and [row["steps"] for row in table] == [3.0, None]


@pytest.mark.parametrize("name", ["dask", "dask://", "dask://host", "dask://host:port", "ssh://there", "4"])
def test_an_executor_that_is_none_is_refused(tmp_path, name):
    with pytest.raises(SceneError, match=f"executor = {name}: must be"):
        carry_out([], tmp_path / "s", executor=name)
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
    with pytest.raises(SceneError, match="needs a case that is done"):
        chart.study_chart([failed], ["yield_value"], "no.png")


# ---- one compilation for all materials -------------------------------------------------------------------------
def test_materials_of_one_law_share_their_kernels():
    """Half the density, viscosity and yield stress are the same motion under gravity, to the last bit: every number of
    the material reaches the kernels that were compiled for another."""
    cone = {"model": "axisymmetric", "spacing": 0.03, "until": 0.1}
    mixes = ((300, 50, 2300), (100, 20, 2000), (150, 25, 1150), (300, 50, 2300))
    rows = [cases.run(cases.case("slump", yield_value=tau, plastic_viscosity=eta, density=rho, **cone))
            for tau, eta, rho in mixes]  # fmt: skip
    assert [row["status"] for row in rows] == ["done"] * 4
    assert all(row["compile_seconds"] < 0.2 * rows[0]["compile_seconds"] for row in rows[1:])
    for name in ("slump_m", "slump_max_m", "spread_m", "steps", "simulated_seconds"):
        assert rows[0][name] == rows[3][name] == pytest.approx(rows[2][name], rel=1e-9), name
    assert rows[1]["slump_m"] > 1.1 * rows[0]["slump_m"]  # 100 Pa
    sim = cases.begin(mps.slump_cone(plastic_viscosity=20, density=2000, **cone))
    height = np.ptp(sim.scene.fluid[:, 1]) + 0.03
    assert sim.scheme.constants.max_time_step == longest_step(
        0.01, 9.81, height, 0.03
    )  # what similarity leaves the same
    failed = cases.run(cases.case("slump", lift_speed=0.1, **cone))
    assert failed["status"] == "failed" and "lift_speed = 0.1 m/s" in failed["reason"]


class Imagined(mps.Bingham):
    """A mix with a number that no kernel reads from a field."""

    imagined_angle: float = 0.0


def test_what_is_compiled_in_is_in_the_key_of_what_is_compiled_once():
    """A number of a mix shares the kernels only if terms/constants.py says that they read it from a field."""
    scene = catalogue.build("slump", spacing=0.05, model="axisymmetric")

    def key(numerics=None, kind=Imagined, **numbers):
        return shape_of(Problem(replace(scene, material=kind(**numbers)), numerics))

    for shared in ({"yield_value": 40.0}, {"plastic_viscosity": 10.0}, {"density": 2000.0}):
        assert key(**shared) == key(), shared
    assert key(critical_strain_rate=0.01) == key(critical_strain_rate=0.02)
    apart = [
        key(),
        key(imagined_angle=20.0),
        key(kind=mps.Bingham),
        key(yield_value=0.0),
        key(critical_strain_rate=0.01),
    ]
    apart += [key(mps.Implicit(passes=7)), key(mps.Implicit(courant_number=0.1)), key(kind=mps.HerschelBulkley)]
    apart += [key(kind=mps.HerschelBulkley, yield_value=40.0)]  # its curve is compiled whole
    assert len(set(apart)) == len(apart)
    assert set(FIELDS_OF_A_MIX) <= set(mps.Bingham.model_fields)


def test_the_time_of_a_milestone_lies_between_two_looks():
    looks = []

    class Run:
        time = 0.0

        def measures(self):
            looks.append(self.time)
            return {"spread_m": 0.2 if self.time == 0.0 else 0.6 + 0.1 * np.log(self.time)}

        def each_step(self, look):
            self.look = look

    sim = Run()
    for end, steps in ((1.0, 100), (30.0, 3000)):  # of 0.5 m at 1/e s, and of 0.85 m at e^2.5 s
        sim.time = 0.0
        milestone = cases.Milestone(sim, "spread_m", value := 0.5 if end == 1.0 else 0.85)
        looks.clear()
        for sim.time in np.linspace(0.01, end, steps):
            sim.look(sim)
        assert milestone.time == pytest.approx(np.exp(10.0 * (value - 0.6)), rel=1e-6)
        assert 5 < len(looks) < 50


# ---- the inverse question --------------------------------------------------------------------------------------
def closed_form(tau, eta):
    """A slump test that behaves like the real one; the spread of a stiff mix does not reach 500 mm."""
    slump = 0.29 / (1.0 + (tau / 800.0) ** 1.3) - 0.004 * np.log(eta / 50.0)
    spread = 0.2 + 0.5 / (1.0 + (tau / 150.0) ** 0.8) - 0.004 * np.log(eta / 50.0)
    return slump, spread, np.where(spread >= 0.5, 0.25 + eta / 50.0 * (1.0 + tau / 40.0), np.nan)


@pytest.fixture(scope="module")
def emulator():
    rows = []
    for tau in np.geomspace(20.0, 2000.0, 16):
        for eta in np.geomspace(5.0, 1000.0, 9):
            slump, spread, time = closed_form(tau, eta)
            row = {"status": "done", "yield_value": tau, "plastic_viscosity": eta, "slump_m": slump, "spread_m": spread}
            rows.append(row | {"t500_s": None if np.isnan(time) else float(time)})
    return Emulator(rows)


def test_rows_of_a_table_without_numbers_do_not_count(emulator):
    rows = []
    for tau in np.geomspace(20.0, 2000.0, 3):
        for eta in np.geomspace(5.0, 1000.0, 3):
            slump, spread, _ = closed_form(tau, eta)
            mix = {"yield_value": float(tau), "plastic_viscosity": float(eta)}
            rows.append({"status": "done", **mix, "slump_m": float(slump), "spread_m": float(spread)})
    bad = [rows[0] | {"yield_value": value} for value in (None, "stiff", -1.0)]
    assert len(Emulator(rows + bad).points) == 9
    for row in rows[:4]:
        row["slump_m"] = None
    with pytest.raises(SceneError, match="column slump_m holds fewer than 6 numbers"):
        Emulator(rows)


def test_a_row_keeps_all_measures_and_what_the_course_tells(tmp_path):
    film = Path(catalogue.locate("film")).read_text()
    film = film.replace(
        "measure=measure,", "measure=measure, over_time=lambda h: {'steps_s': float(len(h['time_s']))},"
    )
    (tmp_path / "slow.py").write_text(film)
    row = cases.run(cases.case(str(tmp_path / "slow.py"), depth=0.04, spacing=0.01, until=0.02))
    assert row["status"] == "done" and row["velocity_error"] > 0.0 and row["steps_s"] == row["steps"] + 1
    assert row["surface_speed_m_s"] < row["exact_surface_speed_m_s"]


ERRORS = {"slump_m": 0.005, "spread_m": 0.01, "t500_s": 0.2}


def draw(random, tau, eta, names):
    """A measurement with its errors."""
    exact = dict(zip(ERRORS, closed_form(tau, eta), strict=True))
    return {name: (exact[name] + ERRORS[name] * random.standard_normal(), ERRORS[name]) for name in names}


def test_the_intervals_hold_the_known_constants_as_often_as_they_say(emulator):
    random, held = np.random.default_rng(1), []
    for _ in range(300):
        tau, eta = random.uniform(35.0, 70.0), random.uniform(40.0, 200.0)
        found = fit(emulator, draw(random, tau, eta, ERRORS), 2300.0)
        pairs = (found.yield_value, tau), (found.plastic_viscosity, eta)
        held.append([(c.lower or 0.0) <= true <= (c.upper or np.inf) for c, true in pairs])
    assert np.all(np.abs(np.mean(held, 0) - 0.95) < 0.03), np.mean(held, 0)  # 0.03: 2.4 standard errors of 300 draws


def test_a_stiff_mix_tells_its_yield_value_alone(emulator):
    random, held = np.random.default_rng(2), []
    for _ in range(100):
        tau = random.uniform(300.0, 1200.0)
        found = fit(emulator, draw(random, tau, 50.0, ("slump_m", "spread_m")), 2300.0)
        held.append(found.yield_value.lower <= tau <= found.yield_value.upper)
        assert not found.plastic_viscosity.determined
    assert np.mean(held) > 0.93
    assert "plastic viscosity  not determined by these measurements" in str(found)


def test_better_measurements_give_narrower_intervals_around_the_constants(emulator):
    exact = dict(zip(ERRORS, map(float, closed_form(50.0, 80.0)), strict=True))
    wide, narrow = (
        fit(emulator, {name: (value, scale * ERRORS[name]) for name, value in exact.items()}, 2300.0)
        for scale in (1.0, 0.1)
    )
    for name, true in (("yield_value", 50.0), ("plastic_viscosity", 80.0)):
        few, many = getattr(narrow, name), getattr(wide, name)
        assert many.lower < few.lower < true < few.upper < many.upper and few.value == pytest.approx(true, rel=0.02)
        assert np.log(few.upper / few.lower) < 0.5 * np.log(many.upper / many.lower)


def test_constants_go_with_the_density(emulator):
    measured = draw(np.random.default_rng(3), 50.0, 80.0, ERRORS)
    light, heavy = (fit(emulator, measured, rho) for rho in (1150.0, 2300.0))
    for name in ("yield_value", "plastic_viscosity"):
        for end in ("value", "lower", "upper"):
            assert getattr(getattr(heavy, name), end) == pytest.approx(
                2.0 * getattr(getattr(light, name), end), rel=1e-9
            )


def test_measurements_that_contradict_each_other_are_named(emulator):
    assert fit(emulator, {"slump_m": (0.05, 0.005), "spread_m": (0.6, 0.01)}, 2300.0).contradictory
    with pytest.raises(SceneError, match="never spread to 0.5 m"):
        calibrate(spread=0.38, t500=3.2)
    with pytest.raises(SceneError, match="spread = 0.15 m: must be more than 0.2 m"):
        calibrate(spread=0.15)
    with pytest.raises(SceneError, match="at least one of"):
        calibrate()
    with pytest.raises(SceneError, match="slump = 21 m: must be less than 0.3 m"):
        calibrate(slump=21)
    with pytest.raises(SceneError, match="no column plastic_viscosity, slump_m"):
        Emulator([{"status": "done", "yield_value": 300.0, "spread_m": 0.3}])
    with pytest.raises(SceneError, match="at least 3 yield stresses"):
        Emulator([{"status": "done", "yield_value": 3.0, "plastic_viscosity": 5.0, "slump_m": 0.1, "spread_m": 0.3}])


def test_a_mix_beyond_the_table_is_said_to_be_so(emulator):
    """2000 Pa are its end. 4000 Pa slump less than anything in it, and least of that where the viscosity is high, which
    says nothing of the viscosity."""
    stiff, known = (fit(emulator, {"slump_m": (float(closed_form(tau, 50.0)[0]), 0.001)}, 2300.0) for tau in (4e3, 1e3))
    assert stiff.at_the_edge[0] == "yield_value" and "edge of the table (yield stress 20 to 2000 Pa" in str(stiff)
    assert stiff.plastic_viscosity.lower is None and stiff.plastic_viscosity.upper is None
    assert not known.at_the_edge and "edge" not in str(known)


@pytest.mark.parametrize(
    ("tau", "slump", "spread"), [(300, 0.2173, 0.3511), (500, 0.1799, 0.3193), (1000, 0.1015, 0.2656)]
)
def test_the_table_of_the_package_finds_the_yield_value_of_the_finite_elements(tau, slump, spread, capsys):
    assert cli.main(["calibrate", "--slump", slump, "--spread", spread, "--no-check", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["yield_value"]["lower"] < tau < found["yield_value"]["upper"]
    assert found["by_viscosity"]["50.0"] == pytest.approx(tau, rel=0.06)  # 10 mm: a slump 2 to 4 mm too small
    assert not found["plastic_viscosity"]["determined"] and not found["contradictory"]
