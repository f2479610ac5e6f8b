"""Known answers of the scene vane: a cylinder near its yield torque, and what the ends of a cylinder and a vane add.

    python benchmarks/vane_known.py run    # every point without a result: results/vane_known.json, an hour of CPU
    python benchmarks/vane_known.py draw   # the tables in docs/scenes/vane.md

A section of the cylinder has the closed form of Reiner and Riwlin. A whole one has a known answer, too: slow and
steady, every ring of the fluid turns with an angular velocity w(r, z) of least dissipation. Finite elements find it.
"""

import json
import sys

import numpy as np
import points

PASTE = {"yield_value": 7.48, "consistency": 1.655, "flow_index": 0.676, "density": 1900.0}  # 0.45-250 of vane.py
SPEEDS = (0.06, 0.5, 5.0, 59.99)  # turns a minute
TAU_Y, ETA, SPEED = 20.0, 1.0, 20.0  # yield stress [Pa], plastic viscosity [Pa s], turns a minute: those of the scene
RADIUS, HEIGHT, CUP = 0.02, 0.06, 0.05  # of the scene [m]; a radius of fluid below and above
SPACINGS = (0.004, 0.003, 0.0025, 0.002, 0.001)  # [m]; at the last the sections alone
ENDS = [(body, model) for model in ("section", "full") for body in ("vane", "cylinder")]
CELL = 0.00025  # of the finite elements [m]


def key(body: str, model: str, spacing: float, speed: float | None = None) -> str:
    return f"{body} {model} {1e3 * spacing:g} mm" + (f" paste {speed:g} rpm" if speed else "")


def cases() -> dict[str, dict]:
    """Keywords of the scene by the key of every point, the long ones last."""
    found = {}
    for spacing in (0.004, 0.002, 0.001):
        for speed in SPEEDS:
            settings = {"body": "cylinder", "model": "section", "spacing": spacing, "speed": speed}
            found[key("cylinder", "section", spacing, speed)] = PASTE | settings
    for spacing in SPACINGS:
        for body, model in ENDS[: 2 if spacing < 0.002 else 4]:
            found[key(body, model, spacing)] = {"body": body, "model": model, "spacing": spacing, "speed": SPEED}
    return found


def point(settings: dict) -> dict:
    """Mean torque [N m] in each of three twelfths of a turn, the period of six blades in a square lattice, and in the
    last, when the flow is steady."""
    import taichi_mps as mps
    from taichi_mps.problem import catalogue

    mps.init(threads=1)
    scene, twelfth = catalogue.build("vane", **settings), 60.0 / settings["speed"] / 12.0
    sim, rows = mps.Simulation(scene), []
    sim.each_step(lambda sim: rows.append((sim.time, sim.measures()["torque_N_m"])))
    sim.run(until=3.0 * twelfth)
    times, torques = np.array(rows).T
    parts = np.minimum(2, (times / twelfth).astype(int))
    means = [float(torques[parts == part].mean()) for part in range(3)]
    exact = scene.over_time({"time_s": times, "torque_N_m": torques})["cylinder_torque_N_m"]
    ran = {"particles": sim.fluid_particles, "steps": sim.steps, "cpu_seconds": round(sim.cpu_seconds, 1)}
    return {"torque_N_m": means[2], "twelfths_N_m": means, "cylinder_torque_N_m": exact} | ran


def whole_cylinder_torque(cell: float, slowest: float = 1e-3, tolerance: float = 1e-5) -> float:
    """Torque [N m] on a whole cylinder by linear finite elements for w(r, z), triangles of the side ``cell`` [m]: the
    floor and the cup stand, the top is free. The shear rate r |grad w| is taken for no less than ``slowest`` times the
    speed of the cylinder, and the viscosity is that of the last w (Picard) until the torque changes by less than
    ``tolerance``."""
    from scipy.sparse import csr_matrix
    from scipy.sparse.linalg import spsolve

    turn, rows, columns = SPEED * np.pi / 30.0, round(CUP / cell), round((HEIGHT + 2.0 * RADIUS) / cell)
    r, z = np.repeat(np.arange(rows + 1), columns + 1) * cell, np.tile(np.arange(columns + 1), rows + 1) * cell
    a, b = (k.ravel() for k in np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij"))
    beside = np.abs((b + 0.5) * cell - RADIUS - 0.5 * HEIGHT) < 0.5 * HEIGHT
    wet = ((a + 0.5) * cell > RADIUS) | ~beside
    low = (a * (columns + 1) + b)[wet]
    corners = np.stack([low, low + columns + 1, low + columns + 2, low + 1])  # of each square, around it
    even = (a + b)[wet] % 2 == 0
    halves = [np.where(even, corners[[0, 1, 2]], corners[[0, 1, 3]]), np.where(even, corners[[0, 2, 3]], corners[1:])]
    nodes = np.concatenate(halves, axis=1).T  # of every triangle, (n, 3)
    x = np.stack([r, z], axis=1)[nodes]
    slopes = np.linalg.inv(np.insert(x, 0, 1.0, axis=2))[:, 1:]  # of its three shapes, (n, 2, 3)
    at, weight = x[:, :, 0].mean(1), np.pi * cell**2 * (x[:, :, 0] ** 3).mean(1)  # r; 2 pi r3 times the area
    near = 0.25 * cell
    body = (r < RADIUS + near) & (np.abs(z - RADIUS - 0.5 * HEIGHT) < 0.5 * HEIGHT + near)
    free = np.flatnonzero(~body & (r < CUP - near) & (z > near))
    w, viscosity, torque, last = np.where(body, turn, 0.0), np.full(len(nodes), ETA), 0.0, -1.0
    places = np.repeat(nodes, 3, axis=1).ravel(), np.tile(nodes, 3).ravel()
    while abs(torque - last) > tolerance * abs(torque):
        each = (viscosity * weight)[:, None, None] * (slopes.transpose(0, 2, 1) @ slopes)
        matrix = csr_matrix((each.ravel(), places), shape=(len(r), len(r)))
        w[free] = spsolve(matrix[free][:, free].tocsc(), -(matrix[free] @ np.where(body, turn, 0.0)))
        last, torque = torque, float(w @ (matrix @ w)) / turn
        rate = at * np.linalg.norm(slopes @ w[nodes][:, :, None], axis=(1, 2))
        viscosity = ETA + TAU_Y / np.hypot(rate, slowest * turn)
    return torque


def limit(runs, order: int) -> float | None:
    """Torque [N m] at no spacing, from a fit of a + b spacing^order to (spacing, torque); None for less than three."""
    if len(runs) < 3:
        return None
    spacings, torques = np.array(runs).T
    return float(np.polyfit(spacings**order, torques, 1)[1])


def draw() -> None:
    found = points.read("vane_known")
    lines = ["| turns a minute | layer that flows [mm] | at 4 mm | at 2 mm | at 1 mm |", "|---|---|---|---|---|"]
    for speed in SPEEDS:
        runs = [found[key("cylinder", "section", spacing, speed)] for spacing in (0.004, 0.002, 0.001)]
        stress = runs[0]["cylinder_torque_N_m"] / (HEIGHT * 2.0 * np.pi * RADIUS**2)
        layer = min(CUP, RADIUS * (stress / PASTE["yield_value"]) ** 0.5) - RADIUS
        off = [f"{100.0 * (run['torque_N_m'] / run['cylinder_torque_N_m'] - 1.0):+.1f} %" for run in runs]
        lines.append(f"| {speed:g} | {1e3 * layer:.1f} | {' | '.join(off)} |")
    columns = [(body, model) for body in ("vane", "cylinder") for model in ("section", "full")]
    finest = {body: found[key(body, "section", SPACINGS[-1])]["torque_N_m"] for body in ("vane", "cylinder")}

    def line(name, torques):
        """Torques [N m] of all columns as a line of the table, those of a whole body also over its finest section."""
        cells = ["-" if torque is None else f"{1e3 * torque:.2f}" for torque in torques]
        for k, (body, model) in enumerate(columns):
            if model == "full" and torques[k] is not None:
                cells[k] += f" ({torques[k] / finest[body]:.2f})"
        return f"| {name} | {' | '.join(cells)} |"

    lines += ["", "| | vane: section | whole (over the finest section) | cylinder: section | whole |"]
    lines.append("|---|---|---|---|---|")
    known = {name: run["torque_N_m"] for name, run in found.items()}
    torques = {spacing: [known.get(key(*column, spacing)) for column in columns] for spacing in SPACINGS}
    lines += [line(f"{1e3 * spacing:g} mm", torques[spacing]) for spacing in SPACINGS]
    whole = [[(h, row[k]) for h, row in torques.items() if row[k] is not None] for k in (1, 3)]
    for order, word in ((1, "first"), (2, "second")):
        vane, cylinder = (limit(runs, order) for runs in whole)
        lines.append(line(f"limit by {word} order", [None, vane, None, cylinder]))
    section = found[key("cylinder", "section", 0.002)]["cylinder_torque_N_m"]
    lines.append(line("known", [None, None, section, whole_cylinder_torque(CELL)]))
    points.put("scenes/vane.md", "vane_known", "\n".join(lines))


if __name__ == "__main__":
    if sys.argv[1] == "point":
        print(json.dumps(point(json.loads(sys.argv[2]))))
    else:
        {"run": lambda: points.run(__file__, "vane_known", cases()), "draw": draw}[sys.argv[1]]()
