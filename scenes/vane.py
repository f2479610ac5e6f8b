"""Rheometer: a vane or a cylinder turns in a cup of paste or concrete; the torque on it.

Source: radii and height of the measured pastes of docs/concretes.md; blades and depth of the cup are assumed.
Run time: half a minute for a section at the default spacing, most of it to compile; full takes some minutes.
"""

import sys
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

import taichi_mps as mps
from taichi_mps.units import Count, Duration, Length, Only, Ratio, RotationSpeed


def cylinder_torque(turn, inner, outer, shear_rate):
    """Torque per height [N] on a cylinder that turns with ``turn`` [rad/s] in a cup (Reiner and Riwlin): the stress
    falls as 1/r2, and its shear rate [1/s] over twice the stress is summed up between both walls."""

    def speed(wall):
        stress = np.geomspace(wall * (inner / outer) ** 2, wall, 1000)
        change = shear_rate(stress) / (2.0 * stress)
        return 0.5 * (change[1:] + change[:-1]) @ np.diff(stress)  # the trapezoidal rule

    return 2.0 * np.pi * inner**2 * mps.rest_shapes.root(lambda wall: speed(wall) - turn, 0.0)


@mps.checked
def scene(
    material: mps.Concrete = mps.Bingham(yield_value=20.0, plastic_viscosity=1.0, density=1900.0),
    spacing: Length = 0.002,
    body: Annotated[Literal["vane", "cylinder"], Field(description="what turns")] = "vane",
    speed: Annotated[RotationSpeed, Field(description="turns of the vane a minute")] = 20.0,
    radius: Length = Field(0.02, description="radius of the vane"),
    height: Length = Field(0.06, description="height of the vane"),
    cup_radius: Length = Field(0.05, description="radius of the cup"),
    blades: Annotated[Count, Only("body", ("vane",)), Field(description="blades of the vane")] = 6,
    thickness: Annotated[Length, Only("body", ("vane",))] = Field(0.001, description="thickness of a blade"),
    turns: Annotated[Ratio, Only("until", False), Field(description="fraction of a turn that is computed")] = 0.25,
    until: Duration | None = None,
    model: Literal["section", "full"] = "section",
) -> mps.Scene:
    """A section of the cup, without weight; or all of it, with a radius of the vane below and above it."""
    if radius + 3.0 * spacing > cup_radius:
        least = radius + 3.0 * spacing
        raise mps.SceneError(f"cup_radius = {cup_radius:g} m: must leave three particles beside the vane, {least:g} m")
    whole, depth, turn = model == "full", height + 2.0 * radius, speed * np.pi / 30.0
    d = 3 if whole else 2

    def across(x):
        """Distance [m] of the section from the blades, or from the cylinder."""
        if body == "cylinder":
            return np.hypot(*x.T) - radius
        angles = 2.0 * np.pi * np.arange(blades) / blades
        blade = np.array([(0.0, -1.0), (1.0, -1.0), (1.0, 1.0), (0.0, 1.0)]) * (radius, 0.5 * thickness)
        turned = [blade @ np.array([[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]]) for a in angles]
        return np.min([mps.polygon_distance(x, corners) for corners in turned], axis=0)

    def distance(x):
        """Distance [m] from the vane."""
        if not whole:
            return across(x)
        beside, ends = across(x[:, :2]), np.abs(x[:, 2] - radius - 0.5 * height) - 0.5 * height
        return np.where(np.minimum(beside, ends) > 0.0, np.hypot(beside, ends), np.maximum(beside, ends))

    cell, room = min(0.5 * spacing, 0.5 * thickness if body == "vane" else spacing), 3.0 * spacing
    low = (-radius - room, -radius - room, radius - room)[:d]
    high = (radius + room, radius + room, radius + height + room)[:d]
    origin, axis = (0.0,) * d, (0.0, 0.0, 1.0) if whole else None
    vane = mps.Solid.of(distance, low, high, cell, angular_velocity=turn, pivot=origin, axis=axis, name="vane")
    cup = mps.Cylinder(origin, cup_radius, axis=axis, name="cup")
    floor = (mps.Plane(origin, axis, name="floor"),) if whole else ()
    x = mps.lattice((-cup_radius, -cup_radius, 0.0)[:d], (cup_radius, cup_radius, depth)[:d], spacing)
    x = x[(cup.distance(x) > 0.0) & (vane.distance(x) > 0.0)]
    closed = not (material.ages or material.friction_coefficient)  # a closed form is known
    exact = height * cylinder_torque(turn, radius, cup_radius, material.shear_rate) if closed else None

    def measure(s):
        if not s.loads:  # of a replay
            return {}
        return {"torque_N_m": -float(s.loads["vane"].torque[-1]) * (1.0 if whole else height)}

    def over_time(history):
        """The mean over the last quarter of the time, and in closed form that of a cylinder without ends."""
        late = history["time_s"] > 0.75 * history["time_s"][-1]
        steady = {"steady_torque_N_m": float(np.mean(history["torque_N_m"][late]))}
        return steady | ({"cylinder_torque_N_m": exact} if closed else {})

    def check(s, measures):
        """Check that the fluid resists the vane, and that the torque of a cylinder is that of the closed form after
        0.5 rad."""
        torque = measures["torque_N_m"]
        assert mps.measure.clearance(s, (cup, vane)) > 0.0, "leak"
        assert torque > 0.0, torque
        if closed and body == "cylinder" and not whole and s.time * turn > 0.5:
            assert abs(torque / exact - 1.0) < 0.05, (torque, exact)

    edge = cup_radius + spacing
    return mps.Scene(
        name="vane",
        material=material,
        spacing=spacing,
        fluid=x,
        walls=(*floor, cup, vane),
        domain=((-edge, -edge, -spacing)[:d], (edge, edge, 2.0 * depth)[:d]),
        gravity=None if whole else (0.0, 0.0),
        until=until or 60.0 * turns / speed,
        wall_loads=True,
        measure=measure,
        over_time=over_time,
        check=check,
    )


if __name__ == "__main__":
    sys.exit(mps.main(["run", __file__, *sys.argv[1:]]))
