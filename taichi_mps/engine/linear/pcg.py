"""Preconditioned conjugate gradients for A x = b; knows no physics.

With a preconditioner of several resolutions (node_multigrid.py) this is the MRPCG of the project,
the multi-resolution preconditioned conjugate gradient; its coarse levels are made from the binning grid.

Sources: Saad, Iterative Methods for Sparse Linear Systems (2003), algorithm 9.1; Fischer, Projection techniques for
iterative solution of Ax = b with successive right-hand sides, Computer Methods in Applied Mechanics and Engineering 163
(1998), 193-204 (warm start).
"""

from ..runtime.backend import double_field, ti
from ..runtime.stages import loop_stage, sequence, stage, team_stage, unfinished
from ..runtime.thread_team import barrier, begins, first, last, leads, takes_part, wait
from .vectors import Jacobi, Vectors

HUGE = 1e38  # not (|s| < HUGE) finds NaN and infinity, also under fast_math
REDUCTION_FLOOR = 1e-4  # part of the norm that the tolerance is compared with, below which no residual need be reduced
RUNNING, CONVERGED, INDEFINITE, BROKEN = range(4)
STATUS = "limit", "converged", "indefinite", "broken"  # how a solve ended; indefinite: (p, A p) <= 0 or (r, z) < 0
FAILED = "indefinite", "broken"
GUESS, GUESSED, CONTINUED = range(3)  # where iterations begin: at zero, along the guess; at the guess; at the last x


@ti.data_oriented
class PCG:
    """Conjugate gradients for the unknowns x_i of ``components`` numbers, i < operator.count.

    operator A: a @ti.data_oriented object with
        count              0-D i32 field: rows in use
        multiply(x, y)     stage, y = A x, zero in rows that are no unknowns
        inverse_diagonal   matrix field: inverse of the diagonal blocks; a zero block marks a row that is no unknown:
                           its x is left as it is, its residual and direction are zero
    preconditioner M: the stage apply(r, z), z = M^-1 r, and build() for the present operator, which the caller calls
    before a solve; Jacobi by default.

    Fields: ``b`` right-hand side; ``x`` initial guess in, solution out; ``max_reference``, upper bound of the
    reference that residuals are compared with; of the last solve ``status``, ``iterations``, and (r, z) in ``rz``
    beside its ``reference``.
    """

    def __init__(self, capacity: int, components: int, operator, preconditioner=None):
        self.A, self.M = operator, preconditioner or Jacobi(operator)
        self.vectors = Vectors(capacity, components, operator)
        self.b, self.x, self.r, self.z, self.p, self.q = (self.vectors.field() for _ in range(6))
        self.first_x, self.first_r, self.last_b = (self.vectors.field() for _ in range(3))  # of the last solve
        self.rz, self.rz_new, self.pq = (double_field() for _ in range(3))  # (r, z), the next one, (p, A p)
        self.alpha, self.beta = double_field(), double_field()
        self.reference, self.target = double_field(), double_field()  # values of (r, z), see set_target
        self.max_reference = double_field()
        self.max_reference[None] = HUGE
        self.status = ti.field(ti.i32, ())
        self.iterations = ti.field(ti.i32, ())
        self.left = ti.field(ti.i32, ())  # iterations that may still follow
        self.start = ti.field(ti.i32, ())  # GUESS, GUESSED or CONTINUED

    # ---- the solve ------------------------------------------------------------------------------------------
    @sequence("solve")
    def solve(
        self,
        tolerance: ti.f64,
        limit: ti.i32,
        warm_start: ti.i32,
        min_reduction: ti.f64,
        max_reduction: ti.f64,
    ):
        """Iterate from the guess x until sqrt((r, z)) <= tolerance sqrt(min((b, M^-1 b), max_reference)). Return the
        field with the number of iterations. From zero the first step is to the guess: one loop has all products.

        Parameters
        ----------
        tolerance : float
            Relative residual at which the solve ends [-].
        limit : int
            Maximum number of iterations.
        warm_start : int
            1 if A, M and x are those that the last solve left: it continues from there with the same reference.
        min_reduction : float
            The solve does not end before sqrt((r, z)) is this times its first value, or 1e-4 of the reference [-].
        max_reduction : float
            It ends in any case where sqrt((r, z)) is this times its first value [-].
        """
        self.set_start(warm_start)
        for _ in range(warm_start, 2):  # to the guess, and from it
            self.iterate(limit, tolerance, min_reduction, max_reduction)
        return self.iterations

    @team_stage("iterate")
    def iterate(self, limit: ti.i32, tolerance: ti.f64, min_reduction: ti.f64, max_reduction: ti.f64):
        """Run Saad's algorithm 9.1 from line 2 on; a thread that joins late continues with the iterations."""
        if begins():
            self.set_target(limit, tolerance, min_reduction, max_reduction)
            self.set_direction()
            barrier()
        while takes_part() and unfinished(self.left):
            self.A.multiply(self.p, self.q)
            self.vectors.dot(self.p, self.q, self.pq)
            self.compute_alpha()
            self.vectors.axpy(self.alpha, self.p, self.x, self.q, self.r)  # x <- x + alpha p;  r <- r - alpha A p
            self.M.apply(self.r, self.z)
            self.vectors.dot(self.r, self.z, self.rz_new)
            self.compute_beta()
            self.vectors.xpby(self.z, self.beta, self.p)  # p <- z + beta p
            barrier()

    @stage("find alpha")
    def compute_alpha(self):
        """alpha = (r, z)/(p, A p), and 1 to the guess; 0 where the matrix turns out not to be positive definite, and in
        an iteration after the end, as a GPU may add one."""
        if leads():
            self.alpha[None] = 1.0 if self.start[None] == GUESS else 0.0
            if self.left[None] > 0 and self.start[None] != GUESS:
                if not (ti.abs(self.pq[None]) < HUGE):
                    self.status[None] = BROKEN
                elif self.pq[None] <= 0.0:
                    self.status[None] = INDEFINITE
                else:
                    self.alpha[None] = self.rz[None] / self.pq[None]
        wait()

    @stage("find beta")
    def compute_beta(self):
        """beta = (r, z) new/old; the end of an iteration."""
        if leads():
            if self.start[None] == GUESS:
                self.rz[None], self.beta[None], self.left[None], self.start[None] = self.rz_new[None], 0.0, 0, GUESSED
            elif self.left[None] > 0 and self.status[None] == RUNNING:
                self.iterations[None] += 1
                self.left[None] -= 1
                self.beta[None] = self.rz_new[None] / self.rz[None]
                self.rz[None] = self.rz_new[None]
                self.check_convergence()
            if self.status[None] != RUNNING:
                self.left[None] = 0
        wait()

    # ---- start ----------------------------------------------------------------------------------------------
    @team_stage("start")
    def set_start(self, warm_start: ti.i32):
        """Set x and r at which iterations begin, z = M^-1 r, and (r, z)."""
        if warm_start != 0:
            self.continue_last()
        else:
            self.start_from_zero()
        self.M.apply(self.r, self.z)
        self.vectors.dot(self.r, self.z, self.rz)

    @stage("right-hand side")
    def start_from_zero(self):
        """Set x = 0, so that r = b, and p to the guess."""
        if leads():
            self.start[None] = GUESS
        for i in range(first(self.A.count[None]), last(self.A.count[None])):
            self.r[i] = self.vectors.masked(i, self.b[i])
            self.last_b[i] = self.b[i]
            self.p[i], self.x[i] = self.x[i], ti.zero(self.x[i])
        wait()

    @loop_stage("direction")
    def set_direction(self):
        """Set p = z, and store x and r at which a solve begins with the guess; p is the guess already before that."""
        n = self.A.count[None] if self.start[None] != GUESS else 0
        for i in range(first(n), last(n)):
            self.p[i] = self.z[i]
            if self.start[None] == GUESSED:
                self.first_x[i], self.first_r[i] = self.x[i], self.r[i]
        wait()

    @sequence("go on")
    def continue_last(self):
        """Set r of the last x and the present b; then move x and r to the best point along the last change of x
        (Fischer's projection onto a single vector)."""
        self.last_change()
        self.vectors.dot(self.p, self.r, self.rz)
        self.vectors.dot(self.p, self.q, self.pq)
        self.compute_best_step()
        self.vectors.axpy(self.alpha, self.p, self.x, self.q, self.r)

    @loop_stage("change")
    def last_change(self):
        """Set p to the last change of x, and q = A p, and store x and r at which the solve begins."""
        for i in range(first(self.A.count[None]), last(self.A.count[None])):
            self.p[i] = self.x[i] - self.first_x[i]
            self.q[i] = self.first_r[i] - self.r[i]
            self.r[i] += self.vectors.masked(i, self.b[i] - self.last_b[i])
            self.last_b[i] = self.b[i]
            self.first_x[i], self.first_r[i] = self.x[i], self.r[i]
        wait()

    @stage("best step")
    def compute_best_step(self):
        """alpha = (p, r)/(p, A p), 0 to 1: A p of a tiny change is rounding, and must not be blown up."""
        if leads():
            self.start[None] = CONTINUED
            best = self.rz[None] / self.pq[None] if self.pq[None] > 0.0 else 0.0
            self.alpha[None] = ti.max(0.0, ti.min(1.0, best))
        wait()

    # ---- stopping criterion ---------------------------------------------------------------------------------
    @stage("set target")
    def set_target(self, limit: ti.i32, tolerance: ti.f64, min_reduction: ti.f64, max_reduction: ti.f64):
        """Set the value of (r, z) at which the solve ends; before the step to the guess, their reference."""
        if leads():
            self.status[None], self.iterations[None] = RUNNING, 0
            if self.start[None] == GUESS:  # r is b
                self.reference[None], self.left[None] = ti.min(self.rz[None], self.max_reference[None]), 1
            else:
                if self.reference[None] == 0.0:
                    self.reference[None] = self.rz[None]
                # of less, as of dry grains at rest, products would underflow
                start, norm = ti.abs(self.rz[None]), ti.max(ti.abs(self.reference[None]), 1e-40)
                least = ti.max(min_reduction * min_reduction * start, REDUCTION_FLOOR * REDUCTION_FLOOR * norm)
                self.target[None] = ti.max(
                    ti.min(tolerance * tolerance * norm, least), max_reduction * max_reduction * start
                )
                self.check_convergence()
                self.left[None] = limit if self.status[None] == RUNNING else 0
        wait()

    @ti.func
    def check_convergence(self):
        """Stop where (r, z) is small enough, or is not the square of a norm."""
        if not (ti.abs(self.rz[None]) < HUGE):
            self.status[None] = BROKEN
        elif ti.abs(self.rz[None]) <= self.target[None]:
            self.status[None] = CONVERGED
        elif self.rz[None] < 0.0:
            self.status[None] = INDEFINITE
