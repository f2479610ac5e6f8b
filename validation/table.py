"""Runs rows of the validation table and writes it: one process a row, results as JSON, the table as Markdown."""

import json
import subprocess
import sys
import time
from dataclasses import asdict
from itertools import cycle, zip_longest
from pathlib import Path

import numpy as np

from taichi_mps.engine.problem.numerics import NUMERICS
from taichi_mps.study import chart
from taichi_mps.units import Duration, SceneError, require, suggestion, user_path, validated

from . import L2_ERROR, SLUMP_ERROR, Measured, Setting, provenance
from .cases import CHOSEN_ON, ROWS

PANELS = {L2_ERROR: ("particles across", -1), SLUMP_ERROR: ("spacing [mm]", 1)}  # x axis, sign of the slope there
VERDICTS = {True: "met", False: "**missed**"}
COMMAND = "python -m validation"
BEGIN, END = f"<!-- written by {COMMAND} -->", f"<!-- end of {COMMAND} -->"


# ---- running ---------------------------------------------------------------------------------------------------
def run_row(name: str, scheme: str = "implicit", budget: float | None = None) -> dict:
    """Run one row in this process (Taichi not started yet), for ``budget`` CPU-seconds at most: its numbers, what
    ended it early, the seconds it took."""
    import taichi_mps as mps

    mps.init(threads=1)
    begin, numbers, series, error = time.perf_counter(), [], [], None
    Setting.scheme, Setting.budget, Setting.begin = scheme, budget, time.process_time()
    try:
        for item in ROWS[name].function(**ROWS[name].settings):
            if isinstance(item, Measured):
                numbers.append(asdict(item) | {"value": float(item.value), "met": item.met})
            else:
                series.append(item)
    except SceneError as refusal:
        error = f"not run: {refusal}".split(";")[0]
    except (mps.DivergedError, TimeoutError) as failure:
        error = str(failure).split(";")[0]  # without the remedy
    spent, wall = time.process_time() - Setting.begin, time.perf_counter() - begin
    return result(name, error, numbers, series, round(spent, 1), round(wall, 1))


def result(name: str, error: str | None, numbers=(), series=(), cpu_seconds=0.0, wall_seconds=0.0) -> dict:
    """Make the JSON-ready result of a row."""
    facts = {"row": name, "case": ROWS[name].case, "reference": ROWS[name].reference}
    found = {"numbers": list(numbers), "series": list(series), "error": error}
    return facts | found | {"cpu_seconds": cpu_seconds, "wall_seconds": wall_seconds}


def run_apart(name: str, scheme: str = "implicit", budget: float | None = None) -> dict:
    """Run a row in a process of its own; a crash is a result with an error, not the end of the table."""
    code = f"import json; from validation.table import run_row; print(json.dumps(run_row{name, scheme, budget}))"
    done = subprocess.run([sys.executable, "-c", code], cwd=provenance.ROOT, capture_output=True, text=True)
    if done.returncode == 0:
        return json.loads(done.stdout.splitlines()[-1])
    return result(name, (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1])


@validated
def run_table(
    names: list[str],
    quick: bool,
    folder: Path,
    page: str | None = None,
    scheme="implicit",
    budget: Duration | None = None,
) -> tuple[str, list[dict]]:
    """Run rows (all, or the quick ones, if none is named); table and results of this scheme. Every JSON in ``folder``
    is written as its row ends, and the table there is of all rows that have one, with either scheme."""
    for name in names:
        require(name in ROWS, f"unknown row '{name}'{suggestion(name, ROWS)}; rows: {', '.join(ROWS)}")
    page = page and user_path(page)
    text = page.read_text(encoding="utf-8") if page else BEGIN + END
    require(BEGIN in text and END in text, f"page = {page}: must hold the lines {BEGIN} and {END}")
    folder.mkdir(parents=True, exist_ok=True)
    for each in NUMERICS:
        read_results(folder, each)  # what is damaged is refused before hours are spent
    head = provenance.head(folder)
    for name in names or [row.name for row in ROWS.values() if row.quick or not quick]:
        result = run_apart(name, scheme, budget)
        print(f"{name}: {result['cpu_seconds']:.0f} CPU-s", file=sys.stderr, flush=True)
        kept = json.dumps({"machine": head} | result, indent=1)
        file_of(folder, scheme, name).write_text(kept + "\n", encoding="utf-8")
    kept = {each: read_results(folder, each) for each in NUMERICS}
    text = markdown(kept["implicit"], kept["semi-implicit"])
    (folder / "table.md").write_text(text + "\n", encoding="utf-8")
    if page:
        page.write_text(provenance.between(page.read_text(encoding="utf-8"), COMMAND, text), encoding="utf-8")
        draw(kept["implicit"], page.parent / "figures" / "convergence.png")
    return text, list(kept[scheme].values())


def draw(results: dict[str, dict], out: Path) -> None:
    """Draw the convergence chart of all results that have points for it; without points, or without matplotlib, print a
    line that says so."""
    try:
        convergence([item for result in results.values() for item in result.get("series", ())], out)
    except (ImportError, ValueError) as missing:
        print(f"{out.name} is not drawn: {missing}", file=sys.stderr)


def convergence(series, out: Path) -> None:
    """Plot errors against the resolution, log-log, with guides of the orders 1 and 1.5; one panel for each quantity of
    PANELS. ``series``: [{quantity, curve, x, y}]; points of the same curve are joined. A panel without points is left
    out; ValueError if all are."""
    curves = {}  # quantity -> curve -> points
    for item in series:
        points = curves.setdefault(item["quantity"], {}).setdefault(item["curve"], [])
        points += [(x, y) for x, y in zip(item["x"], item["y"], strict=True) if y > 0.0]
    shown = [quantity for quantity in PANELS if curves.get(quantity)]
    if not shown:
        raise ValueError("no result holds errors at several spacings")
    figure, axes = chart._figure(6.6 * len(shown), 4.8, len(shown), squeeze=False)
    from matplotlib.ticker import LogLocator

    for panel, quantity in zip(axes.flat, shown, strict=True):
        label, sign = PANELS[quantity]
        lines = {curve: np.array(sorted(points)) for curve, points in curves[quantity].items()}
        every = np.concatenate(list(lines.values()))
        panel.set(xscale="log", yscale="log", xlabel=label, title=quantity)
        ends, top = np.sort([every[:, 0].min(), every[:, 0].max()])[::-sign], 1.3 * every[:, 1].max()
        for order in (1.0, 1.5):  # thin, from above the largest error at the coarsest spacing to the finest
            lowest = top * (ends[1] / ends[0]) ** (sign * order)
            panel.plot(ends, (top, lowest), color="#9aa1a9", lw=1.0, ls="--", zorder=1)
            panel.annotate(
                f"order {order:g}",
                (ends[1], lowest),
                (-6 * sign, -3),
                textcoords="offset points",
                color="#6b727a",
                fontsize=10,
                ha="right" if sign < 0 else "left",
                va="top",
                zorder=1,
            )
        for (curve, points), colour in zip(lines.items(), cycle(chart.COLOURS), strict=False):
            panel.plot(*points.T, "o-", color=colour, ms=6, mec="white", mew=0.8, label=curve)
        panel.set_xticks(np.unique(every[:, 0]), [f"{x:g}" for x in np.unique(every[:, 0])], minor=False)
        panel.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        panel.yaxis.set_major_formatter("{x:g}")
        panel.tick_params(which="minor", left=False, bottom=False, labelleft=False, labelbottom=False)
        panel.legend(loc="best", fontsize=10, frameon=False)
    chart._save(figure, out)


def file_of(folder: Path, scheme: str, name: str) -> Path:
    """Path of a row's result file."""
    return folder / f"validate_{'' if scheme == 'implicit' else scheme + '_'}{name}.json"


def read_results(folder: Path, scheme: str) -> dict[str, dict]:
    """Kept results by row, in the order of the table."""
    files = {name: file_of(folder, scheme, name) for name in ROWS}
    try:
        return {name: json.loads(file.read_text(encoding="utf-8")) for name, file in files.items() if file.is_file()}
    except ValueError as error:
        raise SceneError(f"out = {folder}: a result is damaged ({error}); delete it to run its row anew") from None


# ---- as Markdown -----------------------------------------------------------------------------------------------
def markdown(results: dict[str, dict], others: dict[str, dict] | None = None) -> str:
    """The table of results by row: case, reference, quantity, measured, target, met or missed, CPU seconds; beside it
    what the paper's scheme measured (``others``), if there is any."""
    others = others or {}
    head = ["case", "reference", "quantity", "measured", "target", "", "CPU-s"]
    head += ["semi-implicit", "CPU-s"] if others else []
    lines = [head, ["---"] * len(head)]
    for name in ROWS:
        if name in results or name in others:
            lines += cells_of(results.get(name), others.get(name))
    text = "\n".join("| " + " | ".join(cells[: len(head)]) + " |" for cells in lines)
    below = f"\n\nScheme `semi-implicit`: {count(others)}" if others else ""
    made = provenance.origin([*results.values(), *others.values()])
    return f"{text}\n\n{count(results)}{below}\n\n{made}"


def cells_of(result: dict | None, other: dict | None):
    """The cells of the lines of a row, of which one or both schemes have a result. A number that only the other has is
    named; its own name stands beside it where that differs (at rest, at 0.4 s)."""
    row = result or other
    chosen = CHOSEN_ON.get(row.get("row"))
    first = [row["case"] + (f" (calibration: `{'`, `'.join(chosen)}`)" if chosen else ""), row["reference"]]
    seconds = [f"{each['cpu_seconds']:.0f}" if each else "" for each in (result, other)]
    for line, other_line in zip_longest(lines_of(result), lines_of(other)):
        cells, other_value = line or (other_line[0], "-", other_line[2], "-"), ""
        if other_line:
            quantity, value, _, verdict = other_line
            named = f" ({quantity})" * (cells[0] not in ("-", quantity))
            other_value = f"{value}{named}, {verdict}" if value != "-" else other["error"].split(":")[0]
        yield [*first, *cells, seconds[0], other_value, seconds[1]]
        first = seconds = ["", ""]


def lines_of(result: dict | None) -> list[tuple[str, str, str, str]]:
    """Quantity, measured, target and verdict of the numbers of a result, then what ended it early."""
    result = result or {"numbers": [], "error": None}
    lines = [
        (item["quantity"], written(item, "value"), f"<= {written(item, 'target')}", VERDICTS[item["met"]])
        for item in result["numbers"]
    ]
    return lines + [("-", "-", "-", f"**failed**: {result['error']}")] * bool(result["error"])


def written(item: dict, key: str) -> str:
    return f"{item[key]:.3g}" + ("" if item["unit"] == "-" else f" {item['unit']}")


def count(results: dict[str, dict]) -> str:
    """Number of targets met, and of rows that have ended early."""
    met = [item["met"] for result in results.values() for item in result["numbers"]]
    refused = [result["error"].startswith("not run") for result in results.values() if result["error"]]
    text = f"{sum(met)} of {len(met)} numbers meet their target; {len(refused) - sum(refused)} rows failed"
    return text + (f"; {sum(refused)} were not run." if any(refused) else ".")
