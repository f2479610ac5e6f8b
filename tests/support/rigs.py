"""Inner objects on given particles: the only place where tests put particles, lists, walls and systems together."""

import numpy as np

import taichi_mps as mps
from taichi_mps.boundaries.walls import Walls
from taichi_mps.particles.gradient import Gradient
from taichi_mps.particles.kernels import lattice_sums, mps_weight
from taichi_mps.particles.neighbors import Bins, NeighborList
from taichi_mps.particles.particles import FLUID, Particles
from taichi_mps.runtime.backend import ti
from taichi_mps.runtime.thread_team import ONE_THREAD
from taichi_mps.terms.momentum import MomentumSystem

L0 = 0.1  # spacing [m]
RE = 2.1 * L0  # effective radius [m]
MASS_RATE, BULK = 40.0, 3000.0  # of a System: mass over time step [kg/s], bulk modulus [Pa s]


def cloud(shape, seed=2):
    """A jittered lattice around the origin, [m]."""
    half = 0.5 * L0 * np.array(shape)
    x = mps.lattice(-half, half, L0)
    return x + np.random.default_rng(seed).uniform(-0.25, 0.25, x.shape) * L0


@ti.data_oriented
class Rig:
    """Particles at given places, with kernels for the gradient of ``u`` and the force of the stresses ``T``."""

    def __init__(self, x, kinds=None, planes=(), rings=None, weight=mps_weight):
        """``rings``: their volumes [m3] in an axisymmetric scene."""
        d = x.shape[1]
        t = d if rings is None else 3
        self.dimension, self.volume, self.planes = d, L0**d, planes
        kinds = np.full(len(x), FLUID) if kinds is None else kinds
        lattice = lattice_sums(d, L0, 2.1 * L0, weight)
        volumes = np.full(len(x), self.volume) if rings is None else rings
        frictions = [plane.friction for plane in planes if plane.friction]
        self.particles = Particles(x, kinds, 0.0 * x, volumes, False, rings is not None, frictions=frictions)
        bins = Bins(self.particles, ((-2.0,) * d, (2.0,) * d), (False,) * d, 2.1 * L0)
        neighbors = NeighborList(bins, 60 * len(x))
        on = dict(rings=rings is not None, particles=self.particles, weight=weight)
        walls = Walls(planes, d, L0, 2.1 * L0, len(x), **on)
        self.gradient = Gradient(neighbors, walls, lattice, L0)
        self.u, self.F = (ti.Vector.field(d, ti.f64, len(x)) for _ in range(2))
        self.left = ti.field(ti.f64, len(x))
        self.G, self.T = (ti.Matrix.field(t, t, ti.f64, len(x)) for _ in range(2))
        self.P = ti.Matrix.field(d, d, ti.f64, len(x))
        bins.sort()
        neighbors.build()
        self.gradient.build()
        rows = self.particles.read()
        self.x, self.kind = rows["x"], rows["kind"]
        r = self.x[None] - self.x[:, None]
        size = np.linalg.norm(r, axis=-1) + 9.0 * np.eye(len(x))
        self.weight_r2 = weight(np.minimum(1.0, size / (2.1 * L0))) / size**2
        moment = np.einsum("ij,ija,ijb->iab", self.weight_r2, r, r)
        self.healthy = np.linalg.det(moment) > 0.05 * (lattice.n0 / d) ** d  # not nearly flat: not stiffened
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
            self.P[i] = self.gradient.spread_stress(i, self.T[i])
        for i in range(self.particles.count[None]):
            self.F[i] = self.gradient.force(i, self.P)

    def gradients(self, u, motion=0.0):
        self.u.from_numpy(np.ascontiguousarray(u))
        self._gradients(motion)
        return self.G.to_numpy()

    def fits(self, u):
        self.u.from_numpy(np.ascontiguousarray(u))
        self._fits()
        return self.G.to_numpy(), self.left.to_numpy()

    def forces(self, T):
        self.T.from_numpy(T)
        self._forces()
        return self.F.to_numpy()


@ti.data_oriented
class System(Rig):
    """A cloud of particles with random viscosities, and its momentum system."""

    def __init__(self, x, kinds=None, planes=(), rings=None):
        super().__init__(x, kinds, planes, rings)
        rng = np.random.default_rng(8)
        n, d = x.shape
        self.system = MomentumSystem(self.particles, self.gradient, self.gradient.walls)
        self.system.bulk[None] = BULK
        self.system.inertia.fill(MASS_RATE / self.volume)
        self.system.mu.from_numpy(rng.uniform(10.0, 1000.0, n))
        self.system.h.from_numpy(2.0 * self.volume / self.gradient.n0 * rng.uniform(5.0, 500.0, n))
        self.system.prepare()
        self.y = ti.Vector.field(d, ti.f64, n)
        self.unknown = self.kind == FLUID

    @ti.kernel
    def _multiply(self):
        self.system.apply(self.u, self.y, ONE_THREAD, 0)

    def multiply(self, u):
        self.u.from_numpy(np.ascontiguousarray(u))
        self._multiply()
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
