"""An uneven fill is evened before the first step: by the shift alone, without time or flow.

The packing around a particle, from which its volume follows, is right for an even fill only, and so is what resists
non-affine motion: a body filled at random places settles by millimetres while it should stand.
"""

from math import pi

from .backend import double_field, real, ti
from .particles import FLUID
from .stages import stage

# Mean square of the sum of max(0, 1 - r/(1.5 l0)) e_ij inside of a fill, whose root is 0 for a lattice, 0.04 to 0.10
# for what has flowed, 0.14, 0.25 and 0.58 for a lattice jittered by 0.05, 0.1 and 0.3 l0
UNEVEN = 0.12**2
TIMES = 40  # shifts: then it is as even as what has flowed


@ti.data_oriented
class Evening:
    """Moves the particles of an uneven fill by the shift of what deforms, in full."""

    def __init__(self, particles, gradient, walls, shifting, neighbours: int):
        self.particles, self.gradient, self.walls, self.shifting = particles, gradient, walls, shifting
        self.inside = 0.9 * neighbours  # with as many a particle lies inside of the fill
        self.uneven = ti.field(real(), particles.capacity)  # square of the sum over neighbours; -1 beside a surface [-]
        self.mean = double_field()  # of the squares inside [-]

    def needed(self) -> bool:
        """Whether the fill is uneven; the neighbours must have been found."""
        self.look()
        return self.mean[None] > UNEVEN

    def move(self) -> None:
        """One shift of all particles; then the neighbours must be found anew."""
        self.gradient.build()
        self.shifting.compute(0.0, 1.0, 1.0)
        self.advance()

    @ti.func
    def share(self, i):
        """Cross-section of particle i over that of the lattice [-]: 1 but for rings."""
        share = ti.cast(1.0, ti.f64)
        if ti.static(self.particles.axisymmetric):
            share = self.particles.volume(i) / (2.0 * pi * self.particles.x[i][0] * self.shifting.spacing**2)
        return share

    @stage
    def look(self):
        """``uneven`` and its ``mean``, which has the same bits with any number of threads."""
        for i in range(self.particles.count[None]):
            self.uneven[i] = -1.0
            first, last = self.gradient.neighbors.row_start[i], self.gradient.neighbors.row_start[i + 1]
            if self.particles.kind[i] == FLUID and last - first >= self.inside:
                x, share = self.particles.x[i], self.share(i)
                near = 0.0 * x
                for k in range(first, last):
                    j = self.gradient.neighbors.column[k]
                    r_ij = self.gradient.neighbors.bins.displacement(x, self.particles.x[j])
                    r = r_ij.norm() / (self.shifting.spacing * ti.sqrt(share))
                    near += self.share(j) / share * ti.max(0.0, 1.0 - r / 1.5) * r_ij / ti.max(r_ij.norm(), 1e-30)
                self.uneven[i] = ti.cast(near.norm_sqr(), float)
        ti.loop_config(serialize=True)
        for _ in range(1):
            number, total = ti.cast(0.0, ti.f64), ti.cast(0.0, ti.f64)
            for i in range(self.particles.count[None]):
                if self.uneven[i] >= 0.0:
                    number += 1.0
                    total += self.uneven[i]
            self.mean[None] = total / ti.max(number, 1.0)

    @stage
    def advance(self):
        """x <- x + shift, kept in front of the walls."""
        for i in range(self.particles.count[None]):
            if self.particles.kind[i] == FLUID:
                move = ti.cast(self.shifting.shift[i], ti.f64)
                self.particles.x[i] = self.walls.outside(self.particles.x[i], move)
