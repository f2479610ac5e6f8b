"""What a scene must be to be computed with these numerics: what they can do, room in memory and in 32-bit numbers."""

import numpy as np

from ..geometry.solid import Solid
from ..geometry.walls import Cylinder
from ..units import DENSITY_HINT, HEAVIEST, LIGHTEST, SceneError
from .inlet import FASTEST, buried
from .materials import Bingham
from .numerics import SemiImplicit
from .scene import Scene

MOST_CELLS = 2**27  # of the binning grid: 8 bytes each
MOST_PAIRS = 2**31 - 1  # of neighbours: their numbers are 32-bit


def admit(scene: Scene, numerics) -> None:
    """SceneError, before anything is allocated, if these numerics cannot do what a scene asks for, if its grid or its
    neighbour list would not fit, or a periodic side is too short."""
    able(scene, numerics)
    plausible(scene)
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


def plausible(scene: Scene) -> None:
    """SceneError for what comes of a wrong unit or origin: a density that nothing has where things weigh as on Earth, a
    jet that no hose gives, a solid that nothing can meet."""
    density = [material.density for material in scene.materials]
    earth = 9.0 < float(np.linalg.norm(scene.gravity_vector)) < 11.0
    if earth and not LIGHTEST <= min(density) <= max(density) <= HEAVIEST:
        wrong = min(density) if min(density) < LIGHTEST else max(density)
        raise SceneError(
            f"density = {wrong:g} kg/m3: must be from {LIGHTEST:g} to {HEAVIEST:g} kg/m3 under gravity ({DENSITY_HINT})"
        )
    for inlet in scene.inlets:
        speed, most = inlet.speed(scene.spacing), FASTEST * inlet.layer_volume(scene.spacing) / scene.spacing
        if speed > FASTEST:
            raise SceneError(
                f"inlet: rate = {inlet.rate:g} m3/s: leaves the hose at {speed:.3g} m/s; must be at most {most:.3g} "
                "m3/s (0.012 for 12 l/s)"
            )
        if inlet.start == 0.0 and buried(scene.inlet_layer(inlet), scene.fluid, scene.spacing):
            raise SceneError(
                f"inlet: centre = {point(inlet.centre)} m: lies in the fluid at 0 s; must be clear of it or start later"
            )
    crowded = doubles(scene.initial, 1e-3 * scene.spacing)
    if crowded:
        raise SceneError(f"fluid: {crowded} of {len(scene.initial)} particles lie on others; all must be apart")
    low, high = scene.domain
    for wall in scene.walls:
        depth = 0.0 if wall.thin else -float(np.min(wall.distance(scene.initial)))
        if depth > 0.5 * scene.spacing:
            raise SceneError(
                f"fluid: a particle lies {depth:.3g} m behind a wall ({type(wall).__name__}); all must be in front"
            )
        if not isinstance(wall, Solid) or wall.speed > 0.0:
            continue
        if np.any(np.greater(wall.low, high)) or np.any(np.greater(low, wall.high)):
            raise SceneError(
                f"walls: a solid from {point(wall.low)} to {point(wall.high)} m: must reach into the domain, from "
                f"{point(low)} to {point(high)} m; its origin or its scale is another"
            )


def doubles(x, apart: float) -> int:
    """How many of the points x (n, d) [m] share a cell of this size [m] with another."""
    cells = np.round((x - x.min(0)) / apart).astype(np.int64)
    shape = cells.max(0) + 1
    fits = np.prod(shape.astype(float)) < 2**62
    return len(x) - len(np.unique(np.ravel_multi_index(cells.T, shape)) if fits else np.unique(cells, axis=0))


def point(x) -> str:
    return "(" + ", ".join(f"{value:.4g}" for value in x) + ")"


def able(scene: Scene, numerics) -> None:
    """SceneError for a scene with something that these numerics have not."""
    semi_implicit = isinstance(numerics, SemiImplicit)
    if semi_implicit and not isinstance(scene.material, Bingham):
        raise SceneError(
            f"scene {scene.name}: material {type(scene.material).__name__}: must be Bingham with the scheme "
            "semi-implicit; implicit takes any flow curve"
        )
    if scene.wall_particles is not None and not scene.walls:
        raise SceneError(f"wall_particles: scene {scene.name} has no walls; must also describe them as surfaces")
    re = numerics.effective_radius_ratio * scene.spacing
    for wall in scene.walls:
        if isinstance(wall, Cylinder) and wall.smallest_radius <= re:
            raise SceneError(
                f"radius = {wall.smallest_radius:g} m of a curved wall: must be greater than the effective radius, "
                f"{re:g} m"
            )
    if not semi_implicit and numerics.walls == "surfaces":
        return
    if scene.axisymmetric:
        raise SceneError(f"scene {scene.name} is axisymmetric: must be computed with walls = surfaces, implicit")
    if any(wall.speed > 0.0 or wall.thin for wall in scene.walls):
        raise SceneError(
            f"walls = particles: a wall of scene {scene.name} moves or is thin; must be surfaces, scheme implicit"
        )
    if any(wall.friction for wall in scene.walls):
        raise SceneError(
            f"walls = particles: a wall of scene {scene.name} has friction; must be surfaces, scheme implicit"
        )
    if scene.mirrors:
        raise SceneError(f"walls = particles: scene {scene.name} has a mirror plane; must be surfaces, scheme implicit")
    if scene.inlets:
        raise SceneError(f"scene {scene.name} has an inlet: must be computed with walls = surfaces, implicit")
    if scene.walls and scene.wall_particles is None:
        raise SceneError(f"walls = particles: scene {scene.name} describes its walls as surfaces only")
