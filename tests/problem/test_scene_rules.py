"""Rules of a scene: one that breaks a rule is refused in one line that names it, and valid ones are accepted."""

from dataclasses import replace

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.engine.problem.problem import Problem
from tests.support.scenes import hose, parts

FLOOR = mps.Plane((0.0, 0.0), (0.0, 1.0))
ROUGH = replace(FLOOR, friction=mps.Friction(yield_value=10.0))
MIRROR = mps.Plane((0.0, 0.0), (1.0, 0.0), mirror=True)
SIDE = mps.Plane((0.0,) * 3, (1.0, 0.0, 0.0), mirror=True)
TURNED = mps.Plane((-1.0, 0.0, 0.0), (0.6, 0.8, 0.0), mirror=True)
LIGHT = mps.Bingham(density=1.0)  # of a flow in numbers without dimension
KNEE = mps.Bingham(critical_strain_rate=0.1)
WHERE = {"walls": (MIRROR,), "fluid": np.array([[0.05, 0.05]])}
TWO = np.vstack([parts()["fluid"] + shift for shift in (0.0, 0.03)])  # overlapping, no particle on another


def poured(walls=(), **changes):
    return {"walls": walls, "inlets": (hose(**changes),)}


def named(*names):
    return {"walls": tuple(replace(FLOOR, name=name) for name in names)}


REFUSED = [
    ({"name": 3}, "name = 3: must be text"),
    ({"name": None}, "name = None: must be text"),
    ({"walls": FLOOR}, "walls = .*: must be a tuple, each Plane or Cylinder or Solid"),
    ({"inlets": None}, "inlets = None: must be a tuple, each Inlet"),
    ({"periodic": True}, "periodic = True: must be a tuple, each True or False"),
    ({"periodic": "ab"}, "periodic = ab: must be a tuple, each True or False"),
    ({"cavity": 1}, "cavity = 1: must be a Cavity"),
    ({"grains": mps.Grains(40.0, centres=[(0.1, 0.1)])}, "grains: the scene has diameters up to 40 m, longer than its"),
    ({"axisymmetric": True, "walls": (MIRROR,)}, "axisymmetric = True: periodic along r, or with a mirror plane"),
    ({"cavity": mps.Cavity((0.0,) * 3, (1.0,) * 3, (), 0.1)}, "cavity: must have 2 coordinates, as the fluid has"),
    (
        {"cavity": mps.Cavity((0.0, 0.0), (1.0, 1.0), (), 0.1), "axisymmetric": True},
        "cavity: must have 2 coordinates, as the fluid has, and no rings",
    ),
    ({"measure": "a"}, "measure = a: must be a function"),
    ({"fluid": [[np.nan, 0.5]]}, "fluid = .* m: must be finite numbers of the shape"),
    ({"spacing": "thin"}, "spacing = thin: must be a number"),
    ({"until": "later"}, "until = later: must be a number"),
    (poured() | {"spacing": 1e-233}, "spacing = 1e-233 m: must be at least 1e-12 m"),  # an overflow
    (poured() | {"spacing": 1e-5}, "inlet: radius = 0.3 m: must be at most 1000 times spacing = 1e-05 m"),  # of memory
    ({"axisymmetric": "a"}, "axisymmetric = a: must be True or False"),
    ({"walls": (3,)}, r"walls = \(3,\): must be a tuple, each Plane or Cylinder or"),
    ({"material": None}, "material = None: must be Bingham, HerschelBulkley"),
    ({"fluid": np.zeros((0, 2))}, "fluid: the geometry is empty; it must hold at least one particle"),
    ({"fluid": [[1.0]]}, r"fluid = .* m: must be finite numbers of the shape \(n, 2\) or \(n, 3\)"),
    ({"spacing": -1.0}, "spacing = -1.0 m: must be greater than 0 m"),
    ({"until": 1e-300}, "until = 1e-300 s: must be at least 1e-09 s"),
    ({"until": np.nan}, "until = nan s: must be a finite number"),
    (
        {"domain": ((1.0, 1.0), (0.0, 0.0))},
        "must have 2 coordinates, the second corner above the first along each axis",
    ),
    ({"gravity": (0.0, 0.0, -9.81)}, r"gravity = .* m/s2: must have 2 numbers, as the fluid has"),
    ({"velocity": np.zeros((1, 2))}, r"velocity of shape \(1, 2\): must be of the shape \(25, 2\)"),
    ({"wall_particles": np.zeros((1, 3))}, r"wall_particles of shape \(1, 3\): must be of the shape \(1, 2\)"),
    ({"periodic": (True,)}, "must have one word for each of 2 axes"),
    ({"walls": (mps.Plane((0.0,) * 3, (0.0, 0.0, 1.0)),)}, r"walls: point = .* m: must have 2 coordinates"),
    (named("floor", "floor"), "name = 'floor': of 2 walls; must be of one"),
    (named("wall_1", ""), "name = 'wall_1': of 2 walls; must be of one"),  # as that of the second is without one
    (poured() | {"axisymmetric": True}, "the scene is axisymmetric; must be a scene"),
    (poured(centre=(0.2, 0.2, 1.5), direction=(0.0, 0.0, -1.0)), "must have as many coordinates as the fluid"),
    (poured(volume=0.01), "volume = 0.01 m3: must be at least half a layer, 0.03 m3"),
    (poured(radius=0.14), "radius = 0.14 m: must be at least 1.5 times spacing = 0.1 m"),
    (poured((MIRROR,), centre=(0.1, 1.5)), "cuts the hose; its axis must lie in the plane"),
    (
        poured((MIRROR,), centre=(0.9, 1.5), path=((0.0, 0.0, 0.0), (1.0, 0.1, 0.0))),
        "path: crosses walls: mirror plane",
    ),
    (poured((MIRROR,), centre=(-0.9, 1.5)), "lies behind a mirror plane; must be in front of it"),
    (poured((FLOOR,), centre=(0.2, -0.2)), "the mouth reaches into a wall"),
    (poured(start=1.0) | {"fluid": None}, "fluid: the geometry is empty; it must hold at least one particle"),
    (
        {"inlets": tuple(hose(material=mps.Bingham(yield_value=float(k))) for k in range(257))},
        "inlets: bring 258 mixes; must be at most 256",
    ),
    (poured(material=KNEE), "critical_strain_rate: must be given for all mixes or for none"),
    (poured((ROUGH,), material=mps.Newtonian(density=1500.0)), "where a wall has friction"),
    ({"fluid": np.array([[3.0, 0.0]])}, "a particle lies outside; the domain must"),
    ({"domain": ((0.05, -1.0), (2.0, 2.0))}, "on its edge; the domain must reach beyond"),
    ({"fluid": TWO}, r"about 15 of 50 .* from \(0.025, 0.025\) to \(0.625, 0.625\) m: bodies over"),
    (parts(3) | {"axisymmetric": True}, "the fluid has 3 coordinates; must have 2"),
    ({"axisymmetric": True, "fluid": np.array([[-0.5, 0.5]])}, "r = -0.5 m; r must be above 0"),
    ({"axisymmetric": True, "gravity": (1.0, 0.0)}, "must be along z, axisymmetric"),
    ({"axisymmetric": True, "periodic": (True, False)}, "only z may be periodic"),
    ({"walls": (MIRROR,), "fluid": np.zeros((1, 2))}, "a fluid particle lies on it or behind it; all must be in front"),
    ({"walls": (replace(FLOOR, mirror=True),)}, r"gravity = \(0.0, -9.81\) m/s2 must lie in the plane"),
    (parts(3, walls=(SIDE, TURNED)), r"must be at right angles to that with normal = \(1.0, 0.0, 0.0\)"),
]


@pytest.mark.parametrize(("changes", "message"), REFUSED)
def test_a_scene_that_cannot_be_is_not_made(changes, message):
    with pytest.raises(mps.SceneError, match=message):
        mps.Scene(**parts() | changes)


SOUND = [
    {},
    WHERE,
    poured(),
    poured((MIRROR,), centre=(0.9, 1.5)),
    poured(centre=(0.2, 0.3), start=1.0),  # in the fluid, but not yet open
    {"axisymmetric": True},
    {"material": LIGHT, "gravity": (0.0, 0.0)},
    {"material": LIGHT, "gravity": (0.0, -1.0)},
]


@pytest.mark.filterwarnings("error::UserWarning")
def test_a_fluid_filled_with_another_spacing_than_that_of_the_scene_is_told():
    """A coarser lattice is a cloud of drops; those of a finer one have no room."""
    with pytest.warns(UserWarning, match="fluid: its 25 particles lie apart, as drops; .* with spacing = 0.05 m"):
        mps.Scene(**parts(spacing=0.05))
    assert mps.Scene(**parts())


@pytest.mark.parametrize("changes", SOUND)
def test_a_sound_scene_is_made(changes):
    assert Problem(mps.Scene(**parts(**changes)))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rate": 0.0}, "^rate = 0.0 m3/s: must be greater than 0"),
        ({"rate": np.nan}, "^rate = nan m3/s: must be a finite number"),
        ({"start": -1.0}, "^start = -1.0 s: must be greater than or equal to 0 s"),
        (
            {"material": "water"},
            "^material = water: must be Bingham, HerschelBulkley, .*Newtonian, FlowCurve or another Law",
        ),
        ({"direction": (0.0, 0.0)}, "inlet: direction = .*: must have 2 numbers, as centre has, not all zero"),
        ({"direction": (0.0, 0.0, 1.0)}, "direction = .*: must have 2 numbers"),
        ({"path": ((0.0, 1.0), (1.0, 2.0))}, "inlet: path of shape .2, 2.: must be two rows or more"),
    ],
)
def test_an_inlet_that_cannot_be_is_not_made(change, message):
    with pytest.raises(mps.SceneError, match=message):
        hose(**change)


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
    """A particle on the lower end of a periodic axis is accepted; particles on both ends are duplicates."""
    row = np.column_stack([np.arange(0.0, 2.0, 0.1), np.full(20, 0.5)])
    sides = {"domain": ((0.0, -1.0), (2.0, 2.0)), "periodic": (True, False)}
    assert Problem(mps.Scene(**parts(fluid=row, **sides)))
    with pytest.raises(mps.SceneError, match="1 of 21 lie on others"):
        Problem(mps.Scene(**parts(fluid=np.vstack([row, (2.0, 0.5)]), **sides)))


def test_what_was_given_as_lists_and_integers_is_held_as_tuples_and_arrays():
    given = parts(fluid=[[0, 0]], spacing=1, walls=[FLOOR], gravity=[0, -1], periodic=[True, False], until=2)
    scene = mps.Scene(**given | {"domain": ((-9, -9), (9, 9)), "fluid": [[0, 1]]})
    assert scene.walls == (FLOOR,) and scene.gravity == (0.0, -1.0) and scene.periodic == (True, False)
    assert scene.fluid.dtype == float and isinstance(scene.spacing, float) and isinstance(scene.until, float)
