"""The page of one browser tab: set a run up and watch it; look at runs and compare them; calibrate a mix.

All tabs share the queue of runs and the folder they go into; what is typed belongs to a tab.
"""

from nicegui import background_tasks, run, ui

from ..cli.case_file import keywords
from ..cli.options import GROUPS, Run, group_of
from ..problem import catalogue
from ..problem.numerics import NUMERICS
from ..units import SceneError, plain
from .calibration import Calibrate
from .form import Form
from .jobs import Job, Queue, as_options
from .live import Live
from .results import Results

FIRST = ("yield_value", "plastic_viscosity", "density", "spacing", "model", "accuracy")  # of their groups
OPEN = ("mix", "accuracy and cost")  # groups that are shown at first
NOT_ASKED = {"renderer"}  # another needs a display
TICK = 0.7  # [s] between two looks at the queue


def order(name: str) -> int:
    """The place of a field in its group."""
    return FIRST.index(name) if name in FIRST else len(FIRST)


class Page:
    """Everything of a tab; made when it is opened."""

    def __init__(self, queue: Queue, forecaster):
        self.queue, self.forecaster = queue, forecaster
        self.scene, self.questions = "slump", 0
        self.form = Form(self.check)
        ui.colors(primary="#1f5f99")
        with ui.header(fixed=False).classes("items-baseline gap-3 px-4 py-2"):
            ui.label("taichi_mps").classes("text-lg font-bold")
            ui.label("tests of fresh concrete").classes("opacity-80")
        with ui.tabs().classes("w-full").props("no-caps align=left") as self.tabs:
            first, second, third = ui.tab("Run"), ui.tab("Results"), ui.tab("Calibrate")
        with ui.tab_panels(self.tabs, value=first, animated=False, keep_alive=True).classes("w-full"):
            with ui.tab_panel(first).classes("p-0"), ui.row().classes("w-full items-start gap-4"):
                with ui.card().classes("w-full md:w-96 gap-2").props("flat bordered"):
                    self.set_up()
                live = Live(queue)
            with ui.tab_panel(second).classes("p-0"):
                results = Results(queue)
            with ui.tab_panel(third).classes("p-0"):
                calibration = Calibrate(queue, self.use_mix)
        self.first = first
        for part, often in ((live, 1), (calibration, 1), (results, 3)):
            ui.timer(TICK * often, part.tick)
        self.check()

    def set_up(self) -> None:
        """What is to be run, what is known of it before, and the button."""
        names = {name: text.split(":")[0] for name, text in catalogue.describe().items()}
        test = ui.select(names, label="test", value=self.scene).classes("w-full").props('data-field="test"')
        test.on_value_change(lambda event: self.choose(event.value))
        self.fields()
        with ui.column().classes("w-full gap-1 text-sm text-gray-700").props('data-part="forecast"') as self.forecast:
            ui.label("…")
        self.wrong = ui.label().classes("text-negative w-full").props('role="alert" data-part="wrong"')
        self.button = ui.button("Run", on_click=self.start).classes("w-full").props('no-caps data-action="run"')

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
        self.shown_scheme = self.scheme

    @property
    def scheme(self) -> str:
        """That of the form."""
        return self.form.values.get("scheme", "implicit")

    def choose(self, scene: str) -> None:
        """Another test, with its own values."""
        self.scene = scene
        self.form.values.clear()
        self.fields.refresh()
        self.check()

    def use_mix(self, mix: dict[str, str]) -> None:
        """Take the constants of a calibration over into the form."""
        for name, text in mix.items():
            self.form.put(name, text)
        self.tabs.value = self.first

    # ---- before and at the start ---------------------------------------------------------------------------------
    def check(self) -> None:
        """Find out what is known of the run as it is set up now, and show it when it is found."""
        if self.scheme != self.shown_scheme:
            for name in NUMERICS[self.shown_scheme].model_fields:
                self.form.values.pop(name, None)
            self.fields.refresh()
        background_tasks.create(self.ask())

    async def ask(self):
        """The forecast, shown; None, and a line that says why, where it cannot be computed or was asked for anew."""
        self.questions += 1
        number, values, method = self.questions, dict(self.form.values), NUMERICS[self.scheme]
        scene = self.form.given(catalogue.load(self.scene).parameters)
        try:
            Run(**(options := self.form.given(Run)))
            question = (self.scene, scene, self.scheme, self.form.given(method), options)
            found, line = await run.io_bound(self.forecaster.ask, *question), ""
        except SceneError as error:
            found, line = None, plain(" ".join(str(error).split()))
        if number != self.questions or self.wrong.is_deleted or values != self.form.values:
            return None
        self.wrong.text = line
        self.form.mark(line)
        self.forecast.clear()
        with self.forecast:
            for text in found.lines + found.warnings if found else ():
                ui.label(text)
        return found

    async def start(self) -> None:
        """Put the run into the queue, if it can be computed."""
        found = await self.ask()
        if found is None:
            return
        words = ["run", self.scene, "--quiet", *as_options(self.form.values)]
        title = ", ".join([self.scene, *map(self.form.said, self.form.values)])
        self.queue.add(Job(title, words, scene=self.scene, until=found.until))
        ui.run_javascript("if (innerWidth < 768) document.querySelector('[data-part=live]').scrollIntoView()")
