"""The models of the slump test side by side: particles, CPU seconds, slump, spread.

    python benchmarks/models.py 0.01 100 300 500 1000   # spacing [m], yield values [Pa]: one JSON each in results/
    python benchmarks/models.py table                   # Markdown of all that is there

The models of one yield value run one after the other in one process and one thread, so that their CPU seconds, without
the first step, which compiles, can be compared.
"""

import json
import sys
from pathlib import Path

RESULTS = Path(__file__).resolve().parent / "results"
MODELS = ["full", "half", "quarter"]


def run(model: str, spacing: float, yield_value: float) -> dict:
    """One slump to rest, 5 s at most: what the table needs, in SI units."""
    import taichi_mps as mps

    mps.init(threads=1)
    sim = mps.Simulation(mps.slump_cone(model=model, spacing=spacing, yield_value=yield_value))
    iterations = []
    sim.each_step(lambda s: iterations.append(s.report.pressure_iterations))
    sim.run()
    summary = sim.summary()
    kept = ("fluid_particles", "steps", "simulated_seconds", "stopped_by", "cpu_seconds", "slump_m", "slump_max_m")
    kept += ("spread_m", "volume_error")
    return {"model": model, **{key: summary[key] for key in kept}, "iterations": sum(iterations)}


def compare(spacing: float, yield_value: float) -> None:
    """Run every model and write the JSON of this yield value."""
    rows = [run(model, spacing, yield_value) for model in MODELS]
    result = {"spacing": spacing, "yield_value": yield_value, "rows": rows}
    path = RESULTS / f"models_{yield_value:g}Pa_{1e3 * spacing:g}mm.json"
    path.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    print("\n".join(lines(result)), flush=True)


def lines(result: dict) -> list[str]:
    """Rows of the Markdown table: differences and ratios are those to the first model."""
    first, found = result["rows"][0], []
    for row in result["rows"]:
        cells = [f"{1e3 * result['spacing']:g} mm", f"{result['yield_value']:g} Pa", row["model"]]
        cells += [f"{row['fluid_particles']:,}", f"{row['cpu_seconds']:.1f}"]
        cells += [f"{row['cpu_seconds'] / first['cpu_seconds']:.3f}", f"{row['iterations'] / first['iterations']:.3f}"]
        for key in ("slump_m", "spread_m"):
            cells.append(f"{1e3 * row[key]:.1f} ({1e3 * (row[key] - first[key]):+.1f})")
        found.append("| " + " | ".join(cells) + " |")
    return found


def table() -> str:
    """Markdown of all results, by spacing and yield value."""
    head = "| l0 | yield value | model | particles | CPU-s | of full | iterations, of full | slump [mm] | spread [mm] |"
    results = [json.loads(path.read_text(encoding="utf-8")) for path in RESULTS.glob("models_*mm.json")]
    results.sort(key=lambda result: (-result["spacing"], result["yield_value"]))
    return "\n".join([head, "|" + "---|" * 9, *(line for result in results for line in lines(result))])


if __name__ == "__main__":
    words = sys.argv[1:]
    if not words:
        sys.exit(__doc__)
    if words == ["table"]:
        print(table())
    else:
        for tau in words[1:]:
            compare(float(words[0]), float(tau))
