"""Summary of a run, as in summary.json, and the check of its result."""

import math
import warnings
from html import escape

from .. import __version__
from ..problem import accuracy
from ..problem.labels import in_words, is_measure, title, written
from ..problem.materials import mix_in_words
from ..runtime import backend
from ..schemes.step_report import DivergedError, DomainError, UnmeasuredError
from ..units import quote

SLUMP = "slump_m"


class Summary(dict):
    """Content of summary.json, that prints as a table, in a notebook, too."""

    def rows(self) -> list[tuple[str, str]]:
        """Name and value of each entry, in words."""
        return [entry(key, value) for key, value in self.items()]

    def __str__(self):
        return "\n".join(f"{name:28} {value}" for name, value in self.rows())

    def _repr_html_(self) -> str:
        cells = (f"<tr><td>{escape(name)}</td><td>{escape(value)}</td></tr>" for name, value in self.rows())
        return f"<table>{''.join(cells)}</table>"


def entry(key: str, value) -> tuple[str, str]:
    """An entry of a summary in words: a result with its unit, mixes by their constants."""
    if isinstance(value, dict):
        return in_words(key), ", ".join(f"{in_words(k)} {quote(v, '')}" for k, v in value.items() if v is not None)
    if key == "materials":
        return "mix", "; ".join(map(mix_in_words, value))
    if is_measure(key):
        return title(key), "not known" if value is None else written(key, value)
    return in_words(key), quote(value, "")


def summary(sim) -> Summary:
    """Everything that describes the run, JSON-ready."""
    report = sim.report
    ended = sim.stopped_by not in (DivergedError.stopped_by, DomainError.stopped_by)  # else nothing can be measured
    measures = sim.measures() if ended else {}
    if math.isnan(measures.get(SLUMP, 0.0)):
        del measures[SLUMP]
    facts = described(sim.problem) | {
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
        "backend": backend.started(),
        "version": __version__,
    }
    found = accuracy.errors_of_run(facts) if SLUMP in measures else None
    if found:
        _, height, error = found  # None beyond the measured ones
        facts["slump_expected_error_m"] = height * error.slump if error else None
        facts["spread_expected_error_m"] = 2.0 * height * error.reach if error else None
    return Summary(facts)


def described(problem) -> dict:
    """Entries of summary.json that are known before a run starts."""
    facts = {
        "scene": problem.scene.name,
        "parameters": dict(problem.scene.parameters),
        "materials": [material.facts() for material in problem.materials],
        "scheme": problem.scheme,
        "numerics": problem.numerics.model_dump(),
    }
    return facts | ({"thin_solids_m": problem.thin_solids} if problem.thin_solids else {})


def judge(sim) -> None:
    """Check the result at the end of a run: warn if the volume was not kept on the way, raise an UnmeasuredError if the
    slump to be measured is no number."""
    worst = sim.report.volume_error_max if sim.report else 0.0
    if worst > accuracy.DOUBTFUL_VOLUME_ERROR:
        warnings.warn(
            f"volume_error_max = {worst:.1%}: the volume was not kept within {accuracy.DOUBTFUL_VOLUME_ERROR:.0%} all "
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
        facts["poured_m3" + "_per_m" * (sim.scene.dimension == 2)] = sum(
            pouring.volume * pouring.copies for pouring in sim.pouring
        )
        facts["pour_delay_s"] = max(pouring.delay for pouring in sim.pouring)
    if sim.scene.cavity:
        facts |= sim.scene.cavity.report(sim.snapshot())
        facts["void_m3"] *= 2 ** len(sim.scene.mirrors)
    return facts
