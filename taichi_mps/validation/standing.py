"""Rows of a body that must stand: the slump at which the finite elements with inertia arrested, filled with particles.

A body that fell into its shape stands below its own yield stress, too: inertia carried it farther than its weight
would. How far below follows from the finite elements without inertia: ``static_limit``. So it must stand at its yield
value and at 1.05 of that limit, and flow at 0.95 of it.
"""

from dataclasses import dataclass, replace

import numpy as np

import taichi_mps as mps

from . import Measured, read_reference, row
from .slumps import INERTIAL, INERTIALESS, cone, final_shape, follow, inertial

SPACING = 0.01  # [m]
REFERENCE = f"{INERTIAL}: it stands at tau_y; {INERTIALESS}: below which it flows"


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


def static_limit(tau_y: float) -> float:
    """Share of tau_y [-] below which a body that arrested with inertia flows: the yield stress, over tau_y, of the body
    that comes to rest without inertia with this slump, and of that with this spread, in the mean. They differ by 3 %.

    Between the references at 100, 300, 500 and 1000 Pa a polynomial of third degree in log tau_y."""
    runs = {float(r["tau0_Pa"]): r for r in read_reference("A_fe_slump_abrams_final.csv")}  # the finest of each
    known = [tau for tau in sorted(runs) if tau >= 100.0]
    arrested = next(r for r in inertial("summary", tau_y, "A", 0.0) if r["kind"] == "final(arrest)")
    of_all = np.linspace(np.log(known[0]), np.log(known[-1]), 10_001)
    shares = []
    for still, fallen in (("slump_mm", "slump_mm"), ("spread_diam_mm", "spread_mm")):
        curve = np.polyval(np.polyfit(np.log(known), [float(runs[tau][still]) for tau in known], 3), of_all)
        shares.append(np.exp(of_all[np.argmin(np.abs(curve - float(arrested[fallen])))]) / tau_y)
    return float(np.mean(shares))


def jittered(body, size: float) -> np.ndarray:
    """A lattice in the body, each coordinate moved by up to ``size`` l0, at random (seed 1)."""
    lattice = mps.fill(body, SPACING)
    return lattice + size * SPACING * np.random.default_rng(1).uniform(-1.0, 1.0, lattice.shape)


def relaxed(body) -> np.ndarray:
    """Disordered particles in the body that have found even distances, like those of a liquid: they begin at random
    places and are shifted apart 200 times, in a column of 8 x 8 l0 on the floor, periodic to the sides, with a lid."""
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
    """How far the top sinks in 1 s [m]: the mean of the particles that start within 40 mm of the axis and 1.5 l0 of the
    highest one."""
    scene = cone(yield_value=yield_value, plastic_viscosity=50.0, spacing=SPACING, until=1.0)
    sim, _, _ = follow(replace(scene, fluid=particles, stop_at_rest=False))
    x, y, z = particles.T
    top = (np.hypot(x, y) < 0.04) & (z > z.max() - 1.5 * SPACING)
    return float((z - sim.snapshot().x[:, 2])[top].mean())


def standing(tau_y: float, fill):
    """The arrested body of tau_y [Pa] in 1 s: at tau_y and 5 % above its static limit it stands, 5 % below it flows."""
    particles = fill(Revolved(final_shape(tau_y), mps.Cone(0.1, 0.05, 0.3).volume))
    limit = static_limit(tau_y)
    for share in (1.0, 1.05 * limit):
        if share <= 1.0:
            sunk = sinking(particles, share * tau_y)
            yield Measured(f"{tau_y:g} Pa at {share:.2f} of it: sinking of the top in 1 s", 1e3 * sunk, 1.0, "mm")
    sunk = sinking(particles, 0.95 * limit * tau_y)
    name = f"{tau_y:g} Pa at {0.95 * limit:.2f} of it: 1 mm / sinking of the top in 1 s (flows if under 1)"
    yield Measured(name, 1e-3 / max(sunk, 1e-9), 1.0)


@row("arrested slumps, filled with a lattice", REFERENCE)
def standing_ordered():
    for tau_y in (300.0, 500.0, 1000.0):
        yield from standing(tau_y, lambda body: jittered(body, 0.0))


@row("arrested slumps, filled with disordered particles at even distances", REFERENCE)
def standing_disordered():
    for tau_y in (300.0, 500.0, 1000.0):
        yield from standing(tau_y, relaxed)


@row("arrested slumps, filled with a lattice jittered by 0.3 l0", f"{INERTIAL}: it stands at tau_y")
def standing_jittered():
    for tau_y in (300.0, 500.0, 1000.0):
        body = Revolved(final_shape(tau_y), mps.Cone(0.1, 0.05, 0.3).volume)
        sunk = sinking(jittered(body, 0.3), tau_y)
        yield Measured(f"{tau_y:g} Pa: sinking of the top in 1 s", 1e3 * sunk, 1.0, "mm")
