"""A Simulation that is compiled once and run again with other materials.

A Simulation compiles its kernels anew: 5 to 8 s for a cone that runs in half a second. They read the numbers of a mix
from fields (terms/constants.py says which), so another mix of the same law is other entries.
"""

import hashlib
from dataclasses import fields, is_dataclass

import numpy as np

from ..problem.materials import Bingham
from ..problem.problem import Problem
from ..runtime.backend import require_room, ti
from ..simulation.simulation import Simulation
from ..terms.constants import FIELDS_OF_A_MIX

# of a scene: read at every step or at the end, by no kernel; the material has its own entry
FREE = ("material", "until", "parameters", "measure", "over_time", "check", "outline")


def shape_of(problem: Problem) -> bytes:
    """What of a problem is compiled: all of the scene but FREE, all of the numerics, and what kernels do not read from
    fields of the mix. Problems of one shape share their kernels."""
    scene = problem.scene
    bare = [getattr(scene, field.name) for field in fields(scene) if field.name not in FREE]
    mixes = [scene.mix_of(inlet) for inlet in scene.inlets]  # one may be that of the scene
    rubs = any(wall.friction for wall in scene.walls)  # friction keeps the viscosity of the fluid, too
    material = compiled_numbers(scene.material), scene.material.plastic_viscosity if rubs else None
    return digest(bare, problem.scheme, repr(problem.numerics), problem.law, material, mixes)


def digest(*parts) -> bytes:
    """A digest of numbers, texts, arrays, and of records and rows of these. Of a function the text that compiles it is
    not known, so only the same object is equal to it."""
    total = hashlib.sha256()
    for part in parts:
        if isinstance(part, np.ndarray):
            words = [str(part.dtype).encode(), str(part.shape).encode(), np.ascontiguousarray(part).tobytes()]
        elif is_dataclass(part):
            words = [type(part).__name__.encode(), digest(*(getattr(part, field.name) for field in fields(part)))]
        elif isinstance(part, list | tuple):
            words = [b"row", str(len(part)).encode(), *(digest(item) for item in part)]
        elif callable(part):
            words = [str(id(part)).encode()]
        else:
            words = [type(part).__name__.encode(), repr(part).encode()]
        for word in words:
            total.update(len(word).to_bytes(8, "little") + word)
    return total.digest()


def compiled_numbers(material) -> str:
    """What of a material is compiled in: of a Bingham mix all but FIELDS_OF_A_MIX, of a flow curve all."""
    if not isinstance(material, Bingham):
        return repr(material)
    compiled = [name for name in type(material).model_fields if name not in FIELDS_OF_A_MIX]
    return repr((type(material).__name__, {name: getattr(material, name) for name in compiled}))


class Compiled:
    """One Simulation for all problems of one shape, of the scheme ``implicit``."""

    def __init__(self, problem: Problem):
        self.shape = shape_of(problem)
        self.program = ti.lang.impl.get_runtime().prog
        self.sim = Simulation(problem)
        self.scheme = self.sim.scheme
        self.beginning = self.sim.state()

    @property
    def whole(self) -> bool:
        """False once the Simulation has made its scheme anew, for a longer neighbour list, or Taichi was restarted."""
        return self.sim.scheme is self.scheme and self.program is ti.lang.impl.get_runtime().prog

    def begin(self, problem: Problem) -> Simulation:
        """The Simulation of a problem of this shape, at its start; the one handed out before is over."""
        require_room()
        self.sim.restart(problem, self.beginning)
        return self.sim
