"""Files written by version 0.3.0 are read, and its run continues as it would have there; those of 0.2.0 are refused.

written_by_0.3.0: the run ``slump --spacing 0.05 --until 0.05 --every 0.02 --precision f64 --threads 1``; next.npz:
positions [m] two steps later, ordered by id; checkpoint_semi_implicit.h5 and case_semi_implicit.toml: those of the same
run by the scheme ``semi-implicit``.
"""

import shutil
from pathlib import Path

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.cli.main import main, planned
from taichi_mps.io.history import read_history
from taichi_mps.io.run_folder import RunFolder
from taichi_mps.io.vtkhdf import Trajectory

WRITTEN = Path(__file__).parent / "written_by_0.3.0"


@pytest.fixture
def folder(tmp_path):
    """A copy of the run folder."""
    return RunFolder(shutil.copytree(WRITTEN, tmp_path / "run"))


@pytest.mark.slow
def test_a_checkpoint_goes_on_as_it_would_have_gone_on_there(folder):
    """All fields of an older checkpoint are read, and two steps later positions are those of that version within a
    twentieth of a spacing."""
    state, then = mps.checkpoint.read(folder.checkpoint), np.load(WRITTEN / "next.npz")
    sim = state.resume(state.admit(state.scene()))
    for name, array in sim.particles.read().items():
        np.testing.assert_array_equal(array, state.state[name], err_msg=name)
    sim.step()
    sim.step()
    now = sim.state()
    order = np.argsort(now["id"])
    assert now["steps"] == then["steps"] and now["time"] == pytest.approx(float(then["time"]), rel=1e-9)
    np.testing.assert_allclose(now["x"][order], then["x"], rtol=0.0, atol=0.05 * sim.scene.spacing)


def test_every_file_is_read(folder):
    folder.check_checkpoint(folder.checkpoint, mps.checkpoint.read(folder.checkpoint))
    summary, history = folder.read_summary(), read_history(folder.history)
    *_, last = Trajectory(folder.trajectory).checked_replay()
    assert (history["outer_iterations"][1], history["solver_iterations"][1]) == (40, 80)
    assert last.time == history["time_s"][-1] == summary["simulated_seconds"] == 0.05
    assert last.measures()["slump_m"] == pytest.approx(summary["slump_m"], abs=1e-6)
    for scheme, kind in (("", mps.Implicit), ("_semi_implicit", mps.SemiImplicit)):
        _, options, problem = planned("run", [str(folder.path / f"case{scheme}.toml")])
        later = problem.scene.parameters.keys() - summary["parameters"].keys()  # numbers of laws since then
        assert problem.scene.parameters == summary["parameters"] | dict.fromkeys(later) | {"age": 0.0}
        assert (options.every, options.precision, problem.numerics) == (0.02, "f64", kind())
        state = mps.checkpoint.read(folder.path / f"checkpoint{scheme}.h5")
        assert state.differing(*Trajectory(folder.trajectory).origin()[:2]) == ""
        assert state.admit(state.scene()).numerics == kind()
        assert mps.StepReport(**state.state["report"]).outer_iterations > 0
    assert main(["resume", str(folder.path)]) == 0
    assert Trajectory(folder.trajectory).cut(0.03, 0.02) == 2


def test_files_of_version_0_2_are_refused_by_the_version_that_reads_them(folder, capsys):
    """A history, checkpoints and a scene of version 0.2 have names that are gone; of a case: cli/test_case_file.py."""
    state = mps.checkpoint.read(folder.checkpoint)
    folder.history.write_text(folder.history.read_text().replace("outer_iterations", "viscous_iterations"))
    assert main(["report", str(folder.path)]) == main(["resume", str(folder.path), "--until=1"]) == 2
    assert capsys.readouterr().err.count("history.csv: of version 0.2; version 0.3.0 reads it") == 2
    for header, scalars in (({}, {"report": {"viscous_iterations": 6}}), ({"numerics": {"source": "mixed"}}, {})):
        older = mps.checkpoint.Checkpoint(state.header | header, state.state | scalars).write(folder.path / "older.h5")
        with pytest.raises(mps.SceneError, match=r"older.h5: of version 0.2; version 0.3.0 reads it"):
            mps.checkpoint.read(older)
    mixed = {"consistency": 20.0, "plastic_viscosity": 50.0}
    with pytest.raises(mps.SceneError, match="scene = slump: of version 0.2; version 0.3.0 reads it"):
        mps.catalogue.rebuild("slump", state.header["parameters"] | mixed)


def test_a_number_that_records_get_later_leaves_a_checkpoint_good_until_it_is_given():
    """Numbers added to a record since, at their defaults, and names of walls leave a checkpoint valid."""

    class Imagined(mps.Bingham):
        imagined_angle: float = 0.0

    Imagined.__name__ = "Bingham"

    def digests(material, path=None, name="", **turning):
        bar = mps.Solid(np.array([[-0.1, 0.1], [0.1, 0.1]]), (0.4, 0.0), 0.2, name=name, **turning)
        hose = mps.Inlet((0.5, 0.9), (0.0, -1.0), 0.1, rate=0.01, volume=0.1, path=path)
        walls = (mps.Plane((0.0, 0.0), (0.0, 1.0), name=name and f"{name}_2"), bar)
        scene = mps.Scene("x", material, 0.05, None, ((0, 0), (1, 1)), walls=walls, inlets=(hose,))
        return [
            mps.checkpoint.digest(scene, keys)
            for keys in (mps.checkpoint.PARTICLE_ATTRIBUTES, mps.checkpoint.LAW_ATTRIBUTES)
        ]

    usual = digests(mps.Bingham())
    assert usual == digests(Imagined()) == digests(mps.Bingham(), name="bar")
    changed = digests(mps.Bingham(), path=((0.0, 0.0, 0.0), (1.0, 0.1, 0.0)))
    assert changed[0] != usual[0] and changed[1] == usual[1]
    others = [digests(Imagined(imagined_angle=20.0)), digests(mps.Bingham(), angular_velocity=1.0, pivot=(0.5, 0.1))]
    assert all(other[0] == usual[0] and other[1] != usual[1] for other in others)


def test_a_large_array_counts_by_a_part_and_its_shape(monkeypatch):
    monkeypatch.setattr(mps.checkpoint, "SAMPLED_FROM", 10)
    scene = mps.Scene("x", mps.Bingham(), 0.1, mps.fill(mps.Box((0, 0), (1, 1)), 0.1), ((-1, -1), (2, 2)))
    moved = mps.Scene("x", mps.Bingham(), 0.1, scene.fluid + 0.01, scene.domain)
    digests = [mps.checkpoint.digest(one, mps.checkpoint.PARTICLE_ATTRIBUTES) for one in (scene, scene, moved)]
    assert digests[0] == digests[1] != digests[2]
