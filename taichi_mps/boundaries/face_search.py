"""The faces in front of which the nodes of a sampled solid stand, sought around each node (concave_edges.py)."""

import numpy as np

from ..geometry.concave_edges import BEYOND, TURN
from ..runtime.backend import ti

SAME = 1e-9  # cells: a foot is not nearer by less


def search_faces(values, cell, normal, clean, nodes, steps, reach) -> np.ndarray:
    """Table (n, d, 1 + d) as of inner_edges for nodes (n, d) of a grid with these ``values`` [m] every ``cell`` [m]:
    each face is that of a ``clean`` node one of the ``steps`` (k, d) away, which stands in front of one face, of this
    ``normal``."""
    d = values.ndim
    table = np.zeros((len(nodes), d, 1 + d))
    table[:, :, 0] = np.inf
    grid = np.ascontiguousarray(values).reshape(-1), normal.reshape(-1, d), clean.reshape(-1).astype(np.int32)
    places = (np.ascontiguousarray(part, dtype=np.int32) for part in (nodes, np.vstack([np.zeros((1, d)), steps])))
    _search(d, *grid, *places, table, ti.Vector([*values.shape, 1][:3]), cell, reach)
    return table


@ti.kernel
def _search(
    d: ti.template(),
    values: ti.types.ndarray(ti.f64, 1),
    normals: ti.types.ndarray(ti.f64, 2),
    clean: ti.types.ndarray(ti.i32, 1),
    nodes: ti.types.ndarray(ti.i32, 2),
    steps: ti.types.ndarray(ti.i32, 2),
    table: ti.types.ndarray(ti.f64, 3),
    shape: ti.types.vector(3, ti.i32),
    cell: ti.f64,
    reach: ti.f64,
):
    for i in range(nodes.shape[0]):
        grid = ti.Vector([shape[a] for a in ti.static(range(d))])
        node = ti.Vector([nodes[i, a] for a in ti.static(range(d))])
        normal, foot = ti.Matrix.zero(ti.f64, d, d), ti.Matrix.zero(ti.f64, d, d)  # of each face, foot from here
        seeks = True
        for face in ti.static(range(d)):
            best = ti.cast(np.inf, ti.f64)  # of a face, the foot that is nearest along it
            for s in range(steps.shape[0]):
                if not seeks or best <= SAME * cell:
                    break
                step = ti.Vector([steps[s, a] for a in ti.static(range(d))])
                at = number(node + step, grid)
                if at >= 0 and clean[at] == 1:
                    m = ti.Vector([normals[at, a] for a in ti.static(range(d))])
                    way = step * cell
                    along = m.dot(way)
                    distance = values[at] - along  # of the node from that face
                    # of the foot of the place from that of the node, along the face
                    aside = ti.sqrt(ti.max(0.0, way.norm_sqr() - along**2))
                    p = way - values[at] * m  # foot of that place, from the node
                    sought = distance > -cell and distance < reach + d**0.5 * cell and aside < best - SAME * cell
                    for other in ti.static(range(face)):
                        n = ti.Vector([normal[other, a] for a in ti.static(range(d))])
                        apart = p - ti.Vector([foot[other, a] for a in ti.static(range(d))])
                        # of an inner edge: across an outer one they turn away from each other
                        facing = (n - m).dot(apart) > 0.4 * apart.norm()
                        sought = sought and m.dot(n) < TURN and facing
                    if sought:
                        depth = interpolate(values, grid, node - distance * m / cell)
                        if depth < 0.25 * cell and depth > -BEYOND * reach:  # it is there, or ends at the edge
                            best, table[i, face, 0] = aside, distance
                            for a in ti.static(range(d)):
                                normal[face, a], foot[face, a], table[i, face, 1 + a] = m[a], p[a], m[a]
            seeks = seeks and (face == 0 or best < np.inf)  # without a second face there is no third one


@ti.func
def number(place, grid):
    """Number of the node at a place, -1 beyond the grid."""
    number = 0
    for a in ti.static(range(place.n)):
        number = number * grid[a] + place[a]
    return ti.select((place >= 0).all() and (place < grid).all(), number, -1)


@ti.func
def interpolate(values: ti.template(), grid, at):
    """Distance [m] at a place in nodes, linear between nodes; infinite beyond the grid."""
    first, z = ti.min(ti.cast(ti.floor(at), ti.i32), grid - 2), ti.cast(np.inf, ti.f64)
    if (at >= 0.0).all() and (at <= grid - 1).all():
        z = 0.0
        for corner in ti.static(ti.ndrange(*((2,) * at.n))):
            part = ti.cast(1.0, ti.f64)
            for a in ti.static(range(at.n)):
                part *= at[a] - first[a] if corner[a] else 1.0 + first[a] - at[a]
            z += part * values[number(first + ti.Vector(corner), grid)]
    return z
