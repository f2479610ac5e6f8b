"""Removal of the momentum that the solver's tolerance adds (I25)."""

import numpy as np

from ..geometry.walls import Plane
from ..particles.particles import FLUID
from ..runtime.backend import real, ti
from ..runtime.stages import stage
from .constants import Term


def free_directions(scene, walls: str) -> np.ndarray:
    """Projector (d, d) [-] onto the directions in which nothing but gravity acts on the whole fluid: those along all
    walls, if each is a plane with slip. Zero with any other wall, with walls that are "particles", with an inlet, and
    of rings, whose radius is no direction."""
    d = scene.dimension
    held = (walls == "particles" and scene.wall_particles is not None) or scene.inlets or scene.axisymmetric
    if held or not all(isinstance(wall, Plane) and wall.slip for wall in scene.walls):
        return np.zeros((d, d))
    normals = np.array([wall.normal for wall in scene.walls]).reshape(-1, d)
    return np.eye(d) - np.linalg.pinv(normals) @ normals


@ti.data_oriented
class MomentumDrift(Term):
    """Removes the momentum that the solver's tolerance adds along the ``directions`` (a projector) that no wall holds.

    On a frictionless floor nothing but inertia resists a common motion of all particles. It weighs so little in the
    residual that a solve passes with an acceleration of 3e-4 g, and the next step begins with that.

    Of a body that ``turns`` freely, before no wall at all, it also restores the angular momentum, which fits to few
    particles and the shift change where bodies meet.
    """

    def __init__(self, fluid, constants, shifting, directions: np.ndarray, turns: bool):
        super().__init__(fluid, constants=constants, shifting=shifting, turns=turns)
        d = self.dimension
        self.directions = ti.types.matrix(d, d, ti.f64)(directions)
        self.excess = ti.Vector.field(d, real(), ())  # velocity that all particles have too much [m/s]
        self.centre = ti.Vector.field(3, ti.f64, ())  # of mass [m]
        self.excess_rotation = ti.Vector.field(3, ti.f64, ())  # angular velocity that they have too much [rad/s]

    def restore(self, dt, u) -> None:
        """Take the excess out of the velocity u [m/s] of the end of a step of dt [s]."""
        self.restore_momentum(dt, u)
        if self.turns:
            self.restore_angular_momentum(u)

    @stage("momentum")
    def restore_momentum(self, dt: float, u: ti.template()):
        """u <- u - P sum m (u - u^n - dt g)/sum m, the velocity u [m/s] of the end of the step."""
        ti.loop_config(serialize=True)
        for _ in range(1):
            momentum, mass = ti.Vector.zero(ti.f64, self.dimension), ti.cast(0.0, ti.f64)
            for i in range(self.particles.count[None]):
                if self.particles.kind[i] == FLUID:
                    m = ti.cast(self.particles.volume(i) * self.constants.density_of(i), ti.f64)
                    gain = ti.cast(u[i], ti.f64) - ti.cast(self.particles.u[i], ti.f64)
                    if ti.static(self.constants.held_density == 0.0):
                        gain -= dt * self.constants.gravity_at(i)
                    momentum += m * gain
                    mass += m
            self.excess[None] = ti.cast(self.directions @ (momentum / mass), float)
        for i in range(self.particles.count[None]):
            if self.particles.kind[i] == FLUID:
                u[i] -= self.excess[None]

    @stage("momentum")
    def restore_angular_momentum(self, u: ti.template()):
        """u <- u - w x y, y from the centre of mass, I the inertia about it: gravity turns nothing.

        w = I^-1 sum m [(y + shift) x (u - mean u) - y x u^n]
        """
        I = ti.Matrix.identity(ti.f64, 3)  # noqa: E741
        ti.loop_config(serialize=True)
        for _ in range(1):
            mass, centre, mean = ti.cast(0.0, ti.f64), ti.Vector.zero(ti.f64, 3), ti.Vector.zero(ti.f64, 3)
            for i in range(self.particles.count[None]):
                m = ti.cast(self.particles.volume(i) * self.constants.density_of(i), ti.f64)
                mass += m
                centre += m * self.three_components(self.particles.x[i])
                mean += m * self.three_components(u[i])
            centre /= mass
            inertia, gain = ti.Matrix.zero(ti.f64, 3, 3), ti.Vector.zero(ti.f64, 3)
            for i in range(self.particles.count[None]):
                m = ti.cast(self.particles.volume(i) * self.constants.density_of(i), ti.f64)
                y = self.three_components(self.particles.x[i]) - centre
                gain += m * (y + self.three_components(self.shifting.shift[i])).cross(
                    self.three_components(u[i]) - mean / mass
                )
                gain -= m * y.cross(self.three_components(self.particles.u[i]))
                inertia += m * (y.dot(y) * I - y.outer_product(y))
            self.centre[None] = centre
            self.excess_rotation[None] = (inertia + 1e-9 * inertia.trace() * I).inverse() @ gain
        for i in range(self.particles.count[None]):
            v = self.excess_rotation[None].cross(self.three_components(self.particles.x[i]) - self.centre[None])
            for a in ti.static(range(self.dimension)):
                u[i][a] -= ti.cast(v[a], float)
