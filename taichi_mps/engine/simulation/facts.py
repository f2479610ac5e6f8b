"""What a run tells about itself, and the check of its result at the end."""

import math
import warnings

from ..runtime.backend import started
from ..schemes.step_report import DOUBTFUL_VOLUME_ERROR, DivergedError, DomainError, UnmeasuredError

SLUMP = "slump_m"


def facts_of(sim) -> dict:
    """Everything that describes the run, JSON-ready."""
    report = sim.report
    ended = sim.stopped_by not in (DivergedError.stopped_by, DomainError.stopped_by)  # else nothing can be measured
    measures = sim.measures() if ended else {}
    if math.isnan(measures.get(SLUMP, 0.0)):
        del measures[SLUMP]
    return sim.problem.facts() | {
        "fluid_particles": sim.fluid_particles,
        "wall_particles": sim.wall_particles,
        "steps": sim.steps,
        "left_out": sim.scheme.left_out,
        "simulated_seconds": sim.time,
        "wall_seconds": sim.wall_seconds,
        "cpu_seconds": sim.cpu_seconds,
        "compile_seconds": sim.compile_seconds,
        "stopped_by": sim.stopped_by,
        **({"unmet_steps": sim.scheme.unmet} if sim.scheme.unmet else {}),
        **measures,
        **(filling(sim) if ended else {}),
        "volume_error": report.volume_error if report else 0.0,
        "volume_error_max": report.volume_error_max if report else 0.0,
        "backend": started(),
    }


def judge(sim) -> None:
    """Check the result at the end of a run: warn if the volume was not kept on the way, raise an UnmeasuredError if the
    slump to be measured is no number."""
    worst = sim.report.volume_error_max if sim.report else 0.0
    if worst > DOUBTFUL_VOLUME_ERROR:
        warnings.warn(
            f"volume_error_max = {worst:.1%}: the volume was not kept within {DOUBTFUL_VOLUME_ERROR:.0%} all "
            "the time; a smaller spacing keeps it better, or effective_radius_ratio = 2.6 where the layer is thin",
            stacklevel=1,  # by text: of the command line one line
        )
    if sim.watched and sim.stopped_by != "interrupted" and math.isnan(sim.measures().get(SLUMP, 0.0)):
        raise UnmeasuredError(
            f"{SLUMP} at t = {sim.time:.6g} s, step {sim.steps}, is no number: nothing is left at the axis; take a "
            "smaller spacing, or an earlier until",
            sim.report,
            sim.stopped_by,
        )


def filling(sim) -> dict:
    """Volume that has been poured, and filled part of the cavity; both of the whole body."""
    facts = {}
    if sim.pouring:
        facts["poured_m3" + ("_per_m" if sim.scene.dimension == 2 else "")] = sum(
            pouring.volume * pouring.copies for pouring in sim.pouring
        )
        facts["pour_delay_s"] = max(pouring.delay for pouring in sim.pouring)
    if sim.scene.cavity:
        facts |= sim.scene.cavity.report(sim.snapshot())
        facts |= {key: facts[key] * 2 ** len(sim.scene.mirrors) for key in ("void_m3", "above_m3")}
    return facts
