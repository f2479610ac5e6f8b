"""The studies of tests that `taichi-mps calibrate` looks into, and how well it finds known constants by them.

    python benchmarks/calibration_tables.py slump [WORKERS]      # one process by default; half an hour
    python benchmarks/calibration_tables.py mini_cone [WORKERS]
    python benchmarks/calibration_tables.py v_funnel [WORKERS]
    python benchmarks/calibration_tables.py internal_friction [WORKERS]   # half an hour
    python benchmarks/calibration_tables.py shares               # a line for each mix, some seconds

Each of the first four writes taichi_mps/study/<name>.csv, from studies/<name>_table, where what is there is not run
again. Some mixes are computed at a finer spacing, too: what it changes is the error of the table. slump: rings of
10 mm, below 30 Pa of 5 mm, to rest or 120 s, checked at half of that and between the nodes; its chart is drawn by
`taichi-mps chart`. mini_cone: rings of 2 mm and 1 mm to rest or 1000 s. v_funnel: a quarter at 12.5 mm and 10 mm, until
it is empty. internal_friction: quarters of the standard cone at 10 mm, to rest or 120 s. shares: how often the
intervals hold the constants of finite elements, whose measurements are drawn 200 times with the errors that calibrate
takes by default.
"""

import csv
import sys

import numpy as np
import points

from taichi_mps.study.emulator import DENSITY, RESULT_COLUMNS, emulator_of
from taichi_mps.study.fit import fit
from taichi_mps.study.sweep import sweep

MIX = "yield_value", "plastic_viscosity"  # [Pa], [Pa s]
# by table: scene and what all cases share; names of what they do not, nodes, and checks, which only tell the error
TABLES = {
    "slump": (
        {"scene": "slump", "model": "axisymmetric", "until": "120", "density": "2300"},
        (*MIX, "spacing"),
        [
            ("2,4,7,20", "5,10,20,50,100,200,1000", "0.005"),
            (
                "30,40.49,47,54.66,64,73.78,99.6,134.4,181.5,244.9,330.6,446.3,602.4,813.2,1098,1482",
                "5,10,15,20,30,50,100,200,500,1000",
                "0.01",
            ),
        ],
        [
            *((tau, eta, "0.005") for tau, eta in (("5", "30"), ("9", "80"), ("12", "60"), ("15", "35"), ("26", "70"))),
            ("40.49,99.6,244.9,602.4,1098", "50", "0.005"),
            ("54.66", "30", "0.005"),
            ("134.4", "20", "0.005"),
            ("7,20", "50", "0.0025"),
            ("3", "30", "0.0025"),
            ("10", "15", "0.0025"),
        ],
    ),
    "mini_cone": (
        {"scene": "mini_cone", "density": "1900", "model": "axisymmetric", "until": "1000"},
        (*MIX, "spacing"),
        [("8,14,25,45,80,140,250", "0.5,1,2,4,10,50,250", "0.002")],
        [("8", "2", "0.001"), ("25", "1,10", "0.001"), ("80", "4", "0.001")],
    ),
    "v_funnel": (
        {"scene": "v_funnel", "density": "2300", "model": "quarter"},
        (*MIX, "until", "spacing"),
        [
            ("10,30,60,120", eta, until, "0.0125")
            for eta, until in (("5", "4"), ("10", "6"), ("25", "12"), ("60", "26"), ("150", "62"))
        ],
        [("40", "20", "6", "0.01")],
    ),
    "internal_friction": (
        {"scene": "slump", "density": "2300", "until": "120", "floor_radius": "1", "model": "quarter"},
        (*MIX, "friction_angle", "spacing"),  # an angle [deg] is compiled in, so a study each
        [
            ("2,5,10,15,20,30,60,120,250,500", "20,50,200", angle, "0.01")
            for angle in ("5", "8", "12", "16", "20", "25", "30")
        ],
        [
            ("30", "35", "12", "0.01"),
            ("120", "20", "16", "0.01"),
            ("60", "120", "12", "0.01"),
            ("20.8", "50", "14.6", "0.01"),
            ("3.2", "50", "18", "0.01"),
            ("7", "50", "24", "0.01"),
            ("8", "30", "18", "0.01"),
            ("5", "100", "16", "0.01"),
            ("15", "50", "15", "0.006"),
            ("5", "20", "20", "0.006"),
            ("60", "50", "10", "0.006"),
        ],
    ),
}
HEADS = {
    "slump": "Standard cone (JIS A 1101, 300 mm), true Bingham, mould gone at once; slump over r < 20 mm and spread "
    "[m] at rest or after 120 s, time [s] to 500 mm",
    "mini_cone": "Kantro's mini-cone (57.2 mm), true Bingham, mould gone at once; spread [m] at rest or 1000 s",
    "v_funnel": "V-funnel (EN 12350-9), true Bingham, rough sides, flap gone at once; flow time [s]",
    "internal_friction": "Standard cone (JIS A 1101), Bingham with internal friction, mould gone at once; slump over "
    "r < 20 mm and spread [m] at rest or after 120 s, time [s] to 500 mm. Rows of the role check tell the error",
}
KEPT = ["status", "role", "scene", "model", "spacing", "until", "density", "floor_radius", "friction_angle", *MIX]
ERRORS = {"slump_m": 0.005, "spread_m": 0.01, "t500_s": 0.2}
KNOWN = (  # yield stress [Pa], plastic viscosity [Pa s], measurements [m, s] of finite elements
    (300.0, 50.0, {"slump_m": 0.2173, "spread_m": 0.3511}),
    (500.0, 50.0, {"slump_m": 0.1799, "spread_m": 0.3193}),
    (1000.0, 50.0, {"slump_m": 0.1015, "spread_m": 0.2656}),
    (50.0, 50.0, {"spread_m": 0.5466, "t500_s": 3.54}),
    (50.0, 100.0, {"slump_m": 0.261, "spread_m": 0.5466, "t500_s": 7.08}),
)
DRAWS = 200


def write(name: str, workers="1") -> None:
    """Compute and write a table."""
    shared, names, nodes, checks = TABLES[name]
    columns = list(RESULT_COLUMNS[shared["scene"]].values())
    rows = []
    for number, (role, mixes) in enumerate([*(("node", mix) for mix in nodes), *(("check", mix) for mix in checks)]):
        settings = shared | dict(zip(names, mixes, strict=True))
        found = sweep(out=f"studies/{name}_table/{number}", workers=int(workers), watch=told, **settings)
        rows += [row | {"role": role} for row in found]
    failed = [f"{row['yield_value']} Pa, {row['plastic_viscosity']} Pa s: {row['reason']}" for row in rows
              if row["status"] != "done"]  # fmt: skip
    if failed:
        sys.exit("\n".join(failed))
    with open(points.ROOT / f"taichi_mps/study/{name}.csv", "w", newline="", encoding="utf-8") as file:
        made_by = f"By version {rows[0]['version']} and benchmarks/calibration_tables.py {name}"
        file.write(f"# {HEADS[name]}.\n# {made_by}; {points.stamp()}.\n")
        kept = [column for column in KEPT if column in rows[0]]
        lines = csv.DictWriter(file, [*kept, *columns, "stopped_by"], extrasaction="ignore", lineterminator="\n")
        lines.writeheader()
        for row in rows:
            lines.writerow(row | {column: f"{row[column]:.5g}" if row[column] else None for column in columns})


def told(rows, total) -> None:
    """Print the number of finished cases and the last one."""
    print(len(rows), "of", total, rows[-1:], flush=True)


def shares() -> None:
    """Print how well known constants are found, and how often their intervals hold them."""
    tables = [emulator_of()]
    for tau_y, eta, measured in KNOWN:
        found = fit(tables, {name: (value, ERRORS[name]) for name, value in measured.items()}, DENSITY)
        random, held = np.random.default_rng(0), []
        for _ in range(DRAWS):
            drawn = {name: (v + ERRORS[name] * random.standard_normal(), ERRORS[name]) for name, v in measured.items()}
            answer = fit(tables, drawn, DENSITY)
            pairs = (answer.yield_value, tau_y), (answer.plastic_viscosity, eta)
            held.append([(constant.lower or 0.0) <= true <= (constant.upper or np.inf) for constant, true in pairs])
        told = ", ".join(constant.describe() for constant in found.constants.values())
        print(f"{tau_y:g} Pa, {eta:g} Pa s: {told}; held {' and '.join(f'{s:.1%}' for s in np.mean(held, axis=0))}")


if __name__ == "__main__":
    shares() if sys.argv[1:] == ["shares"] else write(*sys.argv[1:])
