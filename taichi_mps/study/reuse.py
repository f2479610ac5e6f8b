"""A Simulation that is compiled once and run again with other materials.

Taichi compiles the numbers of a scheme into its kernels, so each Simulation compiles anew: 5 to 8 s for a cone that
runs in half a second. Here the kernels read those numbers from a field; another material of the law is other entries.
"""

import pickle
import time
from dataclasses import fields

from ..backend import require_room, ti
from ..material import Bingham
from ..scene import Scene
from ..schemes.implicit import Implicit, law_of
from ..simulation import Simulation


def shape_of(scene: Scene) -> bytes:
    """What of a scene is compiled: all but the numbers of its material, its end and what is read from it."""
    free = ("material", "until", "parameters", "measure", "over_time", "check", "outline")
    bare = [getattr(scene, field.name) for field in fields(scene) if field.name not in free]
    law = law_of(scene.material) if isinstance(scene.material, Bingham) else repr(scene.material)
    rubs = any(wall.friction for wall in scene.walls)  # friction keeps the viscosity of the fluid, too
    return pickle.dumps((bare, law, scene.material.plastic_viscosity if rubs else None))


class Compiled:
    """One Simulation for all scenes of one shape, by the scheme ``implicit`` with its defaults."""

    def __init__(self, scene: Scene):
        self.shape = shape_of(scene)
        self.program = ti.lang.impl.get_runtime().prog
        self.sim = Simulation(scene)
        self.beginning = self.sim.state()
        self.scheme = scheme = self.sim.scheme
        self.numbers = {name: value for name, value in vars(scheme).items() if isinstance(value, float)}
        self.field = ti.field(ti.f64, len(self.numbers))
        for name in self.numbers:
            delattr(scheme, name)
        scheme.__class__ = type(
            "ImplicitOfAnyMaterial", (Implicit,), {name: self._number(name) for name in self.numbers}
        )
        self._write()

    def _number(self, name):
        """A property of the scheme: an entry of the field where a kernel is compiled, a float elsewhere."""
        numbers, field, place = self.numbers, self.field, list(self.numbers).index(name)

        def get(_):
            if not ti.lang.impl.inside_kernel():
                return numbers[name]
            kernel = ti.lang.impl.get_runtime().compiling_callable
            return ti.cast(ti.lang.impl.subscript(kernel.ast_builder(), field, place), float)

        return property(get)

    def _write(self):
        for place, value in enumerate(self.numbers.values()):
            self.field[place] = value

    @property
    def whole(self) -> bool:
        """False once the Simulation has made its scheme anew, for a longer neighbour list, or Taichi was restarted."""
        return self.sim.scheme is self.scheme and self.program is ti.lang.impl.get_runtime().prog

    def begin(self, scene: Scene) -> Simulation:
        """The Simulation of a scene of this shape, at its start; the one handed out before is over."""
        sim = self.sim
        if scene.material != sim.scene.material:  # a scheme on the same particles, made for its numbers alone
            require_room()
            made = Implicit(scene, sim.numerics, sim.particles, sim.neighbors, sim.walls, sim.constants)
            self.numbers.update({name: vars(made)[name] for name in self.numbers})
            sim.scheme.system.bulk[None] = made.bulk
            self._write()
        sim.scene = scene
        sim.load(self.beginning)
        sim._walls_at = 0.0
        sim.walls.place(0.0)
        sim._schedules, sim._each_step, sim.stopped_by = [], [], None
        sim._clock = time.process_time(), time.perf_counter()
        sim.compile_seconds = sim.cpu_seconds = sim.wall_seconds = 0.0
        return sim
