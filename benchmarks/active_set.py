"""What the active set saves: CPU time of a step against the share of the fluid that stands still.

    python benchmarks/active_set.py [--particles 20000] [--repeats 3]
    python benchmarks/active_set.py --tests   # what it changes in tests of concrete, five runs each

A layer of concrete (200 Pa, 20 Pa s), 0.2 m deep between smooth walls, comes to rest; then a part of its length is
given a speed, and a cycle of steps is timed with the active set and without, in turn, from the same state, with one
thread. The share is that of the rows outside the active ones and their border. Writes active_set.json and .md into
benchmarks/results.
"""

import argparse
import json
import time
from pathlib import Path

import numpy as np

import taichi_mps as mps
from taichi_mps.particles.active_set import EVERY

RESULTS = Path(__file__).parent / "results"
DEPTH, LENGTH = 0.2, 4.0
MOVING = 1.0, 0.6, 0.35, 0.2, 0.1, 0.05  # part of the length that is given a speed
SPEED = 0.3  # [m/s]
TESTS = {"slump": {"model": "full"}, "l_box": {}, "wall": {}}
RUNS = 5


def layer(particles: int) -> mps.Scene:
    """The layer, of about so many particles."""
    spacing = (LENGTH * DEPTH**2 / particles) ** (1 / 3)
    spacing = DEPTH / round(DEPTH / spacing)
    axes = [np.arange(0.5 * spacing, size, spacing) for size in (LENGTH, DEPTH, DEPTH)]
    high = LENGTH, DEPTH
    walls = [mps.Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))]
    for axis in (0, 1):
        for at, normal in ((0.0, 1.0), (high[axis], -1.0)):
            point, direction = np.zeros(3), np.zeros(3)
            point[axis], direction[axis] = at, normal
            walls.append(mps.Plane(tuple(point), tuple(direction), slip=True))
    return mps.Scene(
        "layer",
        mps.Bingham(yield_value=200.0, plastic_viscosity=20.0),
        spacing,
        np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3),
        ((-spacing,) * 3, (LENGTH + spacing, DEPTH + spacing, 3.0 * DEPTH)),
        walls=tuple(walls),
        until=3.0,
    )


def cycle(sim, state, steps: int) -> tuple[float, float, float]:
    """CPU-seconds a step of so many from a state; mean part of the rows aside; iterations a step."""
    sim.load(state)
    aside, iterations, begin = 0.0, 0, time.process_time()
    for _ in range(steps):
        iterations += sim.step().pressure_iterations
        aside += sim.particles.aside[None] / sim.particles.number
    return (time.process_time() - begin) / steps, aside / steps, iterations / steps


def tests() -> None:
    """Five runs, with particles or hose 1e-6 l0 aside, of the cone, the L-box and the wall, whole and by default: what
    is left out of their steps, and where something is, how far their measures are from those of five runs of all."""
    from dataclasses import replace

    from taichi_mps.problem import catalogue

    found = {}
    for name, parameters in TESTS.items():
        scene, measures = catalogue.build(name, **parameters), {"on": [], "off": []}
        parts = []
        for seed in range(RUNS):
            aside = 1e-6 * scene.spacing * np.random.default_rng(seed).uniform(-1.0, 1.0, scene.fluid.shape)
            moved = replace(scene, fluid=scene.fluid + aside)
            if not len(scene.fluid):
                hose = scene.inlets[0]
                centre = (hose.centre[0] + 1e-6 * seed * scene.spacing, *hose.centre[1:])
                moved = replace(scene, inlets=(replace(hose, centre=centre),))
            for sleep in measures:
                if sleep == "off" and not parts[-1]:
                    measures[sleep].append(measures["on"][-1])  # bit by bit the same: tests/schemes/test_active_set.py
                    continue
                sim = mps.Simulation(moved, mps.Implicit(sleep=sleep))
                sim.run()
                if sleep == "on":
                    parts.append(sim.scheme.left_out)
                measures[sleep].append({k: v for k, v in sim.measures().items() if isinstance(v, float)})
        row = {"parameters": parameters, "particles": sim.particles.number, "left_out": parts}
        for key in measures["on"][0]:
            values = {sleep: [run[key] for run in runs] for sleep, runs in measures.items()}
            row[key] = values | {"changed": float(np.mean(values["on"]) - np.mean(values["off"]))}
        found[name] = row
        print(name, json.dumps(row), flush=True)
        (RESULTS / "active_set_tests.json").write_text(json.dumps(found, indent=1) + "\n")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--particles", type=int, default=20000)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--tests", action="store_true")
    options = parser.parse_args()
    mps.init(threads=1)
    if options.tests:
        tests()
        return
    scene = layer(options.particles)
    sims = {sleep: mps.Simulation(scene, mps.Implicit(sleep=sleep)) for sleep in ("off", "on")}
    settle = sims["on"]
    while settle.scheme.active_set.standing < 0.99:
        settle.step()
    rest = settle.state()
    rows = []
    for part in MOVING:
        state = dict(rest)
        state["u"] = rest["u"].copy()
        x = rest["x"][:, 0] / LENGTH
        state["u"][:, 0] += SPEED * np.where(x < part, np.sin(np.pi * x / part) ** 2, 0.0)
        state["active_set"] = [0, float(np.mean(x > part)), 0, 0.0]
        for sim in sims.values():
            cycle(sim, state, 2)  # compiled
        found = {sleep: [] for sleep in sims}
        for _ in range(options.repeats):
            for sleep, sim in sims.items():
                found[sleep].append(cycle(sim, state, EVERY))
        ratios = [off[0] / on[0] for off, on in zip(found["off"], found["on"], strict=True)]
        row = {
            "part_moving": part,
            "part_aside": found["on"][0][1] * EVERY / (EVERY - 1),  # of steps that are not of all
            "milliseconds_off": 1e3 * min(f[0] for f in found["off"]),
            "milliseconds_on": 1e3 * min(f[0] for f in found["on"]),
            "iterations_off": found["off"][0][2],
            "iterations_on": found["on"][0][2],
            "ratios": ratios,
        }
        rows.append(row)
        print(row, flush=True)
    result = {"particles": len(scene.fluid), "every": EVERY, "rows": rows}
    (RESULTS / "active_set.json").write_text(json.dumps(result, indent=1) + "\n")
    lines = [
        f"Layer of {len(scene.fluid):,} particles, one thread; CPU time of a step over a cycle of {EVERY}, of which",
        "one is taken by all. Written by `python benchmarks/active_set.py`.",
        "",
        "| part given a speed | rows aside [%] | off [ms] | on [ms] | off over on, pairs | iterations off, on |",
        "|---|---|---|---|---|---|",
    ]
    for row in rows:
        pairs = ", ".join(f"{ratio:.2f}" for ratio in row["ratios"])
        lines.append(
            f"| {row['part_moving']:g} | {100 * row['part_aside']:.0f} | {row['milliseconds_off']:.0f} | "
            f"{row['milliseconds_on']:.0f} | {pairs} | {row['iterations_off']:.0f}, {row['iterations_on']:.0f} |"
        )
    (RESULTS / "active_set.md").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
