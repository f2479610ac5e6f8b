"""Dam break: a column of water, width a and height 2a, collapses in a tank of width 4a.

Source: Koshizuka & Oka (1996), a = 0.146 m; front against Martin & Moyce (1952), z/a over t sqrt(2 g/a).
Run time: about 20 CPU-seconds for 0.3 s at the default spacing.
"""

import sys
from typing import Literal

import numpy as np
from pydantic import Field

import taichi_mps as mps
from taichi_mps.units import Duration, Length

# Martin & Moyce (1952) fig. 3, a = 2.25 in, n^2 = 2, digitised (+-0.05): t sqrt(2 g/a), z/a
FRONT = np.array([[0.832, 1.217], [1.219, 1.474], [1.997, 2.292], [2.547, 2.995], [3.345, 4.134]])


@mps.checked
def scene(
    material: mps.Concrete = mps.Newtonian(),
    spacing: Length = 0.0073,
    column_width: Length = Field(0.146, description="width of the column of water"),
    until: Duration = 0.3,
    model: Literal["plane"] = "plane",
) -> mps.Scene:
    """Two-dimensional collapse of a water column."""
    a = column_width
    low, high = (0.0, 0.0), (4 * a, 2 * a)
    margin = 5 * spacing

    def check(snapshot, measures):
        t = snapshot.time * (2 * 9.81 / a) ** 0.5
        expected = min(np.interp(t, FRONT[:, 0], FRONT[:, 1]), 4.0)  # it stays at the far wall
        assert abs(measures["front_m"] / a - expected) < 0.15 * expected, (t, measures, expected)
        assert np.all(np.isfinite(snapshot.x)) and snapshot.x[:, 1].min() > 0, "leak through the floor"

    return mps.Scene(
        name="dam_break",
        material=material,
        spacing=spacing,
        fluid=mps.fill(mps.Box((0.0, 0.0), (a, 2 * a)), spacing),
        walls=mps.box_planes(low, high, slip=True),
        wall_particles=mps.shell(low, (4 * a, 5.5 * a), spacing),  # as high as it runs up
        domain=((-margin, -margin), (4 * a + margin, 6 * a)),
        until=until,
        measure=mps.measure.front,
        check=check,
    )


if __name__ == "__main__":
    sys.exit(mps.main(["run", __file__, *sys.argv[1:]]))
