"""Constants found from curves whose fluid is known, fronts of dam breaks and finite elements, and from a filmed slump.

    python benchmarks/inverse.py run [NAME ...]   # every case without a result: results/inverse.json
    python benchmarks/inverse.py draw             # docs/measured.md

Measured: see the heads of the files in taichi_mps/validation/reference and tests/reference.
"""

import csv
import sys
import tempfile
from pathlib import Path

import numpy as np
import points

from taichi_mps.validation import measured, read_reference

SLUMPS = points.ROOT / "tests" / "reference" / "fe_inertial_slump_history.csv"
ELEMENTS = {"finite elements, 300 Pa": 300.0, "finite elements, 500 Pa": 500.0}  # yield stress [Pa], at 50 Pa s
FILM = "filmed slump flow"
ENDS = 2.2, 22.3  # of the film [s]: from the foot of the cone on, until something comes into the view
RATES = np.geomspace(1.0, 100.0, 41)  # over which flow curves are compared [1/s]
SOURCE = {  # distance of the source's own estimates from the rheometer, mean |log ratio| of the stress
    "okonomi sauce 2023": 0.20,
    "chuno sauce 2023": 0.056,
    "lotion 2023": 0.21,
    "moisturizing milk 2023": 0.42,
}


def cases() -> dict[str, dict]:
    """Settings of ``point`` by name. Where the search begins is the same for all fluids, and not theirs."""
    cone = {"scene": "slump", "model": "axisymmetric", "spacing": 0.01}
    found = {name: cone | {"yield_value": 100.0, "plastic_viscosity": 20.0} for name in ELEMENTS}
    found[FILM] = cone | {
        "yield_value": 50.0,
        "plastic_viscosity": 50.0,
        "free": "yield_value,plastic_viscosity,time_offset",
    }
    dam = {"scene": "dam_break", "model": "half", "depth": 0.04, "spacing": 0.0025}
    law = {"yield_value": 5.0, "consistency": 5.0, "flow_index": 0.6}
    for fluid, (_, density) in measured.FLUIDS.items():
        found[fluid] = dam | law | {"density": density, "free": "yield_value,consistency,flow_index,time_offset"}
    return {name: {"name": name} | settings for name, settings in found.items()}


def curve(name: str) -> list[list]:
    """Head and rows of the curve of a case, as a user has them."""
    if name in ELEMENTS:
        lines = csv.DictReader(line for line in SLUMPS.read_text(encoding="utf-8").splitlines() if line[0] != "#")
        want = {"model": "A", "tau_Pa": f"{ELEMENTS[name]:g}", "eta_Pa_s": "50"}
        rows = [row for row in lines if want.items() <= row.items()]
        times = np.array([float(row["t_s"]) for row in rows])
        at = np.linspace(0.05, min(1.5, times[-1]), 30)
        shown = [
            np.interp(at, times, [float(row[key]) for row in rows]) for key in ("slump_mean_r20_mm", "spread_diam_mm")
        ]
        return [["time [s]", "slump [mm]", "slump flow [mm]"], *np.stack([at, *shown], 1).tolist()]
    if name == FILM:
        rows = read_reference("E_measured_slump_flow_curve_mojiri.csv")
        film = [[float(row["video_time_s"]), float(row["diameter_ew_mm"])] for row in rows]
        return [["time [s]", "diameter [mm]"], *[row for row in film if ENDS[0] <= row[0] <= ENDS[1]][::5]]
    tests = {key: known for key, known in measured.tests().items() if key[0] == name}
    rows = [[*key[1:], t, front] for key, known in tests.items() for t, front in zip(*known, strict=True)]
    return [["column_width [m]", "column_height [m]", "time [s]", "flow [m]"], *rows]


def point(name: str, scene: str, free: str = "yield_value,plastic_viscosity", **settings) -> dict:
    """Fit of a case: what calibrate writes."""
    from taichi_mps.io.run_folder import strict
    from taichi_mps.study.calibrate_curves import calibrate_curves

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "curve.csv"
        with open(file, "w", newline="", encoding="utf-8") as text:
            csv.writer(text).writerows(curve(name))

        def told(line):
            print(line, file=sys.stderr, flush=True)

        out = points.ROOT / "studies" / f"inverse {name}"
        return strict(calibrate_curves(scene, str(file), free, out, workers=1, watch=told, **settings).facts())


def off(fit: dict, fluid: str) -> tuple[float, bool]:
    """Mean |log ratio| of the fitted stress to the rheometer's over 1 to 100 1/s, and whether the rheometer's curve
    lies in the band of 95 % all over it."""
    rate, stress = measured.flow_curve(fluid, RATES[0], 1.01 * RATES[-1])
    flow = fit["flow_curve"]
    ours, by = (
        np.interp(np.log(rate), np.log(flow["shear_rate_1_s"]), np.log(flow[key]))
        for key in ("shear_stress_Pa", "factor")
    )
    apart = np.abs(ours - np.log(stress))
    return float(np.mean(apart)), bool(np.all(apart <= by))


def interval(fit: dict, name: str) -> str:
    it = fit["constants"][name]
    low, high = (f"{it[end]:.3g}" if it[end] else "-" for end in ("lower", "upper"))
    return f"{it['value']:.3g} ({low} to {high})"


def draw() -> None:
    results, lines, text, verdicts = points.read("inverse"), [], [], []
    for name, tau in ELEMENTS.items():
        if name in results:
            fit = results[name]
            apart = [
                100.0 * (fit["constants"][key]["value"] / true - 1.0)
                for key, true in (("yield_value", tau), ("plastic_viscosity", 50.0))
            ]
            held = all(
                fit["constants"][key]["lower"] <= true <= fit["constants"][key]["upper"]
                for key, true in (("yield_value", tau), ("plastic_viscosity", 50.0))
            )
            met = "met" if abs(apart[0]) <= 3.0 and abs(apart[1]) <= 10.0 and held else "**missed**"
            lines.append(
                [
                    name,
                    interval(fit, "yield_value"),
                    f"{apart[0]:+.1f}",
                    interval(fit, "plastic_viscosity"),
                    f"{apart[1]:+.1f}",
                    "yes" if held else "no",
                    met,
                    f"{fit['cpu_seconds']:.0f}",
                ]
            )
    head = [
        "curve",
        "yield stress [Pa]",
        "off [%]",
        "plastic viscosity [Pa s]",
        "off [%]",
        "held",
        "3 %, 10 %, held",
        "CPU-s",
    ]
    text += [points.table(head, lines)] * bool(lines)
    lines = []
    for fluid, source in SOURCE.items():
        if fluid in results:
            fit, (apart, held) = results[fluid], off(results[fluid], fluid)
            verdicts.append((apart, source, held))
            constants = [interval(fit, key) for key in ("yield_value", "consistency", "flow_index")]
            lines.append(
                [
                    fluid.removesuffix(" 2023"),
                    *constants,
                    f"{100.0 * apart:.0f}",
                    f"{100.0 * source:.0f}",
                    "yes" if held else "no",
                    f"{fit['cpu_seconds']:.0f}",
                ]
            )
    head = [
        "fluid",
        "yield stress [Pa]",
        "consistency [Pa s^n]",
        "flow index",
        "off [%]",
        "source's [%]",
        "rheometer in the band",
        "CPU-s",
    ]
    text += [points.table(head, lines)] * bool(lines)
    if verdicts:
        apart, source, held = np.transpose(verdicts)
        text.append(
            f"Off by {100.0 * apart.mean():.0f} % in the mean, the source's by {100.0 * source.mean():.0f}; "
            f"{np.sum(apart <= source)} of {len(verdicts)} no farther off than its own, asked: all; "
            f"{np.sum(held):.0f} of {len(verdicts)} bands of 95 % hold the rheometer's curve, asked: three."
        )
    if FILM in results:
        told = results[FILM]["told"].splitlines()
        text.append(f"The filmed slump flow: {'; '.join(' '.join(line.split()) for line in told[:3])}. {told[-2]}")
    points.put("measured.md", "inverse", "\n\n".join(text), list(results.values()))


if __name__ == "__main__":
    points.main(__file__, "inverse", cases, point, draw, __doc__)
