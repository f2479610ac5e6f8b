"""What longer steps and fewer passes change of a pour: the scene wall, means of five runs each.

    python benchmarks/pour_steps.py   # results/pour_steps.md, five CPU-minutes

The hoses of the five runs are 1e-6 spacings aside, so what scatters is the flow.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

RESULT = Path(__file__).parent / "results/pour_steps.md"
SETTINGS = {"the default": {}, "`--courant-number 0.4`": {"courant_number": 0.4}}
SETTINGS |= {f"`--courant-number {c} --passes 3`": {"courant_number": c, "passes": 3} for c in (0.4, 0.65)}
HEAD = ("settings", "steps", "CPU-s", "level near [mm]", "level far [mm]", "filled [per mille]", "volume error [%]")
SPACING, UNTIL, RUNS = 0.025, 10.0, 5  # [m], [s]


def run(numerics: dict, seed: int) -> list[float]:
    """Numbers of HEAD of one run; CPU seconds without the first step, which compiles."""
    import taichi_mps as mps
    from taichi_mps.problem import catalogue

    scene = catalogue.build("wall", spacing=SPACING, until=UNTIL)
    aside = 1e-6 * SPACING * np.random.default_rng(seed).uniform(-1.0, 1.0, 3) * (1.0, 0.0, 1.0) * (seed > 0)
    inlet = replace(scene.inlets[0], centre=tuple(np.array(scene.inlets[0].centre) + aside))
    sim = mps.Simulation(replace(scene, inlets=(inlet,)), mps.Implicit(**numerics))
    sim.step()
    compiling = sim.cpu_seconds
    sim.run()
    levels, summary = sim.measures(), sim.summary()
    found = [1e3 * levels["near_m"], 1e3 * levels["far_m"], 1e3 * summary["filled_ratio"]]
    return [sim.steps, sim.cpu_seconds - compiling, *found, 100.0 * summary["volume_error_max"]]


def main() -> None:
    import taichi_mps as mps

    mps.init(threads=1)
    lines = [HEAD, ["---"] * len(HEAD)]
    for name, numerics in SETTINGS.items():
        rows = np.array([run(numerics, seed) for seed in range(RUNS)])
        lines.append(
            [name, *(f"{mean:.4g} ± {by:.2g}" for mean, by in zip(rows.mean(0), rows.std(0, ddof=1), strict=True))]
        )
        print(" | ".join(lines[-1]), flush=True)
    table = "\n".join("| " + " | ".join(line) + " |" for line in lines)
    about = (
        "Scene wall, 25 mm, 60 Pa, 20 Pa s, 10 s, by `python benchmarks/pour_steps.py`: means of five runs and their"
    )
    RESULT.write_text(f"{about}\nstandard deviation; one thread.\n\n{table}\n", encoding="utf-8")


if __name__ == "__main__":
    main()
