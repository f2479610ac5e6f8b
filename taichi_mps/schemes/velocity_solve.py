"""How far each of a step's systems is solved: the velocity solves of the implicit scheme."""

from ..linear.node_multigrid import NodeMultigrid
from ..linear.pcg import PCG
from ..runtime.backend import ti
from ..runtime.stages import flush, sequence

EARLY = 10.0  # only the last solve of a step goes down to the tolerance: the others to ten times that
# To what a solve reduces its first residual, in the last and in the other iterations: a velocity that just passes would
# go on unchanged from step to step, until it fails and is corrected by a jump.
REDUCTION, EARLY_REDUCTION = 0.1, 0.3
MOST_ITERATIONS = 2000  # of a solve


@ti.data_oriented
class VelocitySolve:
    """Conjugate gradients for the momentum ``operator``, with multigrid where there are rows enough.

    ``continues``: A and M stay the same from one solve of a step to the next, which goes on from there.
    """

    def __init__(self, operator, bins, constants, continues: bool):
        self.operator, self.constants, self.continues = operator, constants, continues
        capacity, dimension = operator.particles.capacity, operator.dimension
        multigrid = NodeMultigrid(operator, bins) if capacity >= NodeMultigrid.PAY_FROM else None
        self.solver = PCG(capacity, dimension, operator, multigrid)
        self.velocity = self.solver.x  # [m/s]
        self.iterations = ti.field(ti.i32, ())  # of all solves of a step

    def take_guess(self) -> None:
        """The velocity as it is now is the initial guess of the first solve of a step."""
        if self.continues:
            self.solver.take_guess()

    def prepare(self) -> None:
        """The preconditioner of the operator as it is now, and what residuals are compared with."""
        self.solver.prepare()
        self.operator.set_reference()

    @sequence("solve")
    def solve(self, k, iterations, tolerance):
        """Velocity of the present right-hand side in iteration k of a step."""
        again, reduction, enough = 0, REDUCTION, 0.0
        flush()
        if k + 1 < iterations:
            tolerance, reduction, enough = EARLY * tolerance, EARLY_REDUCTION, self.constants.early_enough[None]
        if ti.static(self.continues):
            again = min(k, 1)
        else:
            self.solver.take_guess()
        self.solver.solve(tolerance, MOST_ITERATIONS, self.operator.reference[None], again, reduction, enough)
        self.iterations[None] = self.solver.iterations[None] + (self.iterations[None] if k > 0 else 0)
        return self.solver.iterations[None]
