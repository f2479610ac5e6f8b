"""What a GPU has to start and to move for one iteration of the conjugate gradients, counted without a GPU.

    python benchmarks/starts.py [--particles 20000]
    PYTHONPATH=OTHER python benchmarks/starts.py         # of another checkout

The kernels of a GPU are compiled for the processor, for Taichi cuts both into the same tasks: each is a loop over
threads, or what one thread does between two loops, such as to read how long the next one is. On a GPU each task is
started by itself. Taichi's profiler notes every task that is executed; those between two looks at whether a solve has
converged are of one iteration, by the median of a step's. A number that Python reads is a task, too, and a wait for all
before it. With TAICHI_MPS_KERNELS=quadrants only the kernels and numbers of an outer iteration tell something: there
Python does not look at each iteration of a solve.

Bytes are those of the fields that each loop goes through (LOOPS), times how often. Prints the tables of
benchmarks/results/starts.md.
"""

import argparse
import os

os.environ |= {f"{name}_KERNEL_PROFILER": "1" for name in ("TI", "QD")}  # before Taichi starts
os.environ |= {f"{name}_OFFLINE_CACHE": "0" for name in ("TI", "QD")}

from itertools import pairwise

import numpy as np
import points

import taichi_mps as mps
from taichi_mps.engine.linear import pcg
from taichi_mps.engine.runtime import thread_team
from taichi_mps.engine.runtime.backend import for_kernels, session, ti
from taichi_mps.engine.schemes.implicit import ImplicitScheme

HEADS = (
    "particles",
    "grids",
    "tasks an iteration",
    "of one thread",
    "numbers read",
    "kernels",
    "tasks a step",
    "numbers read an outer iteration",
    "kernels an outer iteration",
)


def noted() -> list[int]:
    """Numbers of tasks since the last call: in all, of one thread, to read a number, and the first of a kernel."""
    profiler = ti.profiler.kernel_profiler.get_default_kernel_profiler()
    profiler._update_records()
    names = [record.name for record in profiler._traced_records]
    ti.profiler.clear_kernel_profiler_info()
    reads, serial, kernels = (sum(part in name for name in names) for part in ("snode_", "_serial", "_kernel_0_"))
    return [len(names), serial - reads, reads, kernels - reads]


def measure(particles: int) -> tuple:
    """A step of a slump cone of 300 Pa after another one: its simulation, the tasks at each look at a solve, and how
    many looks there were before each outer iteration."""
    mps.init("cpu", threads=2)
    session().settings["arch"] = "cuda"  # from now on what is compiled is a GPU's code
    ti.simt.block.sync = for_kernels(lambda: None)
    getattr(thread_team, "Block", thread_team).in_a_block = 1  # an older checkout has none
    volume_of_one = mps.Cone(0.1, 0.05, 0.3).volume / particles
    sim = mps.Simulation(mps.slump_cone(yield_value=300.0, spacing=volume_of_one ** (1 / 3)))
    sim.step()
    solver = pcg if hasattr(pcg, "unfinished") else pcg.PCG  # the latter in an older checkout
    looks, outer, unfinished, iterate = [], [], solver.unfinished, ImplicitScheme.iterate

    def counted(*arguments):
        looks.append(noted())
        return unfinished(*arguments)

    def begun(*arguments):
        outer.append(len(looks))
        return iterate(*arguments)

    solver.unfinished, ImplicitScheme.iterate = counted, begun
    noted()
    sim.step()
    return sim, [*looks, noted()], outer


# ---- bytes ----------------------------------------------------------------------------------------------------------
# part; what it goes through; how often; fields of a pass that are read or written in order; those picked from others
LOOPS = [
    ("product", "particle", 1, "x velocity", ""),
    ("product", "particle", 1, "velocity difference_sums B mu h position x flux", ""),
    ("product", "pair", 1, "column b pair_drag", "velocity"),
    ("product", "particle", 1, "flux flux_sums position x r inertia h", ""),
    ("product", "pair", 1, "column b", "flux"),
    ("vectors", "particle", 13, "x", ""),  # p q; p x x q r r; r z; z p p
    ("preconditioner", "particle", 1, "corner_weights r r inverse_diagonal corner_weights x", ""),
    ("preconditioner", "cell", 1, "corner_sums", ""),
    ("preconditioner", "node", 1, "defect defect inverse z", "corner_sums"),
    ("preconditioner", "row", 6, "inverse x z z z", ""),  # sweeps and defects
    ("preconditioner", "stencil point", 6, "mu stencil", "z"),
    ("preconditioner", "stencil point", 1, "mu", "defect"),
    ("gradient, once a step", "particle", 1, "position B n n n surface_normal kind", ""),
    ("gradient, once a step", "pair", 1, "column b pair_drag", "position kind"),
]
WAYS = "all once", "each pick from memory", "each access to pairs in whole sectors"
SECTOR = 32  # bytes that a GPU's memory hands over at least


def traffic(scheme) -> list[tuple]:
    """Bytes a particle that each part of LOOPS and an iteration move, in each of WAYS."""
    solver, fluid, M = scheme.velocity.solver, scheme.fluid, scheme.velocity.solver.M
    owners = fluid.particles, scheme.stress, scheme.resistance, fluid.gradient, scheme.sums, scheme.operator, M
    fields = {name: field for owner in owners for name, field in vars(owner).items()}
    fields |= {"position": fluid.particles.x, "column": fluid.neighbors.column, "x": solver.x, "r": solver.r}
    n, rows = fluid.particles.count[None], M.active_count.to_numpy()[1:].sum()
    items = {
        "particle": n,
        "pair": fluid.neighbors.row_start[n],
        "cell": M.filled_count[None],
        "node": M.active_count[0],
        "row": rows,
        "stencil point": M.stencil_points * rows,
    }
    moved = dict.fromkeys([*(part for part, *_ in LOOPS), "an iteration"], 0.0)
    for part, item, times, *names in LOOPS:
        each, others = (np.array([size(fields[name]) for name in line.split()], int) for line in names)
        apart = SECTOR * -(-np.append(each, others) // SECTOR) if item in ("pair", "stencil point") else each
        ways = times * items[item] / n * np.array([each.sum(), each.sum() + others.sum(), apart.sum()])
        moved[part] += ways
        moved["an iteration"] += ways * (part != "gradient, once a step")
    return [(part, *map("{:,.0f}".format, ways)) for part, ways in moved.items()]


def size(field) -> int:
    """Bytes of an element of a field."""
    return 4 * (1 + (field.dtype == ti.f64)) * getattr(field, "n", 1) * getattr(field, "m", 1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--particles", type=int, default=20_000)
    sim, looks, outer = measure(parser.parse_args().particles)
    row = len(sim.scene.fluid), sim.scheme.velocity.solver.M.grids, *np.median(looks, axis=0).astype(int)
    of_outer = np.median([np.sum(looks[a:b], axis=0) for a, b in pairwise(outer)], axis=0).astype(int)
    print(points.table(HEADS, [[*row, sum(look[0] for look in looks), *of_outer[2:]]]), "\n")
    print(points.table(("part", *WAYS), traffic(sim.scheme)))


if __name__ == "__main__":
    main()
