"""The part of the hourglass resistance that is taken back: what the change of the gradient explains (I8).

Where the velocity is curved, the linear fits at both ends of a bond leave the same, c = (delta_ij + delta_ji)/2, with
delta_ij = u_j - u_i - G_i r_ij; where particles move past each other they leave opposite motions. Only what the mean of
both gradients leaves, e = (delta_ij - delta_ji)/2, is to be resisted: instead of the energy

    (1/2) (w/r^2) (h_i |delta_ij|^2 + h_j |delta_ji|^2)  of a bond  its least for this e,  (w/r^2) h |e|^2,

with h = 2 h_i h_j/(h_i + h_j). The matrix keeps the first, which needs the neighbours only. The force of the difference
goes to the right-hand side, at the velocity before the step: a deferred correction. It is never more than what the
matrix resists, so it is stable with any step; in one much longer than the scene's own it would hold up what should be
gone at once, and fades.

In a full vessel the ghosts behind no-slip walls go on with the curvature of the velocity, so what is left of the bonds
to them is taken back whole. And what is left at the edge of a plug, where the law has a kink, is resisted by the
plastic viscosity alone, for the yield stress does not grow with the rate.
"""

from ..runtime.backend import real, ti
from ..runtime.stages import stage

HUGE = 1e30  # N s m: no bound


@ti.data_oriented
class DeferredCorrection:
    """The correction for the velocity at the start of a step; its loop over pairs is written as in pair_sums.py.
    ``averages``: in a full vessel the law is averaged (I31), so only what flows resists what is left."""

    def __init__(self, particles, gradient, sums, strain_rate, resistance, averages: bool = False):
        self.particles, self.gradient, self.pair_sums = particles, gradient, sums
        self.strain_rate, self.resistance, self.averages = strain_rate, resistance, averages
        self.neighbors, self.dimension, self.lanes = gradient.neighbors, particles.dimension, sums.lanes
        self.part = ti.field(real(), ())  # of it that is taken back [-]
        self.most = ti.field(real(), ())  # resistance h_i h_j/(h_i + h_j) at most [N s m]
        # transpose of the flux before it meets B [N], and last the force of the bonds [N]
        self.sums = ti.Matrix.field(self.dimension + 1, self.lanes, real(), particles.capacity)

    @stage("correction")
    def gather(self, part: float):
        """The sums over the pairs of all particles at the velocity that they carry; ``part`` of them counts [-]."""
        for i in range(self.particles.count[None]):
            self.pair_sums.set_motion(i, self.particles.u[i])
        for _ in range(1):
            self.part[None], self.most[None] = part, HUGE
            if ti.static(self.averages):  # noqa: SIM102  (a compiled choice stays apart)
                if self.gradient.walls.bowed[None] == 1:
                    self.most[None] = 0.5 * self.resistance.flowing()
        for i in range(self.particles.count[None]):
            self.gather_bonds(i, part, self.most[None])
        if ti.static(self.gradient.walls.bows):
            for i in range(self.particles.count[None]):
                if self.gradient.walls.bowed[None] == 1:
                    self.add_walls(i)

    @ti.func
    def gather_bonds(self, i, part, most):
        sums = ti.Matrix.zero(float, self.dimension + 1, self.lanes)
        ui, Gi, hi = self.pair_sums.motion[i], self.strain_rate.G[i], self.resistance.h[i]
        for k in range(self.neighbors.row_start[i], self.neighbors.row_start[i + 1]):
            j = self.neighbors.column[k]
            if j < 0:  # never: the way out
                break
            Gj, hj, b, w = self.strain_rate.G[j], self.resistance.h[j], self.gradient.b[k], self.gradient.weight_r2[k]
            jump, r = self.pair_sums.motion[j] - ui, b / ti.max(w, 1e-12)
            together = ti.min(hi * hj / ti.max(hi + hj, 1e-30), most)
            for a in ti.static(range(self.lanes)):
                ours, theirs = jump[a], -jump[a]
                for c in ti.static(range(self.dimension)):
                    ours -= Gi[c, a] * r[c]
                    theirs += Gj[c, a] * r[c]
                resisted = together * (ours - theirs)
                for c in ti.static(range(self.dimension)):
                    sums[c, a] += (hi * ours - resisted) * b[c]
                sums[self.dimension, a] -= w * (hi * ours - hj * theirs - 2.0 * resisted)
        self.sums[i] = part * sums

    @ti.func
    def add_walls(self, i):
        """What the mirrored ghosts of a full vessel leave where the velocity is curved along the walls: none of it is
        resisted."""
        slopes, _drag = self.gradient.walls.bow_term(i, self.particles.x[i])
        push = self.push_of_walls(i)
        for a in ti.static(range(self.dimension)):
            self.sums[i][self.dimension, a] += push[a]
            for c in ti.static(range(self.dimension)):
                self.sums[i][c, a] += 2.0 * self.part[None] * self.resistance.h[i] * slopes[a, c]

    @ti.func
    def push_of_walls(self, i, face: ti.template() = None):
        """The force [N] on particle i among it."""
        _slopes, drag = self.gradient.walls.bow_term(i, self.particles.x[i], face)
        return -self.part[None] * self.resistance.h[i] * drag

    @ti.func
    def force(self, i):
        """Flux matrix [N m] of particle i, to be added to that of its stress, and the force of its bonds [N]."""
        flux = ti.Matrix.zero(float, self.dimension, self.dimension)
        push = ti.Vector.zero(float, self.dimension)
        for a in ti.static(range(self.dimension)):
            push[a] = self.sums[i][self.dimension, a]
            for c in ti.static(range(self.dimension)):
                flux[a, c] = self.sums[i][c, a]
        return flux @ self.gradient.B[i], push
