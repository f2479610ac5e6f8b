"""What the page draws, for JSON: the film and what stands around it, the curves, the section at the end."""

import re
from itertools import groupby

import numpy as np

from ..io.history import COLUMNS
from ..problem.labels import in_words, is_measure, title, unit_of_measure
from ..problem.measures import embed
from ..viz.stage import images, stage, wall_lines
from .film import Film
from .section import numbers, section
from .told import Told

MOST_POINTS = 400  # of a curve
FLOWING = "flowing_fraction"
SHOWN = "slump_m", "spread_m"  # of the columns that every history has
AT_HEIGHT = re.compile(r"(.+)_at_(\d+)mm_Pa")  # a pressure at a height
MARGIN = 0.03  # around what is shown, over its longest side


def drawings(run: Told, film: Film) -> dict:
    """All that page.js draws. Lengths [m]; of lines three lists x, y, z with None between two of them."""
    scene, walls_low, walls_high, floor = run.scene, *stage(run.scene)
    walls = wall_lines(scene, walls_low, walls_high, float(film.times[-1]))
    outline = [line for each in scene.outline for line in images(scene, each)]
    low, high = box(film, outline, floor)
    return {
        "film": film.facts(),
        "size": scene.spacing * film.share ** (-1.0 / scene.dimension),
        "dimension": 3 if scene.axisymmetric else scene.dimension,
        "low": low.tolist(),
        "high": high.tolist(),
        "unit": float((high - low).max()),
        "floor": floor,
        "walls": joined([np.clip(line, low, high) for line in walls]),
        "outline": joined(outline),
        "charts": charts(run.history) + profiles(run.summary),
        "section": section(film.last, scene),
    }


def box(film: Film, outline, floor):
    """Low and high corner [m] (3,) of what is shown: the body at all times, the outline and the floor below it."""
    points = np.vstack([film.low, film.high, *outline])
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


def charts(history: dict) -> list[dict]:
    """Curves over time [s], those of one unit together: measures of the scene, then the share of the volume that flows,
    at every step."""
    time, keys = history["time_s"], [key for key in history if key in SHOWN or key not in COLUMNS]
    kept = np.unique(np.linspace(0, len(time) - 1, MOST_POINTS).round().astype(int))
    found = [
        (unit_of_measure(key)[1], title(key), time[kept], unit_of_measure(key)[0] * history[key][kept])
        for key in keys
        if is_measure(key) and np.isfinite(history[key]).any()
    ]
    found = sorted(found, key=lambda curve: [unit for unit, *_ in found].index(curve[0]))
    if FLOWING in history and np.isfinite(history[FLOWING]).any():  # earlier runs have none
        found.append(("%", "share flowing", time[kept], 100.0 * history[FLOWING][kept]))
    return [
        {"unit": unit, "curves": [{"name": name, "x": five(at), "y": five(values)} for _, name, at, values in some]}
        for unit, some in groupby(found, key=lambda curve: curve[0])
    ]


def profiles(summary: dict) -> list[dict]:
    """What a scene measures of pressures at several heights, in one chart: height [cm] against pressure [kPa]."""
    found = [(AT_HEIGHT.fullmatch(key), value) for key, value in summary.items()]
    found = sorted((m[1], float(m[2]), value) for m, value in found if m and value is not None)
    curves = []
    for name, some in groupby(found, key=lambda row: row[0]):
        _, height, pressure = zip(*some, strict=True)
        if len(height) > 1:
            curves.append(
                {"name": in_words(name), "x": five(1e-3 * np.array(pressure)), "y": five(0.1 * np.array(height))}
            )
    return [{"unit": "cm", "along": "pressure [kPa]", "title": "height [cm]", "curves": curves}] if curves else []


def five(values) -> list:
    """Rounded to five digits, None for what is no number."""
    return [float(f"{value:.5g}") if np.isfinite(value) else None for value in values]
