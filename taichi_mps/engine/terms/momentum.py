"""The implicit velocity-pressure system: its matrix as two loops over pairs, its diagonal, its right-hand side, its
solution.

    (m/dt) u - F[2 mu D'(u) + K div(u) I] - H(u) = (m/dt) u^n + m g + F[-(p + K s) I + stress - 2 mu_r q]

F is the adjoint of the least-squares gradient G (gradient.py). H resists the zero-energy (hourglass) modes, the motion
that G does not see: the gradient of sum_i (h_i/2) sum_j (w/r^2) |u_j - u_i - G_i r_ij|^2, so the matrix is symmetric
positive definite.
"""

from ..linear.node_multigrid import NodeMultigrid
from ..linear.pcg import PCG
from ..linear.vectors import Jacobi
from ..particles.particles import FLUID
from ..runtime.backend import real, ti
from ..runtime.stages import loop_stage, no_op, sequence, stage, team_stage
from ..runtime.sums import sum_threads
from ..runtime.thread_team import first, last, wait
from .constants import Term

EARLY_TOLERANCE = 10.0  # only the last solve of a step goes down to the tolerance: the others to ten times that
# To what a solve reduces its first residual, in the last and in the other iterations: a velocity that just passes would
# go on unchanged from step to step, until it fails and is corrected by a jump.
REDUCTION, EARLY_REDUCTION = 0.1, 0.3
MAX_ITERATIONS = 2000  # of a solve
# Particles whose sums over pairs are stored before another loop uses them, for LLVM's sake (particles/pair_sums.py); on
# a GPU 1
BLOCK = 64


@ti.data_oriented
class MomentumOperator(Term):
    """The matrix, for the conjugate gradients: one row of d velocity components per particle, walls masked."""

    def __init__(self, fluid, sums, constants, stress, resistance, contacts=None):
        super().__init__(fluid, sums=sums, constants=constants, stress=stress, resistance=resistance, contacts=contacts)
        self.count, self.tensors, d = self.particles.count, self.particles.tensor_dimension, self.dimension
        self.inertia = ti.field(real(), self.capacity)  # rho/dt [kg/(m3 s)]
        # block Jacobi [s/kg], 0: no unknown; and inertia and walls, for coarse levels [kg/s]
        self.inverse_diagonal, self.local = (ti.Matrix.field(d, d, real(), self.capacity) for _ in range(2))
        self.threads = sum_threads()
        self.block = BLOCK if self.threads == 1 else 1

    @ti.func
    def unknown(self, i):
        """Whether the velocity of particle i is solved for."""
        return self.particles.kind[i] == FLUID

    @sequence("apply")
    def multiply(self, u, y):
        """y = A u [N], zero in wall rows; with grains P A P u and what their contacts add, for u = P u."""
        self.multiply_moving(u, y, 0.0)
        if ti.static(self.particles.has_grains):
            self.contacts.constrain(u, y)

    @sequence("apply")
    def multiply_moving(self, u, y, wall_motion: ti.template()):
        """y = A u [N], zero in wall rows; ``wall_motion`` 1 counts the walls' own velocity, 0 does not."""
        self.set_velocity(u)
        self.gather_fluxes(u, wall_motion)
        self.gather_forces(u, y, wall_motion)

    @loop_stage("apply")
    def set_velocity(self, u: ti.template()):
        """Put u where the neighbours of each particle see it."""
        for i in range(first(self.count[None]), last(self.count[None])):
            self.sums.set_velocity(i, u[i])
        wait()

    @loop_stage("apply")
    def gather_fluxes(self, u: ti.template(), wall_motion: ti.template()):
        """The flux of each particle."""
        blocks = (self.count[None] + self.block - 1) // self.block
        for block in range(first(blocks), last(blocks)):
            for i in range(block * self.block, ti.min((block + 1) * self.block, self.count[None])):
                self.sums.gather_difference(i)
            for i in range(block * self.block, ti.min((block + 1) * self.block, self.count[None])):
                self.set_flux(i, u, wall_motion)
        wait()

    @loop_stage("apply")
    def gather_forces(self, u: ti.template(), y: ti.template(), wall_motion: ti.template()):
        """y = A u [N] of each particle, once the fluxes are gathered."""
        blocks = (self.count[None] + self.block - 1) // self.block
        for block in range(first(blocks), last(blocks)):
            for i in range(block * self.block, ti.min((block + 1) * self.block, self.count[None])):
                self.sums.gather_fluxes(i)
            for i in range(block * self.block, ti.min((block + 1) * self.block, self.count[None])):
                y[i] = self.balance(i, u, wall_motion)
        wait()

    @ti.func
    def set_flux(self, i, u: ti.template(), wall_motion):
        """The flux of particle i, once the differences of u are gathered; zero where it carries no stress, for B is."""
        G = self.sums.velocity_gradient(i, u, wall_motion)
        T = self.stress.viscous(i, G)
        T += self.constants.bulk[None] * G.trace() * ti.Matrix.identity(float, G.n)
        self.sums.set_flux(i, self.gradient.stress_flux(i, T) - self.resistance.h[i] * self.gradient.in_plane(G))

    @ti.func
    def balance(self, i, u: ti.template(), wall_motion):
        """Row i of A u [N], once the fluxes are gathered."""
        row = ti.Vector.zero(float, self.dimension)
        if self.unknown(i):
            total = self.sums.force(i)
            for a in ti.static(range(self.dimension)):
                total[a] += self.sums.difference_sums[i][self.dimension, a]
            total -= self.resistance.h[i] * self.walls.drag_term(i, self.particles.x[i], u[i], wall_motion)[0]
            total -= self.walls.friction_term(i, self.particles.x[i], u[i], wall_motion)
            row = self.particles.volume(i) * self.inertia[i] * u[i] - total
        return row

    @stage("system")
    def assemble(self, dt: float):
        """Inertia, pair drags and the inverse of the block diagonal for the present mu, h, K and a step of dt [s]."""
        for i in range(self.count[None]):
            self.inertia[i] = self.constants.density_of(i) / dt
            end = self.neighbors.row_start[i + 1] if self.unknown(i) else self.neighbors.row_start[i]
            for k in range(self.neighbors.row_start[i], end):
                hj = self.resistance.h[self.neighbors.column[k]]
                self.sums.pair_drag[k] = (self.resistance.h[i] + hj) * self.gradient.weight_r2[k]
        for i in range(self.count[None]):
            self.inverse_diagonal[i] = ti.Matrix.zero(float, self.dimension, self.dimension)
            self.local[i] = ti.Matrix.zero(float, self.dimension, self.dimension)
            if self.unknown(i):
                inertia = self.particles.volume(i) * self.inertia[i]
                self.local[i] = inertia * ti.Matrix.identity(float, self.dimension)
                own, drag = ti.Vector.zero(float, self.dimension), inertia
                A = ti.Matrix.zero(float, self.dimension, self.dimension)
                for k in range(self.neighbors.row_start[i], self.neighbors.row_start[i + 1]):
                    own -= self.gradient.b[k]
                    drag += self.sums.pair_drag[k]
                    A += self._response(self.neighbors.column[k], self.gradient.b[k])
                shear, bulk, _local = self.stiffness(i)
                B, x = self.gradient.B[i], self.particles.x[i]
                of_walls, wall_drag, block = self.walls.coefficients(i, x, B, shear, bulk)
                own += of_walls
                drag += self.resistance.h[i] * wall_drag
                self.local[i] += block
                A += self._response(i, own) + drag * ti.Matrix.identity(float, self.dimension)
                if ti.static(self.gradient.axisymmetric):
                    stiffness = 4.0 / 3.0 * self.stress.mu[i] + self.constants.bulk[None]
                    hoop = self.particles.volume(i) * stiffness / ti.cast(self.particles.x[i][0], float) ** 2
                    A[0, 0] += hoop
                    self.local[i][0, 0] += hoop
                self.inverse_diagonal[i] = A.inverse()

    @stage("system")
    def set_reference(self, reference: ti.template()):
        """Set the norm that the residual of the solve is compared with: f . M^-1 f over all particles [W]."""
        reference[None] = 0.0
        ti.loop_config(serialize=self.threads == 1)
        for thread in range(self.threads):
            total = ti.cast(0.0, ti.f64)
            for k in range((self.count[None] - thread + self.threads - 1) // self.threads):
                i = thread + k * self.threads
                force = self.constants.reference_force[None] * self.particles.volume(i)
                total += ti.cast(self.inverse_diagonal[i].trace() * force**2, ti.f64)
            reference[None] += total / self.dimension

    @ti.func
    def _response(self, j, b):
        """Diagonal block [kg/s] that the stress of particle j gives to a particle which enters G_j through b."""
        v = self.gradient.B[j] @ b
        mu, volume = self.stress.mu[j], self.particles.volume(j)
        shear = volume * mu * v.dot(v) - self.resistance.h[j] * b.dot(v)
        bulk = volume * (mu + self.constants.bulk[None] - 2.0 * mu / self.tensors)
        return shear * ti.Matrix.identity(float, self.dimension) + bulk * v.outer_product(v)

    @ti.func
    def stiffness(self, i):
        """V mu and V (mu + K - 2 mu/t) [Pa s m3], and what resists the velocity itself [kg/s], of particle i: for the
        coarse levels (linear/node_operators.py)."""
        shear, bulk = ti.cast(0.0, float), ti.cast(0.0, float)
        if self.gradient.B[i][0, 0] > 0.0:
            volume, mu = self.particles.volume(i), self.stress.mu[i]
            shear, bulk = volume * mu, volume * (mu + self.constants.bulk[None] - 2.0 * mu / self.tensors)
        local = self.local[i]
        if not self.unknown(i):  # walls are held on the coarse grids, too
            local += (2.0 * shear + bulk) / self.gradient.spacing**2 * ti.Matrix.identity(float, self.dimension)
        return shear, bulk, local

    @team_stage("wall motion")
    def subtract_wall_motion(self, walls_only, response, b):
        """b -= A applied to the walls' own velocity alone [N]; ``walls_only`` and ``response`` are scratch. By a team:
        without one Taichi gives all loops over fewer than 512 blocks to one thread."""
        self.set_walls_only(walls_only)
        self.multiply_moving(walls_only, response, 1.0)
        self.subtract(response, b)

    @loop_stage("wall motion")
    def set_walls_only(self, v: ti.template()):
        """Set v to the walls' own velocity alone."""
        for i in range(first(self.count[None]), last(self.count[None])):
            v[i] = ti.Vector.zero(float, self.dimension) if self.particles.kind[i] == FLUID else self.particles.u[i]
        wait()

    @loop_stage("wall motion")
    def subtract(self, response: ti.template(), b: ti.template()):
        """b -= response [N]."""
        for i in range(first(self.count[None]), last(self.count[None])):
            b[i] -= response[i]
        wait()


@ti.data_oriented
class MomentumSource(Term):
    """The right-hand side of the system: inertia, gravity, pressure, the known part of the stress, and walls."""

    def __init__(self, fluid, sums, constants, stress, operator, pressure, constraint, correction, wall_stress):
        super().__init__(
            fluid,
            operator=operator,
            sums=sums,
            constants=constants,
            stress=stress,
            pressure=pressure,
            constraint=constraint,
            correction=correction,
            wall_stress=wall_stress,
        )
        walls_act = self.walls.moving or self.walls.have_friction
        self.subtract_wall_motion = operator.subtract_wall_motion if walls_act else no_op

    def evaluate(self, solver) -> None:
        """b of the solver for the present pressure, stress and slip; its p and z are scratch."""
        self.set(solver.b)
        self.subtract_wall_motion(solver.p, solver.z, solver.b)

    @stage("right-hand side")
    def set(self, b: ti.template()):
        """b = (m/dt) u^n + m g + F[-(p~ + K s) I + stress - 2 mu_r q] + what is taken back of H [N]."""
        I = ti.Matrix.identity(float, self.particles.tensor_dimension)  # noqa: E741
        for i in range(self.particles.count[None]):
            T = -(self.pressure.p[i] + self.constants.bulk[None] * self.constraint.divergence[i]) * I
            T += self.stress.known_part(i)
            flux, force = self.correction.force(i)
            if ti.static(self.walls.carry_curvature):
                G = self.gradient.curvature_correction(i)
                T += self.stress.viscous(i, G) + self.constants.bulk[None] * G.trace() * I
                flux -= self.operator.resistance.h[i] * G
            self.sums.set_flux(i, self.gradient.stress_flux(i, T) + flux)
            b[i] = force
        for i in range(self.particles.count[None]):
            self.sums.gather_fluxes(i)
        for i in range(self.particles.count[None]):
            if self.operator.unknown(i):
                volume, weight = self.particles.volume(i), self.constants.weight_of(i)
                inertia_and_weight = volume * (self.operator.inertia[i] * self.particles.u[i] + weight)
                b[i] += inertia_and_weight + self.sums.force(i)
                heavy = self.constants.head_density(i) * ti.cast(self.constants.gravity_at(i), float)
                heavy *= self.pressure.hydrostatic_fraction(self.pressure.whole(i))
                size = self.gradient.cross_section_ratio(i)
                b[i] += volume * self.walls.hydrostatic(i, self.particles.x[i], heavy, self.gradient.B[i], size)
                b[i] += volume * self.wall_stress.force(i)
            else:
                b[i] = ti.Vector.zero(float, self.dimension)


@ti.data_oriented
class OfGrains:
    """Preconditioner of P A P: that of particles, ``inner``, whose part of a grain's own particles gives way to the
    grain, with its contacts; positive definite on the range of P (G2)."""

    def __init__(self, inner, operator):
        self.inner, self.operator = inner, operator

    def build(self) -> None:
        """Build the inner one, and the mobilities of the grains."""
        self.operator.contacts.set_mobilities(self.operator.inverse_diagonal)
        self.inner.build()

    @sequence("cycle")
    def apply(self, r, z):
        """z = M^-1 r of a residual in the range of P."""
        self.inner.apply(r, z)
        self.operator.contacts.precondition(self.operator.inverse_diagonal, r, z)


@ti.data_oriented
class VelocitySolve:
    """Conjugate gradients for the momentum ``operator``, with multigrid where there are rows enough.

    ``continues``: A and M stay the same from one solve of a step to the next, which goes on from there.
    """

    def __init__(self, operator, continues: bool):
        self.operator, self.constants, self.continues = operator, operator.constants, continues
        capacity, bins = operator.particles.capacity, operator.neighbors.bins
        multigrid = NodeMultigrid(operator, bins) if capacity >= NodeMultigrid.MIN_ROWS else None
        if operator.particles.has_grains:
            multigrid = OfGrains(multigrid or Jacobi(operator), operator)
        self.solver = PCG(capacity, operator.dimension, operator, multigrid)
        self.velocity = self.solver.x  # [m/s]
        self.iterations = ti.field(ti.i32, ())  # of all solves of a step

    def prepare(self) -> None:
        """Build the preconditioner of the present operator, and set the reference of the residuals."""
        self.solver.M.build()
        self.operator.set_reference(self.solver.max_reference)

    @sequence("solve")
    def solve(self, k: ti.i32, iterations: ti.i32, tolerance: ti.f64, early_max_reduction: ti.f64):
        """Solve for the velocity with the present right-hand side, in iteration k of a step. Return the field with the
        number of iterations of the solve."""
        warm_start, min_reduction, max_reduction = 0, REDUCTION, 0.0
        if k + 1 < iterations:
            tolerance, min_reduction = EARLY_TOLERANCE * tolerance, EARLY_REDUCTION
            max_reduction = early_max_reduction
        if ti.static(self.continues):
            warm_start = min(k, 1)
        self.solver.solve(tolerance, MAX_ITERATIONS, warm_start, min_reduction, max_reduction)
        self.count_iterations(k)
        return self.solver.iterations

    @stage("solve")
    def count_iterations(self, k: ti.i32):
        """Add the iterations of the solve in iteration k to those of the step."""
        self.iterations[None] = (self.iterations[None] if k > 0 else 0) + self.solver.iterations[None]
