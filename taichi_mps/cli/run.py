"""Execution of a run for the command line: forecast, start of Taichi, run, record, stop on request, report; and drawing
of finished runs."""

import gc
import json
import math
import os
import signal
import time
import warnings
from contextlib import contextmanager
from dataclasses import replace
from itertools import chain
from zlib import crc32

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn
from rich.table import Table

from ..engine import still
from ..input.labels import title, written
from ..io.run_folder import clear_pictures, next_free, write_whole
from ..report.sentences import (
    LEADING,
    certainty,
    closing,
    duration_by_part,
    duration_text,
    grains,
    numerics,
    result_sentences,
    rows,
    thin_solids,
)
from ..spelling import size
from ..units import SceneError, require, require_package
from .case_file import NOT_IN_CASE, case_text
from .options import DIVERGED, DONE, notify, say
from .stopped import HANG_UP, Stopped, handle, leave_terminal, program_start, received

CASE = "case"  # among the settings in a checkpoint: checksum of case.toml as it was written
IMPORTED = time.process_time()  # [s] that the import of the command line took, by which the clock knows the machine


def make_clock(problem, options):
    """Make the clock of a run, which started with the program."""
    from ..forecast.clock import Clock

    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    settings = {"precision": options.precision, "threads": options.threads or cores}
    return Clock(problem, settings, options.every or problem.usual_interval, next(iter(program_start), None), IMPORTED)


def describe_run(problem, clock, verbose=False) -> list[str]:
    """Lines that describe a run before it starts: particles, memory, time, and its parts with ``verbose``, expected
    errors, thin solids."""
    from ..engine import Pouring, memory_of, pairs_of, particles_of

    scene, facts = problem.scene, problem.facts()
    part = {1: ", half of the body", 2: ", a quarter of the body"}.get(len(scene.mirrors), "")
    part = f", model {scene.parameters['model']}" if "model" in scene.parameters else part
    what = f"{particles_of(problem):,} particles of {1e3 * scene.spacing:.3g} mm{part}"
    needed = size(memory_of(problem, pairs_of(scene), clock.precision))
    pours = (
        f"Pours {1e3 * sum(inlet.volume * Pouring(scene, inlet).copies for inlet in scene.inlets):.4g} l"
        f"{' a metre' * (scene.dimension == 2)}. "
        if scene.inlets
        else ""
    )
    parts = f"{duration_by_part(clock.expected, clock.cpu_seconds)}, some {float(f'{clock.cost.steps:.2g}'):,.0f} steps"
    takes = f"Takes about {parts if verbose else duration_text(clock.whole)}{'; shorter the next time' * clock.cold}."
    return [
        f"{what}; about {needed} of memory.",
        pours + takes,
        certainty(facts),
        *thin_solids(facts),
        *grains(facts),
    ]


def require_slump(scene) -> None:
    """Refuse particles so coarse that nothing of the filled body lies at the axis, where its slump is measured."""
    if scene.measure and len(scene.fluid):
        filled = replace(still(scene.fluid, scene.spacing), time=scene.until)  # what is known of 0 s tells nothing
        require(
            not math.isnan(scene.measure(scene.unfold(filled)).get("slump_m", 0.0)),
            f"spacing = {scene.spacing:g} m: nothing of the filled body lies at the axis, where slump_m is measured; "
            "must be smaller",
        )


def carry_out(sim, folder, options, source, as_json, clock, drawing, resumed=None) -> int:
    """Run to the end, to an interrupt or a divergence, and leave a complete run folder in each case. resumed: the
    settings in the checkpoint of a run that goes on."""
    from ..engine import DivergedError
    from ..io.recorder import Recorder

    until = sim.scene.until
    settings = options.model_copy(update={"every": clock.every}).model_dump(exclude=NOT_IN_CASE, exclude_none=True)
    error, quiet = None, as_json or options.quiet
    if not quiet:
        warnings.filterwarnings("ignore", "volume_error_max")  # the result says it in its own words
    with interruptible(sim) as signals:
        case = case_text(source, sim.problem, settings | {"until": until})
        if resumed is None:
            folder.create(options.overwrite)
        else:
            keep_edited(folder.case, {resumed.get(CASE), crc32(case.encode())})  # it, or this run before it was killed
            for path in (folder.report, folder.animation):  # which would end where that run ended
                path.unlink(missing_ok=True)
        write_whole(folder.case, case)
        settings |= {CASE: crc32(folder.case.read_bytes())}
        recorder = Recorder(folder, sim, clock.every, source, settings, drawing.submit)
        try:
            with progress(sim, recorder, quiet, options.verbose, clock):
                stopped_by = sim.run() if sim.time < until - 1e-9 else "time"
        except DivergedError as failure:
            stopped_by, error = failure.stopped_by, str(failure)
    clock.begin("report")
    summary = recorder.finish(stopped_by, error)
    if not quiet:
        print_answer(summary, options.verbose, sim.profile())
    complete(folder, drawing)
    summary |= clock.finish()
    folder.write_summary(summary)
    code = show_end(summary, folder, quiet, as_json)
    return 128 + signals[0] if stopped_by == "interrupted" else code


def complete(folder, drawing) -> None:
    """Make what is missing of a run that has ended: pictures, animation, report."""
    from ..report.page import write

    def finish():
        with optional("more pictures"):
            drawing.finish(last)

    if drawing.options.pictures:
        last = drawing.submit(last=True)
        if folder.report.is_file():
            finish()
        else:
            with optional(folder.report.name):
                write(folder, drawing.scene, drawing.scene_file, finish=finish)
    folder.clock.unlink(missing_ok=True)


@contextmanager
def optional(what: str):
    """Context for what the result does not need: a failure is one line."""
    try:
        yield
    except Exception as error:
        notify(f"no {what}: {error}")


def show_end(summary, folder, quiet, as_json) -> int:
    """Print what a run cost and where it lies, or all of it ``as_json``, and its error if it has one; return the exit
    code."""
    if as_json or not quiet:
        say(json.dumps(summary) if as_json else "\n".join(closing(summary, folder.path)))
    if "error" not in summary:
        return DONE
    notify(f"{summary['error']}; resume from {folder.checkpoint}")
    return DIVERGED


def keep_edited(file, written: set) -> None:
    """Keep a case.toml that has none of these checksums of what runs have written: a resumed run goes on as it
    began."""
    if file.is_file() and crc32(file.read_bytes()) not in written:
        kept = next_free(file.with_name("case.edited.toml"))
        os.replace(file, kept)
        notify(f"case = {file}: has been edited; the run goes on as it began, the file is now {kept}")


@contextmanager
def interruptible(sim):
    """Context in which Ctrl-C, SIGTERM and SIGHUP finish the step and stop the run, and a second one stops it at once;
    gives the list of signals received."""

    signals = []

    def stop(number, frame):
        if number == HANG_UP:
            leave_terminal()
        signals.append(number)
        if len(signals) > 1:
            raise Stopped(number)
        sim.interrupt()

    before = handle(stop)
    for number in received[:1]:  # what was being imported swallowed the exception, as Taichi's modules may
        stop(number, None)
    try:
        yield signals
    finally:
        for number in before:
            if signal.getsignal(number) == stop:  # a SIGHUP stays ignored after the first one
                signal.signal(number, before[number])


# ---- output of a run ---------------------------------------------------------------------------------------------
def redraw(replays, folder, suffix, options, film=False) -> dict:
    """Draw the outputs of runs again, side by side: pictures, GIF and, on request, MP4. Returns the paths of the
    files."""
    from ..viz.film import SideBySide, align_in_time, mp4
    from ..viz.render import gif

    if film:
        require_package("imageio-ffmpeg", "film: needs", "film")
    frames, animation = folder / f"frames{suffix}", folder / f"animation{suffix}.gif"
    outputs = align_in_time(*replays)
    first = next(outputs)
    painter = SideBySide([output.scene for output in first], frames, options)
    try:
        clear_pictures(frames)
    except OSError as error:
        raise SceneError(f"run = {folder}: {frames} cannot be written ({error.strerror})") from None
    drawn = [
        (max(frame.time for frame in each), painter.draw(number, *each))
        for number, each in enumerate(chain([first], outputs))
    ]
    times, made = zip(*drawn, strict=True)
    every = times[-1] / max(len(made) - 1, 1)  # a step longer than the interval asked for has one picture
    gif(made, animation, width=640 * len(replays), every=every)
    names = {"frames": str(frames), "animation": str(animation), "pictures": len(made)}
    return names | ({"film": str(mp4(made, animation.with_suffix(".mp4"), every=every))} if film else {})


@contextmanager
def progress(sim, recorder, quiet, verbose, clock):
    """Context with a progress line on a terminal: flow time, fraction done, result so far, time left; and with the file
    of the clock for other processes."""
    console = Console(stderr=True)
    shown = console.is_terminal and not quiet
    columns = TextColumn("{task.description}"), BarColumn(30), TextColumn("{task.percentage:.0f} %{task.fields[left]}")
    with Progress(*columns, console=console, transient=True, disable=not shown) as bar:
        task = bar.add_task("compiling" + (" (the first run takes longest)" if clock.cold else ""), total=1.0, left="")

        def show(sim):
            if clock.part == "ready":
                clock.begin("flow", sim)
                gc.freeze()  # the 80,000 objects that compiling has left for good: no step looks through them again
            now = clock.now(sim)
            if not now:
                return
            name = next((name for name in LEADING if name in recorder.measures), None)
            moved = f"  {title(name)} {written(name, recorder.measures[name])}" if name else ""
            text = f"{sim.time:.2f} of about {now['end_s']:.3g} s{moved}"
            if verbose:
                r = sim.report
                text += (
                    f"  dt {1e3 * r.dt:.2f} ms ({r.dt_limit}), iterations {r.outer_iterations}/{r.solver_iterations}"
                )
            bar.update(task, completed=now["fraction"], description=text, left=f", {duration_text(now['left_s'])} left")
            write_whole(recorder.folder.clock, json.dumps(now | {"measures": recorder.measures}))

        sim.each_step(show)
        try:
            yield
        finally:
            gc.unfreeze()  # what is frozen at the exit is not destroyed, and only what is destroyed keeps its kernels


def print_answer(summary: dict, verbose=False, stages=()) -> None:
    """Print the result: sentences, then each number with its meaning; the numerics with ``verbose`` or ``stages``."""
    console = Console(highlight=False)
    console.width = max(console.width, 40)  # columns
    with console.capture() as text:  # rich ends the program with 1 where nobody reads
        for sentence in result_sentences(summary):
            console.print(sentence, markup=False)
        shown = Table(show_header=False, box=None)
        for name, value, what in rows(summary):
            shown.add_row(escape(name), value, escape(what))
        console.print(shown)
        if verbose or stages:
            console.print(numerics_table(summary, stages))
    say(text.get(), end="")


def numerics_table(summary: dict, stages) -> Table:
    """Table of the numerics of a run, and of the time that each stage took."""
    shown = Table(title="numerics", show_header=False)
    for name, value in numerics(summary):
        shown.add_row(escape(name), escape(value))
    whole = sum(seconds for _, seconds, _ in stages)
    for stage, seconds, calls in sorted(stages, key=lambda entry: -entry[1]):
        each = f"{1e3 * seconds / max(calls, 1):.3f} ms {'an iteration' if stage == 'solve' else 'a call'}"
        shown.add_row(f"stage {stage}", f"{seconds:.2f} s, {seconds / whole:.0%}, {each}")
    return shown
