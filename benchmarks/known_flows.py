"""The flows of speed_accuracy.py: each gives its scene, what is read of a run and how often [s] (or None), and how the
error follows from that: from times and values, and from the simulation at its end.
"""

from dataclasses import replace

import numpy as np

from taichi_mps.problem import catalogue
from validation import flows, fluids, slumps


def cone(spacing):
    """Largest error of the slump [mm] at 0.1, 0.2, 0.3, 0.5, 1 s beside finite elements with inertia (+-0.4 mm)."""
    scene = catalogue.build("slump", yield_value=500.0, plastic_viscosity=50.0, spacing=spacing, until=1.0)

    def error(times, slump, sim):
        exact = np.interp(slumps.MILESTONES, *slumps.inertial(500.0)[:2])
        return 1e3 * np.abs(np.interp(slumps.MILESTONES, times, slump) - exact).max()

    return scene, ("slump_m", 0.1), error


def block(across):
    """Error of the runout [%] beside finite elements without inertia, as in row block_010. The true Bingham body is at
    rest before 30 s; a bi-viscosity body, with pi_c eta = 0.33 tau_y, flows on and on."""
    scene = slumps.block(0.1, across)
    scene = replace(scene, until=30.0, domain=((-1.0, scene.domain[0][1]), (1.0, scene.domain[1][1])))
    return scene, None, lambda times, values, sim: abs(slumps.runout_error(0.1, sim.snapshot()))


def channel(across):
    """Relative L2 error of the velocity [%] after 1 s, 8.7 rho H^2/eta, beside the closed form."""
    scene, exact = flows.channel(across)

    def error(times, values, sim):
        s = sim.snapshot()
        return 100.0 * flows.l2(s.u[:, 0], exact(s.x[:, 1]))

    return replace(scene, until=1.0), None, error


def pool(layers):
    """Error of the pressure over rho g H [%], mean over 2 s."""
    mix = dict(density=2300.0, plastic_viscosity=50.0, yield_value=100.0)
    scene = catalogue.build("still_pool", spacing=0.2 / layers, until=2.0, **mix)
    return scene, ("pressure_error", 0.1), lambda times, errors, sim: 100.0 * np.mean(errors[1:])


def dam(across):
    """Largest error of the front [%] beside Martin and Moyce, whose gate opened 0.25 sqrt(a/2g) late."""
    scene = catalogue.build("dam_break", until=0.26, spacing=fluids.COLUMN / across)
    return scene, ("front_m", 0.01), lambda times, front, sim: 100.0 * fluids.front_errors(times, front)[0](0.25)
