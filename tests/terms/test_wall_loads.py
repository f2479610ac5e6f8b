"""Force and torque of the fluid on its walls: balances of weight and momentum, and exact flows."""

from dataclasses import replace

import numpy as np
import pytest

import taichi_mps as mps
from tests.support.scenes import ran

LOADS = mps.Implicit(wall_loads=True)
CONVERGED = mps.Implicit(wall_loads=True, passes=40, tolerance=1e-4)
FRICTION = mps.Friction(yield_value=20.0, viscous_constant=500.0)
MIX = mps.Bingham(yield_value=100.0, plastic_viscosity=50.0)
TURN, INNER, OUTER, ETA = 1.0, 0.05, 0.1, 50.0  # rad/s, m, m, Pa s


def block(d, material=MIX, **walls):
    """Eight particles along each side of 0.16 m, in a box twice as wide."""
    floor, *sides = mps.box_planes((0.0,) * d, (0.32,) * d, **walls)
    return mps.Scene(
        name="block",
        material=material,
        spacing=0.02,
        fluid=mps.lattice((0.0,) * d, (0.16,) * d, 0.02),
        walls=(replace(floor, name="floor"), *sides),
        domain=((-0.02,) * d, (0.34,) * d),
        until=0.5,
    )


def momentum(sim):
    """[N s]"""
    return sim.scene.material.density * sim.scene.volumes @ sim.snapshot().u


def gained(sim, of):
    """What a quantity of a simulation gains in a step, per second."""
    before, time = of(sim), sim.time
    sim.step()
    return (of(sim) - before) / (sim.time - time)


@pytest.mark.parametrize(
    ("d", "name"), [(2, "force_floor_z_N_per_m"), pytest.param(3, "force_floor_z_N", marks=pytest.mark.long)]
)
def test_walls_carry_the_weight_less_what_the_momentum_gains(d, name):
    """The force of a collapsing block on all walls, with friction, is weight - d(momentum)/dt in each step whose
    iterations converge; before a step, and after a load, it is unknown."""
    sim = mps.Simulation(block(d, friction=FRICTION), CONVERGED)
    assert np.isnan(sim.measures()[name])
    weight = sim.scene.material.density * sim.scene.volumes.sum() * sim.scene.gravity_vector
    for _ in range(4):
        force = weight - gained(sim, momentum)
        found = sum(load.force for load in sim.snapshot().loads.values())
        assert found == pytest.approx(force, abs=2e-4 * np.abs(weight).max())
    assert sim.measures()[name] < 0.0
    assert sim.scheme.pressure.full[None] == 0  # below a free surface ghosts carry no stress along the walls
    assert np.abs(sim.scheme.wall_stress.driving_force.to_numpy()).max() == 0.0
    sim.load(sim.state())
    assert np.isnan(sim.measures()[name])


@pytest.mark.long
def test_torque_of_circular_couette_flow():
    """The torque is 4 pi eta turn R1^2 R2^2/(R2^2 - R1^2) per metre, equal on the cup and on the turning solid."""
    ends = (-0.07, -0.07), (0.07, 0.07), 0.00125
    turning = {"angular_velocity": TURN, "pivot": (0.0, 0.0), "name": "bob"}
    bob = mps.Solid.of(lambda x: np.hypot(*x.T) - INNER, *ends, **turning)
    cup = mps.Cylinder((0.0, 0.0), OUTER, name="cup")
    scene = mps.Scene(
        name="vessel",
        material=mps.Newtonian(density=2300.0, viscosity=ETA),
        spacing=0.005,
        fluid=mps.rings(INNER, OUTER, 0.005),
        walls=(bob, cup),
        domain=((-0.12, -0.12), (0.12, 0.12)),
        gravity=(0.0, 0.0),
        wall_loads=True,
        until=0.6,
    )
    found = ran(scene).measures()
    exact = 4.0 * np.pi * ETA * TURN * INNER**2 * OUTER**2 / (OUTER**2 - INNER**2)
    assert found["torque_cup_N_m_per_m"] == pytest.approx(exact, rel=0.02)
    assert found["torque_bob_N_m_per_m"] == pytest.approx(-exact, rel=0.02)
    assert found["torque_bob_N_m_per_m"] == pytest.approx(-found["torque_cup_N_m_per_m"], rel=0.01)


@pytest.mark.long
def test_the_torques_on_all_walls_are_what_the_angular_momentum_loses():
    """A vane turns in a cup of Bingham paste, whose plug is stiff against hourglass modes."""
    sim = mps.Simulation(mps.catalogue.build("vane", spacing=0.004))

    def angular_momentum(sim):
        s = sim.snapshot()
        return 1900.0 * s.spacing**2 * float((s.x[:, 0] * s.u[:, 1] - s.x[:, 1] * s.u[:, 0]).sum())

    for _ in range(11):
        sim.step()
    lost = -gained(sim, angular_momentum)
    torques = {name: load.torque[-1] for name, load in sim.snapshot().loads.items()}
    assert sum(torques.values()) == pytest.approx(lost, abs=0.01 * torques["cup"])


@pytest.mark.long
def test_a_slow_paste_with_a_flow_curve_converges_in_a_full_vessel():
    """Most of the paste stands between a cylinder and its cup, which bear the same torque."""
    paste = {"yield_value": 7.48, "consistency": 1.655, "flow_index": 0.676, "density": 1900.0}
    sim = mps.Simulation(mps.catalogue.build("vane", body="cylinder", spacing=0.004, speed=0.06, **paste))
    for _ in range(25):
        report = sim.step()
    torque = {name: load.torque[-1] for name, load in sim.snapshot().loads.items()}
    assert report.strain_rate_residual < 0.05 and report.divergence_residual < 0.1
    assert torque["vane"] == pytest.approx(-torque["cup"], rel=0.03)


@pytest.mark.long
@pytest.mark.parametrize("model", ["quarter", "axisymmetric"])
def test_a_part_between_mirror_planes_has_the_loads_of_the_whole(model):
    """The floor of a part of the cone carries the weight less the gain of momentum, without a force along it or a
    torque."""
    sim = mps.Simulation(mps.catalogue.build("slump", spacing=0.025, model=model), CONVERGED)
    sim.step()
    copies = 4 if model == "quarter" else 1
    upward = copies * gained(sim, momentum)[-1]
    weight = copies * sim.scene.material.density * sim.scene.volumes.sum() * 9.81
    load = sim.scene.unfold(sim.snapshot()).loads["wall_0"]
    assert load.force[-1] == pytest.approx(-weight - upward, rel=2e-4)
    assert np.abs(load.force[:2]).max() < 1e-5 * weight
    assert np.abs(load.torque).max() < 1e-5 * weight * 0.1


@pytest.mark.long
def test_a_body_at_rest_presses_on_smooth_sides_as_a_liquid():
    """The pressure on the sides is rho g times the depth, in three layers, within the discretisation of ten
    particles."""
    walls = mps.box_planes((0.0, 0.0), (0.2, 0.2), slip=True)
    left = replace(walls[1], name="left")
    scene = mps.Scene(
        name="box",
        material=MIX,
        spacing=0.02,
        fluid=mps.lattice((0.0, 0.0), (0.2, 0.2), 0.02),
        walls=(walls[0], left, walls[2]),
        domain=((-0.02, -0.02), (0.22, 0.3)),
        until=0.3,
    )
    s, edges = ran(scene, LOADS).snapshot(), np.array([0.0, 0.06, 0.12, 0.2])
    pressure = mps.measure.by_height(s, -s.loads["left"].forces[:, 0], edges) / np.diff(edges)
    depth = 0.2 - 0.5 * (edges[1:] + edges[:-1])
    assert pressure == pytest.approx(MIX.density * 9.81 * depth, rel=0.04)
