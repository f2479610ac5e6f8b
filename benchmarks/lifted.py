"""The slump cone whose mould is lifted: from slow to at once, and against another method that moves the mould.

    python benchmarks/lifted.py            # every run that benchmarks/results/lifted.json lacks
    python benchmarks/lifted.py ours       # of this engine alone; newton: of the other method alone
    python benchmarks/lifted.py page       # the table of docs/scenes/slump.md alone

Cone of the scene `slump` at 15 mm, filled with rings, whether its mould is lifted or gone at t = 0. The other method is
Newton's implicit material point method (benchmarks/peers, skipped where it is not installed) with the same particles,
its mould a closed shell 45 mm thick that moves up: no friction, no adhesion. Its slump is read 1 s after the mould is
off the cone, the engine's at rest.
"""

import json
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
RESULT, PAGE = ROOT / "benchmarks/results/lifted.json", ROOT / "docs/scenes/slump.md"
BEGIN, END = "<!-- written by benchmarks/lifted.py -->", "<!-- end of benchmarks/lifted.py -->"
SPACING, HEIGHT, AFTER = 0.015, 0.3, 1.0  # [m], [m], [s]
YIELD_VALUES, SPEEDS = (500.0, 100.0, 1000.0), (0.05, 0.1, 0.2, 0.5, 2.0)  # [Pa], [m/s]
PEER_SPEEDS = 0.5, 0.1, 0.2, 0.05


def scene_of(yield_value: float, speed: float | None):
    """The lifted cone, or the same particles without a mould; for all mixes on the same floor."""
    import taichi_mps as mps

    scene = mps.slump_cone(yield_value=yield_value, spacing=SPACING, lift_speed=speed or 1.0, floor_radius=0.37)
    return scene if speed else replace(scene, walls=scene.walls[:-1])


def ours(speed: float | None, wanted):
    """Slump and spread [m] at rest, and the largest volume error on the way, of each yield stress [Pa] in turn."""
    import taichi_mps as mps
    from taichi_mps.problem.problem import Problem

    sim = None
    for yield_value in wanted:
        problem = Problem(scene_of(yield_value, speed), mps.Implicit())
        if sim is None:
            sim = mps.Simulation(problem)
            beginning = sim.state()
        else:
            sim.restart(problem, beginning)
        stopped_by, found = sim.run(), sim.measures()
        yield {
            "slump_m": round(found["slump_m"], 5),
            "spread_m": round(found["spread_m"], 5),
            "end_s": round(sim.time, 3),
            "stopped_by": stopped_by,
            "largest_volume_error": round(sim.report.volume_error_max, 4),
            "cpu_seconds": round(sim.cpu_seconds, 1),
        }


def newton(speed: float | None, wanted):
    """The same by Newton's method; nothing where it is not installed."""
    for yield_value in wanted:
        if (row := peer(yield_value, speed)) is None:
            print("newton: not installed, skipped (python benchmarks/peers/newton_slump.py install)")
            return
        yield row


def peer(yield_value: float, speed: float | None) -> dict | None:
    """One run of Newton; None where it is not installed."""
    sys.path.insert(0, str(ROOT / "benchmarks/peers"))
    from environments import where

    from taichi_mps.problem import measures as measure

    if where("newton") is None:
        return None
    scene, end = scene_of(yield_value, speed), AFTER + (HEIGHT / speed if speed else 0.0)
    case = {
        "spacing": SPACING,
        "fluid": scene.fluid.tolist(),
        "volume": float(scene.volumes.sum()),
        "density": scene.material.density,
        "plastic_viscosity": scene.material.plastic_viscosity,
        "yield_value": yield_value,
        "mould": {"base_radius": 0.1, "top_radius": 0.05, "height": HEIGHT, "thickness": 0.045, "speed": speed}
        if speed
        else None,
        "until": end,
        "times": [end],
        "settings": {"voxel": 1.5, "dt": 0.01},
    }
    with tempfile.TemporaryDirectory() as folder:
        data, out = Path(folder) / "case.json", Path(folder) / "out.npz"
        data.write_text(json.dumps(case), encoding="utf-8")
        script = str(ROOT / "benchmarks/peers/newton_slump.py")
        subprocess.run([str(where("newton")), script, str(data), str(out)], check=True)
        with np.load(out) as output:
            found = measure.slump(measure.still(output["x"][-1], SPACING), HEIGHT)
            cpu = float(output["cpu_seconds"])
    return {
        "slump_m": round(found["slump_m"], 5),
        "spread_m": round(found["spread_m"], 5),
        "end_s": end,
        "cpu_seconds": round(cpu, 1),
    }


def page(results: dict) -> None:
    """The table between the marks of docs/scenes/slump.md."""
    names = [f"{speed:g} m/s" for speed in SPEEDS] + ["at once"]
    lines = ["| Slump, spread [mm] | " + " | ".join(names) + " |", "|---" * (len(names) + 1) + "|"]
    for yield_value in sorted(YIELD_VALUES):
        for label, (method, _speeds) in METHODS.items():
            cells = []
            for speed in (*SPEEDS, None):
                row = results.get(key(method, yield_value, speed))
                cells.append(f"{1e3 * row['slump_m']:.0f}, {1e3 * row['spread_m']:.0f}" if row else "-")
            if set(cells) != {"-"}:
                lines.append(f"| {yield_value:g} Pa, {label} | " + " | ".join(cells) + " |")
    text = PAGE.read_text(encoding="utf-8")
    before, after = text.split(BEGIN)[0], text.split(END)[1]
    PAGE.write_text(f"{before}{BEGIN}\n\n" + "\n".join(lines) + f"\n\n{END}{after}", encoding="utf-8")


def key(method, yield_value: float, speed: float | None) -> str:
    return f"{method.__name__} {yield_value:g} Pa {f'{speed:g} m/s' if speed else 'at once'}"


METHODS = {"this engine": (ours, SPEEDS), "Newton": (newton, PEER_SPEEDS)}


def found() -> dict:
    """The runs that were made."""
    return json.loads(RESULT.read_text(encoding="utf-8")) if RESULT.exists() else {}


def fill(method, speeds) -> None:
    """Make the runs that are missing; the JSON has each as soon as it is done."""
    for speed in (None, *speeds):
        wanted = [value for value in YIELD_VALUES if key(method, value, speed) not in found()]
        for yield_value, row in zip(wanted, method(speed, wanted), strict=False):
            results = found() | {key(method, yield_value, speed): row}  # another process may have added to it
            print(key(method, yield_value, speed), row, flush=True)
            RESULT.write_text(json.dumps(dict(sorted(results.items())), indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    if sys.argv[1:] != ["page"]:
        import taichi_mps

        taichi_mps.init(threads=1)
        for method, speeds in METHODS.values():
            if sys.argv[1:] in ([], [method.__name__]):
                fill(method, speeds)
    page(found())
