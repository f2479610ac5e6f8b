"""Runs: the one that goes on and those that wait; one of the folder with its results, or several beside each other."""

import math
import os
from contextlib import contextmanager, suppress
from itertools import chain
from pathlib import Path
from urllib.parse import quote

import numpy as np
from nicegui import ui

from ..io.history import newest, read_history
from ..io.run_folder import PLOTS, RunFolder
from ..problem.labels import ENDS
from ..problem.materials import mix_in_words
from ..report import inputs
from ..report.sentences import measured, measures, rows, sentences
from ..units import SceneError, ordinary, plain
from .jobs import Job, Queue

PNG_END = b"IEND\xaeB`\x82"  # of a picture that is written to its end
NO_SUMMARY = "runs, was cut off, or is of an older version"
MOST_LINES, MOST_LETTERS = 200, 1000  # of a table; of a text of a run folder
SAVED = {"report.html": "report", "summary.json": "numbers", "history.csv": "curves", "case.toml": "case"}  # in words


def url(folder: RunFolder, name: str) -> str:
    """Where the server has a file of a run; another one when the file was written anew."""
    run, file = (quote(os.fsencode(text), safe) for text, safe in ((folder.path.name, ""), (name, "/")))
    return f"/runs/{run}/{file}?{(folder.path / name).stat().st_mtime_ns}"


def newest_picture(folder: RunFolder) -> Path | None:
    """The last picture that is written to its end."""
    return next((path for path in reversed(folder.pictures) if written_to_its_end(path)), None)


def written_to_its_end(path: Path) -> bool:
    """Whether a file is a whole picture; no pipe or device is opened."""
    with suppress(OSError, ValueError), open(ordinary("picture", path, math.inf), "rb") as file:
        file.seek(-len(PNG_END), os.SEEK_END)
        return file.read() == PNG_END
    return False


def text_of(value) -> str:
    """Text of a run folder, which may come from anybody, as a page has room for it."""
    return plain(value)[:MOST_LETTERS]


@contextmanager
def guarded():
    """Part of a page that shows run folders, which may come from anybody: a line says so where that fails."""
    try:
        yield
    except Exception as error:
        ui.label(f"This cannot be shown: {text_of(error) or type(error).__name__}").classes("text-negative")


def summary_of(folder: RunFolder) -> dict:
    """Its summary; empty for a run that goes on, was cut off, or says of itself what nobody can read."""
    try:
        summary = folder.read_summary()
        for words in (sentences, rows, mixes, given, end_of):
            words(summary)
        return summary
    except Exception:  # a folder may come from anybody
        return {}


def mixes(summary: dict) -> str:
    """The mixes of a run."""
    return "; ".join(mix_in_words(mix) for mix in summary["materials"])


def given(summary: dict) -> dict[str, str]:
    """The keywords of a run."""
    return dict(inputs.rows(summary["parameters"], inputs.fields_of(summary["scene"])))


def written_at(path: Path) -> int:
    """When a file was written last [ns]; 0 where there is none."""
    with suppress(OSError):
        return path.stat().st_mtime_ns
    return 0


def end_of(summary: dict) -> str:
    """Why a run ended."""
    return ENDS.get(summary["stopped_by"], "-")


def show_run(folder: RunFolder) -> None:
    """Sentences, moving picture, table, curves and files of a run, here."""
    summary = summary_of(folder)
    with ui.column().classes("w-full gap-1").props('data-part="sentences"'):
        for text in sentences(summary, folder.path) if summary else [f"It {NO_SUMMARY}."]:
            ui.label(text_of(text))
        if summary.get("error"):
            ui.label(text_of(summary["error"])).classes("text-negative")
    moving = folder.animation if folder.animation.is_file() else newest_picture(folder)
    if moving:
        image(url(folder, str(moving.relative_to(folder.path))))
    if summary:
        table(["result", "", "what it is"], rows(summary))
    for name in PLOTS:
        if (folder.path / name).is_file():
            image(url(folder, name))
    with ui.row().classes("gap-4"):
        for name, words in SAVED.items():
            if (folder.path / name).is_file():
                ui.link(f"Save {words}", url(folder, name)).props(f'data-file="{name}"')


def image(source, part="image") -> ui.image:
    """A picture, here, as wide as there is room."""
    return ui.image(source).classes("w-full max-w-3xl").props(f'no-spinner no-transition data-part="{part}"')


def table(head: list[str], lines) -> None:
    """A table of texts, here."""
    columns = [{"name": str(k), "field": str(k), "label": text, "align": "left"} for k, text in enumerate(head)]
    filled = [{str(k): text_of(cell) for k, cell in enumerate(line)} for line in lines[:MOST_LINES]]
    ui.table(columns=columns, rows=filled).props("flat dense wrap-cells").classes("w-full")
    if len(lines) > MOST_LINES:
        ui.label(f"and {len(lines) - MOST_LINES} more, see summary.json")


class Live:
    """The jobs of all tabs, in one of them."""

    def __init__(self, queue: Queue):
        self.queue, self.state = queue, None
        with ui.column().classes("w-full md:w-0 md:grow gap-4").props('data-part="live"'):
            self.jobs()

    def tick(self) -> None:
        """Show what has changed since the last time."""
        state = [(id(job), job.state, job.stopping) for job in self.queue.jobs]
        if state != self.state:
            self.state = state
            self.jobs.refresh()
        for job in self.queue.jobs:
            if job.state == "running":
                self.update(job)

    @ui.refreshable_method
    def jobs(self) -> None:
        """Redraw the job list."""
        ended = [job for job in self.queue.jobs if job.over and (job.scene or job.state == "failed")]
        for job in [job for job in self.queue.jobs if not job.over] + ended[-1:]:
            with ui.card().classes("w-full").props(f'flat bordered data-job="{job.state}"'):
                self.ended_job(job) if job.over else self.open_job(job)
        if not self.queue.jobs:
            text = "Nothing runs. Set a test up and press Run; it goes on if this page is closed."
            ui.label(text).classes("text-gray-600 p-4")

    def open_job(self, job: Job) -> None:
        """One that runs or waits."""
        with ui.row().classes("w-full items-center justify-between no-wrap"):
            ui.label(job.title).classes("font-bold")
            word = "Stopping …" if job.stopping else "Stop" if job.state == "running" else "Remove"
            button = ui.button(word, on_click=job.stop, color="negative").props('no-caps outline data-action="stop"')
            button.set_enabled(not job.stopping)
        if job.state == "waiting":
            ui.label("waits until the one before is done")
            return
        self.bar = ui.linear_progress(0.0, show_value=False, size="10px").props("instant-feedback")
        said = "getting ready: the program is made for this machine, faster the next time" if job.scene else "at work"
        self.status = ui.label(said).classes("tabular-nums").props('data-part="status"')
        self.picture = ui.interactive_image().classes("w-full max-w-3xl").props('data-part="picture"')

    def update(self, job: Job) -> None:
        """How far the job is that runs."""
        row = newest(job.folder.history) if job.folder else {}
        if row.get("time_s"):
            self.bar.value = min(1.0, row["time_s"] / job.until)
            self.status.text = f"{row['time_s']:.2f} s of at most {job.until:g} s. {measured(measures(row))}"
        if row and (picture := newest_picture(job.folder)):
            self.picture.set_source(url(job.folder, f"frames/{picture.name}"))

    def ended_job(self, job: Job) -> None:
        """The last that ended: its result, or why there is none."""
        ui.label(job.title).classes("font-bold")
        if job.state == "failed":
            said = job.said or f"it ended with code {job.process and job.process.returncode}, and said nothing"
            ui.label(said).classes("text-negative whitespace-pre-line").props('role="alert"')
        if job.folder and job.folder.summary.is_file():
            with guarded():
                show_run(job.folder)
        elif job.state == "stopped":
            ui.label("stopped by you before the first step")


class Results:
    """The runs of the folder to choose from: one is shown, two or more are compared."""

    def __init__(self, queue: Queue):
        self.queue, self.folders, self.there, self.drawn = queue, {}, None, None
        head = {"name": "run", "test": "test", "mix": "mix", "found": "result", "end": "end"}
        columns = [{"name": k, "label": text, "field": k, "align": "left"} for k, text in head.items()]
        with ui.column().classes("w-full gap-4"):
            ui.label("Choose a run to look at it, two or more to compare them.").classes("text-gray-600")
            self.table = ui.table(columns=columns, rows=[], row_key="name", selection="multiple", pagination=8)
            self.table.props('flat bordered dense wrap-cells data-part="runs"').classes("w-full")
            self.table.on_select(lambda: self.show.refresh())
            self.show()

    def tick(self) -> None:
        """Show what has changed since the last time."""
        folders = [RunFolder(path) for path in self.queue.folder.glob("*") if path.is_dir()]
        self.folders = {plain(folder.path.name): folder for folder in folders if folder.ours}
        there = {name: written_at(folder.summary) for name, folder in self.folders.items()}
        drawn = [job.state for job in self.queue.jobs if job.words[0] == "render"]
        if there != self.there:
            newest_first = sorted(there, key=lambda name: (there[name] == 0, there[name]), reverse=True)
            self.table.update_rows([self.row(name) for name in newest_first], clear_selection=False)
        if drawn != self.drawn:
            self.show.refresh()
        self.there, self.drawn = there, drawn

    def row(self, name: str) -> dict[str, str]:
        """A run in the table."""
        summary = summary_of(self.folders[name])
        if not summary:
            return {"name": name, "end": NO_SUMMARY}
        words = {"test": summary["scene"], "mix": mixes(summary), "found": measured(summary), "end": end_of(summary)}
        return {"name": name} | {key: text_of(text) for key, text in words.items()}

    @ui.refreshable_method
    def show(self) -> None:
        """What is chosen."""
        chosen = [self.folders[row["name"]] for row in self.table.selected if row["name"] in self.folders]
        if len(chosen) == 1:
            with guarded():
                show_run(chosen[0])
        elif chosen:
            with guarded():
                summaries = {plain(folder.path.name): summary for folder in chosen if (summary := summary_of(folder))}
                table(["", *summaries], beside(list(summaries.values())))
            with guarded():
                curves(chosen)
            if len(chosen) == 2:
                with guarded():
                    self.side_by_side(*chosen)

    def side_by_side(self, left: RunFolder, right: RunFolder) -> None:
        """Both runs in one moving picture, or the button that draws it."""
        words = ["render", str(left.path), "--beside", str(right.path), "--json"]
        name = f"animation-beside-{right.path.name}.gif"
        job = next((job for job in reversed(self.queue.jobs) if job.words == words), None)
        if job and not job.over:
            ui.label("The moving picture of both is being drawn, after the runs before it.")
        elif (left.path / name).is_file():
            image(url(left, name), "beside").classes("max-w-none")
        else:
            if job and job.state == "failed":
                ui.label(job.said).classes("text-negative").props('role="alert"')
            draw = Job(plain(f"{left.path.name} beside {right.path.name}"), words)
            ui.button("Draw both side by side", on_click=lambda: self.queue.add(draw)).props("no-caps outline")


def beside(summaries: list[dict]) -> list[tuple[str, ...]]:
    """Lines of a table of runs: what differs of their keywords, then each result."""
    keywords = [given(summary) for summary in summaries]
    results = [{name: value for name, value, _ in rows(s)} | {"end": end_of(s)} for s in summaries]
    lines = [(key, *(k.get(key, "-") for k in keywords)) for key in dict.fromkeys(chain(*keywords))]
    lines = [line for line in lines if len(set(line[1:])) > 1]
    return lines + [(name, *(found.get(name, "-") for found in results)) for name in dict.fromkeys(chain(*results))]


def curves(folders: list[RunFolder]) -> None:
    """The slump curves of those runs that have one in one chart, here."""
    shown = {"legend": {}, "tooltip": {"trigger": "axis"}, "series": []}
    shown |= {"xAxis": {"type": "value", "name": "time [s]"}, "yAxis": {"type": "value", "name": "slump [cm]"}}
    try:
        for folder in folders:
            history = read_history(folder.history)
            points = np.stack([history["time_s"], 100.0 * history["slump_m"]], 1)
            if data := points[np.isfinite(points[:, 1])].tolist():
                shown["series"].append(
                    {"name": plain(folder.path.name), "type": "line", "showSymbol": False, "data": data}
                )
        if shown["series"]:
            ui.echart(shown).props('data-part="curves"')
    except SceneError as error:
        ui.label(plain(error))
