"""Sensitivity of a cone and a film to a fifth more or less of each constant of the scheme implicit.

    python benchmarks/constants.py run [NAME ...]   # every constant without a result: results/constants.json
    python benchmarks/constants.py draw             # the table below docs/theory/constants.md

The constants are those of that page, read from its table. Cone: rings of 10 mm, 300 Pa, 50 Pa s, at rest. Film: 25
degrees, 0.1 m deep, 10 across, a yield stress of 0.3 of the wall stress, after 2 s.
"""

import importlib
import re

import numpy as np
import points

PAGE = points.DOCS / "theory" / "constants.md"
FACTORS, PLACINGS = (0.8, 1.2), 5
NO_NUMBER = {"FLOW_THRESHOLD", "PACKING"}  # of what is told alone, and no number
WHOLE = {"passes", "FIRST_ITERATIONS", "VISCOUS_ITERATIONS", "RELAXATION_SHIFTS", "FULL_STEP_INTERVAL"}


def constants() -> list[tuple[str, str]]:
    """Name and file of each constant of the table of the scheme."""
    page = PAGE.read_text(encoding="utf-8").split("## Scheme semi-implicit")[0]
    rows = re.findall(r"^\| (`.*?) \| `(\S+)\.py` \|", page, re.M)
    listed = [(name, file) for cell, file in rows for name in re.findall(r"`([\w.]+)`", cell)]
    return [(name, file) for name, file in listed if name not in NO_NUMBER]


def cases() -> dict[str, dict]:
    """Settings of ``point`` by name."""
    found = {f"as it is {seed}": {"seed": seed} for seed in range(PLACINGS)}
    for name, file in constants():
        found |= {f"{name} {factor:g}": {"name": name, "file": file, "factor": factor} for factor in FACTORS}
    return found


def scaled(name: str, value, factor: float):
    """The constant, each number of it times the factor, counts rounded."""
    if isinstance(value, tuple):
        return tuple(scaled(name, each, factor) for each in value)
    return max(1, round(factor * value)) if name.split(".")[-1] in WHOLE else factor * value


def point(name: str = "", file: str = "", factor: float = 1.0, seed: int = 0) -> dict:
    """Slump and slump flow [m] of the cone, mean speed [m/s] of the film."""
    numerics = {}
    if name:  # before anything else takes the constant from its module
        module = importlib.import_module("taichi_mps.engine." + file.replace("/", "."))
        holder, _, last = name.rpartition(".")
        if holder:
            numerics = {last: scaled(name, getattr(module, holder).model_fields[last].default, factor)}
        else:
            setattr(module, name, scaled(name, getattr(module, name), factor))
    import taichi_mps as mps
    from taichi_mps.input import catalogue

    mps.init(threads=1)
    weight = 2300.0 * 9.81 * np.sin(np.radians(25.0)) * 0.1  # of the film, on the slope [Pa]
    cone = mps.slump_cone(model="axisymmetric", yield_value=300.0, plastic_viscosity=50.0)
    film = catalogue.build(
        "film", angle=25.0, depth=0.1, spacing=0.01, until=2.0, yield_value=0.3 * weight, plastic_viscosity=100.0
    )
    found = {}
    for scene in (cone, film):
        sim = mps.Simulation(scene, mps.Implicit(**numerics))
        state = sim.state()
        state["x"] = state["x"] + points.aside(state["x"].shape, scene.spacing, seed).astype(state["x"].dtype)
        sim.load(state)
        sim.run()
        found |= sim.measures()
        found["speed"] = float(sim.snapshot().u[:, 0].mean())  # of the film, the last
    return {key: float(found[key]) for key in ("slump_m", "spread_m", "speed")}


def draw() -> None:
    """Write the table of changes, bold where the scatter of runs is less; what changes no bit is named."""
    found = points.read("constants")
    # mm, mm, %
    keys, scale = ("slump_m", "spread_m", "speed"), np.array([1e3, 1e3, 100.0 / found["as it is 0"]["speed"]])

    def numbers(key: str) -> np.ndarray:
        """Results of a point."""
        return scale * [found[key][name] for name in keys]

    scatter = np.std([numbers(f"as it is {seed}") for seed in range(PLACINGS)], axis=0, ddof=1)
    lines, same = [], []
    for name, _ in constants():
        changes = np.array([numbers(f"{name} {factor:g}") - numbers("as it is 0") for factor in FACTORS])
        large = np.abs(changes) > 3.0 * 2.0**0.5 * scatter
        texts = [
            [f"**{x:+.1f}**" if bold else f"{x:+.1f}" for x, bold in zip(*both, strict=True)]
            for both in zip(changes.T, large.T, strict=True)
        ]
        if changes.any():
            lines.append([f"`{name}`", *map(", ".join, texts)])
        else:
            same.append(f"`{name}`")
    table = points.table(
        ["constant less, more by a fifth", "slump [mm]", "slump flow [mm]", "speed of the film [%]"], lines
    )
    spread = "{:.1f} mm, {:.1f} mm and {:.2f} %".format(*scatter)
    below = f"Runs with particles 1e-6 l0 aside scatter by {spread}; bold: more than that explains (3 sqrt 2 times)."
    text = f"{table}\n\n{below} Not a bit changes with {', '.join(same)}."
    points.put("theory/constants.md", "constants", text, found.values())


if __name__ == "__main__":
    points.main(__file__, "constants", cases, point, draw, __doc__)
