"""The rules of a scene, each alone: on a scene that breaks it and on one that does not."""

import re
from dataclasses import replace

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.problem import scene_rules as rules
from taichi_mps.problem.problem import Problem
from tests.support.scenes import hose, parts, unchecked

FLOOR = mps.Plane((0.0, 0.0), (0.0, 1.0))
NAMED = mps.Plane((0.0, 0.0), (0.0, 1.0), name="floor")
ROUGH = replace(FLOOR, friction=mps.Friction(yield_value=10.0))
MIRROR = mps.Plane((0.0, 0.0), (1.0, 0.0), mirror=True)
SLANTED = mps.Plane((-1.0, 0.0), (0.6, 0.8), mirror=True)
LEVEL = mps.Plane((0.0, -1.0), (0.0, 1.0), mirror=True)
OTHER = mps.Newtonian(density=1500.0)
CURVE = mps.HerschelBulkley()
KNEE = mps.Bingham(critical_strain_rate=0.1)
WHERE = {"walls": (MIRROR,), "fluid": np.array([[0.05, 0.05]])}
TWO = np.vstack([parts()["fluid"] + shift for shift in (0.0, 0.03)])  # overlapping, no particle on another


def poured(**changes):
    return {"walls": (), "inlets": (hose(**changes),)}


BROKEN = [
    (rules.plain_values_have_their_types, {"name": 3}, "name = 3: must be text"),
    (rules.plain_values_have_their_types, {"axisymmetric": "a"}, "axisymmetric = a: must be True or False"),
    (rules.sequences_hold_their_types, {"walls": (3,)}, "walls = .3,.: must be a tuple, each Plane or Cylinder or"),
    (rules.materials_are_materials, {"material": None}, "material = None: must be Bingham, Newtonian"),
    (
        rules.materials_are_materials,
        poured(material="water"),
        "inlet: material = water: must be Bingham, Newtonian, Hers",
    ),
    (rules.walls_have_the_dimension_of_the_fluid, {"walls": (mps.Plane((0.0,) * 3, (0.0, 0.0, 1.0)),)}, "must have 2"),
    (rules.inlets_need_no_rings, poured() | {"axisymmetric": True}, "the scene is axisymmetric; must be a scene"),
    (
        rules.inlets_have_the_dimension_of_the_fluid,
        poured(centre=(0.2, 0.2, 1.5), direction=(0.0, 0.0, -1.0)),
        "must have as many coordinates as the fluid",
    ),
    (rules.inlets_bring_a_layer, poured(volume=0.01), "volume = 0.01 m3: must be at least half a layer, 0.03 m3"),
    (
        rules.mirrors_leave_a_hose_whole_or_halve_it,
        poured(centre=(0.1, 1.5)) | {"walls": (MIRROR,)},
        "cuts the hose; its axis must lie in the plane",
    ),
    (
        rules.nozzles_move_along_mirrors,
        poured(centre=(0.9, 1.5), path=((0.0, 0.0, 0.0), (1.0, 0.1, 0.0))) | {"walls": (MIRROR,)},
        "path: crosses walls: mirror plane",
    ),
    (rules.inlets_are_in_front_of_mirrors, poured(centre=(-0.9, 1.5)) | {"walls": (MIRROR,)}, "lies behind a mirror"),
    (rules.inlets_are_free_of_walls, poured(centre=(0.2, -0.2)) | {"walls": (FLOOR,)}, "the mouth reaches into a wall"),
    (
        rules.mixes_are_few,
        {"inlets": tuple(hose(material=mps.Bingham(yield_value=float(k))) for k in range(257))},
        "inlets: bring 258 mixes; must be at most 256",
    ),
    (rules.mixes_have_one_law, poured(material=KNEE) | {"material": CURVE}, "must be given for all mixes or for none"),
    (rules.mixes_have_one_law, poured(material=KNEE), "critical_strain_rate: must be given for all mixes or for none"),
    (rules.walls_have_names_of_their_own, {"walls": (NAMED, NAMED)}, "name = 'floor': of 2 walls; must be of one"),
    (
        rules.walls_have_names_of_their_own,  # that of the second is wall_1 without one
        {"walls": (replace(NAMED, name="wall_1"), FLOOR)},
        "name = 'wall_1': of 2 walls; must be of one",
    ),
    (rules.friction_is_of_one_mix, poured(material=OTHER) | {"walls": (ROUGH,)}, "where a wall has friction"),
    (rules.something_is_there_at_the_start, {"fluid": np.zeros((0, 2))}, "must hold at least one particle"),
    (rules.body_lies_in_the_domain, {"fluid": np.array([[3.0, 0.0]])}, "a particle lies outside; the domain must"),
    (
        rules.body_lies_in_the_domain,
        {"domain": ((0.05, -1.0), (2.0, 2.0))},
        "on its edge; the domain must reach beyond",
    ),
    (
        rules.bodies_are_apart,
        {"fluid": TWO},
        r"about 15 of 50 .* from \(0.025, 0.025\) to \(0.625, 0.625\) m: bodies over",
    ),
    (rules.rings_lie_around_the_axis, parts(3) | {"axisymmetric": True}, "the fluid has 3 coordinates; must have 2"),
    (rules.rings_lie_around_the_axis, {"axisymmetric": True, "fluid": -np.ones((1, 2))}, "r = -1 m; r must be above 0"),
    (rules.rings_lie_around_the_axis, {"axisymmetric": True, "gravity": (1.0, 0.0)}, "must be along z, axisymmetric"),
    (rules.rings_lie_around_the_axis, {"axisymmetric": True, "periodic": (True, False)}, "only z may be periodic"),
    (rules.fluid_is_in_front_of_mirrors, {"walls": (MIRROR,), "fluid": np.zeros((1, 2))}, "lies on it or behind it"),
    (rules.gravity_lies_in_mirrors, {"walls": (LEVEL,)}, "gravity = .0.0, -9.81. m/s2 must lie in the plane"),
    (rules.mirrors_stand_at_right_angles, WHERE | {"walls": (MIRROR, SLANTED)}, "must be at right angles to that with"),
]


@pytest.mark.parametrize(("rule", "changes", "message"), BROKEN)
def test_a_rule_tells_what_breaks_it_and_nothing_of_a_sound_scene(rule, changes, message):
    for sound in ({}, WHERE, poured(), {"axisymmetric": True}):
        assert rule(mps.Scene(**parts(**sound))) is None
    scene = unchecked(mps.Scene, **parts(**changes) if "walls" in changes else parts() | changes)
    try:
        said = rule(scene)
    except mps.SceneError as refusal:
        said = str(refusal)
    assert re.search(message, said), said


def test_every_rule_is_tested():
    assert {*rules.KINDS, *rules.RULES} == {rule for rule, *_ in BROKEN}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"fluid": []}, "fluid: the geometry is empty; it must hold at least one particle"),
        ({"fluid": [[1.0]]}, "fluid: positions have 1 coordinates; must have 2 or 3"),
        ({"spacing": -1.0}, "spacing = -1.0 m: must be greater than 0 m"),
        ({"until": 1e-300}, "until = 1e-300 s: must be at least 1e-09 s"),
        ({"until": np.nan}, "until: a value is not a finite number"),
        ({"domain": ((1.0, 1.0), (0.0, 0.0))}, "the second corner must be above the first along each axis"),
        ({"gravity": (0.0, 0.0, -9.81)}, r"gravity: has the shape \(3,\); must be numbers \[m/s2\] of shape \(2,\)"),
        ({"velocity": np.zeros((1, 2))}, r"velocity: has the shape \(1, 2\)"),
        ({"wall_particles": np.zeros((1, 3))}, "wall_particles: have 3 coordinates; must have 2, as the fluid has"),
        ({"periodic": (True,)}, "must have one word for each of 2 axes"),
        ({"gravity": (1.0, 0.0), "axisymmetric": True}, "must be along z, axisymmetric"),
    ],
)
def test_a_scene_that_cannot_be_is_not_made(changes, message):
    with pytest.raises(mps.SceneError, match=message):
        mps.Scene(**parts(**changes))


def random_places(d):
    return np.random.default_rng(3).uniform(0.0, 2.0, (20**d, d))


@pytest.mark.parametrize(
    "fluid",
    [
        np.vstack([parts()["fluid"], parts()["fluid"] + (0.5, 0.05)]),  # bodies that touch, half a spacing off
        np.vstack([parts()["fluid"], parts()["fluid"] + (0.5, 0.0), parts()["fluid"] + (0.23, 0.5)]),
        random_places(2),
        random_places(3),
        mps.rings(0.0, 0.8, 0.1) + 0.9,
    ],
)
def test_bodies_that_touch_and_uneven_fills_are_no_overlap(fluid):
    d = fluid.shape[1]
    assert mps.Scene(**parts(d, fluid=fluid, domain=((-1.0,) * d, (3.0,) * d))).fluid is not None


def test_periodic_sides_hold_a_particle_once():
    """One on the lower end of a periodic axis is there, one on either end is there twice."""
    row = np.column_stack([np.arange(0.0, 2.0, 0.1), np.full(20, 0.5)])
    sides = {"domain": ((0.0, -1.0), (2.0, 2.0)), "periodic": (True, False)}
    assert Problem(mps.Scene(**parts(fluid=row, **sides)))
    with pytest.raises(mps.SceneError, match="1 of 21 particles lie on others"):
        Problem(mps.Scene(**parts(fluid=np.vstack([row, (2.0, 0.5)]), **sides)))


def test_what_was_given_as_lists_and_integers_is_held_as_tuples_and_arrays():
    given = parts(fluid=[[0, 0]], spacing=1, walls=[FLOOR], gravity=[0, -1], periodic=[True, False], until=2)
    scene = mps.Scene(**given | {"domain": ((-9, -9), (9, 9)), "fluid": [[0, 1]]})
    assert scene.walls == (FLOOR,) and scene.gravity == (0.0, -1.0) and scene.periodic == (True, False)
    assert scene.fluid.dtype == float and isinstance(scene.spacing, float) and isinstance(scene.until, float)
