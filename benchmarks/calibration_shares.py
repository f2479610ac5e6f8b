"""How well `taichi-mps calibrate` finds known constants, and how often its intervals hold them.

    python benchmarks/calibration_shares.py    # a line for each mix, some seconds

The measurements are those of finite elements, with the errors that calibrate takes by default, drawn 200 times.
"""

import numpy as np

from taichi_mps.study.calibrate import emulator_of
from taichi_mps.study.emulator import DENSITY, Together
from taichi_mps.study.fit import fit

ERRORS = {"slump_m": 0.005, "spread_m": 0.01, "t500_s": 0.2}
MIXES = (  # yield stress [Pa], plastic viscosity [Pa s], measurements [m, s]
    (300.0, 50.0, {"slump_m": 0.2173, "spread_m": 0.3511}),
    (500.0, 50.0, {"slump_m": 0.1799, "spread_m": 0.3193}),
    (1000.0, 50.0, {"slump_m": 0.1015, "spread_m": 0.2656}),
    (50.0, 50.0, {"spread_m": 0.5466, "t500_s": 3.54}),
    (50.0, 100.0, {"slump_m": 0.261, "spread_m": 0.5466, "t500_s": 7.08}),
)
DRAWS = 200

if __name__ == "__main__":
    tables = Together([emulator_of()])
    for tau_y, eta, measured in MIXES:
        found = fit(tables, {name: (value, ERRORS[name]) for name, value in measured.items()}, DENSITY)
        random, held = np.random.default_rng(0), []
        for _ in range(DRAWS):
            drawn = {name: (v + ERRORS[name] * random.standard_normal(), ERRORS[name]) for name, v in measured.items()}
            answer = fit(tables, drawn, DENSITY)
            pairs = (answer.yield_value, tau_y), (answer.plastic_viscosity, eta)
            held.append([(constant.lower or 0.0) <= true <= (constant.upper or np.inf) for constant, true in pairs])
        shares = " and ".join(f"{share:.1%}" for share in np.mean(held, axis=0))
        print(f"{tau_y:g} Pa, {eta:g} Pa s: {found.yield_value}, {found.plastic_viscosity}; held {shares}")
