"""Dam break: a column of water, width a and height 2a, collapses in a tank of width 4a; or a block leaves an open box.

Source: Koshizuka & Oka (1996), a = 0.146 m; front against Martin & Moyce (1952), z/a over t sqrt(2 g/a). Open box:
Hamamichi et al. (2023), ACM Trans. Graph. 42(6); side walls 5 mm thick are assumed.
Run time: about 20 CPU-seconds for 0.3 s at the default spacing.
"""

import sys
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

import taichi_mps as mps
from taichi_mps.units import Duration, Length, Only, Speed

# Martin & Moyce (1952) fig. 3, a = 2.25 in, n^2 = 2, digitised (+-0.05): t sqrt(2 g/a), z/a
FRONT = np.array([[0.832, 1.217], [1.219, 1.474], [1.997, 2.292], [2.547, 2.995], [3.345, 4.134]])

OPEN_BOX = Only("model", ("half",))
SIDE = 0.005  # thickness of the side walls of the open box [m]


def tank(a, spacing):
    """Parts of a scene of the tank: slip walls, the column in its left corner."""
    low, high, margin = (0.0, 0.0), (4 * a, 2 * a), 5 * spacing
    return dict(
        spacing=spacing,
        fluid=mps.fill(mps.Box((0.0, 0.0), (a, 2 * a)), spacing),
        walls=mps.box_planes(low, high, slip=True),
        wall_particles=mps.shell(low, (4 * a, 5.5 * a), spacing),  # as high as it runs up
        domain=((-margin, -margin), (4 * a + margin, 6 * a)),
    )


def open_box(a, height, depth, lift_speed, floor_length, spacing):
    """Parts of a scene of the half of an open box in front of its middle plane: a back wall, a side wall that ends at
    the gate, x = a, and a floor, all without slip. The gate is gone at once, or a smooth plate that is lifted. The
    particles are as large as fills the block exactly, a whole number along each side."""
    size = np.array([a, 0.5 * depth, height])
    count = np.maximum(1, np.round(size / spacing)).astype(int)
    fluid = size * (np.indices(count).reshape(3, -1).T + 0.5) / count
    spacing = float((size / count).prod() ** (1 / 3))
    half, reach, top, margin = 0.5 * depth, 3.0 * spacing, height + 2.0 * spacing, 4.0 * spacing
    corners = [(-reach, half), (a, half), (a, half + SIDE), (-reach, half + SIDE)]
    low, high = (-reach, half - reach, -reach), (a + reach, half + SIDE + reach, top)
    cell = min(0.5 * spacing, 0.4 * SIDE)
    side = mps.Solid.of(lambda x: mps.polygon_distance(x[:, :2], corners), low, high, cell, name="side")
    mirror = mps.Plane((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), mirror=True)
    walls = (mps.Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)), mps.Plane((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)), mirror, side)
    if lift_speed:
        plate = [(a, -reach), (a + SIDE, -reach), (a + SIDE, top), (a, top)]
        along, moves = (-reach, half + SIDE + reach), (0.0, 0.0, lift_speed)
        walls += (mps.Solid.prism(plate, cell, reach, along, velocity=moves, slip=True, loose=True, name="gate"),)
    return dict(
        spacing=spacing,
        fluid=fluid,
        walls=walls,
        domain=((-margin, -margin, -margin), (a + floor_length, half + SIDE + floor_length, 1.2 * height + margin)),
        outline=tuple(np.array([[0.0, y, 0.0], [a, y, 0.0], [a, y, height]]) for y in (-half, half)),
    )


@mps.checked
def scene(
    material: mps.Concrete = mps.Newtonian(),
    spacing: Length = 0.0073,
    column_width: Length = Field(0.146, description="width of the column, along the flow"),
    column_height: Annotated[Length | None, OPEN_BOX] = Field(
        None, description="of model half: height of the block, by default twice its width"
    ),
    depth: Annotated[Length, OPEN_BOX] = Field(0.04, description="of model half: depth of the box, across the flow"),
    floor_length: Annotated[Length | None, OPEN_BOX] = Field(
        None, description="of model half: free floor in front of the gate, by default 10 heights"
    ),
    lift_speed: Annotated[Speed | None, OPEN_BOX] = None,
    until: Duration = 0.3,
    model: Literal["plane", "half"] = "plane",
) -> mps.Scene:
    """Two-dimensional collapse of a water column in a tank; or, model half, a block that leaves an open box in space:
    rough back wall, side walls that end at the gate, rough floor that is free in front of it. The gate is gone at t =
    0, or lifted from then on with ``lift_speed``."""
    a, box = column_width, model == "half"
    height = column_height or 2.0 * a
    beyond = floor_length or 10.0 * height

    def measure(s):
        """Front and height; of the open box also the distance of the front from the gate, and the width.

        The open box's front is a fan; a camera reads its foremost point. Particles with no other within 2 l0 are drops.
        """
        found = mps.measure.front(s)
        if not box:
            return found
        ahead = s.x[np.argsort(-s.x[:, 0])[:32]]
        nearest = np.sort(np.linalg.norm(ahead[:, None] - ahead, axis=2), axis=1)[:, 1]
        found["front_m"] = float(ahead[nearest < 2.0 * s.spacing, 0].max(initial=0.0) + 0.5 * s.spacing)
        wide = float(np.abs(s.x[:, 1]).max() + 0.5 * s.spacing)
        return found | {"flow_m": found["front_m"] - a, "breadth_m": 2.0 * wide}

    def check(snapshot, measures):
        assert np.all(np.isfinite(snapshot.x)) and snapshot.x[:, -1].min() > 0, "leak through the floor"
        if box:
            assert mps.measure.clearance(snapshot, parts["walls"][:2]) > 0.0, "leak through the back wall"
            assert -0.5 * spacing <= measures["flow_m"] < beyond and measures["breadth_m"] < depth + 2.0 * beyond, (
                measures
            )
            return
        t = snapshot.time * (2 * 9.81 / a) ** 0.5
        expected = min(np.interp(t, FRONT[:, 0], FRONT[:, 1]), 4.0)  # it stays at the far wall
        assert abs(measures["front_m"] / a - expected) < 0.15 * expected, (t, measures, expected)

    parts = open_box(a, height, depth, lift_speed, beyond, spacing) if box else tank(a, spacing)
    return mps.Scene(
        name="dam_break",
        material=material,
        **parts,
        until=until,
        measure=measure,
        check=check,
        enlarged_by="floor_length" if box else "",
    )


if __name__ == "__main__":
    sys.exit(mps.main(["run", __file__, *sys.argv[1:]]))
