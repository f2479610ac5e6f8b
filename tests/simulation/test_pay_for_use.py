"""A scene compiles and stores only what it uses: anything else that is called while it compiles raises here."""

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.engine.boundaries import friction, ghosts, surfaces, walls
from taichi_mps.engine.simulation import simulation
from taichi_mps.engine.terms import momentum, stress
from tests.support.scenes import ran

FLOOR = mps.Plane((0.0, 0.0), (0.0, 1.0))
WEST = mps.Plane((0.0, 0.0), (1.0, 0.0))


def simulate(material, walls=(FLOOR,), **keywords):
    x = mps.fill(mps.Box((0.0, 0.0), (0.1, 0.1)), 0.02)
    return ran(mps.Scene("block", material, 0.02, x, ((-0.5, -0.5), (0.5, 0.5)), walls=walls, **keywords), until=0.05)


@pytest.fixture
def forbid(monkeypatch):
    def forbidden(*_):
        raise AssertionError("not paid for")

    return lambda owner, name: monkeypatch.setattr(owner, name, forbidden)


NEWTONIAN = mps.Newtonian(density=2300.0, viscosity=50.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("pi_c", "others"),
    [(None, "bi_viscosity"), pytest.param(0.01, "return_mapping", marks=pytest.mark.slow)],
    ids=["bingham", "bi-viscosity"],
)
def test_a_law_compiles_its_own_functions_only_and_without_output_nothing_is_read_back(pi_c, others, forbid):
    """Without a callback that asks for positions or pressure no snapshot is made and no measure taken."""
    forbid(stress, others)
    forbid(simulation.Simulation, "snapshot")
    calls = []
    sim = simulate(mps.Bingham(critical_strain_rate=pi_c), measure=lambda s: calls.append(s) or {})
    assert ("stress" in sim.particles.carried) == (pi_c is None)
    assert sim.steps > 1 and not calls and np.isfinite(sim.report.max_speed)


@pytest.mark.long
def test_walls_at_rest_that_do_not_meet_cost_neither_motion_nor_corners_nor_a_yield_stress(forbid):
    for owner, name in (
        (momentum.MomentumOperator, "subtract_wall_motion"),
        (ghosts.GhostSums, "remaining_fraction"),
        (ghosts.GhostSums, "remaining_fractions_at_angle"),
        (walls.Walls, "stands_between"),
        (surfaces.Surface, "weight"),
        (friction.FrictionalSlip, "__init__"),
        (stress, "return_mapping"),
        (stress, "bi_viscosity"),
    ):
        forbid(owner, name)
    sim = simulate(NEWTONIAN)
    assert not hasattr(sim.walls.ghosts, "corner") and not hasattr(sim.scheme.fluid.gradient, "hoop")
    assert not {"ring", "slip_0", "stress"} & set(sim.particles.carried)
    with pytest.raises(Exception, match="not paid for"):
        simulate(NEWTONIAN, walls=(FLOOR, WEST))


def test_without_walls_there_is_no_wall_code(forbid):
    forbid(ghosts.GhostSums, "lookup")
    forbid(walls.Walls, "force_term")
    assert not hasattr(simulate(NEWTONIAN, walls=()).walls, "c")
