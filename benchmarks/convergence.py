"""Slump and spread against step, outer iterations and spacing: what a result does not depend on, shown.

    python benchmarks/convergence.py run                                # every point without a result, CPU-hours
    python benchmarks/convergence.py run "axisymmetric 0.02 300,50 1"   # one of them: model, spacing, mix, step
    python benchmarks/convergence.py draw                               # results/convergence.md, docs/figures/step.png

Each model, spacing, mix and step is one process, which compiles once: steps as the scene takes them and bounded to 1/2,
1/4 and 1/8 of its longest and of its Courant number, by 3 to 24 outer iterations; at fine spacings more iterations go
with shorter steps. Rings of 10 mm also with as many iterations as a tolerance takes. Errors: engine - finite elements
with inertia, at 0.3, 1 and 2 s; what comes to rest before stays as it is.
"""

import time
from itertools import product

import models
import numpy as np
import points

NAMES = "model", "spacing", "mix", "step"  # what makes a point
MODELS, SPACINGS, MIXES = ("axisymmetric", "quarter"), (0.02, 0.01, 0.005, 0.0025), ("300,50", "80,150")
STEPS, ITERATIONS, TIMES = (1.0, 0.5, 0.25, 0.125), (3, 6, 12, 24), (0.3, 1.0, 2.0)
COARSE, TOGETHER = 0.01, {1.0: 6, 0.5: 12, 0.25: 24}  # spacings of all pairs; iterations of each step at finer ones
TOLERANCES, MAX_ITERATIONS = (2e-3, 2e-4), 200
TOO_MANY_PARTICLES = "quarter", 0.0025  # model and spacing that is not run
# at 10 mm five placings, with the usual and with the finest step: of a run's particles up to ASIDE of the spacing
PLACED, PLACINGS, PLACED_ITERATIONS, ASIDE = "placed", 5, {1.0: 6, 0.125: 24}, 0.05
LEAST, TARGETS = 6, {"slump": 1.0, "spread": 3.0}  # iterations from which on runs at 10 mm shall be so close [mm]
HEAD = [
    "mix",
    "model, l0",
    "step",
    "iterations",
    "of a step",
    "slump",
    "spread",
    "rest [s]",
    "2|D-q|",
    "div u-s",
    "CPU-s",
]
JUDGED = ["of", "mix", "model, l0", "iterations", "runs", "mean errors [mm]", "runs apart by [mm]"]
JUDGED += ["means of a step", "means of a number", "order of l0", "orders of the step"]
TOLD = (
    "Errors beside the finite elements at 0.3, 1 and 2 s, of what has come to rest by then as it lies. Targets at "
    f"10 mm: with {LEAST} iterations or more, whatever the step, slumps within {TARGETS['slump']:g} mm and spreads "
    f"within {TARGETS['spread']:g} mm of each other; bold where they are missed."
)
PLACED_HEAD = ["mix", "model, l0", "step", "iterations", "slump, five placings [mm]", "spread, five placings [mm]"]


def runs(model: str, spacing: float, mix: str, step: float, again: str = "") -> dict[str, dict]:
    """Numbers of the outer iterations of a point, by their name; ``again``: PLACED otherwise."""
    if again:
        n = PLACED_ITERATIONS.get(step) if spacing == COARSE else None
        return {f"{n}, placing {k}": {"passes": n} for k in range(1, PLACINGS) if n}
    if (model, spacing) == TOO_MANY_PARTICLES or (spacing < COARSE and step not in TOGETHER):
        return {}
    found = {str(n): {"passes": n} for n in (ITERATIONS if spacing >= COARSE else [TOGETHER[step]])}
    if (model, spacing) == ("axisymmetric", COARSE):
        found |= {f"to {t:g}": {"passes": MAX_ITERATIONS, "outer_tolerance": t} for t in TOLERANCES}
    return found


def cases() -> dict[str, dict]:
    """Settings of each point by its name, those of PLACED last."""
    found = [dict(zip(NAMES, item, strict=True)) for item in product(MODELS, SPACINGS, MIXES, STEPS)]
    usual = {"{model} {spacing:g} {mix} {step:g}".format(**each): each for each in found}
    placed = {f"{key} {PLACED}": {**each, "again": PLACED} for key, each in usual.items()}
    return {key: each for key, each in (usual | placed).items() if runs(**each)}


def point(**settings) -> dict:
    """Results of each run of a point: errors [m], time of rest [s], residuals, iterations, steps and CPU-seconds."""
    import taichi_mps as mps
    from taichi_mps.engine.problem.problem import Problem

    tau, eta = map(float, settings["mix"].split(","))
    (known, *exact), found, start = models.finite_elements(tau, eta), {}, None
    mps.init(threads=1)
    mix = {"yield_value": tau, "plastic_viscosity": eta, "until": TIMES[-1]}
    scene = mps.slump_cone(model=settings["model"], spacing=settings["spacing"], **mix)
    step, usual = settings["step"], mps.Implicit()
    # nothing bounds the steps of the scene: quiet flows take longer ones
    bounds = {"max_time_step": step * Problem(scene).time_step.longest, "courant_number": step * usual.courant_number}
    for name, numbers in runs(**settings).items():
        numerics = mps.Implicit(**numbers, **(bounds if step < 1.0 else {}))
        if start is None:
            sim = mps.Simulation(scene, numerics)
            start = sim.state()
        seed = int(name.partition("placing ")[2] or 0)
        moved = start["x"] + points.aside(start["x"].shape, ASIDE / points.ASIDE * scene.spacing, seed)
        sim.restart(Problem(scene, numerics), {**start, "x": moved})
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


def order(values, ratio: float = 2.0) -> str:
    """Observed order of three values, each of half the step of the last, or of two errors."""
    one, two = np.abs(np.diff(values)) if len(values) == 3 else np.abs(values)
    return f"{np.log(one / two) / np.log(ratio):.1f}" if one > 0.0 and two > 0.0 else "-"


def numbers(errors) -> str:
    """Errors [mm] at TIMES."""
    return ", ".join(f"{1e3 * error:+.1f}" for error in errors)


def parts(found: dict):
    """Model, mix and spacing that were run, with what was found by step and by name."""
    for model, mix, spacing in product(MODELS, MIXES, SPACINGS):
        keys = {step: f"{model} {spacing:g} {mix} {step:g}" for step in STEPS}
        runs = {step: dict(found[key]["runs"]) for step, key in keys.items() if key in found}
        for step in runs:
            runs[step] |= found.get(f"{keys[step]} {PLACED}", {"runs": {}})["runs"]
        if runs:
            yield model, mix, spacing, runs


def rows(found: dict):
    """Yield a row for each run: its settings, errors, time of rest and residuals."""
    for model, mix, spacing, runs in parts(found):
        for step, name, one in ((step, name, one) for step, of_step in runs.items() for name, one in of_step.items()):
            yield [
                "{} Pa, {} Pa s".format(*mix.split(",")),
                f"{model}, {1e3 * spacing:g} mm",
                f"{step:g}",
                name,
                f"{one['iterations']:.1f}",
                numbers(one["slump"]),
                numbers(one["spread"]),
                f"{one['rest']:.2f}" if one["rest"] else "not by 2 s",
                *(f"{residual:.1e}" for residual in one["residuals"]),
                f"{one['cpu_seconds']:.1f}",
            ]


def judged(found: dict):
    """Statistics for each model, mix and spacing, with LEAST iterations or more and to each tolerance: means of the
    errors; ranges of runs, of means of a step and of means of a number of iterations; observed orders of the spacing,
    of the mean size of the errors, and of the step, at the first of TIMES."""
    last = {}
    for key, (model, mix, spacing, runs) in product(TARGETS, parts(found)):
        names = sorted({name for of_step in runs.values() for name in of_step if "placing" not in name}, key=len)
        chosen = {f"{LEAST} or more": [n for n in names if n.isdigit() and int(n) >= LEAST]}
        chosen |= {n: [n] for n in names if n.startswith("to")}
        for label, kept in chosen.items():
            errors = {(step, n): np.array(runs[step][n][key]) for step in runs for n in kept if n in runs[step]}
            mean = np.mean(list(errors.values()), axis=0)
            by_step, by_iterations = (
                [np.mean([e for at, e in errors.items() if at[part] == value], axis=0) for value in values]
                for part, values in enumerate((list(runs), [n for n in kept if any(at[1] == n for at in errors)]))
            )
            full, size = spacing >= COARSE, np.abs(mean).mean()
            before = last.get((model, mix, key)) if label not in kept else None
            if label not in kept:
                last[model, mix, key] = spacing, size
            steps = [order([e[0] for e in by_step[k : k + 3]]) for k in range(len(by_step) - 2)] if full else []
            yield [
                key,
                "{} Pa, {} Pa s".format(*mix.split(",")),
                f"{model}, {1e3 * spacing:g} mm",
                label,
                len(errors),
                numbers(mean),
                far(list(errors.values()), TARGETS[key] if spacing == COARSE else np.inf),
                far(by_step, TARGETS[key] if spacing == COARSE else np.inf) if full else "-",
                far(by_iterations, TARGETS[key] if spacing == COARSE else np.inf) if full and len(kept) > 1 else "-",
                order((before[1], size), before[0] / spacing) if before else "-",
                ", ".join(steps) or "-",
            ]


def far(errors, target: float) -> str:
    """Format the range of errors [mm], in bold where it exceeds a target."""
    apart = [f"{1e3 * number:.1f}" for number in np.ptp(errors, axis=0)]
    return ", ".join(f"**{number}**" if float(number) > target else number for number in apart)


def placed(found: dict):
    """Mean and standard deviation of five placings, with the usual and the finest step."""
    for model, mix, spacing, runs in parts(found):
        for step, n in PLACED_ITERATIONS.items():
            five = [runs[step][name] for name in runs.get(step, ()) if name.split(",")[0] == str(n)]
            if spacing == COARSE and len(five) == PLACINGS:
                cells = ["{} Pa, {} Pa s".format(*mix.split(",")), f"{model}, {1e3 * spacing:g} mm", f"{step:g}", n]
                for key in TARGETS:
                    errors = 1e3 * np.array([run[key] for run in five])
                    mean, scatter = errors.mean(0), errors.std(0, ddof=1)
                    cells.append(", ".join(f"{m:+.1f} ± {s:.1f}" for m, s in zip(mean, scatter, strict=True)))
                yield cells


def draw() -> None:
    """The tables and the chart."""
    from validation import provenance

    plt, found = points.pyplot(), points.read("convergence")
    short = f"{TOLD}\n\n{points.table(JUDGED, judged(found))}\n\n{points.table(PLACED_HEAD, placed(found))}"
    points.put("accuracy.md", "convergence", short, found.values())
    text = (
        "# Convergence\n\nWritten by `python benchmarks/convergence.py draw`. Errors: engine - finite elements, in mm, "
    )
    text += "at 0.3, 1 and 2 s.\n\n"
    text += f"{short}\n\n{points.table(HEAD, rows(found))}\n\n{provenance.origin(found.values())}\n"
    (points.RESULTS / "convergence.md").write_text(text, encoding="utf-8")
    cases = [part for part in parts(found) if part[2] >= COARSE]
    figure, axes = plt.subplots(2, 4, figsize=(13.6, 5.4), sharey=True)
    for axis, (model, mix, spacing, runs) in zip(axes.T.flat, cases, strict=False):
        for n in ITERATIONS:
            shown = {step: 1e3 * runs[step][str(n)]["slump"][1] for step in runs}
            axis.plot(shown.keys(), shown.values(), "o-", label=f"{n} iterations")
        axis.set(title=f"{model}, {1e3 * spacing:g} mm, {mix.split(',')[0]} Pa", xscale="log")
        axis.axhline(0.0, color="k", lw=0.5)
        axis.set_xticks(STEPS, ["1", "1/2", "1/4", "1/8"])
        axis.minorticks_off()
        axis.grid(alpha=0.3)
    for axis in axes[:, 0]:
        axis.set_ylabel("error of the slump at 1 s [mm]")
    for axis in axes[1]:
        axis.set_xlabel("step over the scene's own")
    axes[0, -1].legend(fontsize=7)
    figure.tight_layout()
    figure.savefig(points.FIGURES / "step.png", dpi=110)


if __name__ == "__main__":
    points.main(__file__, "convergence", cases, point, draw, __doc__)
