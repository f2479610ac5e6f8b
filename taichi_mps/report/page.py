"""Writer of report.html, a page of a run that opens from the disk without a network; all text from outside is
escaped."""

import json
import shlex
from base64 import b64encode
from contextlib import suppress
from datetime import datetime
from html import escape
from io import BytesIO
from pathlib import Path
from string import Template

from PIL import Image

from .. import __version__
from ..engine import FLOW_THRESHOLD, NUMERICS, Problem, Scene
from ..forecast import accuracy
from ..input import catalogue
from ..input.labels import in_words, mix_in_words
from ..io.history import read_history
from ..io.run_folder import RunFolder, write_whole
from ..io.vtkhdf import Trajectory
from ..units import SceneError, plain, require
from . import inputs, sentences
from .drawings import drawings, film_data

PAGE_PARTS = Path(__file__).parent
"""Parts of the page: page.html, page.css, and the scripts charts.js, viewer.js, film.js and page.js."""


class RunRecord:
    """Record of a run, read from its folder.

    ``folder`` and its ``path``; ``scene`` and the ``scene_file`` of its code; ``source``: name or file of its function;
    ``every``: interval of the outputs [s]; ``summary``, for a run that has not ``ended`` of scene, mixes, time and
    measures of its last row only; ``history``: columns of history.csv."""

    def __init__(self, folder: RunFolder, scene: Scene | None, scene_file):
        self.folder, self.path, self.scene_file = folder, folder.path, scene_file
        trajectory = Trajectory(folder.trajectory)
        self.source, parameters, self.every = trajectory.origin()
        self.scene = scene or trajectory.rebuilt(scene_file)
        self.history = read_history(folder.history)
        require(len(self.history["time_s"]), f"run = {folder.path}: history.csv holds no row yet")
        last = {key: float(values[-1]) for key, values in self.history.items()}
        self.summary = folder.read_summary() if folder.summary.is_file() else {"simulated_seconds": -1.0}
        self.ended = last["time_s"] <= self.summary["simulated_seconds"] * (1.0 + 1e-6)  # else it went on after that
        if not self.ended:
            self.summary = {
                "scene": self.scene.name,
                "parameters": parameters,
                "materials": [mix.facts() for mix in self.scene.materials],
                "simulated_seconds": last["time_s"],
                **sentences.measures(last),
            }


def write(
    folder: RunFolder, scene: Scene | None = None, scene_file=None, title=None, note=None, finish=lambda: None
) -> Path:
    """Write report.html of a run, finished or killed, and return its path.

    ``scene``: scene of the run, made again by default, a user's own by the code of ``scene_file``. ``title`` and
    ``note``: texts of the user, by default those that the run was given. ``finish`` is called before the last picture
    is read. SceneError if the folder is no run or damaged."""
    run = RunRecord(folder, scene, scene_file)
    run.summary |= {key: text for key, text in (("title", title), ("note", note)) if text}
    shown, last = film_data(Trajectory(folder.trajectory), run.scene, run.history)
    template, style, *scripts = (
        (PAGE_PARTS / name).read_text(encoding="utf-8")
        for name in ("page.html", "page.css", "charts.js", "viewer.js", "film.js", "page.js")
    )
    texts = page_texts(run, shown) | dict(zip(("charts", "viewer", "film", "page"), scripts, strict=True))
    data = json.dumps(drawings(run, shown, last), allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
    finish()
    write_whole(folder.report, Template(template).substitute(texts, style=style, data=data, still=last_picture(folder)))
    return folder.report


def last_picture(folder: RunFolder) -> str:
    """Last picture of a run without its titles, for a printed page or one that shows no film, as a data URL; empty if
    the run has no picture."""
    if not folder.pictures:
        return ""
    jpeg = BytesIO()
    with Image.open(folder.pictures[-1]) as picture:
        wide, tall = picture.size
        picture.convert("RGB").crop((wide // 16, int(0.16 * tall), wide - wide // 16, int(0.97 * tall))).save(
            jpeg, "JPEG", quality=85
        )
    return f"data:image/jpeg;base64,{b64encode(jpeg.getvalue()).decode()}"


# ---- texts and tables --------------------------------------------------------------------------------------------
def page_texts(run, film: dict) -> dict[str, str]:
    """Texts of the placeholders of page.html, by name."""
    summary, later = run.summary, "<p>Said when the run has ended.</p>"
    repeat = repeat_command(run) if run.ended else f"resume {shlex.quote(str(run.path))}"
    numerics = run.ended and table(sentences.numerics(summary)) + f"<p>{safe(sentences.cost(summary))}</p>"
    measured, name = sentences.main_results(summary), catalogue.describe().get(run.source, "").partition(":")[0]
    return {
        "title": safe(summary.get("title") or name or in_words(str(summary["scene"]))),
        "meta": safe(", ".join([*dates(run), *map(mix_in_words, (summary.get("materials") or [])[:1])])),
        "note": f'<p class="remark">{safe(summary["note"])}</p>' if summary.get("note") else "",
        "verdict": safe(" ".join(sentences.verdicts(summary) if run.ended else [])),
        "lead": safe(f"{measured[:-1]}; {sentences.ending(summary, mixes=False)}" if run.ended else measured),
        "doubts": "\n".join(f'<p class="doubt">{safe(text)}</p>' for text in doubts(run)),
        "about": safe(" ".join(view_notes(film, run.scene))),
        "results": table(sentences.rows(summary)) or "<p>Nothing was measured.</p>",
        "inputs": table(input_rows(run)),
        "accuracy": accuracy_section(summary) if run.ended else later,
        "command": safe(f"taichi-mps {repeat}"),
        "versions": safe(versions(run)),
        "numerics": numerics or later,
    }


def repeat_command(run) -> str:
    """Command line that repeats a finished run, with the options that the user gave."""
    every, until = run.every, run.summary["simulated_seconds"] if run.summary["stopped_by"] == "time" else None
    with suppress(SceneError):  # of a scene that the scheme computes with other settings alone
        default = Problem(run.scene, NUMERICS[run.summary["scheme"]]()).usual_interval
        every = None if abs(every / default - 1.0) < 1e-9 else every
    with suppress(SceneError):  # of a file that is not there
        own = catalogue.rebuild(run.source, run.summary["parameters"], run.scene_file).until
        until = None if until and abs(until / own - 1.0) < 1e-6 else until
    return inputs.command(run.source, run.summary, every, until, inputs.fields_of(run.source, run.scene_file))


def dates(run) -> list[str]:
    """Day of the run, from its summary or else from the time of its history.csv."""
    when = datetime.fromtimestamp(run.folder.history.stat().st_mtime)
    with suppress(ValueError, TypeError):
        when = datetime.fromisoformat(run.summary["ended"]) if run.ended and "ended" in run.summary else when
    return [f"{when.day} {when:%B %Y}"]


def safe(text) -> str:
    """Escape text for HTML."""
    return escape(plain(text))


def table(rows, head=()) -> str:
    """HTML table of rows of texts, the first cell of each as its heading; empty without rows."""
    marks = "".join(f'<th scope="col">{safe(text)}</th>' for text in head)
    lines = [f"<tr>{marks}</tr>"] if head else []
    for first, *others in rows:
        cells = "".join(f"<td>{safe(cell)}</td>" for cell in others)
        lines.append(f'<tr><th scope="row">{safe(first)}</th>{cells}</tr>')
    return f"<table>\n{chr(10).join(lines)}\n</table>" if rows else ""


def doubts(run) -> list[str]:
    """Sentences on doubts about the result."""
    if not run.ended:
        reached = run.summary["simulated_seconds"]
        return [f"This run has not ended: it has reached {reached:.2f} s, and can go on by the command below."]
    return ([str(run.summary["error"])] if run.summary.get("error") else []) + sentences.doubts(run.summary)


def view_notes(film: dict, scene) -> list[str]:
    """Sentences that explain the view of the film, and the outputs that it leaves out."""
    shown = len(film["times"])
    notes = [
        (scene.dimension == 3 or scene.axisymmetric, "Drag to turn."),
        (scene.outline, "Red: the mould, the bars, the hose or the table."),
        (True, f"Flowing: the viscous part of the stress is over {FLOW_THRESHOLD:.0%} of the yield stress."),
        (
            shown < film["outputs"],
            f"To keep the page small it shows {shown} of {film['outputs']} outputs; run.h5 has all.",
        ),
    ]
    return [text for holds, text in notes if holds]


def input_rows(run) -> list[tuple[str, str]]:
    """Rows of the table of inputs: keywords of the scene, and constants of mixes that are no keywords."""
    parameters = run.summary.get("parameters", {})
    rows = inputs.rows(parameters, inputs.fields_of(run.source, run.scene_file))
    mixes = [] if "yield_value" in parameters else run.summary.get("materials") or []
    return rows + [(f"mix {k}", mix_in_words(mix)) for k, mix in enumerate(mixes, 1)]


def accuracy_section(summary: dict) -> str:
    """Section on accuracy: the expected error, or that none was measured; for the slump cone a table by spacing."""
    mix, height, error = accuracy.errors_of_run(summary) or (None, None, None)
    text = f"<p>{safe(sentences.certainty(summary))}</p>"
    if not error:
        return text
    sizes = {row.spacing for row in accuracy.error_table() if row.model == error.model} | {error.spacing}
    rows = [
        (
            f"{1e3 * height * row.spacing:.3g} mm",
            f"{1e3 * height * row.slump:.1f} mm",
            f"{2e3 * height * row.reach:.0f} mm",
            f"{row.volume:.1%}",
        )
        for row in filter(None, [accuracy.expected(error.model, size, mix) for size in sorted(sizes, reverse=True)])
    ]
    head = "particle size", "slump within", "diameter within", "volume within"
    return f"{text}\n<p>Of this mix, by the model {safe(error.model)}, are to be expected:</p>\n{table(rows, head)}"


def versions(run) -> str:
    """Sentences on the versions that computed the run and made the page."""
    computed = "Computed by taichi_mps {version}{of} ({backend[arch]}, {backend[precision]}). "
    of = f", commit {run.summary['commit']}" if "commit" in run.summary else ""
    return f"{computed.format(of=of, **run.summary) if run.ended else ''}Page made by taichi_mps {__version__}."
