"""A yield stress that grows with the pressure (Drucker and Prager): a frictional film, and slopes that stand."""

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.problem import catalogue

SLOPE, DEPTH = 10.0, 0.1  # [deg], [m]


def film(yield_value, friction_angle, until=1.0):
    mix = {"yield_value": yield_value, "friction_angle": friction_angle, "plastic_viscosity": 50.0}
    sim = mps.Simulation(catalogue.build("film", **mix, angle=SLOPE, spacing=0.01, until=until))
    sim.run()
    return sim.snapshot()


def exact(y, yield_value, friction_angle):
    """Weight along the slope less friction, both linear in the depth: the film of a Bingham fluid that weighs less."""
    slope, angle = np.radians(SLOPE), np.radians(friction_angle)
    weight = 2300.0 * 9.81 * (np.sin(slope) - np.cos(slope) * np.tan(angle))
    sheared = max(0.0, DEPTH - yield_value / weight)
    y = np.minimum(y, sheared)
    return weight * (sheared * y - 0.5 * y**2) / 50.0


@pytest.mark.parametrize(("yield_value", "bound"), [pytest.param(0.0, 0.01, marks=pytest.mark.long), (100.0, 0.05)])
def test_film_flows_as_one_that_weighs_less_by_its_friction(yield_value, bound):
    """5 degrees on a slope of 10, at 10 across; with a yield stress of its own it has a plug, too."""
    s = film(yield_value, 5.0)
    known = exact(s.x[:, 1], yield_value, 5.0)
    assert np.sqrt(np.mean((s.u[:, 0] - known) ** 2)) < bound * known.max()


def test_slope_stands_below_the_angle_of_friction():
    """Without any yield stress of its own 12 degrees hold a slope of 10."""
    assert film(0.0, 12.0, until=0.5).speed.max() < 1e-5


@pytest.mark.slow
def test_slope_flows_above_the_angle_of_friction():
    assert film(0.0, 8.0).speed.max() == pytest.approx(exact(np.array([DEPTH]), 0.0, 8.0)[0], rel=0.1)


def test_friction_alone_yields_and_rests():
    sand = mps.Bingham(yield_value=0.0, friction_angle=30.0)
    assert sand.yields and sand.rests and not sand.newtonian
    assert sand.friction_coefficient == pytest.approx(3.0**-0.5)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ({"critical_strain_rate": 0.1}, "friction_angle = 20 deg: needs a true yield stress"),
        ({"flow_index": 0.5}, "friction_angle = 20 deg: is of Bingham's law alone; must not be given with flow_index"),
        ({"friction_angle": 90.0}, "friction_angle = 90"),
    ],
)
def test_what_does_not_go_with_it_is_refused(words, said):
    with pytest.raises(mps.SceneError, match=said):
        mps.slump_cone(**{"friction_angle": 20.0, **words})
