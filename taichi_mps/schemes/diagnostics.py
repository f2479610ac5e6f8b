"""What the report of a step and the stop rules read: sums over the fluid, and how the last solve ended.

All at once: to read a number from Python takes 7 microseconds, with all the others in one kernel next to nothing.
"""

import numpy as np

from ..particles.particles import FLUID
from ..runtime.backend import ti

NOT_A_NUMBER = 1e12  # squared speed [m2/s2] that stands for what is not finite
SUMS, SOLVE = 12, 3


@ti.data_oriented
class Diagnostics:
    """Sums over the fluid particles of one scheme, and its solve."""

    def __init__(self, particles, scheme, lattice):
        self.particles, self.scheme, self.solver = particles, scheme, scheme.solver
        self.accelerates = "a" in particles.carried
        self.nearly_all = 0.9 * lattice.neighbours
        # number, max u^2, sum V, V u^2, V u^4, m u^2, unyielded; V packing, V of enclosed ones, of all with many
        # neighbours: particles in pairs or clumps have a large surface normal, and would pass for a surface; V a^2.
        # Iterations of the step; r.z and reference of the last solve over each other, and its status
        self.numbers = np.zeros(SUMS + SOLVE)

    def take(self):
        """Largest speed^2, its mean and that of what moves [m2/s2], kinetic energy [J], share of unyielded particles,
        volume error [-], the volume that was lost [m3]: negative where the fluid has become looser; mean square of
        the acceleration [m2/s4] (0 in ``semi-implicit``); iterations, relative residual and status of the solve."""
        self._add(self.numbers)
        numbers = self.numbers.tolist()
        count, speed2, whole, squares, fourths, energy, unyielded, packing, volume, crowd, room, pushes = numbers[:SUMS]
        error = volume / packing - 1.0 if volume else 0.0
        lost = room - room**2 / crowd if room else 0.0
        mean2, moving2 = squares / whole if whole else 0.0, fourths / squares if squares else 0.0
        acceleration2 = pushes / whole if whole else 0.0
        iterations, ratio, status = numbers[SUMS:]
        solve = int(iterations), abs(ratio) ** 0.5, int(status)
        return speed2, mean2, moving2, 0.5 * energy, unyielded / count, error, lost, acceleration2, *solve

    @ti.kernel
    def _add(self, sums: ti.types.ndarray(ti.f64, 1)):
        ti.loop_config(serialize=True)
        for k in range(SUMS):
            sums[k] = 0.0
        ti.loop_config(serialize=True)
        for i in range(self.particles.count[None]):
            if self.particles.kind[i] == FLUID:
                volume = ti.cast(self.particles.volume(i), ti.f64)
                u2 = ti.cast(self.particles.u[i].norm_sqr(), ti.f64)
                if not (u2 < NOT_A_NUMBER):
                    u2 = NOT_A_NUMBER
                sums[0] += 1
                sums[1] = ti.max(sums[1], u2)
                sums[2] += volume
                sums[3] += volume * u2
                sums[4] += volume * u2 * u2
                sums[5] += volume * u2 * self.scheme.density(i)
                sums[6] += 1 - self.scheme.yielded[i]
                if self.scheme.gradient.enclosed(i):
                    sums[7] += volume * self.scheme.gradient.packing[i]
                    sums[8] += volume
                if self.scheme.gradient.neighbour_count[i] >= self.nearly_all:
                    sums[9] += volume * self.scheme.gradient.packing[i]
                    sums[10] += volume
                if ti.static(self.accelerates):
                    sums[11] += volume * ti.cast(self.particles.a[i].norm_sqr(), ti.f64)
        sums[SUMS] = self.scheme.iterations[None]
        sums[SUMS + 1] = 0.0
        if self.solver.reference[None] != 0.0:
            sums[SUMS + 1] = self.solver.rz[None] / self.solver.reference[None]
        sums[SUMS + 2] = self.solver.status[None]
