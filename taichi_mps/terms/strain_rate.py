"""The velocity gradient: at the start of a step, with what the linear fit leaves of it; and of the solved velocity."""

from ..particles.particles import FLUID
from ..runtime.backend import real, ti
from ..runtime.stages import stage
from .rheology import shear_rate


@ti.data_oriented
class StrainRate:
    """Velocity gradient, shear rate and residual of the fit (gradient.py) of the velocity that particles carry."""

    def __init__(self, particles, gradient, sums):
        self.particles, self.gradient = particles, gradient
        self.dimension = particles.dimension
        # transpose of the velocity gradient in the plane [1/s]; lanes as in pair_sums.py
        self.G = ti.Matrix.field(self.dimension, sums.lanes, real(), particles.capacity)
        self.rate = ti.field(real(), particles.capacity)  # shear rate sqrt(2 D:D) [1/s]
        self.residual = ti.field(real(), particles.capacity)  # (1/n0) sum (w/r^2) |u_j - u_i - G_i r_ij|^2 [1/s2]

    @stage("prepare")
    def evaluate(self):
        """Fit the velocity around each particle."""
        for i in range(self.particles.count[None]):
            G, residual = self.gradient.fit(i, self.particles.u, 1.0)
            G += self.gradient.bow(i)
            for a, c in ti.static(ti.ndrange(self.dimension, self.dimension)):
                self.G[i][c, a] = G[a, c]
            self.rate[i], self.residual[i] = shear_rate(G), residual

    @ti.func
    def velocity_gradient(self, i):
        """The gradient (t, t) at particle i of the velocity at the start of the step [1/s]."""
        G = ti.Matrix.zero(float, self.dimension, self.dimension)
        for a, c in ti.static(ti.ndrange(self.dimension, self.dimension)):
            G[a, c] = self.G[i][c, a]
        return self.gradient.tensor(i, G, self.particles.u)


@ti.data_oriented
class SolvedRate:
    """Velocity gradient of the velocity that the system was solved for."""

    def __init__(self, particles, gradient, sums):
        self.particles, self.gradient, self.sums = particles, gradient, sums
        t = particles.tensor_dimension
        self.G = ti.Matrix.field(t, t, real(), particles.capacity)  # velocity gradient [1/s]

    @stage("stress")
    def update(self, u: ti.template()):
        """For the velocity u [m/s], walls with their own; the shear rate is the particles' from now on."""
        for i in range(self.particles.count[None]):
            if self.particles.kind[i] != FLUID:
                u[i] = self.particles.u[i]
        self.sums.gather_jumps(u)
        for i in range(self.particles.count[None]):
            G = self.sums.velocity_gradient(i, u, 1.0) + self.gradient.bow(i)
            self.G[i] = G
            self.particles.shear_rate[i] = shear_rate(G)

    @ti.func
    def velocity_gradient(self, i):
        """Of particle i (t, t) [1/s]."""
        return self.G[i]
