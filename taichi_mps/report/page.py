"""report.html: one page of a run, that opens from the disk without a network."""

import json
from base64 import b64encode
from io import BytesIO
from pathlib import Path
from string import Template

from PIL import Image

from ..io.history import read_history
from ..io.run_folder import RunFolder, write_whole
from ..io.vtkhdf import Trajectory
from ..problem import catalogue
from ..problem.scene import Scene
from ..units import SceneError
from .drawings import drawings
from .film import film
from .sentences import measures
from .words import words

HERE = Path(__file__).parent
"""Parts of the page: page.html, page.css, and the scripts charts.js, viewer.js and page.js."""


class Told:
    """A run as its folder has it.

    ``folder`` and its ``path``, ``scene``, ``source``: name or file of its function, ``every``: interval of the outputs
    [s], at which steps end, too; ``summary``: of a run that has not ``ended`` scene, mixes, time and measures of its
    last row; ``history``: columns of history.csv."""

    def __init__(self, folder: RunFolder, scene: Scene | None, scene_file):
        self.folder, self.path = folder, folder.path
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


def write(folder: RunFolder, scene: Scene | None = None, scene_file=None, title=None, note=None) -> Path:
    """Write report.html of a run, at its end or of an earlier one, also of one that was killed; its path.

    ``scene``: of the run, where it is at hand; else it is made anew, one of the user's own by the code of
    ``scene_file``. ``title`` and ``note``: a remark of the user's; by default those that the run was given. SceneError
    where the folder is no run or damaged."""
    run = Told(folder, scene, scene_file)
    run.summary |= {key: text for key, text in (("title", title), ("note", note)) if text}
    shown, last = film(Trajectory(folder.trajectory), run.scene, run.history)
    scripts = {name: (HERE / f"{name}.js").read_text(encoding="utf-8") for name in ("viewer", "page")}
    texts = words(run, shown) | scripts | {"still": still(folder)}
    return publish(HERE / "page.html", folder.report, drawings(run, shown, last), **texts)


def still(folder: RunFolder) -> str:
    """The last picture of a run without what is written above it, for a page that is printed or shows no film; as the
    address of an image, empty where the run has none."""
    if not folder.pictures:
        return ""
    jpeg = BytesIO()
    with Image.open(folder.pictures[-1]) as picture:
        wide, tall = picture.size
        picture.convert("RGB").crop((wide // 16, int(0.16 * tall), wide - wide // 16, int(0.97 * tall))).save(
            jpeg, "JPEG", quality=85
        )
    return f"data:image/jpeg;base64,{b64encode(jpeg.getvalue()).decode()}"


def publish(template: Path, out: Path, data, **texts) -> Path:
    """Write a page that opens from the disk without a network: a template with texts, the style, the code of curves,
    and data for its scripts; the path. Replaces the file at once."""
    text = Template(template.read_text(encoding="utf-8")).substitute(
        texts,
        data=json.dumps(data, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c"),
        style=(HERE / "page.css").read_text(encoding="utf-8"),
        charts=(HERE / "charts.js").read_text(encoding="utf-8"),
    )
    write_whole(out, text)
    return out
