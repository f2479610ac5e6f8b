"""Walls that act on the fluid without wall particles.

Behind a wall the lattice of particles goes on as ghosts; a particle at distance z gets tabulated sums over them
(particles/kernels.py). Ghost velocities mirror the fluid's, for no-slip u_g = -u(mirror point) with the latter
from the particle's own velocity and gradient; the wall then adds to the least-squares fit of particle i

    N_i += (u_i - u_wall) (x) n c(z),   M_i += c(z) z n (x) n + t(z) (I - n (x) n),   c = 2 sum (w/r^2)(z + d)

which is exact for a velocity that grows linearly from the wall and keeps a lattice at the wall in equilibrium. Behind
a curved wall the ghosts stand on arcs, which changes the sums in proportion to its curvature. All wall terms are local
to one particle and exactly adjoint to its gradient.

A mirror plane is a slip wall whose ghosts end at the planes it meets: what lies behind both are ghosts of the other.
"""

from ..particles.kernels import PACKING, mps_weight
from ..particles.particles import Carried
from ..runtime.backend import real, ti
from .friction import FrictionalSlip
from .ghosts import COUNT_SUMS, GhostSums, face_pairs, perpendicular_walls
from .positions import WallPositions


def carried(walls) -> dict[str, Carried]:
    """Fields that particles carry for these walls: slip and traction for each wall with friction, and for each
    unilateral wall whether the particle is released from it."""
    fields = {}
    for k, law in enumerate(wall.friction for wall in walls if wall.friction):
        fields[f"slip_{k}"] = Carried("velocity on the wall beneath", "m/s", "vector")
        if law.yield_value > 0.0:
            fields[f"traction_{k}"] = Carried("yield part of the wall's traction", "Pa", "vector")
    for k in range(sum(wall.loose for wall in walls)):
        fields[f"released_{k}"] = Carried("1 where a unilateral wall has let go", "-")
    return fields


@ti.data_oriented
class Walls(WallPositions):
    """Contributions of all walls to a particle: every function sums over the walls within the effective radius of x
    [m].

    ``ratio`` is the cross-section of the particle at x over l0^2, 1 except for rings (gradient.py), whose ghosts stand
    at the spacing of the rings."""

    def __init__(
        self,
        walls,
        dimension: int,
        spacing: float,
        effective_radius: float,
        capacity: int = 1,
        rings: bool = False,
        particles=None,
        slope: float = 0.0,
        weight=mps_weight,
        packing_kernel=PACKING,
    ):
        super().__init__(walls, dimension, spacing, effective_radius, capacity)
        rough = [(wall, surface) for wall, surface in zip(walls, self.surfaces, strict=True) if wall.friction]
        for k, (wall, surface) in enumerate(rough):
            fields = particles.carried[f"slip_{k}"], particles.carried.get(f"traction_{k}")
            surface.friction = FrictionalSlip(wall.friction, *fields, spacing, slope)
        self.have_friction = bool(rough)
        for k, surface in enumerate(surface for surface in self.surfaces if surface.unilateral and particles):
            surface.releases, surface.particles = True, particles
            surface.released = particles.carried[f"released_{k}"]
        each = [(k, slot) for k, surface in enumerate(self.surfaces) for slot in range(surface.faces)]
        self.slots, self.surface_of = tuple(slot for _, slot in each), tuple(k for k, _ in each)
        self.faces = tuple(  # the slip that a particle carries belongs to one face
            self.surfaces[k].frictionless() if slot and self.surfaces[k].has_friction else self.surfaces[k]
            for k, slot in each
        )
        # for rings the axis is no mirror to the other walls: the circle there has no length
        mirrors = [getattr(wall, "mirror", False) and not (rings and abs(wall.normal[0]) > 0.5) for wall in walls]
        for k, others in enumerate(perpendicular_walls(walls)):
            self.surfaces[k].cut_by = tuple((self.surfaces[m], m < k, mirrors[m] or mirrors[k]) for m in others)
        corners = any(surface.cut_by for surface in self.surfaces)
        meet = face_pairs(walls, [k for k, _ in each], mirrors)
        kernels = {"weight": weight, "packing_kernel": packing_kernel}
        self.ghosts = GhostSums(dimension, spacing, effective_radius, kernels, rings, corners, meet, capacity)
        if self.surfaces:
            # coefficient of each face in the gradient of each particle [1/m]
            self.c = ti.field(real(), (capacity, len(self.faces)))
        self.carry_curvature = not rings and any(surface.no_slip for surface in self.surfaces)
        if self.carry_curvature:
            # l0/4 of the curvature of the velocity at each particle [1/s]
            self.velocity_curvature = ti.Vector.field(dimension, real(), capacity)
            self.curvature_known = ti.field(ti.i32, ())  # 1 if that is known, in a full vessel

    def select_faces(self, face=None, kind=None):
        """Pairs (number, surface) of one face or of all; with a ``kind`` only where that attribute is true."""
        return [
            (f, wall)
            for f, wall in enumerate(self.faces)
            if face in (None, f) and (kind is None or getattr(wall, kind))
        ]

    def set_friction_penalty(self, inertia: float) -> None:
        """Set the penalty of the walls' friction for a step of rho/dt = ``inertia`` [kg/(m3 s)]."""
        for _, wall in self.select_faces(None, "has_friction"):
            wall.friction.penalty[None] = inertia * wall.friction.depth * wall.friction.yields

    @ti.func
    def moments(self, i, x, ratio):
        """Contributions of the walls to neighbours, n and packing [-], to the moment matrix [-] and to sum w e [-] of
        particle i at x, e the direction to each ghost. Stores the coefficient c of each face, and the faces of solids
        in front of which it stands."""
        for wall in ti.static(self.surfaces):
            wall.find_faces(i, x)
            if ti.static(wall.releases):
                wall.update_release(i, x)
        if ti.static(self.ghosts.has_wedges):
            for f, wall in ti.static(enumerate(self.faces)):
                z, n, _velocity, _curvature = wall.face(i, x, self.slots[f])
                self.ghosts.store_face(i, f, z, n, wall.weight(i, x, z))
            self.ghosts.divide_corners(i)
        counts = ti.Vector.zero(float, 3)
        surface_normal = ti.Vector.zero(float, self.dimension)
        moment = ti.Matrix.zero(float, self.dimension, self.dimension)
        for f, wall in ti.static(enumerate(self.faces)):
            self.c[i, f] = 0.0
            z, n, _velocity, curvature = wall.face(i, x, self.slots[f])
            if z < self.effective_radius:
                for k, name in ti.static(enumerate(COUNT_SUMS)):
                    counts[k] += self.ghosts.lookup(name, i, wall, f, x, z, curvature, ratio)
                surface_normal -= n * self.ghosts.lookup("inward", i, wall, f, x, z, curvature, ratio)
                normal = n.outer_product(n)
                self.c[i, f] = self.ghosts.lookup("gradient", i, wall, f, x, z, curvature, ratio)
                moment += self.c[i, f] * ti.max(z, self.closest) * normal
                if ti.static(not wall.slip):
                    if ti.static(wall.has_friction):
                        wall.friction.set_sheared_fraction(i, ti.max(z, self.closest))
                    t = self.tangential(i, wall, f, x, z, curvature, ratio)
                    moment += t * (ti.Matrix.identity(float, self.dimension) - normal)
        return counts, moment, surface_normal

    @ti.func
    def tangential(self, i, wall: ti.template(), f: ti.template(), x, z, curvature, ratio):
        """Moment t(z) [-] along the wall of face f at x, smaller where the fluid slips on it."""
        t = self.ghosts.lookup("tangential", i, wall, f, x, z, curvature, ratio)
        if ti.static(wall.has_friction):
            t *= wall.friction.sheared_fraction[i]
        return t

    @ti.func
    def velocity_in_fit(self, i, wall: ti.template(), n, v, wall_motion):
        """Part of a velocity v relative to the wall that enters the fit; ``wall_motion`` 1 adds the part of the slip
        that does not depend on v. With 0 it is symmetric: the same part of a force acts on the particle."""
        seen = v
        if ti.static(wall.slip):
            seen = n * n.dot(v)
        if ti.static(wall.has_friction):
            seen = wall.friction.velocity_in_fit(i, n, v) - wall_motion * wall.friction.offset[i]
        return seen

    @ti.func
    def gradient_term(self, i, x, u, wall_motion, ratio):
        """sum of (u - u_wall) (x) n c [1/s 1/m], and t S (I - n (x) n) where the wall turns with the gradient S;
        ``wall_motion`` 1 with the walls' velocity, 0 without."""
        total = ti.Matrix.zero(float, self.dimension, self.dimension)
        for f, wall in ti.static(enumerate(self.faces)):
            if self.c[i, f] > 0.0:
                z, n, velocity, curvature = wall.face(i, x, self.slots[f])
                difference = self.velocity_in_fit(i, wall, n, u - wall_motion * velocity, wall_motion)
                total += difference.outer_product(n) * self.c[i, f]
                if ti.static(wall.rotates and not wall.slip):
                    spin = ti.cast(wall.spin, float)
                    t = self.tangential(i, wall, f, x, z, curvature, ratio)
                    total += wall_motion * t * (spin - (spin @ n).outer_product(n))
        return total

    @ti.func
    def curvature_term(self, i, x, face: ti.template() = None):
        """Contributions of the ghosts of no-slip walls to gradient_term and drag_term where the velocity is curved
        along the wall [m/s 1/m]: ghosts continue the curvature of the fluid, z ``velocity_curvature`` less than the
        mirrored velocity."""
        total = ti.Matrix.zero(float, self.dimension, self.dimension)
        drag = ti.Vector.zero(float, self.dimension)
        if ti.static(self.carry_curvature):
            for f, wall in ti.static(self.select_faces(face, "no_slip")):
                if self.curvature_known[None] == 1 and self.c[i, f] > 0.0:
                    z, n, _velocity, _curvature = wall.face(i, x, self.slots[f])
                    along = self.c[i, f] * (self.velocity_curvature[i] - n * n.dot(self.velocity_curvature[i]))
                    total -= ti.max(z, self.closest) * along.outer_product(n)
                    drag += along
        return total, drag

    @ti.func
    def force_term(self, i, x, flux, face: ti.template() = None):
        """Force of the walls on a particle with flux matrix P = V T B: the exact adjoint of gradient_term."""
        total = ti.Vector.zero(float, self.dimension)
        for f, wall in ti.static(self.select_faces(face)):
            if self.c[i, f] > 0.0:
                _z, n, _velocity, _curvature = wall.face(i, x, self.slots[f])
                total -= self.velocity_in_fit(i, wall, n, flux @ n, 0.0) * self.c[i, f]
        return total

    @ti.func
    def drag_term(self, i, x, u, wall_motion, face: ti.template() = None):
        """Sum of (u - u_wall) c/z, the walls' part of the resistance to hourglass modes (momentum.py); and its power,
        sum of |u - u_wall|^2 c/z [1/s2]."""
        total, power = ti.Vector.zero(float, self.dimension), ti.cast(0.0, float)
        for f, wall in ti.static(self.select_faces(face)):
            if self.c[i, f] > 0.0:
                z, n, velocity, _curvature = wall.face(i, x, self.slots[f])
                difference = self.velocity_in_fit(i, wall, n, u - wall_motion * velocity, wall_motion)
                weight = self.c[i, f] / ti.max(z, self.closest)
                power += difference.norm_sqr() * weight
                if ti.static(wall.has_friction):
                    difference = self.velocity_in_fit(i, wall, n, difference, 0.0)
                total += difference * weight
        return total, power

    @ti.func
    def friction_term(self, i, x, u, wall_motion, face: ti.template() = None):
        """Force [N] of the walls' friction against a particle, besides force_term."""
        total = ti.Vector.zero(float, self.dimension)
        for f, wall in ti.static(self.select_faces(face, "has_friction")):
            if self.c[i, f] > 0.0:
                _z, n, velocity, _curvature = wall.face(i, x, self.slots[f])
                total += wall.friction.drag(i, n, u - wall_motion * velocity, wall_motion)
        return total

    @ti.func
    def set_initial_slip(self, i, x, u, B, volume, mu, ratio):
        """Set the slip of particle i, of viscosity mu [Pa s], on walls with friction before the iterations of a
        step."""
        for f, wall in ti.static(self.select_faces(None, "has_friction")):
            if self.c[i, f] > 0.0:
                z, n, velocity, _curvature = wall.face(i, x, self.slots[f])
                acts = wall.weight(i, x, z)
                cBn = self.c[i, f] * (B @ n)
                wall.friction.set_area(
                    i, n, ti.max(z, self.closest), volume, cBn, ratio, acts, self.ghosts.second_row_fraction
                )
                wall.friction.set_initial_slip(i, n, u - velocity, mu)
            else:
                wall.friction.clear(i)

    @ti.func
    def update_slip(self, i, x, u, flux, weight, B, mu, h, ratio):
        """Update the slip of particle i after an iteration, so that the walls' friction balances all that they give to
        it: by its flux V T B - h G, by drag_term times h, and by the ghosts' pressure in excess of its own under its
        ``weight`` [N]."""
        for f, wall in ti.static(self.select_faces(None, "has_friction")):
            if self.c[i, f] > 0.0:
                z, n, velocity, curvature = wall.face(i, x, self.slots[f])
                deeper = n.dot(weight) * self.ghosts.lookup("normal", i, wall, f, x, z, curvature, ratio)
                stiff = h * self.c[i, f] / ti.max(z, self.closest)
                force = flux @ n * self.c[i, f] + B @ n * deeper
                force += stiff * self.velocity_in_fit(i, wall, n, u - velocity, 1.0)
                area = wall.friction.area[i]
                wall.friction.map_traction(i, n, u - velocity, force / area, stiff / area, mu)

    @ti.func
    def coefficients(self, i, x, B, shear, bulk):
        """Sums over the walls of n c [1/m] and of c/z [1/m2], for the diagonal; and the block [kg/s] by which they
        resist a velocity of particle i through the gradient that they add, with V mu = ``shear`` and
        V (mu + K - 2 mu/t) = ``bulk`` [Pa s m3]."""
        total, drag = ti.Vector.zero(float, self.dimension), ti.cast(0.0, float)
        block = ti.Matrix.zero(float, self.dimension, self.dimension)
        for f, wall in ti.static(enumerate(self.faces)):
            if self.c[i, f] > 0.0:
                z, n, _velocity, _curvature = wall.face(i, x, self.slots[f])
                total += n * self.c[i, f]
                drag += self.c[i, f] / ti.max(z, self.closest)
                v = B @ n * self.c[i, f]
                if ti.static(wall.slip):
                    block += (shear * v.dot(v) + bulk * n.dot(v) ** 2) * n.outer_product(n)
                else:
                    block += shear * v.dot(v) * ti.Matrix.identity(float, self.dimension) + bulk * v.outer_product(v)
        return total, drag, block

    @ti.func
    def hydrostatic(self, i, x, weight, B, ratio, face: ti.template() = None):
        """Force density [N/m3] by which the ghosts' pressure exceeds the particle's own under rho g = ``weight``."""
        total = ti.Vector.zero(float, self.dimension)
        for f, wall in ti.static(self.select_faces(face)):
            z, n, _velocity, curvature = wall.face(i, x, self.slots[f])
            if z < self.effective_radius:
                force = B @ n * (n.dot(weight) * self.ghosts.lookup("normal", i, wall, f, x, z, curvature, ratio))
                if ti.static(wall.has_friction):
                    force = self.velocity_in_fit(i, wall, n, force, 0.0)
                total -= force
        return total

    @ti.func
    def repulsion(self, i, x, ratio):
        """Sum of max(0, 1 - r/(1.5 l0)) e [-] over the ghosts, e the direction from x to each."""
        total = ti.Vector.zero(float, self.dimension)
        for f, wall in ti.static(enumerate(self.faces)):
            z, n, _velocity, curvature = wall.face(i, x, self.slots[f])
            if z < self.effective_radius:
                total -= n * self.ghosts.lookup("repulsion", i, wall, f, x, z, curvature, ratio)
        return total
