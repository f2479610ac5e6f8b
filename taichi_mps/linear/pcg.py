"""MRPCG: multi-resolution preconditioned conjugate gradient; its coarse levels are made from the binning grid.

Solves A x = b for any symmetric positive definite operator; knows no physics. Preconditioners M:

    Jacobi        M^-1 = D^-1, the inverse (block) diagonal: the cheapest for few rows
    cell levels   M^-1 = one symmetric W-cycle over the cells of the binning grid (CellMultigrid): a matrix in rows
    grid levels   M^-1 = D^-1 + a V-cycle over grids of the corners of these cells (NodeMultigrid): no matrix
"""

from dataclasses import dataclass

import numpy as np

from ..runtime.backend import double_field, real, ti
from ..runtime.stages import stage
from ..runtime.thread_team import ONE_THREAD, team
from .node_multigrid import NodeMultigrid

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


@dataclass
class SolveReport:
    """How a solve ended; ``iterations`` is where the tolerance was first met, or the number done."""

    status: str  # one of STATUS
    iterations: int
    residuals: list[float]  # sqrt(r.z / b.M^-1 b) at the start, at every check and at the end

    @property
    def converged(self) -> bool:
        return self.status == "converged"


@ti.data_oriented
class MRPCG(ConjugateGradient):
    """Preconditioned conjugate gradient for the unknowns x_i of ``components`` numbers, i < operator.count.

    operator: a @ti.data_oriented object with
        count              0-D i32 field: rows in use
        apply(x, y, team, member)   ti.func, y = A x, of whose loops this does the part of a member (team.py)
        inverse_diagonal   matrix field: inverse of the diagonal blocks; a zero block marks a row that is not an
                           unknown: its x is left as it is, its residual and direction are zero
    levels: a CellMultigrid or NodeMultigrid, used while ``use_levels`` is true; see ``prepare``.

    Stops at sqrt(r.z) <= tolerance sqrt(b.M^-1 b), z = M^-1 r (from the first r.z if b = 0), and not before sqrt(r.z)
    is ``reduction`` times the first one or 1e-4 sqrt(b.M^-1 b); but in any case where it is ``enough`` times the first.
    Solves that follow each other with the same A and M may go on ``again`` from the last one: from its x, whose
    residual is then known, and from there to the best point along its change of x (Fischer's projection onto a single
    vector).
    """

    def __init__(self, capacity: int, components: int, operator, levels=None, check_every: int = 5):
        super().__init__(capacity, components, operator)
        self.levels, self.check_every = levels, check_every
        self.team = team(capacity)
        self.use_levels = levels is not None
        self.has_grids = isinstance(levels, NodeMultigrid)
        self.round = ti.field(ti.i32, ())  # see go_through

    def prepare(self) -> None:
        """Use the levels, rebuilt for the matrix as it is now, where they pay; Jacobi elsewhere."""
        self.use_levels = self.levels is not None and self.operator.count[None] >= self.levels.PAY_FROM
        if self.use_levels:
            self.levels.build()

    def solve(
        self,
        tolerance: float,
        max_iterations: int = 1000,
        reference: float | None = None,
        again: bool = False,
        reduction: float = 1.0,
        enough: float = 0.0,
    ) -> SolveReport:
        """Improve self.x until sqrt(r.z) <= tolerance sqrt(min(b.M^-1 b, reference)); ``again`` if A, M and x are those
        that the last solve left: then its b.M^-1 b stays what is compared with."""
        if self.team and (self.has_grids or not self.use_levels):
            limit = HUGE if reference is None else reference
            self.solve_at_once(tolerance, max_iterations, limit, again, reduction, enough, self.use_levels)
            return self.report([self._relative_residual(self.first), self._relative_residual(self.rz)])
        if again:
            self._go_on()
            self._precondition()
        else:
            self._load()
            self._precondition()
            self._refer()
            if self.xx[None] != 0.0:
                self._subtract_guess()
                self._precondition()
        self._begin(tolerance, HUGE if reference is None or again else reference, reduction, enough)
        residuals = [self._relative_residual(self.rz)]
        done = 0
        check_every = 1 if self.use_levels else self.check_every  # a cycle costs far more than a look
        while self.status[None] == RUNNING and done < max_iterations:
            steps = min(check_every, max_iterations - done)
            for _ in range(steps):
                self._iterate()
            done += steps
            residuals.append(self._relative_residual(self.rz))
        return self.report(residuals)

    def report(self, residuals=None) -> SolveReport:
        """Of the last solve; its last residual, where no others are given."""
        residuals = residuals or [self._relative_residual(self.rz)]
        return SolveReport(STATUS[self.status[None]], self.iterations[None], residuals)

    def _relative_residual(self, rz) -> float:
        reference = self.reference[None]
        return float(np.sqrt(abs(rz[None]) / reference)) if reference != 0.0 else 0.0

    def _iterate(self) -> None:
        if self.use_levels:
            self._advance_only()
            self.levels.cycle(self.r, self.z)
            self._turn_only()
        else:
            self._jacobi_iteration()

    def _precondition(self) -> None:
        if self.use_levels:
            self.levels.cycle(self.r, self.z)
        else:
            self._jacobi_only()

    @stage
    def solve_at_once(
        self,
        tolerance: ti.f64,
        limit: ti.i32,
        reference: ti.f64,
        again: ti.i32,
        reduction: ti.f64,
        enough: ti.f64,
        grids: ti.i32,
    ):
        """The whole of ``solve`` with ``grids`` or no levels, by one thread or a team."""
        self.round[None] = -again
        if ti.static(self.team.together):
            self.team.open(self.operator.count[None])
            for turn in range(self.team.turns):
                member = self.team.join(turn)
                if member >= 0:
                    self.go_through(tolerance, limit, reference, reduction, enough, grids, self.team, member)
                    self.team.close()
        else:
            ti.loop_config(serialize=True)
            for _ in range(1):
                self.go_through(tolerance, limit, reference, reduction, enough, grids, self.team, 0)

    @ti.func
    def go_through(self, tolerance, limit, reference, reduction, enough, grids, team: ti.template(), member):
        """Round 0 measures b, round 1 the guess; -1 takes the place of both to go on; then iterations. A and M^-1 stand
        here once, for they take long to compile."""
        while team.has(member) and (
            self.round[None] < 2 or (self.status[None] == RUNNING and self.iterations[None] < limit)
        ):
            this = self.round[None]
            if this > 0:
                self.operator.apply(self.p, self.q, team, member)
            if this == -1:
                self.go_on(team, member)
            elif this == 0:
                self.load(team, member)
            elif this == 1:
                self.subtract_guess(team, member)
            else:
                self.move(team, member)
            if ti.static(self.has_grids):
                if grids != 0:
                    self.levels.part_of_cycle(self.r, self.z, team, member)
                else:
                    self.precondition(team, member)
            else:
                self.precondition(team, member)
            if this == 0:
                self.refer(team, member)
            elif this < 2:
                self.begin(tolerance, HUGE if this < 0 else reference, reduction, enough, team, member)
            else:
                self.turn(team, member)
            self.round[None] = 1 if this == 0 else 2
            team.regroup()

    @ti.kernel
    def _jacobi_iteration(self):
        self.operator.apply(self.p, self.q, ONE_THREAD, 0)
        self.move(ONE_THREAD, 0)
        self.precondition(ONE_THREAD, 0)
        self.turn(ONE_THREAD, 0)

    @ti.kernel
    def _advance_only(self):
        self.operator.apply(self.p, self.q, ONE_THREAD, 0)
        self.move(ONE_THREAD, 0)

    @ti.kernel
    def _jacobi_only(self):
        self.precondition(ONE_THREAD, 0)

    @ti.kernel
    def _turn_only(self):
        self.turn(ONE_THREAD, 0)

    @ti.kernel
    def _load(self):
        self.load(ONE_THREAD, 0)

    @ti.kernel
    def _go_on(self):
        self.go_on(ONE_THREAD, 0)

    @ti.kernel
    def _refer(self):
        self.refer(ONE_THREAD, 0)
        self.note(ONE_THREAD, 0)

    @ti.kernel
    def _subtract_guess(self):
        self.operator.apply(self.p, self.q, ONE_THREAD, 0)
        self.subtract_guess(ONE_THREAD, 0)

    @ti.kernel
    def _begin(self, tolerance: ti.f64, limit: ti.f64, reduction: ti.f64, enough: ti.f64):
        self.begin(tolerance, limit, reduction, enough, ONE_THREAD, 0)
