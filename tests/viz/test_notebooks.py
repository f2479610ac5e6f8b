"""The notebooks run from top to bottom and show their results. Their cells run here one after the other, unchanged; the
last value of a cell is shown as a notebook would show it."""

import ast
import io
import json
import linecache
from pathlib import Path

import imageio.v3 as iio
import matplotlib
import numpy as np
import pytest
from matplotlib.figure import Figure

matplotlib.use("Agg")
BOOKS = sorted((Path(__file__).resolve().parents[2] / "notebooks").glob("*.ipynb"))


@pytest.fixture(scope="module", autouse=True)
def taichi():
    """The notebooks start it."""


def run(path):
    """Names after the last cell, and what each cell shows."""
    space, shown = {"__name__": "__main__"}, []
    for k, cell in enumerate(json.loads(path.read_text(encoding="utf-8"))["cells"]):
        if cell["cell_type"] != "code":
            continue
        outputs = cell["outputs"]
        assert sum("image/png" in output.get("data", {}) for output in outputs) <= 1, "a figure is shown twice"
        text, name = "".join(cell["source"]), f"{path.name}, cell {k}"
        linecache.cache[name] = len(text), None, text.splitlines(keepends=True), name
        body = ast.parse(text).body
        last = body.pop() if isinstance(body[-1], ast.Expr) else None
        exec(compile(ast.Module(body, []), name, "exec"), space)
        shown.append(eval(compile(ast.Expression(last.value), name, "eval"), space) if last else None)
        assert outputs or shown[-1] is None, "run a notebook from top to bottom before it is committed"
        if isinstance(shown[-1], Figure):  # which has one, too
            continue
        if hasattr(shown[-1], "_repr_png_"):
            shown[-1] = iio.imread(io.BytesIO(shown[-1]._repr_png_()))
        elif hasattr(shown[-1], "_repr_html_"):
            shown[-1] = shown[-1]._repr_html_()
    return space, shown


@pytest.mark.slow
def test_the_first_slump_is_that_of_the_finite_elements_in_five_cells():
    space, (_, before, after, figure, report) = run(BOOKS[0])
    assert before.shape == after.shape == (540, 960, 3) and before.std() > 10 and np.any(before != after)
    assert report.startswith("<table>") and "max_speed" in report
    assert abs(space["slump"][-1] - 0.180) < 0.01
    assert isinstance(figure, Figure)


@pytest.mark.slow
def test_kernels_by_hand_leave_the_simulation_as_it_was_and_are_what_numpy_gives():
    """Also that of a cell which is run again with another level, beside NumPy's sum over the whole."""
    space, shown = run(BOOKS[1])
    assert shown[0].shape == (540, 960, 3)
    assert abs(np.median(space["density"]) - 1.0) < 0.1
    assert np.abs(space["rate"][space["inside"]] / (0.5 * 12**0.5) - 1.0).max() < 1e-3
    assert space["residual"] <= 1e-5 and space["iterations"] > 3
    assert space["speed"].max() > 0.0
    sim, after = space["sim"], space["sim"].snapshot().x
    sim.load(space["saved"])
    sim.step()
    assert np.array_equal(sim.snapshot().x, after)
    state = sim.particles.read()
    for level in (0.1, 0.05):
        above = state["x"][:, 1] > level
        momentum = -(state["ring"] * state["u"][:, 1])[above].sum()
        assert space["momentum_above"](sim.particles, level) == pytest.approx(momentum, rel=1e-4)
    assert len(space["course"]) > 10 and np.ptp([value for _, value in space["course"]]) > 0.1
    space["set_invariant"](sim.particles, sim.scheme.solved_rate.G)
    G = sim.scheme.solved_rate.G.to_numpy()[: len(above)]
    exact = np.sqrt(0.5 * ((G + G.swapaxes(1, 2)) ** 2).sum((1, 2)))
    assert space["invariant"].to_numpy()[: len(above)] == pytest.approx(exact, rel=1e-4)
