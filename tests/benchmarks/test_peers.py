"""Peers that are not installed are skipped by name, and errors are read right from known output. Compiles nothing."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from taichi_mps.validation import columns

PEERS = Path(__file__).resolve().parents[2] / "benchmarks" / "peers"
sys.path.append(str(PEERS))

import cases  # noqa: E402
import compare  # noqa: E402
import openfoam_slump as openfoam  # noqa: E402

SLUMP = next(case for case in cases.CASES if case.name == "slump_full_500Pa_10mm")
DAM = next(case for case in cases.CASES if case.kind == "dam")


def test_a_peer_that_is_not_installed_is_skipped_by_name(monkeypatch, tmp_path, capsys):
    monkeypatch.setenv("PATH", str(tmp_path))
    for name in ("newton", "pysph", "splishsplash"):
        monkeypatch.setenv(f"TAICHI_MPS_PEER_{name.upper()}", str(tmp_path / name))
    assert compare.installed(["taichi_mps", *compare.PEERS]) == ["taichi_mps"]
    said = capsys.readouterr().out
    for name, peer in compare.PEERS.items():
        assert f"{name}: not installed, skipped (python benchmarks/peers/{peer.script} install)" in said
        assert (PEERS / peer.script).exists()
    python = tmp_path / "newton" / "bin" / "python"
    python.parent.mkdir(parents=True)
    python.touch()
    assert compare.installed(["newton"]) == []  # begun, but not finished
    (tmp_path / "newton" / "installed").touch()
    assert compare.installed(["newton"]) == ["newton"]


def test_a_run_that_fails_is_a_failure_and_has_no_figures(monkeypatch):
    monkeypatch.setattr(compare, "command", lambda *_: [sys.executable, "-c", "raise SystemExit('broken')"])
    row = compare.measure(SLUMP, SLUMP.runs[1], 60.0)
    assert row["failed"] == "broken (exit status 1)" and "cpu_seconds" not in row
    monkeypatch.setattr(compare, "command", lambda *_: [sys.executable, "-c", "import time; time.sleep(60)"])
    assert compare.measure(SLUMP, SLUMP.runs[1], 0.2)["failed"] == "not done in 0.2 s (exit status 124)"


def test_runs_are_told_by_their_mean_and_scatter_and_by_a_failure():
    rows = [
        {
            "label": "a",
            "steps": 10 + k,
            "cpu_seconds": 1.0 + k,
            "slump_errors_m": [k, -3.0 - k],
            "worst_slump_error_m": w,
        }
        for k, w in enumerate((-3.0, -4.0, -5.0))
    ]
    found = compare.together(rows)
    assert (found["label"], found["runs"], found["steps"], found["cpu_seconds"]) == ("a", 3, 11, 2.0)
    assert found["worst_slump_error_m"] == -4.0 and found["worst_slump_error_m_scatter"] == pytest.approx(1.0)
    assert compare.together([*rows, {"label": "a", "failed": "broken"}])["failed"] == "broken"


def test_all_of_a_case_stands_aside_by_a_millionth_of_a_spacing():
    for case, key in ((SLUMP, "fluid"), (DAM, "aside")):
        first, second, third = (np.array(case.data(case.runs[-1], seed)[key]) for seed in (0, 1, 2))
        assert 0.0 < np.abs(second - first).max() <= 1.01e-6 * case.spacing and np.any(third != second)


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
    """Rows of particles up to the measured front, and a drop ahead of it, which does not count."""
    known, l0 = columns("C_dambreak_front_martin_moyce_koshizuka.csv", dataset="martin_moyce_a2.25in_n2=2"), DAM.spacing
    t, front = np.append(0.0, known["t*sqrt(2g/a)"][:6]), cases.COLUMN * np.append(1.0, known["z/a"][:6])
    bodies = [np.append(np.arange(0.0, reach - 0.5 * l0, l0), reach - 0.5 * l0) for reach in front]
    x = [np.column_stack([np.append(along, along[-1] + 2.5 * l0), np.zeros(len(along) + 1)]) for along in bodies]
    unit = (2 * 9.81 / cases.COLUMN) ** 0.5
    found, early = (cases.judge(DAM, {"t": (t - delay) / unit, "x": x}) for delay in (0.0, 0.2))
    assert found["front_error_no_delay"] < 1e-12 and found["gate_delay"] == 0.0
    assert early["gate_delay"] == pytest.approx(0.2) and early["front_error"] < 1e-12
    assert early["front_error_no_delay"] > 0.05


def test_openfoam_files_and_the_surface_in_them(tmp_path):
    case = {**cases.CONE, **cases.MIX, "spacing": 0.01, "until": 1.0, "yield_value": 500.0}
    case["settings"] = {"rate": 0.02, "courant": 0.5, "max_dt": 0.002, "krylov": True}
    nr, nz = openfoam.write(case, tmp_path)
    alpha = openfoam.read_alpha((tmp_path / "0/alpha.concrete").read_text(encoding="utf-8"), nr, nz)
    r = (np.arange(nr) + 0.5) * 0.01
    volume = 2.0 * np.pi * 0.01**2 * float((alpha * r).sum())
    assert volume == pytest.approx(np.pi * 0.3 / 3 * (0.1**2 + 0.1 * 0.05 + 0.05**2), rel=2e-3)
    slump, spread = openfoam.measured(alpha, 0.01, 0.3)
    assert abs(slump) < 1e-9 and abs(spread - 0.2) < 0.002
    alpha[:] = 0.0
    alpha[:10, :12] = 1.0
    alpha[10, :12] = 0.25  # the surface stands where 0.5 lies between the centres at 95 and 105 mm
    slump, spread = openfoam.measured(alpha, 0.01, 0.3)
    assert slump == pytest.approx(0.3 - (0.095 + 0.01 * 2 / 3)) and spread == pytest.approx(2 * 0.12)
    assert "nu0 10.89" in (tmp_path / "constant/transportProperties").read_text(encoding="utf-8")
    with pytest.raises(ValueError, match="3 cells"):
        openfoam.read_alpha("internalField nonuniform List<scalar> 3(0 1 0);", nr, nz)


def test_a_case_is_plain_numbers():
    for case in cases.CASES:
        for run in case.runs:
            data = json.loads(json.dumps(case.data(run)))
            assert data["spacing"] == case.spacing and data["settings"] == run.settings
        if case.kind == "slump" and case.model == "full":
            assert len(data["fluid"]) == len(case.scene().fluid)
