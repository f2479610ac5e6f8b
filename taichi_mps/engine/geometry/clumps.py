"""Shapes of grains: rigid clumps of spheres, discs in a plane, as large as a sphere one diameter wide. Plain NumPy."""

import re

import numpy as np

from ...units import require

ALONG, LINES = 7, 6  # spheres along the longest axis of an ellipsoid, and lines of them where the middle one is as long
CELLS = {2: 800, 3: 80}  # along the longest side of a clump, in which volume and inertia are summed: within 0.3 %
ELLIPSOID = re.compile(r"ellipse N:N|ellipsoid N:N:N".replace("N", r"(\d+\.?\d*)"))


def clump_rows(shape) -> np.ndarray:
    """Offset and radius of each sphere of a shape given in words or as these rows (k, d + 1), in any unit; no rows of a
    sphere. SceneError where it is none."""
    wrong = (
        f"grains: shape = {str(shape):.60}: must be 'sphere', 'ellipsoid 2:1:1', in a plane 'ellipse 2:1', or rows of "
        "the offset and the radius of each sphere; ratios from 0.1 to 10, radii above 0"
    )
    if isinstance(shape, str):
        found = ELLIPSOID.fullmatch(shape)
        axes = np.array([float(axis) for axis in found.groups() if axis] if found else [])
        require(shape == "sphere" or (found and axes.min() >= 0.1 and axes.max() <= 10.0), wrong)
        return ellipsoid_rows(axes / axes.max()) if found else np.zeros((0, 0))
    require(len(shape) and np.all(shape[:, -1] > 0.0), wrong)
    return shape


def ellipsoid_rows(axes) -> np.ndarray:
    """The largest spheres in an ellipsoid with these half axes (d,) that touch it at chosen points, as ``clump_rows``:
    their centres lie in the plane of the longer axes, where the normals of the ellipsoid lead."""
    order, a = np.argsort(-axes), np.sort(axes)[::-1]
    lines = LINES if len(a) == 3 and a[1] > a[2] else 1
    disc = np.outer(np.linspace(-1.0, 1.0, ALONG), np.exp(1j * np.pi / LINES * np.arange(lines))).ravel()
    grid = np.stack([disc.real, disc.imag], -1)[:, : len(a) - 1]
    points = np.column_stack([grid, np.sqrt(np.maximum(0.0, 1.0 - (grid**2).sum(1)))])  # on a sphere
    rows = np.zeros((len(grid), len(a) + 1))
    rows[:, order[:-1]] = grid * (a[:-1] - a[-1] ** 2 / a[:-1])
    rows[:, -1] = a[-1] ** 2 * np.linalg.norm(points / a, axis=1)
    return np.unique(np.round(rows, 9) + 0.0, axis=0)  # those that coincide once


def scaled(rows, d: int) -> tuple[np.ndarray, np.ndarray]:
    """Spheres of a clump about its centre of mass, over the diameter of a sphere of its volume, as ``clump_rows``; and
    the moment of inertia of the solid over its mass and the square of the radius of that sphere, (3, 3) [-]."""
    if len(rows) < 2:
        return np.append(np.zeros(d), 0.5)[None], (0.4 if d == 3 else 0.5) * np.eye(3)
    centres, radii = rows[:, :-1], rows[:, -1:]
    low, high = (centres - radii).min(0), (centres + radii).max(0)
    step = (high - low).max() / CELLS[d]
    cells = np.stack(np.meshgrid(*[step * (np.arange(CELLS[d]) - 0.5 * (CELLS[d] - 1))] * d), -1)
    x = 0.5 * (low + high) + cells.reshape(-1, d)
    x = x[np.any([((x - c) ** 2).sum(1) < r * r for c, r in zip(centres, radii, strict=True)], axis=0)]
    radius = (len(x) * step**d / {2: np.pi, 3: 4.0 / 3.0 * np.pi}[d]) ** (1.0 / d)
    y = np.pad((x - x.mean(0)) / radius, ((0, 0), (0, 3 - d)))
    inertia = ((y**2).sum() * np.eye(3) - y.T @ y) / len(y)
    return np.column_stack([centres - x.mean(0), radii]) / (2.0 * radius), inertia


def orientations(d: int, seed: int) -> list[np.ndarray]:
    """Twelve rotations (d, d): a random one, followed by steps of 30 degrees in a plane, else by the rotations of a
    tetrahedron, so that axes have no mean direction."""
    random = np.random.default_rng([seed, d])
    if d == 2:
        turns = np.exp(2j * np.pi * (random.random() + np.arange(12) / 12.0))
        return [np.array([[z.real, -z.imag], [z.imag, z.real]]) for z in turns]
    start, upper = np.linalg.qr(random.normal(size=(3, 3)))
    start *= np.sign(np.diag(upper)) * np.linalg.det(start) * np.sign(np.diag(upper)).prod()
    return [
        np.roll(np.eye(3), k, 0) * sign @ start
        for k in range(3)
        for sign in ((1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1))
    ]
