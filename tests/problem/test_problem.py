"""Problem: invalid ones are refused in one line; properties that follow from scene and numerics."""

from dataclasses import replace

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.engine.problem.problem import Problem
from tests.support.scenes import hose, parts

PLANE = mps.Plane((0.0, 0.0), (0.0, 1.0))
WEST = mps.Plane((-0.5, 0.0), (1.0, 0.0))
FAR = mps.Solid.prism([(9.0, 0.0), (9.2, 0.0), (9.2, 0.2), (9.0, 0.2)], 0.05, 0.2)
PARTICLES, PAPER = mps.Implicit(walls="particles"), mps.SemiImplicit()

REFUSED = [
    (
        {"material": mps.Bingham(friction_angle=20.0)},
        PAPER,
        "friction_angle = 20 deg: the scheme semi-implicit has none",
    ),
    ({"material": mps.HerschelBulkley()}, PAPER, "must be Bingham with the scheme semi-implicit"),
    (
        {"material": mps.FlowCurve(shear_stress=lambda rate: 40.0)},
        None,
        r"shear_stress = <lambda>: must take two numbers, \(rate, structure\)",
    ),
    ({"wall_loads": True}, PAPER, "wall_loads = True: .* has no surface to measure on"),
    ({"wall_particles": [[0.0, -0.1]], "walls": ()}, None, "must also describe them as surfaces"),
    ({"walls": (mps.Cylinder((0.2, 0.2), 0.2),)}, None, "radius = 0.2 m of a curved wall: must be greater than .*0.21"),
    ({}, PARTICLES, "scene block describes its walls as surfaces only"),
    ({"axisymmetric": True}, PAPER, "scene block is axisymmetric; must be surfaces, scheme implicit"),
    ({"walls": (replace(PLANE, velocity=(1.0, 0.0)),)}, PARTICLES, "moves or is thin"),
    ({"walls": (replace(WEST, mirror=True),)}, PARTICLES, "has a mirror plane"),
    ({"walls": (), "inlets": (hose(),)}, PAPER, "has an inlet"),
    ({"walls": (replace(PLANE, friction=mps.Friction(yield_value=10.0)),)}, PARTICLES, "has friction"),
    (
        {"material": mps.Bingham(density=2.3)},
        None,
        "^density = 2.3 kg/m3: must be from 200 to 20000 kg/m3 under gravity .*2.3 t/m3",
    ),
    ({"material": mps.Bingham(density=23.0), "gravity": (0.0, -9.81)}, None, "^density = 23 kg/m3: must be from 200"),
    (
        {"material": mps.Bingham(density=2.3e4), "gravity": (6.9, -6.9)},
        None,
        "^density = 23000 kg/m3: must be from 200",
    ),
    ({"grains": mps.Grains(0.3, 0.2, density=2.65), "gravity": (0.0, -9.81)}, None, "^density = 2.65 kg/m3: must be"),
    ({"inlets": (hose(rate=1e3),)}, None, "leaves the hose at 1.67e[+]03 m/s; must be at most"),
    ({"inlets": (hose(path=((0.0, 0.0, 0.0), (1e-3, 1.0, 0.0))),)}, None, "moves with the jet at 1e[+]03 m/s"),
    ({"inlets": (hose(centre=(0.2, 0.3)),)}, None, "lies in the fluid at 0 s"),
    ({"fluid": np.array([[0.0, 0.1]] * 3)}, None, "2 of 3 lie on others"),
    ({"fluid": np.array([[0.0, -0.2]])}, None, "0.2 m behind a wall .Plane."),
    ({"walls": (FAR,)}, None, "its origin or its scale is another"),
    ({"domain": ((-1e5, -1e5), (1e5, 1e5))}, None, "cells of the search radius, 0.21 m; at most"),
    ({"periodic": (True, False), "domain": ((0.0, 0.0), (0.5, 2.0))}, None, "at least three search radii, 0.63 m"),
    (  # three effective radii, but not three of those by which the paper's scheme lists neighbours
        {"periodic": (True, False), "domain": ((0.0, 0.0), (0.7, 2.0)), "walls": ()},
        mps.SemiImplicit(effective_radius_ratio=2.3),
        "at least three search radii, 0.72 m",
    ),
    ({"wall_particles": [[0.2, -0.05], [0.2, -0.05]]}, PAPER, "particles: 1 of 27 lie on others"),
    ({"wall_particles": [[0.2, -9.0]]}, PAPER, "wall_particles: some lie outside of domain"),
    ({"inlets": (hose(volume=1e6),)}, None, "makes 1e[+]08 particles with up to"),
]


@pytest.mark.parametrize(("changes", "numerics", "message"), REFUSED)
def test_what_cannot_be_computed_is_refused(changes, numerics, message):
    scene = mps.Scene(**parts(**changes))
    with pytest.raises(mps.SceneError, match=message):
        Problem(scene, numerics)


# ---- what follows from a problem -----------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("materials", "law", "rests"),
    [
        ((mps.Newtonian(),), "newtonian", False),
        ((mps.Bingham(yield_value=10.0, plastic_viscosity=50.0),), "yield-stress", True),
        ((mps.Bingham(yield_value=1000.0, plastic_viscosity=1.0),), "yield-stress", True),
        ((mps.Bingham(critical_strain_rate=0.1),), "bi-viscosity", False),
        ((mps.HerschelBulkley(yield_value=100.0, consistency=100.0),), "yield-stress", True),
        ((mps.HerschelBulkley(yield_value=0.0),), "yield-stress", False),
        ((mps.Newtonian(density=2000.0), mps.Bingham()), "yield-stress", False),  # that of those that yield
    ],
)
def test_the_law_and_whether_it_rests_follow_from_the_materials(materials, law, rests):
    first, *others = materials
    problem = Problem(mps.Scene(**parts(material=first, inlets=tuple(hose(material=mix) for mix in others))))
    assert (problem.law, problem.rests, problem.scene.materials) == (law, rests, materials)


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
    assert not scene.expected.inlets and np.linalg.norm(scene.expected.velocity, axis=1).max() == pytest.approx(jet)
    assert scene.expected.fluid[:, 1].max() > 1.4  # as high as the mouth


@pytest.mark.parametrize("dimension", [2, 3])
def test_only_a_vessel_that_the_fluid_can_fill_may_be_full(dimension):
    """A closed box counts as full, also with a tenth of it empty; one that is open above, or half filled, does so only
    when an inlet has filled the rest. Moving walls may close an open one."""
    low, high, spacing = (0.0,) * dimension, (1.0,) * dimension, 0.1
    up = (0.0,) * (dimension - 1) + (1.0,)
    lid, above = mps.Plane(high, tuple(-c for c in up)), tuple(1.5 * c for c in high)
    box = mps.box_planes(low, high)

    def full(walls, height=1.0, to_come=0):
        fluid = mps.fill(mps.Box(low, (*high[:-1], height)), spacing)
        domain = (tuple(-0.5 for _ in low), above)
        return Problem(mps.Scene(**parts(fluid=fluid, walls=walls, domain=domain, spacing=spacing))).may_be_full(
            to_come
        )

    half = int(0.5 * spacing**-dimension)
    assert full((*box, lid)) and not full(box) and not full((*box, lid), height=0.5)
    assert full((*box, lid), height=0.5, to_come=half) and not full((*box, lid), height=0.5, to_come=half // 2)
    assert full((*box, replace(lid, velocity=tuple(-0.1 * c for c in up))), height=0.5)


def test_rings_that_fill_a_pipe_between_two_ends_may_be_full():
    mantle = mps.Plane((0.5, 0.0), (-1.0, 0.0))
    ends = (mps.Plane((0.0, 0.0), (0.0, 1.0)), mps.Plane((0.0, 1.0), (0.0, -1.0)))
    fluid = mps.fill(mps.Box((0.0, 0.0), (0.5, 1.0)), 0.05)
    changes = {"fluid": fluid, "spacing": 0.05, "axisymmetric": True, "domain": ((-0.2, -0.2), (0.8, 1.2))}
    assert [Problem(mps.Scene(**parts(walls=w, **changes))).may_be_full() for w in (ends, (*ends, mantle))] == [
        False,
        True,
    ]


def test_a_box_holds_whole_layers_and_a_state_belongs_to_its_number_of_particles():
    """Of sides of 7.5 spacings 7 are filled, 81 % of the volume, which is told; a state is of as many particles."""
    with pytest.warns(UserWarning, match="spacing = 0.02 m: particles fill 81% of the body"):
        assert len(mps.fill(mps.Box((0.0,) * 3, (0.15,) * 3), 0.02)) == 7**3
    coarse, fine = (mps.Simulation(mps.slump_cone(model="axisymmetric", spacing=l0)) for l0 in (0.05, 0.03))
    with pytest.raises(mps.SceneError, match=r"state: has \d+ particles; must be of this scene, at most \d+"):
        coarse.load(fine.state())
