"""The step at the machine's limit: time by stage beside the bytes it must move, from 20,000 to a million particles.

    python benchmarks/step.py [--sizes 20000 160000 1000000] [--threads 1 2] [--repeats 3]
    python benchmarks/step.py --draw     # the tables of docs/speed.md from benchmarks/results/step.json
    python benchmarks/step.py --arch cuda --sizes 20000 1000000 10000000    # on a GPU: the same tables, printed, and
                                         # benchmarks/results/step_cuda.json

The slump cone of 300 Pa in 3-D, with a spacing that gives these numbers of particles. Each size and number of threads
runs in a process of its own, `--repeats` times in turn: a few steps of the collapse, after it has begun. Their mean
counts, for steps differ in their iterations, of the process with the least, for the machine is shared and at times
gives two processes little more than one; the fastest step stands beside. The bandwidth is that of a Taichi kernel that
adds two fields of 256 MB into a third, in the same process, also the best of five. On a device other than the processor
`--threads` means nothing.
"""

import argparse
import json
import platform
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
PAGE, BEGIN, END = (
    ROOT / "docs" / "speed.md",
    "<!-- written by benchmarks/step.py -->",
    "<!-- end of benchmarks/step.py -->",
)
RESULTS = Path(__file__).parent / "results"


def bandwidth() -> float:
    """GB/s of a = b + c, the best of five."""
    from taichi_mps.runtime.backend import started, ti

    rows = 1 << (22 if started()["arch"] == "vulkan" else 26)  # a Vulkan driver need not start more than 2^16 groups
    a, b, c = (ti.field(ti.f32, rows) for _ in range(3))

    @ti.kernel
    def add():
        for i in a:
            a[i] = b[i] + c[i]

    times = []
    for _ in range(6):
        begin = time.perf_counter()
        add()
        ti.sync()
        times.append(time.perf_counter() - begin)
    return 3 * 4 * rows / min(times[1:]) * 1e-9


def measure(particles: int, threads: int, steps: int, arch: str) -> dict:
    import taichi_mps as mps
    from taichi_mps.simulation.roofline import traffic

    mps.init(arch, threads=threads)
    speed = bandwidth()
    spacing = (mps.Cone(0.1, 0.05, 0.3).volume / particles) ** (1 / 3)
    sim = mps.Simulation(mps.slump_cone(yield_value=300.0, spacing=spacing), profile=True)
    while sim.time < 0.02 or sim.steps < 4:
        sim.step()
    sim.execution.spent.clear()
    walls, iterations = [], []
    for _ in range(steps):
        begin = time.perf_counter()
        iterations.append(sim.step().pressure_iterations)
        walls.append(time.perf_counter() - begin)
    moved = traffic(sim)
    stages = {}
    for name, seconds, calls in sim.profile():
        stages[name] = {"seconds": seconds, "calls": calls}
        if name in moved:
            stages[name] |= {"bytes": moved[name].bytes, "operations": moved[name].operations}
    bound = sum(s["bytes"] * s["calls"] for s in stages.values() if "bytes" in s) / (1e9 * speed)
    return {
        "particles": len(sim.scene.fluid),
        "threads": threads,
        "steps": steps,
        "time_step_s": sim.report.dt,
        "bandwidth_GB_s": speed,
        "step_wall_s": walls,
        "iterations_per_step": float(np.mean(iterations)),
        "bound_s": bound / steps,
        "stages": stages,
    }


def cost(row) -> float:
    """Wall seconds of a step, the mean."""
    return float(np.mean(row["step_wall_s"]))


def tables(rows) -> str:
    """The runs, and the stages of the largest with one thread."""
    columns = "particles", "threads", "steps", "iterations a step", "us a particle and step", "fastest step"
    columns += ("million particle-steps a second",)
    text = f"| {' | '.join(columns)} | GB/s of the machine | time over the bound | times one thread |\n"
    text += "|---|---|---|---|---|---|---|---|---|---|\n"
    alone = {r["particles"]: cost(r) for r in rows if r["threads"] == 1}
    for r in rows:
        each, least = (1e6 * seconds / r["particles"] for seconds in (cost(r), min(r["step_wall_s"])))
        text += f"| {r['particles']:,} | {r['threads']} | {r['steps']} | {r['iterations_per_step']:.1f} | {each:.1f} "
        text += f"| {least:.1f} | {1.0 / each:.3f} | {r['bandwidth_GB_s']:.1f} | {cost(r) / r['bound_s']:.2f} "
        text += f"| {alone[r['particles']] / cost(r):.2f} |\n"
    last = max((r for r in rows if r["threads"] == 1), key=lambda r: r["particles"])
    text += f"\n{last['particles']:,} particles, one thread, by stage:\n\n"
    text += "| stage | share of the time | ms a call | MB a call | time over the bound | Mflop a call |\n"
    text += "|---|---|---|---|---|---|\n"
    whole = sum(s["seconds"] for s in last["stages"].values())
    for name, s in sorted(last["stages"].items(), key=lambda item: -item[1]["seconds"]):
        each = s["seconds"] / s["calls"]
        moved = f"{1e-6 * s['bytes']:.0f}" if "bytes" in s else "-"
        over = f"{each * 1e9 * last['bandwidth_GB_s'] / s['bytes']:.1f}" if "bytes" in s else "-"
        worked = f"{1e-6 * s['operations']:.0f}" if "operations" in s else "-"
        text += f"| {name} | {s['seconds'] / whole:.1%} | {1e3 * each:.1f} | {moved} | {over} | {worked} |\n"
    return text


def draw() -> None:
    """Write the tables into the page."""
    page = PAGE.read_text(encoding="utf-8")
    before, rest = page.split(BEGIN)
    rows = json.loads((RESULTS / "step.json").read_text(encoding="utf-8"))["rows"]
    PAGE.write_text(f"{before}{BEGIN}\n\n{tables(rows)}\n{END}{rest.split(END)[1]}", encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=[20_000, 160_000, 1_000_000])
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--repeats", type=int, default=3, help="processes for each size and number of threads [3]")
    parser.add_argument("--arch", default="cpu", help="cpu, cuda or vulkan [cpu]")
    parser.add_argument("--one", type=int, nargs=3, help=argparse.SUPPRESS)
    parser.add_argument("--draw", action="store_true", help="only write the tables")
    arguments = parser.parse_args()
    if arguments.draw:
        draw()
        return
    if arguments.one:
        print(json.dumps(measure(*arguments.one, arguments.arch)))
        return
    rows, threads_of_all = [], arguments.threads if arguments.arch == "cpu" else [1]
    for size in arguments.sizes:
        found = {}
        for threads in threads_of_all * arguments.repeats:
            one = [str(number) for number in (size, threads, 8 if size < 500_000 else 4)]
            command = [sys.executable, __file__, "--arch", arguments.arch, "--one", *one]
            printed = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True).stdout
            row = json.loads(printed.splitlines()[-1])
            print({k: v for k, v in row.items() if k != "stages"}, flush=True)
            found[threads] = min(found.get(threads, row), row, key=cost)
        rows += found.values()
    facts = {"machine": platform.processor() or platform.machine(), "python": platform.python_version()}
    name = "step.json" if arguments.arch == "cpu" else f"step_{arguments.arch}.json"
    (RESULTS / name).write_text(json.dumps({**facts, "rows": rows}, indent=1) + "\n", encoding="utf-8")
    if arguments.arch == "cpu":
        draw()
    else:
        print(tables(rows))


if __name__ == "__main__":
    main()
