"""How far slump cones scatter whose particles start 1e-6 l0 aside: for SCATTER in taichi_mps/problem/accuracy.py.

    python benchmarks/scatter.py full 0.01 500 50    # model, spacing [m], yield stress [Pa], plastic viscosity [Pa s]

Five runs, one thread; prints slump and spread [mm] of each, their means and standard deviations.
"""

import sys
from dataclasses import replace

import numpy as np

import taichi_mps as mps
from taichi_mps.problem import catalogue

RUNS, ASIDE = 5, 1e-6  # ASIDE in spacings


def main(model, spacing, yield_value, plastic_viscosity):
    mps.init(threads=1)
    mix = {"yield_value": float(yield_value), "plastic_viscosity": float(plastic_viscosity)}
    scene, found = catalogue.build("slump", model=model, spacing=float(spacing), **mix), []
    for seed in range(RUNS):
        aside = ASIDE * scene.spacing * np.random.default_rng(seed).uniform(-1.0, 1.0, scene.fluid.shape)
        sim = mps.Simulation(replace(scene, fluid=scene.fluid + aside))
        sim.run()
        measures = sim.measures()
        found.append((1e3 * measures["slump_m"], 1e3 * measures["spread_m"]))
    found = np.array(found)
    print(f"{model} {spacing} m, {yield_value} Pa, {plastic_viscosity} Pa s: {found.round(2).tolist()}")
    print(f"mean {found.mean(0).round(2).tolist()}, standard deviation {found.std(0, ddof=1).round(2).tolist()} mm")


if __name__ == "__main__":
    main(*sys.argv[1:])
