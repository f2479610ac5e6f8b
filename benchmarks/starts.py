"""How much a GPU has to start for one iteration of the conjugate gradients, counted without a GPU.

    python benchmarks/starts.py [--sizes 20000 160000] [--against OTHER]

The kernels of a GPU are compiled for the processor, for Taichi cuts both into the same tasks: each is a loop over
threads, or what one thread does between two loops, such as to read how long the next one is. On a GPU each task is
started by itself. Taichi's profiler notes every task that is executed; those between two looks at whether a solve has
converged are of one iteration, by the median of a step's. A number that Python reads is a task, too, and a wait for all
before it. `--against`: the same of another checkout. Prints benchmarks/results/starts.md.
"""

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import points

os.environ |= {"TI_KERNEL_PROFILER": "1", "TI_OFFLINE_CACHE": "0"}
KINDS = "tasks", "of one thread", "numbers read", "kernels"
HEADS = "checkout", "particles", "grids", "tasks an iteration", *KINDS[1:], "tasks a step", "iterations a step"


def noted() -> list[str]:
    """Names of the tasks that were executed since the last call."""
    import taichi as ti
    from taichi.profiler.kernel_profiler import get_default_kernel_profiler

    profiler = get_default_kernel_profiler()
    profiler._update_records()
    names = [record.name for record in profiler._traced_records]
    ti.profiler.clear_kernel_profiler_info()
    return names


def counts(names: list[str]) -> list[int]:
    """Numbers of KINDS: tasks, those of one thread, numbers that Python read, and kernels that Python started."""
    ours = [name for name in names if not name.startswith("snode_")]
    serial, kernels = (sum(part in name for name in ours) for part in ("_serial", "_kernel_0_"))
    return [len(names), serial, sum(name.startswith("snode_reader") for name in names), kernels]


def measure(particles: int) -> dict:
    """Counts of an iteration and of the third step of a slump cone of 300 Pa."""
    import taichi_mps as mps
    from taichi_mps.engine.linear.pcg import PCG
    from taichi_mps.engine.runtime import thread_team
    from taichi_mps.engine.runtime.backend import for_kernels, session, ti

    mps.init("cpu", threads=2)
    session().settings["arch"] = "cuda"  # from now on what is compiled is a GPU's code
    ti.simt.block.sync = for_kernels(lambda: None)
    if hasattr(thread_team, "Block"):  # a checkout from before has none
        thread_team.Block.in_a_block = 1
    spacing = (mps.Cone(0.1, 0.05, 0.3).volume / particles) ** (1 / 3)
    sim = mps.Simulation(mps.slump_cone(yield_value=300.0, spacing=spacing))
    sim.step()
    sim.step()
    looks, look, unfinished = [], [], PCG.unfinished

    def counted(self, *limit):
        go_on = unfinished(self, *limit)
        look.append(noted())
        looks.append(counts(look[-1]))
        if len(looks) == 6: print(chr(10).join(look[-1]), file=sys.stderr)
        return go_on

    PCG.unfinished = counted
    noted()
    report = sim.step()
    names = sum(look, noted())
    iteration = [int(number) for number in np.median(looks, axis=0)]
    found = {"particles": len(sim.scene.fluid), "grids": sim.scheme.velocity.solver.M.grids, "iteration": iteration}
    return found | {"step": len(names), "iterations": report.solver_iterations, "bytes": traffic(sim.scheme)}


# ---- bytes ----------------------------------------------------------------------------------------------------------
# part; what it goes through; how often; fields of a pass that are read or written in order; those picked from others
LOOPS = [
    ("product", "particle", 1, "x motion", ""),
    ("product", "particle", 1, "motion difference_sums B mu h position x flux", ""),
    ("product", "pair", 1, "column b pair_drag", "motion"),
    ("product", "particle", 1, "flux flux_sums position x r inertia h", ""),
    ("product", "pair", 1, "column b", "flux"),
    ("vectors", "particle", 13, "x", ""),  # p q; p x x q r r; r z; z p p
    ("preconditioner", "particle", 1, "corner_weights r r inverse_diagonal corner_weights x", ""),
    ("preconditioner", "cell", 1, "corner_sums", ""),
    ("preconditioner", "node", 1, "defect defect inverse z", "corner_sums"),
    ("preconditioner", "row", 6, "inverse x z z z", ""),  # sweeps and defects; of restriction and the way back the rest
    ("preconditioner", "stencil point", 6, "stencil_column stencil", "z"),
    ("preconditioner", "stencil point", 1, "stencil_column", "defect"),
    ("gradient, once a step", "particle", 1, "position B n n n surface_normal kind", ""),
    ("gradient, once a step", "pair", 1, "column b pair_drag", "position kind"),
]
PICKED = "pair", "stencil point"  # of which neighbouring threads read what lies apart
SECTOR = 32  # bytes that a GPU's memory hands over at least


def traffic(scheme) -> dict[str, list[float]]:
    """Bytes a particle that each part moves: all once; with each pick from memory; in whole sectors for each access."""
    from taichi_mps.engine.runtime.backend import ti

    M, fluid = scheme.velocity.solver.M, scheme.fluid
    owners = M, scheme.operator, scheme.sums, fluid.gradient, scheme.resistance, scheme.stress, fluid.particles
    fields = {name: field for owner in reversed(owners) for name, field in vars(owner).items()}
    fields |= {"position": fluid.particles.x, "column": fluid.neighbors.column, "stencil_column": M.column}
    fields |= {name: getattr(scheme.velocity.solver, name) for name in "xr"}
    n, active = fluid.particles.count[None], M.active_count.to_numpy()
    items = {"particle": n, "pair": fluid.neighbors.row_start[n], "cell": M.filled_count[None], "node": active[0]}
    items |= {"row": active[1:].sum(), "stencil point": M.stencil_points * active[1:].sum()}

    def sizes(names):
        found = [fields[name] for name in names.split()]
        return [
            np.dtype(ti.lang.util.to_numpy_type(f.dtype)).itemsize * getattr(f, "n", 1) * getattr(f, "m", 1)
            for f in found
        ]

    found = {"pairs": [items["pair"] / n]}
    for part, item, times, in_order, picked in LOOPS:
        each, others = sizes(in_order), sizes(picked)
        apart = [-(-size // SECTOR) * SECTOR if item in PICKED else size for size in each + others]
        moved = [times * items[item] / n * sum(bytes) for bytes in (each, each + others, apart)]
        found[part] = [float(a + b) for a, b in zip(found.get(part, (0, 0, 0)), moved, strict=True)]
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=[20_000, 160_000])
    parser.add_argument("--against", type=Path, help="another checkout")
    parser.add_argument("--one", type=int, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.one:
        print(json.dumps(measure(arguments.one)))
        return
    rows = []
    for size in arguments.sizes:
        for checkout in filter(None, (arguments.against, points.ROOT)):
            command = [sys.executable, __file__, "--one", str(size)]
            environment = os.environ | {"PYTHONPATH": str(checkout)}
            printed = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True, env=environment).stdout
            row = json.loads(printed.splitlines()[-1])
            name = "before" if checkout is arguments.against else "now"
            cells = f"{row['particles']:,}", row["grids"], *row["iteration"], f"{row['step']:,}", row["iterations"]
            rows.append((name, *cells))
    print(points.table(HEADS, rows))


if __name__ == "__main__":
    main()
