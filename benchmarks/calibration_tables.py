"""The studies of mini-cone and V-funnel that `taichi-mps calibrate` looks into; slump_study.py has the slump's.

    python benchmarks/calibration_tables.py mini_cone [WORKERS]   # one process by default
    python benchmarks/calibration_tables.py v_funnel [WORKERS]

Each writes taichi_mps/study/<scene>.csv, from studies/<scene>_table, where what is there is not run again. Some mixes
are computed at a finer spacing, too: what it changes is the error of the table. mini_cone: rings of 2 mm and 1 mm to
rest or 1000 s. v_funnel: a quarter at 12.5 mm and 10 mm, until it is empty.
"""

import csv
import sys
from pathlib import Path

from taichi_mps.study.sweep import sweep

ROOT = Path(__file__).resolve().parents[1]
SHARED = {
    "mini_cone": {"density": "1900", "model": "axisymmetric", "until": "1000"},
    "v_funnel": {"density": "2300", "model": "quarter"},
}
YIELDS = {"mini_cone": "8,14,25,45,80,140,250", "v_funnel": "10,30,60,120"}  # [Pa]
VISCOSITIES = {"mini_cone": "0.5,1,2,4,10,50,250", "v_funnel": "5,10,25,60,150"}  # [Pa s]
SPACINGS = {"mini_cone": ("0.002", "0.001"), "v_funnel": ("0.0125", "0.01")}  # of all mixes and of the finer ones [m]
FINER = {  # yield stress [Pa], plastic viscosity [Pa s]
    "mini_cone": (("8", "2"), ("25", "1"), ("25", "10"), ("80", "4")),
    "v_funnel": (("40", "20"),),
}
HEADS = {
    "mini_cone": "Kantro's mini-cone (57.2 mm), true Bingham, mould gone at once; spread [m] at rest or 1000 s",
    "v_funnel": "V-funnel (EN 12350-9), true Bingham, rough sides, flap gone at once; flow time [s]",
}
COLUMNS = {"mini_cone": "spread_m", "v_funnel": "flow_time_s"}
KEPT = ["status", "scene", "model", "spacing", "until", "density", "yield_value", "plastic_viscosity"]


def studies(scene: str) -> list[dict[str, str]]:
    """The parameters of the sweeps that make the table of a test."""
    coarse, fine = SPACINGS[scene]
    etas = [VISCOSITIES[scene]] if scene == "mini_cone" else VISCOSITIES[scene].split(",")
    wanted = [(YIELDS[scene], eta, coarse) for eta in etas] + [(tau, eta, fine) for tau, eta in FINER[scene]]
    made = [SHARED[scene] | dict(yield_value=tau, plastic_viscosity=eta, spacing=size) for tau, eta, size in wanted]
    for mixes in made if scene == "v_funnel" else ():
        thick = float(mixes["plastic_viscosity"])
        mixes["until"] = f"{2.0 + (0.2 if mixes['spacing'] == fine else 0.4) * thick:g}"
    return made


def main(scene: str, workers="1") -> None:
    rows = []
    for number, mixes in enumerate(studies(scene)):
        rows += sweep(scene, f"studies/{scene}_table/{number}", workers=int(workers), watch=told, **mixes)
    failed = [row for row in rows if row["status"] != "done"]
    if failed:
        sys.exit(
            "\n".join(f"{row['yield_value']} Pa, {row['plastic_viscosity']} Pa s: {row['reason']}" for row in failed)
        )
    column = COLUMNS[scene]
    with open(ROOT / f"taichi_mps/study/{scene}.csv", "w", newline="", encoding="utf-8") as file:
        file.write(f"# {HEADS[scene]}.\n# By version {rows[0]['version']} and benchmarks/calibration_tables.py.\n")
        lines = csv.DictWriter(file, [*KEPT, column, "stopped_by"], extrasaction="ignore", lineterminator="\n")
        lines.writeheader()
        lines.writerows(row | {column: f"{row[column]:.5g}" if row[column] else None} for row in rows)
    seconds = sum(row["cpu_seconds"] + row["compile_seconds"] for row in rows)
    print(f"{len(rows)} cases, {seconds:.0f} CPU-seconds")


def told(rows, total) -> None:
    """The last case that came."""
    if rows:
        print(
            len(rows),
            "of",
            total,
            {name: rows[-1].get(name) for name in (*KEPT, "flow_time_s", "spread_m")},
            flush=True,
        )


if __name__ == "__main__":
    main(*sys.argv[1:])
