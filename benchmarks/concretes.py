"""103 measured pairs of slump and slump flow beside what a Bingham cone can do, with and without slip at the plate.

    python benchmarks/concretes.py run    # cones that slip, by rings: results/concretes.json, two CPU-minutes
    python benchmarks/concretes.py draw   # docs/concretes.md and its chart

A cone without slip: the table of `taichi-mps calibrate` (rings of 10 mm, to rest). Measured: Yeh (2007), UCI.
"""

import json
import sys

import numpy as np
import points

MEASURED = "E_measured_slump_flow_yeh.csv"
YIELDS = 60.0, 100.0, 150.0, 200.0, 300.0, 400.0, 600.0, 800.0, 1200.0  # of the cones that slip [Pa]
VISCOSITY = 50.0  # theirs [Pa s]
BAND = 20.0, 200.0  # of the cones that do not [Pa s]
NEAR = 10.0, 20.0  # [mm] of slump and of flow within which a cone explains a measurement
HEIGHT, VOLUME = 300.0, 5.498e6  # of the cone [mm], [mm3]
PLATES = {"no friction at the plate": 0.0, "plate of half of the yield stress": 0.5}  # over that of the mix
RESULT = points.RESULTS / "concretes.json"


def run() -> None:
    """Cones to rest on plates that hold less than the mix."""
    from dataclasses import replace

    import taichi_mps as mps

    mps.init(threads=1)
    found = {}
    for plate, part in PLATES.items():
        for tau in YIELDS:
            scene = mps.slump_cone(yield_value=tau, plastic_viscosity=VISCOSITY, model="axisymmetric", floor_radius=1.0)
            floor = {"friction": mps.Friction(yield_value=part * tau)} if part else {"slip": True}
            sim = mps.Simulation(replace(scene, walls=(replace(scene.walls[0], **floor),), until=20.0))
            sim.run()
            measures = sim.measures()
            cone = {"yield_value": tau, "slump_mm": 1e3 * measures["slump_m"], "flow_mm": 1e3 * measures["spread_m"]}
            found.setdefault(plate, []).append(cone | {"stopped_by": sim.stopped_by})
            print(plate, found[plate][-1], flush=True)
    RESULT.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


def concretes() -> np.ndarray:
    """Slump and slump flow [mm] of the measured ones, (103, 2)."""
    from taichi_mps.validation import read_reference

    return np.array([(10.0 * float(r["slump_cm"]), 10.0 * float(r["flow_cm"])) for r in read_reference(MEASURED)])


def band() -> np.ndarray:
    """Slump and slump flow [mm] of Bingham cones without slip: (viscosities, yield stresses, 2)."""
    from taichi_mps.study.calibrate import emulator_of
    from taichi_mps.study.emulator import DENSITY

    emulator = emulator_of(None)
    yields = np.linspace(emulator.low[0], emulator.high[0], 200)
    viscosities = np.log(np.geomspace(*BAND, 25) / DENSITY)
    cones = [emulator.at(yields, np.full(len(yields), eta)) for eta in viscosities]
    return 1e3 * np.array([np.column_stack([c["slump_m"], c["spread_m"]]) for c in cones])


def curves() -> dict[str, np.ndarray]:
    """Slump and slump flow [mm] of the cones that slip, between the computed ones."""
    found = {}
    for plate, cones in json.loads(RESULT.read_text(encoding="utf-8")).items():
        known = np.array([(np.log(c["yield_value"]), c["slump_mm"], c["flow_mm"]) for c in cones])
        fine = np.linspace(known[0, 0], known[-1, 0], 200)
        found[plate] = np.column_stack([np.interp(fine, known[:, 0], known[:, k]) for k in (1, 2)])
    return found


def missed(measured, cones) -> np.ndarray:
    """Of each measured one the errors of slump and flow [mm] of the cone that explains it best, (n, 2)."""
    away = cones.reshape(-1, 2)[None] - measured[:, None]
    best = ((away / NEAR) ** 2).sum(2).argmin(1)
    return away[np.arange(len(measured)), best]


def draw() -> None:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    measured, cones, slipping = concretes(), band(), curves()
    stands = measured[:, 0] == 0.0
    room = 0.25 * np.pi * measured[:, 1] ** 2 * (HEIGHT - measured[:, 0])  # of the cylinder around the body
    impossible = ~stands & (room < VOLUME)
    real = measured[~stands & ~impossible]
    ways = {"Bingham, no slip, 20 to 200 Pa s": cones} | {f"Bingham, {plate}": c for plate, c in slipping.items()}
    lines = [
        "| the cone | explains | slump missed by, median [mm] | flow missed by, median [mm] |",
        "|---|---|---|---|",
    ]
    for name, way in (ways | {"any of these": np.concatenate([w.reshape(-1, 2) for w in ways.values()])}).items():
        error = missed(real, way)
        near = np.all(np.abs(error) <= NEAR, axis=1)
        typical = np.median(error, axis=0)
        lines.append(f"| {name} | {near.sum()} of {len(real)} | {typical[0]:+.0f} | {typical[1]:+.0f} |")
    lines += ["", f"Left out: {stands.sum()} without slump, {impossible.sum()} that hold less than the cone's volume."]
    points.put("concretes.md", "concretes", "\n".join(lines))

    figure, axis = plt.subplots(figsize=(7.6, 5.4), layout="constrained")
    low, high = cones[0], cones[-1]
    axis.fill(*np.vstack([low, high[::-1]]).T / 10.0, color="#4477aa", alpha=0.3, lw=0, label=next(iter(ways)))
    for (plate, curve), style in zip(slipping.items(), ("-", "--"), strict=True):
        axis.plot(*curve.T / 10.0, style, color="#aa3377", label=f"Bingham, {plate}, {VISCOSITY:g} Pa s")
    axis.plot(*real.T / 10.0, "o", color="black", mfc="white", ms=4.5, label=f"measured (Yeh 2007), {len(real)}")
    axis.plot(*measured[impossible].T / 10.0, "x", color="#cc3311", label="measured, but less than the cone's volume")
    axis.set(xlabel="slump [cm]", ylabel="slump flow [cm]", xlim=(0.0, 30.0), ylim=(18.0, 80.0))
    axis.grid(alpha=0.3)
    axis.legend(frameon=False, loc="upper left", fontsize=9)
    figure.savefig(points.FIGURES / "concretes.png", dpi=110)


if __name__ == "__main__":
    words = sys.argv[1:]
    if words not in (["run"], ["draw"]):
        sys.exit(__doc__)
    run() if words == ["run"] else draw()
