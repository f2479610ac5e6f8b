"""docs/peers.md and its charts from benchmarks/results/peers_*.json."""

import points

COLOURS = {"taichi_mps": "C0", "newton": "C1", "openfoam": "C2", "pysph": "C3", "splishsplash": "C4"}
PLACES = [
    (5, 5, "left"),
    (5, -6, "left"),
    (-5, -6, "right"),
    (-5, 5, "right"),
    (5, 14, "left"),
    (5, -15, "left"),
    (-5, 14, "right"),
    (-5, -15, "right"),
    (5, -24, "left"),
    (5, 24, "left"),
]  # [pt]
SLUMP_HEAD = ["run", "particles or cells", "steps", "CPU-s", "whole process", "worst slump [mm]", "slump flow [%]"]
DAM_HEAD = ["run", "particles", "steps", "CPU-s per s", "particle-steps per CPU-s", "front [%]", "front, no delay [%]"]


def read() -> list[dict]:
    """The results in the order of the names of the cases, slumps before the dam break."""
    found = [points.load(path.stem) for path in points.RESULTS.glob("peers_*.json")]
    return sorted(found, key=lambda result: (result["case"] == "dam_break", result["case"]))


def scatter(row: dict, key: str, unit: float) -> str:
    """The standard deviation of a run in this unit, where several were made."""
    return f" ± {unit * row[f'{key}_scatter']:.1f}" if f"{key}_scatter" in row else ""


def slump_cells(row: dict) -> list[str]:
    return [
        row["label"],
        f"{row['elements']:,}",
        f"{row['steps']:,}",
        f"{row['cpu_seconds']:.1f}",
        f"{row['process_cpu_seconds']:.1f}",
        f"{1e3 * row['worst_slump_error_m']:+.1f}{scatter(row, 'worst_slump_error_m', 1e3)}",
        f"{100 * row['spread_error']:+.1f}",
    ]


def dam_cells(row: dict) -> list[str]:
    return [
        row["label"],
        f"{row['elements']:,}",
        f"{row['steps']:,}",
        f"{row['cpu_seconds'] / row['simulated_seconds']:.1f}",
        f"{row['elements'] * row['steps'] / row['cpu_seconds']:,.0f}",
        f"{100 * row['front_error']:.1f}{scatter(row, 'front_error', 100)} (gate {row['gate_delay']:.2f} late)",
        f"{100 * row['front_error_no_delay']:.1f}",
    ]


def table(result: dict) -> str:
    """One case in Markdown; a run that failed says why."""
    head, cells = (DAM_HEAD, dam_cells) if result["case"] == "dam_break" else (SLUMP_HEAD, slump_cells)
    lines = []
    for row in result["rows"]:
        failure = [row["label"], f"failed: {row.get('failed', '').split(';')[0]}", *[""] * (len(head) - 2)]
        lines.append(failure if "failed" in row else cells(row))
    facts, load = result["machine"], [row["load_average"] for row in result["rows"]]
    about = f"{facts.get('processor') or facts['cpu']}, {facts['cores']} cores, {facts['date']}"
    about += f", load {min(load):.0f} to {max(load):.0f}."
    return "\n\n".join([f"### {result['title']}", points.table(head, lines), about])


def panels(results: list[dict]) -> dict[str, list[tuple[str, dict]]]:
    """Runs that succeeded, by the problem they share, each with a short name; of slumps those to 1 s, all spacings."""
    found: dict[str, list[tuple[str, dict]]] = {}
    for result in results:
        title, spacing = result["title"], ""
        if result["case"] != "dam_break":
            title, spacing = title.rsplit(", ", 1)
        for row in result["rows"]:
            if "failed" not in row and (row["simulated_seconds"] == 1.0 or not spacing):
                short = (
                    row["label"]
                    .split(", ", 1)[-1]
                    .replace("implicit, ", "" if spacing else "implicit, ")
                    .replace("creep rate 0.02 1/s, ", "")
                    .replace("voxel 1.5 l0, ", "")
                    .replace(", conservative gradient", "")
                    .replace("twice the Courant number", "twice the step")
                )
                found.setdefault(title, []).append(
                    (f"{spacing} {'' if short == 'implicit' and spacing else short}", row)
                )
    return found


def chart(found: dict[str, list[tuple[str, dict]]], key: str, unit: float, what: str, name: str) -> None:
    """The error ``key`` of a row, in this unit and with its scatter, against its CPU seconds for a second, both
    logarithmic, one panel for each problem."""
    plt = points.pyplot()

    def error(row):
        return unit * abs(row[key])

    columns = min(2, len(found))
    rows = -(-len(found) // columns)
    figure, axes = plt.subplots(
        rows, columns, figsize=(0.8 + 4.6 * columns, 0.6 + 3.3 * rows), squeeze=False, sharex=True, sharey=True
    )
    for axis, (title, runs) in zip(axes.flat, found.items(), strict=False):
        for _, row in runs:
            cost = row["cpu_seconds"] / row["simulated_seconds"]
            bar = unit * row.get(f"{key}_scatter", 0.0)
            axis.errorbar(cost, error(row), [[min(bar, 0.9 * error(row))], [bar]], fmt="o", color=COLOURS[row["peer"]])
        axis.set(xscale="log", yscale="log")
        axis.set_title(title, fontsize=9)
        axis.set(xlabel="CPU seconds for 1 s", ylabel=what)
        axis.grid(alpha=0.3, which="both")
        points.set_log_ticks(axis)
    low, high = axes[0, 0].get_xlim()
    axes[0, 0].set_xlim(low, 4.0 * high)  # room for the names
    low, high = axes[0, 0].get_ylim()
    axes[0, 0].set_ylim(0.8 * low, 1.3 * high)
    names = {row["peer"] for runs in found.values() for _, row in runs}
    handles = [plt.Line2D([], [], marker="o", ls="", color=c, label=n) for n, c in COLOURS.items() if n in names]
    figure.legend(handles=handles, loc="upper center", ncols=len(handles), fontsize=8)
    figure.tight_layout(rect=(0, 0, 1, 0.93))
    for axis, runs in zip(axes.flat, found.values(), strict=False):
        write_names(
            axis, [(name.strip(), row["cpu_seconds"] / row["simulated_seconds"], error(row)) for name, row in runs]
        )
    figure.savefig(points.FIGURES / name, dpi=110)


def write_names(axis, named: list[tuple[str, float, float]]) -> None:
    """Write each name beside its point, at the first place in the panel where it covers no other name and no point."""
    from matplotlib.transforms import Bbox

    taken = [Bbox.from_bounds(*(axis.transData.transform(at) - 4.0), 8.0, 8.0) for _, *at in named]
    for name, *at in named:
        for x, y, side in PLACES:
            text = axis.annotate(name, at, (x, y), textcoords="offset points", fontsize=7, ha=side, va="center")
            box = text.get_window_extent()
            free = box.x0 > axis.bbox.x0 and not any(box.overlaps(other) for other in taken)
            if free or (x, y, side) == PLACES[-1]:
                break
            text.remove()
        taken.append(box)


def draw() -> None:
    """The tables between the marks of docs/peers.md, and the charts beside it."""
    results = read()
    points.put("peers.md", "peers/compare", "\n\n".join(table(result) for result in results), results)
    slumps = panels([result for result in results if result["case"] != "dam_break"])
    dams = panels([result for result in results if result["case"] == "dam_break"])
    chart(slumps, "worst_slump_error_m", 1e3, "worst error of the slump [mm]", "peers_slump.png")
    chart(dams, "front_error", 100.0, "worst error of the front [%]", "peers_dam.png")
