"""Curves: every function writes a PNG of the size asked, with the limits of its data and the units on its axes."""

import sys

import numpy as np
import pytest
from PIL import Image

from taichi_mps.viz import plots

TIME = np.linspace(0.0, 4.0, 50)
SLUMP = 0.2 * (1.0 - np.exp(-TIME))


@pytest.fixture
def figures(monkeypatch):
    """The figures drawn in a test."""
    drawn, save = [], plots._save
    monkeypatch.setattr(plots, "_save", lambda figure, out: (drawn.append(figure), save(figure, out))[1])
    return drawn


def size(path):
    with Image.open(path) as picture:
        assert np.ptp(np.asarray(picture.convert("L"))) > 100  # something is drawn
        return picture.size


@pytest.mark.parametrize("log_time", [False, True])
def test_slump_curve_points_downwards_in_cm(tmp_path, figures, log_time):
    runs = {
        "case #1": {"time_s": TIME, "slump_m": SLUMP},
        "_2": {"time_s": TIME[:20], "slump_m": 0.5 * SLUMP[:20]},
    }
    known = {"case #1": (TIME, 1.1 * SLUMP), "test": ([4], [0.1])}
    out = plots.slump_curve(runs, tmp_path / "new" / "slump.png", known, log_time)
    assert size(out) == (1200, 720)
    (axes,) = figures[0].axes
    bottom, top = axes.get_ylim()
    assert bottom > 100 * 1.1 * SLUMP.max() and top <= 0.0
    assert axes.get_xscale() == ("log" if log_time else "linear") and axes.get_xlim()[1] == pytest.approx(4.0)
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("time [s]", "slump [cm]")
    shown = [text.get_text().strip() for text in figures[0].legends[0].texts]
    assert shown == ["case #1", "_2", "case #1, reference", "test, reference"]
    first, _, same, _ = axes.lines
    assert first.get_color() == same.get_color() and same.get_linestyle() == "--"
    np.testing.assert_allclose(first.get_ydata(), 100 * SLUMP[int(log_time) :])  # there is no time 0 of a logarithm


def test_history_draws_a_panel_for_each_quantity_that_has_numbers(tmp_path, figures):
    rows = {
        "time_s": TIME,
        "slump_m": SLUMP,
        "spread_m": 0.2 + SLUMP,
        "dt_s": 0.01 + 0 * TIME,
        "volume_error": 1e-3 * TIME,
        "flowing_fraction": np.linspace(1.0, 0.0, 50),
        "force_floor_z_N": -TIME,
        "torque_N_m": 2.0 * TIME,
        "outer_iterations": 20 + TIME,
        "max_speed_m_s": np.exp(-TIME),
        "front_m": np.full(50, np.nan),
    }
    out = plots.history(rows, tmp_path / "history.png")
    titles = [axes.get_title(loc="left").partition(":")[0] for axes in figures[0].axes]
    assert titles == [
        "slump and slump flow [cm]",
        "torque [N m]",
        "force on floor z [N]",
        "largest speed [m/s]",
        "share of the concrete that flows [%]",
    ]
    assert size(out)[0] == 1125 and all(axes.get_xlim() == (0.0, 4.0) for axes in figures[0].axes)
    assert figures[0].axes[1].lines[0].get_ydata() == pytest.approx(2.0 * TIME)
    flowing = figures[0].axes[4].lines[0].get_ydata()
    assert flowing[0] == 100.0 and flowing[-1] == 0.0
    plots.history(rows, tmp_path / "numerics.png", numerics=True)
    titles = [axes.get_title(loc="left") for axes in figures[1].axes]
    assert titles[5:] == ["time step [ms]", "iterations", "volume error [%]"]


def test_missing_matplotlib_is_said_clearly(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(ImportError, match=r"pip install 'taichi-mps\[plots\]'"):
        plots.slump_curve({"run": {"time_s": TIME, "slump_m": SLUMP}}, tmp_path / "slump.png")


@pytest.mark.parametrize("label", ["r\udcff\udcfe", "a $x^ $ b", "\x1b[31m", "ü\nb"])
def test_a_run_may_have_any_name(tmp_path, label):
    rows = {"time_s": np.array([0.0, 1.0]), "slump_m": np.array([0.0, 0.1])}
    assert plots.slump_curve({label: rows}, tmp_path / "slump.png") and (tmp_path / "slump.png").stat().st_size > 1000
