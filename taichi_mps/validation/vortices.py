"""Rows on vortices (Taylor-Green, Bingham cavity), a standing wave, and the order in time."""

import numpy as np

import taichi_mps as mps

from . import Measured, row
from .fits import fitted
from .flows import DENSITY, DEPTH, ETA, between_walls
from .fluids import columns
from .scheme import simulate


@row("Taylor-Green vortices, Re = 100, 50 across, both axes periodic, to t U/L = 1", "exact decay")
def taylor_green():
    l0, k = 1.0 / 50, 2 * np.pi
    x = mps.lattice((0.0, 0.0), (1.0 - 0.5 * l0,) * 2, l0)
    u = np.column_stack([-np.cos(k * x[:, 0]) * np.sin(k * x[:, 1]), np.sin(k * x[:, 0]) * np.cos(k * x[:, 1])])
    scene = mps.Scene(
        name="Taylor-Green",
        material=mps.Newtonian(density=1.0, viscosity=0.01),
        spacing=l0,
        fluid=x,
        velocity=u,
        gravity=(0.0, 0.0),
        domain=((0.0, 0.0), (1.0, 1.0)),
        periodic=(True, True),
        until=1.0,
    )
    sim = simulate(scene)
    sim.run()
    s, exact = sim.snapshot(), columns("C_taylor_green.csv", Re="100")
    end = int(np.argmin(np.abs(exact["t"] - 1.0)))
    energy = (s.u**2).sum() / (u**2).sum()
    yield Measured("largest velocity, relative error", float(np.abs(s.u).max() / exact["umax"][end] - 1), 0.02)
    yield Measured(
        "root of the kinetic energy, relative error", float((energy / exact["KE/KE0"][end]) ** 0.5 - 1), 0.02
    )
    yield Measured("mean velocity, over U (exact: none)", float(np.abs(s.u.mean(0)).max()), 1e-3)


def zeros(t, values):
    """Times at which a sampled curve crosses zero, by linear interpolation."""
    k = np.flatnonzero(np.diff(np.sign(values)))
    return t[k] + (t[k + 1] - t[k]) * values[k] / (values[k] - values[k + 1])


@row("standing wave, Re = 250, lambda/l0 = 100, amplitude 0.8 l0, slip walls, three periods", "Prosperetti (1981)")
def standing_wave():
    """Half a wave in a tank as deep as it is wide. Its amplitude is the first Fourier mode of the mass along x."""
    wavelength, g, l0 = 1.0, 9.81, 0.01
    k, depth, width = 2 * np.pi / wavelength, 0.5 * wavelength, 0.5 * wavelength
    period, a0 = 2 * np.pi / (g * k) ** 0.5, 0.05 / k
    x = mps.fill(mps.Box((0.0, 0.0), (width, depth)), l0)
    along, up = k * x[:, 0], k * x[:, 1]
    shape = np.column_stack([-np.sin(along) * np.cosh(up), np.cos(along) * np.sinh(up)]) / np.sinh(k * depth)
    scene = mps.Scene(
        name="standing wave",
        material=mps.Newtonian(density=1000.0, viscosity=1000.0 * wavelength * (g * wavelength) ** 0.5 / 250),
        spacing=l0,
        fluid=x + a0 * shape,  # the displacement of deep-water waves, free of divergence
        walls=mps.box_planes((0.0, 0.0), (width, depth), slip=True),
        domain=((-0.1, -0.1), (width + 0.1, depth + 0.2)),
        until=3 * period,
    )
    sim = simulate(scene)
    times, amplitude = [], []

    def sample(s):
        times.append(s.time / period)
        amplitude.append(2 / width * l0**2 * np.cos(k * s.snapshot().x[:, 0]).sum() / a0)

    sim.every(period / 40, sample)
    sim.run()
    exact = columns("C_standing_wave_prosperetti.csv", Re="250")
    wanted = np.interp(times, exact["t/T"], exact["a/a0_prosperetti"])
    yield Measured("amplitude, largest error, over that at the start", float(np.abs(amplitude - wanted).max()), 0.03)
    share = np.dot(amplitude, wanted) / np.dot(wanted, wanted)
    yield Measured("amplitude, mean relative error", float(share - 1), 0.03)
    found, known = zeros(np.array(times), np.array(amplitude)), zeros(np.array(times), wanted)
    late = found[4] / known[4] - 1 if len(found) > 4 else np.inf
    yield Measured("time of the fifth zero, relative error", float(late), 0.03)


def stream_function(x, u, across):
    """psi [m2/s] on the nodes of a unit cavity under a lid of speed 1, (across + 1, across + 1): -u_x from fits
    around each node, summed from the floor up."""
    nodes = np.linspace(0.0, 1.0, across + 1)
    ux = np.zeros((across + 1, across + 1))
    for i, column in enumerate(nodes):
        near = np.abs(x[:, 0] - column) * across < 6.0
        at = np.column_stack([np.full(across + 1, column), nodes])
        ux[i] = fitted(at, x[near], u[near, 0], 1.0 / across)
    ux[:, 0], ux[:, -1] = 0.0, 1.0
    ux[0], ux[-1] = 0.0, 0.0
    slope = np.gradient(ux, axis=1)
    total = np.concatenate([np.zeros((across + 1, 1)), np.cumsum(0.5 * (ux[:, 1:] + ux[:, :-1]), 1)], 1)
    return -(total - (slope - slope[:, :1]) / 12) / across  # the trapezoidal rule, and its error by Euler and Maclaurin


def bingham_cavity(bingham_number, across=40):
    """Lid-driven unit cavity: strength and centre of the vortex, mean of 21 moments from t U/L = 1 to 2: the layer
    under the lid is a few particles thick, and its flow unsteady by several per cent."""
    floor, left, right = mps.box_planes((0.0, 0.0), (1.0, 1.0))
    scene = mps.Scene(
        name="Bingham cavity",
        material=mps.Bingham(density=1.0, plastic_viscosity=1.0, yield_value=bingham_number),
        spacing=1.0 / across,
        fluid=mps.fill(mps.Box((0.0, 0.0), (1.0, 1.0)), 1.0 / across),
        walls=(floor, left, right, mps.Plane((0.0, 1.0), (0.0, -1.0), velocity=(1.0, 0.0))),
        gravity=(0.0, 0.0),
        domain=((-0.1, -0.1), (1.1, 1.1)),
        until=2.0,
    )
    sim = simulate(scene)
    found = []

    def sample(s):
        if s.time > 0.99:
            state = s.snapshot()
            found.append(stream_function(state.x, state.u, across))

    sim.every(0.05, sample)
    sim.run()
    psi = np.mean(found, axis=0)
    i, j = np.unravel_index(np.argmax(psi), psi.shape)
    exact = columns("B_bingham_cavity_vortex.csv", n="32", Bn=f"{bingham_number:g}")
    target = 0.02 if bingham_number <= 10.0 else 0.04
    what = f"stream function, largest, Bn = {bingham_number:g}"
    yield Measured(what, float(psi[i, j] / exact["psi"][0] - 1), target)

    def top(values):
        """Vertex of the parabola through three values, in steps from the middle one."""
        return 0.5 * (values[0] - values[2]) / (values[0] - 2 * values[1] + values[2])

    centre = (i + top(psi[i - 1 : i + 2, j])) / across, (j + top(psi[i, j - 1 : j + 2])) / across
    yield Measured(f"centre of the vortex, x less 0.5, Bn = {bingham_number:g}", float(centre[0] - 0.5), 0.01, "L")
    height = float(exact["yc"][0])
    yield Measured(f"its height, relative to {height:.3f}", float(centre[1]) / height - 1.0, target)


@row("lid-driven Bingham cavity, Re = 1, 40 across, Bn = 2 to 50", "own finite elements (Re = 0)")
def cavity_bingham():
    for bingham_number in (2.0, 5.0, 10.0, 20.0, 50.0):
        yield from bingham_cavity(bingham_number)


@row("lid-driven Bingham cavity, Re = 1, 80 across, Bn = 2 and 20", "own finite elements (Re = 0)")
def cavity_bingham_fine():
    yield from bingham_cavity(2.0, 80)
    yield from bingham_cavity(20.0, 80)


@row("start-up of channel flow, 20 across the half width H, time step T/25, T/50, T/100, T = rho H^2/eta",
     "B_startup_poiseuille.csv")  # fmt: skip
def order_in_time():
    """Plug speed after 0.48 T against the reference (1-D, dt = T/500). The push is weak, so that no particle moves by
    more than 0.01 l0 in a step and the error of the spacing is the same in all runs."""
    half, weight, until = 0.5 * DEPTH, 20.0, 0.48  # m, N/m3, T
    time = DENSITY * half**2 / ETA
    for bn, pressure in (("0", "3"), ("1", "4")):
        exact = columns("B_startup_poiseuille.csv", Bn=bn, G=pressure)
        wanted = exact["u_plug"][np.argmin(np.abs(exact["t"] - until))]
        speed = weight * half**2 / (float(pressure) * ETA)
        material = mps.Bingham(density=DENSITY, plastic_viscosity=ETA, yield_value=float(bn) * ETA * speed / half)
        errors = []
        for steps in (25, 50, 100):
            sim = between_walls(half / 20, DEPTH, material, until * time, weight / DENSITY, max_time_step=time / steps)
            s = sim.snapshot()
            middle = np.abs(s.x[:, 1] - half) < s.spacing
            errors.append(float(s.u[middle, 0].mean() / speed / wanted - 1))
        order = float(np.log2(abs(errors[0] / errors[-1])) / 2)
        listed = ", ".join(f"{100 * e:.2f} %" for e in errors)
        yield Measured(f"0.9 - order ({order:.2f}, errors {listed}), Bn = {bn}", max(0.0, 0.9 - order), 0.0)
