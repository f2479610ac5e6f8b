"""The part of the resistance to non-affine motion that is taken back: what the change of the gradient explains (I8).

Where the velocity is curved, the linear fits at both ends of a bond leave the same, c = (delta_ij + delta_ji)/2, with
delta_ij = u_j - u_i - G_i r_ij; where particles move past each other they leave opposite motions. Only what the mean of
both gradients leaves, e = (delta_ij - delta_ji)/2, is to be resisted: instead of the energy

    (1/2) (w/r^2) (h_i |delta_ij|^2 + h_j |delta_ji|^2)  of a bond  its least for this e,  (w/r^2) h |e|^2,

with h = 2 h_i h_j/(h_i + h_j). The matrix keeps the first, which needs the neighbours only. The force of the difference
goes to the right-hand side, at the velocity before the step: a deferred correction. It is never more than what the
matrix resists, so it is stable with any step; in one much longer than the scene's own it would hold up what should be
gone at once, and fades.
"""

from ..runtime.backend import real, ti
from ..runtime.stages import stage


@ti.data_oriented
class DeferredCorrection:
    """The correction for a velocity; its sums over pairs are kept as in momentum.py."""

    def __init__(self, particles, gradient, system):
        self.particles, self.gradient, self.system = particles, gradient, system
        self.neighbors, self.dimension, self.lanes = gradient.neighbors, particles.dimension, system.lanes
        shape = self.dimension, self.lanes
        self.G = ti.Matrix.field(*shape, real(), particles.capacity)  # transpose of the gradient of the velocity [1/s]
        # transpose of the flux before it meets B [N], and last the force of the bonds [N]
        self.sums = ti.Matrix.field(shape[0] + 1, shape[1], real(), particles.capacity)

    @ti.func
    def keep(self, i, G):
        """G is the gradient at particle i of the velocity that ``gather`` will see."""
        for a, c in ti.static(ti.ndrange(self.dimension, self.dimension)):
            self.G[i][c, a] = G[a, c]

    @ti.func
    def gradient_of(self, i):
        """The gradient at particle i of the velocity at the start of the step [1/s]."""
        G = ti.Matrix.zero(float, self.dimension, self.dimension)
        for a, c in ti.static(ti.ndrange(self.dimension, self.dimension)):
            G[a, c] = self.G[i][c, a]
        return self.gradient.tensor(i, G, self.particles.u)

    @stage
    def gather(self, u: ti.template(), share: float):
        """The sums over the pairs of all particles at the velocity u; a ``share`` of them is given back."""
        for i in range(self.particles.count[None]):
            for a in ti.static(range(self.dimension)):
                self.system.motion[i][a] = u[i][a]
        for i in range(self.particles.count[None]):
            self.gather_bonds(i, share)

    @ti.func
    def gather_bonds(self, i, share):
        sums = ti.Matrix.zero(float, self.dimension + 1, self.lanes)
        ui, Gi, hi = self.system.motion[i], self.G[i], self.system.h[i]
        for k in range(self.neighbors.row_start[i], self.neighbors.row_start[i + 1]):
            j = self.neighbors.column[k]
            if j < 0:  # never: the way out
                break
            Gj, hj, b, w = self.G[j], self.system.h[j], self.gradient.b[k], self.gradient.weight_r2[k]
            jump, r = self.system.motion[j] - ui, b / ti.max(w, 1e-12)
            together = hi * hj / ti.max(hi + hj, 1e-30)
            for a in ti.static(range(self.lanes)):
                ours, theirs = jump[a], -jump[a]
                for c in ti.static(range(self.dimension)):
                    ours -= Gi[c, a] * r[c]
                    theirs += Gj[c, a] * r[c]
                resisted = together * (ours - theirs)
                for c in ti.static(range(self.dimension)):
                    sums[c, a] += (hi * ours - resisted) * b[c]
                sums[self.dimension, a] -= w * (hi * ours - hj * theirs - 2.0 * resisted)
        self.sums[i] = share * sums

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
