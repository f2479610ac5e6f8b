"""The default scheme: viscosity, pressure and yield stress in one implicit system per step.

One step: drift half a step; neighbours and gradients there; smooth p; source s; then `passes` times solve for u, map
the trial stress back onto the yield surface and p <- p - K (div u - s); rotate the stress; drift the other half; shift.
"""

from ..backend import real, ti
from ..gradient import Gradient
from ..momentum import MomentumSystem
from ..mrpcg import MRPCG, GridLevels
from ..particles import FLUID
from ..rheology import bi_viscosity, compiled, curve_mapping, deviator, flow_curve, magnitude, return_mapping
from ..shifting import Shifting
from ..sleeping import Sleeping

NON_AFFINE = 0.6  # c: bond-associated dissipation gives 1/2 (shear) to 2/3 (along the bond), docs/equations.md
INERTIAL = 0.5  # non-affine motion of a thin fluid decays within two natural steps or so: h += 0.5 rho l0^2/step
EDGE = 4.0  # at the edge of a plug a quarter of the bonds carry all non-affine motion: their rate is twice the mean
SLOWEST = 1e-2  # strain per natural step below which the non-affine resistance of a yield-stress fluid stops growing
SMOOTHING = 0.6  # share of the neighbours' mean in the pressure
READING = 0.75  # the same in a snapshot
SOURCE, RING_SOURCE = 0.05, 0.2  # share of the packing error removed per step; thin rings lose more of it per step
STRAIN_SCALE = 0.02  # strain per step above which source and shift act fully
SMOOTHING_SCALE = 1e-3  # strain per step above which the pressure is smoothed fully
STIFFNESS = 75.0  # K = STIFFNESS rho (g H + U^2) times the natural step: that pressure compresses by 1/75 in one pass
VISCOUS_STIFFNESS = 8.0  # and K >= 8 mu_r: a slow flow is resisted by its viscosity, not by its weight
PENALTY = 6.0, 64.0  # mu_r >= 6 eta and 64 tau_y times the natural step: the stress converges in a few passes
EARLY = 10.0  # only the last pass is solved to the tolerance: the others to ten times that
COMPRESSION = 3.0  # mean pressure of a full closed box over the largest viscous stress in it
FIRST_PASSES = 30  # the pressure and the stress of the first step are found from zero


@ti.data_oriented
class Implicit:
    """Implicit coupled scheme for Newtonian, Bingham and bi-viscosity fluids in two or three dimensions."""

    REMEDY = "lower max_time_step or courant_number, or use precision f64"

    def __init__(self, scene, numerics, particles, neighbors, walls, constants):
        material, d = scene.material, scene.dimension
        self.particles, self.neighbors, self.walls = particles, neighbors, walls
        self.numerics = numerics
        self.dimension = d
        self.spacing = scene.spacing
        self.law = law_of(material)
        self.eta, self.tau_y = material.plastic_viscosity, material.yield_value
        self.curve, self.growth = flow_curve(material), compiled(getattr(material, "growth", None))
        self.has_curve, self.has_growth = self.curve is not None, self.growth is not None
        self.pi_c = material.critical_strain_rate or 0.0
        self.density = material.density
        self.g = ti.types.vector(d, real())(scene.gravity_vector)
        height = float(scene.fluid[:, -1].max() - scene.fluid[:, -1].min()) + scene.spacing
        gravity = float((scene.gravity_vector**2).sum() ** 0.5)
        self.layer_pressure = 0.5 * self.density * max(gravity, 0.1) * scene.spacing
        speeds = [float((scene.velocity**2).sum(1).max() ** 0.5)] if scene.velocity is not None else []
        speed = max(speeds + [wall.speed for wall in scene.walls] + [0.0])
        head = max(gravity, 0.1) * height + speed**2  # the pressure to expect, over the density [m2/s2]
        longest = longest_step(self.eta / self.density, gravity, height, scene.spacing)
        self.max_time_step = numerics.max_time_step or longest
        # the step [s] of this scene at its defaults: it scales what must not depend on the steps taken
        self.natural_step = min(longest, numerics.courant_number * scene.spacing / speed) if speed else longest
        self.inertial = INERTIAL * self.density * scene.spacing**2 / self.natural_step
        self.slowest = SLOWEST / self.natural_step
        self.mu_r = max(PENALTY[0] * self.eta, PENALTY[1] * self.tau_y * self.natural_step)
        self.bulk = max(
            STIFFNESS * self.density * head * min(self.natural_step, self.max_time_step), VISCOUS_STIFFNESS * self.mu_r
        )
        self.refill = RING_SOURCE if scene.axisymmetric else SOURCE
        self.drive = self.density * head / height  # force density [N/m3] that errors of the solve are compared with
        self.gradient = Gradient(neighbors, walls, constants, scene.spacing)
        self.sleeping = None
        if numerics.sleep and self.law == "bingham" and self.tau_y > 0.0:
            self.sleeping = Sleeping(particles, neighbors, scene.spacing, max(0.2, self.eta / self.tau_y))
        self.system = MomentumSystem(particles, self.gradient, walls, self.sleeping)
        self.sleeps = self.system.sleeps
        self.system.bulk[None] = self.bulk
        self.shifting = Shifting(particles, self.gradient, walls, scene.spacing)
        many = particles.capacity >= GridLevels.PAY_FROM
        self.solver = MRPCG(
            particles.capacity, d, self.system, GridLevels(self.system, neighbors.bins) if many else None
        )
        self.smooth_p = ti.field(real(), particles.capacity)  # smoothed pressure [Pa]
        self.source = ti.field(real(), particles.capacity)  # wanted divergence [1/s]
        self.reference = ti.field(ti.f64, ())  # drive . M^-1 drive over all particles [W]
        self.yielded = ti.field(ti.i32, particles.capacity)  # 1 where the material flows
        self.first = True
        self.stage = lambda name, call, *arguments: call(*arguments)  # a simulation that is profiled times them

    def state(self) -> dict:
        """Scalars the scheme carries from step to step."""
        return {"first": self.first} | ({"steps_asleep": self.sleeping.steps} if self.sleeping else {})

    def load(self, state: dict) -> None:
        self.first = state["first"]
        if self.sleeping:
            self.sleeping.steps = state["steps_asleep"]

    def time_step_limits(self, max_speed: float) -> dict[str, float]:
        """Largest allowed steps [s] by name."""
        limits = {"maximum": self.max_time_step}
        if max_speed > 0.0:
            limits["Courant"] = self.numerics.courant_number * self.spacing / max_speed
        return limits

    def step(self, dt: float) -> dict:
        """Advance the particles by dt [s]; returns iteration counts and the residual."""
        self.stage("gradient", self.gradient.build)
        if self.sleeping:
            self.stage("sleep", self.sleeping.rouse)
        self.system.inertia[None] = self.density / dt
        self.stage("smooth pressure", self.smooth_pressure, dt)
        if self.walls.rub:
            self.walls.tie(self.density / dt)
            self.begin_friction()
        self.stage("prepare", self.prepare, dt, self.first)
        self.balance()
        iterations, residual, status = 0, 0.0, "converged"
        passes = FIRST_PASSES if self.first else self.numerics.passes
        self.start(self.solver.x)
        for k in range(passes):
            if k == 0 or self.law == "bi-viscosity":
                self.stage("system", self.system.prepare)
                self.stage("levels", self.solver.prepare)
                self.refer()
            self.stage("right-hand side", self.right_hand_side, self.solver.b)
            if self.walls.move or self.walls.rub:
                self.system.subtract_wall_motion(self.solver.p, self.solver.q, self.solver.b)
            tolerance = self.numerics.tolerance * (EARLY if k + 1 < passes else 1.0)
            report = self.stage("solve", self.solver.solve, tolerance, 2000, self.reference[None])
            iterations += report.iterations
            residual, status = report.residuals[-1], report.status
            if status in ("broken", "indefinite"):
                break
            self.stage("stress", self.update_stress, self.solver.x)
        self.stage("shift", self.shifting.compute, dt, STRAIN_SCALE)
        if self.walls.travel:
            self.walls.place(self.walls.clock[None] + 0.5 * dt)  # drift left them at the middle of the step
        self.stage("advance", self.advance, dt, self.solver.x, self.first)
        self.first = False
        return {
            "viscous_iterations": passes,
            "pressure_iterations": iterations,
            "residual": residual,
            "status": status,
        }

    @ti.func
    def pressed(self, p):
        """0 where there is no pressure to 1 from that of half a layer of particles [-]."""
        return ti.max(0.0, ti.min(1.0, p / self.layer_pressure))

    @ti.func
    def deforming(self, i, dt, strain):
        """0 at rest to 1 where a step strains the material by ``strain`` [-]."""
        return ti.min(1.0, self.particles.shear_rate[i] * dt / strain)

    @ti.func
    def mean_pressure(self, i, share):
        """(1-a) p_i + a sum w (p_j - f rho g.r_ij)/sum w over particles that carry stress, a the ``share``; f fades to
        zero where p_i is below that of half a layer, for a body in free fall has no hydrostatic part."""
        x = self.particles.x[i]
        total, weight = ti.cast(0.0, float), ti.cast(0.0, float)
        heavy = self.density * self.g * self.pressed(self.particles.p[i])
        for k in range(self.neighbors.row_start[i], self.neighbors.row_start[i + 1]):
            j = self.neighbors.column[k]
            if self.gradient.B[j][0, 0] > 0.0:
                r = ti.cast(self.neighbors.bins.displacement(x, self.particles.x[j]), float)
                w = self.gradient.weight_r2[k] * r.dot(r)
                total += w * (self.particles.p[j] - heavy.dot(r))
                weight += w
        p = self.particles.p[i]
        if weight > 0.0:
            p = (1.0 - share) * p + share * total / weight
        return p

    @ti.kernel
    def smooth_pressure(self, dt: float):
        """p~: the mean pressure with the share 0.6 where the material deforms and 0 at rest."""
        for i in range(self.particles.count[None]):
            self.smooth_p[i] = 0.0
            if self.gradient.B[i][0, 0] > 0.0:
                self.smooth_p[i] = self.mean_pressure(i, SMOOTHING * self.deforming(i, dt, SMOOTHING_SCALE))

    @ti.kernel
    def read_pressure(self):
        """The pressure to read, into ``smooth_p``, which the next step fills anew: the force does not see what
        alternates from particle to particle, so nothing holds it down at rest, and it means nothing."""
        for i in range(self.particles.count[None]):
            self.smooth_p[i] = self.particles.p[i]
            if self.gradient.B[i][0, 0] > 0.0:
                self.smooth_p[i] = self.mean_pressure(i, READING)

    @ti.kernel
    def begin_friction(self):
        """The slip that each particle brings along to the walls with friction."""
        for i in range(self.particles.count[None]):
            mu = ti.cast(self.eta, float)
            if ti.static(self.law == "bingham"):
                mu = self.mu_r
            elif ti.static(self.law == "bi-viscosity"):
                mu = bi_viscosity(self.particles.shear_rate[i], self.eta, self.tau_y, self.pi_c)
            volume, share = self.particles.volume(i), self.gradient.counts_as(i)
            B = self.gradient.B[i]
            self.walls.begin_friction(i, self.particles.x[i], self.particles.u[i], B, volume, mu, share)

    @ti.kernel
    def prepare(self, dt: float, first: ti.i32):
        """Source, implicit viscosity and non-affine resistance from the last velocity."""
        for i in range(self.particles.count[None]):
            G, left = self.gradient.fit(i, self.particles.u, 1.0)
            rate = 2.0 * magnitude(deviator(G))
            excess = self.gradient.packing[i] - 1.0
            error = ti.max(excess, -0.03 if self.gradient.enclosed(i) else 0.0)
            source = ti.max(-1.0, ti.min(1.0, self.refill * error / dt))
            self.source[i] = source * self.deforming(i, dt, STRAIN_SCALE)
            mu = self.eta
            h = NON_AFFINE * self.eta + self.inertial
            if ti.static(self.law == "bingham"):
                mu = self.mu_r
            if ti.static(self.law != "newtonian"):  # noqa: SIM102  (a compiled choice stays apart)
                if first == 0:
                    bond_rate = ti.max(ti.sqrt(rate * rate + 2.0 * NON_AFFINE * EDGE * left), self.slowest)
                    if ti.static(self.has_curve):
                        h = NON_AFFINE * self.curve(bond_rate, self.structure(i)) / bond_rate + self.inertial
                    else:
                        h += NON_AFFINE * self.tau_y / bond_rate
            if ti.static(self.law == "bi-viscosity"):
                mu = bi_viscosity(rate, self.eta, self.tau_y, self.pi_c)
            self.system.mu[i] = mu
            self.system.h[i] = 2.0 * self.particles.volume(i) * h / self.gradient.lattice(i)[0]

    @ti.kernel
    def balance(self):
        """A box full of fluid has no surface to give way: there no mean divergence can be wanted, and the pressure,
        which is free up to a constant, is kept high enough that nothing is in tension: tension tears voids open."""
        ti.loop_config(serialize=True)
        for _ in range(1):
            surface, rows = 0, ti.cast(0.0, ti.f64)
            source, pressure = ti.cast(0.0, ti.f64), ti.cast(0.0, ti.f64)
            momentum = ti.Vector.zero(ti.f64, self.dimension)
            fastest, speed2 = ti.cast(0.0, float), ti.cast(0.0, float)
            for i in range(self.particles.count[None]):
                if self.gradient.B[i][0, 0] > 0.0:
                    volume = ti.cast(self.particles.volume(i), ti.f64)
                    rows += volume
                    source += volume * self.source[i]
                    pressure += volume * self.smooth_p[i]
                    fastest = ti.max(fastest, self.particles.shear_rate[i])
                    momentum += volume * ti.cast(self.particles.u[i], ti.f64)
                    if self.gradient.around[i] < 0.75 * self.gradient.full:
                        surface += 1
            if surface == 0 and rows > 0.0:
                mean_source, mean_u = ti.cast(source / rows, float), ti.cast(momentum / rows, float)
                for i in range(self.particles.count[None]):
                    if self.gradient.B[i][0, 0] > 0.0:
                        speed2 = ti.max(speed2, (self.particles.u[i] - mean_u).norm_sqr())
                wanted = COMPRESSION * (self.eta * fastest + self.tau_y) + self.density * speed2
                missing = wanted - ti.cast(pressure / rows, float)
                for i in range(self.particles.count[None]):
                    self.source[i] -= mean_source
                    self.smooth_p[i] += missing

    @ti.kernel
    def refer(self):
        """What the residual of the solve is compared with, in the solver's norm."""
        ti.loop_config(serialize=True)
        for _ in range(1):
            total = ti.cast(0.0, ti.f64)
            for i in range(self.particles.count[None]):
                drive = self.drive * self.particles.volume(i)
                total += ti.cast(self.system.inverse_diagonal[i].trace() * drive**2, ti.f64)
            self.reference[None] = total / self.dimension

    @ti.kernel
    def drift(self, dt: float):
        """x <- x + dt u/2, before the neighbours are found: forces act at the middle of the step, so a body in rotation
        keeps its angular momentum and a wave its energy."""
        for i in range(self.particles.count[None]):
            if self.particles.kind[i] == FLUID:
                move = ti.cast(0.5 * dt * self.particles.u[i], ti.f64)
                self.particles.x[i] = self.walls.outside(self.particles.x[i], move)

    @ti.kernel
    def start(self, u: ti.template()):
        for i in range(self.particles.count[None]):
            u[i] = self.particles.u[i] if self.system.unknown(i) else ti.Vector.zero(float, self.dimension)

    @ti.kernel
    def right_hand_side(self, b: ti.template()):
        """b = (m/dt) u^n + m g + F[-(p~ + K s) I + stress - 2 mu_r q] [N]."""
        I = ti.Matrix.identity(float, self.particles.tensor_dimension)  # noqa: E741
        for i in range(self.particles.count[None]):
            if self.system.acts(i):
                T = -(self.smooth_p[i] + self.bulk * self.source[i]) * I
                if ti.static(self.law == "bingham"):
                    T += self.particles.stress[i] - 2.0 * self.mu_r * self.particles.plastic_rate[i]
                self.system.flux[i] = self.gradient.spread_stress(i, T)
        for i in range(self.particles.count[None]):
            b[i] = ti.Vector.zero(float, self.dimension)
            if self.system.unknown(i):
                volume = self.particles.volume(i)
                own = volume * (self.system.inertia[None] * self.particles.u[i] + self.density * self.g)
                b[i] = own + self.gradient.force(i, self.system.flux)
                if ti.static(len(self.walls.surfaces) > 0):
                    heavy = self.density * self.g * self.pressed(self.smooth_p[i])
                    share = self.gradient.counts_as(i)
                    b[i] += volume * self.walls.hydrostatic(self.particles.x[i], heavy, self.gradient.B[i], share)

    @ti.func
    def structure(self, i):
        """Structure of a thixotropic particle, 0 of any other [-]."""
        structure = ti.cast(0.0, float)
        if ti.static(self.has_growth):
            structure = self.particles.structure[i]
        return structure

    @ti.func
    def yield_law(self, i, trial):
        """Stress [Pa], plastic rate and its size [1/s] of particle i for a trial stress [Pa]."""
        if ti.static(self.has_curve):
            return curve_mapping(self.curve, trial, self.structure(i), self.mu_r)
        else:
            return return_mapping(trial, self.eta, self.tau_y, self.mu_r)

    @ti.kernel
    def update_stress(self, u: ti.template()):
        """Shear rate, divergence, and the stress mapped back onto the yield surface, from the velocity u."""
        for i in range(self.particles.count[None]):
            if self.particles.kind[i] != FLUID:
                u[i] = self.particles.u[i]
        for i in range(self.particles.count[None]):
            if self.system.acts(i):
                G = self.gradient.velocity_gradient(i, u, 1.0)
                D = deviator(G)
                rate = 2.0 * magnitude(D)
                self.particles.shear_rate[i] = rate
                self.smooth_p[i] -= (
                    self.bulk * (G.trace() - self.source[i]) * ti.cast(self.gradient.B[i][0, 0] > 0.0, float)
                )
                if ti.static(self.law == "bingham"):
                    trial = self.particles.stress[i] + 2.0 * self.mu_r * D
                    stress, q, flow = self.yield_law(i, trial)
                    carries = ti.cast(self.gradient.B[i][0, 0] > 0.0, float)
                    self.particles.stress[i] = stress * carries
                    self.particles.plastic_rate[i] = q * carries
                    self.yielded[i] = flow > 0.0
                elif ti.static(self.law == "bi-viscosity"):
                    self.yielded[i] = rate >= 2.0 * self.pi_c
                    self.system.mu[i] = bi_viscosity(rate, self.eta, self.tau_y, self.pi_c)
                else:
                    self.yielded[i] = 1
                if ti.static(self.walls.rub):
                    T = 2.0 * self.system.mu[i] * D
                    if ti.static(self.law == "bingham"):
                        T = self.particles.stress[i]
                    flux = self.gradient.spread_stress(i, T)
                    self.walls.adjust_friction(i, self.particles.x[i], u[i], flux, self.system.mu[i])

    @ti.kernel
    def advance(self, dt: float, u: ti.template(), first: ti.i32):
        """Keep p; rotate the stress with the material; x <- x + dt u/2 + shift. In the first step a particle that
        viscosity holds (it gains less than half of free fall) had its speed at once: x <- x + dt u."""
        for i in range(self.particles.count[None]):
            self.particles.p[i] = self.smooth_p[i]
            if ti.static(self.sleeps):  # noqa: SIM102  (a compiled choice stays apart)
                if not self.system.acts(i):  # what sleeps does not deform
                    self.particles.shear_rate[i], self.yielded[i] = 0.0, 0
            if ti.static(self.has_growth):
                self.particles.structure[i] += dt * self.growth(self.particles.shear_rate[i], self.structure(i))
            if ti.static(self.law == "bingham"):
                G = self.gradient.velocity_gradient(i, u, 1.0)
                W = 0.5 * (G - G.transpose())
                stress = self.particles.stress[i]
                self.particles.stress[i] = stress + dt * (W @ stress - stress @ W)
        for i in range(self.particles.count[None]):
            if self.particles.kind[i] == FLUID:
                half = 0.5 * u[i]
                if first != 0 and (u[i] - self.particles.u[i]).norm() < 0.5 * self.g.norm() * dt:
                    half = u[i] - 0.5 * self.particles.u[i]
                move = ti.cast(dt * half + self.shifting.shift[i], ti.f64)
                if ti.static(self.sleeps):
                    self.sleeping.count_rest(i, dt, u[i].norm(), self.yielded[i] == 1)
                    if not self.system.unknown(i):
                        move *= 0.0
                self.particles.u[i] = u[i]
                self.particles.x[i] = self.walls.outside(self.particles.x[i], move)


def law_of(material) -> str:
    """'newtonian', 'bingham' (true yield value) or 'bi-viscosity' (a critical strain rate is given)."""
    if material.newtonian:
        return "newtonian"
    return "bingham" if material.critical_strain_rate is None else "bi-viscosity"


def longest_step(kinematic_viscosity: float, gravity: float, height: float, spacing: float) -> float:
    """Step [s] that resolves the fall of the body, 0.057 sqrt(H/g), or the viscous flow where that is slower; a fluid
    too thin to damp motion on the scale of a particle must resolve that motion, 0.06 sqrt(l0/g)."""
    gravity = max(gravity, 0.1)
    fall = 0.057 * (height / gravity) ** 0.5
    damping = kinematic_viscosity / (spacing * (gravity * spacing) ** 0.5)
    return max(
        min(fall, 0.06 * (spacing / gravity) ** 0.5 * (1.0 + damping)), 0.5 * kinematic_viscosity / (gravity * height)
    )
