"""View volume of pictures of a run, and the walls, the floor, mirror images and dimensions in it. Plain NumPy."""

import numpy as np

from ..engine import Cylinder, Plane, Solid, embed, reflected, still
from ..input.labels import title, written

MIN_DIMENSION = 0.03  # of the longest side of the view volume: shorter lengths get no dimension [-]


def with_mirror_images(scene, line):
    """Polyline (k, d) [m] as (k, 3), with its images behind the mirror planes of the scene and across its axis."""
    line = embed(line)
    lines = [line, line * (-1.0, 1.0, 1.0)] if scene.axisymmetric else [line]
    for plane in scene.mirrors:
        normal, point = embed([plane.normal, plane.point])
        lines += [reflected(other, normal, point) for other in lines]
    return lines


def view_volume(scene):
    """View volume of a run, the body with room to spread up to the walls: low and high corner (3,) [m], and the height
    of its floor [m], None without one."""
    whole, domain = (scene.unfold(still(x, scene.spacing)).x for x in (scene.reach, np.array(scene.domain, float)))
    low, high = whole.min(0) - 0.5 * scene.spacing, whole.max(0) + 0.5 * scene.spacing
    planes = [wall for wall in scene.walls if isinstance(wall, Plane) and not wall.mirror]
    body, domain, touch = (low.copy(), high.copy()), (domain.min(0), domain.max(0)), 0.6 * scene.spacing
    for axis in range(scene.dimension - 1):  # of a plane through the axis, the first alone
        flat = scene.dimension == 2 and not (scene.axisymmetric or scene.inlets)  # which may run as far as it can
        room = np.inf if scene.periodic[axis] or flat else 0.85 * (body[1][-1] - body[0][-1])
        across = [wall for wall in planes if abs(wall.normal[axis]) > 0.99]
        walls = [line[0, axis] for wall in across for line in with_mirror_images(scene, [wall.point])]
        low[axis] = max((w for w in walls if w < low[axis] + touch), default=max(low[axis] - room, domain[0][axis]))
        high[axis] = min((w for w in walls if w > high[axis] - touch), default=min(high[axis] + room, domain[1][axis]))
    if scene.axisymmetric:
        low[1], high[1] = low[0], high[0]
    floors = [w.point[-1] for w in planes if w.normal[-1] > 0.99 and w.point[-1] < low[-1] + touch]
    low[-1] = max(floors, default=low[-1])
    return *embed([low, high]), low[-1] if floors else None


def wall_lines(scene, low, high, time):
    """Walls at a time [s] as polylines (k, 3) [m] in the middle plane of a box from ``low`` to ``high`` (3,) [m],
    mirror images included."""
    (x0, y0, z0), (x1, y1, z1) = low, high
    edges, y = [], 0.5 * (y0 + y1)
    for wall in (wall for wall in scene.walls if np.any(wall.travel) or not len(scene.vessel)):  # others are glass
        if isinstance(wall, Cylinder):
            edges += [circle + wall.displacement(time) for circle in wall.circles]
        elif isinstance(wall, Solid):
            edges += wall.section(y, time)
        elif abs(wall.normal[0]) > 0.99 and not wall.mirror:
            x = wall.point[0] + wall.displacement(time)[0]
            edges.append([(x, y, z0), (x, y, z1)])
        elif wall.normal[-1] < -0.99 and not wall.mirror:
            z = wall.point[-1] + wall.displacement(time)[-1]
            edges.append([(x0, y, z), (x1, y, z)])
    return [line for edge in edges for line in with_mirror_images(scene, edge)]


def lifted_mould_faces(scene, time) -> list[np.ndarray]:
    """Faces (4, 3) [m] of a thin lifted mould at a time [s]."""
    faces = []
    for wall in (wall for wall in scene.walls if isinstance(wall, Cylinder) and wall.thin):
        foot, top = (circle[::2] + wall.displacement(time) for circle in wall.circles)
        faces += list(np.stack([foot[:-1], foot[1:], top[1:], top[:-1]], axis=1))
    return faces


def dimensions(scene, measures, low, high, front) -> list[dict]:
    """Dimensions to draw on a body that reaches to x = ``front`` [m], in a view volume from ``low`` to ``high`` (3,)
    [m]: ends ``a`` and ``b`` (3,) [m] in the plane through the axis or the middle of the width, a ``text``, and y [m]
    of the ``near`` side of the body, below which a horizontal dimension is drawn."""
    least, floor, y = MIN_DIMENSION * np.max(np.subtract(high, low)), low[2], 0.5 * (low[1] + high[1])
    faces = np.concatenate(scene.vessel) if len(scene.vessel) else np.array([low, high])
    begin, end, near = faces[:, 0].min(), faces[:, 0].max(), min(y, max(low[1], faces[:, 1].min()))
    gate = min((x for x in faces[:, 0] if begin < x < end), default=begin)
    lines = {  # ends in the plane, and y of the near side
        "spread_m": lambda d: ((-0.5 * d, 0.0, floor), (0.5 * d, 0.0, floor), -0.5 * d),
        "front_m": lambda d: ((begin, y, floor), (begin + d, y, floor), near),
        "flow_m": lambda d: ((front - d, y, floor), (front, y, floor), near),
        "h1_m": lambda d: ((gate, y, floor), (gate, y, floor + d), near),
        "h2_m": lambda d: ((end, y, floor), (end, y, floor + d), near),
    }
    if scene.mould:
        lines["slump_m"] = lambda d: ((0.0, 0.0, scene.mould.height), (0.0, 0.0, scene.mould.height - d), 0.0)
    found = []
    for key in lines.keys() & {key for key, length in measures.items() if least < length < np.inf}:
        a, b, side = lines[key](measures[key])
        found.append(
            {
                "a": [*map(float, a)],
                "b": [*map(float, b)],
                "near": float(side),
                "text": f"{title(key)} {written(key, measures[key])}",
            }
        )
    return sorted(found, key=lambda one: one["text"])
