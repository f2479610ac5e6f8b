"""Films on a slope and flows between two plane walls, all with the defaults of the scheme.

Where a row caps the time step, its ``case`` says so. Concrete-like numbers throughout: 2300 kg/m3, 50 to 100 Pa s.
Errors of profiles are |u - u_exact|/|u_exact| in the L2 norm over all particles, from the last state of the run.
"""

from functools import partial

import numpy as np

import taichi_mps as mps
from taichi_mps.input import catalogue

from . import L2_ERROR, Measured, columns, record, run, simulate

DENSITY, ETA, DEPTH, G = 2300.0, 100.0, 0.1, 9.81  # kg/m3, Pa s, m, m/s2
SLOPE_WEIGHT = DENSITY * G * float(np.sin(np.radians(10.0)))  # of a film on a slope of 10 degrees, along it [N/m3]
RATIONAL_ERROR = 0.01  # e of the rule of the rational critical strain rate (docs/equations.md, R1 to R4)


# ---- exact, and errors ----------------------------------------------------------------------------------------
def profile(y, weight, eta, tau_y, depth=DEPTH, knee_rate=1e-9):
    """Exact velocity [m/s] at height y [m] over a no-slip wall, shear stress weight (depth - y) [Pa]: two parabolas
    that meet where it equals tau_y + eta knee_rate. Above, the viscosity is eta + tau_y/knee_rate (a plug as the
    knee rate [1/s] goes to 0)."""
    knee = max(0.0, depth - (tau_y + eta * knee_rate) / weight)
    low, high = np.minimum(y, knee), np.maximum(y, knee)
    flowing = (weight * (depth * low - 0.5 * low**2) - tau_y * low) / eta
    return flowing + 0.5 * weight * ((depth - knee) ** 2 - (depth - high) ** 2) / (eta + tau_y / knee_rate)


def l2(u, exact) -> float:
    """Relative L2 error of a velocity u."""
    return float(np.linalg.norm(u - exact) / np.linalg.norm(exact))


def developed(scene, exact):
    """A flow along x after 2 s, and its exact velocities, ``exact(y)``."""
    s = run(scene, 2.0).snapshot()
    return s, exact(s.x[:, 1])


def order_numbers(flow, curve: str):
    """``flow`` (of the particles across) gives a snapshot and the exact velocities along x: these at 40 across; the L2
    error at 20 across, and by how much the order from 10 to 40 across falls short of 1.5."""
    found = {across: flow(across) for across in (10, 20, 40)}
    errors = {across: l2(s.u[:, 0], exact) for across, (s, exact) in found.items()}
    order = np.log2(errors[10] / errors[40]) / 2.0
    what = f"1.5 - order of convergence ({order:.2f} from 10 to 40 across)"
    return found[40], [
        {"quantity": L2_ERROR, "curve": curve, "x": list(errors), "y": list(errors.values())},
        Measured("L2 error at 20 across", errors[20], 0.02),
        Measured(what, max(0.0, float(1.5 - order)), 0.0),
    ]


def plug_number(what, s, plug, exact):
    """Error of the mean speed of the ``plug``, a choice of particles, whose exact speeds are given."""
    return Measured(f"{what} at 40 across, relative error", float(s.u[plug, 0].mean() / exact) - 1.0, 0.01)


# ---- films ----------------------------------------------------------------------------------------------------
def film_scene(across, tau_y, weight=SLOPE_WEIGHT, depth=DEPTH, eta=ETA, pi_c=None) -> mps.Scene:
    """Film on the incline on which it has this weight [N/m3] along it, at rest."""
    law = {"yield_value": tau_y, "plastic_viscosity": eta, "critical_strain_rate": pi_c}
    angle = float(np.degrees(np.arcsin(weight / (DENSITY * G))))
    return catalogue.build("film", spacing=depth / across, angle=angle, depth=depth, **law)


def film(across, tau_y, weight=SLOPE_WEIGHT, depth=DEPTH, eta=ETA, pi_c=None):
    """A film after 2 s (8.7 rho H^2/eta of the usual one), and its exact velocities."""
    exact = {"weight": weight, "eta": eta, "tau_y": tau_y, "depth": depth, "knee_rate": 2.0 * pi_c if pi_c else 1e-9}
    return developed(film_scene(across, tau_y, weight, depth, eta, pi_c), lambda y: profile(y, **exact))


def film_orders(bingham_number):
    """Errors at 10, 20, 40 across; Bn = tau_y/(rho g sin(angle) H)."""
    tau_y = bingham_number * SLOPE_WEIGHT * DEPTH
    (s, exact), numbers = order_numbers(lambda across: film(across, tau_y), f"film, Bn = {bingham_number:g}")
    top = s.x[:, 1] > (DEPTH - tau_y / SLOPE_WEIGHT if tau_y else DEPTH - s.spacing)
    return [*numbers, plug_number("plug speed" if tau_y else "speed of the top layer", s, top, exact[top].mean())]


def film_bi_viscosity():
    law = {"tau_y": 100.0, "depth": 0.05, "eta": 50.0, "pi_c": 0.1}
    _, numbers = order_numbers(lambda across: film(across, weight=8000.0, **law), "bi-viscosity film")
    s, exact = film(20, weight=4000.0, **law)
    return [*numbers, Measured("L2 error at 20 across, 4000 Pa/m", l2(s.u[:, 0], exact), 0.02)]


def film_at_yield():
    """Below, it must stand; above, a layer of H/21 (1.9 particles at 40 across) is sheared, and the speed varies by a
    tenth from instant to instant: the mean over 2 s, in which the plug slides by a third of a spacing."""
    sim = simulate(film_scene(20, SLOPE_WEIGHT * DEPTH / 0.95))
    for t in (2.0, 10.0):
        sim.run(until=t)
        yield Measured(f"largest speed after {t:g} s at 0.95", float(sim.snapshot().speed.max()), 1e-6, "m/s")
    tau_y = SLOPE_WEIGHT * DEPTH / 1.05
    sim, speeds = simulate(film_scene(40, tau_y)), []
    for t in np.linspace(3.0, 5.0, 21):
        sim.run(until=float(t))
        s = sim.snapshot()
        speeds.append(s.u[s.x[:, 1] > 0.5 * DEPTH, 0].mean())
    exact = float(profile(DEPTH, SLOPE_WEIGHT, ETA, tau_y))
    what = f"plug speed at 1.05 ({1e3 * exact:.3g} mm/s), mean of 3 to 5 s, relative error"
    yield Measured(what, float(np.mean(speeds)) / exact - 1.0, 0.05)


def rational_film():
    """Error of the rational rule and of the scheme together, beside the true Bingham material. Speeds are means over
    the upper quarter of a film 20 particles deep, after T = 2 s."""

    def speeds(share):
        tau_y = share * SLOPE_WEIGHT * DEPTH
        pi_c = mps.rational_critical_strain_rate(
            plastic_viscosity=ETA, yield_value=tau_y, time=2.0, error=RATIONAL_ERROR
        )
        s, _ = film(20, tau_y, pi_c=pi_c)
        top = s.x[:, 1] > 0.75 * DEPTH
        return float(s.u[top, 0].mean()), float(profile(s.x[top, 1], SLOPE_WEIGHT, ETA, tau_y).mean())

    (plug, exact), (creep, _) = speeds(0.5), speeds(1.0 / 0.95)
    return [
        Measured("plug speed at tau_y = 0.5 of the wall stress, relative error", plug / exact - 1.0, 0.01),
        Measured("creep in T at a wall stress of 0.95 tau_y, over H", creep * 2.0 / DEPTH, RATIONAL_ERROR),
    ]


def film_viscosity_ratio():
    """Unyielded material is a million times as viscous as flowing material."""
    tau_y = 0.3 * SLOPE_WEIGHT * DEPTH
    s, exact = film(20, tau_y, pi_c=0.5 * (tau_y / (ETA * 999999.0)))
    plug = s.u[s.x[:, 1] > 0.75 * DEPTH, 0]  # it is 0.3 H thick: its particles move as one
    return [
        Measured("L2 error", l2(s.u[:, 0], exact), 0.02),
        Measured("difference of speed in the plug, over its speed", float(np.ptp(plug) / exact.max()), 0.01),
    ]


# ---- between walls --------------------------------------------------------------------------------------------
def between_walls(spacing, gap, material, push=0.0, wall_speed=0.0, start=None) -> mps.Scene:
    """Fluid between y = 0 and gap [m], periodic along x, pushed by a body force [m/s2]; the upper wall moves.
    ``start``: velocity [m/s] along x at heights y [m]."""
    high = (10 * spacing, gap)
    x = mps.lattice((0.0, 0.0), np.array(high) - 0.5 * spacing, spacing)
    lid = mps.Plane(high, (0.0, -1.0), velocity=(wall_speed, 0.0) if wall_speed else None)
    return mps.Scene(
        name="channel",
        material=material,
        spacing=spacing,
        fluid=x,
        velocity=None if start is None else np.column_stack([start(x[:, 1]), np.zeros(len(x))]),
        walls=(mps.Plane((0.0, 0.0), (0.0, 1.0)), lid),
        domain=((0.0, -spacing), (high[0], gap + spacing)),
        periodic=(True, False),
        gravity=(push, 0.0),
    )


HALF = 0.5 * DEPTH  # of the channels [m]


def channel(across):
    """A Bingham channel whose wall stress is 1/0.3 of its yield stress: the scene, and its exact velocity at y [m]."""
    eta, weight = 50.0, 8000.0
    tau_y = 0.3 * weight * HALF
    material = mps.Bingham(density=DENSITY, plastic_viscosity=eta, yield_value=tau_y)
    scene = between_walls(DEPTH / across, DEPTH, material, push=weight / DENSITY)
    return scene, lambda y: profile(HALF - np.abs(y - HALF), weight, eta, tau_y, HALF)


def channel_bingham():
    (s, exact), numbers = order_numbers(lambda across: developed(*channel(across)), "channel, Bn = 0.3")
    return [*numbers, plug_number("plug speed", s, np.abs(s.x[:, 1] - HALF) < 0.3 * HALF, exact.max())]


def couette():
    scene = between_walls(DEPTH / 20, DEPTH, mps.Newtonian(density=DENSITY, viscosity=50.0), wall_speed=0.2)
    s = run(scene, 1.0).snapshot()
    return [Measured("L2 error at 20 across", l2(s.u[:, 0], 0.2 * s.x[:, 1] / DEPTH), 0.02)]


def cessation(flow):
    """Developed flow, then the drive stops: when it is at rest. Constants: length H (half width of the channel, gap of
    Couette), speed V = tau_y H/(eta Bn), time rho H^2/eta."""
    reference, length, speed = columns("B_cessation_summary.csv", flow=flow), 0.05, 0.1
    for bn, pressure, stop in zip(reference["Bn"], reference["G0"], reference["T_stop"], strict=True):
        tau_y, weight = bn * ETA * speed / length, pressure * (ETA * speed / length**2)
        gap, start = length, lambda y: speed * y / length
        if flow == "poiseuille":
            exact = partial(profile, weight=weight, eta=ETA, tau_y=tau_y, depth=length)
            gap, start = 2 * length, lambda y, exact=exact: exact(length - np.abs(y - length))
        material, time = (
            mps.Bingham(density=DENSITY, plastic_viscosity=ETA, yield_value=tau_y),
            stop * (DENSITY * length**2 / ETA),
        )
        scene = between_walls(length / 20, gap, material, start=start)
        _, times, speeds = record(scene, lambda s: s.report.max_speed, until=2.0 * time, max_time_step=time / 200)
        found = np.append(times[speeds < 1e-3 * speed], np.inf)[0] / time - 1.0
        yield Measured(f"stopping time at Bn = {bn:g}, relative error", found, 0.05)
        yield Measured(f"largest speed at 2 T_stop, Bn = {bn:g}", speeds[-1] / speed, 1e-4, "V")


def order_in_time():
    """Plug speed after 0.48 T against the reference (1-D, dt = T/500). The push is weak, so that no particle moves by
    more than 0.01 l0 in a step and the error of the spacing is the same in all runs."""
    weight, until = 20.0, 0.48  # N/m3, T
    time = DENSITY * HALF**2 / ETA
    for bn, pressure in ((0.0, 3.0), (1.0, 4.0)):
        wanted = columns("B_startup_poiseuille.csv", Bn=bn, G=pressure, t=until)["u_plug"][0]
        speed = weight * HALF**2 / (pressure * ETA)
        material = mps.Bingham(density=DENSITY, plastic_viscosity=ETA, yield_value=bn * ETA * speed / HALF)
        scene, errors = between_walls(HALF / 20, DEPTH, material, weight / DENSITY), []
        for steps in (25, 50, 100):
            s = run(scene, until * time, time / steps).snapshot()
            errors.append(float(s.u[np.abs(s.x[:, 1] - HALF) < s.spacing, 0].mean() / speed / wanted - 1))
        order = float(np.log2(abs(errors[0] / errors[-1])) / 2)
        listed = ", ".join(f"{100 * e:.2f} %" for e in errors)
        yield Measured(f"0.9 - order ({order:.2f}, errors {listed}), Bn = {bn:g}", max(0.0, 0.9 - order), 0.0)
