"""A run in words, from its summary alone: what was measured, how sure that is, what it cost."""

from math import isfinite
from pathlib import Path

from ..io.history import COLUMNS
from ..problem import accuracy
from ..problem.labels import ENDS, in_words, is_measure, meaning, title, written
from ..problem.materials import mix_in_words
from ..units import plain

OWN = " This is the error of the computation; the test's own and that of the constants come to it."
LEADING = "slump_m", "spread_m", "t500_s", "flow_m", "flow_time_s", "passing_ratio", "front_m", "filled_ratio"
MEASURED = "slump_m", "spread_m"  # of the columns that every history has
PARTS = {"ready": "making ready", "pictures": "last pictures"}  # of a run, in words where its key is none


def sentences(summary: dict, folder=None) -> list[str]:
    """Sentences on a result: what was measured, why it ended, how sure it is, what it cost and, with a ``folder``,
    where it lies."""
    found = [
        measured(summary),
        ending(summary),
        *doubts(summary),
        *thin_solids(summary),
        certainty(summary),
        cost(summary),
    ]
    if folder is not None:
        found.append(f"Pictures and results lie in {plain(folder)}.")
        if (Path(folder) / "report.html").is_file():
            found.append("Open report.html there: film, curves and all numbers on one page.")
    return found


def measured(summary) -> str:
    """The two results that people ask for first, or else the first two."""
    known = [name for name, value in summary.items() if is_measure(name) and isinstance(value, float | int)]
    found = ([name for name in LEADING if name in known] or known)[:2]
    text = ", ".join(f"{title(name)} {written(name, summary[name])}" for name in found)
    return f"{text[0].upper()}{text[1:]}." if found else "Nothing was measured."


def ending(summary, mixes=True) -> str:
    """Why and when it ended and, with ``mixes``, of what mix; without them as the end of a sentence."""
    reason = ENDS.get(summary["stopped_by"], str(summary["stopped_by"]))
    told = f"{reason} after {summary['simulated_seconds']:.2f} s"
    if not mixes:
        return f"{told}."
    known = summary.get("materials") or []
    mix = f" ({mix_in_words(known[0])})" if len(known) == 1 else f" ({len(known)} mixes)" * bool(known)
    return f"{told[0].upper()}{told[1:]}{plain(mix)}."


def doubts(summary) -> list[str]:
    """Doubts about a result, each with what to do."""
    found = []
    worst = summary.get("volume_error_max") or 0.0
    if worst > accuracy.MOST_VOLUME_ERROR:
        found.append(
            f"Doubtful: the volume was up to {worst:.1%} off on the way; take a smaller particle size (--spacing)."
        )
    if "unmet_steps" in summary:
        found.append(
            f"In {summary['unmet_steps'] / summary['steps']:.1%} of the steps the outer iterations ended before they met "
            "their tolerance; allow more of them (--passes)."
        )
    if summary["stopped_by"] == "time":
        found.append("The concrete may still move; a longer time limit (--until) follows it further.")
    return found


def thin_solids(summary) -> list[str]:
    """Resistance of each solid that is thinner than a particle, in words: tests/boundaries/test_thin_bars.py
    holds it against the exact drag of an array of cylinders."""
    return [
        f"{name}: {1e3 * thickness:.2g} mm thick, thinner than a particle. Such a bar resists a viscous flow across it "
        "by up to a quarter less than it should; with a yield stress that was not measured."
        for name, thickness in (summary.get("thin_solids_m") or {}).items()
    ]


def certainty(summary) -> str:
    """The error to expect, from the committed table of measured ones; where that does not reach, that it does not."""
    found = accuracy.of_run(summary)
    if found is None:
        return "How accurate this is was not measured for such a run; compare it with one of half the particle size."
    mix, height, error = found
    if error is None:
        return (
            "This mix or particle size lies outside of those whose errors were measured, so how accurate this is is "
            f"not known; the nearest mix that was measured is {accuracy.nearest(mix)} (standard cone). Compare it with "
            "a run of half the particle size."
        )
    return (
        f"Expect the slump within {1e3 * height * error.slump:.1f} mm and the slump flow within "
        f"{2e3 * height * error.reach:.0f} mm of the exact flow of this mix: measured for mixes and particle sizes "
        f"around this one, beside independent finite elements.{OWN}"
    )


def cost(summary) -> str:
    """Time that a run took, in all and by its parts; of a run of an earlier version without the files."""
    if "seconds_by_part" in summary:
        return f"It took {in_parts(summary['seconds_by_part'], summary['all_cpu_seconds'])}."
    cpu, start, wall = (summary[f"{key}_seconds"] for key in ("cpu", "compile", "wall"))
    return f"It took {in_time(wall)} ({in_time(cpu + start)} of processor time)."


def in_parts(seconds: dict, cpu_seconds: float) -> str:
    """Wall time in all, processor time, and the wall time of each part."""
    parts = ", ".join(f"{PARTS.get(part, part)} {in_time(value)}" for part, value in seconds.items())
    return f"{in_time(sum(seconds.values()))} in all ({in_time(cpu_seconds)} of processor time): {parts}"


def in_time(seconds: float) -> str:
    """A duration as people say it: 40 s, 5.2 min, 1.4 h."""
    for unit, size in (("h", 3600.0), ("min", 60.0)):
        if seconds >= 1.5 * size:
            return f"{float(f'{seconds / size:.2g}'):g} {unit}"
    return f"{float(f'{seconds:.2g}') if seconds >= 0.95 else max(0.1, round(seconds, 1)):g} s"


def measures(row: dict) -> dict:
    """The measures of the scene in a row of history.csv that have a value."""
    return {key: value for key, value in row.items() if of_scene(key) and isfinite(value)}


def of_scene(column: str) -> bool:
    """Whether a column of history.csv is a measure of the scene."""
    return is_measure(column) and (column in MEASURED or column not in COLUMNS)


def rows(summary) -> list[tuple[str, str, str]]:
    """Each result: its name, its value with unit, and what it is; '-' for what was not reached."""
    return [
        (title(key), "not reached" if value is None else written(key, value), meaning(key))
        for key, value in summary.items()
        if is_measure(key)
        and (value is None or isinstance(value, float | int))
        and not (value is None and key.endswith("expected_error_m"))
    ]


def numerics(summary) -> list[tuple[str, str]]:
    """Numbers of the method, for those who know it."""
    facts = {
        "steps": f"{summary['steps']} in {summary['simulated_seconds']:.3f} s",
        "particles": f"{summary['fluid_particles']} fluid, {summary['wall_particles']} wall",
        "scheme": summary["scheme"],
        "left out": f"{summary['left_out']:.0%} of the particles, which stood still, mean of all steps",
        "volume error": f"{summary['volume_error']:.2%} at the end, at most {summary['volume_error_max']:.2%}",
    } | summary.get("numerics", {})
    return [(in_words(key), str(value)) for key, value in facts.items()]
