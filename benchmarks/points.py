"""What the benchmarks share: cases run apart and kept in one JSON with the machine's facts, tables put into pages."""

import json
import os
import platform
import subprocess
import sys
from datetime import date
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
RESULTS, FIGURES, DOCS = ROOT / "benchmarks" / "results", ROOT / "docs" / "figures", ROOT / "docs"
ASIDE = 1e-6  # by how much particles stand aside in repeated runs [spacings]


def facts() -> dict:
    """What a result was made with: processor, load, versions, commit, date."""
    import taichi

    import taichi_mps

    cpu = Path("/proc/cpuinfo")
    lines = cpu.read_text(encoding="utf-8").splitlines() if cpu.exists() else []
    models = [line.split(":")[1].strip() for line in lines if line.startswith("model name")]
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True)
    return {
        "processor": models[0] if models else platform.processor() or platform.machine(),
        "cores": os.cpu_count(),
        "load_average": os.getloadavg()[0],
        "system": platform.platform(),
        "python": platform.python_version(),
        "taichi": ".".join(map(str, taichi.__version__)),
        "taichi_mps": taichi_mps.__version__,
        "commit": commit.stdout.strip(),
        "date": date.today().isoformat(),
    }


def aside(shape, spacing: float, seed: int) -> np.ndarray:
    """Random shifts [m] of a repeated run, none in the first, whose ``seed`` is 0."""
    return ASIDE * spacing * np.random.default_rng(seed).uniform(-1.0, 1.0, shape) * (seed > 0)


# ---- results -------------------------------------------------------------------------------------------------------
def load(name: str) -> dict:
    """results/<name>.json; empty if there is none yet."""
    file = RESULTS / f"{name}.json"
    return json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}


def save(name: str, result: dict) -> None:
    """Write results/<name>.json with the facts of this machine; whole or not at all."""
    draft = RESULTS / f"{name}.json.part"
    draft.write_text(json.dumps({"machine": facts()} | result, indent=1) + "\n", encoding="utf-8")
    draft.replace(RESULTS / f"{name}.json")


def read(name: str) -> dict[str, dict]:
    """Results by the key of their point."""
    return load(name).get("points", {})


def run(script: str, name: str, points: dict[str, dict], again=lambda result: False) -> None:
    """Run every point (key: its settings) that has no result in results/<name>.json yet, or one that is to be made
    ``again``, each in a process of its own, and add it there. The script is called as ``script point <settings>`` and
    prints the result as its last line."""
    for key, settings in points.items():
        if key in read(name) and not again(read(name)[key]):
            continue
        call = [sys.executable, script, "point", json.dumps(settings)]
        done = subprocess.run(call, capture_output=True, text=True, cwd=ROOT)
        if done.returncode != 0:
            sys.exit(f"{key}: {done.stderr[-2000:]}")
        result = settings | json.loads(done.stdout.splitlines()[-1])
        save(name, {"points": read(name) | {key: result}})
        print(f"{key}: {json.dumps(result)}", flush=True)


# ---- pages ---------------------------------------------------------------------------------------------------------
def table(head, rows) -> str:
    """Markdown of cells."""
    lines = ["| " + " | ".join(str(cell) for cell in cells) + " |" for cells in (head, *rows)]
    return "\n".join([lines[0], "|" + "---|" * len(head), *lines[1:]])


def put(page: str, name: str, text: str) -> None:
    """Replace what stands between the marks of ``name`` in a page of docs/."""
    begin, end = f"<!-- written by benchmarks/{name}.py -->", f"<!-- end of benchmarks/{name}.py -->"
    before, rest = (DOCS / page).read_text(encoding="utf-8").split(begin)
    (DOCS / page).write_text(f"{before}{begin}\n\n{text}\n\n{end}{rest.split(end)[1]}", encoding="utf-8")


def pyplot():
    """matplotlib.pyplot, without a screen."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    return plt
