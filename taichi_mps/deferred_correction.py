"""The part of the resistance to non-affine motion that is taken back: what the change of the gradient explains (I8).

Where the velocity is curved, the linear fits at both ends of a bond leave the same, c = (delta_ij + delta_ji)/2, with
delta_ij = u_j - u_i - G_i r_ij; where particles move past each other they leave opposite motions. Only what the mean of
both gradients leaves, e = (delta_ij - delta_ji)/2, is to be resisted: instead of the energy

    (1/2) (w/r^2) (h_i |delta_ij|^2 + h_j |delta_ji|^2)  of a bond  its least for this e,  (w/r^2) h |e|^2,

with h = 2 h_i h_j/(h_i + h_j). The matrix keeps the first, which needs the neighbours only. The force of the difference
goes to the right-hand side, at the velocity of the pass before: a deferred correction. It is never more than what the
matrix resists, so passes and steps converge whatever their length.
"""

from .backend import real, ti


@ti.data_oriented
class DeferredCorrection:
    """Holds the gradient ``G`` of the last velocity [1/s] of every particle."""

    def __init__(self, particles, gradient, system):
        self.gradient, self.system, self.neighbors = gradient, system, gradient.neighbors
        self.dimension = d = particles.dimension
        self.G = ti.Matrix.field(d, d, real(), particles.capacity)  # of the velocity of the last pass [1/s]

    @ti.func
    def keep(self, i, G):
        """G is the gradient at particle i of the velocity that ``force`` will see."""
        self.G[i] = self.gradient.in_plane(G)

    @ti.func
    def force(self, i, u: ti.template()):
        """Flux matrix [N m] of particle i, to be added to that of its stress, and the force of its bonds [N]."""
        flux = ti.Matrix.zero(float, self.dimension, self.dimension)
        push = ti.Vector.zero(float, self.dimension)
        for k in range(self.neighbors.row_start[i], self.neighbors.row_start[i + 1]):
            j = self.neighbors.column[k]
            b, w = self.gradient.b[k], self.gradient.weight_r2[k]
            if w > 0.0:
                r, jump = b / w, u[j] - u[i]
                ours, theirs = jump - self.G[i] @ r, self.G[j] @ r - jump
                hi, hj = self.system.h[i], self.system.h[j]
                resisted = hi * hj / (hi + hj) * (ours - theirs)
                flux += (hi * ours - resisted).outer_product(b)
                push -= w * (hi * ours - hj * theirs - 2.0 * resisted)
        return flux @ self.gradient.B[i], push
