"""Picture of a filled form without matplotlib; with it: tests/simulation/test_pouring.py."""

import sys

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.viz import plots


def test_missing_matplotlib_is_said_clearly(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    form, body = mps.Cavity((0.0, 0.0), (0.4, 0.2), (), 0.1), mps.measure.still(np.full((1, 2), 0.1), 0.1)
    with pytest.raises(ImportError, match=r"pip install 'taichi-mps\[plots\]'"):
        plots.filling(form, body, tmp_path / "filling.png")
