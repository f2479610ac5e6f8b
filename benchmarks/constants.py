"""What a fifth more or less of each constant of the scheme implicit does to a cone and a film.

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
NO_NUMBER = {"FLOWS", "PACKING"}  # of what is told alone, and no number
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
        module = importlib.import_module("taichi_mps." + file.replace("/", "."))
        holder, _, last = name.rpartition(".")
        if holder:
            numerics = {last: scaled(name, getattr(module, holder).model_fields[last].default, factor)}
        else:
            setattr(module, name, scaled(name, getattr(module, name), factor))
    import taichi_mps as mps
    from taichi_mps.problem import catalogue

    mps.init(threads=1)
    weight = 2300.0 * 9.81 * np.sin(np.radians(25.0)) * 0.1  # of the film, on the slope [Pa]
    cone = mps.slump_cone(model="axisymmetric", yield_value=300.0, plastic_viscosity=50.0)
    mix = {"yield_value": 0.3 * weight, "plastic_viscosity": 100.0}
    film = catalogue.build("film", angle=25.0, depth=0.1, spacing=0.01, until=2.0, **mix)
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
    """The table: changes beside the mean of the constants as they are, and the scatter of these."""
    found = points.read("constants")
    rows = np.array([[*found[f"as it is {seed}"].values()][-3:] for seed in range(PLACINGS)])
    mean, scatter = rows.mean(0), rows.std(0, ddof=1)

    def changes(name: str, factor: float) -> list[str]:
        """Of slump and slump flow [mm] and of the speed [%]; bold beyond three times the scatter."""
        at = [found[f"{name} {factor:g}"][key] for key in ("slump_m", "spread_m", "speed")]
        change, scale = np.subtract(at, mean), (1e3, 1e3, 100.0 / mean[2])
        texts = [f"{by * value:+.1f}" for by, value in zip(scale, change, strict=True)]
        large = np.abs(change) > 3.0 * scatter
        return [f"**{text}**" if bold else text for text, bold in zip(texts, large, strict=True)]

    lines = []
    for name, _ in constants():
        if all(f"{name} {factor:g}" in found for factor in FACTORS):
            pairs = zip(*(changes(name, factor) for factor in FACTORS), strict=True)
            lines.append([f"`{name}`", *(", ".join(pair) for pair in pairs)])
    head = ["constant less, more by a fifth", "slump [mm]", "slump flow [mm]", "speed of the film [%]"]
    spread = f"{1e3 * scatter[0]:.1f} mm, {1e3 * scatter[1]:.1f} mm and {100.0 * scatter[2] / mean[2]:.1f} %"
    text = f"{points.table(head, lines)}\n\nRuns with particles 1e-6 l0 aside scatter by {spread}; bold: beyond three times that."
    points.put("theory/constants.md", "constants", text, found.values())


if __name__ == "__main__":
    points.main(__file__, "constants", cases, point, draw, __doc__)
