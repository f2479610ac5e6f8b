"""The one gate: each rule alone, on a problem that breaks it and on a sound one; and what follows from a problem."""

import re
from dataclasses import replace

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.problem import feasibility as rules
from taichi_mps.problem.problem import Problem
from tests.support.scenes import hose, parts, unchecked

PLANE = mps.Plane((0.0, 0.0), (0.0, 1.0))
BLOCK = mps.Solid.prism([(1.0, 0.0), (1.2, 0.0), (1.2, 0.2), (1.0, 0.2)], 0.05, 0.2)
FAR = mps.Solid.prism([(9.0, 0.0), (9.2, 0.0), (9.2, 0.2), (9.0, 0.2)], 0.05, 0.2)
PARTICLES = mps.Implicit(walls="particles")
EVERYWHERE = ((-1e5, -1e5), (1e5, 1e5))
CROWD = np.broadcast_to(np.zeros((1, 2)), (10**8, 2))  # no memory is taken

BROKEN = [
    (
        rules.internal_friction_is_implicit,
        {"material": mps.Bingham(friction_angle=20.0)},
        mps.SemiImplicit(),
        "friction_angle = 20 deg: the scheme semi-implicit has none",
    ),
    (rules.flow_curve_is_implicit, {"material": mps.HerschelBulkley()}, mps.SemiImplicit(), "must be Bingham with the"),
    (
        rules.own_laws_take_rate_and_structure,
        {"material": mps.FlowCurve(shear_stress=lambda rate: 40.0)},
        None,
        r"shear_stress\(rate\): must take two numbers, \(rate, structure\)",
    ),
    (rules.wall_loads_need_surfaces, {"wall_loads": True}, mps.SemiImplicit(), "has no surface to measure on"),
    (rules.wall_particles_have_surfaces, {"wall_particles": [[0.0, -0.1]], "walls": ()}, None, "must also describe"),
    (rules.curved_walls_are_wide, {"walls": (mps.Cylinder((0.2, 0.2), 0.2),)}, None, "radius = 0.2 m of a curved wall"),
    (rules.needs_no_surfaces, {}, PARTICLES, "scene block describes its walls as surfaces only"),
    (rules.needs_no_surfaces, {"axisymmetric": True}, mps.SemiImplicit(), "is axisymmetric: must be computed with"),
    (rules.needs_no_surfaces, {"walls": (replace(PLANE, velocity=(1.0, 0.0)),)}, PARTICLES, "moves or is thin"),
    (rules.needs_no_surfaces, {"walls": (replace(PLANE, mirror=True),)}, PARTICLES, "has a mirror plane"),
    (rules.needs_no_surfaces, {"walls": (), "inlets": (hose(),)}, PARTICLES, "has an inlet"),
    (
        rules.needs_no_surfaces,
        {"walls": (replace(PLANE, friction=mps.Friction(yield_value=10.0)),)},
        PARTICLES,
        "has friction",
    ),
    (rules.density_is_plausible, {"material": mps.Bingham(density=2.3)}, None, "must be from 200 to 20000 kg/m3"),
    (rules.jet_is_plausible, {"inlets": (hose(rate=1e3),)}, None, "leaves the hose at 1.67e[+]03 m/s; must be at most"),
    (rules.inlet_is_clear, {"inlets": (hose(centre=(0.2, 0.3)),)}, None, "lies in the fluid at 0 s"),
    (rules.particles_are_apart, {"fluid": np.zeros((3, 2))}, None, "2 of 3 particles lie on others"),
    (rules.fluid_is_in_front_of_walls, {"fluid": np.array([[0.0, -0.2]])}, None, "0.2 m behind a wall .Plane."),
    (rules.solids_reach_into_the_domain, {"walls": (FAR,)}, None, "its origin or its scale is another"),
    (rules.grid_fits, {"domain": EVERYWHERE}, None, "cells of the effective radius, 0.21 m; at most"),
    (rules.periods_are_long, {"periodic": (True, False), "domain": ((0.0, 0.0), (0.5, 2.0))}, None, "at least three"),
    (rules.pairs_can_be_counted, {"fluid": CROWD}, None, "makes 1e[+]08 particles with up to"),
]


@pytest.mark.parametrize(("rule", "changes", "numerics", "message"), BROKEN)
def test_a_rule_tells_what_breaks_it_and_nothing_of_a_sound_problem(rule, changes, numerics, message):
    sound = mps.Scene(**parts(walls=(PLANE, BLOCK)))
    assert rule(Problem(sound)) is None
    scene = unchecked(mps.Scene, **parts(**changes))
    said = rule(unchecked(Problem, scene=scene, numerics=numerics or mps.Implicit()))
    assert re.search(message, said), said


@pytest.mark.parametrize(
    ("arguments", "message"),
    [((None,), "scene = None: must be a Scene"), ((mps.Scene(**parts()), "implicit"), "numerics = implicit: must be")],
)
def test_a_problem_is_a_scene_and_numerics(arguments, message):
    with pytest.raises(mps.SceneError, match=f"^{message}"):
        Problem(*arguments)


def test_every_rule_is_tested():
    assert set(rules.RULES) == {rule for rule, *_ in BROKEN} | {rules.is_a_scene, rules.has_numerics}


def test_a_problem_that_breaks_a_rule_is_not_made():
    with pytest.raises(mps.SceneError, match="^density = 2.3 kg/m3: must be from 200 to 20000 kg/m3 under gravity"):
        Problem(mps.Scene(**parts(material=mps.Bingham(density=2.3))))


# ---- what follows from a problem -----------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("material", "law", "rests"),
    [
        (mps.Newtonian(), "newtonian", False),
        (mps.Bingham(yield_value=10.0, plastic_viscosity=50.0), "bingham", True),
        (mps.Bingham(yield_value=1000.0, plastic_viscosity=1.0), "bingham", True),
        (mps.Bingham(critical_strain_rate=0.1), "bi-viscosity", False),
        (mps.HerschelBulkley(yield_value=100.0, consistency=100.0), "bingham", True),
        (mps.HerschelBulkley(yield_value=0.0), "bingham", False),
    ],
)
def test_the_law_and_whether_it_rests_follow_from_the_material(material, law, rests):
    problem = Problem(mps.Scene(**parts(material=material)))
    assert (problem.law, problem.rests) == (law, rests)
    assert problem.materials == (material,)


def test_the_law_of_mixes_is_that_of_those_that_yield():
    soft, stiff = mps.Newtonian(density=2000.0), mps.Bingham(yield_value=50.0, plastic_viscosity=50.0)
    problem = Problem(mps.Scene(**parts(material=soft, inlets=(hose(material=stiff),))))
    assert problem.materials == (soft, stiff) and problem.law == "bingham" and not problem.rests


def test_walls_are_particles_where_the_scheme_or_the_user_wants_them_so_and_the_scene_has_them():
    bare, walled = mps.Scene(**parts(walls=())), mps.Scene(**parts(wall_particles=[[0.2, -0.05]]))
    wanted = [Problem(walled, mps.SemiImplicit()), Problem(walled, PARTICLES)]
    others = [Problem(walled), Problem(bare, mps.SemiImplicit())]
    assert [p.wall_particles for p in wanted + others] == [True, True, False, False]
    assert [p.scheme for p in wanted] == ["semi-implicit", "implicit"]


def test_the_effective_radius_and_what_is_expected_follow_from_the_scene():
    scene = mps.Scene(**parts(inlets=(hose(),)))
    problem = Problem(scene, mps.Implicit(effective_radius_ratio=2.5))
    assert problem.effective_radius == pytest.approx(0.25)
    jet = hose().speed(0.1)
    assert not problem.expected.inlets and np.linalg.norm(problem.expected.velocity, axis=1).max() == pytest.approx(jet)
    assert problem.expected.fluid[:, 1].max() > 1.4  # as high as the mouth
