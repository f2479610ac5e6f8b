"""Peers and this engine on the same cases, in the same run, on the same machine; nothing is installed here.

    python benchmarks/peers/compare.py list                      # peers, whether they are installed; cases
    python benchmarks/peers/compare.py run                       # every installed peer on every case
    python benchmarks/peers/compare.py run --peers newton openfoam --cases slump_full_500Pa_10mm
    python benchmarks/peers/compare.py draw                      # docs/peers.md and its charts; runs nothing

Each run is a process of its own, one after the other, with one thread. CPU seconds are those of the process and its
children: user + system, of the time steps alone (what compiles or loads before the first step is left out) and of the
whole. A run is made five times, with particles 1e-6 spacings aside: what is told are means, and the standard deviation
of one. Cells are not moved, so interFoam runs once. Each case becomes benchmarks/results/peers_CASE.json. A peer lives
in ~/.cache/taichi_mps_peers/NAME, or where TAICHI_MPS_PEER_NAME says (its `install` makes that), and is skipped by name
where it does not.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent), str(HERE.parents[1])]

import numpy as np  # noqa: E402
import points  # noqa: E402
from cases import CASES, Case, Run, judge  # noqa: E402
from environments import PEERS, where  # noqa: E402

SCATTERS = {"worst_slump_error_m", "front_error"}  # of which the standard deviation of a run is kept


def command(case: Case, run: Run, folder: Path, seed: int = 0) -> list[str]:
    """The command line that runs a peer on a case and writes folder/out.npz; another ``seed``, particles aside."""
    out = folder / "out.npz"
    if run.peer == "taichi_mps":
        return [sys.executable, str(HERE / "ours.py"), case.name, json.dumps(run.settings), str(out), str(seed)]
    data = folder / "case.json"
    data.write_text(json.dumps(case.data(run, seed)), encoding="utf-8")
    return [str(where(run.peer)), str(HERE / PEERS[run.peer].script), str(data), str(out)]


def measure(case: Case, run: Run, limit: float, seed: int = 0) -> dict:
    """Run one peer in a process of its own: what it found, its errors and cost; `failed` says why there is none."""
    row = {"peer": run.peer, "label": run.label, "settings": run.settings, "load_average": os.getloadavg()[0]}
    one = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with open(folder / "log", "w", encoding="utf-8") as log:
            start = time.perf_counter()
            words = ["timeout", str(limit), *command(case, run, folder, seed)]
            child = subprocess.Popen(words, stdout=log, stderr=log, env=os.environ | one)
            _, status, usage = os.wait4(child.pid, 0)
        row |= {"process_cpu_seconds": usage.ru_utime + usage.ru_stime, "wall_seconds": time.perf_counter() - start}
        if status or not (folder / "out.npz").exists():
            last = (folder / "log").read_text(encoding="utf-8", errors="replace").strip().splitlines()[-1:]
            why = f"not done in {limit:g} s" if os.waitstatus_to_exitcode(status) == 124 else "".join(last)
            return row | {"failed": f"{why} (exit status {os.waitstatus_to_exitcode(status)})"}
        with np.load(folder / "out.npz") as file:
            output = {key: file[key] for key in file.files}
    count = int(output["elements"])
    row |= {key: float(output[key]) for key in ("cpu_seconds", "compile_seconds", "volume_error") if key in output}
    row |= {"elements": count, "steps": int(output["steps"]), "simulated_seconds": case.until}
    try:
        return row | judge(case, output)
    except ValueError as error:
        return row | {"failed": str(error)}


def compare(case: Case, peers: list[str], limit: float, repeats: int) -> None:
    """All runs of a case, ``repeats`` times in turn. Writes the JSON."""
    runs = [run for run in case.runs if run.peer in peers]
    found: dict[str, list[dict]] = {run.label: [] for run in runs}
    for seed in range(repeats):
        for run in runs:
            of_cells = run.peer in PEERS and not PEERS[run.peer].particles
            if seed == 0 or not of_cells:
                row = measure(case, run, limit, seed)
                found[run.label].append(row)
                print(case.name, run.label, row.get("failed") or f"{row['cpu_seconds']:.1f} CPU-s", flush=True)
        rows = [together(rows) for rows in found.values()]
        points.save(f"peers_{case.name}", {"case": case.name, "title": case.title, "repeats": repeats, "rows": rows})


def together(rows: list[dict]) -> dict:
    """Means of several runs, and the standard deviation of one where there are errors; the one that failed, if any."""
    failed = [row for row in rows if "failed" in row]
    if failed or len(rows) == 1:
        return {**(failed or rows)[0], "runs": len(rows)}
    mean = {
        key: np.mean([row[key] for row in rows], axis=0).tolist() if isinstance(value, float | list) else value
        for key, value in rows[0].items()
    }
    mean["steps"] = round(float(np.mean([row["steps"] for row in rows])))
    if "slump_errors_m" in mean:
        mean["worst_slump_error_m"] = max(mean["slump_errors_m"], key=abs)
    for key in SCATTERS & set(mean):
        mean[f"{key}_scatter"] = float(np.std([abs(row[key]) for row in rows], ddof=1))
    return {**mean, "runs": len(rows)}


def installed(names: list[str]) -> list[str]:
    """Peers that can run here; prints for the others how to install them."""
    there = []
    for name in names:
        if name == "taichi_mps" or where(name):
            there.append(name)
        else:
            print(f"{name}: not installed, skipped (python benchmarks/peers/{PEERS[name].script} install)", flush=True)
    return there


def main(words: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("list", "run", "draw"))
    parser.add_argument("--peers", nargs="+", choices=list(PEERS), default=list(PEERS))
    parser.add_argument("--cases", nargs="+", choices=[case.name for case in CASES])
    parser.add_argument("--limit", type=float, default=900.0, help="seconds a run may take [900]")
    parser.add_argument("--repeats", type=int, default=5, help="times each run is made, in turn [5]")
    options = parser.parse_args(words)
    cases = [case for case in CASES if not options.cases or case.name in options.cases]
    if options.what == "draw":
        from drawing import draw

        draw()
        return
    peers = installed(["taichi_mps", *options.peers])
    if options.what == "list":
        print("installed:", ", ".join(peers))
        for case in cases:
            print(f"{case.name}: {', '.join(run.label for run in case.runs)}")
        return
    if not shutil.which("timeout"):
        raise SystemExit("timeout (coreutils) is needed to end a run that hangs")
    for case in cases:
        compare(case, peers, options.limit, options.repeats)


if __name__ == "__main__":
    main()
