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
        self.open = {heading: heading in OPEN for heading in GROUPS}
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
            group = ui.expansion(heading.capitalize(), value=self.open[heading])
            group.on_value_change(lambda event, heading=heading: self.open.update({heading: event.value}))
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

    async def ask(self) -> None:
        """Show what is known, unless it was asked for anew meanwhile."""
        self.questions += 1
        number = self.questions
        answer = await self.known()
        if number == self.questions and not self.wrong.is_deleted:
            self.tell(*answer)

    async def known(self):
        """The Forecast of the form, or None and in one line why there is none."""
        scene, method = catalogue.load(self.scene).parameters, NUMERICS[self.scheme]
        told = [self.form.given(model) for model in (scene, method, Run)]
        try:
            Run(**told[2])
            return await run.io_bound(self.forecaster.ask, self.scene, self.scheme, *told), ""
        except SceneError as error:
            return None, plain(" ".join(str(error).split()))

    def tell(self, found, line: str) -> None:
        """Show a forecast, or what is wrong."""
        self.wrong.text = line
        self.form.mark(line)
        self.forecast.clear()
        with self.forecast:
            for text in found.lines + found.warnings if found else ():
                ui.label(text)

    async def start(self) -> None:
        """Put the run into the queue, if it can be computed."""
        title = ", ".join([self.scene, *map(self.form.said, self.form.values)])
        job = Job(title, ["run", self.scene, "--quiet", *as_options(self.form.values)], scene=self.scene)
        found, line = await self.known()
        self.tell(found, line)
        if found:
            job.until = found.until
            self.queue.add(job)
            ui.run_javascript("if (innerWidth < 768) document.querySelector('[data-part=live]').scrollIntoView()")
