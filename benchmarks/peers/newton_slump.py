"""Newton's implicit material point method (`newton.solvers.SolverImplicitMPM`) on the slump cone.

    python benchmarks/peers/newton_slump.py install       # in a virtual environment of its own

Run by compare.py as `python newton_slump.py CASE.json OUT.npz`. The particles are the engine's own; voxels of ``voxel``
spacings. True yield stress: in Newton's orthogonal map of symmetric tensors the norm of a deviatoric stress is
sqrt(s:s/2) and that of a rate sqrt(2 D:D), so that its yield_stress and viscosity are tau_y and eta. friction is 0 (the
default, 0.5, is that of sand), tensile_yield_ratio 1 (no tearing, as in its viscous example), air_drag stays at its
default of 1, tolerance 1e-4 and at most 250 iterations.
The floor holds: friction 1e4, adhesion 1e6 Pa. A case with a ``lift_speed`` has the cone in a shell that is lifted from
t = 0 on with its speed [m/s]: a mesh that moves, without friction and adhesion.
"""

import resource

import numpy as np
from environments import main

NEEDS = ("newton==1.8.0", "warp-lang==1.19.0")


def shell(radii: tuple, height: float, thickness: float = 0.045, sides: int = 64) -> tuple[np.ndarray, np.ndarray]:
    """Corners (n, 3) [m] and triangles (m, 3), counter-clockwise from outside, of a mould: the mantle of a cone and the
    same ``thickness`` [m] farther out."""
    angle, k = 2.0 * np.pi * np.arange(sides) / sides, np.arange(sides)
    ring, following = np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle]), np.roll(k, -1)
    section = [(radii[0], 0.0), (radii[0] + thickness, 0.0), (radii[1] + thickness, height), (radii[1], height)]
    rims = [(sides * j, sides * ((j + 1) % 4)) for j in range(4)]
    triangles = [
        part for a, b in rims for part in ((a + k, a + following, b + following), (a + k, b + following, b + k))
    ]
    return np.vstack([r * ring + (0.0, 0.0, z) for r, z in section]), np.vstack([np.column_stack(t) for t in triangles])


def simulate(case: dict) -> dict:
    """Positions (n, 3) [m] at the case's times, and what the run cost."""
    import newton
    import warp as wp
    from newton.solvers import SolverImplicitMPM

    wp.config.quiet = True
    wp.init()
    spacing, settings = case["spacing"], case["settings"]
    x = np.array(case["fluid"])
    builder = newton.ModelBuilder()
    SolverImplicitMPM.register_custom_attributes(builder)
    builder.add_particles(
        pos=x.tolist(),
        vel=np.zeros_like(x).tolist(),
        mass=[case["volume"] / len(x) * case["density"]] * len(x),
        radius=[0.5 * (case["volume"] / len(x)) ** (1 / 3)] * len(x),
    )
    builder.add_ground_plane(cfg=newton.ModelBuilder.ShapeConfig(mu=1e4))
    model = builder.finalize(device="cpu")
    model.set_gravity((0.0, 0.0, -9.81))
    model.mpm.friction.fill_(0.0)
    model.mpm.tensile_yield_ratio.fill_(1.0)
    model.mpm.yield_stress.fill_(case["yield_value"])
    model.mpm.viscosity.fill_(case["plastic_viscosity"])
    model.mpm.collider_adhesion.fill_(1e6)
    config = SolverImplicitMPM.Config()
    config.voxel_size = settings["voxel"] * spacing
    solver = SolverImplicitMPM(model, config=config)
    now, following = model.state(), model.state()
    dt, speed = settings["dt"], case["lift_speed"]
    if speed:
        corners, triangles = shell((case["base_radius"], case["top_radius"]), case["height"])
        up = np.tile((0.0, 0.0, speed), (len(corners), 1))
        arrays = [wp.array(a, dtype=t) for a, t in ((corners, wp.vec3), (triangles.ravel(), int), (up, wp.vec3))]
        mould = wp.Mesh(*arrays)
        solver.setup_collider(
            collider_meshes=[None, mould],
            collider_body_ids=[-1, None],
            collider_friction=[1e4, 0.0],
            collider_adhesion=[1e6, 0.0],
        )
    steps = round(case["until"] / dt)
    frames, kept = [], {round(t / dt) for t in case["times"]}

    def spent():
        return sum(resource.getrusage(resource.RUSAGE_SELF)[:2])

    solver.step(now, following, None, None, dt)  # compiles what is not in the cache
    now, following = following, now
    start = spent()
    for step in range(2, steps + 1):
        if speed:  # where the mould is at the start of the step
            mould.points.assign(corners + (step - 1) * dt * up)
            mould.refit()
        solver.step(now, following, None, None, dt)
        now, following = following, now
        if step in kept:
            frames.append((step * dt, now.particle_q.numpy().copy()))
    cpu = spent() - start
    return {
        "t": np.array([t for t, _ in frames]),
        "x": np.array([x for _, x in frames]),
        "steps": steps,
        "elements": len(x),
        "cpu_seconds": cpu * steps / (steps - 1),
    }


if __name__ == "__main__":
    main("newton", NEEDS, simulate)
