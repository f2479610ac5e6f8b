"""Friction of a wall: slip and traction of each particle in front of it.

The tangential traction t [Pa] of a wall resists the slip u_s [m/s] of the fluid on it: |t| <= yield stress where it
sticks, t = (yield stress + viscous constant |u_s|) u_s/|u_s| where it slips. To the fit the wall moves along with the
slip of the particle, which within a solve is linear in the velocity u of the particle relative to the wall,

    u_s = (1 - s) u + offset,      s = R/(R + mu/z),      t = R u_s + constant_traction:

friction and the layer of thickness z between wall and particle in series. R is the viscous constant plus a penalty r,
which ties the slip to the yield stress as mu_r does the strain rate (stress.py). After each solve ``map_traction``
maps the yield part of the traction back onto its bound, and moves ``offset`` so that in the end t is the traction of
the particle's own stress, whatever s and r were.
"""

from ..runtime.backend import real, ti

DEPTH = 2.0  # penalty r over rho/dt times the spacing [-]: r u accelerates a row or two to u in a step


@ti.data_oriented
class FrictionalSlip:
    """Friction of one wall by the law of a ``geometry.walls.Friction``; ``slip`` and ``traction`` are carried by the
    particles.

    ``slope`` [Pa s], the ``typical_slope`` of the fluid's flow curve, is the viscosity of the layer between particle
    and wall in ``set_sheared_fraction``."""

    def __init__(self, law, slip, traction, spacing: float, slope: float):
        d, capacity = slip.n, slip.shape[0]
        self.yield_value, self.constant = law.yield_value, law.viscous_constant
        self.yields = law.yield_value > 0.0
        self.slip, self.traction = slip, traction  # u_s [m/s]; yield part of the traction [Pa]
        self.spacing, self.depth, self.eta = spacing, DEPTH * spacing, slope
        self.penalty = ti.field(real(), ())  # r [Pa s/m]; 0 without a yield stress
        self.stick = ti.field(real(), capacity)  # s [-]
        self.area = ti.field(real(), capacity)  # of the wall that belongs to the particle [m2]
        self.thickness = ti.field(real(), capacity)  # of the layer between particle and wall [m]
        # factor of t(z): 0 where it slips as a plug, 1 where it sticks [-]
        self.sheared_fraction = ti.field(real(), capacity)
        self.offset = ti.Vector.field(d, real(), capacity)  # part of u_s that does not depend on u [m/s]
        self.constant_traction = ti.Vector.field(d, real(), capacity)  # part of t that does not depend on u_s [Pa]

    @ti.func
    def velocity_in_fit(self, i, n, v):
        """Part of a velocity v relative to the wall that enters the least-squares fit; as adjoint, the part of a force
        v that acts on the particle."""
        normal = n * n.dot(v)
        return normal + self.stick[i] * (v - normal)

    @ti.func
    def slip_velocity(self, i, n, v, wall_motion):
        """Slip u_s [m/s] at the velocity v relative to the wall; with ``wall_motion`` 0 without ``offset``."""
        return (1.0 - self.stick[i]) * (v - n * n.dot(v)) + wall_motion * self.offset[i]

    @ti.func
    def resistance(self):
        """Resistance R of the wall to slip [Pa s/m]."""
        return ti.cast(self.constant, float) + self.penalty[None]

    @ti.func
    def drag(self, i, n, v, wall_motion):
        """Force [N] of the wall against a particle with the velocity v, besides the one through the particle's
        stress."""
        t = self.resistance() * self.slip_velocity(i, n, v, wall_motion)
        if ti.static(self.yields):
            t += wall_motion * self.constant_traction[i]
        return (1.0 - self.stick[i]) * self.area[i] * t

    @ti.func
    def set_sheared_fraction(self, i, z):
        """Set ``sheared_fraction``, the fraction of the velocity of a particle at z [m] that is shear in the layer
        beneath it, the rest being slip."""
        t = self.constant * self.slip[i]
        if ti.static(self.yields):
            t += self.traction[i]
        size, sheared = t.norm(), self.eta / z * self.slip[i].norm()
        self.sheared_fraction[i] = size / (size + sheared) if sheared > 0.0 else 1.0

    @ti.func
    def set_area(self, i, n, z, volume, cBn, ratio, acts, second_row_fraction):
        """Set the area of the wall that belongs to particle i, and the thickness of the layer beneath it. The areas add
        up to the wall: the second row of a lattice has its c V n.B n, ``second_row_fraction`` of the whole, and the
        first row the rest; c V n.B n itself grows by 5 % in sheared fluid. The thickness is z, but not more than
        ``map_traction`` needs to converge."""
        size = self.spacing * ti.sqrt(ratio)
        first = ti.max(0.0, ti.min(1.0, 2.5 - 2.0 * z / size))  # 1 in the first row, 0 in the second
        own_area = volume * ti.max(n.dot(cBn), 1e-3 / size)
        area = first * (1.0 - second_row_fraction) * acts * volume / size + (1.0 - first) * own_area
        self.area[i] = area
        self.thickness[i] = ti.min(z, area / ti.max(volume * cBn.norm_sqr(), 1e-12 * area))

    @ti.func
    def set_initial_slip(self, i, n, v, mu):
        """Set the slip of particle i before the iterations of a step: the slip that it carries, or (1 - s) u if it has
        just come to the wall."""
        R = self.resistance()
        self.stick[i] = R / (R + mu / self.thickness[i])
        tangential = v - n * n.dot(v)
        slip = self.slip[i] - n * n.dot(self.slip[i])
        if slip.norm_sqr() == 0.0:
            slip = (1.0 - self.stick[i]) * tangential
        self.offset[i] = slip - (1.0 - self.stick[i]) * tangential
        if ti.static(self.yields):
            self.traction[i] -= n * n.dot(self.traction[i])
            self.constant_traction[i] = self.traction[i] - self.penalty[None] * slip

    @ti.func
    def clear(self, i):
        """Set slip and traction of particle i, which is not at the wall, to zero."""
        self.slip[i] *= 0.0
        if ti.static(self.yields):
            self.traction[i] *= 0.0

    @ti.func
    def map_traction(self, i, n, v, stress, stiff, mu):
        """Map the traction of particle i back onto its bound after an iteration, and move the slip to where the
        friction balances the traction ``stress`` [Pa] of the particle; v is its velocity relative to the wall, and the
        slip lowers ``stress`` by ``stiff`` [Pa s/m] besides mu/z."""
        tangential, R, layer = v - n * n.dot(v), self.resistance(), mu / self.thickness[i]
        slip, kappa = self.slip_velocity(i, n, v, 1.0), layer + stiff
        residual = stress - n * n.dot(stress) + kappa * slip
        if ti.static(self.yields):
            trial = self.traction[i] + self.penalty[None] * slip
            self.traction[i] = trial * ti.min(1.0, self.yield_value / ti.max(trial.norm(), 1e-12))
            self.constant_traction[i] = 2.0 * self.traction[i] - trial
            residual -= self.constant_traction[i]
        self.slip[i] = residual / (kappa + R)
        self.stick[i] = R / (R + layer)
        self.offset[i] = self.slip[i] - (1.0 - self.stick[i]) * tangential
