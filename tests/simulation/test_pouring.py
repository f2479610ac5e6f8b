"""Placing: inflow through an inlet and its end, the volume in a form, and bars written as a mesh."""

import base64
import zlib
from dataclasses import replace
from importlib.util import find_spec
from itertools import pairwise

import meshio
import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.engine.geometry.meshes import read_mesh
from taichi_mps.engine.simulation.pouring import Pouring
from taichi_mps.engine.terms.pressure import LOOSE
from taichi_mps.io.vtkhdf import Trajectory
from taichi_mps.report import drawings
from tests.support.cube import box
from tests.support.scenes import ran

NEEDS_IGL = pytest.mark.skipif(find_spec("igl") is None, reason="the distance of a mesh is libigl's")
L0, RATE, LAYERS = 0.02, 0.04, 9
HOSE = mps.Inlet(centre=(0.01, 0.4), direction=(0.0, -2.0), radius=0.04, rate=RATE, volume=0.0144)
ALL = LAYERS + 2  # layers: a second hose adds two
SPEED = RATE / (4 * L0)  # four particles lie across the hose
FILE = """
import taichi_mps as mps

@mps.checked
def scene() -> mps.Scene:
    walls = mps.box_planes((-0.1, 0.0), (0.1, 0.4), slip=True)
    return mps.Scene(
        name="poured", material=mps.Bingham(yield_value=2000.0, plastic_viscosity=50.0), spacing=0.02, fluid=None,
        inlets=(
            mps.Inlet(centre=(0.01, 0.4), direction=(0.0, -2.0), radius=0.04, rate=0.04, volume=0.0144),
            mps.Inlet(
                centre=(-0.05, 0.35), direction=(0.0, -1.0), radius=0.04, rate=0.08, volume=0.003, start=0.7,
                material=mps.Bingham(density=2000.0, yield_value=1500.0, plastic_viscosity=30.0),
            ),
        ),
        cavity=mps.Cavity((-0.1, 0.0), (0.1, 0.06), walls, 0.02),
        walls=walls, domain=((-0.12, -0.04), (0.12, 0.5)), until=3.0, stop_at_rest=True, measure=mps.measure.front,
    )
"""


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    path = tmp_path_factory.mktemp("scene") / "poured.py"
    path.write_text(FILE, encoding="utf-8")
    return str(path)


@pytest.fixture
def scene(source):
    return mps.catalogue.build(source)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("yield_value", "plastic_viscosity", "rate"),
    [pytest.param(50.0, 100.0, 0.05, marks=pytest.mark.long), (20.0, 20.0, 0.02)],
)
def test_what_a_slow_jet_pours_stands_as_high_as_its_volume(yield_value, plastic_viscosity, rate):
    """Layers that a free fall of 0.25 m has pulled apart, from 0.2 or 0.4 m/s, close again under their weight: the
    centre is half as high as the poured area over the width, within the tenth of packing from which on (I33) closes
    what lacks. The surface is no measure of it: 50 Pa hold a dome."""
    width, l0 = 0.2, 0.01
    scene = mps.Scene(
        name="poured",
        material=mps.Bingham(density=2300.0, yield_value=yield_value, plastic_viscosity=plastic_viscosity),
        spacing=l0,
        fluid=None,
        walls=mps.box_planes((0.0, 0.0), (width, 0.6)),
        domain=((-0.05, -0.05), (width + 0.05, 0.9)),
        inlets=(mps.Inlet((0.5 * width, 0.25), (0.0, -1.0), radius=0.06, rate=rate, volume=0.0204),),
        until=0.0204 / rate + 1.5,
    )
    s = ran(scene).snapshot()
    assert s.x[:, 1].mean() == pytest.approx(0.5 * len(s.x) * l0**2 / width, rel=LOOSE)


def test_concrete_enters_at_its_rate_falls_freely_rests_and_resumes_bit_for_bit(scene, source, tmp_path):
    sim = mps.Simulation(scene)
    assert repr(sim.scene.inlets[0]) == repr(HOSE) and sim.particles.capacity == 4 * ALL
    layer, interval = 4 * L0**2, 4 * L0**2 / RATE
    entered = [0.0]  # times at which the layers entered [s]
    output = Trajectory(tmp_path / "run.h5")
    output.create(sim, source, 0.1)
    counts = [len(sim.snapshot().x)]
    output.append(sim.snapshot())
    while sim.snapshot().x[:, 1].min() > 2.5 * L0:  # nothing has come near the floor
        start = sim.time
        before = sim.fluid_particles
        sim.step()
        if sim.fluid_particles > before:
            entered.append(start)
        assert sim.fluid_particles * L0**2 == pytest.approx(layer * (1 + np.floor(start / interval)), rel=1e-12)
        assert sim.report.dt * SPEED < 0.21 * L0  # a layer is never late by more than a fifth of a spacing
    assert len(entered) >= 5 and sim.summary()["poured_m3_per_m"] == pytest.approx(len(entered) * layer)
    falling = np.sum([SPEED + 9.81 * (sim.time - t) for t in entered]) * layer
    momentum = -sim.snapshot().u[:, 1].sum() * L0**2
    assert momentum == pytest.approx(falling, rel=1e-3)
    counts.append(len(sim.snapshot().x))
    output.append(sim.snapshot())
    layers = sim.snapshot().x.reshape(-1, 4, 2)  # each as it entered: level, as wide as the hose, around its axis
    assert np.ptp(layers[..., 1], axis=1).max() < 0.05 * L0
    assert np.allclose(layers[..., 0], 0.01 + L0 * np.array([-1.5, -0.5, 0.5, 1.5]), atol=0.05 * L0)

    mps.checkpoint.Checkpoint.of(sim, source).write(tmp_path / "checkpoint.h5")
    ends, steps = [], []
    sim.each_step(lambda sim: steps.append((sim.time, sim.fluid_particles)))
    for limits in ((), (start + 0.5 * interval, 0.7, 0.701)):  # which do not change the run
        steps[:] = [(sim.time, sim.fluid_particles)]
        for limit in limits:
            assert sim.run(until=limit) == "time"
        sim.load(sim.state())  # of the step before the limit
        sim.rest.reached = lambda _: True
        assert sim.run(until=10.0) == "rest"  # which is no end while concrete is to come
        assert all(pouring.done for pouring in sim.pouring) and steps[-1][1] > steps[-2][1]
        opening = min(start for (start, before), (_, after) in pairwise(steps) if after > before and start > 0.5)
        assert opening == pytest.approx(0.7, abs=1e-9)
        del sim.rest.reached
        ends.append(sim.state())
        saved = mps.checkpoint.read(tmp_path / "checkpoint.h5")
        assert saved.header["fluid"] == mps.checkpoint.digest(scene, mps.checkpoint.PARTICLE_ATTRIBUTES)
        sim.load(saved.state)
        assert sim.fluid_particles == counts[-1]
    np.testing.assert_equal(*ends)
    # of another simulation, as resume makes it
    again = mps.checkpoint.restore(tmp_path / "checkpoint.h5", scene).state()
    assert len(again["x"]) == counts[-1] > counts[0]
    np.testing.assert_equal(again, saved.state)
    for poured in (None, [], [[1, 0.0]], [[LAYERS + 1, 0.0], [0, 0.0]], [[1.0, 0.0], [0, 0.0]], [[1, -0.1], [0, 0.0]]):
        with pytest.raises(mps.SceneError, match="^checkpoint: pouring = .* they have .9, 2. layers$"):
            replace(saved, state={**saved.state, "pouring": poured}).admit(scene)

    assert sim.run() == "rest" and sim.time > 0.7
    summary = sim.summary()
    # it would fill more than the cavity, but stands on its own
    assert summary["fluid_particles"] == 4 * ALL and summary["pour_delay_s"] == 0.0 < 0.3 < summary["filled_ratio"]
    # the latter is what losses of volume are compared with
    assert [summary["poured_m3_per_m"], sim._volume] == pytest.approx([4 * ALL * L0**2] * 2)
    s = sim.snapshot()
    assert len(s.x) == 4 * ALL and mps.measure.clearance(s, scene.walls) > 0.0 and s.x[:, 1].max() < 0.3
    output.append(s)
    replay = [(len(out.snapshot().x), out.snapshot()) for out in output.replay(source)]
    assert [n for n, _ in replay] == [*counts, 4 * ALL]
    last = replay[-1][1]
    assert np.allclose(last.x, s.x, atol=1e-6) and np.array_equal(last.mix, s.mix)
    assert s.mix.tolist() == [0] * 4 * LAYERS + [1] * 8  # by id: the second hose has brought its own
    energy = 0.5 * L0**2 * ((s.u**2).sum(1) * np.where(s.mix == 1, 2000.0, 2300.0)).sum()
    assert sim.report.kinetic_energy == pytest.approx(energy, rel=1e-4)


def test_a_buried_mouth_holds_the_layers_back(scene):
    pouring = Pouring(scene, HOSE)
    t = 1.25 * pouring.interval
    assert not pouring.due(0.99 * pouring.interval) and pouring.due(t)
    buried = np.array([[0.0, 0.4]])
    assert pouring.enter(t, buried) is None and pouring.entered == 1
    assert pouring.delay == pytest.approx(0.25 * pouring.interval) and pouring.due(1.3 * pouring.interval)
    layer = pouring.enter(1.3 * pouring.interval, buried - (0.0, 0.1))
    assert np.allclose(layer, scene.inlet_layer(HOSE) - (0.0, 0.05 * L0)) and pouring.entered == 2
    assert not pouring.due(2.2 * pouring.interval) and pouring.due(2.26 * pouring.interval)
    assert pouring.volume == pytest.approx(8 * L0**2)


def test_a_layer_has_the_area_that_its_speed_is_taken_from():
    """Across any hose the lattice has the spacing l0, and a mirror plane along the axis leaves half of it."""
    for direction in ((0.0, 0.0, -1.0), (1.0, 0.0, -1.0), (1.0, 2.0, 3.0)):
        inlet = mps.Inlet((0.1, 0.0, 0.5), direction, 0.05, 0.01, 0.02)
        x = inlet.layer(0.01)
        along = (x - inlet.centre) @ inlet.unit_direction
        assert np.allclose(along, -0.005) and len(x) * 0.01**2 == pytest.approx(np.pi * 0.05**2, rel=0.03)
        apart = np.linalg.norm(x[:, None] - x[None], axis=2) + np.eye(len(x))
        assert np.allclose(apart.min(1), 0.01)
        assert inlet.speed(0.01) * len(x) * 0.01**2 == pytest.approx(0.01)
    mirror = mps.Plane((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), mirror=True)
    inlet = mps.Inlet((0.1, 0.0, 0.5), (1.0, 0.0, -1.0), 0.05, 0.01, 0.02)
    half = mps.Scene(
        "half", mps.Bingham(), 0.01, None, ((-1.0, -0.1, 0.0), (1.0, 1.0, 1.0)), walls=(mirror,), inlets=(inlet,)
    )
    assert 2 * len(half.inlet_layer(inlet)) == len(inlet.layer(0.01)) and half.fluid.shape == (0, 3)
    hoses = inlet, replace(inlet, centre=(0.1, 0.2, 0.5))
    assert [Pouring(half, hose).copies for hose in hoses] == [1, 2]  # of the whole body


@pytest.mark.parametrize("direction", [(1.0, 0.0), (1.0, -1.0), (0.0, -1.0)])
@pytest.mark.parametrize("shape", ["ellipse 2:1", [(0.0, 0.0, 1.0), (1.2, 0.4, 0.5)]])
def test_the_particles_of_a_poured_clump_lie_in_its_spheres(shape, direction):
    """Also of one without symmetry, in a hose of any direction: to the misfit of the lattice."""
    grains, hose = mps.Grains(0.06, 0.2, shape=shape), mps.Inlet((0.0, 0.2), direction, 0.15, 0.06, 0.05)
    scene = mps.Scene("clumps", mps.Bingham(), 0.01, None, ((-2.0, -2.0), (2.0, 2.0)), inlets=(hose,), grains=grains)
    number, centres, radii, turns = scene.grain_places
    x, g, spheres = scene.streams[0].x[number > 0], number[number > 0] - 1, 2.0 * radii[0] * grains.clump(2)[0]
    beyond = ((x - centres[g])[:, None] @ turns[g] - spheres[:, :2]) / spheres[:, 2:]
    assert len(radii) > 3 and np.linalg.norm(beyond, axis=2).min(1).max() < 1.0 + 0.3 * 0.01 / spheres[:, 2].min()


@pytest.fixture(scope="module")
def stony():
    """A stream of mortar with discs from an oblique hose that sinks as it pours, in free fall, and its state at 0 s."""
    hose = mps.Inlet((0.0, 0.2), (0.6, -0.8), 0.06, 0.06, 0.018, path=((0.0, 0.0, 0.0), (0.6, 0.0, -0.1)))
    grains = mps.Grains(diameter=0.04, volume_fraction=0.2, density=2650.0)
    mortar = mps.Bingham(yield_value=50.0, plastic_viscosity=10.0, density=2100.0)
    domain = (-0.4, -2.0), (1.0, 0.3)
    sim = mps.Simulation(mps.Scene("stony", mortar, 0.01, None, domain, inlets=(hose,), grains=grains, until=0.6))
    return sim, sim.state()


@pytest.mark.slow
def test_grains_enter_whole_with_their_first_row_and_keep_momentum(stony):
    """Momentum, of what has entered and its weight, to the tolerance of the solver; each grain has all its particles,
    rigid, from the first, and all of the mortar enters."""
    sim, start = stony
    sim.load(start)
    (hose,), number = sim.scene.inlets, sim.scene.grain_places[0]
    shape, momentum, known = np.vstack([stream.x for stream in sim.scene.streams]), np.zeros(2), 0
    bodies = []
    while not sim.pouring[0].done or known < len(number):
        before = sim.time
        sim.step()
        s = sim.snapshot()
        mass = np.where(s.grain > 0, 2650.0, 2100.0) * 0.01**2
        momentum += mass[known:].sum() * hose.velocity(0.01, before) + mass.sum() * np.array([0.0, -9.81]) * (
            sim.time - before
        )
        known = len(s.x)
        assert (mass[:, None] * s.u).sum(0) == pytest.approx(momentum, abs=1e-3 * np.linalg.norm(momentum))
        for g in np.unique(s.grain[s.grain > 0]):
            now, whole = s.x[s.grain == g], shape[number == g]
            apart, wanted = (np.linalg.norm(x - x[:1], axis=1) for x in (now, whole))
            assert apart == pytest.approx(wanted, abs=1e-9)
        bodies.append(s)
    film = drawings.film_of_grains(sim.scene, bodies, np.zeros(3), np.full(3, 1e-4))
    steps = np.frombuffer(zlib.decompress(base64.b64decode(film["centres"])), "<i2").reshape(len(bodies), -1, 3)
    shown = np.cumsum(steps, axis=0, dtype=np.int16)
    for s, codes in zip(bodies, shown, strict=True):
        there = 1 + np.flatnonzero(codes[:, 0] != drawings.ABSENT)
        assert there.tolist() == np.unique(s.grain[s.grain > 0]).tolist()
        for g in there:
            assert codes[g - 1, ::2] == pytest.approx(1e4 * s.x[s.grain == g].mean(0), abs=1.0)
    assert len(np.unique(s.grain)) - 1 == len(sim.grains.radii) == round(0.2 * 0.018 / (np.pi * 0.02**2))


@pytest.mark.slow
def test_poured_grains_go_on_bit_for_bit(stony):
    sim, start = stony
    sim.load(start)
    while len(np.unique(sim.snapshot().grain)) < 3:
        sim.step()
    middle, ends = sim.state(), []
    for _ in range(2):
        while sim.time < middle["time"] + 0.1:
            sim.step()
        ends.append(sim.state())
        sim.load(start), sim.load(middle)
    assert ends[0]["slot"].max() > middle["slot"].max()
    np.testing.assert_equal(
        {k: v for k, v in ends[0].items() if k != "report"}, {k: ends[1][k] for k in ends[0] if k != "report"}
    )


# ---- what a form holds ------------------------------------------------------------------------------------------
BOX = (0.0, 0.0, 0.0), (0.12, 0.08, 0.1)
FORM = mps.Cavity(*BOX, mps.box_planes(*BOX), 0.01)


def body(where=lambda x: np.full(len(x), True)):
    x = mps.lattice(*BOX, 0.01)
    return mps.measure.still(x[where(x)], 0.01)


def test_a_lattice_fills_a_form_and_a_hole_in_it_is_a_void():
    """The volume of a void is that of the hole less half a cell at each of its faces, which the particles around it
    reach."""
    report = FORM.report(mps.measure.still(mps.lattice(BOX[0], (0.12, 0.08, 0.12), 0.01), 0.01))
    assert report["above_m3"] == pytest.approx(0.12 * 0.08 * 0.02)
    report = FORM.report(body())
    assert (
        report["above_m3"] == 0.0
        and report["filled_ratio"] == 1.0
        and report["void_m3"] == 0.0
        and report["void_centre"] is None
    )
    low, n = np.array([0.03, 0.02, 0.04]), 4
    hole = body(lambda x: ~np.all((x > low) & (x < low + n * 0.01), axis=1))
    report = FORM.report(hole)
    assert report["void_m3"] == pytest.approx((n * 0.01) ** 3)
    assert report["filled_ratio"] == pytest.approx(1.0 - report["void_m3"] / (0.12 * 0.08 * 0.1))
    assert report["void_centre"] == pytest.approx((low + 0.5 * n * 0.01).tolist())
    z, filled = np.transpose(report["filled_by_height"])
    empty = (z > 0.045) & (z < 0.075)
    assert np.allclose(z, 0.0025 + 0.005 * np.arange(20)) and np.all(filled[~empty] == 1.0)
    assert np.allclose(filled[empty], 1.0 - (2 * n - 2) ** 2 / (24 * 16))


def test_a_form_that_is_half_full_and_what_lies_outside_of_it():
    """The filled ratio is exact: the cell above the surface, whose middle is 0.83 spacings from four particles, counts
    as filled."""
    half = body(lambda x: x[:, 2] < 0.05)
    report = FORM.report(half)
    assert report["filled_ratio"] == pytest.approx(0.5)
    assert np.mean(report["filled_by_height"], axis=0)[1] == pytest.approx(11 / 20)
    x = np.vstack([half.x, half.x + (1.0, 0.0, 0.0), half.x - (0.0, 0.0, 0.2)])
    away = mps.measure.still(x, half.spacing)
    assert np.array_equal(FORM.filled(away), FORM.filled(half))
    assert FORM.report(replace(half, x=half.x + 5.0))["filled_ratio"] == 0.0


def test_walls_are_no_part_of_the_cavity():
    post = mps.Solid.of(lambda x: x[:, 0] - 0.04, (-0.1, -0.1, -0.1), (0.2, 0.2, 0.2), 0.01)
    form = mps.Cavity(*BOX, (post,), 0.01)
    assert form.cells.sum() == 16 * 16 * 20 and not form.cells[:8].any()
    assert form.report(body(lambda x: x[:, 0] > 0.04))["filled_ratio"] == 1.0
    for low, high, message in ((BOX[0], (0.03, 0.08, 0.1), "in the walls"), ((0.0, 0.0), (0.0, 1.0), "half a spacing")):
        with pytest.raises(mps.SceneError, match=message):
            mps.Cavity(low, high, (post,), 0.01)


def test_a_report_shows_what_is_filled_through_the_thickness():
    """A form of 12 x 8 x 10 cm with a post in one half of its depth, filled to 5 cm beside it."""
    post = mps.Solid.of(lambda x: 0.04 - x[:, 1], (-0.1, -0.1, -0.1), (0.2, 0.2, 0.2), 0.01)
    form, part = mps.Cavity(*BOX, (post,), 0.01), body(lambda x: x[:, 2] < 0.05)
    shown = drawings.filling(part, form)
    rows = np.array(shown["rows"], float)
    assert shown["low"] == [0.0, 0.0] and shown["high"] == [0.12, 0.1] and rows.shape == (20, 24)
    np.testing.assert_array_equal(rows, form.filled(part).sum(1).T / form.cells.sum(1).T)
    walled = mps.Cavity(*BOX, (mps.Plane((0.04, 0.0, 0.0), (1.0, 0.0, 0.0)),), 0.01)
    assert drawings.filling(body(), walled)["rows"][0] == [None] * 8 + [1.0] * 16


# ---- bars -------------------------------------------------------------------------------------------------------
@NEEDS_IGL
def test_bars_are_written_closed_and_read_back_with_their_volume(tmp_path):
    ends = np.array([[(0.1, 0.0, 0.0), (0.1, 0.0, 0.5)], [(0.0, 0.02, 0.2), (0.3, 0.02, 0.3)]])
    for suffix in ("stl", "obj", "ply"):
        path = mps.write_bars(tmp_path / f"bars.{suffix}", ends, 0.008)
        points, triangles = read_mesh(path)
        a, b, c = (points[triangles[:, k]] for k in range(3))
        length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum()
        assert np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0 == pytest.approx(np.pi * 0.008**2 * length, rel=1e-4)
    bars = mps.Solid.from_mesh(path, 0.003, 0.05)
    at = np.array([[0.1, -0.03, 0.25], [0.105, 0.0, 0.25], [0.2, 0.06, 0.2 + 0.2 / 3]])
    assert bars.distance(at) == pytest.approx([0.022, -0.003, 0.032], abs=1e-3)


@NEEDS_IGL
def test_a_mesh_in_millimetres_needs_a_scale(tmp_path):
    path = str(mps.write_bars(tmp_path / "mm.stl", [[(200.0, 50.0, 10.0), (200.0, 50.0, 400.0)]], 8.0))
    with pytest.raises(mps.SceneError, match=r"mm.stl: .* x 390 m; must .* at most 25 m long .*0.001 for a file in"):
        mps.catalogue.build("wall", rebar=path)
    rebar = mps.catalogue.build("wall", rebar=path, rebar_scale=0.001).walls[-1]
    inside, outside = rebar.distance(np.array([(0.2, 0.05, 0.2), (0.2, 0.07, 0.2)]))
    assert inside < 0.0 and outside == pytest.approx(0.012, abs=1e-3)


@NEEDS_IGL
def test_a_form_from_a_file_is_poured_through_its_opening(tmp_path):
    """A trough of 300 x 120 x 200 mm is filled completely through its narrower neck of 100 mm."""
    trough = np.vstack([box((0, 0, 0), (0.3, 0.12, 0.2)), box((0.1, 0.0, 0.2), (0.2, 0.12, 0.3))])
    meshio.write(tmp_path / "t.ply", meshio.Mesh(trough.reshape(-1, 3), [("triangle", np.arange(72).reshape(-1, 3))]))
    form = {"form": str(tmp_path / "t.ply"), "hose_diameter": 0.08}
    scene = mps.catalogue.build("wall", **form)
    (hose,) = scene.inlets
    assert hose.volume == pytest.approx(0.95 * (0.3 * 0.12 * 0.2 + 0.1 * 0.12 * 0.1), rel=1e-3)
    assert hose.centre == pytest.approx((0.15, 0.06, 0.36), abs=0.011)
    with pytest.raises(
        mps.SceneError, match=r"fill_point = \(0.05, 0.06\) m: the hose of 0.08 m must be over the open"
    ):
        mps.catalogue.build("wall", **form, fill_point=(0.05, 0.06))
    with pytest.raises(mps.SceneError, match="measure_pressure = True: has no effect with form; must be left out"):
        mps.catalogue.build("wall", **form, measure_pressure=True)


@pytest.mark.slow
def test_a_hose_that_is_lowered_fits_between_the_curtains():
    """The inner sides of bars of 10 mm with 25 mm of cover are 108 mm apart, 0.2 - 2 (0.025 + 2.1 x 0.01)."""
    thin = {"spacing": 0.035, "bar_diameter": 0.01, "cover": 0.025, "length": 0.4, "hose": "moving"}
    with pytest.raises(mps.SceneError, match=r"hose_diameter = 0.12 m: must be at most 0.10[78] m, .* or hose = above"):
        mps.catalogue.build("wall", **thin)
    slow = mps.catalogue.build("wall", **thin, hose_diameter=0.105, rate=0.003)
    assert slow.until == pytest.approx(slow.inlets[0].volume / 0.003 + 5.0)


def test_the_wall_judges_what_lies_in_it():
    """The check of the wall passes for a form full of a lattice, as much as is poured, and fails with a particle too
    few or in the rebar."""
    wall = mps.catalogue.build("wall")
    x = mps.lattice((0.0, 0.0, 0.0), (0.8, 0.1, 0.4), wall.spacing)
    x = x[np.min([surface.distance(x) for surface in wall.walls], axis=0) > 0.0]
    (hose,) = wall.inlets
    n = hose.layers(wall.spacing) * len(wall.inlet_layer(hose))
    assert len(x) >= n and n * wall.spacing**3 == pytest.approx(0.5 * hose.volume, rel=0.01)
    full = mps.measure.still(x[np.argsort(x[:, 2], kind="stable")[:n]], wall.spacing)
    measures = wall.measure(wall.unfold(full))
    wall.check(full, measures)
    bar = wall.outline[4].mean(0) * (1.0, -1.0, 1.0)
    for bad in (full.x[:-1], np.vstack([full.x[:-1], bar]), full.x * (1.0, 1.0, 0.8)):
        with pytest.raises(AssertionError):
            wall.check(mps.measure.still(bad, wall.spacing), measures)
