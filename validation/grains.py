"""Grains in mortar: the yield stress that holds a sphere, and what a suspension of spheres resists in shear."""

import numpy as np

import taichi_mps as mps

from . import Measured, record

SIZE, DENSITY, EXTRA, VISCOSITY, GRAVITY = 0.016, 2200.0, 500.0, 20.0, 9.81  # [m, kg/m3, kg/m3, Pa s, m/s2]
HELD = 0.143 / 3.0  # tau_y/(drho g d) that holds a sphere (Beris et al. 1985)
NO_CREEP = 1e-6  # speed over Stokes' below which a sphere stands


# ---- one sphere ------------------------------------------------------------------------------------------------
def sphere(across: int, number: float, until: float):
    """Speeds over Stokes' of a sphere in the middle of a closed box of 2.5 diameters with no-slip walls, up to a time
    [s] after its release, and its diameter of equal volume over the nominal one; ``number``: tau_y/(drho g d)."""
    spacing, side = SIZE / across, 2.5 * SIZE
    low, high = (0.0,) * 3, (side,) * 3
    grains = mps.Grains(diameter=SIZE, centres=[(0.5 * side,) * 3], density=DENSITY + EXTRA)
    mortar = mps.Bingham(yield_value=number * EXTRA * GRAVITY * SIZE, plastic_viscosity=VISCOSITY, density=DENSITY)
    walls = (*mps.box_planes(low, high), mps.Plane(high, (0.0, 0.0, -1.0)))
    domain = ((-4.0 * spacing,) * 3, (side + 4.0 * spacing,) * 3)
    scene = mps.Scene("sphere", mortar, spacing, mps.lattice(low, high, spacing), domain, walls, grains=grains)
    _, times, speeds = record(scene, lambda s: -s.grains.velocities[0, 2], until=until)
    equal = spacing * (6.0 / np.pi * (scene.grain_places[0] > 0).sum()) ** (1.0 / 3.0) / SIZE
    return times, speeds / (EXTRA * GRAVITY * (equal * SIZE) ** 2 / (18.0 * VISCOSITY)), equal


def held(across: int):
    """The least tau_y/(drho g d) that holds a sphere for 2 s, by five bisections of +-25 % about HELD."""
    low, high, creep = 0.75 * HELD, 1.25 * HELD, np.inf
    for _ in range(5):
        number = 0.5 * (low + high)
        _, speeds, equal = sphere(across, number, 2.0)
        stands = abs(speeds[-1]) < NO_CREEP
        low, high, creep = (low, number, abs(speeds[-1])) if stands else (number, high, creep)
    found = 0.5 * (low + high)
    yield Measured(f"tau_y/(drho g d) {found / equal:.4f}, equal volume, relative", found / equal / HELD - 1.0, 0.08)
    yield Measured(f"tau_y/(drho g d) {found:.4f}, diameter as given, relative", found / HELD - 1.0, 0.15)
    yield Measured(f"speed over Stokes' after 2 s at {high:.4f}", creep, NO_CREEP)


# ---- many ------------------------------------------------------------------------------------------------------
def suspension(across: int, fraction: float, seed: int = 1, yield_value: float = 0.0, gap: float = 6.0, until=2.0):
    """Stress on the walls [Pa] and shear rate of the middle half of the gap [1/s], by strain, of spheres as dense as
    the mortar between two walls at the mean rate of 1/s, in a box of ``gap`` diameters that is periodic."""
    spacing, side = SIZE / across, gap * SIZE
    x = mps.lattice((0.0,) * 3, (side,) * 3, spacing)
    u = (x[:, 2:] - 0.5 * side) * (1.0, 0.0, 0.0)
    walls = tuple(
        mps.Plane((0.0, 0.0, z), (0.0, 0.0, n), velocity=(-0.5 * n * side, 0.0, 0.0), name=name)
        for name, z, n in (("bottom", 0.0, 1.0), ("top", side, -1.0))
    )
    mortar = mps.Newtonian(viscosity=VISCOSITY, density=DENSITY)
    if yield_value:
        mortar = mps.Bingham(yield_value=yield_value, plastic_viscosity=VISCOSITY, density=DENSITY)
    scene = mps.Scene(
        "suspension",
        mortar,
        spacing,
        x,
        ((0.0, 0.0, -4.0 * spacing), (side, side, side + 4.0 * spacing)),
        walls,
        velocity=u,
        gravity=(0.0,) * 3,
        periodic=(True, True, False),
        grains=mps.Grains(diameter=SIZE, volume_fraction=fraction, density=DENSITY, seed=seed) if fraction else None,
        wall_loads=True,
    )

    def read(s):
        loads, state = s.measures(), s.snapshot()
        middle = np.abs(state.x[:, 2] - 0.5 * side) < 0.25 * side
        rate = np.polyfit(state.x[middle, 2], state.u[middle, 0], 1)[0]
        return 0.5 * (loads["force_bottom_x_N"] - loads["force_top_x_N"]) / side**2, rate

    _, times, found = record(scene, read, 0.1, until)
    return times, found


def viscosity(across: int, fractions=(0.1, 0.2, 0.3), seeds=(1,)):
    """Stress over that of the mortar alone, mean from a strain of 0.5 to 2, beside Krieger and Dougherty."""
    for fraction in fractions:
        found = [mean_stress(across, fraction, seed) / VISCOSITY for seed in seeds]
        law = (1.0 - fraction / 0.64) ** (-2.5 * 0.64)
        what = f"viscosity at {fraction:g}: {np.mean(found):.3f} (seeds {min(found):.3f} to {max(found):.3f}), relative"
        yield Measured(what, np.mean(found) / law - 1.0, 0.12)


def mean_stress(*arguments, **keywords) -> float:
    """Mean stress [Pa] of a suspension from a strain of 0.5 on."""
    times, found = suspension(*arguments, **keywords)
    return float(found[times > 0.45, 0].mean())
