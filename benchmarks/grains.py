"""The cost of grains: a step of a block that spreads, with 30 % of spheres 4 across and without any.

    python benchmarks/grains.py [--sides 17 34 80] [--repeats 3]

Blocks of that many particles a side, of 40 to 4,500 grains, each in a process of its own with one thread, with and
without grains in turn. The mean of eight steps after six counts, in seconds of the processor, of the process with the
least; of a block of 50 or more a side that of two steps after two, once.
Writes results/grains.json and the table of docs/theory/grains.md.
"""

import argparse
import json
import subprocess
import sys
import time
from itertools import product

import numpy as np
import points

import taichi_mps as mps

# LARGE: particles a side from which on fewer steps are enough
SPACING, ACROSS, FRACTION, LARGE = 0.004, 4.0, 0.3, 50
COLUMNS = "particles", "grains", "us a particle and step", "times without", "iterations a step", "times without"


def block(side: int, fraction: float) -> mps.Scene:
    """A cube of ``side`` particles a side on a floor."""
    size = side * SPACING
    return mps.Scene(
        name="block",
        material=mps.Bingham(yield_value=50.0, plastic_viscosity=10.0),
        spacing=SPACING,
        fluid=mps.fill(mps.Box((0.0,) * 3, (size,) * 3), SPACING),
        domain=((-size, -size, -size / 4), (2 * size, 2 * size, 2 * size)),
        walls=(mps.Plane((0.0,) * 3, (0.0, 0.0, 1.0)),),
        grains=mps.Grains(diameter=ACROSS * SPACING, volume_fraction=fraction) if fraction else None,
    )


def measure(side: int, fraction: float) -> dict:
    """Processor seconds and iterations of a step."""
    mps.init("cpu", threads=1)
    sim = mps.Simulation(block(side, fraction), mps.Implicit(sleep="off"))
    for _ in range(2 if side >= LARGE else 6):
        sim.step()
    seconds, iterations = [], []
    for _ in range(2 if side >= LARGE else 8):
        begin = time.process_time()
        iterations.append(sim.step().solver_iterations)
        seconds.append(time.process_time() - begin)
    found = {"side": side, "particles": side**3, "grains": len(sim.grains.radii) if fraction else 0}
    return found | {"steps": len(seconds), "seconds": float(np.mean(seconds)), "iterations": float(np.mean(iterations))}


def table(pairs: list[tuple[dict, dict]]) -> str:
    """The runs with grains beside those without, as Markdown."""
    lines = []
    for without, with_grains in pairs:
        each = 1e6 * with_grains["seconds"] / with_grains["particles"]
        cost, work = (with_grains[key] / without[key] for key in ("seconds", "iterations"))
        cells = f"{with_grains['particles']:,}", f"{with_grains['grains']:,}", f"{each:.3g}", f"{cost:.2f}"
        lines.append((*cells, f"{with_grains['iterations']:.0f}", f"{work:.2f}"))
    return points.table(COLUMNS, lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--sides", type=int, nargs="+", default=[17, 34, 80])
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--one", type=float, nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        return print(json.dumps(measure(int(options.one[0]), options.one[1])))
    least = {}
    for k in range(options.repeats):
        for side, fraction in product((n for n in options.sides if k == 0 or n < LARGE), (0.0, FRACTION)):
            child = [sys.executable, __file__, "--one", str(side), str(fraction)]
            row = json.loads(subprocess.run(child, capture_output=True, text=True, check=True).stdout.splitlines()[-1])
            least[side, fraction] = min(row, least.get((side, fraction), row), key=lambda found: found["seconds"])
    pairs = [(least[side, 0.0], least[side, FRACTION]) for side in options.sides]
    points.save("grains", {"pairs": pairs})
    points.put("theory/grains.md", "grains", table(pairs), [points.load("grains")])


if __name__ == "__main__":
    main()
