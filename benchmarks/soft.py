"""Mixes from soft to viscous, to their rest, beside finite elements with inertia: slump, slump flow, times, cost.

    python benchmarks/soft.py --model quarter --spacing 0.01   # benchmarks/results/soft_quarter_10mm.md
    python benchmarks/soft.py --model quarter --spacing 0.01 --perturbed 5   # means and scatter of five disturbed runs

Reference: validation/reference/A_fe_inertial_soft.csv (slump +-0.2 mm, spread +-0.3 mm, times +-1.5 %).
Errors: engine - reference. CPU seconds are of one thread, without the first step, which compiles.
"""

import argparse
from dataclasses import replace

import numpy as np
import points

import taichi_mps as mps
from validation import columns
from validation.slumps import slump_and_spread

HEAD = ("mix", "slump 0.2 s", "slump 0.5 s", "slump at rest", "slump flow at rest", "T300", "T400", "T500")
HEAD += ("rest [s]", "CPU-s", "CPU-s to 1 s")
TIMES, WIDE = (0.2, 0.5), (300, 400, 500)  # of slumps [s], of spreads whose time is read [mm]


def run(scene) -> dict:
    """One run to rest: slumps [m] at TIMES and at the end, spread [m], times to spreads [s], CPU seconds."""
    sim, rows = mps.Simulation(scene), [(0.0, 0.0, 0.2, 0.0)]
    sim.each_step(lambda s: rows.append((s.time, *slump_and_spread(s), s.cpu_seconds)))
    for instant in TIMES:
        sim.every(instant, lambda s: None)
    sim.run()
    times, slumps, spreads, spent = np.array(rows).T
    found = {f"slump {at} s": np.interp(at, times, slumps) for at in TIMES}
    found |= {"slump at rest": slumps[-1], "slump flow at rest": spreads[-1], "rest": sim.time}
    wide = np.maximum.accumulate(spreads)
    found |= {f"T{mm}": np.interp(1e-3 * mm, wide, times, right=np.nan) for mm in WIDE}
    return found | {"CPU-s": spent[-1], "CPU-s to 1 s": np.interp(1.0, times, spent)}


def cells(mix, found, exact) -> list[str]:
    """A line of the table: errors with their scatter."""
    mean, scatter = ({key: f([one[key] for one in found]) for key in found[0]} for f in (np.mean, np.std))
    some = len(found) > 1

    def told(key, error, unit, digits):
        spread = f" ± {unit * scatter[key]:.{digits}f}" if some else ""
        return f"{error:+.{digits}f}{spread}" if np.isfinite(error) else "-"

    line = ["{:g} Pa, {:g} Pa s".format(*mix)]
    for key in ("slump 0.2 s", "slump 0.5 s", "slump at rest"):
        line.append(told(key, 1e3 * (mean[key] - exact[key]), 1e3, 2) + " mm")
    for key in ("slump flow at rest", "T300", "T400", "T500"):
        line.append(told(key, 100.0 * (mean[key] / exact[key] - 1.0), 100.0 / exact[key], 2) + " %")
    return line + [f"{mean['rest']:.1f}", f"{mean['CPU-s']:.2f}", f"{mean['CPU-s to 1 s']:.2f}"]


def references():
    """(yield stress [Pa], plastic viscosity [Pa s]) and what the finite elements measure, for each mix."""
    every = columns("A_fe_inertial_soft.csv")
    for mix in dict.fromkeys(zip(every["yield_value_Pa"], every["plastic_viscosity_Pa_s"], strict=True)):
        known = columns("A_fe_inertial_soft.csv", yield_value_Pa=float(mix[0]), plastic_viscosity_Pa_s=float(mix[1]))
        at = dict(zip(known["time_s"], 1e-3 * known["mean20_mm"], strict=True))
        exact = {f"slump {t} s": at.get(t, np.nan) for t in TIMES} | {f"T{mm}": known[f"T{mm}_s"][-1] for mm in WIDE}
        last = {"slump at rest": 1e-3 * known["mean20_mm"][-1], "slump flow at rest": 1e-3 * known["spread_mm"][-1]}
        yield mix, exact | last


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--model", default="quarter")
    parser.add_argument("--spacing", type=float, default=0.01)
    parser.add_argument("--perturbed", type=int, default=1, help="runs whose particles start 1e-6 spacings aside")
    options = parser.parse_args()
    mps.init(threads=1)
    rows = []
    for mix, exact in references():
        cone = dict(yield_value=mix[0], plastic_viscosity=mix[1], model=options.model, spacing=options.spacing)
        scene, found = mps.slump_cone(**cone), []
        for seed in range(options.perturbed):
            fluid = scene.fluid + points.aside(scene.fluid.shape, options.spacing, seed)
            found.append(run(replace(scene, fluid=fluid)))
        rows.append(cells(mix, found, exact))
        print(" | ".join(rows[-1]), flush=True)
    extra = f" --perturbed {options.perturbed}" * (options.perturbed > 1)
    command = f"python benchmarks/soft.py --model {options.model} --spacing {options.spacing:g}{extra}"
    about = f"Errors beside finite elements with inertia, by `{command}` ({points.stamp()}).\n\n"
    path = points.RESULTS / f"soft_{options.model}_{1e3 * options.spacing:g}mm.md"
    path.write_text(f"{about}{points.table(HEAD, rows)}\n", encoding="utf-8")


if __name__ == "__main__":
    main()
