"""Shared code of the benchmarks: cases run in processes and kept in one JSON with their origin; tables in pages."""

import json
import subprocess
import sys
from functools import cache
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.append(str(ROOT))
from validation import provenance  # noqa: E402

RESULTS, FIGURES, DOCS = ROOT / "benchmarks" / "results", ROOT / "docs" / "figures", ROOT / "docs"
ASIDE = 1e-6  # by how much particles stand aside in repeated runs [spacings]


@cache
def head() -> dict:
    """Head of a result that this process writes: commit, date, processor, versions, hash of the numerics."""
    return provenance.head(RESULTS)


def stamp(made=None) -> str:
    """The head, or another one, in a line, for a file that is not JSON."""
    made = made or head()
    return "; ".join(f"{key} {made[key]}" for key in ("commit", "date", "processor", "python", "taichi", "fingerprint"))


def aside(shape, spacing: float, seed: int) -> np.ndarray:
    """Random shifts [m] of a repeated run, none in the first, whose ``seed`` is 0."""
    return ASIDE * spacing * np.random.default_rng(seed).uniform(-1.0, 1.0, shape) * (seed > 0)


# ---- results -------------------------------------------------------------------------------------------------------
def load(name: str) -> dict:
    """results/<name>.json; empty if there is none yet."""
    file = RESULTS / f"{name}.json"
    return json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}


def save(name: str, result: dict) -> None:
    """Write results/<name>.json under its head, whole or not at all; points that are kept have one each."""
    draft, made = RESULTS / f"{name}.json.part", result.get("machine") or head()
    draft.write_text(json.dumps({"machine": made} | result, indent=1) + "\n", encoding="utf-8")
    draft.replace(RESULTS / f"{name}.json")


def read(name: str) -> dict[str, dict]:
    """Results by the key of their point."""
    return load(name).get("points", {})


def child(script: str, *words) -> dict:
    """Run a script in a process of its own, and read the JSON that it prints as its last line."""
    call = [sys.executable, script, *map(str, words)]
    return json.loads(subprocess.run(call, stdout=subprocess.PIPE, text=True, check=True).stdout.splitlines()[-1])


def run(script: str, name: str, points: dict[str, dict]) -> None:
    """Run every point (key: its settings) that has no result in results/<name>.json yet, each in a process of its own,
    and add it there. The script is called as ``script point <settings>`` and prints the result as its last line."""
    for key, settings in points.items():
        if key in read(name):
            continue
        call = [sys.executable, script, "point", json.dumps(settings)]
        done = subprocess.run(call, capture_output=True, text=True, cwd=ROOT)
        if done.returncode != 0:
            sys.exit(f"{key}: {done.stderr[-2000:]}")
        result = {"machine": head()} | settings | json.loads(done.stdout.splitlines()[-1])
        save(name, {"points": read(name) | {key: result}})
        print(f"{key}: {json.dumps(result)}", flush=True)


def main(script: str, name: str, cases, point, draw, about: str) -> None:
    """A benchmark from its command line: ``run`` its cases (all, or the named), ``draw``, or run one ``point``."""
    what, *words = sys.argv[1:] or ["help"]
    if what == "run" and set(words) <= set(cases()):
        run(script, name, {key: each for key, each in cases().items() if not words or key in words})
    elif what == "draw":
        draw()
    elif what == "point":
        print(json.dumps(point(**json.loads(words[0]))))
    else:
        sys.exit(about)


# ---- pages ---------------------------------------------------------------------------------------------------------
def table(head, rows) -> str:
    """Markdown of cells."""
    lines = ["| " + " | ".join(str(cell) for cell in cells) + " |" for cells in (head, *rows)]
    return "\n".join([lines[0], "|" + "---|" * len(head), *lines[1:]])


def put(page: str, name: str, text: str, results=()) -> None:
    """Replace what stands between the marks of ``name`` in a page of docs/, and say where its results come from."""
    block = f"{text}\n\n{provenance.origin(results)}" if results else text
    page = DOCS / page
    page.write_text(
        provenance.between(page.read_text(encoding="utf-8"), f"benchmarks/{name}.py", block), encoding="utf-8"
    )


def pyplot():
    """matplotlib.pyplot, without a screen."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    return plt


def set_log_ticks(axis) -> None:
    """Ticks at 1, 2 and 5 times powers of ten on both logarithmic sides; beyond five decades at the powers only."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    for side in (axis.xaxis, axis.yaxis):
        low, high = side.get_view_interval()
        side.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < 1e5 * low else (1.0,)))
        side.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        side.set_minor_formatter(NullFormatter())
