"""The mix of measured tests: measurements in, constants out, and back into the form of a run."""

import json

from nicegui import ui

from ..report.inputs import option
from ..study.calibrate import Measurements
from ..study.calibration import WORDS, short
from .form import Form
from .jobs import Job, Queue


class Calibrate:
    """Measurements, and what they say of the mix; ``use`` is given the constants as texts."""

    def __init__(self, queue: Queue, use):
        self.queue, self.use, self.job, self.state = queue, use, None, None
        self.form = Form(lambda: None, empty="not measured", described=True)
        with ui.row().classes("w-full items-start gap-4"):
            with ui.card().classes("w-full md:w-96 gap-2").props("flat bordered"):
                ui.label("Measured, one or more: cone of 30 cm, mini-cone, V-funnel").classes("font-bold")
                for name, field in Measurements.model_fields.items():
                    self.form.add(name, field)
                self.check = ui.switch("check by one finer run, some 20 s", value=True)
                ui.button("Calibrate", on_click=self.start).classes("w-full").props('no-caps data-action="calibrate"')
            with ui.column().classes("w-full md:w-0 md:grow"):
                self.answer()

    def start(self) -> None:
        """Put it into the queue."""
        words = ["calibrate", "--json", *(option(*given) for given in self.form.values.items())]
        self.job = self.queue.add(Job("calibration", words + ["--no-check"] * (not self.check.value)))
        self.tick()

    def tick(self) -> None:
        """Show the answer when it is there."""
        state = self.job and self.job.state
        if state != self.state:
            self.state = state
            self.answer.refresh()

    @ui.refreshable_method
    def answer(self) -> None:
        """What was found, or how far it is."""
        if self.job is None:
            ui.label("The yield stress and the plastic viscosity that fit, with their 95 % intervals, come here.")
        elif not self.job.over:
            ui.label("Waits for the run before it." if self.job.state == "waiting" else "At work …")
            ui.linear_progress(show_value=False).props("indeterminate")
        elif self.job.state == "done":
            self.found(json.loads(self.job.output))
        else:
            ui.label(self.job.said or "stopped by you").classes("text-negative").props('role="alert"')

    def found(self, facts: dict) -> None:
        """The constants, and what they rest on."""
        with ui.card().classes("w-full gap-1").props('flat bordered data-part="constants"'):
            for line in facts["told"].splitlines():
                ui.label(" ".join(line.split()))
            mix = {name: short(value) for name, value in facts["mix"].items()}
            words = ", ".join(f"{WORDS[name][0]} {text} {WORDS[name][1]}" for name, text in mix.items())
            ui.button(f"Run a test with {words}", on_click=lambda: self.use(mix)).props("no-caps outline")
