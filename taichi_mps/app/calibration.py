"""Result of a calibration in a sentence or two, from its facts as ``calibrate --json`` prints them."""

from ..problem.labels import in_words
from ..study.calibration import CONTRADICTION, NAMES, RHEOMETER, UNITS, short

MEASURE = {  # measurements that determine a constant which a calibration could not find
    "yield_value": {"slump_m": "the slump", "spread_m": "the slump flow"},
    "plastic_viscosity": {"t500_s": "T500", "v_funnel_s": "the V-funnel time"},
}
MEASUREMENTS = "this", "these two", "these three"  # words for one, two or three measurements


def verdict(facts: dict) -> str:
    """Sentences on the constants with their 95 % intervals, or why there are none, and on what to measure besides."""
    friction = "friction_angle" in facts["mix"]
    if facts["misfit"] > CONTRADICTION and not friction:
        alone = facts["alone"].get("yield_value", {}).items()
        said = [f"the {NAMES[name]} alone says {short(it[0], 2)} Pa" for name, it in alone if name != RHEOMETER]
        return f"No mix does all of this{': ' * bool(said)}{', '.join(said)}."
    known_texts, unknown = [], []
    for name, value in facts["mix"].items():
        words, unit, found = in_words(name), UNITS[name], (facts["friction"] if friction else facts)[name]
        low, high = (end and short(end, 2) for end in (found["lower"], found["upper"]))
        if found["low"] == found["high"]:
            known_texts.append(f"{words} {short(value, 2)} {unit}, as given")
        elif low or high:
            span = f"{low} to {high}" if low and high else f"at least {low}" if low else f"at most {high}"
            known_texts.append(f"{words} about {short(value, 2)} {unit} ({span})")
        else:
            unknown.append(name)
    sentences = ["; ".join(known_texts)] * bool(known_texts)
    for name in unknown:
        others = [words for key, words in MEASURE.get(name, {}).items() if key not in facts["measured"]]
        these = MEASUREMENTS[min(len(facts["measured"]), len(MEASUREMENTS)) - 1]
        sentences.append(
            f"The {in_words(name)} can't be told from {these}" + f": measure {' or '.join(others)}" * bool(others)
        )
    text = ". ".join(sentences)
    return f"{text[0].upper()}{text[1:]}."
