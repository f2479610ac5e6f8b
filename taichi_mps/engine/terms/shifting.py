"""Particle regularity: deforming material is shifted towards even spacing, and close pairs are pushed apart; so is
what tension would tear, and an uneven fill before the first step. In the semi-implicit scheme particles collide."""

import numpy as np

from ..particles.particles import FLUID
from ..runtime.backend import real, sine, ti
from ..runtime.stages import flush, stage
from .constants import Term

# Shift coefficient of a step, and its largest value for a viscous or yield-stress fluid in tension. A free surface that
# is stretched by twice its shear stress clusters its columns at the rate 1.7 T/h, 5.7 per unit strain; in steps that
# strain by 0.02 the two coefficients restore the spacing at 9 and 38 per unit strain
SHIFT_COEFFICIENT, TENSION_SHIFT_COEFFICIENT = 0.1, 0.4
PERTURBATION = 0.005  # amplitude over l0 of a pseudo-random shift: a symmetric lattice yields late and abruptly
# Tension moves a particle out of its place at the rate kappa d (-p)/h, kappa d = 1.7 in the plane and 1.2 in space; the
# shift takes back 0.19 and 0.23 of its way: as a part of the shift 9 and 5 (-p) dt/h would just do
TENSION_FACTOR = 60.0
INTERIOR = 0.97  # of the neighbours of a lattice: with fewer a particle lies beside a surface
# Mean square of the sum of max(0, 1 - r/(1.5 l0)) e_ij inside of a fill, whose root is 0 for a lattice, 0.04 to 0.10
# for what has flowed (rings 0.22), 0.19 for few rings in layers, 0.25 and 0.58 for a lattice jittered by 0.1 and 0.3 l0
MAX_UNEVENNESS = 0.23**2
RELAXATION_SHIFTS = 40  # shifts of an uneven fill before the first step: then it is as even as what has flowed
SAMPLE_SIZE = 2000  # particles that are sampled, evenly over the rows
COLLISION_DISTANCE, RESTITUTION = 0.5, 0.2  # distance over the spacing; coefficient of restitution


@ti.data_oriented
class Shifting(Term):
    """Small displacements that keep the particles evenly spread where the material deforms and, if it has no yield
    stress (``shifts_in_tension``), where it is in tension."""

    def __init__(self, fluid, shifts_in_tension: bool):
        super().__init__(fluid, shifts_in_tension=shifts_in_tension, spacing=fluid.gradient.spacing)
        self.shift = ti.Vector.field(self.dimension, real(), self.capacity)  # displacement [m]
        # tension over the shear stress, 1 at most, times the part of what is viscous in the hourglass resistance [-]
        self.relative_tension = ti.field(real(), self.capacity)
        if shifts_in_tension:
            self.tension = ti.field(real(), self.capacity)  # part of the shift that tension calls for [-]
            self.mean = ti.Vector.field(self.dimension, real(), self.capacity)  # mean shift of neighbours [m]

    @stage("prepare")
    def set_tension(self, dt: float, resistance: ti.template(), pressure: ti.template(), stress: ti.template()):
        """Part of the shift that tension calls for in a step of dt [s]. Without a yield stress min(1, 60 (-p) dt/h)
        (h_0/h)^2 of the shift, none beside a surface; h is the hourglass ``resistance`` [Pa s], h_0 that of a
        low-viscosity fluid: what is viscous would lose angular momentum by it. A yield stress holds particles in their
        places."""
        for i in range(self.particles.count[None]):
            inertial_viscosity, viscosity = resistance.inertial_viscosity[i], resistance.viscosity[i]
            if ti.static(self.shifts_in_tension):
                fraction = ti.cast(0.0, float)
                if self.gradient.neighbour_count[i] >= INTERIOR * self.gradient.lattice_neighbours:
                    pulled = -TENSION_FACTOR * self.particles.p[i] * dt / viscosity
                    fraction = ti.max(0.0, ti.min(1.0, pulled)) * (inertial_viscosity / viscosity) ** 2
                self.tension[i] = fraction
            tension = 1.0 - pressure.whole(i) / ti.max(stress.shear_stress_magnitude(i, stress.mu[i]), 1e-9)
            # a full closed box is kept out of tension
            viscous = (1.0 - inertial_viscosity / viscosity) * (1 - pressure.full[None])
            self.relative_tension[i] = viscous * ti.max(0.0, ti.min(1.0, tension))

    @ti.func
    def correction_fraction(self, i, dt, strain):
        """Fraction of the shift, and of the wanted divergence, that is applied to particle i in a step of dt [s]: 0 at
        rest to 1 where it strains the material by ``strain`` [-], or the fraction that tension calls for."""
        fraction = self.deformation_fraction(i, dt, strain)
        if ti.static(self.shifts_in_tension):
            fraction = ti.max(fraction, self.tension[i])
        return fraction

    @stage("shift")
    def compute(self, dt: float, strain: float, least: float):
        """shift = -a l0 sum_j (s_j/s_i) max(0, 1 - r/(1.5 l0)) e_ij + 0.005 l0 e(x) without its outward part at a
        surface, at most 0.05 l0, and 0.05 (0.85 l0 - r) between closer pairs; all of it times
        min(1, shear_rate dt/strain), or ``least`` where that is larger, the sum times ``tension`` where this is larger
        still. s is the size of a ring (gradient.py), e(x) ``perturbation``; a is 0.1, of what is viscous and in tension
        up to 0.4."""
        d = ti.static(self.dimension)
        for i in range(self.particles.count[None]):
            self.shift[i] = ti.Vector.zero(float, d)
            if self.particles.kind[i] == FLUID and not self.particles.in_grain(i):
                x = self.particles.x[i]
                l0 = self.spacing * ti.sqrt(self.gradient.cross_section_ratio(i))  # spacing of rings this thin
                repulsion, apart = ti.Vector.zero(float, d), ti.Vector.zero(float, d)
                for k in range(self.neighbors.row_start[i], self.neighbors.row_start[i + 1]):
                    j = self.neighbors.column[k]
                    r_ij = ti.cast(self.neighbors.bins.displacement(x, self.particles.x[j]), float)
                    r = ti.max(r_ij.norm(), 1e-3 * l0)
                    e = r_ij / r
                    if ti.static(len(self.walls.separating) > 0):
                        e *= ti.cast(self.gradient.weight_r2[k] > 0.0, float)  # not through a thin wall
                    repulsion += self.gradient.cross_section_ratio(j) * ti.max(0.0, 1.0 - r / (1.5 * l0)) * e
                    apart -= 0.05 * ti.max(0.0, 0.85 * l0 - r) * e
                repulsion /= self.gradient.cross_section_ratio(i)
                repulsion += self.walls.repulsion(i, x, self.gradient.cross_section_ratio(i))
                perturbation = self.perturbation(x)
                deforming = ti.max(least, self.deformation_fraction(i, dt, strain))
                fraction = deforming
                if ti.static(self.shifts_in_tension):
                    perturbation *= ti.min(1.0, deforming / ti.max(self.tension[i], 1e-12))
                    fraction = ti.max(deforming, self.tension[i])
                more = (TENSION_SHIFT_COEFFICIENT - SHIFT_COEFFICIENT) * self.relative_tension[i]
                move = -(SHIFT_COEFFICIENT + more) * l0 * repulsion + PERTURBATION * l0 * perturbation
                inward = self.gradient.surface_normal[i]
                outward = -inward / ti.max(inward.norm(), 1e-12)
                if self.gradient.neighbour_count[i] < INTERIOR * self.gradient.lattice_neighbours:
                    move -= ti.max(move.dot(outward), 0.0) * outward
                if self.gradient.neighbour_count[i] < 0.5 * self.gradient.lattice_neighbours:
                    move *= 0.0
                move *= fraction
                self.shift[i] = move * ti.min(1.0, 0.05 * l0 / ti.max(move.norm(), 1e-12)) + deforming * apart

    @stage("shift")
    def shift_particles(self):
        """Move the particles by the shift, x <- x + shift, kept in front of the walls."""
        for i in range(self.particles.count[None]):
            if self.particles.kind[i] == FLUID:
                self.particles.x[i] = self.walls.keep_in_fluid(self.particles.x[i], ti.cast(self.shift[i], ti.f64))

    @stage("shift")
    def remove_mean_shift(self, dt: float, strain: float):
        """shift -= (1 - min(1, shear_rate dt/strain)) times its mean over the particle and its neighbours, with
        Wendland's kernel (w/r^2 times re^2) as weight. Where the material hardly deforms the shift would transport it
        upwards, and it would flow down again: a spurious stirring."""
        neighbors, re2 = self.neighbors, self.gradient.effective_radius**2
        for i in range(self.particles.count[None]):
            total, weight = self.shift[i], ti.cast(1.0, float)
            for k in range(neighbors.row_start[i], neighbors.row_start[i + 1]):
                w = re2 * self.gradient.weight_r2[k] / self.gradient.ring_radius_ratio(i)
                total += w * self.shift[neighbors.column[k]]
                weight += w
            self.mean[i] = total / weight
        for i in range(self.particles.count[None]):
            self.shift[i] -= (1.0 - self.deformation_fraction(i, dt, strain)) * self.mean[i]

    @ti.func
    def deformation_fraction(self, i, dt, strain):
        """0 at rest to 1 where a step strains the material by ``strain`` [-]."""
        return ti.min(1.0, self.particles.shear_rate[i] * dt / strain)

    @ti.func
    def perturbation(self, x):
        """Numbers between -1 and 1 that look random but follow from the place x [m] alone: a run is repeated and
        resumed bit for bit."""
        d = ti.static(self.dimension)
        phase = ti.cast(0.5, ti.f64)
        for a in ti.static(range(d)):
            phase += (12.9898, 78.233, 37.719)[a] * x[a] / self.spacing
        e = ti.Vector.zero(float, d)
        for a in ti.static(range(d)):
            digits = sine(phase + 4.934 * a) * 43758.5453
            e[a] = ti.cast(2.0 * (digits - ti.floor(digits)) - 1.0, float)
        return e


def is_uneven(fluid) -> bool:
    """Whether the fill is uneven, once its neighbours are found. In NumPy: a kernel would have to compile.

    The packing around a particle, from which its volume follows, is right for an even fill only, and so is what resists
    hourglass modes: a body filled at random places settles by millimetres while it should stand. So a scheme spreads it
    before the first step, by the shift of what deforms, in full: without time or flow.
    """
    flush()
    count, neighbors, spacing = fluid.particles.count[None], fluid.neighbors, fluid.gradient.spacing
    starts, columns = neighbors.row_start.to_numpy(), neighbors.column.to_numpy()
    particles = fluid.particles.read()
    x, kind = particles["x"], particles["kind"]
    rows = np.unique(np.linspace(0, count - 1, min(count, SAMPLE_SIZE)).astype(int))
    rows = rows[(starts[rows + 1] - starts[rows] >= 0.9 * fluid.lattice.neighbours) & (kind[rows] == FLUID)]
    if len(rows) == 0:
        return False
    lengths = starts[rows + 1] - starts[rows]
    i, first = np.repeat(rows, lengths), np.cumsum(lengths) - lengths
    j = columns[np.arange(lengths.sum()) + np.repeat(starts[rows] - first, lengths)]
    r_ij = x[j] - x[i]
    for axis in np.flatnonzero(neighbors.bins.periodic):
        r_ij[:, axis] -= neighbors.bins.size[axis] * np.round(r_ij[:, axis] / neighbors.bins.size[axis])
    ratio = np.ones(len(x))
    if fluid.particles.axisymmetric:
        ratio = particles["ring"] / (2.0 * np.pi * np.maximum(x[:, 0], 1e-30) * spacing**2)
    r = np.linalg.norm(r_ij, axis=1)
    pushes = ratio[j] / ratio[i] * np.maximum(0.0, 1.0 - r / (1.5 * spacing * np.sqrt(ratio[i])))
    repulsion = np.add.reduceat(pushes[:, None] * r_ij / np.maximum(r, 1e-30)[:, None], first)
    return bool((repulsion**2).sum(1).mean() > MAX_UNEVENNESS)


@ti.data_oriented
class Collisions(Term):
    """Impulses between particles that meet: a piece of MPS practice that the paper does not mention (S3).

    Where two particles nearer than COLLISION_DISTANCE l0 approach each other, each gets half of the impulse that leaves
    them with RESTITUTION times the approaching speed along their line; one that meets a wall particle gets the same
    half:

        u*_i <- u*_i - (1 + e)/2 sum_j max(0, (u*_i - u*_j) . n_ij) n_ij      n_ij = r_ij/|r_ij|

    Source: Koshizuka, Tamako, Oka, Computational Fluid Dynamics Journal 4 (1995), 29-46, and the code MPS-Basic of
    Koshizuka, Shibata, Kondo, Matsunaga, Moving Particle Semi-implicit Method (Academic Press, 2018).
    """

    def __init__(self, fluid):
        super().__init__(fluid)
        self.near2 = (COLLISION_DISTANCE * fluid.gradient.spacing) ** 2
        self.half_impulse = 0.5 * (1.0 + RESTITUTION)
        self.change = ti.Vector.field(self.dimension, real(), self.capacity)  # of the velocity [m/s]

    @stage("collisions")
    def collide(self, u: ti.template()):
        """Change the velocities u [m/s] of fluid particles; the pairs are those of the last ``gradient``."""
        for i in range(self.particles.count[None]):
            change = ti.Vector.zero(float, self.dimension)
            if self.particles.kind[i] == FLUID:
                for k in range(self.neighbors.row_start[i], self.neighbors.row_start[i + 1]):
                    b, w_r2 = self.gradient.b[k], self.gradient.weight_r2[k]
                    if b.dot(b) < self.near2 * w_r2 * w_r2:  # b = (w/r^2) r_ij
                        approach = (u[i] - u[self.neighbors.column[k]]).dot(b)
                        if approach > 0.0:
                            change -= self.half_impulse * approach / b.dot(b) * b
            self.change[i] = change
        for i in range(self.particles.count[None]):
            u[i] += self.change[i]
