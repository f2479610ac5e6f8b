"""What threads are worth on a machine: the team of threads, as runs use it, beside Taichi's own parallel loops.

    python benchmarks/threads.py [--particles 20000] [--repeats 3]     # some minutes, nothing else at work

The step of benchmarks/step.py, each number of threads in a process of its own, from 1 to what the machine has, by
powers of two. With its own loops Taichi hands each loop of a solve to its threads anew, as on a GPU.
"""

import argparse
import json
import os

import points
from step import measure

from taichi_mps.engine.runtime import stages
from validation.provenance import facts, origin

WAYS = "team", "loops"


def by_loops(execution, stage, arguments) -> None:
    """Launch a stage for a team part by part instead."""
    stage.function(*arguments)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--particles", type=int, default=20_000)
    parser.add_argument("--repeats", type=int, default=3, help="processes for each, the fastest counts [3]")
    parser.add_argument("--one", nargs=2, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.one:
        way, threads = arguments.one
        stages.Execution.launch_team = by_loops if way == "loops" else stages.Execution.launch_team
        print(json.dumps(measure(arguments.particles, int(threads), "cpu")))
        return
    cores, rows, before = os.cpu_count(), [], facts()
    for threads in sorted({cores, *(2**k for k in range(cores.bit_length()))}):
        best = {way: 1e9 for way in WAYS}
        for way in WAYS * arguments.repeats:
            found = points.child(__file__, "--particles", arguments.particles, "--one", way, threads)
            best[way] = min(best[way], 1e6 * found["mean"] / found["particles"])
        rows.append((threads, *best.values()))
    head = ["threads", *(f"{way}, {what}" for way in WAYS for what in ("us a particle and step", "times one thread"))]
    cells = [(n, f"{a:.3g}", f"{rows[0][1] / a:.2f}", f"{b:.3g}", f"{rows[0][2] / b:.2f}") for n, a, b in rows]
    load = f"{cores} threads in all, load average at the start {before['load_average']!s:.4}."
    print(f"{points.table(head, cells)}\n\n{load}\n\n{origin([{'machine': before}])}")


if __name__ == "__main__":
    main()
