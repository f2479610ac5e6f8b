"""Inner objects with given particles: the only place where tests assemble particles, lists, walls and systems."""

import numpy as np

import taichi_mps as mps
from taichi_mps.engine.boundaries import walls as boundaries
from taichi_mps.engine.particles.gradient import Gradient
from taichi_mps.engine.particles.kernels import lattice_sums, mps_weight
from taichi_mps.engine.particles.neighbors import Bins, NeighborList
from taichi_mps.engine.particles.pair_sums import PairSums
from taichi_mps.engine.particles.particles import FLUID, Carried, Particles
from taichi_mps.engine.runtime.backend import ti
from taichi_mps.engine.terms.hourglass import DeferredCorrection
from taichi_mps.engine.terms.momentum import MomentumOperator
from taichi_mps.engine.terms.rheology import deviator
from taichi_mps.engine.terms.strain_rate import StrainRate

L0 = 0.1  # spacing [m]
RE = 2.1 * L0  # effective radius [m]
MASS_RATE, BULK = 40.0, 3000.0  # of a System: mass over time step [kg/s], bulk modulus [Pa s]


def cloud(shape, seed=2):
    """A jittered lattice around the origin, [m]."""
    half = 0.5 * L0 * np.array(shape)
    x = mps.lattice(-half, half, L0)
    return x + np.random.default_rng(seed).uniform(-0.25, 0.25, x.shape) * L0


# ---- particles, lists, walls and fits ---------------------------------------------------------------------------
def particles(x, kinds=None, volumes=None, rings=False, **carried):
    """Particles at x (n, d) [m]: fluid of 1 m3 each unless said otherwise; ``carried``: shapes of further fields."""
    kinds = np.full(len(x), FLUID) if kinds is None else kinds
    volumes = np.ones(len(x)) if volumes is None else volumes
    fields = {name: Carried(name, "-", shape) for name, shape in carried.items()}
    return Particles({"x": np.asarray(x, float), "kind": kinds}, volumes, fields, rings)


def lists(of, domain, periodic=None, pairs=60, radius=RE):
    """Neighbour list, not searched yet, of particles in a domain (low, high) [m]: room for ``pairs`` of each."""
    periodic = (False,) * len(domain[0]) if periodic is None else periodic
    return NeighborList(Bins(of, domain, periodic, radius), pairs * of.capacity)


def walls(planes, dimension, capacity=1, of=None, rings=False, weight=mps_weight):
    """What particles at the spacing L0 see of walls; with friction or unilateral ones of these particles."""
    return boundaries.Walls(planes, dimension, L0, RE, capacity, rings=rings, particles=of, weight=weight)


@ti.data_oriented
class Probe:
    """What kernels see of walls at points x (n, d) [m] and a time [s]: of the first wall its distance, normal,
    velocity, curvature and weight, of all of them where a ``move`` [m] ends."""

    def __init__(self, planes, x, move=0.0, time=0.0):
        n, d = x.shape
        self.walls = walls(planes, d)
        self.walls.place(time)
        self.first = self.walls.surfaces[0]
        self.x, self.move, self.normal, self.velocity, self.end = (ti.Vector.field(d, ti.f64, n) for _ in range(5))
        self.z, self.curvature, self.weight = (ti.field(ti.f64, n) for _ in range(3))
        self.x.from_numpy(x)
        self.move.from_numpy(np.broadcast_to(move, x.shape).copy())
        self._look()

    @ti.kernel
    def _look(self):
        for i in self.x:
            self.z[i], self.normal[i], self.velocity[i], self.curvature[i] = self.first.nearest(self.x[i])
            self.weight[i] = self.first.weight(i, self.x[i], 0.0)
            self.end[i] = self.walls.keep_in_fluid(self.x[i], self.move[i])


@ti.data_oriented
class Rig:
    """Particles at given places with all that is found of them before a step (lists, walls, fits), and kernels for the
    gradient of ``u`` and the force of the stresses ``T``."""

    def __init__(self, x, kinds=None, planes=(), rings=None, weight=mps_weight, domain=None, periodic=None):
        """x (n, d) [m] at the spacing L0; ``rings``: their volumes [m3] in an axisymmetric scene."""
        d = x.shape[1]
        t = d if rings is None else 3
        self.dimension, self.volume, self.planes = d, L0**d, planes
        volumes = np.full(len(x), L0**d) if rings is None else rings
        carried = {name: field.shape for name, field in boundaries.carried(planes).items()}
        self.particles = particles(x, kinds, volumes, rings is not None, **carried)
        self.neighbors = lists(self.particles, domain or ((-2.0,) * d, (2.0,) * d), periodic)
        self.walls = walls(planes, d, len(x), self.particles, rings is not None, weight)
        self.lattice = lattice_sums(d, L0, RE, weight)
        self.gradient = Gradient(self.neighbors, self.walls, self.lattice, L0)
        self.neighbors.search()
        self.gradient.build()
        self.u, self.F = (ti.Vector.field(d, ti.f64, len(x)) for _ in range(2))
        self.left = ti.field(ti.f64, len(x))
        self.G, self.T = (ti.Matrix.field(t, t, ti.f64, len(x)) for _ in range(2))
        self.sums = PairSums(self.particles, self.gradient, self.walls)
        rows = self.particles.read()
        self.x, self.kind, self.volumes = rows["x"], rows["kind"], volumes[rows["id"]]
        r = self.x[None] - self.x[:, None]
        size = np.linalg.norm(r, axis=-1) + 9.0 * np.eye(len(x))
        self.weight_r2 = weight(np.minimum(1.0, size / RE)) / size**2
        moment = np.einsum("ij,ija,ijb->iab", self.weight_r2, r, r)
        self.healthy = np.linalg.det(moment) > 0.05 * (self.lattice.n0 / d) ** d  # not nearly flat: not stiffened
        self.healthy &= self.gradient.B.to_numpy()[:, 0, 0] > 0.0

    @ti.kernel
    def _gradients(self, motion: ti.f64):
        for i in range(self.particles.count[None]):
            self.G[i] = self.gradient.velocity_gradient(i, self.u, motion)

    @ti.kernel
    def _fits(self):
        for i in range(self.particles.count[None]):
            self.G[i], self.left[i] = self.gradient.fit(i, self.u, 0.0)

    @ti.kernel
    def _forces(self):
        for i in range(self.particles.count[None]):
            self.sums.set_flux(i, self.gradient.stress_flux(i, self.T[i]))
        for i in range(self.particles.count[None]):
            self.sums.gather_fluxes(i)
        for i in range(self.particles.count[None]):
            self.F[i] = self.sums.force(i)

    def gradients(self, u, wall_motion=0.0):
        """Velocity gradients (n, t, t) [1/s] of u (n, d); ``wall_motion`` 1 with the walls' own velocity."""
        self.u.from_numpy(np.ascontiguousarray(u))
        self._gradients(wall_motion)
        return self.G.to_numpy()

    def fits(self, u):
        """The same, and what the linear fit leaves of u (n,) [1/s2]."""
        self.u.from_numpy(np.ascontiguousarray(u))
        self._fits()
        return self.G.to_numpy(), self.left.to_numpy()

    def forces(self, T):
        """Forces (n, d) [N] of the stresses T (n, t, t) [Pa]."""
        self.T.from_numpy(T)
        self._forces()
        return self.F.to_numpy()

    def imbalance(self, u, T):
        """Power of the forces of the stresses T at the velocity u, plus what the stresses do at its gradient, over the
        power of each particle [-]: 0 where force is the negative transpose of the gradient."""
        power, carries = u * self.forces(T), self.gradient.B.to_numpy()[:, 0, 0] > 0.0
        work = ((self.volumes * carries)[:, None, None] * T * self.gradients(u)).sum()
        assert abs(work) > 1e-6
        return abs(power.sum() + work) / np.abs(power).sum()


# ---- the implicit system ----------------------------------------------------------------------------------------
@ti.data_oriented
class Numbers:
    """What the system asks of the other terms, as given numbers: viscosities, resistances, K and a density."""

    def __init__(self, capacity, density):
        self.density = density
        self.mu, self.h = ti.field(ti.f64, capacity), ti.field(ti.f64, capacity)  # [Pa s], [N s m]
        self.bulk, self.natural_step = ti.field(ti.f64, ()), ti.field(ti.f64, ())  # [Pa s], [s]

    @ti.func
    def density_of(self, i):
        return ti.cast(self.density, float)

    @ti.func
    def viscous(self, i, G):
        return 2.0 * self.mu[i] * deviator(G)


@ti.data_oriented
class System(Rig):
    """A cloud of particles with random viscosities, and the matrix of its momentum system for a step of 1 s; without
    ``inertia`` and stress only the hourglass resistance is left of it."""

    def __init__(self, x, kinds=None, planes=(), rings=None, resistance_only=False):
        super().__init__(x, kinds, planes, rings)
        rng = np.random.default_rng(8)
        n, d = x.shape
        number = self.particles.read()["id"]
        numbers = self.numbers = Numbers(n, 0.0 if resistance_only else MASS_RATE / self.volume)
        self.mu = rng.uniform(10.0, 1000.0, n)[number]
        self.h = 2.0 * self.volume / self.gradient.n0 * rng.uniform(5.0, 500.0, n)[number]
        numbers.h.from_numpy(self.h)
        numbers.natural_step[None] = 1.0
        if not resistance_only:
            numbers.bulk[None] = BULK
            numbers.mu.from_numpy(self.mu)
        self.system = MomentumOperator(self, self.sums, numbers, numbers, numbers)
        self.system.assemble(1.0)
        self.rate = StrainRate(self, self.sums)
        self.correction = DeferredCorrection(self, self.sums, self.rate, numbers)
        self.y = ti.Vector.field(d, ti.f64, n)
        self.unknown = self.kind == FLUID

    def multiply(self, u):
        """A u (n, d) [N]."""
        self.u.from_numpy(np.ascontiguousarray(u))
        self.system.multiply(self.u, self.y)
        return self.y.to_numpy()

    def dense(self):
        """Matrix over the unknown rows, (m d, m d), and its diagonal blocks (m, d, d)."""
        rows = np.flatnonzero(self.unknown)
        d, columns = self.dimension, []
        for i in rows:
            for a in range(d):
                u = np.zeros_like(self.x)
                u[i, a] = 1.0
                columns.append(self.multiply(u)[rows].ravel())
        A = np.array(columns).T
        return A, np.array([A[k * d : (k + 1) * d, k * d : (k + 1) * d] for k in range(len(rows))])

    def inverse_diagonal(self):
        """Block Jacobi's blocks (n, d, d) [s/kg], zero where a row is no unknown."""
        return self.system.inverse_diagonal.to_numpy()

    def push_of_moving_walls(self):
        """What walls in motion put on the right-hand side (n, d) [N]: what A applied to fluid at rest gives."""
        scratch = [ti.Vector.field(self.dimension, ti.f64, len(self.x)) for _ in range(3)]
        self.system.subtract_wall_motion(*scratch)
        return scratch[2].to_numpy()

    @ti.kernel
    def _correct(self):
        for i in range(self.particles.count[None]):
            flux, push = self.correction.force(i)
            self.sums.set_flux(i, flux)
            self.y[i] = push
        for i in range(self.particles.count[None]):
            self.sums.gather_fluxes(i)
        for i in range(self.particles.count[None]):
            self.y[i] += self.sums.force(i)

    def correct(self, u):
        """Force (n, d) [N] that the deferred correction gives back at the velocity u."""
        self.particles.u.from_numpy(np.ascontiguousarray(u))
        self.rate.evaluate(0.0)
        self.correction.gather(1.0)
        self._correct()
        return self.y.to_numpy()
