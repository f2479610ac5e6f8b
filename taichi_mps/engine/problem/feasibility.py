"""Rules that a scene with its numerics must obey: limits of the scheme, and plausible numbers.

Each rule takes a ``Problem`` and raises a SceneError, in one line, if it is broken. ``problem.Problem`` applies RULES
in their order when it is made, before anything is allocated. Rules of the scene alone are in ``scene_rules``.
"""

import inspect
from itertools import chain

import numpy as np

from ...units import DENSITY_HINT, HEAVIEST, LIGHTEST, SceneError, require
from ..geometry.solid import Solid
from ..geometry.walls import Cylinder
from .inlet import MAX_JET_SPEED, buried
from .scene_rules import count_in_cells, gravities, point

MAX_CELLS = 2**27  # of the binning grid: 8 bytes each
MAX_PAIRS = 2**31 - 1  # of neighbours: their indices are 32-bit
EARTH_GRAVITY = 10.0  # gravity [m/s2], +-1, under which the density must be plausible for a mix


# ---- limits of the scheme ------------------------------------------------------------------------------------------
def scheme_supports_the_law(problem):
    """The paper's scheme supports Bingham's law only, without internal friction, grains and jolts."""
    material = problem.scene.material
    if problem.scheme == "semi-implicit":
        require(not problem.scene.grains, "grains: the scheme semi-implicit has none; must be implicit")
        require(not problem.scene.jolts, "jolts: the scheme semi-implicit has none; must be implicit")
        require(
            not material.curved,
            f"scene {problem.scene.name}: material {type(material).__name__}: must be Bingham with the scheme "
            "semi-implicit; implicit takes any flow curve",
        )
        require(
            material.straight,
            f"friction_angle = {material.friction_angle:g} deg: the scheme semi-implicit has none; must be 0, or "
            "scheme implicit",
        )


def own_laws_are_flow_curves(problem):
    """Functions of a user's law take two numbers, shear rate and structure, and its stress changes with the rate; one
    that falls is refused where it is compiled."""
    for key, function in chain.from_iterable(material.functions.items() for material in problem.scene.materials):
        try:
            inspect.signature(function).bind(0.0, 0.0)
        except (TypeError, ValueError) as error:
            name = f"{key} = {getattr(function, '__name__', function)}"
            raise SceneError(f"material: {name}: must take two numbers, (rate, structure); {error}") from None
    require(
        all(material.typical_slope != 0.0 for material in problem.scene.materials),
        "material: typical_slope = 0 Pa s: its stress must grow with the shear rate, as by a viscosity",
    )


def walls_suit_the_scheme(problem):
    """The radius of a curved wall is greater than the effective radius. Walls of particles allow no axisymmetric scene,
    no grains, no moving, thin or frictional walls, no mirrors, no inlets and no wall loads."""
    scene, radius = problem.scene, problem.effective_radius
    require(
        scene.wall_particles is None or scene.walls,
        f"wall_particles: scene {scene.name} has no walls; must also describe them as surfaces",
    )
    if problem.numerics.walls == "particles":
        require(
            not problem.wall_loads,
            f"wall_loads = True: scheme {problem.scheme} with walls = particles has no surface to measure on; must be "
            "scheme implicit with walls = surfaces",
        )
        for what, there in {
            "has grains": problem.scene.grains,
            "is axisymmetric": scene.axisymmetric,
            "has an inlet": scene.inlets,
            "has a mirror plane": scene.mirrors,
            "has a wall that moves or is thin": any(wall.speed > 0.0 or wall.thin for wall in scene.walls),
            "has a wall that has friction": any(wall.friction for wall in scene.walls),
            "describes its walls as surfaces only": scene.walls and scene.wall_particles is None,
        }.items():
            require(not there, f"walls = particles: scene {scene.name} {what}; must be surfaces, scheme implicit")
    for wall in scene.walls:
        smallest = wall.smallest_radius if isinstance(wall, Cylinder) else np.inf
        require(
            smallest > radius,
            f"radius = {smallest:g} m of a curved wall: must be greater than the effective radius, {radius:g} m",
        )


# ---- wrong units and origins ---------------------------------------------------------------------------------------
def density_is_plausible(problem):
    """Densities, of grains as well, are plausible under the Earth's gravity; under another numbers may be
    dimensionless."""
    if np.any(np.abs(np.linalg.norm(gravities(problem.scene), axis=1) - EARTH_GRAVITY) < 1.0):
        for material in (*problem.scene.materials, *filter(None, [problem.scene.grains])):
            require(
                LIGHTEST <= material.density <= HEAVIEST,
                f"density = {material.density:g} kg/m3: must be from {LIGHTEST:g} to {HEAVIEST:g} kg/m3 under gravity "
                f"({DENSITY_HINT})",
            )


def inlets_are_plausible(problem):
    """Jets are not faster than MAX_JET_SPEED, or their rate is in another unit, and first layers are clear of fluid."""
    scene, spacing = problem.scene, problem.scene.spacing
    for inlet in scene.inlets:
        speed, most = inlet.speed(spacing), MAX_JET_SPEED * inlet.layer_volume(spacing) / spacing
        require(
            speed <= MAX_JET_SPEED,
            f"inlet: rate = {inlet.rate:g} m3/s: leaves the hose at {speed:.3g} m/s; must be at most {most:.3g} m3/s "
            "(0.012 for 12 l/s)",
        )
        nozzle = float(np.linalg.norm(inlet.fastest(spacing)))
        require(
            nozzle <= MAX_JET_SPEED,
            f"inlet: path: moves with the jet at {nozzle:.3g} m/s; must be at most {MAX_JET_SPEED:g} m/s",
        )
        require(
            inlet.start > 0.0 or not buried(scene.inlet_layer(inlet) + inlet.displacement(0.0), scene.fluid, spacing),
            f"inlet: centre = {point(inlet.centre)} m: lies in the fluid at 0 s; must be clear of it or start later",
        )


def particles_are_apart(problem):
    """No two particles, of walls included, lie at one place or at periodic images of it, and all in the domain."""
    scene, walls = problem.scene, [problem.scene.wall_particles] if problem.wall_particles else []
    x = np.vstack([scene.initial, *walls])
    low, high = np.array(scene.domain, float)
    require(
        np.all((np.clip(x, low, high) == x) | scene.periodic),
        f"wall_particles: some lie outside of domain = {scene.domain} m; the domain must hold all of them",
    )
    # the ends of a periodic axis are the same place
    doubles = len(x) - len(
        count_in_cells(np.where(scene.periodic, low + np.mod(x - low, high - low), x), 1e-3 * scene.spacing)[1]
    )
    require(doubles == 0, f"particles: {doubles} of {len(x)} lie on others; all must be apart")


def walls_lie_where_the_fluid_is(problem):
    """Solids are near the domain and of its scale, and no particle lies behind a wall."""
    scene, (low, high) = problem.scene, problem.scene.domain
    for wall in scene.walls:
        if isinstance(wall, Solid):
            size, room = (float(np.subtract(*ends).max()) for ends in ((wall.high, wall.low), (high, low)))
            require(
                size <= 100.0 * room,
                f"walls: a solid of {size:.3g} m in a domain of {room:.3g} m: must be at most 100 times as long; "
                "scale = 0.001 for a mesh in mm",
            )
        depth = 0.0 if wall.thin else -float(np.min(wall.distance(scene.initial)))
        require(
            depth <= 0.5 * scene.spacing,
            f"fluid: a particle lies {depth:.3g} m behind a wall ({type(wall).__name__}); all must be in front",
        )
        if isinstance(wall, Solid) and wall.speed == 0.0:
            require(
                np.all(np.less_equal(wall.low, high)) and np.all(np.less_equal(low, wall.high)),
                f"walls: a solid from {point(wall.low)} to {point(wall.high)} m: must reach into the domain, from "
                f"{point(low)} to {point(high)} m; its origin or its scale is another",
            )


# ---- sizes ---------------------------------------------------------------------------------------------------------
def grid_fits(problem):
    """The binning grid fits into memory, and is three cells or more along a periodic axis, so that no particle has the
    same neighbour on both sides."""
    size, radius = np.subtract(*problem.scene.domain[::-1]), problem.effective_radius + problem.skin
    across = cells_along_axes(problem)
    cells = np.prod(across)
    require(
        cells <= MAX_CELLS,
        f"domain = {' x '.join(f'{s:g}' for s in size)} m: has {cells:.2g} cells of the search radius, {radius:g} "
        f"m; at most {MAX_CELLS:.2g}",
    )
    for axis in np.flatnonzero(problem.scene.periodic):
        require(
            across[axis] >= 3,
            f"domain = {size[axis]:g} m along periodic axis {axis}: must be at least three search radii, "
            f"{3.0 * radius:g} m",
        )


def pairs_can_be_counted(problem):
    """The indices of neighbour pairs fit into 32 bits."""
    scene, ratio = problem.scene, problem.numerics.effective_radius_ratio
    neighbours = {2: np.pi, 3: 4.0 * np.pi / 3.0}[scene.dimension] * ratio**scene.dimension
    particles = sum(
        [
            len(scene.fluid),
            len(scene.wall_particles) if problem.wall_particles else 0,
            *(len(scene.inlet_layer(inlet)) * inlet.layers(scene.spacing) for inlet in scene.inlets),
        ]
    )
    pairs = 4.0 * neighbours * particles  # the list has room for bodies pressed together and for rings
    require(
        pairs <= MAX_PAIRS,
        f"spacing = {scene.spacing:g} m: makes {particles:.6g} particles with up to {pairs:.2g} pairs of neighbours; "
        f"at most {MAX_PAIRS:.2g}",
    )


RULES = (
    scheme_supports_the_law,
    own_laws_are_flow_curves,
    walls_suit_the_scheme,
    density_is_plausible,
    inlets_are_plausible,
    particles_are_apart,
    walls_lie_where_the_fluid_is,
    grid_fits,
    pairs_can_be_counted,
)


def cells_along_axes(problem) -> np.ndarray:
    """Number of cells (d,), each a search radius wide or more, along the axes of the domain."""
    return np.maximum(
        1.0, np.floor(np.subtract(*problem.scene.domain[::-1]) / (problem.effective_radius + problem.skin))
    )
