"""The film of a report, for JSON: surfaces of the body at some times, in few bytes, and the lengths measured on it."""

import base64
import zlib
from itertools import pairwise

import numpy as np

from ..problem.measures import Snapshot, embed
from ..simulation.frame import between
from ..units import SceneError
from ..viz.body import SECTORS, profile
from ..viz.smooth_surface import smooth_surface
from ..viz.stage import dimensions, stage

ROOM = 2_500_000  # bytes of a film before base64, which makes four of three: a page has less than 5 MB
CUBE = 0.8  # side of the cells of a surface over l0
PARTS, ENOUGH = 3, 60  # most that an output is divided into, for a film that does not jerk, and pictures of such a film
FINEST = 4095  # largest code of a position
FASTEST, FLOWING = 127, 128  # largest code of a speed; the bit of what flows


def film(trajectory, scene, history, room: int = ROOM) -> tuple[dict, Snapshot]:
    """The body at the outputs of a run that fit into ``room`` bytes, the first and the last among them, evenly chosen,
    with states in between where there are few; and the computed part at the last output. SceneError where the run has
    no output yet.

    Of each picture its time in ``times`` [s], the number of its points in ``counts`` and that of their ``links``, with
    so many ``corners``: 3 of triangles, 2 of the section of a body of ``sectors`` equal parts around the axis, 0 where
    the points are particles; and ``dimensions``. In base64 of deflated bytes: ``positions`` of the points, each
    coordinate less that of the point before, in 16 bits, low byte first: ``low`` + ``step`` * sum [m]; ``normals``, a
    byte a coordinate; ``colours``: of 8 bits the speed, whose code FASTEST is that of ``fastest`` [m/s], and FLOWING
    added to it of what flows; ``rows`` of the points that are linked, in 32 bits: the first corner less that of the
    link before, the others less the first."""
    outputs = trajectory.times()
    if not len(outputs):
        raise SceneError(f"run = {trajectory.path.parent}: run.h5 holds no output yet")
    (end,) = trajectory.replay(scene=scene, chosen=[len(outputs) - 1])
    last = shape(scene, end.state)
    fitting = max(2, int(room / len(zlib.compress(b"".join(packed(*last, 1.0, *scale([last])).values())))))
    chosen = np.unique(np.linspace(0, len(outputs) - 1, min(len(outputs), fitting)).round().astype(int)).tolist()
    parts = max(1, min(PARTS, min(fitting, ENOUGH) // len(outputs)))
    states = [
        state for frame in divided(trajectory.replay(scene=scene, chosen=chosen), parts) for state in [frame.state]
    ]
    shapes = [shape(scene, state) for state in states]
    low, step = scale(shapes)
    fastest = max(speed.max(initial=0.0) for _, _, speed, _, _ in shapes) or 1.0
    streams = [packed(*one, fastest, low, step) for one in shapes]
    data = {key: b"".join(stream[key] for stream in streams) for key in streams[0]}
    box = stage(scene)[:2]
    return {
        "times": [round(state.time, 6) for state in states],
        "counts": [len(one[0]) for one in shapes],
        "links": [len(one[4]) for one in shapes],
        "corners": [one[4].shape[1] for one in shapes],
        "sectors": SECTORS,
        "low": low.tolist(),
        "step": step.tolist(),
        "fastest": float(fastest),
        "outputs": len(outputs),
        "dimensions": [
            dimensions(scene, at(history, state.time), *box, one[0][:, 0].max(initial=0.0))
            for state, one in zip(states, shapes, strict=True)
        ],
    } | {key: base64.b64encode(zlib.compress(stream)).decode() for key, stream in data.items()}, end.state


def divided(frames, parts: int):
    """Frames, and between each two of them some more, so that there are ``parts`` steps from one to the next."""
    frames = list(frames)
    for earlier, later in pairwise(frames):
        yield earlier
        for k in range(1, parts):
            yield between(earlier, later, earlier.time + k / parts * (later.time - earlier.time))
    yield frames[-1]


def at(history: dict, time: float) -> dict:
    """The columns of history.csv at a time [s]."""
    return {key: float(np.interp(time, history["time_s"], values)) for key, values in history.items()}


def shape(scene, part: Snapshot):
    """The body of which a part is computed: points (k, 3) [m], unit normals (k, 3), speeds (k,) [m/s], what flows (k,)
    and links (m, c), rows of the points."""
    line = profile(scene, part)
    if line is not None:
        s, normals, links = line
    elif scene.dimension == 3:
        s, normals, links = smooth_surface(scene.unfold(part), CUBE, ("u", "shear_rate"))
    else:
        s = scene.unfold(part)
        normals, links = 0.0 * s.x, np.zeros((0, 0), int)
    flows = np.array([material.flows(s.shear_rate) for material in scene.materials])
    return embed(s.x), embed(normals), s.speed, flows[s.mix, np.arange(len(s.mix))], links


def scale(shapes):
    """Lowest coordinates (3,) [m] of all points, and what a code of a position is worth (3,) [m]."""
    low, high = (end([end(one[0], axis=0) for one in shapes if len(one[0])], axis=0) for end in (np.min, np.max))
    return low, np.maximum(high - low, 1e-9) / FINEST


def packed(x, normals, speed, flowing, links, fastest, low, step) -> dict[str, bytes]:
    """Bytes of one picture, see ``film``."""
    codes = np.round((x - low) / step).astype(np.int32)
    links = np.sort(links, axis=1)
    links = links[np.argsort(links[:, 0], kind="stable")] if links.size else links
    rows = np.concatenate([np.diff(links[:, :1], axis=0, prepend=0), links[:, 1:] - links[:, :1]], axis=1)
    return {
        "positions": np.diff(codes.T, axis=1, prepend=0).astype("<i2").tobytes(),
        "normals": np.round(127 * normals.T).astype(np.int8).tobytes(),
        "colours": (
            np.round(FASTEST * speed / fastest).astype(np.uint8) + FLOWING * flowing.astype(np.uint8)
        ).tobytes(),
        "rows": rows.T.astype("<i4").tobytes(),
    }
