"""Rows of bodies that slump under their own weight: the slump cone, the time to spread, a block in two dimensions.

The references are finite elements of a true Bingham material on a no-slip floor (own solutions; the comment lines
of each CSV say how they were made). Slump is read over r < 20 mm and spread in all directions, by ``measure.slump``.
Errors are engine - reference, with their sign; of several, the largest by magnitude.
"""

import math

import numpy as np

import taichi_mps as mps

from ..problem import catalogue
from . import SLUMP_ERROR, Measured, Series, read_reference, row
from .scheme import simulate

MILESTONES = (0.1, 0.2, 0.3, 0.5, 1.0)  # [s]
DENSITY, GRAVITY = 2300.0, 9.81  # [kg/m3], [m/s2]
INERTIAL = "finite elements with inertia"
INERTIALESS = "finite elements without inertia"


# ---- running and measuring -------------------------------------------------------------------------------------
def cone(**keywords) -> mps.Scene:
    """The scene scenes/slump.py with these keywords (yield_value [Pa], plastic_viscosity [Pa s], spacing [m], ...)."""
    return catalogue.load("slump")(**keywords)


def follow(scene: mps.Scene, interval: float | None = None):
    """Run a scene to its end: simulation, rows of (time [s], measures [m]) every ``interval`` [s], largest volume
    error [-]. The last row is the end."""
    sim = simulate(scene)
    rows, volume = [], [0.0]
    if interval:
        sim.every(interval, lambda s: rows.append((s.time, *s.measures().values())))
    sim.each_step(lambda s: volume.append(abs(s.report.volume_error)))
    sim.run()
    return sim, np.array(rows), max(volume)


def moment(sim) -> str:
    """When a run ended, in words: at rest, or at its last time [s]."""
    return "at rest" if sim.stopped_by == "rest" else f"at {sim.time:g} s"


def largest(errors) -> float:
    """The one of largest magnitude, with its sign; nan if one is."""
    errors = np.asarray(errors, float)
    return float("nan") if np.isnan(errors).any() else float(errors[np.argmax(np.abs(errors))])


def percent(value: float, exact: float) -> float:
    """Relative error [%]."""
    return 100.0 * (value / exact - 1.0)


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


def inertial(file: str, tau_y: float, model: str, rate: float) -> list[dict[str, str]]:
    """Lines of the finite elements with inertia, eta = 50 Pa s; file: summary or shapes; rate: gc of model B [1/s]."""
    lines = read_reference(f"A_fe_inertial_slump_{file}.csv")
    wanted = (model, tau_y, 50.0, rate)
    return [r for r in lines if (r["model"], *(float(r[k]) for k in ("tau_Pa", "eta_Pa_s", "gc_1_s"))) == wanted]


def final_shape(tau_y: float) -> np.ndarray:
    """(r, z) [m] of the true Bingham body at the end, from the contact line to the axis."""
    return np.array([(float(r["r_m"]), float(r["z_m"])) for r in inertial("shapes", tau_y, "A", 0.0)])


# ---- the cone with inertia -------------------------------------------------------------------------------------
def collapse(tau_y, until=5.0, spacing=0.01, pi_c=None, slump_target=5.0, model="full"):
    """Slump at the milestones and at the end, spread, shape and volume of a collapse with eta = 50 Pa s."""
    lines = inertial("summary", tau_y, "B" if pi_c else "A", 2.0 * (pi_c or 0.0))
    fixed = [r for r in lines if not r["kind"].startswith("final") and float(r["time_s"]) <= until]
    exact = {float(r["time_s"]): (1e-3 * float(r["mean20_mm"]), 1e-3 * float(r["spread_mm"])) for r in fixed}
    mix = {"yield_value": tau_y, "plastic_viscosity": 50.0, "critical_strain_rate": pi_c}
    scene = cone(**mix, spacing=spacing, until=until, model=model)
    sim, history, worst = follow(scene, 0.1)
    slumps = np.interp(MILESTONES, history[:, 0], history[:, 1])
    end_slump, end_spread = exact[max(exact)]
    errors = [slump - exact[t][0] for t, slump in zip(MILESTONES, slumps, strict=True)]
    last = moment(sim)
    if pi_c is None and model == "full":
        worst_slump = abs(largest([*errors, history[-1, 1] - end_slump]))
        yield Series(SLUMP_ERROR, f"{tau_y:g} Pa", (1e3 * spacing,), (1e3 * worst_slump,))
    yield Measured("slump, worst of t = 0.1, 0.2, 0.3, 0.5, 1 s", 1e3 * largest(errors), slump_target, "mm")
    yield Measured(f"slump {last}", 1e3 * (history[-1, 1] - end_slump), slump_target, "mm")
    yield Measured(f"spread {last}", percent(history[-1, 3], end_spread), 3.0, "%")
    if pi_c is None:
        yield Measured(
            f"surface {last}", 1e3 * shape_error(scene.unfold(sim.snapshot()), final_shape(tau_y)), 1e3 * spacing, "mm"
        )
    yield Measured("volume at all times", 100.0 * worst, 1.0, "%")
    yield Measured(f"volume {last}", 100.0 * sim.report.volume_error, 0.5, "%")


def collapse_row(tau_y, spacing=0.01, model="full", quick=False):
    """Register a collapse as slump_<tau_y>, _coarse at 20 mm and _fine at 5 mm, with the model's name if reduced."""
    fineness, target = {0.02: ("_coarse", 10.0), 0.01: ("", 5.0), 0.005: ("_fine", 3.0)}[spacing]
    reduced = "" if model == "full" else f"_{model}"
    case = f"slump cone, tau_y = {tau_y:g} Pa, eta = 50 Pa s, l0 = {1e3 * spacing:g} mm{reduced.replace('_', ', ')}"

    @row(case, INERTIAL, quick, name=f"slump_{tau_y:g}{fineness}{reduced}")
    def run():
        yield from collapse(tau_y, spacing=spacing, model=model, slump_target=target)


for tau in (100.0, 300.0, 500.0, 1000.0):
    collapse_row(tau)
for tau in (500.0, 1000.0):
    collapse_row(tau, 0.02, quick=tau == 1000.0)
for tau in (100.0, 300.0, 500.0):
    collapse_row(tau, 0.005)
for tau in (100.0, 300.0, 500.0, 1000.0):
    collapse_row(tau, model="quarter")
    collapse_row(tau, model="axisymmetric")
    collapse_row(tau, 0.005, "axisymmetric")


@row("slump cone, bi-viscosity (pi_c = 0.1 1/s), tau_y = 500 Pa, eta = 50 Pa s, l0 = 10 mm", INERTIAL)
def slump_bi_viscosity_500():
    yield from collapse(500.0, until=1.0, pi_c=0.1)


# ---- the cone without inertia ----------------------------------------------------------------------------------
def slow_collapse(tau_y, run):
    """Rest slump and spread with eta = 1500 Pa s: Re = rho H sqrt(g H)/eta = 0.8, inertia hardly matters."""
    exact = next(r for r in read_reference("A_fe_slump_abrams_final.csv") if r["run"] == run)
    sim, _, _ = follow(cone(yield_value=tau_y, plastic_viscosity=1500.0, until=60.0))
    found, last = sim.measures(), moment(sim)
    yield Measured(f"slump {last}", 1e3 * found["slump_m"] - float(exact["slump_mm"]), 5.0, "mm")
    yield Measured(f"spread {last}", percent(1e3 * found["spread_m"], float(exact["spread_diam_mm"])), 3.0, "%")
    yield Measured(f"volume {last}", 100.0 * sim.report.volume_error, 0.5, "%")


@row("slump cone, tau_y = 300 Pa, eta = 1500 Pa s, l0 = 10 mm", INERTIALESS)
def slow_slump_300():
    yield from slow_collapse(300.0, "c300")


@row("slump cone, tau_y = 500 Pa, eta = 1500 Pa s, l0 = 10 mm", INERTIALESS)
def slow_slump_500():
    yield from slow_collapse(500.0, "c500fine")


@row("slump cone, tau_y = 1000 Pa, eta = 1500 Pa s, l0 = 10 mm", INERTIALESS)
def slow_slump_1000():
    yield from slow_collapse(1000.0, "c1000")


@row("slump cone, tau_y = 100 Pa: eta = 50 against 1500 Pa s", "one rest slump for both, Tomiyama et al. (2009) #4, #5")
def slump_viscosity():
    """The slump of 100 Pa hardly depends on inertia: 248.2 mm with it (eta = 50 Pa s, 5 s), 248.7 mm without."""
    fluid, _, _ = follow(cone(yield_value=100.0, plastic_viscosity=50.0, until=20.0))
    thick, _, _ = follow(cone(yield_value=100.0, plastic_viscosity=1500.0, until=200.0))
    apart = thick.measures()["slump_m"] - fluid.measures()["slump_m"]
    yield Measured(f"slump of 1500 Pa s {moment(thick)} less that of 50 Pa s {moment(fluid)}", 1e3 * apart, 3.0, "mm")


def time_to_spread(spacing, model="full"):
    """Time to a spread of 400 and 500 mm; the reference time is proportional to the viscosity."""
    eta = 1000.0
    lines = [r for r in read_reference("A_fe_slump_T500.csv") if float(r["tau0_Pa"]) == 50.0]
    exact = {float(r["D_mm"]): float(r["t_s_mu100"]) * eta / 100.0 for r in lines}
    keywords = {"yield_value": 50.0, "plastic_viscosity": eta, "until": 2.0 * exact[500.0]}
    sim = simulate(cone(**keywords, spacing=spacing, model=model))
    rows = [(0.0, 0.2)]

    def watch(s):
        rows.append((s.time, max(rows[-1][1], s.measures()["spread_m"])))
        if rows[-1][1] > 0.5:
            s.interrupt()

    sim.each_step(watch)
    sim.run()
    times, spreads = np.array(rows).T
    for diameter in (400.0, 500.0):
        found = np.interp(1e-3 * diameter, spreads, times, right=np.nan)  # nan: never got there
        yield Measured(f"time to a spread of {diameter:g} mm", percent(found, exact[diameter]), 5.0, "%")


@row("slump flow, tau_y = 50 Pa, eta = 1000 Pa s, l0 = 10 mm", INERTIALESS)
def spread_time():
    yield from time_to_spread(0.01)


@row("slump flow, tau_y = 50 Pa, eta = 1000 Pa s, l0 = 5 mm, axisymmetric", INERTIALESS)
def spread_time_fine():
    yield from time_to_spread(0.005, "axisymmetric")


# ---- a block in two dimensions ---------------------------------------------------------------------------------
def block(number):
    """Final runout and height at the middle of a block 0.4 m wide and 0.2 m high, B = tau_y/(rho g H) = ``number``.

    eta = 1500 Pa s: Re = rho H sqrt(g H)/eta = 0.4. The runout is the farthest reach + l0/2, the mean of both sides;
    the height is the top surface over |x| < 2 l0.
    """
    height, eta = 0.2, 1500.0
    l0 = height / 40
    exact = next(r for r in read_reference("B_fe_block2d_final.csv") if float(r["B"]) == number)
    body = mps.Box((-height, 0.0), (height, height))
    scene = mps.Scene(
        name=f"block B = {number:g}",
        material=mps.Bingham(density=DENSITY, plastic_viscosity=eta, yield_value=number * DENSITY * GRAVITY * height),
        spacing=l0,
        fluid=mps.fill(body, l0),
        walls=(mps.Plane((0.0, 0.0), (0.0, 1.0)),),
        domain=((-3.5 * height, -4 * l0), (3.5 * height, 1.5 * height)),
        until=1400.0 * eta / (DENSITY * GRAVITY * height),  # when the finite elements stopped (B = 0.05)
        stop_at_rest=True,
    )
    sim, _, _ = follow(scene)
    s = sim.snapshot()
    runout = 0.5 * (np.ptp(s.x[:, 0]) + l0)
    centre = top_surface(s, np.linspace(-2 * l0, 2 * l0, 41)[:, None]).mean()
    yield Measured(f"runout {moment(sim)}", percent(runout, height * float(exact["x_max_final"])), 3.0, "%")
    yield Measured(f"height at the middle {moment(sim)}", percent(centre, height * float(exact["h0_final"])), 3.0, "%")


@row("2-D block of half width H, tau_y = 0.05 rho g H, l0 = H/40", INERTIALESS)
def block_005():
    yield from block(0.05)


@row("2-D block of half width H, tau_y = 0.1 rho g H, l0 = H/40", INERTIALESS)
def block_010():
    yield from block(0.1)


@row(
    "2-D block on a frictionless floor, from 1.6 to 1.06 of its final height, l0 = H/10",
    "balance of forces",
    quick=True,
)
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
    sim, middles = simulate(scene), {}
    sim.every(5.0, lambda s: middles.update({s.time: middle(s.snapshot())}))
    sim.run()
    for time in (5.0, 10.0):
        exact = height / (1.0 - (1.0 - height / initial) * math.exp(-DENSITY * GRAVITY * height * time / (8.0 * eta)))
        yield Measured(f"height of the middle after {time:g} s", percent(middles[time].mean(), exact), 3.0, "%")
    yield Measured("its surface, standard deviation", middles[10.0].std() / l0, 0.5, "l0")
    yield Measured("speed of sliding", float(sim.snapshot().u[:, 0].mean()), 1e-6, "m/s")


def middle(s) -> np.ndarray:
    """Heights [m] of the top surface over the middle half of a body's width."""
    centre, width = s.x[:, 0].mean(), np.ptp(s.x[:, 0])
    return top_surface(s, np.linspace(centre - 0.25 * width, centre + 0.25 * width, 201)[:, None])
