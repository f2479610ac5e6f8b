"""The models of the slump test side by side: particles, CPU seconds, errors of slump and spread.

    python benchmarks/models.py 100 300 500 1000   # yield values [Pa]: one JSON each in results/
    python benchmarks/models.py draw               # docs/models.md, its chart, and what --accuracy chooses from

The models of one yield value run one after the other in one process and one thread. Their CPU seconds are without the
first step, which compiles. The reference is the finite elements of a true Bingham material with inertia, eta = 50 Pa s
(validation/reference, +-0.4 mm). Errors: engine - reference.
"""

import json
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "benchmarks" / "results"
PAGE, CHART = ROOT / "docs/models.md", ROOT / "docs/figures/models.png"
CHOICES = ROOT / "taichi_mps/problem/accuracy.json"
BEGIN, END = "<!-- written by benchmarks/models.py -->", "<!-- end of benchmarks/models.py -->"
PARTICLES = "full, wall particles"
VARIANTS = [("full", 0.02), (PARTICLES, 0.01), ("full", 0.01), ("half", 0.01)]
VARIANTS += [("quarter", spacing) for spacing in (0.02, 0.015, 0.01, 0.0075)]
VARIANTS += [("axisymmetric", spacing) for spacing in (0.02, 0.01, 0.005, 0.0025)]


def run(model: str, spacing: float, yield_value: float) -> dict:
    """One slump to rest, 5 s at most: what the table needs, in SI units."""
    import taichi_mps as mps
    from taichi_mps.validation.slumps import MILESTONES, inertial

    lines = [line for line in inertial("summary", yield_value, "A", 0.0)]
    exact = {
        float(line["time_s"]): 1e-3 * float(line["mean20_mm"]) for line in lines if not line["kind"].startswith("final")
    }
    last = lines[-1]
    mps.init(threads=1)
    numerics = mps.Implicit(walls="particles" if model == PARTICLES else "surfaces")
    part = model.split(",")[0]
    sim = mps.Simulation(mps.slump_cone(model=part, spacing=spacing, yield_value=yield_value, until=5.0), numerics)
    history, volume = [], []
    sim.every(0.1, lambda s: history.append((s.time, s.measures()["slump_m"])))
    sim.each_step(lambda s: volume.append(abs(s.report.volume_error)))
    sim.run()
    summary = sim.summary()
    times, slumps = np.array(history).T
    rest = summary["slump_m"] - 1e-3 * float(last["mean20_mm"])
    on_the_way = [np.interp(t, times, slumps) - exact[t] for t in MILESTONES]
    kept = ("fluid_particles", "wall_particles", "steps", "simulated_seconds", "stopped_by", "cpu_seconds")
    return {
        "model": model,
        "spacing": spacing,
        **{key: summary[key] for key in (*kept, "compile_seconds", "slump_m", "spread_m")},
        "slump_error_m": rest,
        "worst_slump_error_m": max([rest, *on_the_way], key=abs),
        "spread_error": summary["spread_m"] / (1e-3 * float(last["spread_mm"])) - 1.0,
        "worst_volume_error": max(volume),
    }


def compare(yield_value: float) -> None:
    """Run every model and write the JSON of this yield value."""
    rows = []
    for model, spacing in VARIANTS:
        rows.append(run(model, spacing, yield_value))
        print("| ".join(cells(yield_value, rows[-1])), flush=True)
    text = json.dumps({"yield_value": yield_value, "rows": rows}, indent=1)
    (RESULTS / f"models_{yield_value:g}Pa.json").write_text(text + "\n", encoding="utf-8")


def cells(yield_value: float, row: dict) -> list[str]:
    """One line of the table."""
    walls = f" + {row['wall_particles']:,}" if row["wall_particles"] else ""
    return [
        f"{yield_value:g} Pa",
        f"{row['model']}, {1e3 * row['spacing']:g} mm",
        f"{row['fluid_particles']:,}{walls}",
        f"{row['cpu_seconds']:.1f}",
        f"{1e3 * row['slump_error_m']:+.1f}",
        f"{1e3 * row['worst_slump_error_m']:+.1f}",
        f"{100 * row['spread_error']:+.1f}",
        f"{100 * row['worst_volume_error']:.2f}",
    ]


def read() -> list[dict]:
    found = [json.loads(path.read_text(encoding="utf-8")) for path in RESULTS.glob("models_*Pa.json")]
    return sorted(found, key=lambda result: result["yield_value"])


def table(results: list[dict]) -> str:
    """Markdown of all results, by yield value."""
    head = ["yield value", "model, l0", "particles", "CPU-s", "slump at rest [mm]", "worst slump [mm]", "spread [%]"]
    lines = ["| " + " | ".join([*head, "worst volume [%]"]) + " |", "|" + "---|" * 8]
    for result in results:
        lines += ["| " + " | ".join(cells(result["yield_value"], row)) + " |" for row in result["rows"]]
    return "\n".join(lines)


def reach_error(row: dict) -> float:
    """Error of half of the spread at rest [m]."""
    return 0.5 * row["spread_m"] * (1.0 - 1.0 / (1.0 + row["spread_error"]))


def choices(results: list[dict]) -> list[dict]:
    """Of each model and spacing the largest error [m] of the slump at any time and of the reach, half of the spread, at
    rest, also of finer ones lest a lucky number be promised, the largest volume error, and the mean CPU seconds over
    the yield values."""
    found = []
    for model, spacing in VARIANTS:
        rows = [
            row for result in results for row in result["rows"] if (row["model"], row["spacing"]) == (model, spacing)
        ]
        if model != PARTICLES:
            error = max(max(abs(row["worst_slump_error_m"]), abs(reach_error(row))) for row in rows)
            cost = sum(row["cpu_seconds"] for row in rows) / len(rows)
            volume = max(row["worst_volume_error"] for row in rows)
            found.append(
                {"model": model, "spacing": spacing, "error": round(error, 4), "volume_error": round(volume, 4)}
            )
            found[-1]["cpu_seconds"] = round(cost, 2)
    for choice in found:
        finer = [
            other for other in found if other["model"] == choice["model"] and other["spacing"] <= choice["spacing"]
        ]
        choice["error"] = max(other["error"] for other in finer)
    return found


def draw() -> None:
    """The table in docs/models.md, the chart beside it, and the data of --accuracy."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    results = read()
    before, rest = PAGE.read_text(encoding="utf-8").split(BEGIN)
    PAGE.write_text(f"{before}{BEGIN}\n\n{table(results)}\n\n{END}{rest.split(END)[1]}", encoding="utf-8")
    CHOICES.write_text(json.dumps(choices(results), indent=1) + "\n", encoding="utf-8")
    figure, axes = plt.subplots(1, len(results), figsize=(3.4 * len(results), 3.4), sharex=True, sharey=True)
    for axis, result in zip(axes, results, strict=True):
        for model, colour in zip(dict(VARIANTS), ("C0", "C1", "C2", "C3", "C4"), strict=True):
            rows = [row for row in result["rows"] if row["model"] == model]
            cost, error = ([row[key] for row in rows] for key in ("cpu_seconds", "worst_slump_error_m"))
            axis.loglog(cost, 1e3 * np.abs(error), "o-", color=colour, label=model)
            for row, x, y in zip(rows, cost, error, strict=True):
                axis.annotate(f"{1e3 * row['spacing']:g}", (x, 1e3 * abs(y)), xytext=(3, 3), textcoords="offset points")
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
        for tau in words:
            compare(float(tau))
