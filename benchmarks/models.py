"""The models of the slump test side by side: particles, CPU seconds, errors of slump and spread.

    python benchmarks/models.py 100 300 500 1000   # yield stresses [Pa]: one JSON each in results/
    python benchmarks/models.py 40,30 80,150       # with a plastic viscosity [Pa s], by default 50 Pa s
    python benchmarks/models.py draw               # docs/models.md, its chart, and what --accuracy chooses from

The models of one mix run one after the other in one process and one thread, each five times, with particles that start
1e-6 l0 aside: errors and CPU seconds are means, +- the standard deviation of a run. CPU seconds are without the first
step, which compiles. The reference is the finite elements of a true Bingham material with inertia, +-0.4 mm. Errors:
engine - reference.
"""

import sys

import numpy as np
import points

import taichi_mps as mps
from taichi_mps.forecast.accuracy import HEIGHT, MEASURED, MixNumbers, ModelErrors
from validation import columns
from validation.slumps import MILESTONES, inertial

VARIANTS = [("full", 0.02), ("full", 0.01), ("half", 0.01)]
VARIANTS += [("quarter", spacing) for spacing in (0.02, 0.015, 0.01, 0.0075)]
VARIANTS += [("axisymmetric", spacing) for spacing in (0.02, 0.01, 0.005, 0.0025)]
RUNS = 5
HEAD = ["mix", "model, l0", "particles", "CPU-s", "slump at rest [mm]", "worst slump [mm]", "slump flow [%]"]
HEAD += ["worst volume [%]"]
SCATTERS = "slump_error_m", "spread_error"  # of which the standard deviation of a run is kept
USUAL = 50.0  # plastic viscosity [Pa s] of the mixes that all models are run for
ONLY_USUAL = ("quarter", 0.015), ("quarter", 0.0075), ("axisymmetric", 0.0025)


def finite_elements(yield_value: float, plastic_viscosity: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times [s], slumps and spreads [m] of the finite elements."""
    if plastic_viscosity == USUAL:
        return inertial(yield_value)
    known = columns("A_fe_inertial_soft.csv", yield_value_Pa=yield_value, plastic_viscosity_Pa_s=plastic_viscosity)
    return known["time_s"], 1e-3 * known["mean20_mm"], 1e-3 * known["spread_mm"]


def reference(yield_value: float, plastic_viscosity: float) -> dict:
    """Milestones [s] that the finite elements have and their slumps [m] there, slump and spread [m] at their end, and
    when that is where they did not come to rest."""
    times, slumps, spreads = finite_elements(yield_value, plastic_viscosity)
    until = 5.0 if plastic_viscosity == USUAL else None
    shared = [t for t in MILESTONES if t in times]
    last = {"slump": slumps[-1], "spread": spreads[-1], "until": until}
    return {"times": shared, "slumps": np.interp(shared, times, slumps)} | last


def run(model: str, spacing: float, yield_value: float, plastic_viscosity: float) -> dict:
    """RUNS slumps to rest: what the table needs, means in SI units."""
    exact = reference(yield_value, plastic_viscosity)
    mps.init(threads=1)
    mix = {"yield_value": yield_value, "plastic_viscosity": plastic_viscosity}
    sim = mps.Simulation(mps.slump_cone(model=model, spacing=spacing, until=exact["until"], **mix))
    start, found = sim.state(), []
    for seed in range(RUNS):
        history = []
        sim.restart(sim.problem, {**start, "x": start["x"] + points.aside(start["x"].shape, spacing, seed)})
        sim.every(0.1, lambda s, history=history: history.append((s.time, s.measures()["slump_m"])))
        sim.run()
        measures, end = sim.measures(), sim.measures()["slump_m"] - exact["slump"]
        found.append(
            {
                "steps": sim.steps,
                "simulated_seconds": sim.time,
                "cpu_seconds": sim.cpu_seconds,
                "spread_m": measures["spread_m"],
                "slump_error_m": end,
                "spread_error": measures["spread_m"] / exact["spread"] - 1.0,
                "worst_volume_error": sim.report.volume_error_max,
                "errors": np.append(np.interp(exact["times"], *np.array(history).T) - exact["slumps"], end),
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
    points.save(f"models_{yield_value:g}Pa" + ("" if usual else f"_{plastic_viscosity:g}Pas"), found)


def cells(mix: dict, row: dict) -> list[str]:
    """Cells of one line of the table."""
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
    found = [points.load(path.stem) for path in points.RESULTS.glob("models_*.json")]
    return sorted(found, key=lambda result: (result["yield_value"], result["plastic_viscosity"]))


def reach_error(row: dict) -> float:
    """Error of half of the spread at rest [m]."""
    return 0.5 * row["spread_m"] * (1.0 - 1.0 / (1.0 + row["spread_error"]))


def measured(results: list[dict]) -> list:
    """Rows for the file of the package: errors over the height, by model, spacing and mix."""
    return [
        ModelErrors(
            row["model"],
            round(row["spacing"] / HEIGHT, 9),
            *(round(number, 9) for number in MixNumbers.of(result["yield_value"], result["plastic_viscosity"])),
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


def write(rows: list) -> None:
    """Write the file that the package reads, errors and costs shortened to three digits."""
    lines = [
        "# Errors of the slump cone beside finite elements with inertia, over its height; spread: of half of it.",
        "# Written by `python benchmarks/models.py draw`; yield_number tau_y/(rho g H), viscosity_number",
        "# eta/(rho sqrt(g H^3)), slump and volume: the largest at any time, CPU-s: of one thread, to rest. Means of",
        "# five runs, whose particles start 1e-6 spacings aside, and the standard deviations of one.",
        ",".join(ModelErrors._fields),
        *(",".join([*map(str, row[:4]), *(f"{number:.3g}" for number in row[4:])]) for row in rows),
    ]
    MEASURED.write_text("\n".join(lines) + "\n", encoding="utf-8")


def draw() -> None:
    """The table in docs/models.md, the chart beside it, and the data of --accuracy."""
    plt, results = points.pyplot(), read()
    lines = [cells(result, row) for result in results for row in result["rows"]]
    points.put("models.md", "models", points.table(HEAD, lines), results)
    write(measured(results))
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
    figure.savefig(points.FIGURES / "models.png", dpi=110)


if __name__ == "__main__":
    words = sys.argv[1:]
    if words == ["draw"]:
        draw()
    elif words and all(word[0].isdigit() for word in words):
        for word in words:
            tau, eta = (float(number) for number in f"{word},{USUAL}".split(",")[:2])
            compare(tau, eta)
    else:
        sys.exit(__doc__)
