"""The slump cone whose mould is lifted, in rings: beside half the spacing, half the step and the mould gone at once.

    python benchmarks/lifted.py run     # results/lifted.json, about eight CPU-minutes
    python benchmarks/lifted.py draw    # the table in docs/models.md

Slump and slump flow at rest, or 5 s after the mould is off, are means of three runs, whose particles start 1e-6
spacings aside. Of halved steps the longest is half of the longest while the concrete flows.
"""

import numpy as np
import points

SPEEDS = {"at once": None, "5 m/s": 5.0, "0.3 m/s": 0.3, "0.15 m/s": 0.15, "0.06 m/s": 0.06}
MIXES, RUNS = (100.0, 300.0, 500.0), 3  # yield stresses [Pa], with 50 Pa s
SPACINGS = {0.01: (1.0, 0.5), 0.005: (1.0,)}  # [m]; longest steps over the scheme's own
HEAD = ["mix", "mould", "slump, 10 mm [mm]", "5 mm", "step halved", "slump flow, 10 mm [mm]", "5 mm", "step halved"]
HEAD += ["CPU-s", "worst volume [%]"]


def cases() -> dict:
    """Settings of each point, by its name."""
    each = [(spacing, mould) for spacing in SPACINGS for mould in SPEEDS]
    return {f"{mould}, {1e3 * spacing:g} mm": {"speed": SPEEDS[mould], "spacing": spacing} for spacing, mould in each}


def point(speed: float | None, spacing: float) -> dict:
    """Means and standard deviations of slump and slump flow [m] by mix and step, compiled once."""
    import taichi_mps as mps
    from taichi_mps.problem.problem import Problem

    mps.init(threads=1)
    until = 5.0 + (0.3 / speed if speed else 0.0)
    cone = {"model": "axisymmetric", "spacing": spacing, "lift_speed": speed, "floor_radius": 0.37, "until": until}
    sim = start = None
    found = {}
    for tau in MIXES:
        scene = mps.slump_cone(yield_value=tau, **cone)
        sim = sim or mps.Simulation(scene)
        start = start or sim.state()
        for step in SPACINGS[spacing]:
            longest = None if step == 1.0 else step * sim.scheme.constants.max_time_step
            numerics, runs = mps.Implicit(max_time_step=longest), []
            for seed in range(RUNS):
                moved = {"x": start["x"] + points.aside(start["x"].shape, spacing, seed)}
                sim.restart(Problem(scene, numerics), start | moved)
                sim.scheme.numerics = numerics
                ended, measures = sim.run(), sim.measures()
                lengths = [measures["slump_m"], measures["spread_m"]]
                runs.append([*lengths, sim.report.volume_error_max, sim.cpu_seconds, sim.time, ended == "rest"])
            found[f"{tau:g} {step:g}"] = {
                "mean": np.mean(runs, 0).tolist(),
                "scatter": np.std(runs, 0, ddof=1).tolist(),
            }
    return {"mixes": found}


def draw() -> None:
    """The table of docs/models.md."""
    found, lines = points.read("lifted"), []
    for tau in MIXES:
        for mould in SPEEDS:
            coarse, fine = (found[f"{mould}, {mm} mm"]["mixes"] for mm in (10, 5))
            usual, finer, shorter = coarse[f"{tau:g} 1"], fine[f"{tau:g} 1"], coarse[f"{tau:g} 0.5"]
            told = [
                f"{1e3 * one['mean'][k]:.1f} ± {1e3 * one['scatter'][k]:.1f}"
                for k in (0, 1)
                for one in (usual, finer, shorter)
            ]
            lines.append(
                [f"{tau:g} Pa, 50 Pa s", mould, *told, f"{usual['mean'][3]:.2g}", f"{100 * usual['mean'][2]:.1f}"]
            )
    points.put("models.md", "lifted", points.table(HEAD, lines), found.values())


if __name__ == "__main__":
    points.main(__file__, "lifted", cases, point, draw, __doc__)
