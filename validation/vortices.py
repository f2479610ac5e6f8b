"""Vortices and waves: lid-driven cavities of a Newtonian and a Bingham fluid, Taylor-Green, a standing wave."""

import numpy as np

import taichi_mps as mps

from . import Measured, columns, record, run


# ---- reading values off particles ------------------------------------------------------------------------------
def fitted(places, x, values, spacing):
    """Values at ``places`` (m, 2) from those of particles at ``x`` (n, 2): a parabola through what is around each, by
    least squares weighted with exp(-r^2/l0^2). A weighted mean, or a plane, would smooth what is curved: the profile of
    the cavity of Re = 400, put on a lattice of 40 across and read back, is 0.7 % off with both and 0.1 % with this."""
    r = (x - places[:, None]) / spacing
    weight = np.exp(-(r**2).sum(-1))
    a, b = r[..., 0], r[..., 1]
    basis = np.stack([np.ones_like(a), a, b, a**2, a * b, b**2], -1)
    moment = np.einsum("mn,mna,mnb->mab", weight, basis, basis)
    return np.linalg.solve(moment, np.einsum("mn,mna,n->ma", weight, basis, values)[..., None])[:, 0, 0]


def stream_function(x, u, across):
    """psi [m2/s] on the nodes of a unit cavity under a lid of speed 1, (across + 1, across + 1): -u_x from fits
    around each node, summed from the floor up."""
    nodes = np.linspace(0.0, 1.0, across + 1)
    ux = np.zeros((across + 1, across + 1))
    for i, column in enumerate(nodes):
        near = np.abs(x[:, 0] - column) * across < 6.0
        ux[i] = fitted(np.column_stack([np.full(across + 1, column), nodes]), x[near], u[near, 0], 1.0 / across)
    ux[:, 0], ux[:, -1] = 0.0, 1.0
    ux[0], ux[-1] = 0.0, 0.0
    slope = np.gradient(ux, axis=1)
    total = np.concatenate([np.zeros((across + 1, 1)), np.cumsum(0.5 * (ux[:, 1:] + ux[:, :-1]), 1)], 1)
    return -(total - (slope - slope[:, :1]) / 12) / across  # the trapezoidal rule, and its error by Euler and Maclaurin


# ---- cavities --------------------------------------------------------------------------------------------------
def lid_driven(name, material, across, until) -> mps.Scene:
    """Unit cavity under a lid of speed 1, no-slip walls."""
    floor, left, right = mps.box_planes((0.0, 0.0), (1.0, 1.0))
    return mps.Scene(
        name=name,
        material=material,
        spacing=1.0 / across,
        fluid=mps.fill(mps.Box((0.0, 0.0), (1.0, 1.0)), 1.0 / across),
        walls=(floor, left, right, mps.Plane((0.0, 1.0), (0.0, -1.0), velocity=(1.0, 0.0))),
        gravity=(0.0, 0.0),
        domain=((-0.1, -0.1), (1.1, 1.1)),
        until=until,
    )


def cavity(reynolds, until, good, across=40):
    """u on x = 0.5 against our own solution; ``good`` is the level of C_where_methods_fail.json for its lowest
    value."""
    l0, wanted = 1.0 / across, columns("C_lid_cavity_ghia.csv", Re=float(reynolds), component="u(x=0.5 y)")
    y, u = wanted["position"], wanted["own"]
    inside = (y > 0.5 * l0) & (y < 1 - 0.5 * l0)

    def read(s):
        state = s.snapshot()
        return fitted(np.column_stack([np.full(inside.sum(), 0.5), y[inside]]), state.x, state.u[:, 0], l0)

    scene = lid_driven("cavity", mps.Newtonian(density=1.0, viscosity=1.0 / reynolds), across, until)
    _, _, profiles = record(scene, read, until / 100, after=0.7 * until)
    error = np.mean(profiles, axis=0) - u[inside]
    lowest = np.argmin(u[inside])
    return [
        Measured(
            "u on the centre line, root mean square, over the lid's speed", float(np.sqrt((error**2).mean())), 0.02
        ),
        Measured("its lowest, relative error", float(error[lowest] / u[inside][lowest]), good),
    ]


def bingham_cavities(bingham_numbers, across=40):
    """Strength and centre of the vortex, mean of 21 moments from t U/L = 1 to 2: the layer under the lid is a few
    particles thick, and its flow unsteady by several per cent."""

    def read(s):
        state = s.snapshot()
        return stream_function(state.x, state.u, across)

    for bingham_number in bingham_numbers:
        material = mps.Bingham(density=1.0, plastic_viscosity=1.0, yield_value=bingham_number)
        _, _, found = record(lid_driven("Bingham cavity", material, across, 2.0), read, 0.05, after=0.99)
        psi = np.mean(found, axis=0)
        i, j = np.unravel_index(np.argmax(psi), psi.shape)
        x, y = (i + vertex(psi[i - 1 : i + 2, j])) / across, (j + vertex(psi[i, j - 1 : j + 2])) / across
        exact = columns("B_bingham_cavity_vortex.csv", n=32.0, Bn=bingham_number)
        height, target = float(exact["yc"][0]), 0.02 if bingham_number <= 10.0 else 0.04
        strength, name = float(psi[i, j] / exact["psi"][0] - 1), f"Bn = {bingham_number:g}"
        yield from (
            Measured(f"stream function, largest, {name}", strength, target),
            Measured(f"centre of the vortex, x less 0.5, {name}", float(x - 0.5), 0.01, "L"),
            Measured(f"its height, relative to {height:.3f}", float(y) / height - 1.0, target),
        )


def vertex(values) -> float:
    """Vertex of the parabola through three values, in steps from the middle one."""
    return 0.5 * (values[0] - values[2]) / (values[0] - 2 * values[1] + values[2])


# ---- decay and waves -------------------------------------------------------------------------------------------
def taylor_green_scene(l0, density, viscosity):
    """Vortices of unit speed in a periodic box of side 1 m."""
    k = 2 * np.pi
    x = mps.lattice((0.0, 0.0), (1.0 - 0.5 * l0,) * 2, l0)
    u = np.column_stack([-np.cos(k * x[:, 0]) * np.sin(k * x[:, 1]), np.sin(k * x[:, 0]) * np.cos(k * x[:, 1])])
    return mps.Scene(
        name="Taylor-Green",
        material=mps.Newtonian(density=density, viscosity=viscosity),
        spacing=l0,
        fluid=x,
        velocity=u,
        gravity=(0.0, 0.0),
        domain=((0.0, 0.0), (1.0, 1.0)),
        periodic=(True, True),
    )


def taylor_green():
    scene = taylor_green_scene(1.0 / 50, 1.0, 0.01)
    s, exact = run(scene, 1.0).snapshot(), columns("C_taylor_green.csv", Re=100.0, t=1.0)
    root = float(((s.u**2).sum() / (scene.velocity**2).sum() / exact["KE/KE0"][0]) ** 0.5 - 1)
    return [
        Measured("largest velocity, relative error", float(np.abs(s.u).max() / exact["umax"][0] - 1), 0.02),
        Measured("root of the kinetic energy, relative error", root, 0.02),
        Measured("mean velocity, over U (exact: none)", float(np.abs(s.u.mean(0)).max()), 1e-3),
    ]


def zeros(t, values):
    """Times at which a sampled curve crosses zero, by linear interpolation."""
    k = np.flatnonzero(np.diff(np.sign(values)))
    return t[k] + (t[k + 1] - t[k]) * values[k] / (values[k] - values[k + 1])


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
    )

    def read(s):
        return 2 / width * l0**2 * np.cos(k * s.snapshot().x[:, 0]).sum() / a0

    _, times, amplitude = record(scene, read, period / 40, 3 * period)
    times, exact = times / period, columns("C_standing_wave_prosperetti.csv", Re=250.0)
    wanted = np.interp(times, exact["t/T"], exact["a/a0_prosperetti"])
    found, reference = zeros(times, amplitude), zeros(times, wanted)
    late = found[4] / reference[4] - 1 if len(found) > 4 else np.inf
    share = np.dot(amplitude, wanted) / np.dot(wanted, wanted)
    return [
        Measured("amplitude, largest error, over that at the start", float(np.abs(amplitude - wanted).max()), 0.03),
        Measured("amplitude, mean relative error", float(share - 1), 0.03),
        Measured("time of the fifth zero, relative error", float(late), 0.03),
    ]
