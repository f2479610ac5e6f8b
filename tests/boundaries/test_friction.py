"""Friction of walls: the stress that it holds, the slip velocity of the fluid, and its part of the system matrix."""

from dataclasses import replace

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.engine.runtime.backend import ti
from tests.support.rigs import MASS_RATE, System, cloud
from tests.support.scenes import ran

DENSITY, G, DEPTH = 2300.0, 9.81, 0.1  # kg/m3, m/s2, m
ANGLE = np.radians(10.0)
WEIGHT = DENSITY * G * float(np.sin(ANGLE)) * DEPTH  # traction [Pa] on the floor of a film
ROUGHNESS = 2000.0  # viscous constant [Pa s/m]


def film(law, material):
    """A film on 10 degrees, 10 particles deep, periodic along the slope."""
    l0 = DEPTH / 10
    return mps.Scene(
        name="film",
        material=material,
        spacing=l0,
        fluid=mps.lattice((0.0, 0.0), (DEPTH - 0.5 * l0,) * 2, l0),
        walls=mps.box_planes((0.0, 0.0), (DEPTH, DEPTH), friction=law)[:1],
        domain=((0.0, -l0), (DEPTH, 2.0 * DEPTH)),
        gravity=(G * float(np.sin(ANGLE)), -G * float(np.cos(ANGLE))),
        periodic=(True, False),
    )


STIFF = mps.Bingham(density=DENSITY, plastic_viscosity=50.0, yield_value=2.0 * WEIGHT)


def carried_by(floor, area):
    """Traction [Pa] of a floor, from the slip that its particles carry."""
    yielded = floor.traction.to_numpy() if floor.yields else 0.0
    return ((yielded + floor.constant * floor.slip.to_numpy()) * floor.area.to_numpy()[:, None]).sum(0)[0] / area


def test_newtonian_film_slips_by_the_wall_stress_over_the_viscous_constant():
    """With Navier's slip of half of the surface speed a Newtonian film has its exact profile within 2 %, as without
    slip, and the floor carries its weight."""
    eta = 100.0
    sim = ran(film(mps.Friction(viscous_constant=ROUGHNESS), mps.Newtonian(DENSITY, eta)), until=1.0)  # 9 rho H/k
    s = sim.snapshot()
    y = s.x[:, 1] / DEPTH
    exact = WEIGHT / ROUGHNESS + WEIGHT * DEPTH / eta * (y - 0.5 * y**2)
    assert np.linalg.norm(s.u[:, 0] - exact) < 0.02 * np.linalg.norm(exact)
    assert carried_by(sim.walls.surfaces[0].friction, DEPTH) == pytest.approx(WEIGHT, rel=0.02)


@pytest.mark.long
def test_a_plug_slips_on_a_yielding_floor_by_the_excess_over_its_viscous_constant():
    """A plug follows rho H du/dt = WEIGHT - yield stress - k u from rest: within 5 % on the way, where the step of a
    tenth of rho H/k costs 1 % and the iterations lag, and within 1 % in the end."""
    yield_value = 0.5 * WEIGHT
    sim = mps.Simulation(film(mps.Friction(yield_value=yield_value, viscous_constant=ROUGHNESS), STIFF))
    for time, error in ((0.25, 0.05), (2.5, 0.01)):
        sim.run(until=time)
        exact = (WEIGHT - yield_value) / ROUGHNESS * (1.0 - np.exp(-ROUGHNESS * time / (DENSITY * DEPTH)))
        assert np.abs(sim.snapshot().u[:, 0] / exact - 1.0).max() < error
    assert carried_by(sim.walls.surfaces[0].friction, DEPTH) == pytest.approx(WEIGHT, rel=0.01)


@pytest.mark.long
def test_a_plug_stands_on_a_floor_that_holds_more_than_its_weight():
    """A plug stands from rest at once, and after it has slid to a stop, also where the step is cut short by an
    output. It sways by what six iterations leave, a few millionths of its speed; of 24 that is less than one.

    Its particles part along the floor: the stop leaves a shear stress that alternates from one to the next in the first
    rows, which neither the gradient of an inner particle nor its force sees. At the floor it pulls at them, and only
    the hourglass resistance h holds, a viscosity below MIN_BOND_RATE: they creep, with an e-fold of 0.5 s (rows) to 2 s
    (columns) that grows with h. A solve balances forces to its tolerance of the weight, and h u/l0^2 is the force
    density of h on a motion u that alternates: u is at most tolerance rho g l0^2/h."""
    scene = film(mps.Friction(yield_value=1.05 * WEIGHT), STIFF)
    sim = ran(scene, until=0.5)
    s = sim.snapshot()
    assert s.speed.max() < 1e-6
    assert np.linalg.norm(s.x - sim.scene.fluid, axis=1).max() < 1e-3 * s.spacing
    traction = sim.walls.surfaces[0].friction.traction.to_numpy()
    assert np.linalg.norm(traction, axis=1).max() <= 1.05 * WEIGHT * (1.0 + 1e-12)
    slides = replace(scene, velocity=np.tile((0.1, 0.0), (len(scene.fluid), 1)))
    for passes, left in ((6, 1e-6), (24, 1e-7)):
        sim = mps.Simulation(slides, mps.Implicit(passes=passes))
        for time in (3.0, 3.055, 3.2):
            sim.run(until=time)
            u = sim.snapshot().u
            assert np.linalg.norm(u.mean(0)) < left
            h = sim.scheme.resistance.viscosity.to_numpy().min()
            assert np.abs(u - u.mean(0)).max() < sim.numerics.tolerance * DENSITY * G * s.spacing**2 / h


@ti.data_oriented
class OnFloor(System):
    """A cloud on a floor; what it slips by within a solve is that of a step of rho/dt = ``inertia``."""

    def __init__(self, inertia=0.0, **floor):
        plane = mps.Plane((0.0, -0.33), (0.0, 1.0), **floor)
        x = cloud((5, 6))
        super().__init__(x[plane.distance(x) > 0.01], planes=(plane,))
        if plane.friction:
            self.walls.set_friction_penalty(inertia)
            self.set_initial_slip()

    @ti.kernel
    def set_initial_slip(self):
        for i in range(self.particles.count[None]):
            B = self.gradient.B[i]
            self.walls.set_initial_slip(i, self.particles.x[i], self.u[i], B, self.volume, 300.0, 1.0)


def test_the_matrix_at_a_floor_with_friction_is_symmetric_positive_definite():
    """The resistance to sliding along the floor, friction and layer in series, is more than inertia and less than no
    slip."""
    rubs, holds = OnFloor(1000.0, friction=mps.Friction(yield_value=10.0, viscous_constant=500.0)), OnFloor()
    A, _blocks = rubs.dense()
    assert np.abs(A - A.T).max() < 1e-12 * np.abs(A).max()
    assert np.linalg.eigvalsh(A).min() > 0.0
    along = np.tile((1.0, 0.0), (len(rubs.x), 1))
    power = [(along * rig.multiply(along)).sum() for rig in (rubs, holds)]
    assert MASS_RATE * len(along) * (1.0 + 1e-9) < power[0] < power[1]
