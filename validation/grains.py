"""Grains in mortar: the yield stress that holds a sphere, viscosity and yield stress of a suspension."""

import numpy as np

import taichi_mps as mps
from taichi_mps.study.mortar import growth

from . import Measured, record

SIZE, DENSITY, EXTRA, VISCOSITY, GRAVITY = 0.016, 2200.0, 500.0, 20.0, 9.81  # [m, kg/m3, kg/m3, Pa s, m/s2]
HELD = 0.143 / 3.0  # tau_y/(drho g d) that holds a sphere (Beris et al. 1985)
EINSTEIN, PACKED = 2.5, 0.64  # intrinsic viscosity of spheres (Einstein 1906), volume fraction at which they jam
LIGHT = 20.0  # density [kg/m3] with which a shear is steady after some milliseconds
NEWTONIAN = mps.Newtonian(viscosity=VISCOSITY, density=LIGHT)
THIN = mps.Newtonian(viscosity=1e-3, density=1000.0)  # the law where there is no mortar
LUBE, FLOOR = 1.24, np.pi / 12.0 * SIZE  # run-out over radius and aspect ratio (Lube et al. 2004); mean height [m]
YIELDING = mps.Bingham(yield_value=100.0, plastic_viscosity=1.0, density=LIGHT)  # all but yield stress at 1/s
STANDS, CREEP = (
    1e-4,
    1e-6,
)  # speeds over Stokes': after 2 s of a sphere that is held, after 5 s well above the threshold


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
    found, (_, speeds, _) = 0.5 * (low + high), sphere(across, 1.25 * HELD, 5.0)
    yield Measured(f"tau_y/(drho g d) {found / equal:.4f}, equal volume, relative", found / equal / HELD - 1.0, 0.08)
    yield Measured(f"tau_y/(drho g d) {found:.4f}, diameter as given, relative", found / HELD - 1.0, 0.15)
    yield Measured("speed over Stokes' after 5 s where the yield stress is a quarter above", abs(speeds[-1]), CREEP)


def thickened(
    across: int, wide: int, strain: float, law=NEWTONIAN, numerics=None, change=np.array, **grains
) -> tuple[float, float]:
    """Shear stress of a fluid with grains over that without, mean of the second half of a strain, and the volume
    fraction of their particles; between plates ``wide`` diameters apart, periodic along them, at 1/s; ``change``: of
    the first positions."""
    spacing, side = SIZE / across, wide * SIZE
    x = change(mps.lattice((0.0,) * 3, (side,) * 3, spacing))
    walls = [
        mps.Plane((0.0, 0.0, z), (0.0, 0.0, n), velocity=(-0.5 * n * side, 0.0, 0.0), name=name)
        for z, n, name in ((0.0, 1.0, "lower"), (side, -1.0, "upper"))
    ]
    scene = mps.Scene(
        "suspension",
        law,
        spacing,
        x,
        ((0.0, 0.0, -4.0 * spacing), (side, side, side + 4.0 * spacing)),
        walls,
        velocity=(x[:, 2:] - 0.5 * side) * [1.0, 0.0, 0.0],
        gravity=(0.0,) * 3,
        periodic=(True, True, False),
        grains=mps.Grains(diameter=SIZE, density=LIGHT, **grains),
        wall_loads=True,
        until=strain,
    )

    def stress(sim):
        forces = [load.force[0] for load in sim.snapshot().loads.values()]
        return 0.5 * (forces[0] - forces[1]) / (law.shear_stress(1.0, 1.0) * side**2)

    _, times, stresses = record(scene, stress, until=strain, **(numerics or {}))
    return float(stresses[times > 0.5 * strain].mean()), float((scene.grain_places[0] > 0).mean())


def dilute(across):
    """What one sphere in a cube of four diameters adds to the shear stress, over its volume fraction."""
    for each in across:
        relative, volume = thickened(each, 4, 0.03, centres=[(2.0 * SIZE,) * 3])
        found = (relative - 1.0) / volume
        yield Measured(f"intrinsic viscosity {found:.2f}, {each} across, relative", found / EINSTEIN - 1.0, 0.12)


def placings(seeds: int):
    """Mean viscosity of small suspensions, moved aside or in other rows, less that as it is, over the scatter of
    seeds."""
    ways = {
        "as it is": np.array,
        "moved by 1e-6 l0": lambda x: x + np.random.default_rng(1).uniform(-1e-6, 1e-6, x.shape) * SIZE / 4,
        "rows permuted": np.random.default_rng(1).permutation,
    }
    found = {
        name: np.array(
            [thickened(4, 3, 1.0, change=way, volume_fraction=0.3, seed=seed)[0] for seed in range(1, 1 + seeds)]
        )
        for name, way in ways.items()
    }
    usual = found.pop("as it is")
    for name, each in found.items():
        yield Measured(
            f"{name}: mean {each.mean():.3f} for {usual.mean():.3f}, each within {np.abs(each - usual).max():.3f}, "
            f"over the scatter {usual.std(ddof=1):.3f}",
            (each.mean() - usual.mean()) / usual.std(ddof=1),
            1.0,
        )


def dry_column(wide: int, seeds: int):
    """Run-out of a column of dry spheres over its radius and aspect ratio: a quarter between planes without friction,
    placed at random and settled in a tube, which is then drawn up at 2 m/s, on a floor of half spheres. Its height is
    twice the mean of theirs above the mean floor, the last radius that of the outermost, a mean of six sectors."""
    spacing, radius, settled = SIZE / 4, wide * SIZE, 0.25
    x = mps.lattice((0.0, 0.0, 0.5 * SIZE), (radius, radius, 2.0 * radius), spacing)
    x, end = x[np.hypot(*x[:, :2].T) < radius], 4.0 * radius
    speeds = ((0.0, 0.0), (settled, 0.0), (settled, 2.0), (settled + 0.12, 2.0), (settled + 0.12, 0.0))
    walls = (
        mps.Solid.of(bumps, (-2.0 * SIZE,) * 3, (end + SIZE, end + SIZE, 2.0 * SIZE), 0.5 * spacing),
        mps.Plane((0.0,) * 3, (1.0, 0.0, 0.0), slip=True),
        mps.Plane((0.0,) * 3, (0.0, 1.0, 0.0), slip=True),
        mps.Cylinder((0.0,) * 3, radius, (0.0, 0.0, 1.0), inside=True, velocity=speeds, slip=True, length=3.0 * radius),
    )
    domain, found = ((-SIZE,) * 3, (end, end, 2.2 * radius)), []

    def shape(sim):
        across, up, height = sim.grains.centres.T
        sector = (np.arctan2(up, across) * 12.0 / np.pi).astype(int)
        reach = [np.hypot(across, up)[sector == k].max() + 0.5 * SIZE for k in range(6)]
        return 2.0 * (height.mean() - FLOOR), np.mean(reach)

    for seed in range(1, 1 + seeds):
        grains = mps.Grains(diameter=SIZE, volume_fraction=0.3, seed=seed)
        number, centres, *_ = grains.places(x, spacing, domain, (False,) * 3)
        grains = mps.Grains(diameter=SIZE, centres=centres, friction=0.5)
        scene = mps.Scene("column", THIN, spacing, x[number > 0], domain, walls, grains=grains)
        _, times, shapes = record(scene, shape, until=1.0)
        found.append((shapes[-1, 1] - radius) / np.interp(settled, times, shapes[:, 0]))
    yield Measured(
        f"run-out {np.mean(found):.2f} ({min(found):.2f} to {max(found):.2f}) times the aspect ratio, relative",
        np.mean(found) / LUBE - 1.0,
        0.15,
    )


def segregation(number: float, until: float, seeds: int, rate=0.0):
    """Grains of the top third that are left there after a time [s], a tenth of the volume of a column of 0.1 x 0.1 x
    0.3 m; ``number``: tau_y/(drho g d), ``rate``: shear rate [1/s] between two sides, periodic along them."""
    low, high, found = (0.0,) * 3, (0.1, 0.1, 0.3), []
    walls = mps.box_planes(low, high)
    if rate:
        walls = [walls[0]] + [
            mps.Plane((0.0, y, 0.0), (0.0, n, 0.0), velocity=(-0.05 * n * rate, 0.0, 0.0))
            for y, n in ((0.0, 1.0), (0.1, -1.0))
        ]
    for seed in range(1, 1 + seeds):
        scene = mps.Scene(
            "column",
            mps.Bingham(yield_value=number * EXTRA * GRAVITY * SIZE, plastic_viscosity=1.0, density=DENSITY),
            SIZE / 4,
            mps.lattice(low, high, SIZE / 4),
            ((-SIZE * (not rate), -SIZE, -SIZE), (0.1 + SIZE * (not rate), 0.1 + SIZE, 0.34)),
            walls,
            periodic=(bool(rate), False, False),
            grains=mps.Grains(diameter=SIZE, volume_fraction=0.1, density=DENSITY + EXTRA, seed=seed),
        )
        _, _, heights = record(scene, lambda s: s.grains.centres[:, 2], until=until)
        found.append(np.mean(heights[-1] > 0.2) / np.mean(heights[0] > 0.2))
    yield Measured(
        f"left of the top third {np.mean(found):.3f} ({min(found):.3f} to {max(found):.3f}) less what should be",
        np.mean(found) - (number > HELD and not rate),
        0.05,
    )


def bumps(x):
    """Distance [m] of points from a floor of half spheres side by side, whose mean height is FLOOR."""
    return np.minimum(
        x[:, 2], np.hypot(np.hypot(*((x[:, :2] / SIZE + 0.5) % 1.0 - 0.5).T) * SIZE, x[:, 2]) - 0.5 * SIZE
    )


def suspensions(across, fractions, law=NEWTONIAN, strain=2.0, seeds=5):
    """Viscosity of suspensions over that of their fluid, with a law that yields their yield stress, in a cube of six
    diameters, sheared to a strain, mean of some seeds."""
    # these change a viscous stress by less than 0.5 % (4 across, 0.3, strain 0.2) and add 2.4 % to that of a law that
    # yields (4 across, 0.25, 3 diameters, strain 0.5)
    numerics = {"courant_number": 0.4, "passes": 3}
    constant, bound = ("yield stress", 0.15) if law.yields else ("viscosity", 0.12)
    for part in fractions:
        known = growth(part)["yield_value"] if law.yields else (1.0 - part / PACKED) ** (-EINSTEIN * PACKED)
        found = [
            thickened(across, 6, strain, law, numerics, volume_fraction=part, seed=seed)[0]
            for seed in range(1, 1 + seeds)
        ]
        yield Measured(
            f"{np.mean(found):.2f}{f' ({min(found):.2f} to {max(found):.2f})' * (seeds > 1)} times the {constant} at "
            f"{part:g}, relative",
            np.mean(found) / known - 1.0,
            bound,
        )
