"""Flow table: a cone of concrete or mortar on a table that is dropped, jolt by jolt; spread, class F1 to F6.

Source: EN 12350-5 (mould 200 mm high, 130 on 200 mm; table of 700 mm, 16 kg, hinged at one side, its free edge lifted
40 mm, 15 times) and ASTM C1437 with C230 (mould 50 mm high, 70 on 100 mm; drops of 12.7 mm, 25 times in 15 s).
Run time: a minute of CPU for mortar in rings, some minutes for concrete in the half model.
"""

import sys
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

import taichi_mps as mps
from taichi_mps.units import Count, Duration, Length

G = 9.81  # [m/s2]
TABLE, PLATE = 0.7, 16.0  # length [m] and mass [kg] of the hinged top
CLASSES = 0.345, 0.415, 0.485, 0.555, 0.625  # spread [m] from which on F2 to F6, read to 10 mm


def turn_of_table(drop, mass):
    """Angular velocity [1/s] at which a hinged plate with a mass [kg] on its middle hits its stop, by the energy of the
    fall of its free edge by ``drop`` [m]."""
    return np.sqrt(G * drop * (PLATE + mass) / (PLATE / 3.0 + mass / 4.0)) / TABLE


@mps.checked
def scene(
    material: mps.Concrete = mps.Bingham(yield_value=600.0, plastic_viscosity=30.0),
    spacing: Length = 0.01,
    base_diameter: Length = Field(0.2, description="diameter of the cone at its foot"),
    top_diameter: Length = Field(0.13, description="diameter of the cone at its top"),
    height: Length = Field(0.2, description="height of the cone"),
    drop: Length = Field(0.04, description="height by which the free edge of the table, or all of it, is dropped"),
    jolts: Annotated[Count, Field(description="number of drops")] = 15,
    period: Duration = Field(2.0, description="time between two drops"),
    wait: Duration = Field(2.0, description="time from the lift of the mould to the first drop"),
    table: Annotated[Literal["hinged", "level"], Field(description="turns about one side, or drops level")] = "hinged",
    until: Duration | None = None,
    model: Literal["half", "axisymmetric"] = "half",
) -> mps.Scene:
    """The mould is gone at once. A drop is a jolt: the velocity at which the table hits its stop, in the frame of the
    table, which stays level; between them gravity alone acts. Rings can only drop level: of a hinged table at the speed
    of its middle."""
    cone = mps.Cone(0.5 * base_diameter, 0.5 * top_diameter, height)
    rings, hinged = model == "axisymmetric", table == "hinged"
    d = 2 if rings else 3
    turn = turn_of_table(drop, cone.volume * material.density)
    speed = 0.5 * TABLE * turn if hinged else np.sqrt(2.0 * G * drop)
    times = wait + period * np.arange(jolts)
    given = {"velocity": (0.0,) * (d - 1) + (-speed,)}
    if hinged and not rings:  # the hinge is the line x = -TABLE/2, z = 0, the mirror plane is y = 0
        given = {"velocity": (0.0, 0.0, 0.0), "angular_velocity": turn, "axis": (0.0, 1.0, 0.0)}
        given["pivot"] = (-0.5 * TABLE, 0.0, 0.0)
    reach = max(0.5 * TABLE, 2.0 * base_diameter) if hinged else 2.0 * base_diameter
    mirror = mps.Plane((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), mirror=True)
    walls = (mps.Plane((0.0,) * d, (0.0,) * (d - 1) + (1.0,)), *(() if rings else (mirror,)))

    def measure(s):
        """Slump flow, the mean diameter of all directions (the standard: of two at right angles), and height."""
        return {"spread_m": mps.measure.spread(s), "height_m": float((s.x[:, 2] + 0.5 * s.size).max())}

    def over_time(history):
        """Spread before the first and after each jolt, to 10 mm, of a level table to 1 mm, and what that is called."""
        time, spread = history["time_s"], history["spread_m"]
        time, spread = time[~np.isnan(spread)], spread[~np.isnan(spread)]
        done = enumerate(times[times <= time[-1] + 1e-9])
        digits = 2 if hinged else 3
        found = {f"spread_after_{k}_jolts_m": round(float(np.interp(jolt, time, spread)), digits) for k, jolt in done}
        if time[-1] > times[-1] + 0.05:
            last = round(float(spread[-1]), digits)
            found |= {f"spread_after_{jolts}_jolts_m": last, "flow_ratio": last / base_diameter - 1.0}
            found |= {"flow_class_number": 1.0 + float(np.searchsorted(CLASSES, last))} if hinged else {}
        return found

    def check(s, measures):
        """Check that the mortar is on the table, no narrower than the mould and no wider than the table."""
        assert s.x[:, -1].min() > 0.0 and base_diameter - 2.0 * spacing < measures["spread_m"] < 2.0 * reach, measures

    low, high = (-1.2 * reach,) * (d - 1), (1.2 * reach,) * (d - 1)
    low = (0.0,) if rings else (low[0], -spacing)
    return mps.Scene(
        name="flow_table",
        material=material,
        spacing=spacing,
        fluid=mps.fill_rings(cone, spacing) if rings else mps.fill(cone, spacing, [mirror]),
        axisymmetric=rings,
        walls=walls,
        domain=((*low, -4.0 * spacing), (*high, 2.0 * height)),
        jolts=tuple(mps.Jolt(float(time), **given) for time in times),
        until=until or float(times[-1] + period),
        stop_at_rest=True,
        measure=measure,
        over_time=over_time,
        check=check,
        mould=cone,
        outline=() if rings else (0.5 * TABLE * np.array([(-1, 0, 0), (-1, 1, 0), (1, 1, 0), (1, 0, 0)]),),  # its plate
    )


if __name__ == "__main__":
    sys.exit(mps.main(["run", __file__, *sys.argv[1:]]))
