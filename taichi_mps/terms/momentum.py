"""The implicit velocity-pressure system: its matrix as two gather passes, its diagonal, its right-hand side.

    (m/dt) u - F[2 mu D'(u) + K div(u) I] - H(u) = (m/dt) u^n + m g + F[-(p + K s) I + stress - 2 mu_r q]

The two loops over pairs are written for LLVM, which turns them into vector instructions of four numbers if vectors of
three components are kept as four, if a sum is stored whole and used in another loop only, and if the loop has a way
out. Without, LLVM takes many pairs at a time, whose numbers it must pick one by one: twice as slow. The loops over
blocks count particles, for Taichi gives a thread 512 turns of a loop or more: 512 blocks would stay in one thread.

F is the adjoint of the least-squares gradient G (gradient.py). H resists the non-affine motion that G does not see:
the gradient of sum_i (h_i/2) sum_j (w/r^2) |u_j - u_i - G_i r_ij|^2, so the matrix is symmetric positive definite.
"""

from ..particles.particles import FLUID
from ..runtime.backend import real, ti
from ..runtime.stages import stage
from ..runtime.thread_team import ONE_THREAD
from .rheology import deviator
from .sleeping import ASLEEP, AWAKE

BLOCK = 64  # particles whose sums over pairs are stored before they are used


@ti.data_oriented
class MomentumSystem:
    """Operator of the MRPCG solver; one row of d velocity components per particle, walls masked."""

    def __init__(self, particles, gradient, walls, sleeping=None):
        d = particles.dimension
        self.particles, self.gradient, self.walls, self.sleeping = particles, gradient, walls, sleeping
        self.sleeps = sleeping is not None
        self.neighbors = gradient.neighbors
        self.count = particles.count
        self.dimension, self.tensors = d, particles.tensor_dimension
        self.inertia = ti.field(real(), particles.capacity)  # rho/dt [kg/(m3 s)]
        self.bulk = ti.field(real(), ())  # K [Pa s]
        self.mu = ti.field(real(), particles.capacity)  # viscosity of the implicit part [Pa s]
        self.h = ti.field(real(), particles.capacity)  # 2V/n0 times the resistance to non-affine motion [N s m]
        self.pair_drag = ti.field(real(), self.neighbors.pair_capacity)  # (h_i + h_j) w/r^2 of each pair [kg/s]
        lanes = self.lanes = 4 if d == 3 else d
        self.motion = ti.Vector.field(lanes, real(), particles.capacity)  # u [m/s]
        # sums over pairs of u_j - u_i: d rows of its slopes [1/s], one of the drag [N]
        self.jumps = ti.Matrix.field(d + 1, lanes, real(), particles.capacity)
        self.flux = ti.Matrix.field(d, lanes, real(), particles.capacity)  # transpose of P = V T B - h G [N m]
        self.pulls = ti.Matrix.field(d, lanes, real(), particles.capacity)  # sums over pairs of the fluxes, by axis [N]
        self.inverse_diagonal = ti.Matrix.field(d, d, real(), particles.capacity)  # block Jacobi [s/kg]; 0: no unknown
        self.local = ti.Matrix.field(d, d, real(), particles.capacity)  # inertia and walls: for coarse levels [kg/s]

    @ti.func
    def unknown(self, i):
        """Whether the velocity of particle i is solved for."""
        unknown = self.particles.kind[i] == FLUID
        if ti.static(self.sleeps):
            unknown = unknown and self.sleeping.state[i] == AWAKE
        return unknown

    @ti.func
    def acts(self, i):
        """Whether the stress of particle i acts on an unknown."""
        acts = True
        if ti.static(self.sleeps):
            acts = self.sleeping.state[i] != ASLEEP
        return acts

    @ti.func
    def apply(self, u: ti.template(), y: ti.template(), team: ti.template(), member):
        """y = A u [N], zero in wall rows."""
        self._apply(u, y, 0.0, team, member)

    @ti.func
    def gather_jumps(self, u: ti.template()):
        """``jumps`` of the velocity u: walls not included."""
        for i in range(self.count[None]):
            for a in ti.static(range(self.dimension)):
                self.motion[i][a] = u[i][a]
        for i in range(self.count[None]):
            self.gather_jump(i)

    @ti.func
    def gather_jump(self, i):
        """jumps_i: the transpose of sum_j (u_j - u_i) (x) b_ij, and the drag, of the velocity ``motion``."""
        sums = ti.Matrix.zero(float, self.dimension + 1, self.lanes)
        ui = self.motion[i]
        for k in range(self.neighbors.row_start[i], self.neighbors.row_start[i + 1]):
            j = self.neighbors.column[k]
            if j < 0:  # never: the way out
                break
            jump, b, drag = self.motion[j] - ui, self.gradient.b[k], self.pair_drag[k]
            for c, a in ti.static(ti.ndrange(self.dimension, self.lanes)):
                sums[c, a] += jump[a] * b[c]
            for a in ti.static(range(self.lanes)):
                sums[self.dimension, a] += jump[a] * drag
        self.jumps[i] = sums

    @ti.func
    def gather_pull(self, i):
        """pulls_i of all flux matrices; walls not included."""
        sums = ti.Matrix.zero(float, self.dimension, self.lanes)
        Pi = self.flux[i]
        for k in range(self.neighbors.row_start[i], self.neighbors.row_start[i + 1]):
            j = self.neighbors.column[k]
            if j < 0:  # never: the way out
                break
            Pj, b = self.flux[j], self.gradient.b[k]
            for c, a in ti.static(ti.ndrange(self.dimension, self.lanes)):
                sums[c, a] += (Pi[c, a] + Pj[c, a]) * b[c]
        self.pulls[i] = sums

    @ti.func
    def velocity_gradient(self, i, u: ti.template(), motion):
        """That of ``gradient``, once the jumps of u are gathered."""
        H = ti.Matrix.zero(float, self.dimension, self.dimension)
        for a, c in ti.static(ti.ndrange(self.dimension, self.dimension)):
            H[a, c] = self.jumps[i][c, a]
        if ti.static(len(self.walls.surfaces) > 0):
            H += self.walls.gradient_term(i, self.particles.x[i], u[i], motion, self.gradient.counts_as(i))
        return self.gradient.tensor(i, H @ self.gradient.B[i], u)

    @ti.func
    def keep(self, i, P):
        """Put the matrix P of particle i into ``flux``."""
        for a, c in ti.static(ti.ndrange(self.dimension, self.dimension)):
            self.flux[i][c, a] = P[a, c]

    @ti.func
    def force(self, i):
        """Force [N] on particle i of all flux matrices, once gathered; walls included."""
        P = ti.Matrix.zero(float, self.dimension, self.dimension)
        for a, c in ti.static(ti.ndrange(self.dimension, self.dimension)):
            P[a, c] = self.flux[i][c, a]
        force = self.gradient.own_force(i, P)
        for c, a in ti.static(ti.ndrange(self.dimension, self.dimension)):
            force[a] += self.pulls[i][c, a]
        return force

    @ti.func
    def _apply(self, u: ti.template(), y: ti.template(), motion, team: ti.template(), member):
        for i in range(team.first(member, self.count[None]), team.last(member, self.count[None])):
            for a in ti.static(range(self.dimension)):
                self.motion[i][a] = u[i][a]
        team.wait()
        for first in range(team.first(member, self.count[None]), team.last(member, self.count[None])):
            if first % BLOCK == 0:
                last = ti.min(first + BLOCK, self.count[None])
                for i in range(first, last):
                    if self.acts(i):
                        self.gather_jump(i)
                for i in range(first, last):
                    self.spread(i, u, motion)
        team.wait()
        for first in range(team.first(member, self.count[None]), team.last(member, self.count[None])):
            if first % BLOCK == 0:
                last = ti.min(first + BLOCK, self.count[None])
                for i in range(first, last):
                    if self.acts(i):
                        self.gather_pull(i)
                for i in range(first, last):
                    y[i] = self.balance(i, u, motion)
        team.wait()

    @ti.func
    def spread(self, i, u: ti.template(), motion):
        """``flux`` of particle i, once the jumps of u are gathered."""
        T = ti.Matrix.zero(float, self.tensors, self.tensors)
        if self.gradient.B[i][0, 0] > 0.0 and self.acts(i):
            G = self.velocity_gradient(i, u, motion)
            T = 2.0 * self.mu[i] * deviator(G)
            T += self.bulk[None] * G.trace() * ti.Matrix.identity(float, G.n)
            self.keep(i, self.gradient.spread_stress(i, T) - self.h[i] * self.gradient.in_plane(G))
        else:
            self.keep(i, self.gradient.spread_stress(i, T))

    @ti.func
    def balance(self, i, u: ti.template(), motion):
        """Row i of A u [N], once the fluxes are gathered."""
        row = ti.Vector.zero(float, self.dimension)
        if self.unknown(i):
            total = self.force(i)
            for a in ti.static(range(self.dimension)):
                total[a] += self.jumps[i][self.dimension, a]
            if ti.static(len(self.walls.surfaces) > 0):
                total -= self.h[i] * self.walls.drag_term(i, self.particles.x[i], u[i], motion)
                if ti.static(self.walls.rub):
                    total -= self.walls.friction_term(i, self.particles.x[i], u[i], motion)
            row = self.particles.volume(i) * self.inertia[i] * u[i] - total
        return row

    @stage
    def prepare(self):
        """Pair drags and the inverse of the block diagonal for the present mu, h, K and m/dt."""
        for i in range(self.count[None]):
            end = self.neighbors.row_start[i + 1] if self.unknown(i) else self.neighbors.row_start[i]
            for k in range(self.neighbors.row_start[i], end):
                hj = self.h[self.neighbors.column[k]]
                self.pair_drag[k] = (self.h[i] + hj) * self.gradient.weight_r2[k]
        for i in range(self.count[None]):
            self.inverse_diagonal[i] = ti.Matrix.zero(float, self.dimension, self.dimension)
            self.local[i] = ti.Matrix.zero(float, self.dimension, self.dimension)
            if self.unknown(i):
                inertia = self.particles.volume(i) * self.inertia[i]
                self.local[i] = inertia * ti.Matrix.identity(float, self.dimension)
                own = ti.Vector.zero(float, self.dimension)
                drag = inertia
                A = ti.Matrix.zero(float, self.dimension, self.dimension)
                for k in range(self.neighbors.row_start[i], self.neighbors.row_start[i + 1]):
                    own -= self.gradient.b[k]
                    drag += self.pair_drag[k]
                    A += self._response(self.neighbors.column[k], self.gradient.b[k])
                if ti.static(len(self.walls.surfaces) > 0):
                    pull, wall_drag = self.walls.pull(i, self.particles.x[i])
                    own += pull
                    drag += self.h[i] * wall_drag
                    shear, bulk, _local = self.stiffness(i)
                    self.local[i] += self.walls.stiffness(i, self.particles.x[i], self.gradient.B[i], shear, bulk)
                A += self._response(i, own) + drag * ti.Matrix.identity(float, self.dimension)
                if ti.static(self.gradient.axisymmetric):
                    stiffness = 4.0 / 3.0 * self.mu[i] + self.bulk[None]
                    hoop = self.particles.volume(i) * stiffness / ti.cast(self.particles.x[i][0], float) ** 2
                    A[0, 0] += hoop
                    self.local[i][0, 0] += hoop
                self.inverse_diagonal[i] = A.inverse()

    @ti.func
    def _response(self, j, b):
        """Diagonal block [kg/s] that the stress of particle j gives to a particle which enters G_j through b."""
        v = self.gradient.B[j] @ b
        mu, volume = self.mu[j], self.particles.volume(j)
        shear = volume * mu * v.dot(v) - self.h[j] * b.dot(v)
        bulk = volume * (mu + self.bulk[None] - 2.0 * mu / self.tensors)
        return shear * ti.Matrix.identity(float, self.dimension) + bulk * v.outer_product(v)

    @ti.func
    def stiffness(self, i):
        """V mu and V (mu + K - 2 mu/t) [Pa s m3], and what resists the velocity itself [kg/s], of particle i: for the
        coarse levels (grid_levels.py)."""
        shear, bulk = ti.cast(0.0, float), ti.cast(0.0, float)
        if self.gradient.B[i][0, 0] > 0.0:
            volume, mu = self.particles.volume(i), self.mu[i]
            shear, bulk = volume * mu, volume * (mu + self.bulk[None] - 2.0 * mu / self.tensors)
        local = self.local[i]
        if not self.unknown(i):  # walls and what sleeps are held on the coarse grids, too
            local += (2.0 * shear + bulk) / self.gradient.spacing**2 * ti.Matrix.identity(float, self.dimension)
        return shear, bulk, local

    @stage
    def subtract_wall_motion(self, walls_only: ti.template(), response: ti.template(), b: ti.template()):
        """b -= A applied to the walls' own velocity alone; ``walls_only`` and ``response`` are scratch."""
        for i in range(self.count[None]):
            fluid = self.particles.kind[i] == FLUID
            walls_only[i] = ti.Vector.zero(float, self.dimension) if fluid else self.particles.u[i]
        self._apply(walls_only, response, 1.0, ONE_THREAD, 0)
        for i in range(self.count[None]):
            b[i] -= response[i]
