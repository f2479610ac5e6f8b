"""A Simulation that is compiled once and run again with other materials.

A Simulation compiles its kernels anew: 5 to 8 s for a cone that runs in half a second. They read the numbers of a mix
from fields (``from_fields`` of the law says which), so another mix of the same law is other entries.
"""

import hashlib
import io
import json
from contextlib import redirect_stdout
from dataclasses import fields, is_dataclass

import numpy as np

from ..problem.problem import Problem
from ..problem.scene import Scene
from ..runtime.backend import init, require_room, session
from .simulation import Simulation

# of a scene: read at every step or at the end, by no kernel; the material has its own entry
FREE = ("material", "until", "parameters", "measure", "over_time", "check", "outline", "mould", "vessel")
MOST_KEPT = 4  # Simulations of a process: of some curves, coarse and fine
_kept: dict = {}  # of this process, by shape, last used last: Simulation, its scheme and its state when it was made


def begin(scene: Scene, compiles=None, most: int = MOST_KEPT) -> Simulation:
    """A Simulation of the scene, by kernels of this process where they fit; one handed out before is over. Starts
    Taichi with one thread where it is not, and again where its fields are used up. ``compiles`` is called before
    kernels are made, and ``most`` Simulations are kept."""
    problem = Problem(scene)
    shape = shape_of(problem)
    try:
        require_room()
    except RuntimeError:  # not started, or full
        _kept.clear()
        with redirect_stdout(io.StringIO()):  # without Taichi's greeting
            init(threads=1)
    sim, scheme, beginning = _kept.pop(shape, (None, None, None))
    # its scheme is another one once it was made anew for a longer neighbour list
    if not sim or sim.session is not session() or sim.scheme is not scheme:
        if compiles:
            compiles()
        for oldest in list(_kept)[: max(0, len(_kept) - most + 1)]:
            del _kept[oldest]
        sim = Simulation(problem)
        scheme, beginning = sim.scheme, sim.state()
    require_room()
    sim.restart(problem, beginning)
    _kept[shape] = sim, scheme, beginning
    return sim


def shape_of(problem: Problem) -> bytes:
    """A digest of what of a problem is compiled: all of the scene but FREE, all of the numerics, and what kernels do
    not read from fields of the mix. Problems of one shape share their kernels."""
    scene = problem.scene
    bare = [getattr(scene, field.name) for field in fields(scene) if field.name not in FREE]
    mixes = [scene.mix_of(inlet) for inlet in scene.inlets]  # one may be that of the scene
    rubs = any(wall.friction for wall in scene.walls)  # friction keeps the slope of the flow curve, too
    material = scene.material
    numbers = material.model_dump(exclude=set(material.from_fields))
    slope = material.typical_slope if rubs else None
    parts = (
        bare,
        problem.scheme,
        repr(problem.numerics),
        problem.law,
        type(material),
        numbers,
        material.ages,
        slope,
        mixes,
    )
    return hashlib.sha256(json.dumps(parts, default=described).encode()).digest()


def described(part):
    """An array, a record or anything else that JSON does not know. Of a function the text that compiles it is not
    known, so only the same object is equal to it."""
    if isinstance(part, np.ndarray):
        return [str(part.dtype), part.shape, part.tobytes().hex()]
    if is_dataclass(part):
        return [type(part).__name__, *(getattr(part, field.name) for field in fields(part))]
    return id(part) if callable(part) else [id(type(part)), repr(part)]
