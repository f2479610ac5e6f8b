"""docs/explore.html, a page to pull a slump cone in any browser: a table of runs in rings, and the page made of it.

    python benchmarks/explore.py run      # benchmarks/results/explore.json: mixes of the table, and checks between them
    python benchmarks/explore.py draw     # the page, with the errors between mixes of the table

Mixes that are in the file are not run again. A run is told by STAGES at equal parts of the way that front and top go:
time, slump, slump flow, and the surface as distances from the middle of the floor, along rays at equal angles in the
picture that makes its radius and its height 1. Between mixes all of these are interpolated stage by stage, in the
logarithms of both constants: fronts stay sharp and times keep their scale.
"""

import base64
import json
import sys
import zlib
from concurrent.futures import ProcessPoolExecutor
from itertools import product
from multiprocessing import get_context

import numpy as np
import points

from taichi_mps.engine import Frame
from taichi_mps.input import catalogue
from taichi_mps.study.reuse import begin
from taichi_mps.viz.body import contour, fit_to_mould, profile

TAU_Y = np.geomspace(10.0, 1800.0, 14).round(1)  # yield stress of the table [Pa]
ETA = np.array([10, 14, 20, 28, 40, 55, 75, 110, 250, 1500], float)  # plastic viscosity of the table [Pa s]
CHECKS = 24  # mixes between those of the table
CONE = {"model": "axisymmetric", "spacing": 0.0075, "until": 600.0, "floor_radius": 0.9}
STAGES, RAYS, HEIGHT, AXIS = 24, 48, 0.3, 0.01  # AXIS: radius [m] within which the top is level
UNIT = 1e-4  # of the distances that are kept
MIN_STEP, STEP_RATIO = 0.025, 1.15  # least time between states that are kept [s], least ratio of their times
KEYS = "time_s", "slump_m", "spread_m", "slump_max_m"
TABLE = points.RESULTS / "explore.jsonl"


def checks():
    """Mixes (CHECKS, 2) [Pa, Pa s], evenly spread over the table in the logarithms, none of them in it."""
    even = (np.outer(np.arange(1, CHECKS + 1), (0.7548777, 0.5698403)) + 0.5) % 1.0  # the sequence R2 of Roberts (2018)
    low, high = np.log([(TAU_Y[0], ETA[0]), (TAU_Y[-1], ETA[-1])])
    return np.exp(low + even * (high - low)).round(1)


# ---- runs ----------------------------------------------------------------------------------------------------------
def course(mix) -> dict:
    """A run to rest, told by its stages: KEYS, and ``rays`` (STAGES, RAYS) in units of UNIT."""
    tau_y, eta = mix
    sim = begin(catalogue.build("slump", yield_value=tau_y, plastic_viscosity=eta, **CONE))
    rows, due = [], [0.0]

    def keep(sim):
        if sim.time >= due[0] and sim.all_active:
            state = sim.snapshot()
            measures = {"time_s": sim.time} | Frame(sim.scene, state, sim.report).measures()
            rows.append([*(measures[key] for key in KEYS), *rays(sim.scene, state)])
            due[0] = max(sim.time + MIN_STEP, STEP_RATIO * sim.time)

    keep(sim)
    sim.each_step(keep)
    ended = sim.run()
    due[0] = 0.0
    keep(sim)
    rows = np.array(rows)
    way = np.abs(np.diff(rows[:, 1:3], axis=0)) @ (1.0, 0.5)
    way = np.append(0.0, np.cumsum(np.maximum(way, 1e-9)))
    found = np.array([np.interp(np.linspace(0.0, way[-1], STAGES), way, column) for column in rows.T])
    kept = {key: [float(f"{value:.5g}") for value in found[k]] for k, key in enumerate(KEYS)}
    return {"mix": mix, "ended": ended} | kept | {"rays": packed(found[len(KEYS) :].T)}


def rays(scene, state):
    """Distances (RAYS,) of the surface from the middle of the floor, from the floor to the axis, where radius and
    height are 1."""
    if state.time == 0.0:
        line, _, links = profile(scene, state)
        line = line.x
    else:
        line, _, links = contour(fit_to_mould(scene, state), 0.0)
    near = line[:, 0] < AXIS
    line[near, 1] = np.interp(AXIS, *line[np.argsort(line[:, 0])].T)
    line = line / (line[:, 0].max(), line[near, 1].max())
    angle = np.clip(np.linspace(0.0, 0.5 * np.pi, RAYS), 1e-6, 0.5 * np.pi - 1e-6)
    along, across = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    a, b = line[links].transpose(1, 0, 2)
    off_a, off_b = a @ across, b @ across
    part = off_a / np.where(off_a == off_b, 1.0, off_a - off_b)
    away = (1.0 - part) * (a @ along) + part * (b @ along)
    return np.where(off_a * off_b <= 0.0, away, 0.0).max(0)


def packed(values) -> str:
    """Numbers in units of UNIT, less the one before, in 16 bits, deflated, in base64."""
    codes = np.diff(np.round(np.ravel(values) / UNIT).astype(int), prepend=0)
    return base64.b64encode(zlib.compress(codes.astype("<i2").tobytes(), 9)).decode()


def unpacked(text: str) -> np.ndarray:
    """The numbers (STAGES, RAYS) that ``packed`` wrote."""
    codes = np.frombuffer(zlib.decompress(base64.b64decode(text)), "<i2")
    return UNIT * np.cumsum(codes, dtype=int).reshape(-1, RAYS)


def run(workers="2") -> None:
    """Add the courses that are not in the file yet, in the order of their mixes."""
    kept = {tuple(row["mix"]) for row in rows()}
    todo = [mix for mix in [*product(TAU_Y.tolist(), ETA.tolist()), *map(tuple, checks().tolist())] if mix not in kept]
    if not TABLE.exists():
        TABLE.write_text(json.dumps({"made": points.stamp()}) + "\n", encoding="utf-8")
    with ProcessPoolExecutor(int(workers), get_context("spawn")) as pool, TABLE.open("a", encoding="utf-8") as file:
        for found in pool.map(course, todo):
            print(json.dumps(found), file=file, flush=True)


def rows() -> list[dict]:
    """Courses of the file."""
    lines = TABLE.read_text(encoding="utf-8").splitlines()[1:] if TABLE.exists() else []
    return [json.loads(line) for line in lines]


if __name__ == "__main__":
    {"run": run}[sys.argv[1]](*sys.argv[2:])
