"""A run for other programs: one .vtu file an output by meshio, and the .pvd that gives them their times."""

import os
from pathlib import Path

import meshio
import numpy as np

from .quantity import SceneError
from .vtkhdf import embed, point_data

CUBE, SMOOTHING = 0.3, 15  # side of the cells of a surface over l0; passes in which its mesh is smoothed


def vtu(outputs, folder, whole: bool = False, smooth: bool = False) -> int:
    """Write folder/output_00000.vtu, ... and folder/run.pvd, which opens all of them with their times [s].

    outputs: those of ``Trajectory.replay``; with ``whole`` the body of which they are the computed part; with
    ``smooth`` the surface of the whole body as triangles instead of its particles. Vertices with the fields of run.h5;
    a plane scene lies at y = 0. Returns how many; the .pvd is written anew with each.
    """
    folder = Path(folder)
    index, lines = folder / "run.pvd", []
    for number, output in enumerate(outputs):
        s = output.scene.unfold(output.snapshot()) if whole or smooth else output.snapshot()
        points, triangles = surface(s) if smooth else (None, None)
        folder.mkdir(parents=True, exist_ok=True)
        name = f"output_{number:05d}.vtu"
        if smooth:
            mesh = meshio.Mesh(points, [("triangle", triangles)])
        else:
            mesh = meshio.Mesh(embed(s.x), [("vertex", np.arange(len(s.x))[:, None])], point_data=point_data(s))
        meshio.write(folder / name, mesh, file_format="vtu")
        lines.append(f'    <DataSet timestep="{s.time!r}" part="0" file="{name}"/>')
        text = ['<?xml version="1.0"?>', '<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">']
        text += ["  <Collection>", *lines, "  </Collection>", "</VTKFile>", ""]
        partial = index.with_suffix(".partial")
        partial.write_text("\n".join(text), encoding="utf-8")
        os.replace(partial, index)
    return len(lines)


def surface(s) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) [m] and triangles (m, 3) of the smoothed surface of a body in three dimensions, by pysplashsurf
    (extra ``surface``): the level set at 0.6 of the density of spheres of the spacing, with weighted smoothing."""
    try:
        import pysplashsurf
    except ImportError:
        raise SceneError("surface: needs pysplashsurf: pip install 'taichi-mps[surface]'") from None
    if s.x.shape[1] != 3:
        raise SceneError("surface: the scene is a plane one; must have three dimensions")
    made, _ = pysplashsurf.reconstruction_pipeline(
        np.ascontiguousarray(s.x, np.float64),
        particle_radius=0.5 * s.spacing,
        smoothing_length=2.0,  # in radii, as the next
        cube_size=2.0 * CUBE,
        iso_surface_threshold=0.6,
        mesh_smoothing_iters=SMOOTHING,
        mesh_cleanup=True,
    )
    return np.asarray(made.mesh.vertices, float), np.asarray(made.mesh.triangles).astype(np.int64)
