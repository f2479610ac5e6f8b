"""Errors of peer codes are computed correctly from known output. Compiles no kernels."""

import sys
from pathlib import Path

import numpy as np
import pytest

from validation import columns

PEERS = Path(__file__).resolve().parents[2] / "benchmarks" / "peers"
sys.path.append(str(PEERS))

import cases  # noqa: E402

SLUMP = next(case for case in cases.CASES if case.name == "slump_full_500Pa_10mm")
DAM = next(case for case in cases.CASES if case.kind == "dam")


def test_slump_from_particles_and_from_a_peer_that_gives_it():
    slump, spread = cases.reference(500.0)
    assert slump == pytest.approx([0.03259, 0.1089, 0.1688, 0.17987, 0.17987]) and spread[-1] == pytest.approx(0.31928)
    n, l0, frames = 30, SLUMP.spacing, []
    grid = (np.arange(n) + 0.5) * l0 - 0.5 * n * l0
    for depth in slump:  # boxes of the height of the reference: columns end half a spacing above their top particle
        z = np.linspace(0.0, 0.3 - depth - 0.5 * l0, 20)
        frames.append(np.stack(np.meshgrid(grid, grid, z, indexing="ij"), -1).reshape(-1, 3))
    found = cases.judge(SLUMP, {"t": np.array(cases.TIMES), "x": np.array(frames)})
    assert np.allclose(found["slump_errors_m"], 0.0, atol=1e-12)
    late = slump + np.array([0.0, -0.003, 0.0, 0.002, 0.0])
    given = cases.judge(SLUMP, {"t": np.array(cases.TIMES), "slump": late, "spread": 1.02 * spread})
    assert given["worst_slump_error_m"] == pytest.approx(-0.003)
    assert given["spread_error"] == pytest.approx(0.02)
    with pytest.raises(ValueError, match="the run ended at 0.5 s"):
        cases.judge(SLUMP, {"t": np.array(cases.TIMES[:4]), "slump": late[:4], "spread": spread[:4]})


def test_front_of_the_dam_break():
    """The front of rows of particles is found at its known place, and a drop ahead of it does not count."""
    known, l0 = columns("C_dambreak_front_martin_moyce_koshizuka.csv", dataset="martin_moyce_a2.25in_n2=2"), DAM.spacing
    t, front = np.append(0.0, known["t*sqrt(2g/a)"][:6]), cases.COLUMN * np.append(1.0, known["z/a"][:6])
    bodies = [np.append(np.arange(0.0, reach - 0.5 * l0, l0), reach - 0.5 * l0) for reach in front]
    x = [np.column_stack([np.append(along, along[-1] + 2.5 * l0), np.zeros(len(along) + 1)]) for along in bodies]
    unit = (2 * 9.81 / cases.COLUMN) ** 0.5
    found, early = (cases.judge(DAM, {"t": (t - delay) / unit, "x": x}) for delay in (0.0, 0.2))
    assert found["front_error_no_delay"] < 1e-12 and found["gate_delay"] == 0.0
    assert early["gate_delay"] == pytest.approx(0.2) and early["front_error"] < 1e-12
    assert early["front_error_no_delay"] > 0.05
