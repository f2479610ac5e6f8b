"""Bodies that slump under their own weight: the slump cone, the time to a slump flow, a block in two dimensions.

The references are finite elements of a true Bingham material on a no-slip floor (own solutions; the comment lines
of each CSV say how they were made). Slump is read over r < 20 mm and spread in all directions, by ``measure.slump``.
Errors are engine - reference, with their sign; of several, the largest by magnitude.
"""

import math
from operator import itemgetter

import numpy as np

import taichi_mps as mps

from . import SLUMP_ERROR, Measured, columns, record, run
from .flows import RATIONAL_ERROR

MILESTONES = (0.1, 0.2, 0.3, 0.5, 1.0)  # [s]
DENSITY, GRAVITY = 2300.0, 9.81  # [kg/m3], [m/s2]


# ---- measuring -------------------------------------------------------------------------------------------------
def moment(sim) -> str:
    """Time of the end of a run in words: at rest, or at its last time [s]."""
    return "at rest" if sim.stopped_by == "rest" else f"at {sim.time:g} s"


def percent(value: float, exact: float) -> float:
    """Relative error [%]."""
    return 100.0 * (value / exact - 1.0)


def slump_and_spread(sim) -> tuple[float, float]:
    """Slump and slump flow of a simulation [m]."""
    return itemgetter("slump_m", "spread_m")(sim.measures())


def top_surface(s, points: np.ndarray) -> np.ndarray:
    """Height [m] of the body at horizontal positions (k, d-1) [m]; 0 where there is none.

    The top of balls (discs in 2-D) of 0.75 sizes around the particles, wide enough to leave no hole in a lattice;
    lowered so that a flat surface is exact in the mean. A vertical side comes out 0.25 sizes too far outside.
    """
    size, d = s.size, s.x.shape[1]
    lowered = (0.19 if d == 2 else 0.12) * size
    rise2 = (0.75 * size) ** 2 - sum((points[:, None, a] - s.x[None, :, a]) ** 2 for a in range(d - 1))
    return np.where(rise2 > 0.0, s.x[None, :, -1] + np.sqrt(np.maximum(rise2, 0.0)) - lowered, 0.0).max(1)


def shape_error(s, curve: np.ndarray) -> float:
    """Largest distance [m] in the (r, z) plane of the points (r, h(r)) from the reference curve (k, 2) [m].

    h(r) is the top surface averaged over 36 directions. r goes in steps of l0/2 from the axis to the farthest point
    of the curve that is more than l0 above the floor. The distance is to the nearest point of the curve, since the
    difference in height means nothing where the curve is steep.
    """
    angles = np.arange(36) * 2 * math.pi / 36
    rim = np.stack([np.cos(angles), np.sin(angles)], 1)
    radii = np.arange(0.0, curve[curve[:, 1] > s.spacing, 0].max(), 0.5 * s.spacing)
    points = np.array([(r, top_surface(s, r * rim).mean()) for r in radii])
    start, along = curve[:-1], np.diff(curve, axis=0)
    share = ((points[:, None] - start) * along).sum(-1) / (along**2).sum(-1)
    nearest = start + np.clip(share, 0.0, 1.0)[..., None] * along
    return float(np.linalg.norm(points[:, None] - nearest, axis=-1).min(1).max())


# ---- references ------------------------------------------------------------------------------------------------
def inertial(tau_y: float, eta: float = 50.0, pi_c: float | None = None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times [s], slumps and spreads [m] of the finite elements with inertia, by their time up to 5 s: of the true
    Bingham material, or of the bi-viscosity law."""
    wanted = {"model": "B" if pi_c else "A", "tau_Pa": tau_y, "eta_Pa_s": eta, "gc_1_s": 2.0 * (pi_c or 0.0)}
    reference = columns("A_fe_inertial_slump_summary.csv", **wanted)
    at = ~np.char.startswith(reference["kind"], "final")
    return reference["time_s"][at], 1e-3 * reference["mean20_mm"][at], 1e-3 * reference["spread_mm"][at]


def milestone_errors(times, slumps, tau_y: float, pi_c: float | None = None) -> np.ndarray:
    """Slumps [m] at times [s] less those of the finite elements with inertia, at the MILESTONES."""
    return np.interp(MILESTONES, times, slumps) - np.interp(MILESTONES, *inertial(tau_y, pi_c=pi_c)[:2])


def final_shape(tau_y: float) -> np.ndarray:
    """(r, z) [m] of the true Bingham body at the end, from the contact line to the axis."""
    reference = columns("A_fe_inertial_slump_shapes.csv", model="A", tau_Pa=tau_y, eta_Pa_s=50.0)
    return np.column_stack([reference["r_m"], reference["z_m"]])


# ---- the cone with inertia -------------------------------------------------------------------------------------
def collapse(tau_y, spacing=0.01, slump_target=5.0, model="full", until=5.0, pi_c=None):
    """Slump at the milestones and at the end, spread, shape and volume of a collapse with eta = 50 Pa s."""
    times, slump, spread = inertial(tau_y, pi_c=pi_c)
    mix = {"yield_value": tau_y, "plastic_viscosity": 50.0, "critical_strain_rate": pi_c}
    scene = mps.slump_cone(**mix, spacing=spacing, until=until, model=model)
    sim, at, found = record(scene, slump_and_spread, 0.1)
    errors = milestone_errors(at, found[:, 0], tau_y, pi_c)
    worst, end_error = errors[np.argmax(np.abs(errors))], found[-1, 0] - np.interp(until, times, slump)
    last, largest = moment(sim), 1e3 * float(max(abs(worst), abs(end_error)))
    point = {"quantity": SLUMP_ERROR, "curve": f"{tau_y:g} Pa", "x": [1e3 * spacing], "y": [largest]}
    numbers = [
        *[point] * (pi_c is None and model == "full"),
        Measured("slump, worst of t = 0.1, 0.2, 0.3, 0.5, 1 s", 1e3 * worst, slump_target, "mm"),
        Measured(f"slump {last}", 1e3 * end_error, slump_target, "mm"),
        Measured(f"slump flow {last}", percent(found[-1, 1], np.interp(until, times, spread)), 3.0, "%"),
    ]
    if pi_c is None:
        error = shape_error(scene.unfold(sim.snapshot()), final_shape(tau_y))
        numbers.append(Measured(f"surface {last}", 1e3 * error, 1e3 * spacing, "mm"))
    return [
        *numbers,
        Measured("volume at all times", 100.0 * sim.report.volume_error_max, 1.0, "%"),
        Measured(f"volume {last}", 100.0 * sim.report.volume_error, 0.5, "%"),
    ]


def rational_slump():
    """Error of the rational rule and of the scheme together, beside the true Bingham material."""
    mix = {"yield_value": 500.0, "plastic_viscosity": 50.0, "critical_strain_rate": "rational"}
    _, at, found = record(mps.slump_cone(**mix, until=5.0), slump_and_spread, 0.1)
    exact, (early, late) = inertial(500.0)[1][-1], np.interp([1.0, 5.0], at, found[:, 0])
    what = "creep from 1 to 5 s; target: e of the arrested height"
    return [
        Measured("slump at 5 s", 1e3 * (late - exact), 5.0, "mm"),
        Measured(what, 1e3 * (late - early), 1e3 * (RATIONAL_ERROR * (0.3 - exact)), "mm"),
    ]


# ---- the cone without inertia ----------------------------------------------------------------------------------
def slow_collapse(tau_y, reference):
    """Rest slump and slump flow with eta = 1500 Pa s: Re = rho H sqrt(g H)/eta = 0.8, inertia hardly matters."""
    exact = columns("A_fe_slump_abrams_final.csv", run=reference)
    sim = run(mps.slump_cone(yield_value=tau_y, plastic_viscosity=1500.0, until=60.0))
    (slump, spread), last = slump_and_spread(sim), moment(sim)
    return [
        Measured(f"slump {last}", 1e3 * slump - exact["slump_mm"][0], 5.0, "mm"),
        Measured(f"slump flow {last}", percent(1e3 * spread, exact["spread_diam_mm"][0]), 3.0, "%"),
        Measured(f"volume {last}", 100.0 * sim.report.volume_error, 0.5, "%"),
    ]


def two_viscosities():
    """The slump of 100 Pa hardly depends on inertia: 248.2 mm with it (eta = 50 Pa s, 5 s), 248.7 mm without."""
    fluid = run(mps.slump_cone(yield_value=100.0, plastic_viscosity=50.0, until=20.0))
    thick = run(mps.slump_cone(yield_value=100.0, plastic_viscosity=1500.0, until=200.0))
    what = f"slump of 1500 Pa s {moment(thick)} less that of 50 Pa s {moment(fluid)}"
    return [Measured(what, 1e3 * (slump_and_spread(thick)[0] - slump_and_spread(fluid)[0]), 3.0, "mm")]


def time_to_spread(spacing, model="full"):
    """Time to a slump flow of 40 and 50 cm; the reference time is proportional to the viscosity."""
    eta, reference = 1000.0, columns("A_fe_slump_T500.csv", tau0_Pa=50.0)
    exact = dict(zip(reference["D_mm"], reference["t_s_mu100"] * eta / 100.0, strict=True))
    mix = {"yield_value": 50.0, "plastic_viscosity": eta}

    def read(sim):
        spread = slump_and_spread(sim)[1]
        if spread > 0.5:
            sim.interrupt()
        return spread

    _, times, spreads = record(mps.slump_cone(**mix, until=2.0 * exact[500.0], spacing=spacing, model=model), read)
    times, spreads = np.append(0.0, times), np.maximum.accumulate(np.append(0.2, spreads))
    for diameter in (400.0, 500.0):
        found = np.interp(1e-3 * diameter, spreads, times, right=np.nan)  # nan: never got there
        yield Measured(f"time to a slump flow of {diameter / 10.0:g} cm", percent(found, exact[diameter]), 5.0, "%")


# ---- a block in two dimensions ---------------------------------------------------------------------------------
def block(number, across=40) -> mps.Scene:
    """A block 0.4 m wide and 0.2 m high, B = tau_y/(rho g H) = ``number``, eta = 1500 Pa s:
    Re = rho H sqrt(g H)/eta = 0.4."""
    height, eta = 0.2, 1500.0
    l0 = height / across
    return mps.Scene(
        name=f"block B = {number:g}",
        material=mps.Bingham(density=DENSITY, plastic_viscosity=eta, yield_value=number * DENSITY * GRAVITY * height),
        spacing=l0,
        fluid=mps.fill(mps.Box((-height, 0.0), (height, height)), l0),
        walls=(mps.Plane((0.0, 0.0), (0.0, 1.0)),),
        domain=((-3.5 * height, -4 * l0), (3.5 * height, 1.5 * height)),
        until=1400.0 * eta / (DENSITY * GRAVITY * height),  # when the finite elements stopped (B = 0.05)
        stop_at_rest=True,
    )


def runout_error(number, s) -> float:
    """Relative error [%] of the farthest reach + l0/2, the mean of both sides, of a ``block``."""
    reference = columns("B_fe_block2d_final.csv", B=number)
    return percent(0.5 * (np.ptp(s.x[:, 0]) + s.spacing), 0.2 * reference["x_max_final"][0])


def block_at_rest(number):
    """Final runout and height at the middle, which is the top surface over |x| < 2 l0."""
    sim, exact = run(block(number)), 0.2 * columns("B_fe_block2d_final.csv", B=number)["h0_final"][0]
    s = sim.snapshot()
    centre = top_surface(s, np.linspace(-2 * s.spacing, 2 * s.spacing, 41)[:, None]).mean()
    return [
        Measured(f"runout {moment(sim)}", runout_error(number, s), 3.0, "%"),
        Measured(f"height at the middle {moment(sim)}", percent(centre, exact), 3.0, "%"),
    ]


def stretched_block():
    """Height of the middle after 5 and 10 s, how smooth it is, and how fast the block slides.

    tau_y = 564 Pa, eta = 1500 Pa s, 0.8 m wide. No section of it carries a horizontal force, so the middle thins at the
    rate e with 2 (tau_y + 2 eta e) = rho g h/2: h = H/(1 - (1 - H/h_0) exp(-rho g H t/(8 eta))), H = 4 tau_y/(rho g).
    Its surface is in tension, of twice its shear stress.
    """
    height, initial, half, eta = 0.1, 0.16, 0.4, 1500.0
    l0 = height / 10
    scene = mps.Scene(
        name="block on a frictionless floor",
        material=mps.Bingham(density=DENSITY, plastic_viscosity=eta, yield_value=DENSITY * GRAVITY * height / 4.0),
        spacing=l0,
        fluid=mps.fill(mps.Box((-half, 0.0), (half, initial)), l0),
        walls=(mps.Plane((0.0, 0.0), (0.0, 1.0), slip=True),),
        domain=((-2.5 * half, -4 * l0), (2.5 * half, 2.0 * initial)),
        until=10.0,
    )
    sim, times, middles = record(scene, lambda s: middle(s.snapshot()), 5.0)
    for time, heights in zip(times[1:], middles[1:], strict=True):
        exact = height / (1.0 - (1.0 - height / initial) * math.exp(-DENSITY * GRAVITY * height * time / (8.0 * eta)))
        yield Measured(f"height of the middle after {time:g} s", percent(heights.mean(), exact), 3.0, "%")
    yield Measured("its surface, standard deviation", heights.std() / l0, 0.5, "l0")
    yield Measured("speed of sliding", float(sim.snapshot().u[:, 0].mean()), 1e-6, "m/s")


def middle(s) -> np.ndarray:
    """Heights [m] of the top surface over the middle half of a body's width."""
    centre, width = s.x[:, 0].mean(), np.ptp(s.x[:, 0])
    return top_surface(s, np.linspace(centre - 0.25 * width, centre + 0.25 * width, 201)[:, None])
