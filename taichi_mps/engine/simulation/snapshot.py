"""Snapshot of the fluid of a simulation, and the edge of the domain that it has crossed."""

from dataclasses import replace

import numpy as np

from ..geometry.walls import Plane
from ..particles.particles import FLUID
from ..problem.loads import AXES, Load
from ..problem.measures import Snapshot, still


def snapshot(sim) -> Snapshot:
    """Snapshot of the computed fluid of a simulation, ordered by id."""
    sim.scheme.complete_fields()
    rows = sim.particles.read()
    rows |= sim.scheme.fields_to_read(len(rows["id"]))
    rows["n"] = sim.scheme.fluid.gradient.density_ratio()
    order = fluid_by_id(rows)
    return Snapshot(
        time=sim.time,
        spacing=sim.scene.spacing,
        x=rows["x"][order],
        u=rows["u"][order],
        p=rows["p"][order],
        shear_rate=rows["shear_rate"][order],
        yielded=rows["yielded"][order].astype(bool),
        density_ratio=rows["n"][order],
        wall_x=rows["x"][rows["kind"] != FLUID],
        # side of the cross-section of a ring; of one on the axis as if it were half a spacing from it
        size=(
            np.sqrt(rows["ring"] / (2.0 * np.pi * np.maximum(rows["x"][:, 0], 0.5 * sim.scene.spacing)))[order]
            if sim.scene.axisymmetric
            else None
        ),
        mix=rows["mix"][order] if "mix" in rows else None,
        grain=sim.scheme.rigid.of_members[rows["slot"][order]] if "slot" in rows else None,
        loads=loads(sim.scene, rows, order) if sim.problem.wall_loads else {},
    )


def fluid_by_id(rows: dict) -> np.ndarray:
    """Rows of the fluid, ordered by id."""
    fluid = np.flatnonzero(rows["kind"] == FLUID)
    return fluid[np.argsort(rows["id"][fluid])]


def of_state(state: dict, spacing: float) -> Snapshot:
    """Places and velocities of the fluid in a state, in which nothing else is known."""
    order = fluid_by_id(state)
    return replace(still(state["x"][order], spacing), time=state["time"], u=state["u"][order])


def loads(scene, rows, order) -> dict[str, Load]:
    """Loads of the last step on the walls, by name."""
    found = {}
    for k, (name, number) in enumerate(scene.measured_walls.items()):
        wall = scene.walls[number]
        # about which it may turn
        axis = None if isinstance(wall, Plane) else np.ones(1) if scene.dimension == 2 else wall.unit_axis
        found[name] = Load(
            np.array(getattr(wall, "centre", wall.point), float),
            rows[f"force_{k}"][order],
            rows[f"torque_{k}"][order],
            axis,
        )
    return found


def crossing(rows: dict, scene) -> tuple[str, float] | None:
    """Edge of a scene's domain that most of the particles outside have crossed, with what enlarges the domain, in one
    line, and their largest speed [m/s]; None where no particle is outside or a position is no number. ``rows``: ``x``
    (n, d) [m] and ``u`` (n, d) [m/s]."""
    x, (low, high) = rows["x"], np.array(scene.domain, float)
    bounded = ~np.array(scene.periodic)
    beyond = np.stack([(x < low) & bounded, (x > high) & bounded], axis=-1)  # (n, d, 2)
    if not np.all(np.isfinite(x)) or not beyond.any():
        return None
    axis, end = np.unravel_index(beyond.sum(0).argmax(), (scene.dimension, 2))
    axes = "rz" if scene.axisymmetric else AXES[scene.dimension]
    out = beyond[:, axis, end]
    speed = float(np.linalg.norm(rows["u"][out], axis=1).max())
    remedy = scene.enlarged_by if scene.enlarged_by in scene.parameters else "the domain of the scene"
    return (
        f"{out.sum()} particles left the domain beyond {axes[axis]} = {scene.domain[end][axis]:.4g} m, its "
        f"{('lower', 'upper')[end]} end, at up to {speed:.3g} m/s; enlarge {remedy}",
        speed,
    )
