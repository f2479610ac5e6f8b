"""Checkpoints that earlier versions wrote: the run goes on as if it had never stopped.

checkpoint_6_*.h5: a slump test of 84 particles after 5 steps, in double precision, by the last version before the rooms
(format 6); that of ``implicit`` with ``sleep``, which did something then.
"""

from pathlib import Path

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.io import checkpoint

HERE = Path(__file__).parent


@pytest.mark.filterwarnings("ignore:sleep = True")
@pytest.mark.parametrize("scheme", ["implicit", "semi_implicit"])
def test_a_run_of_format_6_goes_on(scheme):
    old = checkpoint.read(HERE / f"checkpoint_6_{scheme}.h5")
    resumed, whole = old.simulation(), mps.Simulation(old.scene(), old.numerics)
    for _ in range(5):
        whole.step()
    for _ in range(3):
        same(resumed.state(), whole.state())
        resumed.step()
        whole.step()
    same(resumed.state(), whole.state())


def same(a, b):
    """Rounding alone may differ: sums in another order, as on another processor."""
    assert (a["steps"], a["time"]) == (b["steps"], pytest.approx(b["time"], rel=1e-9))
    for name in ("x", "u", "p", "shear_rate"):
        order = np.argsort(a["id"]), np.argsort(b["id"])
        first, second = a[name][order[0]], b[name][order[1]]
        np.testing.assert_allclose(first, second, rtol=1e-6, atol=1e-6 * np.abs(second).max(), err_msg=name)


def test_another_format_is_refused_by_the_version_that_reads_it(tmp_path):
    path = tmp_path / "checkpoint.h5"
    content = (HERE / "checkpoint_6_implicit.h5").read_bytes()
    path.write_bytes(content.replace(b"checkpoint 6 ", b"checkpoint 5 ", 1))
    with pytest.raises(mps.SceneError, match="version 5, this program reads 6"):
        checkpoint.read(path)


def test_a_number_that_mixes_had_not_yet_leaves_a_checkpoint_good_until_it_is_given():
    class Imagined(mps.Bingham):
        imagined_angle: float = 0.0

    Imagined.__name__ = "Bingham"
    scene = checkpoint.read(HERE / "checkpoint_6_implicit.h5").scene()

    def digest(**more):
        material = Imagined(**scene.material.model_dump(), **more)
        return checkpoint.laws_digest(mps.Scene("x", material, 0.1, [[0.5, 0.5]], ((0, 0), (1, 1))))

    plain = checkpoint.laws_digest(mps.Scene("x", scene.material, 0.1, [[0.5, 0.5]], ((0, 0), (1, 1))))
    assert digest() == plain != digest(imagined_angle=20.0)
