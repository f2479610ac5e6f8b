"""This engine on a case of compare.py: python ours.py CASE-NAME SETTINGS.json OUT.npz SEED"""

import json
import sys
from dataclasses import replace

import numpy as np
from cases import CASES, aside

import taichi_mps as mps


def simulate(case, settings: dict, seed: int) -> dict:
    """Slump and spread, or positions, at the times of the case, and what the run cost."""
    options = dict(settings)
    numerics = mps.SemiImplicit if options.pop("scheme", "implicit") == "semi-implicit" else mps.Implicit
    mps.init(threads=1)
    scene = case.scene()
    fluid = scene.fluid + aside(scene.fluid.shape, scene.spacing, seed)
    sim = mps.Simulation(replace(scene, fluid=fluid, stop_at_rest=case.stop_at_rest), numerics(**options))
    frames = []
    sim.every(0.1 if case.kind == "slump" else 0.01, lambda s: frames.append((s.time, s.snapshot(), s.measures())))
    sim.run()
    if sim.stopped_by == "rest":  # it stays as it is until the end of the case
        frames.append((case.until, sim.snapshot(), sim.measures()))
    summary = sim.summary()
    kept = {
        "t": np.array([t for t, _, _ in frames]),
        "steps": summary["steps"],
        "cpu_seconds": summary["cpu_seconds"],
        "compile_seconds": summary["compile_seconds"],
        "elements": summary["fluid_particles"],
    }
    if case.kind == "slump":
        return kept | {key: np.array([m[f"{key}_m"] for _, _, m in frames]) for key in ("slump", "spread")}
    return kept | {"x": np.array([s.x for _, s, _ in frames])}


if __name__ == "__main__":
    name, settings, out, seed = sys.argv[1:]
    case = next(case for case in CASES if case.name == name)
    np.savez(out, **simulate(case, json.loads(settings), int(seed)))
