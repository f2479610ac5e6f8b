"""Reference of the Bingham cavity: strength and height of the vortex, by finite elements without inertia.

    python benchmarks/bingham_cavity.py 32 5 10 50

Elements along a side, then Bingham numbers; prints the lines of B_bingham_cavity_vortex.csv. Q2 velocity and linear
discontinuous pressure on a grid graded towards all walls; the lid's velocity is 0 in its two corners. The yield stress
by an accelerated projection of the dual (Treskatis, Moyers-Gonzalez and Price 2016, J. Non-Newton. Fluid 238, 115):

    Stokes with the stress s added,   s <- s + 2 D(u) cut to Bn,   then extrapolated (Nesterov), restarted when it turns
"""

import sys

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.linalg import splu

GRADING = 2.2  # nodes at (1 + tanh(2.2 s)/tanh(2.2))/2, s even from -1 to 1
EVERY, SETTLED = 100, 1e-7  # iterations between two looks at psi, and its change in three of them that ends the run


def hats(s):
    """Quadratic functions of the nodes -1, 0, 1 at s, and their slopes: (..., 3) each."""
    return np.stack([0.5 * s * (s - 1), 1 - s * s, 0.5 * s * (s + 1)], -1), np.stack([s - 0.5, -2 * s, s + 0.5], -1)


class Cavity:
    """Unit cavity under a lid of speed 1, viscosity 1; fields on points are rows xx, xy, yy."""

    def __init__(self, n: int):
        self.edges = 0.5 * (1 + np.tanh(GRADING * np.linspace(-1, 1, n + 1)) / np.tanh(GRADING))
        self.n, self.side = n, 2 * n + 1
        gauss, weight = np.polynomial.legendre.leggauss(3)
        a, b = (v.ravel() for v in np.meshgrid(gauss, gauss, indexing="ij"))
        (fa, da), (fb, db) = hats(a), hats(b)
        i, j = (v.ravel() for v in np.meshgrid(range(n), range(n), indexing="ij"))
        wide, high = np.diff(self.edges)[i], np.diff(self.edges)[j]
        li, lj = (v.ravel() for v in np.meshgrid(range(3), range(3), indexing="ij"))
        node = (2 * i[:, None] + li) * self.side + 2 * j[:, None] + lj
        point = np.arange(9 * n * n).reshape(-1, 9)

        def on_points(values, scale):
            """Matrix from nodes to points."""
            rows, columns = np.broadcast_arrays(point[:, :, None], node[:, None, :])
            entries = values.reshape(9, 9)[None] * scale[:, None, None]
            return sparse.csr_matrix((entries.ravel(), (rows.ravel(), columns.ravel())), (point.size, self.side**2))

        gx = on_points(np.einsum("qi,qj->qij", da, fb), 2 / wide)
        gy = on_points(np.einsum("qi,qj->qij", fa, db), 2 / high)
        none = sparse.csr_matrix(gx.shape)
        self.rates = [sparse.hstack(pair).tocsr() for pair in ((2 * gx, none), (gy, gx), (none, 2 * gy))]  # 2 D
        self.weights = (np.outer(weight, weight).ravel() * 0.25 * (wide * high)[:, None]).ravel()
        linear = np.stack([np.ones(9), a, b], -1)
        rows, columns = np.broadcast_arrays(point[:, :, None], np.arange(3 * n * n).reshape(-1, 1, 3))
        spread = np.broadcast_to(linear, rows.shape).ravel()
        pressure = sparse.csr_matrix((spread, (rows.ravel(), columns.ravel())), (point.size, 3 * n * n))
        volume = sparse.diags(self.weights)
        self.stiffness = sum(
            part * rate.T @ volume @ rate for part, rate in zip((0.5, 1.0, 0.5), self.rates, strict=True)
        )
        divergence = (pressure.T @ volume @ sparse.hstack([gx, gy])).tocsr()[1:]  # one pressure is free
        i, j = np.meshgrid(range(self.side), range(self.side), indexing="ij")
        last = self.side - 1
        wall = ((i == 0) | (i == last) | (j == 0) | (j == last)).ravel()
        self.lid = np.concatenate([((j == last) & (i > 0) & (i < last)).ravel(), np.zeros(wall.size)])
        self.free = np.flatnonzero(~np.concatenate([wall, wall]))
        inner = divergence[:, self.free]
        nothing = -1e-10 * sparse.eye(inner.shape[0])
        block = sparse.bmat([[self.stiffness[self.free][:, self.free], inner.T], [inner, nothing]])
        self.solved, self.leak = splu(block.tocsc()), -(divergence @ self.lid)

    def velocity(self, stress):
        """Stokes flow with this stress (3, points) added to the viscous one."""
        force = self.stiffness @ self.lid
        for part, rate, s in zip((0.5, 1.0, 0.5), self.rates, stress, strict=True):
            force = force + part * (rate.T @ (self.weights * s))
        u = self.lid.copy()
        u[self.free] = self.solved.solve(np.concatenate([-force[self.free], self.leak]))[: self.free.size]
        return u

    def vortex(self, u):
        """psi and its height on the line in the middle: the largest of -(integral of u_x from the floor)."""
        line, best, below = u[: self.side**2].reshape(self.side, -1)[self.n], (0.0, 0.0), 0.0
        s = np.linspace(-1, 1, 201)
        for k, high in enumerate(np.diff(self.edges)):
            along = hats(s)[0] @ line[2 * k : 2 * k + 3]
            total = below + 0.25 * high * (s[1] - s[0]) * np.concatenate([[0], np.cumsum(along[1:] + along[:-1])])
            best = max(best, (-total.min(), self.edges[k] + 0.5 * high * (1 + s[total.argmin()])))
            below = total[-1]
        return best

    def flow(self, bingham_number: float):
        """psi, height of the vortex, and the unyielded part of the area."""
        stress = ahead = np.zeros((3, self.weights.size))
        momentum, seen = 1.0, []
        while len(seen) < 4 or np.abs(np.diff(seen[-4:])).max() > SETTLED:
            for _ in range(EVERY):
                u = self.velocity(ahead)
                trial = ahead + np.stack([rate @ u for rate in self.rates])
                size = np.sqrt(0.5 * (trial[0] ** 2 + trial[2] ** 2) + trial[1] ** 2)
                new = trial * np.minimum(1.0, bingham_number / np.maximum(size, 1e-30))
                turned = ((ahead - new) * (new - stress) * self.weights).sum() > 0.0
                longer = 1.0 if turned else 0.5 * (1.0 + np.sqrt(1.0 + 4.0 * momentum**2))
                ahead = new if turned else new + (momentum - 1.0) / longer * (new - stress)
                stress, momentum = new, longer
            seen.append(self.vortex(u)[0])
        rigid = size <= bingham_number * (1.0 + 1e-6)
        return *self.vortex(u), float((self.weights * rigid).sum())


if __name__ == "__main__":
    cavity = Cavity(int(sys.argv[1]))
    for number in sys.argv[2:]:
        psi, height, rigid = cavity.flow(float(number))
        print(f"{cavity.n},{number},{psi:.6g},0.5,{height:.6g},{rigid:.4f}", flush=True)
