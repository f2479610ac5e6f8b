"""Placing of grains: without overlap, whole, as much as was asked for, by seed; and what is refused, in one line."""

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.engine.geometry.packing import template

L0 = 0.01


def scene(grains, x=None, **more):
    x = mps.lattice((0.0, 0.0, 0.0), (0.2, 0.2, 0.3), L0) if x is None else x
    keywords = {"domain": ((-0.1,) * 3, (0.5,) * 3)} | more
    return mps.Scene("body", mps.Bingham(yield_value=50.0), L0, x, **keywords, grains=grains)


@pytest.mark.parametrize("fraction", [0.1, 0.25, 0.35])
def test_grains_of_two_sizes_are_apart_whole_inside_and_as_many_as_asked_for(fraction):
    grains = mps.Grains(diameter=[(0.03, 0.4), (0.04, 0.6)], volume_fraction=fraction)
    body = scene(grains)
    number, centres, radii = body.grain_places
    assert (number > 0).mean() == pytest.approx(fraction, abs=0.01)
    apart = np.linalg.norm(centres[:, None] - centres, axis=-1) - radii[:, None] - radii
    assert apart[~np.eye(len(radii), dtype=bool)].min() > -1e-9
    assert (centres - radii[:, None]).min() > -1e-9
    assert np.all(centres + radii[:, None] < np.array([0.2, 0.2, 0.3]) + 1e-9)
    for g in range(1, len(radii) + 1):
        own = body.fluid[number == g]
        assert len(own) == len(template(round(2.0 * radii[g - 1] / L0, 6), 3)[1])
        assert own.mean(0) == pytest.approx(centres[g - 1], abs=1e-9)


def test_another_seed_gives_other_places_and_the_same_seed_the_same():
    first, again, other = (
        scene(mps.Grains(diameter=0.04, volume_fraction=0.2, seed=k)).grain_places[1] for k in (1, 1, 2)
    )
    assert np.array_equal(first, again) and not np.array_equal(first, other)


def test_across_a_periodic_face_a_grain_goes_on_at_the_other():
    x = mps.lattice((0.0, 0.0), (0.2, 0.2), L0)
    grains = mps.Grains(diameter=0.04, centres=[(0.0, 0.1)])
    number, centres, _ = scene(grains, x, domain=((0.0, -0.1), (0.2, 0.3)), periodic=(True, False)).grain_places
    off = x[number == 1] - centres[0]
    off[:, 0] -= 0.2 * np.round(off[:, 0] / 0.2)
    assert np.linalg.norm(off, axis=1).max() <= 0.02 + 1e-9 and (off[:, 0] < 0.0).any() and (off[:, 0] > 0.0).any()


REFUSED = {
    "must be 3 or more: spacing = 0.005 m": dict(grains=mps.Grains(diameter=0.02, volume_fraction=0.2)),
    "the body holds none": dict(grains=mps.Grains(diameter=0.21, volume_fraction=0.2)),
    "reaches out of the fluid": dict(grains=mps.Grains(diameter=0.04, centres=[(0.0, 0.1, 0.1)])),
    "overlaps another": dict(grains=mps.Grains(diameter=0.04, centres=[(0.1, 0.1, 0.1), (0.1, 0.12, 0.1)])),
    "must have 3 coordinates": dict(grains=mps.Grains(diameter=0.04, centres=[(0.1, 0.1)])),
    "mirror planes": dict(
        grains=mps.Grains(diameter=0.04, volume_fraction=0.1),
        walls=(mps.Plane((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), mirror=True),),
    ),
    "stand on no lattice": dict(
        grains=mps.Grains(diameter=0.04, volume_fraction=0.1),
        x=mps.lattice((0.0,) * 3, (0.2,) * 3, L0) + np.random.default_rng(1).uniform(0.0, 1e-3, (8000, 3)),
    ),
}


@pytest.mark.parametrize("words", REFUSED)
def test_what_cannot_be_is_refused_in_one_line(words):
    with pytest.raises(mps.SceneError) as error:
        scene(**REFUSED[words])
    assert words in str(error.value) and "grains" in str(error.value) and "\n" not in str(error.value)


def test_a_grain_takes_volume_or_centres_and_a_grading_sums_to_one():
    for wrong in ({}, {"volume_fraction": 0.2, "centres": [(0.0, 0.0)]}, {"volume_fraction": 0.36}):
        with pytest.raises(mps.SceneError):
            mps.Grains(diameter=0.01, **wrong)
    with pytest.raises(mps.SceneError, match="sum 1"):
        mps.Grains(diameter=[(0.01, 0.5), (0.02, 0.4)], volume_fraction=0.2)
