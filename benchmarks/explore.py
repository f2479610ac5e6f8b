"""docs/explore.html, a page to pull a slump cone in any browser: a table of runs in rings, and the page made of it.

    python benchmarks/explore.py run    # benchmarks/results/explore.jsonl: mixes of the table, and checks between them
    python benchmarks/explore.py draw   # the page, with the errors of the table at the checks

Mixes that are in the file are not run again. A run is told by STAGES at equal parts of the way that front and top go:
time, slump, slump flow, and the surface as distances from the middle of the floor, along rays at equal angles in the
picture that makes its radius and its height 1. Between mixes all of these are interpolated stage by stage, in the
logarithms of both constants: fronts stay sharp and times keep their scale.
"""

import base64
import json
import sys
import zlib
from concurrent.futures import ProcessPoolExecutor, as_completed
from itertools import product
from multiprocessing import get_context
from pathlib import Path
from string import Template

import numpy as np
import points
from scipy.interpolate import CubicHermiteSpline

from taichi_mps import __version__
from taichi_mps.engine import Frame
from taichi_mps.forecast import accuracy
from taichi_mps.input import catalogue
from taichi_mps.study.reuse import begin
from taichi_mps.viz.body import profile

# yield stress of the table [Pa], from the softest on of which the error of rings was measured
TAU_Y = [40.0, 49.4, 73.7, 109.9, 163.8, 244.3, 364.2, 543.0, 809.7, 1207.2, 1800.0]
ETA = [20.0, 28.0, 40.0, 55.0, 75.0, 110.0, 250.0, 1500.0]  # plastic viscosity of the table [Pa s]
NODES, CHECKS = list(product(TAU_Y, ETA)), 24  # mixes of the table, number of those between
CONE = {"model": "axisymmetric", "spacing": 0.0075, "until": 600.0, "floor_radius": 0.9}
STAGES, RAYS, HEIGHT, AXIS = 24, 48, 0.3, 0.01  # AXIS: radius [m] within which the top is level
MIN_STEP, STEP_RATIO = 0.025, 1.15  # least time between states that are kept [s], least ratio of their times
COLUMNS = {"time": "time_s", "slump": "slump_m", "spread": "spread_m", "highest": "slump_max_m", "away": "rays"}
# units of the 16-bit integers of the page: logarithm of a time, lengths [m], rays
UNITS = {"time": 5e-4, "slump": 2e-5, "spread": 2e-5, "highest": 2e-5, "away": 1e-4}
SMOOTHED = 3  # times that a ray takes the mean of itself and its neighbours
MIN_TIME = 1e-3  # whose logarithm stands for the beginning [s]
TABLE, HTML, PAGE = points.RESULTS / "explore.jsonl", Path(__file__).with_suffix(".html"), points.DOCS / "explore.html"
PARTS = "taichi_mps/report/charts.js", "taichi_mps/report/viewer.js", "benchmarks/explore.js"


def checks() -> list[tuple]:
    """Mixes [Pa, Pa s] that are evenly spread over the table in the logarithms, none of them in it."""
    even = (np.outer(np.arange(1, CHECKS + 1), (0.7548777, 0.5698403)) + 0.5) % 1.0  # the sequence R2 of Roberts (2018)
    low, high = np.log((10.0, 10.0)), np.log(NODES[-1])
    return [
        mix
        for mix in map(tuple, np.exp(low + even * (high - low)).round(1).tolist())
        if min(mix[0] / TAU_Y[0], mix[1] / ETA[0]) > 1.0
    ]


# ---- runs ----------------------------------------------------------------------------------------------------------
def course(mix) -> dict:
    """A run to rest, told by its stages."""
    sim = begin(catalogue.build("slump", yield_value=mix[0], plastic_viscosity=mix[1], **CONE))
    rows = []

    def keep(sim, last=False):
        if last or not rows or sim.all_active and sim.time >= max(rows[-1][0] + MIN_STEP, STEP_RATIO * rows[-1][0]):
            state = sim.snapshot()
            measures = {"time_s": sim.time} | Frame(sim.scene, state, sim.report).measures()
            rows.append([*(measures[key] for key in list(COLUMNS.values())[:-1]), *rays(sim.scene, state)])

    keep(sim)
    sim.each_step(keep)
    ended = sim.run()
    keep(sim, last=True)
    rows = np.array(rows)
    way = np.cumsum(np.maximum(np.abs(np.diff(rows[:, 1:3], axis=0, prepend=rows[:1, 1:3])) @ (1.0, 0.5), 1e-9))
    found = [np.interp(np.linspace(way[0], way[-1], STAGES), way, column) for column in rows.T]
    kept = {key: [float(f"{value:.5g}") for value in found[k]] for k, key in enumerate(list(COLUMNS.values())[:-1])}
    return {"mix": mix, "ended": ended} | kept | {"rays": packed(np.transpose(found[len(kept) :]))}


def rays(scene, state) -> np.ndarray:
    """Distances (RAYS,) of the surface from the middle of the floor, from the floor to the axis, where radius and
    height are 1."""
    surface, _, links = profile(scene, state)
    line, near = surface.x, surface.x[:, 0] < AXIS
    line[near, 1] = np.interp(AXIS, *line[np.argsort(line[:, 0])].T)
    line = line / (line[:, 0].max(), line[near, 1].max())
    angle = np.linspace(1e-6, 0.5 * np.pi - 1e-6, RAYS)
    along, across = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    a, b = line[links].transpose(1, 0, 2)
    off_a, off_b = a @ across, b @ across
    part = off_a / np.where(off_a == off_b, 1.0, off_a - off_b)
    return np.where(off_a * off_b <= 0.0, (1.0 - part) * (a @ along) + part * (b @ along), 0.0).max(0)


def packed(values, unit=UNITS["away"]) -> str:
    """Numbers in a unit, less the one before, in 16 bits, deflated, in base64."""
    codes = np.diff(np.round(np.ravel(values) / unit), prepend=0.0).astype("<i2")
    return base64.b64encode(zlib.compress(codes.tobytes(), 9)).decode()


def unpacked(text: str) -> np.ndarray:
    """The rays (STAGES, RAYS) of a text by ``packed``."""
    codes = np.frombuffer(zlib.decompress(base64.b64decode(text)), "<i2")
    return UNITS["away"] * np.cumsum(codes, dtype=int).reshape(-1, RAYS)


def run(workers="2") -> None:
    """Add the courses that are not in the file yet, the slowest first."""
    if not TABLE.exists():
        TABLE.write_text(json.dumps({"made": points.stamp()}) + "\n", encoding="utf-8")
    todo = [mix for mix in sorted([*NODES, *checks()], key=lambda mix: -mix[1]) if mix not in courses()]
    with ProcessPoolExecutor(int(workers), get_context("spawn")) as pool, TABLE.open("a", encoding="utf-8") as file:
        for found in as_completed([pool.submit(course, mix) for mix in todo]):
            print(json.dumps(found.result()), file=file, flush=True)


def courses() -> dict[tuple, dict]:
    """Courses of the file by their mix, with ``rays`` (STAGES, RAYS)."""
    _, *rows = map(json.loads, TABLE.read_text(encoding="utf-8").splitlines())
    return {tuple(row["mix"]): row | {"rays": unpacked(row["rays"])} for row in rows}


# ---- between the mixes ---------------------------------------------------------------------------------------------
def columns(rows) -> dict[str, np.ndarray]:
    """What is interpolated, each (mixes, STAGES, ...): logarithms of times, lengths [m], and the rays, without the
    ripples of rows of rings."""
    found = {name: np.array([row[key] for row in rows]) for name, key in COLUMNS.items()}
    away = found["away"][:, 1:]
    for _ in range(SMOOTHED):
        away[..., 1:-1] += 0.5 * (0.5 * (away[..., :-2] + away[..., 2:]) - away[..., 1:-1])
    away[..., -2] = away[..., -1]  # level at the axis
    return found | {"time": np.log(np.maximum(found["time"], MIN_TIME))}


def weights(nodes, x) -> np.ndarray:
    """Weights (n,) of a cubic through the values at n nodes, whose slopes are those from neighbour to neighbour."""
    k, values = np.arange(len(nodes)), np.eye(len(nodes))
    before, after = np.maximum(k - 1, 0), np.minimum(k + 1, k[-1])
    slopes = (values[after] - values[before]) / (nodes[after] - nodes[before])[:, None]
    return CubicHermiteSpline(nodes, values, slopes)(x)


def at(table: dict, mix) -> dict[str, np.ndarray]:
    """Columns of a mix [Pa, Pa s]."""
    both = [weights(np.log(nodes), np.log(value)) for nodes, value in zip((TAU_Y, ETA), mix, strict=True)]
    return {name: np.tensordot(np.outer(*both).ravel(), values, 1) for name, values in table.items()}


def at_rest(course) -> np.ndarray:
    """Slump [mm], logarithm of the slump flow, and that of T500, nan where it is not reached."""
    wide = np.maximum.accumulate(course["spread"])
    t500 = np.interp(0.5, wide, np.exp(course["time"]), right=np.nan)
    return np.array([1e3 * course["slump"][-1], np.log(wide[-1]), np.log(t500)])


# ---- the page ------------------------------------------------------------------------------------------------------
def draw() -> None:
    """Write the page and print the errors."""
    every, own, off = courses(), [], []
    table = columns([every[mix] for mix in NODES])
    for mix in checks():
        known = {name: values[0] for name, values in columns([every[mix]]).items()}
        off.append((at_rest(at(table, mix)) - at_rest(known)) * (1.0, 100.0, 100.0))
        print("{:g} Pa, {:g} Pa s: slump {:+.2f} mm, slump flow {:+.2f} %, T500 {:+.1f} %".format(*mix, *off[-1]))
        if error := accuracy.expected(CONE["model"], CONE["spacing"] / HEIGHT, accuracy.MixNumbers.of(*mix)):
            own.append(HEIGHT * np.array([1e3 * error.slump, 200.0 * error.reach / known["spread"][-1]]))
    worst = [f"{value:.1f}" for value in [*np.nanmax(np.abs(off), axis=0), *np.max(own, axis=0)]]
    texts = dict(zip(("slump", "flow", "late", "own_slump", "own_flow"), worst, strict=True)) | {
        "version": __version__,
        "made": json.loads(TABLE.read_text("utf-8").partition("\n")[0])["made"],
        "spacing": 1e3 * CONE["spacing"],
        "softest": f"{TAU_Y[0]:g}",
        "mixes": len(NODES),
        "checks": len(off),
        "table": json.dumps(data(table)),
    }
    texts |= {Path(name).stem: (points.ROOT / name).read_text(encoding="utf-8") for name in PARTS}
    PAGE.write_text(Template(HTML.read_text(encoding="utf-8")).substitute(texts), encoding="utf-8")


def data(table) -> dict:
    """Data of the page."""
    return {"yield": TAU_Y, "viscosity": ETA, "stages": STAGES, "rays": RAYS} | {
        name: {"unit": UNITS[name], "packed": packed(values, UNITS[name])} for name, values in table.items()
    }


if __name__ == "__main__":
    {"run": run, "draw": draw}[sys.argv[1]](*sys.argv[2:])
