"""Reuse of a compiled Simulation for other materials.

A Simulation compiles its kernels anew: 5 to 8 s for a cone that runs in half a second. They read the numbers of a mix
from fields (``from_fields`` of the law says which), so another mix of the same law is other entries.
"""

import hashlib
import json
from dataclasses import fields, is_dataclass

import numpy as np

from ..engine import Problem, Scene, init, require_room, session
from ..io.notebook import Simulation

# of a scene: read at every step or at the end, by no kernel; the material has its own entry
FREE = ("material", "until", "parameters", "measure", "over_time", "check", "outline", "mould", "vessel")
MAX_KEPT = 4  # Simulations that a process keeps: of some curves, coarse and fine
_kept: dict = {}  # of this process, by shape, last used last: Simulation, its scheme and its state when it was made


def begin(scene: Scene, compiles=lambda: None, most: int = MAX_KEPT) -> Simulation:
    """Make a Simulation of the scene, with compiled kernels of this process if they fit; one returned before becomes
    invalid. Starts Taichi with one thread if it is not started, and again if its fields are used up. ``compiles`` is
    called before kernels are compiled, and ``most`` Simulations are kept."""
    problem = Problem(scene)
    shape = shape_of(problem)
    try:
        require_room()
    except RuntimeError:  # not started, or full
        _kept.clear()
        init(threads=1)
    sim, scheme, beginning = _kept.pop(shape, (None, None, None))
    # a Simulation makes a new scheme for a longer neighbour list
    if not sim or sim.session is not session() or sim.scheme is not scheme:
        compiles()
        for oldest in list(_kept)[: max(0, len(_kept) - most + 1)]:
            del _kept[oldest]
        sim = Simulation(problem)
        scheme, beginning = sim.scheme, sim.state()
    require_room()
    if "structure" in beginning:
        beginning["structure"] = problem.initial_structure(beginning.get("mix", np.zeros(len(beginning["x"]))))
    sim.restart(problem, beginning)
    _kept[shape] = sim, scheme, beginning
    return sim


def shape_of(problem: Problem) -> bytes:
    """Digest of all of a problem that is compiled into kernels: the scene except FREE, the numerics, and the numbers of
    the mix that kernels do not read from fields. Problems with equal digests share their kernels."""
    scene, material = problem.scene, problem.scene.material
    has_friction = any(wall.friction for wall in scene.walls)  # friction keeps the slope of the flow curve, too
    parts = (
        [getattr(scene, field.name) for field in fields(scene) if field.name not in FREE],
        problem.scheme,
        repr(problem.numerics),
        problem.law,
        type(material),
        material.model_dump(exclude=set(material.from_fields)),
        material.ages,
        material.typical_slope if has_friction else None,
        [scene.mix_of(inlet) for inlet in scene.inlets],  # one may be that of the scene
    )
    return hashlib.sha256(json.dumps(parts, default=as_json).encode()).digest()


def as_json(part):
    """Convert an array, a record or another object for JSON. Functions are compared by identity, since their source is
    not known."""
    if isinstance(part, np.ndarray):
        return [str(part.dtype), part.shape, part.tobytes().hex()]
    if is_dataclass(part):
        return [type(part).__name__, *(getattr(part, field.name) for field in fields(part))]
    return id(part) if callable(part) else [id(type(part)), repr(part)]
