"""Rows of the validation table meet their targets except for known misses; how the table is run and written."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.study import chart
from tests.support.inside import find
from validation import SLUMP_ERROR, Measured, Setting, cases, flows, simulate, standing, table
from validation.__main__ import main

RESULTS = Path(__file__).resolve().parents[2] / "benchmarks" / "results"
ROWS = table.ROWS
CHEAPEST = "slump_100_axisymmetric", "taylor_green"  # of all rows that come to their end
CHEAP = (  # which take longer or lie between those of CHEAPEST: not in the CI
    *(f"slump_300_{name}" for name in ("axisymmetric", "quarter")),
    *(f"slump_500_{name}" for name in ("axisymmetric", "quarter", "coarse", "fine_axisymmetric")),
    *(f"slump_1000{name}" for name in ("", "_axisymmetric", "_quarter", "_fine_axisymmetric")),
    *("film_bingham_05", "film_at_yield", "film_viscosity_ratio", "cessation_channel"),
    *("rotating_disc", "square_patch", "stretched_block", "elliptical_drop", "couette", "dam_break_front"),
    "square_patch_fine",  # tension tears what is not shifted back: a hole of 1.3 l0 opened at 60 across, none at 40
)
CHEAPEST_OF_THE_PAPERS = "dam_break_front", "square_patch", "elliptical_drop", "rotating_disc", "rotating_sphere"

# What of these rows misses its target, by scheme, row and part of the quantity's name: its largest size all the same.
# The gate of Martin and Moyce opened late, by up to 0.3 sqrt(a/2g), in which their front moves by 21 %; with the delay
# the front meets the target. The paper's scheme does not hold a body together that is pulled, and its Laplacian resists
# a rotation that is rigid (schemes/test_semi_implicit.py).
MISSED = {
    ("implicit", "dam_break_front", "no delay"): 0.264,
    ("implicit", "slump_100", "volume at 5 s"): 0.7,
    ("implicit", "slump_100_quarter", "volume at 5 s"): 0.8,
    ("implicit", "slump_100_axisymmetric", "volume at 5 s"): 0.7,
    ("implicit", "slump_500_coarse", "volume at rest"): 0.8,
    ("implicit", "slump_1000_coarse", "volume at rest"): 0.8,
    ("semi-implicit", "dam_break_front", "no delay"): 0.264,
    ("semi-implicit", "square_patch", "waist"): 3.0,
    ("semi-implicit", "square_patch", "largest hole"): 1.0,
    ("semi-implicit", "elliptical_drop", "short half axis"): 0.06,
    ("semi-implicit", "rotating_disc", "loss of angular momentum"): 4.0,
    ("semi-implicit", "rotating_sphere", "loss of angular momentum"): 4.0,
}
# of which rounding decides whether a target of 0.5 % is missed: 0.60 % on an Intel Xeon and 0.23 % on an AMD EPYC, and
# 0.31 to 0.52 % in nine runs of both kernel languages whose particles were moved by 1e-6 l0
MAY_MEET = {"slump_100_axisymmetric", "slump_1000_coarse"}


QUICK = tuple(name for name, row in ROWS.items() if row.quick)
OF_ALL_RUNS = ("slump_1000_coarse",)  # the others of the quick ones take as long to compile, and are slow
CASES = [("implicit", name) for name in (*OF_ALL_RUNS, *CHEAPEST, *sorted({*QUICK} - {*OF_ALL_RUNS, *CHEAP}))]
LONG = [("implicit", name) for name in CHEAP] + [("semi-implicit", name) for name in CHEAPEST_OF_THE_PAPERS]


@pytest.fixture
def setting(monkeypatch):
    """The scheme and the budget of rows, put back at the end."""
    for name, value in vars(Setting).items():
        monkeypatch.setattr(Setting, name, value)
    return Setting


@pytest.mark.parametrize(
    ("scheme", "name"),
    [
        CASES[0],
        *(pytest.param(*case, marks=pytest.mark.slow) for case in CASES[1:]),
        *(pytest.param(*case, marks=pytest.mark.long) for case in LONG),
    ],
)
def test_a_row_meets_its_targets_but_for_what_is_known_to_miss(scheme, name, setting):
    """A row, compiled and run as by `python -m validation`, misses exactly the targets that MISSED names, but for what
    another processor MAY_MEET."""
    result = table.run_row(name, scheme)
    mps.backend.init(arch="cpu", precision="f64", threads=1)  # as the other tests of this file
    assert result["error"] is None and result["numbers"]
    known = {part: most for (*row, part), most in MISSED.items() if row == [scheme, name]}
    for number in result["numbers"]:
        most = next((most for part, most in known.items() if part in number["quantity"]), None)
        assert number["met"] is (most is None) or (name in MAY_MEET and number["met"]), number
        assert abs(number["value"]) <= (most or number["target"]), number


def test_kept_results_are_of_rows_of_the_table():
    """Kept results have the case and reference of their rows, and no two rows have one name."""
    assert len(ROWS) == len(cases.TABLE)
    for file in RESULTS.glob("validate_*.json"):
        kept = json.loads(file.read_text(encoding="utf-8"))
        row = ROWS[kept["row"]]
        assert (kept["case"], kept["reference"]) == (row.case, row.reference), file.name


def test_a_number_is_met_only_within_its_target():
    assert Measured("q", -0.05, 0.05).met and not Measured("q", 0.051, 0.05).met
    assert not Measured("q", float("nan"), 1.0).met


@pytest.mark.parametrize(("tau_y", "by_hand"), [(500.0, 0.87), (1000.0, 0.84)])
def test_a_body_that_fell_stands_below_its_own_yield_value(tau_y, by_hand):
    """By hand: along the chord of slump, and of spread, against log tau_y between two references without inertia (300
    Pa: 216.8 and 348.9 mm; 500 Pa: 166.7 and 307.9 mm; 1000 Pa: 81.0 and 248.8 mm)."""
    assert standing.STATIC_LIMITS[tau_y] == pytest.approx(by_hand, abs=0.015)


def result(*numbers, error=None, case="film"):
    keys = ("quantity", "value", "target", "unit", "met")
    numbers = [dict(zip(keys, number, strict=True)) for number in numbers]
    return {"case": case, "reference": "exact", "numbers": numbers, "series": [], "error": error, "cpu_seconds": 1.0}


SLUMP, VOLUME = ("slump at rest", 1.0, 5.0, "mm", True), ("volume", 2.0, 0.5, "%", False)


def test_both_schemes_stand_side_by_side():
    """Results of both schemes are listed line by line; a number with another name keeps it, and the reason that ended a
    row follows its numbers."""
    late = ("slump at 5 s", -9.0, 5.0, "mm", False)
    rows = {"slump_100": result(SLUMP, VOLUME), "couette": result(SLUMP), "slump_300": result(SLUMP)}
    others = {"slump_100": result(late, error="diverged at t = 1 s"), "couette": result(error="not run: it moves")}
    text = table.markdown(rows, others | {"slump_500": result(late)})
    for line in (
        "| case | reference | quantity | measured | target |  | CPU-s | semi-implicit | CPU-s |\n",
        "| slump at rest | 1 mm | <= 5 mm | met | 1 | -9 mm (slump at 5 s), **missed** | 1 |\n",
        "|  |  | volume | 2 % | <= 0.5 % | **missed** |  | diverged at t = 1 s |  |\n",
        "| slump at rest | 1 mm | <= 5 mm | met | 1 | not run | 1 |\n",
        "| slump at rest | 1 mm | <= 5 mm | met | 1 |  |  |\n",  # not asked for
        "| slump at 5 s | - | <= 5 mm | - |  | -9 mm, **missed** | 1 |\n",
        "3 of 4 numbers meet their target; 0 rows failed.\n",
        "`semi-implicit`: 0 of 2 numbers meet their target; 1 rows failed; 1 were not run.",
    ):
        assert line in text, line
    assert {line.count("|") for line in text.splitlines() if line.startswith("|")} == {10}


def test_a_page_gets_the_convergence_of_all_kept_results(tmp_path, monkeypatch):
    """The page shows the convergence over the row just run and the kept result, and the command ends with 1 where one
    misses."""
    points = {"slump_1000": (10.0, 2.0), "slump_1000_coarse": (20.0, 8.0)}

    def run(name, *how):
        x, y = points[name]
        point = {"quantity": SLUMP_ERROR, "curve": "1000 Pa", "x": (x,), "y": (y,)}
        return result(("slump", y, 5.0, "mm", y <= 5.0)) | {"row": name, "series": [point]}

    drawn, page = [], tmp_path / "page.md"
    monkeypatch.setattr(table, "run_apart", run)
    monkeypatch.setattr(chart, "_save", lambda figure, out: drawn.append((figure, out)))
    page.write_text(f"before\n{table.BEGIN}\nold\n{table.END}\nafter\n")
    for name, (_, y) in points.items():
        assert main([name, "--out", str(tmp_path / "out"), "--page", str(page)]) == (y > 5.0)
    figure, out = drawn[-1]
    text = page.read_text()
    assert out == tmp_path / "figures" / "convergence.png" and text.count("| slump |") == 2 and "old" not in text
    assert text.startswith(f"before\n{table.BEGIN}\n\n|") and text.endswith(f"\n\n{table.END}\nafter\n")
    np.testing.assert_array_equal(figure.axes[0].lines[-1].get_xydata(), sorted(points.values()))


def test_command_refuses_an_unknown_row_and_writes_the_table(tmp_path, capsys, monkeypatch):
    assert main(["plane_couete", "--out", str(tmp_path / "out")]) == 2
    assert "did you mean" in capsys.readouterr().err and not (tmp_path / "out").exists()
    monkeypatch.setattr(table, "run_apart", lambda each, *how: result(error=f"{how}") | {"row": each})
    command = ["couette", "--out", str(tmp_path / "out")]
    assert main([*command, "--json"]) == 1
    assert json.loads(capsys.readouterr().out)[0]["row"] == "couette"
    assert main([*command, "--scheme", "semi-implicit", "--budget", "20"]) == 1
    written = (tmp_path / "out" / "table.md").read_text()
    assert "**failed**: ('implicit', None)" in written and "| ('semi-implicit', 20.0) |" in written


# ---- the paper's scheme ----------------------------------------------------------------------------------------
@pytest.fixture
def papers(setting):
    """Rows run with the paper's scheme, without a budget."""
    setting.scheme, setting.budget = "semi-implicit", None


def channel(**settings):
    return flows.between_walls(0.005, 0.1, mps.Newtonian(density=1000.0, viscosity=1.0), **settings)


@pytest.mark.lattice("the particle number density is n0 to rounding")
def test_planes_get_three_layers_of_wall_particles_that_go_on_the_lattice(papers):
    """With the wall particles the particle number density is n0 everywhere: no gap, no overlap, also across the
    periodic side."""
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


def test_walls_that_move_or_that_no_lattice_can_follow_are_refused(papers):
    with pytest.raises(mps.SceneError, match="scene channel has a wall that moves"):
        simulate(channel(wall_speed=1.0))
    with pytest.raises(mps.SceneError, match="describes its walls as surfaces only"):
        simulate(replace(channel(), walls=(mps.Plane((0.0, 0.0), (0.6, 0.8)),)))


def test_a_budget_stops_a_run_and_says_where(papers):
    Setting.budget = 1e-9
    sim = simulate(mps.catalogue.build("film", spacing=0.01))
    with pytest.raises(TimeoutError, match=r"at t = 8\.36e-05 s: 1e-09 CPU-s spent"):
        sim.run()
    assert sim.steps == 1
