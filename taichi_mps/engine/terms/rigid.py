"""Grains: particles whose velocity is that of a rigid body (G1-G4).

The rigid motions are the unknowns. With the orthogonal projector P of velocities of a grain's N particles onto them,

    P u |_m = U + w x y_m,    U = (1/N) sum u_m,    w = J^-1 sum y_m x u_m,    J = sum (y.y I - y y),

y_m the arms from its centre, each solve for the velocity becomes P A P u = P b. P is symmetric because all particles of
a grain have one mass, so the same sums make its motion of velocities and its force and torque of forces. A solid's
moment of inertia is not that of its particles as points: the difference, times the rotation, is added. One that is no
sphere keeps its angular momentum while it turns freely, so its spin changes.

A grain is a clump of spheres, most often of one; each of its particles counts for the sphere to whose surface it is
nearest.

A particle of a grain that sees no mortar carries neither stress nor pressure: its gradient is taken out. At the surface
a gradient sees both sides, but all strain is that of the mortar, whose fraction along the normal is c. The mortar that
it sees lies farther from the grain than the particle, whose stress is wanted, and there the stress is less: by the law
of the mortar it is multiplied by what it falls around a sphere that turns, s = (r_m/r_i)^d, r_m and r_i the distances
of the middle of that mortar and of the particle from the centre of the sphere (G4).
"""

import numpy as np

from ..runtime.backend import double_field, real, ti
from ..runtime.field_io import FieldIO
from ..runtime.stages import stage
from ..runtime.thread_team import first, last, wait
from .constants import Term

# lowest fraction of mortar beside a grain, with a true yield stress and where it divides a viscosity [-]
MIN_MORTAR_FRACTION, MIN_VISCOUS_MORTAR_FRACTION = 0.02, 0.1


@ti.data_oriented
class Rigid(Term):
    """Grains of a scene: their places and motions, and the projector P."""

    def __init__(self, fluid, problem):
        super().__init__(fluid)
        number, _, radii, _ = problem.scene.grain_places
        self.spheres, self.inertia = problem.scene.grains.clump(self.dimension)
        self.parts, self.uneven = len(self.spheres), self.dimension == 3 and len(self.spheres) > 1  # inertia by axis
        self.count, self.members = len(radii), int((number > 0).sum())
        self.yields = problem.law == "yield-stress"
        self.begin, self.grain_of = ti.field(ti.i32, self.count + 1), ti.field(ti.i32, self.members)
        # behind the last member of each grain, its first if it is yet to enter; number of those that see mortar
        self.end, self.wet_members = ti.field(ti.i32, self.count), ti.field(ti.i32, self.count)
        # of each member, a particle of a grain, and the number of its sphere among those of all grains
        self.row, self.sphere_of = (ti.field(ti.i32, self.members) for _ in range(2))
        spheres = self.count * self.parts
        self.sphere_radius, self.sphere_offset = double_field(spheres), double_field(spheres, 3)  # in the grain [m]
        self.place, self.arm = (
            double_field(self.members, 3),
            double_field(self.members, 3),
        )  # in the grain, in space [m]
        self.centre, self.velocity, self.spin = (double_field(self.count, 3) for _ in range(3))  # [m, m/s, 1/s]
        self.rotation, self.inverse = (ti.Matrix.field(3, 3, ti.f64, self.count) for _ in range(2))  # R, J^-1 [1/m2]
        self.mean, self.rate = double_field(self.count, 3), double_field(self.count, 3)  # motion that P finds
        self.radius, self.mass = ti.field(ti.f64, self.count), ti.field(ti.f64, self.count)  # [m, kg]
        # in the grain, moment of inertia of the solid, and what it is beyond that of its particles as points [kg m2]
        self.solid, self.extra = (ti.Matrix.field(3, 3, ti.f64, self.count) for _ in range(2))
        # c and s of each particle [-]
        self.mortar_fraction, self.stress_ratio = (ti.field(real(), self.capacity) for _ in range(2))
        self.masked = ti.field(ti.i32, self.capacity)  # 1 of a particle of a grain that sees no mortar
        self.motions = FieldIO(
            {
                "grain_centre": self.centre,
                "grain_velocity": self.velocity,
                "grain_spin": self.spin,
                "grain_turn": self.rotation,
            },
            self.count,
        )
        self._place(problem.scene)

    def _place(self, scene) -> None:
        """Put the grains at their places at 0 s, at rest."""
        number, centres, radii, rotations = scene.grain_places
        d, start, size = self.dimension, scene.start, np.subtract(*scene.domain[::-1])
        x = np.vstack([scene.fluid, *(stream.x for stream in scene.streams)])
        members = np.argsort(number, kind="stable")[len(number) - self.members :]
        of = number[members] - 1
        arms = x[members] - centres[of]
        arms -= np.array(scene.periodic) * size * np.round(arms / size)
        places, middle, turn = (
            np.zeros((self.members, 3)),
            np.zeros((self.count, 3)),
            np.tile(np.eye(3), (self.count, 1, 1)),
        )
        places[:, :d], middle[:, :d], turn[:, :d, :d] = arms, centres, rotations
        u = np.zeros_like(x)
        u[: len(scene.fluid)] = 0.0 if scene.velocity is None else scene.velocity
        velocity, spin = self._motion(of, places, u[members])
        places = (places[:, None] @ turn[of])[:, 0]
        counts = np.bincount(of, minlength=self.count)
        mass = scene.grains.density * counts * scene.spacing**d
        moment = np.bincount(of, (arms**2).sum(1), self.count) * (2.0 / 3.0 if d == 3 else 1.0)
        solid = self.inertia * (mass * radii**2)[:, None, None]
        extra = np.eye(3) * (self.inertia[2, 2] * mass * radii**2 - mass / counts * moment)[:, None, None]
        if self.uneven:
            outer = places[:, :, None] * places[:, None]
            points = np.trace(outer, axis1=1, axis2=2)[:, None, None] * np.eye(3) - outer
            extra = solid - (mass / counts)[:, None, None] * np.add.reduceat(points, np.cumsum(counts) - counts)
        # spheres in the grain [m], and the one to whose surface each member is nearest
        offset = 2.0 * radii[:, None, None] * np.pad(self.spheres[:, :d], ((0, 0), (0, 3 - d)))
        radius = np.outer(2.0 * radii, self.spheres[:, d])
        nearest = (np.linalg.norm(places[:, None] - offset[of], axis=-1) - radius[of]).argmin(1)
        self.radii = radii
        self.of_members = np.append(0, of + 1).astype(np.int32)  # number of the grain by the slot, 0 of mortar
        for field, values in (
            (self.begin, np.append(0, np.cumsum(counts)).astype(np.int32)),
            (self.grain_of, of.astype(np.int32)),
            (self.sphere_of, (of * self.parts + nearest).astype(np.int32)),
            (self.sphere_radius, radius.ravel()),
            (self.sphere_offset, offset.reshape(-1, 3)),
            (self.place, places),
            (self.radius, radii),
            (self.mass, mass),
            (self.solid, solid),
            (self.extra, extra),
        ):
            field.from_numpy(values)
        self.motions.load(
            {"grain_centre": middle, "grain_turn": turn, "grain_velocity": velocity, "grain_spin": spin}, self.count
        )
        self.find_present(start["slot"])
        entered = slice(len(scene.fluid), None)
        self.enter(start["slot"][entered], start["x"][entered], start["u"][entered])

    def find_present(self, slot) -> None:
        """Find which grains are there, by the slots of all particles."""
        begin = self.begin.to_numpy()
        self.end.from_numpy(begin[np.arange(self.count) + np.isin(np.arange(self.count), self.of_members[slot] - 1)])

    def enter(self, slot, x, velocity) -> None:
        """Let in the grains of particles in these slots (m,) at x (m, d) [m], with velocities (m, d) [m/s]."""
        number, rows = np.unique(self.of_members[slot], return_index=True)
        number, rows = number[number > 0], rows[number > 0]
        if len(number) == 0:
            return
        state, d, g = self.motions.read(self.count), self.dimension, number - 1
        arms = (state["grain_turn"][g] @ self.place.to_numpy()[slot[rows] - 1, :, None])[:, :d, 0]
        state["grain_centre"][g, :d], state["grain_velocity"][g, :d] = x[rows] - arms, velocity[rows]
        self.motions.load(state, self.count)
        end = self.end.to_numpy()
        end[g] = self.begin.to_numpy()[number]
        self.end.from_numpy(end)

    def _motion(self, of, arms, u) -> tuple[np.ndarray, np.ndarray]:
        """Velocities [m/s] and spins [1/s], (n, 3), of the grains ``of`` the members with arms (m, 3) and velocities u
        (m, d)."""
        velocity, spin = np.zeros((self.count, 3)), np.zeros((self.count, 3))
        whole = np.pad(u, ((0, 0), (0, 3 - self.dimension)))
        for g in range(self.count):
            y, v = arms[of == g], whole[of == g]
            velocity[g] = v.mean(0)
            J = (y**2).sum() * np.eye(3) - y.T @ y
            spin[g] = np.linalg.solve(J, np.cross(y, v).sum(0))
        return velocity, spin

    # ---- in kernels ------------------------------------------------------------------------------------------------
    @ti.func
    def size(self, g):
        """Number of particles of grain g, 1 of one that is yet to enter."""
        return ti.max(1, self.end[g] - self.begin[g])

    @ti.func
    def in_scene(self, v):
        """The first d components of a vector."""
        w = ti.Vector.zero(ti.f64, self.dimension)
        for a in ti.static(range(self.dimension)):
            w[a] = v[a]
        return w

    @ti.func
    def grain(self, i):
        """Number of the grain of particle i, -1 of mortar."""
        return self.sphere(i) // self.parts

    @ti.func
    def sphere(self, i):
        """Number of the sphere of particle i among those of all grains, -1 of mortar."""
        slot, s = self.particles.slot[i], -1
        if slot > 0:
            s = self.sphere_of[slot - 1]
        return s

    @ti.func
    def from_centre(self, s, v):
        """A vector from the centre of sphere s as one from the centre of its grain [m]."""
        return v + self.rotation[s // self.parts] @ self.sphere_offset[s]

    @ti.func
    def sphere_centre(self, s):
        """Centre of sphere s [m]."""
        return self.from_centre(s, self.centre[s // self.parts])

    @ti.func
    def beyond_points(self, g, dt):
        """Moment of inertia of grain g in space beyond that of its particles as points, over dt [kg m2/s]."""
        return self.rotation[g] @ (self.extra[g] / dt) @ self.rotation[g].transpose()

    @ti.func
    def rotated(self, w):
        """Rotation exp([w]x) by an angle |w|."""
        angle = w.norm()
        K = ti.Matrix([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]], dt=ti.f64)
        s, c = ti.cast(1.0, ti.f64), ti.cast(0.5, ti.f64)
        if angle > 1e-9:
            s, c = ti.sin(angle) / angle, (1.0 - ti.cos(angle)) / (angle * angle)
        return ti.Matrix.identity(ti.f64, 3) + s * K + c * K @ K

    @ti.func
    def sums(self, g, v: ti.template()):
        """sum v_m and sum y_m x v_m of the rows of grain g: of forces, its force and torque."""
        total, moment = ti.Vector.zero(ti.f64, 3), ti.Vector.zero(ti.f64, 3)
        for m in range(self.begin[g], self.end[g]):
            w = self.three_components(v[self.row[m]])
            total += w
            moment += self.arm[m].cross(w)
        return total, moment

    @ti.func
    def distribute(self, g, total, moment, v: ti.template()):
        """Write P of rows whose sums are ``total`` and ``moment`` into the rows of grain g."""
        self.move(g, total / self.size(g), self.inverse[g] @ moment, v)

    @ti.func
    def move(self, g, mean, rate, v: ti.template()):
        """Write the rigid motion of grain g with these mean and rate of rotation into its rows."""
        for m in range(self.begin[g], self.end[g]):
            w = mean + rate.cross(self.arm[m])
            for a in ti.static(range(self.dimension)):
                v[self.row[m]][a] = ti.cast(w[a], float)

    @ti.func
    def find_motions(self, v: ti.template()):
        """Mean and rate of rotation of the velocity v of each grain."""
        for g in range(first(self.count), last(self.count)):
            total, moment = self.sums(g, v)
            self.mean[g] = total / self.size(g)
            self.rate[g] = self.inverse[g] @ moment
        wait()

    @ti.func
    def fall(self, sphere, i, offset):
        """By which factor the shear stress around a sphere falls from particle i to the place ``offset`` [m] from it,
        where a fluid carries the couple of a turning sphere outward: as 1/r^d."""
        centre, half = self.in_scene(self.sphere_centre(sphere)), 0.5 * self.gradient.spacing
        r = ti.cast(self.neighbors.bins.displacement(centre, self.particles.x[i]), float)
        return (ti.max(half, (r + offset).norm()) / ti.max(half, r.norm())) ** self.dimension

    # ---- stages ------------------------------------------------------------------------------------------------
    @stage("grains")
    def project(self, v: ti.template()):
        """v <- P v."""
        for g in range(first(self.count), last(self.count)):
            total, moment = self.sums(g, v)
            self.distribute(g, total, moment, v)
        wait()

    @stage("grains")
    def drift(self, time: float):
        """c <- c + time U and R <- exp(time w) R, exactly, and the particles at c + R Y with U + w x R Y (G3). Where I
        differs by axis w is that half-way by the angular momentum, and follows from it: w = (R I R^T)^-1 L."""
        for g in range(self.count):
            self.centre[g] += time * self.velocity[g]
            w = self.spin[g]
            if ti.static(self.uneven):
                R, slowness = self.rotation[g], self.solid[g].inverse()
                L = R @ (self.solid[g] @ (R.transpose() @ w))
                half = self.rotated(0.5 * time * w) @ R
                w = half @ (slowness @ (half.transpose() @ L))
                end = self.rotated(time * w) @ R
                self.spin[g] = end @ (slowness @ (end.transpose() @ L))
            self.rotation[g] = self.rotated(w * time) @ self.rotation[g]
        for m in range(self.members):
            self.arm[m] = self.rotation[self.grain_of[m]] @ self.place[m]
        for i in range(self.particles.count[None]):
            slot = self.particles.slot[i]
            if slot > 0:
                g, arm = self.grain_of[slot - 1], self.arm[slot - 1]
                self.particles.x[i] = self.in_scene(self.centre[g] + arm)
                self.particles.u[i] = ti.cast(self.in_scene(self.velocity[g] + self.spin[g].cross(arm)), float)

    @stage("grains")
    def find(self):
        """Rows and inertia of the grains, which particles are masked, and the fraction of mortar, once neighbours and
        fits are known; masked particles get no gradient."""
        for i in range(self.particles.count[None]):
            slot, own, masked = self.particles.slot[i], self.grain(i), ti.cast(self.particles.slot[i] > 0, ti.i32)
            if slot > 0:
                self.row[slot - 1] = i
            m, core, nearest = ti.Vector.zero(float, self.dimension), self.sphere(i), ti.cast(0.0, float)
            for k in range(self.neighbors.row_start[i], self.neighbors.row_start[i + 1]):
                other, weight = self.grain(self.neighbors.column[k]), self.gradient.weight_r2[k]
                if other != own and weight > 0.0:
                    m += self.gradient.b[k]
                    if own < 0 and weight > nearest:
                        core, nearest = self.sphere(self.neighbors.column[k]), weight
                if other < 0:
                    masked = 0
            self.masked[i], self.mortar_fraction[i], self.stress_ratio[i] = masked, 1.0, 1.0
            n = m / ti.max(m.norm(), 1e-20)
            v, of_others = self.gradient.B[i] @ n, ti.cast(0.0, float)
            middle = ti.Vector.zero(float, self.dimension)  # of the part of the others, times it [m]
            for k in range(self.neighbors.row_start[i], self.neighbors.row_start[i + 1]):
                other = self.grain(self.neighbors.column[k])
                if other != own and self.gradient.weight_r2[k] > 0.0:
                    b, between = self.gradient.b[k], own >= 0 and other >= 0  # two grains: all is mortar
                    part = v.dot(b) * n.dot(b) / self.gradient.weight_r2[k] * (1.0 if between else 0.5)
                    of_others += part
                    middle += part * (0.5 if between else 0.75) * b / self.gradient.weight_r2[k]
            if masked == 0 and of_others > 0.0:
                fraction = of_others if own >= 0 else 1.0 - of_others
                lowest = ti.static(MIN_MORTAR_FRACTION if self.yields else MIN_VISCOUS_MORTAR_FRACTION)
                # of the mortar that i sees
                centre = middle / ti.max(MIN_MORTAR_FRACTION, fraction) * (1.0 if own >= 0 else -1.0)
                self.stress_ratio[i] = self.fall(core, i, centre)
                self.mortar_fraction[i] = ti.max(lowest, ti.min(1.0, fraction))
        for i in range(self.particles.count[None]):
            if self.masked[i] == 1:
                self.gradient.B[i] *= 0.0
        for g in range(self.count):
            J = ti.Matrix.zero(ti.f64, 3, 3)
            self.wet_members[g] = 0
            for m in range(self.begin[g], self.end[g]):
                self.wet_members[g] += 1 - self.masked[self.row[m]]
                y = self.arm[m]
                J += y.dot(y) * ti.Matrix.identity(ti.f64, 3) - y.outer_product(y)
            if self.end[g] > self.begin[g]:  # of another all sums are zero
                self.inverse[g] = (J + 1e-12 * J.trace() * ti.Matrix.identity(ti.f64, 3)).inverse()
            for a in ti.static(range(self.dimension)):
                if ti.static(self.neighbors.bins.periodic[a]):
                    low, size = self.neighbors.bins.low[a], self.neighbors.bins.size[a]
                    self.centre[g][a] -= size * ti.floor((self.centre[g][a] - low) / size)

    @stage("grains")
    def keep(self, u: ti.template()):
        """Take the motion of each grain from the velocity u of the end of a step."""
        self.find_motions(u)
        for g in range(self.count):
            self.velocity[g], self.spin[g] = self.mean[g], self.rate[g]
