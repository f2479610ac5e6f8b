"""Surface of a body for pictures and exports: the mould's at 0 s, a solid of revolution for rings, else the smooth
surface of the particles by pysplashsurf."""

from dataclasses import replace

import numpy as np

from ..engine import SCALARS, Plane, Snapshot
from ..units import require

DENSITY_CELL = 0.5  # side of the cells in which the density of rings is computed, over l0
DEVIATION = 0.6  # standard deviation of the normal distribution of a ring, over l0
REACH = 4  # cells within which a ring counts
# of a line against bending, to find its edges, then to smooth it between them: waves of 8 l0 keep half of their height
STIFFNESS = 100.0, 3000.0
AXIS = 0.4  # radius within which the top of a heap is level, as its slump is read, over that of the mould's top
EDGE = 0.01  # second difference of an edge, over l0: a bend of 3 l0 in radius
SECTORS = 72  # of a solid of revolution
GRAINS = np.array(
    [(0.80, 0.40, 0.18), (0.22, 0.44, 0.66), (0.36, 0.56, 0.30)]
)  # colours of sizes in turn, the smallest first
SURFACE_CELL, MESH_SMOOTHING = 0.3, 15  # side of the cells of a surface over l0; smoothing iterations of its mesh
PICTURE_CELL = 0.6  # cells for pictures, over l0: a fifth of the time, as smooth
LEVEL, PICTURE_LEVEL = 0.6, 0.5  # density of the level set over that of spheres; for pictures, half a spacing outside
BLOCK_CELLS = 32  # cells along the sides of the blocks that are computed one by one; with 64 half as long again
MAX_CELLS = 1e6  # along an axis: their number is a 64-bit integer
FIELDS = ("u", "p", "shear_rate", "yielded", "density_ratio")


def smooth_surface(s: Snapshot, cube: float = SURFACE_CELL, fields=FIELDS) -> tuple[Snapshot, np.ndarray, np.ndarray]:
    """Compute the surface of a whole body in three dimensions: a snapshot of its k vertices, with these fields of the
    particles and their mix interpolated, other fields zero; their outward normals (k, 3), and its triangles (m, 3),
    rows of the vertices. ``cube``: side of its cells over l0.

    It is the level set at LEVEL of the density of spheres of the spacing, with weighted smoothing (Loeschner et al.,
    2023, "Weighted Laplacian smoothing for surface reconstruction of particle-based fluids"). It lies 0.2 to 0.5
    spacings outside of the outermost particles; a particle alone becomes a ball of 1.2 spacings.
    """
    require(s.x.shape[1] == 3, "surface: the scene is a plane one; must have three dimensions")
    import pysplashsurf

    size = np.ptp(s.x, axis=0).max() / (cube * s.spacing) if len(s.x) else 0.0
    require(size < MAX_CELLS, f"surface: the body is {size:.2g} cells long; must be at most {MAX_CELLS:g}")
    exact = cube == SURFACE_CELL
    real = np.float64 if exact else np.float32  # a quarter faster, and fine enough for a picture
    given = {name: np.ascontiguousarray(getattr(s, name), real) for name in fields}
    mixes = np.arange(s.mix.max(initial=0) + 1) if s.mix.any() else ()
    given |= {f"mix {k}": (s.mix == k).astype(real) for k in mixes}
    made, _ = pysplashsurf.reconstruction_pipeline(
        np.ascontiguousarray(s.x, real),
        attributes_to_interpolate=given,
        particle_radius=0.5 * s.spacing,
        smoothing_length=2.0,  # in radii, as the next
        cube_size=2.0 * cube,
        subdomain_num_cubes_per_dim=BLOCK_CELLS,
        iso_surface_threshold=LEVEL if exact else PICTURE_LEVEL,
        mesh_smoothing_iters=MESH_SMOOTHING,
        mesh_cleanup=True,
        compute_normals=True,
        normals_smoothing_iters=None if exact else MESH_SMOOTHING,
    )
    # zero at a point that no particle reaches, and a point that belongs to triangles without area has no normal
    at = {name: np.nan_to_num(np.asarray(values, float)) for name, values in made.point_attributes.items()}
    points = np.asarray(made.mesh.vertices, float)
    zero = np.zeros(len(points))
    whole = {name: at.get(name, 0.0 * points if name == "u" else zero) for name in FIELDS}
    whole["yielded"] = whole["yielded"] > 0.5
    whole["mix"] = np.argmax([at[f"mix {k}"] for k in mixes], axis=0) if len(mixes) else zero.astype(int)
    vertices = replace(s, x=points, size=zero + s.spacing, grain=None, **whole)
    return vertices, at["normals"], np.asarray(made.mesh.triangles).astype(np.int64)


def surface_of(scene, part: Snapshot, cube: float, fields) -> tuple[Snapshot, np.ndarray, np.ndarray]:
    """Compute the surface of the whole body from its computed part: a snapshot of its k vertices with the fields of the
    particles, their outward normals (k, 3), and its triangles (m, 3), rows of the vertices.

    ``cube`` and ``fields`` are passed to ``smooth_surface`` if the body has no ``profile``."""
    line = profile(scene, part)
    if line is None:
        return smooth_surface(scene.unfold(part), cube, fields)
    section, normals, parts = line
    angle, here = 2.0 * np.pi * np.arange(SECTORS) / SECTORS, np.arange(SECTORS)
    rays = np.stack([np.cos(angle), np.sin(angle)], -1)
    x, normals = (np.insert(v[:, None, :1] * rays, 2, v[:, 1:], axis=2).reshape(-1, 3) for v in (section.x, normals))
    (a, b), (c, d) = (parts.T[:, :, None] * SECTORS + np.roll(here, -k) for k in (0, 1))
    return (
        replace(section, x=x, **{name: np.repeat(getattr(section, name), SECTORS, 0) for name in ("u", *SCALARS)}),
        normals,
        np.concatenate([np.stack(corners, -1).reshape(-1, 3) for corners in ((a, b, c), (b, d, c))]),
    )


def grains_of(scene, s: Snapshot) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Grains of a body, or all spheres of their clumps: centres (g, d) [m]; radii (g,) [m] of spheres or discs as large
    as their particles together; rows (g,) of their diameters among those of the scene, the smallest first; and how far
    each grain has come since 0 s (g,) [m], of a hose within it, along axes that are not periodic."""
    rows = np.argsort(s.grain, kind="stable")[np.count_nonzero(s.grain == 0) :]
    there, first, count = np.unique(s.grain[rows], return_index=True, return_counts=True)
    (low, high), periodic = np.array(scene.domain, float), np.array(scene.periodic)

    def centres(x):
        start = x[first]
        arms = x - np.repeat(start, count, axis=0)
        arms -= periodic * (high - low) * np.round(arms / (high - low))  # of a grain on both sides of a period
        middle = np.add.reduceat(arms, first) / count[:, None]
        return start + middle, arms - np.repeat(middle, count, axis=0)

    number, bodies = scene.grain_places[0], [scene.fluid, *(stream.x for stream in scene.streams)]
    at_first = np.argsort(number, kind="stable")[np.count_nonzero(number == 0) :]
    at_first = at_first[np.isin(number[at_first], there)]
    (now, arms), (before, own), d = centres(s.x[rows]), centres(np.vstack(bodies)[at_first]), s.x.shape[1]
    radii = s.spacing * (count / (np.pi if d == 2 else 4.0 / 3.0 * np.pi)) ** (1.0 / d)
    kinds = np.abs(2.0 * radii[:, None] - np.sort(scene.grains.diameters)).argmin(1)
    way = np.linalg.norm((now - before) * ~periodic, axis=1)
    parts = scene.grains.clump(d)[0]
    if len(parts) > 1:  # turned as its particles are
        u, _, v = np.linalg.svd(np.add.reduceat(arms[:, :, None] * own[:, None], first))
        u[:, :, -1] *= np.linalg.det(u @ v)[:, None]
        turned = (u @ v @ scene.grain_places[3][there - 1]) @ parts[:, :d].T  # (g, d, k)
        now = (now[:, None] + 2.0 * radii[:, None, None] * turned.transpose(0, 2, 1)).reshape(-1, d)
        radii, kinds, way = (
            np.outer(2.0 * radii, parts[:, d]).ravel(),
            *(np.repeat(a, len(parts)) for a in (kinds, way)),
        )
    return now, radii, kinds, way


def profile(scene, part: Snapshot) -> tuple[Snapshot, np.ndarray, np.ndarray] | None:
    """Line in (r, z) whose revolution is the surface of the body: a snapshot of its k points (k, 2) with the fields of
    the nearest particles, their outward normals (k, 2), and its segments (m, 2), rows of the points. A heap of rings
    from a mould is as wide as its outermost one, and level around the axis. None for a body without mould and rings."""
    if part.time == 0.0 and scene.mould:
        cone = scene.mould
        corners = np.array([(0.0, 0.0), (cone.base_radius, 0.0), (cone.top_radius, cone.height), (0.0, cone.height)])
        along = np.diff(corners, axis=0)
        normals = np.repeat(np.stack([along[:, 1], -along[:, 0]], -1), 2, axis=0)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        points = np.repeat(corners, 2, axis=0)[1:-1]  # inner corners twice, for sharp edges
        parts, rows = np.arange(len(points)).reshape(-1, 2), np.zeros(len(points), int)
    elif scene.axisymmetric:
        floors = [wall.point[1] for wall in scene.walls if isinstance(wall, Plane) and wall.normal[1] > 0.99]
        fitted = fit_to_mould(scene, part)
        points, normals, parts = contour(fitted, max(floors, default=None))
        if scene.mould:  # smoothing takes off the thin rim, and rings leave a hole at the axis
            points *= ((fitted.x[:, 0] + 0.5 * fitted.size).max() / points[:, 0].max(), 1.0)
            near = points[:, 0] < AXIS * scene.mould.top_radius
            points[near, 1] = points[near, 1].max()
        rows = ((points[:, None] - part.x) ** 2).sum(-1).argmin(1)
    else:
        return None
    return replace(part, x=points, **{name: getattr(part, name)[rows] for name in ("u", *SCALARS)}), normals, parts


def fit_to_mould(scene, part: Snapshot) -> Snapshot:
    """Move rings so that each row of them, when the mould was filled, touches its mantle: without steps of a
    lattice."""
    if not scene.mould:
        return part
    cone, (r, z) = scene.mould, scene.fluid.T
    row, outermost = np.unique(np.round(z / scene.spacing, 3), return_inverse=True)[1], np.zeros(len(r))
    np.maximum.at(outermost, row, r + 0.5 * scene.spacing)
    mantle = cone.base_radius + (cone.top_radius - cone.base_radius) * z / cone.height
    return replace(part, x=part.x + np.stack([r * (mantle / outermost[row] - 1.0), 0.0 * r], -1))


def contour(s: Snapshot, floor):
    """Contour line in (r, z) at which the smoothed density of rings is a half, half a spacing outside of the outermost
    ones, without the steps of their rows: points (k, 2) [m], outward unit normals (k, 2) and segments (m, 2), rows of
    the points."""
    cell, deviation, x, size = DENSITY_CELL * s.spacing, DEVIATION * s.spacing, s.x, s.size
    for axis, plane in ((0, 0.0),) if floor is None else ((0, 0.0), (1, floor)):  # with images behind axis and floor
        near = x[:, axis] < plane + REACH * cell
        image = x[near]
        image[:, axis] = 2.0 * plane - image[:, axis]
        x, size = np.vstack([x, image]), np.append(size, size[near])
    low = np.array([0.0, x[:, 1].min() - REACH * cell if floor is None else floor])
    shape = np.ceil((x.max(0) - low) / cell).astype(int) + REACH + 1
    around = np.stack(np.mgrid[-REACH : REACH + 1, -REACH : REACH + 1], -1).reshape(-1, 2)
    at = np.round((x - low) / cell).astype(int)[:, None] + around
    away = ((low + cell * at - x[:, None]) ** 2).sum(-1) / deviation**2
    here = np.all((at >= 0) & (at < shape), axis=-1)
    node = np.ravel_multi_index(tuple(at[here].T), shape)
    weight = size[:, None] ** 2 / (2.0 * np.pi * deviation**2) * np.exp(-0.5 * away)
    density = np.bincount(node, weight[here], shape.prod())
    nodes = np.arange(shape.prod()).reshape(shape)
    a, b, c, d = (part.ravel() for part in (nodes[:-1, :-1], nodes[1:, :-1], nodes[1:, 1:], nodes[:-1, 1:]))
    triangles = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)])
    inside = density[triangles] > 0.5
    count = inside.sum(1)
    crossed = np.flatnonzero(count % 3)
    lone = np.argmax(inside[crossed] == (count[crossed] == 1)[:, None], axis=1)  # on its side of the line
    corner = triangles[crossed[:, None], (lone[:, None] + [0, 1, 2]) % 3]
    edges = np.sort(np.stack([corner[:, [0, 0]], corner[:, 1:]], -1), axis=-1)  # (m, 2, 2): those that the line crosses
    keys, parts = np.unique(edges @ [nodes.size, 1], return_inverse=True)
    p, q = np.divmod(keys, nodes.size)
    fraction = ((0.5 - density[p]) / (density[q] - density[p]))[:, None]
    place = np.stack(np.unravel_index([p, q], shape), -1)  # (2, k, 2)
    parts = parts.reshape(-1, 2)
    parts[count[crossed] == 2] = parts[count[crossed] == 2, ::-1]  # the body lies on the left of each segment
    points = smooth_line(low + cell * (place[0] + fraction * (place[1] - place[0])), parts, EDGE * s.spacing)
    normals = np.zeros_like(points)
    np.add.at(normals, parts, (points[parts[:, 1]] - points[parts[:, 0]])[:, None, ::-1] * (1.0, -1.0))
    normals[points[:, 0] == 0.0, 0] = 0.0
    return points, normals / np.linalg.norm(normals, axis=1, keepdims=True), parts


def smooth_line(points, parts, edge):
    """Smooth the points (k, 2) of a line in (r, z) with these segments (m, 2): least squares of their displacements
    and, times STIFFNESS, of the second differences along the line, which count less where they exceed ``edge`` [m].
    The line goes on behind the axis as its image; its other ends are held."""
    axis, one = points[:, 0] == 0.0, np.eye(len(points))
    neighbours = 0.0 * one
    np.add.at(neighbours, (parts, parts[:, ::-1]), 0.5)
    ends, weight = neighbours.sum(1) < 1.0, np.ones((len(points), 1))
    neighbours[axis] *= 2.0
    for stiffness in STIFFNESS:
        columns = []
        for column, held in zip(points.T, (ends, ends & ~axis), strict=True):  # a radius is odd about the axis
            second = (neighbours - one) * ~held[:, None]
            stiff = one + stiffness * second.T @ (weight * second)
            columns.append(np.where(held, column, np.linalg.solve(np.where(held[:, None], one, stiff), column)))
        smoothed = np.stack(columns, -1)
        bend = np.linalg.norm(neighbours @ smoothed - smoothed, axis=1) * ~ends
        weight = 1.0 / (1.0 + (bend / edge)[:, None] ** 4)
    return smoothed
