"""Fluids without yield stress, where particle methods are known to fail: pools at rest, dam breaks, free bodies."""

import numpy as np

import taichi_mps as mps
from taichi_mps.input import catalogue

from . import Measured, columns, flows, record, run, simulate

COLUMN = 0.146  # width of the column of water of Martin and Moyce [m]


# ---- pools and dam breaks -------------------------------------------------------------------------------------
def still_pool(**keywords):
    """A pool of 10 layers, 100 s: pressure error, drift of the level, and whether the motion grows in the second
    half."""
    sim = simulate(catalogue.build("still_pool", spacing=0.02, until=100.0, **keywords))
    energy, error = [], []
    sim.each_step(lambda s: energy.append(s.report.kinetic_energy))
    sim.every(5.0, lambda s: error.append(s.measures()["pressure_error"]))
    sim.run()
    half, drift = len(energy) // 2, sim.measures()
    growth = float(np.mean(energy[half:]) / np.mean(energy[1:half]))
    return [
        Measured("pressure, relative L2, mean over the run", float(np.mean(error[1:])), 0.01),
        Measured("drift of the level, twice that of the centre of mass", drift["mean_drift_m"] / 0.02, 0.25, "l0"),
        Measured("highest particle over the level", drift["level_drift_m"] / 0.02, 0.25, "l0"),
        Measured("kinetic energy, second half over first", growth, 1.0),
    ]


def front_errors(times, front):
    """Errors of the front [m] at these times [s] beside Martin and Moyce, whose column is COLUMN wide, up to the wall:
    the largest relative error as a function of the delay of their gate [sqrt(a/2g)], the delay up to 0.3 with which it
    is least, and how many points were compared."""
    reference = columns("C_dambreak_front_martin_moyce_koshizuka.csv", dataset="martin_moyce_a2.25in_n2=2")
    t, reach = np.asarray(times) * (2 * 9.81 / COLUMN) ** 0.5, np.asarray(front) / COLUMN
    at, z = reference["t*sqrt(2g/a)"], reference["z/a"]
    covered = (at < t[-1]) & (z < 3.9)

    def error(delay):
        return float(np.abs(np.interp(at[covered] - delay, t, reach) / z[covered] - 1).max())

    return error, float(min(np.linspace(0.0, 0.3, 31), key=error)), covered.sum()


def dam_break_front():
    _, times, front = record(catalogue.build("dam_break", until=0.26), lambda s: s.measures()["front_m"], 0.01)
    error, delay, number = front_errors(times, front)
    what = f"front, largest relative error of {number} points"
    return [
        Measured(f"{what}, experiment's gate {delay:.2f} sqrt(a/2g) late", error(delay), 0.05),
        Measured(f"{what}, no delay", error(0.0), 0.05),
    ]


def dam_break_pressure():
    height, l0 = 0.6, 0.02
    wide, margin = 5.366 * height, 5 * l0
    scene = mps.Scene(
        name="dam break of Buchner",
        material=mps.Newtonian(density=1000.0, viscosity=1e-3),
        spacing=l0,
        fluid=mps.fill(mps.Box((0.0, 0.0), (2 * height, height)), l0),
        walls=mps.box_planes((0.0, 0.0), (wide, 1.2 * height), slip=True),
        domain=((-margin, -margin), (wide + margin, 6 * height)),
        until=1.45,
    )
    # where the source of the reference has the sensor, 90 mm wide, its upper edge at the height named; and that height
    bands = {"over a sensor from 70 to 160 mm": (0.07, 0.16), "at 160 mm": (0.16 - 1.5 * l0, 0.16 + 1.5 * l0)}

    def sensor(s):
        state = s.snapshot()
        at_wall = state.x[:, 0] > wide - l0
        # a particle at the wall covers l0 of its height; what is dry has no pressure
        near = [(at_wall & (state.x[:, 1] > low) & (state.x[:, 1] < top), top - low) for low, top in bands.values()]
        return [state.p[k].sum() * l0 / tall / (1000.0 * 9.81 * height) for k, tall in near]

    _, times, pressures = record(scene, sensor)
    times = times * (9.81 / height) ** 0.5
    reference, grid = columns("C_dambreak_pressure_buchner.csv", sensor="P1"), np.linspace(3.0, 5.0, 200)
    wanted = np.interp(grid, reference["t_star"], reference["p_star"]).mean()

    def hit(t, p):  # when half of the plateau is reached
        k = int(np.argmax(p > 0.5 * wanted))
        return float(np.interp(0.5 * wanted, p[k - 1 : k + 1], t[k - 1 : k + 1]))

    arrival = hit(times, pressures[:, 0]) / hit(reference["t_star"], reference["p_star"])
    yield Measured("time at which half of the plateau is reached, relative error", arrival - 1, 0.03)
    for band, p in zip(bands, pressures.T, strict=True):
        plateau = np.interp(grid, times, p).mean() / wanted - 1
        yield Measured(f"plateau (t* 3 to 5) {band}, relative error", float(plateau), 0.1)
        yield Measured(f"highest spike {band} over the experiment's", float(p.max() / reference["p_star"].max()), 2.0)


# ---- free bodies ----------------------------------------------------------------------------------------------
def free_body(name, x, u, spacing, room, density=1000.0, viscosity=1e-6) -> mps.Scene:
    """Particles that move as they were left, without gravity and walls; ``room``: half of the domain's width [m]."""
    material, d = mps.Newtonian(density=density, viscosity=viscosity), x.shape[1]
    return mps.Scene(name, material, spacing, x, ((-room,) * d, (room,) * d), velocity=u, gravity=(0.0,) * d)


def spin(x, u) -> float:
    """Sum of the angular momenta, of unit masses, about z."""
    return (x[:, 0] * u[:, 1] - x[:, 1] * u[:, 0]).sum()


def elliptical_drop():
    l0, exact = 0.04, columns("C_elliptical_drop.csv", tau=1.0)
    x = mps.lattice((-1.0, -1.0), (1.0, 1.0), l0)
    x = x[np.hypot(*x.T) < 1.0]
    scene = free_body("elliptical drop", x, x * (1.0, -1.0), l0, 4.0)
    start = 0.5 * 1000.0 * l0**2 * (scene.velocity**2).sum()
    sim = run(scene, 1.0)
    # the drop is an ellipse: its half axes from the second moments, a = 2 sqrt(<x^2>)
    a, b = 2 * np.sqrt((sim.snapshot().x ** 2).mean(0))
    return [
        Measured("long half axis, relative error", float(a / exact["a/R"][0] - 1), 0.02),
        Measured("short half axis, relative error", float(b / exact["b/R"][0] - 1), 0.02),
        Measured("kinetic energy lost", float(1 - sim.report.kinetic_energy / start), 0.05),
    ]


def square_patch(across):
    """Waist and arms at w t = 2, what is lost, and holes. The arms of the reference are a lower bound, which says so:
    their tips are rounded off, 1.25 L with 160 elements and 1.36 L with 240."""
    l0 = 1.0 / across
    x = mps.fill(mps.Box((-0.5, -0.5), (0.5, 0.5)), l0)
    scene = free_body("square patch", x, np.column_stack([x[:, 1], -x[:, 0]]), l0, 2.0)
    s, reference = run(scene, 2.0).snapshot(), columns("C_square_patch_bem.csv", wt=2.0)
    r, angle = np.hypot(*s.x.T), np.arctan2(s.x[:, 1], s.x[:, 0])
    sector = np.floor((angle / (2 * np.pi) + 0.5) * 60).astype(int) % 60
    reach = np.array([r[sector == k].max(initial=0.0) + 0.5 * l0 for k in range(60)])
    middle = mps.lattice((-0.25, -0.25), (0.25, 0.25), 0.5 * l0)
    middle = middle[np.hypot(*middle.T) < 0.25]
    gap = max(np.sqrt(((s.x - point) ** 2).sum(1).min()) for point in middle)
    return [
        Measured("waist, relative error", float(reach.min() / reference["r_min_N240"][0] - 1), 0.1),
        Measured("arms shorter than a lower bound", float(max(0.0, 1 - reach.max() / reference["r_max_N240"][0])), 0.1),
        Measured("angular momentum lost", float(1 - spin(s.x, s.u) / spin(x, scene.velocity)), 0.01),
        Measured("kinetic energy lost", float(1 - (s.u**2).sum() / (scene.velocity**2).sum()), 0.05),
        Measured("largest hole in the middle, radius less that of a lattice", float(gap / l0 - 0.71), 0.3, "l0"),
    ]


def rotation(dimension, across):
    """Rate at which a free body in rigid rotation loses (> 0) or gains angular momentum L, over 0.1 R^2/nu, in
    nu/R^2, at omega R^2/nu = 1 (Courant steps of 0.02/omega); and with the time step capped to 1/200 of that time."""
    radius, nu = 0.1, flows.ETA / flows.DENSITY
    spacing, time, omega = radius / across, 0.1 * radius**2 / nu, nu / radius**2
    x = mps.lattice((-radius,) * dimension, (radius - 0.5 * spacing,) * dimension, spacing)
    x = x[np.linalg.norm(x, axis=1) < radius]
    u = omega * np.column_stack([-x[:, 1], x[:, 0], np.zeros(len(x))])[:, :dimension]
    for cap in (None, time / 200):
        sim = run(free_body("rotation", x, u, spacing, 2 * radius, flows.DENSITY, flows.ETA), time, cap)
        s = sim.snapshot()
        what = "time step capped" if cap else f"{sim.steps} steps"
        lost = float(1.0 - spin(s.x, s.u) / spin(x, u)) / 0.1
        yield Measured(f"loss of angular momentum, {what}", lost, 1e-3, "nu/R^2")
