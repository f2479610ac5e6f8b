"""Friction of the walls in the implicit system: the slip at the start of a step, and after each iteration (I23)."""

from ..runtime.backend import real, ti
from ..runtime.stages import stage


class NoWallFriction:
    """Of a scene without friction."""

    def start(self, dt):
        """Nothing."""

    def update(self, u):
        """Nothing."""


@ti.data_oriented
class WallFriction:
    """What the walls' friction (boundaries/friction.py) needs of the fluid."""

    def __init__(self, particles, gradient, walls, constants, pressure, stress, resistance, solved_rate, gravity):
        self.particles, self.gradient, self.walls, self.constants = particles, gradient, walls, constants
        self.pressure, self.stress, self.resistance, self.solved_rate = pressure, stress, resistance, solved_rate
        self.g = ti.types.vector(particles.dimension, real())(gravity)

    def start(self, dt):
        """Penalty and slip at the start of a step of dt [s]."""
        self.walls.set_friction_penalty(self.constants.materials[0].density / dt)
        self.begin_slip()

    @stage("friction")
    def begin_slip(self):
        """The slip that each particle brings along to the walls with friction."""
        for i in range(self.particles.count[None]):
            mu = self.stress.viscosity(i, self.particles.shear_rate[i])
            volume, size = self.particles.volume(i), self.gradient.cross_section_ratio(i)
            B = self.gradient.B[i]
            self.walls.start_slip(i, self.particles.x[i], self.particles.u[i], B, volume, mu, size)

    @stage("friction")
    def update(self, u: ti.template()):
        """Slip and traction for all that each particle gives to the walls: stress, pressure, hourglass resistance."""
        for i in range(self.particles.count[None]):
            T = self.stress.total(i)
            T -= self.pressure.p[i] * ti.Matrix.identity(float, T.n)
            B, x, h = self.gradient.B[i], self.particles.x[i], self.resistance.h[i]
            G = self.solved_rate.velocity_gradient(i)
            flux = self.gradient.spread_stress(i, T) - h * self.gradient.in_plane(G)
            weight = self.particles.volume(i) * self.constants.density_of(i) * self.g
            weight *= self.constants.pressed(self.pressure.p[i])
            size, mu = self.gradient.cross_section_ratio(i), self.stress.mu[i]
            self.walls.update_slip(i, x, u[i], flux, weight, B, mu, h, size)
