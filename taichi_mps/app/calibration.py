"""What a calibration found, in a sentence or two, from its facts as ``calibrate --json`` prints them."""

from ..problem.labels import in_words
from ..study.calibration import CONTRADICTION, NAMES, RHEOMETER, UNITS, short

MEASURE = {  # what tells a constant that a calibration could not find
    "yield_value": {"slump_m": "the slump", "spread_m": "the slump flow"},
    "plastic_viscosity": {"t500_s": "T500", "v_funnel_s": "the V-funnel time"},
}
UNTOLD = "this", "these two", "these three"  # measurements


def verdict(facts: dict) -> str:
    """The constants with their 95 % intervals, or why there are none; then what to measure besides."""
    friction = "friction_angle" in facts["mix"]
    if facts["misfit"] > CONTRADICTION and not friction:
        alone = facts["alone"].get("yield_value", {}).items()
        said = [f"the {NAMES[name]} alone says {short(it[0], 2)} Pa" for name, it in alone if name != RHEOMETER]
        return f"No mix does all of this{': ' * bool(said)}{', '.join(said)}."
    told, untold = [], []
    for name, value in facts["mix"].items():
        words, unit, found = in_words(name), UNITS[name], (facts["friction"] if friction else facts)[name]
        low, high = (end and short(end, 2) for end in (found["lower"], found["upper"]))
        if found["low"] == found["high"]:
            told.append(f"{words} {short(value, 2)} {unit}, as given")
        elif low or high:
            span = f"{low} to {high}" if low and high else f"at least {low}" if low else f"at most {high}"
            told.append(f"{words} about {short(value, 2)} {unit} ({span})")
        else:
            untold.append(name)
    sentences = ["; ".join(told)] * bool(told)
    for name in untold:
        others = [words for key, words in MEASURE.get(name, {}).items() if key not in facts["measured"]]
        these = UNTOLD[min(len(facts["measured"]), len(UNTOLD)) - 1]
        sentences.append(
            f"The {in_words(name)} can't be told from {these}" + f": measure {' or '.join(others)}" * bool(others)
        )
    text = ". ".join(sentences)
    return f"{text[0].upper()}{text[1:]}."
