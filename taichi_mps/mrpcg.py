"""MRPCG: multi-resolution preconditioned conjugate gradient; its coarse levels are made from the binning grid.

Solves A x = b for any symmetric positive definite operator; knows no physics. Preconditioners M:

    Jacobi        M^-1 = D^-1, the inverse (block) diagonal: the cheapest for few rows
    cell levels   M^-1 = one symmetric W-cycle over the cells of the binning grid (sparse.CellLevels): a matrix in rows
    grid levels   M^-1 = D^-1 + a V-cycle over grids of the corners of these cells (grid_levels.GridLevels): no matrix
"""

from dataclasses import dataclass

import numpy as np

from .backend import ti
from .conjugate_gradient import HUGE, RUNNING, STATUS, ConjugateGradient
from .grid_levels import GridLevels
from .sparse import CellLevels, SparseMatrix
from .stages import stage
from .team import WHOLE, team

__all__ = ["MRPCG", "SolveReport", "SparseMatrix", "CellLevels", "GridLevels"]


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
    levels: a CellLevels or GridLevels, used while ``use_levels`` is true; see ``prepare``.

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
        self.has_grids = isinstance(levels, GridLevels)
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
        self.operator.apply(self.p, self.q, WHOLE, 0)
        self.move(WHOLE, 0)
        self.precondition(WHOLE, 0)
        self.turn(WHOLE, 0)

    @ti.kernel
    def _advance_only(self):
        self.operator.apply(self.p, self.q, WHOLE, 0)
        self.move(WHOLE, 0)

    @ti.kernel
    def _jacobi_only(self):
        self.precondition(WHOLE, 0)

    @ti.kernel
    def _turn_only(self):
        self.turn(WHOLE, 0)

    @ti.kernel
    def _load(self):
        self.load(WHOLE, 0)

    @ti.kernel
    def _go_on(self):
        self.go_on(WHOLE, 0)

    @ti.kernel
    def _refer(self):
        self.refer(WHOLE, 0)
        self.note(WHOLE, 0)

    @ti.kernel
    def _subtract_guess(self):
        self.operator.apply(self.p, self.q, WHOLE, 0)
        self.subtract_guess(WHOLE, 0)

    @ti.kernel
    def _begin(self, tolerance: ti.f64, limit: ti.f64, reduction: ti.f64, enough: ti.f64):
        self.begin(tolerance, limit, reduction, enough, WHOLE, 0)
