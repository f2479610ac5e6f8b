"""Rows on plane flows, yielding, standing columns and rotation, all with the defaults of the scheme.

Where a row caps the time step, its ``case`` says so. Concrete-like numbers throughout: 2300 kg/m3, 50 to 100 Pa s.
Errors of profiles are |u - u_exact|/|u_exact| in the L2 norm over all particles, from the last state of the run.
"""

import numpy as np

import taichi_mps as mps

from ..problem import catalogue
from . import L2_ERROR, Measured, Series, read_reference, row
from .scheme import simulate

DENSITY, ETA, DEPTH, G = 2300.0, 100.0, 0.1, 9.81  # kg/m3, Pa s, m, m/s2
SLOPE_WEIGHT = DENSITY * G * float(np.sin(np.radians(10.0)))  # of a film on a slope of 10 degrees, along it [N/m3]
CLOSED = "closed form"


# ---- helpers --------------------------------------------------------------------------------------------------
def profile(y, weight, eta, tau_y, depth=DEPTH, knee_rate=1e-9):
    """Exact velocity [m/s] at height y [m] over a no-slip wall, shear stress weight (depth - y) [Pa]: two parabolas
    that meet where it equals tau_y + eta knee_rate. Above, the viscosity is eta + tau_y/knee_rate (a plug as the
    knee rate [1/s] goes to 0)."""
    knee = max(0.0, depth - (tau_y + eta * knee_rate) / weight)
    low, high = np.minimum(y, knee), np.maximum(y, knee)
    flowing = (weight * (depth * low - 0.5 * low**2) - tau_y * low) / eta
    return flowing + 0.5 * weight * ((depth - knee) ** 2 - (depth - high) ** 2) / (eta + tau_y / knee_rate)


def l2(u, exact) -> float:
    """Relative L2 error."""
    return float(np.linalg.norm(u - exact) / np.linalg.norm(exact))


def run_film(across, bingham_number, until, pi_c=None, depth=DEPTH, angle=10.0, eta=ETA):
    """Film on an incline from rest: snapshot and slope weight [N/m3]; Bn = tau_y/(rho g sin(angle) H)."""
    weight = DENSITY * G * float(np.sin(np.radians(angle)))
    tau_y = bingham_number * weight * depth
    keywords = {"yield_value": tau_y, "plastic_viscosity": eta, "critical_strain_rate": pi_c, "depth": depth}
    sim = simulate(catalogue.build("film", spacing=depth / across, angle=angle, **keywords))
    sim.run(until=until)
    return sim.snapshot(), weight, tau_y


def order_numbers(errors: dict[int, float], curve: str):
    """L2 error at 20 across, and by how much the order from 10 to 40 across falls short of 1.5."""
    yield Series(L2_ERROR, curve, tuple(errors), tuple(errors.values()))
    yield Measured("L2 error at 20 across", errors[20], 0.02)
    order = np.log2(errors[10] / errors[40]) / 2.0
    yield Measured(f"1.5 - order of convergence ({order:.2f} from 10 to 40 across)", max(0.0, float(1.5 - order)), 0.0)


def between_walls(spacing, gap, material, until, push=0.0, wall_speed=0.0, start=None, max_time_step=None):
    """Fluid between y = 0 and gap [m], periodic along x, pushed by a body force [m/s2]; the upper wall moves."""
    high = (10 * spacing, gap)
    moving = (wall_speed, 0.0) if wall_speed else None
    x = mps.lattice((0.0, 0.0), np.array(high) - 0.5 * spacing, spacing)
    scene = mps.Scene(
        name="channel",
        material=material,
        spacing=spacing,
        fluid=x,
        velocity=None if start is None else np.column_stack([start(x[:, 1]), np.zeros(len(x))]),
        walls=(mps.Plane((0.0, 0.0), (0.0, 1.0)), mps.Plane(high, (0.0, -1.0), velocity=moving)),
        domain=((0.0, -spacing), (high[0], gap + spacing)),
        periodic=(True, False),
        gravity=(push, 0.0),
    )
    sim = simulate(scene, max_time_step)
    if until is not None:
        sim.run(until=until)
    return sim


# ---- films ----------------------------------------------------------------------------------------------------
def film_numbers(bingham_number):
    """Errors at 10, 20, 40 across after 2 s (8.7 rho H^2/eta), from rest."""
    errors = {}
    for across in (10, 20, 40):
        s, weight, tau_y = run_film(across, bingham_number, 2.0)
        exact = profile(s.x[:, 1], weight, ETA, tau_y)
        errors[across] = l2(s.u[:, 0], exact)
    yield from order_numbers(errors, f"film, Bn = {bingham_number:g}")
    top = s.x[:, 1] > (DEPTH - tau_y / weight if tau_y else DEPTH - s.spacing)
    what = "plug speed" if tau_y else "speed of the top layer"
    yield Measured(f"{what} at 40 across, relative error", float(s.u[top, 0].mean() / exact[top].mean()) - 1.0, 0.01)


@row("Newtonian film on 10 degrees, H = 0.1 m, 100 Pa s, after 2 s", CLOSED)
def film_newtonian():
    yield from film_numbers(0.0)


@row("Bingham film, the same, tau_y = 0.2 rho g sin H", CLOSED)
def film_bingham_02():
    yield from film_numbers(0.2)


@row("Bingham film, the same, tau_y = 0.5 rho g sin H", CLOSED)
def film_bingham_05():
    yield from film_numbers(0.5)


@row("bi-viscosity film, H = 0.05 m, 50 Pa s, 100 Pa, 2 pi_c = 0.2 1/s, 8000 and 4000 Pa/m, after 2 s",
     "B_poiseuille_bingham_biviscosity.csv and closed form")  # fmt: skip
def film_bi_viscosity():
    depth, eta, tau_y, knee_rate = 0.05, 50.0, 100.0, 0.2
    for table in read_reference("B_poiseuille_bingham_biviscosity.csv"):  # the closed form is the table's
        numbers = [float(v) for v in list(table.values())[:7]]
        ours = profile(np.array(depth - abs(numbers[4])), numbers[3], numbers[0], numbers[1], depth, numbers[2])
        assert abs(ours - numbers[6]) < 1e-4 * abs(numbers[6]) + 1e-9, table
    for weight, all_across in ((8000.0, (10, 20, 40)), (4000.0, (20,))):
        errors = {}
        for across in all_across:
            angle = float(np.degrees(np.arcsin(weight / (DENSITY * G))))
            s, *_ = run_film(across, tau_y / (weight * depth), 2.0, 0.5 * knee_rate, depth, angle, eta)
            errors[across] = l2(s.u[:, 0], profile(s.x[:, 1], weight, eta, tau_y, depth, knee_rate))
        if len(errors) == 3:
            yield from order_numbers(errors, "bi-viscosity film")
        else:
            yield Measured("L2 error at 20 across, 4000 Pa/m", errors[20], 0.02)


@row("Bingham film with a wall stress of 0.95 and 1.05 tau_y, 20 and 40 across, 100 Pa s", CLOSED)
def film_at_yield():
    """Below, it must stand; above, a layer of H/21 (1.9 particles at 40 across) is sheared, and the speed varies by a
    tenth from instant to instant: the mean over 2 s, in which the plug slides by a third of a spacing."""
    sim = simulate(
        catalogue.build("film", spacing=DEPTH / 20, yield_value=SLOPE_WEIGHT * DEPTH / 0.95, plastic_viscosity=ETA)
    )
    for t in (2.0, 10.0):
        sim.run(until=t)
        yield Measured(f"largest speed after {t:g} s at 0.95", float(sim.snapshot().speed.max()), 1e-6, "m/s")
    tau_y = SLOPE_WEIGHT * DEPTH / 1.05
    sim = simulate(catalogue.build("film", spacing=DEPTH / 40, yield_value=tau_y, plastic_viscosity=ETA))
    speeds = []
    for t in np.linspace(3.0, 5.0, 21):
        sim.run(until=float(t))
        s = sim.snapshot()
        speeds.append(s.u[s.x[:, 1] > 0.5 * DEPTH, 0].mean())
    exact = float(profile(DEPTH, SLOPE_WEIGHT, ETA, tau_y))
    what = f"plug speed at 1.05 ({1e3 * exact:.3g} mm/s), mean of 3 to 5 s, relative error"
    yield Measured(what, float(np.mean(speeds)) / exact - 1.0, 0.05)


# ---- between walls --------------------------------------------------------------------------------------------
@row("Bingham channel between two no-slip walls 0.1 m apart, 50 Pa s, tau_y = 0.3 of the wall stress, after 2 s",
     CLOSED)  # fmt: skip
def channel_bingham():
    half, eta, weight = 0.5 * DEPTH, 50.0, 8000.0
    tau_y = 0.3 * weight * half
    material = mps.Bingham(density=DENSITY, plastic_viscosity=eta, yield_value=tau_y)
    errors = {}
    for across in (10, 20, 40):
        s = between_walls(DEPTH / across, DEPTH, material, 2.0, push=weight / DENSITY).snapshot()
        exact = profile(half - np.abs(s.x[:, 1] - half), weight, eta, tau_y, half)
        errors[across] = l2(s.u[:, 0], exact)
    yield from order_numbers(errors, "channel, Bn = 0.3")
    plug = np.abs(s.x[:, 1] - half) < tau_y / weight
    yield Measured("plug speed at 40 across, relative error", float(s.u[plug, 0].mean() / exact.max()) - 1.0, 0.01)


@row("plane Couette under a moving wall (0.2 m/s), Newtonian, gap 0.1 m, 50 Pa s, after 1 s", CLOSED, quick=True)
def couette():
    material = mps.Newtonian(density=DENSITY, viscosity=50.0)
    s = between_walls(DEPTH / 20, DEPTH, material, 1.0, wall_speed=0.2).snapshot()
    yield Measured("L2 error at 20 across", l2(s.u[:, 0], 0.2 * s.x[:, 1] / DEPTH), 0.02)


def cessation_numbers(flow):
    """Developed flow, then the drive stops: when it is at rest. Constants: length H (half width of the channel, gap of
    Couette), speed V = tau_y H/(eta Bn), time rho H^2/eta."""
    length, speed = 0.05, 0.1
    for table in read_reference("B_cessation_summary.csv"):
        if table["flow"] != flow:
            continue
        bn, pressure, stop = float(table["Bn"]), float(table["G0"]), float(table["T_stop"])
        tau_y, unit = bn * ETA * speed / length, DENSITY * length**2 / ETA
        channel = flow == "poiseuille"
        gap = 2 * length if channel else length
        scale = ETA * speed / length**2

        def start(y, channel=channel, gap=gap, weight=pressure * scale, tau_y=tau_y):
            if channel:
                return profile(length - np.abs(y - length), weight, ETA, tau_y, length)
            return speed * y / gap

        material = mps.Bingham(density=DENSITY, plastic_viscosity=ETA, yield_value=tau_y)
        sim = between_walls(length / 20, gap, material, None, start=start, max_time_step=stop * unit / 200)
        at_rest = []

        def watch(s, at_rest=at_rest):
            if not at_rest and s.report.max_speed < 1e-3 * speed:
                at_rest.append(s.time)

        sim.each_step(watch)
        sim.run(until=2.0 * stop * unit)
        time = at_rest[0] / (stop * unit) - 1.0 if at_rest else float("inf")
        yield Measured(f"stopping time at Bn = {bn:g}, relative error", time, 0.05)
        yield Measured(f"largest speed at 2 T_stop, Bn = {bn:g}", sim.report.max_speed / speed, 1e-4, "V")


@row("cessation of channel flow, 20 across the half width; time step capped to T_stop/200; stopped: max speed < 1e-3 V",
     "B_cessation_summary.csv")  # fmt: skip
def cessation_channel():
    yield from cessation_numbers("poiseuille")


@row("cessation of Couette flow, 20 across the gap; time step capped to T_stop/200; stopped: max speed < 1e-3 V",
     "B_cessation_summary.csv")  # fmt: skip
def cessation_couette():
    yield from cessation_numbers("couette")


# ---- columns stand or flow ------------------------------------------------------------------------------------
HEIGHT, CREEP = 0.3, 1e-3  # m; m/s: a column whose top sinks slower after 0.3 s stands (2.5e-5 rho g H^2/eta)


def top_speed(solid, across, b) -> float:
    """Downward speed [m/s] of the top within H/10 of the axis 0.3 s after release; b = tau_y/(rho g H), 50 Pa s."""
    spacing = HEIGHT / across
    x = mps.fill(solid, spacing)
    d = x.shape[1]
    scene = mps.Scene(
        name="column",
        material=mps.Bingham(density=DENSITY, plastic_viscosity=50.0, yield_value=b * DENSITY * G * HEIGHT),
        spacing=spacing,
        fluid=x,
        walls=(mps.Plane((0.0,) * d, (0.0,) * (d - 1) + (1.0,)),),
        domain=((-0.5,) * (d - 1) + (-0.02,), (0.5,) * (d - 1) + (0.4,)),
    )
    sim = simulate(scene)
    sim.run(until=0.3)
    top = (np.linalg.norm(x[:, :-1], axis=1) < 0.1 * HEIGHT) & (x[:, -1] > HEIGHT - 1.5 * spacing)
    return float(-sim.snapshot().u[top, -1].mean())


def threshold_numbers(name, solid, across):
    """Critical b by four bisections of +-15 % about the middle of the reference's bracket (so to 1 %)."""
    rows = [r for r in read_reference("B_fe_initial_velocity_threshold.csv") if r["case"].lower() == name.lower()]
    flows = max(float(r["B"]) for r in rows if float(r["v_max"]) > 1e-6)
    stands = min(float(r["B"]) for r in rows if float(r["v_max"]) <= 1e-6)
    middle = 0.5 * (flows + stands)
    low, high = 0.85 * middle, 1.15 * middle
    for _ in range(4):
        b = 0.5 * (low + high)
        low, high = (b, high) if top_speed(solid, across, b) > CREEP else (low, b)
    found = 0.5 * (low + high)
    outside = max(0.0, flows - found, found - stands) / middle
    yield Measured(f"critical tau_y/(rho g H) {found:.3f} from the middle of {flows:g} to {stands:g}, relative",
                   found / middle - 1.0, 0.05)  # fmt: skip
    yield Measured("the same: outside the reference's bracket by, relative", outside, 0.05)


@row("plane column, width = H = 0.3 m, 20 across: stands when its top sinks < 1 mm/s after 0.3 s",
     "B_fe_initial_velocity_threshold.csv")  # fmt: skip
def column_plane():
    yield from threshold_numbers("plane X=0.5", mps.Box((-0.15, 0.0), (0.15, HEIGHT)), 20)


@row("cylinder, R = H/2, H = 0.3 m = 14 l0: the same rule", "B_fe_initial_velocity_threshold.csv")
def column_cylinder():
    yield from threshold_numbers("cylinder R=H/2", mps.Cone(0.15, 0.15, HEIGHT), 14)


@row("Abrams cone, H = 0.3 m = 20 l0: the same rule", "B_fe_initial_velocity_threshold.csv")
def column_cone():
    yield from threshold_numbers("abrams cone", mps.Cone(0.1, 0.05, HEIGHT), 20)


# ---- rotation -------------------------------------------------------------------------------------------------
def rotation_numbers(dimension, across):
    """Rate at which a free body in rigid rotation loses (> 0) or gains angular momentum L, over 0.1 R^2/nu, in
    nu/R^2, at omega R^2/nu = 1 (Courant steps of 0.02/omega); and with the time step capped to 1/200 of that time."""
    radius, nu = 0.1, ETA / DENSITY
    spacing, time, omega = radius / across, 0.1 * radius**2 / nu, nu / radius**2
    x = mps.lattice((-radius,) * dimension, (radius - 0.5 * spacing,) * dimension, spacing)
    x = x[np.linalg.norm(x, axis=1) < radius]
    u = np.zeros_like(x)
    u[:, 0], u[:, 1] = -omega * x[:, 1], omega * x[:, 0]
    scene = mps.Scene(
        name="rotation",
        material=mps.Newtonian(density=DENSITY, viscosity=ETA),
        spacing=spacing,
        fluid=x,
        velocity=u,
        domain=((-2 * radius,) * dimension, (2 * radius,) * dimension),
        gravity=(0.0,) * dimension,
    )
    for cap in (None, time / 200):
        sim = simulate(scene, cap)
        sim.run(until=time)
        s = sim.snapshot()
        left = np.sum(s.x[:, 0] * s.u[:, 1] - s.x[:, 1] * s.u[:, 0]) / np.sum(x[:, 0] * u[:, 1] - x[:, 1] * u[:, 0])
        what = "time step capped" if cap else f"{sim.steps} steps"
        yield Measured(f"loss of angular momentum, {what}", float(1.0 - left) / 0.1, 1e-3, "nu/R^2")


SPIN = "omega R^2/nu = 1, over 0.1 R^2/nu; again with the time step capped to 200 steps"


@row(f"free spinning Newtonian disc, R = 10 l0, {SPIN}", "exact: none is lost")
def rotating_disc():
    yield from rotation_numbers(2, 10)


@row(f"free spinning Newtonian sphere, R = 6 l0, {SPIN}", "exact: none is lost")
def rotating_sphere():
    yield from rotation_numbers(3, 6)
