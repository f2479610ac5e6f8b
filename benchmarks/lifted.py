"""The slump cone whose mould is lifted: rings and the whole cone at several spacings, and Newton's implicit MPM.

    python benchmarks/lifted.py run     # results/lifted.json, about twenty CPU-minutes
    python benchmarks/lifted.py draw    # the tables in docs/models.md

Slump and slump flow at rest, or after a minute, are means of runs whose particles start 1e-6 spacings aside. Of halved
steps the longest is half of the longest while the concrete flows, and they end when the usual ones do. Newton's method
ends 2 s after the mould is off; it must be installed (benchmarks/peers).
"""

import sys
from pathlib import Path

import numpy as np
import points

from validation import provenance

SPEEDS = {"at once": None, "5 m/s": 5.0, "0.3 m/s": 0.3, "0.15 m/s": 0.15, "0.06 m/s": 0.06}
MIXES = 100.0, 300.0, 500.0  # yield stresses [Pa], with 50 Pa s
RINGS, WHOLE, PEER = "rings", "whole", "Newton"
# Model, spacing [m]: runs, longest steps over the scheme's own, speeds
RUNS = {
    (RINGS, 0.01): (3, (1.0, 0.5), list(SPEEDS)),
    (RINGS, 0.005): (3, (1.0,), list(SPEEDS)),
    (WHOLE, 0.02): (1, (1.0,), list(SPEEDS)),
    (WHOLE, 0.01): (1, (1.0,), list(SPEEDS)),
    (PEER, 0.015): (1, (1.0,), ["at once", "0.3 m/s", "0.06 m/s"]),
}
LONG = 60.0  # time limit [s]
HEAD = ["mix", "mould", "slump, 10 mm [mm]", "5 mm", "step halved", "slump flow, 10 mm [mm]", "5 mm", "step halved"]
HEAD += ["CPU-s", "worst volume [%]"]
BESIDE = "rings, 5 mm", "whole, 10 mm", "whole, 20 mm", "Newton, 15 mm"


def cases() -> dict:
    """Settings of each point, by its name."""
    return {
        f"{mould}, {model}, {1e3 * spacing:g} mm": {"model": model, "spacing": spacing, "speed": SPEEDS[mould]}
        for (model, spacing), (_, _, moulds) in RUNS.items()
        for mould in moulds
    }


def point(model: str, spacing: float, speed: float | None) -> dict:
    """Means and standard deviations of slump and slump flow [m], volume error [-], CPU time, end [s] and whether at
    rest, by mix and step. Newton's are of none of this engine's numerics."""
    if model == PEER:
        return {"mixes": newton(spacing, speed), "machine": points.head() | {provenance.NUMERICS: "none"}}
    return {"mixes": ours(model, spacing, speed)}


def ours(model: str, spacing: float, speed: float | None) -> dict:
    """What this engine finds, compiled once."""
    import taichi_mps as mps
    from taichi_mps.engine.problem.problem import Problem

    mps.init(threads=1)
    cone = {"model": "full" if model == WHOLE else "axisymmetric", "spacing": spacing, "lift_speed": speed}
    count, steps, _ = RUNS[model, spacing]
    sim = start = None
    found = {}
    for tau in MIXES:
        scene, end = mps.slump_cone(yield_value=tau, **cone, floor_radius=0.37, until=LONG), None
        sim = sim or mps.Simulation(scene)
        start = start or sim.state()
        for step in steps:
            longest = None if step == 1.0 else step * sim.scheme.constants.time_step.longest
            numerics, runs = mps.Implicit(max_time_step=longest), []
            for seed in range(count):
                moved = {"x": start["x"] + points.aside(start["x"].shape, spacing, seed)}
                sim.restart(Problem(scene, numerics), start | moved)
                sim.scheme.numerics = numerics
                ended, measures = sim.run(end), sim.measures()
                lengths = [measures["slump_m"], measures["spread_m"]]
                runs.append([*lengths, sim.report.volume_error_max, sim.cpu_seconds, sim.time, ended == "rest"])
            mean, scatter = np.mean(runs, 0).tolist(), np.std(runs, 0, ddof=1).tolist() if count > 1 else [0.0] * 6
            found[f"{tau:g} {step:g}"], end = {"mean": mean, "scatter": scatter}, mean[4]
    return found


def newton(spacing: float, speed: float | None) -> dict:
    """What Newton's method finds of the same particles."""
    sys.path.append(str(Path(__file__).parent / "peers"))
    import cases as peers
    from compare import measure

    found = {}
    for tau in MIXES:
        case = peers.lifted(tau, spacing, speed)
        row = measure(case, case.runs[0], limit=3600.0)
        mean = [row["slump_m"], row["spread_m"], 0.0, row["cpu_seconds"], case.until, 0.0]
        found[f"{tau:g} 1"] = {"mean": mean, "scatter": [0.0] * 6}
    return found


def draw() -> None:
    """The tables of docs/models.md."""
    found, lines, beside = points.read("lifted"), [], []
    for tau in MIXES:
        for mould in SPEEDS:
            coarse, fine = (found[f"{mould}, {RINGS}, {mm} mm"]["mixes"] for mm in (10, 5))
            usual, finer, shorter = coarse[f"{tau:g} 1"], fine[f"{tau:g} 1"], coarse[f"{tau:g} 0.5"]
            told = [
                f"{1e3 * one['mean'][k]:.1f} ± {1e3 * one['scatter'][k]:.1f}"
                for k in (0, 1)
                for one in (usual, finer, shorter)
            ]
            name = [f"{tau:g} Pa, 50 Pa s", mould]
            lines.append([*name, *told, f"{usual['mean'][3]:.2g}", f"{100 * usual['mean'][2]:.1f}"])
            cells = [
                "{:.1f}, {:.1f}, {:.2g}".format(*1e3 * np.array(row["mean"][:2]), row["mean"][3]) if row else "-"
                for row in [found.get(f"{mould}, {one}", {}).get("mixes", {}).get(f"{tau:g} 1") for one in BESIDE]
            ]
            beside.append([*name, *cells])
    tables = (
        points.table(HEAD, lines) + "\n\n" + points.table(["slump, slump flow [mm], CPU-s", "mould", *BESIDE], beside)
    )
    points.put("models.md", "lifted", tables, found.values())


if __name__ == "__main__":
    points.main(__file__, "lifted", cases, point, draw, __doc__)
