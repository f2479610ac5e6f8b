"""Which grains pass the bars of an L-box: a row for each diameter, volume and seed.

    python benchmarks/passing.py      # all rows that are not in results/passing.jsonl yet
    python benchmarks/passing.py 3    # the next three
    python benchmarks/passing.py 0    # none: docs/figures/passing.png and the table of docs/howto/grains.md alone

A row is a run of `taichi-mps run l_box --height 0.3` with one thread, whose folder stays in renders/passing; one that
was stopped begins anew. It keeps the fractions of grains and of mortar that are beyond the bars at the end, 1 s.
"""

import json
import os
import subprocess
import sys

import numpy as np
import points

from taichi_mps.io.run_folder import RunFolder

ROWS, RUNS, GAP = points.RESULTS / "passing.jsonl", points.ROOT / "renders/passing", 41.0  # between two bars [mm]
UNTIL, SETTINGS = 1.0, ("model", "diameter_mm", "fraction", "across", "seed")
SLICES = [("slice", d, part, 4, seed) for seed in range(1, 11) for part in (0.3, 0.2, 0.1) for d in (20, 16, 12)]
# three of one spacing by three seeds, the fullest of one, the whole box beside them, a finer slice, then the rest
FIRST = [*(("slice", 7 * n, 0.3, n, seed) for seed in (1, 2, 3) for n in (5, 4, 3)), *SLICES[:3]]
CASES = [*FIRST, ("full", 16, 0.3, 4, 1), ("slice", 16, 0.3, 6, 1), *SLICES[3:]]


def known() -> dict[tuple, dict]:
    """Rows that are there, by their settings."""
    rows = map(json.loads, ROWS.read_text("utf-8").splitlines() if ROWS.exists() else [])
    return {tuple(each[key] for key in SETTINGS): each for each in rows}


def row(model, diameter, fraction, across, seed) -> dict:
    """Run a row."""
    folder = RunFolder(RUNS / f"{model}_{diameter}mm_{fraction:g}_{across}_across_{seed}")
    call = (
        f"-m taichi_mps run l_box --model {model} --height 0.3 --grains {diameter}mm --grains-volume {fraction} "
        f"--grains-seed {seed} --spacing {diameter / across:g}mm --until {UNTIL} --every 0.05 --threads 1 --quiet "
        "--no-pictures --overwrite --out"
    )
    _, status, used = os.wait4(subprocess.Popen([sys.executable, *call.split(), folder.path], cwd=points.ROOT).pid, 0)
    assert not status, f"{folder.path.name}: the run has failed"
    summary = folder.read_summary()
    return dict(zip(SETTINGS, (model, diameter, fraction, across, seed), strict=True)) | {
        "grains_beyond": round(summary["grains_passed_number"] / summary["grains_number"], 4),
        "mortar_beyond": round(summary["mortar_passed_ratio"], 4),
        "grains": int(summary["grains_number"]),
        "particles": summary["fluid_particles"],
        "cpu_s": round(used.ru_utime + used.ru_stime, 1),  # with compiling
        "peak_MB": round(used.ru_maxrss / 1000),
        "machine": points.provenance.facts(),
    }


def draw() -> None:
    """Chart of passing against gap over diameter, and the table of the page."""
    rows, lines = known(), []
    figure, axis = points.pyplot().subplots(figsize=(6.4, 3.6), layout="constrained")
    for case in sorted({key[:-1] for key in rows}, key=lambda case: (case[0], -case[2], case)):
        some = [each for key, each in rows.items() if key[:-1] == case]
        names = "grains_beyond", "mortar_beyond", "cpu_s", "peak_MB"
        (grains, mortar, seconds, memory), text = (
            np.mean([[each[name] for name in names] for each in some], axis=0),
            f"{case[1]} mm, {case[2]:g}",
        )
        ratio = [each["grains_beyond"] / each["mortar_beyond"] for each in some]
        at = GAP / case[1] + 0.3 * (case[2] - 0.3)  # less of them a little to the left
        axis.plot([at] * len(some), ratio, f"C{10 * case[2]:.0f}{'d' if case[0] == 'full' else 'o'}", mfc="none")
        axis.annotate(f"{text}; {len(some)}", (at, max(ratio)), (6, -3), textcoords="offset points", size=8)
        told = f"{min(ratio):.2f}" + (f" to {max(ratio):.2f}" if len(some) > 1 else "")
        cells = text, len(some), f"{100 * grains:.1f} %, {100 * mortar:.1f} %", told
        lines.append((f"{case[0]}, {case[3]} across", *cells, f"{seconds / 60:.1f} min, {memory:.0f} MB"))
    axis.axhline(0.5, color="0.6", lw=0.8)
    axis.set(
        xlabel="gap over diameter", ylabel="fraction of grains beyond, over mortar's", xlim=(1, 4), ylim=(-0.05, 1.5)
    )
    figure.savefig(points.FIGURES / "passing.png", dpi=110)
    head = "Run", "Grains", "Seeds", f"Grains, mortar beyond at {UNTIL:g} s", "ratio", "One thread, mean"
    points.put("howto/grains.md", "passing", points.table(head, lines), rows.values())


if __name__ == "__main__":
    for case in [case for case in CASES if case not in known()][: int(sys.argv[1]) if sys.argv[1:] else None]:
        text = json.dumps(row(*case))
        with ROWS.open("a", encoding="utf-8") as file:
            print(text, file=file)
    draw()
