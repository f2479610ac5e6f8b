"""The rules that a scene must obey whatever computes it: types, shapes, and what lies where.

Each rule takes a Scene and raises SceneError, in one line, where it is broken. ``Scene`` applies them when it is made:
``completed`` first, which adds defaults, then RULES in their order.
"""

import numpy as np

from ..units import SceneError, require

MOST_MIXES = 256  # numbers of mixes are bytes
RIGHT = 1e-6  # cosine of an angle that counts as a right one
# Cells in which particles are counted, in spacings; so many times as many as have room are a crowd; of all particles so
# many may be more than that: of those at random places in the plane 0.03 are
CELL, CROWD, EXCESS = 3, 1.3, 0.06


def completed(scene) -> dict:
    """Fields of a scene as it keeps them, with the defaults that follow from the dimension d of the fluid; SceneError
    where two of them have another d."""
    empty = scene.fluid is None or len(scene.fluid) == 0
    require(scene.inlets or not empty, "fluid: the geometry is empty; it must hold at least one particle")
    fluid = np.zeros((0, len(scene.inlets[0].centre))) if empty else scene.fluid
    d = fluid.shape[1]
    gravity = (0.0,) * (d - 1) + (-9.81,) if scene.gravity is None else scene.gravity
    if not callable(gravity) and np.ndim(gravity) == 1:
        gravity = tuple(map(float, gravity))
        require(len(gravity) == d, f"gravity = {gravity} m/s2: must have {d} numbers, as the fluid has")
    periodic = (False,) * d if scene.periodic is None else tuple(scene.periodic)
    require(len(periodic) == d, f"periodic = {scene.periodic}: must have one word for each of {d} axes")
    low, high = np.array(scene.domain, float)
    wrong = f"domain = {scene.domain} m: must have {d} coordinates, the second corner above the first along each axis"
    require(len(low) == d and np.all(low < high), wrong)
    for key, rows in (("velocity", len(fluid)), ("wall_particles", None)):
        value = getattr(scene, key)
        wanted = (len(value) if rows is None else rows, d) if value is not None else ()
        require(np.shape(value) == wanted, f"{key} of shape {np.shape(value)}: must be of the shape {wanted}")
    numbers = {"spacing": float(scene.spacing), "until": float(scene.until), "walls": tuple(scene.walls)}
    return numbers | {"fluid": fluid, "gravity": gravity, "periodic": periodic}


def walls_fit_the_scene(scene):
    names = scene.wall_names
    for name, wall in zip(names, scene.walls, strict=True):
        require(
            len(wall.point) == scene.dimension,
            f"walls: point = {wall.point} m: must have {scene.dimension} coordinates, as the fluid has",
        )
        require(names.count(name) == 1, f"walls: name = {name!r}: of {names.count(name)} walls; must be of one")


def inlets_have_room(scene):
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
            halved = away < 1e-9 and abs(inlet.unit_direction @ mirror.normal) < RIGHT
            require(
                away >= inlet.radius or halved,
                f"inlet: the mirror plane with normal = {mirror.normal} cuts the hose; its axis must lie in the plane, "
                "or it must be clear of it",
            )
            along = np.abs(turns @ np.array(mirror.normal)).max() <= 1e-9
            require(along, f"inlet: path: crosses {named(mirror)}; must lie along it")
        layer = scene.inlet_layer(inlet)
        require(len(layer) > 0, f"{centre}: lies behind a mirror plane; must be in front of it")
        places = (turns[:, None] + layer).reshape(-1, scene.dimension)
        for wall in scene.walls:
            require(np.min(wall.distance(places)) > 0.0, f"{centre}: the mouth reaches into a wall; must be free of it")


def mixes_go_together(scene):
    count = len(scene.materials)
    require(count <= MOST_MIXES, f"inlets: bring {count} mixes; must be at most {MOST_MIXES}")
    knees = [material.critical_strain_rate for material in scene.materials if not material.newtonian]
    require(
        not (None in knees and any(knees)),
        "inlet: critical_strain_rate: must be given for all mixes or for none; some have a true yield stress",
    )
    rubs = any(wall.friction for wall in scene.walls)
    require(count == 1 or not rubs, "inlet: material: must be that of the scene where a wall has friction")


def body_lies_in_the_domain(scene):
    (low, high), x = np.array(scene.domain, float), scene.initial
    require(len(x) > 0, "fluid: the geometry is empty; it must hold at least one particle")
    domain = f"domain = {scene.domain} m: a particle lies"
    require(np.all((x >= low) & (x <= high)), f"{domain} outside; the domain must hold all of them")
    on_edge = ((x == low) | (x == high)) & ~np.array(scene.periodic)
    require(not on_edge.any(), f"{domain} on its edge; the domain must reach beyond all of them")


def bodies_are_apart(scene):
    """Bodies that overlap have more particles in the same room than a lattice."""
    cells, counts = counted(scene.initial, CELL * scene.spacing)
    room = CELL**scene.dimension
    crowd = counts > CROWD * room
    if (counts[crowd] - CROWD * room).sum() > EXCESS * len(scene.initial):
        low, high = point(cells[crowd].min(0)), point(cells[crowd].max(0) + CELL * scene.spacing)
        lost = (counts[crowd] - room).sum()
        raise SceneError(
            f"fluid: about {lost} of {len(scene.initial)} particles have no room, from {low} to {high} m: bodies "
            "overlap; all must be apart"
        )


def rings_lie_around_the_axis(scene):
    """An axisymmetric scene has coordinates (r, z), r above 0, gravity along z, not periodic along r."""
    if scene.axisymmetric:
        d, inmost, gravity = scene.dimension, scene.fluid[:, 0].min(), gravities(scene)
        require(d == 2, f"axisymmetric = True: the fluid has {d} coordinates; must have 2, (r, z)")
        require(inmost > 0.0, f"axisymmetric = True: a particle lies at r = {inmost:g} m; r must be above 0 m")
        across = gravity[np.argmax(np.abs(gravity[:, 0]))]
        require(across[0] == 0.0, f"gravity = {tuple(across.tolist())} m/s2: must be along z, axisymmetric")
        require(not scene.periodic[0], "axisymmetric = True: periodic along r; only z may be periodic")


def mirrors_are_planes_of_symmetry(scene):
    gravity = gravities(scene)
    for k, mirror in enumerate(scene.mirrors):
        require(
            np.min(mirror.distance(scene.initial)) > 0.0,
            f"{named(mirror)}: a fluid particle lies on it or behind it; all must be in front",
        )
        off = np.abs(gravity @ mirror.normal) - RIGHT * np.linalg.norm(gravity, axis=1)
        worst = tuple(gravity[np.argmax(off)].tolist())
        require(off.max() <= 0.0, f"{named(mirror)}: gravity = {worst} m/s2 must lie in the plane")
        for other in scene.mirrors[:k]:
            require(
                abs(np.dot(other.normal, mirror.normal)) <= RIGHT,
                f"{named(mirror)}: must be at right angles to that with normal = {other.normal}",
            )


def jolts_keep_the_symmetry(scene):
    for jolt in scene.jolts:
        given, velocity = f"jolts: velocity = {jolt.velocity} m/s", np.array(jolt.velocity)
        require(len(velocity) == scene.dimension, f"{given}: must have {scene.dimension} numbers, as the fluid has")
        along_axis = velocity[0] == 0.0 and not jolt.angular_velocity
        require(along_axis or not scene.axisymmetric, f"{given}: must be along z and without a turn, axisymmetric")
        for mirror in scene.mirrors:
            across = abs(velocity @ mirror.normal) + np.linalg.norm(jolt.spin @ mirror.normal)
            require(across <= RIGHT, f"{named(mirror)}: {given} and its turn must lie in the plane")


RULES = (
    walls_fit_the_scene,
    inlets_have_room,
    mixes_go_together,
    body_lies_in_the_domain,
    bodies_are_apart,
    rings_lie_around_the_axis,
    mirrors_are_planes_of_symmetry,
    jolts_keep_the_symmetry,
)


def gravities(scene) -> np.ndarray:
    """Gravity [m/s2], shape (k, d): of each row of a table, of a function at many times."""
    return scene.gravity_vector[None] if scene.gravity_in_time is None else scene.gravity_in_time.values


def named(mirror) -> str:
    """Name of a mirror plane in messages."""
    return f"walls: mirror plane, normal = {mirror.normal}"


def point(x) -> str:
    """A point as text: (0.1, 0, 0.25)."""
    return "(" + ", ".join(f"{value:.4g}" for value in x) + ")"


def counted(x, side: float) -> tuple[np.ndarray, np.ndarray]:
    """Cells of this side [m] that hold points x (n, d) [m]: their lower corners (m, d) [m], a
    twelfth of a side off the lowest point, where no lattice of few to a side has a plane; and how many each holds."""
    low = x.min(0) - side / 12.0
    cells = np.floor((x - low) / side).astype(np.int64)
    shape = cells.max(0) + 1
    if np.prod(shape.astype(float)) >= 2**62:
        cells, counts = np.unique(cells, axis=0, return_counts=True)
        return low + side * cells, counts
    flat, counts = np.unique(np.ravel_multi_index(cells.T, shape), return_counts=True)
    return low + side * np.stack(np.unravel_index(flat, shape), axis=-1), counts
