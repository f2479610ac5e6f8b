"""Data of the report's drawings for JSON: film of the body, walls around it, curves, the section at the end, and what
is filled of a form."""

import base64
import re
import zlib
from itertools import chain, groupby, pairwise

import numpy as np

from ..engine import Cylinder, Snapshot, embed, frame_between, still
from ..input.labels import in_words, title, unit_of_measure
from ..units import require
from ..viz.body import GRAINS, SECTORS, grains_of, profile, smooth_surface
from ..viz.view_volume import dimensions, view_volume, wall_lines, with_mirror_images
from . import inputs
from .sentences import is_scene_measure

MAX_FILM_BYTES = 2_500_000  # of a film before base64, which adds a third: a page has less than 5 MB
SURFACE_CELL = 0.8  # side of the cells of a surface over l0
MAX_STEPS_BETWEEN, SMOOTH_FILM = 2, 60  # steps from an output to the next, at most; pictures of a film that is smooth
MAX_POSITION_CODE = 4095  # largest code of a position
MAX_SPEED_CODE, FLOWING_BIT = 127, 128  # largest code of a speed; bit of flowing particles
MAX_POINTS = 400  # of a curve
MAX_BEGINNING = 100_000  # particles of a body before it flows, whose surface takes a second
AT_HEIGHT = re.compile(r"(.+)_at_(\d+)mm_Pa")  # a pressure at a height
CORNERS = 12  # of the polygon that is drawn for a particle
ABSENT = -(2**15)  # code of the coordinates of a grain that has not entered yet
GRAIN_BYTES = 6  # of a sphere of a grain in a picture of the film, at most


def drawings(run, film: dict, last: Snapshot) -> dict:
    """Data of all that page.js draws, with those of ``surroundings``."""
    return surroundings(run.scene, film) | {
        "charts": charts(run.history) + profiles(run.summary),
        "section": section(last, run.scene),
        "filling": filling(last, run.scene.cavity),
    }


def surroundings(scene, film: dict, lines=()) -> dict:
    """A film with what stands around its body, its outline and more ``lines``. Lengths [m]; lines as three lists x, y,
    z, with None between two."""
    walls_low, walls_high, floor = view_volume(scene)
    outline = [line for each in (*scene.outline, *lines) for line in with_mirror_images(scene, each)]
    body = np.array(film["low"]) + np.outer((0, MAX_POSITION_CODE), film["step"])
    if film["corners"][-1] == 2:  # the film has the section of the body
        body = body[1, 0] * np.array([(-1.0, -1.0, 0.0), (1.0, 1.0, 0.0)]) + body * (0.0, 0.0, 1.0)
    points = np.vstack([body, *outline, *scene.vessel])
    room = 0.5 * scene.spacing * (film["corners"][-1] == 0)  # where points are the centres of particles
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
        "walls": polyline_coordinates(
            [np.clip(line, low, high) for line in wall_lines(scene, walls_low, walls_high, film["times"][-1])]
        ),
        "outline": polyline_coordinates(outline),
    }


def beginning(scene) -> dict | None:
    """Data of the body before it flows, at a hose its first layer, as a film of one picture with the lengths of the
    vessel or, without one, of the body, and the ends of hoses that move; None for more than MAX_BEGINNING particles."""
    layers = [scene.inlet_layer(inlet) + inlet.displacement(0.0) for inlet in scene.inlets]
    parts = [x for x in (scene.fluid, *layers) if x is not None]
    if sum(map(len, parts)) > MAX_BEGINNING:
        return None
    film = packed_film([surface_geometry(scene, still(np.vstack(parts), scene.spacing))], [0.0], [[]])
    hoses = [inlet for inlet in scene.inlets if inlet.path is not None and inlet.height is None]
    ends = [hose_end(inlet) for inlet in hoses if scene.dimension == 3]
    drawn, told = surroundings(scene, film, chain.from_iterable(ends)), surroundings(scene, film)
    deep = scene.dimension == 3 and not scene.mould  # a diameter is told once
    corners = np.concatenate(scene.vessel) if len(scene.vessel) else np.array([told["low"], told["high"]])
    (x0, y0, z0), (x1, y1, z1) = corners.min(0).tolist(), corners.max(0).tolist()
    drawn["film"]["dimensions"] = [
        [
            {
                "a": a,
                "b": b,
                "near": y0,
                "straight": True,
                "text": inputs.shown(round(float(np.subtract(b, a).sum()), 4), "m"),
            }
            for a, b in (((x0, y0, z0), (x1, y0, z0)), ((x1, y0, z0), (x1, y1, z0)), ((x0, y0, z0), (x0, y0, z1)))
            if a != b and (a[1] == b[1] or deep)
        ]
    ]
    return drawn


def hose_end(inlet) -> list[np.ndarray]:
    """Lines (k, 3) [m] of the end of a hose, as long as it is wide, where it is at first."""
    place, back = tuple(np.add(inlet.centre, inlet.displacement(0.0))), tuple(-inlet.unit_direction)
    rims = Cylinder(place, inlet.radius, axis=back, length=2.0 * inlet.radius).circles
    return [*rims, *np.stack(rims, axis=1)[:-1:18]]


def polyline_coordinates(lines) -> list[list]:
    """Polylines (k, 3) as lists x, y, z."""
    gap = np.full((1, 3), np.nan)
    rows = np.vstack([gap, *(part for line in lines for part in (embed(line), gap))])
    return [rounded(column) for column in rows[1:].T]


# ---- curves ----------------------------------------------------------------------------------------------------
def charts(history: dict) -> list[dict]:
    """Charts over time [s], one for each unit: measures of the scene, then the fraction of the volume that flows, at
    every step."""
    time = history["time_s"]
    kept = np.unique(np.linspace(0, len(time) - 1, MAX_POINTS).round().astype(int))
    curves = {}
    for key, values in history.items():
        if is_scene_measure(key) and np.isfinite(values).any():
            factor, unit, _ = unit_of_measure(key)
            curves.setdefault(unit, []).append(curve(title(key), time[kept], factor * values[kept]))
    curves["%"] = [curve("fraction flowing", time[kept], 100.0 * history["flowing_fraction"][kept])]
    return [{"unit": unit, "curves": some} for unit, some in curves.items()]


def profiles(summary: dict) -> list[dict]:
    """Charts of height [cm]: against the pressure [kPa] that a scene measures at several heights, and against what is
    filled there [%]."""
    layers = np.reshape(summary.get("filled_by_height") or [], (-1, 2))
    filled = [curve("filled", 100.0 * layers[:, 1], 100.0 * layers[:, 0])] if len(layers) else []
    found = [(AT_HEIGHT.fullmatch(key), value) for key, value in summary.items()]
    found = sorted((m[1], float(m[2]), value) for m, value in found if m and value is not None)
    curves = []
    for name, some in groupby(found, key=lambda row: row[0]):
        _, height, pressure = zip(*some, strict=True)
        if len(height) > 1:
            curves.append(curve(in_words(name), 1e-3 * np.array(pressure), 0.1 * np.array(height)))
    return [
        {"unit": "cm", "along": along, "title": "height [cm]", "curves": some}
        for along, some in (("pressure [kPa]", curves), ("filled [%]", filled))
        if some
    ]


def curve(name: str, x, y) -> dict:
    """Curve with a name, rounded for JSON."""
    return {"name": name, "x": rounded(x), "y": rounded(y)}


def rounded(values) -> list:
    """Round values to five digits; None for a value that is not finite."""
    return [float(f"{value:.5g}") if np.isfinite(value) else None for value in values]


# ---- the middle plane at the end -------------------------------------------------------------------------------
def section(part: Snapshot, scene) -> dict:
    """Section at the end, along ``axes``: of a body in space the page draws where its surface meets the upright plane
    y = ``middle`` [m]; a plane one has its particles as polygons, corners ``across`` and ``up`` [m] with None between
    two, and no ``middle``. ``place``: description of what is shown."""
    level = scene.dimension == 2 and not scene.gravity_vector.any()
    axes = ("x [cm]", "y [cm]") if level else ("across [cm]", "height [cm]")
    if scene.dimension == 3 or scene.axisymmetric:
        y = [0.0] if scene.axisymmetric else embed(scene.unfold(still(scene.reach, part.spacing)).x)[:, 1]
        middle = 0.5 * float(np.min(y) + np.max(y))
        return {"axes": axes, "middle": middle, "place": f"the upright plane y = {round(100.0 * middle, 2) + 0.0:g} cm"}
    angle, whole = 2.0 * np.pi * np.arange(CORNERS) / CORNERS, scene.unfold(part)
    corners = whole.x[:, None] + 0.5 * whole.size[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], -1)
    closed = np.concatenate([corners, np.full((len(corners), 1, 2), np.nan)], axis=1).reshape(-1, 2)
    return {
        "across": rounded(closed[:, 0]),
        "up": rounded(closed[:, 1]),
        "axes": axes,
        "place": f"particles{', seen from above' if level else ''}",
    }


def filling(part: Snapshot, cavity) -> dict | None:
    """Filled fraction of a form through its thickness, in the plane of the form itself: ``rows`` of cells from the
    lowest on, None where there is no room, between the corners ``low`` and ``high`` [m]; None without a form."""
    if cavity is None:
        return None
    room, filled = (cells.sum(1) if cells.ndim == 3 else cells for cells in (cavity.cells, cavity.filled(part)))
    fraction = np.where(room > 0, filled / np.maximum(room, 1), np.nan)
    ends = {"low": [cavity.low[0], cavity.low[-1]], "high": [cavity.high[0], cavity.high[-1]]}
    return ends | {"rows": [rounded(row) for row in fraction.T]}


# ---- the film ----------------------------------------------------------------------------------------------------
def film_data(trajectory, scene, history, room: int = MAX_FILM_BYTES) -> tuple[dict, Snapshot]:
    """Film of the body from evenly chosen outputs of a run that fit into ``room`` bytes, including the first and the
    last, with interpolated states in between if there are few; and the computed part at the last output. SceneError if
    the run has no output yet.

    For each picture: its time in ``times`` [s], the number of its points in ``counts`` and of their ``links``, and the
    ``corners`` of a link: 3 for triangles, 2 for the section of a body of ``sectors`` equal parts around the axis, 0 if
    the points are particles; and ``dimensions``. As base64 of deflated bytes: ``positions`` of the points, each
    coordinate less that of the point before, in 16 bits, low byte first: ``low`` + ``step`` * sum [m]; ``normals``, a
    byte a coordinate; ``colours``, a byte each: the speed, whose code MAX_SPEED_CODE stands for ``fastest`` [m/s], plus
    FLOWING_BIT if it flows; ``rows`` of the points that are linked, in 32 bits: the first corner less that of the link
    before, the others less the first. ``grains``: see ``film_of_grains``."""
    outputs = trajectory.times()
    require(len(outputs), f"run = {trajectory.path.parent}: run.h5 holds no output yet")
    (end,) = trajectory.replay(scene=scene, chosen=[len(outputs) - 1])
    last = surface_geometry(scene, end.state)
    picture = len(zlib.compress(b"".join(pack(*last, 1.0, *position_scale([last])).values())))
    spheres = end.state.grain.max(initial=0) * (len(scene.grains.clump(scene.dimension)[0]) if scene.grains else 1)
    fitting = max(2, int(room / (picture + GRAIN_BYTES * spheres)))
    chosen = np.unique(np.linspace(0, len(outputs) - 1, min(len(outputs), fitting)).round().astype(int)).tolist()
    parts = max(1, min(MAX_STEPS_BETWEEN, min(fitting, SMOOTH_FILM) // len(outputs)))
    states = [
        state
        for frame in with_intermediate_frames(trajectory.replay(scene=scene, chosen=chosen), parts)
        for state in [frame.state]
    ]
    box = view_volume(scene)[:2]
    shapes = [surface_geometry(scene, state) for state in states]
    measured = [
        dimensions(scene, at(history, state.time), *box, one[0][:, 0].max(initial=0.0))
        for state, one in zip(states, shapes, strict=True)
    ]
    film = packed_film(shapes, [round(state.time, 6) for state in states], measured)
    grains = film_of_grains(scene, states, film["low"], film["step"]) if scene.grains else None
    return film | {"outputs": len(outputs), "grains": grains}, end.state


def packed_film(shapes, times, measured) -> dict:
    """Film of shapes by ``surface_geometry`` at these times [s], with their dimensions, as ``film_data`` describes
    it."""
    low, step = position_scale(shapes)
    fastest = max(speed.max(initial=0.0) for _, _, speed, _, _ in shapes) or 1.0
    streams = [pack(*one, fastest, low, step) for one in shapes]
    data = {key: b"".join(stream[key] for stream in streams) for key in streams[0]}
    return {
        "times": times,
        "counts": [len(one[0]) for one in shapes],
        "links": [len(one[4]) for one in shapes],
        "corners": [one[4].shape[1] for one in shapes],
        "sectors": SECTORS,
        "low": low.tolist(),
        "step": step.tolist(),
        "fastest": float(fastest),
        "dimensions": measured,
    } | {key: base64.b64encode(zlib.compress(stream)).decode() for key, stream in data.items()}


def film_of_grains(scene, states, low, step) -> dict:
    """Grains: ``sizes`` [mm] and their ``colours``; of each its ``radii`` [m] and the row of its size, ``kinds``;
    ``free``, 1 of an axis along which its way counts; and ``centres`` in each picture as base64 of deflated bytes, in
    16 bits, low byte first: codes of coordinates as in ``film_data``, ABSENT of one that has not entered yet, less
    those of the picture before."""
    shown, there = [grains_of(scene, state) for state in states], [np.unique(state.grain) for state in states]
    codes = np.full((len(states), len(shown[-1][0]), 3), ABSENT)
    for found, (x, *_), numbers in zip(codes, shown, there, strict=True):
        here = np.repeat(np.isin(there[-1], numbers)[there[-1] > 0], len(scene.grains.clump(scene.dimension)[0]))
        found[here] = np.round((embed(x) - low) / step)
    return {
        "sizes": rounded(1e3 * np.sort(scene.grains.diameters)),
        "colours": GRAINS.tolist(),
        "radii": rounded(shown[-1][1]),
        "kinds": shown[-1][2].tolist(),
        "free": rounded(embed(1.0 - np.array([scene.periodic]))[0]),
        "centres": base64.b64encode(zlib.compress(np.diff(codes, axis=0, prepend=0).astype("<i2").tobytes())).decode(),
    }


def with_intermediate_frames(frames, parts: int):
    """Yield frames with interpolated ones in between, so that there are ``parts`` steps from one to the next."""
    frames = list(frames)
    for earlier, later in pairwise(frames):
        yield earlier
        for k in range(1, parts):
            yield frame_between(earlier, later, earlier.time + k / parts * (later.time - earlier.time))
    yield frames[-1]


def at(history: dict, time: float) -> dict:
    """Interpolate the columns of history.csv at a time [s]."""
    return {key: float(np.interp(time, history["time_s"], values)) for key, values in history.items()}


def surface_geometry(scene, part: Snapshot):
    """Geometry of the whole body from its computed part: points (k, 3) [m], unit normals (k, 3), speeds (k,) [m/s],
    whether they flow (k,), and links (m, c), rows of the points."""
    line = profile(scene, part)
    if line is not None:
        s, normals, links = line
    elif scene.dimension == 3:
        s, normals, links = smooth_surface(scene.unfold(part), SURFACE_CELL, ("u", "shear_rate"))
    else:
        s = scene.unfold(part)
        normals, links = 0.0 * s.x, np.zeros((0, 0), int)
    flows = np.array([material.flows(s.shear_rate) for material in scene.materials])
    return embed(s.x), embed(normals), s.speed, flows[s.mix, np.arange(len(s.mix))], links


def position_scale(shapes):
    """Origin (3,) [m] and step (3,) [m] of the integer codes of positions, from all points."""
    low, high = (end([end(one[0], axis=0) for one in shapes if len(one[0])], axis=0) for end in (np.min, np.max))
    return low, np.maximum(high - low, 1e-9) / MAX_POSITION_CODE


def pack(x, normals, speed, flowing, links, fastest, low, step) -> dict[str, bytes]:
    """Pack one picture into bytes as described in ``film_data``."""
    codes = np.round((x - low) / step).astype(np.int32)
    links = np.sort(links, axis=1)
    links = links[np.argsort(links[:, 0], kind="stable")] if links.size else links
    rows = np.concatenate([np.diff(links[:, :1], axis=0, prepend=0), links[:, 1:] - links[:, :1]], axis=1)
    return {
        "positions": np.diff(codes.T, axis=1, prepend=0).astype("<i2").tobytes(),
        "normals": np.round(127 * normals.T).astype(np.int8).tobytes(),
        "colours": (
            np.round(MAX_SPEED_CODE * speed / fastest).astype(np.uint8) + FLOWING_BIT * flowing.astype(np.uint8)
        ).tobytes(),
        "rows": rows.T.astype("<i4").tobytes(),
    }
