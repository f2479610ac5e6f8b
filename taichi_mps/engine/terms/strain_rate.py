"""Velocity gradient and shear rate of each particle, before and after the velocity is solved for (I2, I4, I32)."""

from ..particles.particles import FLUID
from ..runtime.backend import real, ti
from ..runtime.stages import stage
from .constants import Term
from .rheology import shear_rate


@ti.data_oriented
class StrainRate(Term):
    """Velocity gradient, shear rate and residual of the fit (gradient.py) of the velocity that particles carry."""

    def __init__(self, fluid, sums):
        super().__init__(fluid)
        # transpose of the velocity gradient in the plane [1/s]; in space with rows of four, for vector instructions
        self.G = ti.Matrix.field(self.dimension, sums.lanes, real(), self.capacity)
        self.rate = ti.field(real(), self.capacity)  # shear rate sqrt(2 D:D) [1/s]
        self.residual = ti.field(real(), self.capacity)  # (1/n0) sum (w/r^2) |u_j - u_i - G_i r_ij|^2 [1/s2]
        t = self.particles.tensor_dimension
        # decrease of a gradient when the particles move from the middle of the step to its end (I32) [1/s]
        self.half_step_change = ti.Matrix.field(t, t, real(), self.capacity)

    @stage("prepare")
    def evaluate(self, dt: float):
        """Fit the velocity around each particle, at the middle of a step of dt [s]."""
        for i in range(self.particles.count[None]):
            G, residual = self.gradient.fit(i, self.particles.u, 1.0)
            G += self.gradient.curvature_correction(i)
            for a, c in ti.static(ti.ndrange(self.dimension, self.dimension)):
                self.G[i][c, a] = G[a, c]
            self.rate[i], self.residual[i] = shear_rate(G), residual
            self.half_step_change[i] = 0.5 * dt * G @ G

    @ti.func
    def velocity_gradient(self, i):
        """The gradient (t, t) at particle i of the velocity at the start of the step [1/s]."""
        return self.gradient.tensor(i, self.gradient.in_plane(self.G[i].transpose()), self.particles.u)


@ti.data_oriented
class SolvedRate(Term):
    """Velocity gradient of the velocity that the system was solved for."""

    def __init__(self, fluid, sums, strain_rate):
        super().__init__(fluid, sums=sums, strain_rate=strain_rate)
        t = self.particles.tensor_dimension
        self.G = ti.Matrix.field(t, t, real(), self.capacity)  # velocity gradient [1/s]

    @stage("stress")
    def evaluate(self, u: ti.template()):
        """Gradient of the velocity u [m/s], walls with their own; its shear rate is the particles' from now on."""
        for i in range(self.particles.count[None]):
            if self.particles.kind[i] != FLUID:
                u[i] = self.particles.u[i]
        self.sums.gather_differences(u)
        for i in range(self.particles.count[None]):
            G = self.sums.velocity_gradient(i, u, 1.0) + self.gradient.curvature_correction(i)
            self.G[i] = G
            self.particles.shear_rate[i] = shear_rate(G - self.strain_rate.half_step_change[i])

    @ti.func
    def velocity_gradient(self, i):
        """The gradient (t, t) at particle i of the solved velocity [1/s]."""
        return self.G[i]
