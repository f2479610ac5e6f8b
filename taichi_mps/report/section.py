"""The middle plane of the body at the end, its particles as the shapes that they have."""

from dataclasses import replace

import numpy as np

from ..problem.measures import Snapshot, embed, still, surface

HALF = 0.75  # of a particle size, on either side of the plane: what lies there is shown
CORNERS = 12  # of the polygon that is drawn for a particle


def section(part: Snapshot, scene) -> dict:
    """Particles in the middle plane and the surface above them, of the computed part of a body, for JSON.

    ``across`` and ``up`` [m] are corners of polygons, None between two; ``surface``: two lists, across and up [m];
    ``place``: which plane, in words."""
    x, size, place = in_the_middle(part, scene)
    angle = 2.0 * np.pi * np.arange(CORNERS) / CORNERS
    corners = x[:, None] + 0.5 * size[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], -1)
    closed = np.concatenate([corners, np.full((len(x), 1, 2), np.nan)], axis=1).reshape(-1, 2)
    ticks = np.arange(x[:, 0].min(), x[:, 0].max() + 1e-12, 0.5 * part.spacing)
    heights = surface(replace(still(x, part.spacing), size=size), ticks[:, None])
    return {
        "across": numbers(closed[:, 0]),
        "up": numbers(closed[:, 1]),
        "surface": [numbers(ticks), numbers(heights)],
        "place": place,
    }


def in_the_middle(part: Snapshot, scene):
    """Positions (n, 2) [m] near the middle plane, their sizes (n,) [m], and which plane it is."""
    if scene.axisymmetric:
        x, size = np.vstack([part.x, part.x * (-1.0, 1.0)]), np.tile(part.size, 2)
        return x, size, "through the axis"
    if scene.dimension == 2:
        return part.x, part.size, "the computed plane"
    whole = scene.unfold(part)
    x = embed(whole.x)
    start = scene.unfold(still(scene.reach, part.spacing)).x
    middle = 0.5 * (start[:, 1].min() + start[:, 1].max())
    upright = [mirror.point[1] for mirror in scene.mirrors if abs(mirror.normal[1]) > 0.99]
    middle = upright[0] if upright else middle
    near = np.abs(x[:, 1] - middle) < HALF * part.spacing
    where = f"y = {round(100.0 * middle, 2) + 0.0:g} cm"
    return x[near][:, [0, 2]], whole.size[near], f"particles near the upright plane {where}"


def numbers(values) -> list:
    """Rounded to a hundredth of a millimetre, None for what is no number."""
    return [None if np.isnan(value) else round(float(value), 5) for value in values]
