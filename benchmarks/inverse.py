"""Constants found from curves whose fluid is known, fronts of dam breaks and finite elements, and from a filmed slump.

    python benchmarks/inverse.py run [NAME ...]   # every case without a result: results/inverse.json
    python benchmarks/inverse.py draw             # docs/measured.md

Measured: see the heads of the files in validation/reference and tests/reference.
"""

import csv
import sys
import tempfile
from functools import partial
from pathlib import Path

import numpy as np
import points

from taichi_mps.io.run_folder import strict
from taichi_mps.study.calibrate_curves import calibrate_curves
from validation import columns, measured

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
HEAD = (
    "curve",
    "yield stress [Pa]",
    "off [%]",
    "plastic viscosity [Pa s]",
    "off [%]",
    "held",
    "3 %, 10 %, held",
    "CPU-s",
)
FLUIDS_HEAD = ["fluid", "yield stress [Pa]", "consistency [Pa s^n]", "flow index", "off [%]", "source's [%]"]
FLUIDS_HEAD += ["rheometer in the band", "CPU-s"]


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
        known = columns(str(SLUMPS), model="A", tau_Pa=ELEMENTS[name], eta_Pa_s=50.0)
        at = np.linspace(0.05, min(1.5, known["t_s"][-1]), 30)
        shown = [np.interp(at, known["t_s"], known[key]) for key in ("slump_mean_r20_mm", "spread_diam_mm")]
        return [["time [s]", "slump [mm]", "slump flow [mm]"], *np.stack([at, *shown], 1).tolist()]
    if name == FILM:
        known = columns("E_measured_slump_flow_curve_mojiri.csv")
        film = np.stack([known["video_time_s"], known["diameter_ew_mm"]], 1).tolist()
        return [["time [s]", "diameter [mm]"], *[row for row in film if ENDS[0] <= row[0] <= ENDS[1]][::5]]
    tests = {key: known for key, known in measured.tests().items() if key[0] == name}
    rows = [[*key[1:], t, front] for key, known in tests.items() for t, front in zip(*known, strict=True)]
    return [["column_width [m]", "column_height [m]", "time [s]", "flow [m]"], *rows]


def point(name: str, scene: str, free: str = "yield_value,plastic_viscosity", **settings) -> dict:
    """Fit of a case: what calibrate writes."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "curve.csv"
        with open(file, "w", newline="", encoding="utf-8") as text:
            csv.writer(text).writerows(curve(name))

        told = partial(print, file=sys.stderr, flush=True)
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
    results, elements, fluids, verdicts = points.read("inverse"), [], [], []
    for name, tau in ELEMENTS.items():
        fit, known = results[name], {"yield_value": tau, "plastic_viscosity": 50.0}
        found = {key: fit["constants"][key] for key in known}
        apart = [100.0 * (found[key]["value"] / true - 1.0) for key, true in known.items()]
        held = all(found[key]["lower"] <= true <= found[key]["upper"] for key, true in known.items())
        met = "met" if abs(apart[0]) <= 3.0 and abs(apart[1]) <= 10.0 and held else "**missed**"
        cells = [cell for key, off in zip(known, apart, strict=True) for cell in (interval(fit, key), f"{off:+.1f}")]
        elements.append([name, *cells, "yes" if held else "no", met, f"{fit['cpu_seconds']:.0f}"])
    for fluid, source in SOURCE.items():
        fit, (apart, held) = results[fluid], off(results[fluid], fluid)
        verdicts.append((apart, source, held))
        cells = [interval(fit, key) for key in ("yield_value", "consistency", "flow_index")]
        cells += [f"{100.0 * apart:.0f}", f"{100.0 * source:.0f}", "yes" if held else "no"]
        fluids.append([fluid.removesuffix(" 2023"), *cells, f"{fit['cpu_seconds']:.0f}"])
    apart, source, held = np.transpose(verdicts)
    told = results[FILM]["told"].splitlines()
    text = [
        points.table(HEAD, elements),
        points.table(FLUIDS_HEAD, fluids),
        f"Off by {100.0 * apart.mean():.0f} % in the mean, the source's by {100.0 * source.mean():.0f}; "
        f"{np.sum(apart <= source)} of {len(verdicts)} no farther off than its own, asked: all; "
        f"{np.sum(held):.0f} of {len(verdicts)} bands of 95 % hold the rheometer's curve, asked: three.",
        f"The filmed slump flow: {'; '.join(' '.join(line.split()) for line in told[:3])}. {told[-2]}",
    ]
    points.put("measured.md", "inverse", "\n\n".join(text), list(results.values()))


if __name__ == "__main__":
    points.main(__file__, "inverse", cases, point, draw, __doc__)
