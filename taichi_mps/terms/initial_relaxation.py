"""Initial relaxation: an uneven fill is spread evenly before the first step, by the shift alone, without time or flow.

The packing around a particle, from which its volume follows, is right for an even fill only, and so is what resists
hourglass modes: a body filled at random places settles by millimetres while it should stand.
"""

import numpy as np

from ..particles.particles import FLUID
from ..runtime.backend import ti
from ..runtime.stages import flush, stage

# Mean square of the sum of max(0, 1 - r/(1.5 l0)) e_ij inside of a fill, whose root is 0 for a lattice, 0.04 to 0.10
# for what has flowed (rings 0.22), 0.19 for few rings in layers, 0.25 and 0.58 for a lattice jittered by 0.1 and 0.3 l0
UNEVEN = 0.23**2
SHIFTS = 40  # shifts: then it is as even as what has flowed
SAMPLE = 2000  # particles that are looked at, evenly over the rows


@ti.data_oriented
class InitialRelaxation:
    """Moves the particles of an uneven fill by the shift of what deforms, in full."""

    def __init__(self, particles, gradient, walls, shifting, neighbours: int):
        self.particles, self.gradient, self.walls, self.shifting = particles, gradient, walls, shifting
        self.inside = 0.9 * neighbours  # with as many a particle lies inside of the fill

    def needed(self) -> bool:
        """Whether the fill is uneven; the neighbours must have been found. In NumPy: a kernel would have to compile."""
        flush()
        count, neighbors, spacing = self.particles.count[None], self.gradient.neighbors, self.shifting.spacing
        starts, columns = neighbors.row_start.to_numpy(), neighbors.column.to_numpy()
        particles = self.particles.read()
        x, kind = particles["x"], particles["kind"]
        rows = np.unique(np.linspace(0, count - 1, min(count, SAMPLE)).astype(int))
        rows = rows[(starts[rows + 1] - starts[rows] >= self.inside) & (kind[rows] == FLUID)]
        if len(rows) == 0:
            return False
        lengths = starts[rows + 1] - starts[rows]
        first = np.cumsum(lengths) - lengths
        i = np.repeat(rows, lengths)
        j = columns[np.arange(lengths.sum()) + np.repeat(starts[rows] - first, lengths)]
        r_ij = x[j] - x[i]
        for axis in np.flatnonzero(neighbors.bins.periodic):
            r_ij[:, axis] -= neighbors.bins.size[axis] * np.round(r_ij[:, axis] / neighbors.bins.size[axis])
        ratio = np.ones(len(x))
        if self.particles.axisymmetric:
            ratio = particles["ring"] / (2.0 * np.pi * np.maximum(x[:, 0], 1e-30) * spacing**2)
        r = np.linalg.norm(r_ij, axis=1)
        pushes = ratio[j] / ratio[i] * np.maximum(0.0, 1.0 - r / (1.5 * spacing * np.sqrt(ratio[i])))
        near = np.add.reduceat(pushes[:, None] * r_ij / np.maximum(r, 1e-30)[:, None], first)
        return bool((near**2).sum(1).mean() > UNEVEN)

    def move(self) -> None:
        """One shift of all particles; then the neighbours must be found anew."""
        self.gradient.build()
        self.shifting.compute(0.0, 1.0, 1.0)
        self.advance()

    @stage("relaxation")
    def advance(self):
        """x <- x + shift, kept in front of the walls."""
        for i in range(self.particles.count[None]):
            if self.particles.kind[i] == FLUID:
                move = ti.cast(self.shifting.shift[i], ti.f64)
                self.particles.x[i] = self.walls.outside(self.particles.x[i], move)
