"""What is known of a run before it starts, in lines: size, memory, time, accuracy, and bars too thin for its
particles."""

import io
import os
from contextlib import redirect_stdout

from ..report.sentences import certainty, in_parts, thin_solids
from ..runtime.memory import size
from .stopped import began


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
