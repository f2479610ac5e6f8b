"""Forces of the fluid on walls: on walls with friction, which slip (I23), and on walls whose loads are measured.

Force and torque of the fluid on a wall (I29) are the reaction to all that it gives to the particles.

A wall is seen by the gradient of a particle, G = N B, through what its own motion v + S (x - point) adds to N. The
force and the torque on it are what do work on v and on S: with the flux P = V T B - h G of the particle, c(z) and t(z)
of its ghosts, and the arm a from the wall's point to the foot,

    force = c P n + reactions,      torque_k = (a x force)_k + t e_abk ((P + h S)(I - n n))_ab:

hourglass modes are resisted in the frame of the wall. So over all walls they are what momentum and angular momentum of
the fluid lose, but for the weight.
"""

import numpy as np

from ..runtime.backend import double_field, real, ti
from ..runtime.field_io import FieldIO
from ..runtime.stages import stage
from ..runtime.sums import sum_threads
from .constants import Term


@ti.data_oriented
class WallFriction(Term):
    """Friction of the walls (boundaries/friction.py): the slip at the start of a step and after each iteration."""

    def __init__(self, fluid, constants, pressure, stress, resistance, solved_rate):
        super().__init__(
            fluid, constants=constants, pressure=pressure, stress=stress, resistance=resistance, solved_rate=solved_rate
        )

    def set_initial_slip(self, dt):
        """Set penalty and slip at the start of a step of dt [s]."""
        self.walls.set_friction_penalty(self.constants.materials[0].density / dt)
        self.initialize_slip()

    @stage("friction")
    def initialize_slip(self):
        """Set the slip of each particle on walls with friction from the slip that it carries."""
        for i in range(self.particles.count[None]):
            mu = self.stress.viscosity(i, self.particles.shear_rate[i])
            volume, size = self.particles.volume(i), self.gradient.cross_section_ratio(i)
            B = self.gradient.B[i]
            self.walls.set_initial_slip(i, self.particles.x[i], self.particles.u[i], B, volume, mu, size)

    @stage("friction")
    def update_slip(self, u: ti.template()):
        """Update slip and traction from the stress, pressure and hourglass resistance of each particle."""
        for i in range(self.particles.count[None]):
            B, x, h = self.gradient.B[i], self.particles.x[i], self.resistance.h[i]
            G = self.solved_rate.velocity_gradient(i)
            flux = self.gradient.stress_flux(i, self.stress.total(i, self.solved_rate)) - h * self.gradient.in_plane(G)
            weight = (
                self.particles.volume(i) * self.constants.head_density(i) * ti.cast(self.constants.gravity_at(i), float)
            )
            weight *= self.pressure.hydrostatic_fraction(self.pressure.whole(i))
            size, mu = self.gradient.cross_section_ratio(i), self.stress.mu[i]
            self.walls.update_slip(i, x, u[i], flux, weight, B, mu, h, size)


@ti.data_oriented
class WallLoads(Term):
    """Contribution of every particle to the loads of the walls ``measured``: force [N], and torque about the wall's
    point [N m]. ``up_to_date``: whether they belong to the present state of the particles."""

    def __init__(self, fluid, measured, constants, pressure, stress, resistance, solved_rate, correction, wall_stress):
        super().__init__(
            fluid,
            constants=constants,
            pressure=pressure,
            stress=stress,
            resistance=resistance,
            solved_rate=solved_rate,
            correction=correction,
            wall_stress=wall_stress,
        )
        self.numbers, self.up_to_date = measured, False
        # weight that the hydrostatic pressure beside p holds, and what walls bear of it, less in corners [N]
        self.held, self.threads = double_field(components=2), sum_threads()
        d, capacity, axes = self.dimension, self.capacity, 1 if self.dimension == 2 else 3
        self.forces = [ti.Vector.field(d, real(), capacity) for _ in measured]  # [N]
        self.torques = [ti.Vector.field(axes, real(), capacity) for _ in measured]  # [N m]
        forces = {f"force_{k}": field for k, field in enumerate(self.forces)}
        self.fields = FieldIO(forces | {f"torque_{k}": field for k, field in enumerate(self.torques)}, capacity)

    def read(self, count: int) -> dict:
        """``force_k`` (count, d) and ``torque_k`` (count, 1 or 3) of the first rows, k counts ``measured``; nan where
        they are not up to date."""
        rows = self.fields.read(count)
        return rows if self.up_to_date else {name: np.full(row.shape, np.nan) for name, row in rows.items()}

    def evaluate(self, u) -> None:
        """Evaluate the loads with the stress and the pressure that belong to the velocity u."""
        self.up_to_date = True
        self.set(u)

    @ti.func
    def hydrostatic_force(self, i, f: ti.template()):
        """Force [N] of a face of a wall on particle i by the hydrostatic pressure beside p."""
        x, B, size = self.particles.x[i], self.gradient.B[i], self.gradient.cross_section_ratio(i)
        weight = ti.cast(self.constants.density_held(i) * self.constants.gravity[None], float)
        force = self.walls.hydrostatic(i, x, weight, B, size, f)
        return self.particles.volume(i) * (force + self.walls.force_term(i, x, -self.pressure.hydrostatic(i) * B, f))

    @ti.func
    def with_corners(self, force):
        """A hydrostatic force [N] with its part along gravity so much larger that the walls bear the weight held; at
        most twice, where they are not all that bears it."""
        weight, borne = self.held[None]
        more = weight / ti.max(borne, 0.5 * weight, 1e-30) - 1.0
        along = self.constants.along_gravity(force) / ti.max(self.constants.gravity[None].norm(), 1e-30)
        return force + ti.cast(more * along * self.constants.gravity[None], float)

    @stage("wall loads")
    def set(self, u: ti.template()):
        if ti.static(self.constants.holds):
            for _ in range(1):
                self.held[None] = ti.Vector.zero(ti.f64, 2)
            ti.loop_config(serialize=self.threads == 1)
            for thread in range(self.threads):
                lane_sums = ti.Vector.zero(ti.f64, 2)
                for k in range((self.particles.count[None] - thread + self.threads - 1) // self.threads):
                    i = thread + k * self.threads
                    gravity = self.constants.gravity[None].norm()
                    lane_sums[0] += self.constants.density_held(i) * self.particles.volume(i) * gravity
                    for f in ti.static(range(len(self.walls.faces))):
                        force = ti.cast(self.hydrostatic_force(i, f), ti.f64)
                        lane_sums[1] -= self.constants.along_gravity(force)
                self.held[None] += lane_sums
        for i in range(self.particles.count[None]):
            for field in ti.static(self.forces + self.torques):
                field[i] = ti.zero(field[i])
            x, volume = self.particles.x[i], self.particles.volume(i)
            h, flux = self.resistance.h[i], self.correction.force(i)[0]
            flux += volume * (self.gradient.in_plane(self.stress.total(i, self.solved_rate)) @ self.gradient.B[i])
            flux -= h * self.gradient.in_plane(self.solved_rate.velocity_gradient(i))
            weight = self.constants.head_density(i) * ti.cast(self.constants.gravity_at(i), float)
            weight *= self.pressure.hydrostatic_fraction(self.pressure.whole(i))
            size = self.gradient.cross_section_ratio(i)
            for f, wall in ti.static(enumerate(self.walls.faces)):
                z, n, _velocity, curvature = wall.face(i, x, self.walls.slots[f])
                if z < self.walls.effective_radius:
                    force = self.walls.force_term(i, x, flux, f) - h * self.walls.drag_term(i, x, u[i], 1.0, f)[0]
                    force -= self.walls.friction_term(i, x, u[i], 1.0, f)
                    force += volume * self.walls.hydrostatic(i, x, weight, self.gradient.B[i], size, f)
                    if ti.static(self.constants.holds):
                        force += self.with_corners(self.hydrostatic_force(i, f))
                    force += volume * self.wall_stress.force(i, f) + self.correction.force_of_walls(i, f)
                    arm = ti.cast(wall.arm(x), float) - z * n
                    moment = self.axial_vector(arm.outer_product(-force))  # arm x force
                    if ti.static(not wall.slip):
                        t, couple = self.walls.tangential(i, wall, f, x, z, curvature, size), flux
                        if ti.static(wall.rotates):
                            couple += h * ti.cast(wall.spin, float)
                        moment += t * self.axial_vector(couple - (couple @ n).outer_product(n))
                    for k in ti.static(self.of_face(f)):
                        self.forces[k][i] -= force
                        self.torques[k][i] += moment

    def of_face(self, f) -> list:
        """Index of this face's wall among the walls that are measured, as a list of none or one."""
        return [k for k, number in enumerate(self.numbers) if number == self.walls.surface_of[f]]

    @ti.func
    def axial_vector(self, A):
        """e_abk A_ab, (1,) in two dimensions and (3,) in three."""
        if ti.static(self.dimension == 2):
            return ti.Vector([A[0, 1] - A[1, 0]])
        else:
            return ti.Vector([A[1, 2] - A[2, 1], A[2, 0] - A[0, 2], A[0, 1] - A[1, 0]])
