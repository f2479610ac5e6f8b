"""Dam breaks of fluids whose flow curves a rheometer measured, predicted without a fit: the front against time.

The row runs them at one spacing, ``benchmarks/measured.py`` at more; both are judged by the same numbers.
"""

import numpy as np

from taichi_mps.input import catalogue

from . import Measured, columns, read_reference, record

DAMS, CURVES = "E_measured_dam_break_virheometry.csv", "E_measured_flow_curves_virheometry.csv"
FLUIDS = {  # beginning of the rheometer's sample, density [kg/m3] by the source
    "okonomi sauce 2023": ("Okonomiyaki", 1175.0),
    "chuno sauce 2023": ("Chuno", 1200.0),
    "lotion 2023": ("Lotion", 1000.0),
    "moisturizing milk 2023": ("Nyueki", 1025.0),
}
RATES = 0.9, 110.0  # shear rates [1/s] over which the rheometer's curve is fitted
EARLY = 4  # frames by which the offset of time is found
OFFSETS = np.linspace(-0.04, 0.04, 81)  # of time [s]: the gate's way over half the height takes no longer
LAST = 1.0 / 3.0  # time of the front that is judged [s]
EVERY = 0.004  # between two readings of the front [s]


def tests() -> dict[tuple[str, float, float], tuple[np.ndarray, np.ndarray]]:
    """Measured times [s] and fronts [m] of each test, by fluid, width and height of the block [m]."""
    found = {}
    for row in read_reference(DAMS):
        key = row["fluid"], *(round(0.01 * float(row[name]), 4) for name in ("W_cm", "H_cm"))
        found.setdefault(key, []).append((float(row["time_s"]), 0.01 * float(row["front_cm"])))
    return {key: tuple(np.array(points).T) for key, points in found.items()}


def flow_curve(fluid: str, low=RATES[0], high=RATES[1]) -> tuple[np.ndarray, np.ndarray]:
    """Shear rates [1/s] and stresses [Pa] of the rheometer between two rates."""
    curves = columns(CURVES)
    selected = np.char.startswith(curves["sample"], FLUIDS[fluid][0])
    selected &= (curves["shear_rate_1_s"] >= low) & (curves["shear_rate_1_s"] <= high)
    return curves["shear_rate_1_s"][selected], curves["shear_stress_pa"][selected]


def herschel_bulkley(rate, stress) -> dict[str, float]:
    """Constants of the law of Herschel and Bulkley with the least squares of relative errors of the stress."""
    best = (np.inf, None)
    for n in np.linspace(0.1, 1.0, 901):
        terms = np.stack([np.ones_like(rate), rate**n], 1) / stress[:, None]
        (tau_y, k), *_ = np.linalg.lstsq(terms, np.ones_like(rate), rcond=None)
        best = min(best, (float(np.sum((terms @ (tau_y, k) - 1.0) ** 2)), (float(tau_y), float(k), float(n))))
    return dict(zip(("yield_value", "consistency", "flow_index"), best[1], strict=True))


def keywords(fluid: str, width: float, height: float, spacing: float, low=RATES[0]) -> dict:
    """Keywords of the scene dam_break, with the rheometer's curve from a shear rate ``low`` [1/s] on."""
    law = herschel_bulkley(*flow_curve(fluid, low)) | {"density": FLUIDS[fluid][1]}
    box = {"column_width": width, "column_height": height, "depth": 0.04, "model": "half"}
    return law | box | {"spacing": spacing, "until": LAST + 1.1 * OFFSETS[-1]}


def course(**settings):
    """The Simulation of a test at its end, the times [s], and the front in front of the gate [m]."""
    return record(catalogue.build("dam_break", **settings), lambda s: s.measures()["flow_m"], EVERY)


def offset(courses: dict) -> float:
    """Offset [s] of the films' time, one for all tests, with which the computed fronts (times and values by test) are
    nearest to the measured ones of the first EARLY frames, by squares over the last measured front."""
    fronts = tests()

    def misfit(shift):
        errors = [np.interp(fronts[key][0] + shift, *course) - fronts[key][1] for key, course in courses.items()]
        return sum(np.sum((each[:EARLY] / fronts[key][1][-1]) ** 2) for key, each in zip(courses, errors, strict=True))

    return float(min(OFFSETS, key=misfit))


def named(fluid: str, width: float, height: float) -> str:
    """Name of a test."""
    return f"{fluid.removesuffix(' 2023')} {1e3 * width:.0f} x {1e3 * height:.0f} mm"


def judged(courses: dict, shift: float) -> list[Measured]:
    """Errors of the front after 1/3 s beside the measured one, with an offset [s] of the films' time: mean of all
    tests, and each beside 8 % or 2 mm."""
    last = {key: fronts[-1] for key, (_, fronts) in tests().items()}
    errors = {key: 100.0 * (float(np.interp(LAST + shift, *c)) / last[key] - 1.0) for key, c in courses.items()}
    size = float(np.mean(np.abs(list(errors.values()))))
    each = [Measured(named(*key), error, max(8.0, 0.2 / last[key]), "%") for key, error in errors.items()]
    return [Measured(f"front, mean size of {len(errors)} errors", size, 5.0, "%"), *each]


def dam_breaks(spacing: float):
    """All tests at a spacing [m]."""
    courses = {key: course(**keywords(*key, spacing))[1:] for key in tests()}
    return judged(courses, offset(courses))
