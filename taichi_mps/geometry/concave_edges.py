"""The faces that meet at the inner edges of a sampled solid, from its distances alone. Plain NumPy.

A signed distance knows the nearest face. In front of an inner edge it has a crease, where another face becomes the
nearest one. Beside a crease the other faces are sought at places near it, where they are the nearest, and
extended to here as planes.
"""

import itertools

import numpy as np

CREASE, SHORT = 0.15, 0.97  # there the slope falls by this much over a node, and the gradient is this short [-]
BEND = 0.1  # change of the slope [-] from which on a node is not clearly in front of one face
TURN = 0.8  # cosine of the angle between the normals of two faces up to which they are two
BEYOND = 0.15  # reaches behind the other face at which a foot is beyond the edge
NODES = 500_000  # treated at once, and a rim around them


def inner_edges(values, cell: float, reach: float, faces_at):
    """Faces within ``reach`` [m] of the nodes beside inner edges, from distances [m] at the nodes of a grid, positive
    in the fluid. Returns for each node its row in the table, -1 where the nearest face is all, and the table (rows,
    faces, 1 + d): distance [m] and normal of each face at the node; where there are fewer faces the distance is
    infinite. ``faces_at`` is the search (boundaries/sampled.py)."""
    values = np.asarray(values, float)
    d, steps = values.ndim, probes(values.ndim, reach / cell)
    halo = max(int(np.abs(steps).max(initial=0)), int(np.ceil(0.75 * reach / cell))) + 2
    number, tables = np.full(values.shape, -1, np.int32), [np.zeros((0, d, 1 + d))]
    across = max(1, int(NODES / np.prod(values.shape[1:])))
    for first in range(0, len(values), across):  # slabs, for the sake of memory
        low, high = max(0, first - halo), min(len(values), first + across + halo)
        nodes, table = several_faces(faces_at, values[low:high], cell, reach, steps, first - low, first + across - low)
        number[tuple((nodes + low * np.eye(1, d, dtype=int)).T)] = sum(map(len, tables)) + np.arange(len(nodes))
        tables.append(table)
    table = np.concatenate(tables)
    most = int(np.isfinite(table[..., 0]).sum(1).max(initial=1))
    return number, table[:, :most]


def several_faces(faces_at, values, cell, reach, steps, first, last):
    """Nodes (n, d) from ``first`` to before ``last`` along the first axis that have several faces, and their table (n,
    d, 1 + d)."""
    d, shape = values.ndim, values.shape
    front = values > 0.0
    clean, crease = front.copy(), np.zeros(shape, bool)
    for axis in range(d):
        bend = np.diff(values, 2, axis=axis) / cell
        inner = tuple(slice(1, -1) if a == axis else slice(None) for a in range(d))
        clean[inner] &= np.abs(bend) < BEND
        crease[inner] |= bend < -CREASE
    crease &= front & (values < reach + cell)
    if not crease.any():
        return np.zeros((0, d), int), np.zeros((0, d, 1 + d))
    normal = np.stack(np.gradient(values, cell), -1)
    size = np.linalg.norm(normal, axis=-1)
    clean &= np.abs(size - 1.0) < 0.01
    crease &= size < SHORT
    near = spread(crease, int(np.ceil(0.75 * reach / cell)))
    near &= front & (values < reach + d**0.5 * cell)
    near[:first], near[last:] = False, False
    nodes = np.argwhere(near)
    normal /= np.maximum(size, 1e-9)[..., None]
    table = faces_at(values, cell, normal, clean, nodes, steps, reach)
    several = np.isfinite(table[:, 1, 0])
    return nodes[several], table[several]


def spread(where, width):
    """Mark the nodes within ``width`` nodes along each axis of a node that is True in ``where``."""
    for axis in range(where.ndim):
        room = [(width * (a == axis),) * 2 for a in range(where.ndim)]
        windows = np.lib.stride_tricks.sliding_window_view(np.pad(where, room), 2 * width + 1, axis)
        where = windows.any(axis=-1)
    return where


def probes(d, reach):
    """Steps in nodes (k, d) to places around a node, in all diagonal directions and from one node to 1.2 times the
    reach."""
    directions = np.array([step for step in itertools.product((-1, 0, 1), repeat=d) if any(step)], float)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    sizes = 1.2 * reach * 0.7 ** np.arange(12)
    steps = np.rint(sizes[sizes > 0.9, None, None] * directions).astype(int).reshape(-1, d)
    return np.unique(steps, axis=0)


def interpolate(values, at):
    """Distance [m] at places (n, d) in nodes, linear between nodes; infinite beyond the grid."""
    last = np.array(values.shape) - 1
    k = np.clip(np.floor(at).astype(int), 0, last - 1)
    f = at - k
    z = np.zeros(len(at))
    for corner in np.ndindex(*(2,) * values.ndim):
        z += np.prod(np.where(corner, f, 1.0 - f), axis=1) * values[tuple((k + corner).T)]
    return np.where(np.all((at >= 0.0) & (at <= last), axis=1), z, np.inf)
