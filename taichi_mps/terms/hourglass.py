"""Resistance to zero-energy (hourglass) modes: motion of particles past each other that the gradient does not see (I8).

    h = c eta_a + rho l0^2/(2 T) + ...,    c = 0.6,    at least 2 p dt,

eta_a the apparent viscosity at the rate of the bonds, T the natural step of the scene (constants.py).
"""

from ..runtime.backend import real, ti
from ..runtime.stages import stage

BOND_DISSIPATION = 0.6  # c: bond-associated dissipation gives 1/2 (shear) to 2/3 (along the bond), docs/equations.md
SETTLING = 2.0  # h >= 2 p dt: what the pressure pushes apart goes no further than to its place in a step
# What a thin fluid has at rest, over that in motion, or its particles find no places to stay in; and the strain or
# rotation in a step from which on it moves
AT_REST, MOVING = 64.0, 0.002
EDGE = 4.0  # at the edge of a plug a quarter of the bonds carry all of this motion: their rate is twice the mean


@ti.data_oriented
class HourglassResistance:
    """Resistance of every particle to motion that its velocity gradient does not see."""

    def __init__(self, particles, gradient, constants, strain_rate, pressure, stress):
        self.particles, self.gradient, self.constants = particles, gradient, constants
        self.strain_rate, self.pressure, self.stress = strain_rate, pressure, stress
        self.law, self.in_space = stress.law, particles.dimension == 3
        self.thin = ti.field(real(), particles.capacity)  # that of a thin fluid [Pa s]
        self.whole = ti.field(real(), particles.capacity)  # all of it [Pa s]
        self.h = ti.field(real(), particles.capacity)  # 2 V/n0 times the whole [N s m]

    @stage("prepare")
    def set(self, dt: float, first: ti.i32):
        """For the strain rate at the start of a step of dt [s]; in the ``first`` step that is not known."""
        for i in range(self.particles.count[None]):
            rate, residual = self.strain_rate.rate[i], self.strain_rate.residual[i]
            inertial = self.inertial(i, dt)
            whole = self.viscous(i, rate, residual, first, dt, inertial)
            self.thin[i], self.whole[i] = inertial, whole
            self.h[i] = 2.0 * self.particles.volume(i) * whole / self.gradient.full_weight(i)

    @ti.func
    def flowing(self):
        """That of the first mix where it flows, with the plastic viscosity alone [N s m]."""
        whole = BOND_DISSIPATION * self.constants.eta[0] + self.constants.inertial[0]
        return 2.0 * self.particles.volume(0) * whole / self.gradient.full_weight(0)

    @ti.func
    def inertial(self, i, dt):
        """That of a thin fluid [Pa s]. Without a yield stress it is 64 times as much at rest, less where the velocity
        gradient strains or turns it in a step of dt [s], and no more than elsewhere from 0.002 on and in a full closed
        box, where nothing settles (I8)."""
        resistance = self.constants.inertial[self.constants.mix(i)]
        if ti.static(self.law == "newtonian"):
            G = self.strain_rate.velocity_gradient(i)
            rest = 1.0 - ti.min(1.0, 2.0**0.5 * G.norm() * dt / MOVING)
            resistance *= 1.0 + (AT_REST - 1.0) * rest**2 * (1 - self.pressure.full[None])
        return resistance

    @ti.func
    def viscous(self, i, rate, residual, first, dt, inertial):
        """All of it [Pa s], for a shear rate [1/s], the ``residual`` of the linear fit [1/s2], a step of dt [s], and
        ``inertial``, that of a thin fluid [Pa s]."""
        m = self.constants.mix(i)
        h = BOND_DISSIPATION * self.constants.eta[m] + inertial
        if ti.static(self.law != "newtonian"):  # noqa: SIM102  (a compiled choice stays apart)
            if first == 0:
                own = ti.min(1.0, self.constants.own_step[None] / dt)
                slowest = self.constants.slowest[None] * (ti.sqrt(own) if ti.static(self.in_space) else own)
                bond_rate = ti.max(ti.sqrt(rate * rate + 2.0 * BOND_DISSIPATION * EDGE * residual), slowest)
                if ti.static(self.stress.has_curve):
                    h = BOND_DISSIPATION * self.stress.shear_stress(i, bond_rate) / bond_rate + inertial
                else:
                    h += BOND_DISSIPATION * self.stress.yield_stress(i) / bond_rate
        if ti.static(self.stress.mixes > 1):
            mu = (h - inertial) / BOND_DISSIPATION
            h = BOND_DISSIPATION * self.stress.interface.viscosity(i, mu) + inertial
        return ti.max(h, SETTLING * self.pressure.p[i] * dt)
