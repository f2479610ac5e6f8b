"""The page of one browser tab: set a run up and watch it; look at runs and compare them; calibrate a mix.

All tabs share the queue of runs and the folder they go into; what is typed belongs to a tab.
"""

import asyncio
from concurrent.futures.process import BrokenProcessPool

from nicegui import background_tasks, run, ui

from ..cli.case_file import keywords
from ..cli.main import foreseen
from ..cli.options import GROUPS, group_of
from ..problem import catalogue
from ..problem.numerics import NUMERICS
from ..report.inputs import option
from .calibration import Calibrate
from .form import Form
from .jobs import Job, Queue
from .results import Live, Results

FIRST = ("yield_value", "plastic_viscosity", "density", "spacing", "model", "accuracy")  # of their groups
OPEN = ("mix", "accuracy and cost")  # groups that are shown at first
NOT_ASKED = {"renderer"}  # another needs a display
TICK = 0.7  # [s] between two looks at the queue
PATIENCE = 60.0  # [s] for one forecast
TOO_LONG = f"spacing: this scene could not be tried within {PATIENCE:g} s; make it coarser"


def order(name: str) -> int:
    """The place of a field in its group."""
    return FIRST.index(name) if name in FIRST else len(FIRST)


class Page:
    """Everything of a tab; made when its browser has opened the connection back."""

    def __init__(self, queue: Queue):
        self.queue, self.scene, self.scheme, self.questions = queue, "slump", "implicit", 0
        self.form = Form(self.check)
        ui.colors(primary="#1f5f99")
        with ui.header(fixed=False).classes("items-baseline gap-3 px-4 py-2"):
            ui.label("taichi_mps").classes("text-lg font-bold")
            ui.label("tests of fresh concrete").classes("opacity-80")
        with ui.tabs().classes("w-full").props("no-caps align=left") as self.tabs:
            for name in ("Run", "Results", "Calibrate"):
                ui.tab(name)
        with ui.tab_panels(self.tabs, value="Run", animated=False, keep_alive=True).classes("w-full"):
            with ui.tab_panel("Run").classes("p-0"), ui.row().classes("w-full items-start gap-4"):
                with ui.card().classes("w-full md:w-96 gap-2").props("flat bordered"):
                    self.set_up()
                live = Live(queue)
            with ui.tab_panel("Results").classes("p-0"):
                results = Results(queue)
            with ui.tab_panel("Calibrate").classes("p-0"):
                calibration = Calibrate(queue, self.use_mix)
        for part, often in ((live, 1), (calibration, 1), (results, 3)):
            ui.timer(TICK * often, part.tick)
        self.check()

    def set_up(self) -> None:
        """What is to be run, what is known of it before, and the button."""
        names = {name: text.split(":")[0] for name, text in catalogue.describe().items()}
        test = ui.select(names, label="test", value=self.scene).classes("w-full").props('data-field="test"')
        test.on_value_change(lambda event: self.choose(event.value))
        self.fields()
        self.forecast = ui.column().classes("w-full gap-1 text-sm text-gray-700").props('data-part="forecast"')
        self.wrong = ui.label().classes("text-negative w-full").props('role="alert" data-part="wrong"')
        ui.button("Run", on_click=self.start).classes("w-full").props('no-caps data-action="run"')

    @ui.refreshable_method
    def fields(self) -> None:
        """The inputs of the scene and the scheme that are chosen, in the groups of the command line."""
        known = keywords(catalogue.load(self.scene), NUMERICS[self.scheme])
        self.form.inputs.clear()
        for heading in GROUPS:
            group = ui.expansion(heading.capitalize(), value=heading in OPEN)
            with group.classes("w-full").props("dense header-class=font-bold"):
                for name in sorted(known, key=order):
                    model, field = known[name]
                    if group_of(name, model) == heading and name not in NOT_ASKED:
                        self.form.add(name, field)

    def choose(self, scene: str) -> None:
        """Another test, with its own values."""
        self.scene = scene
        self.form.values.clear()
        self.fields.refresh()
        self.check()

    def use_mix(self, mix: dict[str, str]) -> None:
        """Take the constants of a calibration over into the form."""
        for name, text in mix.items():
            self.form.inputs[name].value = text
        self.tabs.value = "Run"

    # ---- before and at the start ---------------------------------------------------------------------------------
    def check(self) -> None:
        """Find out what is known of the run as it is set up now, and show it when it is found."""
        scheme = self.form.values.get("scheme", "implicit")
        if scheme != self.scheme:
            for name in NUMERICS[self.scheme].model_fields:
                self.form.values.pop(name, None)
            self.scheme = scheme
            self.fields.refresh()
        background_tasks.create(self.known())

    async def known(self) -> tuple[list[str], float, str]:
        """The words of the run as it is set up now, its time limit [s], and in one line what is wrong with it; shows
        what is known of it, unless that was asked for anew meanwhile."""
        self.questions += 1
        number, words = self.questions, [self.scene, *(option(*given) for given in self.form.values.items())]
        try:
            found = await asyncio.wait_for(run.cpu_bound(foreseen, words), PATIENCE)
        except (asyncio.TimeoutError, BrokenProcessPool):  # the process was killed for want of memory
            found = None
        until, lines, wrong = found or (0.0, [], TOO_LONG)
        if number == self.questions and not self.wrong.is_deleted:
            self.wrong.text = wrong
            self.form.mark(wrong)
            self.forecast.clear()
            with self.forecast:
                for text in lines:
                    ui.label(text)
        return words, until, wrong

    async def start(self) -> None:
        """Put the run into the queue, if it can be computed."""
        title = ", ".join([self.scene, *map(self.form.said, self.form.values)])
        words, until, wrong = await self.known()
        if not wrong:
            self.queue.add(Job(title, ["run", *words, "--quiet"], self.scene, until))
            ui.run_javascript("if (innerWidth < 768) document.querySelector('[data-part=live]').scrollIntoView()")
