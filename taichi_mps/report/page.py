"""report.html: one page of a run, that opens from the disk without a network."""

import json
import math
import os
from importlib.util import find_spec
from pathlib import Path
from string import Template

from ..io.history import COLUMNS, read_history
from ..io.run_folder import RunFolder
from ..io.vtkhdf import Trajectory
from ..problem import catalogue
from ..problem.scene import Scene
from ..units import SceneError
from .drawings import drawings
from .film import film
from .told import Told
from .words import words

MOST_BYTES = 9_900_000  # of a page
REST = 250_000  # bytes of it that are neither library nor film
NEEDS = "report needs plotly: pip install 'taichi-mps[report]'"
MEASURED = "slump_m", "spread_m"  # of the columns that every history has
HERE = Path(__file__).parent
"""Templates of the page: page.html, page.css, page.js."""


def write(folder: RunFolder, scene: Scene | None = None, scene_file=None) -> Path:
    """Write report.html of a run, at its end or of an earlier one, also of one that was killed; its path.

    ``scene``: of the run, where it is at hand; else it is made anew, one of the user's own by the code of
    ``scene_file``. SceneError where the folder is no run or damaged, or plotly is missing."""
    script = library()
    run = read(folder, scene, scene_file)
    room = (MOST_BYTES - REST - len(script)) * 3 // 4  # base64 makes four bytes of three
    shown = film(Trajectory(folder.trajectory), run.scene, room)
    text = Template((HERE / "page.html").read_text(encoding="utf-8")).substitute(
        words(run, shown),
        data=json.dumps(drawings(run, shown), allow_nan=False, separators=(",", ":")).replace("<", "\\u003c"),
        style=(HERE / "page.css").read_text(encoding="utf-8"),
        script=(HERE / "page.js").read_text(encoding="utf-8"),
        library=script,
    )
    partial = folder.report.with_suffix(".partial")
    partial.write_text(text, encoding="utf-8")
    os.replace(partial, folder.report)
    return folder.report


def library() -> str:
    """The code of plotly.js as plotly's package has it, which need not be imported for it."""
    found = find_spec("plotly")
    path = Path(found.submodule_search_locations[0], "package_data", "plotly.min.js") if found else None
    if path is None or not path.is_file():
        raise SceneError(NEEDS)
    return path.read_text(encoding="utf-8")


def read(folder: RunFolder, scene: Scene | None, scene_file) -> Told:
    """What the folder holds; a summary that is older than the last row is one of before the run went on."""
    source, parameters, every = Trajectory(folder.trajectory).origin()
    scene = scene or catalogue.rebuild(source, parameters, scene_file)
    history = read_history(folder.history)
    if len(history["time_s"]) == 0:
        raise SceneError(f"run = {folder.path}: history.csv holds no row yet")
    summary = folder.read_summary() if folder.summary.is_file() else {}
    if summary and history["time_s"][-1] <= summary["simulated_seconds"] * (1.0 + 1e-6):
        return Told(folder.path, scene, source, every, summary, True, history)
    last = {key: float(column[-1]) for key, column in history.items() if math.isfinite(column[-1])}
    known = {"scene": scene.name, "parameters": parameters, "materials": [mix.facts() for mix in scene.materials]}
    known["simulated_seconds"] = last.pop("time_s")
    measured = {key: value for key, value in last.items() if key in MEASURED or key not in COLUMNS}
    return Told(folder.path, scene, source, every, known | measured, False, history)
