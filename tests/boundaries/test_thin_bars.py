"""Bars thinner than a particle, as report/sentences.py tells of them: beside the drag of an array of cylinders."""

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.problem.problem import Problem

SIDE, ACROSS, ETA, DENSITY = 0.2, 8, 200.0, 2300.0
L0 = SIDE / ACROSS


def drag(c):
    """Force per length over viscosity and mean velocity on a cylinder of a square array with the volume fraction c:
    Sangani and Acrivos, Int. J. Multiphase Flow 8 (1982) 193."""
    return 4.0 * np.pi / (np.log(1.0 / np.sqrt(c)) - 0.738 + c - 0.887 * c**2 + 2.038 * c**3)


@pytest.mark.slow
@pytest.mark.parametrize("diameter", [0.64 * L0, pytest.param(0.4 * L0, marks=pytest.mark.long)])
def test_a_bar_resists_a_flow_across_it_by_up_to_a_quarter_too_little(diameter):
    """Newtonian, driven by a body force, from rest to the steady flow."""
    mps.init(threads=1)
    radius, fraction = 0.5 * diameter, np.pi * diameter**2 / (4.0 * SIDE**2)

    def distance(x):
        return np.linalg.norm(x - 0.5 * SIDE, axis=1) - radius

    x = mps.lattice((0.0, 0.0), (SIDE, SIDE), L0)
    x = x[distance(x) > 0.0]
    ends = 0.5 * SIDE - radius - 2.5 * L0, 0.5 * SIDE + radius + 2.5 * L0
    bar = mps.Solid.of(distance, ends[:1] * 2, ends[1:] * 2, 0.4 * diameter, name="bar")
    pull = 0.01 * drag(fraction) * ETA / SIDE**2  # for a mean velocity of 1 cm/s [N/m3]
    scene = mps.Scene(
        name="bars",
        material=mps.Newtonian(density=DENSITY, viscosity=ETA),
        spacing=L0,
        fluid=x,
        domain=((0.0, 0.0), (SIDE, SIDE)),
        walls=(bar,),
        periodic=(True, True),
        gravity=(pull / DENSITY, 0.0),
    )
    sim, flows = mps.Simulation(scene, mps.Implicit(max_time_step=0.01)), []
    sim.run(until=0.6)  # ten times density SIDE^2/(viscosity 7.3), in which a flow becomes steady
    sim.each_step(lambda s: flows.append(float(s.snapshot().u[:, 0].sum()) * L0**2 / SIDE**2))
    sim.run(until=1.4)  # particles meet the bar one after the other
    found = pull * len(x) * L0**2 / (ETA * np.mean(flows)) / drag(fraction)
    assert 0.75 < found < 1.0
    assert Problem(scene).thin_solids == pytest.approx({"bar": diameter}, rel=0.1)
