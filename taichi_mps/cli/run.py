"""Carry a simulation out for the command line: tell what it will take, start Taichi, run, record, stop on request,
report."""

import io
import json
import os
import signal
import sys
import warnings
from contextlib import contextmanager, redirect_stdout

from ..io.run_folder import write_whole
from ..report.sentences import certainty, in_parts, thin_solids
from ..runtime.memory import size
from ..units import plain
from . import case_file
from .console import curves, progress, report, result
from .options import DIVERGED, DONE
from .stopped import SIGNALS, Stopped, began, came


def start(options) -> None:
    """Start Taichi without its greeting, which would spoil --json."""
    from ..runtime.backend import init

    with redirect_stdout(io.StringIO()):
        init(options.arch, getattr(options, "precision", "f32"), options.threads)


def clock_of(problem, options):
    """The clock of a run, which began with the program."""
    with redirect_stdout(io.StringIO()):  # the greeting of Taichi would spoil --json
        from ..simulation.clock import Clock

    every = options.every or problem.usual_interval
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    settings = {"arch": options.arch, "precision": options.precision, "threads": options.threads or cores}
    return Clock(problem, settings, every, began[0] if began else None)


def lines(problem, clock) -> list[str]:
    """Lines for a reader."""
    from ..simulation.forecast import memory_of, pairs_of, particles_of
    from ..simulation.summary import described

    scene, facts = problem.scene, described(problem)
    part = {1: ", half of the body", 2: ", a quarter of the body"}.get(len(scene.mirrors), "")
    part = f", model {scene.parameters['model']}" if "model" in scene.parameters else part
    what = f"{particles_of(problem):,} particles of {1e3 * scene.spacing:.3g} mm{part}"
    needed = size(memory_of(problem, pairs_of(scene), clock.precision))
    pours = f"Pours {1e3 * sum(inlet.volume for inlet in scene.inlets):.3g} l. " if scene.inlets else ""
    takes = f"Takes about {in_parts(clock.expected, clock.cpu_seconds)}"
    first = "; shorter the next time" * clock.cold
    time = f"{pours}{takes}, some {float(f'{clock.cost.steps:.2g}'):,.0f} steps{first}."
    return [f"{what}; about {needed} of memory.", time, certainty(facts), *thin_solids(facts)]


def carry_out(sim, folder, options, source, as_json, clock, resumed=False) -> int:
    """Run to the end, to an interrupt or a divergence, and leave a whole run folder behind in each case."""
    from ..io.recorder import Recorder
    from ..simulation.simulation import DivergedError
    from ..viz.film import SideBySide
    from ..viz.render import gif

    until = sim.scene.until
    settings = options.model_dump(exclude={"out", "overwrite", "profile", "quiet", "verbose"}, exclude_none=True)
    settings |= {"every": clock.every}
    error, quiet = None, as_json or options.quiet
    if not quiet:
        warnings.filterwarnings("ignore", "volume_error_max")  # the result says it in its own words
    with interruptible(sim) as signals:
        if not resumed:
            folder.create(options.overwrite)
        write_whole(folder.case, case_file.text(source, sim.problem, settings | {"until": until}))
        draw = SideBySide([sim.scene], folder.frames, options).draw
        recorder = Recorder(folder, sim, clock.every, source, settings, draw)
        try:
            with progress(sim, recorder, quiet, options.verbose, clock):
                stopped_by = sim.run() if sim.time < until - 1e-9 else "time"
        except DivergedError as failure:
            stopped_by, error = failure.stopped_by, str(failure)
    clock.begin("pictures")
    summary = recorder.finish(stopped_by, error)
    if folder.pictures:
        gif(folder.pictures, folder.animation, every=clock.every)
    clock.begin("report")
    written, numerics = report(folder, sim.scene), options.verbose or options.profile
    curves(folder, numerics, sim, options.plots or numerics or not written)
    is_whole = not (resumed or error or stopped_by == "interrupted")
    summary |= clock.finish(is_whole)
    folder.write_summary(summary)
    folder.clock.unlink(missing_ok=True)
    if as_json:
        print(json.dumps(summary))
    elif not options.quiet:
        result(summary, folder, options.verbose, sim.profile())
    if error:
        print(f"taichi-mps: {plain(error)}; resume from {plain(folder.checkpoint)}", file=sys.stderr)
        return DIVERGED
    return 128 + signals[0] if stopped_by == "interrupted" else DONE


@contextmanager
def interruptible(sim):
    """Ctrl-C and SIGTERM finish the step and stop; a second one stops at once. Gives the list of those that came."""

    signals = []

    def stop(number, frame):
        signals.append(number)
        if len(signals) > 1:
            raise Stopped(number)
        sim.interrupt()

    before = {number: signal.signal(number, stop) for number in SIGNALS}
    for number in came[:1]:  # what was being imported swallowed the exception, as Taichi's modules may
        stop(number, None)
    try:
        yield signals
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
