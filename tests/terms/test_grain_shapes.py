"""Grains that are no spheres: clumps in contact and in free flight."""

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.engine.geometry.packing import template
from tests.support.grains import L0, THIN, G, advance, momenta, two_bars

# in spacings, so that all lie well on the lattice: five discs that touch in a row, five spheres with three inertias
ROD = [(4.0 * k, 0.0, 2.0) for k in (-2, -1, 0, 1, 2)]
CROSS = [(0.0, 0.0, 0.0, 2.0), *((s * a, s * b, 0.0, 2.0) for a, b in ((3.0, 0.0), (0.0, 2.0)) for s in (-1, 1))]


def dry(shape, places, across=None, velocities=0.0, spin=(0.0, 0.0, 0.0), **more):
    """Grains without mortar near the places (g, d) [m], ``across`` spacings wide or as their rows tell, with velocities
    (g, d) [m/s] and a spin [1/s]."""
    d, spheres = len(places[0]), mps.Grains(diameter=1.0, volume_fraction=0.1, shape=shape).clump(len(places[0]))[0]
    across = across or shape[0][-1] / spheres[0, -1]
    offset, cells = template(across, d, tuple(map(tuple, spheres.tolist())))
    arms = (cells - offset) * L0
    centres = (np.round(np.array(places) / L0 - offset) + offset) * L0
    turning = np.cross(spin, np.pad(arms, ((0, 0), (0, 3 - d))))[:, :d]
    u = np.broadcast_to(velocities, centres.shape)[:, None] + turning
    numbers = {"gravity": (0.0,) * d, "velocity": u.reshape(-1, d), "until": 10.0} | more
    numbers["grains"] = mps.Grains(diameter=across * L0, centres=centres, shape=shape)
    x = (centres[:, None] + arms).reshape(-1, d)
    return mps.Simulation(
        mps.Scene("dry", THIN, L0, x, ((-0.4,) * d, (0.4,) * d), **numbers), mps.Implicit(tolerance=1e-10)
    )


@pytest.mark.long
def test_a_free_cross_of_five_spheres_tumbles_with_its_angular_momentum_and_energy():
    """Euler's top, spun about its middle axis, which is unstable: it turns over. A solve has a
    tolerance of 1e-10, and P one of some 1e-12, by which its J is regularised."""
    sim = dry(CROSS, [(0.0, 0.0, 0.0)], spin=(0.3, 20.0, 0.1))
    _, angular, energy = momenta(sim)
    along = [20.0]
    while along[-1] > -19.0 and sim.time < 3.0:
        sim.step()
        along.append((sim.grains.rotations[0].T @ sim.grains.spins[0])[1])
    _, after, left = momenta(sim)
    assert along[-1] < -19.0, "it has not turned over"
    assert after == pytest.approx(angular, abs=1e-8 * np.linalg.norm(angular))
    assert left == pytest.approx(energy, rel=1e-5)


@pytest.mark.long
def test_two_ellipsoids_that_collide_keep_momentum_and_angular_momentum_and_go_on_bit_for_bit():
    sim = dry("ellipsoid 2:1:1", [(0.0, 0.0, 0.0), (0.02, 0.0, 0.09)], 4.9, [(0.0, 0.0, 0.5), (0.0, 0.0, -0.5)])
    momentum, angular, energy = momenta(sim)
    while sim.scheme.contacts.force.to_numpy().max() == 0.0:
        sim.step()
    met, ends = sim.state(), []
    for _ in range(2):
        sim.load(met)
        for _ in range(10):
            sim.step()
        ends.append(sim.state())
    assert all(np.array_equal(values, ends[1][name]) for name, values in ends[0].items())
    advance(sim, 0.2)
    after, turned, left = momenta(sim)
    assert np.abs(sim.grains.spins[:, 1]).min() > 0.5 and left < energy, "they have not met"
    assert after == pytest.approx(momentum, abs=1e-9) and turned == pytest.approx(angular, abs=1e-9)


@pytest.mark.long
def test_a_rod_lies_across_a_gap_through_which_a_disc_twice_as_wide_falls():
    """Five discs in a row, the outermost over the middles of two round bars three widths apart: at rest they touch
    them, within their samples, an eighth of a spacing apart."""
    bars = two_bars(8.0 * L0, 2.0 * L0)
    for shape, across in ((ROD, None), ("sphere", 8.0)):
        sim = dry(shape, [(0.0, 0.08)], across, gravity=(0.0, -G), walls=(bars,))
        while sim.time < 0.4 and sim.grains.centres[0, 1] > -0.1:
            sim.step()
        if shape == ROD:
            assert sim.grains.centres[0] == pytest.approx([0.0, 4.0 * L0], abs=0.03 * L0)
            assert np.abs(sim.grains.velocities).max() < 1e-4 and sim.scheme.contacts.number[0] == 2
    assert sim.grains.centres[0, 1] < -0.1


@pytest.mark.long
@pytest.mark.parametrize(
    "shape, tangent, net",  # of a slope; what accelerates the grain along it, over its weight across
    [(ROD, 0.392, 0.0), (ROD, 0.408, 0.008), ("sphere", 0.3, 0.3 * 5.0 / 7.0), ("sphere", 1.43, 1.03)],
)
def test_on_a_slope_a_rod_slides_above_its_friction_and_a_sphere_above_three_and_a_half_times(shape, tangent, net):
    """Friction 0.4. The rod lies with five discs on the slope and cannot roll; below 3.5 mu the sphere rolls with 5/7
    of its weight along it, by the inertia of the solid. 2 % on either side of the friction, and above 3.5 times it,
    where rolling and slipping differ by 0.8 %."""
    normal, weight = np.eye(2 if shape == ROD else 3)[-1], G / np.hypot(1.0, tangent)
    gravity, floor = weight * (tangent * np.roll(normal, 1) - normal), mps.Plane(0.0 * normal, normal)
    sim = dry(shape, [2.0 * L0 * normal], None if shape == ROD else 4.0, gravity=gravity, walls=(floor,))
    advance(sim, 0.2)
    assert sim.grains.velocities[0, 0] == pytest.approx(weight * net * sim.time, rel=2e-3, abs=1e-9)
