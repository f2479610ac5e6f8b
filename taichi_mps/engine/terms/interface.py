"""Interface between two mixes: the shear across it goes through both in series (I27).

The velocity is continuous there and has a kink: the shear stress is the same on both sides, so the shear rates differ
as the fluidities, phi = rate/stress. The gradient of a particle next to the interface is fitted over both sides. Half
of a bond to a particle of another mix lies in that one, so of the gradient along the normal n the part

    c_i = (1/2) sum_j (n . B_i b_ij)(n . r_ij)    over the neighbours j of another mix

is that of the other side, and of the shear rate across the interface, gamma = [(1 - c_i) phi_i + psi_i] stress, with
psi_i the same sum with phi_j. All the other components of the strain rate are one on both sides: their stress is that
of the particle's own law.
"""

from ..runtime.backend import real, ti
from ..runtime.stages import stage
from .constants import Term


@ti.data_oriented
class Interface(Term):
    """Normal of the interface, and fraction and fluidity of the other mixes, at every particle."""

    def __init__(self, fluid, constants):
        super().__init__(fluid, constants=constants, tensors=fluid.particles.tensor_dimension)
        self.normal = ti.Vector.field(self.dimension, real(), self.capacity)  # towards the other mixes [-]
        # c: fraction of the gradient along the normal that belongs to other mixes [-], 0 where none is near
        self.other_fraction = ti.field(real(), self.capacity)
        self.other_fluidity = ti.field(real(), self.capacity)  # psi: fluidity of the other mixes [1/(Pa s)]

    @ti.func
    def other(self, i, k):
        """Whether the neighbour of pair k is of another mix than particle i, and no wall between them."""
        return (
            self.gradient.weight_r2[k] > 0.0 and self.particles.mix[self.neighbors.column[k]] != self.particles.mix[i]
        )

    @ti.func
    def bond_fraction(self, k, n, v):
        """Share of half of the bond of pair k in the gradient along n; v = B n."""
        b = self.gradient.b[k]
        return 0.5 * v.dot(b) * n.dot(b) / self.gradient.weight_r2[k]

    @stage("interface")
    def find_normals(self):
        """Set the normal and the fraction of the other mixes at the present positions."""
        for i in range(self.particles.count[None]):
            m = ti.Vector.zero(float, self.dimension)
            for k in range(self.neighbors.row_start[i], self.neighbors.row_start[i + 1]):
                if self.other(i, k):
                    m += self.gradient.b[k]
            n = m / ti.max(m.norm(), 1e-20)
            v, fraction = self.gradient.B[i] @ n, ti.cast(0.0, float)
            for k in range(self.neighbors.row_start[i], self.neighbors.row_start[i + 1]):
                if self.other(i, k):
                    fraction += self.bond_fraction(k, n, v)
            self.normal[i] = n
            self.other_fraction[i] = ti.max(0.0, ti.min(1.0, fraction))

    @stage("interface")
    def gather(self, fluidity: ti.template()):
        """Sum the fluidity of the other mixes from the ``fluidity`` of all particles [1/(Pa s)]."""
        for i in range(self.particles.count[None]):
            total = ti.cast(0.0, float)
            if self.other_fraction[i] > 0.0:
                n = self.normal[i]
                v = self.gradient.B[i] @ n
                for k in range(self.neighbors.row_start[i], self.neighbors.row_start[i + 1]):
                    if self.other(i, k):
                        total += self.bond_fraction(k, n, v) * fluidity[self.neighbors.column[k]]
            self.other_fluidity[i] = ti.max(0.0, total)

    @ti.func
    def across_interface(self, i, T):
        """Part of a symmetric tensor (t, t) at particle i that is shear across the interface, as a tensor."""
        n = ti.Vector.zero(float, self.tensors)
        for a in ti.static(range(self.dimension)):
            n[a] = self.normal[i][a]
        Tn = T @ n
        s = Tn - n * n.dot(Tn)
        return s.outer_product(n) + n.outer_product(s)

    @ti.func
    def viscosity(self, i, mu):
        """Viscosity of the shear across the interface [Pa s], of a particle whose own is mu [Pa s]."""
        return 1.0 / ((1.0 - self.other_fraction[i]) / mu + self.other_fluidity[i])
