"""What a scene must be to be computed with these numerics: room in memory and in 32-bit numbers, and in its periods."""

import numpy as np

from .quantity import SceneError
from .scene import Scene

MOST_CELLS = 2**27  # of the binning grid: 8 bytes each
MOST_PAIRS = 2**31 - 1  # of neighbours: their numbers are 32-bit


def admit(scene: Scene, numerics) -> None:
    """SceneError, before anything is allocated, if the grid or the neighbour list of a scene would not fit, or a
    periodic side is too short."""
    re = numerics.effective_radius_ratio * scene.spacing
    size = np.subtract(scene.domain[1], scene.domain[0])
    sides = np.maximum(1.0, np.floor(size / re))
    if np.prod(sides) > MOST_CELLS:
        raise SceneError(
            f"domain = {' x '.join(f'{s:g}' for s in size)} m: has {np.prod(sides):.2g} cells of the effective radius, "
            f"{re:g} m; at most {MOST_CELLS:.2g}"
        )
    for axis, (periodic, side) in enumerate(zip(scene.periodic_axes, sides, strict=True)):
        if periodic and side < 3:
            raise SceneError(
                f"domain = {size[axis]:g} m along periodic axis {axis}: must be at least three effective radii, "
                f"{3.0 * re:g} m"
            )
    wall = 0 if scene.wall_particles is None else len(scene.wall_particles)
    around = {2: np.pi, 3: 4.0 * np.pi / 3.0}[scene.dimension] * numerics.effective_radius_ratio**scene.dimension
    poured = sum(inlet.volume for inlet in scene.inlets) / scene.spacing**scene.dimension
    particles = len(scene.fluid) + wall + poured
    pairs = 4.0 * around * particles
    if pairs > MOST_PAIRS:
        raise SceneError(
            f"spacing = {scene.spacing:g} m: makes {particles:.6g} particles with up to {pairs:.2g} pairs of "
            f"neighbours; at most {MOST_PAIRS:.2g}"
        )
