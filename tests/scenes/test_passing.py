"""Scenes with grains: whole bodies, the slice of the L-box, what is counted beyond bars and by height. No kernels."""

from dataclasses import replace

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.report.sentences import passing

CUBE = 0.01 * (np.stack(np.meshgrid(*[[-0.5, 0.5]] * 3), -1).reshape(-1, 3))  # a grain of eight particles [m]


def body(centres, mortar, spacing=0.01):
    """Snapshot of grains of eight particles at these centres [m], and of particles of mortar [m]."""
    x = np.vstack([*(np.array(centre) + CUBE for centre in centres), mortar])
    grain = np.r_[np.repeat(np.arange(len(centres)) + 1, 8), np.zeros(len(mortar), int)]
    return replace(mps.measure.still(x, spacing), grain=grain)


@pytest.mark.parametrize(
    ("name", "beyond"),  # where the far side of the bars, the outlet, or the gate is
    [
        ("l_box", lambda d: (0.156 + d, 0.01, 0.03)),
        ("j_ring", lambda d: (0.6 * (0.159 + d), -0.8 * (0.159 + d), 0.03)),
        ("u_box", lambda d: (0.14 + 0.01875 + 0.0065 + d, -0.03, 0.1)),
        ("v_funnel", lambda d: (0.01, -0.02, -d)),
        ("l_flow", lambda d: (0.1 + d, 0.01, 0.03)),
    ],
)
def test_grains_and_mortar_beyond_are_those_that_were_put_there(name, beyond):
    scene = mps.catalogue.build(name, model="full")
    at = [beyond(d) for d in (-0.03, -0.002, 0.002, 0.04, 0.06)]  # two of them have particles on either side
    mortar = np.array([beyond(d) for d in (-0.05, -0.04, -0.001, 0.001)])
    measures = scene.measure(body(at, mortar))
    assert measures["grains_number"] == 5.0 and measures["grains_passed_number"] == 3.0
    assert measures["mortar_passed_ratio"] == 0.25
    assert "grains_number" not in scene.measure(mps.measure.still(scene.fluid, scene.spacing))  # without grains


def test_thirds_are_those_of_the_depth_at_the_place_of_a_grain():
    deep = mps.lattice((0.0, 0.0, 0.0), (0.1, 0.1, 0.12), 0.01)
    shallow = mps.lattice((0.1, 0.0, 0.0), (0.3, 0.1, 0.06), 0.01)
    places = [(0.05, 0.05, z) for z in (0.02, 0.06, 0.1)] + [(0.25, 0.05, z) for z in (0.01, 0.03, 0.05, 0.048)]
    found = mps.measure.grains(body(places, np.vstack([deep, shallow])))
    thirds = [found[f"grains_{third}_ratio"] for third in ("bottom", "middle", "top")]
    assert thirds == pytest.approx([2 / 7, 2 / 7, 3 / 7], abs=1e-12)
    assert mps.measure.grains(mps.measure.still(deep, 0.01)) == {}


@pytest.mark.parametrize(
    ("name", "mirrors", "model"),
    [
        ("j_ring", 2, {}),
        ("v_funnel", 2, {"top": 0.525}),  # columns of particles that the middle plane leaves whole
        ("u_box", 1, {}),
        ("slump", 2, {"model": "quarter"}),
        ("slump", 1, {"model": "half"}),
    ],
)
def test_the_full_model_is_the_part_and_its_images(name, mirrors, model):
    part, full = mps.catalogue.build(name, **model), mps.catalogue.build(name, **model | {"model": "full"})
    whole = part.unfold(mps.measure.still(part.fluid, part.spacing)).x
    assert not full.mirrors and len(part.mirrors) == mirrors
    order = [np.lexsort(np.round(x / full.spacing, 3).T) for x in (whole, full.fluid)]
    assert np.abs(whole[order[0]] - full.fluid[order[1]]).max() < 1e-12
    low, high = np.array(full.domain)
    x = low + (high - low) * np.random.default_rng(4).random((20000, 3))
    images = x.copy()
    for mirror in part.mirrors:
        images -= np.outer(np.minimum(2.0 * mirror.distance(images), 0.0), mirror.normal)
    solid = [wall for wall in part.walls if wall not in part.mirrors]
    distances = [np.min([w.distance(at) for w in walls], axis=0) for walls, at in ((solid, images), (full.walls, x))]
    near = distances[0] < full.spacing
    assert near.sum() > 500 and np.abs(distances[0] - distances[1])[near].max() < 0.1 * full.spacing  # by their grids


@pytest.mark.parametrize(("bars", "gap"), [("3", 0.041), ("2", 0.176 / 3.0)])
def test_the_slice_of_the_box_is_a_bar_and_the_gap_of_the_standard(bars, gap):
    slice_of, box = (mps.catalogue.build("l_box", spacing=0.008, bars=bars, model=model) for model in ("slice", "full"))
    width = slice_of.domain[1][1] - slice_of.domain[0][1]
    assert slice_of.periodic == (False, True, False) and width / 0.008 == pytest.approx(round(width / 0.008))
    assert abs(width - gap - 0.012) < 0.004 + 1e-12  # half a particle
    rod = slice_of.walls[-1]
    beside = np.array([[0.15, 0.5 * width + y, 0.05] for y in (-0.015, 0.015)])  # between the bar and its image
    assert rod.distance(beside) == pytest.approx(np.full(2, 0.5 * gap - 0.015), abs=4e-4)  # by its grid
    assert not any(isinstance(wall, mps.Plane) and wall.normal[1] for wall in slice_of.walls)
    assert len(slice_of.fluid) / width == pytest.approx(len(box.fluid) / 0.2)


@pytest.mark.parametrize(
    ("grains", "passed", "mortar", "verdict"),
    [
        (210, 3, 0.15, "Blocks: 3 of 210 grains pass, the mortar follows at 15 %."),
        (210, 20, 0.15, "Passes: 20 of 210"),
        (40, 0, 0.15, "Blocks"),  # 0.85^40, 0.0015
        (10, 0, 0.34, "Not decided"),  # 0.66^10, 0.016
        (210, 0, 0.004, "Nothing passes"),
    ],
)
def test_the_verdict_on_what_passes(grains, passed, mortar, verdict):
    found = {"grains_number": float(grains), "grains_passed_number": float(passed), "mortar_passed_ratio": mortar}
    assert passing(found | {"parameters": {"bars": 16}})[0].startswith(verdict)
    assert passing(found)[0].startswith(f"{passed} of {grains} grains are beyond the opening")
    stopped = found | {"parameters": {"bars": 16}, "stopped_by": "interrupted"}
    assert passing(stopped)[0].startswith(f"{passed} of {grains} grains are beyond the bars, with")
    assert "no probability" in passing(found | {"grains": {"shape": "disc"}})[0]
    assert passing({"grains_number": 4.0}) == []


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("printing", "mirror planes, which would cut them"),
        ("l_box --model half", "model full"),
        ("l_box --model slice --bars none", "must be 2 or 3"),
        ("slump --lift-speed 0.1", "gone at 0 s"),
        ("mini_cone --model axisymmetric", "must be the whole body"),
        ("u_box --spacing 8mm", "spacing = 0.004 m"),
    ],
)
def test_what_cannot_be_with_grains_is_refused_in_a_line_that_says_what_to_do(words, told, capsys):
    given = ["--grains", "16mm", "--grains-volume", "0.1", "--forecast"]
    assert mps.main(["run", *words.split(), *given]) == 2
    *_, line = capsys.readouterr().err.strip().splitlines()
    assert told in line and line.startswith("taichi-mps: ")
