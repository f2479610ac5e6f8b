"""The rules that a scene with its numerics must obey: what the scheme can compute, and numbers that make sense.

Each rule takes a ``Problem`` and returns what is wrong in one line, or None. ``problem.Problem`` applies RULES in their
order when it is made. Nothing has been allocated then. The rules of the scene alone are in ``scene_rules``.
"""

import inspect
from itertools import product

import numpy as np

from ..geometry.solid import Solid
from ..geometry.walls import Cylinder
from ..units import DENSITY_HINT, HEAVIEST, LIGHTEST
from .inlet import FASTEST, buried
from .materials import Bingham
from .numerics import Implicit, SemiImplicit
from .scene import Scene
from .scene_rules import counted

MOST_CELLS = 2**27  # of the binning grid: 8 bytes each
MOST_PAIRS = 2**31 - 1  # of neighbours: their numbers are 32-bit
EARTH = 9.0, 11.0  # gravity [m/s2] between which the density must be that of a mix


def is_a_scene(problem):
    if not isinstance(problem.scene, Scene):
        return f"scene = {str(problem.scene)[:60]}: must be a Scene, such as slump_cone(...)"


def has_numerics(problem):
    if not isinstance(problem.numerics, Implicit | SemiImplicit):
        return f"numerics = {str(problem.numerics)[:60]}: must be Implicit(...) or SemiImplicit(...)"


# ---- what the scheme can compute -----------------------------------------------------------------------------------
def internal_friction_is_implicit(problem):
    angles = [getattr(material, "friction_angle", 0.0) for material in problem.materials]
    if problem.scheme == "semi-implicit" and any(angles):
        return f"friction_angle = {max(angles):g} deg: the scheme semi-implicit has none; must be 0, or scheme implicit"


def flow_curve_is_implicit(problem):
    scene = problem.scene
    if problem.scheme == "semi-implicit" and not isinstance(scene.material, Bingham):
        return (
            f"scene {scene.name}: material {type(scene.material).__name__}: must be Bingham with the scheme "
            "semi-implicit; implicit takes any flow curve"
        )


def own_laws_take_rate_and_structure(problem):
    for material, key in product(problem.materials, ("shear_stress", "growth")):
        function = getattr(material, key, None)
        try:
            inspect.signature(function).bind(0.0, 0.0)
        except TypeError as error:
            if callable(function):
                return (
                    f"material: {key}{inspect.signature(function)}: must take two numbers, (rate, structure); {error}"
                )
        except ValueError:  # of no function in Python is a signature known
            pass


def wall_loads_need_surfaces(problem):
    if problem.wall_loads and problem.numerics.walls == "particles":
        return (
            f"wall_loads = True: scheme {problem.scheme} with walls = particles has no surface to measure on; must be "
            "scheme implicit with walls = surfaces"
        )


def wall_particles_have_surfaces(problem):
    if problem.scene.wall_particles is not None and not problem.scene.walls:
        return f"wall_particles: scene {problem.scene.name} has no walls; must also describe them as surfaces"


def curved_walls_are_wide(problem):
    """A wall that bends away within the neighbourhood of a particle is no wall to it."""
    for wall in problem.scene.walls:
        if isinstance(wall, Cylinder) and wall.smallest_radius <= problem.effective_radius:
            return (
                f"radius = {wall.smallest_radius:g} m of a curved wall: must be greater than the effective radius, "
                f"{problem.effective_radius:g} m"
            )


def needs_no_surfaces(problem):
    """With walls of particles there are no rings, no motion, slip or friction of a wall, no mirrors and no inlets."""
    scene = problem.scene
    if problem.numerics.walls == "surfaces":
        return None
    if scene.axisymmetric:
        return f"scene {scene.name} is axisymmetric: must be computed with walls = surfaces, implicit"
    if any(wall.speed > 0.0 or wall.thin for wall in scene.walls):
        return f"walls = particles: a wall of scene {scene.name} moves or is thin; must be surfaces, scheme implicit"
    if any(wall.friction for wall in scene.walls):
        return f"walls = particles: a wall of scene {scene.name} has friction; must be surfaces, scheme implicit"
    if scene.mirrors:
        return f"walls = particles: scene {scene.name} has a mirror plane; must be surfaces, scheme implicit"
    if scene.inlets:
        return f"scene {scene.name} has an inlet: must be computed with walls = surfaces, implicit"
    if scene.walls and scene.wall_particles is None:
        return f"walls = particles: scene {scene.name} describes its walls as surfaces only"


# ---- wrong units and origins ---------------------------------------------------------------------------------------
def density_is_plausible(problem):
    """Where things weigh as on Earth nothing is lighter or heavier; numbers without dimension may be."""
    density = [material.density for material in problem.materials]
    earth = EARTH[0] < float(np.linalg.norm(problem.scene.gravity_vector)) < EARTH[1]
    if earth and not LIGHTEST <= min(density) <= max(density) <= HEAVIEST:
        wrong = min(density) if min(density) < LIGHTEST else max(density)
        return (
            f"density = {wrong:g} kg/m3: must be from {LIGHTEST:g} to {HEAVIEST:g} kg/m3 under gravity ({DENSITY_HINT})"
        )


def jet_is_plausible(problem):
    """No pump is so fast: the rate has another unit."""
    spacing = problem.scene.spacing
    for inlet in problem.scene.inlets:
        speed, most = inlet.speed(spacing), FASTEST * inlet.layer_volume(spacing) / spacing
        if speed > FASTEST:
            return (
                f"inlet: rate = {inlet.rate:g} m3/s: leaves the hose at {speed:.3g} m/s; must be at most {most:.3g} "
                "m3/s (0.012 for 12 l/s)"
            )
        nozzle = float(np.linalg.norm(inlet.fastest(spacing)))
        if nozzle > FASTEST:
            return f"inlet: path: moves with the jet at {nozzle:.3g} m/s; must be at most {FASTEST:g} m/s"


def inlet_is_clear(problem):
    scene = problem.scene
    for inlet in scene.inlets:
        first = scene.inlet_layer(inlet) + inlet.displacement(0.0)
        if inlet.start == 0.0 and buried(first, scene.fluid, scene.spacing):
            return (
                f"inlet: centre = {point(inlet.centre)} m: lies in the fluid at 0 s; must be clear of it or start later"
            )


def particles_are_apart(problem):
    scene, x = problem.scene, problem.scene.initial
    low, size = np.array(scene.domain[0], float), extent(problem)
    images = np.where(scene.periodic_axes, low + np.mod(x - low, size), x)  # what lies on both ends lies there twice
    crowded = doubles(images, 1e-3 * scene.spacing)
    if crowded:
        return f"fluid: {crowded} of {len(x)} particles lie on others; all must be apart"


def fluid_is_in_front_of_walls(problem):
    scene = problem.scene
    for wall in scene.walls:
        depth = 0.0 if wall.thin else -float(np.min(wall.distance(scene.initial)))
        if depth > 0.5 * scene.spacing:
            return f"fluid: a particle lies {depth:.3g} m behind a wall ({type(wall).__name__}); all must be in front"


def solids_reach_into_the_domain(problem):
    low, high = problem.scene.domain
    for wall in problem.scene.walls:
        if not isinstance(wall, Solid) or wall.speed > 0.0:
            continue
        if np.any(np.greater(wall.low, high)) or np.any(np.greater(low, wall.high)):
            return (
                f"walls: a solid from {point(wall.low)} to {point(wall.high)} m: must reach into the domain, from "
                f"{point(low)} to {point(high)} m; its origin or its scale is another"
            )


# ---- sizes ---------------------------------------------------------------------------------------------------------
def grid_fits(problem):
    """The binning grid has to fit into memory."""
    cells = np.prod(sides(problem))
    if cells > MOST_CELLS:
        return (
            f"domain = {' x '.join(f'{s:g}' for s in extent(problem))} m: has {cells:.2g} cells of the effective "
            f"radius, {problem.effective_radius:g} m; at most {MOST_CELLS:.2g}"
        )


def periods_are_long(problem):
    """Along a periodic axis a particle must not meet the same neighbour on both sides."""
    along = zip(problem.scene.periodic_axes, extent(problem), sides(problem), strict=True)
    for axis, (periodic, size, cells) in enumerate(along):
        if periodic and cells < 3:
            return (
                f"domain = {size:g} m along periodic axis {axis}: must be at least three effective radii, "
                f"{3.0 * problem.effective_radius:g} m"
            )


def pairs_can_be_counted(problem):
    scene, ratio = problem.scene, problem.numerics.effective_radius_ratio
    wall = 0 if scene.wall_particles is None else len(scene.wall_particles)
    neighbours = {2: np.pi, 3: 4.0 * np.pi / 3.0}[scene.dimension] * ratio**scene.dimension
    poured = sum(inlet.volume for inlet in scene.inlets) / scene.spacing**scene.dimension
    particles = len(scene.fluid) + wall + poured
    pairs = 4.0 * neighbours * particles  # the list has room for bodies pressed together and for rings
    if pairs > MOST_PAIRS:
        return (
            f"spacing = {scene.spacing:g} m: makes {particles:.6g} particles with up to {pairs:.2g} pairs of "
            f"neighbours; at most {MOST_PAIRS:.2g}"
        )


RULES = (
    is_a_scene,
    has_numerics,
    flow_curve_is_implicit,
    internal_friction_is_implicit,
    own_laws_take_rate_and_structure,
    wall_loads_need_surfaces,
    wall_particles_have_surfaces,
    curved_walls_are_wide,
    needs_no_surfaces,
    density_is_plausible,
    jet_is_plausible,
    inlet_is_clear,
    particles_are_apart,
    fluid_is_in_front_of_walls,
    solids_reach_into_the_domain,
    grid_fits,
    periods_are_long,
    pairs_can_be_counted,
)


def extent(problem) -> np.ndarray:
    """Sides (d,) [m] of the domain."""
    return np.subtract(problem.scene.domain[1], problem.scene.domain[0])


def sides(problem) -> np.ndarray:
    """Cells (d,) of an effective radius, at least, along the sides of the domain."""
    return np.maximum(1.0, np.floor(extent(problem) / problem.effective_radius))


def doubles(x, apart: float) -> int:
    """How many of the points x (n, d) [m] share a cell of this size [m] with another."""
    return len(x) - len(counted(x, apart)[1])


def point(x) -> str:
    """A point as text: (0.1, 0, 0.25)."""
    return "(" + ", ".join(f"{value:.4g}" for value in x) + ")"
