"""The time of a step, and of its stages, from 20,000 to a million particles.

    python benchmarks/step.py [--sizes 20000 160000 1000000] [--threads 1 2] [--repeats 3] [--arch cpu]

The slump cone of 300 Pa in 3-D, with a spacing that gives these numbers of particles. Each size and number of threads
runs in a process of its own, `--repeats` times in turn: a few steps of the collapse, after it has begun. Their mean
counts, for steps differ in their iterations, of the process with the least, for the machine is shared; the fastest
step stands beside. Stages are measured in steps that follow. Prints the tables of docs/speed.md. On a device other
than the processor `--threads` means nothing.
"""

import argparse
import json
import time

import numpy as np
import points

import taichi_mps as mps

RUNS = (
    "particles",
    "threads",
    "steps",
    "iterations a step",
    "us a particle and step",
    "fastest step",
    "times one thread",
)


def measure(particles: int, threads: int, arch: str) -> dict:
    """Wall seconds of steps and of their stages."""
    mps.init(arch, threads=threads)
    spacing = (mps.Cone(0.1, 0.05, 0.3).volume / particles) ** (1 / 3)
    sim = mps.Simulation(mps.slump_cone(yield_value=300.0, spacing=spacing))
    while sim.time < 0.02 or sim.steps < 4:
        sim.step()
    walls, iterations = [], []
    steps = 8 if particles < 500_000 else 4
    for _ in range(steps):
        begin = time.perf_counter()
        iterations.append(sim.step().solver_iterations)
        walls.append(time.perf_counter() - begin)
    sim.execution.timed = True  # stages one by one
    for _ in range(steps):  # compiled anew
        sim.step()
    sim.execution.spent.clear()
    for _ in range(steps):
        sim.step()
    found = {"particles": len(sim.scene.fluid), "threads": threads, "walls": walls, "stages": sim.profile()}
    return found | {"mean": float(np.mean(walls)), "iterations": float(np.mean(iterations))}


def tables(rows: list[dict]) -> str:
    """The runs, and the stages of the largest with one thread, as Markdown."""
    lines, alone = [], {row["particles"]: row for row in rows if row["threads"] == 1}
    for row in rows:
        mean, least = (1e6 * seconds / row["particles"] for seconds in (row["mean"], min(row["walls"])))
        cells = f"{row['particles']:,}", row["threads"], len(row["walls"]), f"{row['iterations']:.1f}"
        cells += f"{mean:.3g}", f"{least:.3g}", f"{alone[row['particles']]['mean'] / row['mean']:.2f}"
        lines.append(cells)
    last = alone[max(alone)]
    whole = sum(seconds for _, seconds, _ in last["stages"])
    stages = sorted(last["stages"], key=lambda stage: -stage[1])
    shares = [(name, f"{spent / whole:.1%}", f"{1e3 * spent / calls:.3g}") for name, spent, calls in stages]
    by_stage = points.table(["stage", "share of the time", "ms a call"], shares)
    return f"{points.table(RUNS, lines)}\n\n{last['particles']:,} particles, one thread, by stage:\n\n{by_stage}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=[20_000, 160_000, 1_000_000])
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--repeats", type=int, default=3, help="processes for each size and number of threads [3]")
    parser.add_argument("--arch", default="cpu", help="cpu, cuda or vulkan [cpu]")
    parser.add_argument("--one", type=int, nargs=2, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.one:
        print(json.dumps(measure(*arguments.one, arguments.arch)))
        return
    rows = []
    for size in arguments.sizes:
        found = {}
        for threads in arguments.threads * arguments.repeats:
            row = points.child(__file__, "--arch", arguments.arch, "--one", size, threads)
            found[threads] = min(found.get(threads, row), row, key=lambda row: row["mean"])
        rows += found.values()
    print(tables(rows))


if __name__ == "__main__":
    main()
