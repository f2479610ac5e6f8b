"""Force and torque of the fluid on each wall (I29): the reaction to all that the wall gives to the particles.

A wall is seen by the gradient of a particle, G = N B, through what its own motion v + S (x - point) adds to N. The
force and the torque on it are what do work on v and on S: with the flux P = V T B - h G of the particle, c(z) and t(z)
of its ghosts, and the arm a from the wall's point to the foot,

    force = c P n + reactions,      torque_k = (a x force)_k + t e_abk (P (I - n n))_ab.

So over all walls they are what momentum and angular momentum of the fluid lose, but for the weight.
"""

import numpy as np

from ..runtime.backend import real, ti
from ..runtime.field_io import FieldIO
from ..runtime.stages import stage


class NoWallLoads:
    """Of a run in which nobody asks for them."""

    known = False

    def find(self, u):
        """Nothing."""

    def read(self, count: int) -> dict:
        """None."""
        return {}


@ti.data_oriented
class WallLoads:
    """What every particle gives to the walls of the numbers ``measured``: force [N], and torque about the wall's point
    [N m]. ``known``: whether they belong to the state that the particles are in."""

    def __init__(
        self, particles, gradient, walls, constants, pressure, stress, resistance, solved_rate, known, measured, g
    ):
        self.particles, self.gradient, self.walls, self.constants = particles, gradient, walls, constants
        self.pressure, self.stress, self.resistance, self.solved_rate = pressure, stress, resistance, solved_rate
        self.correction, self.wall_stress = known
        self.dimension = d = particles.dimension
        self.g = ti.types.vector(d, real())(g)
        self.numbers = measured
        self.forces = [ti.Vector.field(d, real(), particles.capacity) for _ in self.numbers]  # [N]
        self.torques = [ti.Vector.field(1 if d == 2 else 3, real(), particles.capacity) for _ in self.numbers]  # [N m]
        self.fields_of_walls = list(zip(self.forces, self.torques, strict=True))
        self.known = False
        fields = {f"force_{k}": field for k, field in enumerate(self.forces)}
        fields |= {f"torque_{k}": field for k, field in enumerate(self.torques)}
        self.fields = FieldIO(fields, particles.capacity)

    def read(self, count: int) -> dict:
        """``force_k`` (count, d) and ``torque_k`` (count, 1 or 3) of the first rows, k counts ``measured``; nan where
        they are not known."""
        rows = self.fields.read(count)
        return rows if self.known else {name: np.full(row.shape, np.nan) for name, row in rows.items()}

    def find(self, u) -> None:
        """The loads with the stress and the pressure that belong to the velocity u."""
        self.known = True
        self.set(u)

    @stage("wall loads")
    def set(self, u: ti.template()):
        for i in range(self.particles.count[None]):
            for force, torque in ti.static(self.fields_of_walls):
                force[i] = ti.Vector.zero(float, self.dimension)
                torque[i] = ti.Vector.zero(float, torque.n)
            x, volume = self.particles.x[i], self.particles.volume(i)
            T = self.stress.total(i)
            T -= self.pressure.p[i] * ti.Matrix.identity(float, T.n)
            h, flux = self.resistance.h[i], self.correction.force(i)[0]
            flux += volume * (self.gradient.in_plane(T) @ self.gradient.B[i])
            flux -= h * self.gradient.in_plane(self.solved_rate.velocity_gradient(i))
            weight = self.constants.density_of(i) * self.g * self.constants.pressed(self.pressure.p[i])
            size = self.gradient.cross_section_ratio(i)
            for f, wall in ti.static(enumerate(self.walls.faces)):
                z, n, _velocity, curvature = wall.face(i, x, self.walls.slots[f])
                if z < self.walls.effective_radius:
                    push = self.walls.force_term(i, x, flux, f) - h * self.walls.drag_term(i, x, u[i], 1.0, f)
                    push -= self.walls.friction_term(i, x, u[i], 1.0, f)
                    push += volume * self.walls.hydrostatic(i, x, weight, self.gradient.B[i], size, f)
                    push += volume * self.wall_stress.force(i, f) + self.correction.push_of_walls(i, f)
                    arm = ti.cast(wall.arm(x), float) - z * n
                    turn = self.turned(arm, -push)
                    if ti.static(not wall.slip):
                        t = self.walls.ghosts.lookup("tangential", i, wall, f, x, z, curvature, size)
                        if ti.static(wall.has_friction):
                            t *= wall.friction.bond[i]
                        turn += t * self.odd(flux - (flux @ n).outer_product(n))
                    for k in ti.static(self.of_face(f)):
                        self.forces[k][i] -= push
                        self.torques[k][i] += turn

    def of_face(self, f) -> list:
        """The place, among the walls that are measured, of the one that this face belongs to."""
        return [k for k, number in enumerate(self.numbers) if number == self.walls.surface_of[f]]

    @ti.func
    def turned(self, arm, force):
        """arm x force [N m]."""
        return self.odd(arm.outer_product(force))

    @ti.func
    def odd(self, A):
        """e_abk A_ab, (1,) in two dimensions and (3,) in three."""
        if ti.static(self.dimension == 2):
            return ti.Vector([A[0, 1] - A[1, 0]])
        else:
            return ti.Vector([A[1, 2] - A[2, 1], A[2, 0] - A[0, 2], A[0, 1] - A[1, 0]])
