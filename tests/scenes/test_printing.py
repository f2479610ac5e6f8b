"""Nozzles that move, and what is printed from them until it fails under its own weight."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import BSpline

import taichi_mps as mps
from taichi_mps.problem import catalogue
from taichi_mps.problem.problem import Problem
from taichi_mps.simulation.pouring import Pouring

PATH = ((1.0, 0.0, 0.0), (3.0, 0.4, 0.0), (4.0, 0.4, 0.1))
HOSE = mps.Inlet((0.01, 0.4), (0.0, -1.0), 0.04, rate=0.04, volume=0.2, path=PATH)
JET = {"radius": 0.04, "rate": 0.01, "volume": 0.02}


def printed(**changes):
    """A scene of the hose with these changes."""
    hoses = (replace(HOSE, **changes),)
    return mps.Scene("printed", mps.Bingham(), 0.02, None, ((-0.5, -0.1), (0.9, 0.9)), inlets=hoses)


def test_a_nozzle_goes_along_its_path_at_the_speed_of_each_part():
    assert HOSE.displacement(0.5) == pytest.approx((0.0, 0.0))
    assert HOSE.displacement(2.0) == pytest.approx((0.2, 0.0))
    assert HOSE.displacement(9.0) == pytest.approx((0.4, 0.1))
    still = replace(HOSE, path=None).velocity(0.02)
    for time, velocity in ((0.5, (0.0, 0.0)), (1.0, (0.2, 0.0)), (3.5, (0.0, 0.1)), (4.0, (0.0, 0.0))):
        assert HOSE.velocity(0.02, time) - still == pytest.approx(velocity)


def test_a_layer_enters_where_the_nozzle_is_and_goes_with_it():
    scene = printed()
    pouring = Pouring(scene, HOSE)
    pouring.entered = int(2.0 / pouring.interval)  # due at 2 s
    late = 0.25 * pouring.interval
    layer = pouring.enter(pouring.next + late, np.zeros((0, 2)))
    speed = 0.04 / 0.08
    assert layer == pytest.approx(scene.inlet_layer(HOSE) + (0.2 + 0.2 * late, -speed * late))


def test_the_first_layer_is_where_the_path_begins_and_the_jet_as_fast_as_its_fastest_part():
    """The hose of 0.5 m/s is displaced by 0.3 m at 0 s, rests, and goes along with 0.3 m/s."""
    path = np.array(((0.0, 0.3, 0.0), (1.0, 0.3, 0.0), (2.0, 0.6, 0.0)))
    scene = printed(path=path)
    hose = scene.inlets[0]
    assert scene.initial == pytest.approx(scene.inlet_layer(hose) + (0.3, 0.0))
    assert Pouring(scene, hose).speed == pytest.approx(np.hypot(0.3, 0.5))


def mouth(**keywords):
    return mps.Inlet((0.1, 0.0, 0.5), **({"direction": (-1.0, 0.0, 0.0), "height": 0.03} | keywords), **JET)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: replace(HOSE, path=((0.0, 0.0, 0.0),)), "must be two rows or more of a time"),
        (lambda: replace(HOSE, path=((1.0, 0.0, 0.0), (1.0, 0.1, 0.0))), "of a time .s., which grows"),
        (lambda: replace(HOSE, path=((0.0, 0.0), (1.0, 0.1))), "and 2 displacements"),
        (
            lambda: replace(HOSE, path=((0.0, 0.0, 0.0), (1.0, np.inf, 0.0))),
            r"path = .* s and m: must be finite numbers",
        ),
        (lambda: replace(HOSE, path="along"), "path = along: must be finite numbers"),
        (
            lambda: Problem(printed(path=((0.0, 0.0, 0.0), (1e-6, 0.4, 0.0))), mps.Implicit()),
            "inlet: path: moves with the jet at 4e.05 m/s; must be at most 100 m/s",
        ),
        (lambda: replace(HOSE, height=0.03), "height = 0.03 m: must be left out in 2-D"),
        (lambda: mouth(height=0.0), "height = 0.0 m: must be greater than 0 m"),
        (lambda: mouth(height=0.004).layer(0.005), "height = 0.004 m: must be 1 to 1000 times spacing = 0.005 m"),
        (
            lambda: catalogue.build("printing", model="path", layer_height=0.012),
            "layer_height = 0.012 m: must be a whole number of spacings",
        ),
    ],
)
def test_a_path_or_a_height_that_is_none_is_refused(make, message):
    with pytest.raises(mps.SceneError, match=message):
        make()


def test_a_rectangular_mouth_is_as_wide_and_high_as_it_is_said():
    """Upright is what is most upright of the two directions across."""
    for direction in ((-1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (1.0, 0.0, -1.0), (1.0, 2.0, 3.0)):
        inlet = mouth(direction=direction)
        x = inlet.layer(0.01) - inlet.centre
        along = inlet.unit_direction
        level = np.cross(along, (0.0, 0.0, 1.0)) / np.hypot(*along[:2])
        assert np.allclose(x @ along, -0.005) and inlet.layer_volume(0.01) == pytest.approx(0.08 * 0.03 * 0.01)
        assert np.ptp(x @ level) == pytest.approx(0.07) and np.ptp(x @ np.cross(level, along)) == pytest.approx(0.02)


@pytest.mark.slow
def test_a_nozzle_that_goes_to_and_fro_lays_even_layers():
    """What stands on each part of the path is the section of the nozzle times the layers, as high everywhere."""
    scene = catalogue.build("printing", model="path", layers=2, layer_time=0.5, length=0.1)
    sim = mps.Simulation(scene)
    sim.run()
    s, l0 = sim.snapshot(), scene.spacing
    parts = np.arange(0.0, 0.1 + l0, 4.0 * l0)
    counts, _ = np.histogram(s.x[:, 0], parts)
    assert 2.0 * counts * l0**3 / np.diff(parts) == pytest.approx(0.04 * 0.02, rel=0.03)
    tops = [s.x[(s.x[:, 0] > a) & (s.x[:, 0] < a + 4.0 * l0), 2].max() + 0.5 * l0 for a in parts[:-1]]
    assert np.mean(tops) == pytest.approx(0.02, rel=0.03) and np.std(tops) < 0.03 * 0.01
    scene.check(s, sim.measures())


def test_there_is_room_for_as_many_layers_as_the_default_has():
    problem = Problem(catalogue.build("printing", model="path"), mps.Implicit())
    assert problem.height == pytest.approx(0.25)


def failure_height(**keywords):
    """Printed height [m] at which the foot has become 1 % wider, and that before the last particle on top."""
    scene = catalogue.build("printing", floor="smooth", **keywords)
    sim, rows = mps.Simulation(scene), []
    sim.each_step(lambda sim: rows.append({"time_s": sim.time} | sim.measures()))
    sim.run()
    scene.check(sim.snapshot(), sim.measures())
    found = scene.over_time({key: np.array([row[key] for row in rows]) for key in rows[0]})["failure_height_m"]
    return found, found - scene.spacing


@pytest.mark.parametrize("structuration", [pytest.param(0.0, marks=pytest.mark.long), 80.0])
def test_a_printed_wall_fails_at_twice_its_yield_stress(structuration):
    """Between rho g H = 2 tau_y, what the material of the foot bears in plane strain, and the mechanism of two planes
    at 45 degrees from the middle of the foot, a quarter of the width more; tau_y with what it has grown by then. A foot
    that is 1 % wider bears 1 % more."""
    tau_y, width, rise, weight = 1000.0, 0.04, 0.02, 2300.0 * 9.81
    mix = {"yield_value": tau_y, "structuration": structuration, "destructuration": 0.0, "layer_time": 0.5}
    failed, stood = failure_height(layers=16 if structuration else 11, **mix)
    spare = weight - 2.0 * structuration / rise
    assert 2.0 * tau_y / spare < failed and stood < 1.01 * (2.0 * tau_y + 0.25 * weight * width) / spare


def splines(count, length, grade):
    """Gauss points and weights (q,) over 0..length; values, first and second derivatives (q, count) of cubic B-splines
    there, whose knots are closer towards 0 if ``grade`` is above 1."""
    knots = length * np.linspace(0.0, 1.0, count - 2) ** grade
    at, weights = np.polynomial.legendre.leggauss(4)
    middle, half = 0.5 * (knots[1:] + knots[:-1])[:, None], 0.5 * np.diff(knots)[:, None]
    x = (middle + half * at).ravel()
    basis = BSpline(np.pad(knots, 3, mode="edge"), np.eye(count), 3)
    return x, (half * weights).ravel(), *(basis(x, k) for k in range(3))


def column_height(radius, ratio):
    """Upper bound of the height [m] up to which a column of this radius [m] stands on a smooth floor; ratio =
    tau_y/(rho g) [m].

    Over the velocities u_r = -r phi_z, u_z = 2 phi + r phi_r, free of divergence, that rest on the floor and are rigid
    above the zone Z, with u_z = -1 there, H = Z + [ratio int sqrt(2 D:D) dV + int u_z dV]/(pi R^2) is least. The root
    is that of 2 D:D + e^2, e towards 0, by weighted least squares again and again: none of them raises H.
    """
    across, along, zone = 5, 20, 3.0**0.5 * ratio
    r, r_weights, *a = splines(across, radius, 0.7)
    z, z_weights, *b = splines(along, zone, 1.5)
    r = np.repeat(r, len(z))[:, None]
    volume = np.kron(r_weights, z_weights) * r[:, 0] * 2.0 / radius**2  # over pi R^2
    orders = (0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (0, 2)
    phi, phi_r, phi_rr, phi_z, phi_rz, phi_zz = (np.kron(a[i], b[j]) for i, j in orders)
    radial, shear = phi_z + r * phi_rz, 3.0 * phi_r + r * (phi_rr - phi_zz)  # -D_rr and 2 D_rz; -D_tt is phi_z
    rates = np.stack([2.0**0.5 * radial, 2.0**0.5 * phi_z, 2.0**0.5 * (phi_z + radial), shear])  # as long as the root
    falling = volume @ (2.0 * phi + r * phi_r)
    x = np.tile(-0.5 * np.clip(3.0 * np.linspace(0.0, 1.0, along) ** 1.5, 0.0, 1.0), across)
    free = np.arange(across * along).reshape(across, along)[:, 1:-2].ravel()
    for e in np.geomspace(0.3, 1e-5, 60) / zone:
        size = np.sqrt(((rates @ x) ** 2).sum(0) + e**2)
        matrix = ratio * np.einsum("kqi,q,kqj->ij", rates, volume / size, rates, optimize=True)
        x[free] -= np.linalg.solve(matrix[np.ix_(free, free)], (matrix @ x + falling)[free])
    return zone + ratio * volume @ np.linalg.norm(rates @ x, axis=0) + falling @ x


@pytest.mark.slow
def test_a_printed_column_fails_between_its_bounds():
    """Between rho g H = sqrt(3) tau_y, 76.8 mm, what each of its sections bears, and the mechanism of least resistance,
    86.4 mm. A foot that is 1 % wider bears 2 % more."""
    failed, stood = failure_height(model="column", yield_value=1000.0, layers=10, layer_time=0.5)
    ratio = 1000.0 / (2300.0 * 9.81)
    assert failed > 3.0**0.5 * ratio and stood < 1.01**2 * column_height(0.02, ratio)


@pytest.mark.parametrize(
    ("hose", "ends"), [("rising", {0.0}), pytest.param("moving", {0.0, 0.34}, marks=pytest.mark.slow)]
)
def test_a_hose_stays_near_the_concrete_in_a_high_form(hose, ends):
    """300 mm above the mean level of what has been poured, up to its place above the form, and along all of it."""
    fits = {"hose_diameter": 0.1, "bar_diameter": 0.01, "cover": 0.025, "bar_distance": 0.9}
    scene = catalogue.build("wall", spacing=0.03, length=0.5, height=0.9, fill_ratio=1.0, hose=hose, **fits)
    inlet = scene.inlets[0]
    time = inlet.volume / inlet.rate
    for share in (0.0, 0.3, 0.6):
        mouth = inlet.centre[2] + inlet.displacement(share * time)[2]
        assert mouth == pytest.approx(0.9 * share + 0.3, abs=0.04)
    assert inlet.displacement(time)[2] == pytest.approx(0.0)
    assert {round(float(x), 6) for x in inlet.turns[:, 1]} == ends
    assert np.all(inlet.turns[:, 2] == 0.0)
