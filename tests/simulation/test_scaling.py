"""Results depend only on the Bingham number, rho^2 g H^3/eta^2 and spacing/H. With lengths times 1/4 and 4 all scales
are powers of two, exact in binary, so a difference shows a constant with a unit."""

import numpy as np
import pytest

import taichi_mps as mps
from tests.support.inside import in_order

POWERS = {"x": 1.0, "u": 0.5, "p": 1.0, "stress": 1.0, "shear_rate": -0.5}  # of the length, in each field's scale


def cone(length, yield_value, plastic_viscosity, spacing=0.025, **settings):
    """A slump cone with all lengths times ``length``: times go as its root, stresses as it, viscosities as its power
    3/2. Parameters are those of the cone of 0.3 m."""
    return mps.catalogue.build(
        "slump",
        yield_value=length * yield_value,
        plastic_viscosity=length**1.5 * plastic_viscosity,
        base_diameter=0.2 * length,
        top_diameter=0.1 * length,
        height=0.3 * length,
        spacing=spacing * length,
        until=20.0 * length**0.5,
        **settings,
    )


@pytest.mark.parametrize(
    ("model", "yield_value", "plastic_viscosity", "length"),
    [
        pytest.param("axisymmetric", 300.0, 50.0, 0.25, marks=pytest.mark.long),
        pytest.param("axisymmetric", 120.0, 100.0, 4.0, marks=pytest.mark.long),
        pytest.param("quarter", 300.0, 50.0, 4.0, marks=pytest.mark.long),
    ],
)
def test_a_cone_times_a_power_of_two_is_the_same_bit_by_bit_to_its_end(model, yield_value, plastic_viscosity, length):
    mps.init(precision="f32", threads=1)
    one, other = (mps.Simulation(cone(scale, yield_value, plastic_viscosity, model=model)) for scale in (1.0, length))
    assert one.run() == other.run()
    assert one.steps == other.steps and other.time == length**0.5 * one.time
    for name, power in POWERS.items():
        here, there = (in_order(sim, sim.particles.read()[name]) for sim in (one, other))
        np.testing.assert_array_equal(there, length**power * here, err_msg=name)
