"""What a resumed run takes over from the run before."""

import pytest

from taichi_mps.cli import main as cli
from taichi_mps.cli.run import rounded
from taichi_mps.io import checkpoint
from taichi_mps.io.recorder import Recorder
from taichi_mps.io.run_folder import RunFolder
from taichi_mps.problem import catalogue
from tests.support.recorded import Falling


@pytest.mark.parametrize(("words", "every"), [([], 0.01), (["--until", "9"], 0.01), (["--every", "0.5"], 0.5)])
def test_a_resumed_run_goes_on_with_the_interval_that_was_chosen_for_it(tmp_path, monkeypatch, words, every):
    """Of a run to 1 s it is 0.01 s, and stays so for another end; one that is given now counts."""
    folder, scene = RunFolder(tmp_path / "run"), catalogue.build("slump", spacing=0.05, until=1.0)
    folder.create()
    chosen = rounded(scene.until / 100)
    recorder = Recorder(folder, Falling(scene), chosen, "slump", {"every": chosen})
    recorder.finish("interrupted")
    found = []
    monkeypatch.setattr(cli, "start", lambda options: None)
    monkeypatch.setattr(checkpoint.Checkpoint, "resume", lambda state, problem, profile: problem)
    monkeypatch.setattr(cli, "carry_out", lambda sim, folder, options, *rest, **more: found.append(options.every) or 0)
    assert cli.main(["resume", str(folder.path), *words]) == 0
    assert found == [every]
