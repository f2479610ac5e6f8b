"""An uneven fill is relaxed before the first step (I26), and an even one is unchanged."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.distance import pdist

import taichi_mps as mps
from taichi_mps.engine.problem.problem import Problem
from taichi_mps.engine.terms.shifting import is_uneven

SPACING = 0.02
WIDTH, HEIGHT = 0.4, 0.3


def scene_of(dimension=2):
    """A block on a floor, a lattice."""
    low, high = (0.0,) * dimension, (WIDTH,) * (dimension - 1) + (HEIGHT,)
    return mps.Scene(
        name="block",
        material=mps.Bingham(density=2300.0, plastic_viscosity=50.0),
        spacing=SPACING,
        fluid=mps.fill(mps.Box(low, high), SPACING),
        walls=(mps.Plane(low, (0.0,) * (dimension - 1) + (1.0,)),),
        domain=(np.add(low, -0.6), np.add(high, 0.6)),
        until=0.3,
    )


@pytest.fixture(scope="module")
def plane():
    """A block in the plane, compiled once, and its state at the start."""
    sim = mps.Simulation(scene_of())
    return sim, sim.state()


def begun(block, jitter=0.0, yield_value=3000.0):
    """The block at its start, its coordinates moved by up to ``jitter`` l0, at random: where it is, and the run."""
    sim, start = block
    x = start["x"] + jitter * SPACING * np.random.default_rng(1).uniform(-1.0, 1.0, start["x"].shape)
    material = mps.Bingham(density=2300.0, plastic_viscosity=50.0, yield_value=yield_value)
    sim.restart(Problem(replace(sim.scene, material=material)), start | {"x": x})
    return x, sim


def relaxed(sim):
    """Where particles are after the initial relaxation, in the order in which they were given [m]."""
    sim.scheme.relax()
    return sim.snapshot().x


@pytest.mark.filterwarnings("error::UserWarning")
def test_a_lattice_stays_where_it_is(plane):
    fluid, sim = begun(plane, 0.02)
    assert relaxed(sim) == pytest.approx(fluid, abs=1e-12)


def test_few_rings_in_layers_stay_where_they_are():
    """The cone of a lifted mould, ten rings below and five above whose layers do not match, is not relaxed."""
    fluid = mps.catalogue.build("slump", spacing=SPACING, lift_speed=0.5).fluid
    material = mps.Bingham(density=2300.0, plastic_viscosity=50.0, yield_value=20000.0)
    sim = mps.Simulation(mps.Scene("rings", material, SPACING, fluid, ((-0.2, -0.2, -0.1), (0.2, 0.2, 0.4))))
    sim.neighbors.search()
    assert not is_uneven(sim.scheme.fluid)


@pytest.mark.parametrize("dimension", [2, pytest.param(3, marks=pytest.mark.long)])
def test_a_jittered_fill_is_even_after_it_fills_the_same_room_and_is_in_front_of_the_floor(dimension, plane):
    block = plane
    if dimension == 3:
        sim = mps.Simulation(scene_of(3))
        block = sim, sim.state()
    fluid, sim = begun(block, 0.3)
    with pytest.warns(UserWarning, match="fluid: unevenly filled, so it is relaxed before the first step"):
        x = relaxed(sim)
    assert not is_uneven(sim.scheme.fluid)
    assert pdist(x).min() > 0.6 * SPACING > 1.2 * pdist(fluid).min()
    assert x.mean(0) == pytest.approx(fluid.mean(0), abs=0.05 * SPACING)
    assert np.ptp(x, axis=0) == pytest.approx(np.ptp(fluid, axis=0), abs=0.6 * SPACING)
    assert x[:, -1].min() > 0.0


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:fluid")
def test_a_block_that_must_stand_stands_however_it_is_filled(plane):
    """A block with a yield stress of 0.34 rho g H, more than one of any width needs, stands for 0.3 s after relaxation
    in the first step, which has lowered its top by less than the jitter; without relaxation, as in a resumed run, it
    sinks ten times as far as it does then."""
    sunk = []
    for relaxes in (True, False):
        fluid, sim = begun(plane, 0.3, yield_value=2300.0)
        sim.load(sim.state() | {"steps": int(not relaxes)})
        sim.step()
        first = sim.snapshot().x
        sim.run()
        top = fluid[:, 1] > HEIGHT - 1.5 * SPACING
        assert abs((fluid - first)[top, 1].mean()) < 0.3 * SPACING
        sunk.append((first - sim.snapshot().x)[top, 1].mean())
    assert sunk[1] > 10.0 * abs(sunk[0])


def test_what_has_flowed_is_even(plane):
    """A body that has flowed, taken as the fill of a new scene, is not relaxed."""
    _, sim = begun(plane, yield_value=100.0)
    sim.run()
    assert np.ptp(sim.snapshot().x[:, 0]) > 1.2 * WIDTH
    assert not is_uneven(sim.scheme.fluid)


def test_a_fill_that_goes_through_periodic_sides_is_relaxed_through_them(monkeypatch):
    """In a box without walls or surface a fill moved by a third of the box is relaxed in the same way, to rounding
    where no random part of the shift follows from the place."""
    monkeypatch.setattr("taichi_mps.engine.terms.shifting.PERTURBATION", 0.0)
    size, material = 10 * SPACING, mps.Bingham(density=2300.0, plastic_viscosity=50.0, yield_value=100.0)
    lattice = mps.fill(mps.Box((0.0, 0.0), (size, size)), SPACING)
    fluid = lattice + 0.3 * SPACING * np.random.default_rng(1).uniform(-1.0, 1.0, lattice.shape)
    domain = ((0.0, 0.0), (size, size))
    sim = mps.Simulation(
        mps.Scene("box", material, SPACING, lattice, domain, periodic=(True, True), gravity=(0.0, 0.0))
    )
    start, ends = sim.state(), []
    for shift in (0.0, size / 3.0):
        sim.load(start | {"x": (fluid + shift) % size})
        with pytest.warns(UserWarning, match="unevenly filled"):
            ends.append((relaxed(sim) - shift + 0.5 * SPACING) % size)
    apart = (ends[1] - ends[0] + 0.5 * size) % size - 0.5 * size
    assert np.abs(apart).max() < 1e-9 * SPACING
