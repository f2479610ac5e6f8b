"""The numbers of a scene that the kernels of ``implicit`` read: the constants of its mixes, and the scales of time,
rate and pressure that follow. They stand in fields, so another material is other entries, not another compilation.
And what all terms have in common."""

import math

import numpy as np

from ..problem.materials import FLOW_THRESHOLD
from ..runtime.backend import real, ti
from ..runtime.stages import flush

OF_A_MIX = {
    "density": "density [kg/m3]",
    "eta": "typical slope of the flow curve, the plastic viscosity of Bingham's law [Pa s]",
    "tau_y": "yield stress [Pa]",
    "pi_c": "critical strain rate [1/s]",
    "friction": "tangent of the angle of internal friction [-]",
    "inertial": "hourglass resistance of a thin fluid [Pa s]",
    "mu_r": "penalty that ties the strain rate to the yield law [Pa s]",
}
OF_THE_SCENE = {
    "layer_pressure": "pressure of half a layer of particles [Pa]",
    "min_bond_rate": "rate of the bonds below which their resistance stops growing, in a natural step [1/s]",
    "reference_force": "force density that errors of the solve are compared with [N/m3]",
    "own_step": "natural_step, as the kernels read it [s]",
    "early_max_reduction": "part of its first residual that no solve before the last goes below [-]",
    "max_divergence": "largest divergence that is wanted [1/s]",
    "bulk": "K [Pa s]",
}

INERTIAL = 0.5  # hourglass modes of a thin fluid decay within two natural steps or so: h += 0.5 rho l0^2/step
# Over sqrt(a/l0), a = g + U^2/H: rate of the bonds below which the hourglass resistance of a yield-stress fluid stops
# growing: what is slower creeps by the motion that the gradient does not see, at a rate that no yield stress stops
MIN_BOND_RATE = 3.5e-3
# K = STIFFNESS rho (g H + U^2) times the natural step: that pressure compresses by 1/75 in an iteration
STIFFNESS = 75.0
VISCOUS_STIFFNESS = 8.0  # and K >= 8 mu_r: a slow flow is resisted by its viscosity, not by its weight
# mu_r >= 6 eta and 64 tau_y times the natural step: the stress converges in a few iterations; in shorter steps
# also half the geometric mean of eta and rho H^2/dt, or a plug that stops springs back
PENALTY = 6.0, 64.0, 0.5

LONG = 2.0  # a quiet flow takes steps as long as this many of the scene's own
CREEP = 0.1  # a decaying flow may take steps of this fraction of its decay time, in which its speed falls to 1/e
# Where what yields falls, a solve before the last one takes off no more of its residual: the new stress brings as much
EARLY_MAX_REDUCTION = 0.1
QUIET = 0.005  # a flow is quiet where the change of its velocity in a step moves particles by no more of l0
MAX_DIVERGENCE = 0.175, 1.0  # largest divergence that is wanted, over sqrt(g/H) and over U/H [-]: 1 1/s in a slump cone
STILL = 1e-5  # speed over sqrt(gH) below which all is still: each step takes off most of what is left, so not fewer


def longest_step(
    kinematic_viscosity: float, gravity: float, height: float, spacing: float, times: float = 1.0
) -> float:
    """Step [s] that resolves the fall of the body, 0.057 sqrt(H/g), or the viscous flow where that is slower; a fluid
    too thin to damp motion on the scale of a particle must resolve that motion, 0.06 sqrt(l0/g). Where nothing falls
    or moves so, ``times`` as much."""
    fall = 0.057 * (height / gravity) ** 0.5
    damping = kinematic_viscosity / (spacing * (gravity * spacing) ** 0.5)
    return max(
        times * min(fall, 0.06 * (spacing / gravity) ** 0.5 * (1.0 + damping)),
        0.5 * kinematic_viscosity / (gravity * height),
    )


class Term:
    """A term of the equations, which works on the particles, fits and walls of a Discretisation, ``fluid``. ``others``:
    the constants and the terms that it reads, which become attributes of these names."""

    def __init__(self, fluid, **others):
        self.particles, self.gradient, self.neighbors = fluid.particles, fluid.gradient, fluid.neighbors
        self.walls, self.dimension, self.capacity = fluid.walls, fluid.particles.dimension, fluid.particles.capacity
        vars(self).update(others)


@ti.data_oriented
class Constants:
    """Constants of each mix and scales of the scene: a field for each of OF_A_MIX and OF_THE_SCENE."""

    def __init__(self, particles, problem, gravity=None, twist=None):
        """``gravity``: field [m/s2] that is written at the start of a step; ``twist``: of its gradient [1/s2]."""
        self.gravity, self.twist, self.twists = gravity, twist, twist is not None
        self.particles, self.mixes = particles, len(problem.materials)
        self.of_mix = [ti.field(real(), self.mixes) for _ in OF_A_MIX]
        self.of_scene = [ti.field(real(), ()) for _ in OF_THE_SCENE]
        vars(self).update(zip((*OF_A_MIX, *OF_THE_SCENE), self.of_mix + self.of_scene, strict=True))
        curved = [(k, m) for k, m in enumerate(problem.materials) if m.curved and m.from_fields]
        # by the number of a mix: what its compiled flow curve reads
        self.laws = {k: ti.Struct.field(dict.fromkeys(m.from_fields, real()), shape=()) for k, m in curved}
        self.of_scene += [law.get_member_field(name) for law in self.laws.values() for name in law.keys]
        self.set_problem(problem)

    def set_problem(self, problem) -> None:
        """The numbers of the mixes of a problem of the same law and geometry, which is as high and as fast as it will
        be; what is compiled stays."""
        scene, materials, numerics = problem.scene.expected, problem.materials, problem.numerics
        self.materials = materials
        self.of_laws = [getattr(materials[k], name) for k, law in self.laws.items() for name in law.keys]
        height, gravity, speed = problem.height, problem.gravity, problem.speed
        head = gravity * height + speed**2  # the pressure to expect, over the density [m2/s2]
        yields, self.limit = all(m.yields for m in materials), numerics.max_time_step or math.inf  # of any step [s]
        longest, quiet = (
            min(longest_step(m.typical_slope / m.density, gravity, height, scene.spacing, times) for m in materials)
            for times in (1.0, LONG)
        )
        falls = yields and quiet > longest  # what yields falls, faster than its viscosity lets it flow
        self.max_time_step = min(longest, self.limit)  # of a flow that is not quiet [s]
        self.quiet_step = quiet if falls else longest  # longest step of a quiet flow [s]
        self.creeps = yields  # what dies away then takes longer steps
        # limits of what is quiet, and still: change of the velocity times the step [m], velocity [m/s]
        self.quiet, self.still = QUIET * scene.spacing, STILL * head**0.5
        self.rate = head**0.5 / height  # that residuals of the outer iterations are compared with [1/s]
        # the step [s] of this scene at its defaults: it scales what must not depend on the steps taken
        courant_number = type(numerics).model_fields["courant_number"].default
        step = self.natural_step = min(longest, courant_number * scene.spacing / speed) if speed else longest
        density = max(m.density for m in materials)
        inertia = density * height**2 * max(0.0, 1.0 / self.max_time_step - 1.0 / step)  # of shorter steps [Pa s]
        frictions = [m.friction_coefficient for m in materials]
        # parts of mu_r of each mix, and of K [Pa s]; the latter and the plastic ones grow with the step
        self.viscous = [
            max(PENALTY[0] * m.typical_slope, PENALTY[2] * (m.typical_slope * inertia) ** 0.5) for m in materials
        ]
        heaviest = [f * m.density * gravity * height for f, m in zip(frictions, materials, strict=True)]  # yield stress
        self.plastic = [PENALTY[1] * (m.yield_value + most) * step for m, most in zip(materials, heaviest, strict=True)]
        self.stiff = STIFFNESS * density * head * min(step, self.max_time_step)
        self.values = {
            "density": [m.density for m in materials],
            "eta": [m.typical_slope for m in materials],
            "tau_y": [m.yield_value for m in materials],
            "pi_c": [m.critical_strain_rate or 0.0 for m in materials],
            "friction": frictions,
            "inertial": [INERTIAL * m.density * scene.spacing**2 / step for m in materials],
            "layer_pressure": 0.5 * density * gravity * scene.spacing,
            "min_bond_rate": MIN_BOND_RATE * (head / height / scene.spacing) ** 0.5,
            "reference_force": density * head / height,
            "own_step": step,
            "early_max_reduction": EARLY_MAX_REDUCTION if falls else 0.0,
            "max_divergence": max(MAX_DIVERGENCE[0] * (gravity / height) ** 0.5, MAX_DIVERGENCE[1] * speed / height),
        }
        self.stretched = 0.0  # step over max_time_step that mu_r and K are for, 1 at least
        self.set_time_step(self.max_time_step)

    def longest_at(self, speeds) -> float:
        """Longest step [s] at these ``Speeds``: max_time_step, or in a quiet flow sqrt(QUIET l0/acceleration), at most
        quiet_step or, where it dies away, CREEP times the time of that; never above the limit that was given."""
        longest = self.max_time_step
        if speeds.acceleration * longest**2 < self.quiet and speeds.speed > self.still:
            most = max(self.quiet_step, CREEP * speeds.decay * self.creeps)
            longest = max(longest, min(most, math.sqrt(self.quiet / max(speeds.acceleration, 1e-30))))
        return min(longest, self.limit)

    def deferred_fraction(self, dt: float) -> float:
        """Part of the hourglass resistance that is taken back in a step of dt [s]: all of it where steps follow the
        creep, else less in those longer than LONG of the scene's own."""
        return 1.0 if self.creeps else min(1.0, LONG * self.natural_step / dt)

    def set_time_step(self, dt: float) -> None:
        """mu_r and K for a step of dt [s]: larger in one longer than max_time_step, where less inertia resists what the
        iterations leave out of balance."""
        last, self.stretched = self.stretched, max(1.0, dt / self.max_time_step)
        if self.stretched == last:
            return
        penalties = [max(viscous, self.stretched * p) for viscous, p in zip(self.viscous, self.plastic, strict=True)]
        self.values |= {"mu_r": penalties, "bulk": max(self.stiff, VISCOUS_STIFFNESS * max(penalties))}
        flush()
        of_mix, of_scene = ([self.values[name] for name in names] for names in (OF_A_MIX, OF_THE_SCENE))
        self._send(np.array(of_mix, float), np.array([*of_scene, *self.of_laws], float))

    @ti.kernel
    def _send(self, of_mix: ti.types.ndarray(ti.f64, 2), of_scene: ti.types.ndarray(ti.f64, 1)):
        for k in range(self.mixes):
            for row, field in ti.static(enumerate(self.of_mix)):
                field[k] = ti.cast(of_mix[row, k], field.dtype)
        for row, field in ti.static(enumerate(self.of_scene)):
            field[None] = ti.cast(of_scene[row], field.dtype)

    @ti.func
    def mix(self, i):
        """Number of the mix of particle i."""
        mix = 0
        if ti.static(self.mixes > 1):
            mix = self.particles.mix[i]
        return mix

    @ti.func
    def flows(self, i, rate):
        """Whether the viscous stress at a shear rate [1/s] is over FLOW_THRESHOLD of the yield stress of particle i."""
        return self.eta[self.mix(i)] * rate > FLOW_THRESHOLD * self.tau_y[self.mix(i)]

    @ti.func
    def density_of(self, i):
        """Density of particle i [kg/m3]."""
        return self.density[self.mix(i)]

    @ti.func
    def gravity_at(self, i):
        """Gravity [m/s2] of the step at particle i, the shock of a jolt included, in f64."""
        if ti.static(self.twists):
            return self.gravity[None] + self.twist[None] @ self.particles.x[i]
        else:
            return self.gravity[None]

    @ti.func
    def weight_of(self, i):
        """Weight of particle i by its volume [N/m3]."""
        return self.density_of(i) * ti.cast(self.gravity_at(i), float)

    @ti.func
    def pressed(self, p):
        """0 where there is no pressure to 1 from that of half a layer of particles [-]."""
        return ti.max(0.0, ti.min(1.0, p / self.layer_pressure[None]))
