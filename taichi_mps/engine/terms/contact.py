"""Contacts of grains with each other and with walls: multipliers of the outer iterations, with friction (G5).

At a contact with the normal n from the other, and the velocity v of the grain relative to the other there, its force is

    f <- f - r (v + (max(0, gap)/dt + mu |v_t|) n), to the nearest of the cone |f - n n.f| <= mu n.f,

v_t the slip of the iteration before (de Saxce and Feng 1998), and in the matrix of the step stands r I where it sticks,
r p p^T where it slips, p along f. Friction of the last normal force instead diverges in a gap with tan a < mu: a disc
that falls into it flies out faster. Nothing of f takes an overlap back, and after an impact only what other forces than
inertia need goes on: friction would lock the rest in a gap for ever. A grain keeps the list of its own
contacts, so one between two grains is in both lists, with opposite forces, and each grain sums its own. Pairs are found
in the lists of neighbours of its particles; on a wall the point nearest to each of them, so each bar is a contact. In a
clump each sphere has contacts of its own, found by the particles that count for it. A list that is full ends the run.
"""

import numpy as np

from ..particles.neighbors import CapacityError
from ..runtime.backend import double_field, ti
from ..runtime.field_io import FieldIO
from ..runtime.stages import stage
from ..runtime.thread_team import first, last, wait
from .constants import Term

NEAR = 0.5  # gap over l0 from which on two are a contact
# room of a grain for contacts with each wall; largest number of a sphere's with one wall: all faces of a box
WALL_CONTACT_ROOM, MAX_WALL_CONTACTS = 3, 6
OF_CLUMP = 3  # room for contacts of a clump over that of a sphere
SAME_CONTACT = 0.5  # cosine between normals from which on two points of a wall are one contact
# r = m/dt + 6 pi eta a + 200 tau_y a^2 of the smaller grain; ten times that between dry grains, whose solves are exact.
# In mortar the solves before the last leave a part of each velocity, and a large r makes large forces of it
YIELD_STIFFNESS, DRY_STIFFNESS = 200.0, 10.0
# overlap over l0 that stays, and part of a larger one that each grain takes back in a step
MAX_OVERLAP, BACK = 0.01, 0.1
FOOT_TURNS = 20  # in which the foot of a contact on a wall is found; each leaves 1 - l0/(2 a) of its error on a plane
NONE = int(-1e6)  # no partner


def most_contacts(radii, surfaces: int) -> int:
    """Largest number of contacts of a grain: of small ones around a large one, by the area that each takes."""
    return int(4.0 * (1.0 + 1.2 * float(np.max(radii) / np.min(radii))) ** 2) + WALL_CONTACT_ROOM * surfaces


@ti.data_oriented
class Contacts(Term):
    """Contacts of the grains of a ``rigid``, and what the matrix and its right-hand side get of the grains."""

    def __init__(self, fluid, constants, rigid, grains):
        super().__init__(fluid, constants=constants, rigid=rigid)
        self.spacing, self.friction, self.parts = self.gradient.spacing, grains.friction, rigid.parts
        # room of each grain
        self.most = most_contacts(rigid.radii, len(self.walls.surfaces)) * (OF_CLUMP if self.parts > 1 else 1)
        n = rigid.count * self.most
        self.number = ti.field(ti.i32, rigid.count)
        self.overflow = ti.field(ti.i32, ())  # times in the step that a contact found no room
        # partner: k s + own part of the sphere s of another grain, of k parts each; -1 - (k w + own part) of wall w;
        # whether it sticks
        self.partner, self.sticks = (ti.field(ti.i32, n) for _ in range(2))
        # what it resists velocities with, and the same before the last update [N s/m]
        self.resistance, self.last_resistance = (ti.Matrix.field(3, 3, ti.f64, n) for _ in range(2))
        self.normal, self.force, self.wall_velocity = (double_field(n, 3) for _ in range(3))  # [-, N, m/s]
        # [m], r [N s/m], the speed |v_t| that the cone is shifted by, 0 where it sticks [m/s]
        self.gap, self.stiffness, self.slip = (double_field(n) for _ in range(3))
        kept = "partner", "normal", "force", "slip", "sticks"
        # of the step before
        self.old_partner, self.old_sticks, self.old_slip = ti.field(ti.i32, n), ti.field(ti.i32, n), double_field(n)
        self.old_normal, self.old_force = double_field(n, 3), double_field(n, 3)
        self.kept = [(getattr(self, name), getattr(self, f"old_{name}")) for name in kept]
        self.step = double_field()  # dt [s]
        self.force_fraction = double_field(rigid.count)  # of its forces, with which a step begins [-]
        # mobility of each grain, the inverse of what resists its translation [s/kg] and its rotation [s/(kg m2)]
        self.translation_mobility, self.rotation_mobility = (
            ti.Matrix.field(3, 3, ti.f64, rigid.count) for _ in range(2)
        )
        self.field_io = FieldIO({f"contact_{name}": field for name, (field, _) in zip(kept, self.kept, strict=True)}, n)
        self.partner.fill(NONE)

    # ---- finding ---------------------------------------------------------------------------------------------------
    @stage("contacts")
    def find(self, dt: float):
        """Find the contacts at the present places; those of the step before go on with their forces."""
        for _ in range(1):
            self.step[None], self.overflow[None] = dt, 0
        for c in range(self.rigid.count * self.most):
            for kept, old in ti.static(self.kept):
                old[c] = kept[c]
            self.partner[c] = NONE
        for g in range(self.rigid.count):
            self.number[g] = 0
            self.find_grains(g)
            for k, wall in ti.static(enumerate(self.walls.surfaces)):
                for s in range(g * self.parts, (g + 1) * self.parts):
                    self.find_wall_contacts(g, s, k, wall)

    @ti.func
    def find_grains(self, g):
        """Contacts of grain g with others, from the neighbours of its particles."""
        for m in range(self.rigid.begin[g], self.rigid.end[g]):
            i, s = self.rigid.row[m], self.rigid.sphere_of[m]
            centre = self.rigid.in_scene(self.rigid.sphere_centre(s))
            for p in range(self.neighbors.row_start[i], self.neighbors.row_start[i + 1]):
                t = self.rigid.sphere(self.neighbors.column[p])
                partner = t * self.parts + s % self.parts
                known = t < 0 or t // self.parts == g
                for c in range(g * self.most, g * self.most + self.number[g]):
                    known = known or self.partner[c] == partner
                if not known:
                    r = -self.three_components(
                        self.neighbors.bins.displacement(centre, self.rigid.in_scene(self.rigid.sphere_centre(t)))
                    )
                    gap = r.norm() - self.rigid.sphere_radius[s] - self.rigid.sphere_radius[t]
                    if gap < NEAR * self.spacing:
                        self.add(g, partner, r / r.norm(), gap, ti.Vector.zero(ti.f64, 3))

    @ti.func
    def find_wall_contacts(self, g, s, k: ti.template(), wall: ti.template()):
        """Contacts of sphere s of grain g with wall k: the point nearest to its particles, and others in other
        directions."""
        centre, radius, begin = self.rigid.sphere_centre(s), self.rigid.sphere_radius[s], self.number[g]
        for n in range(MAX_WALL_CONTACTS):
            least, towards = ti.cast(1e9, ti.f64), ti.Vector.zero(ti.f64, 3)
            if n == 0 or self.number[g] == begin + n:
                for m in range(self.rigid.begin[g], self.rigid.end[g]):
                    if self.rigid.sphere_of[m] == s:
                        distance, point, _velocity = self.nearest_point(wall, self.rigid.centre[g] + self.rigid.arm[m])
                        away = (point - centre).norm()
                        if distance < 2.4 * self.spacing and away < least:
                            new = True
                            for c in range(g * self.most + begin, g * self.most + self.number[g]):
                                new = new and -self.normal[c].dot(point - centre) < SAME_CONTACT * away
                            if new:
                                least, towards = away, (point - centre) / away
            if least < radius + 2.0 * self.spacing:
                gap, velocity = ti.cast(1e9, ti.f64), ti.Vector.zero(ti.f64, 3)
                for _ in range(FOOT_TURNS):  # the point nearest to the grain's own surface
                    _distance, point, velocity = self.nearest_point(
                        wall, centre + (radius - 0.5 * self.spacing) * towards
                    )
                    gap = (point - centre).norm() - radius
                    towards = (point - centre).normalized()
                if gap < NEAR * self.spacing:
                    self.add(g, -1 - (k * self.parts + s % self.parts), -towards, gap, velocity)

    @ti.func
    def nearest_point(self, wall: ti.template(), x):
        """Distance of x [m] from a wall, the point of the wall that is nearest [m], and its velocity [m/s]."""
        z, n, velocity, _curvature = wall.nearest(self.rigid.in_scene(x))
        return z, x - ti.cast(z, ti.f64) * self.three_components(n), self.three_components(velocity)

    @ti.func
    def add(self, g, other, normal, gap, velocity):
        """Add a contact to the list of grain g, with the forces that it had."""
        if self.number[g] < self.most:
            c = g * self.most + self.number[g]
            self.number[g] += 1
            self.partner[c], self.normal[c], self.gap[c], self.wall_velocity[c] = other, normal, gap, velocity
            self.stiffness[c] = self.penalty(g, self.other(g, c))
            self.force[c], self.slip[c], self.sticks[c] = ti.Vector.zero(ti.f64, 3), 0.0, 0
            for b in range(g * self.most, (g + 1) * self.most):
                if self.old_partner[b] == other and self.old_normal[b].dot(normal) > SAME_CONTACT:
                    self.force[c], self.slip[c], self.sticks[c] = (
                        self.old_force[b],
                        self.old_slip[b],
                        self.old_sticks[b],
                    )
            self.set_resistance(c)
        else:
            self.overflow[None] += 1

    @ti.func
    def penalty(self, g, h):
        """r [N s/m], by the mass of the smaller of grains g and h over the step, its drag and its yield force; ten
        times that where neither sees mortar."""
        a, d = ti.min(self.rigid.radius[g], self.rigid.radius[h]), ti.static(self.dimension)
        drag = 6.0 * np.pi * self.constants.eta[0] * (a if d == 3 else 1.0)
        held = YIELD_STIFFNESS * self.constants.tau_y[0] * (a * a if d == 3 else a)
        return ti.select(self.rigid.wet_members[g] + self.rigid.wet_members[h] == 0, DRY_STIFFNESS, 1.0) * (
            ti.min(self.rigid.mass[g], self.rigid.mass[h]) / self.step[None] + drag + held
        )

    def check(self) -> None:
        """Raise CapacityError where a contact of the step found no room."""
        if self.overflow[None]:
            raise CapacityError(f"a grain has more contacts than its list of {self.most} holds")

    # ---- at a contact ----------------------------------------------------------------------------------------------
    @ti.func
    def arm(self, g, c):
        """Arm from the centre of grain g to its contact c, half-way between both surfaces or on the wall [m]."""
        partner = self.partner[c]
        gap = self.gap[c] if partner < 0 else 0.5 * self.gap[c]
        s = g * self.parts + (partner if partner >= 0 else -1 - partner) % self.parts
        return self.rigid.from_centre(s, -(self.rigid.sphere_radius[s] + gap) * self.normal[c])

    @ti.func
    def other(self, g, c):
        """Number of the grain that contact c of grain g is with, g itself where it is one with a wall."""
        return g if self.partner[c] < 0 else self.partner[c] // self.parts**2

    @ti.func
    def wall(self, c):
        """Number of the wall of contact c, below 0 where it is one with a grain."""
        return (-1 - self.partner[c]) // self.parts

    @ti.func
    def relative_velocity(self, g, c):
        """Velocity of grain g relative to the other at contact c, a wall at rest, by the motions that P found [m/s]."""
        v = self.rigid.mean[g] + self.rigid.rate[g].cross(self.arm(g, c))
        if self.partner[c] >= 0:
            s = self.partner[c] // self.parts
            h = s // self.parts
            arm = self.rigid.from_centre(s, (self.rigid.sphere_radius[s] + 0.5 * self.gap[c]) * self.normal[c])
            v -= self.rigid.mean[h] + self.rigid.rate[h].cross(arm)
        return v

    @ti.func
    def set_resistance(self, c):
        """Matrix of contact c: of all of a velocity where it sticks, of the part along its force where it slips."""
        p = self.force[c] / ti.max(self.force[c].norm(), 1e-30)
        I, slips = ti.Matrix.identity(ti.f64, 3), 1 - self.sticks[c]  # noqa: E741
        self.resistance[c] = self.stiffness[c] * (self.sticks[c] * I + slips * p.outer_product(p))

    @ti.func
    def opening(self, c, slip):
        """gap/dt, by which a contact may close, and what its cone is shifted by at a speed of slip [m/s]."""
        return ti.max(0.0, self.gap[c]) / self.step[None] + self.coefficient(c) * slip

    # ---- in the system ---------------------------------------------------------------------------------------------
    @stage("contacts")
    def constrain(self, u: ti.template(), y: ti.template()):
        """y <- P y plus what the rotation of the solid and the contacts add, for the velocity u = P u [N]."""
        self.rigid.find_motions(u)
        for g in range(first(self.rigid.count), last(self.rigid.count)):
            force, torque = self.rigid.sums(g, y)
            torque += self.rigid.beyond_points(g, self.step[None]) @ self.rigid.rate[g]
            for c in range(g * self.most, g * self.most + self.number[g]):
                f = self.resistance[c] @ self.relative_velocity(g, c)
                force += f
                torque += self.arm(g, c).cross(f)
            self.rigid.distribute(g, force, torque, y)
        wait()

    @stage("contacts")
    def load(self, b: ti.template()):
        """b <- P b plus the known part of what the contacts and the rotation of the solid add [N]."""
        for g in range(self.rigid.count):
            force, torque = self.rigid.sums(g, b)
            torque += self.rigid.beyond_points(g, self.step[None]) @ self.rigid.spin[g]
            for c in range(g * self.most, g * self.most + self.number[g]):
                known = self.wall_velocity[c] - self.opening(c, self.slip[c]) * self.normal[c]
                f = self.resistance[c] @ known + self.force[c]
                force += f
                torque += self.arm(g, c).cross(f)
            self.rigid.distribute(g, force, torque, b)

    @stage("contacts")
    def update(self, u: ti.template()):
        """Forces of the contacts from the velocity u, mapped back onto Coulomb's cone, and their slip (G5)."""
        self.rigid.find_motions(u)
        for g in range(self.rigid.count):
            for c in range(g * self.most, g * self.most + self.number[g]):
                n, mu = self.normal[c], self.coefficient(c)
                v = self.relative_velocity(g, c) - self.wall_velocity[c]
                slip = self.slip[c] if self.force[c].norm() > 0.0 else (v - n.dot(v) * n).norm()
                trial = self.force[c] - self.stiffness[c] * (v + self.opening(c, slip) * n)
                force = n.dot(trial)
                t = trial - force * n
                size, slips = t.norm(), mu == 0.0 or t.norm() > mu * force
                # a slip that turns round sticks first: its force would flip from solve to solve
                turns = slips and mu > 0.0 and self.sticks[c] == 0 and force > 0.0 and t.dot(self.force[c]) < 0.0
                self.sticks[c] = ti.cast(turns or not slips, ti.i32)
                if slips:  # to the nearest force of the cone
                    force = ti.max(0.0, (force + mu * size) / (1.0 + mu * mu))
                    t *= 0.0 if turns else mu * force / ti.max(size, 1e-30)
                slip += (1.0 + mu * mu) * (-v.dot(t) / ti.max(t.norm(), 1e-30) - slip)
                self.slip[c], self.force[c] = (1 - self.sticks[c]) * ti.max(0.0, slip), force * n + t
                self.last_resistance[c] = self.resistance[c]
                self.set_resistance(c)

    @stage("contacts")
    def change_residual(self, u: ti.template(), r: ti.template()):
        """r <- r - (A - A') u, A' the matrix before the last update, for u = P u and r = P r [N]."""
        self.rigid.find_motions(u)
        for g in range(self.rigid.count):
            force, torque = self.rigid.sums(g, r)
            for c in range(g * self.most, g * self.most + self.number[g]):
                f = (self.resistance[c] - self.last_resistance[c]) @ self.relative_velocity(g, c)
                force -= f
                torque -= self.arm(g, c).cross(f)
            self.rigid.distribute(g, force, torque, r)

    @stage("contacts")
    def end_step(self):
        """At the end of a step, before grains keep their motions: move them apart by a part of their overlaps, and keep
        of their forces the part that other forces than inertia need."""
        for g in range(self.rigid.count):
            inertia = self.rigid.mass[g] / self.step[None] * (self.rigid.mean[g] - self.rigid.velocity[g])
            others = inertia
            for c in range(g * self.most, g * self.most + self.number[g]):
                others -= self.force[c]
                self.rigid.centre[g] += BACK * ti.max(0.0, -self.gap[c] - MAX_OVERLAP * self.spacing) * self.normal[c]
            self.force_fraction[g] = ti.min(1.0, others.norm() / ti.max(inertia.norm(), 1e-30))
        for g in range(self.rigid.count):
            for c in range(g * self.most, g * self.most + self.number[g]):
                self.force[c] *= ti.min(self.force_fraction[g], self.force_fraction[self.other(g, c)])

    @ti.func
    def coefficient(self, c):
        """Coefficient of friction of contact c: none with a wall with slip [-]."""
        mu = ti.cast(self.friction, ti.f64)
        for k, wall in ti.static(enumerate(self.walls.surfaces)):
            if ti.static(wall.slip):  # noqa: SIM102  (a compiled choice stays apart)
                if self.wall(c) == k:
                    mu = 0.0
        return mu

    @stage("wall loads")
    def add_loads(self, loads: ti.template()):
        """Add the forces of the contacts to the loads of the walls, in the first row of each grain."""
        for g in range(self.rigid.count):
            i = self.rigid.row[self.rigid.begin[g]]
            for c in range(g * self.most, g * self.most + self.number[g]):
                for j, number in ti.static(enumerate(loads.numbers)):
                    if self.wall(c) == number:
                        point = self.rigid.in_scene(self.rigid.centre[g] + self.arm(g, c))
                        on_wall = -ti.cast(self.rigid.in_scene(self.force[c]), float)
                        arm = ti.cast(self.walls.surfaces[number].arm(point), float)
                        loads.forces[j][i] += on_wall
                        loads.torques[j][i] += loads.axial_vector(arm.outer_product(on_wall))

    # ---- in the preconditioner -------------------------------------------------------------------------------------
    @ti.func
    def add_block(self, g, A, arm):
        """Add a resistance A [kg/s] of grain g at an arm to its sums, which the mobilities are the inverses of."""
        Y = ti.Matrix([[0.0, -arm[2], arm[1]], [arm[2], 0.0, -arm[0]], [-arm[1], arm[0], 0.0]], dt=ti.f64)
        self.translation_mobility[g] += A
        self.rotation_mobility[g] += Y.transpose() @ A @ Y

    @stage("system")
    def set_mobilities(self, inverse_diagonal: ti.template()):
        """Invert what resists the motion of each grain: the sum of the diagonal blocks of its particles and of its
        contacts."""
        I = ti.Matrix.identity(ti.f64, 3)  # noqa: E741
        for g in range(self.rigid.count):
            self.translation_mobility[g], self.rotation_mobility[g] = (
                0.0 * I,
                self.rigid.beyond_points(g, self.step[None]),
            )
            for m in range(self.rigid.begin[g], self.rigid.end[g]):
                D, A = inverse_diagonal[self.rigid.row[m]].inverse(), 0.0 * I
                for a, b in ti.static(ti.ndrange(self.dimension, self.dimension)):
                    A[a, b] = D[a, b]
                self.add_block(g, A, self.rigid.arm[m])
            for c in range(g * self.most, g * self.most + self.number[g]):
                self.add_block(g, self.resistance[c], self.arm(g, c))
            for block in ti.static((self.translation_mobility, self.rotation_mobility)):
                block[g] = (block[g] + 1e-12 * block[g].trace() * I).inverse()

    @stage("contacts")
    def precondition(self, inverse_diagonal: ti.template(), r: ti.template(), z: ti.template()):
        """z <- P (z - D^-1 r) + B P r on the rows of grains: z = M^-1 r, the diagonal blocks D of particles, the
        mobilities B of grains."""
        for g in range(first(self.rigid.count), last(self.rigid.count)):
            for m in range(self.rigid.begin[g], self.rigid.end[g]):
                z[self.rigid.row[m]] -= inverse_diagonal[self.rigid.row[m]] @ r[self.rigid.row[m]]
            total, moment = self.rigid.sums(g, z)
            force, torque = self.rigid.sums(g, r)
            mean = total / self.rigid.size(g) + self.translation_mobility[g] @ force
            self.rigid.move(g, mean, self.rigid.inverse[g] @ moment + self.rotation_mobility[g] @ torque, z)
        wait()

    # ---- in checkpoints --------------------------------------------------------------------------------------------
    def state(self) -> dict:
        """Places, motions and contacts of the grains."""
        return self.rigid.motions.read(self.rigid.count) | self.field_io.read(self.rigid.count * self.most)

    def load_state(self, state: dict) -> None:
        """Load what ``state`` returned."""
        self.rigid.motions.load(state, self.rigid.count)
        self.rigid.find_present(state["slot"])
        self.field_io.load(state, self.rigid.count * self.most)
