"""The cases and figures of Tomiyama et al. (2009), by one command each.

    python benchmarks/paper_cases.py run             # every case, about 90 CPU-minutes; one JSON each in results/
    python benchmarks/paper_cases.py run implicit-1  # some of them
    python benchmarks/paper_cases.py draw            # docs/figures/paper_*.png and the tables of docs/paper.md

Reference curves: tests/reference/fe_inertial_slump_history.csv (own finite elements, +-0.4 mm).
"""

import subprocess
import sys
from itertools import cycle

import numpy as np
import points

from taichi_mps.study import chart
from validation import columns
from validation.slumps import inertial

FRAMES = points.ROOT / "renders" / "paper"
MILESTONES = (0.05, 0.1, 0.2, 0.3, 0.5, 1.0, 2.0, 5.0)
PICTURES = (0.0, 0.1, 1.0, 5.0)

PAPER = {1: (100.0, 50.0), 2: (300.0, 50.0), 3: (500.0, 50.0), 4: (100.0, 50.0), 5: (100.0, 1500.0)}
CASES = {f"implicit-{k}": dict(scheme="implicit", case=k, until=5.0) for k in PAPER}
CASES["implicit-5"]["until"] = 200.0
CASES["implicit-1"]["until"] = 20.0
CASES |= {f"bi-viscosity-{k}": dict(scheme="implicit", case=k, until=5.0, pi_c=0.1) for k in (1, 2, 3, 5)}
CASES |= {f"semi-implicit-{k}": dict(scheme="semi-implicit", case=k, until=5.0) for k in (1, 2, 3, 5)}  # 4 is 1
CASES |= {f"literal-{k}": dict(scheme="semi-implicit", case=k, until=0.5, numerics=dict(literal=True)) for k in (1, 3)}
YIELD_VALUES = (50.0, 100.0, 200.0, 300.0, 500.0, 750.0, 1000.0, 1500.0)
CASES |= {f"yield-{tau:g}": dict(scheme="implicit", yield_value=tau, until=5.0) for tau in YIELD_VALUES}


def run_case(name):
    """Run one case in this process and write its JSON."""
    import taichi_mps as mps
    from taichi_mps.engine.problem.numerics import NUMERICS

    settings = CASES[name]
    tau_y, eta = PAPER[settings["case"]] if "case" in settings else (settings["yield_value"], 50.0)
    mix = dict(yield_value=tau_y, plastic_viscosity=eta, critical_strain_rate=settings.get("pi_c"))
    mps.init(threads=1)
    scene = mps.slump_cone(**mix, spacing=0.01, until=settings["until"])
    sim = mps.Simulation(scene, NUMERICS[settings["scheme"]](**settings.get("numerics", {})))
    wanted = settings.get("case") in (1, 3) and not name.startswith("bi")
    rows, steps, samples = [], [], {}

    def count(s):
        r = s.report
        steps.append((r.outer_iterations, r.solver_iterations, r.dt, abs(r.volume_error), r.dt_limit))

    def picture(s):
        if wanted and any(abs(s.time - t) < 1e-6 for t in PICTURES):
            mps.png(str(FRAMES / name / f"t{s.time:.1f}"))(s)
        if any(abs(s.time - t) < 1e-6 for t in (0.1, 1.0)):
            samples[f"{s.time:g}"] = np.round(np.quantile(s.snapshot().shear_rate, np.linspace(0, 1, 60)), 5).tolist()

    sim.every(0.1 if settings["until"] > 20 else 0.01, lambda s: rows.append((s.time, *s.measures().values())))
    sim.every(0.1, picture)
    sim.each_step(count)
    error = None
    try:
        sim.run()
    except mps.DivergedError as failure:
        error = str(failure)
    for t in PICTURES if wanted and sim.stopped_by in ("rest", "unyielded") else ():
        if t > sim.time:  # later pictures show the body where it stopped
            mps.png(str(FRAMES / name / f"t{t:.1f}"))(sim)
    time, slump, slump_max, spread = np.array(rows).T[:4]
    viscous, pressure, dt, volume, limits = zip(*steps, strict=True)
    out = {
        "case": name,
        "command": f"python benchmarks/paper_cases.py run {name}",
        "error": error,
        "time_s": time.round(4).tolist(),
        "slump_m": slump.round(5).tolist(),
        "slump_max_m": slump_max.round(5).tolist(),
        "spread_m": spread.round(5).tolist(),
        "dt_s": [min(dt), float(np.median(dt)), max(dt)],
        "dt_limits": {limit: limits.count(limit) for limit in sorted(set(limits))},
        "volume_error": {"worst": max(volume), "end": sim.report.volume_error},
        "mean_viscous_iterations": float(np.mean(viscous)),
        "mean_pressure_iterations": float(np.mean(pressure)),
        "shear_rate_quantiles": samples,
        "summary": sim.summary(),
    }
    if pi_c := settings.get("pi_c") or (0.1 if settings["scheme"] == "semi-implicit" else None):
        out["unyielded_viscosity_Pa_s"] = eta + tau_y / (2.0 * pi_c)
    points.save(f"paper_{name}", out)
    print(f"{name}: slump {1e3 * slump[-1]:.1f} mm, spread {1e3 * spread[-1]:.1f} mm at {sim.time:.2f} s, "
          f"{sim.steps} steps, {sim.cpu_seconds:.1f} CPU-s, {error or sim.stopped_by}")  # fmt: skip


def paper_scheme(case):
    """Name of the run of a case with the paper's scheme: #4 has the numbers of #1."""
    return f"semi-implicit-{1 if case == 4 else case}"


def of_the_papers_scheme(cases) -> dict[str, dict]:
    """Results of these cases with the paper's scheme, by their numbers; without those that have not been run."""
    found = {k: points.load(f"paper_{paper_scheme(k)}") for k in cases}
    return {f"#{k}": found[k] for k in cases if found[k]}


def history(tau_y, eta):
    """Finite elements of the bi-viscosity law, pi_c = 0.1 1/s: times [s] and slumps over r < 20 mm [m]."""
    path = points.ROOT / "tests" / "reference" / "fe_inertial_slump_history.csv"
    known = columns(str(path), model="B", tau_Pa=tau_y, eta_Pa_s=eta, gc_1_s=0.2)
    return known["t_s"], 1e-3 * known["slump_mean_r20_mm"]


def at(result, t, key="slump_m"):
    """Value at time t by interpolation; the last one after a stop at rest; nan where the run did not get there."""
    times = result["time_s"]
    if t > times[-1] + 1e-9 and result["summary"]["stopped_by"] != "rest":
        return float("nan")
    return float(np.interp(t, times, result[key]))


def table(names, pi_c):
    """Markdown: slump of each case at the milestones, the reference beside it."""
    lines = []
    for name in names:
        if result := points.load(f"paper_{name}"):
            s = result["summary"]
            cells = ["-" if np.isnan(v := at(result, t)) else f"{1e3 * v:.1f}" for t in MILESTONES]
            cells.append(f"{1e3 * result['slump_m'][-1]:.1f} at {result['time_s'][-1]:.2f} s")
            cost = f"{s['cpu_seconds']:.0f} ({s['compile_seconds']:.0f})"
            cells += [f"{1e3 * result['spread_m'][-1]:.0f}", s["steps"], cost, result["error"] or s["stopped_by"]]
            times, slumps, spreads = inertial(*PAPER[CASES[name]["case"]], pi_c)
            exact = [f"{1e3 * slump:.1f}" for slump in np.interp(MILESTONES, times, slumps)]
            exact += [f"{1e3 * slumps[-1]:.1f} at 5 s", f"{1e3 * spreads[-1]:.0f} at 5 s", "", "", ""]
            lines += [[name, "engine", *cells], ["", "finite elements", *exact]]
    head = [
        "case",
        "",
        *(f"{t:g} s" for t in MILESTONES),
        "last",
        "slump flow",
        "steps",
        "CPU-s (compile)",
        "stopped by",
    ]
    return points.table(head, lines)


def marks_and_lines(marks, lines, out, mark="o", line="-", **settings):
    """Marks {label: (x, y)}, and lines of the same kind in the colour of the marks of their label, or grey; styles of
    both; settings: of the axes, those of matplotlib."""
    figure, axes = chart._figure(7.0, 4.8)
    colour, grey = dict(zip(marks, cycle(chart.COLOURS), strict=False)), cycle(("--", ":", "-."))
    for label, pair in lines.items():
        if label in marks:
            axes.plot(*pair, line, color=colour[label])
        else:
            axes.plot(*pair, next(grey), color="#555b63", label=label)
    for label, pair in marks.items():
        axes.plot(*pair, mark, ms=5, color=colour[label], mec="white", mew=0.5, label=label, rasterized=True)
    axes.set(**settings)
    axes.legend(loc="best", frameon=False)
    chart._save(figure, out)


def draw():
    """Figures 4-10 of the paper, drawn with its scheme beside ``implicit`` and finite elements, and the tables."""
    import imageio.v3 as imageio

    downwards = {"ylabel": "slump [cm]", "ylim": (26.0, 0.0)}
    for number, cases, scale, first in ((5, (1, 2, 3), "linear", 0.0), (9, (4, 5), "log", 0.01)):
        curves = {n: (r["time_s"], 100.0 * np.array(r["slump_m"])) for n, r in of_the_papers_scheme(cases).items()}
        exact = {f"#{k}": (t, 100.0 * s) for k in cases for t, s in [history(*PAPER[k])]}
        axes = {"xlabel": "time [s]", "xscale": scale, "xlim": (first, 5.0)} | downwards
        marks_and_lines(curves, exact, points.FIGURES / f"paper_fig{number}.png", "-", "--", **axes)
    ends = [(t, points.load(f"paper_yield-{t:g}")) for t in YIELD_VALUES]
    ends = {"implicit, at rest or 5 s": np.array([(t, r["slump_m"][-1]) for t, r in ends if r]).T}
    own = [(PAPER[k][0], *of_the_papers_scheme((k,)).values()) for k in (1, 2, 3)]
    ends["semi-implicit, at its stop or 5 s"] = np.array([(t, r["slump_m"][-1]) for t, *found in own for r in found]).T
    ends["the paper's text"] = np.array([(100.0, 0.25)]).T
    exact = [(t, inertial(t)[1][-1]) for t in (100.0, 300.0, 500.0, 1000.0)]
    known = {"finite elements with inertia": np.array(exact).T}
    empirical = np.linspace(50.0, 1500.0, 60)
    slumps = 1e-2 * (25.5 - 17.6 * empirical / 2300.0)
    known["Roussel (2006), 50-250 mm"] = np.array([empirical, slumps])[:, (slumps > 0.05) & (slumps < 0.25)]
    ends, known = ({name: (t, 100.0 * slump) for name, (t, slump) in found.items()} for found in (ends, known))
    axes = {"xlabel": "yield stress [Pa]", "xlim": (0.0, None)} | downwards
    marks_and_lines(ends, known, points.FIGURES / "paper_fig4.png", **axes)
    for figure, cases in (("paper_fig6", (1, 2, 3)), ("paper_fig10", (4, 5))):
        samples, laws, rate = {}, {}, np.logspace(-2, 1.5, 200)
        for k in cases:
            tau_y, eta = PAPER[k]
            laws[f"#{k}"] = (rate, eta + tau_y / np.maximum(rate, 0.2))  # of pi_c = 0.1 1/s
            for label, source in of_the_papers_scheme((k,)).items():
                rates = np.concatenate([np.array(v) for v in source["shear_rate_quantiles"].values()])
                samples[label] = (rates, eta + tau_y / np.maximum(rates, 0.2))
        axes = {"xscale": "log", "yscale": "log", "xlabel": "shear rate [1/s]", "ylabel": "viscosity [Pa s]"}
        marks_and_lines(samples, laws, points.FIGURES / f"{figure}.png", **axes)
    for figure, name in (("paper_fig7", paper_scheme(1)), ("paper_fig8", paper_scheme(3))):
        frames = [sorted((FRAMES / name / f"t{t:.1f}").glob("*.png"))[-1:] for t in PICTURES]
        pictures = [imageio.imread(file)[::2, ::2] for found in frames for file in found]
        if len(pictures) == 4:
            top, bottom = np.hstack(pictures[:2]), np.hstack(pictures[2:])
            imageio.imwrite(points.FIGURES / f"{figure}.png", np.vstack([top, bottom]))
    explicit = [name for name in CASES if name.startswith(("semi-implicit", "literal"))]
    text = [
        "### True Bingham, scheme `implicit`",
        table([f"implicit-{k}" for k in PAPER], None),
        "### The paper's bi-viscosity law (pi_c = 0.1 1/s), scheme `implicit`",
        table([f"bi-viscosity-{k}" for k in (1, 2, 3, 5)], 0.1),
        "### The paper's scheme: `semi-implicit`",
        table(explicit, 0.1),
        cost_table(explicit),
    ]
    results = [result for name in CASES if (result := points.load(f"paper_{name}"))]
    points.put("paper.md", "paper_cases", "\n\n".join(text), results)


def cost_table(names):
    """Markdown: steps, iterations and cost of each case, and what 5 s would take at that rate."""
    lines = []
    for name in names:
        if result := points.load(f"paper_{name}"):
            s, dt, volume = result["summary"], result["dt_s"], result["volume_error"]
            step = s["cpu_seconds"] / max(1, s["steps"] - 1)
            times = f"{dt[0]:.2g} - {dt[1]:.2g} - {dt[2]:.2g}"
            iterations = f"{result['mean_viscous_iterations']:.2f}", f"{result['mean_pressure_iterations']:.1f}"
            cost = f"{step:.4f}", f"{5 / dt[1] * step / 3600:.2f} CPU-h"
            worst = f"{100 * volume['end']:.2f} %, {100 * volume['worst']:.1f} %"
            lines.append([name, times, s["steps"], *iterations, *cost, worst])
    head = ["case", "dt [s], least - median - most", "steps", "direct iterations", "CG iterations", "CPU-s a step"]
    return points.table([*head, "5 s at the median dt", "volume error at the end, worst"], lines)


if __name__ == "__main__":
    if sys.argv[1:2] == ["draw"]:
        draw()
    elif sys.argv[1:2] == ["run"] and len(sys.argv) == 3:
        run_case(sys.argv[2])
    elif sys.argv[1:2] == ["run"] and set(sys.argv[2:]) <= set(CASES):
        for each in sys.argv[2:] or CASES:
            subprocess.run([sys.executable, __file__, "run", each], check=True)
    else:
        sys.exit(__doc__)
