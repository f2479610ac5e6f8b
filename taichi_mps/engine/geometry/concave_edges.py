"""Faces that meet at the concave edges of a sampled solid, found from its signed distance alone. Plain NumPy.

A signed distance belongs to the nearest face. In front of a concave edge it has a crease, where another face becomes
the nearest one. For nodes beside a crease the other faces are sought at nodes nearby, where they are the nearest, and
extended to the node as planes.
"""

import itertools

import numpy as np

# fall of the slope over a node, and length of the gradient, from and up to which a node is at a crease [-]
MIN_BEND_AT_CREASE, MAX_GRADIENT_AT_CREASE = 0.15, 0.97
MAX_BEND_AT_FACE = 0.1  # change of the slope over a node from which on it is not clearly in front of one face [-]
MAX_COSINE = 0.8  # cosine of the angle between the normals of two faces up to which they are different faces [-]
EDGE_MARGIN = 0.15  # depth behind the other face, over ``max_distance``, at which a foot lies beyond the edge [-]
NODES_PER_SLAB = 500_000  # nodes searched at a time, without the margin around them


def find_concave_edges(values, cell: float, max_distance: float, search):
    """Find the faces within ``max_distance`` [m] of the nodes beside concave edges, from distances ``values`` [m] at
    the nodes of a grid, positive in the fluid. Returns for each node its row in the table, -1 where there is the
    nearest face only, and the table (rows, faces, 1 + d): distance [m] and normal of each face at the node; an infinite
    distance fills rows of fewer faces. ``search`` is ``boundaries.sampled.search_faces``."""
    values = np.asarray(values, float)
    d, steps = values.ndim, search_offsets(values.ndim, max_distance / cell)
    margin = max(int(np.abs(steps).max(initial=0)), int(np.ceil(0.75 * max_distance / cell))) + 2
    number, tables = np.full(values.shape, -1, np.int32), [np.zeros((0, d, 1 + d))]
    across = max(1, int(NODES_PER_SLAB / np.prod(values.shape[1:])))
    for first in range(0, len(values), across):  # slabs, for the sake of memory
        low, high = max(0, first - margin), min(len(values), first + across + margin)
        nodes, table = nodes_with_several_faces(
            search, values[low:high], cell, max_distance, steps, first - low, first + across - low
        )
        number[tuple((nodes + low * np.eye(1, d, dtype=int)).T)] = sum(map(len, tables)) + np.arange(len(nodes))
        tables.append(table)
    table = np.concatenate(tables)
    return number, table[:, : int(np.isfinite(table[..., 0]).sum(1).max(initial=1))]


def nodes_with_several_faces(search, values, cell, max_distance, steps, first, last):
    """Nodes (n, d) with several faces, whose first index is from ``first`` to before ``last``, and their table (n, d, 1
    + d) as in ``find_concave_edges``."""
    d, shape = values.ndim, values.shape
    in_fluid = values > 0.0
    single_face, crease = in_fluid.copy(), np.zeros(shape, bool)
    for axis in range(d):
        bend = np.diff(values, 2, axis=axis) / cell
        inner = tuple(slice(1, -1) if a == axis else slice(None) for a in range(d))
        single_face[inner] &= np.abs(bend) < MAX_BEND_AT_FACE
        crease[inner] |= bend < -MIN_BEND_AT_CREASE
    crease &= in_fluid & (values < max_distance + cell)
    if not crease.any():
        return np.zeros((0, d), int), np.zeros((0, d, 1 + d))
    normal = np.stack(np.gradient(values, cell), -1)
    size = np.linalg.norm(normal, axis=-1)
    single_face &= np.abs(size - 1.0) < 0.01
    crease &= size < MAX_GRADIENT_AT_CREASE
    candidates = dilate(crease, int(np.ceil(0.75 * max_distance / cell)))
    candidates &= in_fluid & (values < max_distance + d**0.5 * cell)
    candidates[:first], candidates[last:] = False, False
    nodes = np.argwhere(candidates)
    normal /= np.maximum(size, 1e-9)[..., None]
    table = search(values, cell, normal, single_face, nodes, steps, max_distance)
    several = np.isfinite(table[:, 1, 0])
    return nodes[several], table[several]


def dilate(where, width):
    """Dilate a mask: mark the nodes within ``width`` nodes along each axis of a node that is True in ``where``."""
    for axis in range(where.ndim):
        room = [(width * (a == axis),) * 2 for a in range(where.ndim)]
        where = np.lib.stride_tricks.sliding_window_view(np.pad(where, room), 2 * width + 1, axis).any(axis=-1)
    return where


def search_offsets(d, max_distance):
    """Offsets (k, d) in nodes to the places around a node that are searched: in all axial and diagonal directions, from
    one node to 1.2 times ``max_distance``, in nodes."""
    directions = np.array([step for step in itertools.product((-1, 0, 1), repeat=d) if any(step)], float)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    sizes = 1.2 * max_distance * 0.7 ** np.arange(12)
    return np.unique(np.rint(sizes[sizes > 0.9, None, None] * directions).astype(int).reshape(-1, d), axis=0)


def interpolate(values, at):
    """Interpolate a distance [m] linearly at places (n, d) in nodes; infinite beyond the grid."""
    last = np.array(values.shape) - 1
    k = np.clip(np.floor(at).astype(int), 0, last - 1)
    f = at - k
    z = sum(
        np.prod(np.where(corner, f, 1.0 - f), axis=1) * values[tuple((k + corner).T)]
        for corner in np.ndindex(*(2,) * values.ndim)
    )
    return np.where(np.all((at >= 0.0) & (at <= last), axis=1), z, np.inf)
