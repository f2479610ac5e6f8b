"""The validation table: every row as data, in its order."""

import taichi_mps as mps

from . import Row, curved, flows, fluids, grains, measured, slumps, standing, vortices
from .standing import HEIGHT

CLOSED = "closed form"
SPIN = "omega R^2/nu = 1, over 0.1 R^2/nu; again with the time step capped to 200 steps"
PIPE = "circular pipe, R = 0.05 m, 20 across, 50 Pa s"
REINER = "B_pipe_buckingham_reiner.csv and closed form"
COUETTE = "circular Couette flow, inner cylinder of 0.05 m turning in one of 0.1 m, 20 across, 50 Pa s"
RIWLIN = "B_taylor_couette.csv and closed form"
STOPPED = "time step capped to T_stop/200; stopped: max speed < 1e-3 V"
THRESHOLD = "B_fe_initial_velocity_threshold.csv"
GHIA = "own solution beside Ghia et al. (1982)"
KRIEGER, CHATEAU, HOLDS = (
    "Krieger and Dougherty (1959), phi_m = 0.64",
    "Chateau, Ovarlez and Trung (2008), phi_m = 0.57",
    "held above 0.0477 (Beris et al. 1985), 1/18 (Roussel 2006, from memory)",
)
INERTIAL, INERTIALESS = "finite elements with inertia", "finite elements without inertia"
ARRESTED = f"{INERTIAL}: it stands at tau_y; {INERTIALESS}: below which it flows"


def collapse(tau_y, spacing=0.01, model="full", quick=False) -> Row:
    """slump_<tau_y>, _coarse at 20 mm and _fine at 5 mm, with the model's name if reduced."""
    fineness, target = {0.02: ("_coarse", 10.0), 0.01: ("", 5.0), 0.005: ("_fine", 3.0)}[spacing]
    reduced = "" if model == "full" else f"_{model}"
    case = f"slump cone, tau_y = {tau_y:g} Pa, eta = 50 Pa s, l0 = {1e3 * spacing:g} mm{reduced.replace('_', ', ')}"
    settings = {"tau_y": tau_y, "spacing": spacing, "model": model, "slump_target": target}
    return Row(f"slump_{tau_y:g}{fineness}{reduced}", case, INERTIAL, slumps.collapse, settings, quick)


TABLE = [
    # ---- flows.py ----
    Row("film_newtonian", "Newtonian film on 10 degrees, H = 0.1 m, 100 Pa s, after 2 s", CLOSED,
        flows.film_orders, {"bingham_number": 0.0}),
    Row("film_bingham_02", "Bingham film, the same, tau_y = 0.2 rho g sin H", CLOSED,
        flows.film_orders, {"bingham_number": 0.2}),
    Row("film_bingham_05", "Bingham film, the same, tau_y = 0.5 rho g sin H", CLOSED,
        flows.film_orders, {"bingham_number": 0.5}),
    Row("film_bi_viscosity",
        "bi-viscosity film, H = 0.05 m, 50 Pa s, 100 Pa, 2 pi_c = 0.2 1/s, 8000 and 4000 Pa/m, after 2 s",
        "B_poiseuille_bingham_biviscosity.csv and closed form", flows.film_bi_viscosity),
    Row("film_at_yield", "Bingham film with a wall stress of 0.95 and 1.05 tau_y, 20 and 40 across, 100 Pa s", CLOSED,
        flows.film_at_yield),
    Row("channel_bingham",
        "Bingham channel between two no-slip walls 0.1 m apart, 50 Pa s, tau_y = 0.3 of the wall stress, after 2 s",
        CLOSED, flows.channel_bingham),
    Row("couette", "plane Couette under a moving wall (0.2 m/s), Newtonian, gap 0.1 m, 50 Pa s, after 1 s", CLOSED,
        flows.couette, quick=True),
    Row("cessation_channel", f"cessation of channel flow, 20 across the half width; {STOPPED}",
        "B_cessation_summary.csv", flows.cessation, {"flow": "poiseuille"}),
    Row("cessation_couette", f"cessation of Couette flow, 20 across the gap; {STOPPED}",
        "B_cessation_summary.csv", flows.cessation, {"flow": "couette"}),
    # ---- standing.py, fluids.py ----
    Row("column_plane", "plane column, width = H = 0.3 m, 20 across: stands when its top sinks < 1 mm/s after 0.3 s",
        THRESHOLD, standing.threshold,
        {"reference": "plane X=0.5", "solid": mps.Box((-0.15, 0.0), (0.15, HEIGHT)), "across": 20}),
    Row("column_cylinder", "cylinder, R = H/2, H = 0.3 m = 14 l0: the same rule",
        THRESHOLD, standing.threshold,
        {"reference": "cylinder R=H/2", "solid": mps.Cone(0.15, 0.15, HEIGHT), "across": 14}),
    Row("column_cone", "Abrams cone, H = 0.3 m = 20 l0: the same rule",
        THRESHOLD, standing.threshold,
        {"reference": "abrams cone", "solid": mps.Cone(0.1, 0.05, HEIGHT), "across": 20}),
    Row("rotating_disc", f"free spinning Newtonian disc, R = 10 l0, {SPIN}", "exact: none is lost",
        fluids.rotation, {"dimension": 2, "across": 10}),
    Row("rotating_sphere", f"free spinning Newtonian sphere, R = 6 l0, {SPIN}", "exact: none is lost",
        fluids.rotation, {"dimension": 3, "across": 6}),
    # ---- curved.py ----
    Row("pipe_newtonian", f"{PIPE}, Newtonian, 8000 Pa/m, after 1 s", CLOSED,
        curved.from_fillings, {"flow": curved.pipe, "push": 8000.0, "tau_y": 0.0, "until": 1.0}),
    Row("pipe_bingham_05", f"{PIPE}, 100 Pa, 8000 Pa/m (plug of R/2), after 1 s", REINER,
        curved.from_fillings, {"flow": curved.pipe, "push": 8000.0, "tau_y": 100.0, "until": 1.0}),
    Row("pipe_bingham_02", f"{PIPE}, 100 Pa, 20000 Pa/m (plug of R/5), after 0.5 s", REINER,
        curved.from_fillings, {"flow": curved.pipe, "push": 20000.0, "tau_y": 100.0, "until": 0.5}),
    Row("circular_couette_newtonian", f"{COUETTE}, Newtonian, 1 rad/s, after 1 s", CLOSED,
        curved.from_fillings, {"flow": curved.couette, "turn": 1.0, "tau_y": 0.0, "until": 1.0}),
    Row("circular_couette_bingham_1", f"{COUETTE}, 100 Pa, 1 rad/s (rigid beyond 0.0887 m), after 1 s", RIWLIN,
        curved.from_fillings, {"flow": curved.couette, "turn": 1.0, "tau_y": 100.0, "until": 1.0}),
    Row("circular_couette_bingham_5", f"{COUETTE}, 100 Pa, 5 rad/s (all yielded), after 0.3 s", RIWLIN,
        curved.from_fillings, {"flow": curved.couette, "turn": 5.0, "tau_y": 100.0, "until": 0.3}),
    # ---- fluids.py, vortices.py ----
    Row("still_pool_water", "still pool of water, 10 layers, 100 s", "hydrostatic pressure", fluids.still_pool),
    Row("still_pool_concrete", "still pool of concrete (100 Pa, 50 Pa s), 10 layers, 100 s", "hydrostatic pressure",
        fluids.still_pool, {"density": 2300.0, "plastic_viscosity": 50.0, "yield_value": 100.0}),
    Row("dam_break_front", "dam break, a = 0.146 m, a/l0 = 20",
        "Martin and Moyce (1952), a = 2.25 in, digitised +-0.05", fluids.dam_break_front, quick=True),
    Row("dam_break_pressure", "dam break, H = 0.6 m, H/l0 = 30: pressure at the far wall, sensor at 160 mm",
        "Buchner (2002), digitised", fluids.dam_break_pressure),
    Row("measured_dam_breaks",
        "dam breaks of 4 fluids from an open box, law by their rheometer's curves, l0 = 2 mm, front after 1/3 s",
        "measured (Hamamichi et al. 2023)", measured.dam_breaks, {"spacing": 0.002}),
    Row("elliptical_drop", "elliptical drop, R/l0 = 25, to A0 t = 1", "Monaghan (1994), exact", fluids.elliptical_drop),
    Row("square_patch", "rotating square patch, L/l0 = 40, to w t = 2", "boundary elements (own)",
        fluids.square_patch, {"across": 40}),
    Row("square_patch_fine", "rotating square patch, L/l0 = 60, to w t = 2", "boundary elements (own)",
        fluids.square_patch, {"across": 60}),
    Row("cavity_100", "lid-driven cavity, Re = 100, 40 across", GHIA,
        vortices.cavity, {"reynolds": 100, "until": 15.0, "good": 0.01}),
    Row("cavity_400", "lid-driven cavity, Re = 400, 40 across", GHIA,
        vortices.cavity, {"reynolds": 400, "until": 30.0, "good": 0.03}),
    Row("cavity_100_fine", "lid-driven cavity, Re = 100, 100 across", GHIA,
        vortices.cavity, {"reynolds": 100, "until": 15.0, "good": 0.01, "across": 100}),
    Row("cavity_400_fine", "lid-driven cavity, Re = 400, 100 across", GHIA,
        vortices.cavity, {"reynolds": 400, "until": 30.0, "good": 0.03, "across": 100}),
    # ---- grains.py ----
    Row("sphere_held", "a sphere 8 across, 16 mm, in a closed box of 2.5 diameters, no-slip, 20 Pa s, 2 s; creep, 5 s",
        "Beris et al. (1985): 2 tau_y pi a^2/F = 0.143", grains.held, {"across": 8}),
    Row("suspension_dilute", "one sphere in a cube of four diameters in shear between plates, Newtonian",
        "Einstein (1906): 1 + 2.5 phi; unbounded", grains.dilute, {"across": (4, 6, 8)}),
    Row("suspension", "spheres 4 across in a cube of six diameters in shear between plates, Newtonian, strain 1",
        KRIEGER, grains.suspensions, {"across": 4, "fractions": (0.1, 0.2, 0.3), "strain": 1.0, "seeds": 1}),
    *(
        Row(f"suspension_fine_{100 * fraction:.0f}", f"suspension 6 across in the same cube, {fraction:g}",
            KRIEGER, grains.suspensions, {"across": 6, "fractions": (fraction,)})
        for fraction in (0.1, 0.2, 0.3)
    ),
    Row("suspension_placings", "suspension 4 across at 0.3, cube of three diameters, strain 1, moved, in other rows",
        "the same, five seeds", grains.placings, {"seeds": 5}),
    Row("suspension_yield", "suspension 4 across in the same cube, a yield stress of 100 times the viscous stress",
        CHATEAU, grains.suspensions,
        {"across": 4, "fractions": (0.1, 0.2, 0.3), "strain": 1.0, "seeds": 1, "law": grains.YIELDING}),
    *(
        Row(f"suspension_yield_fine_{100 * fraction:.0f}", f"suspension with that yield stress, 6 across, {fraction:g}",
            CHATEAU, grains.suspensions, {"across": 6, "fractions": (fraction,), "law": grains.YIELDING})
        for fraction in (0.1, 0.2, 0.3)
    ),
    Row("dry_column", "quarter of a column of dry spheres 4 across, 6 diameters in radius, friction 0.5, to 1 s",
        "Lube et al. (2004): 1.24 times the aspect ratio, below 1.7", grains.dry_column, {"wide": 6, "seeds": 3}),
    Row("dry_column_narrow", "the same, 4 diameters in radius",
        "Lube et al. (2004), much narrower than theirs", grains.dry_column, {"wide": 4, "seeds": 3}),
    Row("dry_column_wide", "the same, 9 diameters in radius",
        "Lube et al. (2004), nearer to theirs", grains.dry_column, {"wide": 9, "seeds": 1}),
    Row("segregation_rest", "0.1 x 0.1 x 0.3 m of mortar at rest, 1 Pa s, spheres 4 across, 0.1, 0.07 drho g d, 15 min",
        HOLDS, grains.segregation, {"number": 0.07, "until": 900.0, "seeds": 3}),
    Row("segregation_rest_near", "the same, 0.05 drho g d: between both bounds",
        HOLDS, grains.segregation, {"number": 0.05, "until": 900.0, "seeds": 3}),
    Row("segregation_soft", "the same, 0.02 drho g d, 20 s", HOLDS, grains.segregation,
        {"number": 0.02, "until": 20.0, "seeds": 3}),
    Row("segregation_sheared", "the same, 0.07 drho g d, sheared at 1/s between two sides, 40 s",
        "a yield stress holds a grain only at rest", grains.segregation,
        {"number": 0.07, "until": 40.0, "seeds": 1, "rate": 1.0}),
    # ---- slumps.py, flows.py ----
    *(collapse(tau_y) for tau_y in (100.0, 300.0, 500.0, 1000.0)),
    collapse(500.0, 0.02),
    collapse(1000.0, 0.02, quick=True),
    *(collapse(tau_y, 0.005) for tau_y in (100.0, 300.0, 500.0)),
    *(
        collapse(tau_y, spacing, model)
        for tau_y in (100.0, 300.0, 500.0, 1000.0)
        for spacing, model in ((0.01, "quarter"), (0.01, "axisymmetric"), (0.005, "axisymmetric"))
    ),
    Row("slump_bi_viscosity_500",
        "slump cone, bi-viscosity (pi_c = 0.1 1/s), tau_y = 500 Pa, eta = 50 Pa s, l0 = 10 mm", INERTIAL,
        slumps.collapse, {"tau_y": 500.0, "until": 1.0, "pi_c": 0.1}),
    Row("slow_slump_300", "slump cone, tau_y = 300 Pa, eta = 1500 Pa s, l0 = 10 mm", INERTIALESS,
        slumps.slow_collapse, {"tau_y": 300.0, "reference": "c300"}),
    Row("slow_slump_500", "slump cone, tau_y = 500 Pa, eta = 1500 Pa s, l0 = 10 mm", INERTIALESS,
        slumps.slow_collapse, {"tau_y": 500.0, "reference": "c500fine"}),
    Row("slow_slump_1000", "slump cone, tau_y = 1000 Pa, eta = 1500 Pa s, l0 = 10 mm", INERTIALESS,
        slumps.slow_collapse, {"tau_y": 1000.0, "reference": "c1000"}),
    Row("slump_viscosity", "slump cone, tau_y = 100 Pa: eta = 50 against 1500 Pa s",
        "one rest slump for both, Tomiyama et al. (2009) #4, #5", slumps.two_viscosities),
    Row("spread_time", "slump flow, tau_y = 50 Pa, eta = 1000 Pa s, l0 = 10 mm", INERTIALESS,
        slumps.time_to_spread, {"spacing": 0.01}),
    Row("spread_time_fine", "slump flow, tau_y = 50 Pa, eta = 1000 Pa s, l0 = 5 mm, axisymmetric", INERTIALESS,
        slumps.time_to_spread, {"spacing": 0.005, "model": "axisymmetric"}),
    Row("block_005", "2-D block of half width H, tau_y = 0.05 rho g H, l0 = H/40", INERTIALESS,
        slumps.block_at_rest, {"number": 0.05}),
    Row("block_010", "2-D block of half width H, tau_y = 0.1 rho g H, l0 = H/40", INERTIALESS,
        slumps.block_at_rest, {"number": 0.1}),
    Row("stretched_block", "2-D block on a frictionless floor, from 1.6 to 1.06 of its final height, l0 = H/10",
        "balance of forces", slumps.stretched_block, quick=True),
    Row("rational_film",
        "film on 10 degrees, H = 0.1 m, 100 Pa s, 20 across, bi-viscosity at the rational pi_c (1 %, T = 2 s), after T",
        f"{CLOSED}, true Bingham", flows.rational_film),
    Row("film_viscosity_ratio",
        "bi-viscosity film, the same, viscosity ratio 1e6, tau_y = 0.3 of the wall stress, after 2 s", CLOSED,
        flows.film_viscosity_ratio),
    Row("rational_slump_500",
        "slump cone, tau_y = 500 Pa, eta = 50 Pa s, l0 = 10 mm, bi-viscosity at the rational pi_c (1 %, T = 5 s)",
        f"{INERTIAL}, true Bingham", slumps.rational_slump),
    # ---- standing.py, vortices.py, flows.py ----
    Row("standing_ordered", "arrested slumps, filled with a lattice", ARRESTED,
        standing.arrested, {"fill": standing.jittered, "size": 0.0}),
    Row("standing_disordered", "arrested slumps, filled with disordered particles at even distances", ARRESTED,
        standing.arrested, {"fill": standing.relaxed}),
    Row("standing_jittered", "arrested slumps, filled with a lattice jittered by 0.3 l0",
        f"{INERTIAL}: it stands at tau_y",
        standing.arrested, {"fill": standing.jittered, "below": False, "size": 0.3}),
    Row("taylor_green", "Taylor-Green vortices, Re = 100, 50 across, both axes periodic, to t U/L = 1", "exact decay",
        vortices.taylor_green),
    Row("standing_wave", "standing wave, Re = 250, lambda/l0 = 100, amplitude 0.8 l0, slip walls, three periods",
        "Prosperetti (1981)", vortices.standing_wave),
    Row("cavity_bingham", "lid-driven Bingham cavity, Re = 1, 40 across, Bn = 2 to 50", "own finite elements (Re = 0)",
        vortices.bingham_cavities, {"bingham_numbers": (2.0, 5.0, 10.0, 20.0, 50.0)}),
    Row("cavity_bingham_fine", "lid-driven Bingham cavity, Re = 1, 80 across, Bn = 2 and 20",
        "own finite elements (Re = 0)",
        vortices.bingham_cavities, {"bingham_numbers": (2.0, 20.0), "across": 80}),
    Row("order_in_time",
        "start-up of channel flow, 20 across the half width H, time step T/25, T/50, T/100, T = rho H^2/eta",
        "B_startup_poiseuille.csv", flows.order_in_time),
]  # fmt: skip
ROWS = {row.name: row for row in TABLE}

# constants that were chosen on what a row measures, as docs/theory/constants.md tells: there it is calibration
CHOSEN_ON = {
    "film_at_yield": ("REDUCTION", "EARLY_REDUCTION", "SMOOTHING_SCALE", "MIN_BOND_RATE", "STILL"),
    "order_in_time": ("REDUCTION", "EARLY_REDUCTION"),
    "cessation_channel": ("Implicit.passes", "PENALTY"),
    "channel_bingham": ("COMPRESSION",),
    "cavity_bingham": ("COMPRESSION", "MIN_BOND_STRAIN"),
    "cavity_bingham_fine": ("COMPRESSION", "MIN_BOND_STRAIN"),
    "still_pool_concrete": ("FIRST_ITERATIONS", "VISCOUS_ITERATIONS", "STIFFNESS", "OUTPUT_SMOOTHING"),
    "still_pool_water": ("STIFFNESS", "OUTPUT_SMOOTHING", "REST_FACTOR", "MOVING_STRAIN"),
    "standing_wave": ("STIFFNESS",),
    "square_patch": ("INERTIAL",),
    "square_patch_fine": ("TENSION_FACTOR",),
    "taylor_green": ("INERTIAL", "PERTURBATION"),
    "block_010": ("SHIFT_COEFFICIENT", "TENSION_SHIFT_COEFFICIENT"),
    "stretched_block": ("SHIFT_COEFFICIENT", "TENSION_SHIFT_COEFFICIENT"),
    "standing_jittered": ("RELAXATION_SHIFTS",),
}


def chosen_on_cone(tau_y, model, **_) -> tuple[str, ...]:
    """The constants of a row of slumps.collapse."""
    rings = model == "axisymmetric"
    chosen = {
        "RING_CORRECTION_RATE" if rings else "CORRECTION_RATE": True,
        "PACKING": True,
        "VISCOUS_CORRECTION_RATE": tau_y in (100.0, 500.0),
        "DIFFUSION_SCALE": tau_y in (100.0, 500.0),
        "MAX_SHEAR_FRACTION": tau_y <= 500.0 and rings,
        "CREEP": tau_y == 100.0,
        "MIN_BOND_RATE": tau_y in (100.0, 300.0) and rings,
    }
    return tuple(name for name, is_so in chosen.items() if is_so)


OF_CONES = [row for row in TABLE if row.function is slumps.collapse and "pi_c" not in row.settings]
CHOSEN_ON |= {row.name: chosen_on_cone(**row.settings) for row in OF_CONES}
