"""Invariance of results: under rotation of the body, in a moving frame, and of a body of another size.

Results depend only on the Bingham number, rho^2 g H^3/eta^2 and spacing/H. With lengths times 1/4 and 4 all scales are
powers of two, exact in binary, so a difference shows a constant with a unit.
"""

import numpy as np
import pytest

import taichi_mps as mps
from tests.support.inside import in_order
from tests.support.scenes import ran

STIFF = {"density": 2300.0, "yield_value": 1000.0}
MIX = mps.Bingham(plastic_viscosity=50.0, **STIFF)
LAWS = {
    "Bingham": MIX,
    "bi-viscosity": mps.Bingham(plastic_viscosity=50.0, critical_strain_rate=0.1, **STIFF),
    "flow curve": mps.HerschelBulkley(consistency=50.0, flow_index=0.5, **STIFF),
    "Newtonian": mps.Newtonian(density=2300.0, viscosity=50.0),
}


def turned(across, dimension, turn, turns, material, spacing=0.01):
    """Relative change of a disc or ball of radius ``across`` spacings that turns freely at ``turn`` rad/s: of radius,
    energy and angular momentum, and its largest volume error."""
    ticks = np.arange(-across, across) + 0.5
    x = np.stack(np.meshgrid(*[ticks] * dimension, indexing="ij"), -1).reshape(-1, dimension) * spacing
    x = x[np.linalg.norm(x, axis=1) < across * spacing]
    u = np.zeros_like(x)
    u[:, 0], u[:, 1] = -turn * x[:, 1], turn * x[:, 0]
    far = 2.0 * across * spacing
    scene = mps.Scene(
        name="spin",
        material=material,
        spacing=spacing,
        fluid=x,
        velocity=u,
        gravity=(0.0,) * dimension,
        domain=((-far,) * dimension, (far,) * dimension),
        until=2.0 * np.pi * turns / turn,
    )
    sim = mps.Simulation(scene)
    before = sim.snapshot()
    sim.run()
    after = sim.snapshot()
    spun = [(s.x[:, 0] * s.u[:, 1] - s.x[:, 1] * s.u[:, 0]).sum() for s in (before, after)]
    ratios = [np.sqrt((after.x**2).sum() / (before.x**2).sum()), (after.u**2).sum() / (before.u**2).sum()]
    return [*(ratio - 1.0 for ratio in ratios), spun[1] / spun[0] - 1.0, sim.report.volume_error_max]


@pytest.mark.parametrize(
    ("across", "dimension", "turn", "turns", "law"),
    [
        (6, 2, 3.0, 0.5, "Bingham"),
        pytest.param(10, 2, 2.0, 2.0, "Bingham", marks=pytest.mark.long),
        pytest.param(6, 3, 2.5, 2.0, "Bingham", marks=pytest.mark.long),
        pytest.param(6, 3, 2.5, 2.0, "bi-viscosity", marks=pytest.mark.long),
        pytest.param(6, 3, 2.5, 2.0, "flow curve", marks=pytest.mark.long),
    ],
)
def test_a_rigid_body_that_turns_keeps_radius_energy_angular_momentum_and_volume(across, dimension, turn, turns, law):
    """A rigid rotation keeps them within 0.5 % over two turns; with the gradient at the middle of the step the disc
    would widen by 5 % a turn."""
    mps.init(precision="f32", threads=1)
    np.testing.assert_allclose(turned(across, dimension, turn, turns, LAWS[law]), 0.0, atol=0.005)


def heap(speed, spacing=0.005, until=0.6):
    """Height of the centre of mass [m] of a block that slumps on a floor, both moving at a speed [m/s]."""
    x = mps.lattice((-0.1, 0.0), (0.1, 0.1), spacing)
    scene = mps.Scene(
        name="heap",
        material=mps.Bingham(density=2300.0, plastic_viscosity=30.0, yield_value=150.0),
        spacing=spacing,
        fluid=x,
        velocity=np.tile((speed, 0.0), (len(x), 1)),
        walls=(mps.Plane((0.0, 0.0), (0.0, 1.0), velocity=(speed, 0.0)),),
        domain=((-0.4, -0.02), (0.4 + until * speed, 0.15)),
        until=until,
    )
    sim = ran(scene)
    return sim.snapshot().x[:, 1].mean(), sim.steps


@pytest.mark.long
def test_a_heap_on_a_floor_that_moves_is_the_heap_at_rest():
    """The heap on a moving floor takes as many steps, and its centre of mass agrees within 0.15 mm of 31 mm; 0.03 to
    0.12 mm are seen, of unknown cause."""
    mps.init(precision="f32", threads=1)
    (height, steps), *others = [heap(speed) for speed in (0.0, 0.1, 1.0, 5.0)]
    for other, as_many in others:
        assert other == pytest.approx(height, abs=1.5e-4)
        assert as_many == pytest.approx(steps, rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("aside", "material"), [(0.05, LAWS["Bingham"]), pytest.param(0.03, LAWS["Newtonian"], marks=pytest.mark.long)]
)
def test_blocks_that_collide_off_centre_keep_their_angular_momentum(aside, material, spacing=0.01):
    mps.init(precision="f32", threads=1)
    block = mps.lattice((0.0, 0.0), (0.1, 0.1), spacing)
    x = np.vstack([block, block + [0.103, aside]])
    x -= x.mean(axis=0)
    u = np.repeat([(1.0, 0.0), (-1.0, 0.0)], len(block), axis=0)
    scene = mps.Scene(
        "hit", material, spacing, x, ((-1.0, -1.0), (1.0, 1.0)), velocity=u, gravity=(0.0, 0.0), until=0.1
    )
    s = ran(scene).snapshot()
    spun = [(y[:, 0] * v[:, 1] - y[:, 1] * v[:, 0]).sum() for y, v in ((x, u), (s.x, s.u))]
    assert spun[1] == pytest.approx(spun[0], rel=1e-3)
    assert np.abs(s.u.mean(axis=0)).max() < 1e-5


def pool(turned, l0=0.01, width=0.06, depth=0.3):
    """Largest speed [m/s], pressure [Pa] on the bottom and depth [m] of a pool between slip walls after 0.1 s, its
    axes swapped if ``turned``."""

    def swapped(*vector):
        return vector[::-1] if turned else vector

    sides = [mps.Plane(swapped(x, 0.0), swapped(normal, 0.0), slip=True) for x, normal in ((0.0, 1.0), (width, -1.0))]
    scene = mps.Scene(
        name="pool",
        material=mps.Bingham(density=2300.0, plastic_viscosity=5.0, yield_value=50.0),
        spacing=l0,
        fluid=np.array([swapped(*x) for x in mps.lattice((0.0, 0.0), (width, depth), l0).tolist()]),
        walls=(mps.Plane((0.0, 0.0), swapped(0.0, 1.0), slip=True), *sides),
        domain=(swapped(-l0, -l0), swapped(width + l0, 1.2 * depth)),
        gravity=swapped(0.0, -9.81),
        until=0.1,
    )
    s, along = ran(scene).snapshot(), 0 if turned else 1
    return s.speed.max(), np.polyval(np.polyfit(s.x[:, along], s.p, 1), 0.0), s.x[:, along].max() + 0.5 * l0


@pytest.mark.long
def test_a_deep_pool_stands_whichever_axis_its_weight_acts_along():
    """What sets the scale of the pressure is the height along gravity: 0.3 m, not the width of 0.06 m."""
    (speed, bottom, depth), turned = pool(False), pool(True)
    assert bottom == pytest.approx(2300.0 * 9.81 * 0.3, rel=0.02) and depth == pytest.approx(0.3, abs=0.005 * 0.3)
    assert turned == pytest.approx((speed, bottom, depth), rel=1e-3, abs=1e-5)


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
