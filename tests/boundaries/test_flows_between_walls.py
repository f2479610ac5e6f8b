"""Flows with a free surface between no-slip walls, beside their exact solutions."""

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid
from scipy.optimize import brentq

import taichi_mps as mps

DENSITY, VISCOSITY = 2300.0, 50.0


@pytest.mark.long
def test_the_flow_of_an_open_channel_between_rough_sides_nears_the_series():
    """A channel twice as wide as deep, inclined by 10 degrees, carries half of a square duct's flow (White, Viscous
    Fluid Flow, 1991, eq. 3-48). Too much flows, 13 % with 6 particles across, 5 % with 12 and 1.5 % with 24: the error
    falls faster than the spacing."""
    width, along, down = 0.12, 9.81 * np.sin(np.radians(10.0)), 9.81 * np.cos(np.radians(10.0))
    k = np.arange(1.0, 120.0, 2.0)
    form = 1.0 - 192.0 / np.pi**5 * (np.tanh(0.5 * np.pi * k) / k**5).sum()
    exact = 0.5 * DENSITY * along / VISCOSITY * 4.0 / 3.0 * (0.5 * width) ** 4 * form
    sides = mps.Plane((0.0, 0.0, 0.0), (0.0, 1.0, 0.0)), mps.Plane((0.0, width, 0.0), (0.0, -1.0, 0.0))
    errors = []
    for across in (6, 12):
        l0 = width / across
        high = (7.0 * l0, width, 0.5 * width)
        scene = mps.Scene(
            "channel",
            mps.Newtonian(density=DENSITY, viscosity=VISCOSITY),
            l0,
            mps.fill(mps.Box((0.0, 0.0, 0.0), high), l0),
            ((0.0, -0.5 * width, -0.5 * width), (high[0], 1.5 * width, width)),
            walls=(*sides, mps.Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))),
            gravity=(along, 0.0, -down),
            periodic=(True, False, False),
        )
        sim, flows = mps.Simulation(scene), []
        sim.run(until=0.3)  # four times the time W^2/(pi^2 nu) in which it starts
        sim.each_step(lambda sim, flows=flows: flows.append(sim.report.mean_speed))
        sim.run(until=0.5)
        errors.append(sim.snapshot().u[:, 0].mean() * width * high[2] / exact - 1.0)
        assert np.ptp(flows) < 0.05 * flows[-1]
    assert 0.0 < errors[1] < 0.06 and errors[1] < 0.5 * errors[0], errors


@pytest.mark.long
@pytest.mark.parametrize(
    ("yield_stress", "error"),
    [(0.0, 0.02), (100.0, 0.05)],
    ids=["Newtonian", "Bingham"],
)
def test_the_pressure_between_plates_that_close_is_that_of_lubrication(yield_stress, error):
    """Along the plane it falls as in a channel with the flow V x through the gap h: p = p_0 - 6 eta V x^2/h^3,
    of a Bingham fluid by Buckingham's law, which holds to the order of h/a. The force is 1.1 to 1.3 times that of
    plates in which p is zero at the edge, 8 eta V a^3/h^3: the fluid in front of them has to be pushed away too."""
    half, gap, closing, across = 0.2, 0.05, 0.02, 12
    l0 = gap / across
    box = [(-gap, gap), (half, gap), (half, 3.0 * gap), (-gap, 3.0 * gap)]
    top = mps.Solid.prism(box, 0.5 * l0, 2.1 * l0, velocity=(0.0, -closing), name="top")
    bottom = mps.Plane((0.0, 0.0), (0.0, 1.0), name="bottom")
    scene = mps.Scene(
        "plates",
        mps.Bingham(density=DENSITY, plastic_viscosity=VISCOSITY, yield_value=yield_stress),
        l0,
        mps.fill(mps.Box((0.0, 0.0), (half, gap)), l0),
        ((-0.1, -gap), (half + 0.3, 5.0 * gap)),
        walls=(mps.Plane((0.0, 0.0), (1.0, 0.0), mirror=True), bottom, top),
        gravity=(0.0, 0.0),
        wall_loads=True,
    )
    sim, slopes, forces = mps.Simulation(scene), [], []

    def compare(sim):
        h, s, x = gap - closing * sim.time, sim.snapshot(), np.linspace(0.0, half, 300)
        least = 2.0 * yield_stress / h

        def excess(gradient, flow):
            plug = least / gradient
            return gradient * h**3 / (12.0 * VISCOSITY) * (1.0 - 1.5 * plug + 0.5 * plug**3) - flow

        gradient = [least] + [brentq(excess, least + 1e-9, 1e7, args=(closing * at,)) for at in x[1:]]
        fall = cumulative_trapezoid(gradient, x, initial=0.0)
        inside = s.x[:, 0] < 0.6 * half
        slopes.append(-np.polyfit(np.interp(s.x[inside, 0], x, fall), s.p[inside], 1)[0])
        forces.append(sim.measures()["force_top_z_N_per_m"] / (2.0 * np.trapezoid(fall[-1] - fall, x)))

    sim.run(until=0.1)
    sim.every(0.02, compare)
    sim.run(until=0.8)
    assert np.mean(slopes) == pytest.approx(1.0, abs=error) and 1.1 < np.mean(forces) < 1.3
