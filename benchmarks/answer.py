"""CPU seconds to the answer: whole processes of `taichi-mps run slump --yield-value 500`, this checkout and another.

    python benchmarks/answer.py --against OTHER              # three pairs of each, a table on the screen
    python benchmarks/answer.py --against OTHER --pairs 5 --out benchmarks/results/answer.json

Runs of the two checkouts take turns, for the machines are shared: what counts is the ratio of the medians. Cold: with
an empty cache of kernels; warm: with the one that the cold run has left. The CPU seconds are those of the process
(os.times), from its start to its end, with frames, GIF and plots; `solve`: those of the steps after the first.
`--out` writes the table as JSON and, beside it, as Markdown.
"""

import argparse
import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
MODELS = "axisymmetric", "full"
COMMAND = "run slump --yield-value 500 --quiet --model"


def answer(checkout: Path, model: str, cache: Path) -> dict:
    """CPU seconds of one run, and what it made."""
    with tempfile.TemporaryDirectory() as folder:
        place = os.environ | {"PYTHONPATH": str(checkout), "TI_OFFLINE_CACHE_FILE_PATH": str(cache)}
        before = os.times()
        call = [sys.executable, "-m", "taichi_mps", *COMMAND.split(), model, "--out", f"{folder}/run"]
        subprocess.run(call, cwd=folder, env=place, check=True, capture_output=True)
        after = os.times()
        summary = json.loads(Path(folder, "run/summary.json").read_text())
        files = [path for path in Path(folder, "run").rglob("*") if path.is_file()]
        return {
            "cpu": after.children_user + after.children_system - before.children_user - before.children_system,
            "solve": summary["cpu_seconds"],
            "frames": sum(path.parent.name == "frames" for path in files),
            "gif_kB": sum(path.stat().st_size for path in files if path.suffix == ".gif") / 1e3,
            "files": len(files),
        }


def measure(checkouts: dict[str, Path], pairs: int) -> list[dict]:
    """Each row: checkout, model, cold or warm, and the numbers of a run."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for pair in range(pairs):
            for model in MODELS:
                for state in ("cold", "warm"):
                    for name, checkout in checkouts.items():
                        cache = Path(folder, name, model)
                        if state == "cold":
                            shutil.rmtree(cache, ignore_errors=True)
                        rows.append({"checkout": name, "model": model, "state": state, "pair": pair})
                        rows[-1] |= answer(checkout, model, cache)
                        print(rows[-1], file=sys.stderr)
    return rows


def table(rows: list[dict]) -> str:
    """Medians, as Markdown."""
    lines = [
        "| model | kernels | before [s] | now [s] | now/before | solve before [s] | solve now [s] | frames, GIF now |"
    ]
    lines += ["|---|---|---|---|---|---|---|---|"]
    for model in MODELS:
        for state in ("cold", "warm"):
            of = {
                name: [r for r in rows if (r["checkout"], r["model"], r["state"]) == (name, model, state)]
                for name in ("other", "this")
            }
            cpu, solve = ({n: statistics.median(r[key] for r in of[n]) for n in of} for key in ("cpu", "solve"))
            last, ratio = of["this"][-1], cpu["this"] / cpu["other"]
            numbers = (
                f"{cpu['other']:.1f} | {cpu['this']:.1f} | {ratio:.2f} | {solve['other']:.1f} | {solve['this']:.1f}"
            )
            lines.append(f"| {model} | {state} | {numbers} | {last['frames']}, {last['gif_kB']:.0f} kB |")
    return "\n".join(lines)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--against", type=Path, required=True, help="another checkout")
    parser.add_argument("--pairs", type=int, default=3)
    parser.add_argument("--out", type=Path, help="JSON file for the table; the same as Markdown beside it")
    arguments = parser.parse_args()
    rows = measure({"other": arguments.against.resolve(), "this": ROOT}, arguments.pairs)
    print(table(rows))
    if arguments.out:
        arguments.out.write_text(json.dumps(rows, indent=1) + "\n")
        command = f"`python benchmarks/answer.py --against OTHER --pairs {arguments.pairs}`"
        arguments.out.with_suffix(".md").write_text(f"CPU seconds to the answer, by {command}.\n\n{table(rows)}\n")


if __name__ == "__main__":
    main()
