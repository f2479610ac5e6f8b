"""103 measured pairs of slump and slump flow beside Bingham cones, with slip at the plate and with internal friction.

    python benchmarks/concretes.py run    # cones that slip, by rings: results/concretes.json
    python benchmarks/concretes.py draw   # docs/concretes.md, its chart, and of each what calibrate says: results/*.csv

Cones without slip, and with internal friction: the tables of `taichi-mps calibrate`. Measured: Yeh (2007), UCI.
"""

import sys
from dataclasses import replace
from itertools import pairwise

import numpy as np
import points

import taichi_mps as mps
from taichi_mps.study import measured_mixes
from taichi_mps.study.emulator import DENSITY, FRICTION_TABLE, emulator_of
from validation import read_reference

MEASURED = "E_measured_slump_flow_yeh.csv"
YIELDS = 60.0, 100.0, 150.0, 200.0, 300.0, 400.0, 600.0, 800.0, 1200.0  # of the cones that slip [Pa]
VISCOSITY = 50.0  # of both [Pa s]
BAND = 20.0, 200.0  # of the cones that do not [Pa s]
NEAR = 10.0, 20.0  # [mm] of slump and of flow within which a cone explains a measurement
HEIGHT, VOLUME = 300.0, 5.498e6  # of the cone [mm], [mm3]
PLATES = {"no friction at the plate": 0.0, "plate of half of the yield stress": 0.5}  # over that of the mix
ANGLES = 10.0, 15.0, 20.0  # of internal friction [deg]


def run() -> None:
    """Cones that slip, to rest, 20 s at most: two minutes."""
    mps.init(threads=1)
    found = {}
    for plate, part in PLATES.items():
        rows = found[f"Bingham, {plate}"] = []
        for tau in YIELDS:
            scene = mps.slump_cone(yield_value=tau, plastic_viscosity=VISCOSITY, model="axisymmetric", floor_radius=1.0)
            held = {"friction": mps.Friction(yield_value=part * tau)} if part else {"slip": True}
            sim = mps.Simulation(replace(scene, walls=(replace(scene.walls[0], **held),), until=20.0))
            sim.run()
            measures = sim.measures()
            ends = {"slump_mm": 1e3 * measures["slump_m"], "flow_mm": 1e3 * measures["spread_m"]}
            rows.append({"yield_value": tau, **ends, "stopped_by": sim.stopped_by})
            print(plate, rows[-1], flush=True)
    points.save("concretes", found)


def calibrated() -> str:
    """Return a table of the verdicts of `taichi-mps calibrate --table`, and write each mix to results/concretes.csv."""
    columns = {"no": "no", "slump [cm]": "slump_cm", "spread [cm]": "flow_cm", "rho [kg/m3]": "density_kg_m3"}
    found = measured_mixes.calibrate_list(
        [{name: line[column] for name, column in columns.items()} for line in read_reference(MEASURED)]
    )
    file = points.RESULTS / "concretes.csv"
    measured_mixes.write(found, file)
    file.write_text(f"# {points.stamp()}\n{file.read_text(encoding='utf-8')}", encoding="utf-8")
    lines = [line.strip().split(" ", 1) for line in measured_mixes.tally(found).splitlines()]
    return f"{points.table(['mixes', 'result'], lines)}\n\n{with_friction(found)}"


def with_friction(found) -> str:
    """Return a sentence on how well the mixes that internal friction explains are determined, and at which plastic
    viscosities."""
    some = [row for row in found if row["verdict"] == measured_mixes.WITH_FRICTION]
    known = [sum(row[f"{name}_found"] is not None for name in ("yield_value", "friction_angle")) for row in some]
    angles = [row["friction_angle_found"] for row in some if row["friction_angle_found"] is not None]
    text = f"Of the {len(some)} with internal friction both constants are determined in {known.count(2)}, one in "
    text += f"{known.count(1)}, of the others limits; the angles found are {min(angles):.0f} to {max(angles):.0f} "
    usual = sum(row["plastic_viscosity_found"] == VISCOSITY for row in some)
    return text + f"degrees. {usual} are fitted at {VISCOSITY:g} Pa s, the others at 20 or 200 Pa s only."


def of_table(test: str, *others) -> np.ndarray:
    """Slump and slump flow [mm] of 200 yield stresses by a table of `taichi-mps calibrate`, at others of its constants
    over the density [Pa s m3/kg] or angles [deg]: (200, 2)."""
    emulator = emulator_of(test=test)
    cones = emulator.at(np.linspace(emulator.low[0], emulator.high[0], 200), *np.log(np.tile(others, (200, 1)).T))
    return 1e3 * np.column_stack([cones["slump_m"], cones["spread_m"]])


def curves() -> dict[str, np.ndarray]:
    """Slump and slump flow [mm] of the other cones, between the computed ones; with internal friction by its table."""
    found = {}
    for way in map("Bingham, {}".format, PLATES):
        cones = points.load("concretes")[way]
        known = np.array([(np.log(c["yield_value"]), c["slump_mm"], c["flow_mm"]) for c in cones])
        fine = np.linspace(known[0, 0], known[-1, 0], 200)
        found[way] = np.column_stack([np.interp(fine, known[:, 0], known[:, k]) for k in (1, 2)])
    for angle in ANGLES:
        found[f"internal friction of {angle:g} degrees"] = of_table(FRICTION_TABLE, angle, VISCOSITY / DENSITY)
    return found


def missed(measured, cones) -> np.ndarray:
    """Errors of slump and slump flow [mm] of the cone that fits each measured concrete best, (n, 2)."""
    away = cones.reshape(-1, 2)[None] - measured[:, None]
    return away[np.arange(len(measured)), ((away / NEAR) ** 2).sum(2).argmin(1)]


def draw() -> None:
    plt = points.pyplot()
    measured = np.array([(10.0 * float(r["slump_cm"]), 10.0 * float(r["flow_cm"])) for r in read_reference(MEASURED)])
    cones = np.array([of_table("slump", eta / DENSITY) for eta in np.geomspace(*BAND, 25)])
    others = curves()
    stands = measured[:, 0] == 0.0
    room = 0.25 * np.pi * measured[:, 1] ** 2 * (HEIGHT - measured[:, 0])  # of the cylinder around the body
    impossible = ~stands & (room < VOLUME)
    real = measured[~stands & ~impossible]
    rubbing = [curve for way, curve in others.items() if way.startswith("internal")]
    between = [(1 - t) * a + t * b for a, b in pairwise(rubbing) for t in np.linspace(0.0, 1.0, 11)]
    known = {"Bingham, no slip, 20 to 200 Pa s": cones} | others
    known[f"internal friction of {ANGLES[0]:g} to {ANGLES[-1]:g} degrees"] = np.concatenate(between)
    lines, head = [], ["the cone", "explains", "slump missed by, median [mm]", "flow missed by, median [mm]"]
    for name, way in (known | {"any of these": np.concatenate([w.reshape(-1, 2) for w in known.values()])}).items():
        error = missed(real, way)
        near = np.all(np.abs(error) <= NEAR, axis=1)
        typical = np.median(error, axis=0)
        lines.append([name, f"{near.sum()} of {len(real)}", f"{typical[0]:+.0f}", f"{typical[1]:+.0f}"])
    left_out = f"Left out: {stands.sum()} without slump, {impossible.sum()} that hold less than the cone's volume."
    says = "What `taichi-mps calibrate --table` says of all 103, without slip:"
    text = "\n\n".join([points.table(head, lines), left_out, says, calibrated()])
    points.put("concretes.md", "concretes", text, [points.load("concretes")])

    figure, axis = plt.subplots(figsize=(7.6, 5.4), layout="constrained")
    low, high = cones[0], cones[-1]
    axis.fill(*np.vstack([low, high[::-1]]).T / 10.0, color="#4477aa", alpha=0.3, lw=0, label=next(iter(known)))
    for (way, curve), style in zip(others.items(), ("-", "--", "-", "--", ":"), strict=False):
        colour = "#aa3377" if "plate" in way else "#228833"
        axis.plot(*curve.T / 10.0, style, color=colour, label=f"{way}, {VISCOSITY:g} Pa s")
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
