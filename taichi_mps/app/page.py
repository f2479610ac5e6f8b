"""What the page asks of the server: each question is a method of Page, given a record of what was asked, that gives
JSON. The page itself lies in static/.

All tabs share the queue of runs, the folder they go into, and the processes of preview and forecast.
"""

import json

from ..problem.labels import in_words
from ..spelling import without_unit
from ..units import Checked, require
from . import form
from .calibration import verdict
from .jobs import Job, Queue
from .resident import Resident
from .results import Runs, facts_of

PATIENCE = 60.0  # [s] for one forecast
TOO_LONG = f"this scene could not be tried within {PATIENCE:g} s; make it coarser"
MOST = 100  # characters of a text in the form


class Asked(Checked):
    """A question of the page."""

    test: str = "slump"
    values: dict[str, str] = {}  # texts of the fields that somebody set
    check: bool = False  # of a calibration, by a finer run
    names: list[str] = []  # of runs
    to: str = ""  # another name
    job: int = 0


class Page:
    """The answers, by what may be asked; those about runs are of ``Runs``."""

    def __init__(self, queue: Queue):
        self.queue, runs = queue, Runs(queue)
        self.preview_process, self.forecast_process = Resident("preview"), Resident("forecast")
        self.known = {test["name"]: test for test in form.tests()}
        self.runs = runs
        own = self.tests, self.forecast, self.run, self.calibrate, self.found, self.jobs, self.stop
        of_runs = runs.list, runs.show, runs.compare, runs.draw, runs.resume, runs.rename, runs.delete, runs.restore
        self.answers = {answer.__name__: answer for answer in (*own, *of_runs, runs.empty)}

    # ---- a mix -------------------------------------------------------------------------------------------------
    def tests(self, asked: Asked) -> dict:
        """Tests that can be chosen."""
        tests, measurements = list(self.known.values()), form.measurements()
        return {"tests": tests, "measurements": measurements, "folder": str(self.queue.folder)}

    def fields(self, asked: Asked) -> dict[str, dict]:
        """The fields of the test that was asked for; SceneError where it has none of those that are set."""
        require(asked.test in self.known, f"test = {asked.test}: unknown")
        schemes = self.known[asked.test]["fields"]
        fields = {field["name"]: field for field in schemes.get(asked.values.get("scheme"), schemes["implicit"])}
        return self.allowed(asked, fields)

    def allowed(self, asked: Asked, fields: dict) -> dict:
        """The fields, if those that are set are among them."""
        for key, text in asked.values.items():
            require(key in fields, f"unknown key '{key}'")
            require(len(text) <= MOST, f"{key} = {text[:MOST]}: must have at most {MOST} characters")
        return fields

    async def forecast(self, asked: Asked) -> dict:
        """Forecast of a run before it starts, or its errors."""
        self.fields(asked)
        try:
            parts = self.forecast_process.ask({"test": asked.test, "values": asked.values}, PATIENCE)
            return [part async for part in parts][-2]
        except TimeoutError:
            return {"wrong": {"spacing": f"spacing: {TOO_LONG}"}}

    async def preview(self, asked: Asked):
        """Yield the pictures and the result of a mix."""
        self.fields(asked)
        if not self.preview_process.alive:
            yield {"preparing": True}
        async for part in self.preview_process.ask({"test": asked.test, "values": asked.values}):
            yield part

    async def run(self, asked: Asked) -> dict:
        """Put a run into the queue, if it can be computed."""
        fields, known = self.fields(asked), await self.forecast(asked)
        if known.get("wrong"):
            return known
        units = {key: f" {fields[key]['unit']}" * without_unit(text) for key, text in asked.values.items()}
        told = [f"{in_words(key)} {text}{units[key]}".rstrip() for key, text in asked.values.items()]
        words = ["run", asked.test, *form.options(asked.values), "--quiet"]
        title = ", ".join([in_words(asked.test), *told])
        return self.started(Job(title, words, asked.test, known.get("seconds")))

    def started(self, job: Job) -> dict:
        """Put a job into the queue; its number."""
        self.queue.add(job)
        return {"job": len(self.queue.jobs) - 1}

    # ---- a calibration ------------------------------------------------------------------------------------------
    def calibrate(self, asked: Asked) -> dict:
        """Put a calibration into the queue."""
        self.allowed(asked, {field["name"]: field for field in form.measurements()})
        words = ["calibrate", "--json", *form.options(asked.values), *["--no-check"] * (not asked.check)]
        return self.started(Job("calibration", words))

    def found(self, asked: Asked) -> dict:
        """Result of a calibration."""
        job = self.job_of(asked)
        facts = json.loads(job.output) if job.words[0] == "calibrate" and job.state == "done" else {}
        return {"verdict": verdict(facts), **facts} if facts else {"state": job.state, "said": job.said}

    # ---- jobs --------------------------------------------------------------------------------------------------
    def job_of(self, asked: Asked) -> Job:
        """The job of a number."""
        require(0 <= asked.job < len(self.queue.jobs), f"job = {asked.job}: there is none")
        return self.queue.jobs[asked.job]

    def jobs(self, asked: Asked) -> dict:
        """Jobs that are not over, and the last that is; and the last run that came to its end, whatever came later."""
        jobs = list(enumerate(self.queue.jobs))
        ended = [(number, job) for number, job in jobs if job.over and job.words[0] != "calibrate"]
        shown = ended[-1:] + [(number, job) for number, job in jobs if not job.over]
        last = next((row for row in self.runs.rows() if row["whole"]), None)
        return {"jobs": [facts_of(number, job) for number, job in shown], "last": last}

    def stop(self, asked: Asked) -> None:
        """Stop a job, as Ctrl-C does."""
        self.job_of(asked).stop()
