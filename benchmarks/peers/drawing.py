"""docs/peers.md and its charts from benchmarks/results/peers_*.json."""

import json
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
RESULTS, PAGE, FIGURES = ROOT / "benchmarks/results", ROOT / "docs/peers.md", ROOT / "docs/figures"
BEGIN, END = "<!-- written by benchmarks/peers/compare.py -->", "<!-- end of benchmarks/peers/compare.py -->"
COLOURS = {"taichi_mps": "C0", "newton": "C1", "openfoam": "C2", "pysph": "C3", "splishsplash": "C4"}
SLUMP_HEAD = ["run", "particles or cells", "steps", "CPU-s", "whole process", "worst slump [mm]", "spread [%]"]
DAM_HEAD = ["run", "particles", "steps", "CPU-s per s", "particle-steps per CPU-s", "front [%]", "front, no delay [%]"]


def read() -> list[dict]:
    """The results in the order of the names of the cases, slumps before the dam break."""
    found = [json.loads(path.read_text(encoding="utf-8")) for path in RESULTS.glob("peers_*.json")]
    return sorted(found, key=lambda result: (result["case"] == "dam_break", result["case"]))


def slump_cells(row: dict) -> list[str]:
    return [
        row["label"],
        f"{row['elements']:,}",
        f"{row['steps']:,}",
        f"{row['cpu_seconds']:.1f}",
        f"{row['process_cpu_seconds']:.1f}",
        f"{1e3 * row['worst_slump_error_m']:+.1f}",
        f"{100 * row['spread_error']:+.1f}",
    ]


def dam_cells(row: dict) -> list[str]:
    return [
        row["label"],
        f"{row['elements']:,}",
        f"{row['steps']:,}",
        f"{row['cpu_seconds'] / row['simulated_seconds']:.1f}",
        f"{row['elements'] * row['steps'] / row['cpu_seconds']:,.0f}",
        f"{100 * row['front_error']:.1f} (gate {row['gate_delay']:.2f} late)",
        f"{100 * row['front_error_no_delay']:.1f}",
    ]


def table(result: dict) -> str:
    """One case in Markdown; a run that failed says why."""
    head, cells = (DAM_HEAD, dam_cells) if result["case"] == "dam_break" else (SLUMP_HEAD, slump_cells)
    lines = [f"### {result['title']}", "", "| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    for row in result["rows"]:
        lines.append(f"| {row['label']} | {row['failed']} |" if "failed" in row else f"| {' | '.join(cells(row))} |")
    facts = result["machine"]
    load = [row["load_average"] for row in result["rows"]]
    lines += [
        "",
        f"{facts['cpu']}, {facts['cores']} cores, {facts['date']}, load {min(load):.0f} to {max(load):.0f}.",
        "",
    ]
    return "\n".join(lines)


def chart(results: list[dict], better: str, path: Path) -> None:
    """Error against CPU seconds of each case, logarithmic."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    columns = min(3, len(results))
    rows = -(-len(results) // columns)
    figure, axes = plt.subplots(rows, columns, figsize=(4.2 * columns, 3.4 * rows), squeeze=False)
    for axis in axes.flat[len(results) :]:
        axis.set_visible(False)
    for axis, result in zip(axes.flat, results, strict=False):
        for row in (row for row in result["rows"] if "failed" not in row):
            error = 1e3 * abs(row["worst_slump_error_m"]) if better == "slump" else 100 * row["front_error"]
            cost = row["cpu_seconds"] / row["simulated_seconds"]
            axis.loglog(cost, error, "o", color=COLOURS[row["peer"]])
            axis.annotate(
                row["label"].split(", ", 1)[-1], (cost, error), xytext=(4, 4), textcoords="offset points", fontsize=6
            )
        axis.set_title(result["title"], fontsize=9)
        axis.margins(0.35)
        axis.grid(alpha=0.3, which="both")
        axis.set_xlabel("CPU seconds for 1 s")
        axis.set_ylabel("worst error of the slump [mm]" if better == "slump" else "worst error of the front [%]")
    names = {row["peer"] for result in results for row in result["rows"]}
    handles = [plt.Line2D([], [], marker="o", ls="", color=c, label=n) for n, c in COLOURS.items() if n in names]
    figure.legend(handles=handles, loc="upper center", ncols=len(handles), fontsize=8)
    figure.tight_layout(rect=(0, 0, 1, 0.94))
    figure.savefig(path, dpi=110)


def draw() -> None:
    """The tables between the marks of docs/peers.md, and the charts beside it."""
    results = read()
    if not results:
        raise SystemExit("no benchmarks/results/peers_*.json: run first")
    before, rest = PAGE.read_text(encoding="utf-8").split(BEGIN)
    tables = "\n".join(table(result) for result in results)
    PAGE.write_text(f"{before}{BEGIN}\n\n{tables}\n{END}{rest.split(END)[1]}", encoding="utf-8")
    for kind in ("slump", "dam"):
        chosen = [result for result in results if (result["case"] == "dam_break") == (kind == "dam")]
        if chosen:
            chart(chosen, kind, FIGURES / f"peers_{kind}.png")
