"""Error against CPU seconds: scheme x spacing x time step, on five flows with a known answer.

    python benchmarks/speed_accuracy.py run [flow ...]   # every point without a result, about 25 CPU-minutes in all
    python benchmarks/speed_accuracy.py draw             # charts into docs/, tables into results/

Every point runs in a process of its own, one thread: five times, particles moved aside by up to 1e-6 spacings at
first, unless the first run does not come to its end. Its error is their mean, with the least and the largest; its CPU
seconds, their mean, are without the first step, which compiles. The
budget of a flow [CPU-s] ends a point that would take hours: it is listed with the time it reached and the cost that
follows from it, and has no error. The answer is always that of the true Bingham material; the semi-implicit schemes and
the bi-viscosity law take the paper's pi_c of 0.1 1/s.
"""

import argparse
import json
import warnings
from dataclasses import replace

import numpy as np
import points

import taichi_mps as mps
from taichi_mps.engine.problem.problem import Problem
from taichi_mps.input import catalogue
from validation import flows, fluids, provenance, slumps, with_wall_particles

LITERAL, PRACTICE, BI_VISCOSITY, BINGHAM = "literal", "semi-implicit", "bi-viscosity", "implicit"
TITLES = {
    BINGHAM: "implicit, true yield stress",
    BI_VISCOSITY: "implicit, bi-viscosity",
    PRACTICE: "semi-implicit",
    LITERAL: "semi-implicit, literal",
}
PI_C = 0.1  # of the paper [1/s]
RUNS = 5  # of a point
# flow: title, error, CPU seconds that a point may take, particles across or spacing [m] from coarse to fine
FLOWS = {
    "cone": ("slump cone, 500 Pa, to 1 s", "worst slump [mm]", 45.0, (0.025, 0.02, 0.0125, 0.01)),
    "block": ("2-D block, 0.1 rho g H, to rest, 30 s at most", "runout [%]", 20.0, (8, 16, 32)),
    "channel": ("Bingham channel, Bn = 0.3, to 1 s", "velocity, L2 [%]", 20.0, (10, 20, 40)),
    "pool": ("still pool, 100 Pa, 2 s", "pressure, mean L2 [%]", 20.0, (5, 10, 20)),
    "dam": ("dam break, water, to 0.26 s", "front, worst [%]", 30.0, (10, 20, 40)),
}


def all_points() -> dict[str, dict]:
    """Points by name, the cheap ones of every flow first. Step: a factor of the default Courant number, diffusion
    number and longest step."""
    found = []
    for flow, (*_, sizes) in FLOWS.items():
        coarse, usual, *_ = sizes
        found += [(k, flow, BINGHAM, size, 1.0) for k, size in enumerate(sizes)]
        found += [(3, flow, BINGHAM, usual, 4.0), (4, flow, BINGHAM, usual, 0.25)]
        if flow != "dam":  # water has no yield stress
            found += [(k, flow, BI_VISCOSITY, size, 1.0) for k, size in enumerate(sizes)]
        found += [(5, flow, LITERAL, coarse, 1.0), (5, flow, LITERAL, usual, 1.0)]
        found += [(6, flow, PRACTICE, coarse, 2.0), (7, flow, PRACTICE, coarse, 1.0), (8, flow, PRACTICE, usual, 1.0)]
    found.sort(key=lambda item: item[0])
    return {
        f"{flow} {scheme} {size:g} x{step:g}": {"flow": flow, "scheme": scheme, "size": size, "step": step}
        for _, flow, scheme, size, step in found
    }


# ---- the flows: scene, what is read of a run and how often [s], and the error by times, values and simulation ------
def cone(spacing):
    """Largest error of the slump [mm] at 0.1, 0.2, 0.3, 0.5, 1 s beside finite elements with inertia (+-0.4 mm)."""
    scene = mps.slump_cone(yield_value=500.0, plastic_viscosity=50.0, spacing=spacing, until=1.0)
    return scene, ("slump_m", 0.1), lambda t, slump, sim: 1e3 * np.abs(slumps.milestone_errors(t, slump, 500.0)).max()


def block(across):
    """Error of the runout [%] beside finite elements without inertia, as in row block_010. The true Bingham body is at
    rest before 30 s; a bi-viscosity body, with pi_c eta = 0.33 tau_y, flows on and on."""
    scene = slumps.block(0.1, across)
    scene = replace(scene, until=30.0, domain=((-1.0, scene.domain[0][1]), (1.0, scene.domain[1][1])))
    return scene, None, lambda t, values, sim: abs(slumps.runout_error(0.1, sim.snapshot()))


def channel(across):
    """Relative L2 error of the velocity [%] after 1 s, 8.7 rho H^2/eta, beside the closed form."""
    scene, exact = flows.channel(across)

    def error(t, values, sim):
        s = sim.snapshot()
        return 100.0 * flows.l2(s.u[:, 0], exact(s.x[:, 1]))

    return replace(scene, until=1.0), None, error


def pool(layers):
    """Error of the pressure over rho g H [%], mean over 2 s."""
    mix = dict(density=2300.0, plastic_viscosity=50.0, yield_value=100.0)
    scene = catalogue.build("still_pool", spacing=0.2 / layers, until=2.0, **mix)
    return scene, ("pressure_error", 0.1), lambda t, errors, sim: 100.0 * np.mean(errors[1:])


def dam(across):
    """Largest error of the front [%] beside Martin and Moyce, whose gate opened 0.25 sqrt(a/2g) late."""
    scene = catalogue.build("dam_break", until=0.26, spacing=fluids.COLUMN / across)
    return scene, ("front_m", 0.01), lambda t, front, sim: 100.0 * fluids.front_errors(t, front)[0](0.25)


SCENES = {function.__name__: function for function in (cone, block, channel, pool, dam)}


# ---- one point -------------------------------------------------------------------------------------------------
def numerics_of(scheme, step, scene):
    """The defaults of a scheme with every limit of the time step multiplied by ``step``."""
    if scheme in (LITERAL, PRACTICE):
        bounds = {"courant_number": 0.2 * step, "diffusion_number": 0.2 * step}
        return mps.SemiImplicit(literal=scheme == LITERAL, **bounds)
    if step == 1.0:
        return mps.Implicit()
    return mps.Implicit(courant_number=0.2 * step, max_time_step=min(1.0, step) * Problem(scene).time_step.longest)


def point(flow, scheme, size, step) -> dict:
    """Run one point: its errors if it came to its end, its CPU seconds, and what ended it."""
    warnings.simplefilter("ignore")  # a knee stress above the yield stress is what is measured here
    mps.init(threads=1)
    runs = [one_run(flow, scheme, size, step, 0)]
    while runs[-1]["error"] is not None and len(runs) < RUNS:
        runs.append(one_run(flow, scheme, size, step, len(runs)))
    if len(runs) < RUNS:
        return runs[-1]
    errors = [run["error"] for run in runs]
    cost = round(float(np.mean([run["cpu_seconds"] for run in runs])), 3)
    return runs[0] | {"error": float(np.mean(errors)), "errors": errors, "cpu_seconds": cost}


def one_run(flow, scheme, size, step, seed) -> dict:
    """Run a point once."""
    budget = FLOWS[flow][2]
    scene, reading, error = SCENES[flow](size)
    scene = replace(scene, fluid=scene.fluid + points.aside(scene.fluid.shape, scene.spacing, seed))
    if scheme != BINGHAM and scene.material.yield_value:
        scene = replace(scene, material=mps.Bingham(**(scene.material.model_dump() | {"critical_strain_rate": PI_C})))
    if scheme in (LITERAL, PRACTICE):  # not stopped at nine tenths unyielded: it is the flow that is compared
        scene = replace(scene if scene.wall_particles is not None else with_wall_particles(scene), stop_at_rest=False)
    sim, read = mps.Simulation(scene, numerics_of(scheme, step, scene)), []
    if (
        scheme not in (LITERAL, PRACTICE) and step > 1.0
    ):  # longer than the engine takes by itself, which no limit asks for
        sim.scheme.constants.time_step.longest *= step
    if reading:
        measure, interval = reading
        sim.every(interval, lambda s: read.append((s.time, s.measures()[measure])))
    sim.each_step(lambda s: s.interrupt() if s.cpu_seconds > budget else None)
    try:
        fate = sim.run()
    except mps.DivergedError as failure:
        fate = str(failure).split(";")[0]
    finished = fate in ("time", "rest")
    value = float(error(*np.reshape(read, (-1, 2)).T, sim)) if finished else np.nan
    return {
        "finished": finished,
        "fate": fate,
        "error": value if np.isfinite(value) else None,
        "cpu_seconds": round(sim.cpu_seconds, 3),
        "budget": budget,
        "reached": round(sim.time, 6),
        "until": round(scene.until, 3),
        "steps": sim.steps,
        "particles": len(scene.fluid),
        "spacing": scene.spacing,
    }


# ---- drawing ---------------------------------------------------------------------------------------------------
STYLE = {
    BINGHAM: ("o", "#0072B2"),
    BI_VISCOSITY: ("s", "#E69F00"),
    PRACTICE: ("^", "#009E73"),
    LITERAL: ("v", "#CC79A7"),
}


def front(found: list[dict]) -> list[dict]:
    """Points that no other beats in both cost and error, by cost."""
    best, out = np.inf, []
    for item in sorted(found, key=lambda p: (p["cpu_seconds"], p["error"])):
        if item["error"] < best:
            best = item["error"]
            out.append(item)
    return out


def label(item) -> str:
    size = f"{1e3 * item['spacing']:.3g} mm" if item["flow"] == "cone" else f"{item['size']:g}"
    return size + {0.25: ", step/4", 4.0: ", step x4", 2.0: ", step x2"}.get(item["step"], "")


def draw_flow(flow, found) -> None:
    plt, (title, unit, *_) = points.pyplot(), FLOWS[flow]
    done = [item for item in found if item["error"] is not None]
    figure, axis = plt.subplots(figsize=(7.2, 5.0), layout="constrained")
    top = 2.5 * max(item["error"] for item in done)
    for scheme, (marker, colour) in STYLE.items():
        mine = [item for item in done if item["scheme"] == scheme]
        axis.plot([i["cpu_seconds"] for i in mine], [i["error"] for i in mine], marker, color=colour, ms=8, ls="none",
                  label=TITLES[scheme])  # fmt: skip
        for item in mine:
            errors = item.get("errors", [item["error"]])
            axis.plot([item["cpu_seconds"]] * 2, [min(errors), max(errors)], "-", color=colour, lw=3, alpha=0.5)
            at = (item["cpu_seconds"], item["error"])
            place, side = ((6, 4), "left") if item["step"] == 1.0 else ((0, -13), "center")
            axis.annotate(label(item), at, xytext=place, ha=side, textcoords="offset points", fontsize=7.5)
        for item in (i for i in found if i["scheme"] == scheme and i["error"] is None):
            diverged = item["fate"].startswith("diverged")
            cost = item["cpu_seconds"] if diverged else cost_of(item)
            axis.plot(cost, top, "x" if diverged else marker, color=colour, mfc="none", ms=8, clip_on=False)
    best = front(done)
    axis.plot([i["cpu_seconds"] for i in best], [i["error"] for i in best], "-", color="k", lw=1, zorder=0,
              label="best front")  # fmt: skip
    axis.axhspan(top / 1.35, 1.35 * top, color="0.92", zorder=-1)
    given = "spacing" if flow == "cone" else "particles across"
    axis.text(0.01, 0.985, f"labels: {given}.   Grey: x failed; hollow: did not finish, cost extrapolated",
              transform=axis.transAxes, fontsize=7.5, va="top")  # fmt: skip
    axis.set(xscale="log", yscale="log", xlabel="CPU seconds, one thread", ylabel=f"error: {unit}", title=title)
    axis.set_ylim(0.7 * min(item["error"] for item in done), 1.9 * top)
    axis.set_xlim(left=0.25 * min(item["cpu_seconds"] for item in done))
    axis.grid(alpha=0.3, which="both", lw=0.5)
    points.set_log_ticks(axis)
    figure.legend(fontsize=7.5, loc="outside lower center", ncols=2, frameon=False)
    figure.savefig(points.FIGURES / f"speed_accuracy_{flow}.png", dpi=110)
    plt.close(figure)


def cost_of(item) -> float:
    """CPU seconds to the end: measured if it got there, extrapolated from the share it did if not."""
    return item["cpu_seconds"] * (1.0 if item["finished"] else item["until"] / max(item["reached"], 1e-12))


def cells(item) -> list:
    """Cells of one line of the table."""
    unit = FLOWS[item["flow"]][1].split("[")[1][:-1]
    size = f"{1e3 * item['spacing']:.3g} mm" if item["flow"] == "cone" else f"{item['size']:g} across"
    cost, error = f"{item['cpu_seconds']:.2g}", "-"
    if item["error"] is not None:
        error = f"{item['error']:.2g} {unit}"
        if errors := item.get("errors"):
            error += f" ({min(errors):.2g} to {max(errors):.2g})"
    elif item["fate"].startswith("diverged"):
        error = f"failed: {item['fate']}"
    else:
        error = f"did not finish, reached t = {item['reached']:.2g} of {item['until']:.2g} s"
        cost = f"{cost:s}; extrapolated {cost_of(item):.1e}"
    return [TITLES[item["scheme"]], size, f"{item['step']:g}", item["steps"], cost, error]


def draw() -> None:
    text, tables, order = [], [], list(TITLES)
    for flow, (title, *_) in FLOWS.items():
        wanted = [key for key, settings in all_points().items() if settings["flow"] == flow]
        found = [item for key, item in points.read(f"speed_accuracy_{flow}").items() if key in wanted]
        done = [item for item in found if item["error"] is not None]
        draw_flow(flow, found)
        heading, best = (
            f"### {title[0].upper()}{title[1:]}",
            [f"{TITLES[i['scheme']]}, {label(i)}" for i in front(done)],
        )
        picture = f"![{title}](figures/speed_accuracy_{flow}.png)\n"
        picture += "*Error against CPU-seconds (`python benchmarks/speed_accuracy.py draw`).*"
        text += [heading, picture, f"Best front, from cheap to accurate: {'; '.join(best)}."]
        found.sort(key=lambda i: (order.index(i["scheme"]), -i["spacing"], i["step"]))
        head = ["scheme", "resolution", "step", "steps", "CPU-s", "error"]
        tables += [heading, points.table(head, [cells(item) for item in found])]
    results = [points.load(f"speed_accuracy_{flow}") for flow in FLOWS]
    points.put("speed.md", "speed_accuracy", "\n\n".join(text), results)
    about = "Written by `python benchmarks/speed_accuracy.py draw`; the charts stand in docs/speed.md."
    (points.RESULTS / "speed_accuracy.md").write_text("\n\n".join([about, *tables, provenance.origin(results)]) + "\n")


def run(flows: list[str]) -> None:
    """Run every point of these flows without a result."""
    for flow in flows:
        mine = {key: settings for key, settings in all_points().items() if settings["flow"] == flow}
        points.run(__file__, f"speed_accuracy_{flow}", mine)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("run", "draw", "point"))
    parser.add_argument("names", nargs="*", help=f"flows, by default all: {', '.join(FLOWS)}")
    arguments = parser.parse_args()
    if arguments.what == "run":
        run(arguments.names or list(FLOWS))
    elif arguments.what == "draw":
        draw()
    else:
        print(json.dumps(point(**json.loads(arguments.names[0]))))
