"""Fingerprints of many short runs, bits and CPU seconds, to compare two checkouts whose results should be equal.

    python benchmarks/fingerprint.py                         # this checkout, a table on the screen
    python benchmarks/fingerprint.py --against OTHER         # run in turn with another checkout; both in one table
    python benchmarks/fingerprint.py --against OTHER --repeats 3 --out benchmarks/results/fingerprint.json
    python benchmarks/fingerprint.py --against OTHER --exact    # compiled without fast_math

Every built-in scene at a coarse spacing, both schemes where they apply, every model, wall surfaces and wall particles,
friction, inlet, two mixes, a lifted mould, a solid from a mesh, flow curves, one and two threads, a run taken up again.
Each case is a process of its own. Its fingerprint is a hash of what the particles carry after a number of steps:
positions, velocities, pressures, shear rates, stresses and plastic rates in the order of their numbers, and the time.

With fast_math, the default, the compiler may contract and regroup sums anew where only the surroundings of a loop have
changed; `--exact` compiles without it: then equal arithmetic has equal bits. Runs are chaotic in the last bits: final
measures are compared by `models.py`, whose cones come to rest five times each, their particles 1e-6 spacings aside.

CPU seconds are those of the steps after the first one, compile seconds those until its end; of repeats the least
counts, for the machines are shared. `--out` writes the table as JSON and, beside it, as Markdown.
"""

import argparse
import hashlib
import json
import os
import subprocess
import sys
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import points

import taichi_mps as mps

CARRIED = "x", "u", "p", "shear_rate", "stress", "plastic_rate"
COARSE = {"spacing": 0.02}

# name: (scene, its keywords, scheme, numerics, steps, threads, precision)
CASES = {
    "slump full": ("slump", COARSE, "implicit", {}, 150, 1, "f32"),
    "slump full, two threads": ("slump", COARSE, "implicit", {}, 150, 2, "f32"),
    "slump full, f64": ("slump", COARSE, "implicit", {}, 100, 1, "f64"),
    "slump full, node multigrid": ("slump", {"spacing": 0.0085}, "implicit", {}, 12, 1, "f32"),
    "slump full, node multigrid, two threads": ("slump", {"spacing": 0.0085}, "implicit", {}, 12, 2, "f32"),
    "slump half": ("slump", {**COARSE, "model": "half"}, "implicit", {}, 150, 1, "f32"),
    "slump quarter": ("slump", {**COARSE, "model": "quarter"}, "implicit", {}, 150, 1, "f32"),
    "slump axisymmetric": ("slump", {"spacing": 0.01, "model": "axisymmetric"}, "implicit", {}, 300, 1, "f32"),
    "slump axisymmetric, two threads": (
        "slump",
        {"spacing": 0.004, "model": "axisymmetric"},
        "implicit",
        {},
        60,
        2,
        "f32",
    ),
    "slump bi-viscosity": ("slump", {**COARSE, "critical_strain_rate": 0.1}, "implicit", {}, 100, 1, "f32"),
    "slump Newtonian": ("slump", {**COARSE, "yield_value": 0.0}, "implicit", {}, 100, 1, "f32"),
    "slump, mould lifted": ("slump", {**COARSE, "lift_speed": 0.12}, "implicit", {}, 150, 1, "f32"),
    "slump, wall particles": ("slump", COARSE, "implicit", {"walls": "particles"}, 40, 1, "f32"),
    "slump, wall particles, two threads": (
        "slump",
        {"spacing": 0.015},
        "implicit",
        {"walls": "particles"},
        8,
        2,
        "f32",
    ),
    "slump semi-implicit": ("slump", COARSE, "semi-implicit", {}, 150, 1, "f32"),
    "slump semi-implicit, two threads": ("slump", {"spacing": 0.015}, "semi-implicit", {}, 60, 2, "f32"),
    "mini_cone": ("mini_cone", {"spacing": 0.002}, "implicit", {}, 300, 1, "f32"),
    "film": ("film", {"spacing": 0.01}, "implicit", {}, 300, 1, "f32"),
    "film semi-implicit": ("film", {"spacing": 0.01}, "semi-implicit", {}, 200, 1, "f32"),
    "dam_break": ("dam_break", {}, "implicit", {}, 300, 1, "f32"),
    "dam_break semi-implicit": ("dam_break", {}, "semi-implicit", {}, 80, 1, "f32"),
    "still_pool": ("still_pool", {}, "implicit", {}, 300, 1, "f32"),
    "still_pool semi-implicit": ("still_pool", {}, "semi-implicit", {}, 100, 1, "f32"),
    "l_flow plane": ("l_flow", {"spacing": 0.0125, "model": "plane"}, "implicit", {}, 300, 1, "f32"),
    "l_flow half, gate lifted": ("l_flow", {"spacing": 0.025, "lift_speed": 0.3}, "implicit", {}, 100, 1, "f32"),
    "l_box": ("l_box", {"spacing": 0.025}, "implicit", {}, 100, 1, "f32"),
    "u_box": ("u_box", {"spacing": 0.025}, "implicit", {}, 100, 1, "f32"),
    "lcpc_box": ("lcpc_box", {"spacing": 0.025}, "implicit", {}, 150, 1, "f32"),
    "v_funnel": ("v_funnel", {"spacing": 0.016}, "implicit", {}, 100, 1, "f32"),
    "j_ring": ("j_ring", {"spacing": 0.02}, "implicit", {}, 150, 1, "f32"),
    "wall: inlet, mesh solid": ("wall", {"spacing": 0.04}, "implicit", {}, 150, 1, "f32"),
    "friction": ("friction", {}, "implicit", {}, 150, 1, "f32"),
    "friction, axisymmetric": ("friction", {"model": "axisymmetric"}, "implicit", {}, 150, 1, "f32"),
    "two mixes": ("mixes", {}, "implicit", {}, 150, 1, "f32"),
    "Herschel-Bulkley": ("curve", {"law": "Herschel-Bulkley"}, "implicit", {}, 100, 1, "f32"),
    "thixotropic flow curve": ("curve", {"law": "thixotropic"}, "implicit", {}, 100, 1, "f32"),
    "full closed box": ("box", {}, "implicit", {}, 150, 1, "f32"),
    "taken up again": ("slump", COARSE, "implicit", {"resumed": 60}, 150, 1, "f32"),
    "taken up again, semi-implicit": ("film", {"spacing": 0.01}, "semi-implicit", {"resumed": 100}, 200, 1, "f32"),
}


# which tell whether numerics are the same, at the head of each result: cheap ones of both schemes
SHORT = "film", "still_pool", "slump quarter", "Herschel-Bulkley", "slump semi-implicit", "film semi-implicit"


# ---- scenes ---------------------------------------------------------------------------------------------------------
def built_in(name: str, **keywords):
    """A scene of the folder scenes/ of the checkout that is imported."""
    return mps.catalogue.load(name)(**keywords)


def friction(model="full"):
    """A coarse cone on a floor with a yield stress and a viscous constant of its own."""
    scene = built_in("slump", spacing=0.02 if model == "full" else 0.01, model=model)
    law = mps.Friction(yield_value=50.0, viscous_constant=200.0)
    floor, *others = scene.walls
    return replace(scene, walls=(replace(floor, friction=law), *others), wall_particles=None)


def mixes():
    """A block on a floor, onto which a hose pours a denser and stiffer mix."""
    spacing = 0.02
    first = mps.Bingham(density=2200.0, plastic_viscosity=20.0, yield_value=50.0)
    second = mps.Bingham(density=2400.0, plastic_viscosity=60.0, yield_value=150.0)
    hose = mps.Inlet((0.1, 0.25), (0.0, -1.0), 0.03, 0.02, 0.01, 0.0, second)
    walls = tuple(mps.box_planes((0.0, 0.0), (0.2, 0.6)))[:3]
    x = mps.fill(mps.Box((0.0, 0.0), (0.2, 0.1)), spacing)
    return mps.Scene("mixes", first, spacing, x, ((-0.1, -0.1), (0.3, 0.7)), walls=walls, inlets=(hose,))


def thinning(rate, structure):
    return 100.0 + 40.0 * rate / (1.0 + structure)


def building(rate, structure):
    return 0.5 - 0.1 * rate * structure


def curve(law):
    """A plane block that spreads, by a flow curve other than Bingham's."""
    spacing = 0.0125
    material = mps.HerschelBulkley(yield_value=100.0, consistency=40.0, flow_index=0.6)
    if law == "thixotropic":
        material = mps.FlowCurve(
            yield_value=100.0,
            typical_slope=40.0,
            shear_stress=thinning,
            growth=building,
        )
    x = mps.fill(mps.Box((0.0, 0.0), (0.2, 0.2)), spacing)
    walls = mps.Plane((0.0, 0.0), (0.0, 1.0)), mps.Plane((0.0, 0.0), (1.0, 0.0), mirror=True)
    return mps.Scene("curve", material, spacing, x, ((-0.05, -0.05), (0.6, 0.4)), walls=walls)


def box():
    """A closed box that is full of a Bingham fluid, whose lid moves."""
    spacing, size = 0.025, 0.5
    x = mps.fill(mps.Box((0.0, 0.0), (size, size)), spacing)
    walls = mps.box_planes((0.0, 0.0), (size, size))
    walls = tuple(replace(wall, velocity=(0.5, 0.0)) if wall.normal[1] < 0.0 else wall for wall in walls)
    material = mps.Bingham(density=1000.0, plastic_viscosity=10.0, yield_value=20.0)
    return mps.Scene("box", material, spacing, x, ((-0.1,) * 2, (size + 0.1,) * 2), walls=walls, gravity=(0.0, 0.0))


OWN = {"friction": friction, "mixes": mixes, "curve": curve, "box": box}


# ---- one case -------------------------------------------------------------------------------------------------------
def fingerprint(sim) -> str:
    """Hash of what the particles carry, in the order of their numbers, and of the time."""
    state = sim.state()
    order = np.argsort(state["id"])
    total = hashlib.sha256(np.float64(state["time"]).tobytes())
    for name in CARRIED:
        if name in state:
            total.update(name.encode() + np.ascontiguousarray(state[name][order]).tobytes())
    return total.hexdigest()[:16]


def carry_out(name: str, exact: bool = False) -> dict:
    """Run a case in this process."""
    import taichi

    start = taichi.init
    if exact:
        taichi.init = lambda **settings: start(**(settings | {"fast_math": False}))
    warnings.simplefilter("ignore")
    scene, keywords, scheme, numerics, steps, threads, precision = CASES[name]
    mps.init("cpu", precision, threads)
    made = OWN[scene](**keywords) if scene in OWN else built_in(scene, **keywords)
    settings = {key: value for key, value in numerics.items() if key != "resumed"}
    method = {"implicit": mps.Implicit, "semi-implicit": mps.SemiImplicit}[scheme](**settings)
    sim = mps.Simulation(made, method)
    for step in range(steps):
        if step == numerics.get("resumed"):
            state = sim.state()
            sim = mps.Simulation(made, method)
            sim.load(state)
        sim.step()
    return {
        "hash": fingerprint(sim),
        "particles": sim.fluid_particles,
        "steps": steps,
        "time_s": sim.time,
        "cpu_s": sim.cpu_seconds,
        "compile_s": sim.compile_seconds,
    }


# ---- all of them ----------------------------------------------------------------------------------------------------
def of_checkout(checkout: Path, *words: str):
    """Run the file of this name of a checkout, whose public names may be other ones, in a process of its own and read
    the JSON that it prints."""
    words = [sys.executable, checkout / "benchmarks" / Path(__file__).name, *words]
    done = subprocess.run(
        words, cwd=checkout, env=os.environ | {"PYTHONPATH": str(checkout)}, capture_output=True, text=True
    )
    if done.returncode:
        return {"error": done.stderr.strip().splitlines()[-1][:200]}
    return json.loads(done.stdout.strip().splitlines()[-1])


def numerics() -> str:
    """Hash of the SHORT cases, exact; kept in build/ for these sources and this processor, for it takes a minute."""
    from validation import provenance

    sources = [file for part in ("taichi_mps", "scenes") for file in sorted((points.ROOT / part).rglob("*.py"))]
    state = hashlib.sha256(b"".join(file.read_bytes() for file in [*sources, Path(__file__)]))
    state.update(json.dumps([provenance.facts()[key] for key in ("processor", "taichi")]).encode())
    kept = points.ROOT / "build" / f"numerics-{state.hexdigest()[:16]}"
    if not kept.exists():
        print("the hash of the numerics of these sources is made: a minute", file=sys.stderr, flush=True)
        runs = [of_checkout(points.ROOT, "--case", name, "--exact") for name in SHORT]
        kept.parent.mkdir(exist_ok=True)
        kept.write_text(hashlib.sha256("".join(run["hash"] for run in runs).encode()).hexdigest()[:16], "utf-8")
    return kept.read_text(encoding="utf-8")


def least(runs: list[dict]) -> dict:
    """Combine runs of a case into one with the least times; an error where one failed or their bits differ."""
    failed = next((run for run in runs if "error" in run), None)
    if failed or len({run["hash"] for run in runs}) > 1:
        return failed or {"error": "bits differ from run to run"}
    return runs[0] | {key: min(run[key] for run in runs) for key in ("cpu_s", "compile_s")}


HEAD = [
    "case",
    "particles",
    "steps",
    "fingerprint",
    "CPU [s]",
    "compile [s]",
    "before",
    "CPU [s]",
    "compile [s]",
    "ratio",
]


def cells(name: str, now: dict, before: dict | None) -> list:
    """A line of the table: fingerprint, CPU and compile seconds, now and before, and where bits are not the same."""
    if "error" in now:
        return [name, now["error"], *[""] * 8]
    line = [name, now["particles"], now["steps"], now["hash"], f"{now['cpu_s']:.2f}", f"{now['compile_s']:.1f}"]
    if before is None or "error" in before:
        return [*line, (before or {}).get("error", ""), "", "", ""]
    same = "same" if before["hash"] == now["hash"] else f"**{before['hash']}**"
    ratio = now["cpu_s"] / before["cpu_s"]
    return [*line, same, f"{before['cpu_s']:.2f}", f"{before['compile_s']:.1f}", f"{ratio:.2f}"]


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--case", choices=CASES, help="one case in this process, as JSON")
    parser.add_argument("--numerics", action="store_true", help="one hash of the short cases, exact")
    parser.add_argument("--only", nargs="+", choices=CASES, default=list(CASES), help="these cases")
    parser.add_argument("--against", type=Path, help="another checkout, run in turn with this one")
    parser.add_argument("--exact", action="store_true", help="compiled without fast_math")
    parser.add_argument("--repeats", type=int, default=1)
    parser.add_argument("--out", type=Path, help="JSON file for the table; the same as Markdown beside it")
    arguments = parser.parse_args()
    if arguments.case:
        print(json.dumps(carry_out(arguments.case, arguments.exact)))
        return
    if arguments.numerics:
        print(numerics())
        return
    checkouts = {"now": points.ROOT} | ({"before": arguments.against.resolve()} if arguments.against else {})
    results, exact = {}, ["--exact"] * arguments.exact
    lines = []
    for name in arguments.only:
        runs = {label: [] for label in checkouts}
        for _ in range(arguments.repeats):
            for label, checkout in checkouts.items():
                runs[label].append(of_checkout(checkout, "--case", name, *exact))
        results[name] = {label: least(found) for label, found in runs.items()}
        lines.append(cells(name, results[name]["now"], results[name].get("before")))
        print("| " + " | ".join(map(str, lines[-1])) + " |", flush=True)
    if arguments.out:
        told = {"machine": points.head(), "cases": results}
        arguments.out.write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")
        arguments.out.with_suffix(".md").write_text(points.table(HEAD, lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
