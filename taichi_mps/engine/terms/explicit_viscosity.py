"""Explicit predictor of the semi-implicit scheme: viscosity, body force, direct iteration (eqs 4-9, 12, 17, 18).

    u* = u^k + (dt/rho) [ (eta + Lambda) lap u^k + 2 e_ij dLambda/dx_j ] + dt F

Lambda and e belong to u* itself: guess u*, take the strain rate, the viscosity and u* again, until the relative
change is small. Whether a particle flows is decided anew every time. What the paper leaves open, and is taken here:

- The strain rate is gradient.py's least-squares fit, weighted with w/r^2 and passing through the particle's own
  velocity, over all particles, those of the walls with their own velocity (eqs 22-29). Pi = 2 e:e takes the whole e.
- lap u is that of the known velocity u^k: only the coefficients are iterated.
- dLambda/dx sums over fluid particles (eq 11); the fit at a wall particle sees fluid on one side only and would
  put a false gradient of Lambda at the wall.
- The diffusion number is taken with the largest apparent viscosity of the step before: that of unyielded material
  as soon as one particle is unyielded.

Equation 4 is not in conservation form: Lambda lap u and 2 e grad Lambda cancel only where Lambda is resolved. In a
sheared layer that needs a shear rate that changes by less than about 4 pi_c over l0; above it the gradient of Lambda
at the edge of the plug feeds itself and the layer accelerates without bound (rho g sin = 8 kPa/m, 50 Pa s, 100 Pa,
pi_c = 0.1 1/s, 10 across: 18 times the exact speed after 0.5 s and growing; 20 across: 5 % error).
"""

from ..particles.particles import DUMMY, FLUID
from ..problem.materials import FLOW_THRESHOLD
from ..runtime.backend import double_field, real, ti
from ..runtime.stages import flush, stage
from .constants import Term
from .rheology import magnitude

BLOCK = 1024  # particles per partial sum: the same bits with any number of threads


@ti.data_oriented
class ExplicitViscosity(Term):
    """Intermediate velocity u* of all fluid particles; ``newtonian`` fluids compile no yield code."""

    def __init__(self, fluid, material):
        super().__init__(fluid, gravity=fluid.gravity)
        d, capacity = self.dimension, self.capacity
        self.newtonian = material.newtonian
        self.density, self.eta, self.tau_y = material.density, material.plastic_viscosity, material.yield_value
        self.pi_c, self.largest_possible = material.softened_rate, material.unyielded_viscosity
        self.laplacian_scale = 2.0 * d / (fluid.lattice.lam * fluid.lattice.n0)
        self.u_star = ti.Vector.field(d, real(), capacity)  # newest u* [m/s]
        self.lap_u = ti.Vector.field(d, real(), capacity)  # lap u^k [1/(m s)]
        self.strain_rate = ti.Matrix.field(d, d, real(), capacity)  # e [1/s] of the guess u*0
        self.Lambda = ti.field(real(), capacity)  # tau_y / sqrt(Pi) [Pa s], eqs 5 and 9
        self.yielded = ti.field(ti.i32, capacity)  # 1 where the material flows
        # of each block sums of |change of u*|^2 and |u*|^2, and the largest apparent viscosity eta + Lambda [Pa s]
        self.partial = double_field((capacity + BLOCK - 1) // BLOCK, 3)
        self.error = double_field()  # relative change of u* in the last direct iteration [-]
        self.largest = ti.field(real(), ())  # largest apparent viscosity of the last iteration [Pa s]

    def stable_step(self, diffusion_number: float, spacing: float, viscosity: float) -> float:
        """dt [s] with nu dt/l0^2 = diffusion number."""
        return diffusion_number * spacing**2 * self.density / viscosity

    def predict(self, dt: float, tolerance: float, limit: int) -> int:
        """Fill u_star; returns the number of direct iterations (``limit`` of them at most, one without a yield
        stress)."""
        self.set_laplacian_and_guess()
        for k in range(1 if self.newtonian else limit):  # noqa: B007  (their number is returned)
            self.rate()
            self.explicit_step(dt)
            flush()
            if self.error[None] <= tolerance:
                break
        return k + 1

    @ti.func
    def yield_viscosity(self, rate):
        """Lambda [Pa s] at a shear rate [1/s]: what the yield stress adds to the plastic viscosity (eqs 5, 9)."""
        return self.tau_y / ti.max(rate, 2.0 * self.pi_c)

    @ti.func
    def is_yielded(self, rate):
        """Whether the material flows at a shear rate [1/s] (eqs 1-3); then the gradient of Lambda acts (eqs 4, 8)."""
        return rate >= 2.0 * self.pi_c

    @ti.func
    def laplacian(self, i, u: ti.template()):
        """lap u at i (eq 12), walls included."""
        ui = u[i]
        total = ti.Vector.zero(float, self.dimension)
        for k in range(self.neighbors.row_start[i], self.neighbors.row_start[i + 1]):
            total += (u[self.neighbors.column[k]] - ui) * self.gradient.pair_weight(k)
        return self.laplacian_scale * total

    @ti.func
    def gradient_of_Lambda(self, i):  # noqa: N802
        """dLambda/dx_j [Pa s/m] at i (eq 11) over fluid particles."""
        Lambda_i = self.Lambda[i]
        total = ti.Vector.zero(float, self.dimension)
        for k in range(self.neighbors.row_start[i], self.neighbors.row_start[i + 1]):
            j = self.neighbors.column[k]
            difference = self.Lambda[j] - Lambda_i if self.particles.kind[j] == FLUID else 0.0
            total += difference * self.gradient.b[k]
        return (self.dimension / self.gradient.n0) * total

    @stage("predictor")
    def set_laplacian_and_guess(self):
        """Set lap u^k, and u* to its first guess u^k."""
        for i in range(self.particles.count[None]):
            self.u_star[i] = self.particles.u[i]
            self.lap_u[i] = ti.Vector.zero(float, self.dimension)
            if self.particles.kind[i] == FLUID:
                self.lap_u[i] = self.laplacian(i, self.particles.u)

    @stage("predictor")
    def rate(self):
        """e, its magnitude sqrt(Pi) = sqrt(2 e:e), and Lambda, flowing or not (eqs 3, 5-7, 9), of the guess."""
        for i in range(self.particles.count[None]):
            if self.particles.kind[i] != DUMMY:
                G = self.gradient.velocity_gradient(i, self.u_star, 1.0)
                e = 0.5 * (G + G.transpose())
                root_pi = 2.0 * magnitude(e)
                self.strain_rate[i] = e
                self.particles.shear_rate[i] = root_pi
                if ti.static(not self.newtonian):
                    self.Lambda[i] = self.yield_viscosity(root_pi)

    @stage("predictor")
    def explicit_step(self, dt: float):
        """u* from eq 17, without the gradient of Lambda where unyielded (eq 8); relative change; largest viscosity."""
        for first in range(self.particles.count[None]):
            if first % BLOCK == 0:
                sums = ti.Vector([0.0, 0.0, self.eta], ti.f64)
                for i in range(first, ti.min(first + BLOCK, self.particles.count[None])):
                    if self.particles.kind[i] == FLUID:
                        stress_force = self.eta * self.lap_u[i]  # divergence of the viscous stress [N/m3]
                        if ti.static(not self.newtonian):
                            stress_force += self.Lambda[i] * self.lap_u[i]
                            if self.is_yielded(self.particles.shear_rate[i]):
                                stress_force += 2.0 * (self.strain_rate[i] @ self.gradient_of_Lambda(i))
                            sums[2] = ti.max(sums[2], ti.cast(self.eta + self.Lambda[i], ti.f64))
                        u = self.particles.u[i] + dt * (
                            stress_force / self.density + ti.cast(self.gravity[None], float)
                        )
                        sums[0] += ti.cast((u - self.u_star[i]).norm_sqr(), ti.f64)
                        sums[1] += ti.cast(u.norm_sqr(), ti.f64)
                        self.u_star[i] = u
                self.partial[first // BLOCK] = sums
        ti.loop_config(serialize=True)
        for _ in range(1):
            total = ti.Vector.zero(ti.f64, 3)
            for block in range((self.particles.count[None] + BLOCK - 1) // BLOCK):
                sums = self.partial[block]
                total = ti.Vector([total[0] + sums[0], total[1] + sums[1], ti.max(total[2], sums[2])])
            self.error[None] = ti.sqrt(total[0] / ti.max(total[1], 1e-300))
            self.largest[None] = ti.cast(total[2], float)

    @stage("predictor")
    def move(self, dt: float):
        """The fluid takes u* and goes to r* = r^k + dt u* (eq 18)."""
        for i in range(self.particles.count[None]):
            if self.particles.kind[i] == FLUID:
                self.particles.u[i] = self.u_star[i]
                self.particles.x[i] += ti.cast(dt * self.u_star[i], ti.f64)

    @stage("yielded")
    def mark_yielded(self):
        """Flowing where sqrt(Pi) of the last direct iteration reaches 2 pi_c (eqs 1-3)."""
        for i in range(self.particles.count[None]):
            self.yielded[i] = 1
            if ti.static(not self.newtonian):
                self.yielded[i] = self.is_yielded(self.particles.shear_rate[i])

    @ti.func
    def flows(self, i, rate):
        """Whether the viscous stress at a shear rate [1/s] is over FLOW_THRESHOLD of the yield stress."""
        return self.eta * rate > FLOW_THRESHOLD * self.tau_y

    @ti.func
    def density_of(self, i):
        """Density of particle i [kg/m3]."""
        return ti.cast(self.density, float)
