"""The flows of speed_accuracy.py: each gives its scene, what watches the run (or None), the error of a finished one."""

import numpy as np


def cone(spacing):
    """Largest error of the slump [mm] at 0.1, 0.2, 0.3, 0.5, 1 s beside finite elements with inertia (+-0.4 mm)."""
    from taichi_mps.validation import slumps

    lines = slumps.inertial("summary", 500.0, "A", 0.0)
    exact = {float(r["time_s"]): float(r["mean20_mm"]) for r in lines if not r["kind"].startswith("final")}
    scene = slumps.cone(yield_value=500.0, plastic_viscosity=50.0, spacing=spacing, until=1.0)
    history = []

    def watch(sim):
        sim.every(0.1, lambda s: history.append((s.time, 1e3 * s.measures()["slump_m"])))

    def error(sim):
        times, slump = np.array(history).T
        return max(abs(np.interp(t, times, slump) - exact[t]) for t in slumps.MILESTONES)

    return scene, watch, error


def block(across):
    """Error of the runout [%] beside finite elements without inertia, eta = 1500 Pa s, as in row block_010. The true
    Bingham body is at rest before 30 s; a bi-viscosity body, with pi_c eta = 0.33 tau_y, flows on and on."""
    import taichi_mps as mps
    from taichi_mps.validation import read_reference
    from taichi_mps.validation.slumps import DENSITY, GRAVITY

    height, eta, number = 0.2, 1500.0, 0.1
    l0 = height / across
    exact = next(float(r["x_max_final"]) for r in read_reference("B_fe_block2d_final.csv") if float(r["B"]) == number)
    scene = mps.Scene(
        name="block",
        material=mps.Bingham(density=DENSITY, plastic_viscosity=eta, yield_value=number * DENSITY * GRAVITY * height),
        spacing=l0,
        fluid=mps.fill(mps.Box((-height, 0.0), (height, height)), l0),
        walls=(mps.Plane((0.0, 0.0), (0.0, 1.0)),),
        domain=((-5.0 * height, -4 * l0), (5.0 * height, 1.5 * height)),
        until=30.0,
        stop_at_rest=True,
    )

    def error(sim):
        runout = 0.5 * (np.ptp(sim.snapshot().x[:, 0]) + l0)
        return 100.0 * abs(runout / (height * exact) - 1.0)

    return scene, None, error


def channel(across):
    """Relative L2 error of the velocity [%] after 1 s, 8.7 rho H^2/eta, beside the closed form."""
    import taichi_mps as mps
    from taichi_mps.validation.flows import DENSITY, DEPTH, l2, profile

    half, eta, weight, l0 = 0.5 * DEPTH, 50.0, 8000.0, DEPTH / across
    tau_y, high = 0.3 * weight * half, (10 * l0, DEPTH)
    scene = mps.Scene(
        name="channel",
        material=mps.Bingham(density=DENSITY, plastic_viscosity=eta, yield_value=tau_y),
        spacing=l0,
        fluid=mps.lattice((0.0, 0.0), np.array(high) - 0.5 * l0, l0),
        walls=(mps.Plane((0.0, 0.0), (0.0, 1.0)), mps.Plane(high, (0.0, -1.0))),
        domain=((0.0, -l0), (high[0], DEPTH + l0)),
        periodic=(True, False),
        gravity=(weight / DENSITY, 0.0),
        until=1.0,
    )

    def error(sim):
        s = sim.snapshot()
        return 100.0 * l2(s.u[:, 0], profile(half - np.abs(s.x[:, 1] - half), weight, eta, tau_y, half))

    return scene, None, error


def pool(layers):
    """Error of the pressure over rho g H [%], mean over 2 s."""
    from taichi_mps.problem import catalogue

    mix = dict(density=2300.0, plastic_viscosity=50.0, yield_value=100.0)
    scene = catalogue.load("still_pool")(spacing=0.2 / layers, until=2.0, **mix)
    found = []

    def watch(sim):
        sim.every(0.1, lambda s: found.append(100.0 * s.measures()["pressure_error"]))

    return scene, watch, lambda sim: float(np.mean(found[1:]))


def dam(across):
    """Largest error of the front [%] beside Martin and Moyce, whose gate opened 0.25 sqrt(a/2g) late."""
    from taichi_mps.problem import catalogue
    from taichi_mps.validation.fluids import columns

    a = 0.146
    known = columns("C_dambreak_front_martin_moyce_koshizuka.csv", dataset="martin_moyce_a2.25in_n2=2")
    scene = catalogue.load("dam_break")(until=0.26, spacing=a / across)
    history = []

    def watch(sim):
        sim.every(0.01, lambda s: history.append((s.time, s.measures()["front_m"] / a)))

    def error(sim):
        t, reach = np.array(history).T
        t = t * (2 * 9.81 / a) ** 0.5
        at, z = known["t*sqrt(2g/a)"], known["z/a"]
        covered = (at < t[-1]) & (z < 3.9)
        return 100.0 * float(np.abs(np.interp(at[covered] - 0.25, t, reach) / z[covered] - 1.0).max())

    return scene, watch, error
