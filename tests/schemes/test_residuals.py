"""Residuals of the outer iterations against known fields, and the effect of a tolerance on them."""

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.engine.problem.problem import Problem
from taichi_mps.report.sentences import doubts

STEPS, TOLERANCE = 12, 2e-3


@pytest.fixture(scope="module")
def cone():
    """Rings of 300 Pa and their start."""
    sim = mps.Simulation(mps.slump_cone(model="axisymmetric", spacing=0.02, yield_value=300.0))
    return sim, sim.state()


def reports(cone, **numbers):
    """Of the first steps, with other outer iterations."""
    sim, start = cone
    numerics = mps.Implicit(**numbers)
    sim.restart(Problem(sim.scene, numerics), start)
    sim.scheme.numerics = numerics
    return [sim.step() for _ in range(STEPS)]


def worst(report):
    return max(report.strain_rate_residual, report.divergence_residual)


def test_of_known_fields(cone):
    """The residuals are exact where half of a shear rate of 0.4 1/s is plastic and a wanted divergence of 0.3 1/s is
    missing."""
    sim, scheme = cone[0], cone[0].scheme
    reports(cone)
    shear = np.zeros((3, 3))
    shear[0, 1] = 0.4
    scheme.strain_rate.half_step_change.fill(0.0)
    for field, tensor in (scheme.solved_rate.G, shear), (scheme.fluid.particles.plastic_rate, 0.25 * (shear + shear.T)):
        field.from_numpy(np.tile(tensor, (sim.particles.capacity, 1, 1)).astype("f4"))
    scheme.constraint.divergence.fill(0.3)
    rate = (9.81 / sim.problem.height) ** 0.5
    with sim.execution.active():
        scheme.residuals.measure()
    assert scheme.residuals.read() == pytest.approx([0.2 / rate, 0.3 / rate], rel=1e-5)


def test_fall_with_the_iterations(cone):
    """Doubled iterations at least halve the residuals; beyond 12 the tolerance of the solves counts as well."""
    found = [np.mean([worst(r) for r in reports(cone, passes=n)[1:]]) for n in (3, 6, 12)]
    assert (np.divide(found[1:], found[:-1]) < 0.5).all(), found


@pytest.mark.long
def test_a_tolerance_takes_as_many_iterations_as_it_needs(cone):
    """All steps meet a tolerance, a smaller one in more iterations; half as many leave more in the step after the
    first."""
    loose, found = (reports(cone, passes=50, outer_tolerance=times * TOLERANCE) for times in (2.0, 1.0))
    assert max(map(worst, found)) <= TOLERANCE and cone[0].scheme.unmet == 0
    few, taken = (sum(r.outer_iterations for r in each) for each in (loose, found))
    assert few < taken < 30 * STEPS
    assert worst(reports(cone, passes=found[1].outer_iterations // 2)[1]) > TOLERANCE


@pytest.mark.slow
def test_a_tolerance_that_is_not_met_is_told(cone):
    """A tolerance that is not met is reported in the state of the run and in a sentence."""
    sim = cone[0]
    reports(cone, passes=2, outer_tolerance=1e-6)
    assert sim.scheme.unmet == sim.state()["unmet"] == sim.summary()["unmet_steps"] == STEPS
    assert "In 100.0% of the steps" in doubts(sim.summary() | {"stopped_by": "rest"})[0]
    reports(cone)
    assert "unmet_steps" not in sim.summary()
