"""The quick rows of the validation table, and the table itself."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.cli.main import main
from taichi_mps.problem import catalogue
from taichi_mps.validation import ROWS, SLUMP_ERROR, Measured, Row, standing, table
from taichi_mps.validation.fluids import columns
from taichi_mps.validation.scheme import BudgetError, Setting, simulate
from taichi_mps.viz import plots
from tests.support.inside import find


def late_by(delay):
    """Largest relative change of the front of Martin and Moyce if their gate opened so late [sqrt(a/2g)]."""
    known = columns("C_dambreak_front_martin_moyce_koshizuka.csv", dataset="martin_moyce_a2.25in_n2=2")
    at, z = known["t*sqrt(2g/a)"], known["z/a"]
    covered = (at + delay < at[-1]) & (z < 3.9)
    return float((np.interp(at + delay, at, z)[covered] / z[covered]).max()) - 1.0


# What of the quick rows misses its target, (row, part of the quantity's name): what it is at most all the same, and why
MISSED = {
    ("dam_break_front", "no delay"): (
        lambda target: late_by(0.3) + target,
        "the gate of the experiment opened late, as the reference says: by up to 0.3 sqrt(a/2g), the most that the row "
        "allows for; with its delay the front meets the target",
    )
}


@pytest.mark.parametrize("name", [row.name for row in ROWS.values() if row.quick])
def test_quick_row_meets_its_targets_but_for_what_is_known_to_miss(name):
    """Neither more nor less is missed than MISSED names."""
    numbers = [item for item in ROWS[name].run() if isinstance(item, Measured)]
    assert numbers
    known = {part: most for (row, part), (most, _why) in MISSED.items() if row == name}
    missed = {part: number for number in numbers for part in known if part in number.quantity}
    assert [number for number in numbers if not number.met] == list(missed.values()) and missed.keys() == known.keys()
    for part, number in missed.items():
        assert abs(number.value) <= known[part](number.target), number


def test_the_command_knows_the_rows_of_every_module():
    """In a process of its own: what nobody else has imported is no row."""
    marked = sum(file.read_text().count("\n@row(") for file in Path(table.__file__).parent.glob("*.py"))
    code = "from taichi_mps.validation import table; print(len(table.ROWS))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert int(done.stdout.split()[-1]) >= marked > 30


def test_a_number_is_met_only_within_its_target():
    assert Measured("q", -0.05, 0.05).met and not Measured("q", 0.051, 0.05).met
    assert not Measured("q", float("nan"), 1.0).met


@pytest.mark.parametrize(("tau_y", "by_hand"), [(500.0, 0.87), (1000.0, 0.84)])
def test_a_body_that_fell_stands_below_its_own_yield_value(tau_y, by_hand):
    """By hand: along the chord of slump, and of spread, against log tau_y between two references without inertia
    (300 Pa: 216.8 and 348.9 mm; 500 Pa: 166.7 and 307.9 mm; 1000 Pa: 81.0 and 248.8 mm)."""
    assert standing.static_limit(tau_y) == pytest.approx(by_hand, abs=0.015)


@pytest.mark.long
def test_relaxed_particles_fill_a_body_evenly_and_without_order():
    body = mps.Box((-0.09, -0.09, 0.0), (0.09, 0.09, 0.06))
    x = standing.relaxed(body) / standing.SPACING
    assert len(x) == pytest.approx(18 * 18 * 6, rel=0.02)
    inside = x[np.all((np.abs(x[:, :2]) < 6.0), axis=1) & (np.abs(x[:, 2] - 3.0) < 1.0)]
    distance = np.sqrt(((inside[:, None] - x) ** 2).sum(-1))
    nearest = np.sort(distance, 1)[:, 1]
    assert nearest.min() > 0.6 and nearest.mean() == pytest.approx(0.85, abs=0.02)  # at random: 0.03 and 0.55
    assert len(inside) == pytest.approx(12 * 12 * 2, rel=0.06)
    directions = (x - inside[:, None])[(distance > 0.6) & (distance < 1.2)]
    cubic = ((directions / np.linalg.norm(directions, axis=1)[:, None]) ** 4).sum(1).mean()
    assert cubic == pytest.approx(0.6, abs=0.03)  # that of all directions alike; a lattice has 1


def test_every_row_says_what_it_is():
    assert len(ROWS) > 20
    assert all(isinstance(row, Row) and row.case and row.reference for row in ROWS.values())
    assert sum(row.quick for row in ROWS.values()) >= 3


def result(*numbers, error=None, case="film"):
    keys = ("quantity", "value", "target", "unit", "met")
    numbers = [dict(zip(keys, number, strict=True)) for number in numbers]
    return {"case": case, "reference": "exact", "numbers": numbers, "series": [], "error": error, "cpu_seconds": 1.0}


def test_table_counts_misses_and_failures(tmp_path):
    good = result(("speed", 0.02, 0.01, "m/s", False))
    text = table.markdown({"couette": good, "slump_100": result(case="cone", error="diverged at t = 1 s")})
    assert "| film | exact | speed | 0.02 m/s | <= 0.01 m/s | **missed** | 1 |\n" in text
    assert "| cone | exact | - | - | - | **failed**: diverged at t = 1 s | 1 |\n" in text
    assert "0 of 1 numbers meet their target; 1 rows failed" in text and "semi-implicit" not in text
    page = tmp_path / "page.md"
    page.write_text(f"before\n{table.BEGIN}\nold\n{table.END}\nafter\n")
    table.insert(page, text)
    written = page.read_text()
    assert written.startswith("before\n") and written.endswith("after\n") and text in written and "old" not in written


def test_both_schemes_stand_side_by_side():
    """Line by line; a number with another name keeps it; what ended a row stands where its numbers end."""
    slump, volume = ("slump at rest", 1.0, 5.0, "mm", True), ("volume", 2.0, 0.5, "%", False)
    late = ("slump at 5 s", -9.0, 5.0, "mm", False)
    rows = {"slump_100": result(slump, volume), "couette": result(slump), "slump_300": result(slump)}
    others = {"slump_100": result(late, error="diverged at t = 1 s"), "couette": result(error="not run: it moves")}
    text = table.markdown(rows, others | {"slump_500": result(late)})
    assert text.startswith("| case | reference | quantity | measured | target | | CPU-s | semi-implicit | CPU-s |\n")
    assert "| slump at rest | 1 mm | <= 5 mm | met | 1 | -9 mm (slump at 5 s), **missed** | 1 |\n" in text
    assert "| | | volume | 2 % | <= 0.5 % | **missed** |  | diverged at t = 1 s |  |\n" in text
    assert "| slump at rest | 1 mm | <= 5 mm | met | 1 | not run | 1 |\n" in text
    assert "| slump at rest | 1 mm | <= 5 mm | met | 1 |  |  |\n" in text  # not asked for
    assert "| slump at 5 s | - | <= 5 mm | - |  | -9 mm, **missed** | 1 |\n" in text
    assert "3 of 4 numbers meet their target; 0 rows failed.\n" in text
    assert text.endswith("`semi-implicit`: 0 of 2 numbers meet their target; 1 rows failed; 1 were not run.")
    columns = {line.count("|") for line in text.splitlines() if line.startswith("|")}
    assert columns == {10}


def test_a_page_gets_the_convergence_of_all_kept_results(tmp_path, capsys, monkeypatch):
    """One row gives one point; the row that was run before gives the other."""
    points = {"slump_1000": (10.0, 2.0), "slump_1000_coarse": (20.0, 8.0)}

    def run(name, *how):
        x, y = points[name]
        point = {"quantity": SLUMP_ERROR, "curve": "1000 Pa", "x": (x,), "y": (y,)}
        return result(("slump", y, 5.0, "mm", y <= 5.0)) | {"row": name, "series": [point]}

    drawn = []
    monkeypatch.setattr(table, "run_apart", run)
    monkeypatch.setattr(plots, "_save", lambda figure, out: drawn.append((figure, out)))
    page = tmp_path / "page.md"
    page.write_text(f"{table.BEGIN}\n{table.END}\n")
    for name in points:
        missed = points[name][1] > 5.0
        assert main(["validate", name, "--out", str(tmp_path / "out"), "--page", str(page)]) == missed
    figure, out = drawn[-1]
    (axes,) = figure.axes
    assert out == tmp_path / "figures" / "convergence.png"
    np.testing.assert_array_equal(axes.lines[-1].get_xydata(), sorted(points.values()))
    assert page.read_text().count("| slump |") == 2

    def without(*arguments):
        raise ImportError("plots need matplotlib")

    monkeypatch.setattr(plots, "convergence", without)
    capsys.readouterr()
    assert main(["validate", "slump_1000", "--out", str(tmp_path / "out"), "--page", str(page)]) == 1  # the other row
    assert "convergence.png is not drawn: plots need matplotlib\n" in capsys.readouterr().err


# ---- the paper's scheme ----------------------------------------------------------------------------------------
@pytest.fixture
def papers(monkeypatch):
    """Rows run with the paper's scheme, without a budget."""
    monkeypatch.setattr(Setting, "scheme", "semi-implicit")
    monkeypatch.setattr(Setting, "budget", None)


def channel(**plane):
    high, l0 = (0.05, 0.1), 0.005
    return mps.Scene(
        name="channel",
        material=mps.Newtonian(density=1000.0, viscosity=1.0),
        spacing=l0,
        fluid=mps.lattice((0.0, 0.0), np.array(high) - 0.5 * l0, l0),
        walls=(mps.Plane((0.0, 0.0), (0.0, 1.0)), mps.Plane(high, (0.0, -1.0), **plane)),
        domain=((0.0, -l0), (high[0], high[1] + l0)),
        periodic=(True, False),
    )


def test_planes_get_three_layers_of_wall_particles_that_go_on_the_lattice(papers):
    """Then the particle number density is n0 everywhere: no gap, no overlap, across the periodic side too."""
    sim = simulate(channel())
    assert sim.summary()["scheme"] == "semi-implicit"
    assert sim.summary()["wall_particles"] == 2 * 3 * 10
    find(sim)
    assert np.abs(sim.snapshot().density_ratio - 1.0).max() < 1e-9


def test_a_corner_is_filled_with_wall_particles(papers):
    fluid = mps.fill(mps.Box((0.0, 0.0), (0.1, 0.05)), 0.01)
    walls = mps.box_planes((0.0, 0.0), (0.1, 0.05))
    scene = mps.Scene("tank", mps.Newtonian(), 0.01, fluid, ((-0.01, -0.01), (0.11, 0.1)), walls)
    wall = simulate(scene).scene.wall_particles
    corner = wall[(wall < 0.0).all(1)]
    assert {tuple(point) for point in np.round(corner, 6)} == {(-x, -y) for x in (0.005, 0.015, 0.025)
                                                               for y in (0.005, 0.015, 0.025)}  # fmt: skip
    assert wall.max() > 0.1 and not ((wall > 0.0) & (wall < (0.1, 1.0))).all(1).any()


def test_defaults_are_the_papers_and_a_cap_only_shortens_the_step(papers):
    assert simulate(channel()).numerics == mps.SemiImplicit()
    assert simulate(channel(), max_time_step=1.0).numerics.max_time_step == 1e-3
    assert simulate(channel(), max_time_step=1e-5).numerics.max_time_step == 1e-5


def test_a_moving_wall_is_refused(papers):
    with pytest.raises(mps.SceneError, match="a wall of scene channel moves"):
        simulate(channel(velocity=(1.0, 0.0)))


def test_a_wall_that_no_lattice_can_follow_is_refused(papers):
    with pytest.raises(mps.SceneError, match="describes its walls as surfaces only"):
        simulate(replace(channel(), walls=(mps.Plane((0.0, 0.0), (0.6, 0.8)),)))


def test_a_budget_stops_a_run_and_says_where(papers, monkeypatch):
    monkeypatch.setattr(Setting, "budget", 1e-9)
    sim = simulate(catalogue.build("film", spacing=0.01))
    with pytest.raises(BudgetError, match=r"at t = 8\.36e-05 s: 1e-09 CPU-s spent"):
        sim.run()
    assert sim.steps == 1


def test_command_refuses_an_unknown_row_and_writes_the_table(tmp_path, capsys, monkeypatch):
    assert main(["validate", "plane_couete", "--out", str(tmp_path / "out")]) == 2
    assert "did you mean" in capsys.readouterr().err and not (tmp_path / "out").exists()
    name = next(row.name for row in ROWS.values() if row.quick)
    monkeypatch.setattr(table, "run_apart", lambda each, *how: result(error=f"{how}") | {"row": each})
    assert main(["validate", name, "--out", str(tmp_path / "out"), "--json"]) == 1
    assert json.loads(capsys.readouterr().out)[0]["row"] == name
    assert (tmp_path / "out" / "table.md").read_text().startswith("| case |")
    assert main(["validate", name, "--scheme", "semi-implicit", "--budget", "20", "--out", str(tmp_path / "out")]) == 1
    written = (tmp_path / "out" / "table.md").read_text()
    assert "**failed**: ('implicit', None)" in written and "| ('semi-implicit', 20.0) |" in written


@pytest.mark.long
def test_no_hole_opens_in_a_finer_square_patch():
    """Tension tears what is not shifted back: without that a hole of 1.3 l0 opened at 60 across, though none at 40."""
    numbers = [item for item in ROWS["square_patch_fine"].run() if isinstance(item, Measured)]
    assert len(numbers) == 5 and all(number.met for number in numbers), numbers
