"""Rows for fluids without yield stress, where particle methods are known to fail, and for pools at rest."""

import numpy as np

import taichi_mps as mps

from ..problem import catalogue
from . import Measured, read_reference, row
from .fits import fitted
from .scheme import simulate


def columns(name, **wanted):
    """Reference columns as arrays, of the rows with the wanted text in some columns."""
    rows = [r for r in read_reference(name) if all(r[key] == value for key, value in wanted.items())]
    numeric = [key for key in rows[0] if key not in wanted]
    return {key: np.array([float(r[key]) for r in rows]) for key in numeric}


def still_pool(until, **keywords):
    """A pool of 10 layers: pressure error, drift of the level, and whether the motion grows in the second half."""
    sim = simulate(catalogue.load("still_pool")(spacing=0.02, until=until, **keywords))
    energy, error = [], []
    sim.each_step(lambda s: energy.append(s.report.kinetic_energy))
    sim.every(until / 20, lambda s: error.append(s.measures()["pressure_error"]))
    sim.run()
    half = len(energy) // 2
    yield Measured("pressure, relative L2, mean over the run", float(np.mean(error[1:])), 0.01)
    measures = sim.measures()
    yield Measured("drift of the level, twice that of the centre of mass", measures["mean_drift_m"] / 0.02, 0.25, "l0")
    yield Measured("highest particle over the level", measures["level_drift_m"] / 0.02, 0.25, "l0")
    yield Measured(
        "kinetic energy, second half over first", float(np.mean(energy[half:]) / np.mean(energy[1:half])), 1.0
    )


@row("still pool of water, 10 layers, 100 s", "hydrostatic pressure")
def still_pool_water():
    yield from still_pool(100.0)


@row("still pool of concrete (100 Pa, 50 Pa s), 10 layers, 100 s", "hydrostatic pressure")
def still_pool_concrete():
    yield from still_pool(100.0, density=2300.0, plastic_viscosity=50.0, yield_value=100.0)


@row("dam break, a = 0.146 m, a/l0 = 20", "Martin and Moyce (1952), a = 2.25 in, digitised +-0.05", quick=True)
def dam_break_front():
    a, known = 0.146, columns("C_dambreak_front_martin_moyce_koshizuka.csv", dataset="martin_moyce_a2.25in_n2=2")
    sim = simulate(catalogue.load("dam_break")(until=0.26))
    times, reach = [], []
    sim.every(0.01, lambda s: (times.append(s.time), reach.append(s.measures()["front_m"])))
    sim.run()
    t, reach = np.array(times) * (2 * 9.81 / a) ** 0.5, np.array(reach) / a
    at, z = known["t*sqrt(2g/a)"], known["z/a"]
    covered = (at < t[-1]) & (z < 3.9)

    def error(delay):
        return float(np.abs(np.interp(at[covered] - delay, t, reach) / z[covered] - 1).max())

    delay = min(np.linspace(0.0, 0.3, 31), key=error)
    points = f"largest relative error of {covered.sum()} points"
    yield Measured(f"front, {points}, experiment's gate {delay:.2f} sqrt(a/2g) late", error(delay), 0.05)
    yield Measured(f"front, {points}, no delay", error(0.0), 0.05)


@row("dam break, H = 0.6 m, H/l0 = 30: pressure at the far wall, sensor at 160 mm", "Buchner (2002), digitised")
def dam_break_pressure():
    height, l0 = 0.6, 0.02
    low, high = (0.0, 0.0), (5.366 * height, 1.2 * height)
    margin = 5 * l0
    scene = mps.Scene(
        name="dam break of Buchner",
        material=mps.Newtonian(density=1000.0, viscosity=1e-3),
        spacing=l0,
        fluid=mps.fill(mps.Box((0.0, 0.0), (2 * height, height)), l0),
        walls=mps.box_planes(low, high, slip=True),
        domain=((-margin, -margin), (high[0] + margin, 6 * height)),
        until=1.45,
    )
    sim = simulate(scene)
    # where the source of the reference has the sensor, 90 mm wide, its upper edge at the height named; and that height
    bands = {"over a sensor from 70 to 160 mm": (0.07, 0.16), "at 160 mm": (0.16 - 1.5 * l0, 0.16 + 1.5 * l0)}
    times, pressures = [], []

    def sensor(s):
        state = s.snapshot()
        times.append(s.time * (9.81 / height) ** 0.5)
        at_wall = state.x[:, 0] > high[0] - l0
        # a particle at the wall covers l0 of its height; what is dry has no pressure
        near = [(at_wall & (state.x[:, 1] > low) & (state.x[:, 1] < top), top - low) for low, top in bands.values()]
        pressures.append([state.p[k].sum() * l0 / wide / (1000.0 * 9.81 * height) for k, wide in near])

    sim.each_step(sensor)
    sim.run()
    known = columns("C_dambreak_pressure_buchner.csv", sensor="P1")
    grid = np.linspace(3.0, 5.0, 200)
    wanted = np.interp(grid, known["t_star"], known["p_star"]).mean()

    def hit(t, p):  # when half of the plateau is reached
        k = int(np.argmax(p > 0.5 * wanted))
        return float(np.interp(0.5 * wanted, p[k - 1 : k + 1], t[k - 1 : k + 1]))

    arrival = hit(np.array(times), np.array(pressures)[:, 0]) / hit(known["t_star"], known["p_star"])
    yield Measured("time at which half of the plateau is reached, relative error", arrival - 1, 0.03)
    for band, p in zip(bands, np.array(pressures).T, strict=True):
        plateau = float(np.interp(grid, times, p).mean() / wanted - 1)
        yield Measured(f"plateau (t* 3 to 5) {band}, relative error", plateau, 0.1)
        yield Measured(f"highest spike {band} over the experiment's", float(p.max() / known["p_star"].max()), 2.0)


@row("elliptical drop, R/l0 = 25, to A0 t = 1", "Monaghan (1994), exact")
def elliptical_drop():
    l0, exact = 0.04, columns("C_elliptical_drop.csv")
    x = mps.lattice((-1.0, -1.0), (1.0, 1.0), l0)
    x = x[np.hypot(*x.T) < 1.0]
    scene = mps.Scene(
        name="elliptical drop",
        material=mps.Newtonian(density=1000.0, viscosity=1e-6),
        spacing=l0,
        fluid=x,
        velocity=x * (1.0, -1.0),
        gravity=(0.0, 0.0),
        domain=((-4.0, -4.0), (4.0, 4.0)),
        until=1.0,
    )
    sim = simulate(scene)
    start = 0.5 * 1000.0 * l0**2 * (scene.velocity**2).sum()
    sim.run()
    u = sim.snapshot()
    end = int(np.argmin(np.abs(exact["tau"] - 1.0)))
    # the drop is an ellipse: its half axes from the second moments, a = 2 sqrt(<x^2>)
    a, b = 2 * np.sqrt((u.x**2).mean(0))
    yield Measured("long half axis, relative error", float(a / exact["a/R"][end] - 1), 0.02)
    yield Measured("short half axis, relative error", float(b / exact["b/R"][end] - 1), 0.02)
    yield Measured("kinetic energy lost", float(1 - sim.report.kinetic_energy / start), 0.05)


def rotating_square(across):
    """Waist and arms at w t = 2, what is lost, and holes. The arms of the reference are a lower bound, which says so:
    their tips are rounded off, 1.25 L with 160 elements and 1.36 L with 240."""
    l0, omega = 1.0 / across, 1.0
    x = mps.fill(mps.Box((-0.5, -0.5), (0.5, 0.5)), l0)
    scene = mps.Scene(
        name="square patch",
        material=mps.Newtonian(density=1000.0, viscosity=1e-6),
        spacing=l0,
        fluid=x,
        velocity=omega * np.column_stack([x[:, 1], -x[:, 0]]),
        gravity=(0.0, 0.0),
        domain=((-2.0, -2.0), (2.0, 2.0)),
        until=2.0,
    )
    sim = simulate(scene)
    sim.run()
    s = sim.snapshot()
    known = columns("C_square_patch_bem.csv")
    end = int(np.argmin(np.abs(known["wt"] - 2.0)))
    r, angle = np.hypot(*s.x.T), np.arctan2(s.x[:, 1], s.x[:, 0])
    sector = np.floor((angle / (2 * np.pi) + 0.5) * 60).astype(int) % 60
    reach = np.array([r[sector == k].max(initial=0.0) + 0.5 * l0 for k in range(60)])
    spin = (s.x[:, 0] * s.u[:, 1] - s.x[:, 1] * s.u[:, 0]).sum()
    spin0 = (x[:, 0] * scene.velocity[:, 1] - x[:, 1] * scene.velocity[:, 0]).sum()
    middle = mps.lattice((-0.25, -0.25), (0.25, 0.25), 0.5 * l0)
    middle = middle[np.hypot(*middle.T) < 0.25]
    gap = max(np.sqrt(((s.x - point) ** 2).sum(1).min()) for point in middle)
    yield Measured("waist, relative error", float(reach.min() / known["r_min_N240"][end] - 1), 0.1)
    yield Measured("arms shorter than a lower bound", float(max(0.0, 1 - reach.max() / known["r_max_N240"][end])), 0.1)
    yield Measured("angular momentum lost", float(1 - spin / spin0), 0.01)
    yield Measured("kinetic energy lost", float(1 - (s.u**2).sum() / (scene.velocity**2).sum()), 0.05)
    yield Measured("largest hole in the middle, radius less that of a lattice", float(gap / l0 - 0.71), 0.3, "l0")


@row("rotating square patch, L/l0 = 40, to w t = 2", "boundary elements (own)")
def square_patch():
    yield from rotating_square(40)


@row("rotating square patch, L/l0 = 60, to w t = 2", "boundary elements (own)")
def square_patch_fine():
    yield from rotating_square(60)


def cavity(reynolds, until, good, across=40):
    """Lid-driven unit cavity, no-slip walls: u on x = 0.5 against the independent solution; ``good`` is the level of
    C_where_methods_fail.json for its lowest value."""
    l0 = 1.0 / across
    box = mps.Box((0.0, 0.0), (1.0, 1.0))
    floor, left, right = mps.box_planes((0.0, 0.0), (1.0, 1.0))
    lid = mps.Plane((0.0, 1.0), (0.0, -1.0), velocity=(1.0, 0.0))
    scene = mps.Scene(
        name="cavity",
        material=mps.Newtonian(density=1.0, viscosity=1.0 / reynolds),
        spacing=l0,
        fluid=mps.fill(box, l0),
        walls=(floor, left, right, lid),
        gravity=(0.0, 0.0),
        domain=((-0.1, -0.1), (1.1, 1.1)),
        until=until,
    )
    sim = simulate(scene)
    profile, wanted = [], columns("C_lid_cavity_ghia.csv", Re=str(reynolds), component="u(x=0.5 y)")
    y, u = wanted["position"], wanted["own"]
    inside = (y > 0.5 * l0) & (y < 1 - 0.5 * l0)

    def sample(s):
        if s.time > 0.7 * until:
            state = s.snapshot()
            places = np.column_stack([np.full(inside.sum(), 0.5), y[inside]])
            profile.append(fitted(places, state.x, state.u[:, 0], l0))

    sim.every(until / 100, sample)
    sim.run()
    error = np.mean(profile, axis=0) - u[inside]
    lowest = np.argmin(u[inside])
    yield Measured(
        "u on the centre line, root mean square, over the lid's speed", float(np.sqrt((error**2).mean())), 0.02
    )
    yield Measured("its lowest, relative error", float(error[lowest] / u[inside][lowest]), good)


@row("lid-driven cavity, Re = 100, 40 across", "own solution beside Ghia et al. (1982)")
def cavity_100():
    yield from cavity(100, 15.0, 0.01)


@row("lid-driven cavity, Re = 400, 40 across", "own solution beside Ghia et al. (1982)")
def cavity_400():
    yield from cavity(400, 30.0, 0.03)


@row("lid-driven cavity, Re = 100, 100 across", "own solution beside Ghia et al. (1982)")
def cavity_100_fine():
    yield from cavity(100, 15.0, 0.01, 100)


@row("lid-driven cavity, Re = 400, 100 across", "own solution beside Ghia et al. (1982)")
def cavity_400_fine():
    yield from cavity(400, 30.0, 0.03, 100)
