"""Bodies at the limit between standing and flowing: the critical yield stress of a column, and arrested slumps.

A body that fell into its shape stands also below its own yield stress, since inertia carried it farther than its weight
would. Finite elements without inertia give the limit, STATIC_LIMITS. So it must stand at its yield stress and at 1.05
of the limit, and flow at 0.95 of it.
"""

from dataclasses import dataclass, replace

import numpy as np

import taichi_mps as mps

from . import Measured, columns, run
from .slumps import DENSITY, GRAVITY, final_shape

SPACING = 0.01  # of arrested slumps [m]
HEIGHT, CREEP = 0.3, 1e-3  # m; m/s: a column whose top sinks slower after 0.3 s stands (2.5e-5 rho g H^2/eta)

# Yield stress, over that of a body that arrested with inertia, of the bodies that come to rest without inertia with its
# slump, and with its spread, in the mean (they differ by 3 %): A_fe_slump_abrams_final.csv, the finest of each, as a
# polynomial of third degree in log tau_y, at the arrested values of A_fe_inertial_slump_summary.csv. By tau_y [Pa].
STATIC_LIMITS = {300.0: 0.9836680671798499, 500.0: 0.8760153726353327, 1000.0: 0.8432992842655787}


# ---- columns ---------------------------------------------------------------------------------------------------
def top_speed(solid, across, b) -> float:
    """Downward speed [m/s] of the top within H/10 of the axis 0.3 s after release; b = tau_y/(rho g H), 50 Pa s."""
    spacing = HEIGHT / across
    x = mps.fill(solid, spacing)
    d = x.shape[1]
    scene = mps.Scene(
        name="column",
        material=mps.Bingham(density=DENSITY, plastic_viscosity=50.0, yield_value=b * DENSITY * GRAVITY * HEIGHT),
        spacing=spacing,
        fluid=x,
        walls=(mps.Plane((0.0,) * d, (0.0,) * (d - 1) + (1.0,)),),
        domain=((-0.5,) * (d - 1) + (-0.02,), (0.5,) * (d - 1) + (0.4,)),
    )
    top = (np.linalg.norm(x[:, :-1], axis=1) < 0.1 * HEIGHT) & (x[:, -1] > HEIGHT - 1.5 * spacing)
    return float(-run(scene, 0.3).snapshot().u[top, -1].mean())


def threshold(reference, solid, across):
    """Critical b by four bisections of +-15 % about the middle of the reference's bracket (so to 1 %)."""
    known = columns("B_fe_initial_velocity_threshold.csv", case=reference)
    moving = known["v_max"] > 1e-6
    flows, stands = float(known["B"][moving].max()), float(known["B"][~moving].min())
    middle = 0.5 * (flows + stands)
    low, high = 0.85 * middle, 1.15 * middle
    for _ in range(4):
        b = 0.5 * (low + high)
        low, high = (b, high) if top_speed(solid, across, b) > CREEP else (low, b)
    found = 0.5 * (low + high)
    what = f"critical tau_y/(rho g H) {found:.3f} from the middle of {flows:g} to {stands:g}, relative"
    outside = max(0.0, flows - found, found - stands) / middle
    return [
        Measured(what, found / middle - 1.0, 0.05),
        Measured("the same: outside the reference's bracket by, relative", outside, 0.05),
    ]


# ---- arrested slumps -------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Revolved:
    """The body of revolution under a curve (r, z) [m] that ends on the axis, on the floor z = 0."""

    curve: np.ndarray
    volume: float  # [m3]

    @property
    def bounds(self):
        r, z = self.curve.max(0)
        return np.array([-r, -r, 0.0]), np.array([r, r, z])

    def contains(self, x):
        """Inside where a ray to large r crosses the curve an odd number of times."""
        r, z = np.hypot(x[:, 0], x[:, 1])[:, None], x[:, 2][:, None]
        (r0, z0), (r1, z1) = self.curve[:-1].T, self.curve[1:].T
        between = (z0 <= z) != (z1 <= z)
        rise = np.where(z1 == z0, 1.0, z1 - z0)
        return (between & (r < r0 + (z - z0) / rise * (r1 - r0))).sum(1) % 2 == 1


def jittered(body, size: float) -> np.ndarray:
    """A lattice in the body, each coordinate moved by up to ``size`` l0, at random (seed 1)."""
    lattice = mps.fill(body, SPACING)
    return lattice + size * SPACING * np.random.default_rng(1).uniform(-1.0, 1.0, lattice.shape)


def relaxed(body) -> np.ndarray:
    """Disordered particles in the body at even distances, as in a liquid: from random places they are shifted apart 200
    times, in a column of 8 x 8 l0 with floor and lid and periodic sides, whose copies fill the body."""
    wide, passes = 8, 200
    high = int(np.ceil(body.bounds[1][2] / SPACING)) + 2
    x = np.random.default_rng(1).uniform(0.0, 1.0, (wide * wide * high, 3)) * (wide, wide, high)
    sides = np.array([(a, b, 0.0) for a in (-wide, 0, wide) for b in (-wide, 0, wide)])
    moves = np.zeros_like(x)
    for _ in range(passes):
        levels = np.concatenate([x, x * (1, 1, -1), x * (1, 1, -1) + (0, 0, 2 * high)])  # and mirrored at both ends
        around = (levels + sides[:, None]).reshape(-1, 3)
        around = around[np.all((around > -1.5) & (around < np.add((wide, wide, high), 1.5)), axis=1)]
        for some in np.array_split(np.arange(len(x)), 8):
            r = around - x[some, None]
            distance = np.sqrt((r**2).sum(-1))
            near = np.where(distance > 1e-9, np.maximum(0.0, 1.0 - distance / 1.5) / np.maximum(distance, 1e-9), 0.0)
            moves[some] = -0.1 * (near[..., None] * r).sum(1)
        x = (x + moves) % (wide, wide, 1e9)
        x[:, 2] = np.clip(x[:, 2], 0.1, high - 0.1)
    copies = range(int(np.floor(body.bounds[0][0] / SPACING / wide)), int(np.ceil(body.bounds[1][0] / SPACING / wide)))
    places = [(wide * a, wide * b, 0.0) for a in copies for b in copies]
    filled = SPACING * np.concatenate([x + place for place in places])
    return filled[body.contains(filled)]


def sinking(particles, yield_value: float) -> float:
    """Sinking of the top in 1 s [m]: the mean of the particles that start within 40 mm of the axis and 1.5 l0 of the
    highest one."""
    scene = mps.slump_cone(yield_value=yield_value, plastic_viscosity=50.0, spacing=SPACING, until=1.0)
    sim = run(replace(scene, fluid=particles, stop_at_rest=False))
    x, y, z = particles.T
    top = (np.hypot(x, y) < 0.04) & (z > z.max() - 1.5 * SPACING)
    return float((z - sim.snapshot().x[:, 2])[top].mean())


def arrested(fill, below=True, **settings):
    """Yield the sinking in 1 s of arrested bodies filled by a function of the body, which must stand at tau_y and 5 %
    above the static limit and, with ``below``, flow 5 % below it."""
    for tau_y, limit in STATIC_LIMITS.items():
        particles = fill(Revolved(final_shape(tau_y), mps.Cone(0.1, 0.05, HEIGHT).volume), **settings)
        for share in (1.0, 1.05 * limit) if below and 1.05 * limit <= 1.0 else (1.0,):
            name = f"{tau_y:g} Pa at {share:.2f} of it" if below else f"{tau_y:g} Pa"
            yield Measured(f"{name}: sinking of the top in 1 s", 1e3 * sinking(particles, share * tau_y), 1.0, "mm")
        if below:
            name = f"{tau_y:g} Pa at {0.95 * limit:.2f} of it: 1 mm / sinking of the top in 1 s (flows if under 1)"
            yield Measured(name, 1e-3 / max(sinking(particles, 0.95 * limit * tau_y), 1e-9), 1.0)
