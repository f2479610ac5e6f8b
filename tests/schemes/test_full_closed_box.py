"""A full closed box under gravity: its walls hold the weight, and what flows in it does not know of it (I34)."""

import numpy as np
import pytest

import taichi_mps as mps

ACROSS, DENSITY, ETA, G = 12, 1000.0, 10.0, 9.81  # -, kg/m3, Pa s, m/s2: Reynolds number 100


@pytest.fixture(scope="module")
def cavity():
    """A unit cavity under a lid of 1 m/s and its state at the start; the scene's gravity sets the scales of the step
    and the penalties of all runs."""
    box = (0.0, 0.0), (1.0, 1.0)
    scene = mps.Scene(
        name="cavity",
        material=mps.Newtonian(density=DENSITY, viscosity=ETA),
        spacing=1.0 / ACROSS,
        fluid=mps.fill(mps.Box(*box), 1.0 / ACROSS),
        walls=(*mps.box_planes(*box), mps.Plane((0.0, 1.0), (0.0, -1.0), velocity=(1.0, 0.0))),
        gravity=(0.0, -G),
        domain=((-0.1, -0.1), (1.1, 1.1)),
        wall_loads=True,
    )
    sim = mps.Simulation(scene)
    return sim, sim.state()


def test_the_vortex_is_the_same_with_and_without_gravity(cavity):
    """Bit for bit, for the weight less that of the first mix is nothing; the pressure that is read has the hydrostatic
    one, and on the lattice all walls together carry the weight."""
    sim, start = cavity
    gravities = np.array([(0.0, 0.0), (0.0, -G), (0.6 * G, 0.8 * G)])
    found, loads = [], []
    for gravity in gravities:
        sim.scheme.fluid.gravity[None] = gravity
        sim.load(start)
        sim.step()
        loads.append(sum(load.force for load in sim.snapshot().loads.values()))
        for _ in range(10):
            sim.step()
        found.append(sim.snapshot())
    assert np.abs(found[0].u).max() > 0.5
    print(loads, np.abs(loads - loads[0] - DENSITY * gravities).max() / DENSITY / G)
    for gravity, s in zip(gravities, found, strict=True):
        np.testing.assert_array_equal(s.u, found[0].u)
        np.testing.assert_array_equal(s.x, found[0].x)
        assert s.p == pytest.approx(found[0].p + DENSITY * (s.x - 0.5) @ gravity, abs=1e-5 * DENSITY * G)


def test_a_full_closed_box_goes_on_as_it_was(cavity):
    """Particles carry the pressure in excess of the hydrostatic one, and the state says so; one of an earlier version
    does not, and has the whole pressure: that of the box at rest makes no motion."""
    sim, start = cavity
    sim.scheme.fluid.gravity[None] = (0.0, -G)
    sim.load(start)
    sim.step()
    later = sim.state()
    sim.step()
    u = sim.snapshot().u
    sim.scheme.pressure.full[None] = 0
    sim.load(later)
    sim.step()
    np.testing.assert_array_equal(sim.snapshot().u, u)
    whole = later["p"] + DENSITY * (later["x"] - 0.5) @ (0.0, -G)
    sim.load({k: v for k, v in later.items() if k != "full"} | {"p": whole})
    sim.step()
    print(np.abs(sim.snapshot().u - u).max())
