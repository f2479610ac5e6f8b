"""Description of a run in sentences, from its summary alone: results, expected errors, cost."""

import math
from pathlib import Path

import numpy as np

from ..engine import DOUBTFUL_VOLUME_ERROR
from ..forecast import accuracy
from ..input.labels import (
    RESULT_GROUPS,
    RESULTS,
    STOP_REASONS,
    in_words,
    is_measure,
    meaning,
    mix_in_words,
    title,
    written,
)
from ..io.history import COLUMNS
from ..units import plain
from .verdict import verdict

LEADING = "slump_m", "spread_m", "t500_s", "flow_m", "flow_time_s", "passing_ratio", "front_m", "filled_ratio"
EXPECTED = "_expected_error_m"  # end of the name of the error of a result
MEASURED = "slump_m", "spread_m"  # measures that are columns of every history
# Thickness of a bar over the spacing; by how much its resistance is too little in a viscous fluid, and too much in a
# Bingham fluid with tau_y D/(eta U) = 10 [%]: beside the exact drag, and beside bars four particles thick, in square
# arrays 8 to 20 bars wide (tests/boundaries/test_thin_bars.py)
THIN, TOO_LITTLE, TOO_MUCH = (0.4, 0.64, 1.0), (5.0, 11.0, 10.0), (31.0, 15.0, 6.0)
PASSING = "grains_number", "grains_passed_number", "mortar_passed_ratio"
# fraction of the grains beyond the bars, over that of the mortar, from which on they pass; level of significance at
# which fewer are not by accident; fraction beyond the bars up to which nothing passes
MIN_PASSING_RATIO, SIGNIFICANCE, NEGLIGIBLE_FRACTION = 0.5, 0.01, 0.01
# names of parts of a run other than their keys
PARTS = {"ready": "compiling", "pictures": "last pictures", "report": "pictures and report"}


def result_sentences(summary: dict) -> list[str]:
    """Sentences on the flow of a run: the verdict, its results, the reason of its end, doubts, expected errors."""
    known = [*doubts(summary), *thin_solids(summary), *grains(summary), certainty(summary)]
    return [*verdicts(summary), main_results(summary), ending(summary), *known]


def verdicts(summary: dict) -> list[str]:
    """Sentences that come first: how many grains pass, and the verdict."""
    return [*passing(summary), *filter(None, [verdict(summary)])]


def closing(summary: dict, folder) -> list[str]:
    """Sentences on the cost of a run, and on what lies in its folder."""
    shown = (
        ["Open report.html there: film, curves and all numbers on one page."]
        if (Path(folder) / "report.html").is_file()
        else []
    )
    return [cost(summary), f"The results lie in {plain(folder)}.", *shown]


def main_results(summary) -> str:
    """Sentence on the two main results, or else on the first two."""
    results = [name for name, value in summary.items() if is_measure(name) and isinstance(value, float | int)]
    of_scene = [name for name in results if name in RESULTS or not name.startswith(tuple(RESULT_GROUPS))]
    found = ([name for name in LEADING if name in results] or of_scene or results)[:2]
    text = ", ".join(f"{title(name)} {quoted(summary, name)}" for name in found)
    text = f"stopped before its end: {text}" if summary.get("stopped_by") == "interrupted" and found else text
    return f"{text[0].upper()}{text[1:]}." if found else "Nothing was measured."


def quoted(summary, name: str) -> str:
    """Format a result of a run with its unit, and with its expected error where that is known."""
    error = summary.get(name.removesuffix("_m") + EXPECTED)
    return written(name, summary[name]) + (f" ± {max(1.0, 1e3 * error):.0f} mm" if error else "")


def ending(summary, mixes=True) -> str:
    """Sentence on the reason and the time of the end and, with ``mixes``, on the mix; without, as the end of a
    sentence."""
    text = (
        f"{STOP_REASONS.get(summary['stopped_by'], summary['stopped_by'])} after {summary['simulated_seconds']:.2f} s"
    )
    if not mixes:
        return f"{text}."
    materials = summary.get("materials") or []
    mix = (
        f" ({mix_in_words(materials[0])})"
        if len(materials) == 1
        else (f" ({len(materials)} mixes)" if materials else "")
    )
    return f"{text[0].upper()}{text[1:]}{plain(mix)}."


def doubts(summary) -> list[str]:
    """Sentences on doubts about a result, each with a remedy."""
    worst, unmet = summary.get("volume_error_max") or 0.0, summary.get("unmet_steps", 0) / (summary.get("steps") or 1)
    found = [
        (
            worst > DOUBTFUL_VOLUME_ERROR,
            f"Doubtful: the volume was up to {worst:.1%} off on the way; take a smaller particle size (--spacing).",
        ),
        (
            "unmet_steps" in summary,
            f"In {unmet:.1%} of the steps the outer iterations ended before they met their tolerance; allow more of "
            "them (--outer-iterations).",
        ),
        (
            summary["stopped_by"] == "time",
            "The concrete may still move; a longer time limit (--until) follows it further.",
        ),
    ]
    return [text for holds, text in found if holds]


def thin_solids(summary) -> list[str]:
    """Sentences on the resistance of solids that are thinner than a particle."""
    spacing, found = summary.get("parameters", {}).get("spacing"), []
    for name, thickness in (summary.get("thin_solids_m") or {}).items():
        less, more = (np.interp(thickness / spacing if spacing else 0.0, THIN, each) for each in (TOO_LITTLE, TOO_MUCH))
        found.append(
            f"{name}: {1e3 * thickness:.2g} mm thick, thinner than a particle. A bar as thin resists a flow across it "
            f"by about {less:.0f} % too little where viscosity prevails, and by {more:.0f} % too much where the yield "
            "stress does."
        )
    return found


def grains(summary) -> list[str]:
    """Sentence on the grains, if there are some: the mix is then the mortar between them."""
    found = summary.get("grains")
    if not found:
        return []
    sizes = " and ".join(f"{1e3 * size:.3g}" for size in found["diameters_m"])
    taken = f"take {100.0 * found['volume_fraction']:.1f} % of the volume"
    shape = "" if found.get("shape") in (None, "disc", "sphere") else f" ({found['shape']})"
    return [
        f"{found['number']:,} rigid grains{shape} of {sizes} mm {taken}; the mix is the mortar between them, not the "
        "concrete."
    ]


def passing(summary) -> list[str]:
    """Sentence on how many grains are beyond the bars, and whether they pass: they block where their fraction there
    is less than half of that of the mortar, and so few have a probability below 1 % if each went with it. A run that
    was stopped has no verdict."""
    whole, passed, mortar = (summary.get(name) for name in PASSING)
    if passed is None or mortar is None or not whole:
        return []
    n, k, fraction = round(whole), round(passed), min(max(mortar, 0.0), 1.0)
    barred = summary.get("parameters", {}).get("bars", "none") not in ("none", "no")
    if not barred or summary.get("stopped_by") == "interrupted":
        place = "bars" if barred else "opening"
        text = f"{k} of {n} grains are beyond the {place}, with {100.0 * fraction:.0f} % of the mortar."
    else:
        p = sum(math.comb(n, j) * fraction**j * (1.0 - fraction) ** (n - j) for j in range(k + 1))
        verdict = "Passes" if k >= MIN_PASSING_RATIO * n * fraction else "Blocks" if p < SIGNIFICANCE else "Not decided"
        verdict = verdict if max(k / n, fraction) > NEGLIGIBLE_FRACTION else "Nothing passes"
        text = f"{verdict}: {k} of {n} grains pass, the mortar follows at {100.0 * fraction:.0f} %."
    discs = (summary.get("grains") or {}).get("shape", "").startswith(("disc", "clump of discs", "ellipse"))
    arch = "Discs in a plane arch otherwise than spheres: it tells no probability of a jam."
    return [f"{text} {arch if discs else 'A jam is a statistic: other seeds may tell otherwise.'}"]


def certainty(summary) -> str:
    """Sentence on the expected error from the table of measured errors, or that the table does not cover the run."""
    if summary.get("grains"):
        return "No accuracy data with grains; compare it with other seeds and a smaller particle size."
    found = accuracy.errors_of_run(summary)
    if found is None:
        return "No accuracy data for this case; compare it with a run of half the particle size."
    mix, height, error = found
    lifted = (
        "; lifting the mould, beside finer particles and shorter steps"
        if summary.get("parameters", {}).get("lift_speed") is not None
        else ""
    )
    if error is None:
        return (
            "No accuracy data for this mix or particle size; the nearest mix with data is "
            f"{accuracy.nearest(mix)} (standard cone). Compare it with a run of half the particle size."
        )
    return (
        f"Expect the slump within {1e3 * height * error.slump:.1f} mm and the slump flow within "
        f"{2e3 * height * error.reach:.0f} mm of the exact flow of this mix: measured for mixes and particle sizes "
        f"around this one, beside the project's own finite elements{lifted}. Scatter of the test and uncertainty of "
        "the constants are extra."
    )


def cost(summary) -> str:
    """Sentence on the time that a run took in all; a run of an earlier version, and a report, know no parts."""
    if "seconds_by_part" in summary:
        wall, cpu = sum(summary["seconds_by_part"].values()), summary["all_cpu_seconds"]
    else:
        wall, cpu = summary["wall_seconds"], summary["cpu_seconds"] + summary["compile_seconds"]
    return f"It took {duration_text(wall)} ({duration_text(cpu)} of processor time)."


def duration_by_part(seconds: dict, cpu_seconds: float) -> str:
    """Format wall time in all, processor time, and the wall time of each part."""
    parts = ", ".join(f"{PARTS.get(part, part)} {duration_text(value)}" for part, value in seconds.items())
    return f"{duration_text(sum(seconds.values()))} in all ({duration_text(cpu_seconds)} of processor time): {parts}"


def duration_text(seconds: float) -> str:
    """Format a duration [s] as text: 40 s, 5.2 min, 1.4 h."""
    for unit, size in (("h", 3600.0), ("min", 60.0)):
        if seconds >= 1.5 * size:
            return f"{float(f'{seconds / size:.2g}'):g} {unit}"
    return f"{float(f'{seconds:.2g}') if seconds >= 0.95 else max(0.1, round(seconds, 1)):g} s"


def measures(row: dict) -> dict:
    """Measures of the scene in a row of history.csv that have a value."""
    return {key: value for key, value in row.items() if is_scene_measure(key) and math.isfinite(value)}


def is_scene_measure(column: str) -> bool:
    """Whether a column of history.csv is a measure of the scene."""
    return is_measure(column) and (column in MEASURED or column not in COLUMNS)


def rows(summary) -> list[tuple[str, str, str]]:
    """Rows of a table of results: name, value with unit, and meaning."""
    return [
        (title(key), "not reached" if value is None else quoted(summary, key), meaning(key))
        for key, value in summary.items()
        if is_measure(key) and (value is None or isinstance(value, float | int)) and not key.endswith(EXPECTED)
    ]


def numerics(summary) -> list[tuple[str, str]]:
    """Rows of a table of the numerics: name and value."""
    facts = {
        "steps": f"{summary['steps']} in {summary['simulated_seconds']:.3f} s",
        "particles": f"{summary['fluid_particles']} fluid, {summary['wall_particles']} wall",
        "scheme": summary["scheme"],
        "left out": f"{summary['left_out']:.0%} of the particles, which stood still, mean of all steps",
        "volume error": f"{summary['volume_error']:.2%} at the end, at most {summary['volume_error_max']:.2%}",
    } | summary.get("numerics", {})
    if "seconds_by_part" in summary:
        facts["time"] = duration_by_part(summary["seconds_by_part"], summary["all_cpu_seconds"])
    # forces are among the results; a scene may measure them by itself
    return [(in_words(key), str(value)) for key, value in facts.items() if key != "wall_loads"]
