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
    number, centres, radii, _ = body.grain_places
    assert (number > 0).mean() == pytest.approx(fraction, abs=0.01)
    apart = np.linalg.norm(centres[:, None] - centres, axis=-1) - radii[:, None] - radii
    assert apart[~np.eye(len(radii), dtype=bool)].min() > -1e-9
    assert (centres - radii[:, None]).min() > -1e-9
    assert np.all(centres + radii[:, None] < np.array([0.2, 0.2, 0.3]) + 1e-9)
    for g in range(1, len(radii) + 1):
        own = body.fluid[number == g]
        assert len(own) == len(template(round(2.0 * radii[g - 1] / L0, 6), 3)[1])
        assert own.mean(0) == pytest.approx(centres[g - 1], abs=1e-9)


def test_clumps_are_apart_whole_inside_and_turned_without_a_mean_direction():
    grains = mps.Grains(diameter=0.05, volume_fraction=0.25, shape="ellipsoid 2:1:1", seed=3)
    body = scene(grains, mps.lattice((0.0, 0.0, 0.0), (0.3, 0.3, 0.3), L0))
    number, centres, radii, turns = body.grain_places
    assert (number > 0).mean() == pytest.approx(0.25, abs=0.01) and len(np.unique(turns, axis=0)) == 12
    parts = grains.clump(3)[0]
    x = centres[:, None] + 0.05 * parts[:, :3] @ turns.transpose(0, 2, 1)
    apart = np.linalg.norm(x[:, None, :, None] - x[None, :, None], axis=-1) - 0.05 * np.add.outer(
        parts[:, 3], parts[:, 3]
    )
    assert apart[~np.eye(len(radii), dtype=bool)].min() > -1e-9
    assert (x - 0.05 * parts[:, 3:]).min() > -1e-9 and (x + 0.05 * parts[:, 3:]).max() < 0.3 + 1e-9
    kinds = np.unique(turns[:, :, 0], axis=0)
    assert kinds.T @ kinds / 12.0 == pytest.approx(np.eye(3) / 3.0, abs=1e-12)
    own = [body.fluid[number == g + 1] for g in range(len(radii))]
    assert np.array([y.mean(0) for y in own]) == pytest.approx(centres, abs=1e-9)
    along = [np.linalg.eigh(np.cov(y.T))[1][:, 2] @ turn[:, 0] for y, turn in zip(own, turns, strict=True)]
    assert np.abs(along).min() > 0.98


BALLS = [(0.0, 0.0, -3.0, 3.0), (0.0, 0.0, 3.0, 3.0)]  # two that touch


@pytest.mark.parametrize(
    "shape, exact",
    [
        (BALLS, np.array([1.4, 1.4, 0.4]) / 2.0 ** (2 / 3)),
        (np.array(BALLS)[:, 1:], [0.625, 0.125, 0.75]),
        ("ellipsoid 2:1:1", np.array([2.0, 5.0, 5.0]) / 5.0 / 2.0 ** (2 / 3)),
        ("ellipsoid 1:2:2", np.array([8.0, 5.0, 5.0]) / 5.0 / 4.0 ** (2 / 3)),
        ("ellipse 2:1", [0.125, 0.5, 0.625]),
    ],
)
def test_a_clump_has_the_volume_of_its_diameter_and_the_inertia_of_the_solid(shape, exact):
    """Over the mass and the square of the radius; of an ellipsoid within what its spheres leave out."""
    grains = mps.Grains(diameter=1.0, volume_fraction=0.1, shape=shape)
    parts, inertia = grains.clump(np.asarray(grains.rows).shape[1] - 1)
    assert inertia == pytest.approx(np.diag(exact), abs=0.01 if isinstance(shape, str) else 0.002)
    if len(parts) == 2:
        assert parts[:, -1] == pytest.approx(0.5 / 2.0 ** (1.0 / (parts.shape[1] - 1)), rel=2e-3)


def test_another_seed_gives_other_places_and_the_same_seed_the_same():
    first, again, other = (
        scene(mps.Grains(diameter=0.04, volume_fraction=0.2, seed=k)).grain_places[1] for k in (1, 1, 2)
    )
    assert np.array_equal(first, again) and not np.array_equal(first, other)


def test_across_a_periodic_face_a_grain_goes_on_at_the_other():
    x = mps.lattice((0.0, 0.0), (0.2, 0.2), L0)
    grains = mps.Grains(diameter=0.04, centres=[(0.0, 0.1)])
    number, centres, *_ = scene(grains, x, domain=((0.0, -0.1), (0.2, 0.3)), periodic=(True, False)).grain_places
    off = x[number == 1] - centres[0]
    off[:, 0] -= 0.2 * np.round(off[:, 0] / 0.2)
    assert np.linalg.norm(off, axis=1).max() <= 0.02 + 1e-9 and (off[:, 0] < 0.0).any() and (off[:, 0] > 0.0).any()


REFUSED = {
    "must be 3 or more: spacing = 0.005 m": dict(grains=mps.Grains(diameter=0.02, volume_fraction=0.2)),
    "the body holds none": dict(grains=mps.Grains(diameter=0.21, volume_fraction=0.2)),
    "reaches out of the fluid": dict(grains=mps.Grains(diameter=0.04, centres=[(0.0, 0.1, 0.1)])),
    "overlaps another": dict(grains=mps.Grains(diameter=0.04, centres=[(0.1, 0.1, 0.1), (0.1, 0.12, 0.1)])),
    "must have 3 coordinates": dict(grains=mps.Grains(diameter=0.04, centres=[(0.1, 0.1)])),
    "must be one of 3 dimensions": dict(grains=mps.Grains(diameter=0.06, volume_fraction=0.1, shape="ellipse 2:1")),
    "width of the largest sphere": dict(grains=mps.Grains(diameter=0.03, volume_fraction=0.1, shape="ellipsoid 2:1:1")),
    "mirror planes": dict(
        grains=mps.Grains(diameter=0.04, volume_fraction=0.1),
        walls=(mps.Plane((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), mirror=True),),
    ),
    "behind the mouth": dict(
        grains=mps.Grains(diameter=0.04, volume_fraction=0.1),
        walls=(mps.Plane((0.0, 0.0, 0.43), (0.0, 0.0, -1.0)),),
        inlets=(mps.Inlet((0.1, 0.1, 0.4), (0.0, 0.0, -1.0), 0.06, 0.002, 0.001),),
    ),
    "no fluid at 0 s": dict(
        grains=mps.Grains(diameter=0.04, centres=[(0.1, 0.1, 0.1)]),
        x=np.zeros((0, 3)),
        inlets=(mps.Inlet((0.1, 0.1, 0.4), (0.0, 0.0, -1.0), 0.06, 0.002, 0.001),),
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
    with pytest.raises(mps.SceneError, match="must be one or more"):
        mps.Grains(diameter=0.04, centres=np.zeros((0, 3)))
    with pytest.raises(mps.SceneError, match="sum 1"):
        mps.Grains(diameter=[(0.01, 0.5), (0.02, 0.4)], volume_fraction=0.2)
    for wrong in ("cube", "ellipsoid 2:1", "ellipse 2:0", "ellipsoid 99:1:1", [(0.0, 0.0, -1.0)], np.zeros((0, 3))):
        with pytest.raises(mps.SceneError, match="grains: shape = .*: must be 'sphere'"):
            mps.Grains(diameter=0.01, volume_fraction=0.1, shape=wrong)
