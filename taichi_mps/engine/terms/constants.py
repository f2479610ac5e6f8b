"""Numbers of a scene that the kernels of ``implicit`` read, constants of its mixes and scales of time, rate and
pressure, in fields, so that another material needs no compilation; and the base class of the terms."""

import numpy as np

from ..problem.materials import FLOW_THRESHOLD
from ..problem.time_step import LONG, TimeStep
from ..runtime.backend import double_field, real, ti
from ..runtime.stages import flush

MIX_FIELDS = {
    "density": "density [kg/m3]",
    "eta": "typical slope of the flow curve, the plastic viscosity of Bingham's law [Pa s]",
    "tau_y": "yield stress [Pa]",
    "pi_c": "critical strain rate [1/s]",
    "friction": "tangent of the angle of internal friction [-]",
    "inertial_viscosity": "hourglass resistance of a low-viscosity fluid [Pa s]",
    "mu_r": "penalty that ties the strain rate to the yield law [Pa s]",
}
SCENE_FIELDS = {
    "layer_pressure": "pressure of half a layer of particles [Pa]",
    "min_bond_rate": "rate of the bonds below which their resistance stops growing, in a natural step [1/s]",
    "reference_force": "force density that errors of the solve are compared with [N/m3]",
    "natural_step": "natural step (time_step.py) in a field [s]",
    "early_max_reduction": "part of its first residual at which a solve before the last ends [-]",
    "max_divergence": "largest divergence that is imposed [1/s]",
    "bulk": "K [Pa s]",
}

HUGE = 1e9  # level where no hydrostatic pressure stands beside p [m]
INERTIAL = 0.5  # hourglass modes of a low-viscosity fluid decay within about two natural steps: h += 0.5 rho l0^2/step
# Over sqrt(a/l0), a = g + U^2/H: rate of the bonds below which the hourglass resistance of a yield-stress fluid stops
# growing; slower motion that the gradient does not see creeps at a rate that no yield stress stops
MIN_BOND_RATE = 3.5e-3
# Without gravity, strain of the bonds in a natural step at that rate: of a slow flow the other would be so small that
# the velocities of a plug are not solved for in single precision
MIN_BOND_STRAIN = 1.5e-3
# K = STIFFNESS rho (g H + U^2) times the natural step: the pressure rho (g H + U^2) compresses by 1/75 in an iteration
STIFFNESS = 75.0
VISCOUS_STIFFNESS = 8.0  # and K >= 8 mu_r: a slow flow is resisted by its viscosity, not by its weight
# mu_r >= 6 eta and 64 tau_y times the natural step: the stress converges in a few iterations; in shorter steps
# also half the geometric mean of eta and rho H^2/dt, or a plug that stops springs back
PENALTY = 6.0, 64.0, 0.5

# Where a yielding fluid falls, solves before the last end at this part of their residual: the new stress adds as much
EARLY_MAX_REDUCTION = 0.1
# Largest divergence that is imposed, over sqrt(g/H) and over U/H [-]: 1 1/s in a slump cone
MAX_DIVERGENCE = 0.175, 1.0


class Term:
    """Base of the terms of the equations, on the particles, fits and walls of a ``fluid`` (schemes/scheme.py).

    ``others``: the constants and the terms that it reads, which become attributes of these names.
    """

    def __init__(self, fluid, **others):
        self.particles, self.gradient, self.neighbors = fluid.particles, fluid.gradient, fluid.neighbors
        self.walls, self.dimension, self.capacity = fluid.walls, fluid.particles.dimension, fluid.particles.capacity
        vars(self).update(others)

    @ti.func
    def three_components(self, v):
        """A vector of d components as one of three, in f64."""
        w = ti.Vector.zero(ti.f64, 3)
        for a in ti.static(range(self.dimension)):
            w[a] = ti.cast(v[a], ti.f64)
        return w


@ti.data_oriented
class Constants:
    """Constants of each mix and scales of the scene: a field for each of MIX_FIELDS and SCENE_FIELDS."""

    def __init__(self, particles, problem, gradient=None, gravity=None, twist=None, may_be_full=False):
        """``gravity``: field [m/s2] that is written at the start of a step; ``twist``: field of its gradient [1/s2];
        ``may_be_full``: whether the fluid may fill a closed vessel."""
        self.gradient, self.gravity, self.twist, self.twists = gradient, gravity, twist, twist is not None
        self.particles, self.mixes = particles, len(problem.scene.materials)
        self.of_mix = [ti.field(real(), self.mixes) for _ in MIX_FIELDS]
        self.of_scene = [ti.field(real(), ()) for _ in SCENE_FIELDS]
        vars(self).update(zip((*MIX_FIELDS, *SCENE_FIELDS), self.of_mix + self.of_scene, strict=True))
        scene, grains = problem.scene, problem.scene.grains
        self.grain_density, self.held_density = grains.density if grains else 0.0, problem.held_density  # [kg/m3]
        self.full = ti.field(ti.i32, ())  # 1 in a closed box without a free surface
        changing = bool(scene.gravity_in_time or scene.jolts)
        # along a periodic axis nothing holds a weight
        unsupported = np.any((changing | (scene.gravity_vector != 0.0)) & np.array(scene.periodic))
        self.may_be_full, self.has_level = may_be_full, bool(grains) and not self.twists
        # whether a hydrostatic pressure stands beside p
        self.holds, self.spacing = (may_be_full or self.has_level) and not unsupported, scene.spacing
        self.level = double_field()  # where along gravity it is zero [m]
        self.middle = scene.expected.fluid.mean(0).tolist()  # of the fluid [m]
        # by the number of a mix: numbers that its compiled flow curve reads
        self.laws = {
            k: ti.Struct.field(dict.fromkeys(m.from_fields, real()), shape=())
            for k, m in enumerate(scene.materials)
            if m.curved and m.from_fields
        }
        self.of_scene += [law.get_member_field(name) for law in self.laws.values() for name in law.keys]
        self.set_problem(problem)

    def set_problem(self, problem) -> None:
        """Set the numbers of a problem of the same law and geometry, with its largest height and speed; kernels stay
        compiled."""
        scene, materials = problem.scene.expected, problem.scene.materials
        self.materials = materials
        self.of_laws = [getattr(materials[k], name) for k, law in self.laws.items() for name in law.keys]
        height, gravity, speed = problem.height, problem.gravity, problem.speed
        head = gravity * height + speed**2  # expected pressure over the density [m2/s2]
        rule = self.time_step = TimeStep(problem)
        self.rate = head**0.5 / height  # scale of the residuals of the outer iterations [1/s]
        step = rule.natural
        density = max(m.density for m in materials)
        inertia = density * height**2 * max(0.0, 1.0 / rule.longest - 1.0 / step)  # of shorter steps [Pa s]
        min_bond_rate = MIN_BOND_RATE * (head / height / scene.spacing) ** 0.5
        if not scene.gravity_vector.any():
            min_bond_rate = max(min_bond_rate, MIN_BOND_STRAIN / step)
        # parts of mu_r of each mix, and of K [Pa s]; the latter and the plastic ones grow with the step
        self.viscous = [
            max(PENALTY[0] * m.typical_slope, PENALTY[2] * (m.typical_slope * inertia) ** 0.5) for m in materials
        ]
        # of the largest yield stress, under the full height
        self.plastic = [
            PENALTY[1] * (m.yield_value + m.friction_coefficient * m.density * gravity * height) * step
            for m in materials
        ]
        self.stiff = STIFFNESS * density * head * min(step, rule.longest)
        self.values = {
            "density": [m.density for m in materials],
            "eta": [m.typical_slope for m in materials],
            "tau_y": [m.yield_value for m in materials],
            "pi_c": [m.critical_strain_rate or 0.0 for m in materials],
            "friction": [m.friction_coefficient for m in materials],
            "inertial_viscosity": [INERTIAL * m.density * scene.spacing**2 / step for m in materials],
            "layer_pressure": 0.5 * density * gravity * scene.spacing,
            "min_bond_rate": min_bond_rate,
            "reference_force": density * head / height,
            "natural_step": step,
            "early_max_reduction": EARLY_MAX_REDUCTION if rule.falls else 0.0,
            "max_divergence": max(MAX_DIVERGENCE[0] * (gravity / height) ** 0.5, MAX_DIVERGENCE[1] * speed / height),
        }
        self.step_ratio = 0.0  # step over the longest of a flow that does not vary slowly, at least 1: of mu_r, K
        self.set_time_step(rule.longest)
        self.early = self.early_max_reduction[None]  # for Python, as the field holds it

    def deferred_fraction(self, dt: float) -> float:
        """Fraction of the hourglass resistance that deferred correction removes in a step of dt [s]: all of it where
        steps follow the creep, else less in steps longer than LONG natural ones."""
        return 1.0 if self.time_step.yields else min(1.0, LONG * self.time_step.natural / dt)

    def set_time_step(self, dt: float) -> None:
        """Set mu_r and K for a step of dt [s]: larger in one longer than ``longest``, where less inertia resists the
        imbalance that the iterations leave."""
        last, self.step_ratio = self.step_ratio, max(1.0, dt / self.time_step.longest)
        if self.step_ratio == last:
            return
        penalties = [max(viscous, self.step_ratio * p) for viscous, p in zip(self.viscous, self.plastic, strict=True)]
        self.values |= {"mu_r": penalties, "bulk": max(self.stiff, VISCOUS_STIFFNESS * max(penalties))}
        flush()
        of_mix, of_scene = ([self.values[name] for name in names] for names in (MIX_FIELDS, SCENE_FIELDS))
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
        if ti.static(self.mixes > 1):
            return self.particles.mix[i]
        else:
            return ti.cast(0, ti.i32)

    @ti.func
    def flows(self, i, rate):
        """Whether the viscous stress at a shear rate [1/s] is over FLOW_THRESHOLD of the yield stress of particle i."""
        return self.eta[self.mix(i)] * rate > FLOW_THRESHOLD * self.tau_y[self.mix(i)]

    @ti.func
    def density_of(self, i):
        """Density of particle i [kg/m3]."""
        density = self.density[self.mix(i)]
        if ti.static(self.particles.has_grains):  # noqa: SIM102  (a compiled choice stays apart)
            if self.particles.in_grain(i):
                density = ti.cast(self.grain_density, float)
        return density

    @ti.func
    def along_gravity(self, x):
        """Coordinate of x along gravity [m]."""
        return self.gravity[None].dot(x) / ti.max(self.gravity[None].norm(), 1e-30)

    @ti.func
    def depth(self, i):
        """Depth of particle i below the ``level`` or the middle of a full closed box, over the spacing [-]."""
        level = self.level[None] if ti.static(self.has_level) else HUGE
        if self.full[None] == 1:
            level = self.along_gravity(ti.Vector(self.middle, ti.f64))
        return (self.along_gravity(self.particles.x[i]) - level) / self.spacing

    @ti.func
    def density_held(self, i):
        """Density whose weight the hydrostatic pressure beside p holds at particle i, whatever flows: that of the first
        mix in a full closed box, and below the ``level``, in full from a spacing below on; 0 elsewhere, and of a
        particle that neither carries stress nor is part of a grain [kg/m3]."""
        density = ti.cast(0.0, float)
        if ti.static(self.holds):
            part, bears = ti.cast(self.full[None], float), self.gradient.B[i][0, 0] > 0.0
            if ti.static(self.particles.has_grains):
                bears = bears or self.particles.in_grain(i)
            if bears:
                part = ti.max(part, ti.cast(ti.min(1.0, self.depth(i)), float))
            density = self.density[0] * part
        return density

    @ti.func
    def head_density(self, i):
        """Density whose weight the pressure around particle i balances, that of the mortar where there are grains, less
        what a mean pressure gradient or a hydrostatic pressure beside p holds [kg/m3]."""
        return self.density[self.mix(i)] - (ti.cast(self.held_density, float) + self.density_held(i))

    @ti.func
    def gravity_at(self, i):
        """Gravity [m/s2] of the step at particle i, the shock of a jolt included, in f64."""
        if ti.static(self.twists):
            return self.gravity[None] + self.twist[None] @ self.particles.x[i]
        else:
            return self.gravity[None]

    @ti.func
    def weight_of(self, i):
        """Weight of particle i by its volume, less what a mean pressure gradient or a hydrostatic pressure holds
        [N/m3]."""
        density = self.density_of(i) - (ti.cast(self.held_density, float) + self.density_held(i))
        return density * ti.cast(self.gravity_at(i), float)

    @ti.func
    def pressure_ramp(self, p):
        """Ramp from 0 without pressure to 1 at that of half a layer of particles [-]."""
        return ti.max(0.0, ti.min(1.0, p / self.layer_pressure[None]))
