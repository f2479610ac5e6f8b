"""Answers of the server to queries of the page: each is a method of Page that takes a Query and returns JSON. The page
itself lies in static/.

All tabs share the queue of runs, the folder they go into, and the processes of preview and forecast.
"""

import json
from base64 import b64decode, b64encode
from pathlib import Path
from tempfile import TemporaryDirectory, mkdtemp

from ..input.labels import in_words
from ..spelling import without_unit
from ..study import measured_mixes
from ..study.calibrate import Measurements, check_measurements, emulators_of
from ..study.calibration import CONSTANT_UNITS, MAX_MISFIT, NAMES, RHEOMETER, Constant, rounded
from ..units import Checked, require
from . import form
from .jobs import Job, Queue
from .resident import Resident
from .results import Runs, facts_of

FORECAST_TIMEOUT = 60.0  # for one forecast [s]
MAX_TEXT_LENGTH = 100  # characters in a field of the form
MEASURE = {  # measurements that determine a constant which a calibration could not find
    "yield_value": {"slump_m": "the slump", "spread_m": "the slump flow"},
    "plastic_viscosity": {"t500_s": "T500", "v_funnel_s": "the V-funnel time"},
}
THESE = "this", "these two", "these three"  # words for one, two or three measurements


class Query(Checked):
    """Query of the page."""

    test: str = "slump"
    values: dict[str, str] = {}  # texts of the fields that the user set
    check: bool = False  # whether a finer run checks a calibration
    names: list[str] = []  # names of runs
    to: str = ""  # new name of a run
    file: str = ""  # a laboratory's list, base64
    job: int = 0
    at_once: bool = False  # whether a job that is asked to stop may not end its step


class Page:
    """Answers by the names of queries; those about runs are methods of ``Runs``."""

    def __init__(self, queue: Queue):
        self.queue, runs = queue, Runs(queue)
        self.preview_process, self.forecast_process = Resident("preview"), Resident("forecast")
        self.known = {test["name"]: test for test in form.tests()}
        self.runs = runs
        self.lists = TemporaryDirectory(prefix="taichi_mps-")  # removed at the end of the server
        own = self.tests, self.forecast, self.run, self.calibrate, self.calibrate_list, self.result, self.jobs
        of_runs = runs.list, runs.show, runs.compare, runs.resume, runs.rename, runs.delete, runs.restore
        self.answers = {answer.__name__: answer for answer in (*own, self.stop, *of_runs, runs.empty)}

    # ---- a mix -------------------------------------------------------------------------------------------------
    def tests(self, query: Query) -> dict:
        """Tests that the user can choose, with the fields of their forms."""
        return {
            "tests": list(self.known.values()),
            "measurements": form.measurements(),
            "folder": str(self.queue.folder),
        }

    def fields(self, query: Query) -> dict[str, dict]:
        """Fields of the form of the queried test; SceneError for a value of a field that it does not have."""
        require(query.test in self.known, f"test = {query.test}: unknown")
        schemes = self.known[query.test]["fields"]
        return self.check_fields(query, schemes.get(query.values.get("scheme"), schemes["implicit"]))

    def check_fields(self, query: Query, form_fields: list[dict]) -> dict[str, dict]:
        """Return the fields of a form by name; SceneError for a value of an unknown field or one that is too long."""
        fields = {field["name"]: field for field in form_fields}
        for key, text in query.values.items():
            require(key in fields, f"unknown key '{key}'")
            require(
                len(text) <= MAX_TEXT_LENGTH,
                f"{key} = {text[:MAX_TEXT_LENGTH]}: must have at most {MAX_TEXT_LENGTH} characters",
            )
        return fields

    async def forecast(self, query: Query) -> dict:
        """Forecast of a run before it starts, or its errors."""
        self.fields(query)
        try:
            parts = self.forecast_process.ask({"test": query.test, "values": query.values}, FORECAST_TIMEOUT)
            return [part async for part in parts][-2]  # the last one says that the answer ends
        except TimeoutError:
            text = f"this scene could not be tried within {FORECAST_TIMEOUT:g} s; make it coarser or smaller"
            return {"wrong": {"spacing": f"spacing: {text}"}}

    async def preview(self, query: Query):
        """Yield the pictures and the result of a mix."""
        self.fields(query)
        if not self.preview_process.alive:
            yield {"preparing": True}
        async for part in self.preview_process.ask({"test": query.test, "values": query.values}):
            yield part

    async def run(self, query: Query) -> dict:
        """Enqueue a run, if it can be computed."""
        fields, expected = self.fields(query), await self.forecast(query)
        if expected.get("wrong"):
            return expected
        units = {key: f" {fields[key]['unit']}" if without_unit(text) else "" for key, text in query.values.items()}
        texts = [f"{in_words(key)} {text}{units[key]}".rstrip() for key, text in query.values.items()]
        words = ["run", query.test, *form.options(query.values), "--quiet"]
        return self.enqueue(Job(", ".join([in_words(query.test), *texts]), words, query.test, expected.get("seconds")))

    def enqueue(self, job: Job) -> dict:
        """Enqueue a job and return its number."""
        self.queue.add(job)
        return {"job": len(self.queue.jobs) - 1}

    # ---- a calibration ------------------------------------------------------------------------------------------
    def calibrate(self, query: Query) -> dict:
        """Enqueue a calibration."""
        self.check_fields(query, form.measurements())
        test = Measurements(**query.values)
        check_measurements(test, emulators_of(test.measured()))  # at once, not by the job
        words = ["calibrate", "--json", *form.options(query.values), *(["--no-check"] if not query.check else [])]
        return self.enqueue(Job("calibration", words, short=not query.check))

    def calibrate_list(self, query: Query) -> dict:
        """Enqueue the calibration of a laboratory's list, a CSV file or an Excel sheet."""
        table = Path(mkdtemp(dir=self.lists.name)) / "list"
        table.write_bytes(b64decode(query.file, validate=True))
        measured_mixes.read_list(table)  # at once, not by the job
        out = table.with_name("calibrated.csv")
        return self.enqueue(
            Job("list", ["calibrate", "--json", f"--table={table}", f"--out={out}"], out=out, short=True)
        )

    def result(self, query: Query) -> dict:
        """Result of a calibration, or of that of a list: its rows, the meanings of verdicts, the table of results as
        text, and its chart as base64, '' without matplotlib."""
        job = self.job_of(query)
        if job.out and job.output:  # also where no mix is fitted, which the command counts as failed
            chart = job.out.with_suffix(".png")
            return {
                "rows": json.loads(job.output),
                "verdicts": measured_mixes.VERDICTS,
                "csv": job.out.read_text(encoding="utf-8"),
                "chart": b64encode(chart.read_bytes()).decode() if chart.is_file() else "",
                "message": job.message,
            }
        facts = json.loads(job.output) if job.words[0] == "calibrate" and job.state == "done" else {}
        return {"verdict": verdict(facts), **facts} if facts else {"state": job.state, "message": job.message}

    # ---- jobs --------------------------------------------------------------------------------------------------
    def job_of(self, query: Query) -> Job:
        """Job by its number; SceneError if there is none."""
        require(0 <= query.job < len(self.queue.jobs), f"job = {query.job}: there is none")
        return self.queue.jobs[query.job]

    def jobs(self, query: Query) -> dict:
        """Unfinished jobs and the last finished one; and the last run that came to its end."""
        jobs = list(enumerate(self.queue.jobs))
        ended = [(number, job) for number, job in jobs if job.finished and job.words[0] != "calibrate"]
        shown = ended[-1:] + [(number, job) for number, job in jobs if not job.finished]
        return {
            "jobs": [facts_of(number, job) for number, job in shown],
            "last": next((row for row in self.runs.rows() if row["whole"]), None),
        }

    def stop(self, query: Query) -> None:
        """Stop a job, as Ctrl-C does, or at once."""
        self.job_of(query).stop(query.at_once)


def verdict(facts: dict) -> str:
    """Sentences on a calibration by its facts, as ``calibrate --json`` prints them: the constants with their 95 %
    intervals, or why there are none, and what to measure besides."""
    friction = "friction_angle" in facts["mix"]
    if facts["misfit"] > MAX_MISFIT and not friction:
        statements = [
            f"the {NAMES[name]} alone says {Constant(*it, 0.0, 0.0, 'Pa').value_or_bound()}"
            for name, it in facts["alone"].get("yield_value", {}).items()
            if name != RHEOMETER
        ]
        ends = [rounded(facts["yield_value"][end], 2) for end in ("low", "high")]
        head = f"No mix of the table ({ends[0]} to {ends[1]} Pa) does all of this"
        return f"{head}{': ' if statements else ''}{', '.join(statements)}."
    known_texts, unknown = [], []
    for name, value in facts["mix"].items():
        words, unit, estimate = in_words(name), CONSTANT_UNITS[name], (facts["friction"] if friction else facts)[name]
        low, high = (end and rounded(end, 2) for end in (estimate["lower"], estimate["upper"]))
        if estimate["low"] == estimate["high"]:
            known_texts.append(f"{words} {rounded(value, 2)} {unit}, as given")
        elif low or high:
            span = f"{low} to {high}" if low and high else f"at least {low}" if low else f"at most {high}"
            known_texts.append(f"{words} about {rounded(value, 2)} {unit} ({span})")
        else:
            unknown.append(name)
    sentences = ["; ".join(known_texts)] if known_texts else []
    for name in unknown:
        others = [words for key, words in MEASURE.get(name, {}).items() if key not in facts["measured"]]
        these = THESE[min(len(facts["measured"]), len(THESE)) - 1]
        sentences.append(
            f"The {in_words(name)} can't be told from {these}" + (f": measure {' or '.join(others)}" if others else "")
        )
    text = ". ".join(sentences)
    return f"{text[0].upper()}{text[1:]}."
