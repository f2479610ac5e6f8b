"""Where the time of a step goes: seconds by stage, beside the bytes and the operations that the stage cannot avoid.

Bytes are counted as if each field were read or written once in a pass over the particles: what a neighbour holds stays
in the cache, what belongs to a pair is streamed. Operations are the floating-point ones of the loops over pairs.
"""

from dataclasses import dataclass

from ..linear.node_multigrid import SWEEPS, NodeMultigrid
from ..runtime.backend import started


@dataclass(frozen=True)
class Traffic:
    """What one call of a stage moves and computes."""

    bytes: float
    operations: float


def traffic(sim) -> dict[str, Traffic]:
    """By stage of the implicit scheme; "solve" is one iteration of the conjugate gradient. Empty for others."""
    if sim.problem.scheme != "implicit":
        return {}
    n, d, t = sim.particles.count[None], sim.particles.dimension, sim.particles.tensor_dimension
    m = sim.neighbors.row_start[n]
    s = 8 if started()["precision"] == "f64" else 4
    x, vector, block, tensor, walls = 8 * d, s * d, s * d * d, s * t * t, s * len(sim.walls.faces)
    wide = s * sim.scheme.operator.sums.lanes  # of fields that vector instructions read
    flux = wide * d
    carried = x + 2 * vector + 2 * s + 8 + 2 * tensor * sim.particles.carries_stress
    law = 2 * tensor + 3 * s  # stress, plastic rate, shear rate, p, source
    candidates = m * (27.0 / 4.19 if d == 3 else 9.0 / 3.14)  # cells around a particle over the ball of its neighbours
    per_row = {
        "reorder": 4 * carried + 8,
        "neighbours": 2 * x + 12,
        "gradient": x + block + 4 * s + walls,
        "smooth pressure": x + block + 2 * s,
        "prepare": vector + block + 6 * s + walls,
        "system": 3 * block + 4 * s + x + walls,
        "correction": 2 * flux + 3 * wide + vector + s,
        "right-hand side": 3 * flux + 3 * wide + 2 * vector + law + x + walls,
        "solve": (vector + wide) + (2 * (wide + flux) + wide + block + 2 * s + vector + walls + x)
        + (3 * flux + wide + 3 * s + 2 * vector + walls + x)
        + 2 * vector + 6 * vector + block + 3 * vector + block + 5 * vector,
        "stress": vector + block + law + tensor + walls + x,
        "shift": x + 2 * vector + 2 * s,
        "advance": 2 * x + 5 * vector + block + 2 * tensor + walls,
    }  # fmt: skip
    per_pair = {
        "neighbours": (4, 0),
        "gradient": (4 + vector + s, 8 * d + 2 * d * d + 12),
        "smooth pressure": (4 + s, 4 * d + 6),
        "prepare": (2 * (4 + vector) + s, 2 * (3 * d * d) + 4 * d),
        "system": (2 * 4 + vector + 2 * s, 8 * d * d),
        "correction": (4 + vector + s, 6 * d * d + 10 * d),
        "right-hand side": (4 + vector, 4 * d * d),
        "solve": (2 * (4 + vector) + s, 3 * d * d + 3 * d * d + 3 * d),
        "stress": (4 + vector, 3 * d * d),
        "shift": (4 + s, 10 * d + 12),
        "advance": (4 + vector, 3 * d * d),
    }
    found = {}
    for stage, row in per_row.items():
        pair_bytes, operations = per_pair.get(stage, (0, 0))
        found[stage] = Traffic(row * n + pair_bytes * m, operations * m)
    solver = sim.scheme.velocity.solver
    if (
        isinstance(solver.M, NodeMultigrid) and solver.M.pays[None]
    ):  # to and from the finest grid, and as many times over the stencils as the others are smoothed
        rows = int(solver.M.uses.to_numpy()[1:].sum())
        cycle = (3 * vector + 4) * n + 2 * SWEEPS * (flux + 4) * solver.M.points * rows
        found["solve"] = Traffic(found["solve"].bytes + cycle, found["solve"].operations)
    found["neighbours"] = Traffic(found["neighbours"].bytes, 2 * candidates * 3 * d)
    return found
