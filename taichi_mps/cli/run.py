"""Carry a simulation out for the command line: start Taichi, run, record, stop on request, report."""

import io
import json
import math
import signal
import sys
import time
import warnings
from contextlib import contextmanager, redirect_stdout

from ..io.run_folder import write_whole
from ..units import plain
from . import case_file
from .console import Painter, curves, progress, report, result
from .options import DIVERGED, DONE
from .stopped import SIGNALS, Stopped, came

OUTPUTS_OF_A_FALL = 0.3  # interval of the outputs over sqrt(H/g): what comes to rest falls much faster than it creeps


def start(options) -> None:
    """Start Taichi without its greeting, which would spoil --json."""
    from ..runtime.backend import init

    with redirect_stdout(io.StringIO()):
        init(options.arch, getattr(options, "precision", "f32"), options.threads)


def forecast(problem, precision: str) -> list[str]:
    """What a run will be, in lines for a reader; without the greeting of Taichi."""
    with redirect_stdout(io.StringIO()):
        from ..report.forecast import forecast as lines_of
    return lines_of(problem, precision)


def carry_out(sim, folder, options, source, as_json, resumed=False) -> int:
    """Run to the end, to an interrupt or a divergence, and leave a whole run folder behind in each case."""
    from ..io.recorder import Recorder
    from ..simulation.simulation import DivergedError
    from ..viz.render import gif

    until = sim.scene.until
    longest = OUTPUTS_OF_A_FALL * sim.problem.fall_time if sim.scene.stop_at_rest else until
    every = options.every or rounded(min(until / 100, longest))
    settings = options.model_dump(exclude={"out", "overwrite", "profile", "quiet", "verbose"}, exclude_none=True)
    settings |= {"every": every}
    error, begun, painter = None, time.process_time(), Painter(folder.frames, options, [sim.scene])
    if not (as_json or options.quiet):
        warnings.filterwarnings("ignore", "volume_error_max")  # the result says it in its own words
    with interruptible(sim) as signals:
        if not resumed:
            folder.create(options.overwrite)
        case = case_file.text(source, sim.problem, settings | {"until": until})
        write_whole(folder.case, case)
        recorder = Recorder(folder, sim, every, source, settings, painter.draw)
        try:
            with progress(sim, recorder, options):
                stopped_by = sim.run() if sim.time < until - 1e-9 else "time"
        except DivergedError as failure:
            stopped_by, error = failure.stopped_by, str(failure)
    summary, end = recorder.finish(stopped_by, error), time.process_time()
    if folder.pictures:
        gif(folder.pictures, folder.animation)
    curves(folder, options.verbose or options.profile, sim)
    report(folder, sim.scene)
    if as_json:
        print(json.dumps(summary))
    elif not options.quiet:
        spent = {
            "before the run": begun,
            "run and its files": end - begun - painter.seconds,
            "pictures": painter.seconds,
        }
        spent |= {"animation and plots": time.process_time() - end}
        result(summary, folder, options.verbose, sim.profile(), spent)
    if error:
        print(f"taichi-mps: {plain(error)}; resume from {plain(folder.checkpoint)}", file=sys.stderr)
        return DIVERGED
    return 128 + signals[0] if stopped_by == "interrupted" else DONE


def rounded(interval: float) -> float:
    """The nearest of 1, 2, 5 times a power of ten [s]."""
    power = 10.0 ** math.floor(math.log10(interval))
    return min((k * power for k in (1.0, 2.0, 5.0, 10.0)), key=lambda value: abs(math.log(value / interval)))


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
