"""Runs rows of the validation table and writes it: one process a row, results as JSON, the table as Markdown."""

import json
import subprocess
import sys
import time
from dataclasses import asdict
from pathlib import Path

from ..quantity import SceneError, suggestion
from . import ROWS, Measured, Series, flows, fluids, slumps  # noqa: F401  (they register their rows)

BEGIN, END = "<!-- written by taichi-mps validate -->", "<!-- end of taichi-mps validate -->"


def run_row(name: str) -> dict:
    """Run one row in this process (Taichi not started yet): its numbers, the seconds it took."""
    import taichi_mps as mps

    mps.init(threads=1)
    cpu, begin = time.process_time(), time.perf_counter()
    row, numbers, series, error = ROWS[name], [], [], None
    try:
        for item in row.run():
            if isinstance(item, Series):
                series.append(asdict(item))
            else:
                numbers.append(asdict(item) | {"value": float(item.value), "met": item.met})
    except (mps.DivergedError, AssertionError) as failure:
        error = f"{type(failure).__name__}: {failure}"
    return {
        "row": name,
        "case": row.case,
        "reference": row.reference,
        "numbers": numbers,
        "series": series,
        "error": error,
        "cpu_seconds": round(time.process_time() - cpu, 1),
        "wall_seconds": round(time.perf_counter() - begin, 1),
    }


def run_apart(name: str) -> dict:
    """The same in a process of its own; a crash is a result with an error, not the end of the table."""
    code = f"import json; from taichi_mps.validation import table; print(json.dumps(table.run_row({name!r})))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    if done.returncode == 0:
        return json.loads(done.stdout.splitlines()[-1])
    lines = done.stderr.strip().splitlines() or [f"exit code {done.returncode}"]
    row = ROWS[name]
    return {"row": name, "case": row.case, "reference": row.reference, "numbers": [], "error": lines[-1],
            "cpu_seconds": 0.0, "wall_seconds": 0.0}  # fmt: skip


def markdown(results: list[dict]) -> str:
    """The table: case, reference, quantity, measured, target, met or missed, CPU seconds."""
    lines = ["| case | reference | quantity | measured | target | | CPU-s |", "|" + "---|" * 7]
    for result in results:
        head = f"| {result['case']} | {result['reference']} "
        seconds = f"{result['cpu_seconds']:.0f}"
        for item in result["numbers"]:
            number = Measured(**{key: item[key] for key in ("quantity", "value", "target", "unit")})
            unit = "" if number.unit == "-" else f" {number.unit}"
            verdict = "met" if number.met else "**missed**"
            lines.append(
                f"{head}| {number.quantity} | {number.value:.3g}{unit} | <= {number.target:.3g}{unit} "
                f"| {verdict} | {seconds} |"
            )
            head, seconds = "| | ", ""
        if result["error"]:
            lines.append(f"{head}| - | - | - | **failed**: {result['error']} | {seconds} |")
    numbers = [item for result in results for item in result["numbers"]]
    met = sum(item["met"] for item in numbers)
    failed = sum(bool(result["error"]) for result in results)
    lines.append(f"\n{met} of {len(numbers)} numbers meet their target; {failed} rows failed.")
    return "\n".join(lines)


def run_table(names: list[str], quick: bool, folder: Path, page: str | None = None) -> tuple[str, list[dict]]:
    """Run rows (all, or the quick ones, if none is named); table and results. Every JSON in ``folder`` is written as
    its row ends, and the table there is of all rows that have one."""
    for name in names:
        if name not in ROWS:
            raise SceneError(f"unknown row '{name}'{suggestion(name, ROWS)}; rows: {', '.join(ROWS)}")
    if page and BEGIN not in Path(page).read_text(encoding="utf-8"):
        raise SceneError(f"page = {page}: must hold the lines {BEGIN} and {END}")
    folder.mkdir(parents=True, exist_ok=True)
    for name in names or [row.name for row in ROWS.values() if row.quick or not quick]:
        result = run_apart(name)
        print(f"{name}: {result['cpu_seconds']:.0f} CPU-s", file=sys.stderr, flush=True)
        (folder / f"validate_{name}.json").write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    files = [folder / f"validate_{name}.json" for name in ROWS]
    results = [json.loads(file.read_text(encoding="utf-8")) for file in files if file.is_file()]
    text = markdown(results)
    (folder / "table.md").write_text(text + "\n", encoding="utf-8")
    if page:
        insert(Path(page), text)
    return text, results


def insert(page: Path, text: str) -> None:
    """Put the table between its marks in a page."""
    before, rest = page.read_text(encoding="utf-8").split(BEGIN)
    page.write_text(f"{before}{BEGIN}\n\n{text}\n\n{END}{rest.split(END)[1]}", encoding="utf-8")
