"""Collisions of particles that meet: a piece of MPS practice that the paper does not mention (S3).

Where two particles nearer than DISTANCE l0 approach each other, each gets half of the impulse that leaves them with
RESTITUTION times the approaching speed along their line; one that meets a wall particle gets the same half:

    u*_i <- u*_i - (1 + e)/2 sum_j max(0, (u*_i - u*_j) . n_ij) n_ij      n_ij = r_ij/|r_ij|

Source: Koshizuka, Tamako, Oka, Computational Fluid Dynamics Journal 4 (1995), 29-46, and the code MPS-Basic of
Koshizuka, Shibata, Kondo, Matsunaga, Moving Particle Semi-implicit Method (Academic Press, 2018).
"""

from ..particles.particles import FLUID
from ..runtime.backend import real, ti
from ..runtime.stages import stage

DISTANCE = 0.5  # over the spacing
RESTITUTION = 0.2


@ti.data_oriented
class Collisions:
    """Impulses between particles that meet."""

    def __init__(self, particles, gradient, spacing: float):
        self.particles, self.gradient, self.neighbors = particles, gradient, gradient.neighbors
        self.near2 = (DISTANCE * spacing) ** 2
        self.half_impulse = 0.5 * (1.0 + RESTITUTION)
        self.change = ti.Vector.field(particles.dimension, real(), particles.capacity)  # of the velocity [m/s]

    @stage("collisions")
    def apply(self, u: ti.template()):
        """Change the velocities u [m/s] of fluid particles; the pairs are those of the last ``gradient``."""
        for i in range(self.particles.count[None]):
            change = ti.Vector.zero(float, self.particles.dimension)
            if self.particles.kind[i] == FLUID:
                for k in range(self.neighbors.row_start[i], self.neighbors.row_start[i + 1]):
                    b, w_r2 = self.gradient.b[k], self.gradient.weight_r2[k]
                    if b.dot(b) < self.near2 * w_r2 * w_r2:  # b = (w/r^2) r_ij
                        approach = (u[i] - u[self.neighbors.column[k]]).dot(b)
                        if approach > 0.0:
                            change -= self.half_impulse * approach / b.dot(b) * b
            self.change[i] = change
        for i in range(self.particles.count[None]):
            u[i] += self.change[i]


class NoCollisions:
    """Particles pass through each other, as in the equations alone."""

    def apply(self, u) -> None:
        """Nothing."""
