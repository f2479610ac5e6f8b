"""Points of a benchmark: each in a process of its own, kept in one JSON with the machine's facts, never run twice."""

import json
import os
import platform
import subprocess
import sys
from datetime import date
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
RESULTS, FIGURES, DOCS = ROOT / "benchmarks" / "results", ROOT / "docs" / "figures", ROOT / "docs"


def facts() -> dict:
    """What the points of a file were run on."""
    import taichi

    import taichi_mps

    models = [line.split(":")[1].strip() for line in lines_of("/proc/cpuinfo") if line.startswith("model name")]
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True)
    return {
        "processor": models[0] if models else platform.processor(),
        "cores": os.cpu_count(),
        "threads": 1,
        "system": platform.system(),
        "python": platform.python_version(),
        "taichi": ".".join(map(str, taichi.__version__)),
        "taichi_mps": taichi_mps.__version__,
        "commit": commit.stdout.strip(),
        "date": date.today().isoformat(),
        "note": "shared with other runs: CPU seconds, not wall seconds",
    }


def lines_of(path: str) -> list[str]:
    file = Path(path)
    return file.read_text(encoding="utf-8").splitlines() if file.exists() else []


def read(name: str) -> dict[str, dict]:
    """Results by the key of their point; empty if there is no file yet."""
    file = RESULTS / f"{name}.json"
    return json.loads(file.read_text(encoding="utf-8"))["points"] if file.exists() else {}


def run(script: str, name: str, points: dict[str, dict]) -> None:
    """Run every point (key: its settings) that has no result in results/<name>.json yet, and add it there. The script
    is called as ``script point <settings>`` and prints the result as its last line."""
    for key, settings in points.items():
        if key in read(name):
            continue
        call = [sys.executable, script, "point", json.dumps(settings)]
        done = subprocess.run(call, capture_output=True, text=True, cwd=ROOT)
        if done.returncode != 0:
            sys.exit(f"{key}: {done.stderr[-2000:]}")
        result = settings | json.loads(done.stdout.splitlines()[-1])
        write(name, read(name) | {key: result})
        print(f"{key}: {json.dumps(result)}", flush=True)


def forget(name: str, key: str) -> None:
    """Drop a result, so that its point runs again."""
    write(name, {other: value for other, value in read(name).items() if other != key})


def write(name: str, kept: dict[str, dict]) -> None:
    """All points of a file, one a line; whole or not at all."""
    lines = ",\n".join(f"  {json.dumps(key)}: {json.dumps(value)}" for key, value in kept.items())
    text = f'{{\n "machine": {json.dumps(facts())},\n "points": {{\n{lines}\n }}\n}}\n'
    draft = RESULTS / f"{name}.json.part"
    draft.write_text(text, encoding="utf-8")
    draft.replace(RESULTS / f"{name}.json")


def put(page: str, name: str, text: str) -> None:
    """Replace what stands between the marks of ``name`` in a page of docs/."""
    begin, end = f"<!-- written by benchmarks/{name}.py -->", f"<!-- end of benchmarks/{name}.py -->"
    before, rest = (DOCS / page).read_text(encoding="utf-8").split(begin)
    (DOCS / page).write_text(f"{before}{begin}\n\n{text}\n\n{end}{rest.split(end)[1]}", encoding="utf-8")
