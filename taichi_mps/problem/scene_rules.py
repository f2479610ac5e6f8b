"""The rules that a scene must obey whatever computes it: types, shapes, and what lies where.

Each rule takes a Scene and returns what is wrong in one line, or None. ``Scene`` applies them when it is made, in this
order: KINDS, then ``numbers``, which turns what was given into arrays, then RULES.
"""

from collections.abc import Callable

import numpy as np

from ..geometry.cavity import Cavity
from ..geometry.solid import Solid
from ..geometry.walls import Cylinder, Plane
from ..units import INSTANT, SceneError, check_kinds, finite, said
from .inlet import Inlet
from .materials import Material

MOST_MIXES = 256  # numbers of mixes are bytes
RIGHT = 1e-6  # cosine of an angle that counts as a right one
# Cells in which particles are counted, in spacings; so many times as many as have room are a crowd; of all particles so
# many may be more than that: of those at random places in the plane 0.03 are
CELL, CROWD, EXCESS = 3, 1.3, 0.06


# ---- types ---------------------------------------------------------------------------------------------------------
def plain_values_have_their_types(scene):
    flag = (bool | np.bool_, "True or False")
    function = (Callable, "a function")
    check_kinds(scene, {"name": (str, "text"), "enlarged_by": (str, "text")})
    check_kinds(scene, {"parameters": (dict, "a dict"), "cavity": (Cavity, "a Cavity")})
    check_kinds(scene, {"axisymmetric": flag, "stop_at_rest": flag, "wall_loads": flag})
    check_kinds(scene, {"measure": function, "check": function, "over_time": function})


def sequences_hold_their_types(scene):
    words = "True or False"
    kinds = {"walls": (Plane | Cylinder | Solid, "Plane or Cylinder or Solid"), "inlets": (Inlet, "Inlet")}
    kinds |= {"periodic": (bool | np.bool_, words)} if scene.periodic is not None else {}
    for key, (kind, words) in kinds.items():
        value = getattr(scene, key)
        if not isinstance(value, tuple | list) or not all(isinstance(item, kind) for item in value):
            return f"{key} = {said(value, '')}: must be a tuple, each {words}"


def materials_are_materials(scene):
    laws = "Bingham, Newtonian, HerschelBulkley or FlowCurve"
    if not isinstance(scene.material, Material):
        return f"material = {scene.material!r}: must be {laws}"
    for inlet in scene.inlets:
        if not isinstance(inlet.material, Material | None):
            return f"inlet: material = {str(inlet.material)[:60]}: must be {laws}"


KINDS = (plain_values_have_their_types, sequences_hold_their_types, materials_are_materials)


# ---- numbers -------------------------------------------------------------------------------------------------------
def numbers(scene) -> dict:
    """What was given as numbers, checked for shape and range: fluid (n, d) and velocity (n, d) as arrays, gravity (d,)
    as a tuple, spacing and until as floats. SceneError names the key and its unit."""
    if scene.inlets and (scene.fluid is None or np.size(scene.fluid) == 0):
        fluid = np.zeros((0, len(scene.inlets[0].centre)))
    elif np.size(scene.fluid) == 0:
        raise SceneError("fluid: the geometry is empty; it must hold at least one particle")
    else:
        fluid = finite("fluid", scene.fluid, "m", dimensions=2)
    n, d = fluid.shape
    if d not in (2, 3):
        raise SceneError(f"fluid: positions have {d} coordinates; must have 2 or 3")
    taken = {"fluid": fluid}
    for key, unit in (("spacing", "m"), ("until", "s")):
        taken[key] = float(finite(key, getattr(scene, key), unit, shape=()))
        if not taken[key] > 0.0:
            raise SceneError(f"{key} = {getattr(scene, key)} {unit}: must be greater than 0 {unit}")
    if taken["until"] < INSTANT:
        raise SceneError(f"until = {taken['until']:g} s: must be at least {INSTANT:g} s")
    low, high = finite("domain", scene.domain, "m", shape=(2, d))
    if not np.all(low < high):
        raise SceneError(f"domain = {scene.domain} m: the second corner must be above the first along each axis")
    if scene.gravity is not None:
        taken["gravity"] = tuple(finite("gravity", scene.gravity, "m/s2", (d,)).tolist())
    if scene.velocity is not None:
        taken["velocity"] = finite("velocity", scene.velocity, "m/s", (n, d))
    if scene.wall_particles is not None:
        wall = finite("wall_particles", scene.wall_particles, "m", dimensions=2)
        if wall.shape[1] != d:
            raise SceneError(f"wall_particles: have {wall.shape[1]} coordinates; must have {d}, as the fluid has")
    if scene.periodic is not None and len(scene.periodic) != d:
        raise SceneError(f"periodic = {scene.periodic}: must have one word for each of {d} axes")
    return taken


# ---- inlets --------------------------------------------------------------------------------------------------------
def inlets_need_no_rings(scene):
    if scene.inlets and scene.axisymmetric:
        return "inlet: the scene is axisymmetric; must be a scene without rings"


def inlets_have_the_dimension_of_the_fluid(scene):
    for inlet in scene.inlets:
        if len(inlet.centre) != scene.dimension:
            return f"inlet: centre = {inlet.centre} m: must have as many coordinates as the fluid"


def inlets_bring_a_layer(scene):
    for inlet in scene.inlets:
        least = 0.5 * inlet.layer_volume(scene.spacing)
        if inlet.volume < least:
            return f"inlet: volume = {inlet.volume:g} m3: must be at least half a layer, {least:g} m3"


def mirrors_leave_a_hose_whole_or_halve_it(scene):
    for inlet in scene.inlets:
        for mirror in scene.mirrors:
            away = abs(float(mirror.distance(np.array([inlet.centre]))[0]))
            aligned = abs(inlet.unit_direction @ mirror.normal) < RIGHT
            if away < inlet.radius and not (away < 1e-9 and aligned):
                return (
                    f"inlet: the mirror plane with normal = {mirror.normal} cuts the hose; its axis must lie in the "
                    "plane, or it must be clear of it"
                )


def inlets_are_in_front_of_mirrors(scene):
    for inlet in scene.inlets:
        if not len(scene.inlet_layer(inlet)):
            return f"inlet: centre = {inlet.centre} m: lies behind a mirror plane; must be in front of it"


def nozzles_move_along_mirrors(scene):
    for inlet in scene.inlets:
        for mirror in scene.mirrors:
            if np.abs(inlet.displacements @ np.array(mirror.normal)).max() > 1e-9:
                return f"inlet: path: crosses {named(mirror)}; must lie along it"


def inlets_are_free_of_walls(scene):
    for inlet in scene.inlets:
        places = (inlet.displacements[:, None] + scene.inlet_layer(inlet)).reshape(-1, scene.dimension)
        for wall in scene.walls:
            if np.min(wall.distance(places)) <= 0.0:
                return f"inlet: centre = {inlet.centre} m: the mouth reaches into a wall; must be free of it"


# ---- mixes ---------------------------------------------------------------------------------------------------------
def mixes_are_few(scene):
    if len(scene.materials) > MOST_MIXES:
        return f"inlets: bring {len(scene.materials)} mixes; must be at most {MOST_MIXES}"


def mixes_have_one_law(scene):
    knees = [material.critical_strain_rate for material in scene.materials if not material.newtonian]
    if None in knees and any(knees):
        return "inlet: critical_strain_rate: must be given for all mixes or for none; some have a true yield stress"


def friction_is_of_one_mix(scene):
    if len(scene.materials) > 1 and any(wall.friction for wall in scene.walls):
        return "inlet: material: must be that of the scene where a wall has friction"


# ---- the body ------------------------------------------------------------------------------------------------------
def something_is_there_at_the_start(scene):
    if len(scene.initial) == 0:
        return "fluid: the geometry is empty; it must hold at least one particle"


def body_lies_in_the_domain(scene):
    (low, high), x = np.array(scene.domain, float), scene.initial
    if np.any(x < low) or np.any(x > high):
        return f"domain = {scene.domain} m: a particle lies outside; the domain must hold all of them"
    if np.any(((x == low) | (x == high)) & ~np.array(scene.periodic_axes)):
        return f"domain = {scene.domain} m: a particle lies on its edge; the domain must reach beyond all of them"


def bodies_are_apart(scene):
    """Bodies that overlap have more particles in the same room than a lattice."""
    cells, counts = counted(scene.initial, CELL * scene.spacing)
    room = CELL**scene.dimension
    crowd = counts > CROWD * room
    if (counts[crowd] - CROWD * room).sum() > EXCESS * len(scene.initial):
        ends = cells[crowd].min(0), cells[crowd].max(0) + CELL * scene.spacing
        low, high = (", ".join(f"{v:.3g}" for v in end) for end in ends)
        return (
            f"fluid: about {(counts[crowd] - room).sum()} of {len(scene.initial)} particles have no room, from "
            f"({low}) to ({high}) m: bodies overlap; all must be apart"
        )


def rings_lie_around_the_axis(scene):
    """Of an axisymmetric scene: coordinates (r, z), r above 0, gravity along z, not periodic along r."""
    if not scene.axisymmetric:
        return None
    if scene.dimension != 2:
        return f"axisymmetric = True: the fluid has {scene.dimension} coordinates; must have 2, (r, z)"
    if scene.fluid[:, 0].min() <= 0.0:
        return f"axisymmetric = True: a particle lies at r = {scene.fluid[:, 0].min():g} m; r must be above 0 m"
    if scene.gravity_vector[0] != 0.0:
        return f"gravity = {tuple(scene.gravity_vector.tolist())} m/s2: must be along z, axisymmetric"
    if scene.periodic_axes[0]:
        return "axisymmetric = True: periodic along r; only z may be periodic"


def walls_have_the_dimension_of_the_fluid(scene):
    for wall in scene.walls:
        if len(wall.point) != scene.dimension:
            return f"walls: point = {wall.point} m: must have {scene.dimension} coordinates, as the fluid has"


def walls_have_names_of_their_own(scene):
    names = [wall.name or f"wall_{k}" for k, wall in enumerate(scene.walls)]  # as of measured_walls
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        return f"walls: name = {twice[0]!r}: of {names.count(twice[0])} walls; must be of one"


# ---- mirror planes -------------------------------------------------------------------------------------------------
def fluid_is_in_front_of_mirrors(scene):
    for mirror in scene.mirrors:
        if np.min(mirror.distance(scene.initial)) <= 0.0:
            return f"{named(mirror)}: a fluid particle lies on it or behind it; all must be in front"


def gravity_lies_in_mirrors(scene):
    gravity = scene.gravity_vector
    for mirror in scene.mirrors:
        if abs(gravity @ mirror.normal) > RIGHT * np.linalg.norm(gravity):
            return f"{named(mirror)}: gravity = {tuple(gravity.tolist())} m/s2 must lie in the plane"


def mirrors_stand_at_right_angles(scene):
    for k, mirror in enumerate(scene.mirrors):
        for other in scene.mirrors[:k]:
            if abs(np.dot(other.normal, mirror.normal)) > RIGHT:
                return f"{named(mirror)}: must be at right angles to that with normal = {other.normal}"


def named(mirror) -> str:
    """How a message names a mirror plane."""
    return f"walls: mirror plane, normal = {mirror.normal}"


RULES = (
    walls_have_the_dimension_of_the_fluid,
    walls_have_names_of_their_own,
    inlets_need_no_rings,
    inlets_have_the_dimension_of_the_fluid,
    inlets_bring_a_layer,
    mirrors_leave_a_hose_whole_or_halve_it,
    inlets_are_in_front_of_mirrors,
    nozzles_move_along_mirrors,
    inlets_are_free_of_walls,
    mixes_are_few,
    mixes_have_one_law,
    friction_is_of_one_mix,
    something_is_there_at_the_start,
    body_lies_in_the_domain,
    bodies_are_apart,
    rings_lie_around_the_axis,
    fluid_is_in_front_of_mirrors,
    gravity_lies_in_mirrors,
    mirrors_stand_at_right_angles,
)


def counted(x, side: float) -> tuple[np.ndarray, np.ndarray]:
    """Of the points x (n, d) [m] in cells of this side [m]: the lower corners (m, d) [m] of those that hold any, a
    twelfth of a side off the lowest point, where no lattice of few to a side has a plane; and how many each holds."""
    low = x.min(0) - side / 12.0
    cells = np.floor((x - low) / side).astype(np.int64)
    shape = cells.max(0) + 1
    if np.prod(shape.astype(float)) < 2**62:
        flat, counts = np.unique(np.ravel_multi_index(cells.T, shape), return_counts=True)
        cells = np.stack(np.unravel_index(flat, shape), axis=-1)
    else:
        cells, counts = np.unique(cells, axis=0, return_counts=True)
    return low + side * cells, counts
