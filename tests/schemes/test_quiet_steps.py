"""Longer steps of a quiet flow (I14): when they are taken, and that they do not change the flow."""

import math
from itertools import pairwise

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.engine.problem.problem import Problem
from taichi_mps.engine.problem.time_step import CREEP, LONG, QUIET, STILL, Speeds
from taichi_mps.engine.terms.constants import EARLY_MAX_REDUCTION, Constants
from taichi_mps.study.reuse import begin
from tests.support.scenes import parts

SPACING = 0.02


def cone(yield_value=100.0, **of_material):
    """The slump cone as rings."""
    return mps.slump_cone(yield_value=yield_value, model="axisymmetric", spacing=SPACING, **of_material)


def constants(yield_value=100.0, numerics=None, **of_material):
    """The constants of the cone, which need no Simulation."""
    return Constants(None, Problem(cone(yield_value, **of_material), numerics))


def longest(of, acceleration, speed=0.01, decay=0.0):
    return of.time_step.longest_at(Speeds(speed, acceleration, decay))


@pytest.mark.parametrize("of_material", [{}, {"critical_strain_rate": 0.1}])
def test_the_step_grows_as_the_root_of_what_it_no_longer_changes(of_material):
    """At half of the acceleration below which a flow counts as quiet the step is sqrt(2) times as long, at a quarter or
    less twice; slower flows gain nothing more."""
    found = constants(**of_material)
    usual = found.time_step.longest
    assert found.early_max_reduction[None] == pytest.approx(EARLY_MAX_REDUCTION), (
        "the early solves need not be as good as the last"
    )
    edge = QUIET * SPACING / usual**2
    for part, times in ((math.inf, 1.0), (1.0, 1.0), (0.5, 2.0**0.5), (0.25, 2.0), (0.01, LONG), (0.0, LONG)):
        assert longest(found, part * edge) == pytest.approx(times * usual)
    still = STILL * (9.81 * 0.3) ** 0.5
    assert longest(found, 0.0, 1.01 * still) > longest(found, 0.0, 0.99 * still) == usual


def test_the_step_that_scales_a_scene_does_not_depend_on_its_courant_number():
    scene = mps.Scene(**parts(velocity=np.tile((5.0, 0.0), (25, 1))))
    steps = [Constants(None, Problem(scene, mps.Implicit(courant_number=c))).time_step.natural for c in (0.1, 0.2, 0.4)]
    assert steps == pytest.approx([0.2 * 0.1 / 5.0] * 3)


def test_of_a_flow_that_dies_away_it_grows_with_the_time_of_that_up_to_the_same_root():
    found, decay = constants(), 30.0
    assert longest(found, 0.0, decay=decay) == pytest.approx(CREEP * decay)
    assert longest(found, QUIET * SPACING, decay=decay) == pytest.approx(1.0), "velocity times dt changes by QUIET l0"
    assert longest(found, 0.0, decay=0.1) == pytest.approx(LONG * found.time_step.longest), "as of any quiet flow"
    assert longest(found, 0.0, speed=1e-6, decay=decay) == found.time_step.longest, "still"


@pytest.mark.parametrize(
    ("of_material", "numerics", "step", "early"),
    [
        ({"yield_value": 0.0}, None, None, 0.0),
        ({}, mps.Implicit(max_time_step=0.004), 0.004, EARLY_MAX_REDUCTION),
        ({"plastic_viscosity": 1500.0}, None, 0.5 * 1500.0 / 2300.0 / (9.81 * 0.3), 0.0),
    ],
    ids=["newtonian", "given", "viscous"],
)
def test_no_longer_steps_without_yield_value_in_a_viscous_mix_or_where_one_is_given(of_material, numerics, step, early):
    """Steps stay short without a yield stress, where a step is given, and at 1500 Pa s, whose step, 0.5 nu/(g H), does
    not resolve a fall; such a mix and water need early solves as accurate as the last one, whatever step is given."""
    found = constants(numerics=numerics, **of_material)
    assert longest(found, 0.0) == longest(found, math.inf) == found.time_step.longest
    assert step is None or longest(found, 0.0) == pytest.approx(step)
    assert found.early_max_reduction[None] == pytest.approx(early)


def test_the_penalties_grow_with_the_step_that_is_taken():
    """mu_r = max(6 eta, 64 tau_y dt) and K >= 8 mu_r: at 1000 Pa they double with the step and return with it; at 100
    Pa the plastic viscosity counts in both."""
    for tau_y, eta in ((1000.0, 50.0), (100.0, 50.0)):
        found = constants(tau_y)
        usual = found.time_step.longest
        for dt in (usual, 2.0 * usual, 0.3 * usual):
            found.set_time_step(dt)
            mu_r = max(6.0 * eta, 64.0 * tau_y * max(dt, usual))
            assert found.mu_r[0] == pytest.approx(mu_r)
            assert found.bulk[None] == pytest.approx(max(75.0 * 2300.0 * 9.81 * 0.3 * usual, 8.0 * mu_r))


@pytest.mark.long
def test_a_cone_that_creeps_to_rest_does_not_know_how_long_its_steps_are():
    """At 100 Pa and 2 s slump agrees within a tenth of a spacing and spread within a fifth, with two thirds of the
    steps, none longer than the rule. A given step does not grow; later on the cone creeps beyond the rest (I8)."""
    usual, ends = constants().time_step.longest, []
    for sim in (begin(cone()), mps.Simulation(cone(), mps.Implicit(max_time_step=usual))):
        reports = []
        sim.each_step(lambda sim, reports=reports: reports.append(sim.report))
        sim.run(until=2.0)
        for before, report in pairwise(reports):
            assert report.dt <= usual or before.acceleration * report.dt**2 <= QUIET * SPACING * (1 + 1e-6)
        ends.append((sim.steps, sim.measures()))
    (few, longer), (many, usual) = ends
    assert few < 0.67 * many
    for name, bound in (("slump_m", 0.1), ("spread_m", 0.2)):  # a spread is read where one particle is thick
        assert longer[name] == pytest.approx(usual[name], abs=bound * SPACING)
