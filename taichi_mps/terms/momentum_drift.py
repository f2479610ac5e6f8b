"""Where no wall can take momentum the fluid keeps its own: what the solver's tolerance adds to it is taken out.

On a frictionless floor nothing but inertia resists a common motion of all particles. It weighs so little in the
residual that a solve passes with an acceleration of 3e-4 g, and the next step begins with that.
"""

import numpy as np

from ..geometry.walls import Plane
from ..particles.particles import FLUID
from ..runtime.backend import real, ti
from ..runtime.stages import stage


def free_directions(scene, walls: str) -> np.ndarray:
    """Projector (d, d) [-] onto the directions in which nothing but gravity acts on the whole fluid: those along all
    walls, if each is a plane with slip. Zero with any other wall, with walls that are "particles", with an inlet, and
    of rings, whose radius is no direction."""
    d = scene.dimension
    particles = walls == "particles" and scene.wall_particles is not None
    held = particles or scene.inlets or scene.axisymmetric
    if held or not all(isinstance(wall, Plane) and wall.slip for wall in scene.walls):
        return np.zeros((d, d))
    normals = np.array([wall.normal for wall in scene.walls]).reshape(-1, d)
    return np.eye(d) - np.linalg.pinv(normals) @ normals if len(normals) else np.eye(d)


class NoMomentumDrift:
    """Of a scene whose walls can take momentum in every direction."""

    def restore(self, dt, u):
        """Nothing."""


@ti.data_oriented
class MomentumDrift:
    """Total momentum of the fluid along the ``directions`` (a projector) of a scene."""

    def __init__(self, particles, constants, directions: np.ndarray, gravity):
        d = particles.dimension
        self.particles, self.constants = particles, constants
        self.directions = ti.types.matrix(d, d, ti.f64)(directions)
        self.g = ti.types.vector(d, ti.f64)(gravity)
        self.excess = ti.Vector.field(d, real(), ())  # velocity that all particles have too much [m/s]

    @stage("momentum")
    def restore(self, dt: float, u: ti.template()):
        """u <- u - P sum m (u - u^n - dt g)/sum m, the velocity u [m/s] of the end of the step."""
        ti.loop_config(serialize=True)
        for _ in range(1):
            momentum, mass = ti.Vector.zero(ti.f64, self.particles.dimension), ti.cast(0.0, ti.f64)
            for i in range(self.particles.count[None]):
                if self.particles.kind[i] == FLUID:
                    m = ti.cast(self.particles.volume(i) * self.constants.density_of(i), ti.f64)
                    momentum += m * (ti.cast(u[i], ti.f64) - ti.cast(self.particles.u[i], ti.f64) - dt * self.g)
                    mass += m
            self.excess[None] = ti.cast(self.directions @ (momentum / mass), float)
        for i in range(self.particles.count[None]):
            if self.particles.kind[i] == FLUID:
                u[i] -= self.excess[None]
