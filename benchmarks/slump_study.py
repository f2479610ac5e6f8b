"""The study of the standard cone that `taichi-mps calibrate` and `taichi-mps chart` look into, and its chart.

    python benchmarks/slump_study.py [FOLDER]    # studies/standard_cone by default; what it holds is not run again

16 yield values by 9 plastic viscosities, axisymmetric, 10 mm, read at rest or after 120 s: about 5 CPU-minutes.
Writes taichi_mps/study/slump.csv and docs/figures/slump_chart.png.
"""

import csv
import sys
from pathlib import Path

from taichi_mps.study.sweep import sweep

ROOT = Path(__file__).resolve().parents[1]
TABLE, CHART = ROOT / "taichi_mps/study/slump.csv", ROOT / "docs/figures/slump_chart.png"
YIELD_VALUES = "30,40.49,47,54.66,64,73.78,99.6,134.4,181.5,244.9,330.6,446.3,602.4,813.2,1098,1482"
PLASTIC_VISCOSITIES = "10,15,20,30,50,100,200,500,1000"
SETTINGS = {"model": "axisymmetric", "spacing": 0.01, "until": 120.0}
KEPT = ["status", *SETTINGS, "yield_value", "plastic_viscosity", "slump_m", "spread_m", "t500_s", "stopped_by"]
HEAD = """\
# The standard cone (JIS A 1101, 300 mm), true Bingham material of 2300 kg/m3, mould gone at once; by version {version}.
# Yield value [Pa], plastic viscosity [Pa s]; slump over r < 20 mm and spread [m] at rest or after 120 s, time [s] to a
# spread of 500 mm. Made by benchmarks/slump_study.py.
"""


def main(folder="studies/standard_cone"):
    mixes = {"yield_value": YIELD_VALUES, "plastic_viscosity": PLASTIC_VISCOSITIES}
    rows = sweep(
        "slump", folder, **mixes, **SETTINGS, watch=lambda rows, total: print(len(rows), "of", total, flush=True)
    )
    missing = [row for row in rows if row["status"] != "done"]
    if missing:
        sys.exit(
            "\n".join(f"{row['yield_value']} Pa, {row['plastic_viscosity']} Pa s: {row['reason']}" for row in missing)
        )
    with open(TABLE, "w", newline="", encoding="utf-8") as file:
        file.write(HEAD.format(version=rows[0]["version"]))
        lines = csv.DictWriter(file, KEPT, extrasaction="ignore", lineterminator="\n")
        lines.writeheader()
        for row in rows:
            known = [name for name in ("slump_m", "spread_m", "t500_s") if row.get(name) is not None]
            lines.writerow(row | {name: f"{row[name]:.5g}" for name in known})
    from taichi_mps.study.chart import slump_chart

    print(TABLE, slump_chart(CHART))


if __name__ == "__main__":
    main(*sys.argv[1:])
