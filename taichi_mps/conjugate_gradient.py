"""The steps of a preconditioned conjugate gradient, each of them what a member of a team (team.py) does of its loops.

Sources: Saad, Iterative Methods for Sparse Linear Systems (2003), algorithm 9.1; Fischer, Projection techniques for
iterative solution of Ax = b with successive right-hand sides, Computer Methods in Applied Mechanics and Engineering 163
(1998), 193-204.
"""

from .backend import double_field, real, ti

BLOCK = 1024  # rows per partial sum: a dot product has the same bits with any number of threads
HUGE = 1e38  # not (|s| < HUGE) finds NaN and infinity, also under fast_math
LEAST = 1e-4  # part of the norm that the tolerance is compared with, below which no residual need be reduced
RUNNING, CONVERGED, INDEFINITE, BROKEN = range(4)
STATUS = "limit", "converged", "indefinite", "broken"  # how a solve ended; indefinite: p.Ap <= 0 or r.z < 0


@ti.data_oriented
class ConjugateGradient:
    """Fields and steps. The caller computes q = A p before ``move`` and z = M^-1 r before ``refer``, ``begin`` and
    ``turn``; see MRPCG for the operator."""

    def __init__(self, capacity: int, components: int, operator):
        self.operator = operator
        self.real = real()
        unknowns = [ti.Vector.field(components, self.real, capacity) for _ in range(9)]
        self.b, self.x = unknowns[:2]  # right-hand side; initial guess in, solution out
        self.r, self.z, self.p, self.q = unknowns[2:6]  # b - A x, M^-1 r, search direction, A p
        self.first_x, self.first_r, self.last_b = unknowns[6:]  # of the last solve: where it began, and its b
        scalars = [double_field() for _ in range(8)]
        self.rz, self.rz_new, self.pq, self.xx = scalars[:4]  # r.z, the next one, p.Ap, x.x of the guess
        self.reference, self.target = scalars[4:6]  # b.M^-1 b, where r.z is small enough
        self.step = scalars[6]  # alpha, then beta
        self.first = scalars[7]  # r.z at the start
        self.partial = double_field((capacity + BLOCK - 1) // BLOCK)
        self.status = ti.field(ti.i32, ())
        self.iterations = ti.field(ti.i32, ())
        self.active = ti.field(ti.i32, ())  # rows worked on: all while running, then none (extra steps do nothing)

    @ti.func
    def masked(self, i, v):
        """v, or zero where row i is not an unknown."""
        return ti.select(ti.abs(self.operator.inverse_diagonal[i]).sum() > 0, v, ti.zero(v))

    @ti.func
    def dot(self, a: ti.template(), b: ti.template(), out: ti.template(), team: ti.template(), member):
        """out = a.b, partial sums of BLOCK rows in f64, then their sum in order."""
        for first in range(team.first(member, self.active[None]), team.last(member, self.active[None])):
            if first % BLOCK == 0:
                s = ti.cast(0.0, ti.f64)
                for i in range(first, ti.min(first + BLOCK, self.active[None])):
                    s += ti.cast(a[i].dot(b[i]), ti.f64)
                self.partial[first // BLOCK] = s
        team.wait()
        ti.loop_config(serialize=True)
        for _ in range(team.first(member, 1), team.last(member, 1)):
            s = ti.cast(0.0, ti.f64)
            for k in range((self.active[None] + BLOCK - 1) // BLOCK):
                s += self.partial[k]
            out[None] = s
        team.wait()

    @ti.func
    def stop(self, status):
        self.status[None] = status
        self.active[None] = 0

    @ti.func
    def judge(self):
        """Stop if r.z is small enough, or is not the square of a norm."""
        if not (ti.abs(self.rz[None]) < HUGE):
            self.stop(BROKEN)
        elif ti.abs(self.rz[None]) <= self.target[None]:
            self.stop(CONVERGED)
        elif self.rz[None] < 0.0:
            self.stop(INDEFINITE)

    @ti.func
    def precondition(self, team: ti.template(), member):
        """z = D^-1 r."""
        for i in range(team.first(member, self.active[None]), team.last(member, self.active[None])):
            self.z[i] = self.operator.inverse_diagonal[i] @ self.r[i]
        team.wait()

    @ti.func
    def move(self, team: ti.template(), member):
        """alpha = r.z / p.q;  x += alpha p;  r -= alpha q, with q = A p."""
        self.dot(self.p, self.q, self.pq, team, member)
        ti.loop_config(serialize=True)
        for _ in range(team.first(member, 1), team.last(member, 1)):
            if self.status[None] == RUNNING:
                if not (ti.abs(self.pq[None]) < HUGE):
                    self.stop(BROKEN)
                elif self.pq[None] <= 0.0:
                    self.stop(INDEFINITE)
                else:
                    self.step[None] = self.rz[None] / self.pq[None]
        team.wait()
        for i in range(team.first(member, self.active[None]), team.last(member, self.active[None])):
            alpha = ti.cast(self.step[None], self.real)
            self.x[i] += alpha * self.p[i]
            self.r[i] = self.masked(i, self.r[i] - alpha * self.q[i])
        team.wait()

    @ti.func
    def turn(self, team: ti.template(), member):
        """beta = (r.z) new / old;  p = z + beta p."""
        self.dot(self.r, self.z, self.rz_new, team, member)
        ti.loop_config(serialize=True)
        for _ in range(team.first(member, 1), team.last(member, 1)):
            if self.status[None] == RUNNING:
                self.iterations[None] += 1
                self.step[None] = self.rz_new[None] / self.rz[None]
                self.rz[None] = self.rz_new[None]
                self.judge()
        team.wait()
        for i in range(team.first(member, self.active[None]), team.last(member, self.active[None])):
            self.p[i] = self.z[i] + ti.cast(self.step[None], self.real) * self.p[i]
        team.wait()

    @ti.func
    def load(self, team: ti.template(), member):
        self.active[None] = self.operator.count[None]
        for i in range(team.first(member, self.active[None]), team.last(member, self.active[None])):
            self.r[i] = self.masked(i, self.b[i])
            self.last_b[i] = self.b[i]
        team.wait()

    @ti.func
    def go_on(self, team: ti.template(), member):
        """r of the last x and the present b; then x and r at the best point along the last change of x."""
        self.active[None] = self.operator.count[None]
        for i in range(team.first(member, self.active[None]), team.last(member, self.active[None])):
            self.p[i] = self.x[i] - self.first_x[i]
            self.q[i] = self.first_r[i] - self.r[i]
            self.r[i] += self.masked(i, self.b[i] - self.last_b[i])
            self.last_b[i] = self.b[i]
        team.wait()
        self.dot(self.p, self.r, self.rz, team, member)
        self.dot(self.p, self.q, self.pq, team, member)
        ti.loop_config(serialize=True)
        for _ in range(team.first(member, 1), team.last(member, 1)):
            best = self.rz[None] / self.pq[None] if self.pq[None] > 0.0 else 0.0
            self.step[None] = ti.max(0.0, ti.min(1.0, best))  # q of a tiny change is rounding: never blow it up
        team.wait()
        for i in range(team.first(member, self.active[None]), team.last(member, self.active[None])):
            self.first_x[i], self.first_r[i] = self.x[i], self.r[i]
            self.x[i] += ti.cast(self.step[None], self.real) * self.p[i]
            self.r[i] -= ti.cast(self.step[None], self.real) * self.q[i]
        team.wait()

    @ti.func
    def refer(self, team: ti.template(), member):
        """b.M^-1 b, and the guess as the direction p, to be multiplied next."""
        self.dot(self.r, self.z, self.reference, team, member)
        self.dot(self.x, self.x, self.xx, team, member)
        for i in range(team.first(member, self.active[None]), team.last(member, self.active[None])):
            self.p[i] = self.x[i]
        team.wait()

    @ti.func
    def subtract_guess(self, team: ti.template(), member):
        """r = b - q, with q = A x; where a solve begins."""
        for i in range(team.first(member, self.active[None]), team.last(member, self.active[None])):
            self.r[i] = self.masked(i, self.b[i] - self.q[i])
        team.wait()
        self.note(team, member)

    @ti.func
    def note(self, team: ti.template(), member):
        """Where a solve begins."""
        for i in range(team.first(member, self.active[None]), team.last(member, self.active[None])):
            self.first_x[i], self.first_r[i] = self.x[i], self.r[i]
        team.wait()

    @ti.func
    def begin(self, tolerance, limit, reduction, enough, team: ti.template(), member):
        """p = z; what r.z is compared with: that of the reference, at most ``limit``, and that of the guess."""
        self.dot(self.r, self.z, self.rz, team, member)
        ti.loop_config(serialize=True)
        for _ in range(team.first(member, 1), team.last(member, 1)):
            self.status[None] = RUNNING
            self.iterations[None] = 0
            self.first[None] = self.rz[None]
            self.reference[None] = ti.min(self.reference[None], limit)
            if self.reference[None] == 0.0:
                self.reference[None] = self.rz[None]
            first, norm = ti.abs(self.rz[None]), ti.abs(self.reference[None])
            least = ti.max(reduction * reduction * first, LEAST * LEAST * norm)
            self.target[None] = ti.max(ti.min(tolerance * tolerance * norm, least), enough * enough * first)
            self.judge()
        team.wait()
        for i in range(team.first(member, self.active[None]), team.last(member, self.active[None])):
            self.p[i] = self.z[i]
        team.wait()
