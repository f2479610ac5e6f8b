"""What a run shows while it goes on and when it is done: pictures, progress, result table, curves."""

import math
import sys
from contextlib import contextmanager
from importlib.util import find_spec
from itertools import chain

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn
from rich.table import Table

from ..io.history import read_history
from ..io.run_folder import PLOTS, empty_of_pictures
from ..problem.labels import title, written
from ..report.sentences import LEADING, in_time, numerics, rows, sentences
from ..units import SceneError, plain

NARROWEST = 40  # columns of a result, whatever a terminal says of itself


def redraw(replays, folder, suffix, options, film=False, every=None) -> dict:
    """Draw the outputs of runs, ``every`` [s] apart, again, side by side: pictures, GIF and, on request, MP4; the names
    of what was made."""
    from ..viz.film import SideBySide, check, mp4, together
    from ..viz.render import gif

    if film:
        check()
    frames, animation = folder / f"frames{suffix}", folder / f"animation{suffix}.gif"
    outputs = together(*replays)
    first = next(outputs)
    painter = SideBySide([output.scene for output in first], frames, options)
    try:
        empty_of_pictures(frames)
    except OSError as error:
        raise SceneError(f"run = {folder}: {frames} cannot be written ({error.strerror})") from None
    made = [painter.draw(number, *each) for number, each in enumerate(chain([first], outputs))]
    gif(made, animation, width=640 * len(replays), every=every)
    names = {"frames": str(frames), "animation": str(animation), "pictures": len(made)}
    return names | ({"film": str(mp4(made, animation.with_suffix(".mp4"), every=every))} if film else {})


@contextmanager
def progress(sim, recorder, quiet, verbose, clock):
    """A line on a terminal: flow time, share done, result so far, time left. Elsewhere only the clock's file, for who
    watches the run from outside."""
    console = Console(stderr=True)
    shown = console.is_terminal and not quiet
    columns = TextColumn("{task.description}"), BarColumn(30), TextColumn("{task.percentage:.0f} %{task.fields[left]}")
    with Progress(*columns, console=console, transient=True, disable=not shown) as bar:
        task = bar.add_task("getting ready" + " (the first run takes longest)" * clock.cold, total=1.0, left="")

        def show(sim):
            if clock.part == "ready":
                clock.begin("flow", sim.steps)
            now = clock.now(sim)
            if not now:
                return
            name = next((name for name in LEADING if name in recorder.measures), None)
            moved = f"  {title(name)} {written(name, recorder.measures[name])}" if name else ""
            text = f"{sim.time:.2f} of about {now['end_s']:.3g} s{moved}"
            if verbose:
                r = sim.report
                text += f"  dt {1e3 * r.dt:.2f} ms ({r.dt_limit}), iterations {r.outer_iterations}"
                text += f"/{r.solver_iterations}"
            bar.update(task, completed=now["share"], description=text, left=f", {in_time(now['left_s'])} left")
            recorder.folder.tell(now)

        sim.each_step(show)
        yield


def result(summary: dict, folder, verbose=False, stages=()) -> None:
    """The result for a reader, on stdout: sentences, then each number and what it is; the numerics if asked."""
    console = Console(highlight=False)
    console.width = max(console.width, NARROWEST)
    for sentence in sentences(summary, folder.path):
        console.print(sentence, markup=False)
    shown = Table(show_header=False, box=None)
    for name, value, what in rows(summary):
        shown.add_row(escape(name), value, escape(what))
    console.print(shown)
    if not (verbose or stages):
        return
    shown = Table(title="numerics", show_header=False)
    for name, value in numerics(summary):
        shown.add_row(escape(name), escape(value))
    whole = sum(seconds for _, seconds, _ in stages)
    for stage, seconds, calls in sorted(stages, key=lambda entry: -entry[1]):
        each = seconds / max(calls, 1)
        once = "an iteration" if stage == "solve" else "a call"
        shown.add_row(f"stage {stage}", f"{seconds:.2f} s, {seconds / whole:.0%}, {1e3 * each:.3f} ms {once}")
    console.print(shown)


def curves(folder, numerics=False, sim=None, courses=True) -> list[str]:
    """slump.png and history.png, where ``courses`` are wanted, with the numerics if asked, and filling.png of a
    Simulation of a scene with a cavity; none without matplotlib or without something to show."""
    cavity = sim and sim.scene.cavity
    if not (courses or cavity) or not find_spec("matplotlib"):
        return []
    from ..viz import plots

    slump, course, filling = (folder.path / name for name in PLOTS)
    if courses:
        rows = read_history(folder.history)
        plots.history(rows, course, numerics)
        if not all(map(math.isnan, rows["slump_m"])):
            plots.slump_curve({folder.path.name: rows}, slump)
    if cavity:
        plots.filling(cavity, sim.snapshot(), filling)
    return [str(path) for path in (slump, course, filling) if path.is_file()]


def report(folder, scene=None) -> bool:
    """report.html, of a run whose scene is at hand; whether it was written: one line where it cannot be, which costs no
    run."""
    from ..report.page import write

    try:
        return write(folder, scene).is_file()
    except (SceneError, OSError) as error:
        print(f"taichi-mps: no report.html: {plain(error)}", file=sys.stderr)
    return False
