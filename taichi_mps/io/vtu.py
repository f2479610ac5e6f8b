"""Export of a run for other programs: one .vtu file for each output, by meshio, and a .pvd with their times."""

import re
from collections.abc import Iterable

import meshio
import numpy as np

from ..units import Flag, Place, SceneError, quote, require, validated, writing
from ..viz.body import smooth_surface
from .vtkhdf import embed_single, point_data

OUTPUT_NAME = re.compile(r"output_\d{5,}\.vtu|run\.pvd")  # files that ``vtu`` writes


@validated
def vtu(outputs: Iterable, folder: Place, whole: Flag = False, smooth: Flag = False) -> int:
    """Write a run as output_00000.vtu, ... and run.pvd, which opens all of them with their times.

    Parameters
    ----------
    outputs : iterable of Frame
        Outputs, as ``Trajectory.checked_replay`` gives them.
    folder : path-like
        New or empty folder.
    whole : bool, optional
        Write the whole body of which the outputs are the computed part.
    smooth : bool, optional
        Write the surface of the whole body as triangles instead of its particles.

    Returns
    -------
    int
        How many files.

    Raises
    ------
    SceneError
        If the folder holds other files or cannot be written.

    Examples
    --------
    >>> import tempfile, pathlib, taichi_mps as mps
    >>> from taichi_mps.engine.simulation.frame import Frame
    >>> from taichi_mps.io.vtu import vtu
    >>> scene = mps.slump_cone(model="axisymmetric", spacing=0.05)
    >>> outputs = [Frame(scene, mps.measure.still(scene.fluid, scene.spacing))]
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     vtu(outputs, folder, whole=True)
    ...     sorted(path.name for path in pathlib.Path(folder).iterdir())
    1
    ['output_00000.vtu', 'run.pvd']
    """
    if others := [path.name for path in folder.glob("*") if not OUTPUT_NAME.fullmatch(path.name)]:
        raise SceneError(f"out = {folder}: holds other files, such as {others[0]}; must be a new or empty folder")
    lines = []
    for number, output in enumerate(outputs):
        require(hasattr(output, "snapshot"), f"outputs = {quote(output, '')}: must be those of Trajectory.replay")
        s = output.scene.unfold(output.snapshot()) if whole or smooth else output.snapshot()
        cells = [("vertex", np.arange(len(s.x))[:, None])]
        if smooth:
            s, _, triangles = smooth_surface(s)
            cells = [("triangle", triangles)]
        with writing("out", folder, " folder"):
            folder.mkdir(parents=True, exist_ok=True)
        name = f"output_{number:05d}.vtu"
        meshio.write(folder / name, meshio.Mesh(embed_single(s.x), cells, point_data=point_data(s)), file_format="vtu")
        lines.append(f'    <DataSet timestep="{s.time!r}" part="0" file="{name}"/>')
    require(lines, "outputs: are none; must be those of Trajectory.replay")
    text = [
        '<?xml version="1.0"?>',
        '<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">',
        "  <Collection>",
        *lines,
        "  </Collection>",
        "</VTKFile>",
        "",
    ]
    (folder / "run.pvd").write_text("\n".join(text), encoding="utf-8")
    return len(lines)
