"""Nozzles that move, and what is printed from them until it fails under its own weight."""

from dataclasses import replace

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.problem import catalogue
from taichi_mps.problem.problem import Problem
from taichi_mps.simulation.pouring import Pouring

PATH = ((1.0, 0.0, 0.0), (3.0, 0.4, 0.0), (4.0, 0.4, 0.1))
HOSE = mps.Inlet((0.01, 0.4), (0.0, -1.0), 0.04, rate=0.04, volume=0.2, path=PATH)


def test_a_nozzle_goes_along_its_path_at_the_speed_of_each_part():
    assert HOSE.displacement(0.5) == pytest.approx((0.0, 0.0))
    assert HOSE.displacement(2.0) == pytest.approx((0.2, 0.0))
    assert HOSE.displacement(9.0) == pytest.approx((0.4, 0.1))
    still = replace(HOSE, path=None).velocity(0.02)
    for time, velocity in ((0.5, (0.0, 0.0)), (1.0, (0.2, 0.0)), (3.5, (0.0, 0.1)), (4.0, (0.0, 0.0))):
        assert HOSE.velocity(0.02, time) - still == pytest.approx(velocity)


def test_a_layer_enters_where_the_nozzle_is_and_goes_with_it():
    scene = mps.Scene("printed", mps.Bingham(), 0.02, None, ((-0.5, -0.1), (0.9, 0.9)), inlets=(HOSE,))
    pouring = Pouring(scene, HOSE)
    pouring.entered = int(2.0 / pouring.interval)  # due at 2 s
    late = 0.25 * pouring.interval
    layer = pouring.enter(pouring.next + late, np.zeros((0, 2)))
    speed = 0.04 / 0.08
    assert layer == pytest.approx(scene.inlet_layer(HOSE) + (0.2 + 0.2 * late, -speed * late))


def test_the_first_layer_is_where_the_path_begins_and_the_jet_as_fast_as_its_fastest_part():
    """The hose of 0.5 m/s is displaced by 0.3 m at 0 s, rests, and goes along with 0.3 m/s."""
    path = np.array(((0.0, 0.3, 0.0), (1.0, 0.3, 0.0), (2.0, 0.6, 0.0)))
    hose = replace(HOSE, path=path)
    scene = mps.Scene("printed", mps.Bingham(), 0.02, None, ((-0.5, -0.1), (0.9, 0.9)), inlets=(hose,))
    assert scene.initial == pytest.approx(scene.inlet_layer(hose) + (0.3, 0.0))
    assert Pouring(scene, hose).speed == pytest.approx(np.hypot(0.3, 0.5))


def test_a_nozzle_that_jumps_is_refused():
    hose = replace(HOSE, path=((0.0, 0.0, 0.0), (1e-6, 0.4, 0.0)))
    scene = mps.Scene("printed", mps.Bingham(), 0.02, None, ((-0.5, -0.1), (0.9, 0.9)), inlets=(hose,))
    with pytest.raises(mps.SceneError, match="inlet: path: moves with the jet at 4e.05 m/s; must be at most 100 m/s"):
        Problem(scene, mps.Implicit())


@pytest.mark.parametrize(
    ("path", "message"),
    [
        (((0.0, 0.0, 0.0),), "must be two rows or more of a time"),
        (((1.0, 0.0, 0.0), (1.0, 0.1, 0.0)), "of a time .s., which grows"),
        (((0.0, 0.0), (1.0, 0.1)), "and 2 displacements"),
        (((0.0, 0.0, 0.0), (1.0, np.inf, 0.0)), "path: a value is not a finite number"),
        ("along", "path = along: must be numbers"),
    ],
)
def test_a_path_that_is_none_is_refused(path, message):
    with pytest.raises(mps.SceneError, match=message):
        replace(HOSE, path=path)


def failure_height(**keywords):
    """Printed height [m] at which the foot has become 2 % wider."""
    scene = catalogue.build("printing", floor="smooth", **keywords)
    sim, rows = mps.Simulation(scene), []
    sim.each_step(lambda sim: rows.append({"time_s": sim.time} | sim.measures()))
    sim.run()
    scene.check(sim.snapshot(), sim.measures())
    return scene.over_time({key: np.array([row[key] for row in rows]) for key in rows[0]})["failure_height_m"]


@pytest.mark.parametrize("structuration", [0.0, 20.0])
def test_a_printed_wall_fails_at_twice_its_yield_stress(structuration):
    """Between rho g H = 2 tau_y, what the material of the foot bears in plane strain, and the mechanism of two planes
    at 45 degrees from the middle of the foot, a quarter of the width more; tau_y with what it has grown by then."""
    tau_y, width, rise, weight = 1000.0, 0.04, 0.005, 2300.0 * 9.81
    mix = {"yield_value": tau_y, "structuration": structuration, "destructuration": 0.0}
    found = failure_height(layers=16 if structuration else 11, **mix)
    exact = 2.0 * tau_y / (weight - 2.0 * structuration / rise)
    assert 0.97 * exact < found < 1.03 * (exact + 0.25 * width)


@pytest.mark.parametrize(("hose", "ends"), [("rising", {0.0}), ("moving", {0.0, 0.84})])
def test_a_hose_stays_near_the_concrete_in_a_high_form(hose, ends):
    """300 mm above the mean level of what has been poured, up to its place above the form, and along all of it."""
    fits = {"hose_diameter": 0.1, "bar_diameter": 0.01, "cover": 0.025, "bar_distance": 0.9}
    scene = catalogue.build("wall", spacing=0.03, length=1.0, height=0.9, fill_ratio=1.0, hose=hose, **fits)
    inlet = scene.inlets[0]
    time = inlet.volume / inlet.rate
    for share in (0.0, 0.3, 0.6):
        mouth = inlet.centre[2] + inlet.displacement(share * time)[2]
        assert mouth == pytest.approx(0.9 * share + 0.3, abs=0.04)
    assert inlet.displacement(time)[2] == pytest.approx(0.0)
    assert {round(float(x), 6) for x in inlet.displacements[:, 0]} == ends
    assert np.all(inlet.displacements[:, 1] == 0.0)
