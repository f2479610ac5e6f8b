"""What goes on: the job that runs, with its picture and how far it is, those that wait, and the last that ended."""

from nicegui import ui

from ..io.history import newest
from ..report.sentences import measured, measures
from .jobs import Job, Queue
from .results import newest_picture, show_run, url


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
        """All of it, anew."""
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
            show_run(job.folder)
        elif job.state == "stopped":
            ui.label("stopped by you before the first step")
