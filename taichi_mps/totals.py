"""Sums over the fluid after a step: what the report of the step and the stop rules read."""

import numpy as np

from .backend import ti
from .particles import FLUID

NOT_A_NUMBER = 1e12  # squared speed [m2/s2] that stands for what is not finite


@ti.data_oriented
class Totals:
    """Sums over the fluid particles of one scheme."""

    def __init__(self, particles, scheme, constants):
        self.particles, self.scheme = particles, scheme
        self.nearly_all = 0.9 * constants.neighbours
        # max u^2, sum V, V u^2, V u^4, m u^2, unyielded; V packing, V of enclosed ones, of all with many neighbours:
        # particles that lie in pairs or clumps lean to each other, and would pass for a surface
        self.sums = np.zeros(10)

    def take(self):
        """Largest speed^2, its mean and that of what moves [m2/s2], kinetic energy [J], number of unyielded particles,
        volume error [-], and the volume that was lost [m3]: negative where the fluid has become looser."""
        self._add(self.sums)
        speed2, whole, squares, fourths, energy, unyielded, packing, volume, crowd, room = self.sums.tolist()
        error = volume / packing - 1.0 if volume else 0.0
        lost = room - room**2 / crowd if room else 0.0
        moving2 = fourths / squares if squares else 0.0
        return speed2, squares / whole if whole else 0.0, moving2, 0.5 * energy, unyielded, error, lost

    @ti.kernel
    def _add(self, sums: ti.types.ndarray(ti.f64, 1)):
        ti.loop_config(serialize=True)
        for k in range(10):
            sums[k] = 0.0
        ti.loop_config(serialize=True)
        for i in range(self.particles.count[None]):
            if self.particles.kind[i] == FLUID:
                volume = ti.cast(self.particles.volume(i), ti.f64)
                u2 = ti.cast(self.particles.u[i].norm_sqr(), ti.f64)
                if not (u2 < NOT_A_NUMBER):
                    u2 = NOT_A_NUMBER
                sums[0] = ti.max(sums[0], u2)
                sums[1] += volume
                sums[2] += volume * u2
                sums[3] += volume * u2 * u2
                sums[4] += volume * u2 * self.scheme.density(i)
                sums[5] += 1 - self.scheme.yielded[i]
                if self.scheme.gradient.enclosed(i):
                    sums[6] += volume * self.scheme.gradient.packing[i]
                    sums[7] += volume
                if self.scheme.gradient.around[i] >= self.nearly_all:
                    sums[8] += volume * self.scheme.gradient.packing[i]
                    sums[9] += volume
