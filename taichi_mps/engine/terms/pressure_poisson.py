"""Pressure of the semi-implicit scheme: Poisson equation at r* and the correction it gives (eqs 19-21).

    lap P = -(rho/dt^2) (n* - n0)/n0        P = 0 where n* < 0.97 n0 (free surface)
    u' = -(dt/rho) grad P,   u^{k+1} = u* + u',   r^{k+1} = r* + dt u'

Fluid and wall particles carry pressure, dummy wall particles none: they are left out of the Laplacian (no flow
through the wall). Times -lambda n0/(2 d) the equation is symmetric positive definite:
A_ii = sum w, A_ij = -w, b = (lambda n0/(2 d)) (rho/dt^2) (n* - n0)/n0. Eq 19 has negative pressures, too; practice
sets them to zero (S2; Koshizuka, Nobe, Oka, International Journal for Numerical Methods in Fluids 26 (1998), 751-769).
"""

from ..linear.pcg import PCG
from ..linear.vectors import SparseMatrix
from ..particles.particles import DUMMY, FLUID
from ..runtime.backend import ti
from ..runtime.stages import flush, stage
from .constants import Term

MAX_ITERATIONS = 2000  # of a solve
FREE_SURFACE = 0.97  # n*/n0 below which a particle lies on the free surface
# Rate at which the mixed source removes the density error [1/s], and the largest part that it removes in a step
DENSITY_RATE, DENSITY_PART = 200.0, 0.2


@ti.data_oriented
class PressurePoisson(Term):
    """Pressure P^{k+1} at r*, from ``gradient`` built there.

    Source, ``literal``: eq 19, the paper's. The whole density error is removed in one step, so velocities of l0/dt
    times that error appear: in a pool of 50 Pa s at rest 0.4 m/s and 1.6-4.8 rho g h of pressure error after 0.8 s.
    Else mixed (S4): lap P = (rho/dt) div u* - gamma (rho/dt^2) (n* - n0)/n0, gamma = min(0.2, dt 200 1/s): MPS-Basic's
    fifth in its step of a millisecond, and at the same rate in shorter ones, of which a thin layer may
    need a hundred times as many. (Tanaka, Masunaga, Journal of Computational Physics 229 (2010), 4279-4290, with a
    gamma of each step.)

    Gradient, ``literal``: eq 11 with P_j - P_i, the paper's. It attracts as well as repels: particles clump, n* of a
    pair that meets explodes, and a slump of 100 Pa (l0 = 0.02 m) ends at 0.15 s with either source.
    Else (S1): eq 11 with P_j - min_k P_k, k over the neighbours and i itself: all forces push (Koshizuka, Oka, Nuclear
    Science and Engineering 123 (1996), 421-434). Momentum is not kept.
    """

    def __init__(self, fluid, density: float, literal: bool):
        super().__init__(fluid, density=density, literal=literal, n0=fluid.lattice.n0)
        self.scale = fluid.lattice.lam * self.n0 / (2.0 * self.dimension)  # of the Laplacian, eq 12 [m2]
        self.matrix = SparseMatrix(self.capacity, self.neighbors.row_start, self.neighbors.column, self.particles.count)
        self.solver = PCG(self.capacity, 1, self.matrix)

    def solve(self, dt: float, tolerance: float) -> None:
        """P^{k+1} into particles.p."""
        self.assemble(dt, self.solver.b, self.solver.x)
        self.balance(self.solver.b)
        flush()
        self.solver.solve(tolerance, MAX_ITERATIONS, 0, 1.0, 0.0)
        self.store(self.solver.x)

    @ti.func
    def carries(self, i):
        """1 where P is an unknown: fluid and wall particles inside the fluid."""
        return self.particles.kind[i] != DUMMY and self.gradient.n[i] >= FREE_SURFACE * self.n0

    @ti.func
    def divergence(self, i):
        """div u* [1/s] at r* (eq 11), walls included."""
        total = ti.cast(0.0, float)
        for k in range(self.neighbors.row_start[i], self.neighbors.row_start[i + 1]):
            total += (self.particles.u[self.neighbors.column[k]] - self.particles.u[i]).dot(self.gradient.b[k])
        return (self.dimension / self.n0) * total

    @stage("pressure matrix")
    def assemble(self, dt: float, b: ti.template(), x: ti.template()):
        """Matrix, right-hand side, and the last pressure as the first guess."""
        for i in range(self.particles.count[None]):
            diagonal, source = ti.cast(0.0, float), ti.cast(0.0, float)
            if self.carries(i):
                excess = (self.gradient.n[i] - self.n0) / self.n0
                if ti.static(self.literal):
                    source = self.density / (dt * dt) * excess
                else:
                    density_weight = ti.min(DENSITY_PART, DENSITY_RATE * dt)
                    source = self.density / dt * (density_weight / dt * excess - self.divergence(i))
                for k in range(self.neighbors.row_start[i], self.neighbors.row_start[i + 1]):
                    j = self.neighbors.column[k]
                    w = self.gradient.pair_weight(k)
                    diagonal += w if self.particles.kind[j] != DUMMY else 0.0
                    self.matrix.value[k] = -w if self.carries(j) else 0.0
            else:
                for k in range(self.neighbors.row_start[i], self.neighbors.row_start[i + 1]):
                    self.matrix.value[k] = 0.0
            self.matrix.set_diagonal(i, diagonal)
            b[i][0] = self.scale * source
            x[i][0] = self.particles.p[i] if diagonal > 0.0 else 0.0

    @stage("pressure matrix")
    def balance(self, b: ti.template()):
        """A closed box without any free surface knows P up to a constant: take the mean out of b."""
        ti.loop_config(serialize=True)
        for _ in range(1):
            surface, unknowns = 0, 0
            total = ti.cast(0.0, ti.f64)
            for i in range(self.particles.count[None]):
                if self.carries(i):
                    unknowns += 1
                    total += ti.cast(b[i][0], ti.f64)
                elif self.particles.kind[i] != DUMMY:
                    surface += 1
            if surface == 0 and unknowns > 0:
                for i in range(self.particles.count[None]):
                    if self.carries(i):
                        b[i][0] -= ti.cast(total / unknowns, float)

    @stage("corrector")
    def store(self, x: ti.template()):
        for i in range(self.particles.count[None]):
            self.particles.p[i] = x[i][0] if ti.static(self.literal) else ti.max(0.0, x[i][0])

    @ti.func
    def subtracted(self, i):
        """The pressure [Pa] that is taken from those of the neighbours: that of i, or the smallest around it."""
        pressure = self.particles.p[i]
        if ti.static(not self.literal):
            for k in range(self.neighbors.row_start[i], self.neighbors.row_start[i + 1]):
                j = self.neighbors.column[k]
                if self.particles.kind[j] != DUMMY and self.gradient.weight_r2[k] > 0.0:
                    pressure = ti.min(pressure, self.particles.p[j])
        return pressure

    @ti.func
    def pressure_gradient(self, i):
        """grad P [Pa/m] at i over particles that carry pressure; a dummy repeats the values of i."""
        own, subtracted = self.particles.p[i], self.subtracted(i)
        total = ti.Vector.zero(float, self.dimension)
        for k in range(self.neighbors.row_start[i], self.neighbors.row_start[i + 1]):
            j = self.neighbors.column[k]
            other = self.particles.p[j] if self.particles.kind[j] != DUMMY else own
            total += (self.dimension / self.n0) * (other - subtracted) * self.gradient.b[k]
        return total

    @stage("corrector")
    def correct(self, dt: float):
        """u^{k+1} = u* + u' and r^{k+1} = r* + dt u' (eqs 20, 21)."""
        for i in range(self.particles.count[None]):
            if self.particles.kind[i] == FLUID:
                change = -dt / self.density * self.pressure_gradient(i)
                self.particles.u[i] += change
                self.particles.x[i] += ti.cast(dt * change, ti.f64)
