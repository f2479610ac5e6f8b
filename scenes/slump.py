"""Slump and slump flow (JIS A 1101, A 1150): a cone of concrete whose mould is gone at once or lifted; slump, T500.

Source: Tomiyama et al. (2009), cases #1-#5: l0 = 0.01 m, about 5,330 fluid particles, density not stated there.
Run time: 5 to 30 CPU-seconds to rest with the scheme `implicit` at the default spacing; soft mixes take longest.
"""

import math
import sys
from typing import Literal

import numpy as np
from pydantic import Field

import taichi_mps as mps
from taichi_mps.units import Duration, Length, Speed, in_smaller_unit

TALLEST = 3.0  # [m]; a cone beyond was given in centimetres
BASE, FLOOR = 0.1, 0.37  # radii [m] of the standard cone, and of a floor for it; half as much room is around that

# Rest slump of the standard cone by finite elements with inertia, rho = 2300 kg/m3, eta = 50 Pa s, true Bingham:
# yield stress [Pa], slump over r < 20 mm [m]; own solution, +-0.4 mm
AT_REST = np.array([[100.0, 0.2482], [300.0, 0.2173], [500.0, 0.1799], [1000.0, 0.1015]])
TO_REST, WITHOUT = 120.0, 5.0  # time limits [s] of what comes to rest by itself, and of what does not


def floor_for(cone, material, until):
    """Radius [m] of a floor on which the mix stays until then [s]: half as far again as it flows in 30 sqrt(H/g), 5 s.
    Single particles of thin mixes roll twice as far as their body."""
    numbers = material.density, material.yield_value, material.typical_slope
    time = min(until, 30.0 * (cone.height / 9.81) ** 0.5)
    far = mps.rest_shapes.radius_of_flow(cone.volume, cone.height, *numbers, time=time)
    usual = FLOOR * (cone.base_radius / BASE)
    return usual if max(far, cone.base_radius) < 1.3 * usual else 1.5 * far


def rings_in(cone, spacing):
    """Positions (n, 3) [m] that fill a cone up to its mantle: rings in layers. A square lattice leaves gaps there, into
    which the concrete would settle, and particles that stand too close."""
    layers = []
    for z in spacing * (np.arange(round(cone.height / spacing)) + 0.5):
        radius = cone.base_radius + (cone.top_radius - cone.base_radius) * z / cone.height
        disc = mps.rings(0.0, radius, spacing)
        layers.append(np.column_stack([disc, np.full(len(disc), z)]))
    if not layers:
        raise mps.SceneError(f"spacing = {spacing:g} m: larger than the body, {cone.height:g} m high")
    return np.vstack(layers)


def mould_of(cone, speed, spacing, rings):
    """Wall that is a smooth mould, lifted at a speed [m/s] until it is off; of rings as thick as a particle."""
    off = cone.height / speed
    rise = [(0.0, speed), (off, speed), (off, 0.0)]
    if rings:
        foot, top = (cone.base_radius, cone.base_radius + spacing), (cone.top_radius + spacing, cone.top_radius)
        section = [(r, 0.0) for r in foot] + [(r, cone.height) for r in top]
        given = {"velocity": [(time, 0.0, up) for time, up in rise], "slip": True, "loose": True}
        return mps.Solid.prism(section, cell=0.25 * spacing, reach=2.5 * spacing, **given)
    return mps.Cylinder(
        point=(0.0, 0.0, 0.0),
        radius=cone.base_radius,
        axis=(0.0, 0.0, 1.0),
        slope=(cone.top_radius - cone.base_radius) / cone.height,
        length=cone.height,
        velocity=rise,
        slip=True,
        loose=True,
        thin=True,
    )


@mps.checked
def scene(
    material: mps.Concrete = mps.Bingham(),
    spacing: Length = 0.01,
    base_diameter: Length = Field(0.2, description="diameter of the cone at its foot"),
    top_diameter: Length = Field(0.1, description="diameter of the cone at its top"),
    height: Length = Field(0.3, description="height of the cone"),
    floor_radius: Length | None = Field(None, description="radius of the floor, by default as far as the mix can flow"),
    lift_speed: Speed | None = None,
    until: Duration | None = Field(
        None, description="time limit of the flow, by default 120 s, or 5 s of what does not come to rest"
    ),
    model: Literal["full", "half", "quarter", "axisymmetric"] = "full",
    accuracy: Length | None = None,
) -> mps.Scene:
    """Slump cone on a rough floor. The mould is gone at t = 0, or is smooth and lifted from then on with
    ``lift_speed`` [m/s]; the standard's 300 mm in 2 to 3 s are 0.1 to 0.15 m/s. Model half or quarter computes that
    part of the cone between mirror planes, axisymmetric its half section. With ``accuracy``, the error of the slump
    that is wanted, the cheapest model and spacing measured to reach it are taken where they are not given. The floor is
    as large as the mix can flow, unless ``floor_radius`` is given; the room for it is half as large again."""
    if height > TALLEST:
        raise mps.SceneError(f"height = {height:g} m: must be at most {TALLEST:g} m{in_smaller_unit(height, TALLEST)}")
    if lift_speed is not None and model in ("half", "quarter"):
        allowed = f"a mould that is lifted needs model = full or axisymmetric, not {model}"
        raise mps.SceneError(f"lift_speed = {lift_speed:g} m/s: {allowed}")
    if floor_radius is not None and floor_radius <= 0.5 * base_diameter:
        allowed = f"must be more than the radius of the cone, {0.5 * base_diameter:g} m"
        raise mps.SceneError(f"floor_radius = {floor_radius:g} m: {allowed}")
    until = until or (TO_REST if material.rests else WITHOUT)
    cone = mps.Cone(0.5 * base_diameter, 0.5 * top_diameter, height)
    reach = floor_radius or floor_for(cone, material, until)
    mirrors = [mps.Plane((0.0, 0.0, 0.0), normal, mirror=True) for normal in ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0))]
    mirrors = mirrors[: {"half": 1, "quarter": 2}.get(model, 0)]
    west = -spacing if model == "quarter" else -1.5 * reach
    south = -spacing if mirrors else -1.5 * reach
    floor = mps.lattice((-reach, -reach, -3 * spacing), (reach, reach, 0.0), spacing)
    rim = np.array([[-0.5 * base_diameter, 0.0], [-0.5 * top_diameter, height]])
    angles = np.linspace(0, 2 * math.pi, 49)
    ring = np.stack([np.cos(angles), np.sin(angles)], 1)
    outline = [np.array([[s * rim[0, 0], 0.0, rim[0, 1]], [s * rim[1, 0], 0.0, rim[1, 1]]]) for s in (1, -1)]
    outline += [
        np.column_stack([0.5 * w * ring, np.full(49, z)]) for w, z in ((base_diameter, 0), (top_diameter, height))
    ]
    standard = (base_diameter, top_diameter, height) == (0.2, 0.1, 0.3)
    usual = material.model_copy(update={"yield_value": 300.0}) == mps.Bingham()
    mould = [mould_of(cone, lift_speed, spacing, model == "axisymmetric")] if lift_speed else []
    known = lift_speed is None and standard and usual and 100.0 <= material.yield_value <= 1000.0

    def measure(snapshot):
        """Slump and slump flow; as long as nothing has moved, those of the mould. Where the grains are."""
        filled = {"slump_m": 0.0, "slump_max_m": 0.0, "spread_m": base_diameter}
        found = mps.measure.slump(snapshot, height=height, axis_radius=0.2 * top_diameter)
        found |= mps.measure.grains(snapshot)
        return found | filled if snapshot.time == 0.0 and not snapshot.speed.any() else found

    def check(snapshot, measures):
        """Check that the concrete is on the floor, and for the standard cone at rest that the slump is within l0 (10 mm
        at least) of finite elements."""
        assert snapshot.x[:, 2].min() > 0.0 and 0.0 <= measures["slump_m"] < height, measures
        assert np.hypot(snapshot.x[:, 0], snapshot.x[:, 1]).max() < reach, "off the floor"
        if known and snapshot.speed.max() < 0.01:
            slump = np.interp(material.yield_value, *AT_REST.T)
            assert abs(measures["slump_m"] - slump) < max(spacing, 0.01), (measures, slump)

    def over_time(history):
        """T500 of the slump flow test: time from the first lift to a slump flow of 500 mm."""
        return {"t500_s": mps.measure.time_of(history["time_s"], history["spread_m"], 0.5)}

    if model == "axisymmetric":
        parts = dict(
            axisymmetric=True,
            fluid=mps.fill_rings(cone, spacing),
            walls=(mps.Plane((0.0, 0.0), (0.0, 1.0)), *mould),
            domain=((0.0, -4 * spacing), (1.5 * reach, 1.5 * height)),
        )
    else:
        parts = dict(
            fluid=rings_in(cone, spacing) if lift_speed else mps.fill(cone, spacing, mirrors),
            walls=(mps.Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)), *mirrors, *mould),
            wall_particles=floor[np.hypot(floor[:, 0], floor[:, 1]) < reach],
            domain=((west, south, -4 * spacing), (1.5 * reach, 1.5 * reach, 1.5 * height)),
        )
    return mps.Scene(
        name="slump",
        material=material,
        spacing=spacing,
        **parts,
        until=until,
        stop_at_rest=True,
        measure=measure,
        check=check,
        over_time=over_time,
        enlarged_by="floor_radius",
        outline=tuple(outline),
        mould=cone,
    )


if __name__ == "__main__":
    sys.exit(mps.main(["run", __file__, *sys.argv[1:]]))
