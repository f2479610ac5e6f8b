"""The smooth surface of a body of particles, by pysplashsurf, for pictures and exports."""

from dataclasses import replace

import numpy as np

from ..problem.measures import Snapshot
from ..units import require

CUBE, SMOOTHING = 0.3, 15  # side of the cells of a surface over l0; smoothing iterations of its mesh
CUBE_OF_PICTURES = 0.6  # which takes a fifth of the time and is as smooth
LEVEL, LEVEL_OF_PICTURES = 0.6, 0.5  # of the surface, in densities of spheres; of pictures half a spacing outside
BLOCK = 32  # cells along the sides of the blocks that are computed one by one; with 64 half as long again
MOST_CELLS = 1e6  # along an axis: their number is a 64-bit integer
FIELDS = ("u", "p", "shear_rate", "yielded", "density_ratio")


def smooth_surface(s: Snapshot, cube: float = CUBE, fields=FIELDS) -> tuple[Snapshot, np.ndarray, np.ndarray]:
    """Surface of a whole body in three dimensions: a snapshot of its k vertices, with these fields of the particles
    and their mix interpolated to them, zero in the others; their outward normals (k, 3), and its triangles (m, 3), rows
    of the vertices. cube: side of its cells over l0.

    The level set at LEVEL of the density of spheres of the spacing, with weighted smoothing (Loeschner et al., 2023,
    "Weighted Laplacian smoothing for surface reconstruction of particle-based fluids"). It lies 0.2 to 0.5 spacings
    outside of the outermost particles; a particle alone becomes a ball of 1.2 spacings.
    """
    require(s.x.shape[1] == 3, "surface: the scene is a plane one; must have three dimensions")
    import pysplashsurf

    size = np.ptp(s.x, axis=0).max() / (cube * s.spacing) if len(s.x) else 0.0
    require(size < MOST_CELLS, f"surface: the body is {size:.2g} cells long; must be at most {MOST_CELLS:g}")
    exact = cube == CUBE
    real = np.float64 if exact else np.float32  # takes a quarter less, and a picture has no finer points
    given = {name: np.ascontiguousarray(getattr(s, name), real) for name in fields}
    mixes = np.arange(s.mix.max(initial=0) + 1) if s.mix.any() else ()
    given |= {f"mix {k}": (s.mix == k).astype(real) for k in mixes}
    made, _ = pysplashsurf.reconstruction_pipeline(
        np.ascontiguousarray(s.x, real),
        attributes_to_interpolate=given,
        particle_radius=0.5 * s.spacing,
        smoothing_length=2.0,  # in radii, as the next
        cube_size=2.0 * cube,
        subdomain_num_cubes_per_dim=BLOCK,
        iso_surface_threshold=LEVEL if exact else LEVEL_OF_PICTURES,
        mesh_smoothing_iters=SMOOTHING,
        mesh_cleanup=True,
        compute_normals=True,
        normals_smoothing_iters=None if exact else SMOOTHING,
    )
    at = {name: np.asarray(values, float) for name, values in made.point_attributes.items()}
    points = np.asarray(made.mesh.vertices, float)
    zero = np.zeros(len(points))
    whole = {name: at.get(name, 0.0 * points if name == "u" else zero) for name in FIELDS}
    whole["yielded"] = whole["yielded"] > 0.5
    whole["mix"] = np.argmax([at[f"mix {k}"] for k in mixes], axis=0) if len(mixes) else zero.astype(int)
    vertices = replace(s, x=points, size=zero + s.spacing, **whole)
    # a point that belongs to triangles without area has no normal
    return vertices, np.nan_to_num(at["normals"]), np.asarray(made.mesh.triangles).astype(np.int64)
