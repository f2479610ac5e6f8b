"""Checkpoints that earlier versions wrote: the run goes on as it would have gone on there.

checkpoint_6_*.h5: a slump test of 84 particles after 5 steps, in double precision, by the last version before the rooms
(format 6); that of ``implicit`` with ``sleep``, which did something then. checkpoint_6_next.npz: positions [m],
velocities [m/s] and pressures [Pa] by that version two steps later, ordered by id.
"""

from pathlib import Path

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.io import checkpoint

HERE = Path(__file__).parent
THEN = ("701126f08d8b65e3", "64a8c28f40a8727b")  # digests of a scene by the version before walls had names


@pytest.mark.parametrize("scheme", ["implicit", "semi_implicit"])
def test_a_run_of_format_6_goes_on_as_it_would_have_gone_on_there(scheme):
    """Within rounding: sums may be in another order. 1e-6 of the largest number after two steps."""
    old, then = checkpoint.read(HERE / f"checkpoint_6_{scheme}.h5"), np.load(HERE / "checkpoint_6_next.npz")
    sim = old.simulation()
    for name, array in sim.particles.read().items():
        np.testing.assert_array_equal(array, old.state[name], err_msg=name)
    sim.step()
    sim.step()
    now = sim.state()
    order = np.argsort(now["id"])
    assert now["steps"] == 7 and now["time"] == pytest.approx(float(then[f"{scheme}_time"]), rel=1e-9)
    for name in ("x", "u", "p"):
        there = then[f"{scheme}_7_{name}"]
        np.testing.assert_allclose(now[name][order], there, rtol=0.0, atol=1e-6 * np.abs(there).max(), err_msg=name)


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


def test_what_walls_and_inlets_had_not_yet_leaves_a_checkpoint_good_until_it_is_given():
    """Names of walls never count."""

    def digests(path=None, name="", **turning):
        bar = mps.Solid(np.array([[-0.1, 0.1], [0.1, 0.1]]), (0.4, 0.0), 0.2, name=name, **turning)
        hose = mps.Inlet((0.5, 0.9), (0.0, -1.0), 0.1, rate=0.01, volume=0.1, path=path)
        walls = (mps.Plane((0.0, 0.0), (0.0, 1.0), name=name and f"{name}_2"), bar)
        scene = mps.Scene("x", mps.Bingham(), 0.05, None, ((0, 0), (1, 1)), walls=walls, inlets=(hose,))
        return checkpoint.particles_digest(scene), checkpoint.laws_digest(scene)

    particles, laws = digests()
    assert (particles[:16], laws[:16]) == THEN
    assert digests(name="bar") == (particles, laws)
    assert digests(path=((0.0, 0.0, 0.0), (1.0, 0.1, 0.0)))[0] != particles
    assert digests(angular_velocity=1.0, pivot=(0.5, 0.1))[1] != laws
