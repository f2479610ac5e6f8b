"""The L-box against the closed form of a channel at rest, and against itself at a finer spacing.

    python benchmarks/l_box.py             # every case that benchmarks/results/l_box.json lacks
    python benchmarks/l_box.py slow_100    # some cases, again
    python benchmarks/l_box.py page        # the table of docs/scenes/l_box.md alone

"slow" is a viscous mix without bars, so that inertia does not count: in the plane (the L-flow with a far wall at 700 mm
from the back wall and a column of 600 mm) and as the half of the box. Depths are read as the scene reads them. The
closed form is that of a thin layer; h1 - h2 may exceed it by pi tau_y/(rho g) where what was stretched behind the gate
is pressed together before the far wall: the force of the normal stress over the depth changes from pi/2 tau_y h to
-pi/2 tau_y h there.
"""

import json
import math
import sys
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
RESULT, PAGE = ROOT / "benchmarks/results/l_box.json", ROOT / "docs/scenes/l_box.md"
BEGIN, END = "<!-- written by benchmarks/l_box.py -->", "<!-- end of benchmarks/l_box.py -->"
AREA, LENGTH, COLUMN, RULE = 0.06, 0.7, 0.1, 0.025  # of the section [m2], of the vessel, of the column, of a rule [m]
PLANE = {"model": "plane", "column_height": 0.6, "channel_length": LENGTH - COLUMN, "until": 120.0}
SLOW = {"bars": "none", "until": 120.0}
CASES = {  # scene, keywords
    "slow_100": ("l_flow", PLANE | {"yield_value": 100.0, "plastic_viscosity": 300.0}),
    "slow_100_fine": ("l_flow", PLANE | {"yield_value": 100.0, "plastic_viscosity": 300.0, "spacing": 0.00625}),
    "slow_40": ("l_flow", PLANE | {"yield_value": 40.0, "plastic_viscosity": 120.0}),
    "slow_40_fine": ("l_flow", PLANE | {"yield_value": 40.0, "plastic_viscosity": 120.0, "spacing": 0.00625}),
    "slow_40_box": ("l_box", SLOW | {"yield_value": 40.0, "plastic_viscosity": 120.0}),
    "free": ("l_box", {"bars": "none"}),
    "free_fine": ("l_box", {"bars": "none", "spacing": 0.01}),
    "bars": ("l_box", {"until": 6.0}),
    "rough": ("l_box", {"sides": "rough", "until": 6.0}),
    "gate": ("l_box", {"lift_speed": 0.3, "until": 6.0}),
}
NAMES = {
    "slow_100": "100 Pa, 300 Pa s, plane",
    "slow_40": "40 Pa, 120 Pa s, plane",
    "slow_40_box": "the same, half of the box",
    "free": "40 Pa, 20 Pa s, no bars",
    "bars": "40 Pa, 20 Pa s, 3 bars",
    "rough": "the same, rough sides",
    "gate": "40 Pa, 20 Pa s, 3 bars, gate lifted at 0.3 m/s",
}


def run(name: str) -> dict:
    """One test to its end: H1 and H2 [m], and what the closed form says."""
    import taichi_mps as mps
    from taichi_mps.problem import catalogue

    kind, keywords = CASES[name]
    scene = catalogue.build(kind, **keywords)
    sim = mps.Simulation(scene)
    stopped_by = sim.run()
    return {"stopped_by": stopped_by, "cpu_seconds": round(sim.cpu_seconds, 1)} | judged(name, scene, sim.snapshot())


def judged(name: str, scene, s) -> dict:
    """What is read off a snapshot of a case, and what the closed form says."""
    import taichi_mps as mps

    kind, keywords = CASES[name]
    s, mix = scene.unfold(s), scene.material
    if kind == "l_flow":
        h1, h2 = (mps.measure.standing_level(s, (end - RULE,), (end,)) for end in (COLUMN, LENGTH))
    else:
        h1, h2 = (scene.measure(s)[key] for key in ("h1_m", "h2_m"))
    between = 0.2 if keywords.get("sides") == "rough" else None
    at, h = mps.rest_shapes.channel_at_rest(AREA, mix.density, mix.yield_value, between, LENGTH)
    thin1, thin2 = np.interp([COLUMN - 0.5 * RULE, LENGTH - 0.5 * RULE], at, h)
    return {
        "scene": kind,
        "keywords": keywords,
        "particles": len(scene.fluid),
        "spacing_m": scene.spacing,
        "end_s": round(s.time, 3),
        "largest_speed_m_s": float(f"{s.speed.max():.3g}"),
        "h1_m": round(h1, 4),
        "h2_m": round(h2, 4),
        "thin_h1_m": round(float(thin1), 5),
        "thin_h2_m": round(float(thin2), 5),
        "step_m": round(math.pi * mix.yield_value / (mix.density * 9.81), 5),
    }


def page(results: dict) -> None:
    """The table between the marks of docs/scenes/l_box.md."""
    lines = ["| Mix and vessel | Spacing | H1 | H2 | H2/H1 | H1 - H2, thin layer to thin layer and normal stress |"]
    lines += ["|---|---|---|---|---|---|"]
    for name in CASES:
        if name in results:
            r = results[name]
            thin = r["thin_h1_m"] - r["thin_h2_m"]
            label = NAMES.get(name, "the same, finer")
            ends = f"after {r['end_s']:.3g} s" if r["stopped_by"] == "time" else f"at rest, {r['end_s']:.3g} s"
            h1, h2, spacing = (f"{1e3 * r[key]:g} mm" for key in ("h1_m", "h2_m", "spacing_m"))
            lines.append(
                f"| {label}, {ends} | {spacing} | {h1} | {h2} "
                f"| {r['h2_m'] / r['h1_m']:.2f} "
                f"| {1e3 * (r['h1_m'] - r['h2_m']):.0f} mm, {1e3 * thin:.0f} to {1e3 * (thin + r['step_m']):.0f} |"
            )
    text = PAGE.read_text(encoding="utf-8")
    before, after = text.split(BEGIN)[0], text.split(END)[1]
    PAGE.write_text(f"{before}{BEGIN}\n\n" + "\n".join(lines) + f"\n\n{END}{after}", encoding="utf-8")


if __name__ == "__main__":
    results = json.loads(RESULT.read_text(encoding="utf-8")) if RESULT.exists() else {}
    if sys.argv[1:] != ["page"]:
        import taichi_mps

        taichi_mps.init(threads=1)
        for case in sys.argv[1:] or [name for name in CASES if name not in results]:
            begin = time.perf_counter()
            results[case] = run(case)
            print(case, results[case], f"{time.perf_counter() - begin:.0f} s", flush=True)
            RESULT.write_text(
                json.dumps({k: results[k] for k in CASES if k in results}, indent=1) + "\n", encoding="utf-8"
            )
    page(results)
