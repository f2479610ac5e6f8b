"""The peers' scripts without any peer: skipping by name, and what is read from their output. Compiles nothing."""

import json
import os
import sys
from pathlib import Path

import numpy as np
import pytest

PEERS = Path(__file__).resolve().parents[2] / "benchmarks" / "peers"


@pytest.fixture(scope="module", autouse=True)
def on_path():
    sys.path.insert(0, str(PEERS))
    yield
    sys.path.remove(str(PEERS))


def test_a_peer_that_is_not_installed_is_skipped_by_name(monkeypatch, tmp_path, capsys):
    import compare

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
    import compare
    from cases import CASES

    monkeypatch.setattr(compare, "command", lambda *_: [sys.executable, "-c", "raise SystemExit('broken')"])
    row = compare.measure(CASES[0], CASES[0].runs[1], 60.0)
    assert row["failed"] == "broken (exit status 1)" and "cpu_seconds" not in row
    monkeypatch.setattr(compare, "command", lambda *_: [sys.executable, "-c", "import time; time.sleep(60)"])
    assert compare.measure(CASES[0], CASES[0].runs[1], 0.2)["failed"] == "not done in 0.2 s (exit status 124)"


def test_runs_are_told_by_their_mean_and_scatter_and_by_a_failure():
    import compare

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
    from cases import CASES

    for case in (CASES[0], CASES[-1]):
        data = [case.data(case.runs[-1], seed) for seed in (0, 1, 2)]
        key = "aside" if case.kind == "dam" else "fluid"
        first, second, third = (np.array(one[key]) for one in data)
        assert 0.0 < np.abs(second - first).max() <= 1.01e-6 * case.spacing and np.any(third != second)


def test_the_reference_of_a_slump():
    from cases import reference

    assert reference(500.0)[1.0] == (pytest.approx(0.17987), pytest.approx(0.31928))
    assert reference(500.0)[0.1][0] == pytest.approx(0.03259)


def test_slump_from_particles_and_from_a_peer_that_gives_it():
    from cases import CASES, TIMES, judge, reference

    case = next(case for case in CASES if case.name == "slump_full_500Pa_10mm")
    exact = reference(500.0)
    n, l0 = 30, case.spacing
    grid = (np.arange(n) + 0.5) * l0 - 0.5 * n * l0
    frames = []
    for t in TIMES:  # boxes of the height of the reference: every column ends half a spacing above its top particle
        z = np.linspace(0.0, 0.3 - exact[t][0] - 0.5 * l0, 20)
        frames.append(np.stack(np.meshgrid(grid, grid, z, indexing="ij"), -1).reshape(-1, 3))
    found = judge(case, {"t": np.array(TIMES), "x": np.array(frames)})
    assert np.allclose(found["slump_errors_m"], 0.0, atol=1e-12)
    slump, spread = (np.array(values) for values in zip(*(exact[t] for t in TIMES), strict=True))
    late = slump + np.array([0.0, -0.003, 0.0, 0.002, 0.0])
    given = judge(case, {"t": np.array(TIMES), "slump": late, "spread": 1.02 * spread})
    assert given["worst_slump_error_m"] == pytest.approx(-0.003)
    assert given["spread_error"] == pytest.approx(0.02)
    with pytest.raises(ValueError, match="the run ended at 0.5 s"):
        judge(case, {"t": np.array(TIMES[:4]), "slump": late[:4], "spread": spread[:4]})


def test_front_of_the_dam_break():
    from cases import CASES, COLUMN, MARTIN_MOYCE, judge

    from taichi_mps.validation import read_reference

    case = next(case for case in CASES if case.kind == "dam")
    rows = [r for r in read_reference("C_dambreak_front_martin_moyce_koshizuka.csv") if r["dataset"] == MARTIN_MOYCE]
    at, z = (np.array([float(r[key]) for r in rows]) for key in ("t*sqrt(2g/a)", "z/a"))
    t = np.concatenate([[0.0], at[:6]])
    front = COLUMN * np.concatenate([[1.0], z[:6]])
    l0 = case.spacing
    bodies = [np.append(np.arange(0.0, reach - 0.5 * l0, l0), reach - 0.5 * l0) for reach in front]
    x = [np.column_stack([np.append(along, along[-1] + 2.5 * l0), np.zeros(len(along) + 1)]) for along in bodies]
    found = judge(case, {"t": t / (2 * 9.81 / COLUMN) ** 0.5, "x": x})
    assert found["front_error_no_delay"] < 1e-12 and found["gate_delay"] == 0.0
    early = judge(case, {"t": (t - 0.2) / (2 * 9.81 / COLUMN) ** 0.5, "x": x})
    assert early["gate_delay"] == pytest.approx(0.2) and early["front_error"] < 1e-12
    assert early["front_error_no_delay"] > 0.05


def test_openfoam_files_and_the_surface_in_them(tmp_path):
    import openfoam_slump as openfoam
    from cases import CONE, MIX

    case = {**CONE, **MIX, "spacing": 0.01, "until": 1.0, "yield_value": 500.0}
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
    from cases import CASES

    for case in CASES:
        for run in case.runs:
            data = json.loads(json.dumps(case.data(run)))
            assert data["spacing"] == case.spacing and data["settings"] == run.settings
        if case.kind == "slump" and case.model == "full":
            assert len(data["fluid"]) == len(case.scene().fluid)


def test_the_installer_of_a_peer_is_named_by_the_environment(monkeypatch):
    import environments

    monkeypatch.setenv("TAICHI_MPS_PEER_NEWTON", os.sep + "elsewhere")
    assert environments.folder("newton") == Path(os.sep + "elsewhere")
    monkeypatch.delenv("TAICHI_MPS_PEER_NEWTON")
    assert environments.folder("newton") == environments.HOME / "newton"
