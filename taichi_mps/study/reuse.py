"""A Simulation that is compiled once and run again with other materials.

A Simulation compiles its kernels anew: 5 to 8 s for a cone that runs in half a second. They read the numbers of a
material from fields (constants.py), so another material of the law is other entries.
"""

import pickle
import time
from dataclasses import fields

from ..problem.materials import Bingham
from ..problem.scene import Scene
from ..runtime.backend import require_room, ti
from ..simulation.simulation import Simulation
from ..terms.constants import law_of


def shape_of(scene: Scene) -> bytes:
    """What of a scene is compiled: all but the numbers of its material, its end and what is read from it."""
    free = ("material", "until", "parameters", "measure", "over_time", "check", "outline")
    bare = [getattr(scene, field.name) for field in fields(scene) if field.name not in free]
    law = law_of(scene.material) if isinstance(scene.material, Bingham) else repr(scene.material)
    rubs = any(wall.friction for wall in scene.walls)  # friction keeps the viscosity of the fluid, too
    mixes = len(scene.materials), [scene.mix_of(inlet) for inlet in scene.inlets]  # one may be that of the scene
    return pickle.dumps((bare, law, mixes, scene.material.plastic_viscosity if rubs else None))


class Compiled:
    """One Simulation for all scenes of one shape, by the scheme ``implicit`` with its defaults."""

    def __init__(self, scene: Scene):
        self.shape = shape_of(scene)
        self.program = ti.lang.impl.get_runtime().prog
        self.sim = Simulation(scene)
        self.scheme = self.sim.scheme
        self.beginning = self.sim.state()

    @property
    def whole(self) -> bool:
        """False once the Simulation has made its scheme anew, for a longer neighbour list, or Taichi was restarted."""
        return self.sim.scheme is self.scheme and self.program is ti.lang.impl.get_runtime().prog

    def begin(self, scene: Scene) -> Simulation:
        """The Simulation of a scene of this shape, at its start; the one handed out before is over."""
        require_room()
        sim = self.sim
        self.scheme.set_materials(scene.expected, scene.materials)
        sim.scene = scene
        sim.load(self.beginning)
        sim._walls_at = 0.0
        sim.walls.place(0.0)
        sim._schedules, sim._each_step, sim.stopped_by = [], [], None
        sim._clock = time.process_time(), time.perf_counter()
        sim.compile_seconds = sim.cpu_seconds = sim.wall_seconds = 0.0
        return sim
