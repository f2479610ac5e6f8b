"""What the page draws, for JSON: what stands around the body, the curves, the section at the end."""

import re
from dataclasses import replace
from itertools import groupby

import numpy as np

from ..problem.labels import in_words, title, unit_of_measure
from ..problem.measures import Snapshot, embed, still, surface
from ..viz.body import profile
from ..viz.stage import images, stage, wall_lines
from .film import FINEST
from .sentences import of_scene

MOST_POINTS = 400  # of a curve
AT_HEIGHT = re.compile(r"(.+)_at_(\d+)mm_Pa")  # a pressure at a height
HALF = 0.75  # of a particle size, on either side of the middle plane: what lies there is shown
CORNERS = 12  # of the polygon that is drawn for a particle


def drawings(run, film: dict, last: Snapshot) -> dict:
    """All that page.js draws. Lengths [m]; of lines three lists x, y, z with None between two of them."""
    scene, walls_low, walls_high, floor = run.scene, *stage(run.scene)
    walls = wall_lines(scene, walls_low, walls_high, film["times"][-1])
    outline = [line for each in scene.outline for line in images(scene, each)]
    body = np.array(film["low"]) + np.outer((0, FINEST), film["step"])
    points = np.vstack([body, *outline, *scene.vessel])
    room = 0.5 * scene.spacing * (film["corners"][-1] == 0)  # of particles, whose centres these are
    low, high = points.min(0) - room, points.max(0) + room
    low[2] = low[2] if floor is None else min(floor, low[2])
    return {
        "film": film,
        "size": scene.spacing,
        "dimension": 3 if scene.axisymmetric else scene.dimension,
        "low": low.tolist(),
        "high": high.tolist(),
        "floor": floor,
        "vessel": [face.round(5).tolist() for face in scene.vessel],
        "walls": joined([np.clip(line, low, high) for line in walls]),
        "outline": joined(outline),
        "charts": charts(run.history) + profiles(run.summary),
        "section": section(last, scene),
    }


def joined(lines) -> list[list]:
    """Polylines (k, 3) as lists x, y, z."""
    gap = np.full((1, 3), np.nan)
    rows = np.vstack([gap, *(part for line in lines for part in (embed(line), gap))])
    return [numbers(column) for column in rows[1:].T]


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
    """Chart of the pressures that a scene measures at several heights: height [cm] against pressure [kPa]."""
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
    return {
        "across": numbers(closed[:, 0]),
        "up": numbers(closed[:, 1]),
        "surface": [numbers(values) for values in top(part, scene, x, size).T],
        "place": f"particles near the upright plane y = {round(100.0 * middle, 2) + 0.0:g} cm",
    }


def top(part: Snapshot, scene, x, size):
    """Line (k, 2) [m] of the surface in the middle plane: of a body of revolution its outline, else the highest
    particle at each place, of those at x (n, 2) with these sizes (n,)."""
    line = profile(scene, part)
    if line is None:
        ticks = np.arange(x[:, 0].min(), x[:, 0].max() + 1e-12, 0.5 * part.spacing)
        heights = surface(replace(still(x, part.spacing), size=size), ticks[:, None])
        return np.stack([ticks, heights], -1)
    points, _, parts = line
    pieces = np.insert(points.x[parts], 2, np.nan, axis=1)  # with a gap after each
    return np.concatenate([pieces, pieces * (-1.0, 1.0)]).reshape(-1, 2)


def in_the_middle(part: Snapshot, scene):
    """Positions (n, 2) [m] near the middle plane of the whole body, their sizes (n,) [m], and where along y the plane
    is [m]."""
    if scene.axisymmetric:
        return np.concatenate([part.x, part.x * (-1.0, 1.0)]), np.tile(part.size, 2), 0.0
    whole, start = scene.unfold(part), embed(scene.unfold(still(scene.reach, part.spacing)).x)
    middle = 0.5 * (start[:, 1].min() + start[:, 1].max())
    x = embed(whole.x)
    near = np.abs(x[:, 1] - middle) < HALF * part.spacing
    return x[near][:, [0, 2]], whole.size[near], middle
