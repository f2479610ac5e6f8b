"""Queries on the runs of a folder: list, show, compare, rename, delete into a bin, restore.

A folder may come from anybody: an unreadable one says so in its row, and no link is followed to remove anything.
"""

import math
import os
import shutil
from contextlib import suppress
from itertools import chain
from pathlib import Path
from urllib.parse import quote

from ..input.labels import STOP_REASONS, in_words, is_measure, mix_in_words, title, written
from ..io import lock
from ..io.history import read_history
from ..io.run_folder import MARKER_FILE, REPORT, RunFolder, next_free, read_json
from ..report import inputs
from ..report.drawings import charts
from ..report.sentences import (
    EXPECTED,
    LEADING,
    closing,
    cost,
    main_results,
    measures,
    result_sentences,
    rows,
    verdicts,
)
from ..units import SceneError, plain, require
from .jobs import Job, Queue

NO_SUMMARY = "runs, was cut off, or is of an older version"
MAX_LINES, MAX_CHARACTERS = 200, 1000  # of a table; of a text of a run folder
SAVED = {
    REPORT: "report",
    "summary.json": "numbers as JSON",
    "history.csv": "curves as CSV",
    "case.toml": "case",
}  # in words
BIN = ".bin"  # in the folder of the runs
ENDED_WELL, RESUMABLE_ENDS = ("rest", "unyielded", "time"), (None, "interrupted")  # values of ``stopped_by``


def url(folder: RunFolder, name: str) -> str:
    """URL of a file of a run on the server, with the file's time, so that browsers load a changed file again."""
    run, file = (quote(os.fsencode(text), safe) for text, safe in ((folder.path.name, ""), (name, "/")))
    return f"/runs/{run}/{file}?{(folder.path / name).stat().st_mtime_ns}"


def newest_picture(folder: RunFolder) -> Path | None:
    """Path of the last picture of a run; None without one."""
    return next((path for path in reversed(folder.pictures) if path.is_file()), None)


def text_of(value) -> str:
    """Text of a run folder, which may come from anybody, made printable and cut to MAX_CHARACTERS."""
    return plain(value)[:MAX_CHARACTERS]


def summary_of(folder: RunFolder) -> dict:
    """Summary of a run; empty if it is missing or unreadable."""
    try:
        summary = folder.read_summary()
        for words in (result_sentences, cost, rows, mixes, given, end_of):
            words(summary)
        return summary
    except Exception:  # a folder may come from anybody
        return {}


def mixes(summary: dict) -> str:
    """Mixes of a run on one line."""
    return "; ".join(mix_in_words(mix) for mix in summary["materials"])


def given(summary: dict) -> dict[str, str]:
    """Keywords of a run with their values, in words."""
    return dict(inputs.rows(summary["parameters"], inputs.fields_of(summary["scene"])))


def end_of(summary: dict) -> str:
    """Reason for which a run ended, in words."""
    return STOP_REASONS.get(summary["stopped_by"], "-")


def written_at(folder: RunFolder) -> int:
    """Time at which a run was last written [ns]."""
    return next(
        (
            path.stat().st_mtime_ns
            for path in (folder.summary, folder.history, folder.path / MARKER_FILE)
            if path.exists()
        ),
        0,
    )


def row(folder: RunFolder) -> dict:
    """Row of the list for a run."""
    facts = {
        **dict.fromkeys(("runs", "whole", "resumable"), False),
        **dict.fromkeys(("picture", "report")),
        "size": 0,
        "numbers": {},
        "errors": {},
        "name": plain(folder.path.name),
        "date": written_at(folder) // 10**6,
    }
    try:
        summary, picture = summary_of(folder), newest_picture(folder)
        sizes = (os.lstat(os.path.join(at, name)).st_size for at, _, names in os.walk(folder.path) for name in names)
        report = f"/report/{quote(os.fsencode(folder.path.name), '')}" if folder.report.is_file() else None
        facts |= {"size": sum(sizes), "runs": bool(lock.writer(folder.path)), "report": report}
        facts["resumable"] = folder.resumable and not facts["runs"] and summary.get("stopped_by") in RESUMABLE_ENDS
        facts["picture"] = picture and url(folder, str(picture.relative_to(folder.path)))
        if not summary:
            return facts | {"end": "" if facts["runs"] else f"It {NO_SUMMARY}."}
        words = {
            "scene": summary["scene"],
            "test": in_words(summary["scene"]),
            "mix": mixes(summary),
            "verdict": " ".join(verdicts(summary)),
            "result": main_results(summary),
            "end": end_of(summary),
        }
        leading = {key: summary[key] for key in LEADING if isinstance(summary.get(key), float)}
        errors = {key: summary.get(key.replace("_m", EXPECTED)) for key in ("slump_m", "spread_m")}
        facts |= {key: text_of(text) for key, text in words.items()}
        return facts | {"whole": summary["stopped_by"] in ENDED_WELL, "numbers": numbers(leading), "errors": errors}
    except Exception as error:  # a folder may come from anybody
        return facts | {"end": f"This cannot be read: {text_of(error) or type(error).__name__}"}


class Runs:
    """Runs of a folder, and the answers to queries of the page on them, by their names."""

    def __init__(self, queue: Queue):
        self.queue, self.bin, self.known = queue, queue.folder / BIN, {}

    def folders(self, place: Path) -> list[RunFolder]:
        """Run folders in a folder, the latest first."""
        folders = [RunFolder(path) for path in place.glob("*") if path.is_dir()] if place.is_dir() else []
        return sorted((folder for folder in folders if folder.ours), key=written_at, reverse=True)

    def rows(self) -> list[dict]:
        """Rows of the list; a row is updated when its run has changed."""
        found = self.folders(self.queue.folder)
        keys = [(folder.path, written_at(folder), lock.writer(folder.path)) for folder in found]
        self.known = {
            key: self.known[key] if key in self.known and not key[2] else row(folder)
            for key, folder in zip(keys, found, strict=True)
        }
        return list(self.known.values())

    def named(self, name: str, place: Path | None = None) -> RunFolder:
        """Run folder by its name; SceneError if there is none."""
        for folder in self.folders(place or self.queue.folder):
            if name in (folder.path.name, plain(folder.path.name)):
                return folder
        raise SceneError(f"run = {plain(name)}: no such run here")

    def list(self, query) -> dict:
        """Return all runs and those in the bin."""
        return {"runs": self.rows(), "bin": [row(folder) for folder in self.folders(self.bin)]}

    def show(self, query) -> dict:
        """Details of a run."""
        folder = self.named(*query.names[:1])
        summary = summary_of(folder)
        texts = [*result_sentences(summary), *closing(summary, folder.path)] if summary else [f"It {NO_SUMMARY}."]
        texts += [str(summary["error"])] if summary.get("error") else []
        moving = folder.animation if folder.animation.is_file() else newest_picture(folder)
        lines = [[text_of(cell) for cell in line] for line in (rows(summary) if summary else [])]
        more = [[f"and {len(lines) - MAX_LINES} more, see summary.json", "", ""]] if len(lines) > MAX_LINES else []
        return row(folder) | {
            "sentences": [text_of(text) for text in texts],
            "film": url(folder, str(moving.relative_to(folder.path))) if moving else None,
            "table": lines[:MAX_LINES] + more,
            "files": [[words, url(folder, name)] for name, words in SAVED.items() if (folder.path / name).is_file()],
        }

    def compare(self, query) -> dict:
        """Comparison of runs: keywords that differ, results, and curves."""
        folders = list(map(self.named, query.names))
        known = {text_of(folder.path.name): summary for folder in folders if (summary := summary_of(folder))}
        return {
            "head": list(known),
            "lines": [[text_of(cell) for cell in line] for line in beside(list(known.values()))[:MAX_LINES]],
            "curves": list(map(curves, folders)),
        }

    # ---- changes -----------------------------------------------------------------------------------------------
    def resume(self, query) -> None:
        """Resume a run."""
        folder = self.named(*query.names[:1])
        require(folder.resumable, f"run = {plain(folder.path.name)}: has no checkpoint to go on from")
        self.queue.add(
            Job(f"{plain(folder.path.name)}, resumed", ["resume", str(folder.path), "--quiet"], folder=folder)
        )

    def rename(self, query) -> None:
        """Give a run another name."""
        to = query.to.strip()
        require(
            to and plain(to) == to and not set(to) & set('/\\:*?"<>|\n') and to[0] != "." and len(to) <= 100,
            f'name = {plain(to)}: must be the name of a folder, without a dot before and / \\ : * ? " < > |',
        )
        require(not os.path.lexists(self.queue.folder / to), f"name = {to}: is there already; must be another")
        self.move(self.named(*query.names[:1]), self.queue.folder / to)

    def delete(self, query) -> None:
        """Put runs into the bin."""
        for folder in list(map(self.named, query.names)):
            require(not self.bin.is_symlink(), f"{plain(self.bin)}: is a link; must be a folder, or nothing")
            self.bin.mkdir(exist_ok=True)
            self.move(folder, next_free(self.bin / folder.path.name))

    def restore(self, query) -> None:
        """Take runs out of the bin again."""
        for name in query.names:
            folder = self.named(name, self.bin)
            self.move(folder, next_free(self.queue.folder / folder.path.name))

    def empty(self, query) -> None:
        """Remove the runs in the bin for good; other files stay."""
        for folder in [] if self.bin.is_symlink() else self.folders(self.bin):
            if not folder.path.is_symlink():
                shutil.rmtree(folder.path)
        with suppress(OSError):  # the bin holds other files, or does not exist
            self.bin.rmdir()

    def move(self, folder: RunFolder, to: Path) -> None:
        """Move a run; SceneError if a process writes it, or for a link."""
        name = plain(folder.path.name)
        require(not folder.path.is_symlink(), f"run = {name}: is a link to a run; it is left alone")
        busy = any(job.folder and job.folder.path == folder.path for job in self.queue.jobs if not job.finished)
        require(not busy, f"run = {name}: is running; stop it first")
        with lock.held(folder.path):
            pass
        os.rename(folder.path, to)


def numbers(measures: dict) -> dict:
    """Measures by key: value or None, value as text, and name."""
    known = {key: value for key, value in measures.items() if is_measure(key) and not key.endswith(EXPECTED)}
    reached = {key for key, value in known.items() if value is not None and math.isfinite(value)}
    return {
        key: [value, written(key, value), title(key)] if key in reached else [None, "not reached", title(key)]
        for key, value in known.items()
    }


def facts_of(number: int, job: Job) -> dict:
    """Facts of a job for the page."""
    clock = read_json(job.folder.clock) if job.folder and not job.finished else {}
    picture = newest_picture(job.folder) if clock else None
    message = job.message or f"it ended with code {job.process and job.process.returncode}, and said nothing"
    return {
        "id": number,
        "title": job.title,
        "test": job.scene,
        "state": job.state,
        "stopping": job.stopping,
        "message": message if job.state == "failed" else "",
        "run": job.folder.path.name if job.folder else None,
        "spent": job.spent,
        "about": job.about,
        "left": clock.get("left_s"),
        "flow": clock.get("time_s"),
        "result": main_results(measures(clock.get("measures", {}))) if clock else "",
        "picture": url(job.folder, f"frames/{picture.name}") if picture else None,
    }


def beside(summaries: list[dict]) -> list[tuple[str, ...]]:
    """Lines of a table that compares runs: keywords that differ, then each result."""
    keywords = [given(summary) for summary in summaries]
    results = [{name: value for name, value, _ in rows(s)} | {"end": end_of(s)} for s in summaries]
    lines = [(key, *(k.get(key, "-") for k in keywords)) for key in dict.fromkeys(chain(*keywords))]
    lines = [line for line in lines if len(set(line[1:])) > 1]
    return lines + [(name, *(found.get(name, "-") for found in results)) for name in dict.fromkeys(chain(*results))]


def curves(folder: RunFolder) -> dict:
    """Charts of a run as in its report; none of one without a history."""
    with suppress(SceneError):
        return {"name": text_of(folder.path.name), "charts": charts(read_history(folder.history))}
    return {"name": text_of(folder.path.name), "charts": []}
