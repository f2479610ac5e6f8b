"""Small scene for tests that obeys every rule, and runs of scenes."""

from dataclasses import replace

import numpy as np

import taichi_mps as mps


def ran(scene, numerics=None, until=None) -> mps.Simulation:
    """A simulation of the scene after a time [s], or at its end."""
    sim = mps.Simulation(scene, numerics)
    sim.run(until)
    return sim


def parts(d=2, **changes) -> dict:
    """Keywords of a sound scene: 5 particles along each side of half a metre, on a floor, in d dimensions."""
    up = tuple(np.eye(d)[-1])
    sound = {
        "name": "block",
        "material": mps.Bingham(),
        "spacing": 0.1,
        "fluid": mps.fill(mps.Box((0.0,) * d, (0.5,) * d), 0.1),
        "domain": ((-1.0,) * d, (2.0,) * d),
        "walls": (mps.Plane((0.0,) * d, up),),
    }
    return sound | changes


def hose(**changes) -> mps.Inlet:
    """A sound inlet above the block, in the plane."""
    sound = {"centre": (0.2, 1.5), "direction": (0.0, -1.0), "radius": 0.3, "rate": 0.1, "volume": 0.3}
    return mps.Inlet(**sound | changes)


def two_mixes(lower, upper, **changes) -> mps.Scene:
    """The scene film, ten rows of ``lower``, and a hose of ``upper`` that opens long after the end."""
    spacing = 0.01
    scene = mps.catalogue.build("film", spacing=spacing)
    (left, bottom), (right, top) = scene.domain
    hose = mps.Inlet((0.5 * (left + right), top), (0.0, -1.0), 2 * spacing, 1e-3, 4 * spacing**2, 100.0, upper)
    domain = ((left, bottom), (right, top + 2 * spacing))
    given = {"material": lower, "inlets": (hose,), "domain": domain, "check": None, "measure": None}
    return replace(scene, **given | changes)
