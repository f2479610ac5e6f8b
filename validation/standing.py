"""Bodies at the limit between standing and flowing: the critical yield stress of a column, and arrested slumps.

A slumped body would also stand with a somewhat lower yield stress, since inertia carried it farther than its weight
alone would. Finite elements without inertia give the lowest yield stress, STATIC_LIMITS. So the body must stand with
its own yield stress and with 1.05 of the limit, and flow with 0.95 of it.
"""

from dataclasses import dataclass, replace

import numpy as np

import taichi_mps as mps

from . import Measured, columns, run
from .slumps import DENSITY, GRAVITY, final_shape

SPACING = 0.01  # of arrested slumps [m]
# Height of columns and of the mould [m]; a column stands whose top sinks slower after 0.3 s [m/s], 2.5e-5 rho g H^2/eta
HEIGHT, STANDING_SPEED = 0.3, 1e-3

# {tau_y [Pa] of a body that arrested with inertia: limit over tau_y}. The limit is the mean of the yield stresses with
# which bodies without inertia come to its slump and to its slump flow (they differ by 3 %). With inertia: the arrested
# values of A_fe_inertial_slump_summary.csv; without: the finest runs of A_fe_slump_abrams_final.csv, as a polynomial of
# third degree in log tau_y.
STATIC_LIMITS = {300.0: 0.9836680671798499, 500.0: 0.8760153726353327, 1000.0: 0.8432992842655787}


# ---- columns ---------------------------------------------------------------------------------------------------
def top_speed(solid, across, b) -> float:
    """Downward speed [m/s] of the top within H/10 of the axis 0.3 s after release, for b = tau_y/(rho g H) and 50 Pa s;
    ``across``: particles over the height."""
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
    """Critical tau_y/(rho g H) to 1 %, by four bisections of +-15 % about the middle of the reference's bracket."""
    table = columns("B_fe_initial_velocity_threshold.csv", case=reference)
    moving = table["v_max"] > 1e-6
    flows, stands = float(table["B"][moving].max()), float(table["B"][~moving].min())
    middle = 0.5 * (flows + stands)
    low, high = 0.85 * middle, 1.15 * middle
    for _ in range(4):
        b = 0.5 * (low + high)
        low, high = (b, high) if top_speed(solid, across, b) > STANDING_SPEED else (low, b)
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
    """Body of revolution between the floor z = 0 and a curve (r, z) [m] from the floor to the axis."""

    curve: np.ndarray
    volume: float  # [m3]

    @property
    def bounds(self):
        r, z = self.curve.max(0)
        return np.array([-r, -r, 0.0]), np.array([r, r, z])

    def contains(self, x):
        """Whether positions are inside: a ray to large r crosses the curve an odd number of times."""
        r, z = np.hypot(x[:, 0], x[:, 1])[:, None], x[:, 2][:, None]
        (r0, z0), (r1, z1) = self.curve[:-1].T, self.curve[1:].T
        between = (z0 <= z) != (z1 <= z)
        return (between & (r < r0 + (z - z0) / np.where(z1 == z0, 1.0, z1 - z0) * (r1 - r0))).sum(1) % 2 == 1


def jittered(body, size: float) -> np.ndarray:
    """Lattice in the body with each coordinate moved at random by up to ``size`` l0 (seed 1)."""
    lattice = mps.fill(body, SPACING)
    return lattice + size * SPACING * np.random.default_rng(1).uniform(-1.0, 1.0, lattice.shape)


def relaxed(body) -> np.ndarray:
    """Disordered particles in the body at even distances, as in a liquid. They start at random positions in a column of
    8 x 8 l0 with floor, lid and periodic sides, and are shifted apart 200 times; copies of the column fill the body."""
    wide, passes = 8, 200
    high = int(np.ceil(body.bounds[1][2] / SPACING)) + 2
    x = np.random.default_rng(1).uniform(0.0, 1.0, (wide * wide * high, 3)) * (wide, wide, high)
    sides = np.array([(a, b, 0.0) for a in (-wide, 0, wide) for b in (-wide, 0, wide)])
    moves = np.zeros_like(x)
    for _ in range(passes):
        levels = np.concatenate([x, x * (1, 1, -1), x * (1, 1, -1) + (0, 0, 2 * high)])  # with images below and above
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
    filled = SPACING * np.concatenate([x + (wide * a, wide * b, 0.0) for a in copies for b in copies])
    return filled[body.contains(filled)]


def sinking(particles, yield_value: float) -> float:
    """Sinking of the top in 1 s [m], mean over the particles that start within 40 mm of the axis and 1.5 l0 below the
    highest one."""
    scene = mps.slump_cone(yield_value=yield_value, plastic_viscosity=50.0, spacing=SPACING, until=1.0)
    sim = run(replace(scene, fluid=particles, stop_at_rest=False))
    x, y, z = particles.T
    top = (np.hypot(x, y) < 0.04) & (z > z.max() - 1.5 * SPACING)
    return float((z - sim.snapshot().x[:, 2])[top].mean())


def arrested(fill, below=True, **settings):
    """Yield the sinking in 1 s of arrested bodies, which ``fill(body, **settings)`` fills with particles. They must
    stand at tau_y; with ``below`` also at 1.05 of the static limit, where that is less than tau_y, and flow at 0.95."""
    for tau_y, limit in STATIC_LIMITS.items():
        particles = fill(Revolved(final_shape(tau_y), mps.Cone(0.1, 0.05, HEIGHT).volume), **settings)
        for share in (1.0, 1.05 * limit) if below and 1.05 * limit <= 1.0 else (1.0,):
            name = f"{tau_y:g} Pa at {share:.2f} of it" if below else f"{tau_y:g} Pa"
            yield Measured(f"{name}: sinking of the top in 1 s", 1e3 * sinking(particles, share * tau_y), 1.0, "mm")
        if below:
            name = f"{tau_y:g} Pa at {0.95 * limit:.2f} of it: 1 mm / sinking of the top in 1 s (flows if under 1)"
            yield Measured(name, 1e-3 / max(sinking(particles, 0.95 * limit * tau_y), 1e-9), 1.0)
