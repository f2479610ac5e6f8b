"""Slump and spread against step, outer iterations and spacing: what a result does not depend on, shown.

    python benchmarks/convergence.py cost                    # CPU-hours of what has no result yet
    python benchmarks/convergence.py run [--model axisymmetric] [--spacing 0.02] [--mix 300,50] [--step 1]
    python benchmarks/convergence.py draw                    # results/convergence.md, docs/figures/step.png

Each model, spacing, mix and step is one process, which compiles once: steps as the scene takes them and bounded to 1/2,
1/4 and 1/8 of its longest and of its Courant number, by 3 to 24 outer iterations; at fine spacings more iterations go
with shorter steps. Rings of 10 mm also with as many iterations as a tolerance takes. Errors: engine - finite elements
with inertia, at 0.3, 1 and 2 s; what comes to rest before stays as it is.
"""

import argparse
import json
import time
from itertools import product

import models
import numpy as np
import points

NAMES = "model", "spacing", "mix", "step"  # what makes a point
MODELS, SPACINGS, MIXES = ("axisymmetric", "quarter"), (0.02, 0.01, 0.005, 0.0025), ("300,50", "80,150")
STEPS, ITERATIONS, TIMES = (1.0, 0.5, 0.25, 0.125), (3, 6, 12, 24), (0.3, 1.0, 2.0)
COARSE, TOGETHER = 0.01, {1.0: 6, 0.5: 12, 0.25: 24}  # spacings of all pairs; iterations of each step at finer ones
TOLERANCES, MOST_ITERATIONS = (2e-3, 2e-4), 200
PARTICLES = {  # of each spacing
    "axisymmetric": {0.02: 57, 0.01: 225, 0.005: 900, 0.0025: 3600},
    "quarter": {0.02: 175, 0.01: 1376, 0.005: 11000},
}
# of a run: CPU-seconds of a step, and of a particle and an iteration in it; longest steps in all
COST, USUAL_STEPS = (2e-3, 2e-6), 150


def runs(model: str, spacing: float, mix: str, step: float) -> dict[str, dict]:
    """Numbers of the outer iterations of a point, by their name."""
    if spacing not in PARTICLES[model] or (spacing < COARSE and step not in TOGETHER):
        return {}
    found = {str(n): {"passes": n} for n in (ITERATIONS if spacing >= COARSE else [TOGETHER[step]])}
    if (model, spacing) == ("axisymmetric", COARSE):
        found |= {f"to {t:g}": {"passes": MOST_ITERATIONS, "outer_tolerance": t} for t in TOLERANCES}
    return found


def point(**settings) -> dict:
    """Of each run of a point: errors [m], time of rest [s], residuals, iterations, steps and CPU-seconds."""
    import taichi_mps as mps
    from taichi_mps.problem.problem import Problem
    from taichi_mps.simulation.forecast import own_step

    tau, eta = map(float, settings["mix"].split(","))
    (known, *exact), found, start = models.finite_elements(tau, eta), {}, None
    mps.init(threads=1)
    mix = {"yield_value": tau, "plastic_viscosity": eta, "until": TIMES[-1]}
    scene = mps.slump_cone(model=settings["model"], spacing=settings["spacing"], **mix)
    step, usual = settings["step"], mps.Implicit()
    # nothing bounds the steps of the scene: quiet flows take longer ones
    bounds = {"max_time_step": step * own_step(Problem(scene)), "courant_number": step * usual.courant_number}
    for name, numbers in runs(**settings).items():
        numerics = mps.Implicit(**numbers, **(bounds if step < 1.0 else {}))
        if start is None:
            sim = mps.Simulation(scene, numerics)
            start = sim.state()
        sim.restart(Problem(scene, numerics), start)
        sim.scheme.numerics = numerics  # what is compiled does not depend on it
        rows, begin = [], time.process_time()
        sim.each_step(lambda s, rows=rows: rows.append(row(s)))
        ended = sim.run()
        times, slumps, spreads, *residuals, iterations = np.array(rows).T
        slump, spread = (
            np.interp(TIMES, times, values) - np.interp(TIMES, known, there)
            for values, there in zip((slumps, spreads), exact, strict=True)
        )
        found[name] = {
            "slump": slump.tolist(),
            "spread": spread.tolist(),
            "rest": sim.time if ended == "rest" else None,
            "residuals": [float(values[1:][times[1:] < TIMES[0]].mean()) for values in residuals],  # while it flows
            "iterations": float(iterations[1:].mean()),
            "steps": sim.steps,
            "cpu_seconds": time.process_time() - begin,
        }
    return {"runs": found, "cpu_seconds": time.process_time()}


def row(sim) -> tuple:
    """Time, slump, spread, residuals and outer iterations after a step."""
    measures, report = sim.measures(), sim.report
    results = measures["slump_m"], measures["spread_m"], report.strain_rate_residual, report.divergence_residual
    return (sim.time, *results, report.outer_iterations)


def cost(settings: dict) -> float:
    """CPU-hours of a point, about."""
    count, steps = PARTICLES[settings["model"]][settings["spacing"]], USUAL_STEPS / settings["step"]
    iterations = [min(numbers["passes"], 2 * max(ITERATIONS)) for numbers in runs(**settings).values()]
    return sum(steps * (COST[0] + COST[1] * count * n) for n in iterations) / 3600.0


def order(errors, ratio: float = 2.0) -> str:
    """Observed order of three values, each of half the step of the last, or of two errors."""
    one, two = np.abs(np.diff(errors)) if len(errors) == 3 else np.abs(errors)
    return f"{np.log(one / two) / np.log(ratio):.1f}" if one > 0.0 and two > 0.0 else "-"


def rows(found: dict):
    """Lines of the table."""
    for model, mix, spacing in product(MODELS, MIXES, SPACINGS):
        runs = {s: found.get(f"{model} {s:g} {mix}", {}).get("runs") for s in SPACINGS}
        for step, iterations in product(STEPS, ITERATIONS) if runs[spacing] else ():
            key = f"{step:g} {iterations}"
            one = runs[spacing][key]
            steps = [runs[spacing][f"{k:g} {iterations}"]["errors"][2] for k in (4 * step, 2 * step, step) if k <= 1.0]
            sizes = [runs[s][key]["errors"][2] for s in SPACINGS if runs[s]]
            yield [
                "{} Pa, {} Pa s".format(*mix.split(",")),
                f"{model}, {1e3 * spacing:g} mm",
                f"{step:g}",
                iterations,
                *(f"{1e3 * error:+.1f}" for error in one["errors"]),
                f"{one['rest']:.2f}" if one["rest"] else "not",
                order(steps) if len(steps) == 3 else "-",
                order(sizes) if len(sizes) == 2 else "-",
            ]


def draw() -> None:
    """The table and its chart."""
    from taichi_mps.validation import provenance

    plt, found = points.pyplot(), points.read("convergence")
    lines = list(rows(found))
    text = "# Convergence\n\nWritten by `python benchmarks/convergence.py draw`. Errors: engine - finite elements.\n\n"
    text += f"{points.table(HEAD, lines)}\n\n{provenance.origin(found.values())}\n"
    (points.RESULTS / "convergence.md").write_text(text, encoding="utf-8")
    figure, axes = plt.subplots(1, len(found), figsize=(3.4 * len(found), 3.2), sharey=True, squeeze=False)
    for axis, (name, result) in zip(axes[0], found.items(), strict=True):
        for iterations in ITERATIONS:
            slumps = [1e3 * result["runs"][f"{step:g} {iterations}"]["errors"][2] for step in STEPS]
            axis.plot(STEPS, slumps, "o-", label=f"{iterations} iterations")
        axis.set(title=name, xscale="log", xlabel="step over the longest")
        axis.axhline(0.0, color="k", lw=0.5)
        axis.set_xticks(STEPS, ["1", "1/2", "1/4", "1/8"])
        axis.minorticks_off()
        axis.grid(alpha=0.3)
    axes[0, 0].set_ylabel("error of the slump at rest [mm]")
    axes[0, -1].legend(fontsize=7)
    figure.tight_layout()
    figure.savefig(points.DOCS / "figures" / "step.png", dpi=110)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("action", choices=["cost", "run", "draw", "point"])
    parser.add_argument("settings", nargs="?")
    for name, choices in zip(NAMES, (MODELS, SPACINGS, MIXES, STEPS), strict=True):
        parser.add_argument(f"--{name}", nargs="+", type=type(choices[0]), choices=choices, default=choices)
    given = parser.parse_args()
    asked = [dict(zip(NAMES, item, strict=True)) for item in product(*(getattr(given, n) for n in NAMES))]
    asked = {"{model} {spacing:g} {mix} {step:g}".format(**each): each for each in asked if runs(**each)}
    left = {key: settings for key, settings in asked.items() if key not in points.read("convergence")}
    if given.action == "point":
        print(json.dumps(point(**json.loads(given.settings))))
    elif given.action == "draw":
        draw()
    else:
        for key, settings in left.items():
            print(f"{key}: about {cost(settings):.2f} CPU-hours")
        print(f"in all about {sum(map(cost, left.values())):.2f} CPU-hours", flush=True)
        if given.action == "run":
            points.run(__file__, "convergence", left)


if __name__ == "__main__":
    main()
