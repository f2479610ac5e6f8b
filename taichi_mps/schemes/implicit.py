"""The default scheme: viscosity, pressure and yield stress in one implicit system per step.

One step: drift half a step; neighbours and gradients there; smooth p; source s; then `passes` times solve for u, map
the trial stress back onto the yield surface and p <- p - K (div u - s); rotate the stress; drift the other half; shift.
"""

import math

from ..linear.node_multigrid import NodeMultigrid
from ..linear.pcg import INDEFINITE, MRPCG
from ..particles.gradient import Gradient
from ..particles.particles import FLUID
from ..runtime.backend import double_field, real, ti
from ..runtime.stages import Stages, few, stage
from ..terms.constants import LONG, Constants, law_of, resting_time
from ..terms.deferred_correction import DeferredCorrection
from ..terms.initial_relaxation import InitialRelaxation
from ..terms.momentum import MomentumSystem
from ..terms.momentum_drift import MomentumDrift, free_directions
from ..terms.pressure_smoothing import PressureSmoothing
from ..terms.rheology import shear_rate
from ..terms.shifting import Shifting
from ..terms.sleeping import Sleeping
from ..terms.stress import Stress
from ..terms.wall_stress import WallStress

SOURCE, RING_SOURCE = 0.05, 0.2  # share of the packing error removed per step; thin rings lose more of it per step
VISCOUS_SOURCE, DAMPED = 0.25, 0.25  # the same where viscosity damps what it moves: above this diffusion number
FASTEST, RING_FASTEST = 1.0, 0.25  # at most this [1/s]; of rings also this share of the shear rate, or the shift wins
STRAIN_SCALE = 0.02  # strain per step above which source and shift act fully
EARLY = 10.0  # only the last pass is solved to the tolerance: the others to ten times that
# To what a solve reduces its first residual, in the last and in the other passes: a velocity that just passes would go
# on unchanged from step to step, until it fails and is corrected by a jump.
REDUCTION, EARLY_REDUCTION = 0.1, 0.3
MOST_ITERATIONS = 2000  # of a solve
FIRST_PASSES = 40  # the pressure and the stress of the first step are found from zero
VISCOUS_PASSES = 10  # of these, with mu_r and no yield value: pressure first, or its strain stays as stress in a plug


@ti.data_oriented
class Implicit:
    """Implicit coupled scheme for Newtonian, Bingham and bi-viscosity fluids in two or three dimensions."""

    REMEDY = "lower max_time_step or courant_number, or use precision f64"

    def __init__(self, scene, numerics, particles, neighbors, walls, lattice, materials=(), stages=None):
        """``materials`` of the mixes that come in later, besides that of the scene; ``stages`` may time the stages."""
        material, d = scene.material, scene.dimension
        self.materials = (material, *materials)
        self.particles, self.neighbors, self.walls = particles, neighbors, walls
        self.numerics = numerics
        self.dimension = d
        self.spacing = scene.spacing
        self.g = ti.types.vector(d, real())(scene.gravity_vector)
        self.refill = RING_SOURCE if scene.axisymmetric else SOURCE
        self.constants = Constants(particles, len(self.materials))
        self.gradient = Gradient(neighbors, walls, lattice, scene.spacing)
        self.sleeping = None
        window = resting_time(self.materials)
        if numerics.sleep and math.isfinite(window):
            self.sleeping = Sleeping(particles, neighbors, scene.spacing, window)
        self.system = MomentumSystem(particles, self.gradient, walls, self.sleeping)
        self.sleeps = self.system.sleeps
        self.correction = DeferredCorrection(particles, self.gradient, self.system)
        self.smoothing = PressureSmoothing(particles, self.gradient, self.constants, scene.gravity_vector)
        of_system = self.gradient, walls, self.system, self.constants, self.smoothing
        self.stress = Stress(particles, *of_system, material, law_of(self.materials), scene.gravity_vector)
        of_layer = self.gradient, walls, self.constants, self.smoothing, self.stress, self.correction
        self.layer = WallStress(particles, *of_layer, scene.gravity_vector)
        self.held = not scene.axisymmetric and any(wall.holds for wall in walls.surfaces)
        self.clings = any(not wall.slip for wall in walls.surfaces)  # some wall holds the fluid, or rubs
        directions = free_directions(scene, numerics.walls)
        self.free = bool(directions.any()) and not self.sleeps  # nothing but gravity acts along some direction
        if self.free:
            self.momentum_drift = MomentumDrift(particles, self.constants, directions, scene.gravity_vector)
        self.yielded = self.stress.yielded  # 1 where the material flows
        self.shifting = Shifting(particles, self.gradient, walls, scene.spacing, tears=self.stress.law == "newtonian")
        self.initial_relaxation = InitialRelaxation(particles, self.gradient, walls, self.shifting, lattice.neighbours)
        many = particles.capacity >= NodeMultigrid.PAY_FROM
        self.solver = MRPCG(
            particles.capacity, d, self.system, NodeMultigrid(self.system, neighbors.bins) if many else None
        )
        self.source = ti.field(real(), particles.capacity)  # wanted divergence [1/s]
        self.reference = double_field()  # drive . M^-1 drive over all particles [W]
        self.iterations = ti.field(ti.i32, ())  # of all solves of a step
        self.first = True
        self.viscous_passes = 0 if walls.rub else VISCOUS_PASSES  # friction is found together with the stress
        self.run = stages or Stages()
        self.alone = few(particles.capacity) and not walls.travel  # nothing is needed from Python between the stages
        self.parts = self.begin, self.iterate, self.end  # of a step: stages, kernels or parts of one (stages.py)
        self.set_materials(scene, self.materials)

    def set_materials(self, scene, materials) -> None:
        """Go on with the numbers of these materials, of the same law; what is compiled stays."""
        self.materials = materials
        self.constants.set_materials(scene, materials, self.numerics)
        self.system.bulk[None] = self.constants.bulk[None]

    def state(self) -> dict:
        """Scalars the scheme carries from step to step."""
        return {"first": self.first} | ({"steps_asleep": self.sleeping.steps} if self.sleeping else {})

    def load(self, state: dict) -> None:
        self.first = state["first"]
        if self.sleeping:
            self.sleeping.steps = state["steps_asleep"]

    def time_step_limits(self, max_speed: float, acceleration: float = math.inf) -> dict[str, float]:
        """Largest allowed steps [s] by name at a largest speed [m/s] and a mean acceleration [m/s2]."""
        limits = {"maximum": self.constants.longest_at(max_speed, acceleration)}
        if max_speed > 0.0:
            limits["Courant"] = self.numerics.courant_number * self.spacing / max_speed
        return limits

    def step(self, dt: float) -> int:
        """Advance the particles by dt [s]; returns the number of passes."""
        if self.walls.rub:
            self.walls.tie(self.materials[0].density / dt)
        all_awake = self.sleeping.begin() if self.sleeping else False
        if self.constants.stretch(dt):
            self.system.bulk[None] = self.constants.bulk[None]
        passes = FIRST_PASSES if self.first else self.numerics.passes
        numbers = dt, self.first, all_awake, passes, self.numerics.tolerance
        together = self.alone and not self.run.timed
        for k, part in enumerate(self.parts):
            if together:
                self.in_one_kernel(k, *numbers)
            else:
                part(*numbers)
        self.first = False
        return passes

    @ti.kernel
    def in_one_kernel(
        self, k: ti.template(), dt: float, first: ti.i32, all_awake: ti.i32, passes: ti.i32, tolerance: ti.f64
    ):
        """The stages of part k of a step: loops inside a loop run in one thread. All parts in one compile too long."""
        ti.loop_config(serialize=True)
        for _ in range(1):
            ti.static(self.parts[k])(dt, first, all_awake, passes, tolerance)

    @ti.pyfunc
    def begin(self, dt, first, all_awake, passes, tolerance):
        """Gradients, p~, source and the matrix at the middle of the step."""
        self.run("gradient", self.gradient.build)
        if ti.static(self.sleeps):
            self.run("sleep", self.sleeping.rouse, all_awake)
        self.run("smooth pressure", self.smoothing.smooth, dt)
        if ti.static(self.walls.rub):
            self.begin_friction()
        self.smoothing.look()
        self.run("prepare", self.prepare, dt, first)
        self.smoothing.balance(self.source)
        if ti.static(self.held):  # noqa: SIM102  (a compiled choice stays apart)
            if self.smoothing.full[None] == 1:
                self.run("wall layer", self.layer.begin)
        self.start(self.solver.x)
        share = min(1.0, LONG * self.constants.own_step[None] / dt)
        self.run("correction", self.correction.gather, self.solver.x, share)
        self.foresee(dt, self.solver.x)
        self.prepare_system()
        self.iterations[None] = 0

    @ti.pyfunc
    def iterate(self, dt, first, all_awake, passes, tolerance):
        """``passes`` times: solve for u, then stress and pressure from u."""
        for k in range(passes):
            if k == 0 or self.solver.status[None] < INDEFINITE:
                if ti.static(self.stress.law == "bi-viscosity"):  # noqa: SIM102  (a compiled choice stays apart)
                    if k > 0:
                        self.prepare_system()
                self.run("right-hand side", self.right_hand_side, self.solver.b)
                if ti.static(self.walls.move or self.walls.rub):
                    self.system.subtract_wall_motion(self.solver.p, self.solver.q, self.solver.b)
                self.run("solve", self.solve, tolerance, k, passes)
                if self.solver.status[None] < INDEFINITE:
                    self.run(
                        "stress", self.stress.update, self.solver.x, self.source, first * (k < self.viscous_passes)
                    )
                    if ti.static(self.held):  # noqa: SIM102
                        if self.smoothing.full[None] == 1:
                            self.run("wall layer", self.layer.adjust)

    @ti.pyfunc
    def end(self, dt, first, all_awake, passes, tolerance):
        """Shift, and the other half of the drift."""
        if ti.static(self.free):
            self.run("momentum", self.momentum_drift.restore, dt, self.solver.x)
        self.run("shift", self.shifting.compute, dt, STRAIN_SCALE, 0.0)
        if ti.static(self.shifting.tears):
            self.run("shift", self.shifting.stay, dt, STRAIN_SCALE)
        if ti.static(self.walls.travel):
            self.walls.place(self.walls.clock[None] + 0.5 * dt)  # drift left them at the middle of the step
        self.run("advance", self.advance, dt, self.solver.x, first)

    @ti.pyfunc
    def prepare_system(self):
        """Diagonal and coarse levels of the matrix, and what its residual is compared with."""
        self.run("system", self.system.prepare)
        if ti.static(not self.alone):
            self.run("levels", self.solver.prepare)
        self.refer()

    @ti.pyfunc
    def solve(self, tolerance, k, passes):
        """Velocity of the present stress and pressure in pass k; returns the number of iterations."""
        again, reduction, enough = 0, REDUCTION, 0.0
        if k + 1 < passes:
            tolerance, reduction, enough = EARLY * tolerance, EARLY_REDUCTION, self.constants.early_enough[None]
        if ti.static(self.stress.law != "bi-viscosity" and not self.walls.rub):  # matrix or slip change in each pass
            again = ti.min(k, 1)
        if ti.static(self.alone):
            self.solver.solve_at_once(tolerance, MOST_ITERATIONS, self.reference[None], again, reduction, enough, 0)
        else:
            self.solver.solve(tolerance, MOST_ITERATIONS, self.reference[None], again, reduction, enough)
        self.iterations[None] += self.solver.iterations[None]
        return self.solver.iterations[None]

    @ti.func
    def refill_share(self, i, dt):
        """Share of the packing error that a step removes, by its diffusion number eta dt/(rho l0^2) [-]; in a full
        closed box, which cannot change its volume, more would only stir."""
        diffusion = self.constants.eta[self.constants.mix(i)] * dt / (self.density(i) * self.spacing**2)
        more = (VISCOUS_SOURCE - self.refill) * diffusion / (DAMPED + diffusion)
        return self.refill + more * (1 - self.smoothing.full[None])

    @ti.func
    def density(self, i):
        """Density of particle i [kg/m3]."""
        return self.constants.density[self.constants.mix(i)]

    @stage
    def begin_friction(self):
        """The slip that each particle brings along to the walls with friction."""
        for i in range(self.particles.count[None]):
            mu = self.stress.viscosity(i, self.particles.shear_rate[i])
            volume, share = self.particles.volume(i), self.gradient.counts_as(i)
            B = self.gradient.B[i]
            self.walls.begin_friction(i, self.particles.x[i], self.particles.u[i], B, volume, mu, share)

    @stage
    def prepare(self, dt: float, first: ti.i32):
        """Source, implicit viscosity and non-affine resistance from the last velocity."""
        for i in range(self.particles.count[None]):
            G, left = self.gradient.fit(i, self.particles.u, 1.0)
            self.correction.keep(i, G)
            rate = shear_rate(G)
            excess = self.gradient.packing[i] - 1.0
            error = ti.max(excess, -0.03 if self.gradient.enclosed(i) else 0.0)
            fastest = ti.cast(FASTEST, float)
            if ti.static(self.gradient.axisymmetric):
                fastest = ti.max(fastest, RING_FASTEST * rate)
            source = ti.max(-fastest, ti.min(fastest, self.refill_share(i, dt) * error / dt))
            deforming = self.shifting.deforming(i, dt, STRAIN_SCALE)
            inertial = self.stress.inertial(i, G, dt)
            h = self.stress.non_affine(i, rate, left, first, dt, inertial)
            pull = self.shifting.pull(i, h, inertial, dt)
            self.source[i] = source * ti.max(deforming, pull)
            self.system.inertia[i] = self.density(i) / dt
            self.system.mu[i] = self.stress.viscosity(i, rate)
            tension = 1.0 - self.smoothing.p[i] / ti.max(self.stress.size(i), 1e-9)
            viscous = (1.0 - inertial / h) * (1 - self.smoothing.full[None])  # a full closed box is kept out of tension
            self.shifting.stretched[i] = viscous * ti.max(0.0, ti.min(1.0, tension))
            self.system.h[i] = 2.0 * self.particles.volume(i) * h / self.gradient.lattice(i)[0]

    @stage
    def refer(self):
        """What the residual of the solve is compared with, in the solver's norm."""
        ti.loop_config(serialize=True)
        for _ in range(1):
            total = ti.cast(0.0, ti.f64)
            for i in range(self.particles.count[None]):
                drive = self.constants.drive[None] * self.particles.volume(i)
                total += ti.cast(self.system.inverse_diagonal[i].trace() * drive**2, ti.f64)
            self.reference[None] = total / self.dimension

    @stage
    def drift(self, dt: float):
        """x <- x + dt u/2, before the neighbours are found: forces act at the middle of the step, so a body in rotation
        keeps its angular momentum and a wave its energy."""
        ti.loop_config(serialize=self.alone)
        for i in range(self.particles.count[None]):
            if self.particles.kind[i] == FLUID:
                move = ti.cast(0.5 * dt * self.particles.u[i], ti.f64)
                self.particles.x[i] = self.walls.outside(self.particles.x[i], move)

    @stage
    def start(self, u: ti.template()):
        for i in range(self.particles.count[None]):
            u[i] = self.particles.u[i] if self.system.unknown(i) else ti.Vector.zero(float, self.dimension)

    @stage
    def foresee(self, dt: float, u: ti.template()):
        """Where the first solve starts: with the acceleration of the last step."""
        for i in range(self.particles.count[None]):
            if self.system.unknown(i):
                u[i] += dt * self.particles.a[i]

    @stage
    def right_hand_side(self, b: ti.template()):
        """b = (m/dt) u^n + m g + F[-(p~ + K s) I + stress - 2 mu_r q] + what is taken back of H [N]."""
        I = ti.Matrix.identity(float, self.particles.tensor_dimension)  # noqa: E741
        for i in range(self.particles.count[None]):
            b[i] = ti.Vector.zero(float, self.dimension)
            if self.system.acts(i):
                T = -(self.smoothing.p[i] + self.constants.bulk[None] * self.source[i]) * I
                if ti.static(self.stress.law == "bingham"):
                    T += self.particles.stress[i] - 2.0 * self.system.mu[i] * self.particles.plastic_rate[i]
                flux, push = self.correction.force(i)
                self.system.keep(i, self.gradient.spread_stress(i, T) + flux)
                b[i] = push
        for i in range(self.particles.count[None]):
            self.system.gather_pull(i)
        for i in range(self.particles.count[None]):
            if self.system.unknown(i):
                volume = self.particles.volume(i)
                own = volume * (self.system.inertia[i] * self.particles.u[i] + self.density(i) * self.g)
                b[i] += own + self.system.force(i)
                if ti.static(len(self.walls.surfaces) > 0):
                    heavy = self.density(i) * self.g * self.constants.pressed(self.smoothing.p[i])
                    share = self.gradient.counts_as(i)
                    b[i] += volume * self.walls.hydrostatic(i, self.particles.x[i], heavy, self.gradient.B[i], share)
                if ti.static(self.held):  # noqa: SIM102
                    if self.smoothing.full[None] == 1:
                        b[i] += volume * self.layer.excess(i)
                if ti.static(self.clings):  # noqa: SIM102
                    if self.smoothing.full[None] == 0:
                        b[i] += volume * self.layer.along_the_walls(i)
            else:
                b[i] = ti.Vector.zero(float, self.dimension)

    @stage
    def advance(self, dt: float, u: ti.template(), first: ti.i32):
        """Keep p; turn the stress with the material; x <- x + dt u/2 + shift. In the first step a particle that
        viscosity holds (it gains less than half of free fall) had its speed at once: x <- x + dt u."""
        for i in range(self.particles.count[None]):
            self.stress.carry(i, dt, u)
        for i in range(self.particles.count[None]):
            if self.particles.kind[i] == FLUID:
                half = 0.5 * u[i]
                if first != 0 and (u[i] - self.particles.u[i]).norm() < 0.5 * self.g.norm() * dt:
                    half = u[i] - 0.5 * self.particles.u[i]
                move = ti.cast(dt * half + self.shifting.shift[i], ti.f64)
                if ti.static(self.sleeps):
                    self.sleeping.count_rest(i, dt, u[i].norm(), self.stress.yielded[i] == 1)
                    if not self.system.unknown(i):
                        move *= 0.0
                self.particles.a[i] = (u[i] - self.particles.u[i]) / dt
                self.particles.u[i] = u[i]
                self.particles.x[i] = self.walls.outside(self.particles.x[i], move)
