"""The cases and figures of Tomiyama et al. (2009), by one command each.

    python benchmarks/paper_cases.py run             # every case, about 15 CPU-minutes; one JSON each in results/
    python benchmarks/paper_cases.py run implicit-1  # some of them
    python benchmarks/paper_cases.py draw            # docs/figures/paper_*.png and the tables of docs/paper.md

Reference curves: tests/reference/fe_inertial_slump_summary.csv (own finite elements, +-0.4 mm).
"""

import csv
import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "benchmarks" / "results"
FIGURES = ROOT / "docs" / "figures"
MILESTONES = (0.05, 0.1, 0.2, 0.3, 0.5, 1.0, 2.0, 5.0)
PICTURES = (0.0, 0.1, 1.0, 5.0)

PAPER = {1: (100.0, 50.0), 2: (300.0, 50.0), 3: (500.0, 50.0), 4: (100.0, 50.0), 5: (100.0, 1500.0)}
CASES = {f"implicit-{k}": dict(scheme="implicit", case=k, until=5.0) for k in PAPER}
CASES["implicit-5"]["until"] = 200.0
CASES["implicit-1"]["until"] = 20.0
CASES |= {f"bi-viscosity-{k}": dict(scheme="implicit", case=k, until=5.0, pi_c=0.1) for k in (1, 2, 3, 5)}
CASES |= {f"semi-implicit-{k}": dict(scheme="semi-implicit", case=k, until=5.0) for k in (1, 2, 3, 5)}  # 4 is 1
CASES |= {f"literal-{k}": dict(scheme="semi-implicit", case=k, until=0.5, numerics=dict(literal=True)) for k in (1, 3)}
BEGIN, END = "<!-- written by benchmarks/paper_cases.py draw -->", "<!-- end -->"
YIELD_VALUES = (50.0, 100.0, 200.0, 300.0, 500.0, 750.0, 1000.0, 1500.0)
CASES |= {f"yield-{tau:g}": dict(scheme="implicit", yield_value=tau, until=5.0) for tau in YIELD_VALUES}


def run_case(name):
    """Run one case in this process and write its JSON."""
    import taichi_mps as mps
    from taichi_mps.problem import catalogue
    from taichi_mps.problem.numerics import NUMERICS
    from taichi_mps.terms.rheology import apparent_viscosity

    settings = CASES[name]
    tau_y, eta = PAPER[settings["case"]] if "case" in settings else (settings["yield_value"], 50.0)
    keywords = dict(yield_value=tau_y, plastic_viscosity=eta, spacing=settings.get("spacing", 0.01))
    keywords |= dict(until=settings["until"], critical_strain_rate=settings.get("pi_c"))
    mps.init(threads=1)
    sim = mps.Simulation(
        catalogue.load("slump")(**keywords), NUMERICS[settings["scheme"]](**settings.get("numerics", {}))
    )
    rows, viscous, pressure, steps, volume = [], [], [], [], []

    def record(s):
        rows.append((s.time, *s.measures().values()))

    def count(s):
        viscous.append(s.report.viscous_iterations)
        pressure.append(s.report.pressure_iterations)
        steps.append((s.report.dt, s.report.dt_limit))
        volume.append(s.report.volume_error)

    frames = ROOT / "renders" / "paper" / name
    wanted = settings.get("case") in (1, 3) and not name.startswith("bi")
    samples = {}

    def picture(s):
        if wanted and any(abs(s.time - t) < 1e-6 for t in PICTURES):
            mps.png(str(frames / f"t{s.time:.1f}"))(s)
        if any(abs(s.time - t) < 1e-6 for t in (0.1, 1.0)):
            rate = s.snapshot().shear_rate
            samples[f"{s.time:g}"] = np.round(np.quantile(rate, np.linspace(0, 1, 60)), 5).tolist()

    sim.every(0.01 if name.startswith("semi") else 0.1 if settings["until"] > 20 else 0.01, record)
    sim.every(0.1, picture)
    sim.each_step(count)
    begin, error = time.time(), None
    try:
        sim.run()
    except mps.DivergedError as failure:
        error = str(failure)
    if wanted and sim.stopped_by in ("rest", "unyielded"):  # later pictures show the body where it stopped
        for t in PICTURES:
            if t > sim.time:
                mps.png(str(frames / f"t{t:.1f}"))(sim)
    summary = sim.summary()
    history = np.array(rows)
    dt = np.array([d for d, _ in steps])
    out = {
        "case": name,
        "command": f"python benchmarks/paper_cases.py run {name}",
        "error": error,
        "wall_seconds": time.time() - begin,
        "time_s": history[:, 0].round(4).tolist(),
        "slump_m": history[:, 1].round(5).tolist(),
        "slump_max_m": history[:, 2].round(5).tolist(),
        "spread_m": history[:, 3].round(5).tolist(),
        "dt_s": [float(dt.min()), float(np.median(dt)), float(dt.max())],
        "dt_limits": {k: sum(n == k for _, n in steps) for k in {n for _, n in steps}},
        "volume_error": {"worst": float(np.abs(volume).max()), "end": volume[-1]},
        "mean_viscous_iterations": float(np.mean(viscous)),
        "mean_pressure_iterations": float(np.mean(pressure)),
        "shear_rate_quantiles": samples,
        "summary": summary,
    }
    pi_c = settings.get("pi_c") or (0.1 if settings["scheme"] == "semi-implicit" else None)
    if pi_c:
        out["unyielded_viscosity_Pa_s"] = float(apparent_viscosity(0.0, eta, tau_y, pi_c))
    RESULTS.mkdir(parents=True, exist_ok=True)
    (RESULTS / f"paper_{name}.json").write_text(json.dumps(out, indent=1) + "\n")
    end = f"slump {1e3 * history[-1, 1]:.1f} mm, spread {1e3 * history[-1, 3]:.1f} mm at {sim.time:.2f} s"
    print(f"{name}: {end}, {summary['steps']} steps, {summary['cpu_seconds']:.1f} CPU-s, {error or sim.stopped_by}")


def paper_scheme(case):
    """Name of the run of a case with the paper's scheme: #4 has the numbers of #1."""
    return f"semi-implicit-{1 if case == 4 else case}"


def load(name):
    path = RESULTS / f"paper_{name}.json"
    return json.loads(path.read_text()) if path.exists() else None


def reference(tau_y, eta, model="A", gc=0.0, file="summary"):
    """Finite elements: rows of time [s], mean slump over r < 20 mm [m], spread [m]; file summary or history."""
    slump, spread = ("mean20_mm", "spread_mm") if file == "summary" else ("slump_mean_r20_mm", "spread_diam_mm")
    path = ROOT / "tests" / "reference" / f"fe_inertial_slump_{file}.csv"
    with open(path) as lines:
        rows = csv.DictReader(line for line in lines if not line.startswith("#"))
        found = [
            (float(r.get("time_s") or r["t_s"]), 1e-3 * float(r[slump]), 1e-3 * float(r[spread]))
            for r in rows
            if r["model"] == model
            and (float(r["tau_Pa"]), float(r["eta_Pa_s"]), float(r["gc_1_s"])) == (tau_y, eta, gc)
            and r.get("kind", "fixed") in ("fixed", "after_arrest")
        ]
    return np.array(sorted(found))


def at(result, t, key="slump_m"):
    """Value at time t by interpolation; the last one after a stop at rest; nan where the run did not get there."""
    times = result["time_s"]
    if t > times[-1] + 1e-9 and result["summary"]["stopped_by"] != "rest":
        return float("nan")
    return float(np.interp(t, times, result[key]))


def table(names, model, gc):
    """Markdown: slump of each case at the milestones, the reference beside it."""
    head = [f"{t:g} s" for t in MILESTONES]
    lines = ["| case | | " + " | ".join(head) + " | last | spread | steps | CPU-s (compile) | stopped by |"]
    lines.append("|" + "---|" * (len(head) + 7))
    for name in names:
        result = load(name)
        if result is None:
            continue
        tau_y, eta = PAPER[CASES[name]["case"]]
        s = result["summary"]
        cells = ["-" if np.isnan(v := at(result, t)) else f"{1e3 * v:.1f}" for t in MILESTONES]
        end = f"{1e3 * result['slump_m'][-1]:.1f} at {result['time_s'][-1]:.2f} s"
        lines.append(
            f"| {name} | engine | "
            + " | ".join(cells)
            + f" | {end} | {1e3 * result['spread_m'][-1]:.0f} | {s['steps']} | {s['cpu_seconds']:.0f}"
            + f" ({s['compile_seconds']:.0f}) | {result['error'] or s['stopped_by']} |"
        )
        exact = reference(tau_y, eta, model, gc)
        values = [f"{1e3 * exact[np.isclose(exact[:, 0], t)][0, 1]:.1f}" for t in MILESTONES]
        lines.append(
            "| | finite elements | " + " | ".join(values) + f" | {1e3 * exact[-1, 1]:.1f} at 5 s "
            f"| {1e3 * exact[-1, 2]:.0f} at 5 s | | | |"
        )
    return "\n".join(lines)


def draw():
    """Figures 4-10 of the paper, drawn with its scheme beside ``implicit`` and finite elements, and the tables."""
    import imageio.v3 as imageio

    from taichi_mps.terms.rheology import apparent_viscosity
    from taichi_mps.viz import plots

    FIGURES.mkdir(parents=True, exist_ok=True)

    def curves(cases):
        found = {f"#{k}": load(paper_scheme(k)) for k in cases}
        return {n: {"time_s": np.array(r["time_s"]), "slump_m": np.array(r["slump_m"])} for n, r in found.items() if r}

    def references(cases):
        found = {f"#{k}": reference(*PAPER[k], model="B", gc=0.2, file="history") for k in cases}
        return {label: (rows[:, 0], rows[:, 1]) for label, rows in found.items()}

    plots.slump_curve(curves((1, 2, 3)), FIGURES / "paper_fig5.png", references((1, 2, 3)))
    plots.slump_curve(curves((4, 5)), FIGURES / "paper_fig9.png", references((4, 5)), log_time=True)
    points = [(t, load(f"yield-{t:g}")) for t in YIELD_VALUES]
    points = {"implicit, at rest or 5 s": np.array([(t, r["slump_m"][-1]) for t, r in points if r]).T}
    own = [(PAPER[k][0], load(paper_scheme(k))) for k in (1, 2, 3)]
    points["semi-implicit, at its stop or 5 s"] = np.array([(t, r["slump_m"][-1]) for t, r in own if r]).T
    points["the paper's text"] = np.array([(100.0, 0.25), (500.0, 0.20)]).T
    ref_points = [(t, reference(t, 50.0)[-1, 1]) for t in (100.0, 300.0, 500.0, 1000.0)]
    known = {"finite elements with inertia": np.array(ref_points).T}
    empirical = np.linspace(50.0, 1500.0, 60)
    known["Roussel (2006), 50-250 mm"] = np.array(
        [(t, s) for t in empirical if 0.05 < (s := 1e-2 * (25.5 - 17.6 * t / 2300.0)) < 0.25]
    ).T
    plots.slump_against_yield_value(points, known, FIGURES / "paper_fig4.png")
    for figure, cases in (("paper_fig6", (1, 2, 3)), ("paper_fig10", (4, 5))):
        samples = {}
        for k in cases:
            source = load(paper_scheme(k))
            if source:
                tau_y, eta = PAPER[k]
                rates = np.concatenate([np.array(v) for v in source["shear_rate_quantiles"].values()])
                samples[f"#{k}"] = (rates, apparent_viscosity(rates, eta, tau_y, 0.1, np.maximum))
        rate = np.logspace(-2, 1.5, 200)
        laws = {f"#{k}": (rate, apparent_viscosity(rate, *PAPER[k][::-1], 0.1, np.maximum)) for k in cases}
        plots.viscosity_against_shear_rate(samples, laws, FIGURES / f"{figure}.png")
    for figure, name in (("paper_fig7", paper_scheme(1)), ("paper_fig8", paper_scheme(3))):
        pictures = []
        for t in PICTURES:
            found = sorted((ROOT / "renders" / "paper" / name / f"t{t:.1f}").glob("*.png"))
            if found:
                pictures.append(imageio.imread(found[-1])[::2, ::2])
        if len(pictures) == 4:
            top, bottom = np.hstack(pictures[:2]), np.hstack(pictures[2:])
            imageio.imwrite(FIGURES / f"{figure}.png", np.vstack([top, bottom]))
    text = "### True Bingham, scheme `implicit`\n\n"
    text += table([f"implicit-{k}" for k in PAPER], "A", 0.0)
    text += "\n\n### The paper's bi-viscosity law (pi_c = 0.1 1/s), scheme `implicit`\n\n"
    text += table([f"bi-viscosity-{k}" for k in (1, 2, 3, 5)], "B", 0.2)
    text += "\n\n### The paper's scheme: `semi-implicit`\n\n"
    explicit = [name for name in CASES if name.startswith(("semi-implicit", "literal"))]
    text += table(explicit, "B", 0.2) + "\n\n" + cost_table(explicit)
    page = ROOT / "docs" / "paper.md"
    before, rest = page.read_text().split(BEGIN)
    page.write_text(f"{before}{BEGIN}\n\n{text}\n\n{END}{rest.split(END)[1]}")
    print(text)


def cost_table(names):
    """Markdown: steps, iterations and cost of each case, and what 5 s would take at that rate."""
    lines = [
        "| case | dt [s], least - median - most | steps | direct iterations | CG iterations | CPU-s a step "
        "| 5 s at the median dt | volume error at the end, worst |"
    ]
    lines.append("|" + "---|" * 8)
    for name in names:
        if result := load(name):
            s, dt = result["summary"], result["dt_s"]
            step = s["cpu_seconds"] / max(1, s["steps"] - 1)
            lines.append(
                f"| {name} | {dt[0]:.2g} - {dt[1]:.2g} - {dt[2]:.2g} | {s['steps']} "
                f"| {result['mean_viscous_iterations']:.2f} | {result['mean_pressure_iterations']:.1f} "
                f"| {step:.4f} | {5 / dt[1] * step / 3600:.2f} CPU-h "
                f"| {100 * result['volume_error']['end']:.2f} %, {100 * result['volume_error']['worst']:.1f} % |"
            )
    return "\n".join(lines)


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
