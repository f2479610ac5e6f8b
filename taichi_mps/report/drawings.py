"""What the page draws, for JSON: the film and what stands around it, the curves, the section at the end."""

import base64
import re
from dataclasses import replace
from itertools import groupby

import numpy as np

from ..io.vtkhdf import Trajectory
from ..problem.labels import in_words, title, unit_of_measure
from ..problem.measures import Snapshot, embed, still, surface
from ..units import SceneError
from ..viz.stage import images, stage, wall_lines
from .sentences import of_scene

MOST_SHOWN = 16_500  # particles at a time; of more some are left out
BYTES = 7  # of a particle at a time
GOLDEN = 0.618034  # multiples of it fill 0..1 evenly: which particles are left out
FINEST, FASTEST, FLOWING = 65_535, 127, 128  # largest code of a position and of a speed; the bit of what flows
MOST_POINTS = 400  # of a curve
AT_HEIGHT = re.compile(r"(.+)_at_(\d+)mm_Pa")  # a pressure at a height
MARGIN = 0.03  # around what is shown, over its longest side
HALF = 0.75  # of a particle size, on either side of the middle plane: what lies there is shown
CORNERS = 12  # of the polygon that is drawn for a particle


def drawings(run, film: dict, last: Snapshot) -> dict:
    """All that page.js draws. Lengths [m]; of lines three lists x, y, z with None between two of them."""
    scene, walls_low, walls_high, floor = run.scene, *stage(run.scene)
    walls = wall_lines(scene, walls_low, walls_high, film["times"][-1])
    outline = [line for each in scene.outline for line in images(scene, each)]
    low, high = box(film, outline, floor)
    return {
        "film": film,
        "size": scene.spacing * film["share"] ** (-1.0 / scene.dimension),
        "dimension": 3 if scene.axisymmetric else scene.dimension,
        "low": low.tolist(),
        "high": high.tolist(),
        "unit": float((high - low).max()),
        "floor": floor,
        "walls": joined([np.clip(line, low, high) for line in walls]),
        "outline": joined(outline),
        "charts": charts(run.history) + profiles(run.summary),
        "section": section(last, scene),
    }


def box(film: dict, outline, floor):
    """Low and high corner [m] (3,) of what is shown: the body at all times, the outline and the floor below it."""
    body = np.array(film["low"]) + np.outer((0, FINEST), film["step"])
    points = np.vstack([body, *outline])
    low, high = points.min(0), points.max(0)
    room = MARGIN * (high - low).max()
    low, high = low - room, high + room
    if floor is not None:
        low[2] = min(floor, low[2] + room)
    return low, high


def joined(lines) -> list[list]:
    """Polylines (k, 3) as lists x, y, z."""
    gap = np.full((1, 3), np.nan)
    rows = np.vstack([gap, *(part for line in lines for part in (embed(line), gap))])
    return [numbers(column) for column in rows[1:].T]


# ---- the body over time ----------------------------------------------------------------------------------------
def film(trajectory: Trajectory, scene, room: int) -> tuple[dict, Snapshot]:
    """The outputs of a run that fit into ``room`` bytes, the first and the last among them, evenly chosen, mirrored and
    revolved to the whole body, for JSON; and the computed part at the last output. SceneError where the run has no
    output yet.

    ``times`` [s] and ``counts`` of particles at each output; ``positions`` in base64, 16 bits each, low byte first:
    ``low`` + ``step`` * code [m]; ``colours``: of 8 bits the speed, whose code FASTEST is that of ``fastest`` [m/s],
    and FLOWING added to it of what flows; ``outputs`` of the run, ``share`` of the particles that are shown [-]."""
    outputs = len(trajectory.times())
    if not outputs:
        raise SceneError(f"run = {trajectory.path.parent}: run.h5 holds no output yet")
    (end,) = trajectory.replay(scene=scene, chosen=[outputs - 1])
    whole = len(scene.unfold(end.state).x)
    share = min(1.0, MOST_SHOWN / whole)
    fitting = max(2, int(room / (BYTES * share * whole)))
    chosen = np.unique(np.linspace(0, outputs - 1, min(outputs, fitting)).round().astype(int)).tolist()
    shown = [reduced(replay.state, scene, share) for replay in trajectory.replay(scene=scene, chosen=chosen)]
    x, speed, flowing = (np.concatenate(parts) for parts in zip(*shown, strict=True))
    low = x.min(0)
    step = np.maximum(x.max(0) - low, 1e-9) / FINEST
    fastest = float(speed.max()) or 1.0
    colours = np.round(FASTEST * speed / fastest).astype(np.uint8) + FLOWING * flowing.astype(np.uint8)
    facts = {
        "times": trajectory.times()[chosen].round(6).tolist(),
        "counts": [len(part) for part, _, _ in shown],
        "low": low.tolist(),
        "step": step.tolist(),
        "positions": coded(np.round((x - low) / step).astype("<u2")),
        "colours": coded(colours),
        "fastest": fastest,
        "outputs": outputs,
        "share": share,
    }
    return facts, end.state


def coded(values: np.ndarray) -> str:
    """Numbers in base64."""
    return base64.b64encode(values.tobytes()).decode()


def reduced(part: Snapshot, scene, share: float):
    """Positions (n, 3) [m], speeds (n,) [m/s] and what flows (n,), of a share of the whole body: of a particle
    and its mirror images all or none, and the same ones at all times."""
    whole = scene.unfold(part)
    k = np.arange(len(whole.x))
    rank = np.modf(GOLDEN * (k if scene.axisymmetric else k % len(part.x)))[0]
    kept = rank < share if share < 1.0 else slice(None)
    flows = np.array([material.flows(whole.shear_rate) for material in scene.materials])
    flowing = flows[whole.mix, np.arange(len(whole.mix))]
    return embed(whole.x)[kept], whole.speed[kept], flowing[kept]


# ---- curves ----------------------------------------------------------------------------------------------------
def charts(history: dict) -> list[dict]:
    """Curves over time [s], those of one unit together: measures of the scene, then the share of the volume that flows,
    at every step."""
    time = history["time_s"]
    kept = np.unique(np.linspace(0, len(time) - 1, MOST_POINTS).round().astype(int))
    curves = {}
    for key, values in history.items():
        if of_scene(key) and np.isfinite(values).any():
            factor, unit, _ = unit_of_measure(key)
            curves.setdefault(unit, []).append(curve(title(key), time[kept], factor * values[kept]))
    curves["%"] = [curve("share flowing", time[kept], 100.0 * history["flowing_fraction"][kept])]
    return [{"unit": unit, "curves": some} for unit, some in curves.items()]


def profiles(summary: dict) -> list[dict]:
    """What a scene measures of pressures at several heights, in one chart: height [cm] against pressure [kPa]."""
    found = [(AT_HEIGHT.fullmatch(key), value) for key, value in summary.items()]
    found = sorted((m[1], float(m[2]), value) for m, value in found if m and value is not None)
    curves = []
    for name, some in groupby(found, key=lambda row: row[0]):
        _, height, pressure = zip(*some, strict=True)
        if len(height) > 1:
            curves.append(curve(in_words(name), 1e-3 * np.array(pressure), 0.1 * np.array(height)))
    return [{"unit": "cm", "along": "pressure [kPa]", "title": "height [cm]", "curves": curves}] if curves else []


def curve(name: str, x, y) -> dict:
    """A named curve."""
    return {"name": name, "x": numbers(x), "y": numbers(y)}


def numbers(values) -> list:
    """Rounded to five digits, None for what is no number."""
    return [float(f"{value:.5g}") if np.isfinite(value) else None for value in values]


# ---- the middle plane at the end -------------------------------------------------------------------------------
def section(part: Snapshot, scene) -> dict:
    """Particles in the middle plane, as the shapes that they have, and the surface above them, of the computed part of
    a body.

    ``across`` and ``up`` [m] are corners of polygons, None between two; ``surface``: two lists, across and up [m];
    ``place``: which plane, in words."""
    x, size, middle = in_the_middle(part, scene)
    angle = 2.0 * np.pi * np.arange(CORNERS) / CORNERS
    corners = x[:, None] + 0.5 * size[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], -1)
    closed = np.concatenate([corners, np.full((len(x), 1, 2), np.nan)], axis=1).reshape(-1, 2)
    ticks = np.arange(x[:, 0].min(), x[:, 0].max() + 1e-12, 0.5 * part.spacing)
    heights = surface(replace(still(x, part.spacing), size=size), ticks[:, None])
    return {
        "across": numbers(closed[:, 0]),
        "up": numbers(closed[:, 1]),
        "surface": [numbers(ticks), numbers(heights)],
        "place": f"particles near the upright plane y = {round(100.0 * middle, 2) + 0.0:g} cm",
    }


def in_the_middle(part: Snapshot, scene):
    """Positions (n, 2) [m] near the middle plane of the whole body, their sizes (n,) [m], and where along y the plane
    is [m]."""
    whole, start = scene.unfold(part), embed(scene.unfold(still(scene.reach, part.spacing)).x)
    middle = 0.5 * (start[:, 1].min() + start[:, 1].max())
    x = embed(whole.x)
    near = np.abs(x[:, 1] - middle) < HALF * part.spacing
    return x[near][:, [0, 2]], whole.size[near], middle
