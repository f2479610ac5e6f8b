"""Rules that a scene must obey whatever the numerics: types, shapes and positions.

Each rule takes a Scene and raises a SceneError, in one line, if it is broken, or warns. ``Scene`` applies them when it
is made: ``complete_fields`` first, which adds defaults, then RULES in their order.
"""

import warnings

import numpy as np

from ...units import SceneError, require
from .grains import GOOD_ACROSS, LEAST_ACROSS

MAX_MIXES = 256  # numbers of mixes are bytes
RIGHT_ANGLE_COSINE = 1e-6  # largest cosine of an angle that counts as a right one
# Overlap of bodies: side of the cells in which particles are counted, in spacings; particles over those of a lattice
# from which on a cell is crowded; largest fraction of all particles in excess of that, 0.03 for random places in 2-D
CELL, CROWD, EXCESS = 3, 1.3, 0.06


def complete_fields(scene) -> dict:
    """Fields of a scene as it stores them, with the defaults that follow from the dimension d of the fluid; SceneError
    if one of them has another dimension."""
    empty = scene.fluid is None or len(scene.fluid) == 0
    require(scene.inlets or not empty, "fluid: the geometry is empty; it must hold at least one particle")
    fluid = np.zeros((0, len(scene.inlets[0].centre))) if empty else scene.fluid
    d = fluid.shape[1]
    gravity = (0.0,) * (d - 1) + (-9.81,) if scene.gravity is None else scene.gravity
    if np.ndim(gravity) == 1:
        gravity = tuple(map(float, gravity))
        require(len(gravity) == d, f"gravity = {gravity} m/s2: must have {d} numbers, as the fluid has")
    periodic = (False,) * d if scene.periodic is None else tuple(scene.periodic)
    require(len(periodic) == d, f"periodic = {scene.periodic}: must have one word for each of {d} axes")
    low, high = np.array(scene.domain, float)
    require(
        len(low) == d and np.all(low < high),
        f"domain = {scene.domain} m: must have {d} coordinates, the second corner above the first along each axis",
    )
    for key, rows in (("velocity", len(fluid)), ("wall_particles", None)):
        value = getattr(scene, key)
        wanted = (len(value) if rows is None else rows, d) if value is not None else ()
        require(np.shape(value) == wanted, f"{key} of shape {np.shape(value)}: must be of the shape {wanted}")
    require(
        not scene.cavity or (len(scene.cavity.low) == d and not scene.axisymmetric),
        f"cavity: must have {d} coordinates, as the fluid has, and no rings",
    )
    numbers = {"spacing": float(scene.spacing), "until": float(scene.until), "walls": tuple(scene.walls)}
    for behind in behind_mouths(scene, d):  # from where grains enter
        low, high = np.minimum(low, behind.min(0) - scene.spacing), np.maximum(high, behind.max(0) + scene.spacing)
        numbers["domain"] = tuple(low.tolist()), tuple(high.tolist())
    return numbers | {"fluid": fluid, "gravity": gravity, "periodic": periodic}


def walls_fit_the_scene(scene):
    """Walls have the dimension of the fluid, and different names."""
    names = scene.wall_names
    for name, wall in zip(names, scene.walls, strict=True):
        require(
            len(wall.point) == scene.dimension,
            f"walls: point = {wall.point} m: must have {scene.dimension} coordinates, as the fluid has",
        )
        require(names.count(name) == 1, f"walls: name = {name!r}: of {names.count(name)} walls; must be of one")


def inlets_have_room(scene):
    """Inlets lie clear of walls and mirror planes, and bring half a layer or more."""
    require(
        not (scene.inlets and scene.axisymmetric),
        "inlet: the scene is axisymmetric; must be a scene without rings",
    )
    for inlet in scene.inlets:
        centre, turns = f"inlet: centre = {inlet.centre} m", inlet.turns[:, 1:]
        require(len(inlet.centre) == scene.dimension, f"{centre}: must have as many coordinates as the fluid")
        least = 0.5 * inlet.layer_volume(scene.spacing)
        require(
            inlet.volume >= least, f"inlet: volume = {inlet.volume:g} m3: must be at least half a layer, {least:g} m3"
        )
        for mirror in scene.mirrors:
            away = abs(float(mirror.distance(np.array([inlet.centre]))[0]))
            halved = away < 1e-9 and abs(inlet.unit_direction @ mirror.normal) < RIGHT_ANGLE_COSINE
            require(
                away >= inlet.radius or halved,
                f"inlet: the mirror plane with normal = {mirror.normal} cuts the hose; its axis must lie in the plane, "
                "or it must be clear of it",
            )
            require(
                np.abs(turns @ np.array(mirror.normal)).max() <= 1e-9,
                f"inlet: path: crosses {mirror_text(mirror)}; must lie along it",
            )
        layer = scene.inlet_layer(inlet)
        require(len(layer) > 0, f"{centre}: lies behind a mirror plane; must be in front of it")
        places = (turns[:, None] + layer).reshape(-1, scene.dimension)
        for wall in scene.walls:
            require(np.min(wall.distance(places)) > 0.0, f"{centre}: the mouth reaches into a wall; must be free of it")
    for behind in behind_mouths(scene, scene.dimension):
        require(
            all(np.min(wall.distance(behind)) > 0.0 for wall in scene.walls),
            "grains: enter whole, and would reach into a wall; must have their diameter free behind the mouth",
        )


def mixes_go_together(scene):
    """All mixes have the same kind of yield stress, and there is one mix only where a wall has friction."""
    count = len(scene.materials)
    require(count <= MAX_MIXES, f"inlets: bring {count} mixes; must be at most {MAX_MIXES}")
    knees = [material.critical_strain_rate for material in scene.materials if not material.newtonian]
    require(
        not (None in knees and any(knees)),
        "inlet: critical_strain_rate: must be given for all mixes or for none; some have a true yield stress",
    )
    require(
        count == 1 or not any(wall.friction for wall in scene.walls),
        "inlet: material: must be that of the scene where a wall has friction",
    )


def body_lies_in_the_domain(scene):
    """All particles lie inside the domain."""
    (low, high), x = np.array(scene.domain, float), scene.initial
    require(len(x) > 0, "fluid: the geometry is empty; it must hold at least one particle")
    domain = f"domain = {scene.domain} m: a particle lies"
    require(np.all((x >= low) & (x <= high)), f"{domain} outside; the domain must hold all of them")
    on_edge = ((x == low) | (x == high)) & ~np.array(scene.periodic)
    require(not on_edge.any(), f"{domain} on its edge; the domain must reach beyond all of them")


def bodies_are_apart(scene):
    """Bodies do not overlap: no more particles lie in the same room than in a lattice."""
    cells, counts = count_in_cells(scene.initial, CELL * scene.spacing)
    room = CELL**scene.dimension
    crowd = counts > CROWD * room
    if (counts[crowd] - CROWD * room).sum() > EXCESS * len(scene.initial):
        low, high = point(cells[crowd].min(0)), point(cells[crowd].max(0) + CELL * scene.spacing)
        raise SceneError(
            f"fluid: about {(counts[crowd] - room).sum()} of {len(scene.initial)} particles have no room, from {low} "
            f"to {high} m: bodies overlap; all must be apart"
        )


def bodies_are_filled(scene):
    """Warn of particles none of which has another in a cell of two spacings, where they are no ten drops."""
    count = len(scene.initial)
    if count > 10 and count_in_cells(scene.initial, 2.0 * scene.spacing)[1].max() == 1:
        warnings.warn(
            f"fluid: its {count} particles lie apart, as drops; a body must be filled with spacing = "
            f"{scene.spacing:g} m",
            stacklevel=4,
        )


def rings_lie_around_the_axis(scene):
    """An axisymmetric scene has coordinates (r, z), r above 0, gravity along z, not periodic along r."""
    if scene.axisymmetric:
        d, inmost, gravity = scene.dimension, scene.fluid[:, 0].min(), gravities(scene)
        require(d == 2, f"axisymmetric = True: the fluid has {d} coordinates; must have 2, (r, z)")
        require(inmost > 0.0, f"axisymmetric = True: a particle lies at r = {inmost:g} m; r must be above 0 m")
        across = gravity[np.argmax(np.abs(gravity[:, 0]))]
        require(across[0] == 0.0, f"gravity = {tuple(across.tolist())} m/s2: must be along z, axisymmetric")
        require(
            not (scene.periodic[0] or scene.mirrors),
            "axisymmetric = True: periodic along r, or with a mirror plane; only z may be periodic",
        )


def mirrors_are_planes_of_symmetry(scene):
    """Mirror planes have all fluid in front, contain the gravity, and are at right angles to each other."""
    gravity = gravities(scene)
    for k, mirror in enumerate(scene.mirrors):
        require(
            np.min(mirror.distance(scene.initial)) > 0.0,
            f"{mirror_text(mirror)}: a fluid particle lies on it or behind it; all must be in front",
        )
        off = np.abs(gravity @ mirror.normal) - RIGHT_ANGLE_COSINE * np.linalg.norm(gravity, axis=1)
        worst = tuple(gravity[np.argmax(off)].tolist())
        require(off.max() <= 0.0, f"{mirror_text(mirror)}: gravity = {worst} m/s2 must lie in the plane")
        for other in scene.mirrors[:k]:
            require(
                abs(np.dot(other.normal, mirror.normal)) <= RIGHT_ANGLE_COSINE,
                f"{mirror_text(mirror)}: must be at right angles to that with normal = {other.normal}",
            )


def jolts_keep_the_symmetry(scene):
    """Jolts keep the symmetry of mirror planes and of the axis."""
    for jolt in scene.jolts:
        given, velocity = f"jolts: velocity = {jolt.velocity} m/s", np.array(jolt.velocity)
        require(len(velocity) == scene.dimension, f"{given}: must have {scene.dimension} numbers, as the fluid has")
        along_axis = velocity[0] == 0.0 and not jolt.angular_velocity
        require(along_axis or not scene.axisymmetric, f"{given}: must be along z and without a turn, axisymmetric")
        for mirror in scene.mirrors:
            across = abs(velocity @ mirror.normal) + np.linalg.norm(jolt.spin @ mirror.normal)
            require(across <= RIGHT_ANGLE_COSINE, f"{mirror_text(mirror)}: {given} and its turn must lie in the plane")


def grains_are_supported(scene):
    """Grains are in a whole body, each three spacings or more across."""
    if not scene.grains:
        return
    for what, there in {
        "centres, but no fluid at 0 s; must have volume_fraction": scene.grains.centres is not None
        and scene.fluid.size == 0,
        f"diameters up to {scene.grains.diameters.max():g} m, longer than its domain; must be shorter": np.ptp(
            scene.domain, axis=0
        ).min()
        < scene.grains.diameters.max(),
        "mirror planes, which would cut them; must be the whole body, model full where there is one": scene.mirrors,
        "rings, which would cut them; must be the whole body, axisymmetric = False": scene.axisymmetric,
        "a jolt; must be a scene without, as slump": scene.jolts,
        "a wall with friction; must be without": any(wall.friction for wall in scene.walls),
        "a unilateral wall, such as a mould that is lifted; must be without, gone at 0 s": any(
            wall.loose for wall in scene.walls
        ),
    }.items():
        require(not there, f"grains: the scene has {what}")
    require(
        scene.grains.centres is None or scene.grains.centres.shape[1] == scene.dimension,
        f"grains: centres of shape {np.shape(scene.grains.centres)}: must have {scene.dimension} coordinates",
    )
    require(
        not len(scene.grains.rows) or scene.grains.rows.shape[1] == scene.dimension + 1,
        f"grains: shape = {str(scene.grains.shape):.60}: must be one of {scene.dimension} dimensions, as the scene has",
    )
    smallest, what = scene.grains.width, "width of the largest sphere" if len(scene.grains.rows) else "diameter"
    across = smallest / scene.spacing + 1e-9
    require(
        across >= LEAST_ACROSS,
        f"grains: {what} = {smallest:g} m: is {across:.2g} spacings across; must be {LEAST_ACROSS:g} or more: "
        f"spacing = {smallest / GOOD_ACROSS:g} m",
    )
    if across < GOOD_ACROSS:
        warnings.warn(
            f"grains: {what} = {smallest:g} m is {across:.2g} spacings across; {GOOD_ACROSS:g} or more are better",
            stacklevel=4,
        )


RULES = (
    grains_are_supported,
    walls_fit_the_scene,
    inlets_have_room,
    mixes_go_together,
    body_lies_in_the_domain,
    bodies_are_apart,
    bodies_are_filled,
    rings_lie_around_the_axis,
    mirrors_are_planes_of_symmetry,
    jolts_keep_the_symmetry,
)


def behind_mouths(scene, d: int) -> list[np.ndarray]:
    """Places (k, d) [m] behind each mouth of an inlet to which a grain reaches back that enters."""
    if not scene.grains or scene.grains.rows.shape[1] not in (0, d + 1):
        return []
    parts = scene.grains.clump(d)[0]
    length = 2.0 * scene.grains.diameters.max() * (np.linalg.norm(parts[:, :-1], axis=1) + parts[:, -1]).max()
    steps = np.arange(scene.spacing, length + scene.spacing, scene.spacing)[:, None, None]
    return [
        (inlet.turns[:, None, None, 1:] + inlet.layer(scene.spacing) - steps * inlet.unit_direction).reshape(-1, d)
        for inlet in scene.inlets
        if len(inlet.centre) == d
    ]


def gravities(scene) -> np.ndarray:
    """Gravity [m/s2], shape (k, d), at all times of a table."""
    return scene.gravity_vector[None] if scene.gravity_in_time is None else scene.gravity_in_time.values


def mirror_text(mirror) -> str:
    """Format a mirror plane for messages."""
    return f"walls: mirror plane, normal = {mirror.normal}"


def point(x) -> str:
    """Format a point as text: (0.1, 0, 0.25)."""
    return "(" + ", ".join(f"{value:.4g}" for value in x) + ")"


def count_in_cells(x, side: float) -> tuple[np.ndarray, np.ndarray]:
    """Count points x (n, d) [m] in cells of this side [m]: lower corners (m, d) [m] and number of points of the cells
    that hold some. The grid is a twelfth of a side off the lowest point, so that no lattice plane lies on its faces."""
    low = x.min(0) - side / 12.0
    cells = np.floor((x - low) / side).astype(np.int64)
    shape = cells.max(0) + 1
    if np.prod(shape.astype(float)) >= 2**62:
        cells, counts = np.unique(cells, axis=0, return_counts=True)
        return low + side * cells, counts
    flat, counts = np.unique(np.ravel_multi_index(cells.T, shape), return_counts=True)
    return low + side * np.stack(np.unravel_index(flat, shape), axis=-1), counts
