"""What describes a whole run, as summary.json has it."""

from .. import __version__
from ..runtime import backend


def summary(sim) -> dict:
    """Everything that describes the run, JSON-ready."""
    report = sim.report
    return {
        "scene": sim.scene.name,
        "parameters": dict(sim.scene.parameters),
        "materials": [material.facts() for material in sim.problem.materials],
        "scheme": sim.problem.scheme,
        "numerics": sim.numerics.model_dump(),
        "fluid_particles": sim.fluid_particles,
        "wall_particles": sim.wall_particles,
        "steps": sim.steps,
        "simulated_seconds": sim.time,
        "wall_seconds": sim.wall_seconds,
        "cpu_seconds": sim.cpu_seconds,
        "compile_seconds": sim.compile_seconds,
        "stopped_by": sim.stopped_by,
        **({} if sim.stopped_by == "diverged" else sim.measures()),  # nothing can be measured on what is left
        **({} if sim.stopped_by == "diverged" else filling(sim)),
        "volume_error": report.volume_error if report else 0.0,
        "backend": backend.started(),
        "version": __version__,
    }


def filling(sim) -> dict:
    """What has been poured, and what is filled of the cavity; both of the whole body."""
    facts = {}
    if sim.pouring:
        facts["poured_m3"] = sum(pouring.volume * pouring.copies for pouring in sim.pouring)
        facts["pour_delay_s"] = max(pouring.delay for pouring in sim.pouring)
    if sim.scene.cavity:
        facts |= sim.scene.cavity.report(sim.snapshot())
        facts["void_m3"] *= 2 ** len(sim.scene.mirrors)
    return facts
