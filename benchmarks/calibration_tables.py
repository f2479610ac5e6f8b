"""The studies of other tests that `taichi-mps calibrate` looks into; slump_study.py has that of Bingham cones.

    python benchmarks/calibration_tables.py mini_cone [WORKERS]   # one process by default
    python benchmarks/calibration_tables.py v_funnel [WORKERS]
    python benchmarks/calibration_tables.py internal_friction [WORKERS]   # half an hour

Each writes taichi_mps/study/<name>.csv, from studies/<name>_table, where what is there is not run again. Some mixes
are computed at a finer spacing, too: what it changes is the error of the table. mini_cone: rings of 2 mm and 1 mm to
rest or 1000 s. v_funnel: a quarter at 12.5 mm and 10 mm, until it is empty. internal_friction: quarters of the standard
cone at 10 mm, to rest or 120 s.
"""

import csv
import sys
from pathlib import Path

from taichi_mps.study.sweep import sweep

ROOT = Path(__file__).resolve().parents[1]
SCENES = {"mini_cone": "mini_cone", "v_funnel": "v_funnel", "internal_friction": "slump"}
SHARED = {
    "internal_friction": {"density": "2300", "until": "120", "floor_radius": "1", "model": "quarter"},
    "mini_cone": {"density": "1900", "model": "axisymmetric", "until": "1000"},
    "v_funnel": {"density": "2300", "model": "quarter"},
}
YIELDS = {  # [Pa]
    "mini_cone": "8,14,25,45,80,140,250",
    "v_funnel": "10,30,60,120",
    "internal_friction": "2,5,10,15,20,30,60,120,250,500",
}
VISCOSITIES = {"mini_cone": "0.5,1,2,4,10,50,250", "v_funnel": "5,10,25,60,150", "internal_friction": "20,50,200"}
ANGLES = "5", "8", "12", "16", "20", "25", "30"  # of internal friction [deg]; compiled in, so a study each
CHECKS = (  # [Pa], [deg], [Pa s], [m]; not for the table but for its error
    ("30", "12", "35", "0.01"),
    ("120", "16", "20", "0.01"),
    ("60", "12", "120", "0.01"),
    ("20.8", "14.6", "50", "0.01"),
    ("3.2", "18", "50", "0.01"),
    ("7", "24", "50", "0.01"),
    ("8", "18", "30", "0.01"),
    ("5", "16", "100", "0.01"),
    ("15", "15", "50", "0.006"),
    ("5", "20", "20", "0.006"),
    ("60", "10", "50", "0.006"),
)
SPACINGS = {"mini_cone": ("0.002", "0.001"), "v_funnel": ("0.0125", "0.01")}  # of all mixes and of the finer ones [m]
FINER = {  # yield stress [Pa], plastic viscosity [Pa s]
    "mini_cone": (("8", "2"), ("25", "1"), ("25", "10"), ("80", "4")),
    "v_funnel": (("40", "20"),),
}
HEADS = {
    "mini_cone": "Kantro's mini-cone (57.2 mm), true Bingham, mould gone at once; spread [m] at rest or 1000 s",
    "v_funnel": "V-funnel (EN 12350-9), true Bingham, rough sides, flap gone at once; flow time [s]",
    "internal_friction": "Standard cone (JIS A 1101), Bingham with internal friction, mould gone at once; slump over "
    "r < 20 mm and spread [m] at rest or after 120 s, time [s] to 500 mm. Rows of the role check tell the error",
}
COLUMNS = {
    "mini_cone": ["spread_m"],
    "v_funnel": ["flow_time_s"],
    "internal_friction": ["slump_m", "spread_m", "t500_s"],
}
KEPT = ["status", "scene", "model", "spacing", "until", "density", "yield_value", "plastic_viscosity"]


def rubbing() -> list[dict[str, str]]:
    """The parameters of the sweeps of cones with internal friction, and some of other mixes and of a finer spacing,
    which tell the error."""
    shared, names = SHARED["internal_friction"], ("yield_value", "friction_angle", "plastic_viscosity", "spacing")
    nodes = [(YIELDS["internal_friction"], angle, VISCOSITIES["internal_friction"], "0.01") for angle in ANGLES]
    return [shared | dict(zip(names, mixes, strict=True)) for mixes in (*nodes, *CHECKS)]


def studies(name: str) -> list[dict[str, str]]:
    """The parameters of the sweeps that make a table."""
    return rubbing() if name == "internal_friction" else of_a_test(name)


def of_a_test(scene: str) -> list[dict[str, str]]:
    """The same of mini-cone or V-funnel."""
    coarse, fine = SPACINGS[scene]
    etas = [VISCOSITIES[scene]] if scene == "mini_cone" else VISCOSITIES[scene].split(",")
    wanted = [(YIELDS[scene], eta, coarse) for eta in etas] + [(tau, eta, fine) for tau, eta in FINER[scene]]
    made = [SHARED[scene] | dict(yield_value=tau, plastic_viscosity=eta, spacing=size) for tau, eta, size in wanted]
    for mixes in made if scene == "v_funnel" else ():
        thick = float(mixes["plastic_viscosity"])
        mixes["until"] = f"{2.0 + (0.2 if mixes['spacing'] == fine else 0.4) * thick:g}"
    return made


def main(name: str, workers="1") -> None:
    rows = []
    planned = studies(name)
    for number, mixes in enumerate(planned):
        found = sweep(SCENES[name], f"studies/{name}_table/{number}", workers=int(workers), watch=told, **mixes)
        rows += [row | {"role": "check" if number >= len(planned) - len(CHECKS) else "node"} for row in found]
    failed = [row for row in rows if row["status"] != "done"]
    if failed:
        sys.exit(
            "\n".join(f"{row['yield_value']} Pa, {row['plastic_viscosity']} Pa s: {row['reason']}" for row in failed)
        )
    columns = COLUMNS[name]
    kept = KEPT + ["floor_radius", "friction_angle", "role"] * (name == "internal_friction")
    with open(ROOT / f"taichi_mps/study/{name}.csv", "w", newline="", encoding="utf-8") as file:
        file.write(
            f"# {HEADS[name]}.\n# By version {rows[0]['version']} and benchmarks/calibration_tables.py {name}.\n"
        )
        lines = csv.DictWriter(file, [*kept, *columns, "stopped_by"], extrasaction="ignore", lineterminator="\n")
        lines.writeheader()
        for row in rows:
            lines.writerow(row | {column: f"{row[column]:.5g}" if row[column] else None for column in columns})
    seconds = sum(row["cpu_seconds"] + row["compile_seconds"] for row in rows)
    print(f"{len(rows)} cases, {seconds:.0f} CPU-seconds")


def told(rows, total) -> None:
    """The last case that came."""
    if rows:
        print(
            len(rows),
            "of",
            total,
            {name: rows[-1].get(name) for name in (*KEPT, "friction_angle", "flow_time_s", "slump_m", "spread_m")},
            flush=True,
        )


if __name__ == "__main__":
    main(*sys.argv[1:])
