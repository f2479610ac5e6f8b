"""V-funnel test (EN 12350-9): the time in which a funnel runs empty, until light is seen through it.

Source: top 515 mm, outlet 65 mm, thickness 75 mm, taper 450 mm, outlet 150 mm high, 10.5 l: from memory, fairly sure.
Not of the standard: the concrete falls on a floor 150 mm below the outlet, and the flap is gone at once.
Run time: about a CPU-minute at the default spacing, on a busy machine, and up to 20 s to compile.
"""

import sys
from typing import Literal

import numpy as np
from pydantic import Field

import taichi_mps as mps
from taichi_mps.units import Duration, Length


@mps.checked
def scene(
    material: mps.Concrete = mps.Bingham(yield_value=40.0, plastic_viscosity=20.0),
    spacing: Length = 0.0125,
    top: Length = Field(0.515, description="length of the opening at the top"),
    outlet: Length = Field(0.065, description="length of the outlet"),
    thickness: Length = Field(0.075, description="width of the funnel"),
    taper: Length = Field(0.45, description="height of its tapered part"),
    spout: Length = Field(0.15, description="height of the pipe below it"),
    fall: Length = Field(0.15, description="height of the outlet above the floor"),
    sides: Literal["rough", "smooth"] = "rough",
    until: Duration = 8.0,
    model: Literal["quarter", "full"] = "quarter",
) -> mps.Scene:
    """Funnel filled to the brim above a rough floor; a quarter of it between two mirror planes, or all. ``top`` and
    ``outlet`` are lengths of the openings, ``taper`` and ``spout`` heights, ``fall`` the height above the floor [m].
    The sides have no friction, or are rough and then hold back a layer a spacing thick; steel is between the two."""
    if not outlet < top:
        raise mps.SceneError(f"outlet = {outlet:g} m: must be less than top = {top:g} m")
    if min(outlet, thickness) < 4.0 * spacing:
        raise mps.SceneError(
            f"spacing = {spacing:g} m: must be at most {0.25 * min(outlet, thickness):g} m, a quarter of the outlet"
        )
    half, deep, height, reach = 0.5 * outlet, 0.5 * thickness, taper + spout, 2.5 * spacing
    wide, cell, slip = 0.5 * top, 0.5 * spacing, sides == "smooth"
    full = model == "full"
    low = -1.0 if full else 0.0  # where the computed part begins, over half of the funnel

    def at_height(z):
        """Half length [m] of the inside of the funnel, z [m] above its outlet."""
        return half + (wide - half) * np.clip((z - spout) / taper, 0.0, 1.0)

    cheek = [(half, 0.0), (wide + 4 * spacing, 0.0), (wide + 4 * spacing, height), (wide, height), (half, spout)]
    face = [(deep, 0.0), (deep + 3 * spacing, 0.0), (deep + 3 * spacing, height + reach), (deep, height + reach)]
    mirrors = tuple(mps.Plane((0.0, 0.0, 0.0), normal, mirror=True) for normal in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)))
    mirrors = () if full else mirrors

    def cheek_on(side):
        """Tapered wall at the end of x of this sign."""
        corners = [(side * x, z) for x, z in cheek][:: int(side)]
        return mps.Solid.prism(corners, cell, reach, (low * deep - reach, deep + reach), slip=slip)

    def face_on(side):
        """Upright wall at the end of y of this sign."""
        near, far = sorted((side * (deep - reach), side * (deep + 3 * spacing + reach)))
        corners = (low * wide - reach, near, -reach), (wide + reach, far, height + reach)
        return mps.Solid.of(lambda x: mps.polygon_distance(x[:, 1:] * (side, 1.0), face), *corners, cell, slip=slip)

    signs = (1.0, -1.0) if full else (1.0,)
    cheek_walls = [cheek_on(side) for side in signs]
    walls = (mps.Plane((0.0, 0.0, -fall), (0.0, 0.0, 1.0)), *mirrors, *cheek_walls, *map(face_on, signs))
    box = mps.fill(mps.Box((-wide, -deep, 0.0), (wide, deep, height)), spacing, mirrors)
    clear = np.min([wall.distance(box) for wall in cheek_walls], axis=0)
    fluid = box[(np.abs(box[:, 0]) < at_height(box[:, 2])) & (clear > 0.3 * spacing)]
    rays = np.stack(np.meshgrid(*(np.linspace(-0.8, 0.8, 9) * h for h in (half, deep))), -1).reshape(-1, 2)
    edge = 0.5 * top + 0.5 * thickness + fall + height

    cheeks = [[(side * x, z) for x, z in ((wide, height), (half, spout), (half, 0.0))] for side in (-1, 1)]
    tapered, pipe = ([*cheeks[0][k : k + 2], *cheeks[1][k : k + 2][::-1]] for k in (0, 1))

    def measure(s):
        inside = s.x[:, 2] > 0.0
        over = s.x[inside & (np.abs(s.x[:, 0]) < half + s.spacing)]
        free = [not np.any(np.hypot(*(over[:, :2] - ray).T) < 0.75 * s.spacing) for ray in rays]
        found = {"left_m3": float((s.size[inside] ** 3).sum()), "light_ratio": float(np.mean(free))}
        return found | mps.measure.grains(s, lambda x: x[:, 2] < 0.0)

    def over_time(history):
        """Time when light is seen through a twentieth of the outlet, and when half of the concrete has left."""
        left = history["left_m3"]
        return {
            "flow_time_s": mps.measure.time_of(history["time_s"], history["light_ratio"], 0.05),
            "half_time_s": mps.measure.time_of(history["time_s"], -left, -0.5 * left[0]),
        }

    def emptied(fraction):
        """Time [s] in which an ideal fluid would have left down to this fraction: outflow at sqrt(2 g z)."""
        z = np.linspace(1e-4, height, 2000)
        section = 2 * at_height(z) * thickness
        kept = np.cumsum(section) / section.sum()
        slowness = section / (outlet * thickness * np.sqrt(2 * 9.81 * z)) * (z[1] - z[0])
        return float(slowness[kept >= fraction].sum())

    def check(s, measures):
        """Check that the concrete is in the funnel or above the floor, and not faster than an ideal fluid."""
        assert mps.measure.clearance(s, walls) > 0.0, "leak through a wall"
        left = measures["left_m3"] / ((1 if full else 4) * len(fluid) * spacing**3)
        assert 0.0 <= left <= 1.0 and s.time > 0.9 * emptied(left) - 0.05, (s.time, left, emptied(left))

    return mps.Scene(
        name="v_funnel",
        material=material,
        spacing=spacing,
        fluid=fluid,
        walls=walls,
        domain=((low * edge - reach, low * edge - reach, -fall - reach), (edge, edge, height + 2 * reach)),
        until=until,
        measure=measure,
        over_time=over_time,
        check=check,
        vessel=mps.vessel(cheeks, [tapered, pipe], deep),
    )


if __name__ == "__main__":
    sys.exit(mps.main(["run", __file__, *sys.argv[1:]]))
