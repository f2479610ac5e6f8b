"""Grains in mortar: the yield stress that holds a sphere."""

import numpy as np

import taichi_mps as mps

from . import Measured, record

SIZE, DENSITY, EXTRA, VISCOSITY, GRAVITY = 0.016, 2200.0, 500.0, 20.0, 9.81  # [m, kg/m3, kg/m3, Pa s, m/s2]
HELD = 0.143 / 3.0  # tau_y/(drho g d) that holds a sphere (Beris et al. 1985)
STANDS, CREEP = 1e-4, 1e-6  # speeds over Stokes' after 2 s: of a sphere that is held, and well above the threshold


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
    """The least tau_y/(drho g d) that holds a sphere, by five bisections of +-25 % about HELD, and how fast it creeps
    at the largest."""
    low, high = 0.75 * HELD, 1.25 * HELD
    for _ in range(5):
        number = 0.5 * (low + high)
        _, speeds, equal = sphere(across, number, 2.0)
        low, high = (low, number) if abs(speeds[-1]) < STANDS else (number, high)
    found, (_, speeds, _) = 0.5 * (low + high), sphere(across, 1.25 * HELD, 2.0)
    yield Measured(f"tau_y/(drho g d) {found / equal:.4f}, equal volume, relative", found / equal / HELD - 1.0, 0.08)
    yield Measured(f"tau_y/(drho g d) {found:.4f}, diameter as given, relative", found / HELD - 1.0, 0.15)
    yield Measured("speed over Stokes' where the yield stress is a quarter above", abs(speeds[-1]), CREEP)
