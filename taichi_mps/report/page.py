"""report.html: one page of a run, that opens from the disk without a network."""

import json
from importlib.util import find_spec
from pathlib import Path
from string import Template

from ..io.history import read_history
from ..io.run_folder import RunFolder, write_whole
from ..io.vtkhdf import Trajectory
from ..problem import catalogue
from ..problem.scene import Scene
from ..units import SceneError
from .drawings import drawings, film
from .sentences import measures
from .words import words

FILM = 3_600_000  # bytes of the film before base64, which makes four of three, so that a page has less than 10 MB
NEEDS = "report needs plotly: pip install 'taichi-mps[report]'"
HERE = Path(__file__).parent
"""Templates of the page: page.html, page.css, page.js."""


class Told:
    """A run as its folder has it.

    ``path`` of the folder, ``scene``, ``source``: name or file of its function, ``every``: interval of the outputs [s],
    at which steps end, too; ``summary``: of a run that has not ``ended`` scene, mixes, time and measures of its last
    row; ``history``: columns of history.csv."""

    def __init__(self, folder: RunFolder, scene: Scene | None, scene_file):
        self.path = folder.path
        self.source, parameters, self.every = Trajectory(folder.trajectory).origin()
        self.scene = scene or catalogue.rebuild(self.source, parameters, scene_file)
        self.history = read_history(folder.history)
        if len(self.history["time_s"]) == 0:
            raise SceneError(f"run = {folder.path}: history.csv holds no row yet")
        last = {key: float(values[-1]) for key, values in self.history.items()}
        self.summary = folder.read_summary() if folder.summary.is_file() else {"simulated_seconds": -1.0}
        self.ended = last["time_s"] <= self.summary["simulated_seconds"] * (1.0 + 1e-6)  # else it went on after that
        if not self.ended:
            mixes = [mix.facts() for mix in self.scene.materials]
            known = {"scene": self.scene.name, "parameters": parameters, "materials": mixes}
            self.summary = known | {"simulated_seconds": last["time_s"]} | measures(last)


def write(folder: RunFolder, scene: Scene | None = None, scene_file=None) -> Path:
    """Write report.html of a run, at its end or of an earlier one, also of one that was killed; its path.

    ``scene``: of the run, where it is at hand; else it is made anew, one of the user's own by the code of
    ``scene_file``. SceneError where the folder is no run or damaged, or plotly is missing."""
    run = Told(folder, scene, scene_file)
    shown, last = film(Trajectory(folder.trajectory), run.scene, FILM)
    script = (HERE / "page.js").read_text(encoding="utf-8")
    return publish(HERE / "page.html", folder.report, drawings(run, shown, last), **words(run, shown), script=script)


def publish(template: Path, out: Path, data, **texts) -> Path:
    """Write a page that opens from the disk without a network: a template with texts, the style, plotly.js and data
    for its script; the path. Replaces the file at once. SceneError where plotly is missing."""
    text = Template(template.read_text(encoding="utf-8")).substitute(
        texts,
        data=json.dumps(data, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c"),
        style=(HERE / "page.css").read_text(encoding="utf-8"),
        library=library(),
    )
    write_whole(out, text)
    return out


def library() -> str:
    """The code of plotly.js as plotly's package has it, which need not be imported for it."""
    found = find_spec("plotly")
    path = Path(found.submodule_search_locations[0], "package_data", "plotly.min.js") if found else None
    if path is None or not path.is_file():
        raise SceneError(NEEDS)
    return path.read_text(encoding="utf-8")
