"""Slump and spread against step, outer iterations and spacing: what a result does not depend on, shown.

    python benchmarks/convergence.py cost                    # CPU-hours of what has no result yet
    python benchmarks/convergence.py run [--model axisymmetric] [--spacing 0.02] [--mix 300,50]
    python benchmarks/convergence.py draw                    # results/convergence.md, docs/figures/step.png

Each model, spacing and mix is one process, which compiles once: steps of at most 1 to 1/8 of the longest,
by 3 to 24 outer iterations, to rest. Errors: engine - finite elements with inertia, at 0.3 s, 1 s and at rest.
"""

import argparse
import json
import time
from itertools import product

import models
import numpy as np
import points

MODELS, SPACINGS, MIXES = ("axisymmetric", "quarter"), (0.02, 0.01), ("300,50", "80,150")
STEPS, ITERATIONS, TIMES = (1.0, 0.5, 0.25, 0.125), (3, 6, 12, 24), (0.3, 1.0)
PARTICLES = {("axisymmetric", 0.02): 57, ("axisymmetric", 0.01): 225, ("quarter", 0.02): 175, ("quarter", 0.01): 1376}
# of a run: CPU-seconds of a step, and of a particle and an iteration in it; longest steps to rest
COST, USUAL_STEPS = (3e-3, 4e-6), 250
HEAD = ["mix", "model, l0", "step", "iterations", "slump 0.3 s", "1 s", "at rest [mm]", "spread at rest [mm]"]
HEAD += ["time of rest [s]", "order of the step", "order of the spacing"]


def point(model: str, spacing: float, mix: str) -> dict:
    """Errors [m] and times of rest [s] by step and iterations, and CPU-seconds in all."""
    import taichi_mps as mps
    from taichi_mps.problem.problem import Problem

    tau, eta = map(float, mix.split(","))
    exact, found = models.reference(tau, eta), {}
    mps.init(threads=1)
    scene = mps.slump_cone(model=model, spacing=spacing, until=exact["until"], yield_value=tau, plastic_viscosity=eta)
    sim = mps.Simulation(scene)
    start, longest, begin = sim.state(), sim.scheme.constants.max_time_step, time.process_time()
    for step, iterations in product(STEPS, ITERATIONS):
        # the first column has no limit: quiet flows take longer steps
        numerics = mps.Implicit(passes=iterations, max_time_step=None if step == 1.0 else step * longest)
        sim.restart(Problem(scene, numerics), start)
        sim.scheme.numerics = numerics  # what is compiled does not depend on it
        rows = []
        sim.each_step(lambda s, rows=rows: rows.append((s.time, s.measures()["slump_m"])))
        ended = sim.run()
        measures, history = sim.measures(), np.array(rows).T
        errors = [np.interp(t, *history) - np.interp(t, exact["times"], exact["slumps"]) for t in TIMES]
        errors += [measures["slump_m"] - exact["slump"], measures["spread_m"] - exact["spread"]]
        found[f"{step:g} {iterations}"] = {"errors": errors, "rest": sim.time if ended == "rest" else None}
    return {"runs": found, "cpu_seconds": time.process_time() - begin}


def cost(settings: dict) -> float:
    """CPU-hours of a point, about."""
    count = PARTICLES[settings["model"], settings["spacing"]]
    runs = product(STEPS, ITERATIONS)
    return sum(USUAL_STEPS / step * (COST[0] + COST[1] * count * iterations) for step, iterations in runs) / 3600.0


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
    parser.add_argument("--model", nargs="+", choices=MODELS, default=MODELS)
    parser.add_argument("--spacing", nargs="+", type=float, choices=SPACINGS, default=SPACINGS)
    parser.add_argument("--mix", nargs="+", choices=MIXES, default=MIXES)
    given = parser.parse_args()
    names = "model", "spacing", "mix"
    asked = {
        "{} {:g} {}".format(*item): dict(zip(names, item, strict=True))
        for item in product(*(getattr(given, n) for n in names))
    }
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
