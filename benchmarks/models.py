"""The models of the slump test side by side: particles, CPU seconds, errors of slump and spread.

    python benchmarks/models.py 100 300 500 1000   # yield values [Pa]: one JSON each in results/
    python benchmarks/models.py 40,30 80,150       # with a plastic viscosity [Pa s], by default 50 Pa s
    python benchmarks/models.py draw               # docs/models.md, its chart, and what --accuracy chooses from

The models of one mix run one after the other in one process and one thread, each five times, with particles that start
1e-6 l0 aside: errors and CPU seconds are means, +- the standard deviation of a run. CPU seconds are without the first
step, which compiles. The reference is the finite elements of a true Bingham material with inertia, +-0.4 mm. Errors:
engine - reference.
"""

import json
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "benchmarks" / "results"
PAGE, CHART = ROOT / "docs/models.md", ROOT / "docs/figures/models.png"
BEGIN, END = "<!-- written by benchmarks/models.py -->", "<!-- end of benchmarks/models.py -->"
VARIANTS = [("full", 0.02), ("full", 0.01), ("half", 0.01)]
VARIANTS += [("quarter", spacing) for spacing in (0.02, 0.015, 0.01, 0.0075)]
VARIANTS += [("axisymmetric", spacing) for spacing in (0.02, 0.01, 0.005, 0.0025)]
RUNS, ASIDE = 5, 1e-6  # ASIDE in spacings
SCATTERS = "slump_error_m", "spread_error"  # of which the standard deviation of a run is kept
USUAL = 50.0  # plastic viscosity [Pa s] of the mixes that all models are run for
ONLY_USUAL = ("quarter", 0.015), ("quarter", 0.0075), ("axisymmetric", 0.0025)


def reference(yield_value: float, plastic_viscosity: float) -> dict:
    """Slumps [m] of the finite elements by their time [s], slump and spread [m] at their end, and when that is where
    they did not come to rest."""
    from taichi_mps.validation import read_reference
    from taichi_mps.validation.slumps import MILESTONES, inertial

    if plastic_viscosity == USUAL:
        lines, until = inertial("summary", yield_value, "A", 0.0), 5.0
    else:
        lines, until = read_reference("A_fe_inertial_soft.csv"), None
        mix = yield_value, plastic_viscosity
        lines = [r for r in lines if (float(r["yield_value_Pa"]), float(r["plastic_viscosity_Pa_s"])) == mix]
    slumps = {float(r["time_s"]): 1e-3 * float(r["mean20_mm"]) for r in lines if r["kind"] == "fixed"}
    last = {"slump": 1e-3 * float(lines[-1]["mean20_mm"]), "spread": 1e-3 * float(lines[-1]["spread_mm"])}
    return {"slumps": {t: slumps[t] for t in MILESTONES if t in slumps}, **last, "until": until}


def run(model: str, spacing: float, yield_value: float, plastic_viscosity: float) -> dict:
    """RUNS slumps to rest: what the table needs, means in SI units."""
    import taichi_mps as mps

    exact = reference(yield_value, plastic_viscosity)
    mps.init(threads=1)
    mix = {"yield_value": yield_value, "plastic_viscosity": plastic_viscosity}
    sim = mps.Simulation(mps.slump_cone(model=model, spacing=spacing, until=exact["until"], **mix))
    start, history, volume, found = sim.state(), [], [], []
    for seed in range(RUNS):
        aside = ASIDE * spacing * np.random.default_rng(seed).uniform(-1.0, 1.0, start["x"].shape)
        sim.restart(sim.problem, {**start, "x": start["x"] + aside})
        history.clear()
        volume.clear()
        sim.every(0.1, lambda s: history.append((s.time, s.measures()["slump_m"])))
        sim.each_step(lambda s: volume.append(abs(s.report.volume_error)))
        sim.run()
        times, slumps = np.array(history).T
        measures = sim.measures()
        errors = [np.interp(t, times, slumps) - slump for t, slump in exact["slumps"].items()]
        found.append(
            {
                "steps": sim.steps,
                "simulated_seconds": sim.time,
                "cpu_seconds": sim.cpu_seconds,
                "spread_m": measures["spread_m"],
                "slump_error_m": measures["slump_m"] - exact["slump"],
                "spread_error": measures["spread_m"] / exact["spread"] - 1.0,
                "worst_volume_error": max(volume),
                "errors": np.array([*errors, measures["slump_m"] - exact["slump"]]),
            }
        )
    mean = {key: np.mean([one[key] for one in found], axis=0) for key in found[0]}
    scatter = {f"{key}_scatter": np.std([one[key] for one in found], ddof=1) for key in SCATTERS}
    worst = max(mean.pop("errors"), key=abs)
    told = {key: float(value) for key, value in (mean | scatter | {"worst_slump_error_m": worst}).items()}
    return {"model": model, "spacing": spacing, "runs": RUNS, "fluid_particles": len(start["x"])} | told


def compare(yield_value: float, plastic_viscosity: float) -> None:
    """Run every model and write the JSON of this mix."""
    usual, rows = plastic_viscosity == USUAL, []
    found = {"yield_value": yield_value, "plastic_viscosity": plastic_viscosity, "rows": rows}
    for model, spacing in VARIANTS:
        if usual or (model, spacing) not in ONLY_USUAL:
            rows.append(run(model, spacing, yield_value, plastic_viscosity))
            print("| ".join(cells(found, rows[-1])), flush=True)
    name = f"models_{yield_value:g}Pa" + ("" if usual else f"_{plastic_viscosity:g}Pas")
    (RESULTS / f"{name}.json").write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


def cells(mix: dict, row: dict) -> list[str]:
    """One line of the table."""
    return [
        f"{mix['yield_value']:g} Pa, {mix['plastic_viscosity']:g} Pa s",
        f"{row['model']}, {1e3 * row['spacing']:g} mm",
        f"{row['fluid_particles']:,}",
        f"{row['cpu_seconds']:.1f}",
        f"{1e3 * row['slump_error_m']:+.1f} ± {1e3 * row['slump_error_m_scatter']:.1f}",
        f"{1e3 * row['worst_slump_error_m']:+.1f}",
        f"{100 * row['spread_error']:+.1f} ± {100 * row['spread_error_scatter']:.1f}",
        f"{100 * row['worst_volume_error']:.2f}",
    ]


def read() -> list[dict]:
    found = [json.loads(path.read_text(encoding="utf-8")) for path in RESULTS.glob("models_*.json")]
    return sorted(found, key=lambda result: (result["yield_value"], result["plastic_viscosity"]))


def table(results: list[dict]) -> str:
    """Markdown of all results, by mix."""
    head = ["mix", "model, l0", "particles", "CPU-s", "slump at rest [mm]", "worst slump [mm]", "spread [%]"]
    lines = ["| " + " | ".join([*head, "worst volume [%]"]) + " |", "|" + "---|" * 8]
    for result in results:
        lines += ["| " + " | ".join(cells(result, row)) + " |" for row in result["rows"]]
    return "\n".join(lines)


def reach_error(row: dict) -> float:
    """Error of half of the spread at rest [m]."""
    return 0.5 * row["spread_m"] * (1.0 - 1.0 / (1.0 + row["spread_error"]))


def measured(results: list[dict]) -> list:
    """What the package keeps: errors over the height, by model, spacing and mix."""
    from taichi_mps.problem.accuracy import HEIGHT, Measured, Mix

    return [
        Measured(
            row["model"],
            round(row["spacing"] / HEIGHT, 9),
            *(round(number, 9) for number in Mix.of(result["yield_value"], result["plastic_viscosity"])),
            abs(row["worst_slump_error_m"]) / HEIGHT,
            abs(reach_error(row)) / HEIGHT,
            row["worst_volume_error"],
            row["cpu_seconds"],
            row["slump_error_m_scatter"] / HEIGHT,
            0.5 * row["spread_m"] * row["spread_error_scatter"] / HEIGHT,
        )
        for result in results
        for row in result["rows"]
    ]


def draw() -> None:
    """The table in docs/models.md, the chart beside it, and the data of --accuracy."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    from taichi_mps.problem import accuracy

    results = read()
    before, rest = PAGE.read_text(encoding="utf-8").split(BEGIN)
    PAGE.write_text(f"{before}{BEGIN}\n\n{table(results)}\n\n{END}{rest.split(END)[1]}", encoding="utf-8")
    accuracy.write(measured(results))
    results = [result for result in results if result["plastic_viscosity"] == USUAL]
    figure, axes = plt.subplots(1, len(results), figsize=(3.4 * len(results), 3.4), sharex=True, sharey=True)
    for axis, result in zip(axes, results, strict=True):
        for model, colour in zip(dict(VARIANTS), ("C0", "C1", "C2", "C3"), strict=True):
            rows = [row for row in result["rows"] if row["model"] == model]
            cost, error = ([row[key] for row in rows] for key in ("cpu_seconds", "worst_slump_error_m"))
            error, bar = 1e3 * np.abs(error), np.array([1e3 * row["slump_error_m_scatter"] for row in rows])
            axis.errorbar(cost, error, [np.minimum(bar, 0.9 * error), bar], fmt="o-", color=colour, label=model)
            for row, x, y in zip(rows, cost, error, strict=True):
                axis.annotate(f"{1e3 * row['spacing']:g}", (x, y), xytext=(3, 3), textcoords="offset points")
        axis.set(xscale="log", yscale="log")
        axis.set(title=f"{result['yield_value']:g} Pa", xlabel="CPU seconds to rest")
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("worst error of the slump [mm]")
    axes[0].set_yticks([0.5, 1, 2, 5], ["0.5", "1", "2", "5"])
    axes[0].yaxis.set_minor_formatter("")
    axes[-1].legend(fontsize=7)
    figure.tight_layout()
    figure.savefig(CHART, dpi=110)


if __name__ == "__main__":
    words = sys.argv[1:]
    if not words:
        sys.exit(__doc__)
    if words == ["draw"]:
        draw()
    else:
        for word in words:
            tau, eta = (float(number) for number in f"{word},{USUAL}".split(",")[:2])
            compare(tau, eta)
