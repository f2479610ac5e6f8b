"""Runs rows of the validation table and writes it: one process a row, results as JSON, the table as Markdown."""

import json
import subprocess
import sys
import time
from dataclasses import asdict
from itertools import zip_longest
from pathlib import Path

from ..problem.numerics import NUMERICS
from ..units import SceneError, suggestion
from . import L2_ERROR, ROWS, SLUMP_ERROR, Measured, Series, curved, flows, fluids, rational, slumps, standing, vortices
from .scheme import BudgetError, Setting

WITH_ROWS = curved, flows, fluids, rational, slumps, standing, vortices  # each registers its own when it is imported

PANELS = {L2_ERROR: ("particles across", -1), SLUMP_ERROR: ("spacing [mm]", 1)}  # x axis, sign of the slope there
BEGIN, END = "<!-- written by taichi-mps validate -->", "<!-- end of taichi-mps validate -->"


# ---- running ---------------------------------------------------------------------------------------------------
def run_row(name: str, scheme: str = "implicit", budget: float | None = None) -> dict:
    """Run one row in this process (Taichi not started yet), for ``budget`` CPU-seconds at most: its numbers, what
    ended it early, the seconds it took."""
    import taichi_mps as mps

    mps.init(threads=1)
    begin = time.perf_counter()
    Setting.scheme, Setting.budget, Setting.begin = scheme, budget, time.process_time()
    row, numbers, series, error = ROWS[name], [], [], None
    try:
        for item in row.run():
            if isinstance(item, Series):
                series.append(asdict(item))
            else:
                numbers.append(asdict(item) | {"value": float(item.value), "met": item.met})
    except SceneError as refusal:
        error = f"not run: {refusal}".split(";")[0]
    except (mps.DivergedError, BudgetError) as failure:
        error = str(failure).split(";")[0]  # without the remedy
    except AssertionError as failure:
        error = f"AssertionError: {failure}"
    return {
        "row": name,
        "case": row.case,
        "reference": row.reference,
        "numbers": numbers,
        "series": series,
        "error": error,
        "cpu_seconds": round(time.process_time() - Setting.begin, 1),
        "wall_seconds": round(time.perf_counter() - begin, 1),
    }


def run_apart(name: str, scheme: str = "implicit", budget: float | None = None) -> dict:
    """The same in a process of its own; a crash is a result with an error, not the end of the table."""
    call = f"table.run_row({name!r}, {scheme!r}, {budget!r})"
    code = f"import json; from taichi_mps.validation import table; print(json.dumps({call}))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    if done.returncode == 0:
        return json.loads(done.stdout.splitlines()[-1])
    lines = done.stderr.strip().splitlines() or [f"exit code {done.returncode}"]
    row = ROWS[name]
    return {"row": name, "case": row.case, "reference": row.reference, "numbers": [], "series": [],
            "error": lines[-1], "cpu_seconds": 0.0, "wall_seconds": 0.0}  # fmt: skip


def run_table(
    names: list[str], quick: bool, folder: Path, page: str | None = None, scheme="implicit", budget=None
) -> tuple[str, list[dict]]:
    """Run rows (all, or the quick ones, if none is named); table and results of this scheme. Every JSON in ``folder``
    is written as its row ends, and the table there is of all rows that have one, with either scheme."""
    for name in names:
        if name not in ROWS:
            raise SceneError(f"unknown row '{name}'{suggestion(name, ROWS)}; rows: {', '.join(ROWS)}")
    text = Path(page).read_text(encoding="utf-8") if page else BEGIN + END
    if BEGIN not in text or END not in text:
        raise SceneError(f"page = {page}: must hold the lines {BEGIN} and {END}")
    folder.mkdir(parents=True, exist_ok=True)
    for each in NUMERICS:
        read_results(folder, each)  # what is damaged is refused before hours are spent
    for name in names or [row.name for row in ROWS.values() if row.quick or not quick]:
        result = run_apart(name, scheme, budget)
        print(f"{name}: {result['cpu_seconds']:.0f} CPU-s", file=sys.stderr, flush=True)
        file_of(folder, scheme, name).write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    kept = {each: read_results(folder, each) for each in NUMERICS}
    text = markdown(kept["implicit"], kept["semi-implicit"])
    (folder / "table.md").write_text(text + "\n", encoding="utf-8")
    if page:
        insert(Path(page), text)
        draw(kept["implicit"], Path(page).parent / "figures" / "convergence.png")
    return text, list(kept[scheme].values())


def draw(results: dict[str, dict], out: Path) -> None:
    """The convergence chart of all results that have points for it; without points, or without matplotlib, a line that
    says so."""
    from ..viz import plots

    series = [item for result in results.values() for item in result.get("series", ())]
    try:
        plots.convergence(series, PANELS, out)
    except (ImportError, ValueError) as missing:
        print(f"{out.name} is not drawn: {missing}", file=sys.stderr)


def file_of(folder: Path, scheme: str, name: str) -> Path:
    """Where the result of a row is kept."""
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
    head = "| case | reference | quantity | measured | target | | CPU-s |" + " semi-implicit | CPU-s |" * bool(others)
    lines = [head, "|" + "---|" * (9 if others else 7)]
    for name in [name for name in ROWS if name in results or name in others]:
        result, other = results.get(name), others.get(name)
        either = result or other
        left, right = (numbers_of(each) for each in (result, other))
        first, seconds = f"| {either['case']} | {either['reference']} ", [cpu(each) for each in (result, other)]
        for item, their in zip_longest(left, right):
            cell = "" if their is None else beside(their, item)
            lines.append(
                first + line_of(item, their) + f"| {seconds[0]} |" + f" {cell} | {seconds[1]} |" * bool(others)
            )
            first, seconds = "| | ", ["", ""]
    lines.append("\n" + count(results))
    if others:
        lines.append(f"\nScheme `semi-implicit`: {count(others)}")
    return "\n".join(lines)


def numbers_of(result: dict | None) -> list[Measured | str]:
    """The numbers of a result, then the text of what ended it early."""
    if result is None:
        return []
    keys = ("quantity", "value", "target", "unit")
    numbers = [Measured(**{key: item[key] for key in keys}) for item in result["numbers"]]
    return numbers + [result["error"]] * bool(result["error"])


def line_of(item, their) -> str:
    """Quantity, measured, target, verdict; where only the other scheme has a number, what that is."""
    if isinstance(item, str):
        return f"| - | - | - | **failed**: {item} "
    known = item or their
    if not isinstance(known, Measured):
        return "| - | - | - | - "
    value, verdict = (written(item), "met" if item.met else "**missed**") if item else ("-", "-")
    return f"| {known.quantity} | {value} | <= {known.target:.3g}{unit_of(known)} | {verdict} "


def beside(their: Measured | str, item) -> str:
    """The other scheme's number, with its own name where that differs (at rest, at 0.4 s); of what ended it, the text
    before its reason, which its JSON keeps."""
    if isinstance(their, str):
        return their.split(":")[0]
    same = not isinstance(item, Measured) or item.quantity == their.quantity
    return f"{written(their)}{'' if same else f' ({their.quantity})'}, {'met' if their.met else '**missed**'}"


def written(item: Measured) -> str:
    return f"{item.value:.3g}{unit_of(item)}"


def unit_of(item: Measured) -> str:
    return "" if item.unit == "-" else f" {item.unit}"


def cpu(result: dict | None) -> str:
    return "" if result is None else f"{result['cpu_seconds']:.0f}"


def count(results: dict[str, dict]) -> str:
    """How many numbers meet their target, and how many rows have ended early."""
    numbers = [item for result in results.values() for item in result["numbers"]]
    errors = [result["error"] for result in results.values() if result["error"]]
    refused = sum(error.startswith("not run") for error in errors)
    text = f"{sum(item['met'] for item in numbers)} of {len(numbers)} numbers meet their target; "
    text += f"{len(errors) - refused} rows failed"
    return text + (f"; {refused} were not run." if refused else ".")


def insert(page: Path, text: str) -> None:
    """Put the table between its marks in a page."""
    before, rest = page.read_text(encoding="utf-8").split(BEGIN)
    page.write_text(f"{before}{BEGIN}\n\n{text}\n\n{END}{rest.split(END)[1]}", encoding="utf-8")
